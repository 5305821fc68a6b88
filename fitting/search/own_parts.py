"""A geometry and force terms of a user's own, named by `module:Class`, with what they declare."""

from collections.abc import Mapping, Sequence
from typing import Any

from famjax.boundary.class_path import class_named
from famjax.boundary.errors import InputError
from famjax.geometries import AbstractGeometry
from famjax.parameters import Declared
from famjax.terms import AbstractForceTerm

from ..data.force_data import ForceData
from ..families.parameters import Parameter
from .posing import source_of


def own_parts(
    data: Sequence[ForceData], geometry: str | None, terms: Sequence[str]
) -> tuple[dict[str, Any], dict[str, Declared]]:
    """The options of `identify` that these classes are, and the numbers that they declare.

    Args:
        data: the maps, which have one set of parts.
        geometry: module:Class of a geometry around the estimated one, or None.
        terms: module:Class of each force term.

    Returns:
        (options, declarations by name).

    Raises:
        InputError: a class that is not found or is something else, or a term that needs a number
            which it does not declare.
    """
    options: dict[str, Any] = {}
    declared: dict[str, Declared] = {}
    if geometry is not None:
        options["geometry"] = class_named(geometry, AbstractGeometry, "geometry")
        for one in data:
            declared |= source_of(one, options["geometry"], ()).declared
    for path in terms:
        try:
            term = class_named(path, AbstractForceTerm, "force term").template()
        except ValueError as error:
            raise InputError(
                f"the force term {path} cannot be identified by its class: {error}"
            ) from None
        options["terms"] = options["terms"] + term if "terms" in options else term
        declared |= term.declared()
    return options, declared


def taking_part(
    declared: Mapping[str, Declared], named: Mapping[str, object]
) -> dict[str, Parameter]:
    """All numbers of a user's own parts that are not named otherwise, in their declared ranges."""
    return {name: Parameter() for name in declared if name not in named}

"""A geometry and force terms of a user's own, named by `module:Class`, with what they declare."""

import hashlib
import re
import types
from collections.abc import Mapping, Sequence
from typing import Any

import equinox as eqx
import jax
import numpy as np

from famjax.boundary.class_path import class_named, class_path
from famjax.boundary.errors import InputError
from famjax.geometries import AbstractGeometry
from famjax.parameters import Declared
from famjax.terms import AbstractForceTerm

from ..data.force_data import ForceData
from ..families.parameters import Parameter
from .posing import source_of


def own_parts(
    data: Sequence[ForceData], geometry: str | type | None, terms: Sequence[str | type]
) -> tuple[dict[str, Any], dict[str, Declared]]:
    """The options of `identify` that these classes are, and the numbers that they declare.

    Args:
        data: the maps, which have one set of parts.
        geometry: a geometry around the estimated one, its class or module:Class, or None.
        terms: each force term, its class or module:Class.

    Returns:
        (options, declarations by name).

    Raises:
        InputError: a class that is not found or is something else, or a term that needs a number
            which it does not declare.
    """
    options: dict[str, Any] = {}
    declared: dict[str, Declared] = {}
    if geometry is not None:
        if isinstance(geometry, str):
            geometry = class_named(geometry, AbstractGeometry, "geometry")
        options["geometry"] = geometry
        for one in data:
            declared |= source_of(one, options["geometry"], ()).declared
    for path in terms:
        kind = class_named(path, AbstractForceTerm, "force term") if isinstance(path, str) else path
        try:
            term = kind.template()
        except ValueError as error:
            raise InputError(
                f"the force term {path} cannot be identified by its class: {error}"
            ) from None
        options["terms"] = options["terms"] + term if "terms" in options else term
    if terms:
        # Of two numbers of one name the later one has a longer one in the sum.
        declared |= options["terms"].declared()
    return options, declared


def taking_part(
    declared: Mapping[str, Declared], named: Mapping[str, object]
) -> dict[str, Parameter]:
    """All numbers of a user's own parts that are not named otherwise, in their declared ranges."""
    return {name: Parameter() for name in declared if name not in named}


def fingerprint(part: Any) -> str:
    """A digest of a law, geometry or term of a user's own: its class, what is static in it, its numbers."""
    leaves, treedef = jax.tree.flatten(part)
    digest = hashlib.sha256(f"{_named(part)} {_ADDRESS.sub('', str(treedef))}".encode())
    for leaf in leaves:
        if eqx.is_array_like(leaf):
            digest.update(np.ascontiguousarray(leaf, "<f8").tobytes())
        else:
            digest.update(_named(leaf).encode())
    return digest.hexdigest()


_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def _named(value: Any) -> str:
    named = value if isinstance(value, type | types.FunctionType) else type(value)
    return class_path(named) + ("" if named is value else _ADDRESS.sub("", repr(value)))

"""What a muscle card holds of each part of a muscle, as the class of the part declares it.

A number says its unit where it is declared (`famjax.parameter`, `famjax.parameters.number`), and a
field that is a part says its class: there is no table of classes, and one of a modeller's own has a
card too.
"""

import dataclasses
import functools
import types
import typing
from collections.abc import Mapping
from typing import Any

import equinox as eqx

from .. import (
    braids,
    continuation,
    geometries,
    materials,
    measured,
    muscle,
    profiles,
    slip,
    surfaces,
    terms,
)  # fmt: skip
from ..boundary.class_path import class_named, class_path
from ..boundary.errors import InputError
from ..parameters import declaration


@dataclasses.dataclass(frozen=True)
class CardPart:
    """A field that holds a part, written as an object with its own `type`.

    Attributes:
        base: what the part must be.
        untyped: the class of an object without `type`, as famjax-fit/1 first wrote them.
        optional: None is a value too.
        many: a list of parts.
    """

    base: type
    untyped: type | None = None
    optional: bool = False
    many: bool = False


Fields = Mapping[str, str | CardPart]
"""Name of each field, with the unit that its key ends in, "" for a pure number, or its part."""

MUSCLE: Fields = {
    "geometry": CardPart(geometries.AbstractGeometry),
    "material": CardPart(materials.AbstractMaterial),
    "deadband_pressure": "Pa",
}
"""A muscle of a pressurised braid and the wall of one material."""

MUSCLE_OF_TERMS: Fields = {
    "geometry": CardPart(geometries.AbstractGeometry),
    "terms": CardPart(terms.AbstractForceTerm, many=True),
}
"""A muscle with other terms."""

_UNTYPED = {braids.AbstractBraid: braids.Braid, geometries.Bladder: geometries.Bladder}
_ROOMS = (
    braids, geometries, materials, measured, muscle, continuation, profiles, surfaces, slip, terms,
)  # fmt: skip
_PLAIN = (bool, int, float, tuple[float, ...])


@functools.cache
def fields_of(cls: type[eqx.Module]) -> Fields:
    """The fields of a class, in the order of its constructor.

    Raises:
        InputError: a field that is neither a declared number nor a part.
    """
    found: dict[str, str | CardPart] = {}
    for field in dataclasses.fields(cls):
        if not field.init or field.name.startswith("_"):
            continue
        spec = declaration(field)
        if spec is not None and isinstance(spec.unit, str):
            found[field.name] = _in_key(spec.unit)
        elif spec is not None or field.type in _PLAIN:
            found[field.name] = ""
        else:
            found[field.name] = _part(cls, field.name, field.type)
    return found


def _in_key(unit: str) -> str:
    """A unit as a key says it: `N_per_m` of N/m, `per_N` of 1/N."""
    return f"per_{unit[2:]}" if unit.startswith("1/") else unit.replace("/", "_per_")


def _part(cls: type, name: str, annotation: Any) -> CardPart:
    origin, arguments = typing.get_origin(annotation), typing.get_args(annotation)
    optional = origin in {typing.Union, types.UnionType} and type(None) in arguments
    many = origin is tuple
    base = arguments[0] if optional or many else annotation
    if not (isinstance(base, type) and issubclass(base, eqx.Module)):
        raise InputError(
            f"no card can hold the field {name!r} of {cls.__name__}: declare a number by "
            "famjax.parameter or famjax.parameters.number with its unit, and a part by its class"
        )
    return CardPart(base, untyped=_UNTYPED.get(base), optional=optional, many=many)


def type_written(cls: type) -> str:
    """How a card names a class: by its own name, or as `module:Class` if it is not famjax's.

    Raises:
        InputError: a class that cannot be found by its path.
    """
    if _own_class(cls.__name__) is cls:
        return cls.__name__
    if "<locals>" in cls.__qualname__:
        raise InputError(
            f"{cls.__name__} is defined in a function, where no card finds it again: define the "
            "class in a module"
        )
    return class_path(cls)


def type_read(name: Any, base: type, where: str) -> type:
    """The class that a card names, of those that may stand there.

    Raises:
        InputError: no such class.
    """
    if isinstance(name, str) and ":" in name:
        return class_named(name, base, f"type of {where} of the muscle card")
    found = _own_class(name) if isinstance(name, str) else None
    if found is None or not issubclass(found, base):
        raise InputError(
            f"{where} of the muscle card is of the unknown type {name!r}; known are "
            f"{', '.join(known_types(base))}, and module:Class for one of your own"
        )
    return found


def known_types(base: type) -> list[str]:
    """Names of famjax's own classes that may stand for a base."""
    classes = {name: _own_class(name) for room in _ROOMS for name in vars(room)}
    return sorted(name for name, cls in classes.items() if cls and issubclass(cls, base))


def _own_class(name: str) -> type | None:
    """The concrete class of that name in a room that a muscle is made of; no other is imported."""
    if name.startswith("Abstract"):
        return None
    found = [vars(room)[name] for room in _ROOMS if name in vars(room)]
    return next((one for one in found if isinstance(one, type) and _of_a_room(one)), None)


def _of_a_room(cls: type) -> bool:
    return cls.__module__ in {room.__name__ for room in _ROOMS}

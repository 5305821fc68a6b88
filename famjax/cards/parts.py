"""Convert a muscle to plain data with units in the keys, and back.

The unit of each number is taken from its declaration (`famjax.parameter`, `famjax.parameters.number`),
and the class of each part from its annotation. There is no fixed table of classes, so a card can also
contain user-defined classes.
"""

import dataclasses
import functools
import importlib
import typing
from typing import Any, NamedTuple

import equinox as eqx
import numpy as np

import famjax

from .. import geometries, materials, terms
from .._arrays import as_number
from ..boundary.errors import InputError, Own, check_trusted, class_named, class_path
from ..muscle import AbstractMuscle, Muscle
from ..parameters import declaration

_ROOMS = (
    "braids", "geometries", "materials", "muscle", "measured", "continuation", "profiles", "surfaces",
    "slip", "terms", "equilibrium",
)  # fmt: skip
_PLAIN = (bool, int, float, tuple[float, ...])


class Form(NamedTuple):
    """Required form of one entry.

    Attributes:
        field: name of the argument to the constructor.
        annotation: type of a number, or base class of a part.
        is_part: True for a part, False for a number.
        optional: True if None is allowed.
        many: True for a list of parts.
    """

    field: str
    annotation: Any
    is_part: bool = False
    optional: bool = False
    many: bool = False


Forms = dict[str, Form]
"""Form of each entry by its key, in the order of the constructor's arguments."""

_GEOMETRY = {"geometry": Form("geometry", geometries.AbstractGeometry, is_part=True)}
_TERMS = {"terms": Form("terms", terms.AbstractForceTerm, is_part=True, many=True)}
_MATERIAL = {"material": Form("material", materials.AbstractMaterial, is_part=True)}


def muscle_as_dict(muscle: AbstractMuscle) -> dict[str, Any]:
    """Return the muscle as JSON-ready data in SI, without rounding.

    Raises:
        InputError: a part of the muscle cannot be stored in a card, or a number is not finite.
    """
    return _written(muscle, "muscle")


def muscle_from_dict(card: dict[str, Any], *, own: Own = ()) -> AbstractMuscle:
    """Build a muscle from the data in a card, in JAX's precision; enable float64 to keep every digit.

    Args:
        card: output of `muscle_as_dict`.
        own: trusted modules and classes, such as `("my_rubber",)` or `(Gent,)`. No other module from
            outside famjax is imported.

    Raises:
        InputError: an entry is missing or unexpected, a type is unknown or not trusted, or the values do
            not describe a muscle.
    """
    of_mechanics = isinstance(card, dict) and card.get("type") == "EquilibriumMuscle"
    return _read(card, famjax.EquilibriumMuscle if of_mechanics else Muscle, "muscle", own)


@functools.cache
def forms_of(cls: type) -> Forms:
    """Return the form of each entry for a class.

    Raises:
        InputError: a field is neither a declared number nor a part.
    """
    found: Forms = {}
    for field in dataclasses.fields(cls):
        if not field.init or field.name.startswith("_"):
            continue
        spec, arguments = declaration(field), typing.get_args(field.type)
        optional = type(None) in arguments
        many = typing.get_origin(field.type) is tuple and field.type not in _PLAIN
        kind: Any = arguments[0] if optional or many else field.type
        is_part = isinstance(kind, type) and issubclass(kind, eqx.Module)
        if spec is None and kind not in _PLAIN and not is_part:
            raise InputError(
                f"a card cannot store the field {field.name!r} of {cls.__name__}: if the field is a "
                "number, declare it and its unit with famjax.parameter or famjax.parameters.number; if "
                "it is a part, annotate it with the class of the part"
            )
        unit = spec.unit if spec is not None and isinstance(spec.unit, str) else ""
        found[_key(field.name, unit)] = Form(field.name, kind, is_part, optional, many)
    return found


def _key(name: str, unit: str) -> str:
    """Return the key for a number, such as `rate_N_per_m` for N/m or `compliance_per_N` for 1/N."""
    said = f"per_{unit[2:]}" if unit.startswith("1/") else unit.replace("/", "_per_")
    return f"{name}_{said}" if said else name


def _muscle_forms(*, usual: bool) -> Forms:
    """Return the forms for a muscle, with either material and deadband, or its terms."""
    usual_term: Any = terms.PressurisedBraid
    return _GEOMETRY | (_MATERIAL | forms_of(usual_term) if usual else _TERMS)


# --- to plain data


def _written(part: Any, where: str) -> dict[str, Any]:
    """Convert a part to a JSON object with its type and fields."""
    forms = forms_of(type(part))
    if isinstance(part, Muscle):
        usual = [terms.BladderWall, terms.PressurisedBraid]
        forms = _muscle_forms(usual=[*map(type, part.terms.terms)] == usual)
    card: dict[str, Any] = {"type": _type_written(type(part))}
    for key, form in forms.items():
        value, at = getattr(part, form.field), f"{where}.{form.field}"
        if value is None and form.optional:
            card[key] = None
        elif form.many:
            many: Any = value.terms if isinstance(value, terms.SumOfTerms) else value
            card[key] = [_written(one, f"{at}[{k}]") for k, one in enumerate(many)]
        elif form.is_part:
            card[key] = _written(value, at)
        elif np.isfinite(np.asarray(value)).all():
            card[key] = np.asarray(value).tolist()
        else:
            raise InputError(f"{at} must be finite in a muscle card, got {value}")
    return card


def _type_written(cls: type) -> str:
    """Return the name of a class in famjax, or `module:Class` for any other class."""
    if cls.__module__ in {f"famjax.{room}" for room in _ROOMS}:
        return cls.__name__
    if "<locals>" in cls.__qualname__:
        raise InputError(f"{cls.__name__} is defined in a function: define it at module level")
    return class_path(cls)


# --- and back


def _read(card: Any, base: type, where: str, own: Own) -> Any:
    """Build the part that a JSON object describes."""
    if not isinstance(card, dict):
        raise InputError(
            f"{where} in the muscle card must be a JSON object in braces, got {card!r}"
        )
    cls = _type_read(card.get("type"), base, where, own)
    forms = _muscle_forms(usual="terms" not in card) if cls is Muscle else forms_of(cls)
    missing = [key for key in forms if key not in card]
    unknown = [key for key in card if key not in forms and key != "type"]
    if missing or unknown:
        wrong = f"no entry {missing[0]!r}" if missing else f"the unknown entry {unknown[0]!r}"
        raise InputError(
            f"the muscle card has {wrong} in {where}; valid entries: {', '.join(forms)}"
        )
    values = {}
    for key, form in forms.items():
        value, at = card[key], f"{where}.{form.field}"
        if form.many and not isinstance(value, list):
            raise InputError(f"{at} in the muscle card must be a list, got {value!r}")
        if form.many:
            value = [_read(one, form.annotation, f"{at}[{k}]", own) for k, one in enumerate(value)]
        elif value is not None or not form.optional:
            value = (_read if form.is_part else _number)(value, form.annotation, at, own)
        values[form.field] = value
    try:
        return cls(*values.values()) if cls is Muscle else cls(**values)
    except (ValueError, RuntimeError) as error:  # RuntimeError from checks of traced values
        raise InputError(f"{where} in the card is not a valid {cls.__name__}: {error}") from None


def _type_read(name: Any, base: type, where: str, own: Own) -> type:
    """Return the class named in a card, if it is allowed at this place."""
    if isinstance(name, str) and ":" in name:
        what = f"type of {where} in the card"
        check_trusted(name, own, what)
        return class_named(name, base, what)
    known: list[str] = []
    for room in map("famjax.{}".format, _ROOMS):  # the last one is the slowest to import
        for one, cls in vars(importlib.import_module(room)).items():
            own_class = isinstance(cls, type) and cls.__module__ == room
            if own_class and not one.startswith("Abstract") and issubclass(cls, base):
                if one == name:
                    return cls
                known.append(one)
    raise InputError(
        f"{where} in the card has the unknown type {name!r}; use one of "
        f"{', '.join(sorted(known))}, or module:Class"
    )


def _number(value: Any, annotation: Any, where: str, _own: Own) -> Any:
    """Convert a value to a Boolean, a whole number or an array, as annotated for its field."""
    if annotation in (bool, int):
        if type(value) is annotation:
            return value
        raise InputError(
            f"{where} in the card must be of type {annotation.__name__}, got {value!r}"
        )
    try:
        numbers = np.asarray(value, float)
    except (ValueError, TypeError):  # text, or lists of unequal lengths
        numbers = np.full((), np.nan)
    if not np.isfinite(numbers).all():
        raise InputError(f"{where} in the card must contain only finite numbers, got {value!r}")
    if annotation in _PLAIN:
        return tuple(numbers.tolist()) if numbers.ndim else float(numbers)
    axes, shape = annotation.dim_str.split(), numbers.shape
    digits = [one for one in zip(axes, map(str, shape), strict=False) if one[0].isdigit()]
    if "..." not in axes and (len(axes) != len(shape) or any(a != b for a, b in digits)):
        raise InputError(
            f"{where} in the card must be an array of shape ({' '.join(axes)}), got shape {shape}"
        )
    return as_number(numbers)

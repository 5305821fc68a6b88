"""The muscle card: a muscle as plain data with the unit in every key, and back."""

import dataclasses
from typing import Any

import numpy as np

from .. import terms
from .._arrays import as_number
from ..boundary.errors import InputError
from ..muscle import Muscle
from .card_parts import (
    MUSCLE,
    MUSCLE_OF_TERMS,
    CardPart,
    Fields,
    fields_of,
    known_types,
    type_read,
    type_written,
)


def muscle_as_dict(muscle: Muscle) -> dict[str, Any]:
    """The muscle as JSON-ready data in SI, exact to the last digit.

    Raises:
        InputError: a part of the muscle has no card format, or a number in it is not finite.
    """
    return _written(muscle, "muscle")


def muscle_from_dict(card: dict[str, Any]) -> Muscle:
    """The muscle of a card. Numbers come in JAX's precision: enable float64 to have every digit.

    Raises:
        InputError: the card lacks an entry or has one too many, names a type that is not known, or
            holds what is no muscle.
    """
    return _read(_of_terms(card), CardPart(Muscle, untyped=Muscle), "muscle")


def _of_terms(card: Any) -> Any:
    """An earlier card whose geometry stood for virtual work, as one with a term for it."""
    geometry = card.get("geometry") if isinstance(card, dict) else None
    if not isinstance(geometry, dict) or geometry.get("type") != "VirtualWorkGeometry":
        return card
    pull = {
        "type": "VirtualWork",
        "deadband_pressure_Pa": card.get("deadband_pressure_Pa"),
        "at_thread_length": geometry.get("braid") is not None,
    }
    wall = {"type": "BladderWall", "material": card.get("material")}
    return {"type": "Muscle", "geometry": geometry.get("geometry"), "terms": [wall, pull]}


def _fields_of(part: Muscle) -> Fields:
    """The fields of a muscle's card: its material and deadband, or its terms if it has others."""
    usual = [terms.BladderWall, terms.PressurisedBraid]
    return MUSCLE if [*map(type, part.terms.terms)] == usual else MUSCLE_OF_TERMS


def _written(part: Any, where: str) -> dict[str, Any]:
    """A part as an object: its type and its fields."""
    card: dict[str, Any] = {"type": type_written(type(part))}
    fields = _fields_of(part) if isinstance(part, Muscle) else fields_of(type(part))
    for name, form in fields.items():
        value, at = getattr(part, name), f"{where}.{name}"
        value = value.terms if isinstance(value, terms.SumOfTerms) else value
        if isinstance(form, str):
            card[_key(name, form)] = _number_written(value, at)
        elif form.many:
            card[name] = [_written(one, f"{at}[{k}]") for k, one in enumerate(value)]
        else:
            card[name] = None if value is None and form.optional else _written(value, at)
    return card


def _number_written(value: Any, where: str) -> Any:
    """A number, a list of them, or a truth value."""
    numbers = np.asarray(value)
    if not np.isfinite(numbers).all():
        raise InputError(f"{where} must be finite to be written into a muscle card, got {value}")
    return numbers.tolist()


def _read(card: Any, form: CardPart, where: str) -> Any:
    """The part of an object."""
    if not isinstance(card, dict):
        raise InputError(f"{where} of the muscle card must be an object in braces, got {card!r}")
    cls = _class(card, form, where)
    of_muscle = MUSCLE_OF_TERMS if "terms" in card else MUSCLE
    fields = of_muscle if cls is Muscle else fields_of(cls)
    forms = {_key(name, form): (name, form) for name, form in fields.items()}
    missing = [key for key in forms if key not in card]
    if missing:
        raise InputError(
            f"the muscle card has no entry {missing[0]!r} in {where}; was the file edited?"
        )
    unknown = [key for key in card if key not in forms and key != "type"]
    if unknown:
        raise InputError(
            f"the muscle card has the unknown entry {unknown[0]!r} in {where}; known are "
            f"{', '.join(forms)}"
        )
    holders = (terms.PressurisedBraid, cls)  # the deadband of a muscle is its braid's
    annotations = {field.name: field.type for one in holders for field in dataclasses.fields(one)}
    values = {
        name: _value(card[key], form, annotations.get(name), f"{where}.{name}")
        for key, (name, form) in forms.items()
    }
    try:
        return cls(*values.values()) if cls is Muscle else cls(**values)
    except (ValueError, RuntimeError) as error:  # RuntimeError: of a check on traced values
        raise InputError(f"{where} of the muscle card is no {cls.__name__}: {error}") from None


def _class(card: dict[str, Any], form: CardPart, where: str) -> type:
    """The class that an object says it is, among those that may stand there."""
    if "type" not in card and form.untyped is not None:
        return form.untyped
    if "type" not in card:
        raise InputError(
            f"the muscle card has no entry 'type' in {where}; one of "
            f"{', '.join(known_types(form.base))}"
        )
    return type_read(card["type"], form.base, where)


def _value(value: Any, form: str | CardPart, annotation: Any, where: str) -> Any:
    """The value of one field, as its class takes it."""
    if isinstance(form, str):
        return _number(value, annotation, where)
    if not form.many:
        return None if value is None and form.optional else _read(value, form, where)
    if not isinstance(value, list):
        raise InputError(f"{where} of the muscle card must be a list, got {value!r}")
    return [_read(one, form, f"{where}[{k}]") for k, one in enumerate(value)]


def _number(value: Any, annotation: Any, where: str) -> Any:
    """A truth value, whole number or array of numbers, as the field is annotated."""
    if annotation in (bool, int):
        if type(value) is not annotation:
            raise InputError(
                f"{where} of the muscle card must be of type {annotation.__name__}, got {value!r}"
            )
        return value
    try:
        numbers = np.asarray(value)
    except ValueError:  # lists of unequal lengths
        numbers = np.asarray(None)
    if numbers.dtype.kind not in "fiu" or not np.isfinite(numbers).all():
        raise InputError(f"{where} of the muscle card must hold finite numbers, got {value!r}")
    if annotation is float or annotation == tuple[float, ...]:
        plain = numbers.astype(float).tolist()
        return tuple(plain) if isinstance(plain, list) else plain
    array = as_number(numbers.astype(float))
    if not _has_shape(array.shape, annotation.dim_str.split()):
        raise InputError(
            f"{where} of the muscle card must be numbers of shape ({annotation.dim_str.strip()}), "
            f"got shape {array.shape}"
        )
    return array


def _has_shape(shape: tuple[int, ...], sizes: list[str]) -> bool:
    """Whether a shape is that of an annotation; sizes by name are free, those of one part of another's."""
    if "..." in sizes:
        return len(shape) >= len(sizes) - 1
    return len(shape) == len(sizes) and all(
        not size.isdigit() or int(size) == n for size, n in zip(sizes, shape, strict=True)
    )


def _key(name: str, form: str | CardPart) -> str:
    """The key of a field: its name, with its unit if it has one."""
    return f"{name}_{form}" if isinstance(form, str) and form else name

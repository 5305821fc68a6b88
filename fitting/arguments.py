"""Checks of arguments; each refuses a wrong one in one sentence."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

_SHOWN = 60
"""Characters of a value in a message."""


def is_number(value: object) -> bool:
    """Whether it is one real number: no text, no truth value, no array of several."""
    if isinstance(value, str | bytes | bool):
        return False
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return False
    return array.ndim == 0 and array.dtype.kind in "iuf"


def check_whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number, as Python's.

    Args:
        name: of the argument.
        value: given.
        least: it may be.
        most: it may be.

    Raises:
        InputError: it is none, or out of range.

    >>> check_whole("starts", 16, 1)
    16
    """
    highest = math.inf if most is None else most
    if not (is_number(value) and math.isfinite(value) and least <= value <= highest) or value % 1:
        to = f">= {least}" if most is None else f"{least} to {most}"
        raise InputError(f"{name} must be a whole number {to}, got {shown(value)}")
    return int(value)


def check_numbers(name: str, values: Any) -> np.ndarray:
    """An array of floats.

    Raises:
        InputError: it holds something that is no number, or rows of different lengths.
    """
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must hold numbers, got {shown(values)}") from None


def check_pair(name: str, pair: Any, what: str) -> tuple[float, float]:
    """Two numbers, such as bounds.

    Raises:
        InputError: they are not two, or no numbers.
    """
    given = list(pair) if isinstance(pair, tuple | list | np.ndarray) else []
    if len(given) != 2 or not all(map(is_number, given)):
        raise InputError(f"{name} {what}, got {shown(pair)}")
    return float(given[0]), float(given[1])


def check_mapping(name: str, given: Any, holds: str) -> None:
    """Refuse an argument that is not a mapping by name.

    Raises:
        InputError: it is none.
    """
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"{name} must be a mapping {holds}, got {shown(given)}")


def check_names(name: str, given: Any) -> tuple[str, ...]:
    """Check a sequence of names; a single text is refused as a likely slip.

    Raises:
        InputError: it is a text, or holds something else than texts.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f"{name} must be names in a tuple or list, as ({shown(given)},)")
    names = tuple(given)
    if not all(isinstance(one, str) for one in names):
        raise InputError(f"{name} must be names in a tuple or list, got {shown(names)}")
    return names


def check_path(name: str, given: Any) -> Path:
    """A path.

    Raises:
        InputError: it is neither a text nor a path.
    """
    if not isinstance(given, str | Path):
        raise InputError(f"{name} must be a path, as a text or a pathlib.Path, got {shown(given)}")
    return Path(given)


def shown(value: object) -> str:
    """A value as shown in a message; long values and tables are shown by their type."""
    text = repr(value)
    plain = "\n" not in text and len(text) <= _SHOWN
    kind = type(value).__name__
    return text if plain else f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"

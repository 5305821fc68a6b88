"""Argument checks that raise InputError with a one-sentence message."""

import math
import numbers
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

_SHOWN = 60
"""Length of the longest value, in characters, that a message shows in full."""


def is_number(value: Any) -> bool:
    """Return True for a single real number, and False for strings, booleans and arrays."""
    if isinstance(value, bool) or not (
        issubclass(type(value), numbers.Real) or hasattr(value, "dtype")
    ):
        return False
    return np.ndim(value) == 0 and np.asarray(value).dtype.kind in "iuf"


def check_whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """Check that a value is a whole number within limits, and return it as an int.

    Args:
        name: name of the argument.
        value: value to check.
        least: smallest allowed value.
        most: largest allowed value; None for no limit.

    Raises:
        InputError: the value is not a whole number, or is out of range.

    >>> check_whole("starts", 16, 1)
    16
    """
    highest = math.inf if most is None else most
    if not (is_number(value) and math.isfinite(value) and least <= value <= highest) or value % 1:
        to = f">= {least}" if most is None else f"from {least} to {most}"
        raise InputError(f"{name} must be a whole number {to}, got {shown(value)}")
    return int(value)


def check_numbers(name: str, values: Any) -> np.ndarray:
    """Convert values to an array of floats.

    Raises:
        InputError: an item is not a number, or rows differ in length.
    """
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must contain numbers, got {shown(values)}") from None


def check_pair(name: str, pair: Any, what: str) -> tuple[float, float]:
    """Check that a value is a pair of numbers, such as bounds, and return it as floats.

    Raises:
        InputError: the value is not a pair of numbers.
    """
    given = list(pair) if isinstance(pair, tuple | list | np.ndarray) else []
    if len(given) != 2 or not all(map(is_number, given)):
        raise InputError(f"{name} {what}, got {shown(pair)}")
    return float(given[0]), float(given[1])


def check_mapping(name: str, given: Any, holds: str) -> None:
    """Reject an argument that is neither a mapping nor None.

    Raises:
        InputError: the argument has another type.
    """
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"{name} must be a mapping {holds}, got {shown(given)}")


def check_names(name: str, given: Any) -> tuple[str, ...]:
    """Return a sequence of names as a tuple; a single string is rejected as a likely mistake.

    Raises:
        InputError: the argument is a string, or an item is not a string.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f"{name} must be a tuple or list of names, such as ({shown(given)},)")
    names = tuple(given)
    if not all(isinstance(one, str) for one in names):
        raise InputError(f"{name} must be a tuple or list of names, got {shown(names)}")
    return names


def check_path(name: str, given: Any) -> Path:
    """Return a string or path as a `Path`.

    Raises:
        InputError: the argument has another type.
    """
    if not isinstance(given, str | Path):
        raise InputError(f"{name} must be a path (str or pathlib.Path), got {shown(given)}")
    return Path(given)


def shown(value: object) -> str:
    """Return a value as text for a message; for a long value, return its type."""
    text = repr(value)
    plain = "\n" not in text and len(text) <= _SHOWN
    kind = type(value).__name__
    return text if plain else f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"


def check_float64() -> None:
    """Check that JAX computes in float64.

    Raises:
        RuntimeError: JAX computes in float32.
    """
    import jax  # noqa: PLC0415 -- commands read arguments before they start JAX

    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            'fits need float64: call jax.config.update("jax_enable_x64", True) before any other use of JAX'
        )

"""The errors that explain bad input."""

import difflib
import numbers
from collections.abc import Iterable


class InputError(ValueError):
    """Bad input: what must hold, what was given, what to do; commands print it and exit with 2."""


def check_seed(seed: int) -> int:
    """Check a seed of random numbers.

    Raises:
        InputError: it is negative, or no whole number.
    """
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed!r}")
    return seed


def meant(name: str, known: Iterable[str]) -> str:
    """A "did you mean" with the nearest known name, or "" if none is near.

    >>> meant("rest_lenght_mm", ["rest_length_mm", "name"])
    '; did you mean rest_length_mm?'
    >>> meant("colour", ["rest_length_mm", "name"])
    ''
    """
    by_lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return f"; did you mean {by_lower[near[0]]}?" if near else ""

"""The one family of errors that say what is wrong with what was given."""

import difflib
import importlib
import numbers
from collections.abc import Iterable
from types import ModuleType


class InputError(ValueError):
    """What must hold, what was got, and what to do; the command line prints it and exits with 2."""


def check_seed(seed: int) -> int:
    """The seed of random numbers, if it can be one.

    Raises:
        InputError: it is negative, or no whole number.
    """
    if not isinstance(seed, numbers.Integral) or seed < 0:
        raise InputError(f"a seed must be a whole number >= 0, got {seed!r}")
    return seed


def meant(name: str, known: Iterable[str]) -> str:
    """A question for the end of a message, with the nearest known name, or "" where none is near.

    >>> meant("rest_lenght_mm", ["rest_length_mm", "name"])
    '; did you mean rest_length_mm?'
    >>> meant("colour", ["rest_length_mm", "name"])
    ''
    """
    by_lower = {one.lower(): one for one in known}
    near = difflib.get_close_matches(name.lower(), by_lower, n=1, cutoff=0.6)
    return f"; did you mean {by_lower[near[0]]}?" if near else ""


def import_extra(name: str, extra: str, error: type[Exception] = InputError) -> ModuleType:
    """A package of an extra.

    Args:
        name: of the package.
        extra: with which it comes.
        error: what is raised where it is not there.

    Raises:
        InputError: it is not installed.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise error(
            f'{name} comes with the extra {extra!r}: python -m pip install "famjax[{extra}]"'
        ) from None

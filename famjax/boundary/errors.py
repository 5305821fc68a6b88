"""The one family of errors that say what is wrong with what was given."""

import numbers


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

"""The known name that was probably meant."""

import difflib
from collections.abc import Iterable


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

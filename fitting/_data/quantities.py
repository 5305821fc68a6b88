"""Numbers with their unit as a person types them: `270mm`, `5 bar`, `0.04in`."""

import re
from collections.abc import Iterable

from .._errors import InputError
from .units import UNITS, to_si

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*")


def parse_quantity(text: str, kind: str) -> float:
    """A number with its unit, in SI.

    Raises:
        InputError: not a number, or no unit or one that is not known.

    >>> parse_quantity("270mm", "length"), parse_quantity("5 bar", "pressure")
    (0.27, 500000.0)
    """
    match = _QUANTITY.fullmatch(text)
    known = ", ".join(UNITS[kind])
    if match is None:
        raise InputError(f"a {kind} is a number with its unit ({known}), got {text!r}")
    number, unit = match.groups()
    if not unit and kind != "number":
        raise InputError(f"the {kind} {text!r} has no unit; known are: {known}")
    return to_si(float(number), unit, kind)


def parse_quantities(texts: Iterable[str], kind: str) -> list[float]:
    """All numbers of comma-separated lists."""
    return [parse_quantity(one, kind) for text in texts for one in text.split(",") if one.strip()]

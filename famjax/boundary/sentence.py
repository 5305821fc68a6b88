"""Sentences with quantities that can be printed in any unit system."""

import re
from typing import NamedTuple

from .units import from_si, to_si, unit_system

_KINDS = {
    **dict.fromkeys(("m", "mm", "um", "in"), "length"),
    **dict.fromkeys(("Pa", "kPa", "MPa", "psi"), "pressure"),
    **dict.fromkeys(("N", "lbf"), "force"),
}
_ALSO = {"metric": ("um", "MPa")}
"""Units that go with a system beside its own."""

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_WITH_UNIT = re.compile(
    rf"(?<![\w.-])(?P<first>{_NUMBER})(?: to (?P<last>{_NUMBER}))? (?P<unit>{'|'.join(_KINDS)})\b(?![/^])"
)


class Quantity(NamedTuple):
    """A number in a sentence.

    Attributes:
        value: in SI.
        kind: one of `famjax.boundary.units.UNITS`.
        digits: significant ones that are shown.
    """

    value: float
    kind: str
    digits: int = 4

    def in_units(self, system: str) -> str:
        """The number with its unit in a unit system."""
        unit = unit_system(system)[self.kind]
        return f"{from_si(float(self.value), unit, self.kind):.{self.digits}g} {unit}".rstrip()


class Sentence(str):
    """A text that keeps its quantities; as a string they are in mm, kPa, N and MPa.

    Args:
        *parts: texts, quantities and further sentences, in their order.

    >>> found = Sentence("The length is ", Quantity(0.296, "length"), ".")
    >>> found, in_units(found, "us")
    ('The length is 296 mm.', 'The length is 11.65 in.')
    """

    parts: tuple[str | Quantity, ...]

    def __new__(cls, *parts: str | Quantity) -> "Sentence":
        """A sentence of these parts."""
        made = super().__new__(cls, "".join(_part_in_units(one, "metric") for one in parts))
        made.parts = parts
        return made

    def __reduce__(self) -> tuple[type["Sentence"], tuple[str | Quantity, ...]]:
        return Sentence, self.parts


def in_units(sentence: str, system: str) -> str:
    """A sentence in a unit system (si, metric or us); a text without quantities is unchanged."""
    if isinstance(sentence, Sentence):
        return "".join(_part_in_units(one, system) for one in sentence.parts)
    return sentence


def text_in_units(text: str, system: str) -> str:
    """A text from a file, with its lengths, pressures and forces converted to a unit system.

    Numbers that a unit follows, and ranges such as `159 to 236 mm`; what is in units of the system
    already stays to the last digit, and so does every other number.

    >>> text_in_units("At 344738 Pa the strokes from 159 to 236 mm lack 1.02 s.", "us")
    'At 50 psi the strokes from 6.26 to 9.291 in lack 1.02 s.'
    """
    wanted = unit_system(system)

    def converted(match: re.Match[str]) -> str:
        unit = match["unit"]
        kind = _KINDS[unit]
        if unit in (wanted[kind], *_ALSO.get(system, ())):
            return match[0]
        numbers = (match["first"], match["last"])
        shown = [
            f"{from_si(to_si(float(one), unit, kind), wanted[kind], kind):.4g}"
            for one in numbers
            if one is not None
        ]
        return f"{' to '.join(shown)} {wanted[kind]}"

    return _WITH_UNIT.sub(converted, text)


def _part_in_units(part: str | Quantity, system: str) -> str:
    return part.in_units(system) if isinstance(part, Quantity) else in_units(part, system)

"""Sentences with quantities in them, which a reader has in units of their own."""

from typing import NamedTuple

from .units import from_si, unit_system


class Quantity(NamedTuple):
    """A number of a sentence.

    Attributes:
        value: in SI.
        kind: one of `famjax.boundary.units.UNITS`.
        digits: significant ones that are shown.
    """

    value: float
    kind: str
    digits: int = 4

    def told(self, system: str) -> str:
        """The number with its unit in a unit system."""
        unit = unit_system(system)[self.kind]
        return f"{from_si(float(self.value), unit, self.kind):.{self.digits}g} {unit}".rstrip()


class Sentence(str):
    """A text that knows its quantities; as it stands they are in mm, kPa, N and MPa.

    Args:
        *parts: texts, quantities and further sentences, in their order.

    >>> told = Sentence("The length is ", Quantity(0.296, "length"), ".")
    >>> told, told_in(told, "us")
    ('The length is 296 mm.', 'The length is 11.65 in.')
    """

    parts: tuple[str | Quantity, ...]

    def __new__(cls, *parts: str | Quantity) -> "Sentence":
        """A sentence of these parts."""
        made = super().__new__(cls, "".join(_told(one, "metric") for one in parts))
        made.parts = parts
        return made

    def __getnewargs__(self) -> tuple[str | Quantity, ...]:
        return self.parts


def told_in(sentence: str, system: str) -> str:
    """A sentence in a unit system, si, metric or us; a text without quantities as it is."""
    if isinstance(sentence, Sentence):
        return "".join(_told(one, system) for one in sentence.parts)
    return sentence


def _told(part: str | Quantity, system: str) -> str:
    return part.told(system) if isinstance(part, Quantity) else told_in(part, system)

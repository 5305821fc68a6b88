"""Units for input and output: the names of columns, keys and options contain the unit.

The multipliers are plain numbers that the tests compare with pint. Importing pint itself would double
the run time of a short command.
"""

import math
import re
from collections.abc import Iterable
from typing import Any, NamedTuple

from ..units import BAR, DEGREE, INCH, KILOPASCAL, LBF, MEGAPASCAL, MILLIMETRE, PSI
from .errors import InputError

Row = dict[str, Any]
"""Row of a table; each key ends with the unit of its value."""

_STANDARD_GRAVITY = 9.80665  # m/s2, by definition


class _Kinds(dict[str, dict[str, float]]):
    """Units for each kind of quantity; a kind that is not listed, such as N/m, is itself an SI unit."""

    def __missing__(self, kind: str) -> dict[str, float]:
        return {kind: 1.0}


_PRESSURES = {"Pa": 1.0, "kPa": KILOPASCAL, "MPa": MEGAPASCAL, "bar": BAR, "psi": PSI}
UNITS = _Kinds({
    "force": {"N": 1.0, "kN": 1e3, "lbf": LBF, "kgf": _STANDARD_GRAVITY},
    "pressure": _PRESSURES,
    "length": {"m": 1.0, "cm": 1e-2, "mm": MILLIMETRE, "um": 1e-6, "in": INCH},
    "stress": {"Pa": 1.0, "kPa": KILOPASCAL, "MPa": MEGAPASCAL, "GPa": 1e9, "psi": PSI},
    "angle": {"rad": 1.0, "deg": DEGREE},
    "compliance": {"m/N": 1.0, "mm/N": MILLIMETRE, "in/lbf": INCH / LBF},
    "strain compliance": {"1/N": 1.0, "1/kN": 1e-3, "1/lbf": 1 / LBF},
    "number": {"": 1.0},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "energy": {"J": 1.0, "in lbf": INCH * LBF},
    "volume": {"m3": 1.0, "cm3": 1e-6, "mm3": 1e-9, "in3": INCH**3},
    "scale": {"px/m": 1.0, "px/cm": 1e2, "px/mm": 1e3, "px/in": 1 / INCH},
    "rate": {"m_per_s": 1.0, "mm_per_s": MILLIMETRE, "in_per_s": INCH,
             "mm_per_min": MILLIMETRE / 60, "in_per_min": INCH / 60},
})  # fmt: skip
"""Multipliers to SI for each kind of quantity; the first unit listed is the SI unit."""


class _System(dict[str, str]):
    """Unit for each kind of quantity; a kind that is not listed is itself an SI unit."""

    def __missing__(self, kind: str) -> str:
        return kind


_SYSTEM_UNITS = {
    "force": ("N", "N", "lbf"),
    "pressure": ("Pa", "kPa", "psi"),
    "length": ("m", "mm", "in"),
    "stress": ("Pa", "MPa", "psi"),
    "angle": ("rad", "deg", "deg"),
    "compliance": ("m/N", "mm/N", "in/lbf"),
    "strain compliance": ("1/N", "1/kN", "1/lbf"),
    "number": ("", "", ""),
    "time": ("s", "s", "s"),
    "energy": ("J", "J", "in lbf"),
    "volume": ("m3", "mm3", "in3"),
    "scale": ("px/m", "px/mm", "px/in"),
}
SYSTEMS: dict[str, _System] = {
    system: _System({kind: units[k] for kind, units in _SYSTEM_UNITS.items()})
    for k, system in enumerate(("si", "metric", "us"))
}
"""Unit systems for tables, reports and pictures, each with the unit for every kind of quantity."""

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*")


def factor(unit: str, kind: str) -> float:
    """Return the multiplier that converts a value in `unit` to SI.

    Args:
        unit: one of `UNITS[kind]`.
        kind: one of `UNITS`.

    Raises:
        InputError: the unit is unknown for this kind.

    >>> round(factor("psi", "pressure"), 3), factor("in", "length")
    (6894.757, 0.0254)
    """
    known = UNITS[kind]
    if unit not in known:
        raise InputError(f"{unit!r} is not a known unit of {kind}; use one of: {', '.join(known)}")
    return known[unit]


def to_si(value: float, unit: str, kind: str) -> float:
    """Convert a value in `unit` to SI.

    >>> to_si(2.0, "bar", "pressure")
    200000.0
    """
    return value * factor(unit, kind)


def from_si(value: float, unit: str, kind: str) -> float:
    """Convert an SI value to `unit`."""
    return value / factor(unit, kind)


def si_unit(kind: str) -> str:
    """Return the SI unit of a kind of quantity.

    >>> si_unit("pressure"), si_unit("N/m")
    ('Pa', 'N/m')
    """
    return next(iter(UNITS[kind]))


def unit_system(name: str) -> _System:
    """Return the units in a unit system.

    Raises:
        InputError: the system is unknown.

    >>> unit_system("metric")["length"]
    'mm'
    """
    if name not in SYSTEMS:
        raise InputError(f"units must be one of {', '.join(SYSTEMS)}; got {name!r}")
    return SYSTEMS[name]


def entry(name: str, value: float, kind: str, system: str) -> Row:
    """Return a row with one entry: a key that ends with a unit, and the SI value converted to that unit.

    If the value is nan, None is returned instead. A "number" has no unit.

    >>> entry("length", 0.27, "length", "metric")
    {'length_mm': 270.0}
    """
    unit = unit_system(system)[kind]
    scaled = float(value) / UNITS[kind][unit]
    return {f"{name}_{unit}" if unit else name: None if math.isnan(scaled) else scaled}


def finite_or_none(value: float | int) -> float | None:
    """Return the value, or None (JSON null) if it is nan or infinite."""
    return float(value) if math.isfinite(value) else None


def parse_quantity(text: str, kind: str) -> float:
    """Parse a number with its unit, such as "5bar", and convert it to SI.

    Raises:
        InputError: the text is not a number, or the unit is missing or unknown.

    >>> parse_quantity("270mm", "length"), parse_quantity("5 bar", "pressure")
    (0.27, 500000.0)
    >>> parse_quantity("60in", "length"), parse_quantity("100 px/mm", "scale")
    (1.524, 100000.0)
    """
    match = _QUANTITY.fullmatch(text)
    known = ", ".join(UNITS[kind])
    if match is None:
        raise InputError(f"a {kind} must be a number with its unit ({known}), got {text!r}")
    number, unit = match.groups()
    if not unit and kind != "number":
        raise InputError(f"the {kind} {text!r} has no unit; use one of: {known}")
    return to_si(float(number), unit, kind)


def quantity_unit(text: str) -> str:
    """Return the unit after a number, or after the first number in a list; "" if there is no unit.

    >>> quantity_unit("270mm,10in"), quantity_unit("5")
    ('mm', '')
    """
    match = _QUANTITY.fullmatch(text.strip(", ").partition(",")[0])
    return "" if match is None else match[2]


def parse_quantities(texts: Iterable[str], kind: str) -> list[float]:
    """Parse comma-separated numbers with units, and convert them to SI."""
    return [parse_quantity(one, kind) for text in texts for one in text.split(",") if one.strip()]


# --- sentences with quantities, shown in the reader's units

_SPOKEN = {
    **dict.fromkeys(("m", "mm", "um", "in"), "length"),
    **dict.fromkeys(("Pa", "kPa", "MPa", "psi"), "pressure"),
    **dict.fromkeys(("N", "lbf"), "force"),
}
_ALSO = {"metric": ("um", "MPa")}
"""Further units that `sentence_in_units` leaves unchanged in a unit system."""

_NUMBER = r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?"
_WITH_UNIT = re.compile(
    rf"(?<![\w.-])(?P<first>{_NUMBER})(?: to (?P<last>{_NUMBER}))? (?P<unit>{'|'.join(_SPOKEN)})\b(?![/^])"
)


class Quantity(NamedTuple):
    """A number in a sentence.

    Attributes:
        value: value in SI.
        kind: kind of quantity, a key in `UNITS`.
        digits: number of significant digits to show.
    """

    value: float
    kind: str
    digits: int = 4

    def in_units(self, system: str) -> str:
        """Format the number and its unit in a unit system."""
        unit = unit_system(system)[self.kind]
        return f"{from_si(float(self.value), unit, self.kind):.{self.digits}g} {unit}".rstrip()


class Sentence(str):
    """Text built from several parts, with its quantities in mm, kPa, N and MPa.

    Args:
        *parts: texts and quantities, in order.

    >>> found = Sentence("The length is ", Quantity(0.296, "length"), ".")
    >>> found, sentence_in_units(found, "us")
    ('The length is 296 mm.', 'The length is 11.65 in.')
    """

    def __new__(cls, *parts: str | Quantity) -> "Sentence":
        """Join the parts in metric units."""
        texts = (one.in_units("metric") if isinstance(one, Quantity) else one for one in parts)
        return super().__new__(cls, "".join(texts))


def sentence_in_units(text: str, system: str) -> str:
    """Convert the lengths, pressures and forces in a text to a unit system (si, metric or us).

    Converts numbers followed by a unit, and ranges such as `159 to 236 mm`. Quantities that are already
    in a unit of the system keep all their digits. Other numbers are not changed.

    >>> sentence_in_units("At 344738 Pa the strokes from 159 to 236 mm lack 1.02 s.", "us")
    'At 50 psi the strokes from 6.26 to 9.291 in lack 1.02 s.'
    """
    wanted = unit_system(system)

    def converted(match: re.Match[str]) -> str:
        unit, kind = match["unit"], _SPOKEN[match["unit"]]
        if unit in (wanted[kind], *_ALSO.get(system, ())):
            return match[0]
        size = UNITS[kind][unit] / UNITS[kind][wanted[kind]]
        ends = (one for one in (match["first"], match["last"]) if one is not None)
        return f"{' to '.join(f'{float(one) * size:.4g}' for one in ends)} {wanted[kind]}"

    return _WITH_UNIT.sub(converted, text)

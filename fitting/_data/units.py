"""Units at the boundary: the unit is in the name of a column, a key or an option."""

from collections.abc import Callable, Mapping
from math import pi
from typing import Generic, TypeVar

from famjax.units import INCH, LBF, PSI

from .._errors import InputError

_T = TypeVar("_T")
_STANDARD_GRAVITY = 9.80665  # m/s2, by definition


class _OfKinds(dict[str, _T], Generic[_T]):
    """By kind of quantity; a kind that is not known is an SI unit by itself, such as N/m."""

    def __init__(self, known: Mapping[str, _T], of_unit: Callable[[str], _T]) -> None:
        super().__init__(known)
        self._of_unit = of_unit

    def __missing__(self, kind: str) -> _T:
        return self._of_unit(kind)


_KNOWN: dict[str, dict[str, float]] = {
    "force": {"N": 1.0, "kN": 1e3, "lbf": LBF, "kgf": _STANDARD_GRAVITY},
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": PSI},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": INCH},
    "stress": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "GPa": 1e9, "psi": PSI},
    "angle": {"rad": 1.0, "deg": pi / 180},
    "compliance": {"m/N": 1.0, "mm/N": 1e-3, "in/lbf": INCH / LBF},
    "strain compliance": {"1/N": 1.0, "1/kN": 1e-3, "1/lbf": 1 / LBF},
    "number": {"": 1.0},
}

_FACTORS = _OfKinds(_KNOWN, lambda unit: {unit: 1.0})
UNITS = _OfKinds({kind: tuple(units) for kind, units in _KNOWN.items()}, lambda unit: (unit,))
"""Units known for each kind of quantity; the first is the SI unit used inside."""

SYSTEMS: dict[str, _OfKinds[str]] = {
    system: _OfKinds(dict(zip(_KNOWN, units, strict=True)), lambda unit: unit)
    for system, units in {
        "si": ("N", "Pa", "m", "Pa", "rad", "m/N", "1/N", ""),
        "metric": ("N", "kPa", "mm", "MPa", "deg", "mm/N", "1/kN", ""),
        "us": ("lbf", "psi", "in", "psi", "deg", "in/lbf", "1/lbf", ""),
    }.items()
}
"""Unit systems of a report: the unit of each kind."""


def factor(unit: str, kind: str) -> float:
    """The multiplier that takes a value in `unit` to SI.

    Args:
        unit: one of `UNITS[kind]`.
        kind: one of `UNITS`.

    Returns:
        SI units per `unit`.

    Raises:
        InputError: the unit is not known for that kind.

    >>> round(factor("psi", "pressure"), 3)
    6894.757
    """
    if unit not in UNITS[kind]:
        raise InputError(
            f"{unit!r} is not a known unit of {kind}; known are: {', '.join(UNITS[kind])}"
        )
    return _FACTORS[kind][unit]


def to_si(value: float, unit: str, kind: str) -> float:
    """A value in `unit`, in SI."""
    return value * factor(unit, kind)


def from_si(value: float, unit: str, kind: str) -> float:
    """An SI value, in `unit`."""
    return value / factor(unit, kind)

"""Units at the boundary of `imaging`: the unit is in the name of a column, a key or an option."""

import re

from .errors import ImagingError

_INCH = 0.0254  # [m]
_LBF = 4.4482216152605  # [N]: 0.45359237 kg x 9.80665 m/s2

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "in": _INCH},
    "volume": {"m3": 1.0, "cm3": 1e-6, "mm3": 1e-9, "in3": _INCH**3},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "force": {"N": 1.0, "kN": 1e3, "lbf": _LBF, "kgf": 9.80665},
    "pressure": {
        "Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": _LBF / _INCH**2
    },
    "scale": {"px/m": 1.0, "px/cm": 1e2, "px/mm": 1e3, "px/in": 1 / _INCH},
}  # fmt: skip
"""SI units per unit, for each kind of quantity; the first is the SI unit. Exact by definition of
the units (NIST SP 811, 2008, appendix B)."""

SYSTEMS: dict[str, dict[str, str]] = {
    system: dict(zip(UNITS, units, strict=True))
    for system, units in {
        "si": ("m", "m3", "s", "N", "Pa", "px/m"),
        "metric": ("mm", "mm3", "s", "N", "kPa", "px/mm"),
        "us": ("in", "in3", "s", "lbf", "psi", "px/in"),
    }.items()
}
"""Unit systems of tables and pictures: the unit of each kind."""

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([A-Za-z/]*)\s*")


def factor(unit: str, kind: str) -> float:
    """The multiplier that takes a value in `unit` to SI.

    Args:
        unit: one of `UNITS[kind]`.
        kind: one of `UNITS`.

    Raises:
        ImagingError: the unit is not known for that kind.

    >>> factor("in", "length")
    0.0254
    """
    if unit not in UNITS[kind]:
        raise ImagingError(
            f"{unit!r} is not a known unit of {kind}; known are: {', '.join(UNITS[kind])}"
        )
    return UNITS[kind][unit]


def parse_quantity(text: str, kind: str) -> float:
    """A number with its unit as a person types it, in SI.

    Raises:
        ImagingError: not a number, or no unit or one that is not known.

    >>> parse_quantity("60in", "length"), parse_quantity("100 px/mm", "scale")
    (1.524, 100000.0)
    """
    match = _QUANTITY.fullmatch(text)
    if match is None or not match.group(2):
        raise ImagingError(
            f"a {kind} is a number with its unit ({', '.join(UNITS[kind])}), got {text!r}"
        )
    return float(match.group(1)) * factor(match.group(2), kind)

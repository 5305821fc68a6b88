"""Units at the boundary, as plain multipliers: the unit is in the name of a key or a column."""

from .errors import RigError

_INCH = 0.0254
_LBF = 4.4482216152605
_PSI = _LBF / _INCH**2

UNITS: dict[str, dict[str, float]] = {
    "pressure": {"Pa": 1.0, "kPa": 1e3, "MPa": 1e6, "bar": 1e5, "psi": _PSI},
    "force": {"N": 1.0, "kN": 1e3, "lbf": _LBF, "kgf": 9.80665},
    "length": {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "in": _INCH},
    "time": {"s": 1.0, "ms": 1e-3, "min": 60.0},
    "rate": {
        "m_per_s": 1.0,
        "mm_per_s": 1e-3,
        "in_per_s": _INCH,
        "mm_per_min": 1e-3 / 60,
        "in_per_min": _INCH / 60,
    },
}
"""Multipliers to SI of each kind of quantity; the first unit is the SI unit used inside."""


def to_si(value: float, unit: str, kind: str) -> float:
    """A value in `unit`, in SI.

    Raises:
        RigError: the unit is not known for that kind.

    >>> to_si(2.0, "bar", "pressure")
    200000.0
    """
    if unit not in UNITS[kind]:
        raise RigError(f"unknown unit {unit!r} of {kind}; known are: {', '.join(UNITS[kind])}")
    return value * UNITS[kind][unit]


def keyed_in_si(entry: str, quantity: str, kind: str) -> str | None:
    """The unit at the end of a key such as `pressure_limit_psi`, or None if it is another key.

    Args:
        entry: the key.
        quantity: its name without the unit.
        kind: one of `UNITS`.

    Raises:
        RigError: the key is that quantity with no unit, or with an unknown one.

    >>> keyed_in_si("stroke_in", "stroke", "length")
    'in'
    """
    if entry != quantity and not entry.startswith(quantity + "_"):
        return None
    unit = entry[len(quantity) + 1 :]
    if unit not in UNITS[kind]:
        raise RigError(
            f"{entry!r} must end with a unit of {kind}, as in {quantity}_{next(iter(UNITS[kind]))}; "
            f"known are: {', '.join(UNITS[kind])}"
        )
    return unit

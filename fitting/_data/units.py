"""Units at the boundary: the unit is in the name of a column, a key or an option."""

import functools

from .._errors import InputError

UNITS: dict[str, tuple[str, ...]] = {
    "force": ("N", "kN", "lbf", "kgf"),
    "pressure": ("Pa", "kPa", "MPa", "bar", "psi"),
    "length": ("m", "cm", "mm", "in"),
    "stress": ("Pa", "kPa", "MPa", "GPa", "psi"),
    "angle": ("rad", "deg"),
    "compliance": ("m/N", "mm/N", "in/lbf"),
    "strain compliance": ("1/N", "1/kN", "1/lbf"),
    "number": ("",),
}
"""Units known for each kind of quantity; the first is the SI unit used inside."""

SYSTEMS: dict[str, dict[str, str]] = {
    system: dict(zip(UNITS, units, strict=True))
    for system, units in {
        "si": ("N", "Pa", "m", "Pa", "rad", "m/N", "1/N", ""),
        "metric": ("N", "kPa", "mm", "MPa", "deg", "mm/N", "1/kN", ""),
        "us": ("lbf", "psi", "in", "psi", "deg", "in/lbf", "1/lbf", ""),
    }.items()
}
"""Unit systems of a report: the unit of each kind."""


@functools.cache
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
    if unit == UNITS[kind][0]:
        return 1.0
    import pint  # noqa: PLC0415 -- slow to load, and only needed where units are read

    registry = pint.get_application_registry()
    return float(registry.Quantity(1.0, unit).to(UNITS[kind][0]).magnitude)


def to_si(value: float, unit: str, kind: str) -> float:
    """A value in `unit`, in SI."""
    return value * factor(unit, kind)


def from_si(value: float, unit: str, kind: str) -> float:
    """An SI value, in `unit`."""
    return value / factor(unit, kind)

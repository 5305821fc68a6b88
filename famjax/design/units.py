"""The units in which a designer writes and reads: their multipliers to SI, and systems of them."""

import math
from typing import Any

from .. import units

Row = dict[str, Any]
"""A row of a table: the unit of each quantity is the last part of its key."""

UNITS: dict[str, dict[str, float]] = {
    "length": {"m": 1.0, "cm": 1e-2, "mm": units.MILLIMETRE, "in": units.INCH},
    "angle": {"rad": 1.0, "deg": units.DEGREE},
    "force": {"N": 1.0, "kN": 1e3, "lbf": units.LBF},
    "pressure": {
        "Pa": 1.0,
        "kPa": units.KILOPASCAL,
        "MPa": units.MEGAPASCAL,
        "bar": units.BAR,
        "psi": units.PSI,
    },
    "stress": {
        "Pa": 1.0,
        "kPa": units.KILOPASCAL,
        "MPa": units.MEGAPASCAL,
        "GPa": 1e9,
        "psi": units.PSI,
    },
}
"""Multipliers to SI of the units known for each kind of quantity."""

SYSTEMS: dict[str, dict[str, str]] = {
    "si": {"length": "m", "force": "N", "pressure": "Pa", "stress": "Pa", "angle": "rad"},
    "metric": {"length": "mm", "force": "N", "pressure": "kPa", "stress": "MPa", "angle": "deg"},
    "us": {"length": "in", "force": "lbf", "pressure": "psi", "stress": "psi", "angle": "deg"},
}
"""The unit of each kind of quantity in a system of units."""


def unit_in(system: str, kind: str) -> tuple[str, float]:
    """The unit of a kind of quantity in a system of units, and its multiplier to SI.

    Raises:
        ValueError: the system is not known.

    >>> unit_in("metric", "length")
    ('mm', 0.001)
    """
    if system not in SYSTEMS:
        raise ValueError(f"system must be one of {', '.join(SYSTEMS)}; got {system!r}")
    unit = SYSTEMS[system][kind]
    return unit, UNITS[kind][unit]


def entry(name: str, value: float, kind: str, system: str) -> Row:
    """One key with its unit and the SI value in it; None for nan. A "number" has no unit."""
    unit, factor = ("", 1.0) if kind == "number" else unit_in(system, kind)
    scaled = float(value) / factor
    return {f"{name}_{unit}" if unit else name: None if math.isnan(scaled) else scaled}

"""What a person types for bounds and specimen, as numbers in SI."""

from collections.abc import Iterable

from ._csv import parse_specimen as parse_specimen
from ._errors import InputError
from ._parameters import KINDS
from ._units import UNITS, to_si


def parse_bounds(entries: Iterable[str]) -> dict[str, tuple[float, float]]:
    """Bounds by parameter name in SI, from entries such as `braid_diameter_mm=20:23.6`.

    A single value holds the parameter: `deadband_pressure_kPa=40`.

    Raises:
        InputError: an entry that is not of this form, an unknown name or unit, or a name twice.

    >>> parse_bounds(["E_1_MPa=0:10", "braid_diameter_mm=21"])
    {'E_1': (0.0, 10000000.0), 'braid_diameter': (0.021, 0.021)}
    """
    bounds: dict[str, tuple[float, float]] = {}
    for entry in entries:
        key, equals, interval = entry.partition("=")
        name, _, unit = key.strip().rpartition("_")
        if not equals or not name:
            raise InputError(f"bounds {entry!r} must read name_unit=min:max, as in E_1_MPa=0:10")
        kind = KINDS.get(name, "stress" if name.startswith("E_") else None)
        if kind is None:
            known = ", ".join([*(f"{n}_{UNITS[k][0]}" for n, k in KINDS.items()), "E_1_MPa, ..."])
            raise InputError(f"bounds {entry!r}: unknown parameter; known, with any unit: {known}")
        if name in bounds:
            raise InputError(f"bounds of {name} are given twice")
        ends = interval.split(":")
        try:
            low, high = float(ends[0]), float(ends[-1])
        except ValueError:
            raise InputError(f"bounds {entry!r}: {interval!r} is not min:max") from None
        if len(ends) > 2:
            raise InputError(f"bounds {entry!r}: {interval!r} is not min:max")
        bounds[name] = (to_si(low, unit, kind), to_si(high, unit, kind))
    return bounds

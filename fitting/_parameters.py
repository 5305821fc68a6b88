"""The parameters of an identification: names, units, bounds, and the two standard boxes."""

import dataclasses
import math
from collections.abc import Mapping

from ._data import Specimen
from ._errors import InputError

GEOMETRY = ("braid_diameter", "braid_angle", "deadband_pressure")
"""The nonlinear parameters, in the order in which every array holds them."""

KINDS = {"braid_diameter": "length", "braid_angle": "angle", "deadband_pressure": "pressure"}
"""Kind of unit of each; coefficients E_1, E_2, ... are stresses."""

_WALL_ALLOWANCE = 3.6e-3
"""The braid lies between the bore and the outside of two 1.8 mm walls [m]."""


@dataclasses.dataclass(frozen=True)
class Bounds:
    """An interval in SI; a parameter with min = max is held fixed."""

    min: float
    max: float

    @property
    def fixed(self) -> bool:
        """Whether the interval is one value."""
        return self.min == self.max


def coefficient_names(order: int) -> tuple[str, ...]:
    """E_1 to E_order."""
    return tuple(f"E_{n}" for n in range(1, order + 1))


def kind_of(name: str) -> str:
    """Kind of unit of a parameter."""
    return KINDS.get(name, "stress")


def default_bounds(specimen: Specimen, box: str) -> dict[str, Bounds]:
    """The bounds of the geometry in one of the two standard boxes.

    Args:
        specimen: its nominal diameter places the braid diameter.
        box: "physical", in which the geometry is that of a buildable muscle (braid diameter from
            the bore to 3.6 mm above it, braid angle 60 to 70 deg, deadband to 1 bar), or "open",
            in which the geometry is only a fit parameter.

    Returns:
        Bounds in SI by name. Without a nominal diameter the braid diameter is bounded by what
        muscles are made in, 3 to 80 mm.
    """
    nominal = specimen.nominal_diameter
    if box == "physical":
        diameter = Bounds(nominal, nominal + _WALL_ALLOWANCE) if nominal else Bounds(3e-3, 80e-3)
        return {
            "braid_diameter": diameter,
            "braid_angle": Bounds(math.radians(60), math.radians(70)),
            "deadband_pressure": Bounds(0.0, 100e3),
        }
    if box == "open":
        diameter = Bounds(nominal / 2, nominal * 2) if nominal else Bounds(3e-3, 80e-3)
        return {
            "braid_diameter": diameter,
            "braid_angle": Bounds(math.radians(45), math.radians(80)),
            "deadband_pressure": Bounds(0.0, 200e3),
        }
    raise InputError(f"the box is 'physical' or 'open', got {box!r}")


def complete_bounds(
    specimen: Specimen, box: str, order: int, given: Mapping[str, tuple[float, float]]
) -> dict[str, Bounds]:
    """Bounds of every parameter: the standard box with the given intervals put in.

    Raises:
        InputError: an unknown name, or an interval whose ends contradict each other.
    """
    bounds = default_bounds(specimen, box)
    bounds |= {name: Bounds(-math.inf, math.inf) for name in coefficient_names(order)}
    for name, (low, high) in given.items():
        if name not in bounds:
            raise InputError(f"unknown parameter {name!r}; this fit has {', '.join(bounds)}")
        if math.isnan(low) or math.isnan(high) or low > high:
            raise InputError(
                f"bounds of {name}: the lower one, {low:.6g}, must not exceed the upper one, "
                f"{high:.6g} (SI)"
            )
        bounds[name] = Bounds(low, high)
    for name in GEOMETRY:
        low, high = bounds[name].min, bounds[name].max
        if not (math.isfinite(low) and math.isfinite(high)):
            raise InputError(f"{name} needs finite bounds, got {low:.6g} to {high:.6g} (SI)")
    if bounds["braid_diameter"].min <= 0:
        raise InputError("the lower bound of braid_diameter must be > 0")
    if bounds["braid_angle"].min <= 0 or bounds["braid_angle"].max >= math.pi / 2:
        raise InputError("braid_angle lies between 0 and 90 deg, measured from the circumference")
    if bounds["deadband_pressure"].min < 0:
        raise InputError("the lower bound of deadband_pressure must be >= 0 (gauge pressure)")
    return bounds

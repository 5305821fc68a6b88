"""Parameter table for an identification: value, bounds, prior and unit of every parameter."""

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS, to_si

from .arguments import check_pair, is_number, shown
from .data import Specimen
from .specimen import check_bounds, check_prior

KINDS = {
    "braid_diameter": "length",
    "braid_angle": "angle",
    "deadband_pressure": "pressure",
    "rest_length": "length",
    "end_factor": "number",
    "end_length": "length",
    "braid_compliance": "strain compliance",
    "series_compliance": "compliance",
    "series_exponent": "number",
}
"""Type of unit of each parameter, except those of the bladder law."""

_POSITIVE = {
    "braid_diameter", "braid_angle", "rest_length", "end_factor", "strain_scale", "series_exponent",
}  # fmt: skip
_NOT_NEGATIVE = {"end_length", "deadband_pressure", "braid_compliance", "series_compliance"}
"""Parameters whose lower bound must not be negative."""

_WALL_ALLOWANCE = 3.6e-3
"""Largest difference between braid diameter and bore [m]: two walls of 1.8 mm each."""


@dataclasses.dataclass(frozen=True)
class Parameter:
    """The user's settings for one parameter; None keeps the default.

    Attributes:
        value: fixed value, allowed only with `vary=False`.
        min, max: bounds.
        vary: True to identify the parameter, False to fix it.
        prior: (mean, standard deviation) of the prior.
        unit: unit of all the numbers above, such as "mm"; "" is allowed only for dimensionless parameters.
    """

    value: float | None = None
    min: float | None = None
    max: float | None = None
    vary: bool = True
    prior: tuple[float, float] | None = None
    unit: str = ""


@dataclasses.dataclass(frozen=True)
class Entry:
    """One parameter as the fit uses it, in SI units; it is fixed if min equals max.

    Attributes:
        min, max: bounds.
        kind: type of unit, such as "length" or "pressure".
        prior: (mean, standard deviation) or None.
    """

    min: float = -math.inf
    max: float = math.inf
    kind: str = "number"
    prior: tuple[float, float] | None = None

    @property
    def fixed(self) -> bool:
        """True if the bounds are equal, so that the parameter is fixed."""
        return self.min == self.max


def base_name(name: str) -> str:
    """Return the name without the specimen suffix: `braid_angle` for `braid_angle[10cm]`."""
    return name.partition("[")[0]


def standard_table(specimen: Specimen) -> dict[str, Entry]:
    """Return the three parameters that every fit includes, with bounds suitable for real muscles.

    Args:
        specimen: the specimen; its nominal diameter sets the bounds on the braid diameter.

    Returns:
        Entries in SI units, keyed by name. The braid diameter is between the nominal diameter and
        3.6 mm above it (2.2 times the wall for walls over 1.8 mm), or between 3 and 80 mm if there is no
        nominal diameter. The braid angle is between 60 and 70 deg, and the deadband between 0 and 1 bar.
    """
    bore, wall = specimen.nominal_diameter, 2 * specimen.wall_thickness
    allowance = 1.1 * wall if wall > 1.001 * _WALL_ALLOWANCE else _WALL_ALLOWANCE
    diameter = (bore, bore + allowance) if bore else (3e-3, 80e-3)
    return {
        "braid_diameter": Entry(*diameter, "length"),
        "braid_angle": Entry(math.radians(60), math.radians(70), "angle"),
        "deadband_pressure": Entry(0.0, 100e3, "pressure"),
    }


def optional_table(specimen: Specimen) -> dict[str, Entry]:
    """Return the optional parameters with default bounds; they are fitted only if the user names them."""
    rest = specimen.rest_length
    return {
        "rest_length": Entry(0.97 * rest, 1.03 * rest, "length"),
        "end_factor": Entry(1.0, 1.4),
        "end_length": Entry(0.0, (1 - 1 / 1.4) * rest, "length"),
        "braid_compliance": Entry(0.0, 3e-5, KINDS["braid_compliance"]),
        "series_compliance": Entry(0.0, 5e-5, KINDS["series_compliance"]),
        "series_exponent": Entry(0.3, 1.0),
    }


def entry_in_si(name: str, given: Parameter, standard: Entry) -> Entry:
    """Apply the user's settings to the standard entry of a parameter; return the result in SI units.

    Raises:
        InputError: the unit is missing or unknown, the bounds or value are contradictory, or the
            prior's standard deviation is not positive.
    """
    if not isinstance(given, Parameter):
        raise InputError(
            f"parameters[{name!r}] must be a fitting.Parameter, got {shown(given)}; "
            "pass intervals as bounds={...}"
        )
    ends, told = (given.min, given.max), given.prior
    said = [one for one in (given.value, *ends) if one is not None]
    if not all(map(is_number, said)):
        raise InputError(f"value, min and max of {name} must be numbers, got {shown(said)}")
    if given.vary == (given.value is not None) or (not given.vary and (*ends, told) != (None,) * 3):
        raise InputError(
            f"{name}: vary=False needs a value and allows no bounds or prior; vary=True allows no value, "
            "because starting points are sampled within the bounds"
        )
    if standard.kind != "number" and not given.unit and (said or told):
        units = list(UNITS[standard.kind])
        raise InputError(
            f"{name} needs a unit of {standard.kind}, one of {', '.join(units)}. Example: "
            f"Parameter(..., unit={units[-1]!r})"
        )

    def si(value: float) -> float:
        return to_si(value, given.unit, standard.kind) if given.unit else float(value)

    check_bounds(name, standard.kind, map(si, said), given.unit)
    if given.value is not None:
        return bounded(name, si(given.value), si(given.value), standard)
    if told is not None:
        told = check_pair(f"the prior on {name}", told, "must be (mean, standard deviation)")
        told = si(told[0]), si(told[1])
        if not (np.isfinite(told).all() and told[1] > 0):
            raise InputError(
                f"the prior on {name} must have a finite mean and a standard deviation > 0, got "
                f"{given.prior}"
            )
        check_prior(name, standard.kind, told, given.unit)
    low = standard.min if given.min is None else si(given.min)
    high = standard.max if given.max is None else si(given.max)
    if told is not None:  # a measured value beyond the usual bounds moves them
        low = told[0] - 3 * told[1] if given.min is None and told[0] < low else low
        high = told[0] + 3 * told[1] if given.max is None and told[0] > high else high
    return bounded(name, low, high, dataclasses.replace(standard, prior=told))


def bounded(name: str, low: float, high: float, entry: Entry) -> Entry:
    """Return the entry with these bounds [SI].

    Raises:
        InputError: the lower bound exceeds the upper one, or equal bounds fix a parameter that has a prior.
    """
    if math.isnan(low) or math.isnan(high) or low > high:
        raise InputError(
            f"the lower bound of {name}, {low:.6g}, must not exceed the upper bound, {high:.6g} (SI)"
        )
    if low == high and entry.prior is not None:
        raise InputError(
            f"the bounds on {name} fix it at {low:.6g} (SI), so its prior has no effect: specify "
            "either a prior or a fixed value"
        )
    return dataclasses.replace(entry, min=float(low), max=float(high))


def complete_table(
    specimen: Specimen,
    law: Mapping[str, Entry],
    bounds: Mapping[str, tuple[float, float]],
    parameters: Mapping[str, Parameter],
    further: Mapping[str, Entry] | None = None,
) -> dict[str, Entry]:
    """Combine standard bounds, law parameters and user settings into the table for one specimen.

    Args:
        specimen: the specimen to fit.
        law: shape parameters and coefficients of the law.
        bounds: (low, high) in SI units, keyed by name.
        parameters: bounds, fixed values and priors with their units, keyed by name.
        further: parameters declared by a custom geometry or custom terms; they are fitted only if
            `bounds` or `parameters` names them.

    Returns:
        Entries in SI units, keyed by name, with the coefficients last.

    Raises:
        InputError: a name is unknown, or settings contradict each other.
    """
    standard, changed = standard_table(specimen), {}
    known = {**optional_table(specimen), **(further or {}), **standard, **law}
    for name in (*bounds, *parameters):
        if name not in known:
            raise InputError(f"unknown parameter {name!r}; choose from {', '.join(known)}")
        entry, given = known[name], parameters.get(name)
        if given is not None:
            entry = entry_in_si(name, given, entry)
        if name in bounds:
            ends = check_pair(f"bounds on {name}", bounds[name], "must be (low, high)")
            check_bounds(name, entry.kind, ends)
            if given is not None and (given.value, given.min, given.max) != (None, None, None):
                raise InputError(f"set the bounds on {name} only once: in bounds or in parameters")
            entry = bounded(name, *ends, entry)
        changed[name] = entry
    extras = {name: changed[name] for name in known if name in changed and name not in law}
    table = {**standard, **extras, **law, **changed}
    _check_physics(table, law)
    return table


def _check_physics(table: Mapping[str, Entry], law: Mapping[str, Entry]) -> None:
    """Check that all bounds are physically possible, and finite for parameters that are found by search."""
    for name, entry in table.items():
        low, high = entry.min, entry.max
        if not (name in law and entry.kind == "stress") and not np.isfinite([low, high]).all():
            raise InputError(f"{name} needs finite bounds, got {low:.6g} to {high:.6g} (SI)")
        if (name in _POSITIVE and not low > 0) or (name in _NOT_NEGATIVE and low < 0):
            must = "> 0" if name in _POSITIVE else ">= 0"
            raise InputError(f"the lower bound of {name} must be {must}, got {low:.6g} (SI)")
    if table["braid_angle"].max >= math.pi / 2:
        raise InputError(
            "braid_angle must be between 0 and 90 deg, measured from the circumference"
        )
    if "end_factor" in table and "end_length" in table:
        raise InputError("end_factor and end_length describe the same quantity: specify only one")
    if "series_exponent" in table and "series_compliance" not in table:
        raise InputError("series_exponent requires series_compliance: specify both")

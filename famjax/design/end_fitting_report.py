"""End-fittings, swage tubes and safety factors as plain rows, the unit in each key."""

import math
from collections.abc import Iterable

from ..boundary.units import Row, entry, factor, unit_system
from .end_fitting import EndFitting
from .safety import SafetyFactor
from .tube_strength import TubeStrength


def end_fitting_rows(fittings: Iterable[EndFitting], *, system: str = "si") -> list[Row]:
    """The sizings of an end-fitting, in their order; sensitivities are per length of the radius."""
    unit = unit_system(system)["length"]
    per_unit = factor(unit, "length")
    return [
        {
            "tube": fitting.tube.name,
            "bladder": fitting.bladder.name,
            "braid": fitting.braid.name,
            **entry("diameter_on_braid", fitting.diameter_on_braid, "length", system),
            **entry("diameter_on_bladder", fitting.diameter_on_bladder, "length", system),
            **entry("bladder_bore", fitting.bladder.bore, "length", system),
            "bore_stretch": fitting.bore_stretch,
            "feasible": fitting.feasible,
            f"braid_compression_per_{unit}": fitting.braid_sensitivity * per_unit,
            f"bladder_compression_per_{unit}": fitting.bladder_sensitivity * per_unit,
        }
        for fitting in fittings
    ]


def tube_buckling_rows(strengths: Iterable[TubeStrength], *, system: str = "si") -> list[Row]:
    """What each swage tube bears, in their order; `assumed` names the numbers that nobody gave."""
    return [
        {
            "tube": strength.tube.name,
            **entry("modulus", strength.modulus, "stress", system),
            **entry("yield_stress", strength.yield_stress, "stress", system),
            **entry("free_length", strength.free_length, "length", system),
            **entry("supported_length", strength.supported_length, "length", system),
            **entry("buckling_load", strength.unsupported_load, "force", system),
            **entry("supported_buckling_load", strength.supported_load, "force", system),
            "gain": strength.gain,
            **entry("yield_load", strength.yield_load, "force", system),
            "yields_first": strength.yields_first,
            "assumed": list(strength.assumed),
        }
        for strength in strengths
    ]


def safety_factor_rows(factors: Iterable[SafetyFactor], *, system: str = "si") -> list[Row]:
    """Each test against each demand, in their order; None in the columns of the other kind."""
    return [
        {
            "test": of.test.name,
            "bladder": of.test.bladder,
            "braid": of.test.braid,
            "failed": of.quantity,
            "demand": of.demand,
            **{
                key: value
                for kind in ("pressure", "force")
                for name, number in (("at_failure", of.failure), ("in_use", of.working))
                for key, value in entry(
                    f"{kind}_{name}", number if of.kind == kind else math.nan, kind, system
                ).items()
            },
            "safety_factor": of.factor,
        }
        for of in factors
    ]

"""Designs as plain rows, the unit in each key, for a table or a JSON file."""

import math
from collections.abc import Iterable, Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from .._types import RealArray
from ..boundary.units import Row, entry, factor, unit_system
from ..materials.abstract_material import AbstractMaterial
from .catalogue import Catalogue, CatalogueBladder, CatalogueBraid
from .catalogue_search import DesignCandidate
from .combination import Combination, Feasibility, fam_angle, feasibility
from .end_fitting import EndFitting
from .safety import SafetyFactor
from .swage_tube import TubeStrength

_KINDS = {
    "braid": "length",
    "force": "force",
    "contraction": "number",
    "largest_diameter": "length",
}


def braid_angle_rows(
    catalogue: Catalogue, diameters: Iterable[float] | None = None, *, system: str = "si"
) -> list[Row]:
    """The braid angle of every braid on every diameter: the reference work's table 2.3.

    Args:
        catalogue: from `load_catalogue`.
        diameters: of the muscle [m]; by default those of the bladders, the widest first.
        system: "si", "metric" or "us".

    Returns:
        Rows of braid, diameter, angle (that of the rule, also where infeasible) and feasibility.
    """
    if diameters is None:
        diameters = sorted({bladder.diameter for bladder in catalogue.bladders}, reverse=True)
    widths = list(diameters)
    return [
        {
            "braid": braid.name,
            **entry("diameter", diameter, "length", system),
            **entry(
                "braid_angle",
                float(fam_angle(diameter, braid.nominal_diameter)),
                "angle",
                system,
            ),
            "feasibility": str(feasibility(diameter, braid)),
        }
        for braid in catalogue.braids
        for diameter in widths
    ]


def geometry_rows(catalogue: Catalogue, rest_length: float, *, system: str = "si") -> list[Row]:
    """The initial geometry of every bladder and braid that fit at an active length L0 [m]."""
    rows = []
    for bladder in catalogue.bladders:
        for braid in catalogue.braids:
            fit = feasibility(bladder.diameter, braid)
            if fit is Feasibility.INFEASIBLE:
                continue
            combination = Combination.of(bladder, braid, rest_length)
            at_rest = combination.braid
            jamming = combination.contraction_range()[1]
            rows.append(
                {
                    "bladder": bladder.name,
                    "braid": braid.name,
                    "feasibility": str(fit),
                    **entry("braid_angle", float(combination.braid_angle), "angle", system),
                    **entry("thread_length", float(at_rest.rest_thread_length), "length", system),
                    **entry("turns", float(at_rest.turns), "number", system),
                    **entry("jamming_contraction", float(jamming), "number", system),
                }
            )
    return rows


def performance_rows(
    bladder: CatalogueBladder,
    braid: CatalogueBraid,
    pressure: float,
    contractions: Sequence[float],
    *,
    material: AbstractMaterial | None = None,
    system: str = "si",
) -> list[Row]:
    """Force and diameter against contraction of one combination; None where its braid jams.

    Args:
        bladder: row of the catalogue.
        braid: row of the catalogue.
        pressure: gauge pressure P [Pa].
        contractions: [-], fractions.
        material: of the bladder, in Pa; None neglects the bladder.
        system: "si", "metric" or "us".

    Returns:
        A row for each contraction.
    """
    combination = Combination.of(bladder, braid)
    at = jnp.asarray(contractions)
    columns = (at, *_force_and_diameter(combination, at, pressure, material))
    return [
        {
            "contraction": float(contraction),
            **entry("pressure", pressure, "pressure", system),
            **entry("force", force, "force", system),
            **entry("outer_diameter", diameter, "length", system),
        }
        for contraction, force, diameter in zip(*map(np.asarray, columns), strict=True)
    ]


@eqx.filter_jit
def _force_and_diameter(
    combination: Combination,
    contraction: RealArray,
    pressure: float,
    material: AbstractMaterial | None,
) -> tuple[RealArray, RealArray]:
    return combination.force(contraction, pressure, material), combination.outer_diameter(
        contraction
    )


def candidate_rows(candidates: Iterable[DesignCandidate], *, system: str = "si") -> list[Row]:
    """The candidates of a search, in their order, with what each of them fails.

    Args:
        candidates: from `search`.
        system: "si", "metric" or "us".

    Returns:
        A row for each; `fails` is a list with the name, what was required and what was found.
    """
    return [
        {
            "bladder": candidate.bladder.name,
            "braid": candidate.braid.name,
            "feasibility": str(candidate.feasibility),
            "meets": not candidate.failures,
            **entry("braid_angle", candidate.braid_angle, "angle", system),
            **entry("blocked_force", candidate.blocked_force, "force", system),
            **entry("force", candidate.force, "force", system),
            **entry("usable_contraction", candidate.usable_contraction, "number", system),
            "jams": candidate.jams,
            **entry("outer_diameter", candidate.outer_diameter, "length", system),
            "fails": [
                {
                    "requirement": failure.requirement,
                    **entry("required", failure.required, _KINDS[failure.requirement], system),
                    **entry("found", failure.found, _KINDS[failure.requirement], system),
                }
                for failure in candidate.failures
            ],
        }
        for candidate in candidates
    ]


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
    """What each swage tube bears, in their order; `assumed` names the numbers that were not given."""
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

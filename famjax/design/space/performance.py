"""What one candidate does, and by how much it keeps to what is asked for: pure JAX."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np

from ..._compiled import compiled
from ..._types import RealArray
from ...braids.thread import thread_tension
from ...geometries import inner_volume
from ...materials.abstract_material import AbstractMaterial
from ..catalogue_search import Requirement
from ..combination import Combination
from ..safety import safety_factor
from .limits import ATMOSPHERE, CONSTRAINTS, SearchLimits
from .pairs import BuildablePair

Numbers: TypeAlias = dict[str, RealArray]
"""Numbers by name."""


def pair_numbers(pairs: Sequence[BuildablePair]) -> dict[str, np.ndarray]:
    """What the formulas need of each pair, by name, each (pairs,), in SI; nan where not known."""
    columns = {
        "bladder_diameter": [p.bladder.diameter for p in pairs],
        "bladder_thickness": [p.bladder.thickness for p in pairs],
        "braid_thickness": [p.braid.thickness for p in pairs],
        "smallest_share": [p.braid.diameter_range[0] / p.braid.nominal_diameter for p in pairs],
        "largest_share": [p.braid.diameter_range[1] / p.braid.nominal_diameter for p in pairs],
        "n_threads": [p.braid.n_threads for p in pairs],
        "breaking_load": [p.braid.breaking_load for p in pairs],
        "burst_pressure": [p.burst_pressure for p in pairs],
        "breaking_pull": [p.breaking_pull for p in pairs],
        "tube_yield_load": [p.tube_yield_load for p in pairs],
    }
    return {name: np.array(values, dtype=np.float64) for name, values in columns.items()}


def demand_numbers(requirement: Requirement, limits: SearchLimits) -> dict[str, float]:
    """The numbers of what is asked for, by name, in SI."""
    return vars(requirement) | {
        name: value for name, value in vars(limits).items() if name != "end_fittings"
    }


def performance(
    candidate: Mapping[str, RealArray],
    demand: Mapping[str, RealArray],
    material: AbstractMaterial | None,
) -> tuple[Numbers, Numbers]:
    """What a candidate does, and by how much it keeps to what is asked for.

    The stroke is the usable contraction times the rest length. The outer diameter and the air are
    those at the contraction that the requirement's contraction and the stroke ask for, or at the
    usable one if that is less. The air is what fills the muscle from rest without pressure to there
    under pressure, as free air: ((P + P_a) V - P_a V0) / P_a, isothermal.

    Args:
        candidate: scalars: those of `pair_numbers` for its pair, and `nominal_diameter` [m],
            `rest_length` [m] and `pressure` [Pa].
        demand: scalars, those of `demand_numbers`.
        material: of the bladder, in Pa; None neglects the bladder.

    Returns:
        (numbers of `COLUMNS`, margins of `CONSTRAINTS`), scalars by name. A margin is the share of
        the limit by which it is kept, negative where it is not; nan where the braid jams before it,
        the pressure does not move the bladder, or nothing is known.
    """
    nominal, length = candidate["nominal_diameter"], candidate["rest_length"]
    pressure = candidate["pressure"]
    combination = Combination(
        bladder_diameter=candidate["bladder_diameter"],
        bladder_thickness=candidate["bladder_thickness"],
        nominal_diameter=nominal,
        braid_thickness=candidate["braid_thickness"],
        smallest_diameter=nominal * candidate["smallest_share"],
        largest_diameter=nominal * candidate["largest_share"],
        rest_length=length,
    )
    usable = combination.usable_contraction(pressure, material)
    blocked = combination.force(0.0, pressure, material)
    asked_at = jnp.maximum(demand["force_contraction"], demand["force_stroke"] / length)
    used = jnp.minimum(jnp.maximum(demand["contraction"], demand["stroke"] / length), usable)
    tension = thread_tension(
        blocked, pressure, combination.bladder_diameter / 2, combination.braid_angle,
        candidate["n_threads"],
    )  # fmt: skip
    columns = {
        "rest_length": length,
        "pressure": pressure,
        "braid_angle": combination.braid_angle,
        "nominal_diameter": nominal,
        "blocked_force": blocked,
        "force": combination.force(asked_at, pressure, material),
        "contraction": usable,
        "stroke": usable * length,
        "outer_diameter": combination.outer_diameter(used),
        "air": _free_air(combination, used, pressure),
        "burst_factor": safety_factor(candidate["burst_pressure"], pressure),
        "pull_factor": safety_factor(candidate["breaking_pull"], blocked),
        "thread_factor": safety_factor(candidate["breaking_load"], tension),
        "tube_factor": safety_factor(candidate["tube_yield_load"], blocked),
    }
    margins = {
        name: _margin(columns[column], demand[name], upper=side == "most", always=name in _ALWAYS)
        for name, (column, side) in CONSTRAINTS.items()
    }
    return columns, margins


_ALWAYS = ("force", "contraction")  # a muscle that cannot be there is none, whatever is asked for


def _margin(found: RealArray, limit: RealArray, *, upper: bool, always: bool) -> RealArray:
    if upper:
        return 1 - found / limit
    asked = limit > 0
    share = found / jnp.where(asked, limit, 1.0) - 1
    # Without a limit the sign is what counts; what is not asked for is kept with room to spare.
    return jnp.where(asked, share, jnp.sign(found) if always else 1.0)


def _free_air(combination: Combination, contraction: RealArray, pressure: RealArray) -> RealArray:
    geometry, rest = combination.geometry, combination.rest_length
    empty = inner_volume(geometry, rest, jnp.zeros_like(pressure))
    full = inner_volume(geometry, rest * (1 - contraction), pressure)
    return full * (1 + pressure / ATMOSPHERE) - empty


@compiled
def performances(
    candidates: Mapping[str, RealArray],
    demand: Mapping[str, RealArray],
    material: AbstractMaterial | None,
) -> tuple[Numbers, Numbers]:
    """`performance` of many candidates: every number of theirs (n,)."""
    return jax.vmap(lambda one: performance(one, demand, material))(dict(candidates))

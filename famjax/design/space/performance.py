"""What one candidate does, and by how much it keeps to what is asked for: pure JAX."""

from collections.abc import Mapping, Sequence
from typing import TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Int

from ..._compiled import compiled
from ..._types import RealArray
from ...boundary.errors import InputError
from ...braids.thread import thread_tension
from ...materials.abstract_material import AbstractMaterial
from ...materials.polynomial import PolynomialMaterial
from ..catalogue_search import Requirement
from ..combination import Combination
from ..safety import safety_factor
from .limits import ATMOSPHERE, CONSTRAINTS, SearchLimits
from .pairs import BuildablePair

Numbers: TypeAlias = dict[str, RealArray]
"""Numbers by name."""


def pair_numbers(
    pairs: Sequence[BuildablePair], material: AbstractMaterial | None
) -> dict[str, np.ndarray]:
    """What the formulas need of each pair, by name, each (pairs,), in SI; nan where not known.

    Where the catalogue knows the rubber of some bladder, `coefficients`, (pairs, order), are those of
    each, filled up with zeros.

    Raises:
        InputError: it does, and the material of the others is no polynomial.
    """
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
    numbers = {name: np.array(values, dtype=np.float64) for name, values in columns.items()}
    if any(pair.bladder.coefficients is not None for pair in pairs):
        numbers["coefficients"] = _coefficients(pairs, material)
    return numbers


def _coefficients(pairs: Sequence[BuildablePair], material: AbstractMaterial | None) -> np.ndarray:
    if material is not None and not isinstance(material, PolynomialMaterial):
        raise InputError(
            f"the catalogue gives coefficients of some bladders, and the others are to be of a "
            f"{type(material).__name__}: give a PolynomialMaterial, or None to neglect the others"
        )
    others = [] if material is None else np.asarray(material.coefficients).tolist()
    own = [pair.bladder.coefficients for pair in pairs]
    rows = [others if one is None else list(one) for one in own]
    order = max(map(len, rows))
    return np.array([row + [0.0] * (order - len(row)) for row in rows])


def demand_numbers(requirement: Requirement, limits: SearchLimits) -> dict[str, float]:
    """The numbers of what is asked for, by name, in SI."""
    return vars(requirement) | {
        name: value for name, value in vars(limits).items() if name != "end_fittings"
    }


def free_contraction(
    state: Mapping[str, RealArray], material: AbstractMaterial | None
) -> RealArray:
    """Contraction [-] at zero force of a state, jamming left aside, whatever the rest length.

    Args:
        state: scalars: those of `pair_numbers`, `nominal_diameter` [m] and `pressure` [Pa].
        material: of the bladder, in Pa, unless the catalogue knows it; None neglects the bladder.

    Returns:
        Fraction [-]; nan where the force does not fall to zero.
    """
    rubber = _rubber(state, material)
    return _combination(state, jnp.ones(())).free_contraction(state["pressure"], rubber)


def _rubber(
    state: Mapping[str, RealArray], material: AbstractMaterial | None
) -> AbstractMaterial | None:
    known = state.get("coefficients")
    return material if known is None else PolynomialMaterial(known)


def _combination(state: Mapping[str, RealArray], length: RealArray) -> Combination:
    nominal = state["nominal_diameter"]
    return Combination(
        bladder_diameter=state["bladder_diameter"],
        bladder_thickness=state["bladder_thickness"],
        nominal_diameter=nominal,
        braid_thickness=state["braid_thickness"],
        smallest_diameter=nominal * state["smallest_share"],
        largest_diameter=nominal * state["largest_share"],
        rest_length=length,
    )


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
        candidate: scalars: those of a state, its `free_contraction`, and `rest_length` [m].
        demand: scalars, those of `demand_numbers`.
        material: of the bladder, in Pa, unless the catalogue knows it; None neglects the bladder.

    Returns:
        (numbers of `COLUMNS`, margins of `CONSTRAINTS`), scalars by name. A margin is the share of
        the limit by which it is kept, negative where it is not; nan where the braid jams before it,
        the pressure does not move the bladder, or nothing is known.
    """
    length, pressure = candidate["rest_length"], candidate["pressure"]
    combination, rubber = _combination(candidate, length), _rubber(candidate, material)
    usable = jnp.minimum(candidate["free_contraction"], combination.contraction_range()[1])
    blocked = combination.force(0.0, pressure, rubber)
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
        "nominal_diameter": candidate["nominal_diameter"],
        "blocked_force": blocked,
        "force": combination.force(asked_at, pressure, rubber),
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
    # Of a difference, so that what is at its limit keeps to it whatever the rounding of the share.
    if upper:
        return jnp.where(jnp.isfinite(limit), (limit - found) / limit, 1.0)
    asked = limit > 0
    share = (found - limit) / jnp.where(asked, limit, 1.0)
    # Without a limit the sign is what counts; what is not asked for is kept with room to spare.
    return jnp.where(asked, share, jnp.sign(found) if always else 1.0)


def _free_air(combination: Combination, contraction: RealArray, pressure: RealArray) -> RealArray:
    geometry, rest = combination.geometry, combination.rest_length
    empty = geometry.inner_volume(rest, jnp.zeros_like(pressure))
    full = geometry.inner_volume(rest * (1 - contraction), pressure)
    return full * (1 + pressure / ATMOSPHERE) - empty


@compiled
def performances(
    states: Mapping[str, RealArray],
    of_state: Int[Array, " candidates"],
    rest_length: RealArray,
    demand: Mapping[str, RealArray],
    material: AbstractMaterial | None,
) -> tuple[Numbers, Numbers]:
    """`performance` of many candidates, the free contraction solved once for each state.

    Args:
        states: see `free_contraction`; every number (states,).
        of_state: the state of each candidate.
        rest_length: L0 [m] of each candidate.
        demand: of `performance`.
        material: of the bladder.
    """
    free = jax.vmap(lambda state: free_contraction(state, material))(dict(states))
    solved = dict(states) | {"free_contraction": free}
    candidates = {name: values[of_state] for name, values in solved.items()}
    candidates["rest_length"] = rest_length
    return jax.vmap(lambda one: performance(one, demand, material))(candidates)

"""Search of a catalogue: which bladder under which braid does what is required."""

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._types import RealArray, as_real
from ..materials.abstract_material import AbstractMaterial
from .catalogue import Catalogue, CatalogueBladder, CatalogueBraid
from .combination import Combination, Feasibility, bladder_material, fam_angle, feasibility

_Pair = tuple[CatalogueBladder, CatalogueBraid]


@dataclasses.dataclass(frozen=True)
class Requirement:
    """What a muscle must do.

    Attributes:
        pressure: gauge pressure P [Pa] it is given, > 0.
        force: least pull [N] at `force_contraction`, >= 0.
        contraction: [-] it must reach, a fraction in [0, 1).
        largest_diameter: [m] outside the braid, at `contraction`, not to be exceeded.
        force_contraction: contraction [-] at which `force` is asked for; 0 asks for blocked force.
    """

    pressure: float
    force: float
    contraction: float
    largest_diameter: float = math.inf
    force_contraction: float = 0.0

    def __post_init__(self) -> None:
        """Refuse what no muscle could be asked for."""
        if not (0 < self.pressure < math.inf):
            raise ValueError(f"the pressure must be > 0 and finite, got {self.pressure} Pa")
        if not (0 <= self.force < math.inf):
            raise ValueError(f"the force must be >= 0 and finite, got {self.force} N")
        for name in ("contraction", "force_contraction"):
            value = getattr(self, name)
            if not 0 <= value < 1:
                raise ValueError(f"{name} must be a fraction in [0, 1), got {value}; 0.35 is 35 %")
        if not self.largest_diameter > 0:
            raise ValueError(f"the largest diameter must be > 0, got {self.largest_diameter} m")


@dataclasses.dataclass(frozen=True)
class Failure:
    """A requirement that a combination fails: its name, what was required, what was found, in SI.

    `requirement` is "braid" (bladder diameter [m] against the nearer end of the braid's range),
    "force" [N], "contraction" [-] or "largest_diameter" [m]. `found` is nan where the braid jams
    before it, or the pressure does not move the bladder.
    """

    requirement: str
    required: float
    found: float


@dataclasses.dataclass(frozen=True)
class DesignCandidate:
    """A combination held against a requirement.

    Attributes:
        bladder: row of the catalogue.
        braid: row of the catalogue.
        feasibility: of the braid on the bladder.
        braid_angle: theta0 [rad], from the circumference; nan where the bladder is too wide.
        blocked_force: [N], at zero contraction and the required pressure.
        force: [N], at the required `force_contraction`.
        usable_contraction: [-], to zero force or to jamming.
        jams: True where the braid jams before the force has fallen to zero.
        outer_diameter: [m] outside the braid at the required contraction, or at the usable one if
            that is less.
        failures: empty where all is met. The numbers above are nan where the braid does not fit.
    """

    bladder: CatalogueBladder
    braid: CatalogueBraid
    feasibility: Feasibility
    braid_angle: float
    blocked_force: float
    force: float
    usable_contraction: float
    jams: bool
    outer_diameter: float
    failures: tuple[Failure, ...]


@eqx.filter_jit
def _performance(
    combinations: Combination,
    demand: tuple[RealArray, RealArray, RealArray],
    material: AbstractMaterial | None,
) -> dict[str, Float[Array, " combinations"]]:
    """The numbers of `DesignCandidate` for stacked combinations."""
    pressure, contraction, force_contraction = demand

    def one(combination: Combination) -> dict[str, RealArray]:
        usable = combination.usable_contraction(pressure, material)
        return {
            "blocked_force": combination.force(0.0, pressure, material),
            "force": combination.force(force_contraction, pressure, material),
            "usable_contraction": usable,
            "jams": combination.contraction_range()[1] <= usable,
            "outer_diameter": combination.outer_diameter(jnp.minimum(contraction, usable)),
        }

    return jax.vmap(one)(combinations)


def search(
    catalogue: Catalogue, requirement: Requirement, *, material: AbstractMaterial | None = None
) -> list[DesignCandidate]:
    """Every combination of the catalogue held against a requirement, the best first.

    Those that meet it come first: feasible before boundary, then the smallest outer diameter at the
    required contraction, then the greatest usable contraction. The others follow, each with all the
    requirements that it fails, those with the fewest failures first; last come the braids that do
    not fit. Equal ones stay in the order of the catalogue.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI.
        material: of the bladders whose rubber the catalogue does not know, in Pa; None neglects
            them, so that their wall plays no part and every force and contraction is that of the
            ideal braid.

    Returns:
        One candidate for each bladder and braid.
    """
    fits = {
        (bladder, braid): feasibility(bladder.diameter, braid)
        for bladder in catalogue.bladders
        for braid in catalogue.braids
    }
    at_work = [pair for pair, fit in fits.items() if fit is not Feasibility.INFEASIBLE]
    numbers = _of_each_rubber(at_work, requirement, material)
    found = (_candidate(pair, fit, numbers.get(pair), requirement) for pair, fit in fits.items())
    return sorted(found, key=_rank)


def _of_each_rubber(
    pairs: Sequence[_Pair], requirement: Requirement, material: AbstractMaterial | None
) -> dict[_Pair, dict[str, Any]]:
    """The numbers of each pair as Python values; those of one rubber together."""
    demand = (
        as_real(requirement.pressure),
        as_real(requirement.contraction),
        as_real(requirement.force_contraction),
    )
    found: dict[_Pair, dict[str, Any]] = {}
    for rubber in dict.fromkeys(bladder.coefficients for bladder, _ in pairs):
        of_it = [pair for pair in pairs if pair[0].coefficients == rubber]
        combinations = (Combination.of(*pair) for pair in of_it)
        stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *combinations)
        columns = _performance(stacked, demand, bladder_material(of_it[0][0], material))
        lists = (np.asarray(column).tolist() for column in columns.values())
        for pair, *row in zip(of_it, *lists, strict=True):
            found[pair] = dict(zip(columns, row, strict=True))
    return found


def _candidate(
    pair: _Pair, fit: Feasibility, numbers: dict[str, Any] | None, requirement: Requirement
) -> DesignCandidate:
    """A pair with its numbers, None where the braid does not fit, held against the requirement."""
    bladder, braid = pair
    angle = float(fam_angle(bladder.diameter, braid.nominal_diameter))
    if numbers is None:
        end = min(braid.diameter_range, key=lambda limit: abs(limit - bladder.diameter))
        failure = Failure("braid", end, bladder.diameter)
        nothing = math.nan
        return DesignCandidate(
            bladder, braid, fit, angle, nothing, nothing, nothing, False, nothing, (failure,)
        )
    force, usable, width = (
        numbers[name] for name in ("force", "usable_contraction", "outer_diameter")
    )
    held = (
        ("force", force, force >= requirement.force),
        ("contraction", usable, usable >= requirement.contraction),
        # Not known, hence not failed, where there is no contraction to be reached.
        ("largest_diameter", width, not width > requirement.largest_diameter),
    )
    failures = tuple(
        Failure(name, getattr(requirement, name), found) for name, found, met in held if not met
    )
    return DesignCandidate(bladder, braid, fit, angle, **numbers, failures=failures)


def _rank(candidate: DesignCandidate) -> tuple[bool, int, bool, float, float]:
    """Sorting key of `search`."""
    unfit = candidate.feasibility is Feasibility.INFEASIBLE
    if candidate.failures:
        return unfit, len(candidate.failures), False, 0.0, 0.0
    boundary = candidate.feasibility is Feasibility.BOUNDARY
    # To a micrometre and a millionth, so that the rounding of float32 decides no tie.
    width, stroke = round(candidate.outer_diameter, 6), round(candidate.usable_contraction, 6)
    return unfit, 0, boundary, width, -stroke

"""Design of a muscle from a catalogue: which bladder under which braid does what is required.

The braid's angle on a bladder follows from cos(theta) / D = cos(45 deg) / D_nominal. As in the
reference work's table 2.3, D is the bladder's outer diameter: the thickness of the braid is left
out of the force and counted only in the diameter outside the braid.
"""

import dataclasses
import enum
import math
from collections.abc import Sequence
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._bladder import Bladder
from ._braid import NEUTRAL_ANGLE, Braid, braid_angle_from_diameter
from ._catalogue import NOMINAL_ANGLE, Catalogue, CatalogueBladder, CatalogueBraid
from ._force import gaylord_force
from ._geometry import EstimatedGeometry
from ._material import AbstractMaterial
from ._muscle import Muscle
from ._types import Real, RealArray, as_real

_ROUNDING = 1e-9  # relative: 0.75 in and 19.05 mm are the same diameter


class Feasibility(enum.StrEnum):
    """Whether a braid fits a diameter."""

    FEASIBLE = "feasible"
    BOUNDARY = "boundary"
    INFEASIBLE = "infeasible"


def fam_angle(diameter: Real, nominal_diameter: Real) -> RealArray:
    """Braid angle theta [rad] on a muscle, from cos(theta) / D = cos(45 deg) / D_nominal.

    Jamming is not considered; see `feasibility`.

    Args:
        diameter: D [m] of the muscle, the outer diameter of its bladder.
        nominal_diameter: D_nominal [m] of the braid, that at 45 deg.

    Returns:
        theta [rad], from the circumference, broadcast shape; nan where D > sqrt(2) D_nominal.

    References:
        Chambers 2021, section 2.2 and table 2.3.

    >>> import math
    >>> print(f"{math.degrees(fam_angle(0.875, 2.0)):.1f}")  # inches: the 7/8 in muscle
    72.0
    """
    return braid_angle_from_diameter(diameter, nominal_diameter, NOMINAL_ANGLE)


def feasibility(diameter: float, braid: CatalogueBraid) -> Feasibility:
    """Whether the braid can be put on a bladder of that diameter without jamming.

    Feasible within the braid's `diameter_range`; boundary outside it but within its
    `boundary_range`; infeasible elsewhere. The ends belong to the ranges.

    Args:
        diameter: D [m], outer diameter of the bladder.
        braid: from the catalogue.

    Returns:
        The verdict.
    """

    def within(limits: tuple[float, float]) -> bool:
        return limits[0] * (1 - _ROUNDING) <= diameter <= limits[1] * (1 + _ROUNDING)

    if within(braid.diameter_range):
        return Feasibility.FEASIBLE
    return Feasibility.BOUNDARY if within(braid.boundary_range) else Feasibility.INFEASIBLE


class Combination(eqx.Module):
    """A bladder under a braid. Several may be stacked leaf by leaf, for `jax.vmap`.

    Attributes:
        bladder_diameter: D0 [m], outer; the braid's threads lie on it.
        bladder_thickness: t0 [m].
        nominal_diameter: [m], of the braid, at 45 deg.
        braid_thickness: [m].
        smallest_diameter: [m], at which the braid jams when stretched.
        largest_diameter: [m], at which the braid jams when shortened.
        rest_length: L0 [m], active length at rest; force against contraction does not depend on it.
    """

    bladder_diameter: Float[Array, "..."] = eqx.field(converter=as_real)
    bladder_thickness: Float[Array, "..."] = eqx.field(converter=as_real)
    nominal_diameter: Float[Array, "..."] = eqx.field(converter=as_real)
    braid_thickness: Float[Array, "..."] = eqx.field(converter=as_real)
    smallest_diameter: Float[Array, "..."] = eqx.field(converter=as_real)
    largest_diameter: Float[Array, "..."] = eqx.field(converter=as_real)
    rest_length: Float[Array, "..."] = eqx.field(converter=as_real, default=1.0)

    @classmethod
    def of(
        cls, bladder: CatalogueBladder, braid: CatalogueBraid, rest_length: Real = 1.0
    ) -> "Combination":
        """The combination of two rows of the catalogue, of active length L0 [m]."""
        return cls(
            bladder_diameter=as_real(bladder.diameter),
            bladder_thickness=as_real(bladder.thickness),
            nominal_diameter=as_real(braid.nominal_diameter),
            braid_thickness=as_real(braid.thickness),
            smallest_diameter=as_real(braid.diameter_range[0]),
            largest_diameter=as_real(braid.diameter_range[1]),
            rest_length=as_real(rest_length),
        )

    @property
    def braid_angle(self) -> RealArray:
        """Initial braid angle theta0 [rad], from the circumference; see `fam_angle`."""
        return fam_angle(self.bladder_diameter, self.nominal_diameter)

    @property
    def braid(self) -> Braid:
        """The braid at rest on the bladder, its thickness neglected."""
        return Braid.from_rest(
            diameter=self.bladder_diameter, braid_angle=self.braid_angle, length=self.rest_length
        )

    def muscle(self, material: AbstractMaterial) -> Muscle:
        """The muscle in the estimated geometry, with a bladder of that material."""
        bladder = Bladder(self.rest_length, self.bladder_diameter, self.bladder_thickness)
        return Muscle(EstimatedGeometry(self.braid, bladder), material)

    def contraction_at_diameter(self, diameter: Real) -> RealArray:
        """Contraction [-] at which the braid's diameter is D [m], 1 - sin(theta) / sin(theta0)."""
        angle = fam_angle(diameter, self.nominal_diameter)
        return 1 - jnp.sin(angle) / jnp.sin(self.braid_angle)

    def contraction_range(self) -> tuple[RealArray, RealArray]:
        """Least and greatest contraction [-] that jamming allows; rest is always allowed.

        A boundary combination rests outside the braid's range and is taken to work from there.
        """
        least = jnp.minimum(self.contraction_at_diameter(self.smallest_diameter), 0.0)
        return least, jnp.maximum(self.contraction_at_diameter(self.largest_diameter), 0.0)

    def diameter(self, contraction: Real) -> RealArray:
        """Braid diameter D [m] at a contraction [-], broadcast shape; nan where the braid jams."""
        length, free = self._length(contraction)
        return jnp.where(free, self.braid.diameter(length), jnp.nan)

    def outer_diameter(self, contraction: Real) -> RealArray:
        """Diameter [m] outside the braid at a contraction [-]; nan where the braid jams."""
        return self.diameter(contraction) + 2 * self.braid_thickness

    def force(
        self, contraction: Real, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Pull F [N] at a contraction [-] and gauge pressure P [Pa]; nan where the braid jams.

        Args:
            contraction: (L0 - L) / L0 [-], a fraction.
            pressure: gauge pressure P [Pa].
            material: of the bladder; None neglects the bladder, F = F_G.

        Returns:
            F [N], broadcast shape, not clipped: negative beyond the free contraction.

        References:
            Gaylord 1958; Chambers 2021, equations 6.1 and 6.9.
        """
        length, free = self._length(contraction)
        if material is None:
            radius = self.braid.diameter(length) / 2
            pull = gaylord_force(pressure, radius, self.braid.braid_angle(length))
        else:
            pull = self.muscle(material).force(length, pressure)
        return jnp.where(free, pull, jnp.nan)

    def free_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at zero force, jamming left aside, of the pressure's shape.

        Without a material it is that of the neutral angle, whatever the pressure. With one it is
        nan where the force does not fall to zero, as below the pressure that moves the bladder.
        """
        if material is not None:
            return self.muscle(material).free_contraction(pressure, throw=False)
        neutral = 1 - math.sin(NEUTRAL_ANGLE) / jnp.sin(self.braid_angle)
        return jnp.broadcast_to(neutral, jnp.broadcast_shapes(neutral.shape, jnp.shape(pressure)))

    def usable_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at which the muscle runs out of force or its braid jams, if sooner."""
        return jnp.minimum(self.free_contraction(pressure, material), self.contraction_range()[1])

    def _length(self, contraction: Real) -> tuple[RealArray, Array]:
        """Length [m], that of rest standing in where the braid jams, and where it does not jam."""
        least, greatest = self.contraction_range()
        rounding = 8 * jnp.finfo(least.dtype).eps  # the ends themselves are free
        at = as_real(contraction)
        free = (at >= least - rounding) & (at <= greatest + rounding)
        return self.rest_length * (1 - jnp.where(free, at, 0.0)), free


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
class Candidate:
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
    """The numbers of `Candidate` for stacked combinations."""
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
) -> list[Candidate]:
    """Every combination of the catalogue held against a requirement, the best first.

    Those that meet it come first: feasible before boundary, then the smallest outer diameter at the
    required contraction, then the greatest usable contraction. The others follow, each with all the
    requirements that it fails, those with the fewest failures first; last come the braids that do
    not fit. Equal ones stay in the order of the catalogue.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI.
        material: of the bladder, in Pa; None neglects the bladder, so that its wall plays no part
            and every force and contraction is that of the ideal braid.

    Returns:
        One candidate for each bladder and braid.
    """
    pairs = [(bladder, braid) for bladder in catalogue.bladders for braid in catalogue.braids]
    fits = [feasibility(bladder.diameter, braid) for bladder, braid in pairs]
    at_work = [
        Combination.of(*pair)
        for pair, fit in zip(pairs, fits, strict=True)
        if fit is not Feasibility.INFEASIBLE
    ]
    numbers = iter(_numbers(at_work, requirement, material))
    candidates = [
        _candidate(
            pair, fit, _NOTHING if fit is Feasibility.INFEASIBLE else next(numbers), requirement
        )
        for pair, fit in zip(pairs, fits, strict=True)
    ]
    return sorted(candidates, key=_rank)


_NOTHING = {
    "blocked_force": math.nan,
    "force": math.nan,
    "usable_contraction": math.nan,
    "jams": False,
    "outer_diameter": math.nan,
}


def _numbers(
    combinations: Sequence[Combination],
    requirement: Requirement,
    material: AbstractMaterial | None,
) -> list[dict[str, Any]]:
    """The numbers of each candidate, as Python values."""
    if not combinations:
        return []
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *combinations)
    demand = (
        as_real(requirement.pressure),
        as_real(requirement.contraction),
        as_real(requirement.force_contraction),
    )
    columns = _performance(stacked, demand, material)
    lists = {name: np.asarray(column).tolist() for name, column in columns.items()}
    return [dict(zip(lists, row, strict=True)) for row in zip(*lists.values(), strict=True)]


def _candidate(
    pair: tuple[CatalogueBladder, CatalogueBraid],
    fit: Feasibility,
    numbers: dict[str, Any],
    requirement: Requirement,
) -> Candidate:
    bladder, braid = pair
    if fit is Feasibility.INFEASIBLE:
        end = min(braid.diameter_range, key=lambda limit: abs(limit - bladder.diameter))
        failures = [Failure("braid", end, bladder.diameter)]
    else:
        met = {
            "force": numbers["force"] >= requirement.force,
            "contraction": numbers["usable_contraction"] >= requirement.contraction,
            # Not known, hence not failed, where there is no contraction to be reached.
            "largest_diameter": not numbers["outer_diameter"] > requirement.largest_diameter,
        }
        found = {**numbers, "contraction": numbers["usable_contraction"]}
        found["largest_diameter"] = numbers["outer_diameter"]
        failures = [
            Failure(name, getattr(requirement, name), found[name])
            for name, holds in met.items()
            if not holds
        ]
    angle = float(fam_angle(bladder.diameter, braid.nominal_diameter))
    return Candidate(bladder, braid, fit, angle, **numbers, failures=tuple(failures))


def _rank(candidate: Candidate) -> tuple[bool, int, bool, float, float]:
    """Sorting key of `search`."""
    unfit = candidate.feasibility is Feasibility.INFEASIBLE
    if candidate.failures:
        return unfit, len(candidate.failures), False, 0.0, 0.0
    boundary = candidate.feasibility is Feasibility.BOUNDARY
    # To a micrometre and a millionth, so that the rounding of float32 decides no tie.
    width, stroke = round(candidate.outer_diameter, 6), round(candidate.usable_contraction, 6)
    return unfit, 0, boundary, width, -stroke

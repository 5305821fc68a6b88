"""Search of a catalogue: every pair of bladder and braid at every rest length and pressure of a grid.

The grid is evaluated in one mapped program, held against a `Requirement`, and reduced to its Pareto
front, of which the most balanced design is refined between the points of the grid.

The braid's angle on a bladder follows from cos(theta) / D = cos(45 deg) / D_nominal. As in the
reference work's table 2.3, D is the bladder's outer diameter: the thickness of the braid is left
out of the force and counted only in the diameter outside the braid.
"""

import dataclasses
import enum
import math
from collections.abc import Mapping, Sequence
from typing import Any, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from numpy.typing import NDArray

from .. import units
from .._arrays import Given, Real, RealArray, as_real
from ..boundary.errors import InputError
from ..braids import Braid, braid_angle_from_diameter, gaylord_force, thread_tension
from ..compile_options import quick_jit
from ..geometries import Bladder, EstimatedGeometry
from ..materials import AbstractMaterial, PolynomialMaterial
from ..muscle import Muscle, bisected
from ..parameters import number
from .catalogue import (
    NOMINAL_ANGLE,
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    size_end_fittings,
)

_ROUNDING = 1e-9  # relative: 0.75 in and 19.05 mm are the same diameter

Floats = NDArray[np.floating]
Range = tuple[float, float]

ATMOSPHERE = 101325.0
"""Standard atmosphere [Pa], at which free air is counted."""

LATEX = (257.8 * units.PSI, -57.9 * units.PSI, 32.7 * units.PSI)
"""E_n [Pa] of the reference work's latex (Chambers 2021, chapter 6): the bladder of the design."""

COLUMNS: dict[str, str] = {
    "rest_length": "length",
    "pressure": "pressure",
    "braid_angle": "angle",
    "blocked_force": "force",
    "force": "force",
    "contraction": "number",
    "stroke": "length",
    "outer_diameter": "length",
    "air": "volume",
    "thread_factor": "number",
}
"""The numbers of a candidate, in SI, and the kind of unit of each; see `Search`."""

OBJECTIVES: dict[str, Literal["least", "most"]] = {
    **dict.fromkeys(("outer_diameter", "rest_length", "pressure", "air"), "least"),
    **dict.fromkeys(("force", "blocked_force", "contraction", "stroke"), "most"),
}
"""What a front can weigh, and which of it is better."""

DEFAULT_OBJECTIVES = ("outer_diameter", "rest_length", "air")
"""The room that a muscle takes, and the air that a stroke costs."""

CONSTRAINTS: dict[str, tuple[str, Literal["least", "most"]]] = {
    "force": ("force", "least"),
    "contraction": ("contraction", "least"),
    "stroke": ("stroke", "least"),
    "largest_diameter": ("outer_diameter", "most"),
    "longest_length": ("rest_length", "most"),
    "thread_factor": ("thread_factor", "least"),
}
"""What is asked for: the column that it is held against, and whether as a lower or an upper limit."""

FRONT_STEP = 0.01
"""Share by which designs on the front differ at least."""

_ZOOMS, _STEPS = 20, 41  # of the refinement: grids one within the other, and the steps of each
_ALWAYS = ("force", "contraction")  # a muscle must pull and contract, whatever is asked for


# --- a bladder under a braid


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
    wider = within(braid.boundary_range or braid.diameter_range)
    return Feasibility.BOUNDARY if wider else Feasibility.INFEASIBLE


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

    bladder_diameter: Float[Given, "..."] = number("m")
    bladder_thickness: Float[Given, "..."] = number("m")
    nominal_diameter: Float[Given, "..."] = number("m")
    braid_thickness: Float[Given, "..."] = number("m")
    smallest_diameter: Float[Given, "..."] = number("m")
    largest_diameter: Float[Given, "..."] = number("m")
    rest_length: Float[Given, "..."] = number("m", default=1.0)

    @classmethod
    def of(
        cls, bladder: CatalogueBladder, braid: CatalogueBraid, rest_length: Real = 1.0
    ) -> "Combination":
        """The combination of two rows of the catalogue, of active length L0 [m]."""
        return cls(
            bladder.diameter, bladder.thickness, braid.nominal_diameter, braid.thickness,
            *braid.diameter_range, rest_length,
        )  # fmt: skip

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

    @property
    def geometry(self) -> EstimatedGeometry:
        """The cylinder of braid and bladder, the thickness of the braid neglected."""
        bladder = Bladder(self.rest_length, self.bladder_diameter, self.bladder_thickness)
        return EstimatedGeometry(self.braid, bladder)

    def muscle(self, material: AbstractMaterial) -> Muscle:
        """The muscle in the estimated geometry, with a bladder of that material."""
        return Muscle(self.geometry, material)

    def contraction_range(self) -> tuple[RealArray, RealArray]:
        """Least and greatest contraction [-] that jamming allows; rest is always allowed.

        A boundary combination rests outside the braid's range and is taken to work from there.
        """
        least, greatest = (  # 1 - sin(theta) / sin(theta0)
            1 - jnp.sin(fam_angle(D, self.nominal_diameter)) / jnp.sin(self.braid_angle)
            for D in (self.smallest_diameter, self.largest_diameter)
        )
        return jnp.minimum(least, 0.0), jnp.maximum(greatest, 0.0)

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

    def usable_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at zero force, or at which the braid jams if that comes first.

        Bisected, with the derivative of the implicit function theorem; nan where the pressure does not
        move the bladder. Of the pressure's shape.
        """
        greatest = self.contraction_range()[1]
        fine = jnp.finfo(greatest.dtype)

        def one(P: RealArray) -> RealArray:
            scale = jax.lax.stop_gradient(self.force(0.0, P, material))

            def missing(share: RealArray) -> RealArray:
                return -self.force(share * greatest, P, material) / jnp.where(scale > 0, scale, 1.0)

            ends = jnp.zeros_like(greatest), jnp.ones_like(greatest)
            share = bisected(missing, *ends, tolerance=float(fine.eps), max_steps=fine.nmant + 2)
            found = jnp.where(self.force(greatest, P, material) > 0, 1.0, share) * greatest
            return jnp.where(scale > 0, found, jnp.nan)

        return jnp.vectorize(one)(as_real(pressure))

    def _length(self, contraction: Real) -> tuple[RealArray, Array]:
        """Length [m], that of rest standing in where the braid jams, and where it does not jam."""
        least, greatest = self.contraction_range()
        rounding = 8 * jnp.finfo(least.dtype).eps  # the ends themselves are free
        at = as_real(contraction)
        free = (at >= least - rounding) & (at <= greatest + rounding)
        return self.rest_length * (1 - jnp.where(free, at, 0.0)), free


# --- the search


@dataclasses.dataclass(frozen=True)
class Requirement:
    """Requirements of a muscle. Zero and infinity require nothing.

    Attributes:
        pressure: gauge pressure P [Pa], the greatest that there is, > 0.
        force: least pull [N] at `force_contraction`, >= 0.
        contraction: [-] it must reach, a fraction in [0, 1).
        largest_diameter: [m] outside the braid, at the contraction and stroke that are asked for.
        force_contraction: contraction [-] at which `force` is asked for; 0 asks for blocked force.
        stroke: travel [m] it must reach, >= 0.
        longest_length: rest length [m] that it may have, between the end-fittings.
        thread_factor: least breaking load of a thread over its tension at zero contraction [-].
    """

    pressure: float
    force: float = 0.0
    contraction: float = 0.0
    largest_diameter: float = math.inf
    force_contraction: float = 0.0
    stroke: float = 0.0
    longest_length: float = math.inf
    thread_factor: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.pressure < math.inf:
            raise InputError(f"the pressure must be > 0 and finite, got {self.pressure} Pa")
        for name in ("contraction", "force_contraction"):
            if not 0 <= (value := getattr(self, name)) < 1:
                raise InputError(f"{name} must be a fraction in [0, 1), got {value}; 0.35 is 35 %")
        for name, (_, side) in CONSTRAINTS.items():
            value = getattr(self, name)
            if side == "most" and not value > 0:
                raise InputError(f"{name} must be > 0, got {value} m")
            if side == "least" and not 0 <= value < math.inf:
                raise InputError(f"{name} must be >= 0 and finite, got {value}")


@dataclasses.dataclass(frozen=True)
class BuildablePair:
    """A bladder under a braid, with its swage tube.

    Attributes:
        bladder: row of the catalogue.
        braid: row of the catalogue.
        fit: feasible, or boundary: usable by its source but at rest outside its jamming range.
        tube: the swage tube that fits with the thickest wall, or None where none is asked for.
    """

    bladder: CatalogueBladder
    braid: CatalogueBraid
    fit: Feasibility
    tube: str | None


@dataclasses.dataclass(frozen=True)
class Search:
    """Result of a search: candidates, in the order of pairs, pressures and rest lengths.

    Columns are (candidates,), in SI: `pair`, a position in `pairs`, `rest_length` L0 [m], `pressure`
    P [Pa], `braid_angle` theta0 [rad] from the circumference, `blocked_force` [N], `force` [N] where it
    is asked for, usable `contraction` [-], to zero force or to jamming, `stroke` [m], `outer_diameter`
    [m] and `air` [m3] at the contraction that is asked for, and the factors [-] of `Requirement`, nan
    where nothing is known.

    Attributes:
        requirement: as given.
        ranges: of rest length [m] and pressure [Pa], as given.
        objectives: as given.
        pairs: that can be built; the others are in `left_out`.
        left_out: pairs that cannot be built, by reason: "braid", "end_fitting", "untested".
        columns: of all candidates.
        margins: (candidates, constraints), share of the limit by which each of `CONSTRAINTS` is kept,
            negative where it is not; nan where the braid jams before it or nothing is known.
        front: positions of the candidates of the Pareto front, the most balanced first.
        refined: columns of the most balanced design refined between the points of the grid, and its
            `gain` in the sum of balanced costs; None where nothing is feasible.
    """

    requirement: Requirement
    ranges: dict[str, Range]
    objectives: tuple[str, ...]
    pairs: tuple[BuildablePair, ...]
    left_out: dict[str, int]
    columns: dict[str, NDArray]
    margins: Floats
    front: NDArray[np.int64]
    refined: dict[str, Any] | None

    @property
    def feasible(self) -> NDArray[np.int64]:
        """Indices of the feasible candidates."""
        return np.flatnonzero((self.margins >= 0).all(axis=-1))

    @property
    def nearest(self) -> NDArray[np.int64]:
        """Index of the candidate with the smallest worst shortfall, (1,) or (0,)."""
        missed = np.fmin(np.fmax(-self.margins, 0.0), 1.0)
        missed = np.where(np.isnan(self.margins), 1.0, missed)
        worst, together = (np.round(one, 6) for one in (missed.max(axis=-1), missed.sum(axis=-1)))
        return np.lexsort((together, worst))[:1]  # rounding decides no tie


def search(
    catalogue: Catalogue,
    requirement: Requirement,
    *,
    rest_length: Range,
    pressure: Range | None = None,
    about: int = 20_000,
    objectives: Sequence[str] = DEFAULT_OBJECTIVES,
    coefficients: Sequence[float] = LATEX,
    end_fittings: bool = True,
) -> Search:
    """The Pareto front of every pair of a catalogue at every rest length and pressure.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI; its pressure is the greatest that may be given to the muscle.
        rest_length: least and greatest active length L0 [m]; two equal ones keep it fixed.
        pressure: least and greatest gauge pressure P [Pa]; a quarter of the requirement's pressure
            to all of it if omitted.
        about: number of candidates; the grid has at most so many, but one for each pair.
        objectives: of `OBJECTIVES`; the fewer, the shorter the front.
        coefficients: E_n [Pa] of the bladders whose rubber the catalogue does not know; (0.0,) neglects
            them.
        end_fittings: True if a swage tube of the catalogue must fit; of those that do, the one
            with the thickest wall is taken.

    Returns:
        What was found; `front` is empty where no candidate keeps to everything.

    Raises:
        InputError: an unknown objective, a pressure range beyond the requirement's pressure, a number
            out of its range, a catalogue without swage tubes.

    >>> from famjax.design import Requirement, load_catalogue
    >>> found = search(
    ...     load_catalogue(), Requirement(690e3, force=2000.0, contraction=0.2, stroke=0.05),
    ...     rest_length=(0.1, 0.6), about=2000,
    ... )
    >>> found.pairs[found.columns["pair"][found.front[0]]].bladder.name
    'bladder 0.875 in x 0.0625 in'
    """
    wanted = tuple(objectives)
    if not wanted or len({*wanted} & {*OBJECTIVES}) < len(wanted):
        raise InputError(
            f"objectives must be one or more of {', '.join(OBJECTIVES)}, each once; got "
            f"{', '.join(map(repr, wanted)) or 'none'}"
        )
    if about < 1:
        raise InputError(f"about must be >= 1, got {about}")
    greatest = requirement.pressure
    ranges = {"rest_length": rest_length, "pressure": pressure or (greatest / 4, greatest)}
    for name, (low, high) in ranges.items():
        if not 0 < low <= high < math.inf:
            raise InputError(
                f"the range of the {name} must be two numbers, 0 < least <= greatest, got "
                f"{low:.6g} to {high:.6g} {'m' if name == 'rest_length' else 'Pa'}"
            )
    if ranges["pressure"][1] > greatest * (1 + 1e-9):  # the same pressure in two units
        raise InputError(
            f"the pressure range ends at {ranges['pressure'][1]:.6g} Pa, above the pressure of the "
            f"requirement, {greatest:.6g} Pa, which is the greatest that there is"
        )
    pairs, left_out = buildable_pairs(catalogue, requirement, end_fittings=end_fittings)
    share = about // max(1, len(pairs))
    free = [high > low for low, high in ranges.values()]
    each = max(1, math.isqrt(share) if all(free) else share)
    sizes = max(1, share // each) if all(free) else each, each
    lengths, pressures = (
        np.linspace(*ends, size if varied else 1)
        for ends, size, varied in zip(ranges.values(), sizes, free, strict=True)
    )
    asked = {name: jnp.asarray(value) for name, value in vars(requirement).items()}
    known, table = {}, np.zeros((0, len(COLUMNS) + len(CONSTRAINTS)))
    if pairs:
        known = _known(pairs, coefficients)
        table = np.asarray(_grid(known, jnp.asarray(lengths), jnp.asarray(pressures), asked))
    columns: dict[str, NDArray] = dict(zip(COLUMNS, table.T, strict=False))
    columns["pair"] = np.repeat(np.arange(len(pairs)), lengths.size * pressures.size)
    found = Search(
        requirement, ranges, wanted, tuple(pairs), left_out, columns,
        table[:, len(COLUMNS) :], np.zeros(0, dtype=np.int64), None,
    )  # fmt: skip
    if not len(feasible := found.feasible):
        return found
    costs = costs_of({name: columns[name][feasible] for name in wanted}, wanted)
    at = front_members(costs, FRONT_STEP)
    at = at[np.argsort(costs[at] @ balance(costs[at]), kind="stable")]
    front = feasible[at]
    refined = _refined(found, costs[at], int(front[0]), known, asked)
    return dataclasses.replace(found, front=front, refined=refined)


def buildable_pairs(
    catalogue: Catalogue,
    requirement: Requirement,
    *,
    end_fittings: bool,
) -> tuple[list[BuildablePair], dict[str, int]]:
    """The pairs that can be built, and how many others are excluded for which reason.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI.
        end_fittings: True if a swage tube must fit.

    Returns:
        (pairs in the order of the catalogue, number of pairs left out by reason: "braid" does not
        fit the bladder, "end_fitting" no tube fits, "untested" a thread_factor is asked for and the
        braid's threads are not known).

    Raises:
        InputError: an end-fitting is asked for, and the catalogue has no tubes.
    """
    if end_fittings and not catalogue.tubes:
        raise InputError(
            "the catalogue has no swage tubes: add [[tube]] rows, or search without end-fittings"
        )
    pairs, left_out = [], {"braid": 0, "end_fitting": 0, "untested": 0}
    for braid in catalogue.braids:
        for bladder in catalogue.bladders:
            fit = feasibility(bladder.diameter, braid)
            fitting = [
                one.tube
                for one in size_end_fittings(catalogue, braid, bladder.diameter)
                if end_fittings and one.feasible and one.bladder == bladder
            ]
            tube = max(fitting, key=lambda one: one.thickness, default=None)
            if fit is Feasibility.INFEASIBLE:
                left_out["braid"] += 1
            elif end_fittings and tube is None:
                left_out["end_fitting"] += 1
            elif requirement.thread_factor > 0 and braid.breaking_load is None:
                left_out["untested"] += 1
            else:
                pairs.append(BuildablePair(bladder, braid, fit, tube and tube.name))
    return pairs, left_out


def _known(pairs: Sequence[BuildablePair], coefficients: Sequence[float]) -> dict[str, Any]:
    """What the formulas need of each pair, stacked, in SI; nan where not known."""
    rubber = [list(p.bladder.coefficients or coefficients) for p in pairs]
    order = max(map(len, rubber))
    numbers = [(p.braid.n_threads, p.braid.breaking_load) for p in pairs]
    combinations = [Combination.of(p.bladder, p.braid) for p in pairs]
    return {
        "combination": jax.tree.map(lambda *leaves: jnp.stack(leaves), *combinations),
        "coefficients": jnp.asarray([one + [0.0] * (order - len(one)) for one in rubber]),
        "threads": jnp.asarray(np.array(numbers, dtype=np.float64)),
    }


def _performance(
    known: Mapping[str, Any],
    usable: RealArray,
    rest_length: RealArray,
    pressure: RealArray,
    asked: Mapping[str, Any],
) -> Float[Array, " numbers"]:
    """The numbers of `COLUMNS`, then the margins of `CONSTRAINTS`, of one pair at L0 [m] and P [Pa].

    Outer diameter and air are those at the contraction that is asked for, or at the usable one if that
    is less. The air fills the muscle from rest without pressure to there under pressure, as free air:
    ((P + P_a) V - P_a V0) / P_a, isothermal.
    """
    muscle = eqx.tree_at(lambda c: c.rest_length, known["combination"], rest_length)
    rubber = PolynomialMaterial(known["coefficients"])
    n_threads, breaking_load = known["threads"]
    at = jnp.minimum(jnp.maximum(asked["contraction"], asked["stroke"] / rest_length), usable)
    blocked = muscle.force(0.0, pressure, rubber)
    tension = thread_tension(
        blocked, pressure, muscle.bladder_diameter / 2, muscle.braid_angle, n_threads
    )
    empty = muscle.geometry.inner_volume(rest_length, jnp.zeros_like(pressure))
    full = muscle.geometry.inner_volume(rest_length * (1 - at), pressure)
    columns = {
        "rest_length": rest_length,
        "pressure": pressure,
        "braid_angle": muscle.braid_angle,
        "blocked_force": blocked,
        "force": muscle.force(asked["force_contraction"], pressure, rubber),
        "contraction": usable,
        "stroke": usable * rest_length,
        "outer_diameter": muscle.outer_diameter(at),
        "air": full * (1 + pressure / ATMOSPHERE) - empty,
        "thread_factor": breaking_load / tension,
    }
    margins = [
        _margin(columns[column], asked[name], upper=side == "most", always=name in _ALWAYS)
        for name, (column, side) in CONSTRAINTS.items()
    ]
    return jnp.stack([*(columns[name] for name in COLUMNS), *margins])


def _margin(found: RealArray, limit: RealArray, *, upper: bool, always: bool) -> RealArray:
    # Of a difference, so that what is at its limit keeps to it whatever the rounding of the share.
    if upper:
        return jnp.where(jnp.isfinite(limit), (limit - found) / limit, 1.0)
    wanted = limit > 0
    share = (found - limit) / jnp.where(wanted, limit, 1.0)
    # Without a limit the sign is what counts; what is not asked for is kept with room to spare.
    return jnp.where(wanted, share, jnp.sign(found) if always else 1.0)


@quick_jit
def _grid(
    known: Mapping[str, Any], lengths: RealArray, pressures: RealArray, asked: Mapping[str, Any]
) -> Float[Array, "candidates numbers"]:
    def of_state(state: tuple[Mapping[str, Any], RealArray]) -> RealArray:
        pair, pressure = state
        rubber = PolynomialMaterial(pair["coefficients"])
        usable = pair["combination"].usable_contraction(pressure, rubber)
        return jax.vmap(lambda length: _performance(pair, usable, length, pressure, asked))(lengths)

    n_pairs = len(known["coefficients"])
    repeated = jax.tree.map(lambda one: jnp.repeat(one, len(pressures), axis=0), known)
    states = repeated, jnp.tile(pressures, n_pairs)
    table = jax.lax.map(of_state, states)  # one at a time: memory does not grow with their number
    return table.reshape(-1, table.shape[-1])


def costs_of(columns: Mapping[str, NDArray], objectives: Sequence[str]) -> Floats:
    """Costs to minimise: signed logarithms of the objectives, (n, objectives).

    That of zero is taken as -1000, beyond every number's.
    """
    signs = [1.0 if OBJECTIVES[name] == "least" else -1.0 for name in objectives]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = [np.log(np.asarray(columns[name], dtype=np.float64)) for name in objectives]
    return np.clip(np.stack(logs, axis=-1) * signs, -1000.0, 1000.0)


def front_members(costs: Floats, step: float = 0.0) -> NDArray[np.int64]:
    """Candidates on the front: a part of the Pareto front, at least a step apart.

    The costs are cut into boxes of log(1 + step). Of the boxes that no other is better than, each
    gives the candidate of the least sum of costs. None of them is dominated by any candidate, and for
    every candidate there is one of them that is in no objective worse by more than the share `step`.
    Without a step it is the whole front, of equal ones the first.

    Args:
        costs: from `costs_of`, (n, objectives).
        step: share [-], >= 0.

    Returns:
        Positions in `costs`, rising.

    References:
        Laumanns, Thiele, Deb & Zitzler 2002, Evolutionary Computation 10(3): epsilon-dominance.
    """
    boxes = np.floor(costs / np.log1p(step)) if step > 0 else costs
    order = np.lexsort((costs.sum(-1), *boxes.T))
    at = order[np.unique(boxes[order], axis=0, return_index=True)[1]]
    # Ranks add up to more where a box is dominated, so that the first of what is left never is.
    ranks = np.stack([np.unique(one, return_inverse=True)[1] for one in boxes[at].T], axis=-1)
    at, ranks = at[by_sum := np.argsort(ranks.sum(-1), kind="stable")], ranks[by_sum]
    found = []
    while len(at):
        found.append(at[0])
        better = np.any(ranks < ranks[0], axis=-1)
        at, ranks = at[better], ranks[better]
    return np.sort(np.array(found, dtype=np.int64))


def balance(costs: Floats) -> Floats:
    """Cost weights, shape (objectives,); the balanced design minimises the weighted sum.

    Each cost counts by how far it is on the way from the front's least to its greatest.
    """
    span = np.ptp(costs, axis=0)
    return 1 / np.where(span > 0, span, 1.0)


def _refined(
    found: Search, costs: Floats, first: int, known: Mapping[str, Any], asked: Mapping[str, Any]
) -> dict[str, Any]:
    """The design of least weighed costs about the first of the front, of the same pair.

    A grid about the best so far, a quarter as wide each time. It has the best so far in its
    middle, so that no step is for the worse.
    """
    n, pair = len(COLUMNS), int(found.columns["pair"][first])
    own = jax.tree.map(lambda values: values[pair : pair + 1], known)
    names = list(found.ranges)
    at = np.array([found.columns[name][first] for name in names], dtype=np.float64)
    low, high = np.array(list(found.ranges.values()), dtype=np.float64).T
    spacing = [np.diff(np.unique(found.columns[name])) for name in names]
    reach = np.array([2 * steps.max(initial=0.0) for steps in spacing])
    weights = balance(costs)

    def score(values: NDArray) -> Floats:
        columns = dict(zip(COLUMNS, values.T, strict=False))
        total = costs_of(columns, found.objectives) @ weights
        return np.where((values[:, n:] >= 0).all(axis=-1), total, np.inf)

    before = float(costs[0] @ weights)
    best = None
    for _ in range(_ZOOMS):
        ends = np.clip(at + reach * np.linspace(-1, 1, _STEPS)[:, None], low, high)
        values = np.asarray(_grid(own, *(jnp.asarray(one) for one in ends.T), asked))
        found_here = score(values)
        k = int(np.argmin(found_here))
        if best is None or found_here[k] < best[0]:
            best = found_here[k], values[k]
        at, reach = best[1][: len(names)], reach / 4
    assert best is not None
    columns = dict(zip(COLUMNS, best[1].tolist(), strict=False))
    return {"pair": pair, "gain": before - best[0], **columns}

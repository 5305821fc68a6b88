"""Search a catalogue: every pair of bladder and braid, on a grid of rest lengths and pressures.

One mapped program evaluates the grid and compares it with a `Requirement`. The feasible candidates
are reduced to a Pareto front. The most balanced design on the front is then refined between the grid
points.

The braid angle on a bladder follows from cos(theta) / D = cos(45 deg) / D_nominal. As in table 2.3 of
the reference work, D is the outer diameter of the bladder. The thickness of the braid is neglected in
the force, and is included only in the diameter outside the braid.
"""

import collections
import dataclasses
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
from ..braids import Braid, braid_angle_from_diameter, thread_tension
from ..compile_options import quick_jit
from ..geometries import Bladder, EstimatedGeometry
from ..materials import PolynomialMaterial
from ..muscle import Muscle, bisected
from ..parameters import Parametrised, number
from .catalogue import (
    NOMINAL_ANGLE,
    Catalogue,
    CatalogueBladder,
    CatalogueBraid,
    EndFitting,
    size_end_fittings,
)

Floats = NDArray[np.floating]
Range = tuple[float, float]

ATMOSPHERE = 101325.0
"""Standard atmosphere [Pa], the reference pressure of free air."""

LATEX = (257.8 * units.PSI, -57.9 * units.PSI, 32.7 * units.PSI)
"""Default E_n [Pa]: latex from the reference work (Chambers 2021, chapter 6)."""

COLUMNS = {
    "rest_length": "length", "pressure": "pressure", "braid_angle": "angle", "blocked_force": "force",
    "force": "force", "contraction": "number", "stroke": "length", "outer_diameter": "length",
    "air": "volume", "thread_factor": "number",
}  # fmt: skip
"""Columns for a candidate, each with its kind of quantity, which determines the unit; see `Search`."""

OBJECTIVES: dict[str, Literal["least", "most"]] = {
    **dict.fromkeys(("outer_diameter", "rest_length", "pressure", "air"), "least"),
    **dict.fromkeys(("force", "blocked_force", "contraction", "stroke"), "most"),
}
"""Available objectives, and whether the lowest ("least") or highest ("most") value is best."""

DEFAULT_OBJECTIVES = ("outer_diameter", "rest_length", "air")
"""Default objectives: the size of the muscle and the air used per stroke."""

CONSTRAINTS: dict[str, tuple[str, Literal["least", "most"]]] = {
    "force": ("force", "least"),
    "contraction": ("contraction", "least"),
    "stroke": ("stroke", "least"),
    "largest_diameter": ("outer_diameter", "most"),
    "longest_length": ("rest_length", "most"),
    "thread_factor": ("thread_factor", "least"),
}
"""Column compared with each requirement; "least" is a lower limit and "most" an upper limit."""

FRONT_STEP = 0.01
"""Minimum relative difference between two designs on the front."""

_ZOOMS, _STEPS = 20, 41  # nested grids of the refinement, and points along each axis
_ALWAYS = ("force", "contraction")  # every muscle must pull and contract


# --- a bladder under a braid


def fam_angle(diameter: Real, nominal_diameter: Real) -> RealArray:
    """Return the braid angle theta [rad] on a bladder, from cos(theta) / D = cos(45 deg) / D_nominal.

    Jamming is neglected; see `CatalogueBraid.fits`.

    Args:
        diameter: D [m], outer diameter of the bladder.
        nominal_diameter: D_nominal [m] of the braid at 45 deg.

    Returns:
        theta [rad], measured from the circumference, with the broadcast shape; nan where
        D > sqrt(2) D_nominal.

    References:
        Chambers 2021, section 2.2 and table 2.3.

    >>> import math
    >>> print(f"{math.degrees(fam_angle(0.875, 2.0)):.1f}")  # inches: the 7/8 in muscle
    72.0
    """
    return braid_angle_from_diameter(diameter, nominal_diameter, NOMINAL_ANGLE)


class Combination(Parametrised):
    """A bladder inside a braid; instances can be stacked leaf by leaf for `jax.vmap`.

    Attributes:
        bladder_diameter: outer diameter D0 [m], on which the threads lie.
        bladder_thickness: wall thickness t0 [m].
        nominal_diameter: braid diameter [m] at 45 deg.
        braid_thickness: thickness [m] of the braid, which is neglected in the force.
        largest_diameter: diameter [m] at which the shortened braid jams.
        material: stress law of the bladder.
        n_threads: number of threads [-]; nan if unknown.
        breaking_load: breaking load [N] of one thread; nan if unknown.
        rest_length: active length L0 [m] at rest; force against contraction does not depend on it.
    """

    bladder_diameter: Float[Given, "..."] = number("m")
    bladder_thickness: Float[Given, "..."] = number("m")
    nominal_diameter: Float[Given, "..."] = number("m")
    braid_thickness: Float[Given, "..."] = number("m")
    largest_diameter: Float[Given, "..."] = number("m")
    material: PolynomialMaterial
    n_threads: Float[Given, "..."] = number(default=math.nan)
    breaking_load: Float[Given, "..."] = number("N", default=math.nan)
    rest_length: Float[Given, "..."] = number("m", default=1.0)

    @classmethod
    def of(
        cls, bladder: CatalogueBladder, braid: CatalogueBraid, coefficients: Sequence[float]
    ) -> "Combination":
        """Combine a bladder and a braid from a catalogue with the bladder's E_n [Pa], for a 1 m length."""
        return cls(
            bladder.diameter, bladder.thickness, braid.nominal_diameter, braid.thickness,
            braid.diameter_range[1], PolynomialMaterial(coefficients),
            braid.n_threads or math.nan, braid.breaking_load or math.nan,
        )  # fmt: skip

    @property
    def braid_angle(self) -> RealArray:
        """Initial braid angle theta0 [rad], measured from the circumference; see `fam_angle`."""
        return fam_angle(self.bladder_diameter, self.nominal_diameter)

    @property
    def muscle(self) -> Muscle:
        """The muscle as a cylinder, in which the thickness of the braid is neglected."""
        braid = Braid.from_rest(
            diameter=self.bladder_diameter, braid_angle=self.braid_angle, length=self.rest_length
        )
        bladder = Bladder(self.rest_length, self.bladder_diameter, self.bladder_thickness)
        return Muscle(EstimatedGeometry(braid, bladder), self.material)

    @property
    def jam_contraction(self) -> RealArray:
        """Contraction [-] at which the braid jams, 1 - sin(theta) / sin(theta0); at least 0."""
        jammed = fam_angle(self.largest_diameter, self.nominal_diameter)
        return jnp.maximum(1 - jnp.sin(jammed) / jnp.sin(self.braid_angle), 0.0)

    def outer_diameter(self, contraction: Real) -> RealArray:
        """Return the diameter [m] outside the braid at a contraction [-]; nan if the braid has jammed."""
        length, free = self._length(contraction)
        geometry: Any = self.muscle.geometry
        return jnp.where(free, geometry.braid.diameter(length) + 2 * self.braid_thickness, jnp.nan)

    def force(self, contraction: Real, pressure: Real) -> RealArray:
        """Return the force F [N] at a contraction [-] and gauge pressure P [Pa].

        The force is nan where the braid has jammed. It is not clipped, so it is negative beyond the free
        contraction.
        """
        length, free = self._length(contraction)
        return jnp.where(free, self.muscle.force(length, pressure), jnp.nan)

    def usable_contraction(self, pressure: Real) -> RealArray:
        """Return the contraction [-] at which the force falls to zero or the braid jams, for one pressure.

        The smaller of the two contractions is found by bisection, with derivatives from the implicit
        function theorem. It is nan if the pressure is too low to move the bladder.
        """
        greatest = self.jam_contraction
        scale = jax.lax.stop_gradient(self.force(0.0, pressure))

        def missing(share: RealArray) -> RealArray:
            return -self.force(share * greatest, pressure) / jnp.where(scale > 0, scale, 1.0)

        share = bisected(missing, jnp.zeros_like(greatest), jnp.ones_like(greatest))
        found = jnp.where(self.force(greatest, pressure) > 0, 1.0, share) * greatest
        return jnp.where(scale > 0, found, jnp.nan)

    def _length(self, contraction: Real) -> tuple[RealArray, Array]:
        """Return the length [m] and a mask of unjammed states. Where the braid has jammed, L is L0."""
        at = as_real(contraction)
        free = at <= self.jam_contraction + 8 * jnp.finfo(self.rest_length.dtype).eps
        return self.rest_length * (1 - jnp.where(free, at, 0.0)), free


# --- the search


@dataclasses.dataclass(frozen=True)
class Requirement:
    """Requirements for a muscle; a value of zero or infinity means that there is no requirement.

    Attributes:
        pressure: supply gauge pressure P [Pa], > 0.
        force: minimum force [N], >= 0, at `force_contraction` and at `force_stroke`.
        contraction: minimum contraction [-], a fraction in [0, 1).
        largest_diameter: maximum diameter [m] outside the braid at the required contraction and
            stroke.
        force_contraction: contraction [-] at which `force` is required; 0 for blocked force.
        force_stroke: travel [m] from the rest length at which `force` is required, >= 0.
        stroke: minimum travel [m], >= 0.
        longest_length: maximum rest length [m] between the end-fittings.
        thread_factor: minimum ratio [-] of the breaking load of a thread to its tension at zero
            contraction.
    """

    pressure: float
    force: float = 0.0
    contraction: float = 0.0
    largest_diameter: float = math.inf
    force_contraction: float = 0.0
    force_stroke: float = 0.0
    stroke: float = 0.0
    longest_length: float = math.inf
    thread_factor: float = 0.0

    def __post_init__(self) -> None:
        if not 0 < self.pressure < math.inf:
            raise InputError(f"the pressure must be > 0 and finite, got {self.pressure} Pa")
        for name in ("contraction", "force_contraction"):
            if not 0 <= (value := getattr(self, name)) < 1:
                raise InputError(f"{name} must be a fraction in [0, 1), got {value}; 0.35 is 35 %")
        if not 0 <= self.force_stroke < math.inf:
            raise InputError(f"force_stroke must be >= 0 and finite, got {self.force_stroke} m")
        for name, (_, side) in CONSTRAINTS.items():
            value = getattr(self, name)
            if side == "most" and not value > 0:
                raise InputError(f"{name} must be > 0, got {value} m")
            if side == "least" and not 0 <= value < math.inf:
                raise InputError(f"{name} must be >= 0 and finite, got {value}")


@dataclasses.dataclass(frozen=True)
class BuildablePair:
    """A bladder inside a braid, with its end-fitting.

    Attributes:
        bladder: bladder from the catalogue.
        braid: braid from the catalogue.
        fitting: end-fitting in the tube with the thickest wall that fits, or None if none is required.
    """

    bladder: CatalogueBladder
    braid: CatalogueBraid
    fitting: EndFitting | None


@dataclasses.dataclass(frozen=True)
class Search:
    """Result of a search: candidates ordered by pair, pressure and rest length.

    Columns have the shape (candidates,) and SI units: `pair`, an index into `pairs`; `rest_length`
    L0 [m]; `pressure` P [Pa]; `braid_angle` theta0 [rad] from the circumference; `blocked_force` [N];
    `force` [N] at the contraction where it is required; usable `contraction` [-], up to zero force or
    jamming; `stroke` [m]; `outer_diameter` [m] and `air` [m3] at the required contraction;
    `thread_factor` [-], nan if unknown.

    Attributes:
        requirement: requirement that was passed to `search`.
        ranges: ranges of rest length [m] and pressure [Pa].
        objectives: objectives that were passed to `search`.
        pairs: pairs that can be built.
        left_out: number of excluded pairs for each reason.
        columns: columns for all candidates.
        margins: relative margin for each of `CONSTRAINTS`, shape (candidates, constraints). It is negative
            if the constraint is violated, and nan if the braid jams first or the value is unknown.
        front: indices of the candidates on the Pareto front, starting with the most balanced design.
        refined: columns for the most balanced design after refinement between the grid points, and its
            `gain`, the reduction in the weighted sum of costs; None if no candidate is feasible.
        muscle: muscle of the refined design, or None.
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
    muscle: Muscle | None = None

    @property
    def feasible(self) -> NDArray[np.int64]:
        """Indices of the feasible candidates."""
        return np.flatnonzero((self.margins >= 0).all(axis=-1))

    @property
    def nearest(self) -> NDArray[np.int64]:
        """Index of the candidate with the smallest worst-case shortfall, shape (1,) or (0,)."""
        missed = np.clip(np.nan_to_num(-self.margins, nan=1.0), 0.0, 1.0)
        worst, together = (np.round(one, 6) for one in (missed.max(axis=-1), missed.sum(axis=-1)))
        return np.lexsort((together, worst))[:1]


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
    """Find the Pareto front over all pairs in a catalogue, rest lengths and pressures.

    Args:
        catalogue: catalogue from `load_catalogue`.
        requirement: requirement in SI units; its pressure is the highest that is available.
        rest_length: lowest and highest rest length L0 [m]; two equal values fix it.
        pressure: lowest and highest gauge pressure P [Pa]. If omitted, the range is from a quarter of the
            pressure in the requirement to the full value.
        about: maximum number of candidates; there is always at least one for each pair.
        objectives: names from `OBJECTIVES`; with fewer objectives, the front is shorter.
        coefficients: E_n [Pa] for bladders whose rubber is not in the catalogue; (0.0,) neglects the
            stress in the rubber.
        end_fittings: True if a swage tube must fit. Of the tubes that fit, the one with the thickest
            wall is used.

    Returns:
        The candidates and the front, which is empty if no candidate is feasible.

    Raises:
        InputError: an objective is unknown, a pressure exceeds that in the requirement, a number is out
            of range, or the catalogue has no swage tubes.

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
            f"objectives must be one or more of {', '.join(OBJECTIVES)}, each at most once; got "
            f"{', '.join(map(repr, wanted)) or 'none'}"
        )
    if about < 1:
        raise InputError(f"about must be >= 1, got {about}")
    greatest = requirement.pressure
    ranges = {"rest_length": rest_length, "pressure": pressure or (greatest / 4, greatest)}
    for (name, (low, high)), unit in zip(ranges.items(), ("m", "Pa"), strict=True):
        if not 0 < low <= high < math.inf:
            raise InputError(
                f"the {name} range must satisfy 0 < lowest <= highest, got {low:.6g} to {high:.6g} {unit}"
            )
    if ranges["pressure"][1] > greatest * (1 + 1e-9):  # the same pressure in two units
        raise InputError(
            f"the pressure range ends at {ranges['pressure'][1]:.6g} Pa, above the required supply "
            f"pressure of {greatest:.6g} Pa: lower the range, or raise the required supply pressure"
        )
    pairs, left_out = _buildable_pairs(catalogue, requirement, end_fittings=end_fittings)
    share = about // max(1, len(pairs))
    free = [high > low for low, high in ranges.values()]
    each = max(1, math.isqrt(share) if all(free) else share)
    sizes = max(1, share // each) if all(free) else each, each
    axes = [
        np.linspace(*ends, size if varied else 1)
        for ends, size, varied in zip(ranges.values(), sizes, free, strict=True)
    ]
    asked = {name: jnp.asarray(value) for name, value in vars(requirement).items()}
    stacked, table = None, np.zeros((0, len(COLUMNS) + len(CONSTRAINTS)))
    if pairs:
        stacked = _stacked(pairs, coefficients)
        lengths, pressures = map(jnp.asarray, axes)
        table = np.asarray(_grid(stacked, lengths, pressures, asked))
    columns: dict[str, NDArray] = dict(zip(COLUMNS, table.T, strict=False))
    columns["pair"] = np.repeat(np.arange(len(pairs)), axes[0].size * axes[1].size)
    found = Search(
        requirement, ranges, wanted, tuple(pairs), left_out, columns,
        table[:, len(COLUMNS) :], np.zeros(0, dtype=np.int64), None,
    )  # fmt: skip
    if not len(feasible := found.feasible):
        return found
    costs = costs_of({name: columns[name][feasible] for name in wanted}, wanted)
    at = front_members(costs, FRONT_STEP)
    at = at[np.argsort(costs[at] @ balance(costs[at]), kind="stable")]
    refined = _refined(found, costs[at], int(feasible[at[0]]), stacked, asked)
    own: Combination = jax.tree.map(lambda values: values[refined["pair"]], stacked)
    muscle = dataclasses.replace(own, rest_length=jnp.asarray(refined["rest_length"])).muscle
    return dataclasses.replace(found, front=feasible[at], refined=refined, muscle=muscle)


def _buildable_pairs(
    catalogue: Catalogue, requirement: Requirement, *, end_fittings: bool
) -> tuple[list[BuildablePair], dict[str, int]]:
    """Return the pairs that can be built, and the number of excluded pairs for each reason.

    Raises:
        InputError: end-fittings are required, but the catalogue has no tubes.
    """
    if end_fittings and not catalogue.tubes:
        raise InputError(
            "the catalogue contains no swage tubes: add [[tube]] rows, or search without end-fittings"
        )
    pairs, left_out = [], collections.Counter()
    for braid in catalogue.braids:
        for bladder in catalogue.bladders:
            sized = size_end_fittings(catalogue, braid, bladder) if end_fittings else []
            fitting = [one for one in sized if one.feasible]
            thickest = max(fitting, key=lambda one: one.tube.thickness, default=None)
            if not braid.fits(bladder.diameter):
                left_out["the braid does not fit the bladder"] += 1
            elif end_fittings and thickest is None:
                left_out["no swage tube in the catalogue fits"] += 1
            elif requirement.thread_factor > 0 and braid.breaking_load is None:
                left_out["the strength of the threads is unknown"] += 1
            else:
                pairs.append(BuildablePair(bladder, braid, thickest))
    return pairs, dict(left_out)


def _stacked(pairs: Sequence[BuildablePair], coefficients: Sequence[float]) -> Combination:
    """Stack the pairs, and extend all bladder laws to the same order."""
    rubber = [list(p.bladder.coefficients or coefficients) for p in pairs]
    order = max(map(len, rubber))
    each = [
        Combination.of(p.bladder, p.braid, one + [0.0] * (order - len(one)))
        for p, one in zip(pairs, rubber, strict=True)
    ]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *each)


def _performance(
    pair: Combination, usable: RealArray, pressure: RealArray, asked: Mapping[str, Any]
) -> Float[Array, " numbers"]:
    """Return the values for `COLUMNS`, then the margins for `CONSTRAINTS`, for one pair at P [Pa].

    The outer diameter and the air are evaluated at the required contraction, or at the usable contraction
    if that is smaller. The free air for an isothermal stroke is ((P + P_a) V - P_a V0) / P_a.
    """
    muscle, rest = pair.muscle, pair.rest_length
    loaded = jnp.maximum(asked["force_contraction"], asked["force_stroke"] / rest)
    at = jnp.maximum(jnp.maximum(asked["contraction"], asked["stroke"] / rest), loaded)
    at = jnp.minimum(at, usable)
    blocked = pair.force(0.0, pressure)
    tension = thread_tension(
        blocked, pressure, pair.bladder_diameter / 2, pair.braid_angle, pair.n_threads
    )
    full = muscle.volume(rest * (1 - at), pressure)
    columns = {
        "rest_length": rest,
        "pressure": pressure,
        "braid_angle": pair.braid_angle,
        "blocked_force": blocked,
        "force": pair.force(loaded, pressure),
        "contraction": usable,
        "stroke": usable * rest,
        "outer_diameter": pair.outer_diameter(at),
        "air": full * (1 + pressure / ATMOSPHERE) - muscle.volume(rest, jnp.zeros_like(pressure)),
        "thread_factor": pair.breaking_load / tension,
    }
    margins = [
        _margin(columns[column], asked[name], upper=side == "most", always=name in _ALWAYS)
        for name, (column, side) in CONSTRAINTS.items()
    ]
    return jnp.stack([*(columns[name] for name in COLUMNS), *margins])


def _margin(found: RealArray, limit: RealArray, *, upper: bool, always: bool) -> RealArray:
    # The difference is exactly zero at the limit, which a quotient minus one is not.
    if upper:
        return jnp.where(jnp.isfinite(limit), (limit - found) / limit, 1.0)
    wanted = limit > 0
    share = (found - limit) / jnp.where(wanted, limit, 1.0)
    # Without a limit only the sign of force and contraction counts.
    return jnp.where(wanted, share, jnp.sign(found) if always else 1.0)


@quick_jit
def _grid(
    pairs: Combination, lengths: RealArray, pressures: RealArray, asked: Mapping[str, Any]
) -> Float[Array, "candidates numbers"]:
    def of_state(state: tuple[Combination, RealArray]) -> RealArray:
        pair, pressure = state
        usable = pair.usable_contraction(pressure)

        def one(length: RealArray) -> RealArray:
            long = eqx.tree_at(lambda c: c.rest_length, pair, length)
            return _performance(long, usable, pressure, asked)

        return jax.vmap(one)(lengths)

    repeated = jax.tree.map(lambda one: jnp.repeat(one, len(pressures), axis=0), pairs)
    states = repeated, jnp.tile(pressures, len(pairs.rest_length))
    table = jax.lax.map(of_state, states)  # one at a time to limit memory
    return table.reshape(-1, table.shape[-1])


def costs_of(columns: Mapping[str, NDArray], objectives: Sequence[str]) -> Floats:
    """Return the costs to minimise, signed logs of the objectives clipped to +-1000, (n, objectives)."""
    signs = [1.0 if OBJECTIVES[name] == "least" else -1.0 for name in objectives]
    with np.errstate(divide="ignore", invalid="ignore"):
        logs = [np.log(np.asarray(columns[name], dtype=np.float64)) for name in objectives]
    return np.clip(np.stack(logs, axis=-1) * signs, -1000.0, 1000.0)


def front_members(costs: Floats, step: float = 0.0) -> NDArray[np.int64]:
    """Select candidates on the Pareto front that are at least a relative step apart.

    The cost space is divided into boxes of width log(1 + step). In each non-dominated box, the candidate
    with the lowest sum of costs is selected. No candidate dominates a selected one. For every candidate,
    there is a selected one that is worse by at most `step` in each objective. If `step` is 0, the whole
    front is returned, including only the first of any equal candidates.

    Args:
        costs: costs from `costs_of`, shape (n, objectives).
        step: relative step [-], >= 0.

    Returns:
        Indices into `costs`, in increasing order.

    References:
        Laumanns, Thiele, Deb & Zitzler 2002, Evolutionary Computation 10(3): epsilon-dominance.
    """
    boxes = np.floor(costs / np.log1p(step)) if step > 0 else costs
    order = np.lexsort((costs.sum(-1), *boxes.T))
    at = order[np.unique(boxes[order], axis=0, return_index=True)[1]]
    # A dominated box has a larger sum of ranks, so the first remaining box is never dominated.
    ranks = np.stack([np.unique(one, return_inverse=True)[1] for one in boxes[at].T], axis=-1)
    at, ranks = at[by_sum := np.argsort(ranks.sum(-1), kind="stable")], ranks[by_sum]
    found = []
    while len(at):
        found.append(at[0])
        better = np.any(ranks < ranks[0], axis=-1)
        at, ranks = at[better], ranks[better]
    return np.sort(np.array(found, dtype=np.int64))


def balance(costs: Floats) -> Floats:
    """Return the weights of the costs, 1 / (range on the front), shape (objectives,).

    The most balanced design is the one with the lowest weighted sum.
    """
    span = np.ptp(costs, axis=0)
    return 1 / np.where(span > 0, span, 1.0)


def _refined(
    found: Search, costs: Floats, first: int, pairs: Combination | None, asked: Mapping[str, Any]
) -> dict[str, Any]:
    """Minimise the weighted sum of costs near the first design on the front, for the same pair.

    Each grid is centred on the best design found so far, and is a quarter as wide as the previous grid.
    """
    pair = int(found.columns["pair"][first])
    own = jax.tree.map(lambda values: values[pair : pair + 1], pairs)
    at = np.array([found.columns[name][first] for name in found.ranges], dtype=np.float64)
    low, high = np.array(list(found.ranges.values()), dtype=np.float64).T
    spacing = [np.diff(np.unique(found.columns[name])) for name in found.ranges]
    reach = np.array([2 * steps.max(initial=0.0) for steps in spacing])
    weights = balance(costs)
    best, numbers = math.inf, np.zeros(0)
    for _ in range(_ZOOMS):
        ends = np.clip(at + reach * np.linspace(-1, 1, _STEPS)[:, None], low, high)
        lengths, pressures = map(jnp.asarray, ends.T)
        values = np.asarray(_grid(own, lengths, pressures, asked))
        columns = dict(zip(COLUMNS, values.T, strict=False))
        total = costs_of(columns, found.objectives) @ weights
        total = np.where((values[:, len(COLUMNS) :] >= 0).all(axis=-1), total, np.inf)
        k = int(np.argmin(total))
        if total[k] < best or not numbers.size:
            best, numbers = total[k], values[k]
        at, reach = numbers[: at.size], reach / 4
    columns = dict(zip(COLUMNS, numbers.tolist(), strict=False))
    return {"pair": pair, "gain": float(costs[0] @ weights) - best, **columns}

"""Fits of peers by the engine of every fit: many starts, and refits to parts of a map."""

import dataclasses
import itertools
import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.boundary.errors import InputError

from ..arguments import check_whole
from ..checks import check_affine
from ..data import ForceData
from ..descent import End, descend_many
from ..engine import Point, predict
from ..problem import Part, Problem
from ..response import MapInputs
from ..search import latin_hypercube
from .cross_validation import CrossValidation, check_groups, held_out_errors
from .peer_family import FamilyOfPeer, Model, PeerFamily
from .published import peer_families

_MAX_STEPS = 150
_RIDGE = 1e-9  # of columns of unit length: far below any reading's weight
_DEPENDENT = 1e-7  # part of a column of unit length that the others do not explain
_FOLD_STARTS = 8  # of the refits; the first is the fit to the whole map
_AS_GOOD = 1e-3  # parts of the cost by which two refits may differ and be called equally good
_DISAGREE = 0.01  # parts of the largest force by which they then may predict different forces
_AT_BOUND = 1e-9  # parts of the interval, or of the largest value, within which a bound is reached


@dataclasses.dataclass(frozen=True)
class PeerFit:
    """A peer fitted to a force map.

    Attributes:
        name: in the registry.
        family: parameters with units and bounds.
        values: parameters [SI] by name.
        at_bound: names of the parameters that ended on a bound.
        predicted: force [N] at the loaded readings, shape (points,).
        converged: whether the best descent ended at a stationary point.
        determined: whether the readings determine all linear parameters; if not, the values are
            the smallest that fit.
        problem: as it was posed.
    """

    name: str
    family: PeerFamily
    values: dict[str, float]
    at_bound: tuple[str, ...]
    predicted: Float[np.ndarray, " points"]
    converged: bool
    determined: bool
    problem: Problem = dataclasses.field(repr=False)

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.family.build({name: jnp.asarray(v) for name, v in self.values.items()})

    def force(self, length: famjax.Real, pressure: famjax.Real) -> Float[Array, "..."]:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        return self.model.force(length, pressure)


class _Fit(NamedTuple):
    """Where one descent ended, and whether the readings determine all linear parameters there."""

    end: End
    determined: bool

    @property
    def predicted(self) -> Float[np.ndarray, " points"]:
        """Force [N] at the loaded readings, whatever their weights."""
        return self.end.point.force


def fit_peer(
    name: str | PeerFamily, data: ForceData, *, starts: int = 32, seed: int = 0
) -> PeerFit:
    """The peer of that name that fits the loaded readings of a map best, by least squares.

    Parameters in which the force is linear are solved for, by orthogonal factorisation or, where
    they are bounded, by the convex core; of those that the readings leave open, the smallest are
    taken. The others are sought in their box from many starts.

    Args:
        name: one of `peer_families(data)`, or a family of your own.
        data: the force map; slack readings are censored. Readings count with 1/std, if given.
        starts: number of starts.
        seed: of the starts.

    Returns:
        The fit.

    Raises:
        InputError: an unknown name, no starts, too few readings, or a model that has no force at
            a reading.
        RuntimeError: float64 is off.
    """
    family, problem = _checked(name, data, starts)
    points = _starts(family, starts, seed)
    return _best(name, family, problem, _fitted([problem] * len(points), points))


def _checked(name: str | PeerFamily, data: ForceData, starts: int) -> tuple[PeerFamily, Problem]:
    """The family of that name, and the problem of fitting it; what cannot be fitted is refused."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "fits need float64, and JAX computes in float32 by default. Put this line before any "
            'other use of JAX: jax.config.update("jax_enable_x64", True)'
        )
    check_whole("starts", starts, 1)
    known = {} if isinstance(name, PeerFamily) else peer_families(data)
    if isinstance(name, str) and name not in known:
        raise InputError(f"unknown peer {name!r}; known for this map: {', '.join(known)}")
    family = known[name] if isinstance(name, str) else name
    points = int(data.loaded.sum())
    if points < len(family.parameters):
        raise InputError(
            f"{family.label} has {len(family.parameters)} parameters and the map {points} loaded "
            "readings: give more readings or choose a peer with fewer parameters"
        )
    return family, posed_peer(family, data)


def _best(
    name: str | PeerFamily, family: PeerFamily, problem: Problem, fits: Sequence[_Fit]
) -> PeerFit:
    """The fit of the lowest cost."""
    costs = np.array([one.end.cost for one in fits])
    if not np.isfinite(costs).any():
        raise InputError(
            f"{family.label} has no finite force at some reading, wherever it was started: its "
            "form may not hold for a muscle longer than at rest; check lengths and rest length"
        )
    best = fits[int(np.nanargmin(costs))]
    point = best.end.point
    numbers = (*point.parameters.tolist(), *point.x.tolist())
    values = dict(zip(problem.names + problem.linear, numbers, strict=True))
    return PeerFit(
        name=family.label if isinstance(name, PeerFamily) else name,
        family=family,
        values=values,
        at_bound=_bounds_reached(family, values),
        predicted=best.predicted,
        converged=best.end.converged,
        determined=best.determined,
        problem=problem,
    )


def cross_validate_peer(
    fit: PeerFit, data: ForceData, groups: str = "pressure", *, seed: int = 0
) -> CrossValidation:
    """The errors of a peer at each pressure or length when refitted to the others.

    What `cross_validate` does, with all refits in step. The readings left
    out have no weight. One start is the fit to the whole map; as that has seen them, refits from
    the other starts come first wherever they are as good.

    Args:
        fit: of the whole map.
        data: the same map.
        groups: "pressure" or "length".
        seed: of the starts.

    Returns:
        The errors; nan where no refit had a finite force.

    Raises:
        InputError: other groups, or fewer than two of them.
    """
    held_out = _HeldOut.of(fit.problem, data, (groups,))
    starts = np.vstack([_place(fit), _other_starts(fit.family, seed)])
    return held_out.errors(_fitted(*held_out.fits(starts)))[0]


def fit_and_cross_validate_peer(
    name: str | PeerFamily,
    data: ForceData,
    kinds: Sequence[str],
    *,
    starts: int = 32,
    seed: int = 0,
) -> tuple[PeerFit, list[CrossValidation]]:
    """`fit_peer` and `cross_validate_peer` of it, with all but the refits that start there in step.

    Returns:
        The fit, and the errors of each kind.

    Raises:
        InputError: as from these two.
        RuntimeError: float64 is off.
    """
    family, problem = _checked(name, data, starts)
    held_out = _HeldOut.of(problem, data, kinds)
    points = _starts(family, starts, seed)
    problems, others = held_out.fits(_other_starts(family, seed))
    ends = _fitted([problem] * len(points) + problems, np.vstack([points, others]))
    fit = _best(name, family, problem, ends[: len(points)])
    near, away = _fitted(*held_out.fits(_place(fit)[None])), iter(ends[len(points) :])
    each = len(others) // len(near)
    refits = [end for one in near for end in (one, *itertools.islice(away, each))]
    return fit, held_out.errors(refits)


@dataclasses.dataclass(frozen=True)
class _HeldOut:
    """What is left out in turn.

    Attributes:
        data: the map.
        kinds: of groups.
        labels: of the loaded readings, one array for each kind.
        problems: without each group of the first kind, of the second and so on.
    """

    data: ForceData
    kinds: Sequence[str]
    labels: list[Float[np.ndarray, " points"]]
    problems: list[Problem]

    @classmethod
    def of(cls, problem: Problem, data: ForceData, kinds: Sequence[str]) -> "_HeldOut":
        for groups in kinds:
            if groups not in {"pressure", "length"}:
                raise InputError(f"a peer is cross-validated by pressure or length, got {groups!r}")
            check_groups(data, groups)
        labels = [data.left_out_as(groups)[data.loaded] for groups in kinds]
        held = [label == level for label in labels for level in np.unique(label)]
        problems = [problem.with_readings(factor=1.0 * ~out) for out in held]
        return cls(data, kinds, labels, problems)

    def fits(self, starts: np.ndarray) -> tuple[list[Problem], np.ndarray]:
        """Every problem from every start."""
        problems = [problem for problem in self.problems for _ in starts]
        return problems, np.tile(starts, (len(self.problems), 1))

    def errors(self, refits: Sequence[_Fit]) -> list[CrossValidation]:
        """The errors of each kind, from the same number of refits to each problem."""
        each = len(refits) // len(self.problems)
        folds = (list(refits[k : k + each]) for k in range(0, len(refits), each))
        return [
            _held_out(self.data, groups, label, folds)
            for groups, label in zip(self.kinds, self.labels, strict=True)
        ]


def _held_out(
    data: ForceData, groups: str, labels: Float[np.ndarray, " points"], folds: Iterator[list[_Fit]]
) -> CrossValidation:
    """The errors at the groups, each with the refits of its fold."""
    predicted, ambiguous = np.full(labels.size, math.nan), []
    for level in np.unique(labels):
        held, fits = labels == level, next(folds)
        cost = np.array([one.end.cost for one in fits])
        good = np.flatnonzero(cost <= (1 + _AS_GOOD) * np.nanmin(cost, initial=math.inf))
        if good.size:
            force = np.stack([fits[k].predicted[held] for k in good])
            predicted[held] = force[-1]
            apart = np.ptp(force, axis=0).max() > _DISAGREE * data.max_force
            if apart or not all(fits[k].determined for k in good):
                ambiguous.append(float(level))
    errors = held_out_errors(data, "length" if groups == "length" else "pressure", predicted)
    return dataclasses.replace(errors, ambiguous=tuple(ambiguous))


def _place(fit: PeerFit) -> Float[np.ndarray, " p"]:
    """The fit's point of the unit box."""
    place = [(fit.values[p.name] - p.low) / (p.high - p.low) for p in fit.family.nonlinear]
    return np.clip(place, 0, 1)  # rounding only can have left the box


def _other_starts(family: PeerFamily, seed: int) -> Float[np.ndarray, "starts p"]:
    """Starts of the refits besides the fit to the whole map; none where nothing is searched."""
    searched = len(family.nonlinear)
    return latin_hypercube(searched, _FOLD_STARTS - 1, seed) if searched else np.zeros((0, 0))


def _starts(family: PeerFamily, count: int, seed: int) -> Float[np.ndarray, "starts p"]:
    """Starts in the unit box; a single one where nothing is searched."""
    searched = len(family.nonlinear)
    return latin_hypercube(searched, count if searched else 1, seed)


def posed_peer(family: PeerFamily, data: ForceData) -> Problem:
    """The problem of fitting a peer to the loaded readings of a map.

    Raises:
        InputError: the force is not affine in what is said to be linear.
    """
    at = data.loaded
    nothing = np.zeros(1)
    inputs = MapInputs(
        data.length[at], data.pressure[at], data.force[at], nothing, nothing, np.zeros((1, 0)),
    )  # fmt: skip
    weight = 1 / data.force_std[at] if data.force_std is not None else np.ones(at.sum())
    names, linear = (tuple(p.name for p in of) for of in (family.nonlinear, family.linear))
    low, high = (np.array([getattr(p, end) for p in family.nonlinear]) for end in ("low", "high"))
    levels = {kind: data.levels(kind)[at] for kind in ("pressure", "length")}
    part = Part(
        data.specimen.name, FamilyOfPeer(names, linear, family.build, family.origin), inputs,
        data.force[at], weight, np.arange(len(names)), np.arange(len(linear)), levels,
        np.zeros(at.sum(), int),
    )  # fmt: skip
    problem = Problem(
        parts=(part,),
        names=names,
        low=low,
        high=high,
        linear=linear,
        coefficient_min=np.array([p.low for p in family.linear]),
        coefficient_max=np.array([p.high for p in family.linear]),
        ridge=_RIDGE if names else 0.0,
    )
    if linear:
        check_affine(problem)
    return problem


def forces_of(family: PeerFamily, data: ForceData) -> Float[np.ndarray, " points"]:
    """Force [N] at the loaded readings of a map, of a model in which nothing is free."""
    problem = posed_peer(family, data)
    inputs = problem.parts[0].inputs
    return predict(problem, 0, np.zeros(0), np.zeros(0), inputs.length, inputs.pressure)


def _fitted(problems: Sequence[Problem], starts: Float[np.ndarray, "fits p"]) -> list[_Fit]:
    """The fits, one from each start."""
    ends = descend_many(problems, list(starts), max_steps=_MAX_STEPS)
    if not problems[0].names:
        return [_linear_fit(end) for end in ends]
    return list(map(_Fit, ends, _determined(problems[0], [end.point for end in ends])))


def _linear_fit(end: End) -> _Fit:
    """The least-squares solution where nothing is searched; the smallest where there are many."""
    A, b, _, _ = end.point.programme
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    found, _, rank, _ = np.linalg.lstsq(A / size, b)
    x = found / size
    point = dataclasses.replace(end.point, x=x, residual=A @ x - b)
    return _Fit(dataclasses.replace(end, point=point, converged=True), bool(rank == A.shape[1]))


def _determined(problem: Problem, points: Sequence[Point]) -> list[bool]:
    """Whether the readings tell the linear parameters apart; bounded ones count as determined."""
    limits = np.concatenate([problem.coefficient_min, problem.coefficient_max])
    if not problem.linear or np.isfinite(limits).any():
        return [True] * len(points)
    A = np.stack([point.programme[0] for point in points])
    size = np.linalg.norm(A, axis=1, keepdims=True)
    triangles = np.linalg.qr(A / np.where(size > 0, size, 1.0), mode="r")
    least = np.abs(np.diagonal(triangles, axis1=1, axis2=2)).min(axis=1)
    return (least > _DEPENDENT).tolist()


def _bounds_reached(family: PeerFamily, values: dict[str, float]) -> tuple[str, ...]:
    largest = max((abs(values[p.name]) for p in family.linear), default=0.0)
    reached = []
    for p in family.parameters:
        margin = _AT_BOUND * (largest if p.linear else p.high - p.low)
        distances = (abs(values[p.name] - end) for end in (p.low, p.high) if math.isfinite(end))
        if min(distances, default=math.inf) <= margin:
            reached.append(p.name)
    return tuple(reached)

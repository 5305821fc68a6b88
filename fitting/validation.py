"""Repeated fits: cross-validation, profile likelihood, bootstrap.

Levels of pressure or length, or specimens, are left out one after another; a parameter is held beside
its optimum; readings are drawn anew. All refits of a question run at once.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError, check_seed

from .arguments import check_names, check_whole
from .data import groups_of_levels
from .problem import Problem
from .result import Estimate, Identification, check_identified
from .search import End, descend_many, latin_hypercube

GROUPS = ("pressure", "length", "specimen")
"""What can be left out together."""

NEIGHBOURS = 8
"""Groups of neighbouring levels that say much the same of one another: pressures, and many lengths."""
_SINGLE = 10  # lengths at most are left out one by one
_FEWEST = 3  # levels: without one of two, the other tells nothing of it
_QUICK: dict[str, Any] = {"max_steps": 30, "tolerance": 1e-5, "promise": 1e-6}
"""A prediction need not wait for the last digit of the fit that it is made by."""


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Prediction errors on held-out readings.

    Attributes:
        groups: what was left out together, readings of one "pressure", "length" or "specimen".
        level: of each reading [Pa or m], or the number of its specimen, shape (points,).
        group: number of each reading's group, shape (points,).
        error: prediction less reading [N] while its group was left out, shape (points,).
    """

    groups: str
    level: Float[np.ndarray, " points"]
    group: Int[np.ndarray, " points"]
    error: Float[np.ndarray, " points"]

    @staticmethod
    def of_mean(several: Sequence["LeftOut"], weights: Sequence[float]) -> "LeftOut":
        """Errors of the weighted mean of several predictions of the same."""
        error = np.average([one.error for one in several], axis=0, weights=weights)
        return dataclasses.replace(several[0], error=error)

    @property
    def values(self) -> Float[np.ndarray, " groups"]:
        """The level of each group that was left out; the mean if a group has several levels."""
        return levels_of_groups(self.level, self.group)

    @property
    def group_rmse(self) -> Float[np.ndarray, " groups"]:
        """Root mean square error [N] of each group while it was left out."""
        return np.sqrt(np.bincount(self.group, self.error**2) / np.bincount(self.group))

    @property
    def rmse(self) -> float:
        """RMSE over all readings [N]."""
        return _root_mean_square(self.error)

    @property
    def interior_rmse(self) -> float:
        """RMSE [N] without the lowest and the highest group (extrapolations); nan if none remain."""
        return _root_mean_square(self.error[(self.group > 0) & (self.group < self.group.max())])


def columns_of(left_out: Mapping[str, LeftOut]) -> dict[str, float]:
    """RMSE [N] on pressures, interior lengths, end lengths or specimens left out; groups weigh alike.

    The shortest and the longest length, left out, are extrapolated to.
    """
    found = {}
    for kind, one in left_out.items():
        groups = one.group_rmse
        if kind == "length":
            found["interior length"] = _root_mean_square(groups[1:-1])
            found["end length"] = _root_mean_square(groups[[0, -1]])
        else:
            found[kind] = _root_mean_square(groups)
    return {name: error for name, error in found.items() if np.isfinite(error)}


def _root_mean_square(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def levels_of_groups(
    level: Float[np.ndarray, " points"], group: Int[np.ndarray, " points"]
) -> Float[np.ndarray, " groups"]:
    """The level of each group; the mean over its readings where it has several."""
    first = level[np.unique(group, return_index=True)[1]]
    return first + np.bincount(group, level - first[group]) / np.bincount(group)


def validate(
    result: Identification,
    groups: str = "pressure",
    *,
    starts: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> LeftOut:
    """Cross-validate an identification by pressures, lengths or specimens.

    Everything that was identified is identified again without the group, from the optimum and
    from other starts, and predicts it. All refits run at once.

    Args:
        result: from `identify`, or one of `identify_together` for all of these.
        groups: what is left out together.
        starts: descents for each group, one of them from the optimum of all readings.
        progress: called with (descents done, descents).

    Raises:
        InputError: fewer than two groups, or an unknown kind of group.
    """
    check_identified(result)
    check_whole("starts", starts, 1)
    check_groups(result, groups)
    fits, kinds = [(result.problem, result.end.u)], {groups: (None, starts)}
    (found,) = leave_out_each(
        fits, kinds, seed=result.seed + 1, settled=True, least=2, progress=progress
    )
    return found[groups]


def check_groups(result: Identification, groups: str) -> None:
    """Refuse groups that cannot be left out and predicted from the others.

    Raises:
        InputError: as from `validate`.
    """
    problem = result.problem
    own = [problem.names[k] for k in problem.free if "[" in problem.names[k]]
    if groups not in GROUPS:
        raise InputError(f"groups are one of {', '.join(GROUPS)}, got {groups!r}")
    if groups == "specimen" and (own or len(problem.linear) > result.order):
        raise InputError(
            f"{own[0] if own else 'the law'} belongs to one specimen, so nothing is known about it without "
            "its readings: identify the specimens with own=() and own_law=False"
        )
    if _group_of_each(problem, groups, None, 2) is None:
        raise InputError(f"leaving one {groups} out needs two or more; there is 1")


def leave_out_each(
    fits: Sequence[tuple[Problem, Float[np.ndarray, " _"]]],
    kinds: Mapping[str, tuple[int | None, int]],
    *,
    seed: int = 0,
    settled: bool = False,
    least: int = _FEWEST,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, LeftOut]]:
    """The errors of several fits on each level of some kinds while it was left out, all refits in step.

    Args:
        fits: what was fitted, and its optimum in the unit box, from which every refit starts.
        kinds: "pressure", "length" or "specimen"; in how many groups neighbouring levels are left out
            together, each alone with None (as far as `MOST_APART`), and the descents of each refit, the
            one from the optimum among them.
        seed: of the other starts.
        settled: whether each refit goes on to its last digit, as where families are all but alike.
        least: levels of a kind that say something of one another.
        progress: called with (descents done, descents).

    Returns:
        The errors of each fit by kind, without those of which there are too few levels, or one specimen.
    """
    problems, starts = [], []
    places: list[tuple[int, str, np.ndarray, int]] = []
    for number, (problem, u) in enumerate(fits):
        for kind, (groups, count) in kinds.items():
            group = _group_of_each(problem, kind, groups, least)
            if group is None:
                continue
            places.append((number, kind, group, len(problems)))
            cube = latin_hypercube(len(problem.free), count, seed)
            cube[0] = u
            for k in range(int(group.max()) + 1):
                problems.append(problem.with_readings(factor=1.0 * (group != k)))
                starts.append(cube)
    found: list[dict[str, LeftOut]] = [{} for _ in fits]
    ends = best_ends(problems, starts, progress=progress, **({} if settled else _QUICK))
    for number, kind, group, first in places:
        problem, groups = fits[number][0], int(group.max()) + 1
        error = np.stack([force_error(problem, end) for end in ends[first : first + groups]])
        at = np.flatnonzero(problem.side == 0)
        found[number][kind] = LeftOut(
            kind, problem.levels(kind)[at], group[at], error[group[at], at]
        )
    return found


def groups_of(problem: Problem, kind: str) -> int | None:
    """In how many groups a model's error is sought; None for each level by itself."""
    if kind == "length" and np.unique(problem.levels("length")).size <= _SINGLE:
        return None
    return NEIGHBOURS


def _group_of_each(
    problem: Problem, kind: str, groups: int | None, least: int
) -> Int[np.ndarray, " points"] | None:
    """The group of every reading; -1 of a censored one at a level where none is anything else.

    With fewer levels than the least, or with one specimen, there are no groups.
    """
    level = problem.levels(kind)
    values = np.unique(level[problem.side == 0])
    if values.size < (2 if kind == "specimen" else least):
        return None
    return groups_of_levels(level, values, groups)


def best_ends(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    *,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> list[End]:
    """Best end point of the descents of each problem.

    Args:
        problems: with other readings, weights or bounds.
        starts: of each, points of the unit box of its own free parameters.
        progress: called with (descents done, descents).
        **settings: of each descent, see `descend_many`; what is only compared need not be an optimum
            to the last digit.
    """
    which = np.repeat(np.arange(len(problems)), [len(points) for points in starts])
    tried = descend_many(
        [problems[k] for k in which.tolist()], [start for points in starts for start in points],
        progress=progress, **settings,
    )  # fmt: skip
    costs = np.array([end.cost if np.isfinite(end.cost) else np.inf for end in tried])
    return [
        tried[int(of_one[np.argmin(costs[of_one])])]
        for of_one in (np.flatnonzero(which == k) for k in range(len(problems)))
    ]


def force_error(problem: Problem, end: End) -> Float[np.ndarray, " points"]:
    """Model minus reading [N] at every reading, whatever its weight."""
    return end.point.force - problem.force


Class = Literal["identified", "one-sided", "flat", "stopped by a bound", "stopped by a constraint"]

LEVELS = {0.68: 0.9889, 0.95: 3.8415}
"""Confidence levels and their quantiles of chi-squared with one degree of freedom."""

_REACH = 3.0  # standard errors to either side
_FALLBACK = 0.1  # of the box, or of the largest coefficient, where there is no standard error
_EXTENSIONS = 4  # times that a side is doubled before it counts as open
_CHUNK = 250  # replicates that are fitted in step


@dataclasses.dataclass(frozen=True)
class Profile:
    """The profile of one parameter: how much worse the best fit becomes when it is held elsewhere.

    Attributes:
        name: of the parameter.
        values: at which it was held [SI], ascending, the optimum among them.
        excess: growth of the sum of squares over that at the optimum, in units of the noise
            variance: chi-squared with one degree of freedom where the model is right; nan where no
            fit was found, as beyond a constraint.
        intervals: by confidence level, (low, high) [SI]; infinite on a side where the excess never
            reaches the level within the values.
        verdict: "identified" (closed at 95 %), "one-sided", "flat" (open on both sides), "stopped
            by a bound": the optimum is on one, and the data alone would go further, or "stopped by
            a constraint": a side ends where no fit satisfies it before the data object.
        kind: kind of unit.
    """

    name: str
    values: Float[np.ndarray, " values"]
    excess: Float[np.ndarray, " values"]
    intervals: dict[float, tuple[float, float]]
    verdict: Class
    kind: str


def profile(
    result: Identification,
    names: str | Sequence[str] | None = None,
    *,
    points: int = 9,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Profile, ...]:
    """The profile likelihood of parameters, all refits of one parameter at once.

    Args:
        result: from `identify`.
        names: a parameter, or several; all that were identified unless given.
        points: values to either side of the optimum, to three standard errors or to a bound.
        progress: called with (parameters done, parameters).

    Returns:
        One profile for each name.

    Raises:
        InputError: an unknown or held parameter, or coefficients that depend on pressure.
    """
    check_identified(result)
    check_whole("points", points, 1)
    problem = result.problem
    several = len(problem.linear) > result.order  # one law of several cannot be held by itself
    free = {
        one.name: one
        for one in result.estimates
        if not one.fixed and not (several and one.name not in problem.names)
    }
    names = (names,) if isinstance(names, str) else names
    chosen = list(free) if names is None else check_names("names", names)
    for name in chosen:
        if name not in free:
            raise InputError(f"no identified parameter {name!r}; available: {', '.join(free)}")
    profiles = []
    for done, name in enumerate(chosen, 1):
        profiles.append(_profile(result, free[name], points))
        if progress is not None:
            progress(done, len(chosen))
    return tuple(profiles)


def _profile(result: Identification, estimate: Estimate, points: int) -> Profile:
    (optimum,) = _costs(result, estimate.name, np.array([estimate.value]))
    variance = 2 * optimum / max(result.degrees_of_freedom, 1)
    if not variance > 0:
        raise InputError("a fit without any error has no likelihood to profile")

    def excess_at(values: np.ndarray) -> Float[np.ndarray, " values"]:
        return 2 * (_costs(result, estimate.name, values) - optimum) / variance

    down, fall = _side(estimate, result, -1, points, excess_at)
    up, rise = _side(estimate, result, 1, points, excess_at)
    intervals = {
        level: (_crossing(down, fall, quantile, -1), _crossing(up, rise, quantile, 1))
        for level, quantile in LEVELS.items()
    }
    excess, closed = np.concatenate([fall[:0:-1], rise]), int(np.isfinite(intervals[0.95]).sum())
    verdict: Class = ("flat", "one-sided", "identified")[closed]
    if estimate.at_bound:
        verdict = "stopped by a bound"
    elif closed < 2 and np.isnan(excess).any():
        verdict = "stopped by a constraint"
    values = np.concatenate([down[:0:-1], up])
    return Profile(estimate.name, values, excess, intervals, verdict, estimate.kind)


def _side(
    estimate: Estimate,
    result: Identification,
    sign: int,
    points: int,
    excess_at: Callable[[np.ndarray], np.ndarray],
) -> tuple[np.ndarray, np.ndarray]:
    """Values from the optimum outwards and their excess, as far as the data object or a bound."""
    reach = _REACH * estimate.stderr
    if not np.isfinite(reach):
        span = estimate.max - estimate.min
        reach = _FALLBACK * (span if np.isfinite(span) else np.abs(result.coefficients).max())
    values, excess = np.array([estimate.value]), np.zeros(1)
    for times in 2.0 ** np.arange(_EXTENSIONS):
        end = np.clip(estimate.value + sign * times * reach, estimate.min, estimate.max)
        if np.isclose(end, values[-1], rtol=1e-12, atol=0) or not excess[-1] <= max(
            LEVELS.values()
        ):
            break
        more = np.linspace(values[-1], end, points + 1)[1:]
        values, excess = np.append(values, more), np.append(excess, excess_at(more))
    return values, excess


def _costs(result: Identification, name: str, values: np.ndarray) -> Float[np.ndarray, " values"]:
    """Best cost with the parameter held at each value, from the optimum of all."""
    problem, u = result.problem, result.end.u
    if name in problem.names:
        place = problem.names.index(name)
        u, ends = u[problem.free != place], ("low", "high")
    else:
        place, ends = problem.linear.index(name), ("coefficient_min", "coefficient_max")
    held = []
    for value in values:
        changed = {end: getattr(problem, end).copy() for end in ends}
        for limits in changed.values():
            limits[place] = value
        held.append(dataclasses.replace(problem, **changed))
    found = best_ends(held, [u[None]] * len(values))
    return np.array([end.cost if end.converged else np.nan for end in found])


def _crossing(values: np.ndarray, excess: np.ndarray, level: float, sign: int) -> float:
    """Where the excess first rises through a level, by linear interpolation of its root.

    Infinite, with the sign of the side, where it does not before the values or the fits end.
    """
    # Evidence ends with the first fit that was not found.
    known = np.cumsum(np.isnan(excess)) == 0
    above = np.flatnonzero(known & (excess > level))
    if not above.size:
        return sign * math.inf
    k = above[0]
    left, right = np.sqrt(np.maximum(excess[k - 1 : k + 1], 0))
    share = (np.sqrt(level) - left) / (right - left)
    return float(values[k - 1] + share * (values[k] - values[k - 1]))


@dataclasses.dataclass(frozen=True, repr=False)
class Bootstrap:
    """Replicates of an identification.

    Attributes:
        names: of the identified nonlinear parameters, then of the coefficients.
        samples: their values in every replicate [SI], shape (replicates, parameters).
        failed: replicates that did not converge; they are left out of `samples`.
        forces: of the model at every reading [N], shape (replicates, points).
    """

    names: tuple[str, ...]
    samples: Float[np.ndarray, "replicates parameters"]
    failed: int
    forces: Float[np.ndarray, "replicates points"]

    def __repr__(self) -> str:
        failed = f", {self.failed} failed" if self.failed else ""
        return f"Bootstrap({len(self.samples)} replicates{failed} of {', '.join(self.names)})"

    @property
    def stderr(self) -> dict[str, float]:
        """Standard deviation of each parameter over the replicates [SI]; nan if it never moved."""
        spread = self.samples.std(axis=0, ddof=1)
        moved = np.ptp(self.samples, axis=0) > 0
        return dict(zip(self.names, np.where(moved, spread, np.nan).tolist(), strict=True))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Percentile interval [SI] of a parameter."""
        ends = ((1 - level) / 2, (1 + level) / 2)
        low, high = np.quantile(self.samples[:, self.names.index(name)], ends)
        return float(low), float(high)

    def band(self, level: float = 0.95) -> Float[np.ndarray, "2 points"]:
        """Lower and upper end [N] of the model's force at every reading, shape (2, points)."""
        return np.quantile(self.forces, ((1 - level) / 2, (1 + level) / 2), axis=0)


def bootstrap(
    result: Identification,
    replicates: int = 200,
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Bootstrap:
    """Replicates of an identification, each a descent from the optimum, 250 at once.

    Residuals, scaled for the parameters spent, are drawn anew and added to the model; priors are kept as
    they are, so that a parameter known from its prior alone hardly moves. A replicate of a map of a hundred
    readings takes about a millisecond. Memory holds 8 bytes for each reading of each replicate.

    Args:
        result: from `identify`.
        replicates: number of them.
        seed: of the draws; the same seed gives the same numbers.
        progress: called with (replicates done, replicates).

    Raises:
        InputError: fewer than two replicates, or fewer that converge.
    """
    check_identified(result)
    check_whole("replicates", replicates, 2)
    problem, samples, forces, good = result.problem, [], [], []
    residual, scale, read = force_error(problem, result.end), 1 / problem.weight, problem.side == 0
    standard = (residual / scale)[read]
    spent = np.sqrt(standard.size / max(result.degrees_of_freedom, 1))
    standard = (standard - standard.mean()) * spent
    for first in range(0, replicates, _CHUNK):
        count = min(_CHUNK, replicates - first)
        rng = np.random.default_rng((check_seed(seed), first))
        noise = rng.choice(standard, (count, problem.force.size)) * scale
        drawn = np.where(read, problem.force + residual + noise, problem.force)
        problems = [problem.with_readings(force=force) for force in drawn]
        for end in best_ends(problems, [result.end.u[None]] * count):
            point = end.point
            samples.append(np.concatenate([point.parameters[problem.free], point.x]))
            forces.append(point.force)
            good.append(end.converged and bool(np.isfinite(samples[-1]).all()))
        if progress is not None:
            progress(first + count, replicates)
    if sum(good) < 2:
        raise InputError(
            f"{sum(good)} of {replicates} replicates converged: the readings drawn do not determine "
            "the parameters; fix some"
        )
    return Bootstrap(
        names=tuple(problem.names[k] for k in problem.free) + result.coefficient_names,
        samples=np.array(samples)[good],
        failed=good.count(False),
        forces=np.array(forces)[good],
    )

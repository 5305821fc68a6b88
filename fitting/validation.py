"""Refit a model repeatedly: cross-validation, profile likelihood, bootstrap.

Cross-validation leaves out pressures, lengths or specimens in turn. A likelihood profile fixes a parameter
at values away from its optimum. The bootstrap resamples the residuals. All refits of one task run together.
"""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError, check_seed

from .arguments import check_names, check_whole
from .data import groups_of_levels
from .problem import Problem
from .result import Estimate, Identification, check_identified
from .search import NEAR, End, descend_from, latin_hypercube

_QUICK: dict[str, Any] = {"max_steps": 30, "tolerance": 1e-5, "promise": 1e-6}
"""Looser settings for descents, sufficient for predicting held-out readings."""
_NEARBY: dict[str, Any] = {"damping": 1e-6, "promise": NEAR}
"""Settings of a descent from a nearby optimum; a parameter is found to 1 % of its standard error."""


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Prediction errors at held-out readings.

    Attributes:
        groups: what a group consists of: one or more levels of "pressure" or "length", or a "specimen".
        level: level of each reading [Pa or m], or the number of its specimen, shape (points,).
        group: number of each reading's group, shape (points,).
        error: prediction minus reading [N], with the reading's group left out, shape (points,).
    """

    groups: str
    level: Float[np.ndarray, " points"]
    group: Int[np.ndarray, " points"]
    error: Float[np.ndarray, " points"]

    @property
    def values(self) -> Float[np.ndarray, " groups"]:
        """Level of each group; the mean level if the group has several."""
        return levels_of_groups(self.level, self.group)

    @property
    def group_rmse(self) -> Float[np.ndarray, " groups"]:
        """RMSE of each group [N]."""
        return np.sqrt(np.bincount(self.group, self.error**2) / np.bincount(self.group))

    @property
    def rmse(self) -> float:
        """RMSE over all readings [N]."""
        return _root_mean_square(self.error)

    @property
    def interior_rmse(self) -> float:
        """RMSE [N] without the lowest and highest groups (extrapolations); nan if none remain."""
        return _root_mean_square(self.error[(self.group > 0) & (self.group < self.group.max())])


def columns_of(left_out: Mapping[str, LeftOut]) -> dict[str, float]:
    """Return the held-out RMSE [N] by pressure, interior length, end length or specimen.

    All groups have equal weight. Predictions at the shortest and longest lengths are extrapolations.
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
    """Return the level of each group; the mean over its readings if it has several levels."""
    first = level[np.unique(group, return_index=True)[1]]
    return first + np.bincount(group, level - first[group]) / np.bincount(group)


def validate(
    result: Identification,
    groups: str = "pressure",
    *,
    starts: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> LeftOut:
    """Cross-validate an identification by leaving out pressures or lengths.

    Each group is left out in turn: all identified parameters are identified again from the other groups,
    starting from the optimum and from other points, and the group is predicted.

    Args:
        result: fit from `identify`, or any result of `identify_together`, which represents all of them.
        groups: what to leave out, "pressure" or "length".
        starts: number of descents for each group, including one from the optimum for all readings.
        progress: called with (descents done, total).

    Raises:
        InputError: there are fewer than two groups, or the kind is unknown.
    """
    check_identified(result)
    check_whole("starts", starts, 1)
    problem = result.problem
    if groups not in ("pressure", "length"):
        raise InputError(f"groups must be 'pressure' or 'length', got {groups!r}")
    if _group_of_each(problem, groups, None, 2) is None:
        raise InputError(
            f"leaving out one {groups} requires at least two {groups}s, but there is only one"
        )
    (found,) = leave_out_each(
        [(problem, result.end.u)], {groups: (None, starts)}, seed=result.seed + 1, settled=True,
        least=2, progress=progress,
    )  # fmt: skip
    return found[groups]


def leave_out_each(
    fits: Sequence[tuple[Problem, np.ndarray]],
    kinds: Mapping[str, tuple[int | None, int]],
    *,
    seed: int = 0,
    settled: bool = False,
    least: int = 3,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, LeftOut]]:
    """Leave out each group in turn in several fits, with all refits in one batch.

    A long map is represented by a sample of its readings.

    Args:
        fits: problems and their optima in the unit box, from which every refit starts.
        kinds: for "pressure", "length" or "specimen", the number of groups of neighbouring levels (None
            for one level each, up to `MOST_APART`), and the number of descents of each refit, including
            the one from the optimum.
        seed: random seed of the other starts.
        settled: True to let refits converge fully, as needed to compare nearly identical families.
        least: minimum number of levels; a single remaining level is not informative.
        progress: called with (descents done, total).

    Returns:
        Errors of each fit, keyed by kind, without kinds that have too few levels or only one specimen.
    """
    problems, starts = [], []
    places: list[tuple[int, str, np.ndarray, int]] = []
    fits = [(problem.thinned(), u) for problem, u in fits]
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
    """Return the number of groups for model errors: 8, or None (one per level) for up to ten lengths."""
    return None if kind == "length" and np.unique(problem.levels(kind)).size <= 10 else 8


def _group_of_each(
    problem: Problem, kind: str, groups: int | None, least: int
) -> Int[np.ndarray, " points"] | None:
    """Return the group of every reading; -1 for a reading at a level with only censored readings.

    The result is None if there are fewer than `least` levels, or only one specimen.
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
    """Return the best end point of each problem's descents.

    Args:
        problems: problems with changed readings, weights or bounds.
        starts: starting points for each problem, in the unit box of its free parameters.
        progress: called with (descents done, total).
        **settings: see `descend_many`.
    """
    return [
        min(ends, key=lambda end: np.nan_to_num(end.cost, nan=np.inf))
        for ends in descend_from(problems, starts, progress=progress, **settings)
    ]


def force_error(problem: Problem, end: End) -> Float[np.ndarray, " points"]:
    """Return model minus reading [N] at every reading, regardless of its weight."""
    return end.point.force - problem.force


QUANTILE_95 = 3.8415
"""95 % quantile of chi-squared with one degree of freedom."""


@dataclasses.dataclass(frozen=True)
class Profile:
    """Profile likelihood of one parameter.

    Attributes:
        name: name of the parameter.
        values: values at which the parameter was held [SI], ascending, including the optimum.
        excess: increase in the sum of squares above the optimum in units of the noise variance. It
            follows chi-squared with one degree of freedom if the model is right; nan if no fit was found,
            for example beyond a constraint.
        interval: (low, high) [SI] with a confidence of 95 %; infinite on a side where the excess stays
            below `QUANTILE_95`.
        verdict: "identified" (closed at 95 %), "one-sided", "flat" (open on both sides), "stopped by a
            bound" (the optimum is at a bound), or "stopped by a constraint" (no feasible fit exists beyond
            the values on an open side).
        kind: type of unit, such as "length" or "pressure".
    """

    name: str
    values: Float[np.ndarray, " values"]
    excess: Float[np.ndarray, " values"]
    interval: tuple[float, float]
    verdict: str
    kind: str


def profile(
    result: Identification,
    names: str | Sequence[str] | None = None,
    *,
    points: int = 9,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Profile, ...]:
    """Profile the likelihood of parameters, with all refits of one parameter in a batch.

    Args:
        result: fit from `identify`.
        names: one or several parameters; by default all identified ones.
        points: number of values on either side of the optimum, up to three standard errors or a bound.
        progress: called with (parameters done, total).

    Returns:
        One profile for each name.

    Raises:
        InputError: a parameter is unknown or fixed, or the coefficients depend on pressure.
    """
    check_identified(result)
    check_whole("points", points, 1)
    problem = result.problem
    several = len(problem.linear) > result.law.order  # one of several laws cannot be held alone
    free = {
        one.name: one
        for one in result.estimates
        if not one.fixed and (one.name in problem.names or not several)
    }
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
        raise InputError("all residuals of the fit are zero, so there is no likelihood to profile")

    reach = 3.0 * estimate.stderr
    if not np.isfinite(reach):
        span = estimate.max - estimate.min
        reach = 0.1 * (span if np.isfinite(span) else np.abs(result.coefficients).max())

    def side(sign: int) -> tuple[np.ndarray, np.ndarray]:
        """Return values outwards from the optimum, up to a significant excess or a bound, and excesses."""
        values, excess = np.array([estimate.value]), np.zeros(1)
        for times in 2.0 ** np.arange(4):
            end = np.clip(estimate.value + sign * times * reach, estimate.min, estimate.max)
            same = np.isclose(end, values[-1], rtol=1e-12, atol=0)
            if same or not excess[-1] <= QUANTILE_95:
                break
            more = np.linspace(values[-1], end, points + 1)[1:]
            costs = _costs(result, estimate.name, more)
            values = np.append(values, more)
            excess = np.append(excess, 2 * (costs - optimum) / variance)
        return values, excess

    (down, fall), (up, rise) = side(-1), side(1)
    interval = _crossing(down, fall, -1), _crossing(up, rise, 1)
    excess, closed = np.concatenate([fall[:0:-1], rise]), int(np.isfinite(interval).sum())
    verdict = ("flat", "one-sided", "identified")[closed]
    if estimate.at_bound:
        verdict = "stopped by a bound"
    elif closed < 2 and np.isnan(excess).any():
        verdict = "stopped by a constraint"
    values = np.concatenate([down[:0:-1], up])
    return Profile(estimate.name, values, excess, interval, verdict, estimate.kind)


def _costs(result: Identification, name: str, values: np.ndarray) -> Float[np.ndarray, " values"]:
    """Return the best cost with the parameter held at each value; nan if the fit does not converge."""
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


def _crossing(values: np.ndarray, excess: np.ndarray, sign: int) -> float:
    """Return the value at which the excess first exceeds `QUANTILE_95`, from its interpolated root.

    The root is interpolated linearly. The value is infinite, with the sign of the side, if the excess stays
    below `QUANTILE_95` until the values or the fits end.
    """
    # Values beyond the first failed fit are ignored.
    known = np.cumsum(np.isnan(excess)) == 0
    above = np.flatnonzero(known & (excess > QUANTILE_95))
    if not above.size:
        return sign * math.inf
    near = slice(above[0] - 1, above[0] + 1)
    root = np.sqrt(np.maximum(excess[near], 0))
    return float(np.interp(np.sqrt(QUANTILE_95), root, values[near]))


@dataclasses.dataclass(frozen=True, repr=False)
class Bootstrap:
    """Bootstrap replicates of an identification.

    Attributes:
        names: identified nonlinear parameters, then coefficients.
        samples: values in every replicate [SI], shape (replicates, parameters).
        failed: number of replicates that did not converge; excluded from `samples`.
    """

    names: tuple[str, ...]
    samples: Float[np.ndarray, "replicates parameters"]
    failed: int

    @property
    def stderr(self) -> dict[str, float]:
        """Standard deviation of each parameter over the replicates [SI]; nan if it does not vary."""
        spread = self.samples.std(axis=0, ddof=1)
        moved = np.ptp(self.samples, axis=0) > 0
        return dict(zip(self.names, np.where(moved, spread, np.nan).tolist(), strict=True))

    def interval(self, name: str, level: float = 0.95) -> tuple[float, float]:
        """Return the percentile interval [SI] of a parameter."""
        ends = ((1 - level) / 2, (1 + level) / 2)
        low, high = np.quantile(self.samples[:, self.names.index(name)], ends)
        return float(low), float(high)


def bootstrap(
    result: Identification,
    replicates: int = 200,
    *,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Bootstrap:
    """Bootstrap an identification by resampling residuals.

    Residuals are scaled for the degrees of freedom, resampled and added to the model. Priors stay fixed,
    so a parameter known only from its prior hardly varies. Replicates start from the optimum; each takes
    about a millisecond for 100 readings.

    Args:
        result: fit from `identify`.
        replicates: number of replicates.
        seed: random seed of the resampling.
        progress: called with (replicates done, total).

    Raises:
        InputError: fewer than two replicates are requested or converge.
    """
    check_identified(result)
    check_whole("replicates", replicates, 2)
    problem = result.problem
    residual, scale, read = force_error(problem, result.end), 1 / problem.weight, problem.side == 0
    standard = (residual / scale)[read]
    spent = np.sqrt(standard.size / max(result.degrees_of_freedom, 1))
    standard = (standard - standard.mean()) * spent
    rng = np.random.default_rng((check_seed(seed), 0))
    noise = rng.choice(standard, (replicates, problem.force.size)) * scale
    drawn = np.where(read, problem.force + residual + noise, problem.force)
    problems = [problem.with_readings(force=force) for force in drawn]
    ends = best_ends(problems, [result.end.u[None]] * replicates, progress=progress, **_NEARBY)
    samples = np.array(
        [np.concatenate([end.point.parameters[problem.free], end.point.x]) for end in ends]
    )
    good = np.array([end.converged for end in ends]) & np.isfinite(samples).all(axis=1)
    if good.sum() < 2:
        raise InputError(
            f"at least 2 of {replicates} replicates must converge, but only {good.sum()} did: fix a poorly "
            "determined parameter"
        )
    return Bootstrap(
        names=tuple(problem.names[k] for k in problem.free) + result.coefficient_names,
        samples=samples[good],
        failed=int((~good).sum()),
    )

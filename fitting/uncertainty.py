"""How well parameters are known: profile likelihood, and bootstrap."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError, check_seed

from .arguments import check_names, check_whole
from .problem import Problem
from .result import Estimate, Identification, check_identified
from .validation import best_ends, check_nothing_own, force_error

Class = Literal["identified", "one-sided", "flat", "stopped by a bound", "stopped by a constraint"]

LEVELS = {0.68: 0.9889, 0.95: 3.8415}
"""Confidence levels and their quantiles of chi-squared with one degree of freedom."""

RESAMPLES = ("residual", "length", "specimen")

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
            raise InputError(f"no identified parameter {name!r}; there are {', '.join(free)}")
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
    ended = bool(np.isnan([*fall, *rise]).any())
    return Profile(
        name=estimate.name,
        values=np.concatenate([down[:0:-1], up]),
        excess=np.concatenate([fall[:0:-1], rise]),
        intervals=intervals,
        verdict=_class(estimate, np.isfinite(intervals[0.95]), ended=ended),
        kind=estimate.kind,
    )


def _class(estimate: Estimate, closed: np.ndarray, *, ended: bool) -> Class:
    if estimate.at_bound:
        return "stopped by a bound"
    if closed.all():
        return "identified"
    if ended:
        return "stopped by a constraint"
    return "one-sided" if closed.any() else "flat"


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
    for _ in range(_EXTENSIONS):
        end = float(np.clip(estimate.value + sign * reach, estimate.min, estimate.max))
        more = np.linspace(values[-1], end, points + 1)[1:]
        if abs(end - values[-1]) <= 1e-12 * max(abs(end), abs(values[-1])):
            break
        values, excess = np.append(values, more), np.append(excess, excess_at(more))
        if not excess[-1] <= max(LEVELS.values()):
            break
        reach *= 2
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
    resample: str = "residual",
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Bootstrap:
    """Replicates of an identification, each a descent from the optimum, 250 at once.

    A replicate of a map of a hundred readings takes about a millisecond. Memory holds 8 bytes for each
    reading of each replicate.

    Args:
        result: from `identify`.
        replicates: number of them.
        resample: "residual": residuals, scaled for the parameters spent, drawn anew and added to
            the model, priors kept as they are (so that a parameter known from its prior alone
            hardly moves); "length": whole lengths of the map drawn with replacement; "specimen": whole
            specimens of `identify_together`. The last two need no belief in independent noise.
        seed: of the draws; the same seed gives the same numbers.
        progress: called with (replicates done, replicates).

    Raises:
        InputError: an unknown way to draw, too few groups to draw from, or fewer than two replicates.
    """
    if resample not in RESAMPLES:
        raise InputError(f"resample is one of {', '.join(RESAMPLES)}, got {resample!r}")
    check_identified(result)
    check_whole("replicates", replicates, 2)
    if resample == "specimen":
        check_nothing_own(result)
    drawn_from = _residuals(result) if resample == "residual" else _groups(result, resample)
    problem, samples, forces, good = result.problem, [], [], []
    for first in range(0, replicates, _CHUNK):
        count = min(_CHUNK, replicates - first)
        rng = np.random.default_rng((check_seed(seed), first))
        drawn = drawn_from(rng, count)
        for end in best_ends(drawn, [result.end.u[None]] * count):
            point = end.point
            samples.append(np.concatenate([point.parameters[problem.free], point.x]))
            forces.append(point.force)
            good.append(end.converged and bool(np.isfinite(samples[-1]).all()))
        if progress is not None:
            progress(first + count, replicates)
    if sum(good) < 2:
        raise InputError(
            f"{sum(good)} of {replicates} replicates converged: the readings drawn do not determine "
            "the parameters; use resample='residual', or fix parameters"
        )
    return Bootstrap(
        names=tuple(problem.names[k] for k in problem.free) + result.coefficient_names,
        samples=np.array(samples)[good],
        failed=good.count(False),
        forces=np.array(forces)[good],
    )


Draws = Callable[[np.random.Generator, int], list[Problem]]
"""From a generator of random numbers and a number of draws, the problems."""


def _residuals(result: Identification) -> Draws:
    """The model's forces with standardised residuals drawn with replacement."""
    problem = result.problem
    residual, scale, read = force_error(problem, result.end), 1 / problem.weight, problem.side == 0
    standard = (residual / scale)[read]
    spent = np.sqrt(standard.size / max(result.degrees_of_freedom, 1))
    standard = (standard - standard.mean()) * spent

    def draw(rng: np.random.Generator, count: int) -> list[Problem]:
        noise = rng.choice(standard, (count, problem.force.size)) * scale
        forces = np.where(read, problem.force + residual + noise, problem.force)
        return [problem.with_readings(force=force) for force in forces]

    return draw


def _groups(result: Identification, resample: str) -> Draws:
    """Whole lengths or specimens with replacement.

    Raises:
        InputError: there are fewer than three.
    """
    problem = result.problem
    which = np.repeat(np.arange(len(problem.parts), dtype=float), result.readings_of_parts)
    level = problem.levels("length") if resample == "length" else np.zeros(which.size)
    groups, label = np.unique(np.stack([which, level]), axis=1, return_inverse=True)
    number = groups.shape[1]
    if number < 3:
        raise InputError(
            f"drawing whole groups ({resample}) needs three or more of them, got {number}; use "
            "resample='residual'"
        )

    def draw(rng: np.random.Generator, count: int) -> list[Problem]:
        drawn = rng.integers(number, size=(count, number))
        times = np.stack([np.bincount(row, minlength=number) for row in drawn])
        weights = np.sqrt(times[:, label.ravel()].astype(float))
        return [problem.with_readings(factor=weight) for weight in weights]

    return draw

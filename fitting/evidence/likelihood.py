"""Profile likelihood: how much worse the best fit becomes when one parameter is held elsewhere."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..arguments import check_names, check_whole
from ..result import Estimate, Identification, check_identified
from .refit import refit

Class = Literal["identified", "one-sided", "flat", "stopped by a bound", "stopped by a constraint"]

LEVELS = {0.68: 0.9889, 0.95: 3.8415}
"""Confidence levels and their quantiles of chi-squared with one degree of freedom."""

_REACH = 3.0  # standard errors to either side
_FALLBACK = 0.1  # of the box, or of the largest coefficient, where there is no standard error
_EXTENSIONS = 4  # times that a side is doubled before it counts as open


@dataclasses.dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

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
    free = {e.name: e for e in result.estimates if not e.fixed}
    problem = result.problem
    if len(problem.linear) > result.order:  # one law of several cannot be held by itself
        free = {name: e for name, e in free.items() if name in problem.names}
    if isinstance(names, str):
        names = (names,)
    chosen = list(free) if names is None else list(check_names("names", names))
    unknown = [name for name in chosen if name not in free]
    if unknown:
        raise InputError(f"no identified parameter {unknown[0]!r}; there are {', '.join(free)}")
    profiles = []
    for done, name in enumerate(chosen, 1):
        profiles.append(_profile(result, free[name], points))
        if progress is not None:
            progress(done, len(chosen))
    return tuple(profiles)


def _profile(result: Identification, estimate: Estimate, points: int) -> Profile:
    centre = np.array([estimate.value])
    (optimum,) = _costs(result, estimate.name, centre)
    variance = 2 * optimum / max(result.degrees_of_freedom, 1)
    if not variance > 0:
        raise InputError("a fit without any error has no likelihood to profile")

    def excess_at(values: np.ndarray) -> Float[np.ndarray, " values"]:
        return 2 * (_costs(result, estimate.name, values) - optimum) / variance

    sides = [_side(estimate, result, end, points, excess_at) for end in (-1, 1)]
    ends = {
        level: [_crossing(*side, quantile, sign) for side, sign in zip(sides, (-1, 1), strict=True)]
        for level, quantile in LEVELS.items()
    }
    (down, fall), (up, rise) = sides
    return Profile(
        name=estimate.name,
        values=np.concatenate([down[:0:-1], up]),
        excess=np.concatenate([fall[:0:-1], rise]),
        intervals={level: (low, high) for level, (low, high) in ends.items()},
        verdict=_verdict(estimate, np.isfinite(ends[0.95]), bool(np.isnan([*fall, *rise]).any())),
        kind=estimate.kind,
    )


def _verdict(estimate: Estimate, closed: np.ndarray, ended: bool) -> Class:
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
    limit = estimate.max if sign > 0 else estimate.min
    reach = _REACH * estimate.stderr
    if not np.isfinite(reach):
        span = estimate.max - estimate.min
        reach = _FALLBACK * (span if np.isfinite(span) else np.abs(result.coefficients).max())
    values, excess = np.array([estimate.value]), np.zeros(1)
    for _ in range(_EXTENSIONS):
        end = estimate.value + sign * reach
        end = min(end, limit) if sign > 0 else max(end, limit)
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
    found = refit(held, [u[None]] * len(values))
    return np.where(found.converged, found.cost, np.nan)


def _crossing(values: np.ndarray, excess: np.ndarray, level: float, sign: int) -> float:
    """Where the excess first rises through a level, by linear interpolation of its root.

    Infinite, with the sign of the side, where it does not before the values or the fits end.
    """
    # Evidence ends with the first fit that was not found.
    lost = np.flatnonzero(np.isnan(excess))
    values, excess = (column[: lost[0]] if lost.size else column for column in (values, excess))
    above = np.flatnonzero(excess > level)
    if not above.size:
        return sign * math.inf
    k = above[0]
    left, right = np.sqrt(np.maximum(excess[k - 1 : k + 1], 0))
    share = (np.sqrt(level) - left) / (right - left)
    return float(values[k - 1] + share * (values[k] - values[k - 1]))

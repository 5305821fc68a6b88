"""Profile likelihood: how much worse the best fit becomes when one parameter is held elsewhere."""

import dataclasses
from collections.abc import Callable, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from ._errors import InputError
from ._refit import Readings, Refit, refit
from ._result import Estimate, Identification

Class = Literal["identified", "one-sided", "flat", "stopped by a bound"]

LEVELS = {0.68: 0.9889, 0.95: 3.8415}
"""Confidence levels and their quantiles of chi-squared with one degree of freedom."""

_REACH = 3.0  # standard errors to either side
_FALLBACK = 0.1  # of the box, or of the value of a coefficient, where there is no standard error


@dataclasses.dataclass(frozen=True)
class Profile:
    """The profile of one parameter.

    Attributes:
        name: of the parameter.
        values: at which it was held [SI], ascending, the optimum among them.
        excess: growth of the sum of squares over that at the optimum, in units of the noise
            variance: chi-squared with one degree of freedom where the model is right.
        intervals: by confidence level, (low, high) [SI]; infinite on a side where the excess never
            reaches the level within the values.
        verdict: "identified" (closed at 95 %), "one-sided", "flat" (open on both sides), or
            "stopped by a bound": the optimum is on one, and the data alone would go further.
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
    names: Sequence[str] | None = None,
    *,
    points: int = 9,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Profile, ...]:
    """The profile likelihood of parameters, all refits of one parameter at once.

    Args:
        result: from `identify`.
        names: parameters; all that were identified unless given.
        points: values to either side of the optimum, to three standard errors or to a bound.
        progress: called with (parameters done, parameters).

    Returns:
        One profile for each name.

    Raises:
        InputError: an unknown or held parameter, or coefficients that depend on pressure.
    """
    free = {e.name: e for e in result.estimates if not e.fixed}
    chosen = list(free) if names is None else list(names)
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
    low, high = _range(estimate)
    sides = [
        np.linspace(estimate.value, end, points + 1)[1:]
        for end in (low, high)
        if abs(end - estimate.value) > 1e-12 * max(abs(end), abs(estimate.value))
    ]
    values = np.sort(np.concatenate([[estimate.value], *sides]))
    cost = _costs(result, estimate.name, values)
    at = int(np.flatnonzero(values == estimate.value)[0])
    variance = 2 * cost[at] / _freedom(result)
    # A refit that did not reach its own optimum can only be too high; it is no evidence.
    excess = 2 * (cost - cost[at]) / variance if variance > 0 else np.full(cost.shape, np.nan)
    intervals = {
        level: (
            -_crossing(-values[: at + 1][::-1], excess[: at + 1][::-1], quantile),
            _crossing(values[at:], excess[at:], quantile),
        )
        for level, quantile in LEVELS.items()
    }
    closed = np.isfinite(intervals[0.95])
    verdict: Class = "identified" if closed.all() else "one-sided" if closed.any() else "flat"
    if estimate.at_bound:
        verdict = "stopped by a bound"
    return Profile(estimate.name, values, excess, intervals, verdict, estimate.kind)


def _freedom(result: Identification) -> int:
    return max(result.errors.n_points - result.n_parameters, 1)


def _range(estimate: Estimate) -> tuple[float, float]:
    """Three standard errors to either side, within the bounds."""
    reach = _REACH * estimate.stderr
    if not np.isfinite(reach):
        span = estimate.max - estimate.min
        reach = _FALLBACK * span if np.isfinite(span) else abs(estimate.value)
    return max(estimate.value - reach, estimate.min), min(estimate.value + reach, estimate.max)


def _costs(result: Identification, name: str, values: np.ndarray) -> Float[np.ndarray, " values"]:
    """Best cost with the parameter held at each value, from the optimum of all."""
    search, readings = result.search, Readings.of(result.search).repeated(len(values))
    optimum = np.tile(result.unit_optimum, (len(values), 1))
    if name in search.names:
        place = search.names.index(name)
        held = dataclasses.replace(
            readings,
            low=readings.low.at[:, place].set(values),
            high=readings.high.at[:, place].set(values),
        )
    else:
        place = tuple(search.problem.law.coefficients).index(name)
        held = dataclasses.replace(
            readings,
            coefficient_min=readings.coefficient_min.at[:, place].set(values),
            coefficient_max=readings.coefficient_max.at[:, place].set(values),
        )
    found: Refit = refit(search, held, optimum)
    return np.where(np.isfinite(found.cost), found.cost, np.inf)


def _crossing(values: np.ndarray, excess: np.ndarray, level: float) -> float:
    """Where the excess first rises through a level, by linear interpolation of its root."""
    above = np.flatnonzero(excess > level)
    if not above.size:
        return np.inf
    k = above[0]
    left, right = np.sqrt(np.maximum(excess[k - 1 : k + 1], 0))
    if not np.isfinite(right):
        return float(values[k])
    share = (np.sqrt(level) - left) / (right - left)
    return float(values[k - 1] + share * (values[k] - values[k - 1]))

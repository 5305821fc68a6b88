"""Huber's objective in the geometry and the law together, by reweighted least squares.

sum of rho(r), rho = r^2/2 where |r| <= d, else d |r| - d^2/2. At its optimum the weighted least
squares with weights min(1, d/|r|) are stationary too, and every step towards it lowers it (Huber
1981, section 7.8). So the descent, its bounds and its certified convex fit stay what they are.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..descent import End
from ..problem import Problem
from .multi_start import best_of, descend_all

OBJECTIVES = ("sum_of_squares", "huber")

TUNED = 1.345
"""Huber's threshold per standard deviation: 95 % efficient for normal noise (Huber 1981)."""
NORMAL_MAD = 1.4826
"""Standard deviations of normal noise in a median absolute deviation."""
_SCALED = 8  # rounds in which the noise is estimated; the threshold is then kept
_FROM_ALL = 3  # rounds that descend from every start
_ROUNDS = 200
_SETTLED = 1e-9  # largest change of a weight
_ROUNDING = 1e-9  # of the root mean square force: a spread below is none


@dataclasses.dataclass(frozen=True)
class Robust:
    """What Huber's objective makes of the readings.

    Attributes:
        weight: sqrt(min(1, d/|r|)) of every reading, a factor on its own weight, shape (points,).
        threshold: d, in N or in standard deviations of the readings where they have some.
    """

    weight: Float[np.ndarray, " points"]
    threshold: float


def check_objective(objective: str, *, censored: bool = False) -> None:
    """The objective must be one of those there are, and one that can be asked for."""
    if censored and objective != "sum_of_squares":
        raise InputError(
            "censored readings are one-sided squares: use objective='sum_of_squares', or leave "
            "censored out"
        )
    if objective not in OBJECTIVES:
        raise InputError(f"the objective is one of {', '.join(OBJECTIVES)}, got {objective!r}")


def descend_huber(
    problem: Problem, starts: np.ndarray, progress: Callable[[int, int], None] | None
) -> tuple[End, list[End], Robust]:
    """The optimum of Huber's objective.

    The threshold is 1.345 standard deviations of the noise, estimated from the median of the
    residuals as the first rounds go, and kept in those that follow.

    Args:
        problem: with the readings' own weights.
        starts: points of the unit box.
        progress: called with (starts done, starts) in the first round.

    Returns:
        The best end, the ends of all starts as they last were, and the weights.

    Raises:
        InputError: the weights did not settle.
    """
    points = problem.force.size
    weight, threshold = np.ones(points), np.inf
    ends = descend_all(problem, starts, progress)
    best = best_of(ends)
    for done in range(_ROUNDS):
        # In the readings' own weights again.
        residual = best.point.residual[:points] / weight
        if done < _SCALED:
            threshold = TUNED * _noise(problem, residual)
        old, weight = weight, huber_weight(residual, threshold)
        if done > _SCALED and np.abs(weight - old).max() <= _SETTLED:
            return best, ends, Robust(weight, threshold)
        changed = problem.with_readings(factor=weight)
        if done < _FROM_ALL:
            ends = descend_all(changed, starts)
            best = best_of(ends)
        else:
            best = best_of(descend_all(changed, best.u[None]))
    raise InputError(
        f"Huber's weights did not settle in {_ROUNDS} rounds: the readings leave several fits "
        "equally good. Fix parameters by bounds, or use objective='sum_of_squares'"
    )


def huber_weight(residual: np.ndarray, threshold: float) -> Float[np.ndarray, " points"]:
    """sqrt(min(1, d/|r|))."""
    size = np.abs(residual)
    return np.sqrt(np.where(size > threshold, threshold / np.where(size > 0, size, 1.0), 1.0))


def pseudo_residual(
    residual: Float[np.ndarray, " k"], n_readings: int, threshold: float, unknowns: int
) -> Float[np.ndarray, " k"]:
    """Residuals whose mean square is the variance of a robust fit: K psi(r) / mean(psi').

    References:
        Huber 1981, section 7.6: K = 1 + (p/n) (1 - m)/m with m the part of readings within d.
    """
    readings = residual[:n_readings]
    within = np.mean(np.abs(readings) <= threshold)
    factor = (1 + unknowns / n_readings * (1 - within) / within) / within
    return np.concatenate(
        [factor * np.clip(readings, -threshold, threshold), residual[n_readings:]]
    )


def _noise(problem: Problem, residual: Float[np.ndarray, " points"]) -> float:
    return max(
        NORMAL_MAD * float(np.median(np.abs(residual))),
        _ROUNDING * float(np.sqrt(np.mean((problem.force * problem.weight) ** 2))),
    )

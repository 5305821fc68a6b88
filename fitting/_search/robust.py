"""Huber's objective in the geometry and the law together, by reweighted least squares.

sum of rho(r), rho = r^2/2 where |r| <= d, else d |r| - d^2/2. At its optimum the weighted least
squares with weights min(1, d/|r|) are stationary too, and every step towards it lowers it (Huber
1981, section 7.8). So the descent, its bounds and its certified convex fit stay what they are.
"""

from collections.abc import Callable

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._errors import InputError
from .box import BoxOptimum
from .quick_jit import quick_jit
from .search import Search, best_of, descend

OBJECTIVES = ("sum_of_squares", "huber")

_TUNED = 1.345  # standard deviations: 95 % efficient for normal noise (Huber 1981)
_NORMAL_MAD = 1.4826  # standard deviations of normal noise in a median absolute deviation
_SCALED = 8  # rounds in which the noise is estimated; the threshold is then kept
_FROM_ALL = 3  # rounds that descend from every start
_ROUNDS = 200
_SETTLED = 1e-9  # largest change of a weight
_ROUNDING = 1e-9  # of the root mean square force: a spread below is none


class Robust(eqx.Module):
    """What Huber's objective makes of the readings.

    Attributes:
        weight: sqrt(min(1, d/|r|)) of every reading, a factor on its own weight, shape (points,).
        threshold: d, in N or in standard deviations of the readings where they have some.
    """

    weight: Float[np.ndarray, " points"]
    threshold: float


def check_objective(objective: str) -> None:
    """The objective must be one of those there are."""
    if objective not in OBJECTIVES:
        raise InputError(f"the objective is one of {', '.join(OBJECTIVES)}, got {objective!r}")


def reweighted(search: Search, weight: Float[np.ndarray, " points"]) -> Search:
    """The search with factors on the weights of its readings."""
    parts, first = [], 0
    for part in search.problem.parts:
        here = slice(first, first + part.force.shape[0])
        first = here.stop
        parts.append(eqx.tree_at(lambda p: p.weights, part, part.weights * weight[here]))
    return eqx.tree_at(lambda s: s.problem.parts, search, tuple(parts))


def descend_huber(
    search: Search, starts: np.ndarray, progress: Callable[[int, int], None] | None
) -> tuple[BoxOptimum, BoxOptimum, Robust]:
    """The optimum of Huber's objective.

    The threshold is 1.345 standard deviations of the noise, estimated from the median of the
    residuals as the first rounds go, and kept in those that follow.

    Args:
        search: with the readings' own weights.
        starts: points of the unit box.
        progress: called with (starts done, starts) in the first round.

    Returns:
        The best end, the ends of all starts as they last were, and the weights.

    Raises:
        InputError: the weights did not settle.
    """
    points = sum(part.force.shape[0] for part in search.problem.parts)
    weight, threshold = np.ones(points), np.inf
    ends = descend(search, starts, progress)
    best = best_of(ends)
    for done in range(_ROUNDS):
        residual = np.asarray(_residual(search, reweighted(search, weight), best.u))
        if done < _SCALED:
            threshold = _TUNED * _noise(search, residual)
        old, weight = weight, huber_weight(residual, threshold)
        if done > _SCALED and np.abs(weight - old).max() <= _SETTLED:
            return best, ends, Robust(weight, threshold)
        changed = reweighted(search, weight)
        if done < _FROM_ALL:
            ends = descend(changed, starts, None)
            best = best_of(ends)
        else:
            best = best_of(descend(changed, np.asarray(best.u)[None], None))
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


def _noise(search: Search, residual: Float[np.ndarray, " points"]) -> float:
    force = np.concatenate([np.asarray(p.force * p.weights.max(0)) for p in search.problem.parts])
    return max(
        _NORMAL_MAD * float(np.median(np.abs(residual))),
        _ROUNDING * float(np.sqrt(np.mean(force**2))),
    )


@quick_jit
def _residual(search: Search, weighted: Search, u: Float[Array, " p"]) -> Float[Array, " points"]:
    """Residuals, in the readings' own weights, of the best coefficients of the weighted fit."""
    parameters = search.parameters(u)
    problem = search.problem
    reaches = weighted.problem.reaches(parameters)
    error = problem.force_error(parameters, weighted.problem.solve(parameters).x, reaches)
    return error * jnp.concatenate([jnp.max(p.weights, axis=0) for p in problem.parts])

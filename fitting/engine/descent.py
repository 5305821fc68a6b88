"""Nonlinear least squares in a box, on the host: damped Gauss-Newton with exact convex steps.

Every step minimises |J d + r|^2 + mu |d|^2 with u + d inside the unit box, by the convex core, so
that a bound is met exactly and its multiplier is known, without transforms that flatten the
problem at its edge. `box.minimise_in_box` is the same for batches.
"""

import dataclasses

import numpy as np
from jaxtyping import Float

from .host_qp import solve_host_qp
from .problem import Point, Problem

_VANISHED = 1e-8  # parts of the first residual below which a residual is rounding
_SNAP = 1e-12  # a step that ends this near to a face was meant to end on it
_EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)


@dataclasses.dataclass(frozen=True)
class End:
    """Where a descent ended.

    Attributes:
        u: point in the unit box, shape (p,).
        point: the fit there.
        gradient_residual: largest cosine between r and a column of J along which `u` may still
            move; zero at a stationary point.
        steps: accepted and refused steps taken.
        converged: the gradient residual or the step fell below its tolerance.
    """

    u: Float[np.ndarray, " p"]
    point: Point
    gradient_residual: float
    steps: int
    converged: bool

    @property
    def cost(self) -> float:
        """Half the sum of the squared residuals."""
        return self.point.cost


def _gradient_residual(u: np.ndarray, r: np.ndarray, J: np.ndarray, scale: float) -> float:
    gradient = J.T @ r
    stopped = ((u <= 0) & (gradient > 0)) | ((u >= 1) & (gradient < 0))
    # A residual that has all but vanished has no direction left: it is measured against the start.
    size = np.linalg.norm(J, axis=0) * (np.linalg.norm(r) + _VANISHED * scale)
    cosine = np.where(stopped, 0.0, np.abs(gradient)) / np.maximum(size, _TINY)
    return float(np.max(cosine, initial=0.0))


def descend(
    problem: Problem,
    start: Float[np.ndarray, " p"],
    *,
    max_steps: int = 200,
    tolerance: float = 1e-10,
) -> End:
    """A local minimiser over the box of the nonlinear parameters, from one start.

    Args:
        problem: what is fitted.
        start: point in the unit box of the free parameters, shape (p,).
        max_steps: limit on the steps, refused ones included.
        tolerance: on the gradient residual, and on the step.

    Returns:
        The end; its cost is nan where the start has no fit.
    """
    n = start.size
    point = problem.solve(problem.parameters(start))
    u, r = start, point.residual
    if n == 0 or not np.isfinite(r).all():
        return End(u, point, 0.0 if n == 0 else np.nan, 0, n == 0)
    J = problem.jacobian(point)
    unit, scale = np.eye(n), float(np.linalg.norm(r))
    bounds = np.concatenate([unit, -unit])
    damping = max(1e-3 * float(np.max(np.sum(J**2, axis=0))), _TINY)
    growth, residual = 2.0, _gradient_residual(u, r, J, scale)
    for step in range(1, max_steps + 1):
        if residual <= tolerance:
            return End(u, point, residual, step, True)
        damped = np.concatenate([J, np.sqrt(damping) * unit])
        target = np.concatenate([-r, np.zeros(n)])
        move = solve_host_qp(damped, target, bounds, np.concatenate([-u, u - 1])).x
        trial = u + move
        trial = np.where(trial < _SNAP, 0.0, np.where(trial > 1 - _SNAP, 1.0, trial))
        model = r + J @ move
        predicted = r @ r - model @ model
        # A move below the rounding of the cost cannot show a descent: the end is reached there.
        if predicted <= 4 * _EPS * (r @ r) or np.abs(move).max() <= tolerance:
            return End(u, point, residual, step, True)
        tried = problem.solve(problem.parameters(trial))
        value = tried.residual
        ratio = (r @ r - value @ value) / predicted
        new = None
        if ratio > 1e-4 and np.isfinite(value).all():
            new = problem.jacobian(tried)
        if new is not None and np.isfinite(new).all():
            u, point, r, J = trial, tried, value, new
            # Nielsen's damping: smooth in the quality of the step, growing faster after refusals.
            damping *= max(1 / 3, 1 - (2 * ratio - 1) ** 3)
            growth, residual = 2.0, _gradient_residual(u, r, J, scale)
        else:
            damping *= growth
            growth *= 2
        damping = max(damping, _TINY)
    return End(u, point, residual, max_steps, False)

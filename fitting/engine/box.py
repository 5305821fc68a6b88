"""Nonlinear least squares in a box: damped Gauss-Newton whose steps are exact convex programmes.

Every step minimises |J d + r|^2 + mu |d|^2 with u + d inside the unit box, by the convex core, so
that a bound is met exactly and its multiplier is known, without transforms that flatten the
problem at its edge.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..convex.qp import solve_qp
from .descent import SNAP, gradient_residual

_MOST_STEPS = 200  # refused ones included
_TOLERANCE = 1e-10  # on the gradient residual, and on the step


class BoxOptimum(eqx.Module):
    """Where the descent ended.

    Attributes:
        u: point in the unit box, shape (p,).
        cost: 1/2 |r|^2 at `u`.
        gradient_residual: largest cosine between r and a column of J along which `u` may still
            move; zero at a stationary point.
        steps: accepted and refused steps taken.
        converged: the gradient residual or the step fell below its tolerance.
    """

    u: Float[Array, " p"]
    cost: Float[Array, ""]
    gradient_residual: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


class _State(eqx.Module):
    """The best point so far, the point to be tried next, and what is expected there."""

    u: Float[Array, " p"]
    residual: Float[Array, " k"]
    jacobian: Float[Array, "k p"]
    trial: Float[Array, " p"]
    predicted: Float[Array, ""]
    scale: Float[Array, ""]
    damping: Float[Array, ""]
    growth: Float[Array, ""]
    steps: Int[Array, ""]
    converged: Bool[Array, ""]


def minimise_in_box(
    residual: Callable[[Float[Array, " p"]], Float[Array, " k"]],
    start: Float[Array, " p"],
) -> BoxOptimum:
    """A local minimiser of 1/2 |r(u)|^2 over the unit box, from one start.

    Args:
        residual: r(u), differentiable in forward mode, finite on the box.
        start: point in the unit box, shape (p,).

    Returns:
        The end point; `converged` says whether it is stationary.
    """
    n = start.shape[0]
    if n == 0:
        r = residual(start)
        return BoxOptimum(start, r @ r / 2, jnp.zeros(()), jnp.array(0), jnp.array(True))
    unit = jnp.eye(n, dtype=start.dtype)
    bounds = jnp.concatenate([unit, -unit])

    def slope(*of_one: Array) -> Float[Array, ""]:
        return gradient_residual(*(leaf[None] for leaf in of_one))[0]

    def with_value(u: Float[Array, " p"]) -> tuple[Float[Array, " k"], Float[Array, " k"]]:
        value = residual(u)
        return value, value

    def step(state: _State) -> _State:
        first = state.steps == 0
        jacobian, value = jax.jacfwd(with_value, has_aux=True)(state.trial)
        cost, new_cost = state.residual @ state.residual, value @ value
        ratio = (cost - new_cost) / jnp.where(state.predicted > 0, state.predicted, 1.0)
        descends = (ratio > 1e-4) & (state.predicted > 0) & jnp.all(jnp.isfinite(jacobian))
        better = descends | first
        scale = jnp.where(first, jnp.linalg.norm(value), state.scale)
        u, r, J = jax.tree.map(
            lambda new, old: jnp.where(better, new, old),
            (state.trial, value, jacobian),
            (state.u, state.residual, state.jacobian),
        )
        # Nielsen's damping: smooth in the quality of the step, and growing faster after refusals.
        shrink = jnp.maximum(1 / 3, 1 - (2 * ratio - 1) ** 3)
        damping = state.damping * jnp.where(descends, shrink, state.growth)
        damping = jnp.where(first, 1e-3 * jnp.max(jnp.sum(J**2, axis=0)), damping)
        damping = jnp.maximum(damping, jnp.finfo(u.dtype).tiny)

        damped = jnp.concatenate([J, jnp.sqrt(damping) * unit])
        target = jnp.concatenate([-r, jnp.zeros_like(u)])
        move = solve_qp(damped, target, bounds, jnp.concatenate([-u, u - 1])).x
        trial = u + move
        trial = jnp.where(trial < SNAP, 0.0, jnp.where(trial > 1 - SNAP, 1.0, trial))
        predicted = r @ r - jnp.sum((r + J @ move) ** 2)
        # A move below the rounding of the cost cannot show a descent: the end is reached there.
        negligible = predicted <= 4 * jnp.finfo(u.dtype).eps * (r @ r)
        small = jnp.max(jnp.abs(move)) <= _TOLERANCE
        return _State(
            u=u,
            residual=r,
            jacobian=J,
            trial=trial,
            predicted=predicted,
            scale=scale,
            damping=damping,
            growth=jnp.where(better, 2.0, 2 * state.growth),
            steps=state.steps + 1,
            converged=small | negligible | (slope(u, r, J, scale) <= _TOLERANCE),
        )

    shape = jax.eval_shape(residual, start)
    begin = _State(
        u=start,
        residual=jnp.zeros(shape.shape, shape.dtype),
        jacobian=jnp.zeros((*shape.shape, n), shape.dtype),
        trial=start,
        predicted=jnp.zeros((), shape.dtype),
        scale=jnp.zeros((), shape.dtype),
        damping=jnp.ones((), shape.dtype),
        growth=jnp.full((), 2.0, shape.dtype),
        steps=jnp.array(0),
        converged=jnp.array(False),
    )
    end = jax.lax.while_loop(lambda s: ~s.converged & (s.steps < _MOST_STEPS), step, begin)
    return BoxOptimum(
        u=end.u,
        cost=end.residual @ end.residual / 2,
        gradient_residual=slope(end.u, end.residual, end.jacobian, end.scale),
        steps=end.steps,
        converged=end.converged,
    )

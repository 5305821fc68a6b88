"""The root of a falling function on [0, 1]: Newton's method, kept within its bracket."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Int

from .._arrays import RealArray, over_slope

_MAX_STEPS = 100


class _Bracket(eqx.Module):
    """State of the search: the root lies between `low` and `high`, and `y` is tried next."""

    low: RealArray
    high: RealArray
    y: RealArray
    step: RealArray
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def falling_root(residual: Callable[[RealArray], RealArray], start: RealArray) -> RealArray:
    """The root on [0, 1] of a residual that falls there, with implicit derivatives.

    A step of Newton's method that leaves the bracket, or is not half as long as the one before, is
    replaced by a bisection. Derivatives of any order are taken by the implicit function theorem, in
    whatever the residual depends on.

    Args:
        residual: r(y) of a scalar, of order one, with r(0) >= 0 >= r(1).
        start: where the search begins, within the interval, shape ().

    Returns:
        y, shape (); 0 where the residual is below zero there, so that it does no harm to others in
        a batch.
    """
    eps = float(jnp.finfo(start.dtype).eps)
    rough, fine = eps**0.8, 4 * eps

    def solve(function: Callable[[RealArray], RealArray], start: RealArray) -> RealArray:
        zero, one = jnp.zeros_like(start), jnp.ones_like(start)

        def narrow(at: _Bracket) -> _Bracket:
            value, slope = jax.jvp(function, (at.y,), (one,))
            low = jnp.where(value > 0, at.y, at.low)
            high = jnp.where(value > 0, at.high, at.y)
            newton = at.y - value / slope
            usable = (newton >= low) & (newton <= high)
            usable &= jnp.abs(newton - at.y) <= 0.5 * at.step
            y = jnp.where(usable, newton, 0.5 * (low + high))
            step = jnp.abs(y - at.y)
            # What a step of Newton's method leaves is of the order of its square.
            return _Bracket(
                low, high, y, step, at.steps + 1, step <= jnp.where(usable, rough, fine)
            )

        none = function(zero) <= 0
        begin = _Bracket(zero, one, jnp.where(none, zero, start), 2 * one, jnp.array(0), none)
        return jax.lax.while_loop(lambda at: ~at.done & (at.steps < _MAX_STEPS), narrow, begin).y

    return jax.lax.custom_root(residual, start, solve, over_slope)

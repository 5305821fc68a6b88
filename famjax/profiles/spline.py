"""The interpolating cubic spline with continuous second derivative, not-a-knot at its ends."""

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


def cardinal_splines(
    knots: Float[Array, " knots"], slopes: Float[Array, "knots knots"], at: Float[Array, "..."]
) -> Float[Array, "... knots"]:
    """The splines that are 1 at one knot and 0 at the others, each at the points.

    Args:
        knots: increasing, shape (n,).
        slopes: `slope_matrix(knots)`.
        at: points of any shape; beyond the ends the end cubics go on.

    Returns:
        Shape (..., n).
    """
    cell = jnp.clip(jnp.searchsorted(knots, at, side="right") - 1, 0, knots.shape[0] - 2)
    step = (knots[cell + 1] - knots[cell])[..., None]
    t = (at - knots[cell])[..., None] / step
    unit = jnp.eye(knots.shape[0], dtype=knots.dtype)
    return (
        (1 + 2 * t) * (1 - t) ** 2 * unit[cell]
        + t**2 * (3 - 2 * t) * unit[cell + 1]
        + step * t * (1 - t) * ((1 - t) * slopes[cell] - t * slopes[cell + 1])
    )


@jax.jit
def slope_matrix(knots: Float[Array, " knots"]) -> Float[Array, "knots knots"]:
    """Slopes of the interpolating spline at its knots, as a matrix on the values there.

    A parabola through three knots, a line through two.

    References:
        de Boor 1978, chapter IV.
    """
    n = knots.shape[0]
    step = jnp.diff(knots)
    unit = jnp.eye(n, dtype=knots.dtype)
    secant = (unit[1:] - unit[:-1]) / step[:, None]
    if n == 2:
        return jnp.concatenate([secant, secant])
    left, right = step[:-1], step[1:]
    first, second, first_value = _end_condition(step[:2], secant[:2])
    last, before, last_value = _end_condition(step[:-3:-1], secant[:-3:-1])
    # Between the ends the second derivative is continuous at the knots.
    inner = 3 * (right[:, None] * secant[:-1] + left[:, None] * secant[1:])
    return _solve_tridiagonal(
        jnp.concatenate([jnp.zeros_like(first), right, before]),
        jnp.concatenate([first, 2 * (left + right), last]),
        jnp.concatenate([second, left, jnp.zeros_like(last)]),
        jnp.concatenate([first_value, inner, last_value]),
    )


def _end_condition(
    step: Float[Array, " 2"], secant: Float[Array, "2 knots"]
) -> tuple[Float[Array, " 1"], Float[Array, " 1"], Float[Array, "1 knots"]]:
    """The spline's condition at one end, seen from it: on the first slope, on the second, its value.

    Not-a-knot: the third derivative is continuous at the second knot. Of three knots there is only
    one such condition; there the end cubic is a parabola instead.
    """
    near, next_ = step[:1], step[1:]
    if secant.shape[-1] == 3:
        return jnp.ones_like(near), jnp.ones_like(near), 2 * secant[:1]
    both = near + next_
    value = ((near + 2 * both) * next_ * secant[0] + near**2 * secant[1]) / both
    return next_, both, value[None]


def _solve_tridiagonal(
    below: Float[Array, " n"],
    diagonal: Float[Array, " n"],
    above: Float[Array, " n"],
    values: Float[Array, "n columns"],
) -> Float[Array, "n columns"]:
    """The solution of a system whose pivots are above zero in their order, as a spline's are.

    By plain operations, which a fit of a measured shape does in NumPy: with a factorisation of
    LAPACK's among them it would have to be compiled.
    """

    def eliminate(done: tuple[Array, Array], row: tuple[Array, ...]) -> tuple[Any, Any]:
        share, value = done
        low, own, high, right = row
        pivot = own - low * share
        now = high / pivot, (right - low * value) / pivot
        return now, now

    def substitute(after: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        share, value = row
        now = value - share * after
        return now, now

    nothing = jnp.zeros_like(values[0])
    rows = below, diagonal, above, values
    _, reduced = jax.lax.scan(eliminate, (jnp.zeros_like(diagonal[0]), nothing), rows)
    return jax.lax.scan(substitute, nothing, reduced, reverse=True)[1]

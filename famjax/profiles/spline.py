"""The interpolating cubic spline with continuous second derivative, not-a-knot at its ends."""

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
    left, right = step[:-1, None], step[1:, None]
    # Continuity of the second derivative at the inner knots.
    inner = right * unit[:-2] + 2 * (left + right) * unit[1:-1] + left * unit[2:]
    inner_values = 3 * (right * secant[:-1] + left * secant[1:])
    first, first_value = _end_condition(unit[:3], step[:2], secant[:2])
    last, last_value = _end_condition(unit[:-4:-1], step[:-3:-1], secant[:-3:-1])
    system = jnp.concatenate([first[None], inner, last[None]])
    values = jnp.concatenate([first_value[None], inner_values, last_value[None]])
    return jnp.linalg.solve(system, values)


def _end_condition(
    unit: Float[Array, "3 knots"], step: Float[Array, " 2"], secant: Float[Array, "2 knots"]
) -> tuple[Float[Array, " knots"], Float[Array, " knots"]]:
    """The spline's condition at one end, seen from it: a row on the slopes, and its value.

    Not-a-knot: the third derivative is continuous at the second knot. Of three knots there is only
    one such condition; there the end cubic is a parabola instead.
    """
    near, next_ = step
    if unit.shape[-1] == 3:
        return unit[0] + unit[1], 2 * secant[0]
    both = near + next_
    value = ((near + 2 * both) * next_ * secant[0] + near**2 * secant[1]) / both
    return next_ * unit[0] + both * unit[1], value

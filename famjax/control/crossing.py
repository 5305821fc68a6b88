"""The first place at which a function of one variable takes a value, with implicit derivatives."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._implicit import over_slope
from .._types import RealArray

_STEPS = 200  # bisection alone would need 52, and every other step is one where it is slow
ROUNDED = 64  # times the precision, per largest value: a few sums and powers of rounded numbers


class Crossing(eqx.Module):
    """Where a function takes a value, and what values it has at the stations.

    Attributes:
        at: the first such place; where there is none, the station of the nearest value, nan where
            no value is a number.
        found: whether the value is taken.
        lowest: least value at the stations, nan where none is a number.
        highest: largest value there.
    """

    at: RealArray
    found: Bool[Array, ""]
    lowest: RealArray
    highest: RealArray


def first_crossing(
    function: Callable[[RealArray], RealArray],
    stations: Float[Array, " n"],
    target: RealArray,
    *,
    falling_only: bool = False,
) -> Crossing:
    """The first place between stations at which a function takes a value.

    The stations are walked in their order to the first cell with the value between its ends, and
    that cell is bisected to the last digit. A value that is beyond all others by rounding alone is
    found at the nearest station.

    Args:
        function: f(x), of a scalar. What it depends on besides x is differentiated by the implicit
            function theorem, to any order.
        stations: x in order, rising or falling, shape (n,); not differentiated.
        target: value that is looked for, shape ().
        falling_only: pass cells in which the function rises.

    Returns:
        The crossing; its bounds are not differentiated.
    """
    stations = jax.lax.stop_gradient(stations)
    values = jax.lax.stop_gradient(jax.vmap(function)(stations))
    wanted = jax.lax.stop_gradient(target)
    numbers = jnp.isfinite(values)
    known = jnp.any(numbers)
    least_at = jnp.argmin(jnp.where(numbers, values, jnp.inf))
    most_at = jnp.argmax(jnp.where(numbers, values, -jnp.inf))
    lowest = jnp.where(known, values[least_at], jnp.nan)
    highest = jnp.where(known, values[most_at], jnp.nan)
    size = jnp.where(known, jnp.maximum(jnp.abs(lowest), jnp.abs(highest)), 1.0)
    rounding = ROUNDED * jnp.finfo(values.dtype).eps * size

    # A value beyond the others by rounding is one of theirs.
    inside = jnp.clip(wanted, lowest, highest)
    within = jnp.abs(wanted - inside) <= rounding
    left = jnp.where(within, inside, wanted) - values
    before, after = left[:-1], left[1:]
    falls = (before <= 0) & (after >= 0)
    rises = (before >= 0) & (after <= 0)
    cells = numbers[:-1] & numbers[1:] & (falls if falling_only else falls | rises)
    found = jnp.any(cells)
    cell = jnp.argmax(cells)
    change = jnp.abs(values[cell + 1] - values[cell])
    scale = jnp.where(found & (change > 0), change, jnp.maximum(size, 1.0))

    def residual(x: RealArray) -> RealArray:
        return (function(x) - target) / scale

    # A search that has no root ends before it begins: others in the batch would wait for it.
    ends = tuple((stations[k], jnp.where(found, -left[k] / scale, 0.0)) for k in (cell, cell + 1))
    root = bracketed(residual, *ends)
    nearest = stations[jnp.where(wanted > highest, most_at, least_at)]
    at = jnp.where(found, root, jnp.where(known, nearest, jnp.nan))
    return Crossing(at, found & jnp.isfinite(wanted), lowest, highest)


def bracketed(
    residual: Callable[[RealArray], RealArray],
    low: tuple[RealArray, RealArray],
    high: tuple[RealArray, RealArray],
) -> RealArray:
    """The root of a residual between two points, with the derivatives of the implicit function theorem.

    Chandrupatla's method: inverse quadratic interpolation where three points allow it, else
    bisection, so that a nearly straight residual takes some five evaluations instead of fifty: roots
    stand inside of roots here. To a few times the precision of the larger end. Where the bracket
    holds no root some point of it is returned.

    Args:
        residual: r(x), of a scalar.
        low: one end and the residual there, each of shape ().
        high: the other end.

    Returns:
        x, shape ().

    References:
        Chandrupatla 1997, Advances in Engineering Software 28(3), 145-149.
    """
    low, high = jax.lax.stop_gradient((low, high))
    dtype = jnp.result_type(low[1], high[1])
    fine = 4 * jnp.finfo(dtype).eps
    tolerance = fine * jnp.maximum(jnp.abs(low[0]), jnp.abs(high[0]))

    def solve(function: Callable[[RealArray], RealArray], _: RealArray) -> RealArray:
        def going(state: tuple) -> Bool[Array, ""]:
            steps, (a, f_a), (b, f_b), _, _ = state
            apart = (jnp.abs(b - a) > tolerance) & (f_a != 0) & (f_b != 0)
            return (steps < _STEPS) & apart

        def narrowed(state: tuple) -> tuple:
            steps, a, b, c, share = state
            x = a[0] + share * (b[0] - a[0])
            new = (x, function(x))
            same = jnp.sign(new[1]) == jnp.sign(a[1])
            c, b = _either(same, (a, b), (b, a))  # the root stays between the new one and b
            a = new
            least = 0.5 * tolerance / jnp.where(b[0] == a[0], 1.0, jnp.abs(b[0] - a[0]))
            share = jnp.clip(_next(a, b, c), least, 1 - least)
            return steps + 1, a, b, c, share

        start = (0, low, high, high, jnp.full_like(low[0], 0.5))
        _, a, b, _, _ = jax.lax.while_loop(going, narrowed, start)
        return jnp.where(jnp.abs(a[1]) <= jnp.abs(b[1]), a[0], b[0])

    return jax.lax.custom_root(residual, low[0], solve, over_slope)


def _next(a: tuple, b: tuple, c: tuple) -> RealArray:
    """Share of the way from a to b at which to ask next: a is the newest, c the one before."""
    (x_a, f_a), (x_b, f_b), (x_c, f_c) = a, b, c
    xi = _ratio(x_a - x_b, x_c - x_b)
    phi = _ratio(f_a - f_b, f_c - f_b)
    smooth = (phi**2 < xi) & ((1 - phi) ** 2 < 1 - xi)
    inverse = _ratio(f_a, f_b - f_a) * _ratio(f_c, f_b - f_c)
    inverse += _ratio(x_c - x_a, x_b - x_a) * _ratio(f_a, f_c - f_a) * _ratio(f_b, f_c - f_b)
    return jnp.where(smooth, inverse, 0.5)


def _ratio(over: RealArray, under: RealArray) -> RealArray:
    return over / jnp.where(under == 0, 1.0, under)


def _either(first: Bool[Array, ""], these: tuple, those: tuple) -> tuple:
    """One of two tuples of the same kind."""
    return jax.tree.map(lambda one, other: jnp.where(first, one, other), these, those)

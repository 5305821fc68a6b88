"""The first place at which a function of one variable takes a value, with implicit derivatives."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._arrays import RealArray
from ..muscle import bisected

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

    Bisected to the last digit of the bracket. Where it holds no root some point of it is returned.

    Args:
        residual: r(x), of a scalar, of order one in the bracket.
        low: one end and the residual there, each of shape ().
        high: the other end.

    Returns:
        x, shape ().
    """
    (start, before), (end, after) = jax.lax.stop_gradient((low, high))
    width = jnp.where(end == start, 1.0, end - start)
    rising = jnp.where(before > after, -1.0, 1.0)
    fine = jnp.finfo(jnp.result_type(before, after))
    share = bisected(
        lambda share: rising * residual(start + share * width),
        jnp.zeros_like(width),
        jnp.ones_like(width),
        tolerance=float(fine.eps),
        max_steps=fine.nmant + 2,
    )
    return start + share * width

"""The length at which a muscle carries a load: a bracketed root solve with implicit derivatives."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._implicit import over_slope
from .._types import RealArray

_CELLS = 64
_ROUNDED = 64  # times the precision, per largest force: a few sums and powers of rounded numbers


def longest_equilibrium(
    force: Callable[[RealArray], RealArray],
    shortest: RealArray,
    longest: RealArray,
    load: RealArray,
) -> tuple[RealArray, Bool[Array, ""]]:
    """The longest length at which a shortening muscle's force has fallen to the load.

    The range is walked from its longest end in 64 steps to the first one in which the force falls
    through the load, and that step is bisected to the last digit. What the force depends on is
    differentiated by the implicit function theorem, not through the search.

    Args:
        force: F(L) [N], of a scalar length.
        shortest: lower end of the range [m], shape ().
        longest: upper end of the range [m], shape ().
        load: [N], shape ().

    Returns:
        (length [m], found): nan and False where the force does not fall through the load.
    """
    force = jax.jit(force)  # traced once, for the walk and for the parts of the solve
    grid = jnp.linspace(longest, shortest, _CELLS + 1)
    pull = jax.lax.stop_gradient(jax.vmap(force)(grid) - load)
    # A zero at the very end that rounding left above zero is one: the force at rest without pressure.
    rounding = _ROUNDED * jnp.finfo(pull.dtype).eps * jnp.nanmax(jnp.abs(pull))
    pull = pull.at[-1].set(jnp.where(jnp.abs(pull[-1]) <= rounding, 0.0, pull[-1]))
    falls = (pull[:-1] > 0) & (pull[1:] <= 0)
    found = jnp.any(falls)
    cell = jnp.argmax(falls)
    scale = jnp.where(found, jnp.abs(pull[cell]) + jnp.abs(pull[cell + 1]), 1.0)
    # The solve runs in parts of the rest range and of the force in the cell, both of order one.
    unit = jax.lax.stop_gradient(longest)

    def residual(y: RealArray) -> RealArray:
        return (force(y * unit) - load) / scale

    dtype = jnp.result_type(unit, pull)
    tolerance = 4 * float(jnp.finfo(dtype).eps)
    root = bisected(
        residual,
        grid[cell + 1] / unit,
        grid[cell] / unit,
        tolerance=tolerance,
        max_steps=20 if dtype == jnp.float32 else 50,
    )
    return jnp.where(found, root * unit, jnp.nan), found


def bisected(
    residual: Callable[[RealArray], RealArray],
    lower: RealArray,
    upper: RealArray,
    *,
    tolerance: float,
    max_steps: int,
    flip: bool = False,
) -> RealArray:
    """The root of a residual in a bracket, with the derivatives of the implicit function theorem.

    Derivatives of any order, forward and reverse, in whatever the residual depends on. Where the
    bracket holds no root some point of it is returned, with finite derivatives where the residual
    has them, so that it does no harm to others in a batch.

    Args:
        residual: r(y) of a scalar, of order one.
        lower: end of the bracket, shape ().
        upper: the other end.
        tolerance: absolute and relative.
        max_steps: of the bisection.
        flip: r falls from the lower to the upper end.

    Returns:
        y, shape ().
    """

    def solve(function: Callable[[RealArray], RealArray], start: RealArray) -> RealArray:
        import optimistix as optx  # noqa: PLC0415 -- slow to load, and only needed for a root

        return optx.root_find(
            lambda y, _: function(y),
            optx.Bisection(rtol=tolerance, atol=tolerance, flip=flip),
            start,
            options={"lower": lower, "upper": upper},
            max_steps=max_steps,
            throw=False,
        ).value

    start = jax.lax.stop_gradient(0.5 * (lower + upper))
    return jax.lax.custom_root(jax.jit(residual), start, solve, over_slope)


def required(length: RealArray, found: Bool[Array, "..."], what: str) -> RealArray:
    """The length, or an error naming the likely causes where no equilibrium was found."""
    return eqx.error_if(
        length,
        ~found,
        f"no {what}: the force does not fall through the load between the longest and the "
        "shortest length of the muscle. Likely causes: the load exceeds what the muscle pulls at "
        "that pressure; the pressure is at or below the deadband; a coefficient has the wrong "
        "sign or unit. Pass throw=False to get nan instead.",
    )

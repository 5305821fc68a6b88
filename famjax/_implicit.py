"""The linear half of the implicit function theorem for a scalar unknown."""

from collections.abc import Callable

import jax.numpy as jnp

from ._types import RealArray


def over_slope(linear: Callable[[RealArray], RealArray], value: RealArray) -> RealArray:
    """The x at which a linear function of a scalar has a value: the `tangent_solve` of a root.

    Where its slope is zero or not finite there is no root, and the value itself is returned: one
    member of a batch without a root leaves the derivatives of the others as they are.
    """
    slope = linear(jnp.ones_like(value))
    usable = jnp.isfinite(slope) & (slope != 0)
    return value / jnp.where(usable, slope, 1.0)

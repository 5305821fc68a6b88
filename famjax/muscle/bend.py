"""A straight line that bends towards an end, and a force that does not push: both C1 and monotone."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Real, RealArray

_STRAIGHT = 0.8  # of the way to the end


def bent(step: Real, ends: Float[Array, "2"]) -> RealArray:
    """A step beyond an edge, straight for four fifths of the way to an end that it never passes.

    y = x for |x| <= 4/5 X, beyond it y = X (4/5 + t/(5 (1 + t))), t = 5 |x|/X - 4, with x's sign.
    C1, and its slope is positive everywhere.

    Args:
        step: x, any shape.
        ends: 1/X below and above, >= 0; zero for no end. Shape (2,).

    Returns:
        y of x's unit, x's shape.
    """
    inverse = jnp.where(step < 0, ends[0], ends[1])
    way = inverse * jnp.abs(step)
    t = jnp.maximum(way - _STRAIGHT, 0.0) / (1 - _STRAIGHT)
    beyond = _STRAIGHT + (1 - _STRAIGHT) * t / (1 + t)
    limited = way > _STRAIGHT
    return jnp.where(limited, jnp.sign(step) * beyond / jnp.where(limited, inverse, 1.0), step)


def taut(force: RealArray, width: RealArray) -> RealArray:
    """The force, and none where it would push; between 0 and a width [N] a cubic joins the two.

    F = w (2 t^2 - t^3), t = G/w: exactly zero for G <= 0, exactly G for G >= w, C1, rising. It is
    below G by 0.15 w at most.

    Args:
        force: G [N] as if the muscle could push.
        width: w [N], > 0.

    Returns:
        F [N], >= 0.
    """
    t = jnp.clip(force / width, 0.0, 1.0)
    return jnp.asarray(jnp.where(force >= width, force, width * t**2 * (2 - t)))


def stopped(step: RealArray, stiffness: RealArray, onset: RealArray) -> RealArray:
    """Force [N] of a stop that is run into by a step [m]: none before it, C1, its stiffness bounded.

    k x^2/(2 s) on the first s, then k (x - s/2).

    Args:
        step: x [m], any shape.
        stiffness: k [N/m], > 0.
        onset: s [m], > 0.
    """
    on = jnp.clip(step, 0.0, onset)
    return stiffness * (on**2 / (2 * onset) + jnp.maximum(step - onset, 0.0))


def untaut(force: RealArray, width: RealArray) -> RealArray:
    """The force G [N] of which `taut` makes F [N] >= 0; zero for F = 0, nan below.

    The root of 2 t^2 - t^3 = F/w in [0, 1], t = (2 + 4 cos(arccos(1 - 27 F/(16 w))/3 - 2 pi/3))/3,
    of the three real roots the middle one.
    """
    part = force / width
    blended = (part > 0) & (part < 1)
    angle = jnp.arccos(1 - 27 / 16 * jnp.where(blended, part, 0.5)) / 3
    t = (2 + 4 * jnp.cos(angle - 2 * jnp.pi / 3)) / 3
    return jnp.where(blended, width * t, jnp.where(force >= 0, force, jnp.nan))

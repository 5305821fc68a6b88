"""The pull of a cylindrical braid under pressure, by Gaylord."""

import jax.numpy as jnp

from .._types import Real, RealArray


def force_magnification(braid_angle: Real) -> RealArray:
    """Force magnification [-], 2 tan(theta)^2 - 1: braid force over pressure times section.

    Args:
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        Magnification [-], broadcast shape; zero at `NEUTRAL_ANGLE`, negative below it.

    References:
        Gaylord 1958; Chambers 2021, section 2.2.
    """
    return 2 * jnp.tan(jnp.asarray(braid_angle)) ** 2 - 1


def gaylord_force(pressure: Real, radius: Real, braid_angle: Real) -> RealArray:
    """Pull F_G [N] of a cylindrical braid, F_G = P pi R^2 (2 tan(theta)^2 - 1).

    The bladder's stiffness, the stretch of the threads and the rounded ends are neglected.

    Args:
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        F_G [N], broadcast shape, positive when the muscle pulls.

    References:
        Gaylord 1958; Chambers 2021, equation 6.1.

    >>> round(float(gaylord_force(6e5, 0.01, 1.1)))
    1267
    """
    return jnp.asarray(pressure * jnp.pi * radius**2 * force_magnification(braid_angle))

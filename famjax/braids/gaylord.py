"""The pull of a cylindrical braid under pressure, by Gaylord."""

import jax.numpy as jnp

from .._types import Real, RealArray, as_real


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


def braid_angle_from_blocked_force(pressure: Real, force: Real, diameter: Real) -> RealArray:
    """Braid angle theta_0 [rad] at rest from how blocked force rises with pressure.

    The bladder's force at the rest length does not depend on pressure, nor does the deadband's, so
    that the slope of the line through the readings is Gaylord's own:

    dF/dP = pi D0^2 / 4 (2 tan(theta_0)^2 - 1)

    The stretch of the threads is neglected.

    Args:
        pressure: gauge pressures P [Pa] of the readings, shape (..., n), n >= 2, not all the same.
        force: blocked forces F [N], of that shape.
        diameter: braid diameter D0 [m] at rest, of shape (...).

    Returns:
        theta_0 [rad], from the circumference, of shape (...); nan where the force falls so steeply
        with pressure that no braid does it, dF/dP < -pi D0^2 / 4.

    References:
        Chambers 2021, section 4, initial braid angle.

    >>> P = jnp.array([2e5, 4e5, 6e5])
    >>> F = gaylord_force(P, 0.01, 1.1) - 50.0  # the bladder pushes
    >>> round(float(braid_angle_from_blocked_force(P, F, 0.02)), 6)
    1.1
    """
    P, F = as_real(pressure), as_real(force)
    away = P - jnp.mean(P, axis=-1, keepdims=True)
    slope = jnp.sum(away * F, axis=-1) / jnp.sum(away**2, axis=-1)
    magnification = 4 * slope / (jnp.pi * as_real(diameter) ** 2)
    return jnp.arctan(jnp.sqrt((magnification + 1) / 2))

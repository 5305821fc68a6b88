"""The terms of the static force balance: F = F_G + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2)."""

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


def bladder_axial_force(axial_stress: Real, bladder_volume: Real, length: Real) -> RealArray:
    """Pull [N] of the bladder's own axial stress, sigma_z V / L.

    Args:
        axial_stress: true stress sigma_z [Pa], positive in tension.
        bladder_volume: V [m3] of the rubber.
        length: active length L [m].

    Returns:
        Force [N], broadcast shape; negative when the shortened bladder pushes.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return jnp.asarray(axial_stress * bladder_volume / length)


def bladder_hoop_force(
    hoop_stress: Real, thickness: Real, length: Real, radius: Real, turns: Real
) -> RealArray:
    """Pull [N] lost to the bladder's hoop stress, -sigma_c t L^2 / (2 pi R N^2).

    Args:
        hoop_stress: true stress sigma_c [Pa], positive in tension.
        thickness: wall t [m].
        length: active length L [m].
        radius: braid radius R [m].
        turns: N [-].

    Returns:
        Force [N], broadcast shape; negative when the stretched bladder holds the braid back.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """
    return -jnp.asarray(hoop_stress * thickness * length**2 / (2 * jnp.pi * radius * turns**2))

"""Buckling of a swage tube, pushed through its die with and without a support."""

import equinox as eqx
import jax.numpy as jnp

from .._types import Real, RealArray, as_real


def tube_second_moment(outer_diameter: Real, thickness: Real) -> RealArray:
    """Second moment of area I [m4] of a tube, pi/8 t (D - t) (D^2 - 2 D t + 2 t^2).

    The same as pi/64 (D^4 - d^4), without its cancellation in a thin wall.

    Args:
        outer_diameter: D [m].
        thickness: wall t [m], 0 < t <= D / 2.

    Returns:
        I [m4], broadcast shape.
    """
    D, t = as_real(outer_diameter), as_real(thickness)
    return jnp.pi / 8 * t * (D - t) * (D**2 - 2 * D * t + 2 * t**2)


def euler_load(
    modulus: Real, second_moment: Real, length: Real, end_factor: Real = 1.0
) -> RealArray:
    """Euler's buckling load [N] of a straight elastic column, pi^2 E I / (K L)^2.

    Yielding is neglected, and in a short column comes first: compare the load over the section with
    the yield strength.

    Args:
        modulus: E [Pa], of the column's material.
        second_moment: I [m4].
        length: L [m], free to bend.
        end_factor: K [-]; 1 for two pinned ends, 0.5 for two clamped ones, 2 for one end free.

    Returns:
        Load [N], broadcast shape.

    References:
        Euler 1744; Timoshenko & Gere 1961, Theory of Elastic Stability, chapter 2.
    """
    return jnp.asarray(jnp.pi**2 * modulus * second_moment / as_real(end_factor * length) ** 2)


def yield_load(yield_stress: Real, outer_diameter: Real, thickness: Real) -> RealArray:
    """Load [N] at which a straight tube yields over its section, pi t (D - t) sigma_y.

    Buckling is neglected: the tube bears the smaller of this and `euler_load`, and in between, where
    the two are alike, somewhat less than either.

    Args:
        yield_stress: sigma_y [Pa], of the tube's material.
        outer_diameter: D [m].
        thickness: wall t [m], 0 < t <= D / 2.

    Returns:
        Load [N], broadcast shape.
    """
    return jnp.asarray(jnp.pi * thickness * (as_real(outer_diameter) - thickness) * yield_stress)


class TubeBuckling(eqx.Module):
    """Buckling of a swage tube pushed through the die.

    Attributes:
        unsupported_load: Euler's load [N] of the bare tube.
        supported_load: Euler's load [N] of what the support leaves free.
        gain: supported over unsupported load [-].
        supported_stress: supported load over the tube's section [Pa]. Above the yield strength the
            tube is crushed before it buckles, and Euler's load says nothing.
    """

    unsupported_load: RealArray
    supported_load: RealArray
    gain: RealArray
    supported_stress: RealArray


def tube_buckling(
    *,
    modulus: Real,
    outer_diameter: Real,
    thickness: Real,
    length: Real,
    supported_length: Real,
    end_factor: Real = 1.0,
) -> TubeBuckling:
    """Buckling of the swage tube with and without a support that shortens its free length.

    The support is taken as rigid and its end as the same kind of end as before, so that the gain
    is (L / L')^2. The reference work's support (1.0 in x 0.125 in wall) leaves L' = 1.85 in free
    and "approximately doubles" the load; no L is at hand, and a gain of two implies 2.62 in. The
    support's section is also 1.76 times as stiff as the tube's (`tube_second_moment`): had it
    carried the load in the tube's place over the same length, that would be the gain.

    Check `supported_stress`: the reference work's tube, of a metal with E = 10e6 psi and 1.85 in
    free between pins, would need 3.2e6 psi to buckle. It yields long before.

    Args:
        modulus: Young's modulus E [Pa] of the tube; of the catalogue row, or a handbook's.
        outer_diameter: D [m].
        thickness: wall t [m].
        length: L [m], free length without the support.
        supported_length: L' [m], free length with it, <= L.
        end_factor: K [-]; see `euler_load`.

    Returns:
        Loads [N], gain [-] and stress [Pa], each of the broadcast shape.

    References:
        Chambers 2021, chapter 2.
    """
    second_moment = tube_second_moment(outer_diameter, thickness)
    unsupported = euler_load(modulus, second_moment, length, end_factor)
    supported = euler_load(modulus, second_moment, supported_length, end_factor)
    section = yield_load(1.0, outer_diameter, thickness)
    return TubeBuckling(unsupported, supported, supported / unsupported, supported / section)

"""Drucker stability of a material along the path that the muscle takes when it contracts."""

import jax
import jax.numpy as jnp

from ._geometry import AbstractGeometry
from ._material import AbstractMaterial
from ._types import Real, RealArray, as_real


def path_modulus(
    material: AbstractMaterial, geometry: AbstractGeometry, length: Real, pressure: Real
) -> RealArray:
    """Second-order work of the bladder along the actuation path, per squared strain increment.

    (d sigma_z d eps_z + d sigma_c d eps_c) / (d eps_z^2 + d eps_c^2), the increments taken along
    L at constant pressure. For a law without interaction of the two directions this is
    (sigma_z'(eps_z) d eps_z^2 + sigma_c'(eps_c) d eps_c^2) / (d eps_z^2 + d eps_c^2): a weighted
    mean of the two tangent moduli. Drucker stability asks for >= 0 at every state.

    Args:
        material: stress law.
        geometry: gives the strains at (L, P).
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        Modulus along the path [Pa], broadcast shape.

    References:
        Drucker 1959; Chambers 2021, section 7.2.
    """

    def one(length: RealArray, pressure: RealArray) -> RealArray:
        def state(length: RealArray) -> tuple[tuple[tuple[RealArray, RealArray], ...], RealArray]:
            at = geometry.dimensions(length, pressure)
            axial = jnp.broadcast_to(at.axial_strain[..., None], at.hoop_strain.shape)
            strains = (axial, at.hoop_strain)
            return (strains, material.stresses(*strains, pressure)), at.station_weights

        _, (strain_rate, stress_rate), weights = jax.jvp(
            state, (length,), (jnp.ones_like(length),), has_aux=True
        )
        work = sum(rate * strain for rate, strain in zip(stress_rate, strain_rate, strict=True))
        square = sum(strain**2 for strain in strain_rate)
        return jnp.sum(weights * work) / jnp.sum(weights * square)

    lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
    flat = jax.vmap(one)(lengths.ravel(), pressures.ravel())
    return flat.reshape(lengths.shape)

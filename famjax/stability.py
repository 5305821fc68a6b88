"""Drucker stability of a bladder material along the actuation path of a muscle."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._arrays import Real, RealArray, as_real, at_each, promoting
from .geometries import AbstractGeometry
from .materials import AbstractMaterial


class PathStrains(eqx.Module):
    """Strains on an actuation path, and their derivatives with respect to length.

    Attributes:
        pressure: gauge pressure [Pa].
        axial, hoop: eps_z and eps_c [-] at stations along the muscle, shape (..., stations).
        axial_rate, hoop_rate: derivatives of the strains with respect to L [1/m] at constant pressure.
        station_weights: quadrature weights of the stations; they sum to 1.
    """

    pressure: RealArray
    axial: Float[Array, "... stations"]
    hoop: Float[Array, "... stations"]
    axial_rate: Float[Array, "... stations"]
    hoop_rate: Float[Array, "... stations"]
    station_weights: Float[Array, "... stations"]

    def modulus(self, material: AbstractMaterial) -> RealArray:
        """Return the second-order work divided by the squared strain increment [Pa]; see `path_modulus`."""
        pressure = self.pressure[..., None]
        stress_rate = jax.jvp(
            lambda axial, hoop: material.stresses(axial, hoop, pressure),
            (self.axial, self.hoop),
            (self.axial_rate, self.hoop_rate),
        )[1]
        work = stress_rate[0] * self.axial_rate + stress_rate[1] * self.hoop_rate
        square = self.axial_rate**2 + self.hoop_rate**2
        weights = self.station_weights
        return jnp.sum(weights * work, axis=-1) / jnp.sum(weights * square, axis=-1)


@promoting
def path_strains(geometry: AbstractGeometry, length: Real, pressure: Real) -> PathStrains:
    """Return the strains along the actuation path, with their derivatives with respect to length.

    Args:
        geometry: geometry that provides the strains at (L, P).
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        Strains and rates, with the broadcast shape plus a last axis of stations.
    """

    def one(length: RealArray, pressure: RealArray) -> PathStrains:
        def strains(
            length: RealArray,
        ) -> tuple[tuple[Float[Array, " s"], Float[Array, " s"]], Float[Array, " s"]]:
            at = geometry.dimensions(length, pressure)
            axial = jnp.broadcast_to(at.axial_strain[..., None], at.hoop_strain.shape)
            return (axial, at.hoop_strain), at.station_weights

        (axial, hoop), (axial_rate, hoop_rate), weights = jax.jvp(
            strains, (length,), (jnp.ones_like(length),), has_aux=True
        )
        return PathStrains(pressure, axial, hoop, axial_rate, hoop_rate, weights)

    return at_each(one, as_real(length), as_real(pressure))


@promoting
def path_modulus(
    material: AbstractMaterial, geometry: AbstractGeometry, length: Real, pressure: Real
) -> RealArray:
    """Return the bladder's second-order work along the actuation path, divided by the squared strain.

    (d sigma_z d eps_z + d sigma_c d eps_c) / (d eps_z^2 + d eps_c^2), with increments along L at
    constant pressure. For a law that does not couple the two directions, this is a weighted mean of
    the two tangent moduli, (sigma_z'(eps_z) d eps_z^2 + sigma_c'(eps_c) d eps_c^2) /
    (d eps_z^2 + d eps_c^2). Drucker stability requires a value >= 0 at every state.

    Args:
        material: stress law.
        geometry: geometry that provides the strains at (L, P).
        length: active length L [m].
        pressure: gauge pressure P [Pa].

    Returns:
        Modulus along the path [Pa], with the broadcast shape.

    References:
        Drucker 1959; Chambers 2021, section 7.2.
    """
    return path_strains(geometry, length, pressure).modulus(material)

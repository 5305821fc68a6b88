"""The bladder's part of the pull: the axial stress in its wall, and the hoop stress.

The static force balance is F = F_G + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2).
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._types import Real, RealArray, as_real
from ..geometries.dimensions import Dimensions
from ..materials.abstract_material import AbstractMaterial
from .abstract_term import AbstractForceTerm


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


class _Wall(eqx.Module):
    """Axial means of the true stresses in the wall.

    Attributes:
        axial, hoop: sigma_z and sigma_c [Pa]; 0 where the law does not know the state.
        known: whether it does.
    """

    axial: RealArray
    hoop: RealArray
    known: Bool[Array, "..."]

    @classmethod
    def of(cls, material: AbstractMaterial, at: Dimensions, pressure: Real) -> "_Wall":
        """The means at these dimensions and gauge pressure P [Pa]."""
        stresses = material.stresses(
            at.axial_strain[..., None], at.hoop_strain, as_real(pressure)[..., None]
        )
        known = jnp.all(jnp.isfinite(stresses[0] + stresses[1]), axis=-1)
        axial, hoop = (
            jnp.sum(at.station_weights * jnp.where(known[..., None], stress, 0.0), axis=-1)
            for stress in stresses
        )
        return cls(axial, hoop, known)

    def axial_force(self, at: Dimensions) -> RealArray:
        """Pull [N] of the axial stress."""
        pull = bladder_axial_force(self.axial, at.bladder_volume, at.length)
        return jnp.where(self.known, pull, jnp.nan)

    def hoop_force(self, at: Dimensions) -> RealArray:
        """Pull [N] lost to the hoop stress."""
        pull = bladder_hoop_force(self.hoop, at.thickness, at.length, at.radius, at.turns)
        return jnp.where(self.known, pull, jnp.nan)


class BladderAxial(AbstractForceTerm):
    """The pull of the axial stress alone, sigma_z V / L.

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The pull [N], broadcast shape; negative where the shortened bladder pushes."""
        return _Wall.of(self.material, at, pressure).axial_force(at)


class BladderHoop(AbstractForceTerm):
    """The pull lost to the hoop stress alone, -sigma_c t L^2 / (2 pi R N^2).

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The pull [N], broadcast shape; negative where the stretched bladder holds the braid."""
        return _Wall.of(self.material, at, pressure).hoop_force(at)


class BladderWall(AbstractForceTerm):
    """Both parts of the bladder, of one material: sigma_z V / L - sigma_c t L^2 / (2 pi R N^2).

    Stresses that vary along the axis enter by their axial mean.

    Attributes:
        material: stress law of the bladder.

    References:
        Ferraresi 2001; Chambers 2021, section 6.2.
    """

    material: AbstractMaterial

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The bladder's pull [N], broadcast shape; negative where it resists."""
        wall = _Wall.of(self.material, at, pressure)
        return wall.axial_force(at) + wall.hoop_force(at)

"""The bladder's part of the pull: the axial stress in its wall, and the hoop stress."""

import jax.numpy as jnp

from .._force import bladder_axial_force, bladder_hoop_force
from .._geometry import Dimensions
from .._material import AbstractMaterial
from .._types import Real, RealArray, as_real
from .abstract import AbstractForceTerm


def wall_stresses(
    material: AbstractMaterial, at: Dimensions, pressure: Real
) -> tuple[RealArray, RealArray]:
    """Axial means of the true stresses (sigma_z, sigma_c) [Pa] in the wall, broadcast shape.

    Args:
        material: stress law.
        at: dimensions, with the hoop strain at stations along the axis.
        pressure: gauge pressure P [Pa].

    Returns:
        The two means.
    """
    axial, hoop = material.stresses(
        at.axial_strain[..., None], at.hoop_strain, as_real(pressure)[..., None]
    )
    weights = at.station_weights
    return jnp.sum(weights * axial, axis=-1), jnp.sum(weights * hoop, axis=-1)


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
        axial, _ = wall_stresses(self.material, at, pressure)
        return bladder_axial_force(axial, at.bladder_volume, at.length)


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
        _, hoop = wall_stresses(self.material, at, pressure)
        return bladder_hoop_force(hoop, at.thickness, at.length, at.radius, at.turns)


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
        axial, hoop = wall_stresses(self.material, at, pressure)
        return bladder_axial_force(axial, at.bladder_volume, at.length) + bladder_hoop_force(
            hoop, at.thickness, at.length, at.radius, at.turns
        )

"""The rubber bladder as an incompressible tube: volume, thickness and mid-wall strain.

Two places of the bladder are known in practice. In a McKibben muscle it lies under the braid and
its outer radius is R_braid - t_braid (the reference work). In a moulded muscle (Festo DMSP) the
threads run inside the rubber, and the braid radius is the mid-wall radius.
"""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._types import Given, Real, RealArray
from ..parameters import Parametrised, parameter


def cylinder_volume(length: Real, radius: Real) -> RealArray:
    """Volume [m3] of a cylinder, V = pi R^2 L; the rounded ends of a real muscle are neglected.

    Args:
        length: active length L [m].
        radius: R [m].

    Returns:
        V [m3], broadcast shape.
    """
    return jnp.asarray(jnp.pi * radius**2 * length)


def tube_volume(length: Real, outer_diameter: Real, thickness: Real) -> RealArray:
    """Volume [m3] of the rubber in a tube, V = pi t (D - t) L.

    Args:
        length: L [m].
        outer_diameter: D [m].
        thickness: wall t [m], 0 < t <= D / 2.

    Returns:
        V [m3], broadcast shape.

    >>> round(float(tube_volume(9.28125, 0.875, 0.0625)), 3)  # inches: Chambers 2021, 1.481 in3
    1.481
    """
    return jnp.asarray(jnp.pi * thickness * (outer_diameter - thickness) * length)


def bladder_thickness(length: Real, outer_radius: Real, bladder_volume: Real) -> RealArray:
    """Wall thickness t [m] of an incompressible tube, t = R - sqrt(R^2 - V / (pi L)).

    Args:
        length: L [m], > 0.
        outer_radius: R [m] of the bladder.
        bladder_volume: V [m3] of the rubber, constant.

    Returns:
        t [m], broadcast shape; nan where the rubber does not fit in the radius.

    References:
        Chambers 2021, section 6.1.
    """
    section = bladder_volume / (jnp.pi * length)
    return jnp.asarray(section / (outer_radius + jnp.sqrt(outer_radius**2 - section)))


class Bladder(Parametrised):
    """An incompressible rubber tube.

    Attributes:
        rest_length: L0 [m], active length at which the axial strain is zero.
        rest_diameter: outer diameter at rest [m]; mid-wall diameter where `embedded`.
        rest_thickness: wall t0 [m] at rest.
        embedded: True where the threads run inside the wall, so that the braid radius is the
            mid-wall radius; False where the bladder lies under the braid.
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)
    rest_diameter: Float[Given, "..."] = parameter("m", low=0.0, name="bladder_diameter")
    rest_thickness: Float[Given, "..."] = parameter("m", low=0.0, name="wall_thickness")
    embedded: bool = eqx.field(static=True, default=False)

    @property
    def rest_mid_radius(self) -> RealArray:
        """Mid-wall radius [m] at rest."""
        if self.embedded:
            return self.rest_diameter / 2
        return (self.rest_diameter - self.rest_thickness) / 2

    @property
    def volume(self) -> RealArray:
        """Volume V [m3] of the rubber, 2 pi R_mid t0 L0; constant."""
        return 2 * jnp.pi * self.rest_mid_radius * self.rest_thickness * self.rest_length

    @property
    def smallest_braid_radius(self) -> RealArray:
        """Braid radius [m], thickness of the braid not counted, at which the bore closes at L0."""
        solid_radius = jnp.sqrt(self.volume / (jnp.pi * self.rest_length))
        return solid_radius / 2 if self.embedded else solid_radius

    @property
    def rest_radius(self) -> RealArray:
        """Outer radius [m] at rest; mid-wall radius where `embedded`."""
        return self.rest_diameter / 2

    def fits(self, length: Real, radius: Real) -> Bool[Array, "..."]:
        """Whether the rubber fits in a tube of this length [m] and radius [m] as of `thickness`."""
        positive = (jnp.asarray(length) > 0) & (radius > 0)
        if self.embedded:
            return positive
        section = self.volume / (jnp.pi * jnp.where(positive, length, self.rest_length))
        return positive & (jnp.square(radius) >= section)

    def thickness(self, length: Real, radius: Real) -> RealArray:
        """Wall thickness t [m] at constant volume.

        Args:
            length: L [m].
            radius: outer radius [m] of the bladder; mid-wall radius where `embedded`.

        Returns:
            t [m], broadcast shape.
        """
        if self.embedded:
            return jnp.asarray(self.volume / (2 * jnp.pi * radius * length))
        return bladder_thickness(length, radius, self.volume)

    def axial_strain(self, length: Real) -> RealArray:
        """Axial engineering strain eps_z [-], L / L0 - 1: negative when shorter."""
        return jnp.asarray(length / self.rest_length - 1)

    def hoop_strain(self, length: Real, radius: Real) -> RealArray:
        """Hoop engineering strain eps_c [-] at mid-wall, R_mid / R_mid0 - 1.

        Args:
            length: L [m].
            radius: outer radius [m] of the bladder; mid-wall radius where `embedded`.

        Returns:
            eps_c [-], broadcast shape.

        References:
            Chambers 2021, section 6.1.
        """
        mid_radius = radius if self.embedded else radius - self.thickness(length, radius) / 2
        return jnp.asarray(mid_radius / self.rest_mid_radius - 1)

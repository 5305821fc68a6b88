"""The muscle: geometry, material and deadband composed into one static force model."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._equilibrium import longest_equilibrium, required
from ._force import bladder_axial_force, bladder_hoop_force, gaylord_force
from ._geometry import AbstractGeometry, Dimensions
from ._material import AbstractMaterial
from ._types import Real, RealArray, as_real


class Muscle(eqx.Module):
    """A fluidic artificial muscle in static equilibrium.

    F = F_G(P - P_d) + sigma_z V / L - sigma_c t L^2 / (2 pi R N^2)

    The force is not clipped: a negative value says by how much the muscle would push if it could
    not buckle, and a real one is slack there. Below the deadband the formula is an extrapolation.

    Attributes:
        geometry: source of the dimensions; it composes braid and bladder.
        material: stress law of the bladder.
        deadband_pressure: P_d [Pa], pressure before the muscle acts.

    References:
        Ferraresi 2001; Hocking & Wereley 2012; Chambers 2021, equation 6.9.
    """

    geometry: AbstractGeometry
    material: AbstractMaterial
    deadband_pressure: Float[Array, "..."] = eqx.field(converter=as_real, default=0.0)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        at = self.geometry.dimensions(length, pressure)
        return self.braid_force_at(at, pressure) + self.bladder_force_at(at, pressure)

    def braid_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the pressurised braid alone, F_G at P - P_d, broadcast shape."""
        return self.braid_force_at(self.geometry.dimensions(length, pressure), pressure)

    def bladder_force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of the bladder alone, broadcast shape; negative where it resists.

        Stresses that vary along the axis enter by their axial mean.
        """
        return self.bladder_force_at(self.geometry.dimensions(length, pressure), pressure)

    def braid_force_at(self, at: Dimensions, pressure: Real) -> RealArray:
        """`braid_force` [N] at known dimensions and gauge pressure P [Pa]."""
        return gaylord_force(pressure - self.deadband_pressure, at.radius, at.braid_angle)

    def bladder_force_at(self, at: Dimensions, pressure: Real) -> RealArray:
        """`bladder_force` [N] at known dimensions and gauge pressure P [Pa]."""
        axial_stress, hoop_stress = self.material.stresses(
            at.axial_strain[..., None], at.hoop_strain, as_real(pressure)[..., None]
        )
        axial_mean = jnp.sum(at.station_weights * axial_stress, axis=-1)
        hoop_mean = jnp.sum(at.station_weights * hoop_stress, axis=-1)
        return bladder_axial_force(axial_mean, at.bladder_volume, at.length) + bladder_hoop_force(
            hoop_mean, at.thickness, at.length, at.radius, at.turns
        )

    def stiffness(self, length: Real, pressure: Real) -> RealArray:
        """Axial stiffness dF/dL [N/m] at constant pressure, broadcast shape; positive resists."""
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        slope = jax.vmap(jax.grad(self.force))
        return slope(lengths.ravel(), pressures.ravel()).reshape(lengths.shape)

    def blocked_force(self, pressure: Real) -> RealArray:
        """Blocked force [N], the pull at zero contraction and gauge pressure P [Pa]."""
        return self.force(self.geometry.rest_length, pressure)

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Active length L [m] at which the muscle, contracting, carries the load.

        Args:
            load: [N], positive when it stretches the muscle.
            pressure: gauge pressure P [Pa].
            throw: raise where there is no such length; if False, return nan there.

        Returns:
            L [m], broadcast shape. Differentiable in load, pressure and every number of the
            muscle by the implicit function theorem.

        Raises:
            RuntimeError: there is no such length, and `throw`.
        """
        shortest, longest = self.geometry.length_range()
        loads, pressures = jnp.broadcast_arrays(as_real(load), as_real(pressure))

        def one(load: RealArray, pressure: RealArray) -> tuple[RealArray, Array]:
            return longest_equilibrium(
                lambda length: self.force(length, pressure), shortest, longest, load
            )

        length, found = jax.vmap(one)(loads.ravel(), pressures.ravel())
        if throw:
            length = required(length, found, "equilibrium length")
        return length.reshape(loads.shape)

    def free_contraction(self, pressure: Real, *, throw: bool = True) -> RealArray:
        """Free contraction (L0 - L) / L0 [-] at zero force and gauge pressure P [Pa].

        Args:
            pressure: gauge pressure P [Pa]. Below the deadband the muscle rests longer than L0
                and the result is negative.
            throw: raise where the force has no zero; if False, return nan there.

        Returns:
            Contraction [-], a fraction, of the pressure's shape; differentiable.

        Raises:
            RuntimeError: the force has no zero, and `throw`.
        """
        return 1 - self.length_at_load(0.0, pressure, throw=throw) / self.geometry.rest_length

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Gauge pressure [Pa] at which the force leaves zero at a held length: the onset.

        Args:
            length: active length L [m].
            highest: pressure [Pa] up to which the onset is looked for.
            throw: raise where there is none; if False, return nan there.

        Returns:
            P [Pa], broadcast shape; differentiable in length and every number of the muscle.

        Raises:
            RuntimeError: the force has no zero between 0 and `highest`, and `throw`.
        """
        lengths, tops = jnp.broadcast_arrays(as_real(length), as_real(highest))

        def one(length: RealArray, top: RealArray) -> tuple[RealArray, Array]:
            return longest_equilibrium(
                lambda pressure: self.force(length, pressure),
                jnp.zeros_like(top),
                top,
                jnp.zeros_like(top),
            )

        pressure, found = jax.vmap(one)(lengths.ravel(), tops.ravel())
        if throw:
            pressure = required(pressure, found, "onset pressure")
        return pressure.reshape(lengths.shape)

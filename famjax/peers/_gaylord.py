"""The braid alone: Gaylord's force, the same with stretching threads, and with a wall."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._braid import AbstractBraid, Braid, braid_angle_from_length, diameter_from_length
from .._force import gaylord_force
from .._types import Real, RealArray, as_real
from ._model import PeerModel


class Gaylord(PeerModel):
    """The pull of a pressurised braid; the bladder is neglected but for a deadband and an offset.

    F = (P - P_d) (3 L^2 - B^2) / (4 pi N^2) + F_0

    This is also virtual work, -(P - P_d) dV/dL + F_0, and Chou and Hannaford's model without wall.
    With a `CompliantBraid` it is Davis' model of threads that stretch.

    Attributes:
        braid: threads about the bladder.
        deadband_pressure: P_d [Pa], zero in the originals.
        force_offset: F_0 [N], zero in the originals.

    References:
        Gaylord 1958; Chou & Hannaford 1996; Davis, Tsagarakis, Canderle & Caldwell 2003. General
        knowledge, not read again: Davis takes the tension of a strand from terms of its own.

    >>> model = Gaylord(Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3))
    >>> print(f"{model.force(0.3, 6e5):.0f}")
    1267
    """

    braid: AbstractBraid
    deadband_pressure: Float[Array, "..."] = eqx.field(converter=as_real, default=0.0)
    force_offset: Float[Array, "..."] = eqx.field(converter=as_real, default=0.0)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        acting = as_real(pressure) - self.deadband_pressure
        B = self.braid.thread_length(length, acting)
        radius = diameter_from_length(length, B, self.braid.turns) / 2
        return gaylord_force(acting, radius, braid_angle_from_length(length, B)) + self.force_offset


class ChouHannaford(PeerModel):
    """The braid about a wall of constant thickness that resists nothing.

    F = pi D^2 P / 4 (3 cos(a)^2 - 1) + pi P (D t (2 sin(a) - 1 / sin(a)) - t^2), cos(a) = L / B

    with D = B / (pi N), the diameter at 90 deg, and a the angle between thread and axis.

    Attributes:
        braid: threads of constant length.
        wall_thickness: t [m] of braid and bladder together.

    References:
        Chou & Hannaford 1996. General knowledge, not read again.
    """

    braid: Braid
    wall_thickness: Float[Array, "..."] = eqx.field(converter=as_real)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        B, t = self.braid.rest_thread_length, self.wall_thickness
        D = B / (jnp.pi * self.braid.turns)
        sine = jnp.sqrt((B - length) * (B + length)) / B
        wall = jnp.pi * pressure * (D * t * (2 * sine - 1 / sine) - t**2)
        return Gaylord(self.braid).force(length, pressure) + wall

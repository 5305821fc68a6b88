"""The braid alone: Gaylord's force, the same with stretching threads, and with a wall."""

import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..braids import (
    AbstractBraid,
    Braid,
    braid_angle_from_length,
    diameter_from_length,
    gaylord_force,
)
from ..parameters import parameter
from .abstract_peer import PeerModel, braid_range, known, where_it_holds


class Gaylord(PeerModel):
    """The pull of a pressurised braid; the bladder is neglected but for a deadband and an offset.

    F = (P - P_d) (3 L^2 - B^2) / (4 pi N^2) + F_0

    This is also virtual work, -(P - P_d) dV/dL + F_0, and Chou and Hannaford's model without wall.
    With a `CompliantBraid` it is Davis' model of threads that stretch.

    Attributes:
        braid: threads about the bladder.
        deadband_pressure: P_d [Pa], zero in the originals.
        force_offset: F_0 [N], zero in the originals.
        resting_length: L0 [m], which the force does not need; blocked force and contraction do.

    References:
        Gaylord 1958; Chou & Hannaford 1996; Davis, Tsagarakis, Canderle & Caldwell 2003. General
        knowledge, not read again: Davis takes the tension of a strand from terms of its own.

    >>> model = Gaylord(Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3))
    >>> print(f"{model.force(0.3, 6e5):.0f}")
    1267
    """

    braid: AbstractBraid
    deadband_pressure: Float[Given, "..."] = parameter("Pa", default=0.0)
    force_offset: Float[Given, "..."] = parameter("N", linear=True, default=0.0)
    resting_length: Float[Given, "..."] | None = parameter(
        "m", low=0.0, name="rest_length", default=None
    )

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        acting = as_real(pressure) - self.deadband_pressure
        L, B, reached = self.braid.reach(length, acting)
        radius = diameter_from_length(L, B, self.braid.turns) / 2
        pull = gaylord_force(acting, radius, braid_angle_from_length(L, B)) + self.force_offset
        return jnp.where(reached, pull, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the unloaded threads."""
        return braid_range(self.braid)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction.

        Raises:
            ValueError: it was not given.
        """
        return known(self.resting_length, self)


class ChouHannaford(PeerModel):
    """The braid about a wall of constant thickness that resists nothing.

    F = pi D^2 P / 4 (3 cos(a)^2 - 1) + pi P (D t (2 sin(a) - 1 / sin(a)) - t^2), cos(a) = L / B

    with D = B / (pi N), the diameter at 90 deg, and a the angle between thread and axis.

    Attributes:
        braid: threads of constant length.
        wall_thickness: t [m] of braid and bladder together.
        resting_length: L0 [m], which the force does not need; blocked force and contraction do.

    References:
        Chou & Hannaford 1996. General knowledge, not read again.
    """

    braid: Braid
    wall_thickness: Float[Given, "..."] = parameter("m", low=0.0)
    resting_length: Float[Given, "..."] | None = parameter(
        "m", low=0.0, name="rest_length", default=None
    )

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        L, B, reached = self.braid.reach(length, pressure)
        t = self.wall_thickness
        D = B / (jnp.pi * self.braid.turns)
        sine = jnp.sqrt((B - L) * (B + L)) / B
        wall = jnp.pi * pressure * (D * t * (2 * sine - 1 / sine) - t**2)
        return jnp.where(reached, Gaylord(self.braid).force(L, pressure) + wall, jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to the length of the threads."""
        return braid_range(self.braid)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction.

        Raises:
            ValueError: it was not given.
        """
        return known(self.resting_length, self)

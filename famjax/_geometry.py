"""The dimensions of the muscle at a length and pressure, from whatever is known of its shape."""

import abc
import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from ._bladder import Bladder, cylinder_volume
from ._braid import (
    NEUTRAL_ANGLE,
    AbstractBraid,
    braid_angle_from_length,
    diameter_from_length,
)
from ._types import Real, RealArray, as_real

_BELOW_NEUTRAL = 0.95  # at the neutral length itself a limp bladder's force is zero, not negative


class Dimensions(eqx.Module):
    """What the force balance needs to know of the muscle at one length and pressure.

    Attributes:
        length: L [m].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference.
        turns: N [-].
        thickness: bladder wall t [m].
        axial_strain: eps_z [-].
        hoop_strain: eps_c [-] at stations along the axis, shape (..., stations).
        station_weights: share of the axis that each station stands for, shape (stations,), sum 1:
            the axial mean of any function f of the hoop strain is sum(weights * f(eps_c)).
        bladder_volume: V [m3] of the rubber.
        volume: volume [m3] within the braid's outline.
    """

    length: RealArray
    radius: RealArray
    braid_angle: RealArray
    turns: RealArray
    thickness: RealArray
    axial_strain: RealArray
    hoop_strain: Float[Array, "... stations"]
    station_weights: Float[Array, " stations"]
    bladder_volume: RealArray
    volume: RealArray


class AbstractGeometry(eqx.Module):
    """A source of `Dimensions`."""

    @abc.abstractmethod
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape."""

    @abc.abstractmethod
    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] between which an equilibrium is looked for."""

    @property
    @abc.abstractmethod
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""


def cylinder_dimensions(
    length: RealArray,
    radius: RealArray,
    braid_angle: RealArray,
    braid: AbstractBraid,
    bladder: Bladder,
) -> Dimensions:
    """Dimensions of a cylinder of braid radius R [m] and angle theta [rad] at length L [m]."""
    bladder_radius = radius if bladder.embedded else radius - braid.thickness
    return Dimensions(
        length=length,
        radius=radius,
        braid_angle=braid_angle,
        turns=braid.turns,
        thickness=bladder.thickness(length, bladder_radius),
        axial_strain=bladder.axial_strain(length),
        hoop_strain=bladder.hoop_strain(length, bladder_radius)[..., None],
        station_weights=jnp.ones(1, length.dtype),
        bladder_volume=bladder.volume,
        volume=cylinder_volume(length, radius),
    )


class EstimatedGeometry(AbstractGeometry):
    """A cylinder whose diameter follows from the braid: the estimated geometry.

    Attributes:
        braid: threads about the bladder.
        bladder: rubber tube under, or in, the braid.

    References:
        Chambers 2021, chapter 6, "cylindrical approximation".
    """

    braid: AbstractBraid
    bladder: Bladder

    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape."""
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        thread_length = self.braid.thread_length(length, pressure)
        radius = diameter_from_length(length, thread_length, self.braid.turns) / 2
        angle = braid_angle_from_length(length, thread_length)
        return cylinder_dimensions(length, radius, angle, self.braid, self.bladder)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From just below the neutral angle to where the braid closes the bladder's bore at rest."""
        inset = 0.0 if self.bladder.embedded else self.braid.thickness
        smallest = 2 * (self.bladder.smallest_braid_radius + inset)
        closed = jnp.pi * self.braid.turns * smallest
        thread = self.braid.rest_thread_length
        shortest = _BELOW_NEUTRAL * thread * math.sin(NEUTRAL_ANGLE)
        return shortest, jnp.sqrt((thread - closed) * (thread + closed))

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the bladder's."""
        return self.bladder.rest_length

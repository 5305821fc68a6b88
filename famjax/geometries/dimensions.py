"""The dimensions of the muscle at a length and pressure, and what a geometry is: that which gives them."""

import abc
import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from .._types import Real, RealArray, as_real
from ..braids.inextensible import NEUTRAL_ANGLE
from ..parameters import Parametrised


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
        thread_length: B [m] of the loaded threads; None where the geometry does not say it.
        rates: derivatives of all of these in the length, at constant pressure, for terms that use
            them; else None.
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
    thread_length: RealArray | None = None
    rates: "Dimensions | None" = None

    @property
    def reached(self) -> Bool[Array, "..."]:
        """Whether the muscle can be there: every dimension is a number."""
        along = jnp.all(jnp.isfinite(self.hoop_strain), axis=-1)
        for one in (self.length, self.radius, self.braid_angle, self.thickness, self.axial_strain):
            along &= jnp.isfinite(one)
        return along & jnp.isfinite(self.volume)

    def where(self, reached: Bool[Array, "..."]) -> "Dimensions":
        """The same dimensions with 1, which stands for no muscle, where it cannot be.

        What is computed of them is to be replaced by nan there. Nan itself would spoil, in reverse
        mode, the derivatives of all other states in the numbers that they share.
        """

        def kept(value: RealArray) -> RealArray:
            return jnp.where(reached, value, 1.0)

        return dataclasses.replace(
            self,
            length=kept(self.length),
            radius=kept(self.radius),
            braid_angle=kept(self.braid_angle),
            thickness=kept(self.thickness),
            axial_strain=kept(self.axial_strain),
            hoop_strain=jnp.where(reached[..., None], self.hoop_strain, 1.0),
            volume=kept(self.volume),
            # Longer than the length, so that there is a triangle.
            thread_length=None
            if self.thread_length is None
            else jnp.where(reached, self.thread_length, 2.0),
            rates=None if self.rates is None else self.rates.where(reached),
        )

    def unless(self, reached: Bool[Array, "..."]) -> "Dimensions":
        """The same dimensions with nan where the muscle cannot be."""

        def kept(value: RealArray) -> RealArray:
            return jnp.where(reached, value, jnp.nan)

        return dataclasses.replace(
            self,
            radius=kept(self.radius),
            braid_angle=kept(self.braid_angle),
            thickness=kept(self.thickness),
            axial_strain=kept(self.axial_strain),
            hoop_strain=jnp.where(reached[..., None], self.hoop_strain, jnp.nan),
            volume=kept(self.volume),
            thread_length=None if self.thread_length is None else kept(self.thread_length),
        )


class AbstractGeometry(Parametrised):
    """A source of `Dimensions`."""

    @abc.abstractmethod
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape.

        Nan where the muscle cannot be. Whether there, too, the derivatives of what is computed on the
        way are numbers, so that in a batch they do not spoil those of the others, `keeps_apart` says.
        """

    @property
    def keeps_apart(self) -> bool:
        """Whether states that cannot be leave the derivatives of all others as they are, see `dimensions`.

        A muscle asks the dimensions of a geometry that does not say so twice, the second time with
        the rest length in the place of lengths that it cannot have.
        """
        return False

    def dimensions_with_rates(self, length: Real, pressure: Real) -> Dimensions:
        """The dimensions with their `rates`, the derivatives in the length at constant pressure."""
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        at, rates = jax.jvp(
            lambda lengths: self.dimensions(lengths, pressures),
            (lengths,),
            (jnp.ones_like(lengths),),
        )
        return dataclasses.replace(at, rates=rates)

    @abc.abstractmethod
    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] between which an equilibrium is looked for."""

    @property
    @abc.abstractmethod
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""

    @property
    def breakpoints(self) -> Float[Array, " lengths"]:
        """Active lengths [m] at which some derivative of the dimensions jumps; none if all are smooth."""
        return jnp.asarray(np.zeros(0))  # which compiles nothing

    def inner_volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid: that of the braid's outline less the rubber's.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            V [m3], broadcast shape; nan where the muscle cannot be.
        """
        at = self.dimensions(length, pressure)
        return at.volume - at.bladder_volume

    def braid_limits(self) -> tuple[RealArray, RealArray]:
        """Active lengths [m] at which the unloaded braid locks, and at which its threads are straight.

        Locked, at the neutral angle, pressure shortens it no further; with straight threads nothing
        but their stretch lengthens it.

        Returns:
            (lock, straight) [m], nan for a geometry that has no `braid`.

        References:
            Chambers 2021, section 2.1: the neutral angle, 35.26 deg from the circumference.
        """
        braid = getattr(self, "braid", None)
        if braid is None:
            return jnp.full((), jnp.nan), jnp.full((), jnp.nan)
        thread = braid.rest_thread_length
        return thread * math.sin(NEUTRAL_ANGLE), thread

    def cut_to_length(self, rest_length: RealArray) -> "AbstractGeometry":  # noqa: ARG002
        """The geometry of the same construction with another rest length [m]; `famjax.cut_to_length`.

        Raises:
            ValueError: a shape that is that of one length.
        """
        raise ValueError(
            f"a {type(self).__name__} cannot be cut to another length: a measured or assumed shape is "
            "that of one length; a geometry of your own can have a method cut_to_length(rest_length)"
        )

"""The dimensions of the muscle at a length and pressure, from whatever is known of its shape."""

import abc
import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from .._types import Real, RealArray, as_real
from ..braids.inextensible import (
    NEUTRAL_ANGLE,
    AbstractBraid,
    braid_angle_from_length,
    diameter_from_length,
    thread_length_from_angle,
    turns_from_angle,
)
from ..parameters import Declared, Parametrised
from ..parameters.parametrised import checked_values
from .bladder import Bladder, cylinder_volume

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

        Nan where the muscle cannot be. There the derivatives of what is computed on the way should
        be numbers, so that in a batch they do not spoil those of the others.
        """

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


def cylinder_dimensions(
    length: RealArray,
    radius: RealArray,
    braid_angle: RealArray,
    thread_length: RealArray,
    braid: AbstractBraid,
    bladder: Bladder,
    reached: Bool[Array, "..."],
) -> Dimensions:
    """Dimensions of a cylinder of braid radius R [m] and angle theta [rad] at length L [m].

    Args:
        length: L [m], a number wherever it is; so are the next three, of one shape.
        radius: braid radius R [m].
        braid_angle: theta [rad].
        thread_length: B [m].
        braid: of the muscle.
        bladder: of the muscle.
        reached: whether the braid can be there; what is given elsewhere is of no account.

    Returns:
        The dimensions, nan where not `reached` or where the rubber does not fit in the braid.
    """
    bladder_radius = radius if bladder.embedded else radius - braid.thickness
    reached = reached & bladder.fits(length, bladder_radius)
    rest_length, rest_radius = jax.lax.stop_gradient((bladder.rest_length, bladder.rest_radius))
    wall_length = jnp.where(reached, length, rest_length)
    wall_radius = jnp.where(reached, bladder_radius, rest_radius)
    return Dimensions(
        length=length,
        radius=radius,
        braid_angle=braid_angle,
        turns=braid.turns,
        thickness=bladder.thickness(wall_length, wall_radius),
        axial_strain=bladder.axial_strain(wall_length),
        hoop_strain=bladder.hoop_strain(wall_length, wall_radius)[..., None],
        station_weights=jnp.ones(1, length.dtype),
        bladder_volume=bladder.volume,
        volume=cylinder_volume(length, radius),
        thread_length=thread_length,
    ).unless(reached)


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
        at, thread_length, reached = self.braid.reach(length, pressure)
        radius = diameter_from_length(at, thread_length, self.braid.turns) / 2
        angle = braid_angle_from_length(at, thread_length)
        return cylinder_dimensions(
            at, radius, angle, thread_length, self.braid, self.bladder, reached
        )

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

    def parameters(self) -> dict[str, RealArray]:
        """Braid diameter and angle at rest, unloaded, then those of braid and bladder."""
        rest, thread = self.rest_length, self.braid.rest_thread_length
        natural = {
            "braid_diameter": diameter_from_length(rest, thread, self.braid.turns),
            "braid_angle": braid_angle_from_length(rest, thread),
        }
        others = super().parameters()
        return natural | {name: others[name] for name in others if name not in self._replaced}

    def declared(self) -> dict[str, Declared]:
        """The declarations of the same: diameter and angle in place of thread length and turns."""
        others = super().declared()
        return _AT_REST | {name: others[name] for name in others if name not in self._replaced}

    def with_parameters(self, values: Mapping[str, Real]) -> "EstimatedGeometry":
        """The geometry with other values of some parameters.

        A changed rest length keeps diameter and angle, so that thread length and turns change with
        it. The mid-wall diameter of an embedded bladder goes with the braid's.

        Raises:
            ValueError: an unknown name, or a value that is an array.
        """
        given = checked_values(self, values)
        others = {name: value for name, value in given.items() if name not in _AT_REST}
        changed = super().with_parameters(others)
        if not given.keys() & {*_AT_REST, "rest_length"}:
            return changed
        old = self.parameters()
        diameter, angle, rest = (
            given.get(name, old[name]) for name in ("braid_diameter", "braid_angle", "rest_length")
        )
        thread, turns = (
            thread_length_from_angle(rest, angle),
            turns_from_angle(rest, diameter, angle),
        )
        changed = eqx.tree_at(
            lambda g: (g.braid.rest_thread_length, g.braid.turns), changed, (thread, turns)
        )
        if not self.bladder.embedded:
            return changed
        wall = self.bladder.rest_diameter + (diameter - old["braid_diameter"])
        return eqx.tree_at(lambda g: g.bladder.rest_diameter, changed, wall)

    @property
    def _replaced(self) -> tuple[str, ...]:
        """Parameters of braid and bladder that diameter and angle at rest stand for."""
        fields = ("rest_thread_length", "turns")
        return (*fields, "bladder_diameter") if self.bladder.embedded else fields


_AT_REST = {
    "braid_diameter": Declared("m", "braid_diameter", "length", 3e-3, 80e-3),
    "braid_angle": Declared("rad", "braid_angle", "angle", math.radians(45), math.radians(80)),
}

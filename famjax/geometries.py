"""Dimensions of a muscle at a length and pressure, and the geometries that compute them."""

import abc
import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_real, compiled_method
from .braids import (
    NEUTRAL_ANGLE,
    AbstractBraid,
    braid_angle_from_length,
    diameter_from_length,
    thread_length_from_angle,
    turns_from_angle,
)
from .parameters import Declared, Parametrised, checked_values, parameter
from .profiles import tondu_lopez_length


class Dimensions(eqx.Module):
    """Dimensions of a muscle at one length and pressure, for use in the force balance.

    Attributes:
        length: L [m].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference.
        turns: N [-].
        thickness: wall thickness t [m] of the bladder.
        axial_strain: eps_z [-].
        hoop_strain: eps_c [-] at stations along the axis, shape (..., stations).
        station_weights: quadrature weights of the stations, shape (stations,); they sum to 1. The axial
            mean of a function f of the hoop strain is sum(weights * f(eps_c)).
        bladder_volume: volume V [m3] of the rubber.
        volume: volume [m3] within the braid's outline.
        thread_length: B [m] of the loaded threads; None if the geometry does not provide it.
        rates: derivatives of all fields with respect to length at constant pressure, or None.
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
        """True where the muscle can reach the state: every dimension is finite."""
        along = jnp.all(jnp.isfinite(self.hoop_strain), axis=-1)
        for one in (self.length, self.radius, self.braid_angle, self.thickness, self.axial_strain):
            along &= jnp.isfinite(one)
        return along & jnp.isfinite(self.volume)

    def where(self, reached: Bool[Array, "..."]) -> "Dimensions":
        """Replace the dimensions of impossible states with finite placeholders.

        The caller must replace the results for these states with nan. In reverse mode, a nan dimension
        would contaminate the derivatives of all other states with respect to shared parameters.
        """
        rates = None if self.rates is None else self.rates.where(reached)
        filled = self._filled(reached, 1.0, 2.0)  # a thread is longer than the muscle
        return dataclasses.replace(filled, length=jnp.where(reached, self.length, 1.0), rates=rates)

    def unless(self, reached: Bool[Array, "..."]) -> "Dimensions":
        """Replace the dimensions of impossible states with nan."""
        return self._filled(reached, jnp.nan, jnp.nan)

    def _filled(self, reached: Bool[Array, "..."], other: float, long: float) -> "Dimensions":
        names = ("radius", "braid_angle", "thickness", "axial_strain", "volume")
        kept = {name: jnp.where(reached, getattr(self, name), other) for name in names}
        kept["hoop_strain"] = jnp.where(reached[..., None], self.hoop_strain, other)
        if self.thread_length is not None:
            kept["thread_length"] = jnp.where(reached, self.thread_length, long)
        return dataclasses.replace(self, **kept)


class AbstractGeometry(Parametrised):
    """Base class of all geometries, which compute `Dimensions`."""

    @abc.abstractmethod
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Return the dimensions at active length L [m] and gauge pressure P [Pa]; arguments broadcast.

        The dimensions of impossible states are nan. `keeps_apart` states whether their derivatives are
        finite, so that they do not contaminate the derivatives of other states in a batch.
        """

    @property
    def keeps_apart(self) -> bool:
        """True if impossible states do not affect the derivatives of other states; see `dimensions`.

        If False, a muscle evaluates the dimensions twice; in the second evaluation, it replaces
        impossible lengths with the rest length.
        """
        return False

    def dimensions_with_rates(self, length: Real, pressure: Real) -> Dimensions:
        """Return the dimensions with `rates`, their derivatives with respect to length at constant P."""
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        at, rates = jax.jvp(
            lambda lengths: self.dimensions(lengths, pressures),
            (lengths,),
            (jnp.ones_like(lengths),),
        )
        return dataclasses.replace(at, rates=rates)

    @abc.abstractmethod
    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] for the equilibrium search."""

    @property
    @abc.abstractmethod
    def rest_length(self) -> RealArray:
        """Rest length L0 [m]: active length at zero contraction."""

    def inner_volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3]: the volume within the braid minus the rubber inside it at rest.

        The rubber inside the braid is treated as constant, so V changes as virtual work requires.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            V [m3], with the broadcast shape; nan at impossible states.
        """
        at = self.dimensions(length, pressure)
        return at.volume - self.rubber_within_braid(at)

    def rubber_within_braid(self, at: Dimensions) -> RealArray:
        """Return the volume [m3] of the rubber inside the braid; without `bladder`, that of all rubber."""
        bladder = getattr(self, "bladder", None)
        return at.bladder_volume if bladder is None else bladder.volume_within_braid

    def braid_limits(self) -> tuple[RealArray, RealArray]:
        """Return the lengths [m] at which the unloaded braid locks and at which its threads are straight.

        The braid locks at the neutral angle, where pressure cannot shorten it further. Once the threads
        are straight, only thread stretch can lengthen the braid.

        Returns:
            (lock, straight) [m]; nan for a geometry without `braid`.

        References:
            Chambers 2021, section 2.1: the neutral angle, 35.26 deg from the circumference.
        """
        braid = getattr(self, "braid", None)
        if braid is None:
            return jnp.full((), jnp.nan), jnp.full((), jnp.nan)
        thread = braid.rest_thread_length
        return thread * math.sin(NEUTRAL_ANGLE), thread

    def cut_to_length(self, rest_length: RealArray) -> "AbstractGeometry":  # noqa: ARG002
        """Return the same construction with another rest length [m]; see `famjax.cut_to_length`.

        Raises:
            ValueError: the shape is valid for only one length.
        """
        raise ValueError(
            f"a {type(self).__name__} cannot be cut to another length: a measured or assumed shape is "
            "valid for only one length. If this is your own class, define cut_to_length(rest_length) in it"
        )


def bladder_thickness(length: Real, outer_radius: Real, bladder_volume: Real) -> RealArray:
    """Return the wall thickness t [m] of an incompressible tube, t = R - sqrt(R^2 - V / (pi L)).

    Args:
        length: L [m], > 0.
        outer_radius: outer radius R [m] of the bladder.
        bladder_volume: volume V [m3] of the rubber, constant.

    Returns:
        t [m], with the broadcast shape; nan where the rubber does not fit within the radius.

    References:
        Chambers 2021, section 6.1.
    """
    section = bladder_volume / (jnp.pi * length)
    return jnp.asarray(section / (outer_radius + jnp.sqrt(outer_radius**2 - section)))


class Bladder(Parametrised):
    """An incompressible rubber tube.

    Attributes:
        rest_length: L0 [m], active length at which the axial strain is zero.
        rest_diameter: outer diameter at rest [m]; mid-wall diameter if `embedded`.
        rest_thickness: wall thickness t0 [m] at rest.
        embedded: True if the threads run inside the wall, so the braid radius is the mid-wall radius;
            False if the bladder lies under the braid.
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
    def volume_within_braid(self) -> RealArray:
        """Volume [m3] of the rubber inside the braid at rest: the inner half of an `embedded` wall."""
        if not self.embedded:
            return self.volume
        t = self.rest_thickness
        return jnp.pi * t * (self.rest_mid_radius - t / 4) * self.rest_length

    @property
    def smallest_braid_radius(self) -> RealArray:
        """Braid radius [m], excluding the braid's thickness, at which the bore closes at L0."""
        solid_radius = jnp.sqrt(self.volume / (jnp.pi * self.rest_length))
        return solid_radius / 2 if self.embedded else solid_radius

    def fits(self, length: Real, radius: Real) -> Bool[Array, "..."]:
        """Return True where the rubber fits within a length [m] and radius [m]; see `thickness`."""
        positive = (jnp.asarray(length) > 0) & (radius > 0)
        if self.embedded:
            return positive
        section = self.volume / (jnp.pi * jnp.where(positive, length, self.rest_length))
        return positive & (jnp.square(radius) >= section)

    def thickness(self, length: Real, radius: Real) -> RealArray:
        """Return the wall thickness t [m] at constant volume.

        Args:
            length: L [m].
            radius: outer radius [m] of the bladder; mid-wall radius if `embedded`.

        Returns:
            t [m], with the broadcast shape.
        """
        if self.embedded:
            return jnp.asarray(self.volume / (2 * jnp.pi * radius * length))
        return bladder_thickness(length, radius, self.volume)

    def axial_strain(self, length: Real) -> RealArray:
        """Return the axial engineering strain eps_z [-], L / L0 - 1; negative if shortened."""
        return jnp.asarray(length / self.rest_length - 1)

    def hoop_strain(self, length: Real, radius: Real) -> RealArray:
        """Return the hoop engineering strain eps_c [-] at mid-wall, R_mid / R_mid0 - 1.

        Args:
            length: L [m].
            radius: outer radius [m] of the bladder; mid-wall radius if `embedded`.

        Returns:
            eps_c [-], with the broadcast shape.

        References:
            Chambers 2021, section 6.1.
        """
        mid_radius = radius if self.embedded else radius - self.thickness(length, radius) / 2
        return jnp.asarray(mid_radius / self.rest_mid_radius - 1)


_BELOW_NEUTRAL = 0.95  # a limp bladder's force is zero at the neutral length and negative below it


def cylinder_dimensions(
    length: RealArray,
    radius: RealArray,
    braid_angle: RealArray,
    thread_length: RealArray,
    braid: AbstractBraid,
    bladder: Bladder,
    reached: Bool[Array, "..."],
) -> Dimensions:
    """Return the dimensions of a cylinder with braid radius R [m] and angle theta [rad].

    Args:
        length: L [m]. Length, radius, angle and thread length must be finite and have the same shape.
        radius: braid radius R [m].
        braid_angle: theta [rad].
        thread_length: B [m].
        braid: braid of the muscle.
        bladder: bladder of the muscle.
        reached: mask of the states that the braid can reach; all other states are ignored.

    Returns:
        The dimensions; nan where `reached` is False or the rubber does not fit in the braid.
    """
    bladder_radius = radius if bladder.embedded else radius - braid.thickness
    reached = reached & bladder.fits(length, bladder_radius)
    rest = bladder.rest_length, bladder.rest_diameter / 2
    rest_length, rest_radius = jax.lax.stop_gradient(rest)
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
        volume=jnp.pi * radius**2 * length,
        thread_length=thread_length,
    ).unless(reached)


class EstimatedGeometry(AbstractGeometry):
    """The estimated geometry: a cylinder whose diameter follows from the braid.

    Attributes:
        braid: braid around the bladder.
        bladder: rubber tube under, or embedded in, the braid.

    References:
        Chambers 2021, chapter 6, "cylindrical approximation".
    """

    braid: AbstractBraid
    bladder: Bladder

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Return the dimensions at active length L [m] and gauge pressure P [Pa]; arguments broadcast."""
        at, thread_length, reached = self.braid.reach(length, pressure)
        radius = diameter_from_length(at, thread_length, self.braid.turns) / 2
        angle = braid_angle_from_length(at, thread_length)
        return cylinder_dimensions(
            at, radius, angle, thread_length, self.braid, self.bladder, reached
        )

    @property
    def keeps_apart(self) -> bool:
        """Always True, because impossible states are masked before any computation."""
        return True

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the length range [m], from just below the neutral length to the length at bore closure."""
        inset = 0.0 if self.bladder.embedded else self.braid.thickness
        smallest = 2 * (self.bladder.smallest_braid_radius + inset)
        closed = jnp.pi * self.braid.turns * smallest
        thread = self.braid.rest_thread_length
        shortest = _BELOW_NEUTRAL * thread * math.sin(NEUTRAL_ANGLE)
        return shortest, jnp.sqrt((thread - closed) * (thread + closed))

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the bladder."""
        return self.bladder.rest_length

    def cut_to_length(self, rest_length: RealArray) -> "EstimatedGeometry":
        """Return the same braid and bladder with another rest length; B0 and N scale with L0."""
        new = eqx.error_if(rest_length, jnp.any(rest_length <= 0), "the rest length must be > 0")
        ratio = new / self.bladder.rest_length
        longer = eqx.tree_at(
            lambda b: (b.rest_thread_length, b.turns),
            self.braid,
            (self.braid.rest_thread_length * ratio, self.braid.turns * ratio),
        )
        return EstimatedGeometry(longer, dataclasses.replace(self.bladder, rest_length=new))

    def parameters(self) -> dict[str, RealArray]:
        """Return the diameter and angle of the unloaded braid at rest, then the other parameters."""
        rest, thread = self.rest_length, self.braid.rest_thread_length
        natural = {
            "braid_diameter": diameter_from_length(rest, thread, self.braid.turns),
            "braid_angle": braid_angle_from_length(rest, thread),
        }
        others = super().parameters()
        return natural | {name: others[name] for name in others if name not in self._replaced}

    def declared(self) -> dict[str, Declared]:
        """Return the declarations, with diameter and angle in place of thread length and turns."""
        others = super().declared()
        return _AT_REST | {name: others[name] for name in others if name not in self._replaced}

    def with_parameters(self, values: Mapping[str, Real]) -> "EstimatedGeometry":
        """Return the geometry with new values for some parameters.

        If the rest length changes, the braid's diameter and angle at rest stay the same, and its thread
        length and turns change. The mid-wall diameter of an embedded bladder follows the braid diameter.

        Raises:
            ValueError: a name is unknown, or a value is an array.
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
        changed = eqx.tree_at(
            lambda g: (g.braid.rest_thread_length, g.braid.turns),
            changed,
            (thread_length_from_angle(rest, angle), turns_from_angle(rest, diameter, angle)),
        )
        if not self.bladder.embedded:
            return changed
        wall = self.bladder.rest_diameter + (diameter - old["braid_diameter"])
        return eqx.tree_at(lambda g: g.bladder.rest_diameter, changed, wall)

    @property
    def _replaced(self) -> tuple[str, ...]:
        """Parameters of braid and bladder that are replaced by diameter and angle at rest."""
        fields = ("rest_thread_length", "turns")
        return (*fields, "bladder_diameter") if self.bladder.embedded else fields


_AT_REST = {
    "braid_diameter": Declared("m", "braid_diameter", "length", 3e-3, 80e-3),
    "braid_angle": Declared("rad", "braid_angle", "angle", math.radians(45), math.radians(80)),
}


_LARGEST_FACTOR = 1.4


class EndEffectGeometry(AbstractGeometry):
    """A geometry with rounded ends, which are part of the length but do not contract.

    The cylinder between them is evaluated at the length L0 (1 - k eps). This is equivalent to a dead length
    l = L0 (1 - 1/k) at the ends; the strains in the remaining length are k times as large. The dimension
    `volume` is that of a cylinder with the shortened length,
    without the ends. The volume of the whole muscle changes by only 1/k of that amount.

    Attributes:
        cylinder: geometry of the part that contracts, with the rest length of the whole muscle.
        end_factor: k [-], 1 for a cylinder, above 1 for rounded ends.

    References:
        Tondu & Lopez 2000.
    """

    cylinder: AbstractGeometry
    end_factor: Float[Given, "..."] = parameter(low=1.0, high=_LARGEST_FACTOR)

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Return the cylinder's dimensions at active length L [m] and gauge pressure P [Pa]."""
        positive = as_real(length) > 0
        at = jnp.where(positive, length, jax.lax.stop_gradient(self.rest_length))
        shortened = tondu_lopez_length(at, self.rest_length, self.end_factor)
        return self.cylinder.dimensions(shortened, pressure).unless(positive)

    @property
    def keeps_apart(self) -> bool:
        """True if `keeps_apart` is true for the cylinder."""
        return self.cylinder.keeps_apart

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m], converted from those of the cylinder."""
        shortest, longest = (
            tondu_lopez_length(end, self.rest_length, 1 / self.end_factor)
            for end in self.cylinder.length_range()
        )
        return shortest, longest

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the cylinder."""
        return self.cylinder.rest_length

    def inner_volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3], V_c(L0) + (V_c(L) - V_c(L0))/k; V_c is the cylinder's volume.

        The derivative of V with respect to the muscle's length then equals that of V_c with respect to the
        cylinder's length, as virtual work requires. At rest, the ends are counted as part of the cylinder.
        """
        found = self.dimensions(length, pressure)
        reached = found.reached
        at, rest = found.where(reached), self.cylinder.dimensions(self.rest_length, jnp.zeros(()))
        volume = rest.volume + (at.volume - rest.volume) / self.end_factor
        return jnp.where(reached, volume - self.cylinder.rubber_within_braid(at), jnp.nan)

    def braid_limits(self) -> tuple[RealArray, RealArray]:
        """Return the limits [m], converted from those of the cylinder; rounded ends shift both."""
        rest = self.rest_length
        lock, straight = self.cylinder.braid_limits()
        return rest + (lock - rest) / self.end_factor, rest + (straight - rest) / self.end_factor

    def cut_to_length(self, rest_length: RealArray) -> "EndEffectGeometry":
        """Return the same ends on a cylinder with another length, keeping the dead length L0 (1 - 1/k)."""
        dead = self.rest_length * (1 - 1 / self.end_factor)
        new = eqx.error_if(
            rest_length,
            jnp.any(rest_length <= dead),
            "the rest length must exceed the dead length of the ends",
        )
        return EndEffectGeometry(self.cylinder.cut_to_length(new), new / (new - dead))

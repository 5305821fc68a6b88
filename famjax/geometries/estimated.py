"""A cylinder in its braid: the geometry that is estimated from the braid alone."""

import dataclasses
import math
from collections.abc import Mapping

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool

from .._compiled import compiled_method
from .._types import Real, RealArray
from ..braids.inextensible import (
    NEUTRAL_ANGLE,
    AbstractBraid,
    braid_angle_from_length,
    diameter_from_length,
    thread_length_from_angle,
    turns_from_angle,
)
from ..parameters import Declared
from ..parameters.parametrised import checked_values
from .bladder import Bladder, cylinder_volume
from .dimensions import AbstractGeometry, Dimensions

_BELOW_NEUTRAL = 0.95  # at the neutral length itself a limp bladder's force is zero, not negative


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

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape."""
        at, thread_length, reached = self.braid.reach(length, pressure)
        radius = diameter_from_length(at, thread_length, self.braid.turns) / 2
        angle = braid_angle_from_length(at, thread_length)
        return cylinder_dimensions(
            at, radius, angle, thread_length, self.braid, self.bladder, reached
        )

    @property
    def keeps_apart(self) -> bool:
        """States that cannot be are masked before anything is computed of them."""
        return True

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

    def cut_to_length(self, rest_length: RealArray) -> "EstimatedGeometry":
        """The same braid and bladder, longer or shorter: B0 and N are proportional to L0."""
        new = eqx.error_if(
            rest_length, jnp.any(rest_length <= 0), "the rest length must be above 0"
        )
        ratio = new / self.bladder.rest_length
        longer = eqx.tree_at(
            lambda b: (b.rest_thread_length, b.turns),
            self.braid,
            (self.braid.rest_thread_length * ratio, self.braid.turns * ratio),
        )
        return EstimatedGeometry(longer, dataclasses.replace(self.bladder, rest_length=new))

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

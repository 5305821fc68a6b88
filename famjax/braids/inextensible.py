"""The helical braid of inextensible threads: the triangle relation and its inverses.

One thread, unrolled, is the hypotenuse of a right triangle: L = B sin(theta) along the axis and
pi N D = B cos(theta) around it. `theta` is measured from the circumference.
"""

import abc
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import Parametrised, number, parameter

NEUTRAL_ANGLE = math.atan(math.sqrt(0.5))
"""Braid angle [rad] at which the force magnification 2 tan(theta)^2 - 1 is zero: 35.26 deg."""

_RIGHT_ANGLE = math.pi / 2 * (1 + 1e-6)  # pi/2 in float32 is larger


def thread_length_from_angle(length: Real, braid_angle: Real) -> RealArray:
    """Thread length B [m], B = L / sin(theta).

    Args:
        length: active length L [m], > 0.
        braid_angle: theta [rad], from the circumference, in (0, pi/2].

    Returns:
        B [m], broadcast shape.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.

    >>> round(float(thread_length_from_angle(3.0, NEUTRAL_ANGLE)), 4)
    5.1962
    """
    return jnp.asarray(length / jnp.sin(braid_angle))


def turns_from_angle(length: Real, diameter: Real, braid_angle: Real) -> RealArray:
    """Turns N [-] of one thread about the axis, N = L / (pi D tan(theta)).

    Args:
        length: active length L [m], > 0.
        diameter: braid diameter D [m] at that length, > 0.
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        N [-], a float, broadcast shape.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    return jnp.asarray(length / (jnp.pi * diameter * jnp.tan(braid_angle)))


def diameter_from_length(length: Real, thread_length: Real, turns: Real) -> RealArray:
    """Braid diameter D [m], D = sqrt(B^2 - L^2) / (pi N).

    Args:
        length: active length L [m], 0 < L < B.
        thread_length: B [m].
        turns: N [-], > 0.

    Returns:
        D [m], broadcast shape; nan where L > B, which no braid can reach.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.sqrt(squared) / (jnp.pi * turns)


def length_from_diameter(diameter: Real, thread_length: Real, turns: Real) -> RealArray:
    """Active length L [m], L = sqrt(B^2 - (pi N D)^2): the inverse of `diameter_from_length`.

    Args:
        diameter: braid diameter D [m], 0 <= D < B / (pi N).
        thread_length: B [m].
        turns: N [-], > 0.

    Returns:
        L [m], broadcast shape; nan where pi N D > B.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    around = jnp.pi * turns * diameter
    return jnp.sqrt(jnp.asarray((thread_length - around) * (thread_length + around)))


def braid_angle_from_length(length: Real, thread_length: Real) -> RealArray:
    """Braid angle theta [rad], theta = asin(L / B), written with atan2 to be exact near pi/2.

    Args:
        length: active length L [m], 0 < L < B.
        thread_length: B [m].

    Returns:
        theta [rad], from the circumference, broadcast shape; nan where L > B.

    References:
        Gaylord 1958; Chambers 2021, section 5.1.
    """
    squared = jnp.asarray((thread_length - length) * (thread_length + length))
    return jnp.arctan2(length, jnp.sqrt(squared))


def braid_angle_from_diameter(diameter: Real, known_diameter: Real, known_angle: Real) -> RealArray:
    """Braid angle theta [rad] at another diameter of the same braid: cos(theta) / D is constant.

    Args:
        diameter: D [m] where the angle is wanted, >= 0.
        known_diameter: D1 [m], > 0.
        known_angle: theta1 [rad] at D1, from the circumference.

    Returns:
        theta [rad], broadcast shape; nan where D exceeds D1 / cos(theta1) (threads all round).

    References:
        Chambers 2021, section 2.2.
    """
    return jnp.arccos(jnp.cos(known_angle) * diameter / known_diameter)


class AbstractBraid(Parametrised):
    """A braid whose threads have some length under load."""

    rest_thread_length: eqx.AbstractVar[RealArray]
    turns: eqx.AbstractVar[RealArray]
    thickness: eqx.AbstractVar[RealArray]

    @abc.abstractmethod
    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B [m] at active length L [m] and gauge pressure P [Pa], broadcast shape."""

    def reach(
        self, length: Real, pressure: Real
    ) -> tuple[RealArray, RealArray, Bool[Array, "..."]]:
        """Length and thread length where there is a triangle of the two, and where there is.

        Args:
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            (L, B, reached), of broadcast shape: where 0 < L < B does not hold, L and B are those of
            a triangle that has nothing to do with the state, so that no nan spoils the derivatives
            of other states. What is made of them there is to be replaced by nan.
        """
        lengths, pressures = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        unloaded = jax.lax.stop_gradient(self.rest_thread_length)
        aside = unloaded / 2
        found = self.thread_length(jnp.where(lengths > 0, lengths, aside), pressures)
        reached = (lengths > 0) & (lengths < found)
        return (
            jnp.where(reached, lengths, aside),
            jnp.where(reached, found, unloaded),
            reached,
        )


class Braid(AbstractBraid):
    """A braid of inextensible threads.

    Attributes:
        rest_thread_length: B0 [m], one thread from fitting to fitting.
        turns: N [-], turns of one thread about the axis, a float.
        thickness: t_braid [m], two threads crossing; the bladder lies below it.
    """

    rest_thread_length: Float[Given, "..."] = parameter("m", low=0.0)
    turns: Float[Given, "..."] = parameter(low=0.0)
    thickness: Float[Given, "..."] = number("m", default=0.0)

    @classmethod
    def from_rest(
        cls, *, diameter: Real, braid_angle: Real, length: Real, thickness: Real = 0.0
    ) -> "Braid":
        """The braid that has this diameter and angle at this length.

        Args:
            diameter: D0 [m], braid diameter at rest.
            braid_angle: theta0 [rad], from the circumference, in (0, pi/2].
            length: L0 [m], active length at rest.
            thickness: t_braid [m].

        Returns:
            The braid with B = L0 / sin(theta0) and N = L0 / (pi D0 tan(theta0)).

        Raises:
            ValueError: the angle is out of its range, and not traced; degrees are.

        >>> braid = Braid.from_rest(diameter=0.02, braid_angle=1.1, length=0.3)
        >>> print(f"{braid.diameter(0.3):.4f} {braid.braid_angle(0.3):.4f}")
        0.0200 1.1000
        """
        if not isinstance(braid_angle, Tracer):
            angle = np.asarray(braid_angle, float)
            wrong = angle[(angle <= 0) | (angle > _RIGHT_ANGLE)]
            if wrong.size:
                raise ValueError(
                    f"braid_angle must lie in (0, pi/2] rad, got {wrong[0]:.6g}; an angle in degrees is "
                    "given as jnp.deg2rad(61.7)"
                )
        return cls(
            rest_thread_length=thread_length_from_angle(length, braid_angle),
            turns=turns_from_angle(length, diameter, braid_angle),
            thickness=as_real(thickness),
        )

    def thread_length(self, length: Real, pressure: Real) -> RealArray:
        """Thread length B0 [m], whatever the load, in the broadcast shape of the arguments."""
        shape = jnp.broadcast_shapes(jnp.shape(length), jnp.shape(pressure))
        return jnp.broadcast_to(self.rest_thread_length, shape)

    def diameter(self, length: Real) -> RealArray:
        """Braid diameter D [m] at active length L [m]; see `diameter_from_length`."""
        return diameter_from_length(length, self.rest_thread_length, self.turns)

    def braid_angle(self, length: Real) -> RealArray:
        """Braid angle theta [rad] at active length L [m]; see `braid_angle_from_length`."""
        return braid_angle_from_length(length, self.rest_thread_length)

    @property
    def neutral_length(self) -> RealArray:
        """Active length [m] at the neutral angle, B / sqrt(3): no braid pulls when shorter."""
        return self.rest_thread_length * math.sin(NEUTRAL_ANGLE)

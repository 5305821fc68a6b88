"""Friction of the braid: the part of the pull that depends on the direction of motion.

A velocity is positive when the muscle lengthens. Friction then raises the pull, and lowers it when
the muscle shortens: F_ecc = F_mean + F_fr, F_con = F_mean - F_fr.
"""

import abc

import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..geometries.dimensions import Dimensions
from ..parameters import Parametrised, number, parameter
from .abstract_term import AbstractForceTerm


def smooth_sign(velocity: Real, reference_velocity: Real) -> RealArray:
    """Direction of motion in [-1, 1], tanh(v / v_ref): the sign, without its jump at rest.

    Args:
        velocity: dL/dt [m/s], positive when the muscle lengthens.
        reference_velocity: v_ref [m/s], > 0; at three times this the sign is 0.995.

    Returns:
        Direction [-], broadcast shape.
    """
    return jnp.tanh(as_real(velocity) / reference_velocity)


def thread_contact_area(rest_area: Real, rest_braid_angle: Real, braid_angle: Real) -> RealArray:
    """Area S [m2] in which threads touch threads, S = S0 sin(2 theta0) / sin(2 theta).

    Threads of constant width cross in rhombi, whose number stays and whose area goes with
    1 / sin(2 theta): smallest at 45 deg. The threads are taken as flat ribbons that do not jam.

    Args:
        rest_area: S0 [m2] at rest; 2 pi R0 L0 for a braid that covers the bladder.
        rest_braid_angle: theta0 [rad], in (0, pi/2); the angle to the axis does as well.
        braid_angle: theta [rad], measured alike.

    Returns:
        S [m2], broadcast shape.

    References:
        Tondu & Lopez 2000, IEEE Control Systems Magazine 20(2); see `ThreadFriction`.
    """
    return jnp.asarray(rest_area * jnp.sin(2 * rest_braid_angle) / jnp.sin(2 * braid_angle))


def crossing_area(n_threads: Real, turns: Real, thread_width: Real, braid_angle: Real) -> RealArray:
    """Area S [m2] in which threads touch threads, n^2 N / 2 crossings of w^2 / sin(2 theta) each.

    Two families of n/2 threads; each thread meets each of the other family 2 N times.

    Args:
        n_threads: n [-], both families.
        turns: N [-].
        thread_width: w [m] of a thread as it lies, flattened, in the braid.
        braid_angle: theta [rad], from the circumference, in (0, pi/2).

    Returns:
        S [m2], broadcast shape; the lateral surface pi D L where the threads lie side by side.

    >>> import math
    >>> D, L, n, theta = 0.02, 0.3, 48, 1.1
    >>> turns = L / (math.pi * D * math.tan(theta))
    >>> side_by_side = 2 * math.pi * D * math.sin(theta) / n
    >>> print(f"{crossing_area(n, turns, side_by_side, theta) / (math.pi * D * L):.4f}")
    1.0000
    """
    crossings = n_threads**2 * turns / 2
    return jnp.asarray(crossings * thread_width**2 / jnp.sin(2 * braid_angle))


class AbstractFriction(Parametrised):
    """A friction term: an amplitude that the direction of motion multiplies."""

    @abc.abstractmethod
    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, half the width of the loop, broadcast shape.

        Args:
            at: dimensions of the muscle; ignored by terms that do not depend on them.
            pressure: gauge pressure P [Pa].
        """

    def force(self, at: Dimensions, pressure: Real, direction: Real) -> RealArray:
        """Friction's part of the pull F_fr [N], broadcast shape; positive when lengthening.

        Args:
            at: dimensions of the muscle, `geometry.dimensions(length, pressure)`.
            pressure: gauge pressure P [Pa].
            direction: in [-1, 1], 1 when the muscle lengthens; `smooth_sign` of a velocity.
        """
        return jnp.asarray(direction * self.amplitude(at, pressure))


class ThreadFriction(AbstractFriction):
    """Dry friction of thread on thread, F_fr = f_s S P, S by `thread_contact_area`.

    The coefficient is constant. Tondu and Lopez let it fall with speed from a static to a kinetic
    value; in quasi-static motion only one of the two acts.

    Attributes:
        coefficient: f_s [-], >= 0.
        rest_area: S0 [m2], contact area at rest; 2 pi R0 L0 for a braid that covers the bladder.
            Only f_s S0 can be identified from a force.
        rest_braid_angle: theta0 [rad].

    References:
        Tondu & Lopez 2000, IEEE Control Systems Magazine 20(2). The form was taken from general
        knowledge and agrees with public code that follows them; to be checked against the
        original before it is cited.
    """

    coefficient: Float[Given, "..."] = parameter(low=0.0, linear=True, name="friction_coefficient")
    rest_area: Float[Given, "..."] = number("m2")
    rest_braid_angle: Float[Given, "..."] = number("rad")

    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, f_s S(theta) P, broadcast shape."""
        area = thread_contact_area(self.rest_area, self.rest_braid_angle, at.braid_angle)
        return self.coefficient * area * pressure


class PressureFriction(AbstractFriction):
    """Friction of a constant plus a part that grows with pressure, F_fr = c0 + c1 P.

    Attributes:
        constant: c0 [N].
        per_pressure: c1 [m2], force per pressure.
    """

    constant: Float[Given, "..."] = parameter("N", linear=True, name="friction_constant")
    per_pressure: Float[Given, "..."] = parameter("m2", linear=True, name="friction_per_pressure")

    def amplitude(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction [N] of full sliding, c0 + c1 P, broadcast shape."""
        shape = jnp.broadcast_shapes(jnp.shape(at.length), jnp.shape(pressure))
        return jnp.broadcast_to(self.constant + self.per_pressure * pressure, shape)


class Friction(AbstractForceTerm):
    """Friction's part of the pull while the muscle moves: the amplitude of a law times a direction.

    Attributes:
        law: its amplitude, such as a `ThreadFriction` or a `PressureFriction`.
        direction: in [-1, 1], 1 when the muscle lengthens, -1 when it shortens; `smooth_sign` of a
            velocity.

    >>> import famjax
    >>> shortening = Friction(famjax.terms.PressureFriction(8.0, 6e-5), -1.0)
    """

    law: AbstractFriction
    direction: Float[Given, "..."] = number()

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """Friction's part of the pull [N], broadcast shape; positive when lengthening."""
        return self.law.force(at, pressure, self.direction)

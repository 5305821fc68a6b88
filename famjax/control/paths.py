"""The path of a muscle over a joint: its length, and by its derivative the moment arm."""

import abc

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_number, as_real


class AbstractPath(eqx.Module):
    """Length of a muscle over the angle of a joint.

    A path of your own is a class with `length`. The moment arm follows by automatic differentiation:
    dL/dt = -r d(angle)/dt, so that the torque of a pull F is r F by virtual work.
    """

    @abc.abstractmethod
    def length(self, angle: Real) -> RealArray:
        """Active length L [m] of the muscle at an angle [rad] of the joint, of the angle's shape."""

    def moment_arm(self, angle: Real) -> RealArray:
        """Moment arm r = -dL/d(angle) [m], of the angle's shape; positive where a pull raises it."""
        angles = as_real(angle)
        return -jax.jvp(self.length, (angles,), (jnp.ones_like(angles),))[1]


class Pulley(AbstractPath):
    """A muscle whose cable runs over a pulley on the joint: L = L_0 - r angle.

    Attributes:
        radius: r [m], the moment arm: positive for a muscle that raises the angle, negative for its
            antagonist.
        middle_length: L_0 [m], active length of the muscle at angle 0.

    >>> Pulley(0.02, 0.28).length(0.5)
    Array(0.27, dtype=float64)
    """

    radius: Float[Given, ""] = eqx.field(converter=as_number)
    middle_length: Float[Given, ""] = eqx.field(converter=as_number)

    def length(self, angle: Real) -> RealArray:
        """L_0 - r angle [m], of the angle's shape."""
        return self.middle_length - self.radius * as_real(angle)


class Lever(AbstractPath):
    """A muscle between two pins, on the base and on a link that turns about the joint.

    L = |R(angle) a - b| - l: the moment arm is the distance of the line through the pins from the
    joint, and vanishes at the dead centres, where they and the joint lie on one line.

    Attributes:
        link_pin: a [m], on the link, from the joint, at angle 0, shape (2,).
        base_pin: b [m], on the base, from the joint, shape (2,).
        dead_length: l [m], what of the distance is end-fittings, rods and cable, >= 0.
    """

    link_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    base_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    dead_length: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)

    def length(self, angle: Real) -> RealArray:
        """Distance of the pins less the dead length [m], of the angle's shape."""
        turned = as_real(angle)
        x, y = self.link_pin
        cos, sin = jnp.cos(turned), jnp.sin(turned)
        across = cos * x - sin * y - self.base_pin[0]
        along = sin * x + cos * y - self.base_pin[1]
        return jnp.hypot(across, along) - self.dead_length

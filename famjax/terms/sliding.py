"""Friction as a force term, in a given direction of motion."""

from jaxtyping import Float

from .._types import Given, Real, RealArray
from ..geometries.estimated import Dimensions
from ..parameters import number
from .abstract import AbstractForceTerm
from .friction import AbstractFriction


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

"""A spring beside the muscle, as of a mounting."""

import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray
from ..geometries.dimensions import Dimensions
from ..parameters import parameter
from .abstract_term import AbstractForceTerm


class Spring(AbstractForceTerm):
    """A linear spring parallel to the muscle, F = F_0 + k (L - L_s).

    Attributes:
        stiffness: k [N/m], >= 0; a stretched spring pulls with the muscle.
        rest_length: L_s [m], active length of the muscle at which the spring pulls with F_0 only.
            Only F_0 - k L_s can be identified from a force.
        preload: F_0 [N].
    """

    stiffness: Float[Given, "..."] = parameter("N/m", low=0.0)
    rest_length: Float[Given, "..."] = parameter("m", low=0.0, name="spring_length")
    preload: Float[Given, "..."] = parameter("N", linear=True, name="spring_preload", default=0.0)

    def force(self, at: Dimensions, pressure: Real) -> RealArray:
        """The spring's pull [N], broadcast shape; negative where it is compressed."""
        shape = jnp.broadcast_shapes(jnp.shape(at.length), jnp.shape(pressure))
        pull = self.preload + self.stiffness * (at.length - self.rest_length)
        return jnp.broadcast_to(pull, shape)

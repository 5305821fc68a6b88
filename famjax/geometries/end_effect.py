"""A cylinder that stands for a muscle with rounded ends: Tondu & Lopez's factor on contraction."""

import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import parameter
from ..profiles.assumed_shapes import tondu_lopez_length
from .dimensions import AbstractGeometry, Dimensions

_LARGEST_FACTOR = 1.4


class EndEffectGeometry(AbstractGeometry):
    """Another geometry, taken at the length L0 (1 - k eps): the ends shorten but do not pull.

    The same as a dead length l = L0 (1 - 1/k) at the ends, which does not take part in the
    contraction: the strains of what is left are k times as large. `volume` is that of a cylinder
    of the shortened length, ends not counted: 1/k of its change is the muscle's own.

    Attributes:
        cylinder: geometry of the part that pulls, with the muscle's own rest length.
        end_factor: k [-], 1 for a cylinder, above 1 for rounded ends.

    References:
        Tondu & Lopez 2000.
    """

    cylinder: AbstractGeometry
    end_factor: Float[Given, "..."] = parameter(low=1.0, high=_LARGEST_FACTOR)

    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions of the cylinder at active length L [m] and gauge pressure P [Pa]."""
        positive = as_real(length) > 0
        at = jnp.where(positive, length, jax.lax.stop_gradient(self.rest_length))
        shortened = tondu_lopez_length(at, self.rest_length, self.end_factor)
        return self.cylinder.dimensions(shortened, pressure).unless(positive)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m], those of the cylinder mapped back."""
        shortest, longest = (
            tondu_lopez_length(end, self.rest_length, 1 / self.end_factor)
            for end in self.cylinder.length_range()
        )
        return shortest, longest

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.cylinder.rest_length

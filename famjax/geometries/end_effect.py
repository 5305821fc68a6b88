"""A cylinder that stands for a muscle with rounded ends: Tondu & Lopez's factor on contraction."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._compiled import compiled_method
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

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions of the cylinder at active length L [m] and gauge pressure P [Pa]."""
        positive = as_real(length) > 0
        at = jnp.where(positive, length, jax.lax.stop_gradient(self.rest_length))
        shortened = tondu_lopez_length(at, self.rest_length, self.end_factor)
        return self.cylinder.dimensions(shortened, pressure).unless(positive)

    @property
    def keeps_apart(self) -> bool:
        """Whether the cylinder does."""
        return self.cylinder.keeps_apart

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m], those of the cylinder mapped back."""
        shortest, longest = (
            tondu_lopez_length(end, self.rest_length, 1 / self.end_factor)
            for end in self.cylinder.length_range()
        )
        return shortest, longest

    @property
    def breakpoints(self) -> Float[Array, " lengths"]:
        """Active lengths [m], those of the cylinder mapped back."""
        lengths = self.cylinder.breakpoints
        return tondu_lopez_length(lengths, self.rest_length, 1 / self.end_factor)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.cylinder.rest_length

    def inner_volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, V_c(L0) + (V_c(L) - V_c(L0))/k, V_c being the cylinder's.

        Its slope in the length is then the cylinder's, as the virtual work of the pressure wants,
        and at rest the ends count as the cylinder does.
        """
        found = self.dimensions(length, pressure)
        reached = found.reached
        at, rest = found.where(reached), self.cylinder.dimensions(self.rest_length, jnp.zeros(()))
        volume = rest.volume + (at.volume - rest.volume) / self.end_factor - at.bladder_volume
        return jnp.where(reached, volume, jnp.nan)

    def braid_limits(self) -> tuple[RealArray, RealArray]:
        """Those of the cylinder, mapped back: rounded ends shift both lengths."""
        rest = self.rest_length
        lock, straight = self.cylinder.braid_limits()
        return rest + (lock - rest) / self.end_factor, rest + (straight - rest) / self.end_factor

    def cut_to_length(self, rest_length: RealArray) -> "EndEffectGeometry":
        """The same ends on a longer or shorter cylinder: their dead length L0 (1 - 1/k) stays."""
        dead = self.rest_length * (1 - 1 / self.end_factor)
        new = eqx.error_if(
            rest_length,
            jnp.any(rest_length <= dead),
            "the rest length must be above the dead length of the ends",
        )
        return EndEffectGeometry(self.cylinder.cut_to_length(new), new / (new - dead))

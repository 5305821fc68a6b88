"""A muscle whose pull is the weighted sum of several models': what a fit predicts that chose none."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._alike import of_each
from .._compiled import compiled
from .._types import Real, RealArray, as_number, as_real
from .abstract_muscle import AbstractMuscle


class MeanMuscle(AbstractMuscle):
    """Several models of one muscle, F = sum w_i F_i.

    Attributes:
        members: models of the same rest length.
        weights: w_i [-], of sum 1, shape (members,).
    """

    members: tuple[AbstractMuscle, ...]
    weights: Float[Array, " members"] = eqx.field(converter=as_number)

    def __init__(
        self,
        members: Sequence[AbstractMuscle],
        weights: Sequence[float] | Float[Array, " members"] | None = None,
    ) -> None:
        """The mean of the members, or their sum with these weights.

        Raises:
            ValueError: no members, or not a weight for each.
        """
        self.members = tuple(members)
        count = len(self.members)
        self.weights = as_real(jnp.full(count, 1 / max(count, 1)) if weights is None else weights)
        if not count or self.weights.shape != (count,):
            raise ValueError(
                f"a mean needs members and a weight for each, got {count} and weights of shape "
                f"{self.weights.shape}"
            )

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        return _force(self, *jnp.broadcast_arrays(as_real(length), as_real(pressure)))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] that all members have."""
        ranges = [one.length_range() for one in self.members]
        shortest, longest = (jnp.stack([one[k] for one in ranges]) for k in (0, 1))
        return jnp.max(shortest), jnp.min(longest)

    def stops(self) -> Float[Array, "2"]:
        """Lengths [m] between which no member stops."""
        each = jnp.stack([one.stops() for one in self.members])
        return jnp.stack([jnp.max(each[:, 0]), jnp.min(each[:, 1])])

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid: the first member's."""
        return self.members[0].volume(length, pressure)

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the first member's."""
        return self.members[0].rest_length


@compiled
def _force(mean: MeanMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    count = len(mean.members)
    forces = of_each(
        lambda one, L, P: one.force(L, P), mean.members, [length] * count, [pressure] * count
    )
    return jnp.einsum("i,i...->...", mean.weights, forces)

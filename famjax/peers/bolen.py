"""Bolen's normalised force surface."""

import math

import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..parameters import number, parameter
from ..units import KILOPASCAL
from .abstract_peer import PeerModel, around_rest, where_it_holds

# Of F_620 = b1 atan(b2 (L0 - offset)): b1 [N], b2 [1/m], offset [m]; then c0, c1, c2 [-].
_PUBLISHED = {
    "10 mm": (303.5, 19.03, 0.0075, (0.5682, 4.254, 0.5597)),
    "20 mm": (922.4, 15.37, 0.013, (0.2579, 6.477, 1.321)),
}


class Bolen(PeerModel):
    """A normalised surface: an exponential over contraction plus a bell that carries the pressure.

    F = F_620 (c0 (exp(-c1 e) - 1) + P / P_620 exp(-c2 e^2)), e = eps / eps_620

    Attributes:
        rest_length: L0 [m], from which the contraction eps is counted.
        largest_contraction: eps_620 [-], free contraction at P_620. It only scales c1 and c2, and
            cannot be fitted beside them.
        largest_force: F_620 [N], blocked force at P_620.
        c0, c1, c2: [-].
        reference_pressure: P_620 [Pa], 620 kPa.

    References:
        Bolen, Elzein, Pang & Hunt 2026, where form and constants were read. They set negative
        forces to zero, here they stay.

    >>> muscle = Bolen.published("10 mm", rest_length=0.112, largest_contraction=0.17)
    >>> print(f"{muscle.force(0.112, 620e3):.1f}")  # 335.3 N in the article
    335.3
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    largest_contraction: Float[Given, "..."] = number()
    largest_force: Float[Given, "..."] = parameter("N", linear=True)
    c0: Float[Given, "..."] = parameter(low=0.0, high=5.0)
    c1: Float[Given, "..."] = parameter(low=0.1, high=50.0)
    c2: Float[Given, "..."] = parameter(low=0.0, high=20.0)
    reference_pressure: Float[Given, "..."] = number("Pa", default=620 * KILOPASCAL)

    @classmethod
    def published(cls, muscle: str, *, rest_length: float, largest_contraction: float) -> "Bolen":
        """The published constants, with the blocked force that the rest length gives.

        Args:
            muscle: "10 mm" or "20 mm".
            rest_length: L0 [m].
            largest_contraction: eps_620 [-] of the muscle at hand; the authors measure it.

        Returns:
            The model.

        Raises:
            ValueError: no constants are known for that muscle.
        """
        if muscle not in _PUBLISHED:
            raise ValueError(
                f"Bolen's constants are known for {', '.join(_PUBLISHED)}; got {muscle!r}"
            )
        b1, b2, offset, (c0, c1, c2) = _PUBLISHED[muscle]
        force = b1 * math.atan(b2 * (rest_length - offset))
        return cls(rest_length, largest_contraction, force, c0, c1, c2)

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        e = (1 - as_real(length) / self.rest_length) / self.largest_contraction
        bell = as_real(pressure) / self.reference_pressure * jnp.exp(-self.c2 * e**2)
        return self.largest_force * (self.c0 * jnp.expm1(-self.c1 * e) + bell)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to a tenth above it."""
        return around_rest(self.rest_length)

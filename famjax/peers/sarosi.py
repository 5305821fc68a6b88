"""Sarosi's empirical force functions of contraction and pressure."""

import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..parameters import parameter
from ..units import BAR
from .abstract_peer import PeerModel, around_rest, where_it_holds

# Contraction in per cent and pressure in bar.
_PUBLISHED = {
    "10 mm": (-9.2194029, 203.7012413, -0.34221042, -3.2255991, 109.2038216, -208.372034),
    "20-200": (-4.00180705, 292.4620246, -0.32930845, -9.33564098, 294.0538256, -280.498151),
    "20-400": (-4.35573, 281.22370, -0.32866, -9.27035, 302.20107, -263.69185),
}


class Sarosi(PeerModel):
    """An exponential softening over contraction plus terms linear in pressure; no physics.

    F = (a1 P + a2) exp(a3 eps) + a4 P eps + a5 P + a6

    The five-parameter form has a1 = 1 N/bar, (p + a) exp(b k) + c p k + d p + e in bar and per
    cent; the four-parameter form a1 = 0 and a6 = -a2, so that the wall does not act at rest.

    Attributes:
        rest_length: L0 [m], from which the contraction eps is counted.
        a1, a4, a5: [m2], force per pressure.
        a2, a6: [N].
        a3: [-], negative.

    References:
        Sarosi 2012; Sarosi et al. 2017. Form and constants as transcribed in the published code
        and in the article of Bolen, Elzein, Pang & Hunt 2026; the shorter forms are general
        knowledge.

    >>> muscle = Sarosi.published("20-400", rest_length=0.4)
    >>> print(f"{muscle.force(0.4, 5e5):.0f} {muscle.force(0.3, 5e5):.0f}")
    1507 89
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    a1: Float[Given, "..."] = parameter("m2", linear=True)
    a2: Float[Given, "..."] = parameter("N", linear=True)
    a3: Float[Given, "..."] = parameter(low=-300.0, high=-1.0)
    a4: Float[Given, "..."] = parameter("m2", linear=True)
    a5: Float[Given, "..."] = parameter("m2", linear=True)
    a6: Float[Given, "..."] = parameter("N", linear=True)

    @classmethod
    def published(cls, muscle: str, *, rest_length: float) -> "Sarosi":
        """The published constants of a Festo muscle, converted from per cent and bar.

        Args:
            muscle: "10 mm", "20-200" (20 mm by 200 mm) or "20-400".
            rest_length: L0 [m] of the muscle at hand.

        Returns:
            The model.

        Raises:
            ValueError: no constants are known for that muscle.
        """
        if muscle not in _PUBLISHED:
            raise ValueError(
                f"Sarosi's constants are known for {', '.join(_PUBLISHED)}; got {muscle!r}"
            )
        a1, a2, a3, a4, a5, a6 = _PUBLISHED[muscle]
        return cls(rest_length, a1 / BAR, a2, 100 * a3, 100 * a4 / BAR, a5 / BAR, a6)

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        eps, P = 1 - as_real(length) / self.rest_length, as_real(pressure)
        softening = (self.a1 * P + self.a2) * jnp.exp(self.a3 * eps)
        return softening + self.a4 * P * eps + self.a5 * P + self.a6

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to a tenth above it."""
        return around_rest(self.rest_length)

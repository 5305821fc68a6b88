"""Published empirical formulas for the force as a function of contraction and pressure."""

import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, RealArray
from ..parameters import parameter
from .balance import PeerModel


class Hildebrandt(PeerModel):
    """Empirical model: pressure times a parabola in contraction, plus a cubic and a fractional power.

    F = P (a0 + a1 eps + a2 eps^2) + b0 + b1 eps + b2 eps^2 + b3 eps^3 + b4 |eps|^(2/3)

    The fractional power has no derivative at rest.

    Attributes:
        rest_length: L0 [m], reference length for the contraction eps.
        pressure_coefficients: a0 to a2 [m2], shape (3,).
        force_coefficients: b0 to b4 [N], shape (5,).

    References:
        Hildebrandt, Sawodny, Neumann & Hartmann 2002. The formula is general knowledge and was not
        checked against the publication.
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    pressure_coefficients: Float[Given, " 3"] = parameter(
        "m2", linear=True, name=("a0", "a1", "a2")
    )
    force_coefficients: Float[Given, " 5"] = parameter(
        "N", linear=True, name=("b0", "b1", "b2", "b3", "b4")
    )

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
        eps = 1 - L / self.rest_length
        area = jnp.polyval(self.pressure_coefficients[::-1], eps)
        restoring = jnp.polyval(self.force_coefficients[3::-1], eps)
        root = self.force_coefficients[4] * jnp.cbrt(eps) ** 2
        return P * area + restoring + root


class Sarosi(PeerModel):
    """Empirical model: a force that decays exponentially with contraction, plus terms linear in pressure.

    F = (a1 P + a2) exp(a3 eps) + a4 P eps + a5 P + a6

    The five-parameter form, (p + a) exp(b k) + c p k + d p + e in bar and per cent, has a1 = 1 N/bar.
    The four-parameter form has a1 = 0 and a6 = -a2, so the wall exerts no force at rest.

    Attributes:
        rest_length: L0 [m], reference length for the contraction eps.
        a1, a4, a5: [m2], force per unit pressure.
        a2, a6: [N].
        a3: [-], negative.

    References:
        Sarosi 2012; Sarosi et al. 2017. Form and constants are as transcribed in the published
        code and in the article by Bolen, Elzein, Pang & Hunt 2026; the shorter forms are general
        knowledge.
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    a1: Float[Given, "..."] = parameter("m2", linear=True)
    a2: Float[Given, "..."] = parameter("N", linear=True)
    a3: Float[Given, "..."] = parameter(low=-300.0, high=-1.0)
    a4: Float[Given, "..."] = parameter("m2", linear=True)
    a5: Float[Given, "..."] = parameter("m2", linear=True)
    a6: Float[Given, "..."] = parameter("N", linear=True)

    def formula(self, L: RealArray, P: RealArray) -> RealArray:
        """Return the force F [N] at L [m] and P [Pa]."""
        eps = 1 - L / self.rest_length
        softening = (self.a1 * P + self.a2) * jnp.exp(self.a3 * eps)
        return softening + self.a4 * P * eps + self.a5 * P + self.a6

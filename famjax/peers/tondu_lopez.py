"""The braid alone with corrected contraction: Tondu and Lopez, and Kerscher after them."""

import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..braids import Braid
from ..parameters import parameter
from ..profiles import tondu_lopez_length
from ..units import BAR
from .abstract_peer import PeerModel, around_rest, where_it_holds
from .braid_alone import Gaylord


class TonduLopez(PeerModel):
    """The braid alone at a contraction multiplied by k, for ends that are no cylinder.

    F = (P - P_d) pi R0^2 (a (1 - k eps)^2 - b), k = a_k exp(-P / bar) + b_k

    with a = 3 tan(theta)^2 and b = 1 / cos(theta)^2 of the braid angle at rest.

    Attributes:
        braid: threads of constant length.
        rest_length: L0 [m], from which the contraction eps is counted.
        k_far: b_k [-], the value at high pressure; the constant k where `k_rise` is zero.
        k_rise: a_k [-], by which k is greater without pressure.
        deadband_pressure: P_d [Pa], zero in the original.

    References:
        Tondu & Lopez 2000. General knowledge, not read again.
    """

    braid: Braid
    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    k_far: Float[Given, "..."] = parameter(low=0.5, high=3.0, default=1.0)
    k_rise: Float[Given, "..."] = parameter(low=0.0, high=20.0, default=0.0)
    deadband_pressure: Float[Given, "..."] = parameter("Pa", default=0.0)

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        k = self.k_rise * jnp.exp(-as_real(pressure) / BAR) + self.k_far
        shortened = tondu_lopez_length(length, self.rest_length, k)
        return Gaylord(self.braid, self.deadband_pressure).force(shortened, pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to a tenth above it."""
        return around_rest(self.rest_length)


class Kerscher(PeerModel):
    """Tondu and Lopez' model times a factor that depends on the contraction.

    F = mu(eps) F_TL, mu = a_m exp(-c_m eps) + b_m

    The factor scales the section too, so it cannot be separated from the braid's diameter.

    Attributes:
        muscle: Tondu and Lopez' model.
        factor_rise: a_m [-].
        factor_rate: c_m [-].
        factor_far: b_m [-].

    References:
        Kerscher, Albert, Zoellner & Berns 2006. General knowledge, not read again.
    """

    muscle: TonduLopez
    factor_rise: Float[Given, "..."] = parameter(linear=True)
    factor_rate: Float[Given, "..."] = parameter(low=0.0, high=100.0)
    factor_far: Float[Given, "..."] = parameter(linear=True)

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        eps = 1 - as_real(length) / self.muscle.rest_length
        factor = self.factor_rise * jnp.exp(-self.factor_rate * eps) + self.factor_far
        pull = self.muscle.force(length, pressure)
        reached = jnp.isfinite(pull)
        return jnp.where(reached, factor * jnp.where(reached, pull, 0.0), jnp.nan)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Those of Tondu and Lopez' model."""
        return self.muscle.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.muscle.rest_length

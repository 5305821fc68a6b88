"""Hunt's relation, which gives the pressure that a force takes: solved for the force."""

import math

import jax
import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real, at_each, compiled
from ..parameters import number, parameter
from ..units import KILOPASCAL
from .abstract_peer import PeerModel, where_it_holds
from .falling_root import falling_root

_STEEP = math.pi / 2 - 0.01  # rad; the tangent is 100 there, beyond every pressure in use


class Hunt(PeerModel):
    """The force at which an empirical relation for the pressure holds; no physics.

    P = a0 + a5 F + a1 tan(a2 (eps / (eps_max + a4 F) + a3)) + P_S

    At one contraction the pressure rises with the force, so the root is unique. It is sought by
    Newton's method in a bracket, and differentiated by the implicit function theorem. A muscle
    longer than at rest (eps < 0) is outside the relation and gives nan.

    Attributes:
        rest_length: L0 [m], from which the contraction eps is counted.
        largest_contraction: eps_max [-], free contraction at 620 kPa. Scaling eps_max and a4 with
            1 / a2 and 1 / a3 changes nothing, so it cannot be fitted beside them.
        offset_pressure: a0 [Pa].
        tangent_pressure: a1 [Pa], > 0.
        tangent_slope: a2 [-], > 0.
        tangent_offset: a3 [-], negative.
        contraction_per_force: a4 [1/N], < 0.
        pressure_per_force: a5 [Pa/N], > 0.
        hysteresis_pressure: P_S [Pa]: 15.6 kPa when shortening, the opposite when lengthening,
            zero when static.

    References:
        Hunt, Graber-Tilton & Quinn 2017, with the constants as corrected by Bolen et al. 2026 in
        article and code, where they were read.

    >>> muscle = Hunt.published(rest_length=0.25, largest_contraction=0.2)
    >>> print(f"{muscle.force(0.234, 4e5):.0f}")
    134
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    largest_contraction: Float[Given, "..."] = number()
    offset_pressure: Float[Given, "..."] = parameter("Pa")
    tangent_pressure: Float[Given, "..."] = parameter("Pa", low=0.0)
    tangent_slope: Float[Given, "..."] = parameter(low=0.1, high=10.0)
    tangent_offset: Float[Given, "..."] = parameter()
    contraction_per_force: Float[Given, "..."] = parameter("1/N", kind="1/N", high=0.0)
    pressure_per_force: Float[Given, "..."] = parameter("Pa/N", low=0.0)
    hysteresis_pressure: Float[Given, "..."] = number("Pa", default=0.0)

    @classmethod
    def published(cls, *, rest_length: float, largest_contraction: float) -> "Hunt":
        """The corrected constants, of 10 mm Festo muscles.

        Args:
            rest_length: L0 [m].
            largest_contraction: eps_max [-] of the muscle at hand.

        Returns:
            The model.
        """
        return cls(
            rest_length=rest_length,
            largest_contraction=largest_contraction,
            offset_pressure=254.3 * KILOPASCAL,
            tangent_pressure=192 * KILOPASCAL,
            tangent_slope=2.0265,
            tangent_offset=-0.4609,
            contraction_per_force=-0.331e-3,
            pressure_per_force=1.229 * KILOPASCAL,
        )

    def pressure(self, length: Real, force: Real) -> RealArray:
        """Gauge pressure P [Pa] that the force F [N] takes at the length L [m], broadcast shape."""
        return self._pressure(1 - as_real(length) / self.rest_length, as_real(force))

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        return _forces(self, as_real(length), as_real(pressure))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to the rest length, where the relation begins."""
        return 0.5 * self.rest_length, self.rest_length

    def _pressure(self, eps: RealArray, force: RealArray) -> RealArray:
        relative = eps / (self.largest_contraction + self.contraction_per_force * force)
        bent = jnp.tan(self.tangent_slope * (relative + self.tangent_offset))
        linear = self.offset_pressure + self.pressure_per_force * force
        return linear + self.tangent_pressure * bent + self.hysteresis_pressure

    def _root(self, eps: RealArray, pressure: RealArray) -> RealArray:
        """The force [N] at one contraction and pressure."""
        inside = eps >= 0
        eps = jnp.where(inside, eps, 0.0)
        bent = eps > 0
        # Where the tangent is steep the pressure exceeds the one sought, and below that force it
        # falls by pressure_per_force at least.
        steepest = eps / (_STEEP / self.tangent_slope - self.tangent_offset)
        steep = (steepest - self.largest_contraction) / self.contraction_per_force
        steep = jnp.where(bent, steep, 0.0)
        excess = self._pressure(eps, steep) - pressure
        span = (jnp.abs(excess) + self.tangent_pressure) / self.pressure_per_force
        upper = jax.lax.stop_gradient(jnp.where(bent, steep, steep + span))
        width = jax.lax.stop_gradient(jnp.where(bent, span, 2 * span))

        def residual(y: RealArray) -> RealArray:
            reached = self._pressure(eps, upper - width * y)
            return (reached - pressure) / jax.lax.stop_gradient(self.tangent_pressure)

        share = falling_root(residual, jnp.full_like(pressure, 0.5))
        return jnp.where(inside, upper - width * share, jnp.nan)


@compiled
def _forces(model: Hunt, length: RealArray, pressure: RealArray) -> RealArray:
    return at_each(model._root, 1 - length / model.rest_length, pressure)

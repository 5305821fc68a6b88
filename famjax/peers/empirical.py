"""Empirical surfaces of control engineering: a spring, a rational form, and plain polynomials."""

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Float

from .._arrays import Given, Real, RealArray, as_real
from ..parameters import parameter
from .abstract_peer import PeerModel, around_rest, known, where_it_holds


class Wickramatunge(PeerModel):
    """A spring whose stiffness depends on pressure and stretch; no physics.

    F = K s, K = k0 + k1 P^2 + k2 P s + k3 s^2, s = L - L_s

    Attributes:
        slack_length: L_s [m], from which the stretch s is counted.
        coefficients: k0 [N/m], k1 [N/m/Pa2], k2 [N/m2/Pa], k3 [N/m3], shape (4,).
        resting_length: L0 [m], which the force does not need; blocked force and contraction do.

    References:
        Wickramatunge & Leephakpreeda 2010. General knowledge, not read again.
    """

    slack_length: Float[Given, "..."] = parameter("m", low=0.0)
    coefficients: Float[Given, " 4"] = parameter(
        ("N/m", "N/m/Pa2", "N/m2/Pa", "N/m3"), linear=True, name=("k0", "k1", "k2", "k3")
    )
    resting_length: Float[Given, "..."] | None = parameter(
        "m", low=0.0, name="rest_length", default=None
    )

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        s, P = as_real(length) - self.slack_length, as_real(pressure)
        k0, k1, k2, k3 = self.coefficients
        return s * (k0 + k1 * P**2 + k2 * P * s + k3 * s**2)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From the slack length, where the spring is relaxed, to twice that."""
        return self.slack_length, 2 * self.slack_length

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction.

        Raises:
            ValueError: it was not given.
        """
        return known(self.resting_length, self)


class Hildebrandt(PeerModel):
    """Pressure times a parabola of the contraction, plus a cubic and a fractional power; no physics.

    F = P (a0 + a1 eps + a2 eps^2) + b0 + b1 eps + b2 eps^2 + b3 eps^3 + b4 |eps|^(2/3)

    The fractional power has no derivative at rest.

    Attributes:
        rest_length: L0 [m], from which the contraction eps is counted.
        pressure_coefficients: a0 to a2 [m2], shape (3,).
        force_coefficients: b0 to b4 [N], shape (5,).

    References:
        Hildebrandt, Sawodny, Neumann & Hartmann 2002. General knowledge, not read again.
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    pressure_coefficients: Float[Given, " 3"] = parameter(
        "m2", linear=True, name=("a0", "a1", "a2")
    )
    force_coefficients: Float[Given, " 5"] = parameter(
        "N", linear=True, name=("b0", "b1", "b2", "b3", "b4")
    )

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        eps = 1 - as_real(length) / self.rest_length
        area = jnp.polyval(self.pressure_coefficients[::-1], eps)
        restoring = jnp.polyval(self.force_coefficients[3::-1], eps)
        root = self.force_coefficients[4] * jnp.cbrt(eps) ** 2
        return as_real(pressure) * area + restoring + root

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to a tenth above it."""
        return around_rest(self.rest_length)


class PolynomialSurface(PeerModel):
    """A polynomial of contraction and pressure up to a total degree; no physics.

    F = sum over i + j <= degree of c_ij eps^i (P / MPa)^j

    Attributes:
        rest_length: L0 [m], from which the contraction eps is counted.
        coefficients: c_ij [N] in the order of `terms`, shape ((degree + 1) (degree + 2) / 2,).
        degree: total degree.

    References:
        Sarosi et al. 2017 quote one of degree five, 21 coefficients. General knowledge.
    """

    rest_length: Float[Given, "..."] = parameter("m", low=0.0)  # pyright: ignore
    coefficients: Float[Given, " terms"] = parameter("N", linear=True)
    degree: int = eqx.field(static=True)

    def __check_init__(self) -> None:
        if self.coefficients.shape != (len(self.terms(self.degree)),):
            raise ValueError(
                f"a polynomial of degree {self.degree} in two variables has "
                f"{len(self.terms(self.degree))} coefficients, got {self.coefficients.shape}"
            )

    @staticmethod
    def terms(degree: int) -> tuple[tuple[int, int], ...]:
        """The exponents (i, j) of contraction and pressure, in the order of the coefficients."""
        return tuple((i, k - i) for k in range(degree + 1) for i in range(k + 1))

    @where_it_holds
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa], broadcast shape."""
        eps, P = jnp.broadcast_arrays(
            1 - as_real(length) / self.rest_length, as_real(pressure) / 1e6
        )
        powers = [eps**i * P**j for i, j in self.terms(self.degree)]
        return jnp.stack(powers, axis=-1) @ self.coefficients

    def parameter_name(self, field: str, index: tuple[int, ...]) -> str:
        """The names of the coefficients say their exponents: c_ij."""
        if field != "coefficients":
            return super().parameter_name(field, index)
        i, j = self.terms(self.degree)[index[0]]
        return f"c_{i}{j}"

    def length_range(self) -> tuple[RealArray, RealArray]:
        """From half the rest length to a tenth above it."""
        return around_rest(self.rest_length)

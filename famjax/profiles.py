"""Muscle profiles: diameter as a function of position along the active length."""

import abc

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from ._arrays import Given, Real, RealArray, as_real
from .parameters import Parametrised, number


class AbstractProfile(Parametrised):
    """A smooth surface of revolution: diameter D at the fraction x in [0, 1] of the active length L."""

    @abc.abstractmethod
    def diameter(self, x: Real, length: Real) -> RealArray:
        """Return the braid diameter D [m] at position x [-] and length L [m]; arguments broadcast."""


class FourierProfile(AbstractProfile):
    """A truncated Fourier series with a free wave number; the profile is the same at every length.

    D(x) = a0 + sum over n of a_n cos(n w x) + b_n sin(n w x)

    A profile that is symmetric about x = 1/2 has b_n / a_n = tan(n w / 2) for every n.

    Attributes:
        a0: constant term [m].
        a: a_n [m], shape (terms,).
        b: b_n [m], shape (terms,).
        w: wave number [-], any real number; for w = 2 pi, the profile is periodic over the length.

    Raises:
        ValueError: `a` and `b` differ in shape. `Meridian` checks that the diameter is positive.

    References:
        Chambers 2021, section 4.3, table 4.3.
    """

    a0: Float[Given, ""] = number("m")
    a: Float[Given, " terms"] = number("m")
    b: Float[Given, " terms"] = number("m")
    w: Float[Given, ""] = number()

    def __check_init__(self) -> None:
        if self.a.ndim != 1 or self.a.shape != self.b.shape:
            raise ValueError(
                "a and b need one coefficient per term, excluding a0; got shapes "
                f"{self.a.shape} and {self.b.shape}"
            )

    def symmetrised(self) -> "FourierProfile":
        """Return the part of the profile that is even about x = 1/2, (D(x) + D(1 - x)) / 2."""
        half = _harmonics(self.a) * self.w / 2
        even = self.a * jnp.cos(half) + self.b * jnp.sin(half)
        return FourierProfile(self.a0, even * jnp.cos(half), even * jnp.sin(half), self.w)

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Return the braid diameter D [m] at position x [-]; arguments broadcast.

        The length [m] has no effect on the diameter.
        """
        angle = _harmonics(self.a) * self.w * as_real(x)[..., None]
        series = jnp.sum(self.a * jnp.cos(angle) + self.b * jnp.sin(angle), axis=-1)
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(length))
        return jnp.broadcast_to(self.a0 + series, shape)


def _harmonics(coefficients: RealArray) -> np.ndarray:
    """Return the term numbers n = 1, 2, ..., in the precision of the coefficients."""
    return np.arange(1, coefficients.shape[-1] + 1, dtype=coefficients.dtype)


def tondu_lopez_length(length: Real, rest_length: Real, k: Real) -> RealArray:
    """Return the length [m] at which a cylinder has the same force as a muscle with rounded ends.

    Use this length, L0 (1 - k eps), in place of L in the force of a cylindrical muscle.

    Args:
        length: active length L [m].
        rest_length: L0 [m].
        k: factor [-] on the contraction eps = (L0 - L) / L0; 1 for a cylinder, above 1 for rounded
            ends.

    Returns:
        Length [m], with the broadcast shape.

    References:
        Tondu & Lopez 2000.

    >>> print(f"{tondu_lopez_length(0.27, 0.30, 1.25):.4f}")
    0.2625
    """
    rest_length = as_real(rest_length)
    return rest_length - k * (rest_length - length)


def kothera_length(length: Real, radius: Real, rest_radius: Real) -> RealArray:
    """Return the length [m] of the cylinder between two quarter-circle ends: L - 2 (R - R0).

    Args:
        length: active length L [m].
        radius: R [m] of the cylindrical part.
        rest_radius: R0 [m] at rest, also the radius at the fittings.

    Returns:
        Length [m], with the broadcast shape.

    References:
        Kothera et al. 2009.

    >>> print(f"{kothera_length(0.27, 0.02, 0.01):.2f}")
    0.25
    """
    return as_real(length) - 2 * (as_real(radius) - rest_radius)

"""The shape of a muscle: diameter against the position along the active length."""

import abc
import math
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from ._arrays import Given, Real, RealArray, as_real
from .parameters import Parametrised, number


class AbstractProfile(Parametrised):
    """A surface of revolution: diameter D at the fraction x in [0, 1] of the active length L."""

    @abc.abstractmethod
    def diameter(self, x: Real, length: Real) -> RealArray:
        """Braid diameter D [m] at position x [-] of active length L [m], broadcast shape."""

    @abc.abstractmethod
    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Positions x [-] between 0 and 1, increasing, where slope or diameter jumps at L [m]."""


class FourierProfile(AbstractProfile):
    """A truncated Fourier series with a free wave number; the same at every length.

    D(x) = a0 + sum over n of a_n cos(n w x) + b_n sin(n w x)

    A profile that is symmetric about x = 1/2 has b_n / a_n = tan(n w / 2) for every n.

    Attributes:
        a0: constant term [m].
        a: a_n [m], shape (terms,).
        b: b_n [m], shape (terms,).
        w: wave number [-], any real number; 2 pi gives a profile that is periodic in the length.

    Raises:
        ValueError: `a` and `b` differ in shape, or the diameter is not positive everywhere. The
            latter is seen on concrete numbers only; traced ones are checked where a `Meridian` is
            taken.

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
                "a and b hold one coefficient per term, without a0; got the shapes "
                f"{self.a.shape} and {self.b.shape}"
            )
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        x = np.linspace(0, 1, 32 * (self.a.size + 1) + 1)
        diameter = np.asarray(self.diameter(x, 1.0))
        lowest = int(np.argmin(diameter))
        if not diameter[lowest] > 0:
            raise ValueError(
                "the diameter of a profile must be > 0 from x = 0 to 1; it is "
                f"{diameter[lowest]:.4g} at x = {x[lowest]:.3f}. Check the signs of a_n and b_n, "
                "and w: terms that cancel need every digit"
            )

    @classmethod
    def symmetric(cls, a0: Real, a: Real | Sequence[float], w: Real) -> "FourierProfile":
        """The profile symmetric about x = 1/2 with these cosine terms, b_n = a_n tan(n w / 2).

        Args:
            a0: constant term [m].
            a: a_n [m], shape (terms,).
            w: wave number [-]; not near an n w = pi, 3 pi ... where b_n is unbounded. To make
                symmetric what was fitted with both a_n and b_n, `symmetrised` loses fewer digits.

        Returns:
            The profile.

        >>> profile = FourierProfile.symmetric(1.02, [-0.09, -0.07, -0.01], 5.596)
        >>> print(f"{profile.diameter(0.2, 1.0):.4f} {profile.diameter(0.8, 1.0):.4f}")
        1.1043 1.1043
        """
        cosine = as_real(a)
        return cls(a0, cosine, cosine * jnp.tan(_harmonics(cosine) * w / 2), w)

    def symmetrised(self) -> "FourierProfile":
        """The part of the profile that is even about x = 1/2, (D(x) + D(1 - x)) / 2."""
        half = _harmonics(self.a) * self.w / 2
        even = self.a * jnp.cos(half) + self.b * jnp.sin(half)
        return FourierProfile(self.a0, even * jnp.cos(half), even * jnp.sin(half), self.w)

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Braid diameter D [m] at position x [-]; the length [m] only sets the shape."""
        angle = _harmonics(self.a) * self.w * as_real(x)[..., None]
        series = jnp.sum(self.a * jnp.cos(angle) + self.b * jnp.sin(angle), axis=-1)
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(length))
        return jnp.broadcast_to(self.a0 + series, shape)

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """None: the series is smooth."""
        return jnp.zeros((*jnp.shape(length), 0), self.a0.dtype)


def _harmonics(coefficients: RealArray) -> np.ndarray:
    """The numbers n = 1, 2, ... of the terms, as reals of the coefficients' own precision."""
    return np.arange(1, coefficients.shape[-1] + 1, dtype=coefficients.dtype)


def cardinal_splines(
    knots: Float[Array, " knots"], slopes: Float[Array, "knots knots"], at: Float[Array, "..."]
) -> Float[Array, "... knots"]:
    """The splines that are 1 at one knot and 0 at the others, each at the points.

    Args:
        knots: increasing, shape (n,).
        slopes: `slope_matrix(knots)`.
        at: points of any shape; beyond the ends the end cubics go on.

    Returns:
        Shape (..., n).
    """
    cell = jnp.clip(jnp.searchsorted(knots, at, side="right") - 1, 0, knots.shape[0] - 2)
    step = (knots[cell + 1] - knots[cell])[..., None]
    t = (at - knots[cell])[..., None] / step
    unit = jnp.eye(knots.shape[0], dtype=knots.dtype)
    return (
        (1 + 2 * t) * (1 - t) ** 2 * unit[cell]
        + t**2 * (3 - 2 * t) * unit[cell + 1]
        + step * t * (1 - t) * ((1 - t) * slopes[cell] - t * slopes[cell + 1])
    )


@jax.jit
def slope_matrix(knots: Float[Array, " knots"]) -> Float[Array, "knots knots"]:
    """Slopes of the interpolating spline at its knots, as a matrix on the values there.

    A parabola through three knots, a line through two.

    References:
        de Boor 1978, chapter IV.
    """
    n = knots.shape[0]
    step = jnp.diff(knots)
    unit = jnp.eye(n, dtype=knots.dtype)
    secant = (unit[1:] - unit[:-1]) / step[:, None]
    if n == 2:
        return jnp.concatenate([secant, secant])
    left, right = step[:-1], step[1:]
    first, second, first_value = _end_condition(step[:2], secant[:2])
    last, before, last_value = _end_condition(step[:-3:-1], secant[:-3:-1])
    # Between the ends the second derivative is continuous at the knots.
    inner = 3 * (right[:, None] * secant[:-1] + left[:, None] * secant[1:])
    return jax.lax.linalg.tridiagonal_solve(
        jnp.concatenate([jnp.zeros_like(first), right, before]),
        jnp.concatenate([first, 2 * (left + right), last]),
        jnp.concatenate([second, left, jnp.zeros_like(last)]),
        jnp.concatenate([first_value, inner, last_value]),
    )


def _end_condition(
    step: Float[Array, " 2"], secant: Float[Array, "2 knots"]
) -> tuple[Float[Array, " 1"], Float[Array, " 1"], Float[Array, "1 knots"]]:
    """The spline's condition at one end, seen from it: on the first slope, on the second, its value.

    Not-a-knot: the third derivative is continuous at the second knot. Of three knots there is only
    one such condition; there the end cubic is a parabola instead.
    """
    near, next_ = step[:1], step[1:]
    if secant.shape[-1] == 3:
        return jnp.ones_like(near), jnp.ones_like(near), 2 * secant[:1]
    both = near + next_
    value = ((near + 2 * both) * next_ * secant[0] + near**2 * secant[1]) / both
    return next_, both, value[None]


class AbstractAssumedShape(AbstractProfile):
    """A cylinder in the middle with ends of an assumed form."""

    middle_diameter: eqx.AbstractVar[RealArray]


class Cylinder(AbstractAssumedShape):
    """A cylinder from fitting to fitting.

    Attributes:
        middle_diameter: D [m].

    References:
        Gaylord 1958.
    """

    middle_diameter: Float[Given, "..."] = number("m")

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m], the same at every position, broadcast shape."""
        shape = jnp.broadcast_shapes(jnp.shape(x), jnp.shape(length), self.middle_diameter.shape)
        return jnp.broadcast_to(self.middle_diameter, shape)

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """None."""
        return jnp.zeros((*jnp.shape(length), 0), self.middle_diameter.dtype)


class EllipticToroidEnds(AbstractAssumedShape):
    """A cylinder whose ends are parts of elliptic toroids: elliptic arcs swept around the axis.

    The arc leaves the cylinder tangentially and runs over `arc_angle` of the ellipse's parameter. With
    the default angle and `end_length` R_m - R_e the ends are quarter circles.

    R = R_e + (R_m - R_e) (q - cos(phi)) / (1 - cos(phi)),
    q = sqrt(cos(phi)^2 + sin(phi)^2 zeta (2 - zeta))

    Attributes:
        middle_diameter: D [m].
        end_diameter: D_e [m] at the fitting.
        end_length: axial length a [m] of each end, 0 < a <= L / 2.
        arc_angle: phi [rad] in (0, pi / 2]; at pi / 2, a whole quarter, the tangent is vertical at
            the fittings: no derivative at x = 0 and 1 exactly.
    """

    middle_diameter: Float[Given, "..."] = number("m")
    end_diameter: Float[Given, "..."] = number("m")
    end_length: Float[Given, "..."] = number("m")
    arc_angle: Float[Given, "..."] = number("rad", default=math.pi / 2)

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Where the ends meet the cylinder."""
        share = _end_share(length, self.end_length)
        return jnp.stack([share, 1 - share], axis=-1)

    def __check_init__(self) -> None:
        if not isinstance(self.arc_angle, Tracer) and not jnp.all(
            (self.arc_angle > 0) & (self.arc_angle < math.pi / 2 + 1e-6)
        ):
            raise ValueError(
                f"arc_angle lies in (0, pi / 2], got {self.arc_angle} rad; give it in radians"
            )

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape."""
        x = as_real(x)
        # The part of its end, in [0, 1], that a position is away from the fitting; 1 between.
        zeta = jnp.minimum(jnp.minimum(x, 1 - x) / _end_share(length, self.end_length), 1)
        cosine, sine = jnp.cos(self.arc_angle), jnp.sin(self.arc_angle)
        height = jnp.sqrt(cosine**2 + sine**2 * zeta * (2 - zeta))
        rise = (height - cosine) / (1 - cosine)
        return self.end_diameter + (self.middle_diameter - self.end_diameter) * rise


def tondu_lopez_length(length: Real, rest_length: Real, k: Real) -> RealArray:
    """Length [m] of the cylinder that pulls like a muscle with rounded ends, L0 (1 - k eps).

    Put it into the force of a cylindrical muscle in place of L.

    Args:
        length: active length L [m].
        rest_length: L0 [m].
        k: factor [-] on the contraction eps = (L0 - L) / L0; 1 for a cylinder, above 1 for ends
            that take part in the contraction but do not pull.

    Returns:
        Length [m], broadcast shape.

    References:
        Tondu & Lopez 2000.

    >>> print(f"{tondu_lopez_length(0.27, 0.30, 1.25):.4f}")
    0.2625
    """
    rest_length = as_real(rest_length)
    return rest_length - k * (rest_length - length)


def kothera_length(length: Real, radius: Real, rest_radius: Real) -> RealArray:
    """Length [m] of the cylindrical part between two quarter-circle ends, L - 2 (R - R0).

    Args:
        length: active length L [m].
        radius: R [m] of the cylindrical part.
        rest_radius: R0 [m] at rest, which the ends keep at the fittings.

    Returns:
        Length [m], broadcast shape.

    References:
        Kothera et al. 2009.

    >>> print(f"{kothera_length(0.27, 0.02, 0.01):.2f}")
    0.25
    """
    return as_real(length) - 2 * (as_real(radius) - rest_radius)


def _end_share(length: Real, end_length: Real) -> RealArray:
    """Length of one end over the active length, a / L; an error where the ends do not fit."""
    share = as_real(end_length) / length
    return eqx.error_if(
        share,
        (share <= 0) | (share > 0.5),
        "each end of an assumed shape must be longer than zero and at most half the active "
        "length. Check end_length; all in one unit",
    )

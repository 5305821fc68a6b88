"""Shapes that were assumed for the muscle's ends before anyone measured them, and end corrections.

Every shape is a cylinder of diameter D in the middle that narrows to D_e at both end-fittings. With
zeta the distance from the nearer fitting over the length of an end, R(zeta) runs from R_e to R:

- stepped cylinder: R_e up to zeta = 1
- conic frustum: R_e + (R - R_e) zeta
- semi-ellipsoid, centred on the muscle's axis: sqrt(R_e^2 + (R^2 - R_e^2) zeta (2 - zeta))
- partial elliptic toroid, an elliptic arc swept about the axis; its 90 deg case with a circle is
  R_e + (R - R_e) sqrt(zeta (2 - zeta)), the ends being R - R_e long
"""

import math

import equinox as eqx
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Float

from .._types import Given, Real, RealArray, as_real
from ..parameters import number
from .profile import AbstractProfile


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


class SteppedCylinder(AbstractAssumedShape):
    """Three cylinders. The area of the two faces between them is not counted in any measure.

    Attributes:
        middle_diameter: D [m].
        end_diameter: D_e [m].
        end_length: length a [m] of each narrow end, 0 < a < L / 2.
    """

    middle_diameter: Float[Given, "..."] = number("m")
    end_diameter: Float[Given, "..."] = number("m")
    end_length: Float[Given, "..."] = number("m")

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape; of the middle at the steps."""
        zeta = _end_position(x, length, self.end_length)
        return jnp.where(zeta < 1, self.end_diameter, self.middle_diameter)

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """The two steps."""
        return _end_breakpoints(length, self.end_length)


class ConicFrustumEnds(AbstractAssumedShape):
    """A cylinder whose ends are frusta of cones.

    Attributes:
        middle_diameter: D [m].
        end_diameter: D_e [m] at the fitting.
        end_length: axial length a [m] of each end, 0 < a <= L / 2.
    """

    middle_diameter: Float[Given, "..."] = number("m")
    end_diameter: Float[Given, "..."] = number("m")
    end_length: Float[Given, "..."] = number("m")

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape."""
        zeta = _end_position(x, length, self.end_length)
        return self.end_diameter + (self.middle_diameter - self.end_diameter) * zeta

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Where the frusta meet the cylinder."""
        return _end_breakpoints(length, self.end_length)


class SemiEllipsoidEnds(AbstractAssumedShape):
    """A cylinder whose ends are semi-ellipsoids about the axis, cut off at the fitting.

    Attributes:
        middle_diameter: D [m].
        end_diameter: D_e [m] at the fitting, D_e < D; 0 for whole semi-ellipsoids, whose tangent
            is vertical where they close: no derivative at x = 0 and 1 exactly.
        end_length: axial length a [m] of each end, 0 < a <= L / 2.
    """

    middle_diameter: Float[Given, "..."] = number("m")
    end_diameter: Float[Given, "..."] = number("m")
    end_length: Float[Given, "..."] = number("m")

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape."""
        zeta = _end_position(x, length, self.end_length)
        return jnp.sqrt(
            self.end_diameter**2
            + (self.middle_diameter**2 - self.end_diameter**2) * zeta * (2 - zeta)
        )

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Where the ellipsoids meet the cylinder."""
        return _end_breakpoints(length, self.end_length)


class CircularArcEnds(AbstractAssumedShape):
    """A cylinder whose ends are quarter circles, tangent to the cylinder and to the fitting's face.

    The ends are R - R_e long. The tangent is vertical at the fittings: no derivative at x = 0 and 1
    exactly.

    Attributes:
        middle_diameter: D [m].
        end_diameter: D_e [m] at the fitting, D_e < D < D_e + L.

    References:
        Kothera et al. 2009.
    """

    middle_diameter: Float[Given, "..."] = number("m")
    end_diameter: Float[Given, "..."] = number("m")

    @property
    def end_length(self) -> RealArray:
        """Axial length R - R_e [m] of each end, the radius of the circle."""
        return (self.middle_diameter - self.end_diameter) / 2

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape."""
        zeta = _end_position(x, length, self.end_length)
        return self.end_diameter + 2 * self.end_length * jnp.sqrt(zeta * (2 - zeta))

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Where the arcs meet the cylinder."""
        return _end_breakpoints(length, self.end_length)


class EllipticToroidEnds(AbstractAssumedShape):
    """A cylinder whose ends are parts of elliptic toroids: elliptic arcs swept about the axis.

    The arc leaves the cylinder tangentially and runs over `arc_angle` of the ellipse's parameter.

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

    def __check_init__(self) -> None:
        if not isinstance(self.arc_angle, Tracer) and not jnp.all(
            (self.arc_angle > 0) & (self.arc_angle < math.pi / 2 + 1e-6)
        ):
            raise ValueError(
                f"arc_angle lies in (0, pi / 2], got {self.arc_angle} rad; give it in radians"
            )

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Diameter D [m] at position x [-], broadcast shape."""
        zeta = _end_position(x, length, self.end_length)
        cosine, sine = jnp.cos(self.arc_angle), jnp.sin(self.arc_angle)
        height = jnp.sqrt(cosine**2 + sine**2 * zeta * (2 - zeta))
        rise = (height - cosine) / (1 - cosine)
        return self.end_diameter + (self.middle_diameter - self.end_diameter) * rise

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Where the toroids meet the cylinder."""
        return _end_breakpoints(length, self.end_length)


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


def _end_position(x: Real, length: Real, end_length: Real) -> RealArray:
    """Distance zeta [-] from the nearer fitting over the length of an end, at most 1."""
    x = as_real(x)
    return jnp.minimum(jnp.minimum(x, 1 - x) / _end_share(length, end_length), 1)


def _end_breakpoints(length: Real, end_length: Real) -> Float[Array, "... 2"]:
    """Positions x [-] at which the two ends meet the middle."""
    share = _end_share(length, end_length)
    return jnp.stack([share, 1 - share], axis=-1)


def _end_share(length: Real, end_length: Real) -> RealArray:
    """Length of one end over the active length, a / L; an error where the ends do not fit."""
    share = as_real(end_length) / length
    return eqx.error_if(
        share,
        (share <= 0) | (share > 0.5),
        "each end of an assumed shape must be longer than zero and at most half the active "
        "length. Check end_length, or for circular arcs that the middle is wider than the ends "
        "by less than the active length; all in one unit",
    )

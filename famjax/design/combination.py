"""A bladder under a braid: whether they fit, and what the muscle of the two does.

The braid's angle on a bladder follows from cos(theta) / D = cos(45 deg) / D_nominal. As in the
reference work's table 2.3, D is the bladder's outer diameter: the thickness of the braid is left
out of the force and counted only in the diameter outside the braid.
"""

import enum
import math

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._types import Given, Real, RealArray, as_real
from ..braids.gaylord import gaylord_force
from ..braids.inextensible import NEUTRAL_ANGLE, Braid, braid_angle_from_diameter
from ..geometries.bladder import Bladder
from ..geometries.estimated import EstimatedGeometry
from ..materials.abstract_material import AbstractMaterial
from ..materials.polynomial import PolynomialMaterial
from ..muscle import Muscle
from ..parameters import number
from .catalogue import NOMINAL_ANGLE, CatalogueBladder, CatalogueBraid

_ROUNDING = 1e-9  # relative: 0.75 in and 19.05 mm are the same diameter


class Feasibility(enum.StrEnum):
    """Whether a braid fits a diameter."""

    FEASIBLE = "feasible"
    BOUNDARY = "boundary"
    INFEASIBLE = "infeasible"


def fam_angle(diameter: Real, nominal_diameter: Real) -> RealArray:
    """Braid angle theta [rad] on a muscle, from cos(theta) / D = cos(45 deg) / D_nominal.

    Jamming is not considered; see `feasibility`.

    Args:
        diameter: D [m] of the muscle, the outer diameter of its bladder.
        nominal_diameter: D_nominal [m] of the braid, that at 45 deg.

    Returns:
        theta [rad], from the circumference, broadcast shape; nan where D > sqrt(2) D_nominal.

    References:
        Chambers 2021, section 2.2 and table 2.3.

    >>> import math
    >>> print(f"{math.degrees(fam_angle(0.875, 2.0)):.1f}")  # inches: the 7/8 in muscle
    72.0
    """
    return braid_angle_from_diameter(diameter, nominal_diameter, NOMINAL_ANGLE)


def feasibility(diameter: float, braid: CatalogueBraid) -> Feasibility:
    """Whether the braid can be put on a bladder of that diameter without jamming.

    Feasible within the braid's `diameter_range`; boundary outside it but within its
    `boundary_range`; infeasible elsewhere. The ends belong to the ranges.

    Args:
        diameter: D [m], outer diameter of the bladder.
        braid: from the catalogue.

    Returns:
        The verdict.
    """

    def within(limits: tuple[float, float]) -> bool:
        return limits[0] * (1 - _ROUNDING) <= diameter <= limits[1] * (1 + _ROUNDING)

    if within(braid.diameter_range):
        return Feasibility.FEASIBLE
    wider = within(braid.boundary_range or braid.diameter_range)
    return Feasibility.BOUNDARY if wider else Feasibility.INFEASIBLE


def bladder_material(
    bladder: CatalogueBladder, otherwise: AbstractMaterial | None
) -> AbstractMaterial | None:
    """The law of a bladder's rubber: the catalogue's, or another where it says none."""
    if bladder.coefficients is None:
        return otherwise
    return PolynomialMaterial(list(bladder.coefficients))


class Combination(eqx.Module):
    """A bladder under a braid. Several may be stacked leaf by leaf, for `jax.vmap`.

    Attributes:
        bladder_diameter: D0 [m], outer; the braid's threads lie on it.
        bladder_thickness: t0 [m].
        nominal_diameter: [m], of the braid, at 45 deg.
        braid_thickness: [m].
        smallest_diameter: [m], at which the braid jams when stretched.
        largest_diameter: [m], at which the braid jams when shortened.
        rest_length: L0 [m], active length at rest; force against contraction does not depend on it.
    """

    bladder_diameter: Float[Given, "..."] = number("m")
    bladder_thickness: Float[Given, "..."] = number("m")
    nominal_diameter: Float[Given, "..."] = number("m")
    braid_thickness: Float[Given, "..."] = number("m")
    smallest_diameter: Float[Given, "..."] = number("m")
    largest_diameter: Float[Given, "..."] = number("m")
    rest_length: Float[Given, "..."] = number("m", default=1.0)

    @classmethod
    def of(
        cls, bladder: CatalogueBladder, braid: CatalogueBraid, rest_length: Real = 1.0
    ) -> "Combination":
        """The combination of two rows of the catalogue, of active length L0 [m]."""
        return cls(
            bladder_diameter=as_real(bladder.diameter),
            bladder_thickness=as_real(bladder.thickness),
            nominal_diameter=as_real(braid.nominal_diameter),
            braid_thickness=as_real(braid.thickness),
            smallest_diameter=as_real(braid.diameter_range[0]),
            largest_diameter=as_real(braid.diameter_range[1]),
            rest_length=as_real(rest_length),
        )

    @property
    def braid_angle(self) -> RealArray:
        """Initial braid angle theta0 [rad], from the circumference; see `fam_angle`."""
        return fam_angle(self.bladder_diameter, self.nominal_diameter)

    @property
    def braid(self) -> Braid:
        """The braid at rest on the bladder, its thickness neglected."""
        return Braid.from_rest(
            diameter=self.bladder_diameter, braid_angle=self.braid_angle, length=self.rest_length
        )

    @property
    def geometry(self) -> EstimatedGeometry:
        """The cylinder of braid and bladder, the thickness of the braid neglected."""
        bladder = Bladder(self.rest_length, self.bladder_diameter, self.bladder_thickness)
        return EstimatedGeometry(self.braid, bladder)

    def muscle(self, material: AbstractMaterial) -> Muscle:
        """The muscle in the estimated geometry, with a bladder of that material."""
        return Muscle(self.geometry, material)

    def contraction_at_diameter(self, diameter: Real) -> RealArray:
        """Contraction [-] at which the braid's diameter is D [m], 1 - sin(theta) / sin(theta0)."""
        angle = fam_angle(diameter, self.nominal_diameter)
        return 1 - jnp.sin(angle) / jnp.sin(self.braid_angle)

    def contraction_range(self) -> tuple[RealArray, RealArray]:
        """Least and greatest contraction [-] that jamming allows; rest is always allowed.

        A boundary combination rests outside the braid's range and is taken to work from there.
        """
        least = jnp.minimum(self.contraction_at_diameter(self.smallest_diameter), 0.0)
        return least, jnp.maximum(self.contraction_at_diameter(self.largest_diameter), 0.0)

    def diameter(self, contraction: Real) -> RealArray:
        """Braid diameter D [m] at a contraction [-], broadcast shape; nan where the braid jams."""
        length, free = self._length(contraction)
        return jnp.where(free, self.braid.diameter(length), jnp.nan)

    def outer_diameter(self, contraction: Real) -> RealArray:
        """Diameter [m] outside the braid at a contraction [-]; nan where the braid jams."""
        return self.diameter(contraction) + 2 * self.braid_thickness

    def force(
        self, contraction: Real, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Pull F [N] at a contraction [-] and gauge pressure P [Pa]; nan where the braid jams.

        Args:
            contraction: (L0 - L) / L0 [-], a fraction.
            pressure: gauge pressure P [Pa].
            material: of the bladder; None neglects the bladder, F = F_G.

        Returns:
            F [N], broadcast shape, not clipped: negative beyond the free contraction.

        References:
            Gaylord 1958; Chambers 2021, equations 6.1 and 6.9.
        """
        length, free = self._length(contraction)
        if material is None:
            radius = self.braid.diameter(length) / 2
            pull = gaylord_force(pressure, radius, self.braid.braid_angle(length))
        else:
            pull = self.muscle(material).force(length, pressure)
        return jnp.where(free, pull, jnp.nan)

    def free_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at zero force, jamming left aside, of the pressure's shape.

        Without a material it is that of the neutral angle, whatever the pressure. With one it is
        nan where the force does not fall to zero, as below the pressure that moves the bladder.
        """
        if material is not None:
            return self.muscle(material).free_contraction(pressure, throw=False)
        neutral = 1 - math.sin(NEUTRAL_ANGLE) / jnp.sin(self.braid_angle)
        return jnp.broadcast_to(neutral, jnp.broadcast_shapes(neutral.shape, jnp.shape(pressure)))

    def usable_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at which the muscle runs out of force or its braid jams, if sooner."""
        return jnp.minimum(self.free_contraction(pressure, material), self.contraction_range()[1])

    def _length(self, contraction: Real) -> tuple[RealArray, Array]:
        """Length [m], that of rest standing in where the braid jams, and where it does not jam."""
        least, greatest = self.contraction_range()
        rounding = 8 * jnp.finfo(least.dtype).eps  # the ends themselves are free
        at = as_real(contraction)
        free = (at >= least - rounding) & (at <= greatest + rounding)
        return self.rest_length * (1 - jnp.where(free, at, 0.0)), free

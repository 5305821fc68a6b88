"""A bladder under a braid: whether they fit, and what the muscle of the two does.

The braid's angle on a bladder follows from cos(theta) / D = cos(45 deg) / D_nominal. As in the
reference work's table 2.3, D is the bladder's outer diameter: the thickness of the braid is left
out of the force and counted only in the diameter outside the braid.
"""

import enum

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from .._arrays import Given, Real, RealArray, as_real
from ..braids import Braid, braid_angle_from_diameter, gaylord_force, thread_tension
from ..geometries import Bladder, EstimatedGeometry
from ..materials import AbstractMaterial
from ..muscle import Muscle
from ..parameters import number
from .catalogue import NOMINAL_ANGLE, CatalogueBladder, CatalogueBraid

_HALVINGS = 52  # to the last bit of a float64 fraction
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

    def usable_contraction(
        self, pressure: Real, material: AbstractMaterial | None = None
    ) -> RealArray:
        """Contraction [-] at which the muscle runs out of force or its braid jams, if sooner.

        Bisected, with the derivative of the implicit function theorem; zero or nan where the pressure
        does not move the bladder. Of the pressure's shape.
        """
        greatest = self.contraction_range()[1]

        def one(P: RealArray) -> RealArray:
            def force(contraction: RealArray) -> RealArray:
                return self.force(contraction, P, material)

            def halved(_: Array, ends: tuple[RealArray, RealArray]) -> tuple[RealArray, RealArray]:
                low, high = ends
                middle = (low + high) / 2
                pulls = force(middle) > 0
                return jnp.where(pulls, middle, low), jnp.where(pulls, high, middle)

            ends = jnp.zeros_like(greatest), greatest
            low, high = jax.lax.stop_gradient(jax.lax.fori_loop(0, _HALVINGS, halved, ends))
            zero = (low + high) / 2
            pull, slope = jax.value_and_grad(force)(zero)
            zero = zero - (pull - jax.lax.stop_gradient(pull)) / jax.lax.stop_gradient(slope)
            found = jnp.where(force(greatest) > 0, greatest, zero)
            return jnp.where(force(jnp.zeros_like(greatest)) > 0, found, jnp.nan)

        return jnp.vectorize(one)(as_real(pressure))

    def _length(self, contraction: Real) -> tuple[RealArray, Array]:
        """Length [m], that of rest standing in where the braid jams, and where it does not jam."""
        least, greatest = self.contraction_range()
        rounding = 8 * jnp.finfo(least.dtype).eps  # the ends themselves are free
        at = as_real(contraction)
        free = (at >= least - rounding) & (at <= greatest + rounding)
        return self.rest_length * (1 - jnp.where(free, at, 0.0)), free


def safety_factor(failure: Real, working: Real) -> RealArray:
    """Safety factor [-]: the load or pressure that failed in a test over the greatest one in use.

    Args:
        failure: burst pressure [Pa] or tensile failure load [N].
        working: greatest pressure [Pa] or pull [N] in use, of the same kind.

    Returns:
        Factor [-], broadcast shape.

    References:
        Chambers 2021, chapter 2: 280 psi and 2147 lbf.

    >>> print(f"{safety_factor(280, 100):.1f} {safety_factor(2147, 1049):.2f}")  # psi; lbf
    2.8 2.05
    """
    return jnp.asarray(failure) / working


def thread_strength_margin(
    force: Real,
    pressure: Real,
    radius: Real,
    braid_angle: Real,
    *,
    n_threads: Real,
    breaking_load: Real,
) -> RealArray:
    """Strength margin of the threads [-]: the load that breaks one over its tension in use.

    The tension is that of `famjax.braids.thread_tension`; all threads are taken to carry the same.

    Args:
        force: pull F [N] of the muscle.
        pressure: gauge pressure P [Pa].
        radius: braid radius R [m].
        braid_angle: theta [rad], from the circumference.
        n_threads: n [-], of both families.
        breaking_load: of one thread [N].

    Returns:
        Factor [-], broadcast shape; 1 where a thread breaks.

    References:
        Chambers 2021, section 5.1: a thread breaks at 59.3 lbf.

    >>> margin = thread_strength_margin(1058, 100, 0.522, 1.2032, n_threads=144, breaking_load=59.3)
    >>> round(float(margin), 1)  # psi, in, lbf
    7.0
    """
    tension = thread_tension(force, pressure, radius, braid_angle, n_threads)
    return safety_factor(breaking_load, tension)

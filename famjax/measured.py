"""Compute lengths, areas and volumes of a measured shape by quadrature along the axis.

A profile is integrated by Gauss-Legendre quadrature after the substitution x = u^2 (3 - 2 u), which
also handles ends with a vertical tangent, dR/dz ~ 1 / sqrt(z).
"""

import functools
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Real, RealArray, as_real, at_each, compiled_method
from .braids import AbstractBraid
from .geometries import AbstractGeometry, Bladder, Dimensions, cylinder_dimensions
from .surfaces import AbstractMeasuredFamily

QUADRATURE_ORDER = 64
"""Default number of stations. The relative error is below 1e-8 for Fourier profiles with up to five
terms, and below 1e-12 for the reference work's profiles."""


class Meridian(eqx.Module):
    """A profile evaluated at quadrature stations, and its integrals.

    Attributes:
        length: L [m].
        radius: R [m], shape (..., stations).
        slope: dR/dz [-], shape (..., stations).
        weights: quadrature weights, shape (stations,); they sum to 1.
    """

    length: RealArray
    radius: Float[Array, "... stations"]
    slope: Float[Array, "... stations"]
    weights: Float[Array, " stations"]

    @classmethod
    def of(
        cls,
        diameter: Callable[[RealArray, RealArray], RealArray],
        length: Real,
        *,
        order: int = QUADRATURE_ORDER,
    ) -> "Meridian":
        """Evaluate an outline at the quadrature stations.

        Args:
            diameter: function D(x, L), such as the method `diameter` of a profile.
            length: active length L [m], > 0.
            order: number of quadrature stations, >= 1.

        Returns:
            The meridian; its arrays have the shape of the length, plus a last axis of stations.

        Raises:
            RuntimeError: the diameter is not positive everywhere.

        >>> from famjax.profiles import FourierProfile
        >>> print(f"{Meridian.of(FourierProfile(2.0, [0.0], [0.0], 1.0).diameter, 3.0).volume:.3f}")
        9.425
        """
        length = as_real(length)
        x, weights = (jnp.asarray(one.astype(length.dtype)) for one in quadrature(order))
        D, rate = jax.jvp(lambda x: diameter(x, length[..., None]), (x,), (jnp.ones_like(x),))
        radius = _positive(D / 2, "the diameter of a profile must be > 0 from x = 0 to 1")
        return cls(length, radius, rate / (2 * length[..., None]), weights)

    def inset(self, thickness: Real) -> "Meridian":
        """Offset the meridian radially inwards by a thickness [m], to obtain the bladder's outer surface.

        Raises:
            RuntimeError: the thickness exceeds the radius somewhere.
        """
        radius = _positive(
            self.radius - thickness, "the radius of a profile must exceed the braid's thickness"
        )
        return Meridian(self.length, radius, self.slope, self.weights)

    def mean(self, values: Float[Array, "... stations"]) -> RealArray:
        """Return the axial mean of the values at the stations."""
        return jnp.sum(self.weights * values, axis=-1)

    @property
    def mean_diameter(self) -> RealArray:
        """Average diameter [m] along the axis."""
        return 2 * self.mean(self.radius)

    @property
    def arc_length(self) -> RealArray:
        """Length [m] of the meridian from fitting to fitting, excluding the faces of steps."""
        return self.length * self.mean(jnp.sqrt(1 + self.slope**2))

    @property
    def surface_area(self) -> RealArray:
        """Lateral area [m2] of the surface of revolution, excluding the faces of steps."""
        element = self.radius * jnp.sqrt(1 + self.slope**2)
        return 2 * jnp.pi * self.length * self.mean(element)

    @property
    def volume(self) -> RealArray:
        """Volume [m3] within the surface of revolution."""
        return jnp.pi * self.length * self.mean(self.radius**2)

    def thickness(self, bladder_volume: Real) -> RealArray:
        """Return the uniform wall thickness t [m] of a bladder with this outer meridian: volume / area.

        References:
            Chambers 2021, section 6.1.
        """
        return jnp.asarray(bladder_volume / self.surface_area)

    def axial_strain(self, rest_length: Real) -> RealArray:
        """Return the axial engineering strain eps_z [-] of this meridian: arc length / L0 - 1.

        References:
            Chambers 2021, section 6.1.
        """
        return self.arc_length / rest_length - 1

    def hoop_strain(self, bladder: Bladder) -> Float[Array, "... stations"]:
        """Return the mid-wall hoop engineering strain eps_c [-] of a bladder with this outer meridian.

        Args:
            bladder: bladder whose volume determines the wall thickness. If it is `embedded`, this meridian
                lies at mid-wall.

        Returns:
            (R - t / 2) / (R_0 - t_0 / 2) - 1 at the stations, shape (..., stations).

        Raises:
            RuntimeError: the wall closes the bore somewhere.

        References:
            Chambers 2021, section 6.1.
        """
        inward = 0.0 if bladder.embedded else 0.5
        thickness = self.thickness(bladder.volume)[..., None]
        bore = self.radius - (0.5 + inward) * thickness
        radius = eqx.error_if(
            self.radius,
            bore <= 0,
            "the radius of a profile must be large enough to leave a bore, but the rubber fills it. "
            "Check the profile and the bladder's rest diameter, thickness and length, and use the same "
            "unit for all of them",
        )
        return (radius - inward * thickness) / bladder.rest_mid_radius - 1


@functools.cache
def quadrature(order: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the Gauss-Legendre rule in u on [0, 1]: stations x = u^2 (3 - 2 u), weights w 6 u (1 - u).

    The weights sum to 1.
    """
    if order < 1:
        raise ValueError(f"the quadrature order must be >= 1, got {order}")
    nodes, weights = np.polynomial.legendre.leggauss(order)
    u = (nodes + 1) / 2
    shares = 3 * weights * u * (1 - u)
    return u**2 * (3 - 2 * u), shares / shares.sum()


def _positive(radius: RealArray, must: str) -> RealArray:
    """Raise an error if a radius or diameter [m] is not positive; nan is passed through."""
    return eqx.error_if(
        radius,
        radius <= 0,
        f"{must}. Check the profile's coefficients, and that the length lies within the measured range",
    )


class _OfProfiles(AbstractGeometry):
    """A geometry based on a family of measured profiles; dimensions are nan outside `length_range`."""

    family: eqx.AbstractVar[AbstractMeasuredFamily]
    bladder: eqx.AbstractVar[Bladder]

    @property
    def braid(self) -> AbstractBraid:
        """Braid of the family of profiles."""
        return self.family.braid

    @property
    def keeps_apart(self) -> bool:
        """Always True, because impossible states are masked before any computation."""
        return True

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the family's shortest and longest length [m]: the measured range plus its margin."""
        return self.family.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m], taken from the bladder."""
        return self.bladder.rest_length


class MeasuredGeometry(_OfProfiles):
    """The measured geometry: strains and thickness follow from the bladder's measured outline.

    The axial strain is eps_z = arc length / L0 - 1, the wall thickness is t = V / surface area, and eps_c
    is evaluated at every station. The force terms use the average diameter D, with
    theta = atan(L / (pi N D)). The bladder's outline lies inside the measured outline, at a radial distance
    t_braid; for an `embedded` bladder, the two coincide.

    Outside `length_range`, the dimensions are nan.

    Attributes:
        family: measured profiles, and the braid that scales them with pressure.
        bladder: rubber tube under, or embedded in, the braid.
        order: number of quadrature stations.

    Raises:
        RuntimeError: the wall closes the bore within the range of lengths. The error is raised on
            construction or, if the numbers are traced, in `dimensions`.

    References:
        Chambers 2021, chapter 6, "measured".
    """

    family: AbstractMeasuredFamily
    bladder: Bladder
    order: int = eqx.field(static=True, default=QUADRATURE_ORDER)

    def __check_init__(self) -> None:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        lengths = jnp.linspace(*self.length_range(), 33)
        self.dimensions(lengths, self.family.middle_pressure())

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Return the dimensions at active length L [m] and gauge pressure P [Pa]; arguments broadcast."""
        length, pressure, thread_length, reached = _states(self.family, length, pressure)
        bladder, inset = self.bladder, 0.0 if self.bladder.embedded else self.braid.thickness

        def one(length: RealArray, pressure: RealArray) -> tuple[RealArray, ...]:
            diameter = functools.partial(self.family.diameter, pressure=pressure)
            outline = Meridian.of(diameter, length, order=self.order)
            line = outline.inset(inset)
            strains = line.axial_strain(bladder.rest_length), line.hoop_strain(bladder)
            return outline.mean_diameter, line.thickness(bladder.volume), *strains, outline.volume

        diameter, thickness, axial_strain, hoop_strain, volume = at_each(one, length, pressure)
        return Dimensions(
            length=length,
            radius=diameter / 2,
            braid_angle=_braid_angle(length, diameter, self.braid),
            turns=self.braid.turns,
            thickness=thickness,
            axial_strain=axial_strain,
            hoop_strain=hoop_strain,
            station_weights=jnp.asarray(quadrature(self.order)[1].astype(length.dtype)),
            bladder_volume=self.bladder.volume,
            volume=volume,
            thread_length=thread_length,
        ).unless(reached)


class AverageDiameterGeometry(_OfProfiles):
    """A cylinder with the measured average diameter: only D differs from the estimated geometry.

    Outside `length_range`, the dimensions are nan.

    Attributes:
        family: measured profiles, and the braid that scales them with pressure.
        bladder: rubber tube under, or embedded in, the braid.
        order: number of quadrature stations.

    References:
        Chambers 2021, chapter 6, "measured average diameter".
    """

    family: AbstractMeasuredFamily
    bladder: Bladder
    order: int = eqx.field(static=True, default=QUADRATURE_ORDER)

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Return the dimensions at active length L [m] and gauge pressure P [Pa]; arguments broadcast."""
        length, pressure, thread_length, reached = _states(self.family, length, pressure)
        x, weights = (one.astype(length.dtype) for one in quadrature(self.order))
        diameter = self.family.diameter(x, length[..., None], pressure[..., None])
        must = "the diameter of a profile must be > 0 from x = 0 to 1"
        radius = _positive(diameter / 2, must) @ weights
        angle = _braid_angle(length, 2 * radius, self.braid)
        return cylinder_dimensions(
            length, radius, angle, thread_length, self.braid, self.bladder, reached
        )


def _states(
    family: AbstractMeasuredFamily, length: Real, pressure: Real
) -> tuple[RealArray, RealArray, RealArray, Bool[Array, "..."]]:
    """Return lengths [m], pressures [Pa], thread lengths [m] and a mask of states with a known shape.

    All other states are replaced with a state in the middle of the measured range.
    """
    length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
    middle = jax.lax.stop_gradient((family.lengths[0] + family.lengths[-1]) / 2)
    at = jnp.where(family.knows(length), length, middle)
    found = family.braid.thread_length(at, pressure)
    reached = family.knows(length) & (at < found)
    at = jnp.where(reached, at, middle)
    measured = jax.lax.stop_gradient(family.middle_pressure())
    thread_length = jnp.where(reached, found, 2 * at)
    return at, jnp.where(reached, pressure, measured), thread_length, reached


def _braid_angle(length: RealArray, diameter: RealArray, braid: AbstractBraid) -> RealArray:
    return jnp.arctan2(length, jnp.pi * braid.turns * diameter)

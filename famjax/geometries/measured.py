"""The two geometries that follow from measured shapes: with every station, and by the average."""

import equinox as eqx
import jax
import jax.numpy as jnp
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from .._compiled import compiled_method
from .._each import at_each
from .._types import Real, RealArray, as_real
from ..braids.inextensible import AbstractBraid
from ..profiles.family import AbstractMeasuredFamily
from .bladder import Bladder
from .dimensions import AbstractGeometry, Dimensions
from .estimated import cylinder_dimensions
from .meridian import QUADRATURE_ORDER, Meridian, quadrature


class MeasuredGeometry(AbstractGeometry):
    """The muscle as measured: strain and thickness follow the bladder's line in the photograph.

    eps_z = arc length / L0 - 1, t = V / surface area, eps_c at every station; the force terms use
    the average diameter, with theta = atan(L / (pi N D)). The bladder's line lies t_braid below the
    outline, along the radius, or is the outline where the bladder is `embedded`.

    Outside `length_range` the shape is not known and the dimensions are nan.

    Attributes:
        family: measured profiles, and the braid that scales them in pressure.
        bladder: rubber tube under, or in, the braid.
        order: quadrature stations in each smooth piece of the profiles.

    Raises:
        RuntimeError: the wall closes the bore somewhere within the range of lengths; at
            construction on concrete numbers, in `dimensions` on traced ones.

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

    @property
    def braid(self) -> AbstractBraid:
        """The family's braid."""
        return self.family.braid

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape."""
        length, pressure, thread_length, reached = _states(self.family, length, pressure)
        diameter, thickness, axial_strain, hoop_strain, volume = _measures(
            self.family, self.bladder, self.order, length, pressure
        )
        return Dimensions(
            length=length,
            radius=diameter / 2,
            braid_angle=_braid_angle(length, diameter, self.braid),
            turns=self.braid.turns,
            thickness=thickness,
            axial_strain=axial_strain,
            hoop_strain=hoop_strain,
            station_weights=quadrature(self.family.kinks, self.order)[1],
            bladder_volume=self.bladder.volume,
            volume=volume,
            thread_length=thread_length,
        ).unless(reached)

    @property
    def keeps_apart(self) -> bool:
        """States that cannot be are masked before anything is computed of them."""
        return True

    def length_range(self) -> tuple[RealArray, RealArray]:
        """The family's: the measured lengths, and its margin of extrapolation beyond."""
        return self.family.length_range()

    @property
    def breakpoints(self) -> Float[Array, " lengths"]:
        """Active lengths [m] of the profiles, between which the family interpolates."""
        return self.family.lengths

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the bladder's."""
        return self.bladder.rest_length


class AverageDiameterGeometry(AbstractGeometry):
    """A cylinder of the measured average diameter: it differs from the estimated one in D alone.

    Outside `length_range` the shape is not known and the dimensions are nan.

    Attributes:
        family: measured profiles, and the braid that scales them in pressure.
        bladder: rubber tube under, or in, the braid.
        order: quadrature stations in each smooth piece of the profiles.

    References:
        Chambers 2021, chapter 6, "measured average diameter".
    """

    family: AbstractMeasuredFamily
    bladder: Bladder
    order: int = eqx.field(static=True, default=QUADRATURE_ORDER)

    @property
    def braid(self) -> AbstractBraid:
        """The family's braid."""
        return self.family.braid

    @compiled_method
    def dimensions(self, length: Real, pressure: Real) -> Dimensions:
        """Dimensions at active length L [m] and gauge pressure P [Pa], of broadcast shape."""
        length, pressure, thread_length, reached = _states(self.family, length, pressure)
        radius = _mean_diameter(self.family, self.order, length, pressure) / 2
        angle = _braid_angle(length, 2 * radius, self.braid)
        return cylinder_dimensions(
            length, radius, angle, thread_length, self.braid, self.bladder, reached
        )

    @property
    def keeps_apart(self) -> bool:
        """States that cannot be are masked before anything is computed of them."""
        return True

    def length_range(self) -> tuple[RealArray, RealArray]:
        """The family's: the measured lengths, and its margin of extrapolation beyond."""
        return self.family.length_range()

    @property
    def breakpoints(self) -> Float[Array, " lengths"]:
        """Active lengths [m] of the profiles, between which the family interpolates."""
        return self.family.lengths

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction: the bladder's."""
        return self.bladder.rest_length


def _states(
    family: AbstractMeasuredFamily, length: Real, pressure: Real
) -> tuple[RealArray, RealArray, RealArray, Bool[Array, "..."]]:
    """Lengths [m], pressures [Pa], thread lengths [m], and where the shape is known.

    Elsewhere they are those of a state in the middle of what was measured.
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


@eqx.filter_jit
def _measures(
    family: AbstractMeasuredFamily,
    bladder: Bladder,
    order: int,
    length: RealArray,
    pressure: RealArray,
) -> tuple[RealArray, ...]:
    """Mean diameter [m], thickness [m], axial strain, hoop strain at the stations, volume [m3]."""
    inset = 0.0 if bladder.embedded else family.braid.thickness

    def one(length: RealArray, pressure: RealArray) -> tuple[RealArray, ...]:
        outline = Meridian.of(family.at(pressure), length, order=order)
        line = outline.inset(inset)
        return (
            outline.mean_diameter,
            line.thickness(bladder.volume),
            line.axial_strain(bladder.rest_length),
            line.hoop_strain(bladder),
            outline.volume,
        )

    return at_each(one, length, pressure)


@eqx.filter_jit
def _mean_diameter(
    family: AbstractMeasuredFamily, order: int, length: RealArray, pressure: RealArray
) -> RealArray:
    """Average diameter [m] over the axis."""
    x, weights = quadrature(family.kinks, order)
    return jnp.sum(weights * family.diameter(x, length[..., None], pressure[..., None]), axis=-1)


def _braid_angle(length: RealArray, diameter: RealArray, braid: AbstractBraid) -> RealArray:
    """Braid angle theta [rad] of a cylinder, atan(L / (pi N D)), from the circumference."""
    return jnp.arctan2(length, jnp.pi * braid.turns * diameter)

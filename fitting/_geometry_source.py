"""From identified geometry parameters to a geometry: which of the four a fit is made with."""

import abc

import equinox as eqx
from jaxtyping import Array, Float

import famjax

from ._data import Specimen


class AbstractGeometrySource(eqx.Module):
    """Makes a geometry of the braid diameter D0 [m] and braid angle theta0 [rad] at rest."""

    @abc.abstractmethod
    def geometry(
        self, diameter: Float[Array, ""], braid_angle: Float[Array, ""]
    ) -> famjax.AbstractGeometry:
        """The geometry of these two parameters."""


class EstimatedSource(AbstractGeometrySource):
    """A cylinder in a braid that follows from D0 and theta0: both estimated geometries.

    Attributes:
        specimen: rest length, wall and place of the bladder.
        n_threads: n [-] of an elastic braid; None for an inextensible one.
        thread: law of one thread; None for inextensible ones.
    """

    specimen: Specimen = eqx.field(static=True)
    n_threads: float | None = None
    thread: famjax.AbstractThread | None = None

    def __check_init__(self) -> None:
        if (self.n_threads is None) != (self.thread is None):
            raise ValueError(
                "an elastic braid needs both the number of threads and the law of one thread; "
                "give neither for inextensible threads"
            )

    def geometry(
        self, diameter: Float[Array, ""], braid_angle: Float[Array, ""]
    ) -> famjax.AbstractGeometry:
        """The cylinder with that braid; D0 and theta0 belong to the unloaded threads."""
        specimen = self.specimen
        braid: famjax.AbstractBraid = famjax.Braid.from_rest(
            diameter=diameter,
            braid_angle=braid_angle,
            length=specimen.rest_length,
            thickness=specimen.braid_thickness,
        )
        if self.thread is not None and self.n_threads is not None:
            braid = famjax.ElasticBraid(
                braid.rest_thread_length, braid.turns, braid.thickness, self.n_threads, self.thread
            )
        inset = 0.0 if specimen.embedded else 2 * specimen.braid_thickness
        bladder = famjax.Bladder(
            rest_length=specimen.rest_length,
            rest_diameter=specimen.bladder_diameter or diameter - inset,
            rest_thickness=specimen.wall_thickness,
            embedded=specimen.embedded,
        )
        return famjax.EstimatedGeometry(braid, bladder)


class KnownSource(AbstractGeometrySource):
    """A geometry that is known, such as a measured one: nothing of it is identified.

    Attributes:
        known: what every parameter gives.
    """

    known: famjax.AbstractGeometry

    def geometry(
        self, diameter: Float[Array, ""], braid_angle: Float[Array, ""]
    ) -> famjax.AbstractGeometry:
        """The known geometry."""
        del diameter, braid_angle
        return self.known

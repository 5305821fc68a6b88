"""From identified parameters to a geometry: which of the four a fit is made with, or another."""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from ..data.force_data import Specimen

Values = Mapping[str, famjax.Real]
"""Parameters of one specimen by name, SI."""


class SpecimenNumbers(eqx.Module):
    """The numbers of a specimen as arrays: another specimen is another input of one program.

    Attributes:
        rest_length, wall_thickness, bladder_diameter, braid_thickness, embedded: of `Specimen`.
    """

    rest_length: Float[np.ndarray, ""]
    wall_thickness: Float[np.ndarray, ""]
    bladder_diameter: Float[np.ndarray, ""] | None
    braid_thickness: Float[np.ndarray, ""]
    embedded: bool = eqx.field(static=True)

    @classmethod
    def of(cls, specimen: Specimen) -> "SpecimenNumbers":
        """The numbers of a specimen."""
        bladder = specimen.bladder_diameter
        return cls(
            np.asarray(specimen.rest_length, float),
            np.asarray(specimen.wall_thickness, float),
            None if bladder is None else np.asarray(bladder, float),
            np.asarray(specimen.braid_thickness, float),
            specimen.embedded,
        )


class AbstractGeometrySource(eqx.Module):
    """Makes a geometry of a specimen's parameters."""

    @abc.abstractmethod
    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The geometry of these parameters [SI]; those it does not know are ignored."""

    @property
    def stretches(self) -> bool:
        """Whether dimensions depend on pressure."""
        return True

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """What can be identified of it besides the parameters of every fit, by name."""
        return {}

    def as_arrays(self) -> "AbstractGeometrySource":
        """The same source, its numbers arrays, so that another specimen is no other program."""
        return self


class EstimatedSource(AbstractGeometrySource):
    """A cylinder in a braid that follows from D0 and theta0: both estimated geometries.

    It reads `braid_diameter` and `braid_angle`, both of the unloaded threads, and where they are
    given `rest_length`, `braid_compliance`, and `end_factor` k or the dead length l of rounded
    ends, `end_length`, which is the same in muscles of any length: k = L0/(L0 - l).

    Attributes:
        specimen: rest length, wall and place of the bladder.
        n_threads: n [-] of an elastic braid; None for an inextensible one.
        thread: law of one thread; None for inextensible ones.
    """

    specimen: Specimen | SpecimenNumbers
    n_threads: float | None = None
    thread: famjax.braids.AbstractThread | None = None

    def __check_init__(self) -> None:
        if (self.n_threads is None) != (self.thread is None):
            raise ValueError(
                "an elastic braid needs both the number of threads and the law of one thread; "
                "give neither for inextensible threads"
            )

    @property
    def stretches(self) -> bool:
        """Whether the threads are elastic."""
        return self.thread is not None

    def as_arrays(self) -> "EstimatedSource":
        """The same source with the specimen's numbers as arrays."""
        assert isinstance(self.specimen, Specimen)
        return EstimatedSource(SpecimenNumbers.of(self.specimen), self.n_threads, self.thread)

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The cylinder with that braid, behind its end effect if there is one."""
        specimen, diameter = self.specimen, values["braid_diameter"]
        rest_length = values.get("rest_length", specimen.rest_length)
        inset = 0.0 if specimen.embedded else 2 * specimen.braid_thickness
        bladder = famjax.Bladder(
            rest_length=rest_length,
            rest_diameter=(
                diameter - inset if specimen.bladder_diameter is None else specimen.bladder_diameter
            ),
            rest_thickness=specimen.wall_thickness,
            embedded=specimen.embedded,
        )
        cylinder = famjax.EstimatedGeometry(self._braid(values, rest_length), bladder)
        if "end_factor" in values:
            return famjax.geometries.EndEffectGeometry(cylinder, values["end_factor"])
        if "end_length" in values:
            factor = rest_length / (rest_length - values["end_length"])
            return famjax.geometries.EndEffectGeometry(cylinder, factor)
        return cylinder

    def _braid(self, values: Values, rest_length: famjax.Real) -> famjax.braids.AbstractBraid:
        braid = famjax.Braid.from_rest(
            diameter=values["braid_diameter"],
            braid_angle=values["braid_angle"],
            length=rest_length,
            thickness=self.specimen.braid_thickness,
        )
        if self.thread is not None and self.n_threads is not None:
            return famjax.ElasticBraid(
                braid.rest_thread_length, braid.turns, braid.thickness, self.n_threads, self.thread
            )
        if "braid_compliance" in values:
            return famjax.braids.CompliantBraid.of(braid, values["braid_compliance"])
        return braid


class KnownSource(AbstractGeometrySource):
    """A geometry that is known, such as a measured one, but for what is named of its parameters.

    Attributes:
        known: what every parameter gives.
        identified: names of its declared parameters that are not known.
    """

    known: famjax.geometries.AbstractGeometry
    identified: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """What the geometry declares."""
        return self.known.declared()

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The known geometry, with what is identified of it."""
        if not self.identified:
            return self.known
        return self.known.with_parameters({name: values[name] for name in self.identified})


class WrappedSource(AbstractGeometrySource):
    """A user's geometry around the estimated one.

    Attributes:
        inner: makes the estimated geometry.
        wrap: from that to the other geometry.
        identified: names of its declared parameters that take part.
    """

    inner: AbstractGeometrySource
    wrap: Callable[[famjax.geometries.AbstractGeometry], famjax.geometries.AbstractGeometry] = (
        eqx.field(static=True)
    )
    identified: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """What the outer geometry declares and the estimated one does not."""
        inner = self.inner.geometry({"braid_diameter": 0.02, "braid_angle": 1.1})
        return {
            n: d for n, d in self._around(inner).declared().items() if n not in inner.declared()
        }

    def _around(
        self, inner: famjax.geometries.AbstractGeometry
    ) -> famjax.geometries.AbstractGeometry:
        """The outer geometry; of a class, with the middle of the range of what has no default.

        Raises:
            InputError: the class has fields that cannot be told, or what is made is no geometry.
        """
        wrap: Any = self.wrap
        try:
            if isinstance(wrap, type) and issubclass(wrap, famjax.geometries.AbstractGeometry):
                fields: Any = dataclasses.fields(wrap)
                first, *others = (one for one in fields if one.init)
                known = all(one.default is not dataclasses.MISSING for one in others)
                make: Any = wrap
                made = make(inner) if known else make.template(**{first.name: inner})
            else:
                made = wrap(inner)
        except (TypeError, ValueError) as error:
            name = getattr(wrap, "__name__", type(wrap).__name__)
            raise InputError(
                f"the geometry {name} cannot be made of the estimated one alone: {error}"
            ) from None
        if not isinstance(made, famjax.geometries.AbstractGeometry):
            raise InputError(
                "what makes a geometry must return one, derived from "
                f"famjax.geometries.AbstractGeometry; got a {type(made).__name__}"
            )
        return made

    def as_arrays(self) -> "WrappedSource":
        """The same source with the specimen's numbers as arrays."""
        return WrappedSource(self.inner.as_arrays(), self.wrap, self.identified)

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The outer geometry of these parameters."""
        outer = self._around(self.inner.geometry(values))
        return outer.with_parameters({name: values[name] for name in self.identified})

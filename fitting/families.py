"""Families of muscles: a law, a source of the geometry, and the muscle that their numbers make.

A law may be any material whose class declares its numbers.

Of the declared numbers those in which the force is affine are the coefficients, which every fit
solves for in one convex programme; the others give the law its shape and are searched.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.boundary.errors import InputError, class_named, class_path

from .arguments import check_whole
from .data import Specimen
from .parameters import Entry
from .response import AbstractFamily, Values

_MAX_ORDER = 8


class Law(eqx.Module):
    """A material as a family of laws in its declared numbers.

    Attributes:
        material: any member of the family.
    """

    material: famjax.materials.AbstractMaterial

    @property
    def coefficients(self) -> dict[str, Entry]:
        """The numbers in which the stress is linear, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if d.linear}

    @property
    def shape(self) -> dict[str, Entry]:
        """The numbers in which it is not, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if not d.linear}

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    @property
    def name(self) -> str:
        """What the command line calls it: a known name, or `module:Class`."""
        return type(self.material).law_name or class_path(type(self.material))

    def with_values(self, values: Mapping[str, famjax.Real]) -> famjax.materials.AbstractMaterial:
        """The material of these values [SI], which hold at least those of the law."""
        return self.material.with_parameters({n: values[n] for n in self.material.declared()})


def _entry(declared: famjax.parameters.Declared) -> Entry:
    return Entry(declared.low, declared.high, declared.kind)


def known_laws() -> dict[str, type[famjax.materials.AbstractMaterial]]:
    """The laws of famjax that can be identified, by name."""
    laws = (
        famjax.PolynomialMaterial,
        famjax.materials.OgdenMaterial,
        famjax.materials.MooneyRivlinMaterial,
        famjax.materials.SaturatingMaterial,
        famjax.materials.MonotoneMaterial,
        famjax.materials.NeoHookeanMaterial,
        famjax.materials.YeohMaterial,
    )
    return {law.law_name: law for law in laws}


LawGiven = str | Law | type[famjax.materials.AbstractMaterial] | famjax.materials.AbstractMaterial
"""What a law may be given as."""


def law_named(law: LawGiven, order: int | None) -> Law:
    """The law of that name, class or material; `order` is for the polynomial alone.

    Raises:
        InputError: an unknown name, an order for a law that has none, or a class that declares
            nothing to identify.
    """
    if isinstance(law, Law):
        return law
    given = law if isinstance(law, str) else getattr(law, "__name__", type(law).__name__)
    if isinstance(law, str) and ":" in law:
        law = class_named(law, famjax.materials.AbstractMaterial, "law")
    elif isinstance(law, str):
        laws = known_laws()
        if law not in laws:
            raise InputError(
                f"the law must be one of {', '.join(laws)}, or module:Class for one of your own; "
                f"got {law!r}"
            )
        law = laws[law]
    if law is famjax.PolynomialMaterial:
        order = check_whole("the order of the law", 3 if order is None else order, 1, _MAX_ORDER)
        return Law(famjax.PolynomialMaterial.template(order=order))
    if order is not None:
        raise InputError(
            f"only the polynomial law has an order, got {order} for {given}: leave the order out, or "
            "name the law polynomial"
        )
    try:
        material = law.template() if isinstance(law, type) else law
    except ValueError as error:
        raise InputError(f"{given} cannot be identified by its class alone: {error}") from None
    if not isinstance(material, famjax.materials.AbstractMaterial):
        raise InputError(
            f"a law is a name, a famjax.materials.AbstractMaterial or its class, got {given}"
        )
    if not material.declared():
        raise InputError(
            f"{given} declares no number to identify: declare its fields by "
            "famjax.parameter(unit, low=..., high=..., linear=...)"
        )
    return Law(material)


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
        *sizes, embedded = (getattr(specimen, one.name) for one in dataclasses.fields(cls))
        arrays: Any = (None if one is None else np.asarray(one, float) for one in sizes)
        return cls(*arrays, embedded=embedded)


class AbstractGeometrySource(eqx.Module):
    """Makes a geometry of a specimen's parameters."""

    @abc.abstractmethod
    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """The geometry built from these parameters [SI]; parameters it does not use are ignored."""

    @property
    def stretches(self) -> bool:
        """Whether dimensions depend on pressure."""
        return True

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """What can be identified of it besides the parameters of every fit, by name."""
        return {}

    def muscle(
        self,
        values: Values,
        material: famjax.materials.AbstractMaterial,
        further: famjax.terms.SumOfTerms | None,
    ) -> famjax.AbstractMuscle:
        """The muscle of these parameters, with that law and further terms besides those of every muscle."""
        return assembled(self.geometry(values), material, values["deadband_pressure"], further)

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


def assembled(
    geometry: famjax.geometries.AbstractGeometry,
    material: famjax.materials.AbstractMaterial,
    deadband: famjax.Real,
    further: famjax.terms.SumOfTerms | None,
) -> famjax.Muscle:
    """A muscle with force terms besides those that every muscle has.

    Args:
        geometry: of the muscle.
        material: of its bladder.
        deadband: P_d [Pa]; of no account where further terms have one of their own.
        further: the terms, or None.
    """
    if further is None:
        return famjax.Muscle(geometry, material, deadband)
    wall = famjax.terms.BladderWall(material)
    if "deadband_pressure" in further.declared():  # they have a pressure term of their own
        return famjax.Muscle(geometry, wall + further)
    return famjax.Muscle(geometry, wall + famjax.terms.PressurisedBraid(deadband) + further)


class MuscleFamily(AbstractFamily):
    """Muscles of a specimen.

    Attributes:
        nonlinear: names of the parameters that are searched.
        source: makes the geometry, its numbers arrays.
        law: of the bladder.
        rest: L0 [m] of the specimen.
        terms: further force terms, or None.
        nodes: two pressures [Pa] between which the coefficients are linear, or None: they are fixed.
    """

    nonlinear: tuple[str, ...] = eqx.field(static=True)
    source: AbstractGeometrySource
    law: Law
    rest: Float[np.ndarray, ""]
    terms: famjax.terms.SumOfTerms | None = None
    nodes: Float[np.ndarray, " nodes"] | None = None

    @property
    def linear(self) -> tuple[str, ...]:
        """Names of the coefficients, node by node."""
        names = tuple(self.law.coefficients)
        if self.nodes is None:
            return names
        return tuple(f"{name}@{k}" for k in range(len(self.nodes)) for name in names)

    @property
    def stretches(self) -> bool:
        """Whether dimensions depend on pressure."""
        return self.source.stretches or "braid_compliance" in self.nonlinear

    def build(self, values: Values) -> famjax.AbstractMuscle:
        """The muscle of these values."""
        if self.nodes is None:
            material = self.law.with_values(values)
        else:
            coefficients = jnp.stack([values[name] for name in self.linear])
            material = famjax.materials.PressurePolynomialMaterial(
                self.nodes, coefficients.reshape(len(self.nodes), -1)
            )
        further = None
        if self.terms is not None:
            free = [name for name in self.terms.declared() if name in self.nonlinear]
            further = self.terms.with_parameters({name: values[name] for name in free})
        return self.source.muscle(values, material, further)

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """L0 [m] at which every path starts."""
        return jnp.asarray(values.get("rest_length", self.rest))

    @property
    def derived_names(self) -> tuple[str, ...]:
        """Thread length and turns, where the braid is estimated."""
        return ("thread_length", "turns") if isinstance(self.source, EstimatedSource) else ()

    def derived(self, values: Values) -> tuple[Float[Array, ""], ...]:
        """Thread length [m] and turns of a braid that is estimated."""
        if not isinstance(self.source, EstimatedSource):
            return ()
        geometry = self.source.geometry(values)
        if isinstance(geometry, famjax.geometries.EndEffectGeometry):
            geometry = geometry.cylinder
        assert isinstance(geometry, famjax.EstimatedGeometry)
        return geometry.braid.rest_thread_length, geometry.braid.turns

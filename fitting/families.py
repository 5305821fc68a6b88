"""Families of muscles: a bladder law and a geometry source, with their free parameters.

A law can be any material whose class declares its parameters. Declared parameters in which the
force is affine are the coefficients, which a convex programme determines. All others are shape
parameters, which the outer search determines.
"""

import abc
import dataclasses
from collections.abc import Callable, Mapping
from typing import Any, ClassVar

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

import famjax
from famjax.boundary.errors import InputError, class_named, class_path

from .arguments import check_whole
from .data import Specimen
from .parameters import Entry
from .response import Values

_MAX_ORDER = 8


class Law(eqx.Module):
    """A family of laws, parametrised by the declared parameters of a material.

    Attributes:
        material: any member of the family.
    """

    material: famjax.materials.AbstractMaterial

    @property
    def coefficients(self) -> dict[str, Entry]:
        """Parameters in which the stress is linear, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if d.linear}

    @property
    def shape(self) -> dict[str, Entry]:
        """Parameters in which the stress is nonlinear, by name."""
        return {n: _entry(d) for n, d in self.material.declared().items() if not d.linear}

    @property
    def order(self) -> int:
        """Number of coefficients."""
        return len(self.coefficients)

    @property
    def name(self) -> str:
        """Name of the law on the command line: a built-in name or `module:Class`."""
        return type(self.material).law_name or class_path(type(self.material))

    def with_values(self, values: Mapping[str, famjax.Real]) -> famjax.materials.AbstractMaterial:
        """Return the material with these values [SI]; values of other parameters are ignored."""
        return self.material.with_parameters({n: values[n] for n in self.material.declared()})


def _entry(declared: famjax.parameters.Declared) -> Entry:
    return Entry(declared.low, declared.high, declared.kind)


def known_laws() -> dict[str, type[famjax.materials.AbstractMaterial]]:
    """Return the built-in laws that can be identified, by name."""
    laws = (
        famjax.PolynomialMaterial,
        famjax.materials.OgdenMaterial,
        famjax.materials.MooneyRivlinMaterial,
        famjax.materials.SaturatingMaterial,
        famjax.materials.NeoHookeanMaterial,
        famjax.materials.YeohMaterial,
    )
    return {law.law_name: law for law in laws}


LawGiven = str | Law | type[famjax.materials.AbstractMaterial] | famjax.materials.AbstractMaterial
"""Types that specify a law: a name, a `Law`, a material class or a material."""


def law_named(law: LawGiven, order: int | None) -> Law:
    """Return the law for a name, class or material; `order` applies only to the polynomial law.

    Raises:
        InputError: the name is unknown, an order is given for a law without an order, or the class
            declares no parameters.
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
                f"the law must be one of {', '.join(laws)}, or module:Class for your own law; "
                f"got {law!r}"
            )
        law = laws[law]
    if law is famjax.PolynomialMaterial:
        order = check_whole("the order of the law", 3 if order is None else order, 1, _MAX_ORDER)
        return Law(famjax.PolynomialMaterial.template(order=order))
    if order is not None:
        raise InputError(
            f"only the polynomial law has an order, got {order} for {given}: omit the order, or "
            "choose law='polynomial'"
        )
    try:
        material = law.template() if isinstance(law, type) else law
    except ValueError as error:
        raise InputError(f"{given} cannot be identified from its class alone: {error}") from None
    if not isinstance(material, famjax.materials.AbstractMaterial):
        raise InputError(
            "a law must be a name, or an instance or subclass of famjax.materials.AbstractMaterial; got "
            f"{given}"
        )
    if not material.declared():
        raise InputError(
            f"{given} declares no parameters to identify: declare its fields with "
            "famjax.parameter(unit, low=..., high=..., linear=...)"
        )
    return Law(material)


class AbstractGeometrySource(eqx.Module):
    """Base class of objects that build a geometry from parameter values.

    Attributes:
        derived_names: names of the additional quantities that `derived` returns for the report.
    """

    derived_names: ClassVar[tuple[str, ...]] = ()

    @abc.abstractmethod
    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """Build the geometry from these parameters [SI]; unused parameters are ignored."""

    @property
    def stretches(self) -> bool:
        """Whether the dimensions depend on pressure."""
        return True

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """Further parameters that can be identified, by name."""
        return {}

    def muscle(
        self,
        values: Values,
        material: famjax.materials.AbstractMaterial,
        further: famjax.terms.SumOfTerms | None,
    ) -> famjax.AbstractMuscle:
        """Build the muscle from these parameters, the law and any further force terms."""
        return assembled(self.geometry(values), material, values["deadband_pressure"], further)


class EstimatedSource(AbstractGeometrySource):
    """Source for a cylinder in a braid that is estimated from D0 and theta0.

    The threads may be inextensible or compliant. The parameters are `braid_diameter` and `braid_angle`
    of the unloaded braid. Optional parameters are `rest_length`, `braid_compliance`, and for rounded
    ends either `end_factor` k or the dead length `end_length` l, with k = L0/(L0 - l). The dead length
    does not depend on the muscle's length.

    The dimensions of the specimen are arrays, so that all specimens share one compiled program.

    Args:
        specimen: rest length, wall thickness and bladder position.
    """

    rest_length: Float[np.ndarray, ""]
    wall_thickness: Float[np.ndarray, ""]
    bladder_diameter: Float[np.ndarray, ""] | None
    braid_thickness: Float[np.ndarray, ""]
    embedded: bool = eqx.field(static=True)
    derived_names: ClassVar[tuple[str, ...]] = ("thread_length", "turns")

    def __init__(self, specimen: Specimen) -> None:
        self.rest_length = np.asarray(specimen.rest_length, float)
        self.wall_thickness = np.asarray(specimen.wall_thickness, float)
        inner = specimen.bladder_diameter
        self.bladder_diameter = None if inner is None else np.asarray(inner, float)
        self.braid_thickness = np.asarray(specimen.braid_thickness, float)
        self.embedded = specimen.embedded

    @property
    def stretches(self) -> bool:
        """False: the dimensions depend on pressure only through `braid_compliance`."""
        return False

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """Build the cylinder from these parameters [SI], with rounded ends if they are included."""
        diameter, rest_length = (
            values["braid_diameter"],
            values.get("rest_length", self.rest_length),
        )
        inner = self.bladder_diameter
        if inner is None:
            inner = diameter - (0.0 if self.embedded else 2 * self.braid_thickness)
        braid = famjax.Braid.from_rest(
            diameter=diameter,
            braid_angle=values["braid_angle"],
            length=rest_length,
            thickness=self.braid_thickness,
        )
        if "braid_compliance" in values:
            braid = famjax.braids.CompliantBraid.of(braid, values["braid_compliance"])
        cylinder = famjax.EstimatedGeometry(
            braid,
            famjax.Bladder(
                rest_length=rest_length,
                rest_diameter=inner,
                rest_thickness=self.wall_thickness,
                embedded=self.embedded,
            ),
        )
        if "end_factor" in values:
            return famjax.geometries.EndEffectGeometry(cylinder, values["end_factor"])
        if "end_length" in values:
            factor = rest_length / (rest_length - values["end_length"])
            return famjax.geometries.EndEffectGeometry(cylinder, factor)
        return cylinder

    def derived(self, values: Values) -> tuple[Float[Array, ""], ...]:
        """Return the thread length [m] and the number of turns of the braid."""
        plain = {name: value for name, value in values.items() if not name.startswith("end_")}
        geometry = self.geometry(plain)
        assert isinstance(geometry, famjax.EstimatedGeometry)
        return geometry.braid.rest_thread_length, geometry.braid.turns


class KnownSource(AbstractGeometrySource):
    """Source for a known (for example, measured) geometry; some of its parameters may be identified.

    Attributes:
        known: the geometry.
        identified: names of the declared parameters to identify.
    """

    known: famjax.geometries.AbstractGeometry
    identified: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """Parameters that the geometry declares."""
        return self.known.declared()

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """Return the known geometry with the identified values."""
        if not self.identified:
            return self.known
        return self.known.with_parameters({name: values[name] for name in self.identified})


class WrappedSource(AbstractGeometrySource):
    """Source for a user's geometry that wraps the estimated geometry.

    Attributes:
        inner: source of the estimated geometry.
        wrap: function or class that maps the estimated geometry to the outer one.
        identified: names of the parameters declared by the outer geometry that are to be identified.
    """

    inner: AbstractGeometrySource
    wrap: Callable[[famjax.geometries.AbstractGeometry], famjax.geometries.AbstractGeometry] = (
        eqx.field(static=True)
    )
    identified: tuple[str, ...] = eqx.field(static=True, default=())

    @property
    def declared(self) -> dict[str, famjax.parameters.Declared]:
        """Parameters that only the outer geometry declares."""
        inner = self.inner.geometry({"braid_diameter": 0.02, "braid_angle": 1.1})
        return {
            n: d for n, d in self._around(inner).declared().items() if n not in inner.declared()
        }

    def _around(
        self, inner: famjax.geometries.AbstractGeometry
    ) -> famjax.geometries.AbstractGeometry:
        """Wrap a geometry; fields without a default start at the middle of their range.

        Raises:
            InputError: the class has fields without a known value, or the result is not a geometry.
        """
        wrap: Any = self.wrap
        try:
            if isinstance(wrap, type) and issubclass(wrap, famjax.geometries.AbstractGeometry):
                first, *_ = (one.name for one in dataclasses.fields(wrap) if one.init)
                made = wrap.template(**{first: inner})
            else:
                made = wrap(inner)
        except (TypeError, ValueError) as error:
            name = getattr(wrap, "__name__", type(wrap).__name__)
            raise InputError(
                f"the geometry {name} cannot be built from the estimated geometry alone: {error}"
            ) from None
        if not isinstance(made, famjax.geometries.AbstractGeometry):
            raise InputError(
                "the geometry function must return an instance of "
                f"famjax.geometries.AbstractGeometry; got a {type(made).__name__}"
            )
        return made

    def geometry(self, values: Values) -> famjax.geometries.AbstractGeometry:
        """Build the outer geometry from these parameters."""
        outer = self._around(self.inner.geometry(values))
        return outer.with_parameters({name: values[name] for name in self.identified})


def assembled(
    geometry: famjax.geometries.AbstractGeometry,
    material: famjax.materials.AbstractMaterial,
    deadband: famjax.Real,
    further: famjax.terms.SumOfTerms | None,
) -> famjax.Muscle:
    """Assemble a muscle from its geometry, its law and any further force terms.

    Args:
        geometry: muscle geometry.
        material: bladder material.
        deadband: deadband pressure P_d [Pa]; ignored if the further terms have their own deadband.
        further: further terms, or None.
    """
    if further is None:
        return famjax.Muscle(geometry, material, deadband)
    wall = famjax.terms.BladderWall(material)
    if "deadband_pressure" in further.declared():  # it replaces the standard pressure term
        return famjax.Muscle(geometry, wall + further)
    return famjax.Muscle(geometry, wall + famjax.terms.PressurisedBraid(deadband) + further)

"""The muscles of one specimen as a family: braid, bladder, law and deadband of named numbers."""

from collections.abc import Sequence

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import famjax

from ..data.force_data import Specimen
from ..response import AbstractFamily, Values
from .geometry_source import AbstractGeometrySource, EstimatedSource
from .laws import Law


class _NearestNode(famjax.materials.PressurePolynomialMaterial):
    """The coefficients of the nearest node: readings of one level differ a little in pressure."""

    def known(self, pressure: famjax.Real) -> Bool[Array, "..."]:
        """Everywhere: a reading of the first or last level may lie a little outside the nodes."""
        return jnp.isfinite(jnp.asarray(pressure))

    def interpolated(self, at: famjax.Real) -> Float[Array, "... order"]:
        """Coefficients E_n [Pa] at a pressure [Pa], shape (..., order): no interpolation."""
        distance = jnp.abs(jnp.asarray(at)[..., None] - self.node_pressures)
        return self.node_coefficients[jnp.argmin(distance, axis=-1)]


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
        nonlinear, linear: names of the parameters; the coefficients node by node.
        source: makes the geometry.
        law: of the bladder.
        rest: L0 [m] of the specimen.
        terms: further force terms, or None.
        of_terms: names of their parameters that take part.
        nodes: pressures [Pa] at which the coefficients are known, or None where they are fixed.
        nearest: whether a reading takes the coefficients of its own node.
    """

    nonlinear: tuple[str, ...] = eqx.field(static=True)
    linear: tuple[str, ...] = eqx.field(static=True)
    source: AbstractGeometrySource
    law: Law
    rest: Float[np.ndarray, ""]
    terms: famjax.terms.SumOfTerms | None
    of_terms: tuple[str, ...] = eqx.field(static=True)
    nodes: Float[np.ndarray, " nodes"] | None
    nearest: bool = eqx.field(static=True)

    @classmethod
    def of(
        cls,
        specimen: Specimen,
        source: AbstractGeometrySource,
        law: Law,
        nonlinear: Sequence[str],
        terms: famjax.terms.SumOfTerms | None = None,
        nodes: np.ndarray | None = None,
        *,
        nearest: bool = False,
    ) -> "MuscleFamily":
        """The family of a specimen."""
        linear = tuple(law.coefficients)
        if nodes is not None:
            linear = tuple(f"{name}@{k}" for k in range(len(nodes)) for name in linear)
        known = () if terms is None else terms.declared()
        return cls(
            nonlinear=tuple(nonlinear),
            linear=linear,
            source=source.as_arrays(),
            law=law,
            rest=np.asarray(specimen.rest_length),
            terms=terms,
            of_terms=tuple(name for name in known if name in nonlinear),
            nodes=nodes,
            nearest=nearest,
        )

    @property
    def n_nodes(self) -> int:
        """Number of laws."""
        return 1 if self.nodes is None else len(self.nodes)

    @property
    def stretches(self) -> bool:
        """Whether dimensions depend on pressure."""
        return self.source.stretches or "braid_compliance" in self.nonlinear

    def build(self, values: Values) -> famjax.Muscle:
        """The muscle of these values."""
        if self.nodes is None:
            material = self.law.with_values(values)
        else:
            kind = _NearestNode if self.nearest else famjax.materials.PressurePolynomialMaterial
            coefficients = jnp.stack([values[name] for name in self.linear])
            material = kind(self.nodes, coefficients.reshape(len(self.nodes), -1))
        further = None
        if self.terms is not None:
            further = self.terms.with_parameters({name: values[name] for name in self.of_terms})
        return assembled(
            self.source.geometry(values), material, values["deadband_pressure"], further
        )

    def rest_length(self, values: Values) -> Float[Array, ""]:
        """L0 [m] at which every path starts."""
        return jnp.asarray(values.get("rest_length", self.rest))

    def final(self, muscle: famjax.Muscle) -> famjax.Muscle:
        """The muscle as a user gets it: coefficients interpolated between their nodes."""
        if not self.nearest:
            return muscle
        law = muscle.material
        assert isinstance(law, famjax.materials.PressurePolynomialMaterial)
        smooth = famjax.materials.PressurePolynomialMaterial(
            law.node_pressures, law.node_coefficients
        )
        return famjax.Muscle(muscle.geometry, smooth, muscle.deadband_pressure)

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

"""One compiled program for muscles of several laws: the sum of the laws, of which each is a face.

Tracing and compiling takes longer than fitting. A muscle has some of the parameters of the sum and
leaves the others where they change nothing: no end effect, rigid threads, a rigid rig, no stress of
the other laws.
"""

import dataclasses
import functools
from collections.abc import Mapping
from typing import ClassVar

import jax.numpy as jnp
import numpy as np

import famjax
from famjax._arrays import Real, RealArray
from famjax.materials import AbstractMaterial

from .families import EstimatedSource, Law, MuscleFamily
from .problem import Part, Problem, Within

_NEUTRAL: Mapping[str, float] = {
    "deadband_pressure": 0.0, "end_factor": 1.0, "braid_compliance": 0.0,
    "series_compliance": 0.0, "series_exponent": 1.0, "ogden_exponent": 2.0, "strain_scale": 0.1,
}  # fmt: skip
"""Of parameters that a family has not, values that change nothing; the rest length is the specimen's."""
_NONLINEAR = ("braid_diameter", "braid_angle", "rest_length", *_NEUTRAL)
_ORDER = 3
_TERMS = {famjax.terms.PressurisedBraid, famjax.terms.BladderWall}


class LawSum(AbstractMaterial):
    """The sum of the stresses of several laws.

    Attributes:
        laws: none with a parameter of another's.
    """

    laws: tuple[AbstractMaterial, ...]

    depends_on_pressure: ClassVar[bool] = False

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa], the sums of those of the laws."""
        each = [law.stresses(axial_strain, hoop_strain, pressure) for law in self.laws]
        axial, hoop = zip(*each, strict=True)
        return sum(axial, jnp.zeros(())), sum(hoop, jnp.zeros(()))

    def with_parameters(self, values: Mapping[str, Real]) -> "LawSum":
        """The sum with other values; names are those of the laws."""
        return LawSum(
            tuple(
                law.with_parameters({n: v for n, v in values.items() if n in law.declared()})
                for law in self.laws
            )
        )


@functools.cache
def _whole() -> LawSum:
    """The sum of the laws of the ladder."""
    return LawSum(
        (
            famjax.materials.OgdenMaterial.template(),
            famjax.materials.MooneyRivlinMaterial.template(),
            famjax.materials.SaturatingMaterial.template(),
            famjax.PolynomialMaterial.template(order=_ORDER),
        )
    )


@functools.cache
def _linear() -> tuple[str, ...]:
    return tuple(Law(_whole()).coefficients)


def sharing_one_program(problem: Problem) -> Problem:
    """The same problem, its parts computed by the shared program where they are faces of it."""
    return dataclasses.replace(problem, parts=tuple(_within(part) for part in problem.parts))


def _within(part: Part) -> Part:
    family = part.family
    if not isinstance(family, MuscleFamily) or not isinstance(family.source, EstimatedSource):
        return part
    face = {*family.nonlinear} <= {*_NONLINEAR} and _with_law(family.law.material) is not None
    plain = family.source.thread is None and family.terms is None and family.nodes is None
    if not (face and plain) or len(part.inputs.path_end) > 2:
        return part
    larger = MuscleFamily(
        nonlinear=_NONLINEAR, linear=_linear(), source=family.source, law=Law(_whole()),
        rest=family.rest, terms=None, of_terms=(), nodes=None, nearest=False,
    )  # fmt: skip
    neutral = {**_NEUTRAL, "rest_length": float(family.rest)}
    held = [0.0 if n in family.nonlinear else neutral[n] for n in _NONLINEAR]
    return dataclasses.replace(
        part,
        within=Within(
            larger,
            np.array([_NONLINEAR.index(name) for name in family.nonlinear], int),
            np.array(held),
            np.array([_linear().index(name) for name in family.linear], int),
        ),
    )


def in_shared_program(mounted: famjax.MountedMuscle) -> famjax.MountedMuscle:
    """The same muscle as the shared program has it; as it is where it is no face of that."""
    muscle = mounted.muscle
    if type(muscle) is not famjax.Muscle or {*map(type, muscle.terms.terms)} != _TERMS:
        return mounted
    geometry, factor = muscle.geometry, np.asarray(1.0)
    if isinstance(geometry, famjax.geometries.EndEffectGeometry):
        geometry, factor = geometry.cylinder, geometry.end_factor
    law = _with_law(muscle.material)
    if type(geometry) is not famjax.EstimatedGeometry or law is None:
        return mounted
    braid = geometry.braid
    if type(braid) is famjax.Braid:
        braid = famjax.braids.CompliantBraid.of(braid, np.asarray(0.0))
    if type(braid) is not famjax.braids.CompliantBraid:
        return mounted
    ends = famjax.geometries.EndEffectGeometry(
        famjax.EstimatedGeometry(braid, geometry.bladder), factor
    )
    exponent = np.asarray(1.0) if mounted.exponent is None else mounted.exponent
    whole = famjax.Muscle(ends, law, muscle.deadband_pressure)
    return famjax.MountedMuscle(whole, mounted.compliance, exponent)


def _with_law(law: AbstractMaterial) -> LawSum | None:
    """The sum with one law alone; None where that is none of its laws."""
    if isinstance(law, famjax.PolynomialMaterial):
        extra = _ORDER - law.coefficients.shape[-1]
        if extra < 0:
            return None
        law = famjax.PolynomialMaterial(np.pad(np.asarray(law.coefficients), (0, extra)))
    if isinstance(law, famjax.materials.OgdenMaterial) and law.moduli.shape != (1,):
        return None
    if type(law) not in map(type, _whole().laws):
        return None
    return LawSum(
        tuple(
            law
            if type(one) is type(law)
            else one.with_parameters(dict.fromkeys(Law(one).coefficients, 0.0))
            for one in _whole().laws
        )
    )

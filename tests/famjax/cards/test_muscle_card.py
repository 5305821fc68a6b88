"""A muscle as plain data and back: every class of famjax that a muscle can be made of."""

import functools
import inspect
import json
from collections.abc import Callable

import equinox as eqx
import jax
import muscles as known
import numpy as np
import pytest
from slow_cases import slow_after

import famjax
from famjax.boundary.errors import InputError
from famjax.cards import muscle_as_dict, muscle_from_dict

L0, P = known.L0, 1.5
NARROW = famjax.profiles.EllipticToroidEnds(1.7, 0.9, 1.1, 1.0)
PROFILES = (
    famjax.profiles.Cylinder(1.0),
    famjax.profiles.EllipticToroidEnds(1.4, 0.9, 1.1),
    NARROW,
    famjax.surfaces.IsobaricProfile(
        famjax.surfaces.AssumedShapeFamily(known.INELASTIC, NARROW), 50.0
    ),
    known.TABLE_4_3[0.2625][0].symmetrised(),
)


# A family is made where a test needs it: making it compiles, and every worker collects this file.
def family() -> famjax.surfaces.MeasuredFamily:
    lengths = L0 * np.linspace(1.0, 0.73, len(PROFILES))
    return famjax.surfaces.MeasuredFamily(lengths, PROFILES, 100.0, known.KEVLAR, margin=0.01)


def surface() -> famjax.surfaces.SampledSurface:
    """A shape that swells with the pressure."""
    x, lengths = np.linspace(0, 1, 9), L0 * np.array([1.0, 0.86, 0.72])
    bulge = 1 + 0.3 * np.arange(3)[:, None] * np.sin(np.pi * x)
    return famjax.surfaces.SampledSurface(
        lengths, [20.0, 90.0], np.stack([bulge, 1.01 * bulge]), known.KEVLAR, 0.02
    )


GEOMETRIES: dict[str, Callable[[], famjax.geometries.AbstractGeometry]] = {
    **known.GEOMETRIES,
    "photographed": lambda: famjax.MeasuredGeometry(surface(), known.SPECIMEN, 8),
    "average": lambda: famjax.measured.AverageDiameterGeometry(family(), known.SPECIMEN),
}
SUMS_OF_TERMS = {"terms": famjax.Muscle(known.CYLINDER, [*known.TERMS.values()])}
MUSCLES = [*GEOMETRIES, *known.LAWS, *SUMS_OF_TERMS]
BASES = (
    famjax.geometries.AbstractGeometry, famjax.materials.AbstractMaterial,
    famjax.braids.AbstractBraid, famjax.braids.AbstractThread, famjax.profiles.AbstractProfile,
    famjax.surfaces.AbstractProfileFamily, famjax.terms.AbstractForceTerm, famjax.Bladder,
    famjax.Muscle,
)  # fmt: skip
ROOMS = ("braids", "geometries", "materials", "measured", "muscle", "continuation", "profiles",
         "surfaces", "slip", "terms")  # fmt: skip
CONCRETE = [
    cls
    for room in (getattr(famjax, name) for name in ROOMS)
    for cls in vars(room).values()
    if inspect.isclass(cls)
    and cls.__module__ == room.__name__
    and issubclass(cls, BASES)
    and not inspect.isabstract(cls)
    and cls is not famjax.terms.SumOfTerms
]


@functools.cache
def muscle_named(name: str) -> famjax.Muscle:
    if name in GEOMETRIES:
        return famjax.Muscle(GEOMETRIES[name](), known.LATEX, 0.1)
    if name in known.LAWS:
        return famjax.Muscle(known.CYLINDER, known.LAWS[name], 1 / 3)
    return SUMS_OF_TERMS[name]


@eqx.filter_jit
def force(muscle: famjax.Muscle) -> jax.Array:
    return muscle.force(L0 * np.array([0.99, 0.8]), P)


def through_text(card: dict) -> dict:
    return json.loads(json.dumps(card, allow_nan=False))


@pytest.mark.parametrize(
    "name",
    slow_after(
        len(MUSCLES) - 2, sorted(MUSCLES, key=lambda name: name in ("photographed", "average"))
    ),
)
def test_a_muscle_comes_back_to_the_last_bit(name: str, caplog: pytest.LogCaptureFixture) -> None:
    muscle = muscle_named(name)
    pull = force(muscle)
    assert np.isfinite(pull).all()
    again = muscle_from_dict(through_text(muscle_as_dict(muscle)))
    with jax.log_compiles():  # what was written in Python's numbers meets the same programs
        np.testing.assert_array_equal(force(again), pull)
    assert not caplog.records, caplog.records[0].getMessage()
    assert jax.tree.structure(again) == jax.tree.structure(muscle)
    for mine, theirs in zip(jax.tree.leaves(again), jax.tree.leaves(muscle), strict=True):
        np.testing.assert_array_equal(mine, theirs)
        assert mine.dtype == theirs.dtype


def test_every_part_of_a_muscle_has_a_card_and_is_tried_above() -> None:
    tried: set[str] = set()

    def walk(card: object) -> None:
        if isinstance(card, dict):
            tried.add(card["type"])
        for value in card.values() if isinstance(card, dict) else card:
            if isinstance(value, dict | list):
                walk(value)

    for name in MUSCLES:
        walk(muscle_as_dict(muscle_named(name)))
    assert tried == {cls.__name__ for cls in CONCRETE}


class Undeclared(famjax.materials.AbstractMaterial):
    """Its modulus says no unit."""

    modulus: np.ndarray

    def stresses(self, axial_strain, hoop_strain, pressure):
        return axial_strain, hoop_strain


def test_what_has_no_card_is_refused() -> None:
    class Local(famjax.materials.AbstractMaterial):
        def stresses(self, axial_strain, hoop_strain, pressure):
            return axial_strain, hoop_strain

    with pytest.raises(InputError, match=r"Local is defined in a function"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, Local()))
    with pytest.raises(InputError, match=r"no card can hold the field 'modulus' of Undeclared"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, Undeclared(np.ones(2))))
    with pytest.raises(InputError, match=r"muscle\.deadband_pressure must be finite"):
        muscle_as_dict(famjax.Muscle(known.CYLINDER, known.LATEX, float("nan")))

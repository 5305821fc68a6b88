"""The equations as they are written for NumPy, against the model."""

import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import famjax
from famjax.braids import CompliantBraid
from famjax.cards import MuscleCard
from famjax.continuation import Region
from famjax.export import Subject, export
from famjax.geometries import EndEffectGeometry
from famjax.materials import (
    AbstractMaterial,
    MooneyRivlinMaterial,
    NeoHookeanMaterial,
    OgdenMaterial,
    SaturatingMaterial,
    YeohMaterial,
)

LAWS = [
    famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6]),
    OgdenMaterial([-4e5, 3e5], [-6.4, 2.0]),
    MooneyRivlinMaterial(2e5, 1e5),
    NeoHookeanMaterial(4e5),
    SaturatingMaterial(2e5, 1e5, 0.2),
]


def written(law: AbstractMaterial, folder: Path, *, embedded: bool, ends: bool) -> tuple[Any, Any]:
    """The muscle and the functions of its NumPy module."""
    braid: Any = famjax.Braid.from_rest(
        diameter=23e-3, braid_angle=1.082, length=0.296, thickness=3e-4
    )
    bladder = famjax.Bladder(0.296, 22e-3, 1.8e-3, embedded=embedded)
    if ends:
        braid = CompliantBraid.of(braid, 2e-7)
    geometry: Any = famjax.EstimatedGeometry(braid, bladder)
    muscle = famjax.Muscle(EndEffectGeometry(geometry, 1.08) if ends else geometry, law, 40e3)
    mounted = famjax.MountedMuscle(muscle, np.asarray(0.0))
    card = MuscleCard("Test", (mounted,), np.ones(1), Region([0.25, 0.29], [1.5e5, 6e5]))
    subject = Subject.of_card(card)
    (path,) = export(subject, ["python"], folder)
    return subject.muscle, runpy.run_path(str(path))


@pytest.mark.parametrize(
    ("law", "embedded", "ends"),
    [(law, k % 2 == 0, k in (1, 2)) for k, law in enumerate(LAWS)],
    ids=[type(law).__name__ for law in LAWS],
)
def test_equations_are_the_model(
    law: AbstractMaterial, embedded: bool, ends: bool, tmp_path: Path
) -> None:
    muscle, module = written(law, tmp_path, embedded=embedded, ends=ends)
    assert "closed form" in module["__doc__"]
    rng, region = np.random.default_rng(1), muscle.region
    L, P = (rng.uniform(low, high, 300) for low, high in (region.length, region.pressure))
    force = np.asarray(muscle.force(L, P))
    np.testing.assert_allclose(module["force"](L, P), force, rtol=0, atol=1e-11 * force.max())
    pulls = force > muscle.slack_width
    np.testing.assert_allclose(module["pressure"](L, force)[pulls], P[pulls], rtol=1e-9)


def test_range_and_shapes(tmp_path: Path) -> None:
    _, module = written(LAWS[0], tmp_path, embedded=True, ends=False)
    force, pressure = module["force"], module["pressure"]
    assert force(np.array([[0.27], [0.28]]), np.array([2e5, 3e5, 4e5])).shape == (2, 3)
    assert np.isnan(
        [force(0.2, 3e5), force(0.28, 9e6), pressure(0.28, 1e5), pressure(0.28, -1.0)]
    ).all()
    with pytest.raises(ValueError, match="L must be in m"):
        force(28.0, 3e5)


@pytest.mark.slow
def test_a_law_without_a_closed_form_is_a_table(tmp_path: Path) -> None:
    muscle, module = written(YeohMaterial([2e5, 1e4, 1e3]), tmp_path, embedded=True, ends=False)
    assert "no closed form" in module["__doc__"]
    expected = float(muscle.force(0.27, 4e5))
    assert module["force"](0.27, np.array([4e5, 4e5])) == pytest.approx(expected, rel=1e-6)

"""The table and the closed form of a muscle: near its model everywhere, their slopes, their inverse."""

import itertools
import math
import runpy
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from targets import exported_states

import famjax
from famjax.boundary.errors import InputError
from famjax.braids import CompliantBraid
from famjax.cards import MuscleCard
from famjax.continuation import Region
from famjax.export import Subject, export, tabulated
from famjax.geometries import EndEffectGeometry
from famjax.materials import NeoHookeanMaterial, OgdenMaterial, SaturatingMaterial, YeohMaterial


@pytest.mark.slow
@pytest.mark.parametrize("name", ["subject", "dmsp_20"])
def test_the_table_is_near_the_model(name, request):
    subject = request.getfixturevalue(name)
    L, P = exported_states(subject, 400)
    force = np.asarray(subject.muscle.force(L, P))
    largest = force[:200].max()
    off = np.array([*map(subject.pull.force, L.tolist(), P.tolist())]) - force
    assert np.abs(off).max() < 1e-6 * largest
    stiffness = np.asarray(subject.muscle.stiffness(L, P))
    told = np.array([*map(subject.pull.stiffness, L.tolist(), P.tolist())])
    assert np.abs(told - stiffness).max() < 1e-4 * np.abs(stiffness).max()
    # What the heads of the files say covers these states, too, which are others.
    assert np.abs(off[:200]).max() < 3 * subject.errors.force * largest
    assert np.abs(off[200:]).max() < 3 * subject.errors.force_beyond * largest
    assert subject.errors.force < 1e-6


def test_slopes_are_those_of_the_force(subject):
    pull = subject.pull
    for length, pressure in np.transpose(exported_states(subject, 200)).tolist():
        for slope, (dL, dP) in ((pull.stiffness, (1e-7, 0)), (pull.area, (0, 1e-1))):
            ends = [pull.force(length + k * dL, pressure + k * dP) for k in (-1, 0, 1)]
            sides = [(ends[k + 1] - ends[k]) / (dL + dP) for k in (0, 1)]
            rounding = 1e-12 * abs(ends[1]) / (dL + dP) + 1e-12
            least, most = min(sides), max(sides)
            slack = 1e-5 * abs(most) + rounding
            assert least - slack <= slope(length, pressure) <= most + slack


def test_the_inverse(subject):
    pull = subject.pull
    for length, pressure in itertools.product((0.23, 0.26, 0.295, 0.31), (9e4, 3e5, 6e5, 9e5)):
        force = pull.force(length, pressure)
        if force > 0:
            assert pull.pressure(length, force) == pytest.approx(pressure, abs=1e-6)
    assert pull.pressure(0.28, 1e6) == pull.pressure_limit == 1.2e6
    held = pull.lengths[-1] + 0.05  # the stop carries more than this without pressure
    assert pull.force(held, 0.0) > 100
    assert pull.pressure(held, 100.0) == 0
    onset = pull.pressure(0.27, 0.0)
    assert pull.pressure(0.27, -50.0) == onset
    assert pull.force(0.27, onset) == pytest.approx(0, abs=1e-6)
    assert pull.force(0.27, onset + 2e3) > 0
    assert math.isnan(pull.pressure(math.nan, 100.0))
    assert math.isnan(pull.pressure(0.27, math.nan))
    assert math.isnan(pull.force(math.nan, 3e5))


class Rippled(famjax.AbstractMuscle):
    """A spring with more ripples than a table has nodes."""

    rest_length: jax.Array = eqx.field(converter=jnp.asarray, default=0.3)

    def force(self, length, pressure):
        return 2e3 * length + 4 * jnp.sin(2.4e-3 * pressure) + 1e-2 * pressure

    def length_range(self):
        return jnp.asarray(0.1), jnp.asarray(0.4)


def test_a_model_with_ripples_is_refused():
    muscle = famjax.SafeMuscle.of(Rippled(), [0.2, 0.3], [0.0, 5e5])
    with pytest.raises(InputError, match="not smooth enough for a table"):
        tabulated(muscle)


def test_slack_states_have_no_force_and_the_models_own(subject, tmp_path):
    """In the region and beyond, of the table and of its module for MuJoCo."""
    grid = np.meshgrid([0.15, 0.225, 0.25, 0.28, 0.296], [0.0, 2e4, 1e5, 3e5])
    L, P = (one.ravel() for one in grid)
    model = np.asarray(subject.muscle.model_force(L, P))
    slack = model < 0
    assert slack.sum() >= 10
    assert (L[slack] == 0.296).any()
    assert (np.asarray(subject.muscle.force(L, P))[slack] == 0).all()
    each = [*zip(L[slack].tolist(), P[slack].tolist(), strict=True)]
    _, file = export(subject, ["mujoco"], tmp_path)
    for pull in (subject.pull, runpy.run_path(str(file))["PULL"]):
        assert [pull.force(*one) for one in each] == [0.0] * len(each)
        near = 1e-5 * subject.errors.largest_force
        assert [pull.model_force(*one) for one in each] == pytest.approx(model[slack], abs=near)


LAWS = [
    famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6]),
    OgdenMaterial([-4e5, 3e5], [-6.4, 2.0]),
    famjax.materials.MooneyRivlinMaterial(2e5, 1e5),
    NeoHookeanMaterial(4e5),
    SaturatingMaterial(2e5, 1e5, 0.2),
]


def written(law: Any, folder: Path, *, embedded: bool, ends: bool) -> tuple[Any, Any]:
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=1.082, length=0.296, thickness=3e-4)
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
def test_equations_are_the_model(law, embedded, ends, tmp_path):
    muscle, module = written(law, tmp_path, embedded=embedded, ends=ends)
    assert "closed form" in module["__doc__"]
    rng, region = np.random.default_rng(1), muscle.region
    L, P = (rng.uniform(low, high, 300) for low, high in (region.length, region.pressure))
    force = np.asarray(muscle.force(L, P))
    np.testing.assert_allclose(module["force"](L, P), force, rtol=0, atol=1e-11 * force.max())
    pulls = force > muscle.slack_width
    np.testing.assert_allclose(module["pressure"](L, force)[pulls], P[pulls], rtol=1e-9)


def test_range_and_shapes(tmp_path):
    _, module = written(LAWS[0], tmp_path, embedded=True, ends=False)
    force, pressure = module["force"], module["pressure"]
    assert force(np.array([[0.27], [0.28]]), np.array([2e5, 3e5, 4e5])).shape == (2, 3)
    beyond = force(0.2, 3e5), force(0.28, 9e6), pressure(0.28, 1e5), pressure(0.28, -1.0)
    assert np.isnan(beyond).all()
    with pytest.raises(ValueError, match="L must be in m"):
        force(28.0, 3e5)


@pytest.mark.slow
def test_a_law_without_a_closed_form_is_a_table(tmp_path):
    muscle, module = written(YeohMaterial([2e5, 1e4, 1e3]), tmp_path, embedded=True, ends=False)
    assert "no closed form" in module["__doc__"]
    expected = float(muscle.force(0.27, 4e5))
    assert module["force"](0.27, np.array([4e5, 4e5])) == pytest.approx(expected, rel=1e-6)

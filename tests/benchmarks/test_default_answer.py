"""Maps with dense truth, the physics they are made by, and what is counted as silently wrong."""

import dataclasses
import math
import re
import sys
from pathlib import Path

import dense_truth as truth
import numpy as np
import pytest
import tubes

from fitting import load_bundled, read_csv

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
answers = pytest.importorskip("default_answer")
sys.path.pop(0)


@pytest.fixture
def tube():
    rubber = tubes.Rubber("mooney-rivlin", 5e5, (0.2,))
    return tubes.Tube(0.25, 0.01, 1.8e-3, 0.5, math.radians(64), rubber)


@pytest.mark.parametrize("name", ["tubes", "dense_truth"])
def test_the_physics_shares_nothing_with_famjax(name):
    text = (Path(__file__).parents[1] / f"{name}.py").read_text()
    imported = set(re.findall(r"^\s*(?:import|from) (\w+)", text, re.MULTILINE))
    assert {"numpy"} <= imported
    assert not imported & {"famjax", "fitting", "imaging", "rig", "jax"}


def test_a_thin_wall_pulls_as_its_energy_at_one_radius_changes(tube):
    # An oracle without a quadrature: neo-Hookean rubber at the braid's radius alone.
    rubber = tubes.Rubber("mooney-rivlin", 5e5, (0.0,))
    thin = dataclasses.replace(tube, wall=1e-5, rubber=rubber)
    L, P, h = 0.22, 3e5, 1e-6
    volume = np.pi * ((thin.bore / 2 + thin.wall) ** 2 - (thin.bore / 2) ** 2) * thin.rest_length

    def energy(L):
        along = L / thin.rest_length
        squared = (1 - (along * np.sin(thin.angle)) ** 2) / np.cos(thin.angle) ** 2  # around
        first = squared + along**2 + 1 / (squared * along**2) - 3
        return volume * 2.5e5 * first - P * np.pi * thin.braid_radius**2 * squared * L

    expected = (energy(L + h) - energy(L - h)) / (2 * h)
    assert thin.reading(L, P) == pytest.approx(expected, rel=1e-3)  # 0.2 % of the radius is wall


@pytest.mark.parametrize(
    ("law", "shape"),
    [("mooney-rivlin", (0.3,)), ("ogden", (2.0, -3.0, 0.4)), ("gent", (9.0,)), ("yeoh", (-0.05, 0.01))],
)  # fmt: skip
def test_every_law_has_its_modulus_at_small_strains(law, shape):
    rubber = tubes.Rubber(law, 4e5, shape)
    e = 1e-3  # pure shear: the energy is G e^2 / 2 at an engineering shear of 2 e
    energy = rubber.energy(np.array(np.exp(e)), np.array(np.exp(-e)))
    assert energy == pytest.approx(4e5 * (2 * e) ** 2 / 2, rel=1e-2)


def test_the_rig_is_in_the_reading(tube):
    rigid = tube.reading(0.23, 5e5)
    give = 1e-6
    found = dataclasses.replace(tube, rig_give=give).reading(0.23, 5e5)
    assert found == pytest.approx(tube.reading(0.23 - give * found, 5e5), rel=1e-6)
    assert found < rigid
    assert dataclasses.replace(tube, gain=1.02).reading(0.23, 5e5) == pytest.approx(1.02 * rigid)
    offset = dataclasses.replace(tube, offset=2e3)
    assert offset.reading(0.23, 4.98e5) == pytest.approx(rigid)
    up = dataclasses.replace(tube, friction=0.05, branch="lengthening").reading(0.23, 5e5)
    down = dataclasses.replace(tube, friction=0.05, branch="shortening").reading(0.23, 5e5)
    assert (up + down) / 2 == pytest.approx(rigid)
    assert down < rigid < up


@pytest.mark.parametrize("seed", range(6))
def test_a_seed_is_a_map_and_its_truth_lies_inside(seed, tmp_path):
    one, again = truth.own_map(seed), truth.own_map(seed)
    assert one.readings == again.readings
    assert one.readings != truth.own_map(seed + 100).readings
    path = tmp_path / "map.csv"
    path.write_text(one.readings)
    data = read_csv(path)
    assert data.loaded.sum() >= 12
    assert ("rest_length" in data.assumed) == ("no lines" in one.about)
    assert np.isfinite(one.force).all()
    assert (one.force >= 0).all()
    assert one.force.max() == pytest.approx(data.max_force, rel=0.05)
    for values, measured in ((one.length, data.length), (one.pressure, data.pressure)):
        assert values.min() >= measured.min() * (1 - 1e-6)
        assert values.max() <= measured.max() * (1 + 1e-6)
    second, first = np.unique(np.round(data.length, 6))[-2:]
    assert np.unique(one.length[(one.length > second) & (one.length < first)]).size >= 8


def test_a_hard_muscle_fits_the_real_map():
    one = truth.hard_map(3)
    real = load_bundled("DMSP-10-250")
    rows = np.loadtxt(one.readings.splitlines()[1:], delimiter=",")
    assert rows[:, 1] == pytest.approx(real.length * 1e3)
    error = (rows[:, 2] - real.force)[real.loaded]
    assert np.sqrt(np.mean(error**2)) < 2.2  # 1.5 N of misfit and 1 N of noise
    assert "specimen" not in one.readings


@pytest.mark.parametrize(
    ("force", "half", "bad"),
    [
        ([-30, 50, 100], 2.0, False),  # a true answer
        ([0, 50, 108], 2.0, True),  # 4 half-bands
        ([0, 50, 105], 2.0, False),  # 2.5
        ([0, 50, 112], 8.0, True),  # 12 % of the largest force, outside the band
        ([0, 50, 112], 13.0, False),  # the band says so
        ([9, 50, 100], 2.0, True),  # slack, but the answer says that it pulls
    ],
)
def test_what_is_wrong(force, half, bad):
    """An answer to a truth of 0, 50 and 100 N at three states."""
    states, force = np.full(3, 0.2), np.array(force, float)
    one = truth.TruthMap("own", "made up", 0, "", "", states, states, np.array([0.0, 50.0, 100.0]))
    found = {"force_N": force, "low_95_N": force - half, "high_95_N": force + half,
             "inside": np.ones(3)}  # fmt: skip
    answer = answers.compared(one, one.force, found, {"max_force_N": 100.0, "reasons": []})
    assert (answer.bad, answer.silent) == (bad, bad)


@pytest.mark.slow
def test_a_small_map_is_examined():
    small = next(one for one in map(truth.own_map, range(20)) if one.about.startswith("4x6"))
    one = answers.examine(small)
    assert not one.why
    assert one.rmse_percent < 5
    assert one.coverage > 50

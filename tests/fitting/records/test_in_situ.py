import tomllib
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import linregress

from famjax.braids import (
    ElasticBraid,
    LinearThread,
    braid_angle_from_length,
    diameter_from_length,
    gaylord_force,
    thread_tension,
)
from fitting import InputError
from fitting.records import InSitu, thread_in_situ

# The reference specimen in inch, psi, lbf
L0, B0, N, n, AREA = 9.28125, 9.89, 1.09, 144, 1.332e-4
SPECIMEN = {"length": L0, "turns": N, "n_threads": n, "area": AREA}
PUBLISHED = tomllib.loads(
    (Path(__file__).parents[3] / "benchmarks" / "reference" / "chambers2021.toml").read_text()
)
TABLE = PUBLISHED["elastic_braid"]
PRESSURE = np.array(TABLE["pressure_psi"], float)
FORCE = np.array([*reversed(PUBLISHED["tested"]["blocked_force_lbf"]), 0.0])
DIAMETER = np.array(TABLE["D_in"])


@pytest.fixture
def published() -> InSitu:
    return thread_in_situ(DIAMETER, FORCE, PRESSURE, **SPECIMEN)


def test_table_5_1_follows_from_its_diameters(published):
    """D is printed to 0.0005 in; dB / dD = pi^2 N^2 D / B = 1.24, d theta / dB = -15 deg/in."""
    np.testing.assert_allclose(published.thread_length, TABLE["B_in"], atol=1.24 * 5e-4 + 5e-4)
    np.testing.assert_allclose(np.degrees(published.braid_angle), TABLE["theta_deg"], atol=0.015)


def test_largest_tension_and_strain_are_the_printed_ones(published):
    assert published.tension.max() == pytest.approx(TABLE["max_thread_tension_lbf"], abs=0.05)
    assert published.strain.max() == pytest.approx(TABLE["max_thread_strain"], abs=1e-4)


@pytest.mark.parametrize("threshold", [0.0, 50.0])
def test_lines_meet_scipys_regression(published, threshold):
    chosen = threshold <= PRESSURE
    expected = linregress(published.strain[chosen], published.stress[chosen])
    line = published.linear if threshold == 0 else published.high_pressure
    assert line.modulus == pytest.approx(expected.slope, rel=1e-9)
    assert line.modulus_stderr == pytest.approx(expected.stderr, rel=1e-9)
    assert line.intercept == pytest.approx(expected.intercept, rel=1e-9)
    assert line.intercept_stderr == pytest.approx(expected.intercept_stderr, rel=1e-9)
    assert line.count == chosen.sum()


def test_the_braid_model_is_analysed_back():
    """Diameters and Gaylord's force of a linear braid give its own modulus in every line."""
    braid = ElasticBraid(B0, N, 0.011, n, LinearThread(11.6e6, AREA))
    B = braid.thread_length(L0, PRESSURE)
    diameter, angle = diameter_from_length(L0, B, N), braid_angle_from_length(L0, B)
    force = gaylord_force(PRESSURE, diameter / 2, angle)
    found = thread_in_situ(np.asarray(diameter), np.asarray(force), PRESSURE, **SPECIMEN)
    assert found.rest_thread_length == pytest.approx(B0, rel=1e-13)
    np.testing.assert_allclose(found.thread_length, B, rtol=1e-13)
    tension = thread_tension(force, PRESSURE, diameter / 2, angle, n)
    np.testing.assert_allclose(found.tension, tension, rtol=1e-12)
    for line in (found.linear, found.proportional, found.high_pressure):
        assert line.modulus == pytest.approx(11.6e6, rel=1e-9)
        assert line.modulus_stderr < 1e-6 * line.modulus


def test_an_error_of_the_rest_length_spares_the_slopes(published):
    shifted = thread_in_situ(DIAMETER, FORCE, PRESSURE, rest_thread_length=9.89, **SPECIMEN)
    assert shifted.linear.modulus == pytest.approx(published.linear.modulus, rel=1e-3)
    assert shifted.proportional.modulus < 0.95 * published.proportional.modulus


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"force": FORCE[:-1]}, "equally long"),
        ({"pressure": PRESSURE[:, None]}, "one-dimensional"),
        ({"diameter": np.where(PRESSURE == 80, -1.0, DIAMETER)}, "diameters must be > 0"),
        ({"force": np.where(PRESSURE == 80, np.nan, FORCE)}, "force of reading 2 is nan"),
        ({"pressure": PRESSURE - 14.7}, "gauge pressure"),
        ({"pressure": PRESSURE + 1.0}, "give a reading at zero pressure"),
        ({"high_pressure": 90.0}, "two different strains"),
        ({"turns": 0.0}, "turns must be > 0"),
        ({"rest_thread_length": np.nan}, "rest_thread_length must be > 0"),
    ],
)
def test_bad_readings_are_refused(change, match):
    good = {"diameter": DIAMETER, "force": FORCE, "pressure": PRESSURE, **SPECIMEN}
    with pytest.raises(InputError, match=match):
        thread_in_situ(**{**good, **change})

"""Sensors and feed-forward: least squares against independent oracles, errors against repetition."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from rig.calibration import (
    Calibration,
    FeedForward,
    Sensor,
    calibration_from_dict,
    fit_feed_forward,
    fit_sensor,
    read_calibration,
    write_calibration,
)
from rig.errors import RigError

REFERENCES = np.linspace(0, 7e5, 8)
ROUNDING = 1e-9
"""Two ways of one sum in float64."""


def noisy_counts(rng, scatter=2.0):
    return 512 + REFERENCES / 330 + rng.normal(0, scatter, REFERENCES.size)


def test_a_sensor_is_the_regression_of_counts_on_references():
    counts = noisy_counts(np.random.default_rng(1))
    sensor, oracle = fit_sensor(counts, REFERENCES), stats.linregress(REFERENCES, counts)
    assert sensor.gain == pytest.approx(1 / oracle.slope, rel=ROUNDING)
    assert sensor.zero == pytest.approx(oracle.intercept, rel=ROUNDING)
    assert sensor.gain_std == pytest.approx(oracle.stderr / oracle.slope**2, rel=ROUNDING)
    assert sensor.zero_std == pytest.approx(oracle.intercept_stderr, rel=ROUNDING)


def test_the_errors_of_a_sensor_are_those_of_repeated_calibrations():
    rng = np.random.default_rng(2)
    many = [fit_sensor(noisy_counts(rng), REFERENCES) for _ in range(1500)]
    spread = np.std([sensor.value(1700.0) for sensor in many])
    expected = np.sqrt(np.mean([sensor.error(1700.0) ** 2 for sensor in many]))
    assert expected == pytest.approx(spread, rel=0.08)  # 1500 draws: 2 % each
    mean_gain_std = np.sqrt(np.mean([sensor.gain_std**2 for sensor in many]))
    assert mean_gain_std == pytest.approx(np.std([s.gain for s in many]), rel=0.08)
    assert np.corrcoef([s.gain for s in many], [s.zero for s in many])[0, 1] == pytest.approx(
        np.mean([s.correlation for s in many]), abs=0.05
    )


def test_a_cubic_comes_back_and_its_scatter_is_that_of_the_noise():
    P = np.linspace(2e4, 7e5, 12)
    true = np.polynomial.Polynomial((30, 120, -60, 90))(P / 7e5)
    exact = fit_feed_forward(P, true)
    np.testing.assert_allclose([exact.output(p) for p in P], true, rtol=1e-9)
    rng = np.random.default_rng(3)
    noisy = [fit_feed_forward(P, true + rng.normal(0, 0.8, P.size)) for _ in range(800)]
    scatter = np.sqrt(np.mean([v.scatter**2 for v in noisy]))
    assert scatter == pytest.approx(0.8, rel=0.05)  # 800 draws: 1 %
    with pytest.raises(RigError, match=r"known from 20 kPa to 700 kPa, not at 10 kPa"):
        exact.output(1e4)
    assert FeedForward.bias().output(3e5) == 127.5
    with pytest.raises(RigError, match=r"must be 0..255"):
        FeedForward.bias(300.0).output(0.0)


def test_a_file_gives_back_the_same_numbers(tmp_path):
    path, rng, P = tmp_path / "rig.toml", np.random.default_rng(5), np.linspace(2e4, 7e5, 12)
    force = fit_sensor(2500 - REFERENCES / 400, REFERENCES / 300)
    v = fit_feed_forward(P, 30 + P / 4000 + rng.normal(0, 0.5, P.size))
    known = Calibration(fit_sensor(noisy_counts(rng), REFERENCES), force, v)
    for one in (
        known,
        dataclasses.replace(known, feed_forward=FeedForward.bias()),
        Calibration(Sensor(300.0, 500.0), Sensor(-1.0, 2000.0), board=4711),
    ):
        write_calibration(path, one)
        assert read_calibration(path) == one
    assert "gain_Pa_per_count" in path.read_text()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"pressure": {}}, "force is missing"),
        (
            {"pressure": {"gain_Pa_per_count": 1}, "force": {}},
            r"\[pressure\]: zero_counts is missing",
        ),
        ({"pressure": {"gain_psi_per_count": 1}, "force": {}}, "unknown key 'gain_psi_per_count'"),
        ({"pressure": {"gain_Pa_per_count": 0, "zero_counts": 0}, "force": {}}, "not zero"),
        ({"pressure": {}, "force": {}, "board": "a"}, "board must be a number of 0 to 65534"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(content, message):
    with pytest.raises(RigError, match=message):
        calibration_from_dict(content)

"""The simulated machine, sensors and line against closed forms; calibrations against repetition."""

import dataclasses
import itertools

import numpy as np
import pytest
from benches import PSI
from scipy import stats

from rig import calibration
from rig.calibration import Calibration, FeedForward, Sensor
from rig.errors import RigError
from rig.simulation import ByteChannel, SimulatedSensor, TestMachine, load_cell, pressure_transducer

DT = 2e-3
STEP = 1.016e-3 * DT * 1.01  # m, one step at 0.04 in/s: a turn comes that much late


def machine(noise=0.0, **options):
    return TestMachine(0.23, shortest=0.14, load_noise=noise, **options)


def log_of(m, seconds, load=lambda length: 10000.0 * (length - 0.15)):
    """The log of so many seconds."""
    for now in (DT * np.arange(1, round(seconds / DT) + 1)).tolist():
        m.step(now, DT, load(m.length))
    names = ("time_s", "displacement_m", "force_N", "sync")
    return dict(zip(names, np.array(m.rows).T, strict=True))


def test_strokes_are_triangles_between_rest_and_the_load_that_turns_them():
    m = machine()
    m.start(2, 1e-3)
    log = log_of(m, 400.0)
    # 80 mm at 1 mm/s: down in 80 s, back in 80 s, twice
    phase = log["time_s"] % 160
    wanted = np.where(log["time_s"] < 320, -np.minimum(phase, 160 - phase) * 1e-3, 0.0)
    assert np.abs(log["displacement_m"] - wanted).max() < 4 * STEP  # four turns, a step late each
    assert np.abs(log["force_N"] - 1e4 * (log["displacement_m"] + 0.08)).max() < 1e4 * 2 * STEP
    assert not m.busy
    assert m.length == 0.23
    m = machine()
    m.start(1, 5e-3)
    switched = log_of(m, 40.0, load=lambda _: 100.0)
    assert switched["displacement_m"].min() == pytest.approx(-0.09, abs=5 * STEP)  # its switch


@pytest.mark.parametrize("sensor", [pressure_transducer(), load_cell()])
def test_a_sensor_s_calibration_undoes_it(sensor):
    rng = np.random.default_rng(5)
    for share in (0.1, 0.9):
        value = sensor.low + share * (sensor.high - sensor.low)
        # Dither of many counts: quantisation averages out.
        draws = rng.normal(0, 3, size=20_000).tolist()
        mean = 5 * np.mean([sensor.counts(value, error) for error in draws])
        five_errors = 5 * 3 / sensor.counts_per_unit / np.sqrt(20_000)
        assert float(sensor.calibration().value(mean)) == pytest.approx(value, abs=five_errors)
    transducer = pressure_transducer()
    assert transducer.counts(0.0) == int(0.5 / 5 * 1024)
    assert transducer.counts(200 * PSI) == int(4.5 / 5 * 1024)
    assert (sensor.counts(1e9), sensor.counts(-1e9)) == (1023, 0)


@pytest.mark.parametrize("time", [0.0, 0.02])
def test_noise_has_its_deviation_and_its_memory(time):
    sensor = SimulatedSensor(0.0, 1e6, noise=2e3, correlation_time=time)
    draws = np.array(list(itertools.islice(sensor.errors(2e-3, 7), 200_000)))
    keep = np.exp(-2e-3 / time) if time else 0.0
    # Correlated draws count for fewer: (1 - keep)/(1 + keep) of them.
    n = draws.size * (1 - keep) / (1 + keep)
    assert draws.std() == pytest.approx(2e3 * sensor.counts_per_unit, rel=4 / np.sqrt(2 * n))
    assert np.corrcoef(draws[:-1], draws[1:])[0, 1] == pytest.approx(keep, abs=4 / np.sqrt(n))
    assert list(itertools.islice(sensor.errors(2e-3, 7), 100)) == draws[:100].tolist()


def test_a_line_takes_its_time_and_a_cut_cable_loses_what_is_on_it():
    line = ByteChannel(baud=115200)
    data = bytes(range(200))
    line.send(data, 1.0)
    byte = 10 / 115200
    assert line.receive(1.0 + 0.99 * byte) == b""
    assert line.receive(1.0 + 1.01 * byte) == data[:1]
    assert line.receive(1.0 + 99.5 * byte) == data[1:99]
    line.send(b"next", 1.001)  # waits for what is before it
    assert line.receive(1.0 + 203.5 * byte) == data[99:] + b"nex"
    assert line.receive(2.0) == b"t"
    assert line.waiting == 0
    line.send(b"lost", 2.0)
    line.cut = True
    line.send(b"lost too", 2.0)
    assert line.receive(10.0) == b""
    line.cut = False
    line.send(b"kept", 11.0)
    assert line.receive(20.0) == b"kept"


REFERENCES = np.linspace(0, 7e5, 8)
ROUNDING = 1e-9  # two ways of one sum in float64


def noisy_counts(rng, scatter=2.0):
    return 512 + REFERENCES / 330 + rng.normal(0, scatter, REFERENCES.size)


def test_a_sensor_is_the_regression_of_counts_on_references():
    counts = noisy_counts(np.random.default_rng(1))
    sensor = calibration.fit_sensor(counts, REFERENCES)
    oracle = stats.linregress(REFERENCES, counts)
    assert sensor.gain == pytest.approx(1 / oracle.slope, rel=ROUNDING)
    assert sensor.zero == pytest.approx(oracle.intercept, rel=ROUNDING)
    assert sensor.gain_std == pytest.approx(oracle.stderr / oracle.slope**2, rel=ROUNDING)
    assert sensor.zero_std == pytest.approx(oracle.intercept_stderr, rel=ROUNDING)


def test_a_cubic_comes_back_and_its_scatter_is_that_of_the_noise():
    P = np.linspace(2e4, 7e5, 12)
    true = np.polynomial.Polynomial((30, 120, -60, 90))(P / 7e5)
    exact = calibration.fit_feed_forward(P, true)
    np.testing.assert_allclose([exact.output(p) for p in P], true, rtol=1e-9)
    rng = np.random.default_rng(3)
    noisy = [calibration.fit_feed_forward(P, true + rng.normal(0, 0.8, P.size)) for _ in range(800)]
    scatter = np.sqrt(np.mean([v.scatter**2 for v in noisy]))
    assert scatter == pytest.approx(0.8, rel=0.05)  # 800 draws: 1 %
    with pytest.raises(RigError, match=r"valid from 20 kPa to 700 kPa, not at 10 kPa"):
        exact.output(1e4)
    assert FeedForward.bias().output(3e5) == 127.5
    with pytest.raises(RigError, match=r"must be 0..255"):
        FeedForward.bias(300.0).output(0.0)


def test_a_file_gives_back_the_same_numbers(tmp_path):
    path, rng, P = tmp_path / "rig.toml", np.random.default_rng(5), np.linspace(2e4, 7e5, 12)
    force = calibration.fit_sensor(2500 - REFERENCES / 400, REFERENCES / 300)
    v = calibration.fit_feed_forward(P, 30 + P / 4000 + rng.normal(0, 0.5, P.size))
    known = Calibration(calibration.fit_sensor(noisy_counts(rng), REFERENCES), force, v)
    biased = dataclasses.replace(known, feed_forward=FeedForward.bias())
    numbered = Calibration(Sensor(300.0, 500.0), Sensor(-1.0, 2000.0), board=4711)
    for one in (known, biased, numbered):
        calibration.write_calibration(path, one)
        assert calibration.read_calibration(path) == one
    assert "gain_Pa_per_count" in path.read_text()


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"pressure": {}}, "force is missing"),
        ({"pressure": {"gain_Pa_per_count": 1}, "force": {}}, "pressure.: zero_counts is missing"),
        ({"pressure": {"gain_psi_per_count": 1}, "force": {}}, "unknown key 'gain_psi_per_count'"),
        ({"pressure": {"gain_Pa_per_count": 0, "zero_counts": 0}, "force": {}}, "nonzero"),
        ({"pressure": {}, "force": {}, "board": "a"}, "board must be a number from 0 to 65534"),
    ],
)
def test_a_file_that_is_no_calibration_is_refused(content, message):
    with pytest.raises(RigError, match=message):
        calibration.calibration_from_dict(content)

"""Records of known truth: a force law, a hysteresis that closes at the top, noise and a clamp."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from maps import COLUMNS, bpa10_maps

import fitting
from famjax.boundary.errors import InputError
from fitting.data import Specimen, csv_text, read_csv, write_csv
from fitting.records import QuasiStatic, RampRecord, quasi_static, ramp, ramps_command, static_map

ZERO, TOP, HALF_WIDTH, NOISE = 9e3, 6.2e5, 4.0, 0.9  # Pa, Pa, N, N
CLAMP = -8.7
LENGTHS = (0.30, 0.28)  # m; pretension 6 N at the first, slack under 150 kPa at the second
SPECIMEN = Specimen("synthetic", 0.30, 1.8e-3, nominal_diameter=10e-3, embedded=True)
SIGMAS = 4.0  # standard errors that an estimate may miss the truth by; seeds are fixed


def _static(P: np.ndarray, length: float) -> np.ndarray:
    """Force [N]: nearly a line, slightly curved; without the muscle's slack where it buckles."""
    if length == LENGTHS[0]:
        return 6 + 6e-4 * P + 1e-10 * P**2
    return np.maximum(4e-4 * (P - 1.5e5), -7.0 - 3e-5 * P)


def _half_width(P: np.ndarray) -> np.ndarray:
    return HALF_WIDTH * np.sin(np.pi * np.clip(P / TOP, 0, 1))


def _hold_pressures() -> np.ndarray:
    """Gauge pressure of the holds: filling towards the top, then venting to 60 kPa."""
    fill = TOP * (1 - 0.85 ** np.arange(1, 21))
    return np.concatenate([fill, 6e4 + (fill[-1] - 6e4) * 0.8 ** np.arange(1, 19)])


def _staircase(length: float, *, seed: int = 0, noise: float = NOISE) -> RampRecord:
    random = np.random.default_rng(seed)
    held = _hold_pressures()
    t = np.arange(0, 0.05 + 0.4 * held.size, 2e-3)
    since = t - 0.05
    number = np.minimum(np.floor(since / 0.4).astype(int), held.size - 1)
    before, after = (np.concatenate([[0.0], held])[number + k] for k in (0, 1))
    decay = np.exp(-np.clip(since - 0.4 * number, 0, None) / 0.015)
    P = np.where(number < 0, 0.0, after + (before - after) * decay)
    F = _static(P, length) + np.where(number < 20, -1.0, 1.0) * _half_width(P)
    if noise:
        F = F + noise * random.standard_normal(t.size)
        P = P + 350 * random.standard_normal(t.size)
    stamps = np.round(t, 2)  # they repeat
    return RampRecord(np.maximum(F, CLAMP), P + ZERO, stamps, length, f"staircase {seed}")


def _ramp(length: float, *, seed: int = 0, noise: float = NOISE) -> RampRecord:
    random = np.random.default_rng(seed)
    t = np.arange(0, 42, 2e-3)
    P = TOP * np.clip(np.minimum(t - 1, 41 - t) / 20, 0, 1)
    F = _static(P, length) + np.where(t < 21, -1, 1) * _half_width(P)
    F = np.maximum(F + noise * random.standard_normal(t.size), CLAMP)
    P = P + ZERO + 350 * (noise > 0) * random.standard_normal(t.size)
    return RampRecord(F, P, t, length, f"ramp {seed}")


@pytest.fixture(scope="module")
def points() -> QuasiStatic:
    records = [_staircase(L, seed=i + 3 * (L < 0.3)) for L in LENGTHS for i in range(3)]
    return quasi_static(records, atmosphere=ZERO)


@pytest.fixture(scope="module")
def static(points: QuasiStatic) -> fitting.records.StaticMap:
    return static_map(points)


def test_each_hold_gives_a_point_clamp_and_slack_are_marked_and_nothing_is_dropped(points):
    assert points.kinds == ("staircase",) * 6
    np.testing.assert_allclose(points.periods, 0.4, rtol=0.01)
    for number in range(6):
        mine = points.record == number
        held = _hold_pressures()
        assert mine.sum() == held.size
        # A median of 80 readings, and the last 0.2 % of the step that decays in the window.
        bound = SIGMAS * 350 * 1.26 / np.sqrt(80) + 0.002 * TOP * 0.15
        assert np.abs(points.pressure[mine] - held).max() < bound
        assert points.filling[mine].tolist() == [True] * 20 + [False] * 18
    assert points.settled.all()
    assert points.clamp == CLAMP
    assert points.slack_below == pytest.approx(6 * NOISE, rel=0.05)
    short = points.length == LENGTHS[1]
    assert points.slack[points.force < points.slack_below].all()
    assert not points.slack[~short & (points.pressure > 1e5)].any()
    assert points.slack[short & (points.pressure < 1.4e5)].all()
    assert points.force.size == 6 * 38


def test_force_and_noise_of_the_holds(points):
    free = points.force > CLAMP + 4 * NOISE
    P = points.pressure
    truth = np.where(points.length == LENGTHS[0], *(_static(P, length) for length in LENGTHS))
    truth = truth + np.where(points.filling, -1, 1) * _half_width(P)
    miss = (points.force - truth)[free]
    stderr = np.hypot(points.stderr[free], 6e-4 * 350 * 1.26 / np.sqrt(80))
    assert np.abs(miss / stderr).max() < SIGMAS
    assert np.std(miss / stderr) == pytest.approx(1, abs=0.25)  # 3 standard errors, 200 points
    assert np.median(points.noise[free]) == pytest.approx(NOISE, rel=0.05)


def test_readings_of_a_coarse_sensor_are_resolved():
    """Medians fall on the sensor's steps; spread over the step they do not."""
    fine = _staircase(LENGTHS[0], seed=5)
    step = 0.683
    coarse = dataclasses.replace(fine, force=step * np.round(fine.force / step))
    a, b = (quasi_static([record], atmosphere=ZERO) for record in (fine, coarse))
    assert np.sqrt(np.mean((a.force - b.force) ** 2)) < 0.1 * step  # 0.29 for plain medians
    assert np.unique(b.force).size == b.force.size


def test_the_map_is_the_mean_of_the_branches(static):
    pulling = ~static.slack
    for length in LENGTHS:
        rows = pulling & (static.length == length)
        truth = _static(static.pressure[rows], length)
        # Noise, and up to 0.25 N of curvature and of the kink between holds.
        assert np.abs(static.force[rows] - truth).max() < SIGMAS * 0.1 + 0.25
    assert static.slack[(static.length == LENGTHS[1]) & (static.pressure <= 1.5e5)].all()
    assert np.isin(np.arange(2e5, 6e5, 25e3), static.pressure[pulling]).all()


@pytest.mark.parametrize("length", LENGTHS)
def test_a_continuous_ramp(length):
    points = quasi_static([_ramp(length)], atmosphere=ZERO)
    assert points.kinds == ("ramp",)
    assert np.median(points.noise) == pytest.approx(NOISE, rel=0.05)
    made = static_map(points)
    rows = ~made.slack
    P = made.pressure[rows]
    away = np.abs(P - 1.5e5) > 25e3 if length == LENGTHS[1] else P > 0  # a bin across the kink
    # Curvature in a bin: 2e-10 w^2 / 24 = 0.005 N.
    assert np.abs((made.force[rows] - _static(P, length))[away]).max() < SIGMAS * 0.05
    pairs = fitting.records.ramp_pairs(points, rest_length=LENGTHS[0])
    half = pairs.half_difference - _half_width(pairs.pressure)
    assert np.median(np.abs(half)) < SIGMAS * 0.05
    assert rows.sum() >= 17


def test_the_map_is_data_and_reads_back(static, tmp_path):
    data = static.force_data(SPECIMEN)
    assert data.force.min() >= static.points.slack_below
    assert read_csv(write_csv(data, tmp_path / "map.csv")).sha256 == data.sha256
    metric = read_csv(write_csv(data, tmp_path / "metric.csv", "metric"))
    np.testing.assert_allclose(metric.pressure, data.pressure, rtol=1e-14)
    assert metric.specimen.rest_length == pytest.approx(0.30, rel=1e-14)
    with pytest.raises(InputError, match="units must be one of"):
        csv_text(data, "imperial")


def test_unsettled_holds_are_marked_and_not_used(monkeypatch):
    monkeypatch.setattr(ramp, "_PART", (0.02, 0.9))
    points = _points()
    assert 0 < points.settled.sum() < points.settled.size
    monkeypatch.setattr(ramp, "_MAX_DRIFT", 1e-6)
    with pytest.raises(InputError, match="no record at 300 mm has both branches"):
        static_map(_points())
    monkeypatch.setattr(ramp, "_PART", (0.511, 0.512))
    with pytest.raises(InputError, match="fewer than 5 readings in the used part"):
        _points()


BAD: list[tuple[Callable[[], object], str]] = [
    (lambda: _points(atmosphere=np.nan), "must be finite"),
    (lambda: _points(atmosphere=101e3), "far below the stated reading at atmos.*, 101 kPa"),
    (lambda: quasi_static([], atmosphere=ZERO), "at least one record"),
    (lambda: quasi_static([_still()], atmosphere=0.0), "has no complete pressure bin"),
    (lambda: static_map(_points(), step=0.0), "step must be > 0"),
    (lambda: static_map(_points(slack_below=1e4)).force_data(SPECIMEN), "of the map are slack"),
    (lambda: dataclasses.replace(_ramp(0.3), length=0.0), "length must be > 0"),
    (lambda: dataclasses.replace(_ramp(0.3), pressure=np.ones(21000)), "pressure in a record must"),
    (lambda: dataclasses.replace(_ramp(0.3), time=np.ones(21000)), "time in a record must vary"),
]


def _points(**options: float) -> QuasiStatic:
    return quasi_static([_staircase(LENGTHS[0])], **({"atmosphere": ZERO} | options))


def _still() -> RampRecord:
    whole = _ramp(LENGTHS[0])
    return dataclasses.replace(whole, pressure=1.2e5 + 1e-3 * whole.pressure)


@pytest.mark.parametrize(("call", "match"), BAD)
def test_what_cannot_be(call, match):
    with pytest.raises(InputError, match=match):
        call()


def _stairs(period: float, rate: float, noise: float, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Pressure [Pa], time [s] and the times of all pulses; some pulses are too small to be seen."""
    t = np.arange(0, 40 * period, 1 / rate)
    pulses = 0.3 * period + period * np.arange(39)
    steps = np.concatenate([6e4 * 0.85 ** np.arange(25), -9e4 * 0.75 ** np.arange(14)])
    since = t[:, None] - pulses
    ringing = 1 - np.exp(-since.clip(0) / (0.02 * period)) * np.cos(250 * since / period)
    P = (steps * np.where(since > 0, ringing, 0)).sum(axis=1) + 9e3
    return P + noise * np.random.default_rng(seed).standard_normal(t.size), t + 100, pulses + 100


@pytest.mark.parametrize(("period", "rate"), [(0.5, 500.0), (0.8, 1000.0), (5.0, 20.0)])
@pytest.mark.parametrize("noise", [0.0, 400.0])
def test_holds_lie_between_the_pulses(period, rate, noise):
    P, t, pulses = _stairs(period, rate, noise)
    found = fitting.records.find_staircase(P, t)
    assert found is not None
    assert found.period == pytest.approx(period, rel=0.01)  # two readings in a hundred
    assert found.start.size == 39  # one after each pulse; what is left after the last is too short
    # A pulse is seen at its first jump, at most two readings late; unseen ones are spaced evenly.
    assert np.abs(found.start - pulses).max() < max(3 / rate, 0.03 * period)
    rows = found.rows(t)
    for part, pulse in zip(rows, pulses, strict=True):
        assert pulse + 0.55 * period <= t[part[0]] <= t[part[-1]] < pulse + period


def _write(record: RampRecord, path: Path) -> str:
    columns = (record.force, record.pressure / 1e3, record.time, np.ones_like(record.time))
    np.savetxt(path, np.stack(columns, axis=1), delimiter=",", fmt="%.10g")  # type: ignore[arg-type]
    return str(path)


@pytest.mark.slow
def test_the_command(points, tmp_path):
    files = [_write(r, tmp_path / f"{i}.csv") for i, r in enumerate(points.records)]
    entries = [f"{f}={r.length * 1e3}mm" for f, r in zip(files, points.records, strict=True)]
    listed = tmp_path / "list.csv"
    rows = (f"{i}.csv,{r.length * 1e3}" for i, r in enumerate(points.records))
    listed.write_text("\n".join(["file,length_mm", *rows, ""]))
    specimen = {"rest_length": 0.30, "name": "synthetic"}
    how = {"columns": COLUMNS, "atmosphere": ZERO}
    summary, made = ramps_command(entries, **how, specimen=specimen, system="metric")
    assert set(made) == {"map.csv", "ramps.png", "branches.csv"}
    assert made["ramps.png"].startswith(b"\x89PNG")
    (tmp_path / "map.csv").write_bytes(made["map.csv"])
    assert read_csv(tmp_path / "map.csv").force.size == summary["n_pulling_rows"] > 30
    assert summary["lengths"][0]["length_m"] == pytest.approx(0.3)
    assert summary["lengths"][0]["n_fill"] == 60
    assert summary["clamp_N"] == pytest.approx(CLAMP)
    assert summary["atmosphere_Pa"] == pytest.approx(9e3)
    # What was not said is assumed as of any force map, is told, and is not said by the map either.
    told = " ".join(summary["notes"])
    assert "wall thickness was not given: 1.8 mm" in told
    assert "bladder diameter was not given" in told
    read = read_csv(tmp_path / "map.csv")
    assert read.assumed == ("nominal_diameter", "wall_thickness", "bladder_diameter")
    known = {**specimen, "wall_thickness": 1.5e-3, "embedded": False, "nominal_diameter": 0.02}
    _, made = ramps_command(entries, columns=COLUMNS, atmosphere=ZERO, specimen=known)
    (tmp_path / "known.csv").write_bytes(made["map.csv"])
    read = read_csv(tmp_path / "known.csv")
    assert read.assumed == ()
    assert not read.specimen.embedded
    again = fitting.records.read_ramps([str(listed)], columns=COLUMNS)
    assert [record.length for record in again] == pytest.approx([0.3] * 3 + [0.28] * 3)
    assert [record.source for record in again] == [f"{i}.csv" for i in range(6)]


@pytest.mark.slow
def test_bpa10_is_as_its_study_says():
    """Figures of an independent evaluation of the seven specimens of the series, rounded there."""
    maps = bpa10_maps()
    assert sum(made.points.force.size for made in maps.values()) == pytest.approx(1300, abs=20)
    for made in maps.values():
        points = made.points
        np.testing.assert_allclose(points.periods, 0.5, rtol=0.01)
        assert points.clamp == -8.7354
        assert np.median(points.noise) == pytest.approx(0.9, abs=0.05)
        assert points.settled.mean() > 0.99
        unkinked, *kinked = made.lengths
        assert unkinked["half_width_rms_N"] == pytest.approx(0.9, abs=0.4)
        assert all(one["half_width_rms_N"] < 8.7 for one in kinked)
        assert 0.1 < unkinked["repeatability_N"] < 1.5

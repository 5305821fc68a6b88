"""Clocks of devices, logs and cameras: known drifts, offsets and rates, and what cannot be aligned."""

import numpy as np
import pytest

from fitting import InputError
from fitting.records import MachineLog, SyncError, align_by_load, fit_clock, synchronise

LATENCY = 0.002
"""Shortest latency [s]: the map cannot know it."""
TARGET = 1e-3
"""The figure asked for [s]."""
SIGMAS = 4.5  # of about 40 checks each; the standard errors themselves are estimates


def arrivals(
    seed: int, *, duration: float, drift: float, period: float, wobble: float = 30e-6
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Device times, true host times and arrivals, 2 % of them late by 0.1 s in the mean."""
    rng = np.random.default_rng(seed)
    t = np.arange(0, duration, 0.01)
    phase = rng.uniform(0, 2 * np.pi)
    swing = wobble * period / (2 * np.pi) * np.sin(2 * np.pi * t / period + phase)
    true = 1234.5 + (1 + drift) * t + swing
    late = LATENCY + rng.exponential(0.002, t.size)
    late += (rng.random(t.size) < 0.02) * rng.exponential(0.1, t.size)
    return t, true, true + late


@pytest.mark.parametrize("drift", [3000e-6, -3000e-6])
@pytest.mark.parametrize("period", [200.0, 600.0, 1800.0])
def test_drift_and_wobble_are_followed_to_a_millisecond(drift, period):
    t, true, arrived = arrivals(int(period), duration=1800, drift=drift, period=period)
    clock = fit_clock(t, arrived)
    error = clock.host(t) - true - LATENCY
    assert np.abs(error).max() < TARGET / 2
    assert error.std() < 5e-5
    assert clock.error < TARGET / 10
    assert clock.rate == pytest.approx(1 + drift, abs=4e-5)


@pytest.mark.parametrize(
    ("device", "host", "match"),
    [
        ([1.0, 2.0], [1.0], "equal shape"),
        ([1.0, 1.0], [1.0, 2.0], "different device times"),
        ([1.0, np.nan], [1.0, 2.0], "finite"),
    ],
)
def test_what_cannot_be_mapped_is_refused(device, host, match):
    with pytest.raises(InputError, match=match):
        fit_clock(device, host)


def load(t: np.ndarray) -> np.ndarray:
    """Strokes of 80 s at four pressures that rise, each within half a second, with rests between."""
    phase = np.where((t - 10) % 100 < 80, np.minimum((t - 10) % 100, 80 - (t - 10) % 100) / 40, 0.0)
    phase = np.where((t > 10) & (t < 400), phase, 0.0)
    at, step = np.array([5.0, 95.0, 195.0, 295.0, 405.0]), [1000, 700, 700, 700, -3000]
    level = 200 + sum(h * (1 + np.tanh((t - s) / 0.2)) / 2 for s, h in zip(at, step, strict=True))
    return level * (1 - phase) ** 1.3


def recorded(
    seed: int, offset: float, rate: float, seconds: float = 420.0, noise: float = 8.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    journal_time = np.arange(0, seconds, 0.01)
    true = np.arange(3.0, seconds - 5, 0.02)
    journal = load(journal_time) + rng.normal(0, noise, journal_time.size)
    log = 0.97 * load(true) + 12.0 + rng.normal(0, 0.5, true.size)
    return journal_time, journal, (true - offset) / (1 + rate), log


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("offset", "rate"), [(1234.5678, 0.0), (-77.7, 3e-3), (0.004, -5e-5)])
def test_offset_and_rate_are_found_within_their_errors(seed, offset, rate):
    found = align_by_load(*recorded(seed, offset, rate))
    at = np.array([10.0, 200.0, 400.0])
    machine = (at - offset) / (1 + rate)
    error = found.journal_time(machine) - at
    assert np.abs(error).max() < 2e-3  # s; the target is 10 ms
    stated = np.hypot(found.offset_error, found.rate_error * (machine - found.reference))
    assert np.all(np.abs(error) < SIGMAS * stated)
    assert abs(found.rate - rate) < SIGMAS * found.rate_error


def test_the_errors_are_neither_boast_nor_blanket():
    scaled = []
    for seed in range(12):
        found = align_by_load(*recorded(seed, 50.0, 1e-4))
        reference = np.array(found.reference)
        truth = 50.0 + (1 + 1e-4) * reference
        scaled.append(float(found.journal_time(reference) - truth) / found.offset_error)
    assert 0.5 < np.std(scaled) < 2.0  # 12 draws: 0.6 to 1.4 for exact errors


@pytest.mark.parametrize("every", [5, 25])
def test_a_slow_log_is_laid_by_its_strokes(every):
    """10 and 2 rows a second: too slow for the changes of pressure, which would pull the offset."""
    t, F, tm, Fm = recorded(4, 321.0, 1e-4)
    found = align_by_load(t, F, tm[::every], Fm[::every])
    machine = (np.array([10.0, 400.0]) - 321.0) / (1 + 1e-4)
    assert np.abs(found.journal_time(machine) - [10.0, 400.0]).max() < 5e-3


def test_equal_strokes_alone_are_refused_unless_it_is_known_roughly():
    t = np.arange(0, 400.0, 0.01)
    F = 1000 * np.abs((t % 40) / 20 - 1)
    inner = t[(t > 60) & (t < 300)][::2]
    Fm = 1000 * np.abs((inner % 40) / 20 - 1)
    with pytest.raises(InputError, match="agree at more than one offset"):
        align_by_load(t, F, inner - 7.0, Fm)
    found = align_by_load(t, F, inner - 7.0, Fm, near=(5.0, 10.0))
    assert found.offset == pytest.approx(7.0, abs=1e-3)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda t, F, tm, Fm: (t, F, tm, np.cumsum(np.random.default_rng(1).normal(size=tm.size))),
         "do not match"),
        (lambda t, F, tm, Fm: (t, F, tm, -Fm), "do not match"),
        (lambda t, F, tm, Fm: (t, F, tm, np.full(tm.size, 3.0)), "do not match"),
        (lambda t, F, tm, Fm: (t[:10], F[:10], tm, Fm), "at least 50"),
    ],
)  # fmt: skip
def test_records_of_different_tests_and_of_the_other_sign_are_refused(spoil, words):
    with pytest.raises(InputError, match=words):
        align_by_load(*spoil(*recorded(0, 5.0, 0.0)))


IN = 0.0254
REST = 9.28 * IN


def triangle(t, stroke=2.8 * IN, start=10.0, duration=240.0):
    return stroke * (1 - np.abs(2 * np.clip((t - start) / duration, 0, 1) - 1))


def machine(displacement=triangle, end=270.0):
    t = np.arange(0, end, 0.1)
    return MachineLog(t, displacement(t), force=1e3 * np.cos(t / 30), source="log.csv")


def pictured(seed, offset, rate=1.0, noise=0.001 * IN, jitter=0.0, n=220, sense=-1,
                 displacement=triangle):  # fmt: skip
    """Camera times of pictures about a second apart, and the lengths in them."""
    rng = np.random.default_rng(seed)
    t = 0.4 + 1.09 * np.arange(n)
    at = t + offset + (rate - 1) * (t - t.mean()) + jitter * rng.standard_normal(n)
    return t, REST + sense * displacement(at) + noise * rng.standard_normal(n)


@pytest.mark.slow
def test_offset_and_rate_come_back_within_their_standard_errors():
    scaled = []
    for seed in range(40):
        t, length = pictured(seed, 7.3, 1.0004, noise=0.003 * IN)
        found = synchronise(t, length, machine())
        scaled.append([(found.offset - 7.3) / found.offset_stderr,
                       (found.rate - 1.0004) / found.rate_stderr])  # fmt: skip
    rms = np.sqrt(np.mean(np.square(scaled), axis=0))
    assert np.all((rms > 0.7) & (rms < 1.4))  # 40 draws scatter by 11 %


@pytest.mark.parametrize(
    ("noise", "jitter", "bound"),
    [(0.001, 0.0, 0.01), (0.005, 0.0, 0.05), (0.0007, 0.3, 0.1)],
    ids=["photogrammetry", "pixel level", "jitter of the shutter"],
)
def test_the_offset_is_as_sharp_as_the_study_found(noise, jitter, bound):
    t, length = pictured(3, -4.2, noise=noise * IN, jitter=jitter)
    found = synchronise(t, length, machine())
    assert found.offset == pytest.approx(-4.2, abs=bound)  # three standard errors of the study
    assert found.offset_stderr < bound / 2
    assert found.sense == -1
    assert found.length_at_zero == pytest.approx(REST, abs=0.01 * IN)


def test_whole_second_stamps_shift_the_offset_by_half_a_second_which_keeps_the_times_right():
    t, length = pictured(7, 12.0)
    found = synchronise(np.floor(t), length, machine())
    assert found.offset == pytest.approx(12.5, abs=0.06)
    late = found.log_time(np.floor(t)) - (t + 12.0)
    assert abs(late.mean()) < 0.06
    assert np.abs(late).max() < 0.6


@pytest.mark.parametrize(
    ("displacement", "match"),
    [
        (lambda t: 0 * t, "length is constant"),
        (lambda t: 1e-3 * t * IN, "does not determine the clock offset"),
        (lambda t: 1e-6 * IN * np.sin(t / 20), "do not follow"),
    ],
    ids=["standing", "one straight ramp", "less than the noise"],
)
def test_no_motion_is_refused(displacement, match):
    t, length = pictured(11, 5.0, displacement=displacement, noise=1e-4 * IN)
    with pytest.raises(SyncError, match=match):
        synchronise(t, length, machine(displacement))


def test_a_motion_that_repeats_needs_a_window():
    def cycles(t):
        return 1.4 * IN * (1 - np.cos(2 * np.pi * t / 60))

    t, length = pictured(12, 97.0, displacement=cycles)
    log = machine(cycles, end=1200)
    with pytest.raises(SyncError, match="several offsets"):
        synchronise(t, length, log)
    assert synchronise(t, length, log, near=(90.0, 20.0)).offset == pytest.approx(97, abs=0.02)


def test_interpolation_knows_its_error():
    t = np.arange(0, 20, 0.5)
    log = MachineLog(t, t, force=np.sin(t))
    at = np.linspace(1, 18, 1000)
    found, stderr = log.at("force", at)
    wrong = np.abs(found - np.sin(at))
    assert np.all(wrong <= 1.3 * stderr + 1e-6)  # second differences of a sine fall short by h^2/12
    assert stderr.max() < 1.5 * wrong.max()
    shifted, with_clock = log.at("force", at, 0.01)
    slope = np.interp(at, t[:-1] + 0.25, np.diff(np.sin(t)) / 0.5)
    assert np.all(with_clock >= 0.01 * np.abs(slope) * 0.7 - 2e-3)
    np.testing.assert_array_equal(shifted, found)
    assert np.isnan(log.at("force", np.array([-1.0, 21.0]))[0]).all()
    with pytest.raises(ValueError, match="no channel 'pressure'"):
        log.at("pressure", at)

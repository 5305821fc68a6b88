"""The clocks of camera and machine: strokes with a known offset, rate, jitter and whole seconds."""

import numpy as np
import pytest

from fitting.records import MachineLog, SyncError, synchronise

IN = 0.0254
REST = 9.28 * IN
LBF, PSI = 4.4482216152605, 6894.757293168361


def triangle(t, stroke=2.8 * IN, start=10.0, duration=240.0):
    """Displacement of one cycle between two stops."""
    part = np.clip((t - start) / duration, 0, 1)
    return stroke * (1 - np.abs(2 * part - 1))


def machine(displacement=triangle, end=270.0):
    t = np.arange(0, end, 0.1)
    return MachineLog(t, displacement(t), force=1e3 * np.cos(t / 30), source="log.csv")


def photographed(seed, offset, rate=1.0, noise=0.001 * IN, jitter=0.0, n=220, sense=-1,
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
        t, length = photographed(seed, 7.3, 1.0004, noise=0.003 * IN)
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
    t, length = photographed(3, -4.2, noise=noise * IN, jitter=jitter)
    found = synchronise(t, length, machine())
    assert found.offset == pytest.approx(-4.2, abs=bound)  # three standard errors of the study
    assert found.offset_stderr < bound / 2
    assert found.sense == -1
    assert found.length_at_zero == pytest.approx(REST, abs=0.01 * IN)


def test_whole_second_stamps_shift_the_offset_by_half_a_second_which_keeps_the_times_right():
    t, length = photographed(7, 12.0)
    found = synchronise(np.floor(t), length, machine())
    assert found.offset == pytest.approx(12.5, abs=0.06)
    late = found.log_time(np.floor(t)) - (t + 12.0)
    assert abs(late.mean()) < 0.06
    assert np.abs(late).max() < 0.6


@pytest.mark.parametrize(
    ("displacement", "match"),
    [
        (lambda t: 0 * t, "no motion"),
        (lambda t: 1e-3 * t * IN, "does not fix the offset"),
        (lambda t: 1e-6 * IN * np.sin(t / 20), "do not follow"),
    ],
    ids=["standing", "one straight ramp", "less than the noise"],
)
def test_no_motion_is_refused(displacement, match):
    t, length = photographed(11, 5.0, displacement=displacement, noise=1e-4 * IN)
    with pytest.raises(SyncError, match=match):
        synchronise(t, length, machine(displacement))


def test_a_motion_that_repeats_needs_a_window():
    def cycles(t):
        return 1.4 * IN * (1 - np.cos(2 * np.pi * t / 60))

    t, length = photographed(12, 97.0, displacement=cycles)
    log = machine(cycles, end=1200)
    with pytest.raises(SyncError, match="several offsets"):
        synchronise(t, length, log)
    assert synchronise(t, length, log, window=20.0, guess=90.0).offset == pytest.approx(
        97, abs=0.02
    )


# The log


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

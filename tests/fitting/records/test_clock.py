"""Device to host time: within a millisecond where the crystal drifts and wobbles and packets are late."""

import numpy as np
import pytest

from famjax.boundary.errors import InputError
from fitting.records import fit_clock

LATENCY = 0.002
"""Shortest latency [s]: the map cannot know it."""
TARGET = 1e-3
"""The figure asked for [s]."""


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
def test_drift_and_wobble_are_followed_to_a_millisecond(drift: float, period: float) -> None:
    t, true, arrived = arrivals(int(period), duration=1800, drift=drift, period=period)
    clock = fit_clock(t, arrived)
    error = clock.host(t) - true - LATENCY
    assert np.abs(error).max() < TARGET / 2
    assert error.std() < 5e-5
    assert clock.error < TARGET / 10
    assert clock.drift_ppm == pytest.approx(-drift * 1e6, abs=40)


@pytest.mark.parametrize("duration", [1.0, 8.0, 25.0])
def test_short_records_are_mapped_too(duration: float) -> None:
    t, true, arrived = arrivals(4, duration=duration, drift=3000e-6, period=600)
    assert np.abs(fit_clock(t, arrived).host(t) - true - LATENCY).max() < TARGET


def test_a_pause_of_the_host_does_not_bend_the_map() -> None:
    """All packets of three seconds come at once, as after SIGSTOP."""
    t, true, arrived = arrivals(6, duration=120, drift=2000e-6, period=600)
    paused = (t > 50) & (t < 53)
    arrived[paused] = arrived[paused].max()
    assert np.abs(fit_clock(t, arrived).host(t) - true - LATENCY).max() < TARGET


def test_a_perfect_line_comes_back_exactly_and_the_inverse_inverts() -> None:
    t = np.linspace(0, 300, 1001)
    clock = fit_clock(t[::-1], 10 + 1.003 * t[::-1])
    np.testing.assert_allclose(clock.host(t), 10 + 1.003 * t, atol=1e-9)
    t, _, arrived = arrivals(8, duration=300, drift=3000e-6, period=200)
    clock = fit_clock(t, arrived)
    np.testing.assert_allclose(clock.device(clock.host(t)), t, atol=1e-9)


def test_what_cannot_be_mapped_is_refused() -> None:
    with pytest.raises(InputError, match=r"one shape"):
        fit_clock([1.0, 2.0], [1.0])
    with pytest.raises(InputError, match=r"two device times"):
        fit_clock([1.0, 1.0], [1.0, 2.0])
    with pytest.raises(InputError, match=r"finite"):
        fit_clock([1.0, np.nan], [1.0, 2.0])

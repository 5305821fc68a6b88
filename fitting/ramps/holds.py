"""Holds of a staircase record: the stretches between the pulses of a valve, found by the pressure.

A pulse shows as a jump of the pressure. Where it moves too little to be seen, near saturation, the
period tells when it came.
"""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError

from ..rubber.cycles import noise_of

_JUMP = 0.01  # least jump over two readings, as a fraction of the record's pressure range
_JUMP_NOISE = 8.0  # and in standard deviations of the pressure noise
_CALM = 0.25  # of a period without a jump before a pulse: longer than the air rings
_LEAST_PULSES = 4
_LEAST_CORRELATION = 0.3
_FULL = 0.95  # least part of a period that the first or the last hold must have
_TOLERANCE = 0.15  # of a period by which a regular pulse may be early or late


@dataclasses.dataclass(frozen=True)
class Staircase:
    """When the pressure of a record is held.

    Attributes:
        period: between pulses of the valve [s].
        start, stop: of every hold [s], shape (holds,), from one pulse to the next.
    """

    period: float
    start: Float[np.ndarray, " holds"]
    stop: Float[np.ndarray, " holds"]

    def rows(
        self, time: Float[np.ndarray, " n"], part: tuple[float, float]
    ) -> list[Int[np.ndarray, " _"]]:
        """Rows of each hold's part, given as fractions of the hold."""
        width = self.stop - self.start
        low, high = (np.searchsorted(time, self.start + end * width) for end in part)
        return [np.arange(i, j) for i, j in zip(low, high, strict=True)]


def find_staircase(
    pressure: Float[np.ndarray, " n"],
    time: Float[np.ndarray, " n"],
    *,
    period: float | None = None,
) -> Staircase | None:
    """The holds of a record, or None where its pressure does not move in regular pulses.

    A reading moves where the pressure changes by more than 1 % of its range, and by more than the
    noise explains, over two readings. The period is the lag of the highest peak of the moving
    readings' autocorrelation. A pulse is the first moving reading after a calm quarter of it. The
    time between two pulses is one hold, or several equal ones where pulses moved nothing.

    Args:
        pressure: [Pa], shape (n,).
        time: [s], shape (n,).
        period: [s] where it is known; None finds it.

    Returns:
        The holds, or None: fewer than four pulses, or no period.

    Raises:
        InputError: a period that is not between two readings and half the record.
    """
    t = time - time[0]
    if period is not None and not 2 * t[-1] / t.size < period < t[-1] / 2:
        raise InputError(
            f"the period must lie between two readings and half the record, {t[-1] / 2:.4g} s, got "
            f"{period} s"
        )
    moving = _moving(pressure)
    lag = _period(moving, t) if period is None else period
    if lag is None:
        return None
    at = t[moving]
    pulses = at[np.diff(at, prepend=-np.inf) > _CALM * lag]
    if pulses.size < _LEAST_PULSES:
        return None
    gaps = np.diff(pulses)
    regular = np.abs(gaps / lag - np.round(gaps / lag)) < _TOLERANCE
    if regular.sum() < gaps.size / 2:
        return None
    if period is None:
        lag = float(np.median(gaps[regular] / np.round(gaps[regular] / lag)))
    before = pulses[0] - lag * np.arange(int((pulses[0] + (1 - _FULL) * lag) / lag), 0, -1)
    after = pulses[-1] + lag * np.arange(1, int((t[-1] - pulses[-1]) / lag + 1 - _FULL) + 1)
    inner = [
        np.linspace(a, b, max(1, round((b - a) / lag)), endpoint=False)
        for a, b in itertools.pairwise(pulses)
    ]
    edges = np.concatenate([before, *inner, pulses[-1:], after]) + time[0]
    return Staircase(period=lag, start=edges[:-1], stop=edges[1:])


def _moving(pressure: Float[np.ndarray, " n"]) -> Bool[np.ndarray, " n"]:
    jump = max(_JUMP * float(np.ptp(pressure)), _JUMP_NOISE * noise_of(pressure))
    change = np.abs(pressure[2:] - pressure[:-2]) > jump
    return np.concatenate([[False], change, [False]])


def _period(moving: Bool[np.ndarray, " n"], time: Float[np.ndarray, " n"]) -> float | None:
    """Lag [s] of the highest peak in the autocorrelation of the moving readings; None if low."""
    step = time[-1] / (time.size - 1)
    signal = np.zeros(time.size)
    signal[np.round(time[moving] / step).astype(int)] = 1.0
    signal -= signal.mean()
    spectrum = np.fft.rfft(signal, 2 * time.size)
    correlation = np.fft.irfft(np.abs(spectrum) ** 2)[: time.size // 2]
    low = np.flatnonzero(correlation < 0.1 * correlation[0])
    if not low.size:
        return None
    lag = int(low[0] + np.argmax(correlation[low[0] :]))
    return lag * step if correlation[lag] >= _LEAST_CORRELATION * correlation[0] else None

"""Align clocks: the device's with the host's, and the test machine's with the journal's."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

Series = tuple[np.ndarray, np.ndarray]
"""Times [s] and forces [N] of a record."""
MAX_RATE = 0.01
"""Largest accepted relative difference between two clock rates: ten seconds in a quarter of an hour."""

_PASSES = 3
_WINDOW = 10.0  # s, within which the error of a clock map is constant
_COARSE = 0.5  # s, grid of the correlation
_LEAST_AGREEMENT = 0.9  # smallest correlation between the loads of the same test
_LEAST_OVERLAP = 0.5  # smallest overlap, relative to the shorter record
_CORRELATED = 0.05  # longest correlation of residuals, relative to the record
_CUBIC = 3 / 128  # interpolation error of a cubic at mid-interval, per fourth difference
_STEPS = 30  # largest number of Gauss-Newton steps
_SETTLED = 1e-4  # convergence tolerance of the offset, relative to the log's interval
_TO_AND_FRO = 0.2  # accepted oscillation of the offset, relative to its standard error
_BRIDGE = 5  # longest gap that is interpolated, in usual intervals
_FEWEST = 50  # fewest load readings for an alignment


@dataclasses.dataclass(frozen=True)
class ClockMap:
    """Map from device time to host time, neglecting the shortest latency and any drift within a window.

    host = offset + rate device + s(device), where s is piecewise linear and follows the oscillator's drift.

    Attributes:
        offset: host time [s] at device time zero.
        rate: host seconds per device second.
        knots: device times [s] of the knots of s, shape (n,), increasing.
        residuals: values of s at the knots [s], shape (n,); constant beyond the ends.
        error: standard deviation [s] of s between the knots, estimated by leaving out each knot in turn.
    """

    offset: float
    rate: float
    knots: np.ndarray
    residuals: np.ndarray
    error: float

    def host(self, device: ArrayLike | float) -> np.ndarray:
        """Convert device times [s], of any shape, to host times [s]."""
        t = np.asarray(device, dtype=np.float64)
        return np.asarray(self.offset + self.rate * t + np.interp(t, self.knots, self.residuals))


def fit_clock(device: ArrayLike, host: ArrayLike, *, window: float = _WINDOW) -> ClockMap:
    """Fit the map from device to host time as the lower envelope of arrival times.

    A record cannot arrive before it is created, so the earliest arrival in each window has the shortest
    latency. A straight line represents the mean drift. The remaining deviations of the earliest arrivals
    are interpolated, so that the map follows an unsteady oscillator.

    Args:
        device: device times [s] of records, shape (n,), n >= 2, in any order.
        host: their arrival times [s], shape (n,).
        window: length [s] of a window; variations slower than four windows are followed.

    Returns:
        The map, which converts device time to the creation time of a record plus the shortest latency.

    Raises:
        InputError: there are fewer than two distinct device times, shapes differ, or values are not
            finite.

    References:
        Moon, Skelly & Towsley 1999, INFOCOM: clock skew from the lower envelope of delays.

    >>> t = np.arange(0.0, 60.0, 0.01)
    >>> clock = fit_clock(t, 5.0 + 1.002 * t + 0.004 * (np.arange(t.size) % 7))
    >>> round(float(clock.host(30.0)), 6), round(clock.rate, 6)
    (35.06, 1.002)
    """
    t, arrival = np.asarray(device, np.float64), np.asarray(host, np.float64)
    known = t.ndim == 1 and t.shape == arrival.shape and np.isfinite([t, arrival]).all()
    if not known or t.size < 2 or np.ptp(t) == 0:
        raise InputError(
            "fitting a clock needs finite device and host times of equal shape (n,), with at least two "
            f"different device times; got shapes {t.shape} and {arrival.shape}: record for longer"
        )
    order = np.argsort(t, kind="stable")
    t, arrival = t[order], arrival[order]
    rate = _envelope_rate(t, arrival)
    late = arrival - rate * t
    offset = float(late.min())
    late = late - offset
    windows = max(round((t[-1] - t[0]) / window), 1)
    cell = np.minimum(((t - t[0]) / np.ptp(t) * windows).astype(np.int64), windows - 1)
    knots = residuals = np.empty(0)
    trend = np.zeros_like(t)
    for _ in range(_PASSES):  # a trend within a window shifts its earliest arrival
        first = _earliest(cell, late - trend)
        knots, residuals = t[first], late[first]
        trend = np.interp(t, knots, residuals)
    error = np.inf
    if knots.size > 2:  # each knot against the line through its neighbours
        guess = residuals[:-2] + np.diff(knots)[:-1] / (knots[2:] - knots[:-2]) * (
            residuals[2:] - residuals[:-2]
        )
        error = float(np.sqrt(np.mean((residuals[1:-1] - guess) ** 2) / 1.5))
    if knots.size > 1:  # extend the outer segments to the ends of the record
        slopes = np.diff(residuals) / np.diff(knots)
        before = residuals[0] + slopes[0] * (t[0] - knots[0])
        after = residuals[-1] + slopes[-1] * (t[-1] - knots[-1])
        inner = (knots > t[0]) & (knots < t[-1])
        knots = np.concatenate([t[:1], knots[inner], t[-1:]])
        residuals = np.concatenate([[before], residuals[inner], [after]])
    return ClockMap(offset, rate, knots, residuals, error)


def _envelope_rate(t: np.ndarray, arrival: np.ndarray) -> float:
    """Return the slope of the line below all arrivals that is highest at the middle of the record."""
    from scipy.optimize import linprog  # noqa: PLC0415 -- 0.2 s

    span = float(np.ptp(t))
    first = _earliest(np.floor((t - t[0]) / span * 256).astype(np.int64), arrival - t)
    x, late = (t[first] - t[0]) / span - 0.5, (arrival - t)[first]
    below = np.column_stack([np.ones_like(x), x])
    size = max(float(np.ptp(late)), 1e-300)
    line = linprog([-1, 0], below, (late - late.min()) / size, bounds=(None, None))
    return 1.0 + float(line.x[1]) * size / span


def _earliest(cell: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Return the index of the smallest delay in each cell, in the order of the cells."""
    order = np.lexsort((late, cell))
    return order[np.flatnonzero(np.diff(cell[order], prepend=-1))]


@dataclasses.dataclass(frozen=True)
class Alignment:
    """Alignment of the machine's clock with the journal's.

    t_journal = t + offset + rate (t - reference), where t is the machine's time.

    Attributes:
        offset: offset at the reference [s].
        rate: rate of the journal's clock relative to the machine's, minus 1 [-].
        reference: machine time [s] at which the offset is most accurate.
        offset_error: standard error of the offset [s].
        rate_error: standard error of the rate [-].
    """

    offset: float
    rate: float
    reference: float
    offset_error: float
    rate_error: float

    def __str__(self) -> str:
        return (
            f"clocks aligned by load: journal = log {self.offset:+.4f} s +- "
            f"{self.offset_error * 1e3:.2g} ms, rate {self.rate * 1e6:.1f} +- "
            f"{self.rate_error * 1e6:.1f} ppm"
        )

    def journal_time(self, time: ArrayLike | float) -> np.ndarray:
        """Convert machine times [s], of any shape, to journal times [s]."""
        machine = np.asarray(time, float)
        return np.asarray(machine + self.offset + self.rate * (machine - self.reference))


def align_by_load(
    journal_time: np.ndarray,
    journal_force: np.ndarray,
    log_time: np.ndarray,
    log_force: np.ndarray,
    *,
    near: tuple[float, float] | None = None,
    time_error: float = 0.0,
) -> Alignment:
    """Align two clocks by the load recorded with both; the gain and zero of the load are fitted as well.

    Minimises the sum of squares of F_journal(t) - a F_log(t) - b over offset, rate, a and b, starting from
    the offset with the best correlation. The standard errors assume that residuals are correlated over less
    than a twentieth of the record, and equally so during load changes and elsewhere. A delay in either
    channel is neglected and causes an error in the offset.

    Args:
        journal_time: journal times [s], increasing, shape (n,).
        journal_force: journal forces [N], shape (n,).
        log_time: times on the machine's clock [s], increasing, shape (m,).
        log_force: forces in the log [N], shape (m,), with the journal's sign.
        near: approximate offset [s] and its largest error [s], if known.
        time_error: standard deviation [s] of the journal's times, such as `ClockMap.error`; constant
            within 10 s and independent beyond.

    Returns:
        The alignment.

    Raises:
        InputError: the loads hardly vary, do not agree, or agree at more than one offset.
    """
    journal = _series("journal", journal_time, journal_force)
    log = _series("log", log_time, log_force)
    lag = _best_lag(journal, log, near)
    # Smooth loads find the rate from a lag that is known to half a second.
    first = _refined(_smoothed(*journal), _smoothed(*log), lag, 0.0, float(log[0].mean()), 0.0)
    if abs(first.rate) > MAX_RATE:
        raise InputError(
            f"the clock rates must agree within {MAX_RATE * 1e6:.0f} ppm, got {first.rate * 1e6:.0f} ppm: "
            "check that journal and log are from the same test"
        )
    return _refined(journal, log, first.offset, first.rate, first.reference, time_error)


def _series(name: str, time: np.ndarray, force: np.ndarray) -> Series:
    if np.shape(time) != np.shape(force) or np.size(time) < _FEWEST:
        raise InputError(
            f"time and force of the {name} must have equal lengths and at least {_FEWEST} readings, got "
            f"shapes {np.shape(time)} and {np.shape(force)}"
        )
    return np.asarray(time, float), np.asarray(force, float)


def _best_lag(journal: Series, log: Series, near: tuple[float, float] | None) -> float:
    """Return the lag [s] of the log, to half a second, from the normalised correlation."""
    correlation, lags, share = _correlation(journal, log)
    if near is not None:
        correlation = np.where(np.abs(lags - near[0]) <= near[1], correlation, -1.0)
    # Explained variance of the shorter record: a mere part of a record may fit anywhere.
    explained = correlation * np.abs(correlation) * share
    k = int(np.argmax(explained))
    if not correlation[k] >= _LEAST_AGREEMENT:
        raise InputError(
            f"the loads in journal and log do not match: their best correlation must be at least "
            f"{_LEAST_AGREEMENT}, got {correlation[k]:.2f}. Check that journal and log are from the same "
            "test, and that their forces have the same sign"
        )
    peak = explained[1:-1] >= np.maximum(explained[:-2], explained[2:])
    peaks = 1 + np.flatnonzero(peak & (np.abs(lags[1:-1] - lags[k]) > 10 * _COARSE))
    left = 1 - correlation**2
    rivals = peaks[(left[peaks] < 3 * left[k] + 1e-4) & (explained[peaks] > 0.8 * explained[k])]
    if rivals.size:
        raise InputError(
            f"the loads agree at more than one offset, such as {lags[k]:.1f} s and "
            f"{lags[rivals[0]]:.1f} s: equal strokes cannot be distinguished. Pass near=(approximate "
            "offset, its largest error), in s"
        )
    return float(lags[k])


def _smoothed(time: np.ndarray, force: np.ndarray) -> Series:
    """Return the means over 400 parts of a record, smoothed over seven parts."""
    centre, mean, _ = _sampled(time, force, float(time[-1] - time[0]) / 400)
    window = np.hanning(9)[1:-1] / np.hanning(9).sum()
    return centre, np.convolve(np.pad(mean, 3, mode="edge"), window, mode="valid")


def _correlation(journal: Series, log: Series) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the correlation at lags half a second apart, the lags [s], and the variance in the overlap.

    The correlation is -1 if the load is constant in the overlap, or if the overlap is less than half the
    shorter record. The variance is that of the shorter record, relative to its largest value.
    """
    from scipy.signal import correlate  # noqa: PLC0415 -- 0.2 s

    grid_a, a, wa = _sampled(*journal, _COARSE)
    grid_b, b, wb = _sampled(*log, _COARSE)
    least = _LEAST_OVERLAP * min(wa.sum(), wb.sum())
    a, b = a * wa, b * wb
    n, sa, sb, saa, sbb, sab = (
        correlate(x, y, method="fft")
        for x, y in ((wa, wb), (a, wb), (wa, b), (a * a, wb), (wa, b * b), (a, b))
    )
    safe = np.maximum(n, 1.0)
    va, vb = saa - sa**2 / safe, sbb - sb**2 / safe
    valid = (n >= least) & (va > 1e-6 * va.max()) & (vb > 1e-6 * vb.max())
    valid &= min(va.max(), vb.max()) > 0
    spread = np.sqrt(np.where(valid, va * vb, 1.0))
    correlation = np.where(valid, (sab - sa * sb / safe) / spread, -1.0)
    lags = np.arange(1 - b.size, a.size) * _COARSE + grid_a[0] - grid_b[0]
    shorter = va if wa.sum() < wb.sum() else vb
    return correlation, lags, shorter / max(float(shorter.max()), 1e-300)


def _sampled(
    t: np.ndarray, f: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return bin centres, bin means about their average, and 1 for bins with readings, 0 for others."""
    index = np.floor((t - t[0]) / step).astype(int)
    n = np.bincount(index)
    held = n > 0
    time, force = (np.bincount(index, x)[held] / n[held] for x in (t, f))
    centre = t[0] + (np.arange(n.size) + 0.5) * step
    mean = np.interp(centre, time, force)
    return centre, mean - mean[held].mean(), held.astype(float)


def _refined(
    journal: Series, log: Series, offset: float, rate: float, reference: float, time_error: float
) -> Alignment:
    """Determine offset, rate and their errors by Gauss-Newton on F_j - a F_m - b.

    The log is interpolated by a cubic with slopes from central differences. Straight lines would be
    biased at bends, and the few rows during a pressure change determine most of the offset. Readings with
    a large interpolation error have less weight, since a slow log cannot resolve fast changes.
    """
    from scipy.interpolate import CubicHermiteSpline  # noqa: PLC0415 -- 0.2 s

    (tj, fj), (tm, fm) = journal, log
    interval = float(np.median(np.diff(tm)))
    spline = CubicHermiteSpline(tm, fm, np.gradient(fm, tm))
    smooth = np.hanning(9)[1:-1] / np.hanning(9).sum()
    slope = np.gradient(np.convolve(np.pad(fm, 3, mode="edge"), smooth, mode="valid"), tm)
    fourth = np.convolve(np.pad(fm, 2, mode="edge"), [1, -4, 6, -4, 1], mode="valid")
    wrong = _CUBIC * np.abs(fourth)

    def linearised(offset: float, rate: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the log times of the readings, the weighted residuals, and their derivatives."""
        at = (tj - offset + rate * reference) / (1 + rate)
        right = np.clip(np.searchsorted(tm, at), 1, tm.size - 1)
        bridged = tm[right] - tm[right - 1] <= _BRIDGE * interval
        use = (at >= tm[0]) & (at <= tm[-1]) & bridged
        if use.sum() < _FEWEST:
            raise InputError("journal and log must overlap in time to be aligned by load")
        at, y, right = at[use], fj[use], right[use]
        x, v = spline(at), np.interp(at, tm, slope)
        gain, zero = np.polyfit(x, y, 1)
        scatter = 1.5 * float(np.median(np.abs(y - gain * x - zero))) + 1e-9 * float(np.ptp(y))
        astray = np.maximum(wrong[right], wrong[right - 1])
        weight = 1 / np.hypot(1.0, gain * astray / scatter)
        gain, zero = np.polyfit(x, y, 1, w=weight)
        J = np.column_stack([-gain * v, -gain * v * (at - reference), x, np.ones_like(x)])
        return at, weight * (y - gain * x - zero), weight[:, None] * J

    done = 0
    while True:
        at, left, J = linearised(offset, rate)
        scale = np.sqrt((J**2).sum(axis=0))
        if scale[0] == 0:
            raise InputError(
                "the load must vary so that clocks can be aligned by it, but it is constant"
            )
        step = np.linalg.lstsq(J / scale, left, rcond=None)[0] / scale
        step *= 1.0 if done < _STEPS // 3 else 0.5  # damp oscillations
        offset, rate = offset + float(step[0]), rate + float(step[1])
        done += 1
        if abs(step[0]) < _SETTLED * interval or done == _STEPS:
            break
    inverse = np.linalg.pinv((J / scale).T @ (J / scale))
    scores = _covariance_of_scores(left, J / scale)
    # A time error acts like an offset, which is the first column.
    edges = np.flatnonzero(np.diff(at // _WINDOW)) + 1
    each = np.add.reduceat(J / scale * J[:, :1], np.concatenate([[0], edges]))
    scores += time_error**2 * each.T @ each
    errors = np.sqrt(np.diag(inverse @ scores @ inverse)) / scale
    # The offset may oscillate between two rows of a slow log, by less than its standard error.
    if not abs(step[0]) < max(_SETTLED * interval, _TO_AND_FRO * errors[0]):
        raise InputError(
            f"the load alignment did not converge: after {_STEPS} steps, the offset was still shifting by "
            f"{abs(step[0]):.2g} s. Check that both channels record the same load"
        )
    return Alignment(offset, rate, reference, float(errors[0]), float(errors[1]))


def _covariance_of_scores(left: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Return the covariance of J^T e for errors e with the autocorrelation of the residuals, shape (4, 4).

    S = sum over lags k of w_k g_k sum over i of J_i J_{i+k}^T, where g is the autocovariance of all
    residuals and w is a triangle that vanishes at a lag of `_CORRELATED` of the record. A sandwich
    covariance, J^T e e^T J over parts of the record, would be too small: the few pressure changes that
    determine the offset dominate the fit, so their residuals are smaller than their errors.

    References:
        Newey & West 1987, Econometrica 55: the weights of the lags.
    """
    from scipy.signal import correlate, fftconvolve  # noqa: PLC0415 -- 0.2 s

    n = left.size
    lags = max(1, round(_CORRELATED * n))
    covariance = correlate(left, left, method="fft")[n - 1 : n - 1 + lags] / n
    weight = covariance * (1 - np.arange(lags) / lags)
    kernel = np.concatenate([weight[:0:-1], weight])
    return np.asarray(J.T @ fftconvolve(J, kernel[:, None], mode="same", axes=0))

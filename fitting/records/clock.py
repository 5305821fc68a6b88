"""Clocks of one test: device ticks to host time, and a machine's clock to the journal's."""

import dataclasses
import itertools

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

Series = tuple[np.ndarray, np.ndarray]
"""Times [s] and forces [N] of a record."""
MAX_RATE = 0.01
"""Largest relative rate of two clocks that is believed: ten seconds in a quarter of an hour."""

_PASSES = 3
_WINDOW = 10.0  # s, within which the host's map of a device's clock has one error
_COARSE, _FINE = 0.5, 0.05  # s, grids of the correlations
_LEAST_AGREEMENT = 0.9  # correlation below which two loads are not of the same test
_LEAST_OVERLAP = 0.5  # of the shorter record
_WINDOWS, _REACH = 10, 30.0  # windows of the local lags, and how far each may lie from the best [s]
_CORRELATED = 0.05  # of the readings: the longest lag at which residuals may be correlated
_CUBIC = 3 / 128  # of a fourth difference: the error of a cubic half-way between two of four rows
_STEPS = 30  # of Gauss-Newton, at most
_SETTLED = 1e-4  # of the log's interval: a smaller step of the offset is the last
_TO_AND_FRO = 0.2  # of the offset's standard error
_BRIDGE = 5  # usual intervals over which a recording is interpolated; a longer gap is left out
_FEWEST = 50  # readings of a load that two clocks are aligned by


@dataclasses.dataclass(frozen=True)
class ClockMap:
    """Host time of device time, neglecting the shortest latency and what drifts within a window.

    host = offset + rate device + s(device), with s piecewise linear: the crystal's wobble.

    Attributes:
        offset: host time [s] of device time zero on the line.
        rate: host seconds in a second of the device.
        knots: device times [s] at which s is known, shape (n,), increasing.
        residuals: s there [s], shape (n,). Beyond the ends s keeps its last value.
        error: standard deviation [s] of s between the knots, from leaving each one out.
    """

    offset: float
    rate: float
    knots: np.ndarray
    residuals: np.ndarray
    error: float

    def host(self, device: ArrayLike | float) -> np.ndarray:
        """Host time [s] of device times [s], any shape."""
        t = np.asarray(device, dtype=np.float64)
        return np.asarray(self.offset + self.rate * t + np.interp(t, self.knots, self.residuals))


def fit_clock(device: ArrayLike, host: ArrayLike, *, window: float = _WINDOW) -> ClockMap:
    """The map from device to host time as the lower envelope of arrivals, neglecting early ones.

    A record never arrives before it is made, so in every window the arrival that is earliest
    against the device's clock has the shortest latency. The line is the mean drift; what is left of
    the earliest arrivals is interpolated, which follows a wobbling resonator.

    Args:
        device: device times [s] of records, shape (n,), n >= 2, any order.
        host: their times of arrival [s], shape (n,).
        window: length [s] of a window; a wobble slower than four windows is followed.

    Returns:
        The map; it puts a record's host time at its creation plus the shortest latency.

    Raises:
        InputError: fewer than two distinct device times, shapes that differ, or values that are not
            finite.

    References:
        Moon, Skelly & Towsley 1999, INFOCOM: clock skew from the lower envelope of delays.

    >>> t = np.arange(0.0, 60.0, 0.01)
    >>> clock = fit_clock(t, 5.0 + 1.002 * t + 0.004 * (np.arange(t.size) % 7))
    >>> round(float(clock.host(30.0)), 6), round(clock.rate, 6)
    (35.06, 1.002)
    """
    t, arrival = np.asarray(device, np.float64), np.asarray(host, np.float64)
    if t.ndim != 1 or t.shape != arrival.shape:
        raise InputError(
            f"device and host times must have one shape (n,), got {t.shape} and {arrival.shape}"
        )
    if not (np.isfinite(t).all() and np.isfinite(arrival).all()):
        raise InputError("device and host times must be finite; leave out records with no time")
    if t.size < 2 or np.ptp(t) == 0:
        raise InputError("a clock needs records of two device times at least; record for longer")
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
    for _ in range(_PASSES):  # the trend within a window shifts its earliest arrival
        first = _earliest(cell, late - trend)
        knots, residuals = t[first], late[first]
        trend = np.interp(t, knots, residuals)
    error = np.inf
    if knots.size > 2:  # each knot against the line through its neighbours
        guess = residuals[:-2] + np.diff(knots)[:-1] / (knots[2:] - knots[:-2]) * (
            residuals[2:] - residuals[:-2]
        )
        error = float(np.sqrt(np.mean((residuals[1:-1] - guess) ** 2) / 1.5))
    if knots.size > 1:  # the outer segments' lines go on to the ends of the record
        slopes = np.diff(residuals) / np.diff(knots)
        before = residuals[0] + slopes[0] * (t[0] - knots[0])
        after = residuals[-1] + slopes[-1] * (t[-1] - knots[-1])
        inner = (knots > t[0]) & (knots < t[-1])
        knots = np.concatenate([t[:1], knots[inner], t[-1:]])
        residuals = np.concatenate([[before], residuals[inner], [after]])
    return ClockMap(offset, rate, knots, residuals, error)


def _envelope_rate(t: np.ndarray, arrival: np.ndarray) -> float:
    """Slope of the line under all arrivals that passes closest to them."""
    late = arrival - t
    hull: list[int] = []
    cell = np.floor((t - t[0]) / np.ptp(t) * 256).astype(np.int64)
    for c in _earliest(cell, late).tolist():
        while len(hull) > 1:
            a, b = hull[-2:]
            if (late[b] - late[a]) * (t[c] - t[a]) < (late[c] - late[a]) * (t[b] - t[a]):
                break  # b lies below the line from a to c
            hull.pop()
        hull.append(c)
    middle = (t[0] + t[-1]) / 2
    after = next((k for k in range(1, len(hull)) if t[hull[k]] >= middle), len(hull) - 1)
    a, b = hull[max(after - 1, 0)], hull[after]
    return 1.0 if a == b else 1.0 + float((late[b] - late[a]) / (t[b] - t[a]))


def _earliest(cell: np.ndarray, late: np.ndarray) -> np.ndarray:
    """Index of the smallest lateness in each cell, in the order of the cells."""
    order = np.lexsort((late, cell))
    return order[np.flatnonzero(np.diff(cell[order], prepend=-1))]


@dataclasses.dataclass(frozen=True)
class Alignment:
    """How a machine's clock reads against the journal's.

    t_journal = t + offset + rate (t - reference),  t the machine's time

    Attributes:
        offset: [s], at the reference.
        rate: by which the journal's clock gains on the machine's [-].
        reference: the machine's time [s] at which the offset is best known.
        offset_error: standard error [s].
        rate_error: standard error [-]; infinite where one pulse is all there was.
        residual: root mean square of what is left: [N] by load, [s] by pulses.
        n: readings, or edges of pulses, that were used.
        method: "load" or "pulses".
    """

    offset: float
    rate: float
    reference: float
    offset_error: float
    rate_error: float
    residual: float
    n: int
    method: str

    def __str__(self) -> str:
        rate = f"{self.rate * 1e6:.1f}"
        if np.isfinite(self.rate_error):
            rate += f" +- {self.rate_error * 1e6:.1f}"
        return (
            f"clocks aligned by {self.method}: journal = log {self.offset:+.4f} s +- "
            f"{self.offset_error * 1e3:.2g} ms, rate {rate} ppm"
        )

    def journal_time(self, time: ArrayLike | float) -> np.ndarray:
        """The journal's time [s] of the machine's times [s], any shape."""
        machine = np.asarray(time, float)
        return np.asarray(machine + self.offset + self.rate * (machine - self.reference))

    def error(self, time: ArrayLike | float) -> np.ndarray:
        """Standard error [s] of `journal_time`, of the shape of the machine's times [s]."""
        away = np.abs(np.asarray(time, float) - self.reference)
        with np.errstate(invalid="ignore"):
            drift = np.where(away > 0, self.rate_error * away, 0.0)
        return np.asarray(np.hypot(self.offset_error, drift))


def align_by_pulses(
    journal_pulses: np.ndarray, log_pulses: np.ndarray, *, resolution: float = 0.01
) -> Alignment:
    """The alignment under which pulses that both have recorded coincide.

    Either list may lack pulses or have some of its own. One pulse gives an offset and no rate.

    Args:
        journal_pulses: times of the edges [s], rising, shape (n,).
        log_pulses: times of the edges on the machine's clock [s], rising, shape (m,).
        resolution: standard deviation of the time of an edge [s]: half a log's interval or so.

    Returns:
        The alignment.

    Raises:
        InputError: a list is empty, or the pulses match in more than one way, or hardly at all.
    """
    journal, log = np.asarray(journal_pulses, float), np.asarray(log_pulses, float)
    if not (journal.size and log.size):
        raise InputError(
            f"no pulses to match: {journal.size} in the journal, {log.size} in the log"
        )
    for name, times in (("journal", journal), ("log", log)):
        if times.ndim != 1 or not np.all(np.isfinite(times)) or np.any(np.diff(times) <= 0):
            raise InputError(f"the pulses of the {name} must be finite and rise, got {times}")
    i, j = _matched(journal, log, resolution)
    n, reference = len(i), float(log[j].mean())
    away, lags = log[j] - reference, journal[i] - log[j]
    offset = float(lags.mean())
    if n == 1:
        return Alignment(offset, 0.0, reference, resolution, np.inf, 0.0, 1, "pulses")
    square = float(away @ away)
    rate = float(away @ lags) / square
    left = lags - offset - rate * away
    spread = np.sqrt(left @ left / (n - 2)) if n > 2 else 0.0
    spread = max(float(spread), resolution)  # a chance agreement of few pulses is no precision
    errors = spread / n**0.5, spread / square**0.5
    residual = float(np.sqrt(left @ left / n))
    return Alignment(offset, rate, reference, *errors, residual, n, "pulses")


def _matched(
    journal: np.ndarray, log: np.ndarray, resolution: float
) -> tuple[np.ndarray, np.ndarray]:
    """Indices in journal and log of the pairs of the one hypothesis under which most pulses coincide."""
    found: set[tuple[tuple[int, int], ...]] = set()
    for i, j in np.ndindex(journal.size, log.size):
        at = journal[i] + log - log[j]
        nearest = np.abs(journal[:, None] - at).argmin(axis=0)
        within = 4 * resolution + MAX_RATE * np.abs(log - log[j])
        near = np.flatnonzero(np.abs(journal[nearest] - at) <= within)
        if np.unique(nearest[near]).size == near.size:
            found.add(tuple(zip(nearest[near].tolist(), near.tolist(), strict=True)))
    most = max(map(len, found), default=0)
    best = [pairs for pairs in found if len(pairs) == most]
    if most < min(journal.size, log.size) / 2 or len(best) != 1:
        raise InputError(
            f"{journal.size} pulses of the journal and {log.size} of the log match in {len(best)} "
            f"ways, with {most} pairs: vary the time between pulses, or align by load"
        )
    i, j = np.array(best[0]).T
    return i, j


def align_by_load(
    journal_time: np.ndarray,
    journal_force: np.ndarray,
    log_time: np.ndarray,
    log_force: np.ndarray,
    *,
    near: tuple[float, float] | None = None,
    time_error: float = 0.0,
) -> Alignment:
    """The alignment under which the two load channels agree, gain and zero of either being free.

    Least squares of F_journal(t) - a F_log(t) - b over offset, rate, a and b, from the offset of the
    best correlation. The standard errors hold for residuals that are correlated within a twentieth of
    the record, and that as much where the load changes as elsewhere. Neglected: a delay of either
    channel, which is an error of the offset.

    Args:
        journal_time: [s], rising, shape (n,).
        journal_force: [N], shape (n,).
        log_time: of the machine's clock [s], rising, shape (m,).
        log_force: [N], shape (m,), of the journal's sign.
        near: offset [s] and how far it may be off [s], where it is known roughly.
        time_error: standard deviation [s] of the journal's times, such as `ClockMap.error`; it is one
            error within 10 s and another beyond.

    Returns:
        The alignment.

    Raises:
        InputError: the loads hardly vary, do not agree, or agree at more than one offset.
    """
    journal = _series("journal", journal_time, journal_force)
    log = _series("log", log_time, log_force)
    lag = _best_lag(journal, log, near)
    times, lags = _local_lags(journal, log, lag)
    start = lag, 0.0, float(log[0].mean())
    if times.size >= 2:
        rate, offset = np.polyfit(times - times.mean(), lags, 1)
        start = float(offset), float(rate), float(times.mean())
    if abs(start[1]) > MAX_RATE:
        raise InputError(
            f"the clocks would differ by {start[1] * 1e6:.0f} ppm, more than {MAX_RATE * 1e6:.0f}: "
            "are journal and log of the same test?"
        )
    return _refined(journal, log, *start, time_error)


def _series(name: str, time: np.ndarray, force: np.ndarray) -> Series:
    time, force = np.asarray(time, float), np.asarray(force, float)
    if time.ndim != 1 or time.shape != force.shape or time.size < _FEWEST:
        raise InputError(
            f"time and force of the {name} must be equally long, one-dimensional, and at least "
            f"{_FEWEST} readings, got shapes {time.shape} and {force.shape}"
        )
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(force)) and np.all(np.diff(time) > 0)):
        raise InputError(f"time and force of the {name} must be finite, and time must rise")
    return time, force


def _best_lag(journal: Series, log: Series, near: tuple[float, float] | None) -> float:
    """Lag [s] to add to the log's time, to half a second, by normalised correlation."""
    correlation, lags, share = _correlation(journal, log, _COARSE, _LEAST_OVERLAP)
    if near is not None:
        correlation = np.where(np.abs(lags - near[0]) <= near[1], correlation, -1.0)
    # How much of the shorter record's variance the other explains: part of a record may fit anywhere.
    explained = correlation * np.abs(correlation) * share
    k = int(np.argmax(explained))
    if not correlation[k] >= _LEAST_AGREEMENT:
        raise InputError(
            f"the loads of journal and log do not match anywhere: their best correlation is "
            f"{correlation[k]:.2f}, {_LEAST_AGREEMENT} is needed. Do they come from the same "
            "test, with the same sign?"
        )
    peak = explained[1:-1] >= np.maximum(explained[:-2], explained[2:])
    peaks = 1 + np.flatnonzero(peak & (np.abs(lags[1:-1] - lags[k]) > 10 * _COARSE))
    left = 1 - correlation**2
    rivals = peaks[(left[peaks] < 3 * left[k] + 1e-4) & (explained[peaks] > 0.8 * explained[k])]
    if rivals.size:
        raise InputError(
            f"the loads agree at more than one offset, {lags[k]:.1f} s and {lags[rivals[0]]:.1f} s "
            "among them: equal strokes cannot be told apart. Give near=(offset, within), or pulses"
        )
    return float(lags[k])


def _local_lags(journal: Series, log: Series, lag: float) -> tuple[np.ndarray, np.ndarray]:
    """Times of the log [s] and the lag [s] around each, from windows whose load varies.

    Only those that lie on one line: the median of all slopes between pairs decides.
    """
    (tj, fj), (tm, fm), found = journal, log, []
    reach = min(_REACH, (tm[-1] - tm[0]) / 4)
    for low, high in itertools.pairwise(np.linspace(tm[0], tm[-1], _WINDOWS + 1).tolist()):
        inside = (tm >= low) & (tm <= high)
        around = (tj >= low + lag - reach) & (tj <= high + lag + reach)
        few = min(inside.sum(), around.sum()) < _FEWEST
        if few or np.std(fm[inside]) < 0.2 * float(np.std(fm)):
            continue
        parts = (tj[around], fj[around]), (tm[inside], fm[inside])
        correlation, lags, _ = _correlation(*parts, _FINE, None)
        k = int(np.argmax(correlation))
        if correlation[k] > _LEAST_AGREEMENT and 0 < k < correlation.size - 1:
            y = correlation[k - 1 : k + 2]
            bend = y[0] - 2 * y[1] + y[2]
            shift = 0.5 * (y[0] - y[2]) / bend if bend < 0 else 0.0
            found.append([(low + high) / 2, lags[k] + shift * _FINE])
    times, lags = np.reshape(found, (-1, 2)).T
    if times.size < 3:
        return times, lags
    i, j = np.triu_indices(times.size, 1)
    left = lags - np.median((lags[j] - lags[i]) / (times[j] - times[i])) * times
    left = np.abs(left - np.median(left))
    keep = left <= max(4 * float(np.median(left)), _FINE)
    return times[keep], lags[keep]


def _correlation(
    journal: Series, log: Series, step: float, overlap: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Correlation of the overlap at lags `step` apart, the lags [s], and the variance in the overlap.

    The correlation is -1 where the overlap is shorter than a part of the shorter record (four fifths
    of the log unless given) or does not vary. The variance is that of the shorter record, as part of
    its largest.
    """
    from scipy.signal import correlate  # noqa: PLC0415 -- 0.2 s

    grid_a, a, wa = _sampled(*journal, step)
    grid_b, b, wb = _sampled(*log, step)
    least = 0.8 * wb.sum() if overlap is None else overlap * min(wa.sum(), wb.sum())
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
    lags = np.arange(1 - b.size, a.size) * step + grid_a[0] - grid_b[0]
    shorter = va if wa.sum() < wb.sum() else vb
    return correlation, lags, shorter / max(float(shorter.max()), 1e-300)


def _sampled(
    t: np.ndarray, f: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means in bins of an even grid, less their mean, and 1 where a bin holds readings."""
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
    """Offset, rate and their errors by Gauss-Newton on F_j - a F_m - b.

    Between two rows the log is a cubic through them with the slopes of central differences: a
    straight line lies on one side of every bend, and most of what fixes the offset is in the few
    rows of a change of pressure. A reading counts the less the more the cubic may be wrong there: a
    slow log knows a fast change badly, and its strokes well.
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
        """The log's times of the readings, their weighted residuals, and the derivatives of these."""
        at = (tj - offset + rate * reference) / (1 + rate)
        right = np.clip(np.searchsorted(tm, at), 1, tm.size - 1)
        bridged = tm[right] - tm[right - 1] <= _BRIDGE * interval
        use = (at >= tm[0]) & (at <= tm[-1]) & bridged
        if use.sum() < _FEWEST:
            raise InputError("journal and log hardly overlap in time: no alignment by load")
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
            raise InputError("the load does not change: it cannot align two clocks")
        step = np.linalg.lstsq(J / scale, left, rcond=None)[0] / scale
        step *= 1.0 if done < _STEPS // 3 else 0.5  # where whole steps go to and fro
        offset, rate = offset + float(step[0]), rate + float(step[1])
        done += 1
        if abs(step[0]) < _SETTLED * interval or done == _STEPS:
            break
    inverse = np.linalg.pinv((J / scale).T @ (J / scale))
    scores = _covariance_of_scores(left, J / scale)
    # A later time has the effect of a larger offset, which is the first column.
    edges = np.flatnonzero(np.diff(at // _WINDOW)) + 1
    each = np.add.reduceat(J / scale * J[:, :1], np.concatenate([[0], edges]))
    scores += time_error**2 * each.T @ each
    errors = np.sqrt(np.diag(inverse @ scores @ inverse)) / scale
    # Between two rows of a slow log it may go to and fro, by less than it is known.
    if not abs(step[0]) < max(_SETTLED * interval, _TO_AND_FRO * errors[0]):
        raise InputError(
            f"the load alignment does not converge: after {_STEPS} steps it still shifts by "
            f"{abs(step[0]):.2g} s. Do both channels record the same load?"
        )
    residual = float(np.sqrt(np.mean(left**2)))
    offset_error, rate_error = float(errors[0]), float(errors[1])
    return Alignment(offset, rate, reference, offset_error, rate_error, residual, left.size, "load")


def _covariance_of_scores(left: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Covariance of J^T e for errors e as correlated as the residuals are, shape (4, 4).

    S = sum over lags k of w_k g_k sum over i of J_i J_{i+k}^T, g the autocovariance of all residuals
    and w a triangle to zero at `_CORRELATED` of the record. What fixes the offset are a few changes
    of pressure, to which the fit bends: their own residuals are smaller than the errors there, and
    the covariance of a sandwich, J^T e e^T J of each part of the record, is too small.

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

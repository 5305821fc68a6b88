"""Where two recordings of one load coincide in time: correlation first, then least squares."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError

_COARSE, _FINE = 0.5, 0.05  # s, grids of the correlations
_LEAST_AGREEMENT = 0.9  # correlation below which two loads are not of the same test
_LEAST_OVERLAP = 0.5  # of the shorter record
_WINDOWS, _REACH = 10, 30.0  # windows of the local lags, and how far each may lie from the best [s]
_CORRELATED = 0.05  # of the readings: the longest lag at which residuals may be correlated
_WINDOW = 10.0  # s, within which the journal's clock has one error: that of `fit_clock`
_CUBIC = 3 / 128  # of a fourth difference: the error of a cubic half-way between two of four rows
_STEPS = 30  # of Gauss-Newton, at most
_SETTLED = 1e-4  # of the log's interval: a smaller step of the offset is the last
_TO_AND_FRO = 0.2  # of the offset's standard error
_BRIDGE = 5  # usual intervals over which a recording is interpolated; a longer gap is left out


def best_lag(
    tj: np.ndarray,
    fj: np.ndarray,
    tm: np.ndarray,
    fm: np.ndarray,
    near: tuple[float, float] | None = None,
) -> float:
    """Lag [s] to add to the log's time, to half a second, by normalised correlation.

    Raises:
        InputError: the loads hardly vary, do not agree, or agree at more than one lag.
    """
    grid_j, a, wa = _sampled(tj, fj, _COARSE)
    grid_m, b, wb = _sampled(tm, fm, _COARSE)
    least = _LEAST_OVERLAP * min(wa.sum(), wb.sum())
    correlation, lags, covered_a, covered_b = _correlation(a, wa, b, wb, least)
    lags = lags * _COARSE + grid_j[0] - grid_m[0]
    if near is not None:
        correlation = np.where(np.abs(lags - near[0]) <= near[1], correlation, -1.0)
    # How much of the shorter record's variance the other explains: part of a record may fit anywhere.
    explained = (
        correlation * np.abs(correlation) * (covered_a if wa.sum() < wb.sum() else covered_b)
    )
    k = int(np.argmax(explained))
    if not correlation[k] >= _LEAST_AGREEMENT:
        raise InputError(
            f"the loads of journal and log agree nowhere: their best correlation is "
            f"{correlation[k]:.2f}, {_LEAST_AGREEMENT} is needed. Are they of one test, and of one sign?"
        )
    peak = explained[1:-1] >= np.maximum(explained[:-2], explained[2:])
    peaks = 1 + np.flatnonzero(peak & (np.abs(lags[1:-1] - lags[k]) > 10 * _COARSE))
    left = 1 - correlation**2
    rivals = [
        p for p in peaks if left[p] < 3 * left[k] + 1e-4 and explained[p] > 0.8 * explained[k]
    ]
    if rivals:
        raise InputError(
            f"the loads agree at more than one offset, {lags[k]:.1f} s and {lags[rivals[0]]:.1f} s "
            "among them: equal strokes cannot be told apart. Give near=(offset, within), or pulses"
        )
    return float(lags[k])


def local_lags(
    tj: np.ndarray, fj: np.ndarray, tm: np.ndarray, fm: np.ndarray, lag: float
) -> tuple[np.ndarray, np.ndarray]:
    """Times of the log [s] and the lag [s] around each, from windows whose load varies."""
    edges = np.linspace(tm[0], tm[-1], _WINDOWS + 1)
    times, lags = [], []
    varies = 0.2 * float(np.std(fm))
    reach = min(_REACH, (tm[-1] - tm[0]) / 4)
    for low, high in itertools.pairwise(edges.tolist()):
        inside = (tm >= low) & (tm <= high)
        around = (tj >= low + lag - reach) & (tj <= high + lag + reach)
        if inside.sum() < 50 or around.sum() < 50 or np.std(fm[inside]) < varies:
            continue
        grid_m, b, wb = _sampled(tm[inside], fm[inside], _FINE)
        grid_j, a, wa = _sampled(tj[around], fj[around], _FINE)
        correlation, steps, _, _ = _correlation(a, wa, b, wb, 0.8 * wb.sum())
        k = int(np.argmax(correlation))
        if correlation[k] > _LEAST_AGREEMENT and 0 < k < correlation.size - 1:
            y = correlation[k - 1 : k + 2]
            bend = y[0] - 2 * y[1] + y[2]
            shift = 0.5 * (y[0] - y[2]) / bend if bend < 0 else 0.0
            times.append((low + high) / 2)
            lags.append((steps[k] + shift) * _FINE + grid_j[0] - grid_m[0])
    return _consistent(np.array(times), np.array(lags))


def refine(
    tj: np.ndarray,
    fj: np.ndarray,
    tm: np.ndarray,
    fm: np.ndarray,
    offset: float,
    rate: float,
    reference: float,
    time_error: float = 0.0,
) -> dict[str, Any]:
    """Offset, rate and their errors by Gauss-Newton on F_j - a F_m - b; see `Alignment`.

    Between two rows the log is a cubic through them with the slopes of central differences: a
    straight line lies on one side of every bend, and most of what fixes the offset is in the few
    rows of a change of pressure. A reading counts the less the more the cubic may be wrong there: a
    slow log knows a fast change badly, and its strokes well.

    Raises:
        InputError: the records hardly overlap, or the steps do not end.
    """
    from scipy.interpolate import CubicHermiteSpline  # noqa: PLC0415 -- 0.2 s

    interval = float(np.median(np.diff(tm)))
    log = CubicHermiteSpline(tm, fm, np.gradient(fm, tm))
    slope = np.gradient(_smooth(fm), tm)
    fourth = np.convolve(np.pad(fm, 2, mode="edge"), [1, -4, 6, -4, 1], mode="valid")
    wrong = _CUBIC * np.abs(fourth)
    step, done = np.zeros(4), 0
    while True:
        at, left, J = _linearised(tj, fj, tm, log, slope, wrong, offset, rate, reference)
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
    scores += time_error**2 * _scores_of_time(at, J, scale)
    covariance = inverse @ scores @ inverse / np.outer(scale, scale)
    # Between two rows of a slow log it may go to and fro, by less than it is known.
    if not abs(step[0]) < max(_SETTLED * interval, _TO_AND_FRO * np.sqrt(covariance[0, 0])):
        raise InputError(
            f"the alignment by load does not settle: after {_STEPS} steps it still moves by "
            f"{abs(step[0]):.2g} s. Do both channels record the same load?"
        )
    return {
        "offset": offset,
        "rate": rate,
        "reference": reference,
        "offset_error": float(np.sqrt(covariance[0, 0])),
        "rate_error": float(np.sqrt(covariance[1, 1])),
        "residual": float(np.sqrt(np.mean(left**2))),
        "n": int(left.size),
    }


def _covariance_of_scores(left: np.ndarray, J: np.ndarray) -> np.ndarray:
    """Covariance of J^T e for errors e as correlated as the residuals are, shape (4, 4).

    S = sum over lags k of w_k g_k sum over i of J_i J_{i+k}^T, g the autocovariance of all residuals
    and w a triangle to zero at `_CORRELATED` of the record. What fixes the offset are a few changes
    of pressure, to which the fit bends: their own residuals are smaller than the errors there, and
    the covariance of a sandwich, J^T e e^T J of each part of the record, is too small.

    References:
        Newey & West 1987, Econometrica 55: the weights of the lags.
    """
    n = left.size
    lags = max(1, round(_CORRELATED * n))
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(left, size)) ** 2
    weight = np.fft.irfft(spectrum, size)[:lags] / n * (1 - np.arange(lags) / lags)
    kernel = np.zeros(size)
    kernel[:lags], kernel[size - lags + 1 :] = weight, weight[:0:-1]
    filtered = np.fft.irfft(
        np.fft.rfft(kernel)[:, None] * np.fft.rfft(J, size, axis=0), size, axis=0
    )
    return np.asarray(J.T @ filtered[:n])


def _scores_of_time(at: np.ndarray, J: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Covariance of J^T e where times have an error of 1 s, one within `_WINDOW` and another beyond."""
    edges = np.flatnonzero(np.diff(at // _WINDOW)) + 1
    # A later time has the effect of a larger offset, which is the first column.
    each = np.add.reduceat(J / scale * J[:, :1], np.concatenate([[0], edges]))
    return np.asarray(each.T @ each)


def _linearised(
    tj: np.ndarray,
    fj: np.ndarray,
    tm: np.ndarray,
    log: Callable[[np.ndarray], np.ndarray],
    slope: np.ndarray,
    wrong: np.ndarray,
    offset: float,
    rate: float,
    reference: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, weighted residuals of the best gain and zero, their derivatives by offset, rate and both."""
    at = (tj - offset + rate * reference) / (1 + rate)  # the log's time of the journal's readings
    right = np.clip(np.searchsorted(tm, at), 1, tm.size - 1)
    bridged = tm[right] - tm[right - 1] <= _BRIDGE * np.median(np.diff(tm))
    use = (at >= tm[0]) & (at <= tm[-1]) & bridged
    if use.sum() < 50:
        raise InputError("journal and log hardly overlap in time: no alignment by load")
    at, y = at[use], fj[use]
    x, v = log(at), np.interp(at, tm, slope)
    astray = np.maximum(wrong[right[use]], wrong[right[use] - 1])
    gain, zero = np.polyfit(x, y, 1)
    scatter = 1.5 * float(np.median(np.abs(y - gain * x - zero))) + 1e-9 * float(np.ptp(y))
    weight = 1 / np.hypot(1.0, gain * astray / scatter)
    gain, zero = np.polyfit(x, y, 1, w=weight)
    left = y - gain * x - zero
    J = np.column_stack([-gain * v, -gain * v * (at - reference), x, np.ones_like(x)])
    return at, weight * left, weight[:, None] * J


def _sampled(
    t: np.ndarray, f: np.ndarray, step: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means in bins of an even grid, and 1 where a bin holds readings."""
    index = np.floor((t - t[0]) / step).astype(int)
    n = np.bincount(index)
    total = np.bincount(index, f)
    time = np.bincount(index, t)
    held = n > 0
    centre = t[0] + (np.arange(n.size) + 0.5) * step
    mean = np.interp(centre, time[held] / n[held], total[held] / n[held])
    return centre, mean - mean[held].mean(), held.astype(float)


def _correlation(
    a: np.ndarray, wa: np.ndarray, b: np.ndarray, wb: np.ndarray, least: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Correlation of the overlap at every whole lag of b, and the parts of both variances in it.

    The correlation is -1 where the overlap is too short or does not vary.
    """
    size = 1 << (a.size + b.size - 1).bit_length()

    def sums(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        product = np.fft.irfft(np.fft.rfft(x, size) * np.fft.rfft(y, size).conj(), size)
        return np.concatenate([product[size - b.size + 1 :], product[: a.size]])

    a, b = a * wa, b * wb
    n = sums(wa, wb)
    safe = np.maximum(n, 1.0)
    sa, sb = sums(a, wb), sums(wa, b)
    covariance = sums(a, b) - sa * sb / safe
    va, vb = sums(a * a, wb) - sa**2 / safe, sums(wa, b * b) - sb**2 / safe
    floor = 1e-6 * max(float(va.max()), 1e-300), 1e-6 * max(float(vb.max()), 1e-300)
    valid = (n >= least) & (va > floor[0]) & (vb > floor[1])
    spread = np.sqrt(np.where(valid, va * vb, 1.0))
    correlation = np.where(valid, covariance / spread, -1.0)
    lags = np.arange(-b.size + 1, a.size)
    return correlation, lags, va / va.max(initial=1e-300), vb / vb.max(initial=1e-300)


def _consistent(times: np.ndarray, lags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Those lags that lie on one line: the median of all slopes between pairs decides."""
    if times.size < 3:
        return times, lags
    i, j = np.triu_indices(times.size, 1)
    rate = np.median((lags[j] - lags[i]) / (times[j] - times[i]))
    left = lags - rate * times
    left = np.abs(left - np.median(left))
    keep = left <= max(4 * float(np.median(left)), _FINE)
    return times[keep], lags[keep]


def _smooth(f: np.ndarray) -> np.ndarray:
    kernel = np.hanning(9)[1:-1]
    kernel /= kernel.sum()
    return np.convolve(np.pad(f, 3, mode="edge"), kernel, mode="valid")

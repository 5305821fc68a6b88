"""Device ticks to host time, from the arrival times of records that can only be late."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike, NDArray

from famjax.boundary.errors import InputError

_PASSES = 3


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
    knots: NDArray[np.float64]
    residuals: NDArray[np.float64]
    error: float

    def host(self, device: ArrayLike | float) -> NDArray[np.float64]:
        """Host time [s] of device times [s], any shape."""
        t = np.asarray(device, dtype=np.float64)
        return np.asarray(self.offset + self.rate * t + np.interp(t, self.knots, self.residuals))

    def device(self, host: ArrayLike | float) -> NDArray[np.float64]:
        """Device time [s] of host times [s], any shape; the inverse of `host` to 1e-9 s."""
        t_host = np.asarray(host, dtype=np.float64)
        t = (t_host - self.offset) / self.rate
        for _ in range(4):  # s changes by some 1e-4 of its argument: each pass gains four digits
            t = (t_host - self.offset - np.interp(t, self.knots, self.residuals)) / self.rate
        return np.asarray(t)

    @property
    def drift_ppm(self) -> float:
        """How much the device's clock runs fast [ppm]."""
        return (1 / self.rate - 1) * 1e6


def fit_clock(device: ArrayLike, host: ArrayLike, *, window: float = 10.0) -> ClockMap:
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
    >>> round(float(clock.host(30.0)), 6), round(clock.drift_ppm)
    (35.06, -1996)
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
    windows = max(round((t[-1] - t[0]) / window), 1)
    cell = np.minimum(((t - t[0]) / np.ptp(t) * windows).astype(np.int64), windows - 1)
    rate = _envelope_rate(t, arrival)
    late = arrival - rate * t
    offset = float(late.min())
    late = late - offset
    knots = residuals = np.empty(0)
    trend = np.zeros_like(t)
    for _ in range(_PASSES):  # the trend within a window shifts its earliest arrival
        first = _first_in_cell(cell, late - trend)
        knots, residuals = t[first], late[first]
        trend = np.interp(t, knots, residuals)
    error = _leave_one_out(knots, residuals)
    return ClockMap(offset, rate, *_to_the_ends(knots, residuals, t[0], t[-1]), error)


def _to_the_ends(
    knots: NDArray[np.float64], residuals: NDArray[np.float64], first: float, last: float
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The knots with one more at each end of the record, on the outer segments' lines."""
    if knots.size < 2:
        return knots, residuals
    inner = (knots > first) & (knots < last)
    slopes = np.diff(residuals) / np.diff(knots)
    before = residuals[0] + slopes[0] * (first - knots[0])
    after = residuals[-1] + slopes[-1] * (last - knots[-1])
    return (
        np.concatenate([[first], knots[inner], [last]]),
        np.concatenate([[before], residuals[inner], [after]]),
    )


def _envelope_rate(t: NDArray[np.float64], arrival: NDArray[np.float64]) -> float:
    """Slope of the line under all arrivals that passes closest to them."""
    late = arrival - t
    hull: list[int] = []
    for i in _first_in_cell(np.floor((t - t[0]) / np.ptp(t) * 256).astype(np.int64), late).tolist():
        while len(hull) > 1 and _above(t, late, hull[-2], hull[-1], i):
            hull.pop()
        hull.append(i)
    middle = (t[0] + t[-1]) / 2
    after = next((k for k in range(1, len(hull)) if t[hull[k]] >= middle), len(hull) - 1)
    a, b = hull[max(after - 1, 0)], hull[after]
    return 1.0 if a == b else 1.0 + float((late[b] - late[a]) / (t[b] - t[a]))


def _above(t: NDArray[np.float64], y: NDArray[np.float64], a: int, b: int, c: int) -> bool:
    """Whether point b lies on or above the line from a to c."""
    return bool((y[b] - y[a]) * (t[c] - t[a]) >= (y[c] - y[a]) * (t[b] - t[a]))


def _first_in_cell(cell: NDArray[np.int64], late: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the smallest lateness in each cell, in the order of the cells."""
    order = np.lexsort((late, cell))
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    return order[starts]


def _leave_one_out(knots: NDArray[np.float64], residuals: NDArray[np.float64]) -> float:
    """Root mean square [s] of each knot against the line through its neighbours, over sqrt(3/2)."""
    if knots.size < 3:
        return float("inf")
    share = (knots[1:-1] - knots[:-2]) / (knots[2:] - knots[:-2])
    guess = residuals[:-2] + share * (residuals[2:] - residuals[:-2])
    return float(np.sqrt(np.mean((residuals[1:-1] - guess) ** 2) / 1.5))

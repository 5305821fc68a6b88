"""Branches of a stroke: force over length, where it ends, and the force held before it."""

import numpy as np
from numpy.polynomial import Polynomial

from famjax.boundary.errors import InputError

from .isobaric_record import IsobaricRecord
from .stroke import Stroke

_AT_REST = 1e-3  # of the rest length: nearer than that the muscle is held at it
_SHORTEST_HOLD = 0.5  # s
_MISSING = 5  # usual intervals: rows that are further apart have others missing between them
_BEND = 5  # degree of that polynomial, where there are values enough
_STILL = 2e-5  # of the rest length: within that of the median it does not move


def branch(
    record: IsobaricRecord, rows: slice, at: np.ndarray, width: float, of: str = "force"
) -> np.ndarray:
    """A column on the grid by local straight lines, each through the rows within `width` of its length.

    The lines are those of what a polynomial through all rows leaves: one through a bend would lie
    beside it.
    """
    order = np.argsort(record.length[rows], kind="stable")
    x, y = record.length[rows][order], getattr(record, of)[rows][order]
    bend = bend_of(x, y)
    y = y - bend(x)
    origin = x.mean()
    x = x - origin
    sums = np.cumsum(np.stack([np.ones_like(x), x, x * x, y, x * y]), axis=1)
    sums = np.concatenate([np.zeros((5, 1)), sums], axis=1)
    low = np.searchsorted(x, at - origin - 1.0001 * width)
    high = np.searchsorted(x, at - origin + 1.0001 * width)
    n, sx, sxx, sy, sxy = sums[:, high] - sums[:, low]
    spread = n * sxx - sx * sx
    thin = (n < 3) | (spread <= 0)
    if thin.any():
        raise InputError(
            f"the machine's log has {int(n[thin][0])} rows within {width:.3g} m of the length "
            f"{at[thin][0]:.5g} m: log faster, or take a coarser grid"
        )
    slope = (n * sxy - sx * sy) / spread
    return (sy - slope * sx) / n + slope * (at - origin) + bend(at)


def bend_of(x: np.ndarray, y: np.ndarray) -> Polynomial:
    """The polynomial through a curve, about which its local means and lines are without bias."""
    return Polynomial.fit(x, y, min(_BEND, x.size // 3))


def pressure_variance(
    record: IsobaricRecord, rows: slice, at: np.ndarray, width: float, about: np.ndarray
) -> np.ndarray:
    """Mean square [Pa2] of the pressure about a curve, in the rows within `width` of each length."""
    order = np.argsort(record.length[rows], kind="stable")
    x = record.length[rows][order]
    left = record.pressure[rows][order] - np.interp(x, at[::-1], about[::-1])
    sums = np.concatenate([[0.0], np.cumsum(left**2)])
    low, high = (np.searchsorted(x, at + side * 1.0001 * width) for side in (-1, 1))
    return (sums[high] - sums[low]) / (high - low)


def hole(record: IsobaricRecord, rows: slice, grid: int) -> float:
    """How long [s] rows are missing while the length moves on by more than a step of the grid; or 0."""
    apart, moved = np.diff(record.time[rows]), np.abs(np.diff(record.length[rows]))
    step = float(np.ptp(record.length[rows])) / (grid - 1)
    missing = (apart > _MISSING * np.median(apart)) & (moved > step)
    return float(apart[missing].max(initial=0.0))


def force_at_rest(at: np.ndarray, curve: np.ndarray, rest_length: float, width: float) -> float:
    """Force at the rest length, nan where the strokes begin more than a step of the grid from it."""
    if not abs(at[0] - rest_length) <= width:
        inside = at[-1] <= rest_length <= at[0]
        return float(np.interp(rest_length, at[::-1], curve[::-1])) if inside else float("nan")
    return float(curve[0] + (rest_length - at[0]) * (curve[1] - curve[0]) / (at[1] - at[0]))


def contraction_at_zero(rest_length: float, at: np.ndarray, curve: np.ndarray) -> float:
    """Contraction at which a curve falls to zero, within a step of the grid's end; else nan."""
    fallen = np.flatnonzero(curve <= 0)
    if fallen.size and fallen[0] == 0:
        return float("nan")
    k = int(fallen[0]) if fallen.size else curve.size - 1
    length = at[k] - curve[k] * (at[k] - at[k - 1]) / (curve[k] - curve[k - 1])
    beyond = (at[-1] - length) / abs(at[1] - at[0])
    return float("nan") if beyond > 1.0 else float((rest_length - length) / rest_length)


def held_force(record: IsobaricRecord, first: Stroke) -> np.ndarray:
    """Forces in the second half of the rest before a stroke, two seconds of it at most."""
    stop = first.shortening.start + 1
    length = record.length[:stop]
    near = np.abs(length - record.rest_length) <= _AT_REST * record.rest_length
    same = near & (record.set_pressure[:stop] == first.set_pressure)
    while stop > 0 and not same[stop - 1] and length[stop - 1] >= length[-1]:
        stop -= 1  # the stroke has left the rest length by more than what counts as being there
    others = np.flatnonzero(~same[:stop])
    start = int(others[-1]) + 1 if others.size else 0
    if stop - start < 3:
        return np.empty(0)
    length = length[:stop]
    away = np.abs(length[start:] - np.median(length[start:]))
    still = np.flatnonzero(away <= max(3 * float(np.median(away)), _STILL * record.rest_length))
    rows = slice(start, start + int(still[-1]) + 1)
    time = record.time[rows]
    if time[-1] - time[0] < _SHORTEST_HOLD:
        return np.empty(0)
    return record.force[rows][time >= max(time[-1] - 2.0, (time[0] + time[-1]) / 2)]

"""How far the middle between both edges is from that of a body of revolution."""

import numpy as np

from ..arrays import Array

_QUARTIC = 5  # coefficients of a bow, which half a sine wave has to a hundredth
_CUBIC = 4  # coefficients of the axis: a muscle may be bowed, or hang in an S
_REFITS, _STRAY = 6, 2.0  # fits without what strays, by so many robust standard deviations


def axis_deviation(left: Array, right: Array) -> float:
    """Root mean square of the mid-line about a straight one, over the mean radius.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    middle = (left + right) / 2
    x = np.linspace(-1, 1, middle.size)
    off = middle - np.polynomial.Polynomial.fit(x, middle, 1)(x)
    return float(np.sqrt(np.mean(off**2)) / np.mean((right - left) / 2))


def bow(left: Array, right: Array) -> Array:
    """Deviation of the smooth mid-line from the straight line through its ends [px], shape (n,).

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    x, smooth, fit = _smooth_midline(left, right, _QUARTIC)
    curve = smooth[:, :_QUARTIC] @ fit[:_QUARTIC]
    return curve - np.interp(x, x[[0, -1]], curve[[0, -1]])


def axis_kink(left: Array, right: Array) -> float:
    """Largest deviation of the mid-line from a smooth one, over the mean radius.

    Rendered muscles stay below 0.025; something that covers a sixth of the radius on one side makes
    0.07 or more.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
    """
    off = off_smooth_midline(left, right)
    return float(np.abs(off).max() / np.mean((right - left) / 2))


def off_smooth_midline(
    left: Array, right: Array, n: int = _CUBIC, *, robust: bool = False
) -> Array:
    """Deviation of the mid-line from a smooth one [px], shape (n,).

    An axis bends as a cubic at most, and pairs of one row lie askew on a rolled muscle, which
    moves their middle by roll R R'.

    Args:
        left: column of the left edge in each row [px], shape (n,).
        right: of the right one.
        n: coefficients of the axis, more than those of a cubic where it may be bowed by much.
        robust: rows that stray do not pull the smooth mid-line towards them.
    """
    _, smooth, fit = _smooth_midline(left, right, n)
    middle = (left + right) / 2
    off = middle - smooth @ fit
    for _ in range(_REFITS if robust else 0):
        keep = np.abs(off) <= _STRAY * 1.4826 * np.median(np.abs(off))
        off = middle - smooth @ np.linalg.lstsq(smooth[keep], middle[keep], rcond=None)[0]
    return off


def _smooth_midline(left: Array, right: Array, n: int) -> tuple[Array, Array, Array]:
    """Positions -1 to 1, the columns of a smooth mid-line's model, and their factors."""
    middle, half = (left + right) / 2, (right - left) / 2
    x = np.linspace(-1, 1, middle.size)
    smooth = np.column_stack([np.vander(x, n), half * np.gradient(half)])
    return x, smooth, np.asarray(np.linalg.lstsq(smooth, middle, rcond=None)[0], float)

"""Interpolation that keeps the shape of the points: no overshoot between a hold and the next."""

import numpy as np
from jaxtyping import Float


def monotone_cubic(
    x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"], at: Float[np.ndarray, " k"]
) -> Float[np.ndarray, " k"]:
    """The piecewise cubic through the points that rises and falls only where they do.

    Slopes are the harmonic means of the neighbouring secants, weighted by their widths, and zero
    at an extreme; at the ends that of a parabola, limited so that the shape is kept.

    Args:
        x: strictly increasing, shape (n,), n >= 1.
        y: shape (n,).
        at: shape (k,).

    Returns:
        Values at `at`, shape (k,); nan outside the range of x.

    References:
        Fritsch & Butland 1984, SIAM J. Sci. Stat. Comput. 5; Moler 2004, chapter 3 (pchip).

    >>> monotone_cubic(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 2.0]), np.array([1.0, 2.0]))
    array([2., 2.])
    """
    inside = (at >= x[0]) & (at <= x[-1])
    if x.size == 1:
        return np.where(inside, y[0], np.nan)
    h = np.diff(x)
    secant = np.diff(y) / h
    slope = _slopes(h, secant) if x.size > 2 else np.repeat(secant, 2)
    i = np.clip(np.searchsorted(x, at, side="right") - 1, 0, x.size - 2)
    s, w = at - x[i], h[i]
    quadratic = (3 * secant[i] - 2 * slope[i] - slope[i + 1]) / w
    cubic = (slope[i] + slope[i + 1] - 2 * secant[i]) / w**2
    return np.where(inside, y[i] + s * (slope[i] + s * (quadratic + s * cubic)), np.nan)


def end_slope(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> float:
    """Slope of that cubic at the first point; n >= 2."""
    h = np.diff(x)
    secant = np.diff(y) / h
    return float(_slopes(h, secant)[0] if x.size > 2 else secant[0])


def _slopes(h: Float[np.ndarray, " m"], secant: Float[np.ndarray, " m"]) -> Float[np.ndarray, " n"]:
    before, after = secant[:-1], secant[1:]
    same = before * after > 0
    w1, w2 = 2 * h[1:] + h[:-1], h[1:] + 2 * h[:-1]
    a, b = np.where(same, before, 1.0), np.where(same, after, 1.0)
    inner = np.where(same, (w1 + w2) / (w1 / a + w2 / b), 0.0)
    first = _parabola_slope(h[0], h[1], secant[0], secant[1])
    last = _parabola_slope(h[-1], h[-2], secant[-1], secant[-2])
    return np.concatenate([[first], inner, [last]])


def _parabola_slope(h0: float, h1: float, near: float, far: float) -> float:
    slope = ((2 * h0 + h1) * near - h0 * far) / (h0 + h1)
    if slope * near <= 0:
        return 0.0
    if near * far <= 0 and abs(slope) > 3 * abs(near):
        return 3 * near
    return float(slope)

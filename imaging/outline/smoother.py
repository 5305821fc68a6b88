"""A smooth edge through noisy positions, one for each row, that throws out stray rows."""

import functools

import numpy as np
from scipy.linalg import solveh_banded

from ..arrays import Array, Flags

_THIRD = np.array([-1.0, 3.0, -3.0, 1.0])
_REJECT = 4.0  # robust standard deviations at which a row counts as stray
_PASSES = 3
_ABOUT = 0.5  # octaves on either side
_POWER = 5 * np.pi / 18  # integral of 1 / (1 + x^6)^2 over x > 0


def smooth(position: Array, resolution: float, weight: Array | None = None) -> Array:
    """The curve that minimises sum w (p - q)^2 + lambda sum (third difference of q)^2.

    A wave of length `resolution` passes at half its height, a parabola unchanged; the ends are
    free. 0.3 ms for 2000 rows.

    Args:
        position: p, shape (n,), n >= 4.
        resolution: wavelength of the half response [rows].
        weight: w >= 0, shape (n,); None for ones.

    Returns:
        q, shape (n,).

    References:
        Whittaker 1923; Eilers 2003, Anal. Chem. 75, equation 6.
    """
    # SciPy's smoothing splines penalise the second derivative: a parabola would not pass unchanged.
    w = np.ones_like(position) if weight is None else weight
    band = penalty(position.size) * _strength(resolution)  # a new array
    band[-1] += w
    return solveh_banded(
        band, w * position, overwrite_ab=True, overwrite_b=True, check_finite=False
    )


def smooth_robustly(
    position: Array, resolution: float, weight: Array | None = None
) -> tuple[Array, Flags]:
    """`smooth` without the rows that stand off by more than four robust standard deviations.

    Returns:
        The curve, shape (n,), and the rows that count, shape (n,).
    """
    weight = np.ones(position.size) if weight is None else weight
    usable = weight > 0
    keep = usable
    curve = smooth(position, resolution, weight)
    for _ in range(_PASSES):
        off = position - curve
        kept = off[keep]
        centre = _median(kept)
        spread = 1.4826 * _median(np.abs(kept - centre))
        now = usable & (np.abs(off - centre) <= _REJECT * max(spread, 1e-3))
        if now.sum() < position.size // 2 or np.array_equal(now, keep):
            break
        keep = now
        curve = smooth(position, resolution, keep * weight)
    return curve, keep


def _median(values: Array) -> float:
    """The upper median, thrice as fast as numpy's."""
    half = values.size // 2
    return float(np.partition(values, half)[half])


def variance_of_smooth(n: int, resolution: float) -> Array:
    """Variance of `smooth` at each of n rows for independent errors of unit variance.

    5 pi / 18 * 2 / resolution inside; near the ends, which are free, several times as much. The
    rows of one resolution at each end are exact, what lies between has the value of the inside.
    """
    edge = _end_variance(round(resolution * 1000))
    inside = _POWER * 2 / resolution
    out = np.full(n, inside)
    k = min(edge.size, n // 2)
    out[:k] = edge[:k]
    out[n - k :] = edge[:k][::-1]
    return out


def density_left_over(off: Array, resolution: float) -> float:
    """Variance times rows of the scatter before `smooth`, from what it left over of one picture.

    The mean of the periodogram about the wavelength that passes at half its height, each value
    over the part that was left of it. Shorter waves, a weave's own, say little about what passes.

    Args:
        off: positions less the smooth curve, shape (n,).
        resolution: of the smoothing [rows].
    """
    taper = np.hanning(off.size)
    size = 2 ** int(np.ceil(np.log2(off.size)))
    first, last = (round(size / resolution * 2**octaves) for octaves in (-_ABOUT, _ABOUT))
    wave = np.arange(max(first, 1), max(last, 1) + 1)
    power = np.abs(np.fft.rfft(off * taper, size)[wave]) ** 2 / np.sum(taper**2)
    bent = _strength(resolution) * (2 - 2 * np.cos(2 * np.pi * wave / size)) ** 3
    return float(np.mean(power * (1 + 1 / bent) ** 2))


@functools.lru_cache(maxsize=16)
def _end_variance(thousandths: int) -> Array:
    resolution = thousandths / 1000
    n, k = int(4 * resolution) + 8, int(resolution)
    every = max(1, k // 32)
    at = np.arange(0, k, every)
    unit = np.zeros((n, at.size))
    unit[at, np.arange(at.size)] = 1
    band = penalty(n) * _strength(resolution)
    band[-1] += 1
    response = solveh_banded(band, unit)
    return np.interp(np.arange(k), at, np.sum(response**2, axis=0))


def _strength(resolution: float) -> float:
    return float((2 - 2 * np.cos(2 * np.pi / resolution)) ** -3)


@functools.lru_cache(maxsize=16)
def penalty(n: int) -> Array:
    """The matrix D'D of third differences as the upper band that LAPACK takes, shape (4, n)."""
    band = np.zeros((4, n), order="F")
    for i, a in enumerate(_THIRD):
        for j, b in enumerate(_THIRD[i:], start=i):
            band[3 - (j - i), j : n - 3 + j] += a * b
    band.setflags(write=False)
    return band


def correlated_points(off: Array) -> float:
    """Points over which residuals are correlated, 1 + 2 sum of their autocorrelations while > 0."""
    power = float(off @ off)
    if power == 0:
        return 1.0
    size = 2 ** int(np.ceil(np.log2(2 * off.size)))
    spectrum = np.abs(np.fft.rfft(off, size)) ** 2
    lags = np.fft.irfft(spectrum, size)[1 : off.size // 2] / power
    stop = int(np.argmax(lags <= 0)) if np.any(lags <= 0) else lags.size
    return float(1 + 2 * lags[:stop].sum())

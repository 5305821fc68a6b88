"""Marks on a strip of a ruler: their places to a hundredth of a pixel, their numbers, the fit."""

import dataclasses

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import leastsq

from ..arrays import Array, Flags, Indices

_EDGE_SMOOTHING = (1.0, 1 / 16, 2.0)  # px; pitches; px: least, wanted, most
_FINER = 4  # samples per px: a parabola through the slope's extremum is good to 0.04 of their step
_STRONG = 8  # th strongest edge, which is a mark's: the ruler's own ends are two
_FAINT = 0.3  # of its height, below which an edge is none of a mark
_OFF = 0.2  # pitches by which a mark may be off the model and still be numbered
_REJECT = 4.0  # robust standard deviations
_ROUNDS = 4


@dataclasses.dataclass(frozen=True)
class Numbered:
    """Marks that are numbered and fitted.

    Attributes:
        number: n, whole, shape (m,).
        place: position along the strip [px], shape (m,).
        coefficients: a, b, c of px(n) = (a + b n) / (1 + c n).
        covariance: of them, shape (3, 3).
        residual: root mean square about the fit [px].
    """

    number: Indices
    place: Array
    coefficients: Array
    covariance: Array
    residual: float

    @property
    def pitch(self) -> float:
        """From mark to mark, the mean [px]."""
        return float(np.ptp(self.place) / np.ptp(self.number))

    @property
    def expected(self) -> int:
        """Marks between the first and the last, both included."""
        return int(self.number[-1] - self.number[0]) + 1


def marks_of(profile: Array, pitch: float) -> Array:
    """Middles of the marks along a profile [px], dark on light or light on dark.

    Each mark has two gradient extrema, one of each sign; their midpoint does not depend on blur,
    exposure or tone curve. A mark is the narrower of mark and gap.

    Args:
        profile: brightness, shape (n,).
        pitch: from mark to mark, about [px].

    References:
        Chambers 2021, section 4.2.1, finds hatch marks by their gradient extrema.
    """
    least, wanted, most = _EDGE_SMOOTHING
    sigma = float(np.clip(wanted * pitch, least, most))
    smooth = gaussian_filter1d(profile, sigma, mode="nearest")
    fine = np.arange(0, profile.size - 1 + 1 / (2 * _FINER), 1 / _FINER)
    slope = CubicSpline(np.arange(profile.size), smooth)(fine, 1)
    pitch *= _FINER
    places, _ = min((_pairs(sign * slope, pitch) for sign in (1, -1)), key=lambda pair: pair[1])
    return places / _FINER


def _pairs(slope: Array, pitch: float) -> tuple[Array, float]:
    """Midpoints of each maximum and the minimum that follows it, and their median distance."""
    rise, fall = _extrema(slope), _extrema(-slope)
    if rise.size == 0 or fall.size == 0:
        return np.empty(0), np.inf
    after = np.searchsorted(fall, rise)
    inside = after < fall.size
    width = fall[np.minimum(after, fall.size - 1)] - rise
    good = inside & (width < 0.75 * pitch)
    if not good.any():
        return np.empty(0), np.inf
    return (rise + width / 2)[good], float(np.median(width[good]))


def _extrema(slope: Array) -> Array:
    """Places of the strong maxima, by a parabola through three samples."""
    inner = slope[1:-1]
    peak = np.flatnonzero((inner >= slope[:-2]) & (inner > slope[2:]) & (inner > 0)) + 1
    if peak.size == 0:
        return np.empty(0)
    height = slope[peak]
    strong = height > _FAINT * np.sort(height)[-min(_STRONG, height.size)]
    peak = peak[strong]
    before, at, after = slope[peak - 1], slope[peak], slope[peak + 1]
    return peak + 0.5 * (before - after) / (before - 2 * at + after)


def numbered(places: Array, pitch: float) -> Numbered | None:
    """The largest set of marks that one projective scale explains, or None for fewer than four.

    A plane ruler at any tilt has px(n) = (a + b n) / (1 + c n). Numbers are counted on from mark
    to mark, then taken from the fit, until neither changes.

    Args:
        places: middles of marks, increasing [px], shape (m,).
        pitch: from mark to mark, about [px].
    """
    pitch = _typical_pitch(places, pitch)
    if places.size < 4:
        return None
    number, keep = _counted(places, pitch)
    fit = None
    for _ in range(_ROUNDS):
        if np.unique(number[keep]).size < 4:
            return None
        fit = _projective(number[keep], places[keep])
        a, b, c = fit
        n = (places - a) / (b - c * places)
        number = np.rint(n).astype(np.int64)
        off = places - _place(fit, number)
        spread = 1.4826 * float(np.median(np.abs(off[keep])))
        now = (np.abs(n - number) < _OFF) & (np.abs(off) <= max(_REJECT * spread, 0.05))
        now &= _one_each(number, np.abs(off), now)
        if np.array_equal(now, keep):
            break
        keep = now
    if fit is None or keep.sum() < 4:
        return None
    number, kept = number[keep], places[keep]
    fit = _projective(number, kept)
    off = kept - _place(fit, number)
    jacobian = _jacobian(fit, number)
    variance = float(off @ off) / max(number.size - 3, 1)
    covariance = np.asarray(np.linalg.inv(jacobian.T @ jacobian) * variance, np.float64)
    residual = float(np.sqrt(np.mean(off**2)))
    return Numbered(number, kept, fit, covariance, residual)


def _typical_pitch(places: Array, pitch: float) -> float:
    steps = np.diff(places)
    near = steps[np.abs(steps / pitch - 1) < 0.15]
    return float(np.median(near)) if near.size >= 3 else pitch


def _counted(places: Array, pitch: float) -> tuple[Indices, Flags]:
    """Numbers from mark to mark within the longest run without a step that fits no number."""
    steps = np.diff(places) / pitch
    whole = np.rint(steps)
    good = (np.abs(steps - whole) < 0.15 * np.maximum(whole, 1)) & (whole >= 1)
    number = np.concatenate([[0], np.cumsum(whole)]).astype(np.int64)
    run = np.concatenate([[0], np.cumsum(~good)])
    longest = np.argmax(np.bincount(run))
    return number, run == longest


def _one_each(number: Indices, off: Array, among: Flags) -> Flags:
    """The mark nearest to the model for each number."""
    order = np.lexsort((off, ~among, number))
    nearest = np.zeros(order.size, bool)
    nearest[order[np.unique(number[order], return_index=True)[1]]] = True
    return nearest


def _place(fit: Array, number: Indices) -> Array:
    a, b, c = fit
    return (a + b * number) / (1 + c * number)


def _jacobian(fit: Array, number: Indices) -> Array:
    below = 1 + fit[2] * number
    return np.stack([1 / below, number / below, -_place(fit, number) * number / below], axis=1)


def _projective(number: Indices, place: Array) -> Array:
    slope, start = np.polyfit(number, place, 1)
    size = np.array([1.0, 1.0 / np.ptp(number), 1.0 / (np.ptp(number) * np.ptp(place))])
    best, *_ = leastsq(
        lambda p: _place(p * size, number) - place,
        np.array([start, slope, 0.0]) / size,
        Dfun=lambda p: _jacobian(p * size, number) * size,
        xtol=1e-14,
        ftol=1e-14,
    )
    return np.asarray(best) * size

"""Marks of a ruler: strips that repeat themselves, places to a hundredth of a pixel, numbers."""

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.optimize import leastsq

from .arrays import Array, Flags, Image, Indices, Single

_PITCHES = (5.0, 220.0)  # px between marks
_STRIP = 6  # columns that are averaged in the search
_REGULAR = 0.35  # least autocorrelation one pitch on
_HARMONICS = 0.75  # of the highest autocorrelation, from which a smaller lag is the pitch
_MOST = 12  # strips tried
_BAND = 32  # rows worked on at once, which fit a processor's cache


@dataclasses.dataclass(frozen=True)
class Line:
    """A straight line in a picture and the strip about it that is averaged.

    Attributes:
        origin: u, v of its first sample [px].
        along: unit vector to the next sample, shape (2,).
        samples: number of them, 1 px apart.
        width: of the strip [px].
        pitch: from mark to mark, about [px].
    """

    origin: Array
    along: Array
    samples: int
    width: float
    pitch: float

    @property
    def across(self) -> Array:
        """Unit vector across the line, shape (2,)."""
        return np.array([-self.along[1], self.along[0]])

    def profile(self, light: Single, *, part: float = 0.0) -> Array:
        """Mean across the strip at each sample, shape (samples,).

        Args:
            light: picture, shape (h, w).
            part: -1 and 1 take the strip's halves, 0 the whole.
        """
        n = max(3, round(self.width))
        offset = (np.arange(n) - (n - 1) / 2) * (0.5 if part else 1.0) + part * self.width / 4
        at = np.arange(self.samples)
        u, v = (
            self.origin[i] + at[:, None] * self.along[i] + offset * self.across[i] for i in (0, 1)
        )
        return map_coordinates(light, [v, u], order=1, mode="nearest").mean(axis=1)

    def turned(self, angle: float) -> "Line":
        """The same line turned by a small angle [rad] about its middle."""
        c, s = np.cos(angle), np.sin(angle)
        along = np.array(
            [c * self.along[0] - s * self.along[1], s * self.along[0] + c * self.along[1]]
        )
        middle = self.origin + (self.samples - 1) / 2 * self.along
        return dataclasses.replace(
            self, origin=middle - (self.samples - 1) / 2 * along, along=along
        )


def regular_strips(luma: Image) -> list[Line]:
    """Strips whose brightness repeats itself along the ruler, the most regular first.

    Marks and sides of a ruler are square to each other: the gradients' mean direction modulo a
    quarter turn gives the ruler's, in one of two ways, and both are searched.

    Args:
        luma: picture, shape (h, w).
    """
    angle = square_direction(luma)
    found = []
    for quarter in (0, 1):
        turn = angle + quarter * np.pi / 2
        upright, back = _upright(luma, turn)
        found += [
            (score, _line(back, upright.shape[0], column, width, pitch))
            for score, column, width, pitch in _periodic(upright)
        ]
    found.sort(key=lambda each: -each[0])
    return [line for _, line in found[:_MOST]]


def square_direction(luma: Image) -> float:
    """Direction [rad] of the gradients modulo a quarter turn, in [-pi/4, pi/4]."""
    soft = cv2.GaussianBlur(luma, (0, 0), 1.5)
    gx, gy = (
        np.asarray(cv2.Sobel(soft, cv2.CV_16S, *order), np.int16) for order in ((1, 0), (0, 1))
    )
    least = np.percentile(_power(gx[::4, ::4], gy[::4, ::4]), 90)
    fourth = []
    for top in range(0, luma.shape[0], _BAND):
        du, dv = (slope[top : top + _BAND].astype(np.float32) for slope in (gx, gy))
        power = _power(du, dv)
        strong = power > least
        fourth.append((du[strong] + 1j * dv[strong]) ** 4 / power[strong])
    return float(np.angle(np.sum(np.concatenate(fourth))) / 4)


def _power(gx: NDArray[np.number], gy: NDArray[np.number]) -> Array:
    return gx.astype(float) ** 2 + gy.astype(float) ** 2


def _upright(luma: Image, turn: float) -> tuple[Single, Array]:
    """The picture turned so that the ruler stands, and the matrix from its pixels back (2, 3)."""
    h, w = luma.shape
    c, s = np.cos(turn), np.sin(turn)
    size = (int(abs(w * c) + abs(h * s)) + 1, int(abs(h * c) + abs(w * s)) + 1)
    back = np.array([[c, -s, 0.0], [s, c, 0.0]])
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2])
    back[:, 2] = np.array([(w - 1) / 2, (h - 1) / 2]) - back[:, :2] @ middle
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    upright = cv2.warpAffine(luma, back, size, flags=flags, borderMode=cv2.BORDER_REPLICATE)
    return upright.astype(np.float32), back


def _periodic(upright: Single) -> list[tuple[float, float, float, float]]:
    """Score, middle column, width and pitch of the runs of columns that repeat along the rows."""
    means = cv2.blur(upright, (_STRIP, 1), borderType=cv2.BORDER_REFLECT)
    strips = np.asarray(means)[:, _STRIP // 2 :: _STRIP // 2].T
    slope = np.diff(strips, axis=1)
    slope = slope - slope.mean(axis=1, keepdims=True)
    lags = np.arange(int(_PITCHES[0]), min(int(_PITCHES[1]), slope.shape[1] // 4))
    likeness = _autocorrelation(slope, lags[-1] + 2)
    power = likeness[:, 0]
    part = likeness[:, lags[0] - 1 : lags[-1] + 2] / np.maximum(power, 1e-9)[:, None]
    peak = (part[:, 1:-1] >= part[:, :-2]) & (part[:, 1:-1] > part[:, 2:])
    height = np.where(peak, part[:, 1:-1], 0.0)
    top = height.max(axis=1)
    first = np.argmax(height >= _HARMONICS * top[:, None], axis=1)
    regular = (top > _REGULAR) & (power > 0.05 * power.max())
    return _runs(regular, lags[first], top * np.sqrt(power))


def _autocorrelation(rows: Single, lags: int) -> Single:
    """Of each row with itself at lags 0, 1, ... below `lags`, shape (m, lags)."""
    size = next_fast_len(rows.shape[1] + lags, real=True)
    likeness = np.empty((rows.shape[0], lags), np.float32)
    for first in range(0, rows.shape[0], _BAND):
        spectrum = np.fft.rfft(rows[first : first + _BAND], size, axis=1)
        power = spectrum.real**2 + spectrum.imag**2
        likeness[first : first + _BAND] = np.fft.irfft(power, size, axis=1)[:, :lags]
    return likeness


def _runs(regular: Flags, lag: Indices, score: Array) -> list[tuple[float, float, float, float]]:
    """Neighbouring strips of one pitch, joined."""
    runs: list[list[int]] = []
    for i in np.flatnonzero(regular).tolist():
        start = runs[-1][0] if runs and runs[-1][-1] == i - 1 else None
        if start is not None and abs(lag[i] - lag[start]) <= 1 + 0.03 * lag[start]:
            runs[-1].append(i)
        else:
            runs.append([i])
    half = _STRIP // 2
    return [
        (
            float(score[run].sum()),
            ((run[0] + run[-1]) / 2 + 1) * half,
            max(len(run) * half - 2.0, _STRIP / 2),
            float(np.median(lag[run])),
        )
        for run in runs
    ]


def _line(back: Array, samples: int, column: float, width: float, pitch: float) -> Line:
    origin = back @ np.array([column, 0.0, 1.0])
    return Line(origin, back[:, 1].copy(), samples, width, pitch)


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
        lambda p: _place(p * size, number) - place, np.array([start, slope, 0.0]) / size,
        Dfun=lambda p: _jacobian(p * size, number) * size, xtol=1e-14, ftol=1e-14,
    )  # fmt: skip
    return np.asarray(best) * size

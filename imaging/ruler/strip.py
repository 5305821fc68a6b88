"""Where in a picture a ruler's marks are: the direction along it, and strips with a regular pattern."""

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.fft import next_fast_len
from scipy.ndimage import map_coordinates

from ..arrays import Array, Flags, Image, Indices, Single

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

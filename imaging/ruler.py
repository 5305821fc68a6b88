"""The scale from a photograph of a ruler in place of the muscle."""

import dataclasses
import math
from collections import Counter
from os import PathLike
from typing import NamedTuple

import cv2
import numpy as np
from scipy.fft import next_fast_len
from scipy.interpolate import CubicSpline
from scipy.ndimage import gaussian_filter1d, map_coordinates
from scipy.optimize import curve_fit

from .camera import Array, Camera, Flags, Image, Indices, Scale, Single, Tone
from .errors import AmbiguousRuler, ImagingError, RulerNotFound
from .photograph import named

INCH = 0.0254  # [m]
_PITCHES = (5.0, 220.0)  # px between marks
_STRIP = 6  # columns that are averaged in the search
_REGULAR = 0.35  # least autocorrelation one pitch on
_HARMONICS = 0.75  # of the highest autocorrelation, from which a smaller lag is the pitch
_MOST = 12  # strips tried


@dataclasses.dataclass(frozen=True)
class Line:
    """A straight line in a picture, and the strip around it that is averaged.

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
        along = np.cos(angle) * self.along + np.sin(angle) * self.across
        origin = self.origin + (self.samples - 1) / 2 * (self.along - along)
        return dataclasses.replace(self, origin=origin, along=along)


def regular_strips(luma: Image) -> list[Line]:
    """Strips with periodic brightness along the ruler, the most regular first.

    Marks and sides of a ruler are square to each other: the gradients' mean direction modulo a
    quarter turn gives the ruler's, in one of two ways, and both are searched.

    Args:
        luma: picture, shape (h, w).
    """
    angle, found = square_direction(luma), []
    for turn in (angle, angle + np.pi / 2):
        upright, back = _upright(luma, turn)
        for score, column, width, pitch in _periodic(upright):
            origin = back @ np.array([column, 0.0, 1.0])
            line = Line(origin, back[:, 1].copy(), upright.shape[0], width, pitch)
            found.append((score, line))
    found.sort(key=lambda each: -each[0])
    return [line for _, line in found[:_MOST]]


def square_direction(luma: Image) -> float:
    """Direction [rad] of the gradients modulo a quarter turn, in [-pi/4, pi/4]."""
    soft = cv2.GaussianBlur(luma, (0, 0), 1.5)
    gx, gy = (
        np.asarray(cv2.Sobel(soft, cv2.CV_16S, *order), np.float32) for order in ((1, 0), (0, 1))
    )
    power = gx.astype(float) ** 2 + gy.astype(float) ** 2
    strong = power > np.percentile(power[::4, ::4], 90)
    fourth = (gx[strong] + 1j * gy[strong]) ** 4 / power[strong]
    return float(np.angle(np.sum(fourth)) / 4)


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
    size = next_fast_len(slope.shape[1] + int(lags[-1]) + 2, real=True)
    spectrum = np.fft.rfft(slope, size, axis=1)
    squares = spectrum.real**2 + spectrum.imag**2
    likeness = np.fft.irfft(squares, size, axis=1)[:, : lags[-1] + 2].astype(np.float32)
    power = likeness[:, 0]
    part = likeness[:, lags[0] - 1 : lags[-1] + 2] / np.maximum(power, 1e-9)[:, None]
    peak = (part[:, 1:-1] >= part[:, :-2]) & (part[:, 1:-1] > part[:, 2:])
    height = np.where(peak, part[:, 1:-1], 0.0)
    top = height.max(axis=1)
    first = np.argmax(height >= _HARMONICS * top[:, None], axis=1)
    regular = (top > _REGULAR) & (power > 0.05 * power.max())
    return _runs(regular, lags[first], top * np.sqrt(power))


def _runs(regular: Flags, lag: Indices, score: Array) -> list[tuple[float, float, float, float]]:
    """Neighbouring strips of one pitch, joined."""
    runs: list[list[int]] = []
    for i in np.flatnonzero(regular).tolist():
        start = runs[-1][0] if runs and runs[-1][-1] == i - 1 else None
        if start is not None and abs(lag[i] - lag[start]) <= 1 + 0.03 * lag[start]:
            runs[-1].append(i)
        else:
            runs.append([i])
    half, found = _STRIP // 2, []
    for run in runs:
        middle, width = ((run[0] + run[-1]) / 2 + 1) * half, max(len(run) * half - 2.0, _STRIP / 2)
        found.append((float(score[run].sum()), middle, width, float(np.median(lag[run]))))
    return found


_EDGE_SMOOTHING = (1.0, 1 / 16, 2.0)  # px; pitches; px: least, wanted, most
_FINER = 4  # samples per px: a parabola through the slope's extremum is good to 0.04 of their step
_STRONG = 8  # th strongest edge, which is a mark's: the ruler's own ends are two
_FAINT = 0.3  # of its height, below which an edge is none of a mark
_OFF = 0.2  # pitches by which a mark may be off the model and still be numbered
_REJECT = 4.0  # robust standard deviations
_NUMBERINGS = 4


class Numbered(NamedTuple):
    """Marks with numbers and their fit.

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
        """Mean distance between marks [px]."""
        return float(np.ptp(self.place) / np.ptp(self.number))

    @property
    def expected(self) -> int:
        """Marks between the first and the last, both included."""
        return int(self.number[-1] - self.number[0]) + 1


def marks_of(profile: Array, pitch: float) -> Array:
    """Centres of the marks along a profile [px], dark on light or light on dark.

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
    after = np.append(fall, np.inf)[np.searchsorted(fall, rise)]
    width = after - rise
    good = width < 0.75 * pitch
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
    """The largest set of marks on one projective scale, or None for fewer than four.

    A plane ruler at any tilt has px(n) = (a + b n) / (1 + c n). Numbers are counted on from mark
    to mark, then taken from the fit, until neither changes.

    Args:
        places: middles of marks, increasing [px], shape (m,).
        pitch: from mark to mark, about [px].
    """
    steps = np.diff(places)
    near = steps[np.abs(steps / pitch - 1) < 0.15]
    pitch = float(np.median(near)) if near.size >= 3 else pitch
    if places.size < 4:
        return None
    number, keep = _counted(places, pitch)
    for _ in range(_NUMBERINGS):
        if np.unique(number[keep]).size < 4:
            return None
        a, b, c = fit = _projective(number[keep], places[keep])[0]
        n = (places - a) / (b - c * places)
        number = np.rint(n).astype(np.int64)
        off = places - _place(number, *fit)
        spread = 1.4826 * float(np.median(np.abs(off[keep])))
        now = (np.abs(n - number) < _OFF) & (np.abs(off) <= max(_REJECT * spread, 0.05))
        now &= _one_each(number, np.abs(off), now)
        if np.array_equal(now, keep):
            break
        keep = now
    if keep.sum() < 4:
        return None
    number, kept = number[keep], places[keep]
    fit, covariance = _projective(number, kept)
    residual = float(np.sqrt(np.mean((kept - _place(number, *fit)) ** 2)))
    return Numbered(number, kept, fit, covariance, residual)


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


def _place(number: Indices | Array, a: float, b: float, c: float) -> Array:
    return (a + b * number) / (1 + c * number)


def _projective(number: Indices, place: Array) -> tuple[Array, Array]:
    """Coefficients a, b, c of least squares and their covariance."""
    slope, start = np.polyfit(number, place, 1)
    size = np.array([1.0, 1.0 / np.ptp(number), 1.0 / (np.ptp(number) * np.ptp(place))])

    def slopes(n: Indices, *unknown: float) -> Array:
        c = unknown[2] * size[2]
        at = _place(n, *(np.array(unknown) * size))
        return np.stack([np.ones(n.size), n, -at * n], axis=1) / (1 + c * n)[:, None] * size

    best, covariance = curve_fit(
        lambda n, *unknown: _place(n, *(np.array(unknown) * size)), number, place,
        np.array([start, slope, 0.0]) / size, jac=slopes, xtol=1e-14, ftol=1e-14,
    )  # fmt: skip
    return best * size, covariance * np.outer(size, size)


FEWEST = 8
_ON_MODEL = 0.8  # of the marks between the first and the last
_AT_ALL = 0.5  # of them, from which another scale may not be passed over
_SHARP = 0.05  # pitches; marks that scatter more are none of a ruler
_EXPECTED = 0.25  # relative, by which the scale that is expected may be off
_SAME = 0.03  # relative, by which two pitches, or a multiple of one, may differ
_AS_EXACT = (3.0, 0.1)  # times, px
_STRAND = 3.0  # px, width of the lines along which marks are followed from strip to strip
_KNOWN = (0.003175, 0.0015875, 0.001, 0.0254 / 32, 0.00254, 0.0005, 0.00635)  # m
_ON_MARK = 0.12  # pitches by which a mark may seem to wander between two strips


class Strip(NamedTuple):
    """A strip of a ruler with its marks.

    Attributes:
        line: where it is.
        marks: on it.
    """

    line: Line
    marks: Numbered


def choose_strip(luma: Image, light: Single, pitch: float | None, expected: float | None) -> Strip:
    """The strip with the most marks among those with the expected scale.

    Args:
        luma: picture, shape (h, w).
        light: the same in linear light.
        pitch: of the marks [m]; None is that of any ruler.
        expected: scale [px/m]; None expects that of the finest marks, and no other.

    Raises:
        RulerNotFound: no strip has 8 marks at even distances, or none of the scale expected.
        AmbiguousRuler: no scale is expected, and another edge shows another one.
    """
    lines = regular_strips(luma)
    strips = [strip for line in lines if (strip := read_strip(light, line)) is not None]
    good = [strip for strip in strips if is_ruler(strip.marks)]
    if expected is not None:
        # Of two edges the one of the commoner pitch: eighths of an inch come first.
        alike = (
            [one for one in good if abs(one.marks.pitch / (expected * near) - 1) < _EXPECTED]
            for near in (_KNOWN if pitch is None else (pitch,))
        )
        good = next(filter(None, alike), [])
    if not good:
        raise RulerNotFound(
            f"a ruler must show at least {FEWEST} evenly spaced marks: check that it is in the picture and "
            "in focus, and that pitch and expected scale refer to its finest regular marks",
            strips=len(lines),
        )
    best = max(good, key=lambda strip: (strip.marks.number.size, strip.line.width))
    if expected is None:
        _check_unique(light, best, strips, pitch or _KNOWN[0])
    return best


def read_strip(light: Single, line: Line) -> Strip | None:
    """A strip's marks; None if they cannot be numbered."""
    marks = numbered(marks_of(line.profile(light), line.pitch), line.pitch)
    return None if marks is None else Strip(line, marks)


def is_ruler(marks: Numbered, part: float = _ON_MODEL) -> bool:
    """Whether there are enough marks, this part of those between the first and the last, and sharp."""
    enough = marks.number.size >= max(FEWEST, part * marks.expected)
    return enough and marks.residual <= _SHARP * marks.pitch


def _check_unique(light: Single, best: Strip, strips: list[Strip], pitch: float) -> None:
    """Every other strip must show the same marks, or the longer ones of them.

    Numbers beside every eighth mark repeat themselves as well, but less exactly.
    """
    others = [
        strip
        for strip in strips
        if abs(strip.line.along @ best.line.along) > 0.99 and is_ruler(strip.marks, _AT_ALL)
    ]
    alike = [strip for strip in others if abs(strip.marks.pitch / best.marks.pitch - 1) < _SAME]
    for other in others:
        ratio = max(other.marks.pitch, best.marks.pitch) / min(other.marks.pitch, best.marks.pitch)
        whole = abs(ratio / round(ratio) - 1) < _SAME
        if whole and (
            round(ratio) == 1
            or other.marks.residual > _AS_EXACT[0] * best.marks.residual + _AS_EXACT[1]
            or any(_run_together(light, fine, other) for fine in alike)
        ):
            continue
        raise AmbiguousRuler(
            "the two edges of the ruler differ: state the expected scale (expected_px_per_m, "
            "--expected-px-per-in), or cover one edge",
            pitch_px=best.marks.pitch, other_pitch_px=other.marks.pitch,
            px_per_in=best.marks.pitch / pitch * INCH,
            other_px_per_in=other.marks.pitch / pitch * INCH,
        )  # fmt: skip


def _run_together(light: Single, fine: Strip, coarse: Strip) -> bool:
    """Whether the marks of a strip go on to that of the finer ones: they are its longer marks."""
    across = coarse.line.across
    way = float((fine.line.origin - coarse.line.origin) @ across)
    for part in (0.25, 0.5, 0.75):
        origin = coarse.line.origin + part * way * across
        line = dataclasses.replace(coarse.line, origin=origin, width=_STRAND)
        seen = marks_of(line.profile(light), coarse.line.pitch)
        if seen.size == 0:
            return False
        off = np.abs(coarse.marks.place[:, None] - seen).min(axis=1)
        if np.mean(off < _ON_MARK * coarse.marks.pitch) < 0.5:
            return False
    return True


_PERIODS = (2, 4, 5, 8, 10, 16, 20, 32, 64)
_READINGS = {
    8: (0.125 * INCH,), 16: (0.0625 * INCH,), 32: (INCH / 32,), 64: (INCH / 64,),
    10: (0.001, 0.1 * INCH), 20: (0.0005, 0.05 * INCH),
}  # fmt: skip
"""Pitches [m] of marks that are numbered at every so many: inches in powers of two, centimetres,
inches in tenths and twentieths. Every fourth mark is longer on most rulers, and tells nothing."""

_REACH = 24  # pitches across, within which a ruler has its longest marks and its numbers
_ACROSS = 0.25  # pitches
_SUPPORT = 0.5  # of the lines that the period seen on most has, without which another is chance
_FEWEST = 4  # numbers
_CLEAR = 0.6  # of the ink's variance from mark to mark, that its period explains
_AS_CLEAR = 0.75  # of the clearest period
_INK = 0.15  # of the light on the face


def pitch_of(light: Single, strip: Strip, expected: float | None) -> float:
    """The pitch of a ruler's marks [m] by the number of marks from number to number.

    Args:
        light: linear light of the picture, shape (h, w).
        strip: the marks.
        expected: scale to within a quarter [px/m], which decides between two readings.

    Raises:
        AmbiguousRuler: no numbers or longest marks are seen, or they can be read in two ways.
    """
    period = marks_per_number(light, strip)
    readings = _READINGS.get(period or 0, ())
    if expected is not None:
        near = strip.marks.pitch / expected
        readings = tuple(one for one in readings if abs(one / near - 1) < _EXPECTED)
    if len(readings) == 1:
        return readings[0]
    seen = f"every {period}th mark is numbered" if period else "no numerals were found"
    raise AmbiguousRuler(
        f"{seen}, so the spacing of the marks is ambiguous: state it, as in --pitch 0.125in or 1mm",
        pitch_px=strip.marks.pitch,
    )


def marks_per_number(light: Single, strip: Strip) -> int | None:
    """Marks from number to number, or between the longest marks; None if none are seen.

    Along lines beside the marks the ink about each mark's place is summed. Its period on each line is
    the shortest one that explains nearly all that any explains; the longest of all lines' periods is
    that of the numbers, since all shorter marks repeat themselves more often.
    """
    line, marks = strip.line, strip.marks
    first, last = int(marks.number.min()), int(marks.number.max())
    face = max(float(np.percentile(line.profile(light), 80)), 1e-6)
    away = np.arange(-_REACH, _REACH + _ACROSS, _ACROSS) * line.pitch
    # Three pixels wide, and between pixels: a line of the nearest ones goes up and down an edge that it
    # lies along, in steps as regular as a ruler's numbers.
    at, across = np.arange(line.samples), (away[:, None] + np.arange(-1.0, 2.0)).reshape(-1, 1)
    u, v = (
        (line.origin[i] + at * line.along[i] + across * line.across[i]).astype(np.float32)
        for i in (0, 1)
    )
    seen = cv2.remap(light, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    profiles = np.asarray(seen, float).reshape(away.size, 3, -1).mean(axis=1)
    ink = _ink(profiles, marks.coefficients, first, last) / face
    counts = Counter(period for period in _periods(ink) if period)
    least = max(2, _SUPPORT * max(counts.values(), default=0))
    return max((one for one, n in counts.items() if n >= least), default=None)


def _ink(profiles: Array, fit: Array, first: int, last: int) -> Array:
    """Ink about each mark's place, the mean of what differs from most of its line, (lines, marks)."""
    at = _place(np.arange(first - 0.5, last + 1), *fit)
    edges = np.clip(np.sort(np.rint(at)).astype(int), 0, profiles.shape[1])
    inside = profiles[:, edges[0] : max(edges[-1], edges[0] + 1)]
    differs = np.abs(profiles - np.median(inside, axis=1, keepdims=True))
    total = np.pad(np.cumsum(differs, axis=1), ((0, 0), (1, 0)))
    ink = np.diff(total[:, edges], axis=1) / np.maximum(np.diff(edges), 1)
    return ink if fit[1] > 0 else ink[:, ::-1]


def _periods(ink: Array) -> list[int | None]:
    """The shortest period that explains the ink about the marks of each line; None where none does."""
    most = np.sort(ink, axis=1)[:, -_FEWEST:].min(axis=1, keepdims=True)
    ink = np.minimum(ink, 0.7 * most)  # an 8 is no more than a 1
    known = [n for n in _PERIODS if ink.shape[1] >= _FEWEST * n]
    explained = np.zeros((len(ink), len(known)))
    for k, n in enumerate(known):
        whole = ink[:, : ink.shape[1] // n * n].reshape(len(ink), -1, n)
        mean, size = whole.mean(axis=1, keepdims=True), whole[0].size
        left = np.sum((whole - mean) ** 2, axis=(1, 2)) / max(size - n, 1)
        spread = np.var(whole, axis=(1, 2)) * size / (size - 1)
        seen = (spread > 0) & (np.ptp(mean[:, 0], axis=1) > _INK / 4)
        explained[seen, k] = 1 - left[seen] / spread[seen]
    best = explained.max(axis=1, initial=0.0)
    near = explained >= np.maximum(_AS_CLEAR * best, 1e-300)[:, None]
    return [
        known[int(np.argmax(row))] if clear >= _CLEAR else None
        for row, clear in zip(near, best, strict=True)
    ]


_OF_K1 = 1e-3  # of k1, for a derivative
_ROUNDS = 3
_SEEN = 3.0  # standard errors from which a distortion is undone
_LARGEST = 0.5


def lens_of_marks(strip: Strip, camera: Camera) -> tuple[Camera, float | None]:
    """The camera with the distortion k1 that the marks show, and the standard error of k1.

    Marks at even distances on a plane ruler have px(n) = (a + b n) / (1 + c n) behind a lens that
    does not distort. k1 r^3 is not of that form: Gauss and Newton's steps find the k1 that leaves
    least over. One of less than three standard errors is taken for none.

    Args:
        strip: the marks.
        camera: whose k1 is not known; its scale may be off by some percent.

    Returns:
        The camera; None where the marks are too few, or too close to the optical axis.
    """
    k1, stderr = 0.0, math.inf
    for _ in range(_ROUNDS):
        here, there = (
            _left_over(strip, dataclasses.replace(camera, k1=k1 + step)) for step in (0.0, _OF_K1)
        )
        slope = (there - here) / _OF_K1
        power = float(slope @ slope)
        if here.size < 8 or not power > 0:
            return camera, None
        k1 -= float(slope @ here) / power
        if abs(k1) > _LARGEST:
            return camera, None
        stderr = math.sqrt(float(here @ here) / max(here.size - 4, 1) / power)
    seen = abs(k1) > _SEEN * stderr
    return (dataclasses.replace(camera, k1=k1) if seen else camera), stderr


def _shown(strip: Strip, camera: Camera) -> Array:
    """Places along the strip [px] of the marks behind a lens without distortion."""
    line, centre = strip.line, np.array(camera.centre)
    u, v = (line.origin[i] + strip.marks.place * line.along[i] for i in (0, 1))
    rays = np.stack(camera.rays(u, v), axis=1)
    return (centre + rays * camera.focal_px - line.origin) @ line.along


def _left_over(strip: Strip, camera: Camera) -> Array:
    """What the best projective scale leaves of the marks' places, for this lens [px]."""
    place, n = _shown(strip, camera), strip.marks.number
    x = (n - n.mean()) / max(np.ptp(n), 1)
    # px = (a + b n) / (1 + c n) is linear in a, b, c but for px in the last column.
    model = np.column_stack([np.ones_like(x), x, -x * place])
    fit = np.linalg.lstsq(model, place, rcond=None)[0]
    return (fit[0] + fit[1] * x) / (1 + fit[2] * x) - place


_TURNS = 3
_LEAST_EXACT = 1e-3  # standard error of the scale, relative


def calibrate_ruler(
    image: str | PathLike[str] | Image, *, pitch: float | None = None, distance: float = 1.524,
    centre: tuple[float, float] | None = None, k1: float | None = None, tone: Tone | None = None,
    expected_px_per_m: float | None = None, placement_stderr: float | None = None,
) -> Scale:  # fmt: skip
    """Measure the scale in the mid-plane from a ruler at the height of the optical axis.

    The mark positions follow px(n) = (a + b n) / (1 + c n) exactly for any tilt in depth. The tilt is
    sin(tilt) = d c / (1 + c n0) per metre of ruler, with n0 at the optical axis; the scale there is the
    slope divided by cos(tilt). The picture does not show how far the ruler was in front of or behind the
    muscle's axis: an offset e changes the scale by e / d.

    Args:
        image: path of a picture, or an RGB array, dtype uint8, shape (h, w, 3). The ruler may have any
            orientation, dark or light marks of several lengths, and numerals.
        pitch: spacing of the finest regular marks [m]; None infers it from the number of marks between
            numerals or longest marks.
        distance: distance d from camera to mid-plane [m].
        centre: position (u, v) of the optical axis in the picture [px]; None for the middle.
        k1: radial distortion, see `Camera`; None estimates it from the marks and uses it if it exceeds
            three standard errors.
        tone: the camera's tone curve, by default sRGB; its influence is small.
        expected_px_per_m: approximate scale (within 25 %) [px/m]; selects among marks of different
            spacing, or between the two edges.
        placement_stderr: standard error of the ruler's position in depth [m], included in that of the
            scale. None assumes the ruler in the plane; measurements then issue a warning.

    Returns:
        The scale; `tilt_deg` is positive if the lower or right end is further away.

    Raises:
        RulerNotFound: too few regular marks, too many outliers, or a scale error above 0.1 %.
        AmbiguousRuler: the two edges show different scales and none is expected, or the pitch is
            ambiguous.
        UnreadableImage, DamagedImage: see `read_image`.
        ImagingError: a value outside its range.

    References:
        Chambers 2021, section 4.2.1.
    """
    for name, value in (("pitch", pitch), ("expected_px_per_m", expected_px_per_m)):
        if value is not None and not 0 < value < math.inf:
            raise ImagingError(f"{name} must be finite and > 0, got {value}, in SI")
    if not 0 <= (placement_stderr or 0.0) < math.inf:
        raise ImagingError(f"placement_stderr must be finite and >= 0, got {placement_stderr} m")
    with named(image) as (rgb, _):
        luma = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        table = (tone or Tone.srgb()).table.astype(np.float32)
        light = np.asarray(cv2.LUT(luma, table), np.float32)
        strip = _aligned(light, choose_strip(luma, light, pitch, expected_px_per_m))
        step = pitch or pitch_of(light, strip, expected_px_per_m)
        middle = centre or ((rgb.shape[1] - 1) / 2, (rgb.shape[0] - 1) / 2)
        lens = Camera(strip.marks.pitch / step, distance, middle, k1 or 0.0)
        bent = None
        if k1 is None:
            lens, bent = lens_of_marks(strip, lens)
        straight = numbered(_shown(strip, lens), strip.marks.pitch) if lens.k1 else None
        scale = _scale(
            strip.line, straight or strip.marks, middle, step, distance, placement_stderr or 0.0
        )
        return dataclasses.replace(
            scale, k1=lens.k1, k1_stderr=bent, pitch=step, placement_stderr=placement_stderr
        )


def _aligned(light: Single, strip: Strip) -> Strip:
    """The strip turned until both of its halves show the marks at the same places."""
    line = strip.line
    for _ in range(_TURNS):
        halves = [marks_of(line.profile(light, part=part), line.pitch) for part in (-1.0, 1.0)]
        if min(half.size for half in halves) < FEWEST:
            break
        nearest = np.abs(halves[0][:, None] - halves[1]).argmin(axis=1)
        shift = halves[1][nearest] - halves[0]
        close = np.abs(shift) < 0.3 * line.pitch
        if close.sum() < FEWEST:
            break
        angle = float(np.median(shift[close])) / (line.width / 2)
        line = line.turned(-np.arctan(angle)) if abs(angle) > 1e-5 else line
    again = read_strip(light, line)
    return again if again is not None and is_ruler(again.marks) else Strip(line, strip.marks)


def _scale(
    line: Line, marks: Numbered, centre: tuple[float, float], pitch: float, distance: float,
    placement: float,
) -> Scale:  # fmt: skip
    foot = float((np.asarray(centre) - line.origin) @ line.along)

    def scale_and_tilt(fit: Array) -> tuple[float, float]:
        a, b, c = fit
        n = (foot - a) / (b - c * foot)
        below = 1 + c * n
        sine = float(np.clip(c / below / pitch * distance, -1, 1))
        slope = (b - a * c) / below**2 / pitch
        return slope / math.sqrt(1 - sine**2), math.degrees(math.asin(sine))

    fit = marks.coefficients
    px_per_m, tilt = scale_and_tilt(fit)
    root = np.sqrt(np.diag(marks.covariance))
    ends = [[scale_and_tilt(fit + sign * step)[0] for sign in (1, -1)] for step in np.diag(root)]
    gradient = np.subtract(*np.transpose(ends)) / (2 * root)
    random = math.sqrt(gradient @ marks.covariance @ gradient)
    if not random <= _LEAST_EXACT * px_per_m:
        raise RulerNotFound(
            f"the marks must determine the scale to {_LEAST_EXACT:.1%}; they are too few or scatter "
            "too much: check that the ruler is in focus and its finest marks are at least 5 px apart",
            relative_stderr=random / px_per_m,
        )
    a, b, c = fit
    return Scale(
        px_per_m=px_per_m, stderr=math.hypot(random, px_per_m * placement / distance),
        coefficients=(float(a), float(b / pitch), float(c / pitch)), tilt_deg=tilt,
        residual_px=marks.residual, marks=marks.number.size, source="ruler",
    )  # fmt: skip

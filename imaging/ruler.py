"""Measure the scale from a photograph of a ruler placed where the muscle was."""

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
_STRIP = 6  # columns averaged in the search
_REGULAR = 0.35  # smallest autocorrelation at a lag of one pitch
_HARMONICS = 0.75  # the pitch is the smallest lag with this fraction of the highest autocorrelation
_MOST = 12  # strips tried


@dataclasses.dataclass(frozen=True)
class Line:
    """A straight line in a picture, and the strip around it over which brightness is averaged.

    Attributes:
        origin: u, v of the first sample [px].
        along: unit vector to the next sample, shape (2,).
        samples: number of samples, 1 px apart.
        width: width of the strip [px].
        pitch: approximate spacing of the marks [px].
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
        """Return the mean brightness across the strip at each sample, shape (samples,).

        Args:
            light: picture, shape (h, w).
            part: -1 or 1 for one half of the strip, 0 for the whole strip.
        """
        n = max(3, round(self.width))
        offset = (np.arange(n) - (n - 1) / 2) * (0.5 if part else 1.0) + part * self.width / 4
        at = np.arange(self.samples)
        u, v = (
            self.origin[i] + at[:, None] * self.along[i] + offset * self.across[i] for i in (0, 1)
        )
        return map_coordinates(light, [v, u], order=1, mode="nearest").mean(axis=1)

    def turned(self, angle: float) -> "Line":
        """Return the line rotated by a small angle [rad] about its middle."""
        along = np.cos(angle) * self.along + np.sin(angle) * self.across
        origin = self.origin + (self.samples - 1) / 2 * (self.along - along)
        return dataclasses.replace(self, origin=origin, along=along)


def regular_strips(luma: Image) -> list[Line]:
    """Return strips with periodic brightness along the ruler, the most regular first.

    The marks on a ruler are perpendicular to its sides. The mean gradient direction, modulo a quarter
    turn, therefore leaves two possible directions for the ruler, and both are searched.

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
    """Return the gradient direction [rad] modulo a quarter turn, in [-pi/4, pi/4]."""
    soft = cv2.GaussianBlur(luma, (0, 0), 1.5)
    gx, gy = (
        np.asarray(cv2.Sobel(soft, cv2.CV_16S, *order), np.float32) for order in ((1, 0), (0, 1))
    )
    power = gx.astype(float) ** 2 + gy.astype(float) ** 2
    strong = power > np.percentile(power[::4, ::4], 90)
    fourth = (gx[strong] + 1j * gy[strong]) ** 4 / power[strong]
    return float(np.angle(np.sum(fourth)) / 4)


def _upright(luma: Image, turn: float) -> tuple[Single, Array]:
    """Return the picture rotated so that the ruler is upright, and the inverse matrix, shape (2, 3)."""
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
    """Return score, middle column, width and pitch for runs of columns with periodic brightness."""
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
    """Join neighbouring strips with the same pitch."""
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


_EDGE_SMOOTHING = (1.0, 1 / 16, 2.0)  # smallest [px], preferred [pitches] and largest [px]
_FINER = 4  # samples per px; the parabola through an extremum is accurate to 0.04 of their spacing
_STRONG = (
    8  # rank of the edge that serves as reference; the ends of the ruler make two strong edges
)
_FAINT = 0.3  # edges with less than this fraction of its height are not marks
_OFF = 0.2  # largest deviation from the model at which a mark is numbered [pitches]
_REJECT = 4.0  # robust standard deviations
_NUMBERINGS = 4


class Numbered(NamedTuple):
    """Numbered marks and the scale fitted to them.

    Attributes:
        number: mark numbers n, integers, shape (m,).
        place: positions along the strip [px], shape (m,).
        coefficients: a, b, c of px(n) = (a + b n) / (1 + c n).
        covariance: covariance of the coefficients, shape (3, 3).
        residual: RMS deviation from the fit [px].
    """

    number: Indices
    place: Array
    coefficients: Array
    covariance: Array
    residual: float

    @property
    def pitch(self) -> float:
        """Mean spacing of the marks [px]."""
        return float(np.ptp(self.place) / np.ptp(self.number))


def marks_of(profile: Array, pitch: float) -> Array:
    """Return the centres [px] of the marks along a profile, whether dark on light or light on dark.

    Each mark has two gradient extrema of opposite sign. Their midpoint is independent of blur, exposure
    and tone curve. Marks are assumed to be narrower than gaps.

    Args:
        profile: brightness, shape (n,).
        pitch: approximate spacing of the marks [px].

    References:
        Chambers 2021, section 4.2.1, which finds hatch marks by their gradient extrema.
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
    """Return midpoints between each maximum and the following minimum, and their median distance."""
    rise, fall = _extrema(slope), _extrema(-slope)
    after = np.append(fall, np.inf)[np.searchsorted(fall, rise)]
    width = after - rise
    good = width < 0.75 * pitch
    if not good.any():
        return np.empty(0), np.inf
    return (rise + width / 2)[good], float(np.median(width[good]))


def _extrema(slope: Array) -> Array:
    """Return the positions of strong maxima, refined by a parabola through three samples."""
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
    """Return the largest set of marks that fits one projective scale; None if it has fewer than four marks.

    On a plane ruler at any tilt, the marks lie at px(n) = (a + b n) / (1 + c n). They are first numbered by
    counting from one to the next, then renumbered from the fit until the numbers no longer change.

    Args:
        places: centres of the marks, increasing [px], shape (m,).
        pitch: approximate spacing of the marks [px].
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
    """Number the marks by counting, and select the longest run whose steps are whole pitches."""
    steps = np.diff(places) / pitch
    whole = np.rint(steps)
    good = (np.abs(steps - whole) < 0.15 * np.maximum(whole, 1)) & (whole >= 1)
    number = np.concatenate([[0], np.cumsum(whole)]).astype(np.int64)
    run = np.concatenate([[0], np.cumsum(~good)])
    longest = np.argmax(np.bincount(run))
    return number, run == longest


def _one_each(number: Indices, off: Array, among: Flags) -> Flags:
    """For each number, select the mark nearest to the model."""
    order = np.lexsort((off, ~among, number))
    nearest = np.zeros(order.size, bool)
    nearest[order[np.unique(number[order], return_index=True)[1]]] = True
    return nearest


def _place(number: Indices | Array, a: float, b: float, c: float) -> Array:
    return (a + b * number) / (1 + c * number)


def _projective(number: Indices, place: Array) -> tuple[Array, Array]:
    """Return the least-squares coefficients a, b, c and their covariance."""
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
_ON_MODEL = 0.8  # fraction of the marks between the first and the last that must be found
_AT_ALL = 0.5  # the same for a strip that may contradict the best one
_SHARP = 0.05  # largest scatter of the marks of a ruler [pitches]
_SAME = 0.03  # relative difference at which two pitches, or multiples of one, count as equal
_AS_EXACT = (3.0, 0.1)  # factor and offset [px] of the residual of another scale
_STRAND = 3.0  # width of the lines along which marks are traced between strips [px]
_ON_MARK = 0.12  # largest apparent shift of a mark between two strips [pitches]


class Strip(NamedTuple):
    """A strip of a ruler, and its marks."""

    line: Line
    marks: Numbered


def choose_strip(luma: Image, light: Single) -> Strip:
    """Return the strip with the most marks.

    Args:
        luma: picture, shape (h, w).
        light: the same picture in linear light.

    Raises:
        RulerNotFound: no strip has at least 8 evenly spaced marks.
        AmbiguousRuler: the marks on another edge have a different spacing.
    """
    lines = regular_strips(luma)
    strips = [strip for line in lines if (strip := read_strip(light, line)) is not None]
    good = [strip for strip in strips if is_ruler(strip.marks)]
    if not good:
        raise RulerNotFound(
            f"a ruler must show at least {FEWEST} evenly spaced marks: check that it is in the picture and "
            "in focus",
            strips=len(lines),
        )
    best = max(good, key=lambda strip: (strip.marks.number.size, strip.line.width))
    _check_unique(light, best, strips)
    return best


def read_strip(light: Single, line: Line) -> Strip | None:
    """Return the strip with its marks; None if they cannot be numbered."""
    marks = numbered(marks_of(line.profile(light), line.pitch), line.pitch)
    return None if marks is None else Strip(line, marks)


def is_ruler(marks: Numbered, part: float = _ON_MODEL) -> bool:
    """Return True if there are at least 8 sharp marks, and at least `part` times the number expected."""
    enough = marks.number.size >= max(FEWEST, part * (int(np.ptp(marks.number)) + 1))
    return enough and marks.residual <= _SHARP * marks.pitch


def _check_unique(light: Single, best: Strip, strips: list[Strip]) -> None:
    """Check that every other strip shows the same marks, or only the longer ones among them.

    Numerals next to every eighth mark are also periodic, but less exactly.
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
            "the marks on the two edges of the ruler differ: cover one edge, or state the scale (--scale)",
            pitch_px=best.marks.pitch, other_pitch_px=other.marks.pitch,
        )  # fmt: skip


def _run_together(light: Single, fine: Strip, coarse: Strip) -> bool:
    """Return True if the marks in the coarse strip extend to the fine strip, as longer marks do."""
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
"""Possible pitches [m] for each number of marks per numeral: binary fractions of an inch, millimetres and
half-millimetres, tenths and twentieths of an inch. On most rulers, every fourth mark is longer, so a period
of four does not identify the pitch."""

_REACH = 24  # distance from the marks within which longest marks and numerals are sought [pitches]
_ACROSS = 0.25  # spacing of the lines searched [pitches]
_SUPPORT = 0.5  # smallest number of lines that support a period, relative to the best supported one
_FEWEST = 4  # numerals
_CLEAR = 0.6  # fraction of the ink's variance that a period must explain
_AS_CLEAR = 0.75  # the same relative to the best period
_INK = 0.15  # relative to the light on the ruler's face


def pitch_of(light: Single, strip: Strip) -> float:
    """Return the pitch of a ruler's marks [m], from the number of marks between numerals.

    Args:
        light: linear light of the picture, shape (h, w).
        strip: strip with the marks.

    Raises:
        AmbiguousRuler: neither numerals nor longest marks are visible, or two pitches are possible.
    """
    period = marks_per_number(light, strip)
    readings = _READINGS.get(period or 0, ())
    if len(readings) == 1:
        return readings[0]
    seen = f"one mark in {period} is numbered" if period else "no numerals were found"
    raise AmbiguousRuler(
        f"{seen}, so the spacing of the marks is ambiguous: state it, as in --pitch 0.125in or --pitch 1mm",
        pitch_px=strip.marks.pitch,
    )


def marks_per_number(light: Single, strip: Strip) -> int | None:
    """Return the number of marks between numerals, or the longest marks; None if neither is visible.

    The ink around the position of each mark is summed along lines parallel to the marks' strip. The period
    of a line is the shortest one that explains almost as much variance as the best one. The longest period
    among all lines is that of the numerals, because shorter marks repeat more often.
    """
    line, marks = strip.line, strip.marks
    first, last = int(marks.number.min()), int(marks.number.max())
    face = max(float(np.percentile(line.profile(light), 80)), 1e-6)
    away = np.arange(-_REACH, _REACH + _ACROSS, _ACROSS) * line.pitch
    # Lines are interpolated and 3 px wide: a line of nearest pixels along an edge has steps that are as
    # regular as the numerals.
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
    """Return the ink around each mark: the mean deviation from the line's median, shape (lines, marks)."""
    at = _place(np.arange(first - 0.5, last + 1), *fit)
    edges = np.clip(np.sort(np.rint(at)).astype(int), 0, profiles.shape[1])
    inside = profiles[:, edges[0] : max(edges[-1], edges[0] + 1)]
    differs = np.abs(profiles - np.median(inside, axis=1, keepdims=True))
    total = np.pad(np.cumsum(differs, axis=1), ((0, 0), (1, 0)))
    ink = np.diff(total[:, edges], axis=1) / np.maximum(np.diff(edges), 1)
    return ink if fit[1] > 0 else ink[:, ::-1]


def _periods(ink: Array) -> list[int | None]:
    """Return the shortest period that explains the ink of each line; None if there is none."""
    most = np.sort(ink, axis=1)[:, -_FEWEST:].min(axis=1, keepdims=True)
    ink = np.minimum(ink, 0.7 * most)  # so that an 8 counts no more than a 1
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


_SEEN = 3.0  # standard errors above which a distortion is corrected
_LARGEST = 0.5  # of k1


def lens_of_marks(strip: Strip, camera: Camera) -> tuple[Camera, float | None]:
    """Return the camera with the distortion k1 estimated from the marks, and the standard error of k1.

    Without distortion, evenly spaced marks follow px(n) = (a + b n) / (1 + c n). A term k1 r^3 does not
    have this form, so k1 can be found by least squares. If its magnitude is below three standard errors,
    k1 is set to zero.

    Args:
        strip: strip with the marks.
        camera: camera with unknown k1; its scale may be wrong by a few percent.

    Returns:
        The camera, and the standard error, which is None if the marks are too close to the optical axis.
    """

    def left_over(_: Indices, one_more: float) -> Array:
        return _left_over(strip, dataclasses.replace(camera, k1=float(one_more) - 1))

    n = strip.marks.number  # k1 + 1 is fitted, whose finite differences have a step of 1e-3
    found, variance = curve_fit(left_over, n, np.zeros(n.size), [1.0], epsfcn=1e-6)
    # The projective scale has three more parameters.
    k1, stderr = float(found[0]) - 1, math.sqrt(variance[0, 0] * (n.size - 1) / (n.size - 4))
    if not (math.isfinite(stderr) and abs(k1) <= _LARGEST):
        return camera, None
    return dataclasses.replace(camera, k1=k1 if abs(k1) > _SEEN * stderr else 0.0), stderr


def _shown(strip: Strip, camera: Camera) -> Array:
    """Return the positions of the marks along the strip [px] as seen by a lens without distortion."""
    line, centre = strip.line, np.array(camera.centre)
    u, v = (line.origin[i] + strip.marks.place * line.along[i] for i in (0, 1))
    rays = np.stack(camera.rays(u, v), axis=1)
    return (centre + rays * camera.focal_px - line.origin) @ line.along


def _left_over(strip: Strip, camera: Camera) -> Array:
    """Return the residuals of the best projective scale for this lens [px]."""
    place, n = _shown(strip, camera), strip.marks.number
    x = (n - n.mean()) / max(np.ptp(n), 1)
    # px = (a + b n) / (1 + c n) is linear in a, b, c, except for px in the last column.
    model = np.column_stack([np.ones_like(x), x, -x * place])
    fit = np.linalg.lstsq(model, place, rcond=None)[0]
    return (fit[0] + fit[1] * x) / (1 + fit[2] * x) - place


_TURNS = 3
_LEAST_EXACT = 1e-3  # largest relative standard error of the scale


def calibrate_ruler(
    image: str | PathLike[str] | Image, *, pitch: float | None = None, distance: float = 1.524,
    centre: tuple[float, float] | None = None, k1: float | None = None, tone: Tone | None = None,
    placement_stderr: float | None = None,
) -> Scale:  # fmt: skip
    """Measure the scale in the plane of the muscle's axis from a ruler at the height of the optical axis.

    The mark positions follow px(n) = (a + b n) / (1 + c n) exactly for any tilt in depth. The tilt follows
    from sin(tilt) = d c / (1 + c n0), with n in metres of ruler and n0 at the optical axis; the scale there
    is the slope divided by cos(tilt). The picture does not show how far the ruler was in front of or behind
    the muscle's axis: an offset e causes a relative error of e / d in the scale.

    Args:
        image: path of a picture, or an RGB array, dtype uint8, shape (h, w, 3). The ruler may have any
            orientation, dark or light marks of several lengths, and numerals.
        pitch: spacing of the finest regular marks [m]; if None, it is inferred from the number of marks
            between numerals or between the longest marks.
        distance: distance d from the camera to the plane of the muscle's axis [m].
        centre: position (u, v) of the optical axis in the picture [px]; None for the middle of the picture.
        k1: radial distortion, see `Camera`; if None, it is estimated from the marks and used if it exceeds
            three standard errors.
        tone: the camera's tone curve, by default sRGB; its influence is small.
        placement_stderr: standard error of the ruler's position in depth [m], included in the standard
            error of the scale. If None, the ruler is assumed to lie in the plane of the muscle's axis, and
            measurements include a warning.

    Returns:
        The scale; `tilt_deg` is positive if the lower or right end is further away.

    Raises:
        RulerNotFound: there are too few regular marks or too many outliers, or the standard error of the
            scale exceeds 0.1 %.
        AmbiguousRuler: the two edges have different marks, or the pitch is ambiguous.
        UnreadableImage, DamagedImage: see `read_image`.
        ImagingError: a value is out of range.

    References:
        Chambers 2021, section 4.2.1.
    """
    if pitch is not None and not 0 < pitch < math.inf:
        raise ImagingError(f"pitch must be finite and > 0, got {pitch} m")
    if not 0 <= (placement_stderr or 0.0) < math.inf:
        raise ImagingError(f"placement_stderr must be finite and >= 0, got {placement_stderr} m")
    with named(image) as (rgb, _):
        luma = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        table = (tone or Tone.srgb()).table.astype(np.float32)
        light = np.asarray(cv2.LUT(luma, table), np.float32)
        strip = _aligned(light, choose_strip(luma, light))
        step = pitch or pitch_of(light, strip)
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
    """Return the strip, rotated until both of its halves show the marks at the same positions."""
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
            f"the marks must determine the scale to within {_LEAST_EXACT:.1%}, but they are too few or "
            "scatter too much: check that the ruler is in focus, with its finest marks at least 5 px apart",
            relative_stderr=random / px_per_m,
        )
    return Scale(
        px_per_m=px_per_m, stderr=math.hypot(random, px_per_m * placement / distance), tilt_deg=tilt,
        residual_px=marks.residual, marks=marks.number.size, source="ruler",
    )  # fmt: skip

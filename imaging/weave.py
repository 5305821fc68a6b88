"""The braid angle along a muscle from the spectrum of its unrolled front."""

import dataclasses
import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, map_coordinates

from .camera import Array, Camera, Flags, Image, Silhouette, Single, turned
from .edge import parabola_peak
from .photograph import Photograph

BAND = 1.3
"""Azimuth to which the front is used on either side of the line of sight [rad]."""

_AROUND = 0.25  # of the radius: brightness is taken relative to the mean over so much
_STRONGEST = 0.25  # of that mean: what sparkles or is black counts no more


class Unrolled(NamedTuple):
    """The contrast of a body's surface towards the camera.

    Attributes:
        azimuth: of the columns, from the line of sight to the axis [rad], shape (m,), uniform.
        y: of the rows, as in `Silhouette` [m], shape (n,), uniform.
        arc: length along the meridian from the first row [m], shape (n,).
        radius: R at y [m], shape (n,).
        contrast: brightness over its local mean, less one, shape (n, m).
    """

    azimuth: Array
    y: Array
    arc: Array
    radius: Array
    contrast: Single


def unrolled(rgb: Image, camera: Camera, body: Silhouette, first: float, last: float) -> Unrolled:
    """The front of a body, sampled a pixel apart, without perspective, roll, lens and foreshortening.

    The point at azimuth psi and position y is (x0 + R sin(psi'), y, d - R cos(psi')), with psi'
    from the optical axis and psi from the line of sight to the body's axis.

    Args:
        rgb: picture, shape (h, w, 3).
        camera: the camera.
        body: the body of revolution behind the outline.
        first: position y at which it begins [m].
        last: position y at which it ends [m].
    """
    px = 1 / camera.px_per_m
    y = np.asarray(first + np.arange(int((last - first) / px) + 1) * px, float)
    radius = body.radius_at(y)
    rise = np.diff(radius)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(rise, px))])
    half = max(8, round(BAND * float(radius.mean()) / px))
    azimuth = np.linspace(-BAND, BAND, 2 * half + 1)
    turn = azimuth - np.arctan2(body.x0, camera.distance)
    X = body.x0 + radius[:, None] * np.sin(turn)
    Z = camera.distance - radius[:, None] * np.cos(turn)
    u, v = camera.pixels(*turned(X, y[:, None], body.roll), Z)
    u0, v0 = max(int(u.min()) - 2, 0), max(int(v.min()) - 2, 0)
    part = rgb[v0 : int(v.max()) + 3, u0 : int(u.max()) + 3]
    luma = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    at = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
    surface = cv2.remap(luma, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    surface = np.asarray(surface, np.float32)
    around = max(1.0, _AROUND * float(radius.mean()) / px)
    mean = cv2.GaussianBlur(surface, (0, 0), around, borderType=cv2.BORDER_REFLECT)
    contrast = surface / np.maximum(np.asarray(mean, np.float32), 1.0) - 1
    contrast = np.clip(contrast, -_STRONGEST, _STRONGEST).astype(np.float32)
    return Unrolled(azimuth, y, arc, radius, contrast)


Spectrum = NDArray[np.complex64]
"""Complex amplitudes, by row and frequency."""

ACROSS = 0.44
"""Standard deviation of the Gaussian window across the band [rad]."""

ALONG = 0.5
"""The same along the meridian, over the mean radius."""

ENDS = 1.5
"""Windows nearer to an end of the braid than this, over their standard deviation, are not looked at."""

_RAYS = np.deg2rad(np.arange(8.0, 78.0, 0.5))  # of a ray against the axis of azimuths, whitened
_FINE = 0.4  # of a window's own width in the spectrum: how far samples of it are apart
_LEAST_PITCH = 2.8  # px: of a finer pattern nothing is seen
_SHORTEST = 3.5  # widths of the window from zero: nearer a ray belongs to the light's own fall
_APART = 1.5  # standard deviations from window to window
_MOST = 24  # windows
_OWN = np.deg2rad(4.0)  # that a window's ray may be off that of the kinematics
_COSINES = np.linspace(0.12, 0.985, 400)


class Directions(NamedTuple):
    """Result of the whole pattern.

    Attributes:
        cosine_per_radius: c of cos(theta) = c R [1/m], which threads of one length have.
        contrast: mean rise of the yarns' rays over the median ray, in powers of e.
        apparent: yarns around the circumference in each direction, as the spectrum has them [-];
            nan where there is no peak.
    """

    cosine_per_radius: float
    contrast: float
    apparent: float

    def twist_rate(self, radius: Array) -> Array:
        """Azimuth per arc length of a yarn, cot(theta) / R [rad/m], at these radii."""
        c = self.cosine_per_radius
        return c / np.sqrt(1 - np.minimum(c * radius, float(_COSINES[-1])) ** 2)


def window_width(surface: Unrolled) -> float:
    """Standard deviation of the windows along the meridian [m]."""
    return ALONG * float(surface.radius.mean())


def rows_of(
    surface: Unrolled, azimuthal: Array, *, middle: float = 0.0, across: float = ACROSS
) -> Spectrum:
    """Spectrum of every row at some frequencies, with a Gaussian window across the band.

    Args:
        surface: the unrolled front.
        azimuthal: frequencies [1/rad], shape (k,).
        middle: of the part [rad].
        across: its standard deviation [rad].

    Returns:
        Shape (n, k), complex.
    """
    taper = np.exp(-((surface.azimuth - middle) ** 2) / (2 * across**2))
    waves = taper[:, None] * np.exp(-2j * np.pi * surface.azimuth[:, None] * azimuthal)
    return np.asarray(surface.contrast @ waves.astype(np.complex64), np.complex64)


def directions(surface: Unrolled, px: float) -> Directions | None:
    """The yarns' direction along the whole muscle; None if the picture is too small.

    A function of one family's phase alone, such as its yarns' shades, has its spectrum on the ray
    square to them, whatever yarn differs from yarn. In units of a Gaussian window's own widths the
    power about this ray falls alike to both sides. Which rays belong to yarns is told by all
    windows together, by cos(theta) = c R: threads of one length.

    Args:
        surface: the unrolled front.
        px: size of a pixel [m].
    """
    width = window_width(surface)
    first, last = ENDS * width, float(surface.arc[-1]) - ENDS * width
    highest = float(surface.radius.min()) / (px * _LEAST_PITCH)
    step = _FINE / (2 * np.pi * ACROSS)
    azimuthal = np.arange(2 * step, highest, step)
    if not (last > first and azimuthal.size * _FINE > 2 * _SHORTEST):
        return None
    number = int(np.clip((last - first) / (_APART * width), 2, _MOST))
    centres = np.linspace(first, last, number)
    farthest = highest / float(surface.radius.mean())
    axial = np.arange(-farthest, farthest, step * ACROSS / width)
    spectrum = rows_of(surface, azimuthal)
    powers = [_power(surface, spectrum, centre, width, axial) for centre in centres]
    radii = np.interp(centres, surface.arc, surface.radius)
    rays = np.array([_rays(power, azimuthal, axial, width) for power in powers])
    rise = np.log(rays / np.median(rays, axis=2, keepdims=True))
    cosine = _COSINES[:, None] * radii / radii.max()
    rate = cosine / np.sqrt(1 - cosine**2) / radii
    expected = np.arctan(rate * width / ACROSS)  # rays of a family with this twist rate
    score = np.sum(
        [
            np.interp(expected[:, k], _RAYS, one)
            for k, families in enumerate(rise)
            for one in families
        ],
        axis=0,
    )
    best = int(np.argmax(score))
    along = np.zeros(azimuthal.size)
    for k, power in enumerate(powers):
        for family, sign in enumerate((1, -1)):
            near = np.abs(_RAYS - expected[best, k]) <= _OWN
            ray = _RAYS[near][np.argmax(rise[k, family, near])]
            rate = np.tan(ray) * ACROSS / width
            along += _sampled(power, azimuthal, axial, azimuthal, sign * rate * azimuthal)
    # Yarns around, from the strongest wave along the rays.
    peaks, n = 1 + np.flatnonzero((along[1:-1] > along[:-2]) & (along[1:-1] >= along[2:])), math.nan
    if peaks.size:
        k = int(peaks[np.argmax((along * azimuthal)[peaks])])
        near = np.log(along[None, k - 1 : k + 2] + 1e-30)
        at = k - 1 + float(parabola_peak(near)[0])
        n = 2 * np.pi * float(azimuthal[0] + (azimuthal[1] - azimuthal[0]) * at)
    return Directions(float(_COSINES[best] / radii.max()), float(score[best] / (2 * number)), n)


def _power(surface: Unrolled, rows: Spectrum, centre: float, width: float, axial: Array) -> Array:
    """Power spectrum of one window, shape (f, k)."""
    near = np.abs(surface.arc - centre) < 3 * width
    off = surface.arc[near] - centre
    weight = np.exp(-(off**2) / (2 * width**2))
    waves = np.exp(-2j * np.pi * np.outer(axial, off)) * (weight / weight.sum())
    return np.abs(waves.astype(np.complex64) @ rows[near]) ** 2


def _rays(power: Array, azimuthal: Array, axial: Array, width: float) -> Array:
    """Energy of the gradient on each ray of both families, shape (2, rays)."""
    r = np.arange(_SHORTEST, azimuthal[-1] * 2 * np.pi * ACROSS, _FINE)[:, None]
    k = r * np.cos(_RAYS) / (2 * np.pi * ACROSS)
    f = r * np.sin(_RAYS) / (2 * np.pi * width)
    families = [_sampled(power, azimuthal, axial, k, sign * f) for sign in (1, -1)]
    return np.array([(r**2 * family).sum(axis=0) for family in families]) + 1e-30


def _sampled(power: Array, azimuthal: Array, axial: Array, k: Array, f: Array) -> Array:
    at = [(x - grid[0]) / (grid[1] - grid[0]) for x, grid in ((f, axial), (k, azimuthal))]
    return np.asarray(map_coordinates(power, at, order=1))


_HARMONICS = (1, 2)
_SPAN = 2.0  # widths of a window in the spectrum to either side: where a yarn's wave is sought
_FINER = 0.1  # of such a width
_SIDES = 0.95, 0.28  # azimuth and width of the parts between which yarns are counted [rad]
_SEEN = 0.3  # coherence of both parts from which a harmonic counts
# Yarns that the harmonics' numbers may be off an even one, and 2 n_2 - n_1:
_NEAR_EVEN = (1.0, 0.6, 0.5)
_EXCESS, _UNSURE = 0.3, (0.5, 0.8)  # of a number not counted; its standard error by both, by one


class Waves:
    """One family's wave in each window.

    Args:
        surface: the unrolled front.
        seen: what the whole pattern says.
        width: standard deviation of the windows along the meridian [m].
        spacing: of the windows, over this.

    Attributes:
        centres: of the windows along the meridian [m], shape (w,).
    """

    def __init__(self, surface: Unrolled, seen: Directions, width: float, spacing: float) -> None:
        self.surface, self.width = surface, width
        last = float(surface.arc[-1])
        first = min(ENDS * width, 0.4 * last)
        number = max(2, round((last - 2 * first) / (spacing * width)) + 1)
        self.centres = centres = np.linspace(first, last - first, number)
        model = seen.twist_rate(surface.radius)
        between = (model[1:] + model[:-1]) / 2 * np.diff(surface.arc)
        turn = np.concatenate([[0.0], np.cumsum(between)])
        self.model = np.interp(centres, surface.arc, model)
        self._windows: list[tuple[slice, Array, Array]] = []
        for centre, here in zip(centres, self.model, strict=True):
            near = np.flatnonzero(np.abs(surface.arc - centre) < 3 * self.width)
            rows = slice(int(near[0]), int(near[-1]) + 1)
            weight = np.exp(-((surface.arc[rows] - centre) ** 2) / (2 * self.width**2))
            # In this length, in place of the arc's own, threads of one length run straight.
            off = (turn[rows] - np.interp(centre, surface.arc, turn)) / here
            self._windows.append((rows, weight / weight.sum(), off))

    def twist_rates(self, n: float) -> tuple[Array, Array]:
        """Azimuth per arc length g of both families, for n yarns around in each direction.

        Returns:
            g: [rad/m], shape (2, w).
            part: of the power at n / (2 pi) that is the family's wave, shape (2, w).
        """
        k = n / (2 * np.pi)
        spectrum = rows_of(self.surface, k * np.array(_HARMONICS))
        rates, parts = np.empty((2, self.centres.size)), np.empty((2, self.centres.size))
        for w, (rows, weight, off) in enumerate(self._windows):
            for family, sign in enumerate((1, -1)):
                f, part = self._wave(spectrum[rows], weight, sign * off, k * self.model[w])
                rates[family, w], parts[family, w] = f / k, part
        return rates, parts

    def _wave(self, rows: Spectrum, weight: Array, off: Array, about: float) -> tuple[float, float]:
        """Frequency near `about` at which a family's wave runs, and its part of the rows' power."""
        unit = 1 / (2 * np.pi * self.width)
        reach = min(_SPAN * unit, 0.5 * about)
        f = about + np.arange(-reach, reach + _FINER * unit, _FINER * unit)
        power = np.zeros(f.size)
        for column, harmonic in enumerate(_HARMONICS):
            waves = np.exp(-2j * np.pi * harmonic * np.outer(f, off))
            power += harmonic * np.abs(waves @ (weight * rows[:, column])) ** 2
        top = float(parabola_peak(np.log(power[None] + 1e-30))[0])
        total = sum(h * float(weight @ np.abs(rows[:, c]) ** 2) for c, h in enumerate(_HARMONICS))
        return float(f[0] + top * (f[1] - f[0])), float(power.max()) / max(total, 1e-30)

    def phase_across(self, n: float, rates: Array, harmonic: int) -> tuple[float, float]:
        """Phase by which a harmonic's wave on the right is ahead of n yarns', against the left.

        Returns:
            The phase [rad], and how far all windows agree in it, 0 to 1.
        """
        k = np.array([harmonic * n / (2 * np.pi)])
        left, right = (
            rows_of(self.surface, k, middle=side * _SIDES[0], across=_SIDES[1])[:, 0]
            for side in (-1, 1)
        )
        product, power = 0j, 0.0
        for w, (rows, weight, off) in enumerate(self._windows):
            for family, sign in enumerate((1, -1)):
                wave = weight * np.exp(-2j * np.pi * sign * k * rates[family, w] * off)
                one, other = wave @ left[rows], wave @ right[rows]
                product += other * np.conj(one)
                power += abs(one * other)
        return float(np.angle(product)), float(abs(product) / max(power, 1e-30))


def count_yarns(waves: Waves, apparent: float) -> tuple[float, float]:
    """Yarns around in each direction, whole where they can be counted, and the standard error.

    Shade moves the crests that the first harmonic sees by so much of a pitch between the left and
    the right, and those of the second by half of it, more or less: 2 n_2 - n_1 is free of it where it is
    half. Lamps near the camera make one yarn more of 24, so that only an even number, as a braider's
    carriers make, to which all three are near is counted; else n_2 less its usual excess is about right.

    Args:
        waves: of the muscle.
        apparent: n by the spectrum, to within one and a half.

    Returns:
        n, and its standard error, 0 where it is whole.
    """
    rates, _ = waves.twist_rates(apparent)
    numbers = []
    for harmonic in _HARMONICS:
        phase, agreed = waves.phase_across(apparent, rates, harmonic)
        if agreed < _SEEN:
            break
        numbers.append(apparent + phase / harmonic / (2 * _SIDES[0]))
    if len(numbers) < len(_HARMONICS):
        return (numbers or [apparent])[0] - _EXCESS, _UNSURE[1]
    first, second = numbers
    even = 2.0 * round((2 * second - first) / 2)
    off = np.abs(np.array([first, second, 2 * second - first]) - even)
    return (even, 0.0) if (off < _NEAR_EVEN).all() else (second - _EXCESS, _UNSURE[0])


_SPACING = 0.5  # of windows, over their standard deviation
_FEW = 28  # yarns around; windows are the longer the fewer there are
_FRONT, _STRIPE, _SHINY = 1.0, 9, 2.5  # rad; columns; variance of a stripe over the middle one's
_CONTRAST = 0.5  # of the rays in the mean, in powers of e, from which there is a weave
_COHERENT = 0.06  # part of the rows' power that is one family's wave, from which it is believed
_ALIKE = math.radians(4.0)  # that the two families may differ by
_TILT = 0.6, 0.35  # crests move by so much of the meridian's slope against the lamps [rad of phase]
_SHADE = 0.045  # [rad of phase] by which they stray besides, over one radius
_PLACE = 0.012  # of its width by which a window's contrast is not in its middle
_LEAST = 0.0007  # rad
_NEIGHBOURS = 4.0  # windows over which the scatter of the two families is pooled
_FEWEST = 4  # windows whose scatter says something


NO_WEAVE = "two families of yarns could not be detected"
BLURRED = "the yarns are not resolved"
GLOSSY = "glossy stripes hide the yarns: move the lamps, or make the braid matt"


@dataclasses.dataclass(frozen=True)
class BraidAngle:
    """The angle between yarns and circumference along a muscle, from a picture of its weave.

    Attributes:
        z: positions from the upper tape's edge to the lower one's [m], shape (n,).
        angle: theta, mean of both families [rad], shape (n,); nan where it is not resolved.
        stderr: its standard error [rad], shape (n,).
        right, left: theta of the yarns that run to the right on the way down, and to the left,
            shape (n,) [rad]. They differ where the muscle is twisted.
        refusal: why the angle is nowhere known; empty if it is.
        yarns: around the circumference in each direction; whole where they could be counted, else
            as many as there seem to be; nan where none are seen.
        yarns_stderr: its standard error, 0 where they were counted; nan where none are seen.
        turns: N of a thread over the length, by threads of one length where nothing is resolved.
    """

    z: Array
    angle: Array
    stderr: Array
    right: Array
    left: Array
    refusal: str
    yarns: float
    yarns_stderr: float
    turns: float

    @property
    def resolved(self) -> Flags:
        """Where the angle is known, shape (n,)."""
        return np.isfinite(self.angle)

    @property
    def part(self) -> float:
        """Fraction of the length over which the angle is resolved."""
        both = self.resolved[1:] & self.resolved[:-1]
        return float(np.diff(self.z) @ both / (self.z[-1] - self.z[0]))

    @property
    def mean(self) -> float:
        """Mean angle where it is resolved [rad]; nan if it is nowhere."""
        return float(np.nanmean(self.angle)) if self.resolved.any() else math.nan

    @property
    def mean_stderr(self) -> float:
        """Standard error of the mean [rad], assuming fully correlated errors."""
        return float(np.nanmean(self.stderr)) if self.resolved.any() else math.nan


def braid_angle(
    photo: Photograph, body: Silhouette, first: float, last: float, relative_stderr: float = 0.0
) -> BraidAngle:
    """Measure the braid angle from the spectrum of the weave along the muscle.

    The front is unrolled to azimuth phi and arc length s, where a yarn has d phi / ds = +-g,
    g = cot(theta) / R. Across the front n yarns in 2 pi make a wave of n / (2 pi) per radian, and
    this wave runs along s with the frequency f = g n / (2 pi), which Gaussian windows show. n is
    counted: a lamp shifts the crests of round yarns towards itself, which stretches the pattern
    across by up to 4 %; that n is whole, and even in a braid of two over two, undoes this.
    Along s the same shift follows the slope of the meridian; its usual amount is taken off.

    Args:
        photo: the picture.
        body: the body of revolution behind the outline.
        first: position y of the upper tape's inner edge [m].
        last: the same of the lower tape.
        relative_stderr: of the diameter, that of the scale left out.

    Returns:
        The angle in windows with a standard deviation of half a mean radius, more where there are
        fewer than 28 yarns around, half of it apart; no nearer to the tapes than 1.5 of it.
    """
    surface = unrolled(photo.rgb, photo.camera, body, first, last)
    seen = directions(surface, 1 / photo.camera.px_per_m)
    if seen is None or not (seen.contrast > _CONTRAST and math.isfinite(seen.apparent)):
        return _nothing(last - first, NO_WEAVE)
    if shines(surface):
        return _nothing(last - first, GLOSSY)
    width = window_width(surface)
    n, uncounted = count_yarns(Waves(surface, seen, width, 1.0), seen.apparent)
    waves = Waves(surface, seen, width * max(1.0, _FEW / n), _SPACING)
    rate, coherence = waves.twist_rates(n)
    radius = np.interp(waves.centres, surface.arc, surface.radius)
    tilt = _tilt(surface, seen, waves) / n
    families = np.arctan(1 / ((rate + _TILT[0] * tilt) * radius))
    angle, half = families.mean(axis=0), np.diff(families, axis=0)[0] / 2
    good = (coherence.min(axis=0) >= _COHERENT) & (np.abs(half) < _ALIKE / 2)
    # d theta = -sin(theta) cos(theta) d(g R) / (g R)
    of_rate = np.hypot(
        math.hypot(relative_stderr, uncounted / n), _TILT[1] * tilt / rate.mean(axis=0)
    )
    shade = _SHADE * np.sin(angle) ** 2 / n
    place = _PLACE * waves.width * np.gradient(angle, waves.centres)
    systematic = np.sqrt(_LEAST**2 + shade**2 + place**2 + (of_rate * np.sin(2 * angle) / 2) ** 2)
    stderr = np.hypot(_scatter(half, good), systematic)
    good &= np.isfinite(stderr)
    z = np.interp(waves.centres, surface.arc, surface.y) - first
    angle, stderr, right, left = (
        np.array([np.nan, *np.where(good, each, np.nan), np.nan])
        for each in (angle, stderr, *families)
    )
    return BraidAngle(
        np.array([0.0, *z, last - first]), angle, stderr, right, left, "" if good.any() else BLURRED,
        n, uncounted, _turns(surface, seen, waves, np.where(good, rate.mean(axis=0), waves.model)),
    )  # fmt: skip


def shines(surface: Unrolled) -> bool:
    """Whether the contrast forms stripes along the muscle, as gloss does."""
    across = np.var(surface.contrast[:, np.abs(surface.azimuth) < _FRONT], axis=0)
    across = np.convolve(across, np.ones(_STRIPE) / _STRIPE, "valid")
    return bool(across.max() > _SHINY * np.median(across))


def _nothing(length: float, reason: str) -> BraidAngle:
    none = np.full(2, np.nan)
    at = np.array([0.0, length])
    return BraidAngle(at, none, none, none, none, reason, *3 * (math.nan,))


def _tilt(surface: Unrolled, seen: Directions, waves: Waves) -> Array:
    """Rate along the arc of cos(theta) times the meridian's slope [rad/m], as the windows see it."""
    slope = np.gradient(surface.radius, surface.arc)
    rate = np.gradient(seen.cosine_per_radius * surface.radius * slope, surface.arc)
    per_row = waves.width / float(np.mean(np.diff(surface.arc)))
    smooth = gaussian_filter1d(rate, per_row, mode="nearest")
    return np.interp(waves.centres, surface.arc, smooth)


def _turns(surface: Unrolled, seen: Directions, waves: Waves, rate: Array) -> float:
    """Turns of a thread, the integral of g ds / (2 pi): as measured, and beyond by the model."""
    off = np.interp(surface.arc, waves.centres, rate / waves.model)
    return float(np.trapezoid(seen.twist_rate(surface.radius) * off, surface.arc) / (2 * np.pi))


def _scatter(half: Array, good: Flags) -> Array:
    """Random error of the mean of two families, from half their difference about its mean course."""
    if np.count_nonzero(good) < _FEWEST:
        return np.full(half.shape, np.nan)
    x = np.linspace(-1, 1, half.size)
    off = np.where(good, half - np.polyval(np.polyfit(x[good], half[good], 1), x), 0.0)
    weight = gaussian_filter1d(good.astype(float), _NEIGHBOURS, mode="constant")
    local = gaussian_filter1d(off**2, _NEIGHBOURS, mode="constant") / np.maximum(weight, 1e-9)
    return np.sqrt((local + np.mean(off[good] ** 2)) / 2)

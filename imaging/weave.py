"""Measure the braid angle along a muscle from the spectrum of its front surface, unrolled to a plane."""

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
"""Largest azimuth used on either side of the line of sight [rad]."""

_AROUND = 0.25  # size of the area of the local mean brightness, relative to the radius
_STRONGEST = 0.25  # limit of the contrast, so that sparkles and black threads count no more


class Unrolled(NamedTuple):
    """Contrast on the surface that faces the camera, unrolled to a plane.

    Attributes:
        azimuth: azimuth of the columns, measured from the line of sight to the axis [rad], evenly spaced,
            shape (m,).
        y: position of the rows, as in `Silhouette` [m], evenly spaced, shape (n,).
        arc: length along the meridian from the first row [m], shape (n,).
        radius: R at y [m], shape (n,).
        contrast: brightness divided by its local mean, minus one, shape (n, m).
    """

    azimuth: Array
    y: Array
    arc: Array
    radius: Array
    contrast: Single


def unrolled(rgb: Image, camera: Camera, body: Silhouette, first: float, last: float) -> Unrolled:
    """Unroll the front of a body at a spacing of one pixel, corrected for perspective, roll and distortion.

    The point at azimuth psi and position y is (x0 + R sin(psi'), y, d - R cos(psi')). psi' is measured from
    the optical axis, and psi from the line of sight to the body's axis.

    Args:
        rgb: picture, shape (h, w, 3).
        camera: camera.
        body: body of revolution with the measured outline.
        first: first position y [m].
        last: last position y [m].
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
"""Complex amplitudes by row and frequency."""

ACROSS = 0.44
"""Standard deviation of the Gaussian window across the band [rad]."""

ALONG = 0.5
"""Standard deviation of the window along the meridian, relative to the mean radius."""

ENDS = 1.5
"""Smallest distance of a window from the ends of the braid, in standard deviations of the window."""

_RAYS = np.deg2rad(np.arange(8.0, 78.0, 0.5))  # angles of rays to the azimuthal axis, whitened
_FINE = 0.4  # spacing of samples of the spectrum, in widths of the window
_LEAST_PITCH = 2.8  # smallest pitch that is resolved [px]
_SHORTEST = 3.5  # first sample of a ray, in widths of the window; below, shading dominates
_APART = 1.5  # spacing of the windows in standard deviations
_MOST = 24  # windows
_OWN = np.deg2rad(4.0)  # largest difference between a window's ray and the kinematics
_COSINES = np.linspace(0.12, 0.985, 400)


class Directions(NamedTuple):
    """Direction of the yarns in the whole pattern.

    Attributes:
        cosine_per_radius: c in cos(theta) = c R [1/m], for threads of equal length.
        contrast: mean logarithm of the energy on the yarns' rays relative to that on the median ray.
        apparent: number of yarns around the circumference in each direction, from the spectrum [-]; nan
            if the spectrum has no peak.
    """

    cosine_per_radius: float
    contrast: float
    apparent: float

    def twist_rate(self, radius: Array) -> Array:
        """Return a yarn's change of azimuth per unit arc length, cot(theta) / R [rad/m], at these radii."""
        c = self.cosine_per_radius
        return c / np.sqrt(1 - np.minimum(c * radius, float(_COSINES[-1])) ** 2)


def window_width(surface: Unrolled) -> float:
    """Return the standard deviation of the windows along the meridian [m]."""
    return ALONG * float(surface.radius.mean())


def rows_of(
    surface: Unrolled, azimuthal: Array, *, middle: float = 0.0, across: float = ACROSS
) -> Spectrum:
    """Return the spectrum of each row with a Gaussian window across the band, shape (n, k), complex.

    Args:
        surface: unrolled front.
        azimuthal: frequencies [1/rad], shape (k,).
        middle: azimuth of the window [rad].
        across: standard deviation of the window [rad].
    """
    taper = np.exp(-((surface.azimuth - middle) ** 2) / (2 * across**2))
    waves = taper[:, None] * np.exp(-2j * np.pi * surface.azimuth[:, None] * azimuthal)
    return np.asarray(surface.contrast @ waves.astype(np.complex64), np.complex64)


def directions(surface: Unrolled, px: float) -> Directions | None:
    """Return the yarns' direction along the whole muscle; None if the picture is too small.

    The spectrum of a pattern that is constant along the yarns of one family lies on the ray perpendicular
    to the yarns, even if the yarns differ from each other. If frequencies are scaled by the widths of the
    window, the power is symmetric about this ray. The constant c in cos(theta) = c R, which holds for
    threads of equal length, is determined from all windows together.

    Args:
        surface: unrolled front.
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
    # The number of yarns follows from the strongest wave along the rays.
    peaks, n = 1 + np.flatnonzero((along[1:-1] > along[:-2]) & (along[1:-1] >= along[2:])), math.nan
    if peaks.size:
        k = int(peaks[np.argmax((along * azimuthal)[peaks])])
        near = np.log(along[None, k - 1 : k + 2] + 1e-30)
        at = k - 1 + float(parabola_peak(near)[0])
        n = 2 * np.pi * float(azimuthal[0] + (azimuthal[1] - azimuthal[0]) * at)
    return Directions(float(_COSINES[best] / radii.max()), float(score[best] / (2 * number)), n)


def _power(surface: Unrolled, rows: Spectrum, centre: float, width: float, axial: Array) -> Array:
    """Return the power spectrum of one window, shape (f, k)."""
    near = np.abs(surface.arc - centre) < 3 * width
    off = surface.arc[near] - centre
    weight = np.exp(-(off**2) / (2 * width**2))
    waves = np.exp(-2j * np.pi * np.outer(axial, off)) * (weight / weight.sum())
    return np.abs(waves.astype(np.complex64) @ rows[near]) ** 2


def _rays(power: Array, azimuthal: Array, axial: Array, width: float) -> Array:
    """Return the energy of the gradient on each ray of both families, shape (2, rays)."""
    r = np.arange(_SHORTEST, azimuthal[-1] * 2 * np.pi * ACROSS, _FINE)[:, None]
    k = r * np.cos(_RAYS) / (2 * np.pi * ACROSS)
    f = r * np.sin(_RAYS) / (2 * np.pi * width)
    families = [_sampled(power, azimuthal, axial, k, sign * f) for sign in (1, -1)]
    return np.array([(r**2 * family).sum(axis=0) for family in families]) + 1e-30


def _sampled(power: Array, azimuthal: Array, axial: Array, k: Array, f: Array) -> Array:
    at = [(x - grid[0]) / (grid[1] - grid[0]) for x, grid in ((f, axial), (k, azimuthal))]
    return np.asarray(map_coordinates(power, at, order=1))


_HARMONICS = (1, 2)
_SPAN = 2.0  # range of frequencies searched for a yarn's wave, in widths of a window
_FINER = 0.1  # spacing of these frequencies, in widths of a window
_SIDES = 0.95, 0.28  # azimuth and width of the parts between which yarns are counted [rad]
_SEEN = 0.3  # smallest coherence of a harmonic between both parts
_NEAR_EVEN = (1.0, 0.6, 0.5)  # largest distance of n_1, n_2 and 2 n_2 - n_1 from an even number
_EXCESS, _UNSURE = (
    0.3,
    (0.5, 0.8),
)  # of a number not counted; standard error by both harmonics, by one


class Waves:
    """Waves of both families of yarns in each window.

    Args:
        surface: unrolled front.
        seen: direction of the yarns in the whole pattern.
        width: standard deviation of the windows along the meridian [m].
        spacing: spacing of the windows, relative to `width`.

    Attributes:
        centres: centres of the windows along the meridian [m], shape (w,).
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
            # As functions of this length, threads of equal length are straight.
            off = (turn[rows] - np.interp(centre, surface.arc, turn)) / here
            self._windows.append((rows, weight / weight.sum(), off))

    def twist_rates(self, n: float) -> tuple[Array, Array]:
        """Return both families' change of azimuth per unit arc length, g, for n yarns in each direction.

        Returns:
            g: [rad/m], shape (2, w).
            part: fraction of the power at n / (2 pi) that is due to the family's wave, shape (2, w).
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
        """Return the frequency of a family's wave near `about`, and its fraction of the rows' power."""
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
        """Return a harmonic's phase on the right relative to the left, minus the value for n yarns.

        Returns:
            The phase [rad], and the agreement between all windows, 0 to 1.
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
    """Return the number of yarns in each direction, an integer if counted, and its standard error.

    The yarns are counted from the phase between left and right, which yields n_1 from the first harmonic
    and n_2 from the second. Shading shifts the crests of the second harmonic by about half as much as
    those of the first; if it is exactly half, 2 n_2 - n_1 is free of the shift. Lamps near the camera raise
    the count by up to one yarn in 24. Braiding machines use even numbers of yarns, so an even number is
    accepted if n_1, n_2 and 2 n_2 - n_1 are all close to it. Otherwise, n_2 minus its usual excess is
    returned.

    Args:
        waves: waves of the muscle.
        apparent: n from the spectrum, accurate to within 1.5.

    Returns:
        n, and its standard error, which is 0 if the yarns were counted.
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


_SPACING = 0.5  # spacing of the windows, in standard deviations
_FEW = 28  # yarns; with fewer yarns the windows are longer
_FRONT, _STRIPE, _SHINY = 1.0, 9, 2.5  # rad; columns; ratio of a stripe's variance to the median
_CONTRAST = 0.5  # smallest contrast of a weave, see `Directions`
_COHERENT = 0.06  # smallest fraction of the rows' power due to one family's wave
_ALIKE = math.radians(4.0)  # largest difference of the two families
_TILT = 0.6, 0.35  # shift of crests per slope of the meridian, and its error [rad of phase]
_SHADE = 0.045  # other shifts of the crests over one radius [rad of phase]
_PLACE = 0.012  # error of the position of a window, relative to its width
_LEAST = 0.0007  # rad
_NEIGHBOURS = 4.0  # number of windows over which the scatter of the families is averaged
_FEWEST = 4  # windows required for an estimate of the scatter


NO_WEAVE = "two families of yarns could not be detected"
BLURRED = "the yarns are not resolved"
GLOSSY = "glossy stripes hide the yarns: move the lamps, or make the braid matt"


@dataclasses.dataclass(frozen=True)
class BraidAngle:
    """The angle between yarns and circumference along a muscle, from a picture of its weave.

    Attributes:
        z: positions from the upper tape's edge to the lower tape's edge [m], shape (n,).
        angle: theta, mean of both families [rad], shape (n,); nan where it is not resolved.
        stderr: standard error of theta [rad], shape (n,).
        refusal: reason why the angle is not resolved anywhere; empty if it is resolved.
        yarns: number around the circumference in each direction, an integer if counted, otherwise an
            estimate; nan if no yarns are visible.
        yarns_stderr: standard error of the number, 0 if counted; nan if no yarns are visible.
        turns: number of turns N of a thread over the length; where the angle is not resolved, threads of
            equal length are assumed.
    """

    z: Array
    angle: Array
    stderr: Array
    refusal: str
    yarns: float
    yarns_stderr: float
    turns: float

    @property
    def resolved(self) -> Flags:
        """True where the angle is resolved, shape (n,)."""
        return np.isfinite(self.angle)

    @property
    def part(self) -> float:
        """Fraction of the length over which the angle is resolved."""
        both = self.resolved[1:] & self.resolved[:-1]
        return float(np.diff(self.z) @ both / (self.z[-1] - self.z[0]))

    @property
    def mean(self) -> float:
        """Mean of the angle where it is resolved [rad]; nan if it is not resolved anywhere."""
        return float(np.nanmean(self.angle)) if self.resolved.any() else math.nan

    @property
    def mean_stderr(self) -> float:
        """Standard error of the mean [rad], assuming fully correlated errors."""
        return float(np.nanmean(self.stderr)) if self.resolved.any() else math.nan


def braid_angle(
    photo: Photograph, body: Silhouette, first: float, last: float, relative_stderr: float = 0.0
) -> BraidAngle:
    """Measure the braid angle from the spectrum of the weave along the muscle.

    The front is unrolled to azimuth phi and arc length s, where a yarn has d phi / ds = +-g with
    g = cot(theta) / R. The n yarns around the circumference form a wave with n / (2 pi) periods per radian
    across the front. Along s, the wave has the frequency f = g n / (2 pi), which is measured in Gaussian
    windows. A lamp shifts the crests of round yarns towards itself and stretches the pattern sideways by up
    to 4 %. Counting the yarns corrects this, because n is an integer, and an even one in a two-over-two
    braid. Along s, the crests shift in proportion to the slope of the meridian; the typical shift is
    subtracted.

    Args:
        photo: picture.
        body: body of revolution with the measured outline.
        first: position y of the upper tape's inner edge [m].
        last: position y of the lower tape's inner edge [m].
        relative_stderr: relative standard error of the diameter, excluding that of the scale.

    Returns:
        The angle in windows with a standard deviation of half the mean radius, or more for fewer than 28
        yarns. The windows are half a standard deviation apart, and at least 1.5 standard deviations from
        the tapes.
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
    angle, stderr = (
        np.array([np.nan, *np.where(good, each, np.nan), np.nan]) for each in (angle, stderr)
    )
    # The turns are the integral of g ds / (2 pi), with the model where nothing was measured.
    off = np.where(good, rate.mean(axis=0), waves.model) / waves.model
    rates = seen.twist_rate(surface.radius) * np.interp(surface.arc, waves.centres, off)
    turns = float(np.trapezoid(rates, surface.arc) / (2 * np.pi))
    refusal = "" if good.any() else BLURRED
    return BraidAngle(
        np.array([0.0, *z, last - first]), angle, stderr, refusal, n, uncounted, turns
    )


def shines(surface: Unrolled) -> bool:
    """Return True if the contrast forms stripes along the muscle, as gloss does."""
    across = np.var(surface.contrast[:, np.abs(surface.azimuth) < _FRONT], axis=0)
    across = np.convolve(across, np.ones(_STRIPE) / _STRIPE, "valid")
    return bool(across.max() > _SHINY * np.median(across))


def _nothing(length: float, reason: str) -> BraidAngle:
    none = np.full(2, np.nan)
    return BraidAngle(np.array([0.0, length]), none, none, reason, *3 * (math.nan,))


def _tilt(surface: Unrolled, seen: Directions, waves: Waves) -> Array:
    """Return the derivative along the arc of cos(theta) times the meridian's slope, smoothed [rad/m]."""
    slope = np.gradient(surface.radius, surface.arc)
    rate = np.gradient(seen.cosine_per_radius * surface.radius * slope, surface.arc)
    per_row = waves.width / float(np.mean(np.diff(surface.arc)))
    smooth = gaussian_filter1d(rate, per_row, mode="nearest")
    return np.interp(waves.centres, surface.arc, smooth)


def _scatter(half: Array, good: Flags) -> Array:
    """Return the random error of the mean of both families, from half their difference, detrended."""
    if np.count_nonzero(good) < _FEWEST:
        return np.full(half.shape, np.nan)
    x = np.linspace(-1, 1, half.size)
    off = np.where(good, half - np.polyval(np.polyfit(x[good], half[good], 1), x), 0.0)
    weight = gaussian_filter1d(good.astype(float), _NEIGHBOURS, mode="constant")
    local = gaussian_filter1d(off**2, _NEIGHBOURS, mode="constant") / np.maximum(weight, 1e-9)
    return np.sqrt((local + np.mean(off[good] ** 2)) / 2)

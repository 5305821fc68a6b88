"""The braid angle at each position along a muscle, with its error."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike
from scipy.ndimage import gaussian_filter1d

from ..arrays import Array, Flags, Image
from ..camera.pinhole import Camera, turned
from ..camera.silhouette import Silhouette
from .directions import Directions, directions, window_width
from .front import Unrolled, unrolled
from .waves import Waves, count_yarns

_SPACING = 0.5  # of windows, over their standard deviation
_FEW = 28  # yarns around; windows are the longer the fewer there are
_OTHER = 0.06  # relative, from the number of yarns that seems to be: another number is meant
_CONTRAST = 0.5  # of the rays in the mean, in powers of e, from which there is a weave
_COHERENT = 0.06  # part of the rows' power that is one family's wave, from which it is believed
_ALIKE = math.radians(4.0)  # that the two families may differ by
_TILT = 0.6, 0.35  # crests move by so much of the meridian's slope against the lamps [rad of phase]
_SHADE = 0.045  # [rad of phase] by which they stray besides, over one radius
_PLACE = 0.012  # of its width by which a window's contrast is not in its middle
_LEAST = 0.0007  # rad
_NEIGHBOURS = 4.0  # windows over which the scatter of the two families is pooled
_FEWEST = 4  # windows whose scatter says something

_DRAWN = 3  # windows from piece to piece
_PIECE = 0.5  # of the radius: half the length of a piece

RESOLVED = ""
AT_TAPE = "nearer to a tape than a window reaches"
NO_WEAVE = "no two families of yarns are seen"
BLURRED = "the yarns are not resolved here"


@dataclasses.dataclass(frozen=True)
class BraidAngle:
    """The angle between yarns and circumference along a muscle, from the picture of its weave.

    Attributes:
        z: positions from the upper tape's edge to the lower one's [m], shape (n,).
        angle: theta, mean of both families [rad], shape (n,); nan where it is not resolved.
        stderr: its standard error [rad], shape (n,).
        right, left: theta of the yarns that run to the right on the way down, and to the left,
            shape (n,) [rad]. They differ where the muscle is twisted.
        reason: why there is no angle, empty where there is one, n of them.
        yarns: around the circumference in each direction; whole where they could be counted, else
            as many as there seem to be; nan where none are seen.
        turns: N of a thread over the length, by threads of one length where nothing is resolved.
    """

    z: Array
    angle: Array
    stderr: Array
    right: Array
    left: Array
    reason: tuple[str, ...]
    yarns: float
    turns: float

    @property
    def resolved(self) -> Flags:
        """Where there is an angle, shape (n,)."""
        return np.isfinite(self.angle)

    @property
    def refusal(self) -> str:
        """Why there is no angle anywhere, empty where there is one."""
        if self.resolved.any():
            return RESOLVED
        return next((reason for reason in self.reason if reason != AT_TAPE), AT_TAPE)

    @property
    def part(self) -> float:
        """Part of the length over which the angle is resolved."""
        both = self.resolved[1:] & self.resolved[:-1]
        return float(np.diff(self.z) @ both / (self.z[-1] - self.z[0]))

    @property
    def mean(self) -> float:
        """Mean of the angle over where it is resolved [rad]; nan where nothing is."""
        return float(np.nanmean(self.angle)) if self.resolved.any() else math.nan

    @property
    def mean_stderr(self) -> float:
        """Standard error of the mean [rad], all errors taken to have one cause."""
        return float(np.nanmean(self.stderr)) if self.resolved.any() else math.nan

    def at(self, z: ArrayLike) -> tuple[Array, Array]:
        """Angle and standard error [rad] at any positions [m], nan where none is resolved."""
        z = np.asarray(z, float)
        angle, stderr = (np.interp(z, self.z, values) for values in (self.angle, self.stderr))
        return angle, stderr


def triangle_angle(length: ArrayLike, turns: float, diameter: ArrayLike) -> Array:
    """The braid angle of a cylinder [rad], theta = atan(L / (pi N D)), against the circumference.

    Args:
        length: L [m].
        turns: N of one thread about the axis over the length [-].
        diameter: D [m], broadcast with L.

    References:
        Chambers 2021, section 2.1: the triangle relation.

    >>> round(float(np.degrees(triangle_angle(9.28125, 1.09, 0.875))), 2)
    72.11
    """
    return np.arctan2(length, np.pi * turns * np.asarray(diameter, float))


def braid_angle(
    rgb: Image,
    camera: Camera,
    body: Silhouette,
    first: float,
    last: float,
    *,
    relative_stderr: float = 0.0,
    n_threads: int | None = None,
) -> BraidAngle:
    """The braid angle from the picture of the weave, by its spectrum along the muscle.

    The front is unrolled to azimuth phi and arc length s, where a yarn has d phi / ds = +-g,
    g = cot(theta) / R. Across the front n yarns in 2 pi make a wave of n / (2 pi) per radian, and
    this wave runs along s with the frequency f = g n / (2 pi), which Gaussian windows show. n is
    counted: a lamp shifts the crests of round yarns towards itself, which stretches the pattern
    across by up to 4 %; that n is whole, and even in a braid of two over two, undoes this.
    Along s the same shift follows the slope of the meridian; its usual amount is taken off.

    Args:
        rgb: picture, shape (h, w, 3).
        camera: the camera.
        body: the body of revolution behind the outline.
        first: position y of the upper tape's inner edge [m].
        last: the same of the lower tape.
        relative_stderr: of the diameter, that of the scale left out.
        n_threads: threads of both families, an even number; None counts them.

    Returns:
        The angle in windows with a standard deviation of half a mean radius, more where there are
        fewer than 28 yarns around, half of it apart; no nearer to the tapes than 1.5 of it.
    """
    surface = unrolled(rgb, camera, body, first, last)
    seen = directions(surface, 1 / camera.px_per_m)
    if seen is None or not (seen.contrast > _CONTRAST and math.isfinite(seen.apparent)):
        return _nothing(last - first, NO_WEAVE)
    width = window_width(surface)
    if n_threads is None:
        n, uncounted = count_yarns(Waves(surface, seen, width, 1.0), seen.apparent)
    else:
        n, uncounted = n_threads / 2, 0.0
        if abs(n / seen.apparent - 1) > _OTHER:
            about = 2 * round(seen.apparent)
            return _nothing(last - first, f"about {about} threads are seen, not {n_threads}")
    waves = Waves(surface, seen, width * max(1.0, _FEW / n), _SPACING)
    rate, coherence = waves.twist_rates(n)
    radius = np.interp(waves.centres, surface.arc, surface.radius)
    tilt = _tilt(surface, seen, waves) / n
    families = np.arctan(1 / ((rate + _TILT[0] * tilt) * radius))
    angle, half = families.mean(axis=0), np.diff(families, axis=0)[0] / 2
    good = (coherence.min(axis=0) >= _COHERENT) & (np.abs(half) < _ALIKE / 2)
    # d theta = -sin(theta) cos(theta) d(g R) / (g R)
    of_rate = np.hypot(math.hypot(relative_stderr, uncounted), _TILT[1] * tilt / rate.mean(axis=0))
    shade = _SHADE * np.sin(angle) ** 2 / n
    place = _PLACE * waves.width * np.gradient(angle, waves.centres)
    systematic = np.sqrt(_LEAST**2 + shade**2 + place**2 + (of_rate * np.sin(2 * angle) / 2) ** 2)
    stderr = np.hypot(_scatter(half, good), systematic)
    good &= np.isfinite(stderr)
    z = np.interp(waves.centres, surface.arc, surface.y) - first
    inside = (RESOLVED if each else BLURRED for each in good)
    angle, stderr, right, left = (
        np.array([np.nan, *np.where(good, each, np.nan), np.nan])
        for each in (angle, stderr, *families)
    )
    return BraidAngle(
        np.array([0.0, *z, last - first]),
        angle,
        stderr,
        right,
        left,
        (AT_TAPE, *inside, AT_TAPE),
        n,
        _turns(surface, seen, waves, np.where(good, rate.mean(axis=0), waves.model)),
    )


def yarn_lines(camera: Camera, body: Silhouette, first: float, braid: BraidAngle) -> list[Array]:
    """Pieces of yarns of both families as they should lie in the picture, for a check by eye.

    Args:
        camera: the camera.
        body: the body of revolution behind the outline.
        first: position y of the upper tape's inner edge [m].
        braid: the angle along it.

    Returns:
        Points u, v of each piece [px], shape (2, k).
    """
    lines = []
    for k in np.flatnonzero(braid.resolved)[::_DRAWN]:
        middle = first + float(braid.z[k])
        radius = float(body.radius_at(middle))
        along = np.linspace(-_PIECE, _PIECE, 9) * radius
        for theta in (braid.right[k], -braid.left[k]):
            y = middle + along * abs(np.sin(theta))
            turn = np.sign(theta) * along * np.cos(theta) / radius
            turn = turn - np.arctan2(body.x0, camera.distance)
            R = body.radius_at(y)
            X, Y = turned(body.x0 + R * np.sin(turn), y, body.roll)
            lines.append(np.stack(camera.pixels(X, Y, camera.distance - R * np.cos(turn))))
    return lines


def _nothing(length: float, reason: str) -> BraidAngle:
    none = np.full(2, np.nan)
    at = np.array([0.0, length])
    return BraidAngle(at, none, none, none, none, (reason, reason), math.nan, math.nan)


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

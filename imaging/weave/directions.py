"""In which directions the yarns run, and how many there are: the surface's spectrum along rays."""

import dataclasses
import math

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from ..arrays import Array
from .front import Unrolled

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
_SHORTEST = (
    3.5  # widths of the window from zero, within which a ray belongs to the light's own fall
)
_APART = 1.5  # standard deviations from window to window
_MOST = 24  # windows
_OWN = np.deg2rad(4.0)  # that a window's ray may be off that of the kinematics
_COSINES = np.linspace(0.12, 0.985, 400)


@dataclasses.dataclass(frozen=True)
class Directions:
    """What the whole pattern says.

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
    """Spectrum across a Gaussian part of the band, at some frequencies, of every row.

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
    """The yarns' direction along the whole muscle; None where the picture is too small for one.

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
    expected = _ray_of(cosine / np.sqrt(1 - cosine**2) / radii, width)
    score = np.zeros(_COSINES.size)
    for k in range(number):
        for family in range(2):
            score += np.interp(expected[:, k], _RAYS, rise[k, family])
    best = int(np.argmax(score))
    along = np.zeros(azimuthal.size)
    for k, power in enumerate(powers):
        for family, sign in enumerate((1, -1)):
            near = np.abs(_RAYS - expected[best, k]) <= _OWN
            ray = _RAYS[near][np.argmax(rise[k, family, near])]
            rate = np.tan(ray) * ACROSS / width
            along += _sampled(power, azimuthal, axial, azimuthal, sign * rate * azimuthal)
    return Directions(
        float(_COSINES[best] / radii.max()),
        float(score[best] / (2 * number)),
        _number(azimuthal, along),
    )


def _ray_of(rate: Array, width: float) -> Array:
    """Angle of the ray on which a family with this twist rate has its spectrum."""
    return np.arctan(rate * width / ACROSS)


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
    at = [
        (f - axial[0]) / (axial[1] - axial[0]), (k - azimuthal[0]) / (azimuthal[1] - azimuthal[0]),
    ]  # fmt: skip
    return np.asarray(map_coordinates(power, at, order=1))


def _number(azimuthal: Array, along: Array) -> float:
    """Yarns around, from the strongest wave along the rays."""
    peaks = 1 + np.flatnonzero((along[1:-1] > along[:-2]) & (along[1:-1] >= along[2:]))
    if peaks.size == 0:
        return math.nan
    return 2 * np.pi * _vertex(azimuthal, along, int(peaks[np.argmax((along * azimuthal)[peaks])]))


def _vertex(x: Array, power: Array, k: int) -> float:
    before, here, after = np.log(power[k - 1 : k + 2] + 1e-30)
    return float(x[k] + (x[1] - x[0]) * (before - after) / 2 / (before - 2 * here + after))

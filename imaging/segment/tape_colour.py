"""Tape from braid by colour: Otsu on the chromaticity along the line that separates the two."""

import colorsys

import cv2
import numpy as np
from numpy.typing import NDArray

from ..arrays import Image
from .masks import Mask, sampled
from .otsu import otsu_split

_OWN_HUE = 60.0  # deg up to which a class may be the tape of the hue that was given
_SURE_HUE = 25.0  # the same of the class with more pixels, which is the braid as a rule
_LEAST_CHROMA = 0.01  # of chromaticity; rendered grey has 0.006 at most, tan on tan 0.018
_SAMPLE = 4000  # pixels that the classes are found on


def split_by_colour(rgb: Image, muscle: Mask, tape_hue: float | None) -> tuple[Mask, float]:
    """The pixels of the tape among those of the muscle.

    Chromaticity c = (R, G, B) / (R + G + B) does not depend on the light's strength. Otsu's cut
    along its first principal axis gives two classes, and a second one along the line between
    their means the answer. White braids, whose hue is noise, and red tapes, whose hue lies across
    the seam, need no special case.

    Args:
        rgb: picture, shape (h, w, 3).
        muscle: > 0 on the muscle, shape (h, w).
        tape_hue: of the tape [deg]; None takes the class with fewer pixels, as does a hue that
            neither class has.

    Returns:
        mask: 255 on the tape, shape (h, w).
        eta: separability of the two colours, 0 to 1.
    """
    nothing = np.zeros_like(muscle), 0.0
    sample = sampled(rgb, muscle, _SAMPLE).astype(np.float32)
    colour = sample / (sample @ np.ones((3, 1), np.float32) + 1)
    along = np.linalg.eigh(np.cov(colour.T))[1][:, -1]
    level, eta = _cut(colour @ along)
    upper = colour @ along > level
    if upper.all() or not upper.any():
        return nothing
    along = colour[upper].mean(axis=0) - colour[~upper].mean(axis=0)
    if np.linalg.norm(along - along.mean()) < _LEAST_CHROMA:
        return nothing
    level, eta = _cut(colour @ along)
    upper = colour @ along > level
    if upper.all() or not upper.any():
        return nothing
    take_upper = bool(np.count_nonzero(upper) <= upper.size / 2)
    if tape_hue is not None:
        sides = (sample[upper], sample[~upper])
        away = [hues_apart(hue_of(np.median(side, axis=0)), tape_hue) for side in sides]
        nearest = bool(away[0] <= away[1])
        if min(away) < (_OWN_HUE if nearest == take_upper else _SURE_HUE):
            take_upper = nearest
    # along . c > level, multiplied by R + G + B + 1, is one linear form of the picture.
    form = np.array([[*(along - level), -level]], np.float32)
    u, v, width, height = cv2.boundingRect(muscle)
    box = slice(v, v + height), slice(u, u + width)
    above = cv2.transform(rgb[box].astype(np.float32), form).reshape(height, width) > 0
    mask = np.zeros_like(muscle)
    mask[box] = np.where((above == take_upper) & (muscle[box] > 0), 255, 0)
    return mask, eta


def hue_of(rgb: NDArray[np.floating]) -> float:
    """Hue [deg] of a colour, 0 to 360; zero for grey."""
    red, green, blue = (float(value) for value in rgb)
    return 360 * colorsys.rgb_to_hsv(red, green, blue)[0]


def hues_apart(a: float, b: float) -> float:
    """Distance of two hues around the circle [deg], 0 to 180."""
    return abs((a - b + 180) % 360 - 180)


def _cut(values: NDArray[np.floating]) -> tuple[float, float]:
    """The level between two classes of values, and their separability.

    Otsu's level lies half way between the means and cuts into the wider class, such as a glossy
    tape; this one is as many standard deviations from the one as from the other.
    """
    low, high = np.percentile(values, [0.2, 99.8])
    if not high > low:
        return float(high), 0.0
    place = np.clip((values - low) * (256 / (high - low)), 0, 255).astype(np.intp)
    split = otsu_split(np.bincount(place, minlength=256))
    upper = place > split.level
    if upper.all() or not upper.any():
        return float(high), 0.0
    (m0, s0), (m1, s1) = ((part.mean(), part.std()) for part in (values[~upper], values[upper]))
    level = (m0 * s1 + m1 * s0) / (s0 + s1) if s0 + s1 > 0 else (m0 + m1) / 2
    return float(level), split.eta

"""Which pixels belong to the muscle and its tapes, and which to the cloth."""

import dataclasses
from typing import Any

import cv2
import numpy as np

from ..arrays import Image
from ..errors import NoMuscle, Underexposed
from .masks import Mask, above, areas, chosen, parts, shaped
from .otsu import Split, counts_of, otsu_split

LEAST_CONTRAST = 30  # levels between cloth and muscle
LEAST_AREA = 0.002  # of the picture
TWO_CLASSES = 0.75  # eta of two separate classes; one normal distribution has 0.64
_DARK = 40  # mean level of the bright class below which a muscle is under-exposed
_SHADE = 0.15  # of the way from cloth to muscle at which its shaded side begins


@dataclasses.dataclass(frozen=True)
class MuscleMask:
    """The muscle with its tapes.

    Attributes:
        lit: its well lit part, 255 inside, shape (h, w).
        whole: the shaded side as well, and rods that glare.
        eta: separability of muscle and cloth, 0 to 1; nan where it was not found by its brightness.
    """

    lit: Mask
    whole: Mask
    eta: float


def muscle_mask(rgb: Image) -> MuscleMask:
    """The largest thing that is brighter, or stronger in colour, than the cloth.

    Otsu's level on the brightest of the three colours, and on the strength of the colour, max -
    min, where this has two classes: a dark blue tape is no brighter than cloth, but bluer.

    Raises:
        NoMuscle: nothing stands out and holds together.
        Underexposed: it does, but is too dark.
    """
    red, green, blue = cv2.split(rgb)
    value = np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)
    least = cv2.min(cv2.min(red, green), blue)
    strength = np.asarray(cv2.subtract(value, least), np.uint8)
    by_value, by_strength = otsu_split(counts_of(value)), otsu_split(counts_of(strength))
    lit = above(value, by_value.level)
    if by_strength.eta > TWO_CLASSES and by_strength.high - by_strength.low > LEAST_CONTRAST:
        lit = lit | above(strength, by_strength.level)
    lit = shaped(lit, cv2.MORPH_OPEN, 3)
    labels = parts(shaped(lit, cv2.MORPH_CLOSE, 5))
    area = areas(labels)
    _check(by_value, float(area.max() / value.size))
    lit = lit & chosen(labels, int(np.argmax(area)))
    return MuscleMask(lit, _with_shaded_side(lit, value, by_value), by_value.eta)


def _check(split: Split, area: float) -> None:
    figures: dict[str, Any] = {
        "eta_value": split.eta,
        "cloth_level": split.low,
        "muscle_level": split.high,
        "area": area,
    }
    if split.high < _DARK and area >= LEAST_AREA and split.eta > TWO_CLASSES:
        raise Underexposed(
            f"the muscle must be brighter than level {_DARK} of 255: expose longer, or give it "
            "more light",
            **figures,
        )
    if split.high - split.low < LEAST_CONTRAST or area < LEAST_AREA:
        raise NoMuscle(
            f"the brighter class must stand {LEAST_CONTRAST} levels above the cloth and hold "
            "together: is the muscle in the picture, and lit?",
            **figures,
        )


def _with_shaded_side(lit: Mask, value: Image, split: Split) -> Mask:
    """The muscle's lit part and what is darker beside it, but not as dark as the cloth."""
    cloth = np.cumsum(counts_of(value, ~shaped(lit, cv2.MORPH_DILATE, 9)))
    if cloth[-1] == 0:
        return lit
    low, high = np.searchsorted(cloth, np.array([0.5, 0.98]) * cloth[-1])
    level = max(low + _SHADE * (split.high - low), high + 4)
    shade = shaped(above(value, min(level, split.level)), cv2.MORPH_OPEN, 3)
    labels = parts(lit | shade)
    return chosen(labels, labels[::2, ::2][lit[::2, ::2] > 0])

"""The muscle against its background, by brightness, colour or the borders of the picture."""

import dataclasses
import math
from typing import Any

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray
from skimage.filters.thresholding import threshold_otsu

from .arrays import Array, Image, Indices, Single
from .errors import Clipped, NoMuscle, Underexposed

Mask = Image


def above(image: Image, level: float) -> Mask:
    """Where an 8-bit image is brighter than a level."""
    return np.where(image > level, 255, 0).astype(np.uint8)


def shaped(mask: Mask, operation: int, size: int) -> Mask:
    """A mask after an operation with a square of `size` px.

    Args:
        mask: shape (h, w).
        operation: `cv2.MORPH_OPEN` takes away what is narrower than the square, `cv2.MORPH_CLOSE`
            fills gaps that are, `cv2.MORPH_ERODE` takes away a border of half of its size, and
            `cv2.MORPH_DILATE` adds one.
        size: of the square [px].
    """
    return np.asarray(cv2.morphologyEx(mask, operation, np.ones((size, size), np.uint8)), np.uint8)


def parts(mask: Mask) -> NDArray[np.int32]:
    """Numbers of the connected parts, 0 outside."""
    return np.asarray(cv2.connectedComponents(mask)[1], np.int32)  # thrice as fast as with areas


def areas(labels: NDArray[np.int32]) -> Indices:
    """Pixels of each part, that of the outside 0."""
    area = np.bincount(labels.ravel())
    area[0] = 0
    return area


def chosen(labels: NDArray[np.int32], numbers: NDArray[np.integer] | int) -> Mask:
    """The parts with these numbers."""
    table = np.zeros(int(labels.max()) + 1, np.uint8)
    table[numbers] = 255
    return table.take(labels)


def sampled(image: Image, mask: Mask, n: int) -> Image:
    """About n pixels of a mask, from an even grid; all where it has fewer."""
    every = max(1, int(np.sqrt(cv2.countNonZero(mask) / n)))
    return image[::every, ::every][mask[::every, ::every] > 0]


@dataclasses.dataclass(frozen=True)
class Split:
    """A histogram cut in two.

    Attributes:
        level: the last bin of the lower class.
        eta: between-class over total variance, 0 to 1; 0.64 for one normal distribution.
        low, high: means of the classes, in bins.
        share: part of all counts in the upper class.
    """

    level: int
    eta: float
    low: float
    high: float
    share: float


def otsu_split(counts: ArrayLike) -> Split:
    """The cut of a histogram that maximises the variance between its two classes.

    eta(k) = w0 w1 (m1 - m0)^2 / sigma^2; scikit-image's level, of which only the separability is ours.

    Args:
        counts: of the bins 0, 1, 2 ..., shape (n,).

    Returns:
        The cut; eta is zero where all counts are in one bin.

    References:
        Otsu 1979, IEEE Trans. Syst. Man Cybern. 9, equations 14 to 16.

    >>> split = otsu_split([5, 9, 1, 0, 2, 7, 3])
    >>> print(split.level, round(split.eta, 4), round(split.low, 4), round(split.high, 4))
    2 0.9276 0.7333 5.0833
    """
    p = np.asarray(counts, float).ravel()
    p = p / p.sum()
    bins = np.arange(p.size)
    mean = float(p @ bins)
    spread = float(p @ (bins - mean) ** 2)
    if spread == 0:
        return Split(int(np.argmax(p)), 0.0, mean, mean, 0.0)
    level = int(threshold_otsu(hist=(p, bins)))
    below = slice(None, level + 1)
    share = 1 - float(p[below].sum())
    low = float(p[below] @ bins[below]) / (1 - share)
    high = (mean - low * (1 - share)) / share
    return Split(level, share * (1 - share) * (high - low) ** 2 / spread, low, high, share)


def counts_of(values: Image, mask: Image | None = None) -> Array:
    """Counts of the values 0 to 255 of an 8-bit array, or of those in a mask, shape (256,)."""
    return cv2.calcHist([values], [0], mask, [256], [0, 256]).ravel().astype(np.float64)


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
    }
    figures["area"] = area
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


_BORDER = 1 / 60  # of the width: what is looked at on either side
_ALONG = 1 / 30  # of the height, over which the border's colour is evened out
_EVERY = 4  # pixels of which one is looked at
_DIM = 0.3  # of the muscle's median brightness: what is darker is a rod or a black thread
_STREAK = 0.12  # of the muscle's width, which the glare on a rod does not reach
_TOUCHES = 0.03  # of the rows in which a muscle may reach the border
_ROUNDS = 2  # of the cut that minimises energy
_LEAST = 12.0  # levels that the muscle must stand off the border's colour


def mask_against_border(rgb: Image) -> MuscleMask:
    """The largest thing that differs from what the left and the right border show in its rows.

    The background of a row has the colour of its left border, of its right one, or one between
    them by place; two halves of different cloth and a wall in uneven light are such. From what is
    off all three, a cut through the picture's graph of neighbours, with mixtures of colours learnt
    on either side of it, takes the muscle.

    Args:
        rgb: picture, shape (h, w, 3).

    References:
        Rother, Kolmogorov and Blake 2004, "GrabCut".

    Raises:
        NoMuscle: nothing stands off the background and holds together.
        Clipped: what does reaches the left or the right border.
    """
    off = _distance(rgb)
    value = np.asarray(np.clip(off, 0, 255), np.uint8)
    split = otsu_split(counts_of(value))
    sure = shaped(above(value, max(split.level, _LEAST)), cv2.MORPH_OPEN, 5)
    if split.high - split.low < _LEAST or np.count_nonzero(sure) < LEAST_AREA * value.size:
        raise NoMuscle(
            "the muscle must stand out from the background on its left and right; nothing does: "
            "put a dark cloth behind it",
            eta_value=split.eta, off_levels=split.high,
        )  # fmt: skip
    guess = np.full(value.shape, cv2.GC_PR_BGD, np.uint8)
    guess[value > _LEAST] = cv2.GC_PR_FGD
    guess[sure > 0] = cv2.GC_FGD
    width = _border(value.shape[1])
    guess[:, :width] = guess[:, -width:] = cv2.GC_BGD
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.setRNGSeed(0)
    cv2.grabCut(rgb, guess, (0, 0, 1, 1), *models, _ROUNDS, cv2.GC_INIT_WITH_MASK)
    inside = np.where(guess & 1, 255, 0).astype(np.uint8)
    lit = shaped(inside, cv2.MORPH_OPEN, 3)
    labels = parts(shaped(lit, cv2.MORPH_CLOSE, 5))
    found = _filled(chosen(labels, int(np.argmax(areas(labels)))))
    at_border = [float((found[:, k] > 0).mean()) for k in (width, -width - 1)]
    if max(at_border) > _TOUCHES:
        raise Clipped(
            "the whole width of the muscle must be in the picture; its outline touches the border: "
            "move the camera, or widen the crop",
            left_part=at_border[0], right_part=at_border[1],
        )  # fmt: skip
    brightest = np.asarray(rgb.max(axis=2), np.uint8)
    lit = found & above(brightest, _DIM * float(np.median(brightest[found > 0])))
    return MuscleMask(lit & _without_streaks(lit), found, math.nan)


def _border(width: int) -> int:
    return max(3, round(_BORDER * width))


def _without_streaks(lit: Mask) -> Mask:
    """A mask without the streaks of light on a rod: black threads filled, what is narrow taken off."""
    size = max(3, round(_STREAK * float((lit > 0).sum(axis=1).max())))
    return shaped(_filled(shaped(lit, cv2.MORPH_CLOSE, 5)), cv2.MORPH_OPEN, size)


def light_behind(rgb: Image) -> bool:
    """Whether the picture's left and right borders both are of its brighter class."""
    value = np.asarray(rgb.max(axis=2)[::_EVERY, ::_EVERY])
    level = otsu_split(counts_of(np.ascontiguousarray(value))).level
    width = _border(value.shape[1])
    return all(float(np.median(side)) > level for side in (value[:, :width], value[:, -width:]))


def _distance(rgb: Image) -> Single:
    """Levels by which each pixel is off its row's background, shape (h, w)."""
    h, w = rgb.shape[:2]
    width, height = _border(w), max(3, round(_ALONG * h)) | 1
    picture, sides = rgb.astype(np.float32), []
    for border in (picture[:, :width], picture[:, -width:]):
        colour = np.median(border, axis=1).reshape(h, 1, 3)
        smooth = np.asarray(cv2.blur(colour, (1, height), borderType=cv2.BORDER_REPLICATE))
        sides.append(smooth.reshape(h, 1, 3).astype(np.float32))
    place = np.linspace(0, 1, w, dtype=np.float32)[None, :, None]
    backgrounds = (*sides, sides[0] + place * (sides[1] - sides[0]))
    return np.min([np.linalg.norm(picture - each, axis=2) for each in backgrounds], axis=0)


def _filled(mask: Mask) -> Mask:
    """A part without the holes in it."""
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    filled = np.zeros_like(mask)
    cv2.drawContours(filled, list(outlines), -1, 255, cv2.FILLED)
    return filled

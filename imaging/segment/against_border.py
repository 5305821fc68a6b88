"""The muscle in front of a light or uneven background: what differs from the picture's own borders."""

import math

import cv2
import numpy as np

from ..arrays import Image, Single
from ..errors import Clipped, NoMuscle
from .masks import Mask, above, areas, chosen, parts, shaped
from .muscle_mask import LEAST_AREA, MuscleMask
from .otsu import counts_of, otsu_split

_BORDER = 1 / 60  # of the width: what is looked at on either side
_ALONG = 1 / 30  # of the height, over which the border's colour is evened out
_EVERY = 4  # pixels of which one is looked at
_DARK = 0.3  # of the muscle's median brightness: what is darker is a rod or a black thread
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
            eta_value=split.eta,
            off_levels=split.high,
        )
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
            left_part=at_border[0],
            right_part=at_border[1],
        )
    brightest = np.asarray(rgb.max(axis=2), np.uint8)
    lit = found & above(brightest, _DARK * float(np.median(brightest[found > 0])))
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
    picture = rgb.astype(np.float32)
    sides = []
    for border in (picture[:, :width], picture[:, -width:]):
        colour = np.median(border, axis=1).reshape(h, 1, 3)
        smooth = np.asarray(cv2.blur(colour, (1, height), borderType=cv2.BORDER_REPLICATE))
        sides.append(smooth.reshape(h, 1, 3).astype(np.float32))
    left, right = sides
    place = np.linspace(0, 1, w, dtype=np.float32)[None, :, None]
    backgrounds = (left, right, left + place * (right - left))
    away = [np.linalg.norm(picture - each, axis=2) for each in backgrounds]
    return np.asarray(np.minimum(np.minimum(away[0], away[1]), away[2]), np.float32)


def _filled(mask: Mask) -> Mask:
    """A part without the holes in it."""
    outlines = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)[0]
    filled = np.zeros_like(mask)
    cv2.drawContours(filled, list(outlines), -1, 255, cv2.FILLED)
    return filled

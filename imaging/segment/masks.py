"""Operations on 8-bit masks, 255 inside and 0 outside."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..arrays import Image, Indices

Mask = Image


def above(image: Image, level: float) -> Mask:
    """Where an 8-bit image is brighter than a level."""
    return _mask(cv2.threshold(image, float(np.floor(level)), 255, cv2.THRESH_BINARY)[1])


def opened(mask: Mask, size: int) -> Mask:
    """Without what is narrower than `size` px."""
    return _mask(cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((size, size), np.uint8)))


def closed(mask: Mask, size: int) -> Mask:
    """With gaps narrower than `size` px filled."""
    return _mask(cv2.morphologyEx(mask, cv2.MORPH_CLOSE, np.ones((size, size), np.uint8)))


def eroded(mask: Mask, size: int) -> Mask:
    """Without a border of half of `size` px."""
    return _mask(cv2.erode(mask, np.ones((size, size), np.uint8)))


def dilated(mask: Mask, size: int) -> Mask:
    """With a border of half of `size` px."""
    return _mask(cv2.dilate(mask, np.ones((size, size), np.uint8)))


def both(a: Mask, b: Mask) -> Mask:
    """Inside a and inside b."""
    return _mask(cv2.bitwise_and(a, b))


def either(a: Mask, b: Mask) -> Mask:
    """Inside a or inside b."""
    return _mask(cv2.bitwise_or(a, b))


def outside(mask: Mask) -> Mask:
    """What the mask leaves out."""
    return _mask(cv2.bitwise_not(mask))


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


def _mask(image: object) -> Mask:
    return np.asarray(image, np.uint8)

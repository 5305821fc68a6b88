"""The two tapes among the pixels of their colour."""

import dataclasses

import cv2
import numpy as np
from numpy.typing import NDArray

from ..arrays import Flags
from ..errors import AmbiguousHue, Clipped, ExtraFitting, MissingFitting
from .masks import Mask, areas, parts, shaped
from .muscle_mask import TWO_CLASSES

_GAP = 0.4  # of the root of half the coloured area: how far apart parts of one tape may be
_LEAST_TAPE = 0.2  # of the larger tape's area


@dataclasses.dataclass(frozen=True)
class Patch:
    """The pixels of one tape.

    Attributes:
        x, y: first column and row of its box.
        mask: its pixels in the box, shape (h, w).
    """

    x: int
    y: int
    mask: Flags

    @property
    def centre(self) -> tuple[float, float]:
        """Middle of the box, u and v."""
        h, w = self.mask.shape
        return self.x + w / 2, self.y + h / 2


def two_tapes(coloured: Mask, muscle: Mask, eta: float, step: int) -> tuple[Patch, Patch]:
    """The two tapes, the upper one first, or the left one where they are at one height.

    Parts that a streak of gloss divides are one tape; what has less than a fifth of the largest
    one's pixels is none.

    Args:
        coloured: pixels of the tape's colour, shape (h, w).
        muscle: pixels of the muscle.
        eta: separability of the two colours.
        step: picture pixels to one of these, for the figures of errors.

    Raises:
        AmbiguousHue, MissingFitting, ExtraFitting, Clipped: there are not two, or not all of them.
    """
    coloured = shaped(coloured, cv2.MORPH_OPEN, 3)
    half = np.count_nonzero(coloured) / 2
    labels = parts(shaped(coloured, cv2.MORPH_CLOSE, int(max(5, _GAP * np.sqrt(half))) | 1))
    labels[coloured == 0] = 0
    area = areas(labels)
    numbers = np.flatnonzero((area > 0) & (area >= _LEAST_TAPE * area.max()))
    _check_number(numbers.size, eta, _at_frame(muscle))
    patches = sorted((_patch(labels, int(i)) for i in numbers), key=lambda patch: patch.centre[1])
    for patch in patches:
        h, w = patch.mask.shape
        if min(patch.x, patch.y) == 0 or patch.x + w == muscle.shape[1] or (
            patch.y + h == muscle.shape[0]
        ):  # fmt: skip
            raise Clipped(
                "the tapes must lie inside the picture; one touches its border: move the camera, "
                "or widen the crop",
                left_px=patch.x * step,
                top_px=patch.y * step,
                width_px=w * step,
                height_px=h * step,
            )
    return patches[0], patches[1]


def _patch(labels: NDArray[np.int32], number: int) -> Patch:
    mask = labels == number
    x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
    return Patch(x, y, mask[y : y + h, x : x + w])


def _check_number(n: int, eta: float, at_frame: str) -> None:
    figures = {"tapes": n, "eta_hue": eta}
    if n < 2 and at_frame:
        raise Clipped(
            f"both tapes must be in the picture; {n} is seen, and the muscle runs out at the "
            f"{at_frame}: move the camera, or widen the crop",
            **figures,
        )
    if n == 0 or (n != 2 and eta < TWO_CLASSES):
        raise AmbiguousHue(
            "the tapes must differ in colour from the braid; no two classes of colour are seen: "
            "use another tape, or give its hue",
            **figures,
        )
    if n == 1:
        raise MissingFitting(
            "two tapes must be seen; one is: is the other covered, too dark, or without colour?",
            **figures,
        )
    if n > 2:
        raise ExtraFitting(
            f"two tapes must be seen, and {n} are: remove the rest from the picture, crop it, or "
            "give the tape's hue",
            **figures,
        )


def _at_frame(muscle: Mask) -> str:
    sides = {"top": muscle[0], "bottom": muscle[-1], "left": muscle[:, 0], "right": muscle[:, -1]}
    return " and ".join(name for name, line in sides.items() if line.any())

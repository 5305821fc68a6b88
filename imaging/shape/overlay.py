"""What was found in a picture, drawn on it for a check by eye."""

import numpy as np

from ..arrays import Image
from .measurement import Trace

_OUTLINE, _TAPES, _MIDLINE = (255, 40, 40), (255, 220, 0), (0, 230, 230)  # RGB
_YARNS = (255, 0, 255)
_BITS = 4  # of the fraction of a pixel in which OpenCV draws
_MARGIN = 0.6  # of the muscle's width, kept beside it


def draw_overlay(image: Image, trace: Trace, *, crop: bool = True, thickness: int = 1) -> Image:
    """The picture with outline (red), tape edges (yellow), mid-line (cyan), yarns (magenta).

    Lines are drawn to a sixteenth of a pixel where the edges were found, before perspective and
    roll are undone.

    Args:
        image: RGB, shape (h, w, 3).
        trace: of its measurement.
        crop: cut the picture down to the muscle and its surroundings.
        thickness: of the lines [px].

    Returns:
        RGB, dtype uint8; a picture that was turned to be measured stays turned.
    """
    import cv2  # noqa: PLC0415

    drawn = np.ascontiguousarray(np.rot90(image, -1) if trace.turned else image).copy()
    lines = (
        (trace.left, trace.rows, _OUTLINE),
        (trace.right, trace.rows, _OUTLINE),
        (*trace.upper, _TAPES),
        (*trace.lower, _TAPES),
        ((trace.left + trace.right) / 2, trace.rows, _MIDLINE),
        *((u, v, _YARNS) for u, v in trace.yarns),
    )
    for u, v, colour in lines:
        points = np.round(np.stack([u, v], axis=1) * 2**_BITS).astype(np.int32)
        cv2.polylines(drawn, [points], False, colour, thickness, cv2.LINE_AA, _BITS)
    return _cropped(drawn, trace) if crop else drawn


def _cropped(image: Image, trace: Trace) -> Image:
    width = float(np.median(trace.right - trace.left))
    margin = _MARGIN * width
    v = np.concatenate([trace.rows, trace.upper[1], trace.lower[1]])
    top, bottom = int(max(v.min() - margin, 0)), int(v.max() + margin) + 1
    left, right = int(max(trace.left.min() - margin, 0)), int(trace.right.max() + margin) + 1
    return image[top:bottom, left:right]

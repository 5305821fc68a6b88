"""In which light the muscle's outline is looked for: luma or one colour, brighter or darker inside."""

import math

import cv2
import numpy as np

from ..arrays import Array, Image, Single
from ..camera.tone import LUMA, Tone, amount_of_look, amount_of_luma
from ..errors import NoMuscle
from .segmentation import Segmentation

_BESIDE = np.arange(6, 17)  # px from the coarse outline, on either side of it
_ROWS = 400  # that are looked at, evenly thinned out
_LEAST = 0.12  # of the brighter side: contrast that nine rows in ten must have
_LUMA_FIRST = 0.5  # of the best colour's contrast with which luma, JPEG's sharpest, is preferred


def edge_light(rgb: Image, coarse: Segmentation, tone: Tone) -> tuple[Image, Single]:
    """The picture in which the outline is found, and the linear amount of muscle for its values.

    In front of dark cloth this is luma. In front of another background it is luma, or the colour
    that separates the muscle where luma does not; where the muscle is the darker one, the picture
    is inverted, and the amount is that of light which it lacks.

    Args:
        rgb: picture, shape (h, w, 3).
        coarse: where the muscle is.
        tone: the camera's tone curve.

    Returns:
        The picture, shape (h, w, 3), of which luma is taken, or (h, w); and the amount for the
        values 0 to 255.

    Raises:
        NoMuscle: neither luma nor a colour has a contrast all along the outline.
    """
    if not math.isnan(coarse.eta_value):
        return rgb, amount_of_luma(tone, coarse.cloth, coarse.braid)
    inside, outside = _beside(rgb, coarse, tone)
    looks = [LUMA, *np.eye(3)]
    contrasts = [_contrast(inside @ look, outside @ look) for look in looks]
    least = np.array([abs(contrast) for contrast in contrasts])
    best = 0 if least[0] >= _LUMA_FIRST * least.max() else int(np.argmax(least))
    if least[best] < _LEAST:
        raise NoMuscle(
            "all of the muscle's outline must be brighter than its background, or all of it darker; "
            "it is not: put a dark cloth behind it",
            contrast=float(least[best]),
            limit=_LEAST,
        )
    gray = rgb[..., best - 1] if best else cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    gray = np.ascontiguousarray(gray, np.uint8)
    background, muscle = np.median(outside, axis=0), np.median(inside, axis=0)
    amount = amount_of_look(tone, background, muscle, looks[best])
    if contrasts[best] > 0:
        return gray, amount
    return cv2.bitwise_not(gray).astype(np.uint8), amount[::-1].copy()


def _beside(rgb: Image, coarse: Segmentation, tone: Tone) -> tuple[Array, Array]:
    """Linear light inside and outside of both sides of the outline, shape (n, 3) each."""
    some = slice(None, None, max(1, coarse.rows.size // _ROWS))
    rows = coarse.rows[some].astype(np.intp)[:, None]
    found: list[list[Array]] = [[], []]
    for columns, inward in ((coarse.left[some], 1), (coarse.right[some], -1)):
        for way, light in zip((inward, -inward), found, strict=True):
            at = np.rint(columns[:, None] + way * _BESIDE).astype(np.intp)
            seen = rgb[rows, np.clip(at, 0, rgb.shape[1] - 1)]
            light.append(tone.table[seen].mean(axis=1))
    return np.concatenate(found[0]), np.concatenate(found[1])


def _contrast(inside: Array, outside: Array) -> float:
    """Contrast that nine rows in ten have at least, negative where the muscle is darker; 0 if mixed."""
    relative = (inside - outside) / np.maximum(np.maximum(inside, outside), 1e-4)
    low, high = np.quantile(relative, [0.1, 0.9])
    return float(low) if low > 0 else float(high) if high < 0 else 0.0

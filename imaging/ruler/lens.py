"""What a ruler's marks show of the lens: a distortion bends their even row of places."""

import dataclasses
import math

import numpy as np

from ..arrays import Array
from ..camera.pinhole import Camera
from .choice import Strip
from .marks import Numbered, numbered

_STEP = 1e-3  # of k1, for a derivative
_ROUNDS = 3
_SEEN = 3.0  # standard errors from which a distortion is undone
_LARGEST = 0.5


def lens_of_marks(strip: Strip, camera: Camera) -> tuple[Camera, float | None]:
    """The camera with the distortion k1 that the marks show, and the standard error of k1.

    Marks at even distances on a plane ruler have px(n) = (a + b n) / (1 + c n) behind a lens that
    does not distort. k1 r^3 is not of that form: Gauss and Newton's steps find the k1 that leaves
    least over. One of less than three standard errors is taken for none.

    Args:
        strip: the marks.
        camera: whose k1 is not known; its scale may be off by some percent.

    Returns:
        The camera; None where the marks are too few, or too close to the optical axis.
    """
    k1, stderr = 0.0, math.inf
    for _ in range(_ROUNDS):
        here, there = (
            _left_over(strip, dataclasses.replace(camera, k1=k1 + step)) for step in (0.0, _STEP)
        )
        if here is None or there is None:
            return camera, None
        slope = (there - here) / _STEP
        power = float(slope @ slope)
        free = max(here.size - 4, 1)
        if not power > 0:
            return camera, None
        k1 -= float(slope @ here) / power
        if abs(k1) > _LARGEST:
            return camera, None
        stderr = math.sqrt(float(here @ here) / free / power)
    seen = abs(k1) > _SEEN * stderr
    return (dataclasses.replace(camera, k1=k1) if seen else camera), stderr


def straightened(strip: Strip, camera: Camera) -> Numbered:
    """The marks where a lens without distortion would show them."""
    if camera.k1 == 0:
        return strip.marks
    again = numbered(_shown(strip, camera), strip.marks.pitch)
    return strip.marks if again is None else again


def _shown(strip: Strip, camera: Camera) -> Array:
    """Places along the strip [px] of the marks behind a lens without distortion."""
    line, centre = strip.line, np.array(camera.centre)
    u, v = (line.origin[i] + strip.marks.place * line.along[i] for i in (0, 1))
    rays = np.stack(camera.rays(u, v), axis=1)
    return (centre + rays * camera.focal_px - line.origin) @ line.along


def _left_over(strip: Strip, camera: Camera) -> Array | None:
    """What the best projective scale leaves of the marks' places, for this lens [px]."""
    place, n = _shown(strip, camera), strip.marks.number
    x = (n - n.mean()) / max(np.ptp(n), 1)
    if n.size < 8:
        return None
    # px = (a + b n) / (1 + c n) is linear in a, b, c but for px in the last column.
    model = np.column_stack([np.ones_like(x), x, -x * place])
    fit = np.linalg.lstsq(model, place, rcond=None)[0]
    return (fit[0] + fit[1] * x) / (1 + fit[2] * x) - place

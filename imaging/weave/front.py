"""The muscle's front, unrolled: azimuth across, arc length along the meridian."""

import dataclasses

import cv2
import numpy as np

from ..arrays import Array, Image, Single
from ..camera.pinhole import Camera, turned
from ..camera.silhouette import Silhouette

BAND = 1.3
"""Azimuth to which the front is used on either side of the line of sight [rad]."""

_AROUND = 0.25  # of the radius: brightness is taken relative to the mean over so much
_STRONGEST = 0.25  # of that mean: what sparkles or is black counts no more


@dataclasses.dataclass(frozen=True)
class Unrolled:
    """The contrast of a body's surface towards the camera.

    Attributes:
        azimuth: of the columns, from the line of sight to the axis [rad], shape (m,), uniform.
        y: of the rows, as in `Silhouette` [m], shape (n,), uniform.
        arc: length along the meridian from the first row [m], shape (n,).
        radius: R at y [m], shape (n,).
        contrast: brightness over its local mean, less one, shape (n, m).
    """

    azimuth: Array
    y: Array
    arc: Array
    radius: Array
    contrast: Single


def unrolled(rgb: Image, camera: Camera, body: Silhouette, first: float, last: float) -> Unrolled:
    """The front of a body, sampled a pixel apart: perspective, roll, lens and foreshortening undone.

    The point at azimuth psi and position y is (x0 + R sin(psi'), y, d - R cos(psi')), with psi'
    from the optical axis and psi from the line of sight to the body's axis.

    Args:
        rgb: picture, shape (h, w, 3).
        camera: the camera.
        body: the body of revolution behind the outline.
        first: position y at which it begins [m].
        last: position y at which it ends [m].
    """
    px = 1 / camera.px_per_m
    y = np.asarray(first + np.arange(int((last - first) / px) + 1) * px, float)
    radius = body.radius_at(y)
    rise = np.diff(radius)
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(rise, px))])
    half = max(8, round(BAND * float(radius.mean()) / px))
    azimuth = np.linspace(-BAND, BAND, 2 * half + 1)
    turn = azimuth - np.arctan2(body.x0, camera.distance)
    X = body.x0 + radius[:, None] * np.sin(turn)
    Z = camera.distance - radius[:, None] * np.cos(turn)
    u, v = camera.pixels(*turned(X, y[:, None], body.roll), Z)
    u0, v0 = max(int(u.min()) - 2, 0), max(int(v.min()) - 2, 0)
    part = rgb[v0 : int(v.max()) + 3, u0 : int(u.max()) + 3]
    luma = cv2.cvtColor(part, cv2.COLOR_RGB2GRAY)
    at = (u - u0).astype(np.float32), (v - v0).astype(np.float32)
    surface = cv2.remap(luma, *at, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    surface = np.asarray(surface, np.float32)
    around = max(1.0, _AROUND * float(radius.mean()) / px)
    mean = cv2.GaussianBlur(surface, (0, 0), around, borderType=cv2.BORDER_REFLECT)
    contrast = surface / np.maximum(np.asarray(mean, np.float32), 1.0) - 1
    contrast = np.clip(contrast, -_STRONGEST, _STRONGEST).astype(np.float32)
    return Unrolled(azimuth, y, arc, radius, contrast)

"""What a lens does to light: blur, defocus, halo and motion, each a convolution."""

import numpy as np
from numpy.typing import NDArray

from .scene import Lens


def through_lens(light: NDArray[np.floating], lens: Lens) -> NDArray[np.floating]:
    """Light behind the lens: each of its faults a convolution, the picture's border mirrored."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    seen = np.asarray(light, np.float32)
    if lens.motion_px > 0:
        seen = cv2.filter2D(seen, -1, _box(lens.motion_px)[:, None])
    if lens.defocus_px > 0:
        seen = cv2.filter2D(seen, -1, _disk(lens.defocus_px))
    if lens.blur_px > 0:
        seen = cv2.GaussianBlur(seen, (0, 0), lens.blur_px)
    if lens.halo > 0:
        glow = cv2.GaussianBlur(seen, (0, 0), lens.halo_px)
        seen = (1 - lens.halo) * seen + lens.halo * glow
    return np.asarray(seen, np.float32)


def _box(width: float) -> NDArray[np.floating]:
    """A box of any width [px], sampled by the part of each pixel that it covers."""
    reach = int(np.ceil(width / 2 + 0.5))
    k = np.arange(-reach, reach + 1)
    part = np.clip(width / 2 + 0.5 - np.abs(k), 0, 1)
    return (part / part.sum()).astype(np.float32)


def _disk(radius: float) -> NDArray[np.floating]:
    """A disk of any radius [px], sampled by the part of each pixel that it covers."""
    reach = int(np.ceil(radius + 0.5))
    fine = (np.arange(16 * (2 * reach + 1)) + 0.5) / 16 - reach - 0.5
    inside = np.hypot(fine[:, None], fine[None, :]) <= radius
    part = inside.reshape(2 * reach + 1, 16, 2 * reach + 1, 16).mean(axis=(1, 3))
    return (part / part.sum()).astype(np.float32)

"""Windows of samples across one side of a muscle, in rows at first and then along normals."""

import dataclasses

import cv2
import numpy as np
from scipy.ndimage import grey_opening, median_filter, percentile_filter

from ..arrays import Array, Image, Single
from ..errors import NoMuscle
from .edge_fit import best_shift
from .edge_model import step
from .smoother import smooth_robustly

_AVERAGED_ROWS = 21  # along the edge, before an edge is fitted
_FIRST_BLUR = 1.2  # px, of the step that gives the first curve
_FIRST_REACH = 10  # px by which the coarse outline may be off
_COARSE_MEDIAN = 15  # rows
_DENT = 0.6  # of the radius, along the axis: the longest dent that dark threads make
_DARK_THREAD = 0.22  # of the brightness around, below which a thread's edge is not seen
_AROUND = 1.5  # of the radius, along the axis, over which that brightness is taken
_LEAST_SEEN = 0.2  # of the averaged rows, below which they give no edge


@dataclasses.dataclass(frozen=True)
class Samples:
    """Windows across one side, aligned to a curve, and the mean of neighbouring ones.

    Attributes:
        inward: +1 on the left side, -1 on the right.
        curve: columns to which they are aligned, shape (n,).
        stretch: columns per pixel along the normal, shape (n,).
        mean: windows averaged along the edge, shape (n, k).
        weight: part of the averaged rows in which the edge shows, shape (n,).
        height: brightness of each just inside the edge, by which `mean` is divided, shape (n,).
        profile: mean of all, shape (k,).
    """

    inward: int
    curve: Array
    stretch: Array
    mean: Single
    weight: Single
    height: Single
    profile: Array

    @property
    def light(self) -> Array:
        """Mean of all as bright as they are, shape (k,)."""
        total = max(float(self.weight.sum()), 1.0)
        return (self.weight * self.height @ self.mean / total).astype(np.float64)


def first_curve(luma: Image, coarse: Array, inward: int, resolution: float, radius: float) -> Array:
    """The outline to half a pixel: a step in the encoded values, in which a dark limb still shows."""
    start = np.round(_without_dents(coarse, inward, radius)).astype(np.int64)
    reach = min(_FIRST_REACH, round(0.3 * radius))
    offset = np.arange(-reach - 6, reach + 5)
    n, width = luma.shape
    column = np.clip(start[:, None] + inward * offset, 0, width - 1)
    windows = luma.ravel().take(column + width * np.arange(n)[:, None]).astype(np.float32)
    windows = _along_edge(windows, 5)
    shift = best_shift(windows, offset.astype(float), lambda t: step(t, _FIRST_BLUR), reach, 0.5)
    curve, keep = smooth_robustly(start + inward * shift, resolution)
    if keep.mean() < 0.5:
        raise NoMuscle("an edge must be seen along the whole muscle", rows_found=float(keep.mean()))
    return curve


def _without_dents(coarse: Array, inward: int, radius: float) -> Array:
    """The coarse outline without the dents that dark threads make, and without single specks."""
    size = max(5, round(_DENT * radius))
    smooth = median_filter(coarse, _COARSE_MEDIAN, mode="nearest")
    # Continued by its own point reflection, an end that slopes inward is not taken for a dent.
    pad = min(size, smooth.size - 1)
    longer = np.pad(inward * smooth, pad, mode="reflect", reflect_type="odd")
    return inward * np.asarray(grey_opening(longer, size), float)[pad:-pad]


def aligned_windows(
    light: Single, curve: Array, inward: int, t: Array, radius: float, spacing: int = 1
) -> Samples:
    """Windows along the normal by Catmull-Rom interpolation in each row of the picture `light`.

    Its rows may be thinned out, `spacing` px apart.
    """
    stretch = np.hypot(1, np.gradient(curve, spacing))
    n, width = light.shape
    at = curve.astype(np.float32)[:, None] + np.outer(stretch, inward * t).astype(np.float32)
    whole = at.astype(np.intp)
    f = at - whole.astype(np.float32)
    first = np.clip(whole - 1, 0, width - 4) + width * np.arange(n)[:, None]
    flat = light.ravel()
    before, here, after, last = (flat[k:].take(first) for k in range(4))
    # Catmull-Rom: exact for parabolas, unlike OpenCV's bicubic.
    rise, drop = after - before, here - after
    windows = 3 * drop + last - before
    windows = ((windows * (f - 1) - 2 * drop - rise) * f + rise) * (0.5 * f) + here
    seen = _seen(windows[:, (t > 1) & (t < 5)].mean(axis=1), radius / spacing)
    averaged = _AVERAGED_ROWS // spacing | 1
    weight = _along_edge(seen[:, None], averaged)[:, 0]
    windows *= seen[:, None]
    windows = _along_edge(windows, averaged)
    windows /= np.maximum(weight, 1e-3)[:, None]
    weight[weight < _LEAST_SEEN] = 0
    # Faint threads at the limb count as much as bright ones, or the mean edge would be the bright's.
    height = windows[:, (t > 1) & (t < 5)].mean(axis=1)
    height = np.maximum(height, 0.3 * np.median(height))
    windows /= height[:, None]
    profile = (weight @ windows / max(float(weight.sum()), 1.0)).astype(np.float64)
    return Samples(inward, curve, stretch, windows, weight, height, profile)


def _along_edge(windows: Single, rows: int) -> Single:
    """Means of so many neighbouring rows; shape (n, k)."""
    means = cv2.blur(windows, (1, rows), borderType=cv2.BORDER_REFLECT_101)
    return np.asarray(means, np.float32).reshape(windows.shape)


def _seen(height: Single, radius: float) -> Single:
    """1 in rows whose limb is lit, 0 where a black thread hides it; shape (n,)."""
    every = 8
    around = max(3, round(_AROUND * radius / every))
    level = percentile_filter(height[::every], 70, around, mode="nearest")
    level = np.interp(np.arange(height.size), np.arange(0, height.size, every), level)
    return (height > _DARK_THREAD * level).astype(np.float32)

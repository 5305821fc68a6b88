"""Segment a picture into cloth, braid and tape, and find a coarse outline."""

import dataclasses
import math
from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_fill_holes
from skimage.filters.thresholding import threshold_otsu

from . import errors
from .camera import LUMA, Array, Flags, Image, Indices, Single, Tone, amount_of_luma

Mask = Image


def above(image: Image, level: float) -> Mask:
    """Return the mask of pixels brighter than a level."""
    return np.where(image > level, 255, 0).astype(np.uint8)


def shaped(mask: Mask, operation: int, size: int) -> Mask:
    """Apply one of OpenCV's morphological operations to a mask, with a square of `size` px."""
    return np.asarray(cv2.morphologyEx(mask, operation, np.ones((size, size), np.uint8)), np.uint8)


def parts(mask: Mask) -> tuple[NDArray[np.int32], Indices]:
    """Return the labels of the connected parts, 0 outside, and the number of pixels in each part."""
    _, labels, found, _ = cv2.connectedComponentsWithStats(mask)
    found[0, cv2.CC_STAT_AREA] = 0
    return np.asarray(labels, np.int32), np.asarray(found[:, cv2.CC_STAT_AREA], np.int64)


def chosen(labels: NDArray[np.int32], numbers: NDArray[np.integer] | int) -> Mask:
    """Return the mask of the parts with these labels."""
    return np.where(np.isin(labels, numbers), 255, 0).astype(np.uint8)


def largest(mask: Mask) -> tuple[Mask, int]:
    """Return the largest part of a mask, with gaps under 5 px closed, and its number of pixels."""
    labels, area = parts(shaped(mask, cv2.MORPH_CLOSE, 5))
    return chosen(labels, int(np.argmax(area))), int(area.max())


def sampled(image: Image, mask: Mask, n: int) -> Image:
    """Return about n of the pixels inside a mask, on a regular grid, or all if there are fewer."""
    every = max(1, int(np.sqrt(cv2.countNonZero(mask) / n)))
    return image[::every, ::every][mask[::every, ::every] > 0]


class Split(NamedTuple):
    """A histogram of 8-bit values split into two classes.

    Attributes:
        level: largest value of the lower class.
        eta: between-class variance divided by total variance, 0 to 1; 0.64 for one normal distribution.
        low, high: means of the classes.
    """

    level: int
    eta: float
    low: float
    high: float


def otsu_split(values: Image) -> Split:
    """Split 8-bit values at Otsu's level, and compute the separability of the two classes.

    eta(k) = w0 w1 (m1 - m0)^2 / sigma^2. The level is computed by scikit-image.

    Args:
        values: any shape.

    Returns:
        The split; eta is zero if all values are equal.

    References:
        Otsu 1979, IEEE Trans. Syst. Man Cybern. 9, equations 14 to 16.

    >>> split = otsu_split(np.repeat(np.arange(7, dtype=np.uint8), [5, 9, 1, 0, 2, 7, 3]))
    >>> print(split.level, round(split.eta, 4), round(split.low, 4), round(split.high, 4))
    2 0.9276 0.7333 5.0833
    """
    counts = cv2.calcHist([values], [0], None, [256], [0, 256]).ravel().astype(np.float64)
    p, bins = counts / counts.sum(), np.arange(256)
    mean = float(p @ bins)
    spread = float(p @ (bins - mean) ** 2)
    if spread == 0:
        return Split(int(np.argmax(p)), 0.0, mean, mean)
    level = int(threshold_otsu(hist=(p, bins)))
    below = slice(None, level + 1)
    share = 1 - float(p[below].sum())
    low = float(p[below] @ bins[below]) / (1 - share)
    high = (mean - low * (1 - share)) / share
    return Split(level, share * (1 - share) * (high - low) ** 2 / spread, low, high)


LEAST_CONTRAST = 30  # levels between cloth and muscle
LEAST_AREA = 0.002  # of the picture
TWO_CLASSES = 0.75  # eta of two separate classes; one normal distribution has 0.64
_DARK = 40  # an under-exposed muscle has a smaller mean level
_SHADE = 0.15  # level of the shaded side, as a fraction of the difference between cloth and muscle


_CLOTH = "put a dark cloth behind the muscle"
_WHOLE = "the whole muscle must be in the picture, clear of its border: move the camera or widen the crop"


class MuscleMask(NamedTuple):
    """Masks of the muscle with its tapes.

    Attributes:
        lit: well-lit part, 255 inside, shape (h, w).
        whole: the well-lit part, the shaded side, and rods with glare, 255 inside, shape (h, w).
        eta: separability of muscle and cloth, 0 to 1; nan if the muscle was not found by its brightness.
    """

    lit: Mask
    whole: Mask
    eta: float


def muscle_mask(rgb: Image) -> MuscleMask:
    """Find the largest object that is brighter or more strongly coloured than the cloth.

    The brightest of the three colours is split at Otsu's level. The difference between the brightest and
    the darkest is also split if it has two classes, because a dark blue tape is no brighter than the cloth.

    Raises:
        NoMuscle: no connected object stands out from the cloth.
        Underexposed: the object is too dark.
    """
    red, green, blue = cv2.split(rgb)
    value = np.asarray(cv2.max(cv2.max(red, green), blue), np.uint8)
    least = cv2.min(cv2.min(red, green), blue)
    strength = np.asarray(cv2.subtract(value, least), np.uint8)
    by_value, by_strength = otsu_split(value), otsu_split(strength)
    lit = above(value, by_value.level)
    if by_strength.eta > TWO_CLASSES and by_strength.high - by_strength.low > LEAST_CONTRAST:
        lit = lit | above(strength, by_strength.level)
    lit = shaped(lit, cv2.MORPH_OPEN, 3)
    found, area = largest(lit)
    enough, figures = area >= LEAST_AREA * value.size, by_value._asdict()
    if enough and by_value.high < _DARK and by_value.eta > TWO_CLASSES:
        raise errors.Underexposed(
            "the muscle is too dark: use a longer exposure or more light", **figures
        )
    if not enough or by_value.high - by_value.low < LEAST_CONTRAST:
        raise errors.NoMuscle(
            "the muscle must be one object, distinct from the cloth: check that it is visible and lit",
            **figures,
        )
    lit = lit & found
    return MuscleMask(lit, _with_shaded_side(lit, value, by_value), by_value.eta)


def _with_shaded_side(lit: Mask, value: Image, split: Split) -> Mask:
    """Extend the lit part of the muscle to adjacent pixels that are brighter than the cloth."""
    cloth = value[shaped(lit, cv2.MORPH_DILATE, 9) == 0]
    if cloth.size == 0:
        return lit
    low, high = map(float, np.quantile(cloth, [0.5, 0.98], method="inverted_cdf"))
    level = max(low + _SHADE * (split.high - low), high + 4)
    shade = shaped(above(value, min(level, split.level)), cv2.MORPH_OPEN, 3)
    labels, _ = parts(lit | shade)
    return chosen(labels, labels[::2, ::2][lit[::2, ::2] > 0])


_BORDER = 1 / 60  # width of the border, relative to that of the picture
_ALONG = 1 / 30  # smoothing length of the border's colour, relative to the height
_DIM = 0.3  # of the muscle's median brightness; darker pixels are rods or black threads
_STREAK = 0.12  # of the muscle's width; glare on a rod is narrower
_TOUCHES = 0.03  # fraction of the rows in which a muscle may reach the border
_ROUNDS = 2  # GrabCut iterations
_LEAST = 12.0  # levels between muscle and border


def mask_against_border(rgb: Image) -> MuscleMask:
    """Find the largest object that differs from the left and right borders of its rows, using GrabCut.

    The background of a row is assumed to have the colour of the left border, that of the right border, or a
    colour interpolated between them. This covers two adjacent cloths and a wall in uneven light.

    Args:
        rgb: picture, shape (h, w, 3).

    References:
        Rother, Kolmogorov and Blake 2004, "GrabCut".

    Raises:
        NoMuscle: no connected object differs from the background.
        Clipped: the object reaches the left or right border.
    """
    off = _distance(rgb)
    value = np.asarray(np.clip(off, 0, 255), np.uint8)
    split = otsu_split(value)
    sure = shaped(above(value, max(split.level, _LEAST)), cv2.MORPH_OPEN, 5)
    if split.high - split.low < _LEAST or np.count_nonzero(sure) < LEAST_AREA * value.size:
        raise errors.NoMuscle(
            f"no object can be distinguished from the background: {_CLOTH}", **split._asdict()
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
    found = _filled(largest(shaped(inside, cv2.MORPH_OPEN, 3))[0])
    if (part := max((found[:, k] > 0).mean() for k in (width, -width - 1))) > _TOUCHES:
        raise errors.Clipped(_WHOLE, part_of_rows=float(part))
    brightest = np.asarray(rgb.max(axis=2), np.uint8)
    lit = found & above(brightest, _DIM * float(np.median(brightest[found > 0])))
    return MuscleMask(lit & _without_streaks(lit), found, math.nan)


def _border(width: int) -> int:
    return max(3, round(_BORDER * width))


def _without_streaks(lit: Mask) -> Mask:
    """Remove narrow streaks of glare on rods from a mask, after filling black threads."""
    size = max(3, round(_STREAK * float((lit > 0).sum(axis=1).max())))
    return shaped(_filled(shaped(lit, cv2.MORPH_CLOSE, 5)), cv2.MORPH_OPEN, size)


def _distance(rgb: Image) -> Single:
    """Return the colour difference between each pixel and the background of its row, shape (h, w)."""
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
    """Fill the holes in a mask."""
    return np.where(np.asarray(binary_fill_holes(mask)), 255, 0).astype(np.uint8)


_LEAST_CHROMA = 0.01  # of chromaticity; rendered grey has at most 0.006, tan on tan 0.018
_COLOURS = 4000  # pixels used for classes and median colours
_FEWEST = 50  # pixels of a class


def split_by_colour(rgb: Image, muscle: Mask) -> tuple[Mask, float]:
    """Separate the pixels of the tapes from those of the braid, assuming that the tapes cover less area.

    Chromaticity c = (R, G, B) / (R + G + B) is independent of the strength of the light. It is split into
    two classes by Otsu's method along its first principal axis, and again along the line between the means
    of these classes. A fitting or a hose may have a third colour: if the tape class contains two
    colours, one after the other along the muscle, the outer one is removed. White braids and red tapes
    need no special treatment, because no hue is computed.

    Args:
        rgb: picture, shape (h, w, 3).
        muscle: > 0 on the muscle, shape (h, w).

    Returns:
        mask: 255 on the tape, shape (h, w).
        eta: separability of the two colours, 0 to 1.
    """
    sample = sampled(rgb, muscle, _COLOURS).astype(np.float32)
    along, level, eta = _two_colours(sample)
    upper = _chromaticity(sample) @ along > level
    if eta == 0:
        return np.zeros_like(muscle), 0.0
    take_upper = bool(np.count_nonzero(upper) <= upper.size / 2)
    mask = np.where((_beyond(rgb, along, level) == take_upper) & (muscle > 0), 255, 0)
    return _without_fittings(rgb, mask.astype(np.uint8), muscle), eta


def _two_colours(sample: NDArray[np.floating]) -> tuple[NDArray[np.floating], float, float]:
    """Return the direction and level in chromaticity that separate two classes, and the separability."""
    colour = _chromaticity(sample)
    along, nothing = np.linalg.eigh(np.cov(colour.T))[1][:, -1], (np.ones(3), 1.0, 0.0)
    for last in (False, True):
        level, eta = _cut(colour @ along)
        upper = colour @ along > level
        if upper.all() or not upper.any():
            return nothing
        if not last:
            along = colour[upper].mean(axis=0) - colour[~upper].mean(axis=0)
            if np.linalg.norm(along - along.mean()) < _LEAST_CHROMA:
                return nothing
    return along, level, eta


def _chromaticity(colours: NDArray[np.floating]) -> NDArray[np.floating]:
    return colours / (colours @ np.ones((3, 1), np.float32) + 1)


def _beyond(rgb: Image, along: NDArray[np.floating], level: float) -> Flags:
    """Return True where the chromaticity exceeds a level."""
    # Multiplied by R + G + B + 1, along . c > level is a linear form of the picture.
    form = np.array([[*(along - level), -level]], np.float32)
    return np.asarray(cv2.transform(rgb.astype(np.float32), form)).reshape(rgb.shape[:2]) > 0


def _without_fittings(rgb: Image, mask: Mask, muscle: Mask) -> Mask:
    """Remove colours that lie beyond the tapes, such as those of a fitting or a hose.

    The pixels in `mask` are split into three colours, such as tape, gloss on the tape and a grey fitting.
    A colour is removed if, along the muscle, it begins where the others end.
    """
    braid, at = (np.argwhere(each) for each in ((muscle > 0) & (mask == 0), mask > 0))
    if min(len(braid), len(at)) < _FEWEST:
        return mask
    at = at[:: max(1, len(at) // _COLOURS)]
    colours = _chromaticity(rgb[at[:, 0], at[:, 1]].astype(np.float32))
    cv2.setRNGSeed(0)
    _, label, centres = cv2.kmeans(colours, 3, np.empty(0), (3, 20, 1e-4), 2, cv2.KMEANS_PP_CENTERS)
    axis = np.linalg.eigh(np.cov(braid.T))[1][:, -1]
    far, label = np.abs((at - braid.mean(axis=0)) @ axis), np.ravel(label)
    order = np.argsort([np.median(far[label == k]) for k in range(3)])
    for kept in (order[:1], order[:2]):
        inner = np.isin(label, kept)
        if not 1 > inner.mean() > _LEAST_TAPE:
            continue
        if np.quantile(far[inner], 0.9) < np.quantile(far[~inner], 0.25):
            v, u = np.nonzero(mask)
            colour = _chromaticity(rgb[v, u].astype(np.float32))
            nearest = np.linalg.norm(colour[:, None] - centres, axis=2).argmin(axis=1)
            mask = mask.copy()
            mask[v, u] = np.where(np.isin(nearest, kept), 255, 0)
            return mask
    return mask


def _cut(values: NDArray[np.floating]) -> tuple[float, float]:
    """Return the level between two classes of values, and their separability.

    The level is the same number of standard deviations of each class from its mean. Otsu's level is midway
    between the means and would cut into the wider class, such as that of a glossy tape.
    """
    low, high = np.percentile(values, [0.2, 99.8])
    if not high > low:
        return float(high), 0.0
    place = np.clip((values - low) * (256 / (high - low)), 0, 255).astype(np.uint8)
    split = otsu_split(place)
    upper = place > split.level
    if upper.all() or not upper.any():
        return float(high), 0.0
    (m0, s0), (m1, s1) = ((part.mean(), part.std()) for part in (values[~upper], values[upper]))
    level = (m0 * s1 + m1 * s0) / (s0 + s1) if s0 + s1 > 0 else (m0 + m1) / 2
    return float(level), split.eta


_GAP = 0.4  # largest gap in one tape, relative to the square root of half the coloured area
_LEAST_TAPE = 0.2  # of the larger tape's area


class Patch(NamedTuple):
    """The pixels of one tape.

    Attributes:
        x, y: first column and row of the bounding box.
        mask: pixels of the tape in the box, shape (h, w).
    """

    x: int
    y: int
    mask: Flags

    @property
    def centre(self) -> tuple[float, float]:
        """Centre of the box, u and v."""
        h, w = self.mask.shape
        return self.x + w / 2, self.y + h / 2


def two_tapes(coloured: Mask, muscle: Mask, eta: float) -> tuple[Patch, Patch]:
    """Return the two tapes: the upper one first, or the left one if they are at the same height.

    Parts separated by a streak of gloss are joined. Parts with less than a fifth of the pixels of the
    largest part are ignored.

    Args:
        coloured: pixels of the tape's colour, shape (h, w).
        muscle: pixels of the muscle.
        eta: separability of the two colours.

    Raises:
        AmbiguousHue, MissingFitting, ExtraFitting, Clipped: there are not two complete tapes.
    """

    def patch(number: int) -> Patch:
        mask = labels == number
        x, y, w, h = cv2.boundingRect(mask.view(np.uint8))
        return Patch(x, y, mask[y : y + h, x : x + w])

    coloured = shaped(coloured, cv2.MORPH_OPEN, 3)
    half = np.count_nonzero(coloured) / 2
    labels, _ = parts(shaped(coloured, cv2.MORPH_CLOSE, int(max(5, _GAP * np.sqrt(half))) | 1))
    labels[coloured == 0] = 0
    area = np.bincount(labels.ravel())
    area[0] = 0
    numbers = np.flatnonzero((area > 0) & (area >= _LEAST_TAPE * area.max()))
    n = int(numbers.size)
    clipped = any(line.any() for line in (muscle[0], muscle[-1], muscle[:, 0], muscle[:, -1]))
    for holds, error, text in (
        (n < 2 and clipped, errors.Clipped, f"both tapes must be visible, and {_WHOLE}"),
        (n == 0 or (n != 2 and eta < TWO_CLASSES), errors.AmbiguousHue,
         "the tapes must differ in colour from the braid: use tape of a different colour"),
        (n == 1, errors.MissingFitting,
         "two tapes must be visible, but only one is: the other may be covered, dark or colourless"),
        (n > 2, errors.ExtraFitting,
         "exactly two tapes must be visible: remove other objects of the same colour, or crop the picture"),
    ):  # fmt: skip
        if holds:
            raise error(text, tapes=n, eta_hue=eta)
    upper, lower = sorted(map(patch, numbers.tolist()), key=lambda patch: patch.centre[1])
    for x, y, (h, w) in ((each.x, each.y, each.mask.shape) for each in (upper, lower)):
        if min(x, y) == 0 or x + w == muscle.shape[1] or y + h == muscle.shape[0]:
            raise errors.Clipped(_WHOLE, tapes=n)
    return upper, lower


_SEPARATE = 0.7  # smallest eta of brightness of a dark and uniform background
_COARSE_PIXELS = 0.35e6  # approximate size of the thinned picture for the first pass
_FINE_STEP = 4
_FEWEST_ROWS = 48
_GUARD = 2  # pixels next to a tape that its blur may affect
_MARGIN = 40  # pixels of cloth kept around the muscle


class TapeBand(NamedTuple):
    """One tape in the picture [px].

    Attributes:
        box: top, bottom, left and right of the bounding box.
        inner: coefficients of the inner edge, v = polynomial in u, highest power first, shape (3,).
        limbs: rows of the inner edge at its left and right end.
    """

    box: tuple[float, float, float, float]
    inner: Array
    limbs: tuple[float, float]

    @property
    def middle(self) -> float:
        """Column in the middle of the box."""
        return (self.box[2] + self.box[3]) / 2

    def moved(self, step: int, v0: int, u0: int) -> "TapeBand":
        """Return the tape in pixel coordinates of the whole picture, v = step p((u - u0) / step) + v0."""
        a, b, c = self.inner
        inner = a / step, b - 2 * a * u0 / step, a * u0**2 / step - b * u0 + c * step + v0
        first, last, top, bottom = (row * step + v0 for row in (*self.limbs, *self.box[:2]))
        left, right = (column * step + u0 for column in self.box[2:])
        return TapeBand((top, bottom, left, right), np.array(inner), (first, last))


@dataclasses.dataclass(frozen=True)
class Segmentation:
    """Outline and tapes of a muscle, to within a few pixels.

    Attributes:
        rows: rows between the tapes, shape (n,).
        left, right: columns of the outermost muscle pixels in these rows, shape (n,).
        upper, lower: tapes.
        cloth, braid, tape: median colours, 0 to 255, shape (3,).
        eta_value, eta_hue: separability of muscle and cloth, and of tape and braid, 0 to 1. The first is
            nan if the muscle was not found by its brightness.
        saturated: fraction of the muscle's pixels in which any colour is 254 or more.
    """

    rows: Indices
    left: Array
    right: Array
    upper: TapeBand
    lower: TapeBand
    cloth: Array
    braid: Array
    tape: Array
    eta_value: float
    eta_hue: float
    saturated: float


def segment(rgb: Image) -> Segmentation:
    """Find the coarse outline of an upright muscle and its two tapes.

    `muscle_mask` separates the muscle from a dark cloth. If it finds no muscle with two tapes, or if
    muscle and cloth are poorly separated, `mask_against_border` is tried. `split_by_colour` separates the
    tapes from the braid. Large pictures are segmented in two passes: a coarse one that finds the position,
    and a finer one that uses every fourth pixel.

    Args:
        rgb: picture, shape (h, w, 3).

    Raises:
        ImagingError: one of NoMuscle, Underexposed, AmbiguousHue, MissingFitting, ExtraFitting,
            Clipped, WrongOrientation; see these classes.
    """
    found = None
    try:
        found = _segmented(rgb, muscle_mask)
        if found.eta_value >= _SEPARATE:
            return found
    except (errors.Underexposed, errors.WrongOrientation):
        raise
    except errors.ImagingError:
        pass
    try:
        return _segmented(rgb, mask_against_border)
    except errors.ImagingError:
        if found is not None:
            return found
        raise


def _segmented(rgb: Image, mask_by: Callable[[Image], MuscleMask]) -> Segmentation:
    step = max(1, round(np.sqrt(rgb.shape[0] * rgb.shape[1] / _COARSE_PIXELS)))
    # With a step of 3, the first pass would be finer than the second pass of a large picture.
    step = _FINE_STEP if step == _FINE_STEP - 1 else step
    v0, u0, part = 0, 0, rgb
    while True:
        h, w = part.shape[0] // step, part.shape[1] // step
        even = part[: h * step, : w * step]
        small = np.asarray(cv2.resize(even, (w, h), interpolation=cv2.INTER_NEAREST), np.uint8)
        soft = np.asarray(cv2.blur(small, (3, 3)), np.uint8)
        muscle = mask_by(soft)
        coloured, eta_hue = split_by_colour(soft, muscle.lit)
        patches = two_tapes(coloured, muscle.lit, eta_hue)
        across, along = np.abs(np.subtract(patches[0].centre, patches[1].centre))
        if part is rgb and across > along:
            raise errors.WrongOrientation(
                'the muscle must be upright: turn the camera, or set the orientation to "auto"',
                across_px=float(across * step),
            )
        if step <= _FINE_STEP:
            break
        # Crop to both tapes and the muscle between them, with a margin of cloth.
        top, bottom = patches[0].y, patches[1].y + patches[1].mask.shape[0]
        columns = np.flatnonzero(muscle.whole[top:bottom].any(axis=0))
        margin = [-_MARGIN, _MARGIN]
        v0, v1 = np.clip(np.array([top, bottom]) * step + margin, 0, rgb.shape[0]).tolist()
        u0, u1 = np.clip(columns[[0, -1]] * step + margin, 0, rgb.shape[1]).tolist()
        part, step = rgb[v0:v1, u0:u1], _FINE_STEP
    upper, lower = _tape(patches[0], lower=False), _tape(patches[1], lower=True)
    first, last = max(upper.limbs), min(lower.limbs)
    rows = np.arange(
        int(np.ceil(first * step)) + step + _GUARD, int(last * step) - step - _GUARD + 1
    )
    first, last = int(np.ceil(first)), int(last)
    if rows.size < _FEWEST_ROWS or last - first < _FEWEST_ROWS // step:
        raise errors.MissingFitting(
            f"at least {_FEWEST_ROWS} rows of braid must be visible between the tapes; got {rows.size}"
        )
    band = muscle.whole[first : last + 1] > 0
    left = np.argmax(band, axis=1)
    right = band.shape[1] - 1 - np.argmax(band[:, ::-1], axis=1)
    if left.min() == 0 or right.max() == band.shape[1] - 1:
        raise errors.Clipped(f"{_WHOLE}, or {_CLOTH}", left_px=int(left.min() * step))
    at = np.arange(first, last + 1) * step
    body = shaped(muscle.lit, cv2.MORPH_ERODE, 5)
    inside = np.zeros_like(body)
    inside[first : last + 1] = body[first : last + 1]
    cloth = ~shaped(muscle.whole, cv2.MORPH_DILATE, 9)
    cloth, braid, tape = (
        sampled(small, mask, _COLOURS) for mask in (cloth, inside, coloured & body)
    )
    if min(cloth.size, braid.size, tape.size) == 0:
        raise errors.NoMuscle(
            "cloth, braid and tapes must all be visible, but one of them has no pixels"
        )
    return Segmentation(
        rows=rows + v0, left=np.interp(rows, at, left * step) + u0,
        right=np.interp(rows, at, right * step) + u0, upper=upper.moved(step, v0, u0),
        lower=lower.moved(step, v0, u0), cloth=np.median(cloth, axis=0),
        braid=np.median(braid, axis=0), tape=np.median(tape, axis=0), eta_value=muscle.eta,
        eta_hue=eta_hue, saturated=float(np.mean(braid.max(axis=1) >= 254)),
    )  # fmt: skip


def _tape(found: Patch, *, lower: bool) -> TapeBand:
    x, y, patch = found.x, found.y, found.mask
    h, w = patch.shape
    edge = y + (np.argmax(patch, axis=0) if lower else h - 1 - np.argmax(patch[::-1], axis=0))
    columns = np.arange(x, x + w)
    middle = slice(w // 8, w - w // 8)
    u, v = columns[middle].astype(float), edge[middle].astype(float)
    keep = np.abs(v - np.median(v)) <= max(4.0, 0.15 * np.ptp(u))
    off = np.abs(v - np.polyval(np.polyfit(u[keep], v[keep], 2), u))
    keep &= off <= max(2.0, 3 * float(np.median(off[keep])))
    inner = np.polyfit(u[keep], v[keep], 2)
    limbs = np.polyval(inner, np.array([x, x + w - 1.0]))
    return TapeBand((y, y + h, x, x + w), inner, (float(limbs[0]), float(limbs[1])))


_BESIDE = np.arange(6, 17)  # distances to both sides of the coarse outline [px]
_ROWS = 400  # rows sampled
_CONTRAST = 0.12  # smallest contrast of nine rows in ten, relative to the brighter side
_ONE_SIDED = 1.3  # of the braid's light


def edge_light(rgb: Image, coarse: Segmentation, tone: Tone) -> tuple[Image, Single]:
    """Return the picture in which to locate the outline, and the amount of muscle for each luma value.

    If the muscle is darker than the background, the picture is inverted.

    Args:
        rgb: picture, shape (h, w, 3).
        coarse: coarse outline of the muscle.
        tone: tone curve of the camera.

    Returns:
        The picture, RGB or shape (h, w), and the linear amount of muscle for the values 0 to 255.

    Raises:
        NoMuscle: the contrast along the outline is too low.
    """
    inside, outside = _beside(rgb, coarse, tone)
    if not math.isnan(coarse.eta_value):
        dark, braid = map(tone.light, (coarse.cloth, coarse.braid))
        brighter = max((np.median(one, axis=0) for one in np.array_split(inside, 2)), key=LUMA.dot)
        # If one side is in bright light, its limb is brighter than glare on other threads.
        braid = brighter if brighter @ LUMA > _ONE_SIDED * (braid @ LUMA) else braid
        return rgb, amount_of_luma(tone, dark, braid)
    one, other = inside @ LUMA, outside @ LUMA
    relative = (one - other) / np.maximum(np.maximum(one, other), 1e-4)
    low, high = np.quantile(relative, [0.1, 0.9])
    contrast = float(low if low > 0 else high if high < 0 else 0.0)
    if abs(contrast) < _CONTRAST:
        raise errors.NoMuscle(
            f"the whole outline must be either brighter or darker than the background: {_CLOTH}",
            contrast=abs(contrast),
        )
    amount = amount_of_luma(tone, np.median(outside, axis=0), np.median(inside, axis=0))
    if contrast > 0:
        return rgb, amount
    gray = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    return cv2.bitwise_not(gray).astype(np.uint8), amount[::-1].copy()


def _beside(rgb: Image, coarse: Segmentation, tone: Tone) -> tuple[Array, Array]:
    """Return the linear light inside and outside the outline, from both sides, shape (n, 3) each."""
    some = slice(None, None, max(1, coarse.rows.size // _ROWS))
    rows = coarse.rows[some].astype(np.intp)[:, None]
    found: list[list[Array]] = [[], []]
    for columns, inward in ((coarse.left[some], 1), (coarse.right[some], -1)):
        for way, light in zip((inward, -inward), found, strict=True):
            at = np.rint(columns[:, None] + way * _BESIDE).astype(np.intp)
            seen = rgb[rows, np.clip(at, 0, rgb.shape[1] - 1)]
            light.append(tone.table[seen].mean(axis=1))
    return np.concatenate(found[0]), np.concatenate(found[1])

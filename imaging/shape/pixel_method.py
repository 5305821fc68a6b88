"""The reference work's own method, at pixel level: HSV, two thresholds, boundaries."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Image, Indices
from ..errors import AmbiguousHue, Clipped, ExtraFitting, MissingFitting, NoMuscle
from ..quality import Quality
from ..recipe import Recipe
from ..segment.otsu import counts_of, otsu_split
from ..segment.tape_colour import hues_apart
from .measurement import Measurement, MeasurementErrors, Trace
from .photograph import Photograph

_LEAST_CONTRAST = 30
_LEAST_AREA = 0.002
_LEAST_STRENGTH = 60  # saturation of 255 below which a hue is noise
_LEAST_FITTING = 0.2  # of the larger fitting's area
_TWO_CLASSES = 0.75
_HUES = 256
_PIXEL_STDERR = 12**-0.5  # px, of a boundary that is known to a whole pixel


def measure_pixels(photo: Photograph, recipe: Recipe) -> Measurement:
    """The muscle's shape by the reference work's steps, to a whole pixel.

    Otsu's threshold on V, the boundary of the largest object, Otsu's threshold on H inside it, the
    boundaries of the two fittings, the braid's two edges between them; one scale for all of the
    picture, no correction for perspective, roll or lens. The hue circle is cut at its emptiest arc
    first: the literal method measures red tape wrongly without a warning.

    Raises:
        NoMuscle, AmbiguousHue, MissingFitting, ExtraFitting, Clipped: see these classes.

    References:
        Chambers 2021, sections 4.1 and 4.2, and equations 4.1 to 4.5 for hue, saturation and value,
        which OpenCV's are but for the rounding to 8 bits.
    """
    rgb = photo.rgb
    hsv = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2HSV_FULL), np.uint8)
    boundary, eta_value = _boundary(np.ascontiguousarray(hsv[..., 2]))
    inside = np.zeros(rgb.shape[:2], np.uint8)
    cv2.drawContours(inside, [boundary], -1, 255, cv2.FILLED)
    fittings, eta_hue, hue = _fittings(hsv, inside, recipe.tape_hue)
    upper, lower = fittings
    first = int(upper[:, 1].max()) + 1
    last = int(lower[:, 1].min()) - 1
    if last - first < 2:
        raise MissingFitting("braid must show between the fittings", braid_rows=last - first)
    rows, left, right = _edges(boundary, first, last)
    height, width = rgb.shape[:2]
    if left.min() == 0 or right.max() == width - 1 or first == 0 or last == height - 1:
        raise Clipped("the muscle must lie inside the picture; its boundary touches the border")
    px = 1 / recipe.scale.px_per_m
    length = (last - first + 1) * px
    z = np.linspace(0, length, rows.size)
    diameter = (right - left + 1) * px
    relative = recipe.scale.relative_stderr
    pixel = np.sqrt(2) * _PIXEL_STDERR * px
    quality = Quality(
        eta_value=eta_value,
        eta_hue=eta_hue,
        saturated=float(np.mean(hsv[..., 2][inside > 0] >= 254)),
        tape_hue_deg=hue,
    )
    quality.check(recipe.limits)
    middle = (left + right) / 2
    return Measurement(
        path=photo.path,
        time=photo.time,
        method="pixel",
        z=z,
        diameter=diameter,
        diameter_stderr=np.hypot(pixel, diameter * relative),
        length=length,
        px_per_m=recipe.scale.px_per_m,
        roll=-float(np.arctan(np.polyfit(rows, middle, 1)[0])),
        x0=float(np.mean(middle) - recipe.camera(width, height).centre[0]) * px,
        errors=MeasurementErrors(edge=pixel, density=0.0, ends=pixel, scale=relative),
        quality=quality,
        trace=Trace(
            rows.astype(float),
            left,
            right,
            upper.T.astype(float),
            lower.T.astype(float),
            photo.turned,
        ),
    )


def _boundary(value: Image) -> tuple[NDArray[np.int32], float]:
    """Boundary of the largest object brighter than Otsu's level, and its separability."""
    split = otsu_split(counts_of(value))
    contours = _boundaries(value > split.level)
    largest = max(contours, key=cv2.contourArea, default=np.zeros((1, 2), np.int32))
    area = cv2.contourArea(largest)
    if split.high - split.low < _LEAST_CONTRAST or area < _LEAST_AREA * value.size:
        raise NoMuscle(
            f"the muscle must stand {_LEAST_CONTRAST} levels above the cloth",
            eta_value=split.eta,
            cloth_level=split.low,
            muscle_level=split.high,
            area_px=area,
        )
    return largest, split.eta


def _fittings(
    hsv: Image, inside: Image, tape_hue: float | None
) -> tuple[tuple[NDArray[np.int32], NDArray[np.int32]], float, float]:
    """Boundaries of the upper and lower fitting, separability and hue [deg]."""
    coloured = (inside > 0) & (hsv[..., 1] > _LEAST_STRENGTH)
    counts = counts_of(hsv[..., 0][coloured])
    if counts.sum() < 0.05 * np.count_nonzero(inside):
        raise AmbiguousHue(
            "muscle and tapes must show colour; hardly any pixel does",
            coloured=float(counts.sum() / np.count_nonzero(inside)),
        )
    start = _emptiest(counts)
    split = otsu_split(np.roll(counts, -start))
    means = [(mean + start) % _HUES * 360 / _HUES for mean in (split.low, split.high)]
    if tape_hue is None:
        take_upper = split.share <= 0.5
    else:
        away = [hues_apart(mean, tape_hue) for mean in means]
        take_upper = away[1] <= away[0]
    if split.eta < _TWO_CLASSES:
        raise AmbiguousHue(
            "the tapes must differ in hue from the braid", eta_hue=split.eta, tapes=0
        )
    turned = (hsv[..., 0].astype(np.int16) - start) % _HUES
    tape = coloured & ((turned > split.level) == take_upper)
    square = np.ones((5, 5), np.uint8)
    contours = _boundaries(cv2.morphologyEx(tape.view(np.uint8), cv2.MORPH_OPEN, square))
    area = np.array([cv2.contourArea(contour) for contour in contours])
    large = [i for i in np.argsort(-area) if area[i] >= _LEAST_FITTING * area.max()]
    if len(large) != 2:
        error = MissingFitting if len(large) < 2 else ExtraFitting
        raise error(
            f"two fittings must be seen, and {len(large)} are", tapes=len(large), eta_hue=split.eta
        )
    upper, lower = sorted((contours[i] for i in large), key=lambda contour: contour[:, 1].mean())
    return (upper, lower), split.eta, means[1 if take_upper else 0]


def _boundaries(mask: NDArray[np.generic]) -> list[NDArray[np.int32]]:
    """Outermost pixels u, v of each object, shape (n, 2)."""
    objects = np.ascontiguousarray(mask).view(np.uint8)
    contours, _ = cv2.findContours(objects, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    return [np.asarray(contour.reshape(-1, 2), np.int32) for contour in contours]


def _emptiest(counts: Array) -> int:
    """The middle of the longest run of hues that nearly no pixel has."""
    empty = counts <= 0.001 * counts.max()
    if not empty.any():
        return int(np.argmin(np.convolve(np.tile(counts, 2), np.ones(9), "same")[: counts.size]))
    twice = np.concatenate([empty, empty])
    run = np.zeros(twice.size, int)
    for i in range(1, twice.size):
        run[i] = run[i - 1] + 1 if twice[i] else 0
    end = int(np.argmax(run))
    return (end - int(run[end]) // 2) % counts.size


def _edges(boundary: NDArray[np.int32], first: int, last: int) -> tuple[Indices, Array, Array]:
    """Leftmost and rightmost boundary pixel of each row between the fittings."""
    u, v = boundary.T
    between = (v >= first) & (v <= last)
    n = last - first + 1
    left, right = np.full(n, np.inf), np.full(n, -np.inf)
    np.minimum.at(left, v[between] - first, u[between])
    np.maximum.at(right, v[between] - first, u[between])
    rows = np.arange(first, last + 1)
    return rows, left, right

"""Which pixels are cloth, braid and tape: a coarse outline for the fine steps to start from."""

import dataclasses
from collections.abc import Callable

import cv2
import numpy as np

from ..arrays import Array, Image, Indices
from ..errors import (
    AmbiguousHue,
    Clipped,
    ExtraFitting,
    ImagingError,
    MissingFitting,
    NoMuscle,
    WrongOrientation,
)
from .against_border import light_behind, mask_against_border
from .masks import Mask, sampled, shaped
from .muscle_mask import MuscleMask, muscle_mask
from .tape_colour import split_by_colour
from .tapes import Patch, two_tapes

_BY_BACKGROUND = Clipped, NoMuscle, ExtraFitting, AmbiguousHue, MissingFitting
_SEPARATE = 0.7  # eta of brightness from which the background is dark and even
_COARSE_PIXELS = 0.35e6  # the picture is thinned out to about this many for the first look
_FINE_STEP = 4
_FEWEST_ROWS = 48
_GUARD = 2  # pixels next to a tape that its blur may reach
_SAMPLE = 4000  # pixels that a median colour is taken of
_MARGIN = 40  # pixels around the muscle that are kept as cloth


@dataclasses.dataclass(frozen=True)
class TapeBand:
    """One tape ring as it lies in the picture [px].

    Attributes:
        top, bottom, left, right: bounding box.
        inner: coefficients of the inner edge, v = polynomial in u, highest power first, shape (3,).
        inner_limbs: rows of the inner edge at its left and right end.
    """

    top: float
    bottom: float
    left: float
    right: float
    inner: Array
    inner_limbs: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Segmentation:
    """The muscle to within some pixels.

    Attributes:
        rows: rows between the tapes, shape (n,).
        left, right: columns of the outermost muscle pixels in them, shape (n,).
        upper, lower: the tapes.
        cloth, braid, tape: median colours, 0 to 255, shape (3,).
        eta_value, eta_hue: separability of muscle and cloth, of tape and braid, 0 to 1; the first nan
            where the muscle was found by its border and not by its brightness.
        saturated: part of the muscle with a colour at 254 or more.
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


@dataclasses.dataclass(frozen=True)
class _Look:
    """Muscle and tapes in a picture of which every `step`-th pixel is looked at."""

    step: int
    small: Image
    muscle: MuscleMask
    tape: Mask
    upper: Patch
    lower: Patch
    eta_hue: float


def segment(rgb: Image, tape_hue: float | None = None) -> Segmentation:
    """The coarse outline of an upright muscle and its two tapes.

    The brightest of the three colours, or the strength of the colour, separates the muscle from
    the cloth (Otsu on each); where this gives no muscle with two tapes, what is off the colours of
    the picture's left and right borders does. The chromaticity along the line between the two
    classes separates the tapes from the braid (Otsu again), without a seam at hue 0. Large pictures
    are looked at twice, coarse for the place and then at every fourth pixel.

    Args:
        rgb: picture, shape (h, w, 3).
        tape_hue: of the tape [deg]; None takes the colour that covers the smaller part.

    Raises:
        ImagingError: one of NoMuscle, Underexposed, AmbiguousHue, MissingFitting, ExtraFitting,
            Clipped, WrongOrientation; see these classes.
    """
    error: ImagingError | None = None
    try:
        found = _segmented(rgb, tape_hue, muscle_mask)
        if found.eta_value >= _SEPARATE:
            return found
    except _BY_BACKGROUND as refused:
        found, error = None, refused
    try:
        return _segmented(rgb, tape_hue, mask_against_border)
    except ImagingError as also:
        if found is not None:
            return found
        raise also if error is None or light_behind(rgb) else error from None


def _segmented(
    rgb: Image, tape_hue: float | None, mask_by: Callable[[Image], MuscleMask]
) -> Segmentation:
    step = _first_step(rgb)
    look = _look(rgb, step, tape_hue, mask_by)
    first, second = look.upper.centre, look.lower.centre
    if abs(first[0] - second[0]) > abs(first[1] - second[1]):
        raise WrongOrientation(
            "the muscle must stand in the picture as the recipe says; the line from tape to tape "
            'lies across it: turn the camera, or set the orientation to "auto"',
            across_px=step * abs(first[0] - second[0]),
            along_px=step * abs(first[1] - second[1]),
        )
    v0 = u0 = 0
    if step > _FINE_STEP:
        v0, v1, u0, u1 = _around(look, rgb.shape)
        crop = rgb[v0:v1, u0:u1]
        look = _look(crop, _FINE_STEP, tape_hue, mask_by)
    return _measured(look, v0, u0)


def _first_step(rgb: Image) -> int:
    step = max(1, round(np.sqrt(rgb.shape[0] * rgb.shape[1] / _COARSE_PIXELS)))
    # A picture that would be looked at a little more finely than a large one needs no second look.
    return _FINE_STEP if step == _FINE_STEP - 1 else step


def _look(
    rgb: Image, step: int, tape_hue: float | None, mask_by: Callable[[Image], MuscleMask]
) -> _Look:
    h, w = rgb.shape[0] // step, rgb.shape[1] // step
    even = rgb[: h * step, : w * step]
    small = np.asarray(cv2.resize(even, (w, h), interpolation=cv2.INTER_NEAREST), np.uint8)
    soft = np.asarray(cv2.blur(small, (3, 3)), np.uint8)
    muscle = mask_by(soft)
    tape, eta_hue = split_by_colour(soft, muscle.lit, tape_hue)
    upper, lower = two_tapes(tape, muscle.lit, eta_hue, step)
    return _Look(step, small, muscle, tape, upper, lower, eta_hue)


def _around(look: _Look, shape: tuple[int, ...]) -> tuple[int, int, int, int]:
    """Box of both tapes and the muscle between them with a margin of cloth: v0, v1, u0, u1."""
    top, bottom = look.upper.y, look.lower.y + look.lower.mask.shape[0]
    columns = np.flatnonzero(look.muscle.whole[top:bottom].any(axis=0))
    margin = np.array([-_MARGIN, _MARGIN])
    v = np.clip(np.array([top, bottom]) * look.step + margin, 0, shape[0])
    u = np.clip(columns[[0, -1]] * look.step + margin, 0, shape[1])
    return int(v[0]), int(v[1]), int(u[0]), int(u[1])


def _measured(look: _Look, v0: int, u0: int) -> Segmentation:
    """The look's masks as rows, columns and colours of the whole picture."""
    upper, lower = _tape(look.upper, lower=False), _tape(look.lower, lower=True)
    step = look.step
    first, last = max(upper.inner_limbs), min(lower.inner_limbs)
    rows = np.arange(
        int(np.ceil(first * step)) + step + _GUARD, int(last * step) - step - _GUARD + 1
    )
    first, last = int(np.ceil(first)), int(last)
    if rows.size < _FEWEST_ROWS or last - first < _FEWEST_ROWS // step:
        raise MissingFitting(
            f"{_FEWEST_ROWS} or more rows of braid must show between the tapes",
            braid_rows=rows.size,
        )
    band = look.muscle.whole[first : last + 1] > 0
    left = np.argmax(band, axis=1)
    right = band.shape[1] - 1 - np.argmax(band[:, ::-1], axis=1)
    if left.min() == 0 or right.max() == band.shape[1] - 1:
        raise Clipped(
            "the whole width of the muscle must be in the picture; its outline touches the border: "
            "move the camera, widen the crop, or put a dark cloth behind all of it",
            left_px=int(left.min() * step),
            right_px=int(right.max() * step),
        )
    at = np.arange(first, last + 1) * step
    body = shaped(look.muscle.lit, cv2.MORPH_ERODE, 5)
    inside = np.zeros_like(body)
    inside[first : last + 1] = body[first : last + 1]
    cloth = ~shaped(look.muscle.whole, cv2.MORPH_DILATE, 9)
    tape = look.tape & body
    braid = _pixels(look.small, inside)
    return Segmentation(
        rows=rows + v0,
        left=np.interp(rows, at, left * step) + u0,
        right=np.interp(rows, at, right * step) + u0,
        upper=_moved(upper, step, v0, u0),
        lower=_moved(lower, step, v0, u0),
        cloth=np.median(_pixels(look.small, cloth), axis=0),
        braid=np.median(braid, axis=0),
        tape=np.median(_pixels(look.small, tape), axis=0),
        eta_value=look.muscle.eta,
        eta_hue=look.eta_hue,
        saturated=float(np.mean(braid.max(axis=1) >= 254)),
    )


def _pixels(small: Image, mask: Mask) -> Image:
    """Pixels of a mask, evenly thinned out, shape (n, 3)."""
    pixels = sampled(small, mask, _SAMPLE)
    if pixels.size == 0:
        raise NoMuscle("cloth, braid and tapes must each show some pixels; one shows none")
    return pixels


def _tape(found: Patch, *, lower: bool) -> TapeBand:
    x, y, patch = found.x, found.y, found.mask
    h, w = patch.shape
    edge = y + (np.argmax(patch, axis=0) if lower else h - 1 - np.argmax(patch[::-1], axis=0))
    columns = np.arange(x, x + w)
    middle = slice(w // 8, w - w // 8)
    inner = _robust_parabola(columns[middle].astype(float), edge[middle].astype(float))
    limbs = np.polyval(inner, np.array([x, x + w - 1.0]))
    return TapeBand(y, y + h, x, x + w, inner, (float(limbs[0]), float(limbs[1])))


def _robust_parabola(x: Array, y: Array) -> Array:
    keep = np.abs(y - np.median(y)) <= max(4.0, 0.15 * np.ptp(x))
    fit = np.polyfit(x[keep], y[keep], 2)
    off = np.abs(y - np.polyval(fit, x))
    keep &= off <= max(2.0, 3 * float(np.median(off[keep])))
    return np.polyfit(x[keep], y[keep], 2)


def _moved(tape: TapeBand, step: int, v0: int, u0: int) -> TapeBand:
    """The tape in pixels of the whole picture."""
    a, b, c = tape.inner
    # v = step p((u - u0) / step) + v0
    inner = np.array([a / step, b - 2 * a * u0 / step, a * u0**2 / step - b * u0 + c * step + v0])
    upper, lower = tape.inner_limbs
    return TapeBand(
        tape.top * step + v0,
        tape.bottom * step + v0,
        tape.left * step + u0,
        tape.right * step + u0,
        inner,
        (upper * step + v0, lower * step + v0),
    )

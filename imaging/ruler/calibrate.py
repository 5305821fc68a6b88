"""The scale from the photograph of a ruler in the muscle's place."""

import dataclasses
import math
from os import PathLike, fspath

import cv2
import numpy as np

from ..arrays import Array, Image, Single
from ..camera.pinhole import Camera
from ..camera.read import Reader, read_image
from ..camera.tone import Tone
from ..errors import AmbiguousRuler, ImagingError, RulerNotFound
from .choice import FEWEST, Strip, choose_strip, is_ruler, read_strip
from .lens import lens_of_marks, straightened
from .marks import Numbered, marks_of
from .numbers import pitch_of
from .scale import RulerReading, Scale
from .strip import Line

_TURNS = 3
_PITCHES = (0.003175, 0.0015875, 0.001, 0.0254 / 32, 0.00254, 0.0005, 0.00635)
_LEAST_EXACT = 1e-3  # standard error of the scale, relative


def calibrate_ruler(
    image: str | PathLike[str] | Image,
    *,
    pitch: float | None = None,
    distance: float = 1.524,
    centre: tuple[float, float] | None = None,
    k1: float | None = None,
    tone: Tone | None = None,
    expected_px_per_m: float | None = None,
    placement_stderr: float | None = None,
    reader: Reader = read_image,
) -> Scale:
    """The scale in the mid-plane from a ruler that passes through it at the height of the optical axis.

    The marks' places along the ruler follow px(n) = (a + b n) / (1 + c n) exactly for any tilt in
    depth; the tilt is sin(tilt) = d c / (1 + c n0) per metre of ruler with n0 where the optical
    axis meets it, and the scale there its slope over cos(tilt). What no picture of a ruler shows is
    how far in front of or behind the muscle's axis it was: a distance e changes the scale by e / d.

    Args:
        image: path of a picture, or the picture: RGB, dtype uint8, shape (h, w, 3). The ruler may
            lie in any direction, its marks dark or light, long and short, with numbers.
        pitch: from mark to mark, of the finest that are regular [m]; None reads it off the number of
            marks from one number, or longest mark, to the next.
        distance: camera to the mid-plane d [m].
        centre: where the optical axis meets the picture (u, v) [px]; None takes its middle.
        k1: radial distortion, as in `Camera`; None takes what the marks show, where that is more than
            three standard errors.
        tone: the camera's tone curve; sRGB by default. It hardly matters here.
        expected_px_per_m: the scale to within a quarter [px/m]; distinguishes a ruler's
            finer and coarser marks, or its two edges.
        placement_stderr: standard error of the ruler's place in depth [m]; enters the scale's. None
            takes it to lie in the plane, and measurements warn of that.
        reader: from path to picture.

    Returns:
        The scale; positive `tilt_deg` when its lower, or right, end is further away.

    Raises:
        RulerNotFound: no regular marks, fewer than 8, too many that do not fit, or a scale no
            better than 0.1 %.
        AmbiguousRuler: no scale is expected, and two edges of the ruler show two; or the pitch can be
            read in two ways, or in none.
        UnreadableImage, DamagedImage: as `read_image`.
        ValueError: a figure outside its range.

    References:
        Chambers 2021, section 4.2.1.
    """
    RulerReading(pitch, expected_px_per_m, placement_stderr)  # refuses what cannot be
    if not (math.isfinite(distance) and distance > 0):
        raise ValueError(f"distance must be finite and > 0, got {distance} m")
    path = "" if isinstance(image, np.ndarray) else fspath(image)
    try:
        rgb = image if isinstance(image, np.ndarray) else reader(path)
        luma = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        table = (tone or Tone.srgb()).table.astype(np.float32)
        light = np.asarray(cv2.LUT(luma, table), np.float32)
        strip, step = _strip_and_pitch(luma, light, pitch, expected_px_per_m)
        middle = centre or ((rgb.shape[1] - 1) / 2, (rgb.shape[0] - 1) / 2)
        lens = Camera(strip.marks.pitch / step, distance, middle, k1 or 0.0)
        bent = None
        if k1 is None:
            lens, bent = lens_of_marks(strip, lens)
        marks = straightened(strip, lens)
        scale = _scale(strip.line, marks, middle, step, distance, placement_stderr or 0.0)
        return dataclasses.replace(
            scale, k1=lens.k1, k1_stderr=bent, pitch=step, placement_stderr=placement_stderr
        )
    except ImagingError as error:
        if path:
            raise error.at(path) from error
        raise


def _aligned(light: Single, strip: Strip) -> Strip:
    """The strip turned until both of its halves show the marks at the same places."""
    line = strip.line
    for _ in range(_TURNS):
        halves = [marks_of(line.profile(light, part=part), line.pitch) for part in (-1.0, 1.0)]
        if min(half.size for half in halves) < FEWEST:
            break
        nearest = np.abs(halves[0][:, None] - halves[1]).argmin(axis=1)
        shift = halves[1][nearest] - halves[0]
        close = np.abs(shift) < 0.3 * line.pitch
        if close.sum() < FEWEST:
            break
        angle = float(np.median(shift[close])) / (line.width / 2)
        line = line.turned(-np.arctan(angle)) if abs(angle) > 1e-5 else line
    again = read_strip(light, line)
    return again if again is not None and is_ruler(again.marks) else Strip(line, strip.marks)


def _strip_and_pitch(
    luma: Image, light: Single, pitch: float | None, expected: float | None
) -> tuple[Strip, float]:
    """The marks and their pitch [m], the stated one or that of the numbers beside them."""
    if pitch is not None:
        return _aligned(light, choose_strip(luma, light, pitch, expected)), pitch
    wanted = _PITCHES if expected is not None else _PITCHES[:1]
    for one in wanted:
        try:
            strip = _aligned(light, choose_strip(luma, light, one, expected))
            return strip, pitch_of(light, strip, expected)
        except (RulerNotFound, AmbiguousRuler):
            if one == wanted[-1]:
                raise
    raise AssertionError  # the loop returns or raises


def _scale(
    line: Line,
    marks: Numbered,
    centre: tuple[float, float],
    pitch: float,
    distance: float,
    placement: float,
) -> Scale:
    foot = float((np.asarray(centre) - line.origin) @ line.along)

    def scale_and_tilt(fit: Array) -> tuple[float, float]:
        a, b, c = fit
        n = (foot - a) / (b - c * foot)
        below = 1 + c * n
        sine = float(np.clip(c / below / pitch * distance, -1, 1))
        slope = (b - a * c) / below**2 / pitch
        return slope / math.sqrt(1 - sine**2), math.degrees(math.asin(sine))

    fit = marks.coefficients
    px_per_m, tilt = scale_and_tilt(fit)
    root = np.sqrt(np.diag(marks.covariance))
    gradient = np.array(
        [
            (scale_and_tilt(fit + step)[0] - scale_and_tilt(fit - step)[0]) / (2 * size)
            for size, step in zip(root, np.diag(root), strict=True)
        ]
    )
    random = math.sqrt(gradient @ marks.covariance @ gradient)
    if not random <= _LEAST_EXACT * px_per_m:
        raise RulerNotFound(
            f"a ruler's marks must give the scale to {_LEAST_EXACT:.1%} or better; these are too few, "
            "or scatter too much: is it in focus, are its finest marks 5 px or more apart?",
            relative_stderr=random / px_per_m,
            marks=marks.number.size,
            residual_px=marks.residual,
        )
    a, b, c = fit
    return Scale(
        px_per_m=px_per_m,
        stderr=math.hypot(random, px_per_m * placement / distance),
        coefficients=(float(a), float(b / pitch), float(c / pitch)),
        tilt_deg=tilt,
        residual_px=marks.residual,
        marks=marks.number.size,
        source="ruler",
    )

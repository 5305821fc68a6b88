"""The scale from the photograph of a ruler in the muscle's place."""

import math
from os import PathLike, fspath

import cv2
import numpy as np

from ..arrays import Array, Image, Single
from ..camera.pinhole import Camera
from ..camera.read import Reader, read_image
from ..camera.tone import Tone
from ..errors import ImagingError, RulerNotFound
from .choice import FEWEST, Strip, choose_strip, is_ruler, read_strip
from .marks import Numbered, marks_of, numbered
from .scale import RulerReading, Scale
from .strip import Line

_TURNS = 3
_LEAST_EXACT = 1e-3  # standard error of the scale, relative


def calibrate_ruler(
    image: str | PathLike[str] | Image,
    *,
    pitch: float = 0.003175,
    distance: float = 1.524,
    centre: tuple[float, float] | None = None,
    k1: float = 0.0,
    tone: Tone | None = None,
    expected_px_per_m: float | None = None,
    placement_stderr: float = 0.0,
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
        pitch: from mark to mark, of the finest that are regular [m]; 1/8 in by default.
        distance: camera to the mid-plane d [m].
        centre: where the optical axis meets the picture (u, v) [px]; None takes its middle.
        k1: radial distortion, as in `Camera`.
        tone: the camera's tone curve; sRGB by default. It hardly matters here.
        expected_px_per_m: the scale to within a quarter [px/m]; distinguishes a ruler's
            finer and coarser marks, or its two edges.
        placement_stderr: standard error of the ruler's place in depth [m]; enters the scale's.
        reader: from path to picture.

    Returns:
        The scale; positive `tilt_deg` when its lower, or right, end is further away.

    Raises:
        RulerNotFound: no regular marks, fewer than 8, too many that do not fit, or a scale no
            better than 0.1 %.
        AmbiguousRuler: no scale is expected, and two edges of the ruler show two.
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
        strip = _aligned(light, choose_strip(luma, light, pitch, expected_px_per_m))
        middle = centre or ((rgb.shape[1] - 1) / 2, (rgb.shape[0] - 1) / 2)
        marks = _straightened(strip, middle, k1, pitch, distance)
        return _scale(strip.line, marks, middle, pitch, distance, placement_stderr)
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


def _straightened(
    strip: Strip, centre: tuple[float, float], k1: float, pitch: float, distance: float
) -> Numbered:
    """The marks where a lens without distortion would show them."""
    line, marks = strip.line, strip.marks
    if k1 == 0:
        return marks
    camera = Camera(strip.marks.pitch / pitch, distance, centre, k1)
    u, v = (line.origin[i] + marks.place * line.along[i] for i in (0, 1))
    a, b = camera.rays(u, v)
    shown = np.stack([centre[0] + a * camera.focal_px, centre[1] + b * camera.focal_px], axis=1)
    again = numbered((shown - line.origin) @ line.along, strip.marks.pitch)
    return marks if again is None else again


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

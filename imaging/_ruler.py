"""The scale from the photograph of a ruler in the muscle's place."""

import math
from os import PathLike, fspath
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ._camera import Camera
from ._errors import AmbiguousRuler, ImagingError, RulerNotFound
from ._read import Reader, read_image
from ._ruler_marks import Numbered, marks_of, numbered
from ._ruler_strip import Line, regular_strips
from ._scale import Scale
from ._tone import Tone

_FEWEST = 8
_ON_MODEL = 0.8  # of the marks between the first and the last
_SHARP = 0.05  # pitches; marks that scatter more are none of a ruler
_WHOLE = 0.06  # by which the ratio of two pitches may miss a whole number
_TURNS = 3


def calibrate_ruler(
    image: str | PathLike[str] | NDArray[np.uint8],
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
        expected_px_per_m: the scale to within a quarter [px/m]; tells a ruler's finer and coarser
            marks, or its two edges, from each other.
        placement_stderr: standard error of the ruler's place in depth [m]; enters the scale's.
        reader: from path to picture.

    Returns:
        The scale; positive `tilt_deg` when its lower, or right, end is further away.

    Raises:
        RulerNotFound: no regular marks, fewer than 8, or too many that do not fit.
        AmbiguousRuler: two sets of marks whose pitches are not multiples of each other.
        UnreadableImage, DamagedImage: as `read_image`.
        ValueError: a pitch or distance that is not positive.

    References:
        Chambers 2021, section 4.2.1.
    """
    for name, value in (("pitch", pitch), ("distance", distance)):
        if not (math.isfinite(value) and value > 0):
            raise ValueError(f"{name} must be finite and > 0, got {value} m")
    path = "" if isinstance(image, np.ndarray) else fspath(image)
    try:
        rgb = image if isinstance(image, np.ndarray) else reader(path)
        luma = np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY), np.uint8)
        expected = None if expected_px_per_m is None else expected_px_per_m * pitch
        line, marks = _best(luma, (tone or Tone.srgb()).table, expected)
    except ImagingError as error:
        if path:
            raise error.at(path) from error
        raise
    middle = centre or ((rgb.shape[1] - 1) / 2, (rgb.shape[0] - 1) / 2)
    marks = _straightened(line, marks, middle, k1, pitch, distance)
    return _scale(line, marks, middle, pitch, distance, placement_stderr)


def _best(
    luma: NDArray[np.uint8], table: NDArray[np.float64], expected: float | None
) -> tuple[Line, Numbered]:
    light = table[luma].astype(np.float32)
    tried = [(line, _read(light, line)) for line in regular_strips(luma)]
    good = [(line, marks) for line, marks in tried if marks is not None and _is_ruler(marks)]
    if expected is not None:
        good = [each for each in good if abs(_pitch(each[1]) / expected - 1) < 0.25]
    if not good:
        most = max((marks.number.size for _, marks in tried if marks is not None), default=0)
        figures: dict[str, Any] = {"marks": most, "strips": len(tried)}
        if expected is not None:
            figures["expected_pitch_px"] = expected
        raise RulerNotFound(
            f"a ruler must show {_FEWEST} or more marks at even distances, {_ON_MODEL:.0%} of those "
            "between the first and the last; is it in the picture, in focus, and is the pitch that "
            "of its finest regular marks?",
            **figures,
        )
    line, marks = max(good, key=lambda each: (each[1].number.size, each[0].width))
    _check_unique(marks, [other for _, other in good])
    line = _aligned(light, line)
    again = _read(light, line)
    return line, again if again is not None and _is_ruler(again) else marks


def _read(light: NDArray[np.float32], line: Line) -> Numbered | None:
    return numbered(marks_of(line.profile(light), line.pitch), line.pitch)


def _is_ruler(marks: Numbered) -> bool:
    return (
        marks.number.size >= _FEWEST
        and marks.number.size >= _ON_MODEL * marks.expected
        and marks.residual <= _SHARP * abs(_pitch(marks))
    )


def _pitch(marks: Numbered) -> float:
    return float(np.ptp(marks.place) / np.ptp(marks.number))


def _check_unique(best: Numbered, others: list[Numbered]) -> None:
    for other in others:
        ratio = max(_pitch(other), _pitch(best)) / min(_pitch(other), _pitch(best))
        if abs(ratio - round(ratio)) > _WHOLE:
            raise AmbiguousRuler(
                "the picture must show one scale; it shows two whose pitches are not multiples of "
                "each other: cover one edge of the ruler, or give the scale to expect",
                pitch_px=_pitch(best),
                other_pitch_px=_pitch(other),
            )


def _aligned(light: NDArray[np.float32], line: Line) -> Line:
    """The line turned until both halves of its strip show the marks at the same places."""
    for _ in range(_TURNS):
        halves = [marks_of(line.profile(light, part=part), line.pitch) for part in (-1.0, 1.0)]
        if min(half.size for half in halves) < _FEWEST:
            return line
        nearest = np.abs(halves[0][:, None] - halves[1]).argmin(axis=1)
        shift = halves[1][nearest] - halves[0]
        close = np.abs(shift) < 0.3 * line.pitch
        if close.sum() < _FEWEST:
            return line
        angle = float(np.median(shift[close])) / (line.width / 2)
        line = line.turned(-np.arctan(angle)) if abs(angle) > 1e-5 else line
    return line


def _straightened(
    line: Line,
    marks: Numbered,
    centre: tuple[float, float],
    k1: float,
    pitch: float,
    distance: float,
) -> Numbered:
    """The marks where a lens without distortion would show them."""
    if k1 == 0:
        return marks
    camera = Camera(_pitch(marks) / pitch, distance, centre, k1)
    u, v = (line.origin[i] + marks.place * line.along[i] for i in (0, 1))
    a, b = camera.rays(u, v)
    shown = np.stack([centre[0] + a * camera.focal_px, centre[1] + b * camera.focal_px], axis=1)
    again = numbered((shown - line.origin) @ line.along, _pitch(marks))
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

    def scale_and_tilt(fit: NDArray[np.float64]) -> tuple[float, float]:
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

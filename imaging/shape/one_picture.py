"""From one photograph to a muscle's shape."""

import dataclasses
import math
from os import PathLike, fspath

import numpy as np

from ..arrays import Image
from ..camera.amount import amount_of_luma
from ..camera.pinhole import Camera, Silhouette, profile_from_silhouette, ring_position
from ..camera.read import Reader, read_image
from ..errors import ImagingError, NoMuscle, WrongOrientation
from ..outline.both_sides import Outline, find_outline
from ..outline.midline import axis_deviation, axis_kink
from ..quality import Quality
from ..recipe import Recipe
from ..segment.segmentation import Segmentation, Tape, segment
from ..segment.tape_colour import hue_of
from ..tape.diameter import check_tape_diameter
from ..tape.ring import Ring, find_ring
from .measurement import Measurement
from .pixel_method import measure_pixels
from .profile_of_body import end_radius, measurement_of_body

_LEAST_WIDTH = 16  # px


def measure(
    image: str | PathLike[str] | Image,
    recipe: Recipe,
    *,
    time: float | None = None,
    reader: Reader = read_image,
) -> Measurement:
    """The shape of the muscle in one photograph, with standard errors and quality figures.

    Coarse segmentation, outline by the limb model, exact inversion of the silhouette, the tapes'
    edges as rings of the radius found, D(z) between them. How the standard errors are made up is
    said at `Errors`, the class of `Measurement.errors`.

    Args:
        image: path of a picture, or the picture itself: RGB, dtype uint8, shape (h, w, 3).
        recipe: every choice.
        time: when it was taken [s].
        reader: from path to picture.

    Returns:
        The measurement.

    Raises:
        ImagingError: one of its kinds, with the path and the figures, when the picture gives no
            measurement.
        ValueError: an array that is no picture, or a crop outside its frame.
    """
    path = "" if isinstance(image, np.ndarray) else fspath(image)
    try:
        rgb = image if isinstance(image, np.ndarray) else reader(path)
        return _upright(_checked(rgb), recipe, path, math.nan if time is None else float(time))
    except ImagingError as error:
        if path:
            raise error.at(path) from error
        raise


def _checked(rgb: Image) -> Image:
    if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or min(rgb.shape[:2]) < 64:
        raise ValueError(
            "a picture is RGB of dtype uint8 and shape (h, w, 3), 64 px or more each way; got "
            f"{rgb.dtype} and {rgb.shape}"
        )
    return rgb


def _upright(rgb: Image, recipe: Recipe, path: str, time: float) -> Measurement:
    """The measurement of a picture that is turned first where the recipe says so."""
    camera = recipe.camera(rgb.shape[1], rgb.shape[0])
    if recipe.orientation != "horizontal":
        try:
            return _measured(rgb, camera, recipe, path, time, turned=False)
        except WrongOrientation:
            if recipe.orientation == "vertical":
                raise
    centre = (rgb.shape[0] - 1 - camera.centre[1], camera.centre[0])
    camera = dataclasses.replace(camera, centre=centre)
    return _measured(
        np.ascontiguousarray(np.rot90(rgb, -1)), camera, recipe, path, time, turned=True
    )


def _measured(
    rgb: Image, camera: Camera, recipe: Recipe, path: str, time: float, *, turned: bool
) -> Measurement:
    if recipe.method == "pixel":
        return measure_pixels(rgb, recipe, path=path, time=time, turned=turned)
    coarse = segment(rgb, recipe.tape_hue)
    width = float(np.min(coarse.right - coarse.left))
    if width < _LEAST_WIDTH:
        raise NoMuscle(f"a muscle must be at least {_LEAST_WIDTH} px wide", width_px=width)
    outline = find_outline(
        rgb,
        amount_of_luma(recipe.tone, coarse.cloth, coarse.braid),
        coarse.rows,
        coarse.left,
        coarse.right,
        resolution=recipe.smoothing_px,
        method=recipe.method,
        blur=recipe.blur_px,
    )
    body = _body(camera, outline, recipe.edge_offset_px)
    upper, lower = (
        _ring(rgb, coarse, tape, outline, body, camera, recipe, lower=at_end)
        for tape, at_end in ((coarse.upper, False), (coarse.lower, True))
    )
    quality = _quality(coarse, outline, upper, lower, recipe)
    for failure in quality.failures(recipe.limits):
        raise failure
    if recipe.tape_diameter is not None:
        check_tape_diameter(rgb, coarse, body, camera, recipe, recipe.tape_diameter)
    made = measurement_of_body(outline, body, upper, lower, camera, recipe.scale, quality)
    trace = dataclasses.replace(made.trace, turned=turned)
    return dataclasses.replace(made, path=path, time=time, method=recipe.method, trace=trace)


def _body(camera: Camera, outline: Outline, offset: float) -> Silhouette:
    left, right = outline.left.column - offset, outline.right.column + offset
    try:
        return profile_from_silhouette(camera, outline.rows, left, right)
    except ValueError as error:
        raise NoMuscle(f"the outline is that of no muscle: {error}") from error


def _ring(
    rgb: Image,
    coarse: Segmentation,
    tape: Tape,
    outline: Outline,
    body: Silhouette,
    camera: Camera,
    recipe: Recipe,
    *,
    lower: bool,
) -> Ring:
    """The tape's edge, with the radius that the outline has there."""
    u = (tape.left + tape.right) / 2
    v = float(np.polyval(tape.inner, u))
    radius = float(body.radius[-1 if lower else 0])
    y = float(ring_position(camera, u, v, radius, body.x0, body.roll))
    return find_ring(
        rgb,
        recipe.tone,
        camera,
        (coarse.tape, coarse.braid),
        y=y,
        radius_at=end_radius(body, upper=not lower),
        x0=body.x0,
        roll=body.roll,
        lower=lower,
        blur=outline.blur,
    )


def _quality(
    coarse: Segmentation, outline: Outline, upper: Ring, lower: Ring, recipe: Recipe
) -> Quality:
    hue = hue_of(coarse.tape)
    apart = 0.0 if recipe.tape_hue is None else abs((hue - recipe.tape_hue + 180) % 360 - 180)
    sides = (outline.left, outline.right)
    columns = (outline.left.column, outline.right.column)
    return Quality(
        eta_value=coarse.eta_value,
        eta_hue=coarse.eta_hue,
        blur_px=outline.blur,
        kappa=max(side.kappa for side in sides),
        axis_deviation=axis_deviation(*columns),
        axis_kink=axis_kink(*columns),
        misfit=outline.misfit,
        outlier_fraction=max(side.outliers for side in sides),
        residual_rms=max(side.residual for side in sides),
        tape_sd_px=max(upper.spread, lower.spread),
        tape_blur_px=max(upper.blur, lower.blur),
        saturated=coarse.saturated,
        tape_hue_deg=hue,
        tape_hue_error_deg=apart,
    )

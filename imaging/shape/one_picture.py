"""From one photograph to a muscle's shape."""

import dataclasses
import math
from os import PathLike, fspath

import numpy as np

from ..arrays import Array, Image
from ..camera.pinhole import Camera, ring_position
from ..camera.read import Reader, read_image
from ..camera.silhouette import Silhouette, profile_from_silhouette
from ..errors import (
    AmbiguousHue,
    DamagedImage,
    ImagingError,
    MotionBlurred,
    NoMuscle,
    WrongOrientation,
)
from ..outline.both_sides import Outline, find_outline
from ..outline.dents import without_dents
from ..outline.midline import axis_deviation, axis_kink
from ..quality import Quality
from ..recipe import Recipe
from ..segment.edge_light import edge_light
from ..segment.segmentation import Segmentation, segment
from ..segment.tape_colour import hue_of, hues_apart
from ..tape.diameter import check_tape_diameter
from ..tape.ring import Ring, find_ring
from ..weave.angle import braid_angle, yarn_lines
from .axis import axis_of, distance_by_tapes, ends_aside
from .measurement import Measurement
from .photograph import Photograph
from .pixel_method import measure_pixels
from .profile_of_body import measurement_of_body

_LEAST_WIDTH = 16  # px
_RAGGED = 1.5  # px, scatter of a tape's edge from which its teeth may pass for blur
_PASSES = 3  # towards the distance of the tapes' arcs, each linear in what is left
_SMEARED = 2.0  # times the outline's blur, from which it is motion all the same


def measure(
    image: str | PathLike[str] | Image,
    recipe: Recipe,
    *,
    time: float | None = None,
    reader: Reader = read_image,
) -> Measurement:
    """The shape of the muscle in one photograph, with standard errors and quality figures.

    Coarse segmentation, outline by the limb model, exact inversion of the silhouette, the tapes'
    edges as rings of the radius found, D(z) between them. `MeasurementErrors`, the class of
    `Measurement.errors`, describes how the standard errors are composed.

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
        rgb = _checked(image if isinstance(image, np.ndarray) else reader(path))
        camera = recipe.camera(rgb.shape[1], rgb.shape[0])
        photo = Photograph(rgb, camera, path, math.nan if time is None else float(time))
        if recipe.orientation == "horizontal":
            return _measured(photo.clockwise(), recipe)
        try:
            return _measured(photo, recipe)
        except WrongOrientation:
            if recipe.orientation == "vertical":
                raise
            return _measured(photo.clockwise(), recipe)
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


def _measured(photo: Photograph, recipe: Recipe) -> Measurement:
    if recipe.method == "pixel":
        return measure_pixels(photo, recipe)
    coarse = segment(photo.rgb, recipe.tape_hue)
    width = float(np.min(coarse.right - coarse.left))
    if width < _LEAST_WIDTH:
        raise NoMuscle(f"a muscle must be at least {_LEAST_WIDTH} px wide", width_px=width)
    image, amount = edge_light(photo.rgb, coarse, recipe.tone_curve)
    outline = find_outline(
        image,
        amount,
        coarse.rows,
        coarse.left,
        coarse.right,
        resolution=recipe.smoothing_px,
        method=recipe.method,
        blur=recipe.blur_px,
    )
    seen, outline = outline, without_dents(outline)
    body, upper, lower = _placed(photo, coarse, outline, recipe)
    for again in range(_PASSES if recipe.distance is None else 0):
        distance = distance_by_tapes(body, upper, lower, photo.camera.distance, found=again > 0)
        if distance == photo.camera.distance:
            break
        camera = photo.camera.moved(distance)
        if recipe.k1 is not None:
            camera = dataclasses.replace(camera, k1=recipe.k1)
        photo = dataclasses.replace(photo, camera=camera)
        body, upper, lower = _placed(photo, coarse, outline, recipe)
    quality = _quality(coarse, seen, upper, lower, recipe)
    _check(quality, recipe)
    if recipe.tape_diameter is not None:
        check_tape_diameter(photo.rgb, coarse, body, photo.camera, recipe, recipe.tape_diameter)
    stated = recipe.distance is not None
    axis = axis_of(photo.camera, outline, body, upper, lower, stated=stated)
    found = measurement_of_body(photo, outline, body, upper, lower, recipe, quality, axis)
    return _with_braid(found, photo, body, upper, lower, recipe) if recipe.braid_angle else found


def _placed(
    photo: Photograph, coarse: Segmentation, outline: Outline, recipe: Recipe
) -> tuple[Silhouette, Ring, Ring]:
    """The body behind the outline, and the edges of its upper and lower tape."""
    body = _body(photo.camera, outline, recipe.edge_offset_px)
    upper, lower = (
        _ring(
            photo,
            coarse,
            dataclasses.replace(body, x0=body.x0 + aside),
            recipe,
            lower=lower,
            blur=outline.edge.blur,
        )
        for lower, aside in zip((False, True), ends_aside(photo.camera, outline), strict=True)
    )
    return body, upper, lower


def _check(quality: Quality, recipe: Recipe) -> None:
    """Refuse what is worse than the recipe's limits; where background or tape is the cause, name it."""
    try:
        quality.check(recipe.limits)
    except MotionBlurred as error:
        smear = quality.tape_blur_px / max(quality.blur_px, 1.0)
        if not (quality.tape_sd_px > _RAGGED and _SMEARED > smear > 1):
            raise
        raise AmbiguousHue(
            "the tapes' edges must be cut straight; these are so ragged that they look like "
            "ones that moved: wind fresh tape with a straight edge",
            tape_sd_px=quality.tape_sd_px,
            tape_blur_px=quality.tape_blur_px,
        ) from error
    except DamagedImage as error:
        if not math.isnan(quality.eta_value):
            raise
        raise NoMuscle(
            "the muscle must stand out from its background all along its outline; the background is "
            "too much like it in places: put a dark cloth behind it",
            axis_kink=quality.axis_kink,
            residual_rms=quality.residual_rms,
            misfit=quality.misfit,
        ) from error


def _with_braid(
    found: Measurement,
    photo: Photograph,
    body: Silhouette,
    upper: Ring,
    lower: Ring,
    recipe: Recipe,
) -> Measurement:
    """The measurement with the braid angle, on which an error of the scale has no influence."""
    braid = braid_angle(
        photo.rgb,
        photo.camera,
        body,
        upper.y,
        lower.y,
        relative_stderr=found.errors.edge / found.mean_diameter,
        n_threads=recipe.n_threads,
    )
    yarns = tuple(yarn_lines(photo.camera, body, upper.y, braid))
    return dataclasses.replace(
        found, braid=braid, trace=dataclasses.replace(found.trace, yarns=yarns)
    )


def _body(camera: Camera, outline: Outline, offset: float) -> Silhouette:
    left, right = outline.left.column - offset, outline.right.column + offset
    try:
        return profile_from_silhouette(camera, outline.rows, left, right)
    except ValueError as error:
        raise NoMuscle(f"the outline is that of no muscle: {error}") from error


def _ring(
    photo: Photograph,
    coarse: Segmentation,
    body: Silhouette,
    recipe: Recipe,
    *,
    lower: bool,
    blur: float,
) -> Ring:
    """The tape's edge, with the radius that the outline has there."""
    tape = coarse.lower if lower else coarse.upper
    u = (tape.left + tape.right) / 2
    v = float(np.polyval(tape.inner, u))
    radius = float(body.radius[-1 if lower else 0])
    y = float(ring_position(photo.camera, u, v, radius, body.x0, body.roll))
    colours = coarse.tape, coarse.braid
    return find_ring(
        photo.rgb, recipe.tone_curve, photo.camera, colours, body, y=y, lower=lower, blur=blur
    )


def _beside(colour: Array, white: Array, recipe: Recipe) -> Array:
    """Linear light of a colour over that of what is taken for white, the largest one 1."""
    values = np.arange(256)
    light, full = (np.interp(each, values, recipe.tone_curve.table) for each in (colour, white))
    ratio = light / np.maximum(full, 1e-4)
    return np.asarray(ratio / ratio.max(), float)


def _quality(
    coarse: Segmentation, outline: Outline, upper: Ring, lower: Ring, recipe: Recipe
) -> Quality:
    hue = hue_of(coarse.tape)
    off = 0.0
    if recipe.tape_hue is not None:
        # Coloured light turns hues; beside the braid, taken for white, the tape has its own again.
        seen = hue, hue_of(_beside(coarse.tape, coarse.braid, recipe))
        off = min(hues_apart(each, recipe.tape_hue) for each in seen)
    sides = (outline.left, outline.right)
    columns = (outline.left.column, outline.right.column)
    return Quality(
        eta_value=coarse.eta_value,
        eta_hue=coarse.eta_hue,
        blur_px=outline.edge.blur,
        kappa=max(side.kappa for side in sides),
        axis_deviation=axis_deviation(*columns),
        axis_kink=axis_kink(*columns),
        misfit=outline.edge.misfit,
        flank=outline.edge.flank,
        rim=outline.edge.rim,
        outlier_fraction=max(side.outliers for side in sides),
        residual_rms=max(side.residual for side in sides),
        tape_sd_px=max(upper.spread, lower.spread),
        tape_blur_px=max(upper.blur, lower.blur),
        saturated=coarse.saturated,
        tape_hue_deg=hue,
        tape_hue_error_deg=off,
    )

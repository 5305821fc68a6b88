"""From one photograph to a muscle's shape."""

import dataclasses
import math
from os import PathLike, fspath

import numpy as np

from .arrays import Image
from .axis import axis_of, distance_by_tapes, ends_aside
from .camera import Silhouette, profile_from_silhouette
from .ends import Ring, check_tape_diameter, find_ring
from .errors import (
    AmbiguousHue,
    DamagedImage,
    ImagingError,
    MotionBlurred,
    NoMuscle,
    WrongOrientation,
)
from .outline import Outline, axis_deviation, axis_kink, find_outline, without_dents
from .photograph import Reader, read_image
from .profile import Measurement, Photograph, Trace, measurement_of_body
from .quality import Quality
from .recipe import Recipe
from .segment import Segmentation, edge_light, hue_of, hues_apart, segment
from .weave import braid_angle

_OUTLINE, _TAPES, _MIDLINE = (255, 40, 40), (255, 220, 0), (0, 230, 230)  # RGB
_BITS = 4  # of the fraction of a pixel in which OpenCV draws
_MARGIN = 0.6  # of the muscle's width, kept beside it


def draw_overlay(image: Image, trace: Trace, *, crop: bool = True, thickness: int = 1) -> Image:
    """The picture with outline (red), tape edges (yellow) and mid-line (cyan).

    Lines are drawn to a sixteenth of a pixel where the edges were found, before perspective and
    roll are undone.

    Args:
        image: RGB, shape (h, w, 3).
        trace: of its measurement.
        crop: cut the picture down to the muscle and its surroundings.
        thickness: of the lines [px].

    Returns:
        RGB, dtype uint8; a picture that was turned to be measured stays turned.
    """
    import cv2  # noqa: PLC0415

    drawn = np.ascontiguousarray(np.rot90(image, -1) if trace.turned else image).copy()
    lines = (
        (trace.left, trace.rows, _OUTLINE),
        (trace.right, trace.rows, _OUTLINE),
        (*trace.upper, _TAPES),
        (*trace.lower, _TAPES),
        ((trace.left + trace.right) / 2, trace.rows, _MIDLINE),
    )
    for u, v, colour in lines:
        points = np.round(np.stack([u, v], axis=1) * 2**_BITS).astype(np.int32)
        cv2.polylines(drawn, [points], False, colour, thickness, cv2.LINE_AA, _BITS)
    if not crop:
        return drawn
    margin = _MARGIN * float(np.median(trace.right - trace.left))
    v = np.concatenate([trace.rows, trace.upper[1], trace.lower[1]])
    top, bottom = int(max(v.min() - margin, 0)), int(v.max() + margin) + 1
    left, right = int(max(trace.left.min() - margin, 0)), int(trace.right.max() + margin) + 1
    return drawn[top:bottom, left:right]


_LEAST_WIDTH = 16  # px
_RAGGED = 1.5  # px, scatter of a tape's edge from which its teeth may pass for blur
_PASSES = 3  # towards the distance of the tapes' arcs, each linear in what is left
_SMEARED = 2.0  # times the outline's blur, from which it is motion all the same


def measure(
    image: str | PathLike[str] | Image, recipe: Recipe, *, reader: Reader = read_image,
) -> Measurement:  # fmt: skip
    """The shape of the muscle in one photograph, with standard errors and quality figures.

    Coarse segmentation, outline by the limb model, exact inversion of the silhouette, the tapes'
    edges as rings of the radius found, D(z) between them. `MeasurementErrors`, the class of
    `Measurement.errors`, describes how the standard errors are composed.

    Args:
        image: path of a picture, or the picture itself: RGB, dtype uint8, shape (h, w, 3).
        recipe: every choice.
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
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or min(rgb.shape[:2]) < 64:
            raise ValueError(
                "a picture is RGB of dtype uint8 and shape (h, w, 3), 64 px or more each way; got "
                f"{rgb.dtype} and {rgb.shape}"
            )
        photo = Photograph(rgb, recipe.camera(rgb.shape[1], rgb.shape[0]), path)
        if recipe.orientation == "horizontal":
            return _measured(photo.clockwise(), recipe)
        try:
            return _measured(photo, recipe)
        except WrongOrientation:
            if recipe.orientation == "vertical":
                raise
            return _measured(photo.clockwise(), recipe)
    except ImagingError as error:
        raise error.at(path) from error if path else None


def _measured(photo: Photograph, recipe: Recipe) -> Measurement:
    coarse = segment(photo.rgb, recipe.tape_hue)
    width = float(np.min(coarse.right - coarse.left))
    if width < _LEAST_WIDTH:
        raise NoMuscle(f"a muscle must be at least {_LEAST_WIDTH} px wide", width_px=width)
    image, amount = edge_light(photo.rgb, coarse, recipe.tone_curve)
    seen = find_outline(
        image, amount, coarse.rows, coarse.left, coarse.right,
        resolution=recipe.smoothing_px, blur=recipe.blur_px,
    )  # fmt: skip
    outline = without_dents(seen)
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
        check_tape_diameter(photo, coarse, body, recipe, recipe.tape_diameter)
    stated = recipe.distance is not None
    axis = axis_of(photo.camera, outline, body, upper, lower, stated=stated)
    found = measurement_of_body(photo, outline, body, upper, lower, recipe, quality, axis)
    if not recipe.braid_angle:
        return found
    # An error of the scale has no influence on the angle.
    relative = found.errors.edge / found.mean_diameter
    braid = braid_angle(photo, body, upper.y, lower.y, relative, n_threads=recipe.n_threads)
    return dataclasses.replace(found, braid=braid)


def _placed(
    photo: Photograph, coarse: Segmentation, outline: Outline, recipe: Recipe
) -> tuple[Silhouette, Ring, Ring]:
    """The body behind the outline, and the edges of its upper and lower tape."""
    offset = recipe.edge_offset_px * np.array([[-1.0], [1.0]])
    try:
        body = profile_from_silhouette(photo.camera, outline.rows, *(outline.columns + offset))
    except ValueError as error:
        raise NoMuscle(f"the outline is that of no muscle: {error}") from error
    upper, lower = (
        find_ring(
            photo, recipe.tone_curve, coarse, dataclasses.replace(body, x0=body.x0 + aside),
            outline.edge.blur, lower=lower,
        )
        for lower, aside in zip((False, True), ends_aside(photo.camera, outline), strict=True)
    )  # fmt: skip
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


def _quality(
    coarse: Segmentation, outline: Outline, upper: Ring, lower: Ring, recipe: Recipe
) -> Quality:
    hue = hue_of(coarse.tape)
    off = 0.0
    if recipe.tape_hue is not None:
        # Coloured light turns hues; beside the braid, taken for white, the tape has its own again.
        table = recipe.tone_curve.table
        tape, white = (np.interp(one, np.arange(256), table) for one in (coarse.tape, coarse.braid))
        beside = tape / np.maximum(white, 1e-4)
        seen = hue, hue_of(beside / beside.max())
        off = min(hues_apart(each, recipe.tape_hue) for each in seen)
    sides = (outline.left, outline.right)
    return Quality(
        eta_value=coarse.eta_value, eta_hue=coarse.eta_hue, blur_px=outline.edge.blur,
        kappa=max(side.kappa for side in sides), axis_deviation=axis_deviation(*outline.columns),
        axis_kink=axis_kink(*outline.columns), misfit=outline.edge.misfit, flank=outline.edge.flank,
        rim=outline.edge.rim, outlier_fraction=max(side.outliers for side in sides),
        residual_rms=max(side.residual for side in sides),
        tape_sd_px=max(upper.spread, lower.spread), tape_blur_px=max(upper.blur, lower.blur),
        saturated=coarse.saturated, tape_hue_deg=hue, tape_hue_error_deg=off,
    )  # fmt: skip

"""Measure a muscle's shape D(z) in one photograph, with standard errors."""

import dataclasses
import math
from os import PathLike
from typing import NamedTuple

import numpy as np

from . import errors
from .camera import Array, Image, Silhouette, profile_from_silhouette
from .edge import moved_by_limb, shine_of
from .ends import Ring, axis_of, check_tape_diameter, distance_by_tapes, ends_aside, find_ring
from .outline import Outline, correlated_points, find_outline, off_smooth_midline, smooth
from .photograph import Photograph, named
from .recipe import Quality, Recipe
from .segment import Segmentation, edge_light, segment
from .weave import BraidAngle, braid_angle


class Trace(NamedTuple):
    """Positions of the edges in the picture [px], for visual inspection.

    Attributes:
        rows: v, shape (n,).
        left, right: u of the outline, shape (n,).
        upper, lower: u, v of the inner edges of the tapes, shape (2, k).
        turned: True if the picture was first rotated a quarter turn clockwise; the positions then refer to
            the rotated picture.
    """

    rows: Array
    left: Array
    right: Array
    upper: Array
    lower: Array
    turned: bool = False


class MeasurementErrors(NamedTuple):
    """Components of the standard errors of diameter and length.

    All components are estimated from the picture itself. The random error of D combines the edge scatter
    that remains after smoothing with the detail that smoothing removes. The edge scatter is at least that
    of the mid-line, because the mid-line of a body of revolution is smooth. The systematic error of an edge
    is the root sum square of two parts: the larger of the first two terms below, and the third. Here s is
    the blur, and kappa and the misfit are defined in `Quality`; the coefficients were determined from
    rendered pictures:

    - 0.018 s, with s at least 1: shading of the outermost threads that remains after the correction for the
      light of the first thread (see `EdgeProfile.shifts`);
    - light from only one lamp: 0.6 times the mean edge shift due to kappa, because the brightness follows
      the square-root law only on a limb that the lamp reaches; and 0.8 s times the waves (see
      `EdgeProfile`) in excess of the 0.055 found on braids lit from both sides, because threads cast
      shadows on a limb lit from the front;
    - 16 m s for halos, sharpening and other blur that differs from the model. Here m is the misfit in
      excess of 0.001 s^2 (s up to 1.5), the part of the misfit due to threads.

    If black threads hide part of the edge, 0.03 px per edge is added for dents that both sides share and
    for threads that protrude next to hidden ones.

    If the rim is bright (0.98 to 1.03) or the flank falls (-0.04 to -0.08), up to 0.13 s is added, because
    gloss or a lamp behind the muscle makes it look wider.

    The error of the length combines the scatter of both tape edges with 0.05 px per tape for the shading of
    the threads, and with the same 16 m s.

    If no tone curve is stated, 0.09 s is added for each edge of the muscle and tapes, with full
    correlation. This is one third of the shift caused by a gamma of 0.75 or 1.25, and 0.8 of that due to an
    S-curve. For the contributions of tilt, distance and bow to the error of the length, see `axis_of`.

    Effects that pictures cannot show are not included: a stated tone curve that is wrong, and threads so
    coarse that their mirrored pattern survives the smoothing. Below 4500 px/m (115 px/in), errors in
    D(z) of rendered braids reach twice the standard error; errors in length and mean diameter reach 1.3
    standard errors at 50 to 110 px/in.

    Attributes:
        edge: systematic error of the diameter, common to all positions [m].
        density: variance of the diameter's random error times its correlation length [m^3].
        ends: error of the length due to the tape edges [m].
        scale: relative error of the scale.
    """

    edge: float
    density: float
    ends: float
    scale: float


@dataclasses.dataclass(frozen=True)
class Measurement:
    """A muscle's shape in one photograph, corrected for perspective, roll and lens distortion.

    The measured edge is the mean outline of the woven threads, whereas a caliper touches their crests.

    Attributes:
        path: path of the picture; empty if it was passed as an array.
        z: positions from the upper tape edge, 0 to the length [m], shape (n,).
        diameter: D at z [m], shape (n,).
        diameter_stderr: standard error of D, including the scale [m], shape (n,).
        length: distance between the inner tape edges along the axis [m].
        px_per_m: scale in the mid-plane [px/m].
        roll: roll of the axis, positive clockwise [rad].
        x0: distance of the axis from the optical axis [m].
        errors: components of the standard errors.
        quality: quality figures.
        distance: distance from camera to axis [m], stated or estimated from the tape edges.
        distance_stderr: standard error of the distance, 0 if stated [m].
        tilt, tilt_stderr: tilt of the axis in depth, positive with its lower end away from the camera
            [rad], and its standard error.
        bow: largest deviation of the mid-line from a straight line [m].
        warnings: effects that the standard errors do not cover, or cover only in part.
        trace: edges in the picture.
        braid: braid angle profile; None unless the recipe requests it.
    """

    path: str
    z: Array
    diameter: Array
    diameter_stderr: Array
    length: float
    px_per_m: float
    roll: float
    x0: float
    errors: MeasurementErrors
    quality: Quality
    trace: Trace
    distance: float = math.nan
    distance_stderr: float = 0.0
    tilt: float = 0.0
    tilt_stderr: float = math.nan
    bow: float = 0.0
    warnings: tuple[str, ...] = ()
    braid: BraidAngle | None = None

    @property
    def length_stderr(self) -> float:
        """Standard error of the length [m]."""
        return math.hypot(self.errors.ends, self.length * self.errors.scale)

    @property
    def mean_diameter(self) -> float:
        """Mean of D over the length [m]."""
        return float(np.trapezoid(self.diameter, self.z) / self.length)

    @property
    def mean_diameter_stderr(self) -> float:
        """Standard error of the mean diameter [m]."""
        mean = self.mean_diameter
        at_ends = float(self.diameter[[0, -1]].mean() - mean) / self.length * self.errors.ends
        random = math.sqrt(self.errors.density / self.length)
        return math.hypot(self.errors.edge, random, at_ends, mean * self.errors.scale)

    @property
    def volume(self) -> float:
        """Volume inside the outline, the integral of pi D^2 / 4 [m^3]."""
        return float(np.trapezoid(np.pi / 4 * self.diameter**2, self.z))

    @property
    def volume_stderr(self) -> float:
        """Standard error of the volume [m^3]."""
        by_edge = np.pi / 2 * float(np.trapezoid(self.diameter, self.z)) * self.errors.edge
        squared = float(np.trapezoid((np.pi / 2 * self.diameter) ** 2, self.z))
        at_ends = np.pi / 4 * float(np.mean(self.diameter[[0, -1]] ** 2)) * self.errors.ends
        random = math.sqrt(self.errors.density * squared)
        return math.hypot(by_edge, random, at_ends, 3 * self.volume * self.errors.scale)


# Coefficients of `MeasurementErrors`, per edge:
_SHADE = 0.018  # times blur
_OF_TONE = 0.09  # times blur, also per tape
_OF_LIGHT = 0.6  # times the edge shift due to kappa
_OF_WAVES = 0.8  # times blur
_PLAIN = 0.055  # waves of braids lit from both sides
_OF_MISFIT = 16.0  # px per px of blur
_OF_THREADS = 0.001  # misfit due to threads, per px^2 of blur
_WIDEST = 1.5  # px of blur up to which that misfit grows
_HIDDEN = 0.03  # px, if black threads hide part of the edge
_RING_BIAS = 0.05  # px
_OF_GLOSS = 0.13  # times blur


def _random_part(outline: Outline) -> tuple[Array, float]:
    """Return the random error of the width in each row [px], and its density: variance x length [px^3].

    This is the larger of two estimates: the edge scatter that passes the smoothing, and the scatter of the
    mid-line, which equals that of the width if the errors of the two edges are independent. Only the first
    includes patterns mirrored on both sides; only the second includes waves longer than the resolution.
    """
    random = np.hypot(outline.left.stderr, outline.right.stderr)
    off = off_smooth_midline(*outline.columns)
    scatter, stretch = 2 * float(np.sqrt(np.mean(off**2))), correlated_points(off)
    square = float(np.mean(random**2))
    random = random * math.sqrt(max(1.0, scatter**2 / square))
    width = np.diff(outline.columns, axis=0)[0]
    # A second smoothing removes as much as the first.
    removed = width - smooth(width, outline.resolution)
    return np.hypot(random, removed), max(square, scatter**2) * stretch


def _systematic_part(outline: Outline, *, stated: bool) -> tuple[float, float]:
    """Return the systematic errors of width and length [px]."""
    seen, sides = outline.edge, (outline.left, outline.right)
    radius, s = float(np.median(np.diff(outline.columns, axis=0))) / 2, seen.blur
    moved = [moved_by_limb(side.kappa, s, radius) for side in sides]
    by_lamp = _OF_LIGHT * abs(sum(moved)) / 2  # the same law on both sides
    shine = shine_of(seen.rim, seen.flank)
    waves = (1 - shine) * math.sqrt(max(seen.waves**2 - _PLAIN**2, 0.0))
    light = math.hypot(by_lamp, _OF_WAVES * waves * max(1.0, s))
    misfit = math.sqrt(max(seen.misfit**2 - (_OF_THREADS * min(s, _WIDEST) ** 2) ** 2, 0.0))
    lens, tone = _OF_MISFIT * misfit * s, 0.0 if stated else _OF_TONE * s
    shade, gloss = _SHADE * max(1.0, s), _OF_GLOSS * shine * max(1.0, s)
    hidden = _HIDDEN * (sum(side.hidden for side in sides) > 0)
    edge = 2 * math.hypot(max(shade, light), lens, tone, gloss, hidden)
    # The tone curve moves both tape edges in opposite directions, so the shifts add.
    return edge, 2 * math.hypot(math.hypot(_RING_BIAS, lens) / math.sqrt(2), tone)


def _of_placement(recipe: Recipe) -> tuple[str, ...]:
    """Return a warning if the standard error of the ruler's placement is not stated."""
    part = 0.00254 / recipe.camera_distance
    if recipe.scale.source != "ruler" or recipe.scale.placement_stderr is not None:
        return ()
    return (
        "the ruler is assumed to lie in the plane of the axis; an offset of 0.1 in changes "
        f"all lengths by {part:.2%}: state the offset's standard error, as in --ruler-placement 0.01in",
    )


_OUTLINE, _TAPES, _MIDLINE = (255, 40, 40), (255, 220, 0), (0, 230, 230)  # RGB
_BITS = 4  # fractional bits of OpenCV's drawing coordinates
_MARGIN = 0.6  # margin relative to the muscle's width


def draw_overlay(image: Image, trace: Trace, *, thickness: int = 1) -> Image:
    """Draw the outline (red), tape edges (yellow) and mid-line (cyan) on a picture.

    The lines mark the detected edges to a sixteenth of a pixel, without correction for perspective or roll.

    Args:
        image: picture, RGB, shape (h, w, 3).
        trace: detected edges, from `Measurement.trace`.
        thickness: line thickness [px].

    Returns:
        RGB picture, dtype uint8, cropped to the muscle and rotated as for the measurement.
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
    margin = _MARGIN * float(np.median(trace.right - trace.left))
    v = np.concatenate([trace.rows, trace.upper[1], trace.lower[1]])
    top, bottom = int(max(v.min() - margin, 0)), int(v.max() + margin) + 1
    left, right = int(max(trace.left.min() - margin, 0)), int(trace.right.max() + margin) + 1
    return drawn[top:bottom, left:right]


_LEAST_WIDTH = 16  # px
_PASSES = 3  # Newton steps for the camera distance


def measure(image: str | PathLike[str] | Image, recipe: Recipe) -> Measurement:
    """Measure the shape of the muscle in one photograph, with standard errors and quality figures.

    The picture is first segmented coarsely. The outline is located with the limb model and inverted exactly
    to a body of revolution, and the tape edges are located as rings on this body. `MeasurementErrors`
    describes the standard errors.

    Args:
        image: path of a picture, or an RGB array, dtype uint8, shape (h, w, 3).
        recipe: measurement settings.

    Raises:
        ImagingError: the picture cannot be measured (a subclass names the cause), the array is not a
            picture, or the crop extends beyond its frame.
    """
    with named(image) as (rgb, path):
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or min(rgb.shape[:2]) < 64:
            raise errors.ImagingError(
                "a picture must be RGB, dtype uint8, shape (h, w, 3), with h and w >= 64; got "
                f"{rgb.dtype} and {rgb.shape}"
            )
        photo = Photograph(rgb, recipe.camera(rgb.shape[1], rgb.shape[0]), path)
        if recipe.orientation != "horizontal":
            try:
                return _measured(photo, recipe)
            except errors.WrongOrientation:
                if recipe.orientation == "vertical":
                    raise
        return _measured(photo.clockwise(), recipe)


def _measured(photo: Photograph, recipe: Recipe) -> Measurement:
    coarse = segment(photo.rgb)
    width = float(np.min(coarse.right - coarse.left))
    if width < _LEAST_WIDTH:
        raise errors.NoMuscle(f"the muscle must be at least {_LEAST_WIDTH} px wide", width_px=width)
    image, amount = edge_light(photo.rgb, coarse, recipe.tone_curve)
    outline = find_outline(
        image, amount, coarse.rows, coarse.left, coarse.right, resolution=recipe.smoothing_px
    )
    stated, number = recipe.distance is not None, 0
    while True:
        body, upper, lower = _placed(photo, coarse, outline, recipe)
        if stated or number == _PASSES:
            break
        distance = distance_by_tapes(body, upper, lower, photo.camera.distance, found=number > 0)
        if distance == photo.camera.distance:
            break
        camera, number = photo.camera.moved(distance), number + 1
        camera = camera if recipe.k1 is None else dataclasses.replace(camera, k1=recipe.k1)
        photo = dataclasses.replace(photo, camera=camera)
    quality = _quality(coarse, outline, upper, lower)
    quality.check()
    if recipe.tape_diameter is not None:
        check_tape_diameter(photo, coarse, body, recipe, recipe.tape_diameter)
    axis = axis_of(photo.camera, outline, body, upper, lower, stated=stated)
    px_per_m, relative = photo.camera.px_per_m, recipe.scale.relative_stderr
    px = 1 / px_per_m
    first, last = (ring.y + beyond for ring, beyond in zip((upper, lower), axis.ends, strict=True))
    length = (last - first) * axis.length_factor
    part = np.linspace(0, 1, max(16, round(length * px_per_m) + 1))
    y = first + (last - first) * part
    random, density = _random_part(outline)
    at = np.linspace(body.y[0], body.y[-1], random.size)
    edge, both_rings = _systematic_part(outline, stated=recipe.tone is not None)
    diameter = 2 * body.radius_at(y) * np.interp(y, at, axis.cosine)
    edge = math.hypot(edge, axis.diameter_stderr * float(diameter.mean()) * px_per_m)
    stderr = np.sqrt((np.interp(y, at, random) ** 2 + edge**2) * px**2 + (diameter * relative) ** 2)
    found = Measurement(
        path=photo.path, z=length * part, diameter=diameter, diameter_stderr=stderr, length=length,
        px_per_m=px_per_m, roll=body.roll, x0=body.x0,
        errors=MeasurementErrors(
            edge=edge * px,
            density=density * px**3,
            ends=math.hypot(upper.stderr, lower.stderr, both_rings * px, axis.length_stderr),
            scale=relative,
        ),
        quality=quality, distance=axis.distance, distance_stderr=axis.distance_stderr,
        tilt=axis.tilt, tilt_stderr=axis.tilt_stderr, bow=axis.bow,
        warnings=(*axis.warnings, *_of_placement(recipe)),
        trace=Trace(outline.rows.astype(float), outline.left.column, outline.right.column, upper.arc,
                    lower.arc, photo.turned),
    )  # fmt: skip
    if not recipe.braid_angle:
        return found
    # The scale error does not affect the angle.
    braid = braid_angle(photo, body, upper.y, lower.y, found.errors.edge / found.mean_diameter)
    return dataclasses.replace(found, braid=braid)


def _placed(
    photo: Photograph, coarse: Segmentation, outline: Outline, recipe: Recipe
) -> tuple[Silhouette, Ring, Ring]:
    body = profile_from_silhouette(photo.camera, outline.rows, *outline.columns)
    upper, lower = (
        find_ring(
            photo, recipe.tone_curve, coarse, dataclasses.replace(body, x0=body.x0 + aside),
            outline.edge.blur, lower=lower,
        )
        for lower, aside in zip((False, True), ends_aside(photo.camera, outline), strict=True)
    )  # fmt: skip
    return body, upper, lower


def _quality(coarse: Segmentation, outline: Outline, upper: Ring, lower: Ring) -> Quality:
    sides, middle = (outline.left, outline.right), outline.columns.mean(axis=0)
    bent = middle - np.polynomial.Polynomial.fit(outline.rows, middle, 1)(outline.rows)
    radius = float(np.diff(outline.columns, axis=0).mean()) / 2
    return Quality(
        eta_value=coarse.eta_value, eta_hue=coarse.eta_hue, blur_px=outline.edge.blur,
        kappa=max(side.kappa for side in sides), axis_deviation=float(bent.std()) / radius,
        axis_kink=float(np.abs(off_smooth_midline(*outline.columns)).max()) / radius,
        misfit=outline.edge.misfit, flank=outline.edge.flank, rim=outline.edge.rim,
        outlier_fraction=max(side.outliers for side in sides),
        residual_rms=max(side.residual for side in sides),
        tape_sd_px=max(upper.spread, lower.spread), tape_blur_px=max(upper.blur, lower.blur),
        saturated=coarse.saturated,
    )  # fmt: skip

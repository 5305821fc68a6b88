"""From one photograph to a muscle's shape D(z) and its errors."""

import dataclasses
import math
from os import PathLike
from typing import NamedTuple

import numpy as np

from . import errors
from .camera import Array, Image, Silhouette, profile_from_silhouette
from .edge import moved_by_limb, shine_of
from .ends import Axis, Ring, axis_of, check_tape_diameter, distance_by_tapes, ends_aside, find_ring
from .outline import (
    Outline,
    axis_deviation,
    axis_kink,
    correlated_points,
    find_outline,
    off_smooth_midline,
    smooth,
    without_dents,
)
from .photograph import Photograph, named
from .recipe import Quality, Recipe
from .segment import Segmentation, edge_light, hue_of, hues_apart, segment
from .weave import BraidAngle, braid_angle


class Trace(NamedTuple):
    """Positions of the edges in the picture [px], for a visual check.

    Attributes:
        rows: v, shape (n,).
        left, right: u of the outline, shape (n,).
        upper, lower: u, v of the inner edges of the tapes, shape (2, k).
        turned: the picture was turned a quarter turn clockwise first, and these positions are in
            the turned one.
    """

    rows: Array
    left: Array
    right: Array
    upper: Array
    lower: Array
    turned: bool = False


class MeasurementErrors(NamedTuple):
    """The parts of the standard error of a diameter and a length.

    Each has its cause in the picture itself. The random part of D is the scatter of the edges that
    passes the smoothing, no less than that of the mid-line, which a body of revolution has smooth,
    and what the smoothing rounds off. The systematic part of an edge is the root of the summed
    squares of the larger of the first two and of the third, with blur s, kappa and misfit m as in
    `Quality`, each coefficient read off rendered pictures of known truth:

    - 0.018 s, s no less than 1: the shade of the outermost threads, within whose width the edge is fitted,
      beyond what the light of the first one says of it (see `EdgeProfile.shifts`);
    - the light of one lamp, where it is the larger: 0.6 of what kappa moves the edges by, on average of
      both, since light falls off as the root of the distance only on a limb that the lamp reaches; and
      0.8 s times the waves (see `EdgeProfile`) beyond the 0.055 of braids that are lit from both sides,
      as threads throw shades on a limb that is lit from the front;
    - 16 m s, of the misfit m beyond the 0.001 s^2, s up to 1.5, that threads leave within the part of the
      edge that is fitted: a lens or a camera program that spreads light otherwise than the model, as
      halo and sharpening do.

    Where black threads hide some of the edge, 0.03 px for each edge are added: dents that both sides have
    in the same rows, and what stands out beside hidden ones.

    A rim brighter than what lies inside of it adds up to 0.13 s, from 0.98 to 1.03, and so does a flank
    that falls, from -0.04 to -0.08: gloss there, or a lamp behind the muscle, looks like more of it.

    The length has the scatter of both edges along their tapes, and for each tape 0.05 px, the shade
    of the threads there, and the same 16 m s.

    A tone curve that was not stated adds 0.09 s to each edge of muscle and tapes, all alike: a third of
    what a gamma of 0.75 or 1.25 does to a step, and an S-curve of 0.8. Axis, distance and bow add
    to the length as `axis_of` says.

    What no picture shows is not in it: a tone curve that was stated and is not the camera's, and
    threads so coarse that their pattern, mirrored on both sides, passes the smoothing whole. Where
    px_per_m is below 4500 (115 px/in), D(z) of rendered braids is off by up to twice its standard
    error; length and mean diameter by 1.3 times theirs at 50 to 110 px/in.

    Attributes:
        edge: systematic part of the diameter, of both edges, common to all of it [m].
        density: of the diameter's random part along the axis, variance times length [m^3].
        ends: of the length, from the tapes' edges [m].
        scale: relative, of the scale.
    """

    edge: float
    density: float
    ends: float
    scale: float


@dataclasses.dataclass(frozen=True)
class Measurement:
    """A muscle's shape in one photograph, corrected for perspective, roll and lens distortion.

    The optical edge is the mean outline of the woven threads; a caliper touches their crests.

    Attributes:
        path: of the picture; empty for an array.
        z: positions from the upper tape's edge, 0 to the length [m], shape (n,).
        diameter: D at z [m], shape (n,).
        diameter_stderr: its standard error, that of the scale included [m], shape (n,).
        length: between the inner edges of the tapes along the axis [m].
        px_per_m: scale in the mid-plane [px/m].
        roll: of the axis, clockwise positive [rad].
        x0: distance of the axis from the optical axis [m].
        errors: the parts of the standard errors.
        quality: the figures by which to judge it.
        distance: of the camera to the axis [m]: the stated one, or that of the tapes' arcs.
        distance_stderr: its standard error, 0 where it was stated [m].
        tilt, tilt_stderr: of the axis in depth, its lower end away from the camera [rad].
        bow: largest deviation of the mid-line from a straight one [m].
        warnings: what the errors do not hold, or hold only in part, in words.
        trace: the edges in the picture.
        braid: the braid angle along it; None where the recipe does not ask for it.
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
    def maximum_diameter(self) -> float:
        """Largest D [m]."""
        return float(self.diameter.max())

    @property
    def volume(self) -> float:
        """Volume within the outline, integral of pi D^2 / 4 [m^3]."""
        return float(np.trapezoid(np.pi / 4 * self.diameter**2, self.z))

    @property
    def volume_stderr(self) -> float:
        """Standard error of the volume [m^3]."""
        by_edge = np.pi / 2 * float(np.trapezoid(self.diameter, self.z)) * self.errors.edge
        squared = float(np.trapezoid((np.pi / 2 * self.diameter) ** 2, self.z))
        at_ends = np.pi / 4 * float(np.mean(self.diameter[[0, -1]] ** 2)) * self.errors.ends
        random = math.sqrt(self.errors.density * squared)
        return math.hypot(by_edge, random, at_ends, 3 * self.volume * self.errors.scale)


_SHADE = 0.018  # of the blur, per edge
_OF_TONE = 0.09  # of the blur, per edge and per tape
_OF_LIGHT = 0.6  # of what the fall of light towards the limb moves an edge by
_OF_WAVES = 0.8  # of the blur, per edge
_PLAIN = 0.055  # waves of braids that are lit from both sides
_OF_MISFIT = 16.0  # px per edge and px of blur
_OF_THREADS = 0.001  # misfit that threads leave, per px^2 of blur
_WIDEST = 1.5  # px of blur, up to which it grows
_HIDDEN = 0.03  # px per edge, where black threads hide some of it
_RING_BIAS = 0.05  # px
_OF_GLOSS = 0.13  # of the blur, per edge
_OF_AXIS = ("distance", "distance_stderr", "tilt", "tilt_stderr", "bow")


def measurement_of_body(
    photo: Photograph, outline: Outline, body: Silhouette, upper: Ring, lower: Ring, recipe: Recipe,
    quality: Quality, axis: Axis,
) -> Measurement:  # fmt: skip
    """Make the measurement; `MeasurementErrors` describes the parts of the standard errors."""
    px_per_m, relative = photo.camera.px_per_m, recipe.scale.relative_stderr
    px = 1 / px_per_m
    first, last = (ring.y + beyond for ring, beyond in zip((upper, lower), axis.ends, strict=True))
    length = (last - first) * axis.length_factor
    part = np.linspace(0, 1, max(16, round(length * px_per_m) + 1))
    y = first + (last - first) * part
    random, density = _random_part(outline)
    at = np.linspace(body.y[0], body.y[-1], random.size)
    edge, both_rings = _systematic_part(quality, outline, stated=recipe.tone is not None)
    edge = math.hypot(edge, 2 * _HIDDEN * (outline.left.hidden + outline.right.hidden > 0))
    diameter = 2 * body.radius_at(y) * np.interp(y, at, axis.cosine)
    left, right = outline.columns
    edge = math.hypot(edge, axis.diameter_stderr * float(diameter.mean()) * px_per_m)
    stderr = np.sqrt((np.interp(y, at, random) ** 2 + edge**2) * px**2 + (diameter * relative) ** 2)
    return Measurement(
        path=photo.path, z=length * part, diameter=diameter, diameter_stderr=stderr, length=length,
        px_per_m=px_per_m, roll=body.roll, x0=body.x0,
        errors=MeasurementErrors(
            edge=edge * px,
            density=density * px**3,
            ends=math.hypot(upper.stderr, lower.stderr, both_rings * px, axis.length_stderr),
            scale=relative,
        ),
        quality=quality, **{name: getattr(axis, name) for name in _OF_AXIS},
        warnings=(*axis.warnings, *_of_placement(recipe)),
        trace=Trace(outline.rows.astype(float), left, right, upper.arc, lower.arc, photo.turned),
    )  # fmt: skip


def _random_part(outline: Outline) -> tuple[Array, float]:
    """Random error of the width in every row [px], and its density, variance times length [px^3].

    The larger of two: what passes the smoothing of the edges' scatter, and the scatter of the
    mid-line, which is the width's where the edges err independently. Threads that both sides show
    mirrored are in the first alone, waves longer than the smoothing in the second alone.
    """
    random = np.hypot(outline.left.stderr, outline.right.stderr)
    off = off_smooth_midline(*outline.columns)
    scatter, stretch = 2 * float(np.sqrt(np.mean(off**2))), correlated_points(off)
    square = float(np.mean(random**2))
    random = random * math.sqrt(max(1.0, scatter**2 / square))
    width = np.diff(outline.columns, axis=0)[0]
    rounded = width - smooth(width, outline.resolution)  # by a second smoothing as by the first
    return np.hypot(random, rounded), max(square, scatter**2) * stretch


def _systematic_part(quality: Quality, outline: Outline, *, stated: bool) -> tuple[float, float]:
    """Systematic error of the width and of the length [px]."""
    radius, s = float(np.median(np.diff(outline.columns, axis=0))) / 2, quality.blur_px
    moved = [moved_by_limb(side.kappa, s, radius) for side in (outline.left, outline.right)]
    by_lamp = _OF_LIGHT * abs(sum(moved)) / 2  # the same law on both sides
    shine = shine_of(quality.rim, quality.flank)
    waves = (1 - shine) * math.sqrt(max(outline.edge.waves**2 - _PLAIN**2, 0.0))
    light = math.hypot(by_lamp, _OF_WAVES * waves * max(1.0, s))
    misfit = math.sqrt(max(quality.misfit**2 - (_OF_THREADS * min(s, _WIDEST) ** 2) ** 2, 0.0))
    lens, tone = _OF_MISFIT * misfit * s, 0.0 if stated else _OF_TONE * s
    shade, gloss = _SHADE * max(1.0, s), _OF_GLOSS * shine * max(1.0, s)
    edge = 2 * math.hypot(max(shade, light), lens, tone, gloss)
    # Both tapes' edges move towards them, or from them, by the same tone curve.
    return edge, 2 * math.hypot(math.hypot(_RING_BIAS, lens) / math.sqrt(2), tone)


def _of_placement(recipe: Recipe) -> tuple[str, ...]:
    """A warning of what the recipe leaves open and no picture shows."""
    part = 0.00254 / recipe.camera_distance
    if recipe.scale.source != "ruler" or recipe.scale.placement_stderr is not None:
        return ()
    return (
        "the ruler is taken to lie in the plane of the axis, which was not stated: 0.1 in off makes "
        f"all lengths wrong by {part:.2%}; say how well it lay there, --ruler-placement 0.01in",
    )


_OUTLINE, _TAPES, _MIDLINE = (255, 40, 40), (255, 220, 0), (0, 230, 230)  # RGB
_BITS = 4  # of the fraction of a pixel in which OpenCV draws
_MARGIN = 0.6  # of the muscle's width, kept beside it


def draw_overlay(image: Image, trace: Trace, *, thickness: int = 1) -> Image:
    """The picture with outline (red), tape edges (yellow) and mid-line (cyan).

    Lines are drawn to a sixteenth of a pixel where the edges were found, before perspective and
    roll are undone.

    Args:
        image: RGB, shape (h, w, 3).
        trace: of its measurement.
        thickness: of the lines [px].

    Returns:
        RGB, dtype uint8, of the muscle and its surroundings; a picture that was turned to be measured stays
        turned.
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
_PASSES = 3  # towards the distance of the tapes' arcs, each linear in what is left


def measure(image: str | PathLike[str] | Image, recipe: Recipe) -> Measurement:
    """The shape of the muscle in one photograph, with standard errors and quality figures.

    Coarse segmentation, outline by the limb model, exact inversion of the silhouette, the tapes'
    edges as rings of the radius found, D(z) between them. `MeasurementErrors`, the class of
    `Measurement.errors`, describes how the standard errors are composed.

    Args:
        image: path of a picture, or the picture itself: RGB, dtype uint8, shape (h, w, 3).
        recipe: every choice.

    Returns:
        The measurement.

    Raises:
        ImagingError: one of its kinds, with the path and the figures, when the picture gives no
            measurement.
        ImagingError: an array that is no picture, or a crop outside its frame.
    """
    with named(image) as (rgb, path):
        if rgb.dtype != np.uint8 or rgb.ndim != 3 or rgb.shape[2] != 3 or min(rgb.shape[:2]) < 64:
            raise errors.ImagingError(
                "a picture is RGB of dtype uint8 and shape (h, w, 3), 64 px or more each way; got "
                f"{rgb.dtype} and {rgb.shape}"
            )
        photo = Photograph(rgb, recipe.camera(rgb.shape[1], rgb.shape[0]), path)
        if recipe.orientation == "horizontal":
            return _measured(photo.clockwise(), recipe)
        try:
            return _measured(photo, recipe)
        except errors.WrongOrientation:
            if recipe.orientation == "vertical":
                raise
            return _measured(photo.clockwise(), recipe)


def _measured(photo: Photograph, recipe: Recipe) -> Measurement:
    coarse = segment(photo.rgb, recipe.tape_hue)
    width = float(np.min(coarse.right - coarse.left))
    if width < _LEAST_WIDTH:
        raise errors.NoMuscle(f"a muscle must be at least {_LEAST_WIDTH} px wide", width_px=width)
    image, amount = edge_light(photo.rgb, coarse, recipe.tone_curve)
    seen = find_outline(
        image, amount, coarse.rows, coarse.left, coarse.right,
        resolution=recipe.smoothing_px,
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
    quality.check()
    if recipe.tape_diameter is not None:
        check_tape_diameter(photo, coarse, body, recipe, recipe.tape_diameter)
    stated = recipe.distance is not None
    axis = axis_of(photo.camera, outline, body, upper, lower, stated=stated)
    found = measurement_of_body(photo, outline, body, upper, lower, recipe, quality, axis)
    if not recipe.braid_angle:
        return found
    # An error of the scale has no influence on the angle.
    relative = found.errors.edge / found.mean_diameter
    braid = braid_angle(photo, body, upper.y, lower.y, relative)
    return dataclasses.replace(found, braid=braid)


def _placed(
    photo: Photograph, coarse: Segmentation, outline: Outline, recipe: Recipe
) -> tuple[Silhouette, Ring, Ring]:
    """The body behind the outline, and the edges of its upper and lower tape."""
    body = profile_from_silhouette(photo.camera, outline.rows, *outline.columns)
    upper, lower = (
        find_ring(
            photo, recipe.tone_curve, coarse, dataclasses.replace(body, x0=body.x0 + aside),
            outline.edge.blur, lower=lower,
        )
        for lower, aside in zip((False, True), ends_aside(photo.camera, outline), strict=True)
    )  # fmt: skip
    return body, upper, lower


def _quality(
    coarse: Segmentation, outline: Outline, upper: Ring, lower: Ring, recipe: Recipe
) -> Quality:
    hue = hue_of(coarse.tape)
    off = 0.0
    if recipe.tape_hue is not None:
        # Coloured light turns hues; beside the braid, taken for white, the tape has its own again.
        tape, white = map(recipe.tone_curve.light, (coarse.tape, coarse.braid))
        beside = tape / np.maximum(white, 1e-4)
        seen = hue, hue_of(beside / beside.max())
        off = min(hues_apart(each, recipe.tape_hue) for each in seen)
    sides = outline.left, outline.right
    return Quality(
        eta_value=coarse.eta_value, eta_hue=coarse.eta_hue, blur_px=outline.edge.blur,
        kappa=max(side.kappa for side in sides), axis_deviation=axis_deviation(*outline.columns),
        axis_kink=axis_kink(*outline.columns), misfit=outline.edge.misfit, flank=outline.edge.flank,
        rim=outline.edge.rim, outlier_fraction=max(side.outliers for side in sides),
        residual_rms=max(side.residual for side in sides),
        tape_sd_px=max(upper.spread, lower.spread), tape_blur_px=max(upper.blur, lower.blur),
        saturated=coarse.saturated, tape_hue_deg=hue, tape_hue_error_deg=off,
    )  # fmt: skip

"""D(z) between the tapes, and the errors of it, from an outline and two rings."""

import math

import numpy as np

from ..arrays import Array
from ..camera.silhouette import Silhouette
from ..outline.both_sides import Outline
from ..outline.edge_profile import moved_by_limb, shine_of
from ..outline.midline import off_smooth_midline
from ..outline.smoother import correlated_points, smooth
from ..quality import Quality
from ..recipe import Recipe
from ..tape.ring import Ring
from .axis import Axis
from .measurement import Measurement, MeasurementErrors, Trace
from .photograph import Photograph

_SHADE = 0.018  # of the blur, per edge
_OF_TONE = 0.09  # of the blur, per edge and per tape
_OF_LIGHT = 0.6  # of what the fall of light towards the limb moves an edge by
_OF_WAVES = 0.8  # of the blur, per edge
_PLAIN = 0.055  # waves of braids that are lit from both sides
_OF_MISFIT = 16.0  # px per edge and px of blur
_OF_THREADS = 0.001  # misfit that threads leave, per px^2 of blur
_WIDEST = 1.5  # px of blur, up to which it grows
_HIDDEN = 0.03  # px per edge, where black threads hide some of it
_RING_BIAS = 0.035  # px
_OF_GLOSS = 0.13  # of the blur, per edge


def measurement_of_body(
    photo: Photograph,
    outline: Outline,
    body: Silhouette,
    upper: Ring,
    lower: Ring,
    recipe: Recipe,
    quality: Quality,
    axis: Axis,
) -> Measurement:
    """The measurement; `MeasurementErrors` describes how the standard errors are composed."""
    px_per_m, relative = photo.camera.px_per_m, recipe.scale.relative_stderr
    px = 1 / px_per_m
    first, last = (ring.y + beyond for ring, beyond in zip((upper, lower), axis.ends, strict=True))
    length = (last - first) * axis.length_factor
    part = np.linspace(0, 1, max(16, round(length * px_per_m) + 1))
    y = first + (last - first) * part
    random, density = _random_part(outline)
    at = np.linspace(body.y[0], body.y[-1], random.size)
    edge, both_rings = _systematic_part(quality, outline, stated=recipe.tone is not None)
    hidden = outline.left.hidden + outline.right.hidden > 0
    edge = math.hypot(edge, 2 * _HIDDEN * hidden)
    rows = np.linspace(body.y[0], body.y[-1], axis.cosine.size)
    cosine = np.interp(y, rows, axis.cosine)
    diameter = 2 * body.radius_at(y) * cosine
    edge = math.hypot(edge, axis.diameter_stderr * float(diameter.mean()) * px_per_m)
    stderr = np.sqrt((np.interp(y, at, random) ** 2 + edge**2) * px**2 + (diameter * relative) ** 2)
    return Measurement(
        path=photo.path,
        time=photo.time,
        method=recipe.method,
        z=length * part,
        diameter=diameter,
        diameter_stderr=stderr,
        length=length,
        px_per_m=px_per_m,
        roll=body.roll,
        x0=body.x0,
        errors=MeasurementErrors(
            edge=edge * px,
            density=density * px**3,
            ends=math.hypot(upper.stderr, lower.stderr, both_rings * px, axis.length_stderr),
            scale=relative,
        ),
        quality=quality,
        distance=axis.distance,
        distance_stderr=axis.distance_stderr,
        tilt=axis.tilt,
        tilt_stderr=axis.tilt_stderr,
        bow=axis.bow,
        warnings=(*axis.warnings, *_of_recipe(recipe, length)),
        trace=Trace(
            outline.rows.astype(float),
            outline.left.column,
            outline.right.column,
            upper.arc,
            lower.arc,
            photo.turned,
        ),
    )


def _random_part(outline: Outline) -> tuple[Array, float]:
    """Random error of the width in every row [px], and its density, variance times length [px^3].

    The larger of two: what passes the smoothing of the edges' scatter, and the scatter of the
    mid-line, which is the width's where the edges err independently. Threads that both sides show
    mirrored are in the first alone, waves longer than the smoothing in the second alone.
    """
    random = np.hypot(outline.left.stderr, outline.right.stderr)
    off = off_smooth_midline(outline.left.column, outline.right.column)
    scatter, stretch = 2 * float(np.sqrt(np.mean(off**2))), correlated_points(off)
    square = float(np.mean(random**2))
    random = random * math.sqrt(max(1.0, scatter**2 / square))
    width = outline.right.column - outline.left.column
    rounded = width - smooth(width, outline.resolution)  # by a second smoothing as by the first
    return np.hypot(random, rounded), max(square, scatter**2) * stretch


def _systematic_part(quality: Quality, outline: Outline, *, stated: bool) -> tuple[float, float]:
    """Systematic error of the width and of the length [px]."""
    radius = float(np.median(outline.right.column - outline.left.column)) / 2
    moved = (
        moved_by_limb(side.kappa, outline.edge.blur, radius)
        for side in (outline.left, outline.right)
    )
    by_lamp = _OF_LIGHT * abs(sum(moved)) / 2  # the same law on both sides
    shine = shine_of(quality.rim, quality.flank)
    waves = (1 - shine) * math.sqrt(max(outline.edge.waves**2 - _PLAIN**2, 0.0))
    light = math.hypot(by_lamp, _OF_WAVES * waves * max(1.0, quality.blur_px))
    threads = _OF_THREADS * min(quality.blur_px, _WIDEST) ** 2
    misfit = math.sqrt(max(quality.misfit**2 - threads**2, 0.0))
    lens = _OF_MISFIT * misfit * quality.blur_px
    shade = _SHADE * max(1.0, quality.blur_px)
    tone = 0.0 if stated else _OF_TONE * quality.blur_px
    gloss = _OF_GLOSS * shine * max(1.0, quality.blur_px)
    edge = 2 * math.hypot(max(shade, light), lens, tone, gloss)
    # Both tapes' edges move towards them, or from them, by the same tone curve.
    return edge, 2 * math.hypot(math.hypot(_RING_BIAS, lens) / math.sqrt(2), tone)


def _of_recipe(recipe: Recipe, length: float) -> tuple[str, ...]:
    """What the recipe leaves open and no picture shows."""
    scale = recipe.scale
    if scale.source != "ruler" or scale.placement_stderr is not None:
        return ()
    off = 0.1 * length / recipe.camera_distance
    return (
        "the ruler is taken to lie in the plane of the axis, which was not stated: 0.1 in off makes the "
        f"length wrong by {off:.3f} in; say how well it lay there, --ruler-placement 0.01in",
    )

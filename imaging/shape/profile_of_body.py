"""D(z) between the tapes, and the errors of it, from an outline and two rings."""

import math

import numpy as np

from ..arrays import Array
from ..camera.silhouette import Silhouette
from ..outline.both_sides import Outline
from ..outline.midline import off_smooth_midline
from ..outline.smoother import correlated_points, smooth
from ..quality import Quality
from ..recipe import Recipe
from ..tape.ring import Ring
from .measurement import Errors, Measurement, Trace
from .photograph import Photograph

_SHADE = 0.02  # px per edge and px^0.5 of blur
_OF_LIGHT = 0.6  # of the edge's scatter, for kappa 1
_OF_MISFIT = 20.0  # px per edge and px of blur
_RING_BIAS = 0.045  # px


def measurement_of_body(
    photo: Photograph,
    outline: Outline,
    body: Silhouette,
    upper: Ring,
    lower: Ring,
    recipe: Recipe,
    quality: Quality,
) -> Measurement:
    """The measurement; `Errors` describes how the standard errors are composed."""
    px_per_m, relative = photo.camera.px_per_m, recipe.scale.relative_stderr
    px = 1 / px_per_m
    length = lower.y - upper.y
    z = np.linspace(0, length, max(16, round(length * px_per_m) + 1))
    y = upper.y + z
    random, density = _random_part(outline)
    at = np.linspace(body.y[0], body.y[-1], random.size)
    edge, ring = _systematic_part(quality)
    diameter = 2 * body.radius_at(y)
    stderr = np.sqrt((np.interp(y, at, random) ** 2 + edge**2) * px**2 + (diameter * relative) ** 2)
    return Measurement(
        path=photo.path,
        time=photo.time,
        method=recipe.method,
        z=z,
        diameter=diameter,
        diameter_stderr=stderr,
        length=length,
        px_per_m=px_per_m,
        roll=body.roll,
        x0=body.x0,
        errors=Errors(
            edge=edge * px,
            density=density * px**3,
            ends=math.hypot(upper.stderr, lower.stderr, ring * px, ring * px),
            scale=relative,
        ),
        quality=quality,
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


def _systematic_part(quality: Quality) -> tuple[float, float]:
    """Systematic error of the width, and of each tape's edge [px]."""
    light = _OF_LIGHT * max(quality.kappa, 0.0) * quality.residual_rms
    lens = _OF_MISFIT * quality.misfit * quality.blur_px
    shade = _SHADE * math.sqrt(max(1.0, quality.blur_px))
    edge = 2 * math.sqrt(shade**2 + light**2 + lens**2)
    return edge, math.hypot(_RING_BIAS, lens)

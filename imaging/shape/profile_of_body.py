"""D(z) between the tapes, and the errors of it, from an outline and two rings."""

import math
from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline

from ..arrays import Array
from ..camera.pinhole import Camera, Silhouette
from ..outline.both_sides import Outline
from ..outline.smoother import correlated_points, smooth
from ..quality import Quality
from ..ruler.scale import Scale
from ..tape.ring import Ring
from .measurement import Errors, Measurement, Trace

_SHADE = 0.02  # px per edge and px^0.5 of blur
_OF_LIGHT = 0.6  # of the edge's scatter, for kappa 1
_OF_MISFIT = 20.0  # px per edge and px of blur
_RING_BIAS = 0.045  # px
_END_ROWS = 24


def end_radius(body: Silhouette, *, upper: bool) -> Callable[[float], float]:
    """Radius [m] at positions near an end [m], continued beyond it by a parabola."""
    beyond = _parabola(body, upper=upper)

    def radius(y: float) -> float:
        if body.y[0] <= y <= body.y[-1]:
            return float(np.interp(y, body.y, body.radius))
        return float(beyond(y))

    return radius


def measurement_of_body(
    outline: Outline,
    body: Silhouette,
    upper: Ring,
    lower: Ring,
    camera: Camera,
    scale: Scale,
    quality: Quality,
) -> Measurement:
    """The measurement, without the picture's path and time.

    How the standard errors are made up is said at `Errors`.
    """
    length = lower.y - upper.y
    n = max(16, round(length * camera.px_per_m) + 1)
    z = np.linspace(0, length, n)
    y = upper.y + z
    px = 1 / camera.px_per_m
    random, density = _random_part(outline)
    at = np.linspace(body.y[0], body.y[-1], random.size)
    edge, ring = _systematic_part(quality)
    ends = math.sqrt(upper.stderr**2 + lower.stderr**2 + 2 * (ring * px) ** 2)
    diameter = 2 * _radius_at(body, y)
    stderr = np.sqrt(
        (np.interp(y, at, random) ** 2 + edge**2) * px**2 + (diameter * scale.relative_stderr) ** 2
    )
    return Measurement(
        path="",
        time=math.nan,
        method="",
        z=z,
        diameter=diameter,
        diameter_stderr=stderr,
        length=length,
        px_per_m=camera.px_per_m,
        roll=body.roll,
        x0=body.x0,
        errors=Errors(
            edge=edge * px,
            density=density * px**3,
            ends=ends,
            scale=scale.relative_stderr,
        ),
        quality=quality,
        trace=Trace(
            outline.rows.astype(float),
            outline.left.column,
            outline.right.column,
            upper.arc,
            lower.arc,
        ),
    )


def _random_part(outline: Outline) -> tuple[Array, float]:
    """Random error of the width in every row [px], and its density, variance times length [px^3].

    The larger of two: what passes the smoothing of the edges' scatter, and the scatter of the
    mid-line, which is the width's where the edges err independently. Threads that both sides show
    mirrored are in the first alone, waves longer than the smoothing in the second alone.
    """
    random = np.hypot(outline.left.stderr, outline.right.stderr)
    scatter, stretch = _scatter_of_middle(outline)
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


def _scatter_of_middle(outline: Outline) -> tuple[float, float]:
    """Standard deviation of the width [px] that the mid-line's says, and rows it sticks together.

    Pairs of one row lie askew on a rolled muscle, which moves their middle by roll R R'.
    """
    middle = (outline.left.column + outline.right.column) / 2
    half = (outline.right.column - outline.left.column) / 2
    x = np.linspace(-1, 1, middle.size)
    functions = np.column_stack([np.vander(x, 4), half * np.gradient(half)])
    off = middle - functions @ np.linalg.lstsq(functions, middle, rcond=None)[0]
    return 2 * float(np.sqrt(np.mean(off**2))), correlated_points(off)


def _radius_at(body: Silhouette, y: Array) -> Array:
    """Cubic inside; beyond the ends the parabola through the rows next to them."""
    radius = CubicSpline(body.y, body.radius)(y)
    for upper, outside in ((True, y < body.y[0]), (False, y > body.y[-1])):
        radius[outside] = _parabola(body, upper=upper)(y[outside])
    return radius


def _parabola(body: Silhouette, *, upper: bool) -> np.polynomial.Polynomial:
    """The parabola through the rows next to an end."""
    rows = slice(None, _END_ROWS) if upper else slice(-_END_ROWS, None)
    return np.polynomial.Polynomial.fit(body.y[rows], body.radius[rows], 2)

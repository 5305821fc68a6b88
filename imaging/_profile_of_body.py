"""D(z) between the tapes, and the errors of it, from an outline and two rings."""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from ._camera import Camera, Silhouette
from ._fourier import correlated_points
from ._measurement import Errors, Measurement, Trace
from ._outline import AVERAGED_ROWS, Outline
from ._quality import Quality
from ._scale import Scale
from ._tape_edge import Ring

_EDGE_BIAS = 0.02  # px per edge, of a blur of 1 px
_OF_SCATTER = 0.12
_OF_KAPPA, _LARGEST_KAPPA = (
    0.06,
    2.0,
)  # px per edge and kappa: how the light falls is known to a part
_RING_BIAS = 0.06  # px
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

    The standard error of D is the root of the summed squares of three parts. Random: of both edges
    after smoothing, no less than the mid-line's scatter about a cubic says, for a body of
    revolution has a smooth one. Systematic: per edge 0.02 px for each pixel of blur, an eighth of
    the edge's scatter, and 0.06 px for a kappa of 1, a limb in harsh frontal light: what weave,
    lens and a tone curve known to some percent leave. A wrong tone curve can do ten times as much.
    And the scale's. That of L has the scatter of the edge along each tape, a systematic 0.06 px for
    each, and the scale's.
    """
    length = lower.y - upper.y
    n = max(16, round(length * camera.px_per_m) + 1)
    z = np.linspace(0, length, n)
    y = upper.y + z
    px = 1 / camera.px_per_m
    smoothed = np.hypot(outline.left.stderr, outline.right.stderr)
    residual = float(np.hypot(outline.left.residual, outline.right.residual))
    scatter, stretch = _scatter_of_middle(outline)
    random = smoothed * max(1.0, scatter / float(np.sqrt(np.mean(smoothed**2)))) * px
    density = max(residual**2 * AVERAGED_ROWS, scatter**2 * stretch) * px**3
    at = np.linspace(body.y[0], body.y[-1], random.size)
    kappa = min(max(quality.kappa, 0.0), _LARGEST_KAPPA)
    edge = _EDGE_BIAS * max(1.0, quality.blur_px) + _OF_SCATTER * quality.residual_rms
    edge = 2 * (edge + _OF_KAPPA * kappa) * px
    ends = math.sqrt(upper.stderr**2 + lower.stderr**2 + 2 * (_RING_BIAS * px) ** 2)
    diameter = 2 * _radius_at(body, y)
    stderr = np.sqrt(
        np.interp(y, at, random) ** 2 + edge**2 + (diameter * scale.relative_stderr) ** 2
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
            edge=edge,
            density=density,
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


def _radius_at(body: Silhouette, y: NDArray[np.float64]) -> NDArray[np.float64]:
    """Cubic inside; beyond the ends the parabola through the rows next to them."""
    radius = CubicSpline(body.y, body.radius)(y)
    for upper, outside in ((True, y < body.y[0]), (False, y > body.y[-1])):
        radius[outside] = _parabola(body, upper=upper)(y[outside])
    return radius


def _parabola(body: Silhouette, *, upper: bool) -> np.polynomial.Polynomial:
    """The parabola through the rows next to an end."""
    rows = slice(None, _END_ROWS) if upper else slice(-_END_ROWS, None)
    return np.polynomial.Polynomial.fit(body.y[rows], body.radius[rows], 2)

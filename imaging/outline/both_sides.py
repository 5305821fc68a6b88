"""The outline of the muscle to a fraction of a pixel: limb model, blur from the picture itself."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Literal

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from ..arrays import Array, Image, Indices, Single
from .edge_fit import best_shift, parabola_peak
from .edge_profile import DEEPEST, EdgeProfile, edge_profile, limb, limb_strength, near_edge
from .edge_windows import Samples, aligned_windows, first_curve
from .smoother import density_left_over, smooth_robustly, variance_of_smooth

Method = Literal["limb", "gradient", "half-level"]
"""How an edge is found in linear light: the limb model, the steepest point, half the local step."""

_WIDEST_START = 3.0  # px: from too small a blur the flank of a defocused edge looks like an edge
_EVERY = 4  # rows of which one is looked at first
_ALIGNED = 2  # rows of which one is enough to align windows to
_PASSES = 4
_SETTLED = (0.15, 0.05)  # px, of which the next pass would leave a fifth; part of the blur
_BROAD = 45.0  # px inside the edge over which the light is read that falls towards the limb
_INWARD = np.array([1, -1])  # of the left side, of the right one
_LEAST_STEP = 0.3  # of a step that overshoots
_LARGEST_PART = 0.35  # of the radius up to which the windows may reach
_MARGIN = 64  # px beside the coarse outline: its own error, and five times the widest blur


@dataclasses.dataclass(frozen=True)
class Side:
    """One side of the outline.

    Attributes:
        column: u of the edge in every row [px], shape (n,).
        stderr: its random standard error [px], shape (n,).
        residual: root mean square of the single fits about the curve [px].
        outliers: part of the rows that were thrown out.
        kappa: strength of the limb's root against its step [px^-0.5].
        hidden: part of the edge that black threads hide.
    """

    column: Array
    stderr: Array
    residual: float
    outliers: float
    kappa: float
    hidden: float


@dataclasses.dataclass(frozen=True)
class Outline:
    """Both sides of a muscle.

    Attributes:
        rows: v, shape (n,).
        left, right: the sides.
        edge: blur, light and misfit of the mean edge.
        resolution: wavelength that passed the smoothing at half its height [px].
    """

    rows: Indices
    left: Side
    right: Side
    edge: EdgeProfile
    resolution: float


def find_outline(
    image: Image,
    amount: Single,
    rows: Indices,
    left: Array,
    right: Array,
    *,
    resolution: float,
    method: Method = "limb",
    blur: float | None = None,
) -> Outline:
    """Both edges of an upright muscle in every row, from a coarse outline.

    I(t) = B + s0 [Phi(t/s) + kappa (sqrt(t) * G_s)] along the normal. Single rows give a first
    curve; then windows aligned to it are averaged over 21 rows along the edge, the mean of all
    gives blur s and kappa, and every averaged window a position, which is smoothed.

    Args:
        image: luma, shape (h, w), or RGB of which luma is taken, shape (h, w, 3).
        amount: linear amount of braid for each value of luma, shape (256,).
        rows: v, consecutive, shape (n,).
        left: columns of the left side to within 10 px, shape (n,).
        right: the same of the right side.
        resolution: wavelength that passes at half its height [px].
        method: the estimator.
        blur: s [px]; None estimates it.

    Raises:
        NoMuscle: no edge where the coarse outline has one.
    """
    radius = float(np.median(right - left)) / 2
    u0 = max(int(left.min()) - _MARGIN, 0)
    box = image[rows[0] : rows[-1] + 1, u0 : int(right.max()) + _MARGIN]
    luma = cv2.cvtColor(box, cv2.COLOR_RGB2GRAY) if box.ndim == 3 else np.ascontiguousarray(box)
    luma = np.asarray(luma, np.uint8)
    curves = [
        first_curve(luma, coarse - u0, inward, resolution, radius)
        for coarse, inward in ((left, 1), (right, -1))
    ]
    light = np.asarray(cv2.LUT(luma, amount), np.float32)
    first, curves, kappas = _first_look(light, curves, radius, blur)
    improved = functools.partial(
        _improved, light, rows, radius=radius, resolution=resolution, method=method,
        estimate=blur is None,
    )  # fmt: skip
    outline = improved(curves, first, kappas=first.kappas, spacing=_ALIGNED)
    found = [_in_every_row(side.column, rows.size) for side in (outline.left, outline.right)]
    steps = _mean_steps(curves, found)
    inside = np.array(first.shifts)
    for _ in range(_PASSES):
        curves, before = found, outline.edge
        inside = inside + _INWARD * steps
        outline = improved(curves, before, kappas=kappas(inside, before.blur))
        outline, steps = _without_overshoot(outline, curves, steps)
        found = [outline.left.column, outline.right.column]
        moved = max(np.abs(new - old).max() for new, old in zip(found, curves, strict=True))
        if moved < _SETTLED[0] and abs(outline.edge.blur / before.blur - 1) < _SETTLED[1]:
            break
    sides = (outline.left, outline.right)
    left_side, right_side = (dataclasses.replace(side, column=side.column + u0) for side in sides)
    return dataclasses.replace(outline, left=left_side, right=right_side)


_Strengths = Callable[[Array, float], tuple[float, float]]
"""Kappas of both sides, from how far inside of the first curves they lie [px] and from the blur."""


def _first_look(
    light: Single, curves: list[Array], radius: float, blur: float | None
) -> tuple[EdgeProfile, list[Array], _Strengths]:
    """Blur to within a tenth or so, the curves less their mean error, and how to read kappas.

    Over a third of the radius threads average out. The windows stay where they are: a kappa of
    windows about the last pass's curve would feed on itself, as one that is too large puts the edge
    too far out, and there the next one is larger still.
    """
    start = _WIDEST_START if blur is None else blur
    t = _window(start, radius, _BROAD)
    sides = [
        aligned_windows(light[::_EVERY], curve[::_EVERY], inward, t, radius, _EVERY)
        for curve, inward in zip(curves, (1, -1), strict=True)
    ]

    def kappas(inside: Array, s: float) -> tuple[float, float]:
        left, right = (
            limb_strength(side.light, t - shift, s, radius)
            for side, shift in zip(sides, inside, strict=True)
        )
        return left, right

    about = kappas(np.zeros(2), start)
    profiles = [side.profile for side in sides]
    fit = edge_profile(profiles, t, start, radius, about, estimate=blur is None)
    left, right = fit.shifts
    fit = dataclasses.replace(fit, kappas=kappas(np.array(fit.shifts), fit.blur))
    return fit, [curves[0] + left, curves[1] - right], kappas


def _mean_steps(before: list[Array], now: list[Array]) -> Array:
    """How far both sides have moved to the right in the mean [px], shape (2,)."""
    return np.array([float(np.mean(new - old)) for new, old in zip(now, before, strict=True)])


def _without_overshoot(outline: Outline, curves: list[Array], last: Array) -> tuple[Outline, Array]:
    """The outline less the part of its step by which it would have to come back, and its mean step.

    An edge's place, height and blur are found together, from a flank that ends where the curve puts
    it: beside the edge a step may be twice too long, and passes go to and fro about their middle. Two
    steps of opposite sign say by how much, by the secant through them.

    Args:
        outline: of windows aligned to the curves.
        curves: columns of the left and the right side, shape (n,) each.
        last: mean step that led to the curves [px], shape (2,).
    """
    sides = [outline.left, outline.right]
    steps = _mean_steps(curves, [side.column for side in sides])
    back = last * steps < 0
    part = np.where(back, last / np.where(back, last - steps, 1.0), 1.0).clip(_LEAST_STEP, 1.0)
    left, right = (
        dataclasses.replace(side, column=side.column - less)
        for side, less in zip(sides, (1 - part) * steps, strict=True)
    )
    return dataclasses.replace(outline, left=left, right=right), part * steps


def _improved(
    light: Single,
    rows: Indices,
    curves: list[Array],
    before: EdgeProfile,
    *,
    radius: float,
    resolution: float,
    method: Method,
    kappas: tuple[float, float],
    estimate: bool,
    spacing: int = 1,
) -> Outline:
    """The outline from windows aligned to the curves of the pass before, and their blur unless given.

    Rows `spacing` px apart are enough to align the windows of the next pass to.
    """
    t = _window(before.blur, radius, DEEPEST * max(1.0, before.blur))
    light, rows, curves = light[::spacing], rows[::spacing], [curve[::spacing] for curve in curves]
    windows = [
        aligned_windows(light, curve, inward, t, radius, spacing)
        for curve, inward in zip(curves, (1, -1), strict=True)
    ]
    fit = edge_profile(
        [side.profile for side in windows], t, before.blur, radius, kappas, disk=before.disk,
        estimate=estimate,
    )  # fmt: skip
    left, right = (
        _refined(
            side,
            _estimator(method, t, fit, kappa, radius),
            resolution / spacing,
            shift if method == "limb" else None,
            kappa,
        )
        for side, kappa, shift in zip(windows, kappas, fit.shifts, strict=True)
    )
    return Outline(rows, left, right, fit, resolution)


def _in_every_row(column: Array, n: int) -> Array:
    """A curve of which every `_ALIGNED`-th of n rows is known."""
    longer = np.append(column, 2 * column[-1] - column[-2])
    return np.interp(np.arange(n), _ALIGNED * np.arange(longer.size), longer)


def _window(blur: float, radius: float, deepest: float) -> Array:
    outside = round(max(8.0, 5 * blur))
    inside = round(min(deepest, _LARGEST_PART * radius))
    return np.arange(-outside, inside + 1.0)


Estimator = Callable[[Single], Array]


def _estimator(
    method: Method, t: Array, fit: EdgeProfile, kappa: float, radius: float
) -> Estimator:
    """Shift inward [px] of averaged windows, by the method."""
    s = fit.blur
    if method == "limb":
        near = near_edge(t, s)
        return lambda windows: best_shift(
            windows[:, near],
            t[near],
            lambda x: limb(x, s, kappa, radius, fit.disk),
            max(2.0, 1.5 * s),
            0.1,
        )
    near = np.abs(t) <= 5 * max(1.0, s)
    if method == "gradient":
        return lambda windows: _steepest(windows[:, near], t[near])
    return lambda windows: _half_level(windows[:, near], t[near], s)


def _steepest(windows: Single, t: Array) -> Array:
    slope = gaussian_filter1d(windows.astype(float), 1.0, axis=1, order=1)
    inner = np.flatnonzero(np.abs(t) <= 0.6 * t[-1])
    return t[inner[0]] + parabola_peak(slope[:, inner])


def _half_level(windows: Single, t: Array, s: float) -> Array:
    outside = windows[:, t < -3 * s].mean(axis=1)
    inside = windows[:, (t > 2 * s) & (t < 5 * s)].mean(axis=1)
    above = windows > ((outside + inside) / 2)[:, None]
    k = np.clip(np.argmax(above, axis=1), 1, t.size - 1)
    row = np.arange(k.size)
    low, high = windows[row, k - 1], windows[row, k]
    rise = np.where(high > low, high - low, 1.0)
    return t[k - 1] + ((outside + inside) / 2 - low) / rise


def _refined(
    side: Samples, estimator: Estimator, resolution: float, mean_shift: float | None, kappa: float
) -> Side:
    """The smooth edge through the shifts of all windows."""
    shift = estimator(side.mean)
    if mean_shift is not None:
        # The mean profile has no noise to bias its fit: it says where the edges are on average.
        shift += mean_shift - np.average(shift, weights=side.weight)
    position = side.curve + side.inward * side.stretch * shift
    curve, keep = smooth_robustly(position, resolution, side.weight.astype(float))
    off = np.where(keep, position - curve, 0.0)
    density = density_left_over(off, resolution)
    return Side(
        column=curve,
        stderr=np.sqrt(density * variance_of_smooth(curve.size, resolution)),
        residual=float(np.sqrt(np.mean(off[keep] ** 2))),
        outliers=1 - float(keep.mean()),
        kappa=kappa,
        hidden=1 - float(side.weight.mean()),
    )

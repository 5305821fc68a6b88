"""Model the brightness across the blurred edge of a lit body, and locate the edge."""

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import leastsq
from scipy.special import gamma, ndtr, pbdv

from .camera import Array, Flags

LARGEST_DISK = 0.86  # of the blur's variance; above this, six nodes are too few
_REACH, _TABLE = 40.0, 4001  # end of the table of blurred roots, in blurs, and its length
_ANGLES = np.arange(1, 7) * np.pi / 7
_NODES, _WEIGHTS = np.cos(_ANGLES), 2 / 7 * np.sin(_ANGLES) ** 2


def step(t: ArrayLike, blur: ArrayLike) -> Array:
    """Return a step at t = 0 with Gaussian blur, Phi(t / s), 0 outside and 1 inside.

    Args:
        t: distance inward from the edge [px].
        blur: s > 0 [px], broadcast with t.
    """
    return ndtr(np.divide(t, blur))


def defocused_step(t: ArrayLike, blur: ArrayLike, disk: ArrayLike) -> Array:
    """Return a step at t = 0 blurred by a defocused lens and a Gaussian, 0 outside and 1 inside.

    Across an edge, a blur disk of radius r acts as a semicircular weight of variance r^2 / 4. The mean of
    Phi((t - r x) / g) is computed by Gauss-Chebyshev quadrature with six nodes.

    Args:
        t: distance inward from the edge [px].
        blur: s = sqrt(g^2 + r^2 / 4) > 0 [px], broadcast with t.
        disk: r^2 / (4 s^2), 0 to `LARGEST_DISK`, broadcast with t.
    """
    s, part = np.asarray(blur, float), np.asarray(disk, float)
    gaussian, radius = s * np.sqrt(1 - part), 2 * s * np.sqrt(part)
    scaled = np.divide(t, gaussian)[..., None]
    return ndtr(scaled - (radius / gaussian)[..., None] * _NODES) @ _WEIGHTS


def ramp(t: ArrayLike, blur: ArrayLike, radius: float) -> Array:
    """Return the blurred root sqrt(t - t^2 / (2 R)), the brightness inside the limb of a lit cylinder.

    At a distance t from the limb of a cylinder of radius R, the cosine of the angle between the normal and
    the line of sight is sqrt(2 t / R - t^2 / R^2). The second term is included to first order.

    Args:
        t: distance inward from the edge [px].
        blur: s > 0 [px], broadcast with t.
        radius: R [px].

    Returns:
        Values [px^0.5], broadcast shape.
    """
    blur = np.asarray(blur, float)
    x = np.divide(t, blur)
    grid, *roots = _blurred_roots()
    half, three = (np.interp(x, grid, root) for root in roots)
    if x.max() > _REACH:  # expansion to second order for blur << t
        far = np.maximum(x, _REACH)
        half = np.where(x > _REACH, np.sqrt(far) * (1 - 1 / (8 * far**2)), half)
        three = np.where(x > _REACH, far**1.5 * (1 + 3 / (8 * far**2)), three)
    return np.sqrt(blur) * (half - blur * three / (4 * radius))


@functools.cache
def _blurred_roots() -> tuple[Array, Array, Array]:
    """Return a grid of x, and E[(x + z)_+^p] for normal z on it, for p = 1/2 and p = 3/2.

    The values are parabolic cylinder functions, Gamma(p + 1) / sqrt(2 pi) exp(-x^2 / 4) D_{-p-1}(-x).
    """
    x = np.linspace(-8, _REACH, _TABLE)
    factor = np.exp(-(x**2) / 4) / np.sqrt(2 * np.pi)
    half, three = (gamma(p + 1) * factor * pbdv(-p - 1, -x)[0] for p in (0.5, 1.5))
    return x, half, three


_DIFFERENCE = 1e-7  # step for derivatives, for unknowns of order 1

Edge = Callable[[Array], Array]
"""Brightness of an edge, in any unit, as an elementwise function of the distance inward t [px]."""


def best_shift(
    windows: NDArray[np.floating], t: Array, edge: Edge, reach: float, spacing: float
) -> Array:
    """Return the shift of the edge in each window, from a least-squares fit with free level and height.

    The variance explained by the model a + b edge(t - shift) is the square of an inner product. The
    candidate shift that maximises it is refined with a parabola. One matrix product covers all windows
    and shifts.

    Args:
        windows: samples, shape (m, n).
        t: distance of the samples inward from the expected edge [px], shape (n,).
        edge: model of the edge.
        reach: largest shift [px].
        spacing: spacing of the candidate shifts [px].

    Returns:
        Shift inward [px], shape (m,); its magnitude is `reach` if there is no maximum within that range.
    """
    count = round(reach / spacing)
    shifts = np.arange(-count, count + 1) * spacing
    models = edge(t - shifts[:, None])
    models = models - models.mean(axis=1, keepdims=True)
    models /= np.maximum(np.linalg.norm(models, axis=1, keepdims=True), 1e-12)
    energy = windows @ models.T.astype(windows.dtype)
    return parabola_peak(energy * np.abs(energy)) * spacing - count * spacing


def parabola_peak(energy: NDArray[np.floating]) -> Array:
    """Return the fractional index of each row's maximum, from a parabola through it and its neighbours.

    Args:
        energy: shape (m, k), k >= 3.

    Returns:
        Shape (m,); an integer if the maximum is the first or last value.
    """
    best = np.argmax(energy, axis=1)
    row = np.arange(best.size)
    inner = np.clip(best, 1, energy.shape[1] - 2)
    before, at, after = (energy[row, inner + d].astype(float) for d in (-1, 0, 1))
    bend = before - 2 * at + after
    safe = np.where(bend < 0, bend, -1.0)
    offset = np.where(bend < 0, 0.5 * (before - after) / safe, 0.0)
    return np.where(inner == best, inner + np.clip(offset, -1, 1), best)


def height_and_rest(samples: Array, model: Array) -> tuple[Array, Array]:
    """Fit a + b model to samples by least squares; return b and the residuals.

    Args:
        samples: shape (..., n).
        model: shape (..., n), broadcast with the samples.

    Returns:
        b, shape (..., 1), zero for a constant model, and the residuals, shape (..., n).
    """
    n = samples.shape[-1]
    centred = model - model.sum(axis=-1, keepdims=True) / n
    rest = samples - samples.sum(axis=-1, keepdims=True) / n
    power = (centred * centred).sum(axis=-1, keepdims=True)
    height = (centred * rest).sum(axis=-1, keepdims=True) / np.where(power > 0, power, 1.0)
    return height, rest - height * centred


def least_squares(left_over: Callable[[Array], Array], start: ArrayLike, tolerance: float) -> Array:
    """Return the unknowns that minimise a sum of squared residuals (Levenberg-Marquardt method).

    Args:
        left_over: function that maps the unknowns, shape (p,), to the residuals, shape (n,).
        start: initial values, shape (p,), of order 1.
        tolerance: relative tolerance of the unknowns.

    Returns:
        Shape (p,).
    """
    best, *_ = leastsq(left_over, start, xtol=tolerance, ftol=tolerance, epsfcn=_DIFFERENCE**2)
    return np.asarray(best, float)


_BROAD = 3.0  # distance inside the edge from which the fall of light is measured, in blurs
DEEPEST = 8.0  # distance inside the edge up to which light is used, in blurs
_NEAR = (-7.0, 1.75, 2.5)  # samples that determine the position, in blurs; the last for wide blurs
_WIDE = (
    1.5,
    2.0,
)  # wide blurs [px], which are due to a defocused lens and end inside as a box does
_BLURS = (0.4, 8.0)  # px
_FLANK = (2.0, 5.0)  # blurs inside the edge
_RIM = ((1.5, 3.5), (4.0, DEEPEST))  # blurs inside the edge
_OF_WAVE = 0.45  # of the blur, per relative excess of the first thread's light
_WAVE_SEEN, _WAVE_LOST = 1.2, 2.0  # px of blur
_MATTE, _TO_GLOSS = 0.98, 0.05  # of a rim's brightness
_FALLS, _TO_SHINE = -0.04, 0.04  # of a flank; exceeded by one plain matte braid in seventy
_FIRST_DISK = 0.6  # initial value; a small initial disk would not grow in the fit
_FARTHEST = 4.0  # largest shift of an edge in one pass [px]
_KAPPAS = (-0.3, 6.0)  # sheen makes kappa negative; at 5 the limb has 2 % of the middle's light
_DARKEST = 0.05  # of a limb's light
_LEAST_ANGLE = 0.2  # at 0, a pure Gaussian, the derivative by the disk vanishes


@dataclasses.dataclass(frozen=True)
class EdgeProfile:
    """Results of the fit to the mean brightness profiles of both sides.

    Attributes:
        blur: s, standard deviation of the blur across the edge, common to both sides [px].
        disk: fraction of the blur's variance due to the disk of a defocused lens; the rest is Gaussian.
        shifts: inward shift of each side's edge relative to the windows [px], corrected for the light of
            the first thread.
        misfit: RMS difference between profiles and model, relative to the step.
        flank: excess brightness of the profile over the model, 2 to 5 blurs inside the edge, relative to
            the step; the larger value of the two sides.
        rim: brightness 1.5 to 3.5 blurs inside the edge divided by that 4 to 8 blurs inside, mean of both
            sides. The limb of a matte body is never brighter than the area inside it.
        waves: relative deviation of the brightness from that of a smooth limb, 1.5 to 8 blurs inside the
            edge, RMS of both sides.
    """

    blur: float
    disk: float
    shifts: tuple[float, float]
    misfit: float
    flank: float
    rim: float
    waves: float


def edge_profile(
    profiles: list[Array], t: Array, blur: float, radius: float, kappas: tuple[float, ...], disk:
    float | None = None,
) -> EdgeProfile:  # fmt: skip
    """Fit the blur and positions of the edges to the mean profiles of both sides.

    The positions are determined from the outer flanks only, so the shading of the first thread has little
    influence.

    Args:
        profiles: mean brightness along the normal on the left and right sides, shape (n,) each.
        t: distance of the samples inward [px], shape (n,).
        blur: approximate s [px].
        radius: radius of the body [px].
        kappas: kappa of each side, from `limb_strength`.
        disk: `EdgeProfile.disk` from the previous pass; None in the first pass.
    """
    near = near_edge(t, blur)
    parts = np.stack([profile[near] / max(np.ptp(profile[near]), 1e-6) for profile in profiles])

    def blur_and_disk(unknown: Array) -> tuple[float, float]:
        s = float(np.exp(np.clip(unknown[2], *np.log(_BLURS))))
        return s, LARGEST_DISK * math.sin(unknown[3]) ** 2

    def left_over(unknown: Array) -> Array:
        s, part = blur_and_disk(unknown)
        model = limb(t[near] - unknown[:2, None], s, np.array(kappas)[:, None], radius, part)
        return height_and_rest(parts, model)[1].ravel()

    angle = math.asin(math.sqrt((_FIRST_DISK if disk is None else disk) / LARGEST_DISK))
    best = least_squares(left_over, [0.0, 0.0, np.log(blur), max(angle, _LEAST_ANGLE)], 1e-3)
    misfit = float(np.sqrt(np.mean(left_over(best) ** 2)))
    shifts = np.clip(best[:2], -_FARTHEST, _FARTHEST).tolist()
    s, part = blur_and_disk(best)
    flanks, waves, rims, laws = zip(
        *(
            _inside(profile, t - shift, s, part, kappa, radius)
            for profile, shift, kappa in zip(profiles, shifts, kappas, strict=True)
        ),
        strict=True,
    )
    flank, rim = max(flanks), float(np.mean(rims))
    matte = 1 - shine_of(rim, flank)
    left, right = (
        shift - matte * _first_thread(own, law, s)
        for shift, own, law in zip(shifts, rims, laws, strict=True)
    )
    wave = float(np.sqrt(np.mean(np.square(waves))))
    return EdgeProfile(s, part, (left, right), misfit, flank, rim, wave)


def limb(
    t: Array, s: float | Array, kappa: float | Array, radius: float, disk: float | Array = 0.0
) -> Array:
    """Return the brightness across a limb, a blurred step plus kappa times the blurred root, elementwise.

    The square root is smooth, so the shape of the blur has no effect on it.
    """
    edge = defocused_step(t, s, disk) if np.any(disk) else step(t, s)
    return edge + kappa * ramp(t, s, radius) if np.any(kappa) else edge


def _inside(
    profile: Array, t: Array, s: float, disk: float, kappa: float, radius: float
) -> tuple[float, float, float, float]:
    """Return flank, wave and rim of one side, and the rim of a smooth limb, see `EdgeProfile`.

    The brightness of a smeared edge rises further inside than the fitted samples; the flank measures this
    rise. Each value is 0 if there are no samples.
    """
    near, model = near_edge(t, s), limb(t, s, kappa, radius)
    height = float(height_and_rest(profile[near], model[near])[0][0])
    above = profile - float(np.mean(profile[near] - height * model[near]))
    flank = wave = 0.0
    size = max(1.0, s)
    at = (t > _FLANK[0] * s) & (t < _FLANK[1] * s)
    if at.any():
        excess = float(np.mean(above[at] - height * model[at]))
        flank = excess / max(height * float(np.mean(model[at])), 1e-9)
    at = (t > _RIM[0][0] * size) & (t < _RIM[1][1] * size)
    if at.any():
        light = above[at] / np.maximum(height * model[at], 1e-9)
        wave = float(np.std(np.log(np.maximum(light, _DARKEST))))
    return flank, wave, _rim(profile, t, s), _rim(limb(t, s, kappa, radius, disk), t, s)


def _rim(profile: Array, t: Array, s: float) -> float:
    """Return the brightness just inside the edge divided by that further in; 0 if there are no samples."""
    size = max(1.0, s)
    at, beside = (profile[(t > low * size) & (t < high * size)] for low, high in _RIM)
    return float(at.mean() / max(beside.mean(), 1e-9)) if at.size and beside.size else 0.0


def _first_thread(own: float, law: float, s: float) -> float:
    """Return how far the true edge lies outside the fitted one [px], from the light of the first thread.

    Because of the threads, the light varies periodically with azimuth. This wave is in phase along a
    straight edge, with about one period in the first 8 blurs. If the light 1.5 to 3.5 blurs inside exceeds
    that of a smooth limb, the edge itself is darker, and the fit confuses the flank of the thread with that
    of the edge. For a wave that fades at grazing incidence, averaged over its phase, the edge lies 0.2 to
    0.6 px further out per unit of relative excess, for blurs of 0.8 to 1.3 px. In rendered braids, the
    factor is 0.45 px per px of blur. A blur wider than the wave changes its phase. On a glossy rim, the
    excess has a different cause.

    Args:
        own: brightness just inside the edge divided by that further in, on this side; 0 if there are no
            samples.
        law: the same ratio for a smooth limb.
        s: blur [px].
    """
    if min(own, law) <= 0:
        return 0.0
    alike = np.clip((_WAVE_LOST - s) / (_WAVE_LOST - _WAVE_SEEN), 0, 1)
    return float(alike * _OF_WAVE * max(1.0, s) * np.log(own / law))


def shine_of(rim: float, flank: float) -> float:
    """Return the confidence that a limb is glossy, 0 to 1, from its rim and flank (see `EdgeProfile`).

    The rim of a matte limb is at most 1, and its flank follows the model. On a glossy limb, the brightness
    falls off inside a narrow bright rim.
    """
    return min(max((rim - _MATTE) / _TO_GLOSS, (_FALLS - flank) / _TO_SHINE, 0.0), 1.0)


def moved_by_limb(kappa: float, s: float, radius: float) -> float:
    """Return how far an edge with this kappa lies outside the best-fitting plain step [px].

    Args:
        kappa: ratio of the square-root term to the step in the limb model [px^-0.5].
        s: blur [px].
        radius: radius of the body [px].
    """
    reach = round(-_NEAR[0] * max(1.0, s))
    t = np.arange(-reach, reach + 1.0)
    t = t[near_edge(t, s)]
    edge = limb(t, s, kappa, radius)
    return float(best_shift(edge[None], t, lambda x: step(x, s), max(2.0, 1.5 * s), 0.1)[0])


def near_edge(t: Array, s: float) -> Flags:
    """Select the samples near the outer flank of the edge."""
    size = max(1.0, s)
    reach = np.interp(s, _WIDE, _NEAR[1:])
    return (t >= _NEAR[0] * size) & (t <= reach * size)


def limb_strength(light: Array, t: Array, s: float, radius: float) -> float:
    """Return kappa in s0 [1 + kappa sqrt(t - t^2 / (2 R))], the brightness inside the blurred edge.

    The square-root law holds for a smooth body, and for a woven body if averaged over its threads. It is
    fitted to the samples that are at least 3 blurs inside the edge.

    Args:
        light: mean brightness along the normal, shape (n,). The windows must not be divided by their own
            brightness before averaging, because random factors would then make the mean rise inward.
        t: distance of the samples inward from the edge [px], shape (n,).
        s: blur [px].
        radius: radius of the body [px].
    """
    inside = t >= _BROAD * max(1.0, s)
    x = t[inside]
    root = np.sqrt(x * (1 - x / (2 * radius)))
    slope = float(height_and_rest(light[inside], root)[0][0])
    at_limb = float(light[inside].mean() - slope * root.mean())
    if at_limb <= 0:
        return _KAPPAS[1] if slope > 0 else _KAPPAS[0]
    return float(np.clip(slope / at_limb, *_KAPPAS))

"""A model of brightness across the blurred edge of a lit body, and the position of the edge."""

import dataclasses
import functools
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import leastsq
from scipy.special import gamma, ndtr, pbdv

from .camera import Array, Flags

LARGEST_DISK = 0.86  # of a blur's variance: with more, the nodes of its integral would show
_REACH, _TABLE = 40.0, 4001  # end of the table of blurred roots, in blurs; its length
_ANGLES = np.arange(1, 7) * np.pi / 7
_NODES, _WEIGHTS = np.cos(_ANGLES), 2 / 7 * np.sin(_ANGLES) ** 2


def step(t: ArrayLike, blur: ArrayLike) -> Array:
    """A step at t = 0 under Gaussian blur, Phi(t / s), 0 outside and 1 inside.

    Args:
        t: distance inward from the edge [px].
        blur: s > 0 [px], broadcast with t.
    """
    return ndtr(np.divide(t, blur))


def defocused_step(t: ArrayLike, blur: ArrayLike, disk: ArrayLike) -> Array:
    """A step at t = 0 under the disk of a defocused lens and a Gaussian blur, 0 outside, 1 inside.

    Across an edge the disk of radius r weighs the light with a semicircle, whose variance is
    r^2 / 4 and whose mean over Phi((t - r x) / g) is taken by Gauss and Chebyshev's six nodes. A
    pixel's box, flat as well, is distinguished from a Gaussian by it too.

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
    """The blurred root sqrt(t - t^2 / (2 R)): how a lit cylinder brightens inside its limb.

    The cosine between normal and line of sight at t from the limb of a cylinder of radius R is
    sqrt(2 t / R - t^2 / R^2); its second term is taken to first order.

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
    if x.max() > _REACH:  # where blur is small against t, to second order
        far = np.maximum(x, _REACH)
        half = np.where(x > _REACH, np.sqrt(far) * (1 - 1 / (8 * far**2)), half)
        three = np.where(x > _REACH, far**1.5 * (1 + 3 / (8 * far**2)), three)
    return np.sqrt(blur) * (half - blur * three / (4 * radius))


@functools.cache
def _blurred_roots() -> tuple[Array, Array, Array]:
    """E[(x + z)_+^p] for z normal: grid and values for p = 1/2, values for p = 3/2.

    They are parabolic cylinder functions, Gamma(p + 1) / sqrt(2 pi) exp(-x^2 / 4) D_{-p-1}(-x).
    """
    x = np.linspace(-8, _REACH, _TABLE)
    factor = np.exp(-(x**2) / 4) / np.sqrt(2 * np.pi)
    half, three = (gamma(p + 1) * factor * pbdv(-p - 1, -x)[0] for p in (0.5, 1.5))
    return x, half, three


_DIFFERENCE = 1e-7  # of an unknown of order 1, for derivatives: root of the precision, and more

Edge = Callable[[Array], Array]
"""Brightness of an edge against the distance inward t [px], elementwise, in any unit."""


def best_shift(
    windows: NDArray[np.floating], t: Array, edge: Edge, reach: float, spacing: float
) -> Array:
    """The shift of the edge in each window, by least squares with free level and height.

    For every candidate shift, what the model a + b edge(t - shift) explains of the samples'
    variance is the square of one inner product; the largest wins, refined by a parabola. All
    windows and shifts are one matrix product.

    Args:
        windows: samples, shape (m, n).
        t: distance of the samples inward from where the edge is expected [px], shape (n,).
        edge: the model.
        reach: largest shift that is tried [px].
        spacing: of the shifts that are tried [px].

    Returns:
        Shift inward [px], shape (m,); of size `reach` where no maximum lies inside.
    """
    count = round(reach / spacing)
    shifts = np.arange(-count, count + 1) * spacing
    models = edge(t - shifts[:, None])
    models = models - models.mean(axis=1, keepdims=True)
    models /= np.maximum(np.linalg.norm(models, axis=1, keepdims=True), 1e-12)
    energy = windows @ models.T.astype(windows.dtype)
    return parabola_peak(energy * np.abs(energy)) * spacing - count * spacing


def parabola_peak(energy: NDArray[np.floating]) -> Array:
    """Index of each row's maximum, with a fraction from the parabola through its neighbours.

    Args:
        energy: shape (m, k), k >= 3.

    Returns:
        Shape (m,); a whole number where the maximum is the first or last value.
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
    """The height b of a + b model fitted to samples by least squares, and the residual.

    Args:
        samples: shape (..., n).
        model: shape (..., n), broadcast with the samples.

    Returns:
        b, shape (..., 1), zero for a level model, and the rest, shape (..., n).
    """
    n = samples.shape[-1]
    centred = model - model.sum(axis=-1, keepdims=True) / n
    rest = samples - samples.sum(axis=-1, keepdims=True) / n
    power = (centred * centred).sum(axis=-1, keepdims=True)
    height = (centred * rest).sum(axis=-1, keepdims=True) / np.where(power > 0, power, 1.0)
    return height, rest - height * centred


def least_squares(left_over: Callable[[Array], Array], start: Array, tolerance: float) -> Array:
    """The unknowns with the least squares of residuals, by Levenberg-Marquardt.

    Args:
        left_over: from unknowns of shape (..., p) to residuals of shape (..., n): it is asked for
            all forward differences at once.
        start: shape (p,), each unknown of order 1.
        tolerance: relative, of the unknowns.

    Returns:
        Shape (p,).
    """
    steps = _DIFFERENCE * np.eye(start.size + 1, start.size, -1)

    def slopes(unknown: Array) -> Array:
        values = left_over(unknown + steps)
        return (values[1:] - values[0]) / _DIFFERENCE

    best, *_ = leastsq(
        left_over, start, Dfun=slopes, col_deriv=True, xtol=tolerance, ftol=tolerance
    )
    return np.asarray(best, float)


_BROAD = 3.0  # px per px of blur, from where on samples say how the light falls towards the limb
DEEPEST = 8.0  # the same, up to where an edge is looked at
_NEAR = (-7.0, 1.75, 2.5)  # the same: samples that say where the edge is; the last of wide blurs
_WIDE = (1.5, 2.0)  # px: of blurs that no sharp lens has, which end as far inside as a box's do
_BLURS = (0.4, 8.0)  # px
_FLANK = (2.0, 5.0)  # blurs inside the edge
_RIM = ((1.5, 3.5), (4.0, DEEPEST))  # the same
_OF_WAVE = 0.45  # of the blur, per relative excess of the first thread's light
_WAVE_SEEN, _WAVE_LOST = 1.2, 2.0  # px of blur
_MATTE, _TO_GLOSS = 0.98, 0.05  # of a rim's brightness
_FALLS, _TO_SHINE = -0.04, 0.04  # of a flank; one plain matte braid in seventy falls so
_FIRST_DISK = 0.6  # from a large one the fit finds a small one, and not the reverse
_FARTHEST = 4.0  # px that one pass may move an edge
_KAPPAS = (-0.3, 6.0)  # sheen brightens a limb; 5 is one of 2 % of the middle's light
_DARKEST = 0.05  # of a limb's light
_LEAST_ANGLE = 0.2  # at 0, which is a Gaussian, all directions lead to larger disks alike


@dataclasses.dataclass(frozen=True)
class EdgeProfile:
    """Result from the mean profiles of the two sides.

    Attributes:
        blur: s, standard deviation of the spread of light across the edge, common to both [px].
        disk: part of its variance that a defocused lens' disk makes, the rest being Gaussian.
        shifts: of the edge against where the windows were aligned, inward [px], by the fit and by what the
            light of the first thread says of its error.
        misfit: root mean square between profiles and model, over the step.
        flank: how much brighter than the model the profiles are 2 to 5 blurs inside, over the step; the
            larger of both sides.
        rim: brightness 1.5 to 3.5 blurs inside the edge over that at 4 to 8, the mean of both sides; the
            limb of a matte body is never brighter than what lies inside of it.
        waves: relative deviation of the light 1.5 to 8 blurs inside from the law of a smooth limb, root
            mean square of both sides.
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
    """Blur and position of the edges, from the mean profiles of both sides.

    Where the edge is, is read from the outer flank alone, so that the first thread's own shade, which
    may be anything, moves it little.

    Args:
        profiles: mean brightness of the left and the right side along the normal, shape (n,) each.
        t: distance inward of the samples [px], shape (n,).
        blur: s, about [px].
        radius: of the body [px].
        kappas: of both sides, from `limb_strength`.
        disk: of the pass before; None in the first.
    """
    near = near_edge(t, blur)
    parts = np.stack([profile[near] / max(np.ptp(profile[near]), 1e-6) for profile in profiles])

    def blur_and_disk(unknown: Array) -> tuple[Array, ...]:
        s = np.exp(np.clip(unknown[..., 2:3], *np.log(_BLURS)))
        return s, LARGEST_DISK * np.sin(unknown[..., 3:]) ** 2

    def left_over(unknown: Array) -> Array:
        s, part = blur_and_disk(unknown)
        at = t[near] - unknown[..., :2, None]
        model = limb(at, s[..., None], np.array(kappas)[:, None], radius, part[..., None])
        return height_and_rest(parts, model)[1].reshape(*unknown.shape[:-1], -1)

    angle = np.arcsin(np.sqrt((_FIRST_DISK if disk is None else disk) / LARGEST_DISK))
    first = [0.0, 0.0, np.log(blur), max(float(angle), _LEAST_ANGLE)]
    best = least_squares(left_over, np.array(first), 1e-3)
    misfit = float(np.sqrt(np.mean(left_over(best) ** 2)))
    shifts = np.clip(best[:2], -_FARTHEST, _FARTHEST).tolist()
    s, part = (float(value[0]) for value in blur_and_disk(best))
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
    """Brightness across a limb, the step under blur plus kappa (root under blur), elementwise.

    The root is smooth: the shape of the blur does not matter to it.
    """
    edge = defocused_step(t, s, disk) if np.any(disk) else step(t, s)
    return edge + kappa * ramp(t, s, radius) if np.any(kappa) else edge


def _inside(
    profile: Array, t: Array, s: float, disk: float, kappa: float, radius: float
) -> tuple[float, float, float, float]:
    """Flank, wave and rim of one side, and the rim by the law of a smooth limb, see `EdgeProfile`.

    The flank is what the profile exceeds the model by, inside the part that the model was fitted to: an
    edge smeared over more than that goes on to rise there, whatever smeared it. The wave is of any
    height: threads shade one limb more than another all along it. Each is 0 where nothing is seen.
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
    """Brightness just inside the edge over that further in; 0 where there is no further in."""
    size = max(1.0, s)
    at, beside = (profile[(t > low * size) & (t < high * size)] for low, high in _RIM)
    return float(at.mean() / max(beside.mean(), 1e-9)) if at.size and beside.size else 0.0


def _first_thread(own: float, law: float, s: float) -> float:
    """How much further out the edge is than the fit has it, by the light of the first thread [px].

    Threads make the light wave as the azimuth does, in the same phase all along a straight edge, with
    about one wave in the first 8 blurs. Where it is brighter 1.5 to 3.5 blurs inside than the law of a
    smooth limb says, it is darker at the edge: the fit takes the thread's own flank for the edge's. In
    the mean over all phases of a wave that fades at grazing sight the edge lies 0.2 to 0.6 px further
    out per part of excess, at blurs of 0.8 to 1.3 px; rendered braids have 0.45 px per px of blur. A
    blur that spans the wave has another phase. Of a rim that is gloss the excess says nothing.

    Args:
        own: brightness there over that further in, on this side.
        law: the same by the law; 0, as on this side, where there is no further in.
        s: blur [px].
    """
    if min(own, law) <= 0:
        return 0.0
    alike = np.clip((_WAVE_LOST - s) / (_WAVE_LOST - _WAVE_SEEN), 0, 1)
    return float(alike * _OF_WAVE * max(1.0, s) * np.log(own / law))


def shine_of(rim: float, flank: float) -> float:
    """Confidence that a limb shines, 0 to 1, from its rim and its flank, see `EdgeProfile`.

    The rim of a matte limb is 1 at most, and its flank goes on as the model says: light that falls off
    inside of a narrow bright rim is gloss.
    """
    return min(max((rim - _MATTE) / _TO_GLOSS, (_FALLS - flank) / _TO_SHINE, 0.0), 1.0)


def moved_by_limb(kappa: float, s: float, radius: float) -> float:
    """How much further out an edge of this kappa lies than a plain step that fits its flank best [px].

    Args:
        kappa: strength of the limb's root against its step [px^-0.5].
        s: blur [px].
        radius: of the body [px].
    """
    reach = round(-_NEAR[0] * max(1.0, s))
    t = np.arange(-reach, reach + 1.0)
    t = t[near_edge(t, s)]
    edge = limb(t, s, kappa, radius)
    return float(best_shift(edge[None], t, lambda x: step(x, s), max(2.0, 1.5 * s), 0.1)[0])


def near_edge(t: Array, s: float) -> Flags:
    """The samples near the outer flank of the edge."""
    size = max(1.0, s)
    reach = np.interp(s, _WIDE, _NEAR[1:])
    return (t >= _NEAR[0] * size) & (t <= reach * size)


def limb_strength(light: Array, t: Array, s: float, radius: float) -> float:
    """The kappa of s0 [1 + kappa sqrt(t - t^2 / (2 R))] inside the edge's blur.

    The root is the law of a smooth body, and of a woven one in the mean over its threads: it is read
    from 3 blurs inside the edge on, as far as there are samples.

    Args:
        light: mean brightness along the normal, shape (n,), of windows as bright as they are: means of
            windows over their own limb's brightness rise inward, as those over any random number do.
        t: distance of the samples inward from the edge [px], shape (n,).
        s: blur [px].
        radius: of the body [px].
    """
    inside = t >= _BROAD * max(1.0, s)
    x = t[inside]
    root = np.sqrt(x * (1 - x / (2 * radius)))
    slope = float(height_and_rest(light[inside], root)[0][0])
    at_limb = float(light[inside].mean() - slope * root.mean())
    if at_limb <= 0:
        return _KAPPAS[1] if slope > 0 else _KAPPAS[0]
    return float(np.clip(slope / at_limb, *_KAPPAS))

"""How brightness rises across the blurred edge of a lit body: the model that edges are fitted with."""

import functools

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import ndtr

from ..arrays import Array

LARGEST_DISK = 0.86  # of a blur's variance: with more, the nodes of its integral would show
_REACH = 40.0  # end of the table of blurred roots, in blurs
_TABLE = 4001
_SIMPSON, _PARTS = 200, 40  # intervals; parts of the table that fit a processor's cache
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
    """The blurred root sqrt(t - t^2 / (2 R)) by which a lit cylinder brightens inward of its limb.

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

    The substitution x + z = w^2 removes the root's corner; Simpson's rule on w then is exact to
    1e-10.
    """
    # They are parabolic cylinder functions; `scipy.special.pbdv` agrees to 1e-10 but takes 0.14 s.
    x = np.linspace(-8, _REACH, _TABLE)
    rule = np.full(_SIMPSON + 1, 2.0)
    rule[1::2] = 4
    rule[[0, -1]] = 1
    integrals = []
    for centre in np.array_split(x[:, None], _PARTS):
        low, high = np.sqrt(np.maximum(centre - 8, 0.0)), np.sqrt(centre + 8)
        w = np.arange(_SIMPSON + 1) * ((high - low) / _SIMPSON) + low
        w[:, -1:] = high
        density = np.exp(-((w**2 - centre) ** 2) / 2) / np.sqrt(2 * np.pi) * 2 * w
        density *= rule * ((high - low) / (3 * _SIMPSON))
        integrals.append([(density * w).sum(axis=1), (density * w**3).sum(axis=1)])
    half, three = np.concatenate(integrals, axis=1)
    return x, half, three

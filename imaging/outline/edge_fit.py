"""Where along a window the edge lies: the shift at which a model explains most of the samples."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import leastsq

from ..arrays import Array

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
    """The height b of a + b model fitted to samples by least squares, and what it leaves over.

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
    """The unknowns of least squared residuals, by Levenberg and Marquardt.

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

"""Where along a window the edge lies: the shift at which a model explains most of the samples."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Edge = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Brightness of an edge against the distance inward t [px], elementwise, in any unit."""


def best_shift(
    windows: NDArray[np.floating],
    t: NDArray[np.float64],
    edge: Edge,
    reach: float,
    spacing: float,
) -> NDArray[np.float64]:
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
    energy = (windows @ models.T.astype(windows.dtype)).astype(np.float64)
    return parabola_peak(energy * np.abs(energy)) * spacing - count * spacing


def parabola_peak(energy: NDArray[np.float64]) -> NDArray[np.float64]:
    """Index of each row's maximum, with a fraction from the parabola through its neighbours.

    Args:
        energy: shape (m, k), k >= 3.

    Returns:
        Shape (m,); a whole number where the maximum is the first or last value.
    """
    best = np.argmax(energy, axis=1)
    row = np.arange(best.size)
    inner = np.clip(best, 1, energy.shape[1] - 2)
    before, at, after = (energy[row, inner + d] for d in (-1, 0, 1))
    bend = before - 2 * at + after
    safe = np.where(bend < 0, bend, -1.0)
    offset = np.where(bend < 0, 0.5 * (before - after) / safe, 0.0)
    return np.where(inner == best, inner + np.clip(offset, -1, 1), best)


def height_and_rest(
    samples: NDArray[np.float64], model: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64]]:
    """The height b of a + b model fitted to samples by least squares, and what it leaves over."""
    centred = model - model.mean()
    rest = samples - samples.mean()
    power = float(centred @ centred)
    height = float(centred @ rest) / power if power > 0 else 0.0
    return height, rest - height * centred

"""Output of the valve or pump that holds a pressure by itself: a bias, or a cubic from steps."""

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..errors import RigError

FULL_OUTPUT = 255
"""Largest output [counts of pulse-width modulation], 5 V."""


@dataclasses.dataclass(frozen=True)
class FeedForward:
    """Output v that is added to the controller's, v = sum c_k (P / P_s)^k, k = 0..3.

    Attributes:
        coefficients: c_k [counts], shape (4,).
        scale: P_s [Pa], > 0.
        pressure_range: lowest and highest pressure [Pa] at which v is known.
        covariance: of the coefficients [counts^2], shape (4, 4); infinite where it is not known.
        scatter: root mean square [counts] of the steps about the cubic.
    """

    coefficients: tuple[float, ...]
    scale: float = 1.0
    pressure_range: tuple[float, float] = (0.0, math.inf)
    covariance: tuple[tuple[float, ...], ...] = ()
    scatter: float = math.inf

    @classmethod
    def bias(cls, output: float = 127.5) -> "FeedForward":
        """The same output at every pressure: 2.5 V, the proportional valve's middle."""
        return cls((output, 0.0, 0.0, 0.0))

    def output(self, pressure: float) -> float:
        """Output [counts, 0..255] that holds a pressure [Pa].

        Raises:
            RigError: the pressure lies outside `pressure_range`, or the output outside 0..255.
        """
        low, high = self.pressure_range
        if not low <= pressure <= high:
            raise RigError(
                f"the feed-forward is known from {low:.0f} to {high:.0f} Pa, not at {pressure:.0f} "
                "Pa; step the pump over the whole range of the plan"
            )
        v = math.fsum(c * (pressure / self.scale) ** k for k, c in enumerate(self.coefficients))
        if not 0 <= v <= FULL_OUTPUT:
            raise RigError(f"the feed-forward at {pressure:.0f} Pa is {v:.1f}; it must be 0..255")
        return v

    def error(self, pressure: ArrayLike) -> NDArray[np.float64]:
        """Standard error [counts] of the output at pressures [Pa], any shape."""
        x = np.asarray(pressure, np.float64)[..., None] / self.scale
        if not self.covariance:
            return np.full(x.shape[:-1], math.inf)
        powers = x ** np.arange(len(self.coefficients))
        return np.sqrt(np.einsum("...i,ij,...j", powers, np.array(self.covariance), powers))


def fit_feed_forward(pressures: ArrayLike, outputs: ArrayLike) -> FeedForward:
    """The cubic through steps of the output, neglecting the pressures' noise.

    Args:
        pressures: mean pressure [Pa] at each step, shape (n,), n >= 5, four different at least.
        outputs: the steps [counts, 0..255], shape (n,).

    Returns:
        v(P) with the covariance of its coefficients, known between the extreme pressures.

    Raises:
        RigError: too few steps, or a cubic that does not rise over the whole range: the pump did
            not follow.

    >>> P = np.linspace(0, 7e5, 8)
    >>> v = fit_feed_forward(P, 20 + 180 * (P / 7e5) ** 2 + 30 * P / 7e5)
    >>> round(v.output(3.5e5), 6)
    80.0
    """
    P, u = np.asarray(pressures, np.float64), np.asarray(outputs, np.float64)
    if P.ndim != 1 or P.shape != u.shape:
        raise RigError(f"pressures and outputs must have one shape (n,), got {P.shape}, {u.shape}")
    if not (np.isfinite(P).all() and np.isfinite(u).all()):
        raise RigError("pressures and outputs must be finite; leave out steps that were not read")
    if u.size < 5 or np.unique(u).size < 4 or np.unique(P).size < 4:
        raise RigError(f"a cubic with its error needs five steps of four outputs, got {u.size}")
    scale = float(np.abs(P).max())
    A = np.vander(P / scale, 4, increasing=True)
    c, _, rank, _ = np.linalg.lstsq(A, u)
    if rank < 4:
        raise RigError("the pressures do not fix a cubic; spread the steps over the whole range")
    scatter = float(np.sqrt(np.sum((A @ c - u) ** 2) / (u.size - 4)))
    x = np.linspace(P.min(), P.max(), 257) / scale
    slope = c[1] + 2 * c[2] * x + 3 * c[3] * x * x
    if (slope <= 0).any():
        at = x[np.argmin(slope)] * scale
        raise RigError(
            f"the output must rise with the pressure, but falls near {at:.0f} Pa; wait longer at "
            "each step, start where the pump begins to deliver, and check the needle valve"
        )
    covariance = scatter**2 * np.linalg.inv(A.T @ A)
    rows, known = tuple(map(tuple, covariance.tolist())), (float(P.min()), float(P.max()))
    return FeedForward(tuple(c.tolist()), scale, known, rows, scatter)

"""The shapes of the reference work's muscle, as profiles D(x) of `MuscleScene`."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from .muscle import INCH

REST_LENGTH = 9.28125 * INCH
PUBLISHED_CONTRACTIONS = (0.0, 0.0875, 0.175, 0.2625, 0.35)

# Chambers 2021, table 4.3 with the corrected wave numbers: a0, (a1, a2, a3), (b1, b2, b3) [in], w [-].
_TABLE_4_3 = (
    (1.02, (-0.09, -0.07, -0.01), (0.03, 0.06, 0.02), 5.596),
    (1.37, (-0.35, -0.15, -0.01), (-0.17, -0.19, -0.06), -5.371),
    (1.51, (-0.56, -0.10, 0.04), (0.43, 0.41, 0.10), 4.961),
    (1.27, (-0.83, 0.29, 0.18), (1.20, 0.75, 0.04), 4.347),
    (-32.74, (24.82, 12.82, -3.90), (47.44, -18.47, -0.5), 2.176),
)


@dataclasses.dataclass(frozen=True)
class FourierShape:
    """D(x) = mean + sum over n of cosines_n cos(n w (x - 1/2)): a profile symmetric about its middle.

    Attributes:
        mean: constant term [m].
        cosines: coefficients about the middle [m].
        frequency: wave number w [-].
    """

    mean: float
    cosines: tuple[float, ...]
    frequency: float

    def __call__(self, x: ArrayLike) -> NDArray[np.float64]:
        """D [m] at x [-]."""
        n = np.arange(1, len(self.cosines) + 1)
        angle = self.frequency * (np.asarray(x, float)[..., None] - 0.5)
        return self.mean + np.cos(n * angle) @ np.array(self.cosines)


def published_shape(contraction: float) -> FourierShape:
    """The muscle's published profile at 100 psi and one of `PUBLISHED_CONTRACTIONS`, symmetrised.

    Args:
        contraction: (L0 - L)/L0 [-]: 0, 0.0875, 0.175, 0.2625 or 0.35.

    Raises:
        ValueError: another contraction; `stroke_shape` has those between.

    References:
        Chambers 2021, table 4.3.
    """
    if contraction not in PUBLISHED_CONTRACTIONS:
        raise ValueError(
            f"profiles are published at the contractions {PUBLISHED_CONTRACTIONS}, not at "
            f"{contraction}; `stroke_shape` interpolates"
        )
    mean, a, b, w = _TABLE_4_3[PUBLISHED_CONTRACTIONS.index(contraction)]
    n = np.arange(1, len(a) + 1)
    # a cos(nwx) + b sin(nwx), its part even about x = 1/2.
    even = np.array(a) * np.cos(n * w / 2) + np.array(b) * np.sin(n * w / 2)
    return FourierShape(mean * INCH, tuple(float(c) * INCH for c in even), abs(w))


def stroke_shape(
    contraction: float, end_diameter: float = 0.875 * INCH
) -> Callable[[ArrayLike], NDArray[np.float64]]:
    """A profile at any contraction of the stroke, its ends held by fittings of one diameter.

    Between the published profiles by a monotone cubic in the contraction at every x; what the
    published ends deviate from `end_diameter` is taken off, fading to nothing in the middle.

    Args:
        contraction: (L0 - L)/L0 [-], 0 to 0.35.
        end_diameter: D at both tapes [m].

    Raises:
        ValueError: a contraction outside of the published ones.
    """
    if not PUBLISHED_CONTRACTIONS[0] <= contraction <= PUBLISHED_CONTRACTIONS[-1]:
        raise ValueError(
            f"the stroke is known from 0 to {PUBLISHED_CONTRACTIONS[-1]}, got {contraction}"
        )

    def between(x: NDArray[np.float64]) -> NDArray[np.float64]:
        from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 - keeps the import cheap

        published = np.stack([published_shape(each)(x) for each in PUBLISHED_CONTRACTIONS])
        return np.asarray(PchipInterpolator(PUBLISHED_CONTRACTIONS, published)(contraction))

    excess = float(between(np.zeros(1))[0]) - end_diameter

    def shape(x: ArrayLike) -> NDArray[np.float64]:
        x = np.asarray(x, float)
        return between(x) - excess * (1 - 4 * x * (1 - x)) ** 4

    return shape

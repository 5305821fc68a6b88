"""How far the front of a tape's edge lies beside its middle: leaning tapes, tilted axes, distances."""

import dataclasses

import numpy as np

from ..arrays import Array
from ..outline.smoother import correlated_points
from .ring import Ring, plane_model


@dataclasses.dataclass(frozen=True)
class Lean:
    """A ring as a plane through a cylinder, from its arc in the picture.

    Attributes:
        slope: p, by which the ring's front lies lower than its middle, over the radius [-].
        stderr: its standard error [-].
        middle: how far the ring's middle lies beyond `Ring.y` along the axis [m].
        middle_stderr: standard error of the middle's place [m].
    """

    slope: float
    stderr: float
    middle: float
    middle_stderr: float


def ring_lean(ring: Ring, radius: float) -> Lean:
    """The lean of a ring, by least squares.

    Unrolled about an upright cylinder at the camera's distance, a ring square to it is straight.
    The front of one that leans lies lower by p sqrt(R^2 - X^2) at X across the axis, as does that of
    a square one around a tilted axis, or seen from another distance.

    Args:
        ring: from `find_ring`.
        radius: R of the ring [m].
    """
    model = plane_model(radius * ring.lateral, radius)
    inverse = np.linalg.pinv(model)
    found = inverse @ ring.shift
    off = ring.shift - model @ found
    variance = float(off @ off) / max(off.size - model.shape[1], 1)
    # Groups in the width of one thread are moved together.
    stderr: Array = np.sqrt(np.diag(inverse @ inverse.T) * variance * correlated_points(off))
    return Lean(float(found[2]), float(stderr[2]), float(found[0]), float(stderr[0]))

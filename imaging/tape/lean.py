"""How far the front of a tape's edge lies beside its middle: leaning tapes, tilted axes, distances."""

import dataclasses

from .ring import Ring, plane_through


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
    found, stderr = plane_through(radius * ring.lateral, ring.shift, radius)
    return Lean(found[2], stderr[2], found[0], stderr[0])

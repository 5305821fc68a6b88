"""What a perfect measurement of a picture would find, by closed forms that the renderer does not use."""

import dataclasses

import numpy as np

from imaging.camera import Array

from .world import World


@dataclasses.dataclass(frozen=True)
class MuscleTruth:
    """What a perfect measurement of the picture would find, in SI but for the picture's px.

    Attributes:
        rows: rows v at which both sides of the braid are seen [px], shape (m,).
        left, right: columns of the braid's outline at these rows [px], relief included.
        z: positions along the muscle from the upper tape's edge, shape (1001,), with the diameter
            of the mean outline there and the angle of the strands to the circumference.
        length: L, between the inner edges of the tapes along the axis.
        turns: of a strand about the axis over the length [-].
        px_per_m: scale in the plane of the axis.
        x0, roll: as of `MuscleScene`.
        upper_edge, lower_edge: points (u, v) of the tapes' inner edges, the front half of a circle
            [px], shape (k, 2), from the left to the right.
    """

    rows: Array
    left: Array
    right: Array
    z: Array
    diameter: Array
    length: float
    volume: float
    mean_diameter: float
    braid_angle: Array
    turns: float
    px_per_m: float
    x0: float
    roll: float
    upper_edge: Array
    lower_edge: Array

    @property
    def tape_rows(self) -> tuple[float, float]:
        """Rows at which the tapes' inner edges cross the middle of the muscle, upper and lower."""
        middle = self.upper_edge.shape[0] // 2
        return float(self.upper_edge[middle, 1]), float(self.lower_edge[middle, 1])


@dataclasses.dataclass(frozen=True)
class RulerTruth:
    """What a perfect reading of a ruler would find.

    Attributes:
        px_per_m: scale in the mid-plane, where the muscle's axis lies [px/m].
        line: scale along the ruler from its first mark to its last, seen from the camera [px/m]:
            what the picture alone shows of a ruler that is neither tilted nor misplaced.
        marks: middles (u, v) of the marks at half their length [px], shape (n, 2).
        tilt_deg: as of `RulerScene`.
    """

    px_per_m: float
    line: float
    marks: Array
    tilt_deg: float


_POINTS = 1001


def true_figures(world: World) -> MuscleTruth:
    """What a perfect measurement of this world's picture would find."""
    from scipy.integrate import simpson
    from scipy.interpolate import CubicSpline

    muscle = world.muscle
    sides = [CubicSpline(v, u) for u, v in world.outline()]
    first = max(side.x[0] for side in sides)
    last = min(side.x[-1] for side in sides)
    rows = np.arange(np.ceil(first), np.floor(last) + 1)
    z = np.linspace(0, world.length, _POINTS)
    D = muscle.diameter(z / world.length)
    lower = world.axis.first + muscle.length
    along = world.axis.first + z * muscle.length / world.length
    return MuscleTruth(
        rows=rows,
        left=sides[0](rows),
        right=sides[1](rows),
        z=z,
        diameter=D,
        length=world.length,
        volume=float(simpson(np.pi / 4 * D**2, x=z)),
        mean_diameter=float(simpson(D, x=z)) / world.length,
        braid_angle=np.arctan2(1, np.interp(along, world.y, world.weave.cotangent)),
        turns=float(np.ptp(world.weave.twist)) / (2 * np.pi),
        px_per_m=world.camera.px_per_m,
        x0=muscle.x0,
        roll=muscle.roll,
        upper_edge=world.ring(world.axis.first, world.edge_radius(muscle.upper, 0)),
        lower_edge=world.ring(lower, world.edge_radius(muscle.lower, -1)),
    )

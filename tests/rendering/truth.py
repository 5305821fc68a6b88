"""What a perfect measurement of a picture would find, by closed forms that the renderer does not use."""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike
from scipy.integrate import simpson
from scipy.interpolate import CubicSpline

from imaging.camera import Array, Camera, turned

from .world import World


@dataclasses.dataclass(frozen=True)
class MuscleTruth:
    """What a perfect measurement of the picture would find, in SI but for the picture's px."""

    rows: Array  # at which both sides of the braid are seen
    left: Array  # columns of the outline there, relief included
    right: Array
    z: Array  # positions along the muscle from the upper tape's edge
    diameter: Array  # of the mean outline there
    length: float  # L, between the inner edges of the tapes along the axis
    volume: float
    mean_diameter: float
    braid_angle: Array  # of the strands to the circumference at z
    turns: float
    px_per_m: float  # in the plane of the axis
    x0: float
    roll: float
    upper_edge: Array  # points (u, v) of the tape's inner edge, the front half of a circle
    lower_edge: Array


@dataclasses.dataclass(frozen=True)
class RulerTruth:
    """What a perfect reading of a ruler would find."""

    px_per_m: float  # in the mid-plane, where the muscle's axis lies
    line: float  # px/m along the ruler from its first mark to its last, as the camera sees it
    marks: Array  # middles (u, v) of the marks at half their length
    tilt_deg: float


def _common_rows(sides: list[CubicSpline]) -> tuple[Array, Array, Array]:
    """Rows that both sides have, and the columns of the left and the right one."""
    first, last = max(side.x[0] for side in sides), min(side.x[-1] for side in sides)
    rows = np.arange(np.ceil(first), np.floor(last) + 1)
    return rows, sides[0](rows), sides[1](rows)


def silhouette_from_profile(
    camera: Camera, y: ArrayLike, R: ArrayLike, *, x0: float = 0.0, roll: float = 0.0
) -> tuple[Array, Array, Array]:
    """Rows, left and right columns [px] of a body of revolution with radii R at y [m].

    On the outline sin(phi - alpha) = (R - R' y) / rho, alpha = atan(x0 / d), rho = hypot(x0, d).
    """
    y, R = np.asarray(y, float), np.asarray(R, float)
    slope, d = CubicSpline(y, R)(y, 1), camera.distance
    alpha, psi = np.arctan2(x0, d), np.arcsin((R - slope * y) / np.hypot(x0, d))
    sides = []
    for phi in (np.pi - psi + alpha, psi + alpha):
        X, Y = turned(x0 + R * np.cos(phi), y, roll)
        u, v = camera.pixels(X, Y, d - R * np.sin(phi))
        sides.append(CubicSpline(v, u))
    return _common_rows(sides)


def true_figures(world: World) -> MuscleTruth:
    muscle = world.muscle
    rows, left, right = _common_rows([CubicSpline(v, u) for u, v in world.outline()])
    z = np.linspace(0, world.length, 1001)
    D = muscle.diameter(z / world.length)
    lower = world.axis.first + muscle.length
    along = world.axis.first + z * muscle.length / world.length
    return MuscleTruth(
        rows, left, right, z, D,
        length=world.length,
        volume=float(simpson(np.pi / 4 * D**2, x=z)),
        mean_diameter=float(simpson(D, x=z)) / world.length,
        braid_angle=np.arctan2(1, np.interp(along, world.y, world.weave.cotangent)),
        turns=float(np.ptp(world.weave.twist)) / (2 * np.pi),
        px_per_m=world.camera.px_per_m, x0=muscle.x0, roll=muscle.roll,
        upper_edge=world.ring(world.axis.first, world.edge_radius(muscle.upper, 0)),
        lower_edge=world.ring(lower, world.edge_radius(muscle.lower, -1)),
    )  # fmt: skip

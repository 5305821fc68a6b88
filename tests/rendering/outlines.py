"""The outline of a body of revolution from a closed form, to judge measurements by."""

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from imaging.camera import Array, Camera, turned


def silhouette_from_profile(
    camera: Camera, y: ArrayLike, R: ArrayLike, *, x0: float = 0.0, roll: float = 0.0
) -> tuple[Array, Array, Array]:
    """The outline of a body of revolution in the picture: rows, left and right columns [px].

    The surface point at azimuth phi is on the outline where its normal is square to the ray:
    sin(phi - alpha) = (R - R' y) / rho, alpha = atan(x0 / d), rho = hypot(x0, d). Exact for a body
    that does not hide itself; R' is the slope of a cubic spline through the radii R at y [m].
    """
    y, R = np.asarray(y, float), np.asarray(R, float)
    slope = CubicSpline(y, R)(y, 1)
    d = camera.distance
    rho, alpha = np.hypot(x0, d), np.arctan2(x0, d)
    psi = np.arcsin((R - slope * y) / rho)
    sides = []
    for phi in (np.pi - psi + alpha, psi + alpha):
        X, Y = turned(x0 + R * np.cos(phi), y, roll)
        u, v = camera.pixels(X, Y, d - R * np.sin(phi))
        sides.append(CubicSpline(v, u))
    first = max(side.x[0] for side in sides)
    last = min(side.x[-1] for side in sides)
    rows = np.arange(np.ceil(first), np.floor(last) + 1)
    return rows, sides[0](rows), sides[1](rows)

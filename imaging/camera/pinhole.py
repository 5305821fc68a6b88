"""The camera as a pinhole with radial distortion.

Picture: u to the right, v downwards, in px, pixel centres at the integers. World: X to the right,
Y downwards, Z along the optical axis away from the camera, in metres, the camera at the origin.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array
from .tangents import body_from_tangents, turned as turned

_NEWTON_STEPS = 6  # quadratic from an error of k1 r^2, at most a few percent


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera that looks square at the plane in which the muscle's axis lies.

    u - u_c = f x (1 + k1 r^2), v - v_c = f y (1 + k1 r^2), x = X/Z, y = Y/Z, r^2 = x^2 + y^2,
    f = px_per_m distance.

    Attributes:
        px_per_m: scale in the mid-plane Z = distance [px/m], > 0.
        distance: camera's centre of projection to the mid-plane [m], > 0.
        centre: where the optical axis meets the picture (u, v) [px]; in a cropped picture outside
            of its middle as a rule.
        k1: radial distortion [-]; negative is a barrel.

    Raises:
        ValueError: a figure that is not finite, or a scale or distance that is not positive.

    Examples:
        >>> camera = Camera(px_per_m=8922.4, distance=1.524, centre=(549.5, 1324.5))
        >>> round(float(camera.pixels(0.01, 0.0, 1.524)[0]), 3)
        638.724
    """

    px_per_m: float
    distance: float
    centre: tuple[float, float]
    k1: float = 0.0

    def __post_init__(self) -> None:
        figures = (self.px_per_m, self.distance, *self.centre, self.k1)
        if not np.all(np.isfinite(figures)) or self.px_per_m <= 0 or self.distance <= 0:
            raise ValueError(
                "a camera has finite figures, px_per_m > 0 and distance > 0; got "
                f"px_per_m = {self.px_per_m} px/m, distance = {self.distance} m, "
                f"centre = {self.centre} px, k1 = {self.k1}"
            )

    @property
    def focal_px(self) -> float:
        """Focal length f [px]."""
        return self.px_per_m * self.distance

    def rays(self, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """The rays (X/Z, Y/Z) [-] of picture positions u, v [px], broadcast shape."""
        x = (np.asarray(u, float) - self.centre[0]) / self.focal_px
        y = (np.asarray(v, float) - self.centre[1]) / self.focal_px
        if self.k1 == 0:
            return x, y
        distorted = np.hypot(x, y)
        r = distorted
        for _ in range(_NEWTON_STEPS):
            r = r - (r * (1 + self.k1 * r**2) - distorted) / (1 + 3 * self.k1 * r**2)
        factor = np.divide(r, distorted, out=np.ones(distorted.shape), where=distorted > 0)
        return np.asarray(x * factor, float), np.asarray(y * factor, float)

    def pixels(self, X: ArrayLike, Y: ArrayLike, Z: ArrayLike) -> tuple[Array, Array]:
        """The picture positions (u, v) [px] of points X, Y, Z [m], Z > 0, broadcast shape."""
        x, y = np.asarray(X, float) / Z, np.asarray(Y, float) / Z
        f = self.focal_px * (1 + self.k1 * (x**2 + y**2))
        return np.asarray(self.centre[0] + f * x, float), np.asarray(self.centre[1] + f * y, float)


@dataclasses.dataclass(frozen=True)
class Silhouette:
    """The body of revolution behind an outline.

    Attributes:
        y: position along the axis, from the foot of the perpendicular that the optical axis drops
            on it, downwards [m], shape (n,), increasing.
        radius: radius R [m] at y, shape (n,).
        x0: distance of the axis from the optical axis, positive to the right [m].
        roll: angle of the axis against the picture's vertical [rad], positive when the picture
            shows it turned clockwise, its lower end to the left.
    """

    y: Array
    radius: Array
    x0: float
    roll: float


def silhouette_from_profile(
    camera: Camera, y: ArrayLike, R: ArrayLike, *, x0: float = 0.0, roll: float = 0.0
) -> tuple[Array, Array, Array]:
    """The outline of a body of revolution in the picture: rows, left and right columns [px].

    The surface point at azimuth phi is on the outline where its normal is square to the ray:
    sin(phi - alpha) = (R - R' y) / rho, alpha = atan(x0 / d), rho = hypot(x0, d). Exact for a body
    that does not hide itself; R' is the slope of a cubic spline through R.

    Args:
        camera: the camera.
        y: positions along the axis [m], increasing, shape (n,), n >= 4.
        R: radius at y [m], > 0, shape (n,).
        x0: distance of the axis from the optical axis [m], see `Silhouette`.
        roll: turn of the axis [rad], see `Silhouette`.

    Returns:
        rows: the integers v at which both sides are seen [px], shape (m,).
        left, right: columns u of the outline at these rows [px], shape (m,).

    Raises:
        ValueError: the body reaches the camera or turns away from it: no outline.

    References:
        Chambers 2021, section 4.2, gives the pixel-level outline without perspective.
    """
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 - keeps the import cheap

    y, R = np.asarray(y, float), np.asarray(R, float)
    slope = CubicSpline(y, R)(y, 1)
    d = camera.distance
    rho, alpha = np.hypot(x0, d), np.arctan2(x0, d)
    sine = (R - slope * y) / rho
    if not np.all(np.abs(sine) < 1):
        raise ValueError(
            "the camera must stand outside of the body and see both its sides; |R - R' y| reaches "
            f"{np.abs(sine).max():.3g} of the distance {rho:.3g} m"
        )
    psi = np.arcsin(sine)
    sides = []
    for phi in (np.pi - psi + alpha, psi + alpha):
        X, Y = turned(x0 + R * np.cos(phi), y, roll)
        u, v = camera.pixels(X, Y, d - R * np.sin(phi))
        sides.append(CubicSpline(v, u))
    first = max(side.x[0] for side in sides)
    last = min(side.x[-1] for side in sides)
    rows = np.arange(np.ceil(first), np.floor(last) + 1)
    return rows, sides[0](rows), sides[1](rows)


def profile_from_silhouette(
    camera: Camera,
    rows: ArrayLike,
    left: ArrayLike,
    right: ArrayLike,
    *,
    slope_window: int = 31,
    tolerance: float = 1e-10,
    max_steps: int = 30,
) -> Silhouette:
    """The body of revolution whose outline this is, exactly: perspective, roll and lens undone.

    With the ray's angle beta to the axis' own direction alpha, and psi = asin((R - R' y) / rho):
    R = rho sin(beta) / cos(psi - beta), y = b (d - R sin(psi +- alpha)), b = Y/Z of the turned ray.
    Left and right are solved each for itself and brought to common positions y, so that the roll
    biases nothing; alpha and the roll are those for which the two sides agree.

    Args:
        camera: the camera, with the distortion k1.
        rows: rows v [px], increasing, shape (n,).
        left: columns u of the left side [px], shape (n,).
        right: columns u of the right side [px], greater than `left`, shape (n,).
        slope_window: points of the outline through which a quartic gives R' [-], odd; fewer where
            the outline is shorter. Only R' is smoothed, and R depends on it at second order.
        tolerance: change of the roll [rad], and of x0 and R over the distance, at which it stops.
        max_steps: the most steps.

    Returns:
        The body at the positions that both sides show: n points or, with a roll, a few fewer.

    Raises:
        ValueError: shapes that differ, fewer than 9 rows, sides that cross or values that are not
            finite; or no convergence, which an outline of no body of revolution can cause.
    """
    rows, left, right = _checked_outline(rows, left, right)
    body = body_from_tangents(
        camera.rays(left, rows),
        camera.rays(right, rows),
        camera.distance,
        slope_window=slope_window,
        tolerance=tolerance,
        max_steps=max_steps,
    )
    return Silhouette(*body)


def _checked_outline(*columns: ArrayLike) -> tuple[Array, Array, Array]:
    rows, left, right = (np.asarray(column, float) for column in columns)
    if not (rows.ndim == 1 and rows.shape == left.shape == right.shape and rows.size >= 9):
        raise ValueError(
            "an outline is rows, left and right of one shape (n,), n >= 9; got the shapes "
            f"{rows.shape}, {left.shape}, {right.shape}"
        )
    if not all(np.all(np.isfinite(column)) for column in (rows, left, right)):
        raise ValueError("an outline has finite positions; leave out the rows that were not found")
    if not (np.all(np.diff(rows) > 0) and np.all(left < right)):
        raise ValueError("rows must increase and left must lie left of right in every one of them")
    return rows, left, right


def ring_position(
    camera: Camera,
    u: ArrayLike,
    v: ArrayLike,
    radius: ArrayLike,
    x0: float = 0.0,
    roll: float = 0.0,
) -> Array:
    """Position y along the axis [m] of a ring of known radius that is seen at picture position u, v.

    A straight edge around a cylinder, such as a tape's, is the front of a circle and so an arc in
    the picture: on the axis of a 1.4 in muscle, 4.6 in above the optical axis and 60 in away, it
    lies 0.055 in further out than at the limb. y = b Z with the nearer root Z of
    (a Z - x0)^2 + (Z - d)^2 = R^2.

    Args:
        camera: the camera.
        u: columns of points on the edge [px].
        v: rows of the same points [px], broadcast with u.
        radius: radius R of the ring [m], broadcast with u and v.
        x0: distance of the axis from the optical axis [m], see `Silhouette`.
        roll: turn of the axis [rad], see `Silhouette`.

    Returns:
        y [m], broadcast shape; nan where the ray passes beside a cylinder of that radius.
    """
    a, b = turned(*camera.rays(u, v), -roll)
    d = camera.distance
    half = a * x0 + d
    under = half**2 - (1 + a**2) * (x0**2 + d**2 - np.asarray(radius, float) ** 2)
    depth = (half - np.sqrt(np.where(under >= 0, under, np.nan))) / (1 + a**2)
    return b * depth


def apparent_diameter(diameter: ArrayLike, distance: float, x0: float = 0.0) -> Array:
    """Width [m] in the mid-plane that a cylinder of this diameter covers, its axis upright.

    D_app = D d sqrt(rho^2 - R^2) / (d^2 - R^2), rho = hypot(x0, d): the tangent rays touch in
    front of the axis.

    Args:
        diameter: D [m].
        distance: d, camera to mid-plane [m].
        x0: distance of the axis from the optical axis [m].
    """
    R = np.asarray(diameter, float) / 2
    width = 2 * R * distance * np.sqrt(x0**2 + distance**2 - R**2) / (distance**2 - R**2)
    return np.asarray(width, float)

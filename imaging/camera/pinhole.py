"""The camera as a pinhole with radial distortion.

Picture: u to the right, v downwards, in px, pixel centres at the integers. World: X to the right,
Y downwards, Z along the optical axis away from the camera, in metres, the camera at the origin.
"""

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array

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

    def moved(self, distance: float) -> "Camera":
        """The camera of the same pictures, its distance [m] another one."""
        further = distance / self.distance
        # k1 belongs to the angle, of which the same picture now shows less, or more.
        return dataclasses.replace(self, distance=distance, k1=self.k1 * further**2)

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


def turned(x: ArrayLike, y: ArrayLike, angle: float) -> tuple[Array, Array]:
    """x, y turned by an angle [rad], clockwise as a picture shows it."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


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

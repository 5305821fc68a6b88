"""Camera model (pinhole with radial distortion), scale, tone curve, and inversion of a silhouette."""

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.ndimage import correlate1d

from .errors import ImagingError, NoMuscle

Array = NDArray[np.float64]
"""Array of positions, brightness values or errors."""

Single = NDArray[np.float32]
"""Single-precision array, used for whole pictures and large sets of windows."""

Image = NDArray[np.uint8]
"""A picture: RGB with shape (h, w, 3), or one value per pixel with shape (h, w)."""

Flags = NDArray[np.bool_]
"""Boolean mask."""

Indices = NDArray[np.int64]
"""Array of picture rows or mark numbers."""


_NEWTON_STEPS = 6  # quadratic from an error of k1 r^2, at most a few percent


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera whose optical axis is perpendicular to the plane of the muscle's axis.

    u - u_c = f x (1 + k1 r^2), v - v_c = f y (1 + k1 r^2), x = X/Z, y = Y/Z, r^2 = x^2 + y^2,
    f = px_per_m distance.

    Attributes:
        px_per_m: scale in the mid-plane Z = distance [px/m], > 0.
        distance: distance from the centre of projection to the mid-plane [m], > 0.
        centre: position (u, v) of the optical axis in the picture [px]; usually not the middle of a
            cropped picture.
        k1: radial distortion [-]; negative for barrel distortion.

    Examples:
        >>> camera = Camera(px_per_m=8922.4, distance=1.524, centre=(549.5, 1324.5))
        >>> round(float(camera.pixels(0.01, 0.0, 1.524)[0]), 3)
        638.724
    """

    px_per_m: float
    distance: float
    centre: tuple[float, float]
    k1: float = 0.0

    def moved(self, distance: float) -> "Camera":
        """Return the same camera at a different distance [m]."""
        further = distance / self.distance
        # k1 depends on the angle, and the same picture now covers a different angle.
        return dataclasses.replace(self, distance=distance, k1=self.k1 * further**2)

    @property
    def focal_px(self) -> float:
        """Focal length f [px]."""
        return self.px_per_m * self.distance

    def rays(self, u: ArrayLike, v: ArrayLike) -> tuple[Array, Array]:
        """Return the rays (X/Z, Y/Z) [-] through picture positions u, v [px]; u and v broadcast."""
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
        """Return the image coordinates (u, v) [px] of points (X, Y, Z) [m], Z > 0; arguments broadcast."""
        x, y = np.asarray(X, float) / Z, np.asarray(Y, float) / Z
        f = self.focal_px * (1 + self.k1 * (x**2 + y**2))
        return np.asarray(self.centre[0] + f * x, float), np.asarray(self.centre[1] + f * y, float)


def turned(x: ArrayLike, y: ArrayLike, angle: float) -> tuple[Array, Array]:
    """Return x, y rotated by an angle [rad], clockwise in the picture."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


def ring_position(
    camera: Camera, u: ArrayLike, v: ArrayLike, radius: ArrayLike, x0: float = 0.0,
    roll: float = 0.0,
) -> Array:  # fmt: skip
    """Return the axial position y [m] of a ring of known radius seen at picture position u, v.

    The straight edge of a tape around a cylinder is a circle, part of which appears as an arc. If the
    ring is 1.4 in in diameter, 4.6 in above the optical axis and 60 in away, the middle of the arc is
    0.055 in further from the optical axis than its ends. y = b Z, where Z is the smaller root of
    (a Z - x0)^2 + (Z - d)^2 = R^2.

    Args:
        camera: camera.
        u: columns of points on the edge [px].
        v: rows of the same points [px], broadcast with u.
        radius: radius R of the ring [m], broadcast with u and v.
        x0: distance of the axis from the optical axis [m], see `Silhouette`.
        roll: roll of the axis [rad], see `Silhouette`.

    Returns:
        y [m], broadcast shape; nan where the ray misses a cylinder of that radius.
    """
    a, b = turned(*camera.rays(u, v), -roll)
    d = camera.distance
    half = a * x0 + d
    under = half**2 - (1 + a**2) * (x0**2 + d**2 - np.asarray(radius, float) ** 2)
    depth = (half - np.sqrt(np.where(under >= 0, under, np.nan))) / (1 + a**2)
    return b * depth


@dataclasses.dataclass(frozen=True)
class Scale:
    """The scale in the plane of the muscle's axis.

    Attributes:
        px_per_m: scale [px/m], > 0.
        stderr: standard error of the scale [px/m], >= 0. It includes the error due to the ruler's unknown
            distance from the plane of the muscle's axis only if `placement_stderr` was stated.
        tilt_deg: tilt of the ruler in depth [deg].
        residual_px: RMS deviation of the marks from the fit [px].
        marks: number of marks used.
        source: "ruler" or "manual".
        k1: radial distortion of the lens estimated from the ruler's marks; 0 if not significant.
        k1_stderr: standard error of k1; None if it was not estimated.
        pitch: spacing of the ruler's marks [m]; None if no ruler was used.
        placement_stderr: stated standard error of the ruler's position in depth [m], or None.

    Raises:
        ImagingError: the scale is not positive, or the standard error is negative.
    """

    px_per_m: float
    stderr: float
    tilt_deg: float = 0.0
    residual_px: float = 0.0
    marks: int = 0
    source: str = "manual"
    k1: float = 0.0
    k1_stderr: float | None = None
    pitch: float | None = None
    placement_stderr: float | None = None

    def __post_init__(self) -> None:
        if not (0 < self.px_per_m < np.inf and 0 <= self.stderr < np.inf):
            raise ImagingError(
                "a scale must be finite and > 0, and its standard error finite and >= 0; got "
                f"{self.px_per_m} +- {self.stderr} px/m"
            )

    @classmethod
    def manual(cls, px_per_m: float, stderr: float = 0.0) -> "Scale":
        """Return a scale that is known from another source."""
        return cls(float(px_per_m), float(stderr))

    @property
    def relative_stderr(self) -> float:
        """Standard error divided by the scale."""
        return self.stderr / self.px_per_m


LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, JPEG's own
_BRIGHTEST = 1.6  # larger amounts come from glare on threads and would pull an edge inward
_DARKEST = -0.5


@dataclasses.dataclass(frozen=True)
class Tone:
    """A camera's tone curve: linear light for each 8-bit value, assumed equal for all three colours.

    Edges are located in linear light, because edges located in encoded values move with the brightness of
    the lamps. A wrong tone curve shifts each edge by up to 0.8 px: set the camera to a neutral picture
    style.

    Attributes:
        table: linear light for the values 0 to 255, non-decreasing, 1 at 255, shape (256,).

    Raises:
        ImagingError: the shape is wrong, a value is not finite, or the curve decreases or is constant.
    """

    table: Array

    def __post_init__(self) -> None:
        table = np.array(self.table, np.float64)
        sound = table.shape == (256,) and np.isfinite(table).all()
        if not sound or np.diff(table).min() < 0 or not table[-1] > table[0]:
            raise ImagingError(
                "a tone curve must have 256 finite values that never decrease and are not all equal"
            )
        table = table / table[-1]
        table.setflags(write=False)
        object.__setattr__(self, "table", table)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tone) and np.array_equal(self.table, other.table)

    def __hash__(self) -> int:
        return hash(self.table.tobytes())

    def light(self, encoded: Array) -> Array:
        """Return the linear light for encoded values 0 to 255, any shape; non-integers are allowed."""
        return np.interp(encoded, np.arange(256), self.table)

    @classmethod
    def srgb(cls) -> "Tone":
        """Return the sRGB curve, which neutral picture styles approximate.

        E = v / 12.92 up to v = 0.04045, ((v + 0.055) / 1.055)^2.4 above.

        References:
            IEC 61966-2-1:1999, equations 5 and 6.
        """
        v = np.arange(256) / 255
        return cls(np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4))


def amount_of_luma(tone: Tone, background: Array, muscle: Array) -> Single:
    """Return the amount q of muscle for each luma value; JPEG stores luma at full resolution.

    A pixel covered by a fraction q of muscle and 1 - q of background has linear light b + q (a - b) in each
    colour. The weighted sum of the three encoded values is monotonic in q and is inverted here. If the
    muscle is darker than the background, q is 1 where one of the colours reaches zero, because the limb can
    be darker than the rest of the muscle.

    Args:
        tone: tone curve of the camera.
        background: linear light b of the background, shape (3,).
        muscle: linear light a of the muscle, shape (3,).

    Returns:
        q for luma values 0 to 255: 0 on the background, at most 1.6; shape (256,).
    """
    values, falls, least, most = np.arange(256.0), background - muscle, -np.inf, _BRIGHTEST
    if float(falls @ LUMA) > 0:
        most = float(np.min(background[falls > 0] / falls[falls > 0]))
    else:  # no shadow can be darker than black
        least = max(_DARKEST, float(background @ LUMA) / min(float(falls @ LUMA), -1e-9))
    q = np.linspace(_DARKEST, most, 1024)
    light = np.clip(background + q[:, None] * (muscle - background), 0, 1)
    seen = np.interp(light, tone.table, values) @ LUMA
    if seen[-1] < seen[0]:
        seen, q = seen[::-1], q[::-1] / most
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(seen), prepend=-1.0) > 0)
    return np.maximum(np.interp(values, seen[rising], q[rising]), least).astype(np.float32)


_END_ROWS = 24
_SLOPE_WINDOW = 31  # rows of the quartic that gives R', on which R depends only to second order
_TOLERANCE = 1e-10  # of the roll [rad], and of x0 and R relative to the distance
_MOST_STEPS = 30


@dataclasses.dataclass(frozen=True)
class Silhouette:
    """A body of revolution with a given outline.

    Attributes:
        y: position along the axis [m], shape (n,), increasing downwards. Zero is the point on the axis
            closest to the optical axis.
        radius: radius R at y [m], shape (n,).
        x0: distance of the axis from the optical axis, positive to the right [m].
        roll: angle between the axis and the picture's vertical [rad], positive clockwise, with the
            lower end to the left.
    """

    y: Array
    radius: Array
    x0: float
    roll: float

    def radius_at(self, y: ArrayLike) -> Array:
        """Return R [m] at y [m] from a cubic spline, extended beyond each end by a parabola."""
        y = np.asarray(y, float)
        radius = CubicSpline(self.y, self.radius)(y)
        for rows, beyond in (
            (slice(None, _END_ROWS), y < self.y[0]),
            (slice(-_END_ROWS, None), y > self.y[-1]),
        ):
            if beyond.any():
                parabola = np.polynomial.Polynomial.fit(self.y[rows], self.radius[rows], 2)
                radius = np.where(beyond, parabola(y), radius)
        return radius


def profile_from_silhouette(
    camera: Camera, rows: ArrayLike, left: ArrayLike, right: ArrayLike
) -> Silhouette:
    """Return the body of revolution with this outline, inverting perspective, roll and distortion exactly.

    beta is the angle between a ray and the direction alpha of the axis, and psi = asin((R - R' y) / rho):
    R = rho sin(beta) / cos(psi - beta), y = b (d - R sin(psi +- alpha)), b = Y/Z of the rotated ray.
    Each side is solved separately, and both are interpolated to common positions y, so that the roll
    causes no bias. alpha and the roll are chosen so that the two sides agree.

    Args:
        camera: camera, including the distortion k1.
        rows: rows v [px], increasing, shape (n,).
        left: columns u of the left side [px], shape (n,).
        right: columns u of the right side [px], greater than `left`, shape (n,).

    Returns:
        The body at the positions visible on both sides; slightly fewer than n if the axis is rolled.

    Raises:
        NoMuscle: no body of revolution has this outline.
    """
    v, u = np.asarray(rows, float), np.array([left, right], float)
    d, sign, rays = camera.distance, np.array([[-1.0], [1.0]]), camera.rays(u, v)
    y, R, slope = rays[1] * d, np.zeros(u.shape), np.zeros(u.shape)
    x0, roll, tilt, shift = 0.0, 0.0, np.inf, np.inf
    for _ in range(_MOST_STEPS):
        a, b = turned(*rays, -roll)
        rho, alpha = np.hypot(x0, d), np.arctan2(x0, d)
        sine = (R - slope * y) / rho
        if not np.all(np.abs(sine) < 1):
            break
        psi, beta = np.arcsin(sine), sign * (np.arctan(a) - alpha)
        before, R = R, rho * np.sin(beta) / np.cos(psi - beta)
        y = b * (d - R * np.sin(psi + sign * alpha))
        slope = _rises(R) / _rises(y)
        common = y.mean(axis=0)
        common = common[(common >= y[:, 0].max()) & (common <= y[:, -1].min())]
        one, other = (CubicHermiteSpline(*side)(common) for side in zip(y, R, slope, strict=True))
        # If the axis lies further right than assumed, the right radius is too large by that amount.
        tilt, shift = np.polyfit(common, (other - one) / 2, 1).tolist()
        x0, roll = x0 + shift, roll - tilt
        if abs(tilt) < _TOLERANCE and max(abs(shift), np.abs(R - before).max()) < _TOLERANCE * d:
            return Silhouette(common, (one + other) / 2, x0, roll)
    raise NoMuscle(
        "the outline must be that of a body of revolution: check that nothing is in front of or next to "
        "the muscle"
    )


def _rises(values: Array) -> Array:
    """Return the slopes per row from quartic Savitzky-Golay filters, shape (2, n)."""
    # `scipy.signal.savgol_filter` does the same, but takes half a second to import.
    points = min(_SLOPE_WINDOW, values.shape[1] - 1 + values.shape[1] % 2)
    rates, half = _rates(points), points // 2
    rises = correlate1d(values, rates[half], axis=1)
    rises[:, :half] = values[:, :points] @ rates[:half].T
    rises[:, -half:] = values[:, -points:] @ rates[half + 1 :].T
    return rises


@functools.cache
def _rates(points: int) -> Array:
    """Return the matrix that maps `points` values to the slopes of their quartic fit at each point."""
    t = np.linspace(-1, 1, points)
    powers = np.vander(t, min(5, points), increasing=True)
    slopes = np.pad(powers[:, :-1] * np.arange(1, powers.shape[1]), ((0, 0), (1, 0)))
    return np.asarray(slopes @ np.linalg.pinv(powers) * (t[1] - t[0]), float)

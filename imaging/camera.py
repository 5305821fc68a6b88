"""The camera: pinhole with distortion, scale, tone curve, and the body of revolution behind an outline."""

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.ndimage import correlate1d

from .errors import ImagingError, NoMuscle

Array = NDArray[np.float64]
"""Positions, brightnesses, errors."""

Single = NDArray[np.float32]
"""The same in half the memory, where a whole picture or many windows are worked on."""

Image = NDArray[np.uint8]
"""A picture: RGB, shape (h, w, 3), or one value for each pixel, shape (h, w)."""

Flags = NDArray[np.bool_]
"""Which of some things are meant."""

Indices = NDArray[np.int64]
"""Rows of a picture, numbers of marks."""


_NEWTON_STEPS = 6  # quadratic from an error of k1 r^2, at most a few percent


@dataclasses.dataclass(frozen=True)
class Camera:
    """A camera that looks perpendicularly at the plane of the muscle's axis.

    u - u_c = f x (1 + k1 r^2), v - v_c = f y (1 + k1 r^2), x = X/Z, y = Y/Z, r^2 = x^2 + y^2,
    f = px_per_m distance.

    Attributes:
        px_per_m: scale in the mid-plane Z = distance [px/m], > 0.
        distance: camera's centre of projection to the mid-plane [m], > 0.
        centre: where the optical axis meets the picture (u, v) [px]; in a cropped picture outside
            of its middle as a rule.
        k1: radial distortion [-]; negative is a barrel.

    Raises:
        ImagingError: a figure that is not finite, or a scale or distance that is not positive.

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
            raise ImagingError(
                f"a camera has finite figures, scale and distance > 0; got {figures}"
            )

    def moved(self, distance: float) -> "Camera":
        """The same camera at another distance [m]."""
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
    """x, y rotated by an angle [rad], clockwise in the picture."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


def ring_position(
    camera: Camera, u: ArrayLike, v: ArrayLike, radius: ArrayLike, x0: float = 0.0,
    roll: float = 0.0,
) -> Array:  # fmt: skip
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


@dataclasses.dataclass(frozen=True)
class Scale:
    """The scale in the plane of the muscle's axis.

    Attributes:
        px_per_m: [px/m], > 0.
        stderr: its standard error [px/m], >= 0. What the picture of a ruler cannot show, the
            ruler's distance from the muscle's plane, is not in it unless it was given.
        coefficients: (a, b, c) of px(n) = (a + b n) / (1 + c n), n in metres along the ruler, or
            None where the scale is no ruler's.
        tilt_deg: of the ruler in depth [deg].
        residual_px: root mean square of the marks about the fit [px].
        marks: number of marks used.
        source: "ruler" or "manual".
        k1: radial distortion of the lens that the ruler's marks show, 0 where they show none.
        k1_stderr: its standard error; None where none was looked for.
        pitch: of the ruler's marks [m]; None without a ruler.
        placement_stderr: the stated standard error of the ruler's place in depth [m]; None where none
            was stated.

    Raises:
        ImagingError: a scale that is not positive or a standard error that is negative.
    """

    px_per_m: float
    stderr: float
    coefficients: tuple[float, float, float] | None = None
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
                "a scale is finite and > 0, its standard error finite and >= 0; got "
                f"{self.px_per_m} +- {self.stderr} px/m"
            )

    @classmethod
    def manual(cls, px_per_m: float, stderr: float = 0.0) -> "Scale":
        """A scale known from elsewhere."""
        return cls(float(px_per_m), float(stderr))

    @property
    def relative_stderr(self) -> float:
        """Standard error over the scale."""
        return self.stderr / self.px_per_m


LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, JPEG's own
_BRIGHTEST = 1.6  # amounts above belong to threads that glare; they would pull an edge inward
_DARKEST = -0.5


@dataclasses.dataclass(frozen=True)
class Tone:
    """Linear light for every value of an 8-bit picture, assumed equal in all three colours.

    Edges are found in linear light: on the encoded values every edge moves outward or inward with
    the lamps. A tone curve that is not the camera's moves the diameter by up to 0.8 px per edge:
    switch the camera to a neutral picture style.

    Attributes:
        table: linear light of the values 0 to 255, never falling, 1 at 255, shape (256,).

    Raises:
        ImagingError: another shape, values that are not finite, a curve that falls or is flat.
    """

    table: Array

    def __post_init__(self) -> None:
        table = np.array(self.table, np.float64)
        sound = table.shape == (256,) and np.isfinite(table).all()
        if not sound or np.diff(table).min() < 0 or not table[-1] > table[0]:
            raise ImagingError("a tone curve has 256 finite values that rise and never fall")
        table = table / table[-1]
        table.setflags(write=False)
        object.__setattr__(self, "table", table)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tone) and np.array_equal(self.table, other.table)

    def __hash__(self) -> int:
        return hash(self.table.tobytes())

    def light(self, encoded: Array) -> Array:
        """Linear light of encoded values 0 to 255, whole or not; any shape."""
        return np.interp(encoded, np.arange(256), self.table)

    @classmethod
    def srgb(cls) -> "Tone":
        """The sRGB curve, which a camera's neutral picture style approaches.

        E = v / 12.92 up to v = 0.04045, ((v + 0.055) / 1.055)^2.4 above.

        References:
            IEC 61966-2-1:1999, equations 5 and 6.
        """
        v = np.arange(256) / 255
        return cls(np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4))


def amount_of_look(tone: Tone, background: Array, muscle: Array, look: Array) -> Single:
    """The amount q of muscle for each value of a weighted sum of colours, 0 on the background.

    Luma is such a sum, which JPEG keeps at full resolution.

    A pixel that shows q of muscle and 1 - q of background has in each colour the light b + q (a - b),
    and the sum is that of the three encoded values: a rising or falling function of q, inverted here.
    A muscle that is darker counts as 1 where no light is left of its colour: its own limb may be
    darker than the most of it.

    Args:
        tone: the camera's tone curve.
        background: linear light b of its colours, shape (3,).
        muscle: linear light a, the same.
        look: weights of the colours, shape (3,).

    Returns:
        q for the values 0 to 255, held at 1.6 above, shape (256,).
    """
    values, falls, least, most = np.arange(256.0), background - muscle, -np.inf, _BRIGHTEST
    if float(falls @ look) > 0:
        most = float(np.min(background[falls > 0] / falls[falls > 0]))
    else:  # no shadow is darker than black
        least = max(_DARKEST, float(background @ look) / min(float(falls @ look), -1e-9))
    q = np.linspace(_DARKEST, most, 1024)
    light = np.clip(background + q[:, None] * (muscle - background), 0, 1)
    seen = np.interp(light, tone.table, values) @ look
    if seen[-1] < seen[0]:
        seen, q = seen[::-1], q[::-1] / most
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(seen), prepend=-1.0) > 0)
    return np.maximum(np.interp(values, seen[rising], q[rising]), least).astype(np.float32)


_END_ROWS = 24
_SLOPE_WINDOW = 31  # rows through which a quartic gives R', on which R depends at second order
_TOLERANCE = 1e-10  # of the roll [rad], and of x0 and R over the distance
_MOST_STEPS = 30


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

    def radius_at(self, y: ArrayLike) -> Array:
        """R [m] at any y [m]: cubic inside, a parabola through the nearest rows beyond an end."""
        y = np.asarray(y, float)
        radius = self._inside(y)
        for parabola, beyond in zip(self._ends, (y < self.y[0], y > self.y[-1]), strict=True):
            if beyond.any():
                radius = np.where(beyond, parabola(y), radius)
        return radius

    @functools.cached_property
    def _inside(self) -> CubicSpline:
        return CubicSpline(self.y, self.radius)

    @functools.cached_property
    def _ends(self) -> list[np.polynomial.Polynomial]:
        rows = slice(None, _END_ROWS), slice(-_END_ROWS, None)
        return [np.polynomial.Polynomial.fit(self.y[end], self.radius[end], 2) for end in rows]


def profile_from_silhouette(
    camera: Camera, rows: ArrayLike, left: ArrayLike, right: ArrayLike
) -> Silhouette:
    """The body of revolution with this outline, exactly: without perspective, roll and lens distortion.

    With the ray's angle beta to the axis' own direction alpha, and psi = asin((R - R' y) / rho):
    R = rho sin(beta) / cos(psi - beta), y = b (d - R sin(psi +- alpha)), b = Y/Z of the turned ray.
    Left and right are solved each for itself and brought to common positions y, so that the roll
    biases nothing; alpha and the roll are those for which the two sides agree.

    Args:
        camera: the camera, with the distortion k1.
        rows: rows v [px], increasing, shape (n,).
        left: columns u of the left side [px], shape (n,).
        right: columns u of the right side [px], greater than `left`, shape (n,).

    Returns:
        The body at the positions that both sides show: n points or, with a roll, a few fewer.

    Raises:
        NoMuscle: no outline, or one that no body of revolution has.
    """
    v, u = np.asarray(rows, float), np.array([left, right], float)
    if not (v.size >= 9 and u.shape == (2, *v.shape) and np.isfinite(u).all()) or not (
        np.all(np.diff(v) > 0) and np.all(u[0] < u[1])
    ):
        raise NoMuscle(
            "an outline is 9 or more rows in which the left side is left of the right one"
        )
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
        # An axis that lies further right than assumed makes the right radius too large by as much.
        tilt, shift = np.polyfit(common, (other - one) / 2, 1).tolist()
        x0, roll = x0 + shift, roll - tilt
        if abs(tilt) < _TOLERANCE and max(abs(shift), np.abs(R - before).max()) < _TOLERANCE * d:
            return Silhouette(common, (one + other) / 2, x0, roll)
    raise NoMuscle(
        "the outline must be that of a body of revolution, and is not: do left and right belong together?"
    )


def _rises(values: Array) -> Array:
    """Rise per row by Savitzky and Golay's quartics, shape (2, n); at the ends the last full one's."""
    # SciPy has them as well, in `scipy.signal`, which takes half a second to import.
    points = min(_SLOPE_WINDOW, values.shape[1] - 1 + values.shape[1] % 2)
    rates, half = _rates(points), points // 2
    rises = correlate1d(values, rates[half], axis=1)
    rises[:, :half] = values[:, :points] @ rates[:half].T
    rises[:, -half:] = values[:, -points:] @ rates[half + 1 :].T
    return rises


@functools.cache
def _rates(points: int) -> Array:
    """Matrix that takes `points` values to the slopes of the quartic through them, at each."""
    t = np.linspace(-1, 1, points)
    powers = np.vander(t, min(5, points), increasing=True)
    slopes = np.pad(powers[:, :-1] * np.arange(1, powers.shape[1]), ((0, 0), (1, 0)))
    return np.asarray(slopes @ np.linalg.pinv(powers) * (t[1] - t[0]), float)

"""The outline of a body of revolution in a picture, and the body behind an outline."""

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline

from ..arrays import Array
from .pinhole import Camera, turned

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
        """R [m] at any y [m]: cubic inside, beyond an end the parabola through the rows next to it."""
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
    camera: Camera, rows: ArrayLike, left: ArrayLike, right: ArrayLike
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

    Returns:
        The body at the positions that both sides show: n points or, with a roll, a few fewer.

    Raises:
        ValueError: shapes that differ, fewer than 9 rows, sides that cross or values that are not
            finite; or no convergence, which an outline of no body of revolution can cause.
    """
    rows, left, right = _checked_outline(rows, left, right)
    rays = (camera.rays(left, rows), camera.rays(right, rows))
    d = camera.distance
    sides = [_Side(b * d, np.zeros_like(b), np.zeros_like(b)) for _, b in rays]
    x0, roll = 0.0, 0.0
    tilt = shift = np.inf
    for _ in range(_MOST_STEPS):
        before = sides
        sides = [
            _improved(side, *turned(*ray, -roll), sign, x0, d)
            for side, ray, sign in zip(before, rays, (-1, 1), strict=True)
        ]
        change = max(np.abs(new.R - old.R).max() for new, old in zip(sides, before, strict=True))
        y, R_left, R_right = _on_common_positions(*sides)
        # An axis that lies further right than assumed makes the right radius too large by as much.
        tilt, shift = np.polyfit(y, (R_right - R_left) / 2, 1).tolist()
        x0, roll = x0 + shift, roll - tilt
        if abs(tilt) < _TOLERANCE and max(abs(shift), change) < _TOLERANCE * d:
            return Silhouette(y, (R_left + R_right) / 2, x0, roll)
    raise ValueError(
        f"the outline must be that of a body of revolution; after {_MOST_STEPS} steps x0 still moves "
        f"by {shift:.3g} m and the roll by {tilt:.3g} rad. Check that left and right belong "
        "together and that the outline is smooth"
    )


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


@dataclasses.dataclass(frozen=True)
class _Side:
    """One side of an outline: position y and radius R [m], slope R' [-], each of shape (n,)."""

    y: Array
    R: Array
    slope: Array


def _improved(side: _Side, a: Array, b: Array, sign: int, x0: float, d: float) -> _Side:
    """One fixed-point step for the tangent rays (a, b) of the left (-1) or right (+1) side."""
    rho, alpha = np.hypot(x0, d), np.arctan2(x0, d)
    beta = sign * (np.arctan(a) - alpha)
    sine = (side.R - side.slope * side.y) / rho
    if not np.all(np.abs(sine) < 1):
        raise ValueError(
            "an outline turns slowly enough for both its sides to be seen; |R - R' y| reaches "
            f"{np.abs(sine).max():.3g} of the distance. Check that left and right belong together "
            "and that the outline is smooth"
        )
    psi = np.arcsin(sine)
    R = rho * np.sin(beta) / np.cos(psi - beta)
    y = b * (d - R * np.sin(psi + sign * alpha))
    return _Side(y, R, _slope(y, R))


def _slope(y: Array, R: Array) -> Array:
    """dR/dy by Savitzky and Golay's quartics, both by the row; at the ends the last full one's."""
    # SciPy has them as well, in `scipy.signal`, which takes half a second to import.
    rates = _rates(min(_SLOPE_WINDOW, R.size - 1 + R.size % 2))
    return _per_row(R, rates) / _per_row(y, rates)


def _per_row(values: Array, rates: Array) -> Array:
    points = rates.shape[0]
    half = points // 2
    slopes = np.empty(values.size)
    slopes[:half] = rates[:half] @ values[:points]
    slopes[half : values.size - half] = np.correlate(values, rates[half], "valid")
    slopes[values.size - half :] = rates[half + 1 :] @ values[-points:]
    return slopes


@functools.cache
def _rates(points: int) -> Array:
    """Matrix that takes `points` values to the slopes of the quartic through them, at each."""
    t = np.linspace(-1, 1, points)
    powers = np.vander(t, min(5, points), increasing=True)
    order = np.arange(1, powers.shape[1])
    slopes = np.column_stack([np.zeros(points), powers[:, :-1] * order])
    return np.asarray(slopes @ np.linalg.pinv(powers) * (t[1] - t[0]), float)


def _on_common_positions(left: _Side, right: _Side) -> tuple[Array, Array, Array]:
    """Positions y that both sides show [m], and there the radius by the left and by the right."""
    y = (left.y + right.y) / 2
    first, last = max(left.y[0], right.y[0]), min(left.y[-1], right.y[-1])
    y = y[(y >= first) & (y <= last)]
    return y, _between(left, y), _between(right, y)


def _between(side: _Side, y: Array) -> Array:
    """R at y, by the cubics that have the side's radii and slopes."""
    # SciPy's CubicHermiteSpline gives the same; with it all of a measurement takes an eighth longer.
    k = np.clip(np.searchsorted(side.y, y, side="right") - 1, 0, side.y.size - 2)
    h = side.y[k + 1] - side.y[k]
    t = (y - side.y[k]) / h
    R0, R1, s0, s1 = side.R[k], side.R[k + 1], h * side.slope[k], h * side.slope[k + 1]
    rise = R1 - R0
    return R0 + t * (s0 + t * (3 * rise - 2 * s0 - s1 + t * (s0 + s1 - 2 * rise)))

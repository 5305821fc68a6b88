"""The body of revolution that a camera sees between two rows of tangent rays."""

import dataclasses
import functools

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array

Rays = tuple[Array, Array]


def turned(x: ArrayLike, y: ArrayLike, angle: float) -> tuple[Array, Array]:
    """x, y turned by an angle [rad], clockwise as a picture shows it."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    c, s = np.cos(angle), np.sin(angle)
    return c * x - s * y, s * x + c * y


def body_from_tangents(
    left: Rays, right: Rays, d: float, *, slope_window: int, tolerance: float, max_steps: int
) -> tuple[Array, Array, float, float]:
    """Position y [m], radius R [m], x0 [m] and roll [rad]; see `profile_from_silhouette`.

    Args:
        left: rays (X/Z, Y/Z) that touch the body on the left, shape (n,) each.
        right: the same on the right.
        d: camera to the axis [m].
        slope_window: points through which a quartic gives R', odd.
        tolerance: change of the roll [rad], and of x0 and R over d, at which it stops.
        max_steps: the most steps.

    Raises:
        ValueError: the rays are not those of a body of revolution.
    """
    rays = (left, right)
    sides = [_Side(b * d, np.zeros_like(b), np.zeros_like(b)) for _, b in rays]
    x0, roll = 0.0, 0.0
    tilt = shift = np.inf
    for _ in range(max_steps):
        before = sides
        sides = [
            _improved(side, *turned(*ray, -roll), sign, x0, d, slope_window)
            for side, ray, sign in zip(before, rays, (-1, 1), strict=True)
        ]
        change = max(np.abs(new.R - old.R).max() for new, old in zip(sides, before, strict=True))
        y, R_left, R_right = _on_common_positions(*sides)
        # An axis that lies further right than assumed makes the right radius too large by as much.
        tilt, shift = _straight_line(y, (R_right - R_left) / 2)
        x0, roll = x0 + shift, roll - tilt
        if abs(tilt) < tolerance and max(abs(shift), change) < tolerance * d:
            return y, (R_left + R_right) / 2, float(x0), float(roll)
    raise ValueError(
        f"the outline must be that of a body of revolution; after {max_steps} steps x0 still moves "
        f"by {shift:.3g} m and the roll by {tilt:.3g} rad. Check that left and right belong "
        "together and that the outline is smooth"
    )


@dataclasses.dataclass(frozen=True)
class _Side:
    """One side of an outline: position y and radius R [m], slope R' [-], each of shape (n,)."""

    y: Array
    R: Array
    slope: Array


def _improved(
    side: _Side, a: Array, b: Array, sign: int, x0: float, d: float, slope_window: int
) -> _Side:
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
    return _Side(y, R, _slope(y, R, slope_window))


def _slope(y: Array, R: Array, window: int) -> Array:
    """dR/dy by Savitzky and Golay's quartics, both by the row; at the ends the last full one's."""
    points = min(window, R.size - 1 + R.size % 2)
    rates = _rates(points)
    dR, dy = _per_row(R, rates), _per_row(y, rates)
    return dR / dy


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
    k = np.clip(np.searchsorted(side.y, y, side="right") - 1, 0, side.y.size - 2)
    h = side.y[k + 1] - side.y[k]
    t = (y - side.y[k]) / h
    R0, R1, s0, s1 = side.R[k], side.R[k + 1], h * side.slope[k], h * side.slope[k + 1]
    rise = R1 - R0
    return R0 + t * (s0 + t * (3 * rise - 2 * s0 - s1 + t * (s0 + s1 - 2 * rise)))


def _straight_line(x: Array, y: Array) -> tuple[float, float]:
    """Slope and value at x = 0 of the least-squares line."""
    away = x - x.mean()
    slope = away @ y / (away @ away)
    return float(slope), float(y.mean() - slope * x.mean())

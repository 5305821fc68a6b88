"""Bodies that rays can meet: circles piled up along an axis, and the ring between braid and fitting."""

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array, Flags

_STEPS = 3


@dataclasses.dataclass(frozen=True)
class BodyAxis:
    """The axis of a muscle: straight but for a half sine wave between the tapes.

    Attributes:
        x0, depth: of the straight line [m].
        first, length: where the braid begins along it and how long it is [m].
        bow, bow_depth: amplitudes [m].
    """

    x0: float
    depth: float
    first: float
    length: float
    bow: float
    bow_depth: float

    def at(self, y: Array) -> tuple[Array, Array, Array, Array]:
        """xc, dxc/dy, zc, dzc/dy at y."""
        x = np.clip((y - self.first) / self.length, 0, 1)
        wave = np.sin(np.pi * x)
        rate = np.where((x > 0) & (x < 1), np.pi / self.length * np.cos(np.pi * x), 0.0)
        return (
            self.x0 + self.bow * wave, self.bow * rate,
            self.depth + self.bow_depth * wave, self.bow_depth * rate,
        )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Hits:
    """Where rays meet a surface, all of shape (n,) but the normal's (n, 3).

    Attributes:
        y: position along the axis [m].
        azimuth: about the axis [rad], 0 to the right, pi/2 towards the camera.
        normal: outward, unit.
    """

    y: Array
    azimuth: Array
    normal: Array


class Body:
    """A pile of circles between two positions along an axis.

    `cut` makes an end uneven: the lower (-1) or the upper one (1), and how much further down it lies
    at an azimuth.

    Args:
        axis: the axis.
        first: upper end [m].
        last: lower end [m].
        y: positions of the radii [m], uniform.
        R: radii [m], shape of y.
        offset: how much further out the outline lies on the left and on the right [m], (2, m).
    """

    def __init__(
        self,
        axis: BodyAxis,
        first: float,
        last: float,
        y: Array,
        R: Array,
        offset: Array | None = None,
    ) -> None:
        self.first, self.last = first, last
        self.y0, self.step = y[0], y[1] - y[0]
        x, dx, z, dz = axis.at(y)
        square = R**2
        columns = square, np.gradient(square, y), x, dx, z, dz
        self.columns = [
            (column, None if np.ptp(column) == 0 else np.diff(column)) for column in columns
        ]
        self.depth_of_axis = float(z.mean())
        self.steps = 1 if all(rise is None for _, rise in self.columns) else _STEPS
        self.offset = None if offset is None else 2 * R * offset
        self.largest = float(R.max())
        self.cut: tuple[int, Callable[[Array], Array]] | None = None

    @classmethod
    def cylinder(cls, axis: BodyAxis, first: float, last: float, diameter: float) -> "Body":
        """A round tape or rod."""
        y = np.linspace(first, last, 64)
        return cls(axis, first, last, y, np.full(64, diameter / 2))

    def _place(self, y: Array) -> tuple[NDArray[np.intp], Array]:
        """Entry of the table below y and the part of the way to the next."""
        place = np.clip((y - self.y0) / self.step, 0, self.columns[0][0].size - 1 - 1e-6)
        i = place.astype(np.intp)
        return i, place - i

    def _at(self, y: Array) -> list[Array]:
        """R^2, its slope, xc, its slope, zc, its slope at y; a scalar where it is the same all over."""
        i, part = self._place(y)
        return [
            column[0] if rise is None else column.take(i) + part * rise.take(i)
            for column, rise in self.columns
        ]

    def _relief(self, offset: Array, right: Flags, y: Array) -> Array:
        """What the yarns add to R^2 on the side of the body where the ray passes."""
        i, part = self._place(y)
        side = right.astype(np.intp)
        return (1 - part) * offset[side, i] + part * offset[side, i + 1]

    def depth(self, a: Array, b: Array) -> Array:
        """Z where the rays (a, b), shape (n,), first meet the body [m]; inf where they miss."""
        y = beside = b * self.depth_of_axis
        under = depth = np.zeros_like(b)
        for step in range(self.steps):
            q, dq, xc, dx, zc, dz = self._at(y)
            if step == self.steps - 1 and self.offset is not None:
                q = q + self._relief(self.offset, a * zc > xc, beside)
            px, sx = a - dx * b, xc - dx * y
            pz, sz = 1 - dz * b, zc - dz * y
            half = px * sx + pz * sz + dq * b / 2
            square = px**2 + pz**2
            under = half**2 - square * (sx**2 + sz**2 - q + dq * y)
            depth = (half - np.sqrt(np.maximum(under, 0))) / square
            y, beside = b * depth, b * half / square  # where it enters, where it is deepest inside
        first, last = self.first, self.last
        if self.cut is not None:
            end, edge = self.cut
            xc, _, zc, _ = self._at(y)[2:]
            shift = edge(np.arctan2(zc - depth, a * depth - xc))
            first, last = (first + shift, last) if end > 0 else (first, last + shift)
        return np.where((under >= 0) & (y >= first) & (y <= last), depth, np.inf)

    def hits(self, a: Array, b: Array, depth: Array) -> Hits:
        """The places and normals of rays (a, b) that meet the body at this depth, shape (n,)."""
        y = b * depth
        _, dq, xc, dx, zc, dz = self._at(y)
        X, Z = a * depth - xc, depth - zc
        normal = np.stack([X, -(dq / 2 + X * dx + Z * dz), Z], axis=1)
        return Hits(y, np.arctan2(-Z, X), unit_vectors(normal))


class Shoulder:
    """The flat ring between the braid and a thicker fitting: the tape's edge throws it into shade.

    Args:
        axis: the axis.
        y: its position [m].
        inner: radius of the braid [m].
        outer: radius of the tape [m].
    """

    def __init__(self, axis: BodyAxis, y: float, inner: float, outer: float) -> None:
        self.y, self.inner, self.outer = y, inner, outer
        self.first = self.last = y
        self.largest = outer
        x, _, z, _ = axis.at(np.array([y]))
        self.x, self.z = float(x[0]), float(z[0])

    def depth(self, a: Array, b: Array) -> Array:
        """Z where the rays meet it [m]; inf where they miss."""
        with np.errstate(divide="ignore"):
            depth = self.y / b
        r = np.hypot(a * depth - self.x, depth - self.z)
        return np.where((depth > 0) & (r >= self.inner) & (r <= self.outer), depth, np.inf)


def unit_vectors(vectors: Array) -> Array:
    """Vectors of length 1, shape (n, 3)."""
    x, y, z = vectors.T  # a third of the time of `np.linalg.norm`, to the same bit
    return vectors / np.sqrt(x * x + y * y + z * z)[:, None]

"""What stands in front of the cloth as bodies that rays meet: braid, tapes and rods along an axis."""

import colorsys
import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from imaging import Camera
from imaging.camera import Array, turned

from .muscle import INCH, MuscleScene, Tape, Weave

_STEPS = 3


@dataclasses.dataclass(frozen=True)
class BodyAxis:
    """The axis of a muscle: straight but for a half sine wave over the braid's length."""

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
    """Where rays meet a surface."""

    y: Array
    azimuth: Array  # 0 to the right, pi/2 towards the camera
    normal: Array


class Body:
    """A pile of circles along an axis from `first` to `last`: radii R at uniform positions y [m].

    `offset`: how much further out the outline lies on the left and on the right, (2, m). `cut`: the
    end that is uneven, lower (-1) or upper (1), and how much further down it lies at an azimuth.
    """

    def __init__(self, axis: BodyAxis, ends: tuple[float, float], y: Array, R: Array,
                 offset: Array | None = None) -> None:  # fmt: skip
        self.first, self.last = ends
        self.y0, self.step = y[0], y[1] - y[0]
        x, dx, z, dz = axis.at(y)
        square = R**2
        columns = square, np.gradient(square, y), x, dx, z, dz
        self.columns = [(one, None if np.ptp(one) == 0 else np.diff(one)) for one in columns]
        self.depth_of_axis = float(z.mean())
        self.steps = 1 if all(rise is None for _, rise in self.columns) else _STEPS
        self.offset = None if offset is None else 2 * R * offset
        self.largest = float(R.max())
        self.cut: tuple[int, Callable[[Array], Array]] | None = None

    def _place(self, y: Array) -> tuple[NDArray[np.intp], Array]:
        """Entry of the table below y and the part of the way to the next."""
        place = np.clip((y - self.y0) / self.step, 0, self.columns[0][0].size - 1 - 1e-6)
        i = place.astype(np.intp)
        return i, place - i

    def _at(self, y: Array) -> list[Array]:
        """R^2, xc, zc and their slopes at y; a scalar where it is the same all over."""
        i, part = self._place(y)
        return [
            column[0] if rise is None else column.take(i) + part * rise.take(i)
            for column, rise in self.columns
        ]

    def depth(self, a: Array, b: Array) -> Array:
        """Z where the rays (a, b), shape (n,), first meet the body [m]; inf where they miss."""
        y = beside = b * self.depth_of_axis
        under = depth = np.zeros_like(b)
        for step in range(self.steps):
            q, dq, xc, dx, zc, dz = self._at(y)
            if step == self.steps - 1 and self.offset is not None:
                # What the yarns add on the side of the body where the ray passes.
                i, part = self._place(beside)
                side = (a * zc > xc).astype(np.intp)
                q = q + ((1 - part) * self.offset[side, i] + part * self.offset[side, i + 1])
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
        """Of rays (a, b) that meet the body at this depth."""
        y = b * depth
        _, dq, xc, dx, zc, dz = self._at(y)
        X, Z = a * depth - xc, depth - zc
        normal = np.stack([X, -(dq / 2 + X * dx + Z * dz), Z], axis=1)
        return Hits(y, np.arctan2(-Z, X), unit_vectors(normal))


class Shoulder:
    """The flat ring between the braid and a thicker fitting: the tape's edge throws it into shade."""

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


_POINTS = 4097  # of the profile along the braid
_ROD_BEYOND = 1.0  # [m] that a rod reaches beyond the tape: out of every picture
_ROD_DIAMETER = 0.5 * INCH
_ROD = np.full(3, 0.012)  # reflectance


class World:
    """The bodies in front of the cloth."""

    def __init__(self, muscle: MuscleScene, camera: Camera) -> None:
        self.muscle, self.camera = muscle, camera
        y0, depth = _leaned(muscle.y0, camera.distance, muscle.tilt)
        first = y0 - muscle.length / 2
        last = first + muscle.length
        self.axis = BodyAxis(muscle.x0, depth, first, muscle.length, muscle.bow, muscle.bow_depth)
        self.y = np.linspace(first, last, _POINTS)
        _, across, _, away = self.axis.at(self.y)
        self.length = float(np.trapezoid(np.sqrt(1 + across**2 + away**2), self.y))
        # The circles lie in planes of one y: square to a bowed axis they are narrower.
        diameter = muscle.diameter((self.y - first) / muscle.length) * np.hypot(1, across)
        self.R = diameter / 2
        self.slope = np.gradient(self.R, self.y)
        self.weave = Weave(muscle, self.y, self.R, self.slope)
        offset = [self.weave.outline_offset(phi, self.R) for phi in self._tangent_azimuths()]
        self.offset = np.stack(offset)
        braid = "braid", self._braid(first, last), np.array(muscle.albedo)
        self.bodies: list[tuple[str, Body | Shoulder, Array]] = [braid]
        self._add_fitting(muscle.upper, first, -1)
        self._add_fitting(muscle.lower, last, 1)
        if muscle.third is not None:
            tape, x = muscle.third
            middle = first + x * muscle.length
            around = np.abs(self.y - middle) <= tape.width / 2
            inside = 2 * float(self.R[around].max()) if around.any() else _ROD_DIAMETER
            diameter = tape.diameter or 1.005 * inside
            self._add_tape(tape, middle - tape.width / 2, middle + tape.width / 2, diameter)

    def _braid(self, first: float, last: float) -> Body:
        """The braid, which goes on under tapes with uneven edges as a cylinder."""
        beyond = max(self._reach(self.muscle.upper, 0), self._reach(self.muscle.lower, -1))
        if beyond == 0:
            return Body(self.axis, (first, last), self.y, self.R, self.offset)
        y = np.linspace(first - beyond, last + beyond, _POINTS)
        R = np.interp(y, self.y, self.R)
        offset = np.stack([np.interp(y, self.y, side) for side in self.offset])
        return Body(self.axis, (first - beyond, last + beyond), y, R, offset)

    def _reach(self, tape: Tape | None, end: int) -> float:
        """How far a tape's edge may lie from its plane [m]."""
        if tape is None or tape.slant == tape.ragged == 0:
            return 0.0
        return float(self.R[end]) * abs(np.tan(tape.slant)) + 4 * tape.ragged

    def _tangent_azimuths(self) -> tuple[Array, Array]:
        """Azimuth of the outline's points on the left and on the right [rad], shape of y each."""
        xc, dx, zc, dz = self.axis.at(self.y)
        across, away = xc - self.y * dx, zc - self.y * dz
        alpha = np.arctan2(across, away)
        psi = np.arcsin((self.R - self.slope * self.y) / np.hypot(across, away))
        return np.pi - psi + alpha, psi + alpha

    def outline(self) -> list[tuple[Array, Array]]:
        """Points (u, v) [px] of the braid's outline in the picture, left and right."""
        xc, _, zc, _ = self.axis.at(self.y)
        sides = []
        for phi, offset, sign in zip(self._tangent_azimuths(), self.offset, (-1, 1), strict=True):
            X = xc + self.R * np.cos(phi) + sign * offset
            x, y, z = self._placed(X, self.y, zc - self.R * np.sin(phi))
            sides.append(self.camera.pixels(x, y, z))
        return sides

    def ring(self, y: float, radius: float) -> Array:
        """The front half of a circle about the axis in the picture, left to right, (k, 2) [px]."""
        xc, _, zc, _ = self.axis.at(np.array([y]))
        psi = np.arcsin(radius / np.hypot(xc[0], zc[0]))
        alpha = np.arctan2(xc[0], zc[0])
        phi = np.linspace(np.pi - psi + alpha, psi + alpha, 361)
        height = np.full(phi.size, y)
        place = self._placed(xc + radius * np.cos(phi), height, zc - radius * np.sin(phi))
        return np.stack(self.camera.pixels(*place), axis=1)

    def _placed(self, X: Array, y: Array, Z: Array) -> tuple[Array, Array, Array]:
        """Points beside the axis in the camera's own directions."""
        Y, Z = _leaned(y, Z, -self.muscle.tilt)
        return *turned(X, Y, self.muscle.roll), Z

    def edge_radius(self, tape: Tape | None, end: int) -> float:
        """Radius of the tape's inner edge at the upper (0) or lower (-1) end of the braid [m]."""
        if tape is None or tape.diameter is None:
            return float(self.R[end])
        return tape.diameter / 2

    def _add_fitting(self, tape: Tape | None, end: float, sign: int) -> None:
        """A tape beyond this end of the braid and the rod beyond the tape."""
        which = 0 if sign < 0 else -1
        braid, outer = float(self.R[which]), self.edge_radius(tape, which)
        beyond = end + sign * (0.5 * braid if tape is None else tape.width)
        if tape is None:
            self._add("rod", end, beyond, 2 * outer, _ROD)
        else:
            self._add_tape(tape, end, beyond, 2 * outer)
            reach = self._reach(tape, which)
            if reach > 0:
                first, last = min(beyond, end), max(beyond, end)
                y = np.linspace(first - reach, last + reach, 512)
                body = Body(self.axis, (first, last), y, 1.002 * np.interp(y, self.y, self.R))
                body.cut = sign, functools.partial(tape.edge, radius=braid)
                self.bodies[-1] = ("tape", body, self.bodies[-1][2])
                outer = braid
        if outer > braid:
            self.bodies.append(("shade", Shoulder(self.axis, end, braid, outer), _ROD))
        self._add("rod", beyond, beyond + sign * _ROD_BEYOND, _ROD_DIAMETER, _ROD)

    def _add_tape(self, tape: Tape, one_end: float, other_end: float, diameter: float) -> None:
        colour = colorsys.hsv_to_rgb(tape.hue % 360 / 360, tape.saturation, tape.value)
        albedo = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
        self._add("tape", one_end, other_end, diameter, np.array(albedo))

    def _add(self, kind: str, one: float, other: float, diameter: float, albedo: Array) -> None:
        ends = min(one, other), max(one, other)
        body = Body(self.axis, ends, np.linspace(*ends, 64), np.full(64, diameter / 2))
        self.bodies.append((kind, body, albedo))

    def span(self, v_first: float, v_last: float) -> tuple[float, float]:
        """Columns [px] within which bodies can be seen in these rows."""
        largest = max(body.largest for _, body, _ in self.bodies if isinstance(body, Body))
        widest = largest + abs(self.muscle.bow)
        half_rows = np.array([v_first, v_last]) - self.camera.centre[1]
        X, Y = self.muscle.x0, half_rows / self.camera.px_per_m
        middle = (X - np.sin(self.muscle.roll) * Y) / np.cos(self.muscle.roll)
        reach = 1.05 * widest / np.cos(self.muscle.roll) + 0.05 * np.abs(middle)
        scale = self.camera.px_per_m
        left = self.camera.centre[0] + scale * np.min(middle - reach)
        right = self.camera.centre[0] + scale * np.max(middle + reach)
        return float(left) - 4, float(right) + 4

    def met(self, u: Array, v: Array) -> tuple[NDArray[np.int8], Array, Array, Array]:
        """What the rays through picture positions u, v [px] meet first.

        The number of the body, -1 for the cloth; the rays X/Z and Y/Z in the axis' own directions;
        and Z where they meet it [m].
        """
        a, b = turned(*self.camera.rays(u, v), -self.muscle.roll)
        b, away = _leaned(b, np.ones_like(b), self.muscle.tilt)
        a, b = a / away, b / away
        nearest = np.full(u.shape, np.inf)
        which = np.full(u.shape, -1, np.int8)
        low, high = b.min() * self.axis.depth, b.max() * self.axis.depth
        for number, (_, body, _) in enumerate(self.bodies):
            margin = 0.1 * max(abs(low), abs(high)) + body.largest
            if body.last <= low - margin or body.first >= high + margin:
                continue
            depth = body.depth(a, b)
            closer = depth < nearest
            nearest[closer] = depth[closer]
            which[closer] = number
        return which, a, b, nearest


def _leaned(y: Any, z: Any, tilt: float) -> tuple[Any, Any]:
    """The directions down and away, turned about the camera by an angle [rad]."""
    c, s = np.cos(tilt), np.sin(tilt)
    return y * c + z * s, z * c - y * s

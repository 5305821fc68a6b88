"""What the camera sees along a ray: bodies, their colours, the light on them."""

import colorsys
import functools
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..arrays import Array
from ..camera.pinhole import Camera, turned
from .bodies import Body, BodyAxis, Hits, Shoulder, unit_vectors
from .muscle import MuscleScene, Tape, Weave
from .scene import Light

_POINTS = 4097  # of the profile along the braid
_ROD_BEYOND = 1.0  # [m] that a rod reaches beyond the tape: out of every picture
_ROD = np.full(3, 0.012)  # reflectance
_GLOSS = {"tape": (0.05, 25.0), "rod": (0.10, 60.0)}  # strength and exponent of the glare
_FIBRE_GLOSS = 0.10


class World:
    """The bodies in front of the cloth.

    Args:
        muscle: the muscle.
        light: the light.
        camera: the camera.
    """

    def __init__(self, muscle: MuscleScene, light: Light, camera: Camera) -> None:
        self.muscle, self.light, self.camera = muscle, light, camera
        y0, depth = _leaned(muscle.y0, camera.distance, muscle.tilt)
        first = y0 - muscle.length / 2
        last = first + muscle.length
        bow = muscle.bow, muscle.bow_depth
        self.axis = BodyAxis(muscle.x0, depth, first, muscle.length, *bow)
        self.y = np.linspace(first, last, _POINTS)
        _, across, _, away = self.axis.at(self.y)
        self.length = float(np.trapezoid(np.sqrt(1 + across**2 + away**2), self.y))
        # The circles lie in planes of one y: square to a bowed axis they are narrower.
        diameter = muscle.diameter((self.y - first) / muscle.length) * np.hypot(1, across)
        self.R = diameter / 2
        self.slope = np.gradient(self.R, self.y)
        self.weave = Weave(muscle, self.y, self.R, self.slope)
        self.offset = np.stack(
            [self.weave.outline_offset(phi, self.R) for phi in self._tangent_azimuths()]
        )
        braid = self._braid(first, last)
        self.bodies: list[tuple[str, Body | Shoulder, Array]] = [
            ("braid", braid, np.array(muscle.albedo))
        ]
        self._add_fitting(muscle.upper, first, -1)
        self._add_fitting(muscle.lower, last, 1)
        if muscle.third is not None:
            tape, x = muscle.third
            middle = first + x * muscle.length
            around = np.abs(self.y - middle) <= tape.width / 2
            inside = 2 * float(self.R[around].max()) if around.any() else muscle.rod_diameter
            diameter = tape.diameter or 1.005 * inside
            self._add_tape(tape, middle - tape.width / 2, middle + tape.width / 2, diameter)

    def _braid(self, first: float, last: float) -> Body:
        """The braid, which goes on under tapes with uneven edges as a cylinder."""
        beyond = max(self._reach(tape, end) for tape, end in self._tapes())
        if beyond == 0:
            return Body(self.axis, first, last, self.y, self.R, self.offset)
        y = np.linspace(first - beyond, last + beyond, _POINTS)
        R = np.interp(y, self.y, self.R)
        offset = np.stack([np.interp(y, self.y, side) for side in self.offset])
        return Body(self.axis, first - beyond, last + beyond, y, R, offset)

    def _tapes(self) -> tuple[tuple[Tape | None, int], ...]:
        return (self.muscle.upper, 0), (self.muscle.lower, -1)

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
        braid = float(self.R[0 if sign < 0 else -1])
        outer = self.edge_radius(tape, 0 if sign < 0 else -1)
        beyond = end + sign * (0.5 * braid if tape is None else tape.width)
        reach = self._reach(tape, 0 if sign < 0 else -1)
        if tape is not None and reach > 0:
            self._add_tape(tape, end, beyond, 2 * outer)
            first, last = min(beyond, end), max(beyond, end)
            y = np.linspace(first - reach, last + reach, 512)
            body = Body(self.axis, first, last, y, 1.002 * np.interp(y, self.y, self.R))
            body.cut = sign, functools.partial(tape.edge, radius=braid)
            self.bodies[-1] = ("tape", body, self.bodies[-1][2])
            outer = braid
        elif tape is not None:
            self._add_tape(tape, end, beyond, 2 * outer)
        else:
            self._add("rod", end, beyond, 2 * outer, _ROD)
        if outer > braid:
            self.bodies.append(("shade", Shoulder(self.axis, end, braid, outer), _ROD))
        self._add("rod", beyond, beyond + sign * _ROD_BEYOND, self.muscle.rod_diameter, _ROD)

    def _add_tape(self, tape: Tape, one_end: float, other_end: float, diameter: float) -> None:
        colour = colorsys.hsv_to_rgb(tape.hue % 360 / 360, tape.saturation, tape.value)
        albedo = np.array(
            [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in colour]
        )
        self._add("tape", one_end, other_end, diameter, albedo)

    def _add(
        self, kind: str, one_end: float, other_end: float, diameter: float, albedo: Array
    ) -> None:
        first, last = min(one_end, other_end), max(one_end, other_end)
        self.bodies.append((kind, Body.cylinder(self.axis, first, last, diameter), albedo))

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

    def seen(self, u: Array, v: Array) -> tuple[NDArray[np.int8], Array]:
        """What is seen at picture positions u, v [px], shape (n,).

        Returns:
            which: number of the body, -1 for the cloth, shape (n,).
            light: linear RGB that the bodies send, zero for the cloth, shape (n, 3).
        """
        a, b = turned(*self.camera.rays(u, v), -self.muscle.roll)
        b, away = _leaned(b, np.ones_like(b), self.muscle.tilt)
        a, b = a / away, b / away
        nearest = np.full(u.shape, np.inf)
        which = np.full(u.shape, -1, np.int8)
        low, high = b.min() * self.axis.depth, b.max() * self.axis.depth
        for number, (_, body, _) in enumerate(self.bodies):
            if not self._in_sight(body, low, high):
                continue
            depth = body.depth(a, b)
            closer = depth < nearest
            nearest[closer] = depth[closer]
            which[closer] = number
        light = np.zeros((u.size, 3))
        for number, (kind, body, albedo) in enumerate(self.bodies):
            at = np.flatnonzero(which == number)
            if at.size == 0:
                continue
            if isinstance(body, Shoulder):
                light[at] = self.light.ambient * albedo
                continue
            hits = body.hits(a[at], b[at], nearest[at])
            sight = unit_vectors(-np.stack([a[at], b[at], np.ones(at.size)], axis=1))
            light[at] = self._on_braid(hits, sight) if kind == "braid" else self._glossy(
                hits, sight, albedo, *_GLOSS[kind])  # fmt: skip
        return which, light

    def _in_sight(self, body: Body | Shoulder, low: float, high: float) -> bool:
        margin = 0.1 * max(abs(low), abs(high)) + body.largest
        return body.last > low - margin and body.first < high + margin

    def _on_braid(self, hits: Hits, sight: Array) -> Array:
        """Light of the woven surface, (n, 3)."""
        at = self.weave.crossings(hits.azimuth, hits.y)
        lean, fibre = self.weave.directions(at, hits.azimuth, hits.y)
        lit = self.light.on_threads(unit_vectors(hits.normal + lean), sight)
        for lamp in self.light.lamps:
            skew = np.einsum("ij,ij->i", fibre, unit_vectors(sight + lamp.towards))
            lit += _FIBRE_GLOSS * lamp.irradiance(hits.normal) * np.clip(1 - skew**2, 0, 1) ** 12
        facing = np.clip(np.einsum("ij,ij->i", hits.normal, sight), 0, 1)
        lit += self.muscle.sheen * (1 - facing) ** self.muscle.sheen_power
        return (lit * self.weave.reflectance(at))[:, None] * np.array(self.muscle.albedo)

    def _glossy(
        self, hits: Hits, sight: Array, albedo: Array, gloss: float, exponent: float
    ) -> Array:
        """Light of a smooth coloured surface with glare (Blinn and Phong), (n, 3)."""
        diffuse = np.full(hits.y.shape, self.light.ambient)
        glare = np.zeros(hits.y.shape)
        for lamp in self.light.lamps:
            diffuse += lamp.irradiance(hits.normal)
            half = unit_vectors(sight + lamp.towards)
            shine = np.clip(np.einsum("ij,ij->i", hits.normal, half), 0, 1)
            glare += lamp.strength * gloss * shine**exponent
        return diffuse[:, None] * albedo + glare[:, None]


def _leaned(y: Any, z: Any, tilt: float) -> tuple[Any, Any]:
    """The directions down and away, turned about the camera by an angle [rad]."""
    c, s = np.cos(tilt), np.sin(tilt)
    return y * c + z * s, z * c - y * s

"""Photographs of a ruler: engraved marks on a strip that may be tilted, turned or misplaced."""

import dataclasses
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from imaging.camera import Array, Flags

from .muscle import INCH
from .scene import PUBLISHED_CROP, Setting, published_camera
from .truth import RulerTruth


@dataclasses.dataclass(frozen=True)
class RulerScene(Setting):
    """A ruler in the muscle's place, upright, its marks along one or both edges; SI."""

    pitch: float = 0.125 * INCH
    marks: int = 89
    margin: float = 0.25 * INCH  # from the first and the last mark to the strip's ends
    tilt_deg: float = 0.0  # in depth, the lower end away from the camera
    offset: float = 0.0  # of its middle behind the mid-plane
    rotation_deg: float = 0.0  # in the picture, clockwise
    x0: float = 0.0  # its middle to the right of the optical axis
    y0: float = 0.0
    width: float = 1.0 * INCH
    mark_width: float = 0.008 * INCH
    # At every pitch, at a quarter and half of the way from number to number, at the numbers.
    mark_lengths: tuple[float, ...] = (0.16 * INCH, 0.22 * INCH, 0.28 * INCH, 0.36 * INCH)
    print_error: float = 0.0  # standard deviation of the marks' places
    print_seed: int = 0
    edge: Literal["left", "right", "both"] = "left"  # from which the marks start
    other_pitch: float | None = None  # of the right edge's marks, where both have some
    worn: float = 0.0  # part of the marks that cannot be seen any more
    numbers: bool = True  # printed beside every `per_number`-th mark
    per_number: int = 8
    face: tuple[float, float, float] = (0.62, 0.62, 0.60)  # steel, linear RGB
    ink: tuple[float, float, float] = (0.03, 0.03, 0.03)


def published_ruler(*, size: tuple[int, int] = PUBLISHED_CROP) -> RulerScene:
    """An 11 in steel ruler in 1/8 in, as the reference work's camera saw it."""
    return RulerScene(published_camera(size), size)


_NUMBERS_PER_M = 12000  # px of the raster that holds the printed numbers
_GRAIN = 0.05


@dataclasses.dataclass(frozen=True)
class _Row:
    """The marks along one edge, left (-1) or right (1): places and lengths [m], 0 where worn."""

    side: int
    pitch: float
    places: Array
    lengths: Array
    visible: Array

    def covers(self, s: Array, inward: Array, width: float) -> Flags:
        nearest = np.rint((s - self.places[0]) / self.pitch).astype(np.intp)
        k = np.clip(nearest, 0, self.places.size - 1)
        return (inward < self.visible[k]) & (np.abs(s - self.places[k]) <= width / 2)


class Ruler:
    """A strip in space: what is seen of it along a ray."""

    def __init__(self, scene: RulerScene) -> None:
        self.scene = scene
        turn, tilt = np.deg2rad(scene.rotation_deg), np.deg2rad(scene.tilt_deg)
        lean = np.array(
            [[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]]
        )
        self.along = lean @ np.array([-np.sin(turn), np.cos(turn), 0])
        self.across = lean @ np.array([np.cos(turn), np.sin(turn), 0])
        self.facing = np.cross(self.along, self.across)  # towards the camera
        self.half = (scene.marks - 1) / 2 * scene.pitch + scene.margin
        self.middle = np.array([scene.x0, scene.y0, scene.camera.distance + scene.offset])
        random = np.random.default_rng(scene.print_seed)
        sides = {"left": [-1], "right": [1], "both": [-1, 1]}[scene.edge]
        self.rows = [self._row_of_marks(side, random) for side in sides]
        self.numbers = self._printed_numbers()

    def _row_of_marks(self, side: int, random: np.random.Generator) -> _Row:
        scene = self.scene
        other = scene.other_pitch if side > 0 and scene.edge == "both" else None
        pitch = other or scene.pitch
        n = int((scene.marks - 1) * scene.pitch / pitch + 1e-9) + 1
        first = -(scene.marks - 1) / 2 * scene.pitch
        places = first + np.arange(n) * pitch + scene.print_error * random.standard_normal(n)
        level = np.zeros(n, int)
        for longer, part in enumerate((4, 2, 1), start=1):
            if scene.per_number % part == 0:
                level[:: scene.per_number // part] = longer
        lengths = np.array(scene.mark_lengths)[level]
        visible = np.where(random.random(n) < scene.worn, 0.0, lengths)
        return _Row(side, pitch, places, lengths, visible)

    def _printed_numbers(self) -> Array:
        """A raster of the strip's face, 1 where a number is printed."""
        scene = self.scene
        shape = np.array([2 * self.half, scene.width]) * _NUMBERS_PER_M
        rows, columns = np.ceil(shape).astype(int)
        raster = np.zeros((rows, columns), np.uint8)
        size = 0.4 * scene.width * _NUMBERS_PER_M / 22  # Hershey's digits are 22 px high
        column = 0.22 if scene.edge == "right" else 0.45
        for k in range(0, scene.marks if scene.numbers else 0, scene.per_number):
            row = (self.rows[0].places[k] + self.half) * _NUMBERS_PER_M
            place, thick = (int(column * columns), int(row + 9 * size)), max(1, int(2 * size))
            cv2.putText(raster, str(k // scene.per_number), place, 0, 0.8 * size, 255, thick)
        return np.asarray(cv2.GaussianBlur(raster, (0, 0), 1.5), float) / 255

    def span(self, v_first: float, v_last: float) -> tuple[float, float]:
        """Columns [px] within which the strip can be seen in these rows."""
        ends = np.array([-1, 1]) * self.half
        edges = np.array([-1, 1]) * self.scene.width / 2
        corners = np.array([self._picture(s, w) for s in ends for w in edges])
        if v_last < corners[:, 1].min() - 4 or v_first > corners[:, 1].max() + 4:
            return 0.0, 0.0
        return float(corners[:, 0].min()) - 4, float(corners[:, 0].max()) + 4

    def _picture(self, s: Array | float, w: Array | float) -> Array:
        """Picture positions (u, v) [px] of places along and across the strip [m]."""
        s, w = np.asarray(s, float)[..., None], np.asarray(w, float)[..., None]
        X, Y, Z = np.moveaxis(self.middle + s * self.along + w * self.across, -1, 0)
        return np.stack(self.scene.camera.pixels(X, Y, Z), axis=-1)

    def seen(self, u: Array, v: Array) -> tuple[NDArray[np.int8], Array]:
        """As `LitWorld.seen`: 0 is the strip, 1 a mark or next to it, 2 a number, -1 the cloth."""
        scene = self.scene
        a, b = scene.camera.rays(u, v)
        ray = np.stack([a, b, np.ones(a.size)], axis=1)
        place = ray * (self.middle @ self.facing / (ray @ self.facing))[:, None] - self.middle
        s, w = place @ self.along, place @ self.across
        on = (np.abs(s) <= self.half) & (np.abs(w) <= scene.width / 2)
        mark, near = np.zeros(s.shape, bool), np.zeros(s.shape, bool)
        seen_width = max(scene.mark_width, 1.2 / scene.camera.px_per_m)
        for row in self.rows:
            inward = scene.width / 2 - row.side * w
            mark |= row.covers(s, inward, scene.mark_width)
            near |= row.covers(s, inward, seen_width)
        rows, columns = self.numbers.shape
        i = np.rint((s + self.half) * _NUMBERS_PER_M).astype(np.intp)
        j = np.rint((w + scene.width / 2) * _NUMBERS_PER_M).astype(np.intp)
        print_ = self.numbers[np.clip(i, 0, rows - 1), np.clip(j, 0, columns - 1)]
        ink = np.where(mark, 1.0, print_)[:, None]
        which = np.where(near, 1, np.where(print_ > 0.5, 2, 0))
        albedo = (1 - ink) * np.array(scene.face) + ink * np.array(scene.ink)
        grain = 1 + _GRAIN * np.sin(2900 * w + 3 * np.sin(40 * s)) * np.sin(1100 * w)
        facing, lamps = self.facing[None, :], scene.light.lamps
        lit = scene.light.ambient + sum(lamp.irradiance(facing)[0] for lamp in lamps)
        light = lit * grain[:, None] * albedo
        light[~on] = 0
        return np.where(on, which, -1).astype(np.int8), light

    def truth(self) -> RulerTruth:
        row = self.rows[0]
        w = row.side * (self.scene.width - row.lengths) / 2
        marks = self._picture(row.places, w)
        ends = self._picture(row.places[[0, -1]], np.full(2, w.mean()))
        line = np.linalg.norm(ends[1] - ends[0]) / np.ptp(row.places[[0, -1]])
        return RulerTruth(self.scene.camera.px_per_m, float(line), marks, self.scene.tilt_deg)

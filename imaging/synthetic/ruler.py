"""Photographs of a ruler: engraved marks on a strip that may be tilted, turned or misplaced."""

import dataclasses
import datetime
from typing import Literal

from ..camera.pinhole import Camera
from .light import Light
from .muscle import INCH
from .scene import (
    PUBLISHED_CROP,
    PUBLISHED_DISTANCE,
    PUBLISHED_PX_PER_IN,
    Jpeg,
    Lens,
    Sensor,
)

STEEL = (0.62, 0.62, 0.60)
WOOD = (0.62, 0.40, 0.17)
INK = (0.03, 0.03, 0.03)


@dataclasses.dataclass(frozen=True)
class RulerScene:
    """A ruler in the muscle's place, upright, its marks along one or both edges.

    Attributes:
        camera: the camera.
        size: rows and columns of the picture.
        pitch: from mark to mark [m].
        marks: their number.
        margin: from the first and the last mark to the strip's ends [m].
        tilt_deg: turn in depth [deg], the lower end away from the camera.
        offset: how far its middle lies behind the mid-plane [m].
        rotation_deg: turn in the picture [deg], clockwise.
        x0: its middle to the right of the optical axis [m]; `y0` below it.
        width: of the strip [m].
        mark_width: width of a mark [m].
        mark_lengths: lengths of the marks at every pitch, every 2nd, 4th and 8th [m].
        print_error: standard deviation of the marks' places [m], drawn by `print_seed`.
        edge: which edge the marks start from, "left", "right" or "both".
        other_pitch: pitch of the right edge's marks where `edge` is "both", such as a millimetre
            beside an eighth of an inch [m]; None takes `pitch`.
        worn: part of the marks that cannot be seen any more [-], drawn by `print_seed`.
        numbers: every 8th mark has a number printed beside it.
        face, ink: reflectance of the strip and of its marks, linear RGB.
        light, lens, sensor, jpeg, time, lying: as in `Scene`.
    """

    camera: Camera
    size: tuple[int, int]
    pitch: float = 0.125 * INCH
    marks: int = 89
    margin: float = 0.25 * INCH
    tilt_deg: float = 0.0
    offset: float = 0.0
    rotation_deg: float = 0.0
    x0: float = 0.0
    y0: float = 0.0
    width: float = 1.0 * INCH
    mark_width: float = 0.008 * INCH
    mark_lengths: tuple[float, float, float, float] = (
        0.16 * INCH, 0.22 * INCH, 0.28 * INCH, 0.36 * INCH,
    )  # fmt: skip
    print_error: float = 0.0
    print_seed: int = 0
    edge: Literal["left", "right", "both"] = "left"
    other_pitch: float | None = None
    worn: float = 0.0
    numbers: bool = True
    face: tuple[float, float, float] = STEEL
    ink: tuple[float, float, float] = INK
    light: Light = dataclasses.field(default_factory=Light.side)
    lens: Lens = dataclasses.field(default_factory=Lens)
    sensor: Sensor = dataclasses.field(default_factory=Sensor)
    jpeg: Jpeg | None = dataclasses.field(default_factory=Jpeg)
    time: datetime.datetime | None = None
    lying: bool = False

    def __post_init__(self) -> None:
        if not (self.pitch > 0 and self.marks >= 2 and self.edge in {"left", "right", "both"}):
            raise ValueError(
                "a ruler has a pitch > 0, at least 2 marks and its marks at the edge 'left', "
                f"'right' or 'both'; got pitch = {self.pitch} m, marks = {self.marks}, "
                f"edge = {self.edge!r}"
            )


def published_ruler(*, size: tuple[int, int] = PUBLISHED_CROP) -> RulerScene:
    """An 11 in steel ruler in 1/8 in, as the reference work's camera saw it (`published_scene`)."""
    px_per_in = PUBLISHED_PX_PER_IN * size[0] / PUBLISHED_CROP[0]
    centre = ((size[1] - 1) / 2, (size[0] - 1) / 2)
    return RulerScene(Camera(px_per_in / INCH, PUBLISHED_DISTANCE, centre), size)

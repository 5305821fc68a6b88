"""Scenes drawn at random: for the errors' own estimates, and against tuning to one set-up."""

import dataclasses

import numpy as np

from ..camera.pinhole import Camera
from .muscle import INCH, REST_LENGTH, TAN, MuscleScene, Tape, stroke_shape
from .scene import Lamp, Lens, Light, Scene, Sensor

_WHITE_THREAD = (0.75, 0.75, 0.72)
_HUES = (222.0, 130.0, 355.0)  # blue, green, red across the seam of the circle
_ROOM = 0.35 * INCH  # of cloth beside the muscle and beyond the tapes


def random_scene(
    seed: int, *, px_per_in: tuple[float, float] = (100.0, 400.0), length: float = REST_LENGTH
) -> Scene:
    """A scene drawn from what a laboratory may set up: no two alike, all of them measurable.

    Distance 30 to 100 in, contraction 0 to 0.35, up to 3 in beside the optical axis and 2 in along
    it, rolled by up to 3 degrees; lamps on either side, stronger on one, cloth more or less black;
    tan, white or black-flecked threads; blue, green or red tape, as thick as the braid's end or up
    to 0.1 in thicker; ISO 800 to 6400, a lens of 0.7 to 1.3 px, mosaic or not. The crop has its
    own place in the frame: the optical axis is not in its middle.

    Args:
        seed: of everything.
        px_per_in: range of the scale; small figures make small pictures.
        length: of the muscle at rest [m].
    """
    random = np.random.default_rng(seed)
    scale = random.uniform(*px_per_in) / INCH
    contraction = random.uniform(0, 0.35)
    shape = stroke_shape(contraction)
    muscle = MuscleScene(
        shape,
        length * (1 - contraction),
        x0=random.uniform(-3, 3) * INCH,
        y0=random.uniform(-2, 2) * INCH,
        roll=np.deg2rad(random.uniform(-3, 3)),
        strands=int(np.clip(4 * round(9 * scale * INCH / 226), 8, 36)),
        albedo=TAN if random.random() < 0.6 else _WHITE_THREAD,
        flecks=random.choice([0.0, 0.05]),
        weave_seed=int(random.integers(1 << 30)),
    )
    hue = float(random.choice(_HUES) + random.uniform(-6, 6)) % 360
    thicker = random.uniform(0, 0.1) * INCH if random.random() < 0.5 else 0.0
    tape = Tape(hue=hue, diameter=float(shape(0.0)) + thicker)
    muscle = dataclasses.replace(muscle, upper=tape, lower=tape)
    distance = random.uniform(30, 100) * INCH
    size, centre = _crop(muscle, scale, random)
    return Scene(
        Camera(scale, distance, centre),
        size,
        muscle,
        light=_light(random),
        lens=Lens(blur_px=random.uniform(0.7, 1.3)),
        sensor=Sensor(
            full_well=float(random.choice([7600.0, 3800.0, 1900.0, 950.0])),
            bayer=bool(random.random() < 0.3),
        ),
    )


def _crop(
    muscle: MuscleScene, scale: float, random: np.random.Generator
) -> tuple[tuple[int, int], tuple[float, float]]:
    """Size of a picture that holds the muscle, and the optical axis in it."""
    cos, sin = np.cos(muscle.roll), np.sin(muscle.roll)
    widest = float(muscle.diameter(np.linspace(0, 1, 101)).max())
    tape = muscle.upper.width if muscle.upper else 0.0
    reach = muscle.length + 2 * tape + 2 * _ROOM
    height = 1.04 * reach * cos + widest * abs(sin)  # nearer parts look larger
    width = 1.1 * widest + muscle.length * abs(sin) + 4 * _ROOM
    across = cos * muscle.x0 - sin * muscle.y0
    along = sin * muscle.x0 + cos * muscle.y0
    size = round(height * scale), round(width * scale)
    aside = random.uniform(-0.3, 0.3, 2) * _ROOM
    u = (size[1] - 1) / 2 - scale * (across + aside[0])
    v = (size[0] - 1) / 2 - scale * (along + aside[1])
    return size, (float(u), float(v))


def _light(random: np.random.Generator) -> Light:
    """Two lamps, one on each side."""
    lamps = []
    for side in (-1, 1):
        angle = np.deg2rad(random.uniform(40, 70))
        direction = (side * np.sin(angle), random.uniform(-0.4, 0.1), -np.cos(angle))
        lamps.append(Lamp(direction, random.uniform(0.5, 0.9), random.uniform(0.1, 0.4)))
    return Light(
        tuple(lamps),
        ambient=random.uniform(0.05, 0.2),
        reflectance=random.choice(["lambert", "oren-nayar", "sqrt"]),
        cloth=random.uniform(0.003, 0.012),
        cloth_gradient=random.uniform(-0.8, 0.8),
        stray=random.uniform(0, 0.015),
        stray_place=(random.choice([0.1, 0.9]), random.uniform(0.2, 0.8)),
    )

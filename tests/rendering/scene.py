"""A whole photograph before it is taken: light, lens, sensor and file; as published, or drawn at random."""

import dataclasses
import datetime
import functools
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from imaging import Camera, Tone
from imaging.camera import Array

from .muscle import (
    INCH,
    PUBLISHED_CONTRACTIONS,
    REST_LENGTH,
    TAN,
    MuscleScene,
    Tape,
    published_shape,
    stroke_shape,
)


@dataclasses.dataclass(frozen=True)
class Lamp:
    """A soft lamp far away."""

    direction: tuple[float, float, float]  # to it (X right, Y down, Z away from the camera)
    strength: float  # light on a white surface that faces it, 1 is the picture's white
    softness: float = 0.25  # sine of the angle over which it fades at the terminator

    @functools.cached_property
    def towards(self) -> Array:
        """Unit vector to the lamp, shape (3,)."""
        return np.array(self.direction) / np.linalg.norm(self.direction)

    def irradiance(self, normal: Array) -> Array:
        """Light on surfaces with these normals, shape (n, 3) -> (n,)."""
        x, w = normal @ self.towards, self.softness
        return self.strength * np.where(x > w, x, np.clip(x + w, 0, None) ** 2 / (4 * w))


@dataclasses.dataclass(frozen=True)
class Light:
    """Lamps, ambient light and what the cloth makes of them."""

    lamps: tuple[Lamp, ...]
    ambient: float = 0.10
    reflectance: Literal["lambert", "oren-nayar", "sqrt"] = "oren-nayar"
    cloth: float = 0.006  # light of the cloth
    cloth_gradient: float = 0.5  # its relative change from left to right
    other_cloth: float | None = None  # light of another cloth, beyond the border
    border: float = 0.5  # part of the picture's width, or of its height
    border_down: bool = False
    colour: tuple[float, float, float] = (1.0, 1.0, 1.0)  # of all light, linear RGB
    stray: float = 0.012  # an out-of-focus reflection on the cloth
    stray_place: tuple[float, float] = (0.12, 0.75)  # parts of width and height

    @classmethod
    def side(cls) -> "Light":
        """Two soft lamps, 60 degrees to the left and 55 to the right: bright limbs, as advised."""
        return cls((Lamp((-0.87, -0.10, -0.50), 0.85), Lamp((0.82, -0.15, -0.57), 0.70)))

    @classmethod
    def frontal(cls) -> "Light":
        """Two lamps beside the camera: the limb a quarter as bright as the middle."""
        return cls((Lamp((-0.2, -0.1, -0.97), 0.5), Lamp((0.2, -0.1, -0.97), 0.5)), ambient=0.28)

    @classmethod
    def harsh(cls) -> "Light":
        """One hard lamp at the camera: the limb at 8 percent, where thresholds fail."""
        return cls((Lamp((0.0, -0.05, -1.0), 1.0, 0.02),), ambient=0.08)


Size = tuple[int, int]
PUBLISHED_PX_PER_IN = 226.63
PUBLISHED_DISTANCE = 60 * INCH
PUBLISHED_CROP = (2650, 1100)
PUBLISHED_FRAME = (3712, 5568)
_STRANDS = 36


@dataclasses.dataclass(frozen=True)
class Lens:
    """What the lens does to the picture, in linear light."""

    blur_px: float = 0.9  # standard deviation of the Gaussian point spread
    defocus_px: float = 0.0  # radius of the disk of a defocused lens
    halo: float = 0.0  # part of the light that is spread over a Gaussian of `halo_px`
    halo_px: float = 6.0
    motion_px: float = 0.0  # way of the muscle during the exposure
    motion_deg: float = 0.0  # its direction, from the picture's vertical to the right


@dataclasses.dataclass(frozen=True)
class CameraSensor:
    """What sensor and camera program make of the light."""

    full_well: float = 1900.0  # electrons of a white pixel, as at ISO 3200
    read_noise: float = 3.0  # electrons
    exposure: float = 1.0  # factor on the light
    bayer: bool = False  # one colour per pixel (RGGB), the others interpolated
    sharpening: float = 0.0  # amount of an unsharp mask of 1 px on the encoded picture
    s_curve: float = 0.0  # s of a picture style, e + s e (1 - e) (2 e - 1), -2 to 1
    gamma: float = 1.0  # exponent on the encoded values
    denoising: float = 0.0  # range of a bilateral filter before the sharpening

    def encoded(self, light: NDArray[np.floating]) -> Array:
        """Encoded value in [0, 1] of linear light."""
        light = np.clip(np.asarray(light, float), 0, 1)
        e = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
        e = np.clip(e, 0, 1) ** self.gamma
        return e + self.s_curve * e * (1 - e) * (2 * e - 1)

    def tone(self) -> Tone:
        """The tone curve that undoes `encoded`: what a perfect calibration would find."""
        light = np.linspace(0, 1, 1 << 16)
        return Tone(np.interp(np.arange(256) / 255, self.encoded(light), light))


@dataclasses.dataclass(frozen=True)
class Jpeg:
    """The file: quality 1 to 100, chroma subsampling "444", "422" or "420"."""

    quality: int = 92
    subsampling: Literal["444", "422", "420"] = "422"


@dataclasses.dataclass(frozen=True)
class Setting:
    """Everything that a photograph depends on, but for what it shows and the noise's seed."""

    camera: Camera
    size: tuple[int, int]  # rows and columns
    _: dataclasses.KW_ONLY
    light: Light = dataclasses.field(default_factory=Light.side)
    lens: Lens = dataclasses.field(default_factory=Lens)
    sensor: CameraSensor = dataclasses.field(default_factory=CameraSensor)
    jpeg: Jpeg | None = dataclasses.field(default_factory=Jpeg)  # None: as it left the sensor
    time: datetime.datetime | None = None  # local, of the time stamp
    lying: bool = False  # across the picture, upper end to the left; the truth stays upright


@dataclasses.dataclass(frozen=True)
class Scene(Setting):
    """A muscle before it is photographed; None leaves the cloth alone."""

    muscle: MuscleScene | None


def published_camera(size: tuple[int, int]) -> Camera:
    """The reference work's: 60 in away; a crop of another height takes fewer px per inch."""
    px_per_in = PUBLISHED_PX_PER_IN * (size[0] / PUBLISHED_CROP[0])
    centre = ((size[1] - 1) / 2, (size[0] - 1) / 2)
    return Camera(px_per_in / INCH, PUBLISHED_DISTANCE, centre)


def published_scene(
    contraction: float = 0.2625, *, size: Size = PUBLISHED_CROP, rest_length: float = REST_LENGTH
) -> Scene:
    """The reference work's muscle at 100 psi, as its camera saw it; strands as thick in px at any size.

    Between the published contractions the profile is that of `stroke_shape`, with tapes of 0.875 in.
    """
    camera = published_camera(size)
    profile, tape = stroke_shape(contraction), Tape(diameter=0.875 * INCH)
    if contraction in PUBLISHED_CONTRACTIONS:
        profile, tape = published_shape(contraction), Tape()
    strands = max(8, 4 * round(_STRANDS * camera.px_per_m * INCH / PUBLISHED_PX_PER_IN / 4))
    length = rest_length * (1 - contraction)
    muscle = MuscleScene(profile, length, strands=strands, upper=tape, lower=tape)
    return Scene(camera, size, muscle)


_WHITE_THREAD = (0.75, 0.75, 0.72)
_HUES = (222.0, 130.0, 355.0)  # blue, green, red across the seam of the circle
_ROOM = 0.35 * INCH  # of cloth beside the muscle and beyond the tapes


def random_scene(
    seed: int, *, px_per_in: tuple[float, float] = (100.0, 400.0), length: float = REST_LENGTH
) -> Scene:
    """A scene drawn from what a laboratory may set up, measurable; px_per_in is the scale's range.

    The crop has its own place in the frame: the optical axis is not in its middle.
    """
    random = np.random.default_rng(seed)
    scale = random.uniform(*px_per_in) / INCH
    contraction = random.uniform(0, 0.35)
    shape = stroke_shape(contraction)
    muscle = MuscleScene(
        shape, length * (1 - contraction),
        x0=random.uniform(-3, 3) * INCH, y0=random.uniform(-2, 2) * INCH,
        roll=np.deg2rad(random.uniform(-3, 3)),
        strands=int(np.clip(4 * round(9 * scale * INCH / 226), 8, 36)),
        albedo=TAN if random.random() < 0.6 else _WHITE_THREAD,
        flecks=random.choice([0.0, 0.05]),
        weave_seed=int(random.integers(1 << 30)),
    )  # fmt: skip
    hue = float(random.choice(_HUES) + random.uniform(-6, 6)) % 360
    thicker = random.uniform(0, 0.1) * INCH if random.random() < 0.5 else 0.0
    tape = Tape(hue=hue, diameter=float(shape(0.0)) + thicker)
    muscle = dataclasses.replace(muscle, upper=tape, lower=tape)
    distance = random.uniform(30, 100) * INCH
    size, centre = _crop(muscle, scale, random)
    light, lens = _light(random), Lens(blur_px=random.uniform(0.7, 1.3))
    full_well = float(random.choice([7600.0, 3800.0, 1900.0, 950.0]))
    sensor = CameraSensor(full_well, bayer=bool(random.random() < 0.3))
    camera = Camera(scale, distance, centre)
    return Scene(camera, size, muscle, light=light, lens=lens, sensor=sensor)


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
    ambient, reflectance = random.uniform(0.05, 0.2), ["lambert", "oren-nayar", "sqrt"]
    return Light(
        tuple(lamps), ambient, random.choice(reflectance),
        cloth=random.uniform(0.003, 0.012), cloth_gradient=random.uniform(-0.8, 0.8),
        stray=random.uniform(0, 0.015),
        stray_place=(random.choice([0.1, 0.9]), random.uniform(0.2, 0.8)),
    )  # fmt: skip

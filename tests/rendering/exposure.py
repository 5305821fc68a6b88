"""From the light before the lens to the file: blur, noise, colour filter, tone curve, sharpening, JPEG."""

import dataclasses
import datetime
import struct
from os import PathLike
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from imaging.camera import Image

from .scene import CameraSensor, Jpeg, Lens, Setting

Floats = NDArray[np.floating]


def encode_jpeg(rgb: Image, jpeg: Jpeg) -> bytes:
    factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{jpeg.subsampling}")
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg.quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor]
    return cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)[1].tobytes()


def stamped(data: bytes, time: datetime.datetime) -> bytes:
    """The file with an EXIF block that holds DateTimeOriginal and SubSecTimeOriginal."""
    exif = PIL.Image.Exif()
    camera = exif.get_ifd(0x8769)
    camera[0x9003] = time.strftime("%Y:%m:%d %H:%M:%S")
    camera[0x9291] = f"{time.microsecond // 1000:03d}"
    block = exif.tobytes()
    return data[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + data[2:]


def through_lens(light: Floats, lens: Lens) -> Floats:
    """Light behind the lens: each of its faults a convolution."""
    seen = np.asarray(light, np.float32)
    if lens.motion_px > 0:
        seen = cv2.filter2D(seen, -1, _way(lens.motion_px, np.deg2rad(lens.motion_deg)))
    if lens.defocus_px > 0:
        seen = cv2.filter2D(seen, -1, _disk(lens.defocus_px))
    if lens.blur_px > 0:
        seen = cv2.GaussianBlur(seen, (0, 0), lens.blur_px)
    if lens.halo > 0:
        glow = cv2.GaussianBlur(seen, (0, 0), lens.halo_px)
        seen = (1 - lens.halo) * seen + lens.halo * glow
    return np.asarray(seen, np.float32)


def _way(length: float, angle: float) -> Floats:
    """A straight way [px] at an angle [rad] to the vertical, by the part of it that each pixel has."""
    reach = int(np.ceil(length / 2)) + 1
    at = ((np.arange(512 * reach) + 0.5) / (512 * reach) - 0.5) * length
    part = np.zeros((2 * reach + 1, 2 * reach + 1))
    u, v = (np.rint(reach + at * turn).astype(int) for turn in (np.sin(angle), np.cos(angle)))
    np.add.at(part, (v, u), 1.0)
    return (part / part.sum()).astype(np.float32)


def _disk(radius: float) -> Floats:
    """A disk of any radius [px], sampled by the part of each pixel that it covers."""
    reach = int(np.ceil(radius + 0.5))
    fine = (np.arange(16 * (2 * reach + 1)) + 0.5) / 16 - reach - 0.5
    inside = np.hypot(fine[:, None], fine[None, :]) <= radius
    part = inside.reshape(2 * reach + 1, 16, 2 * reach + 1, 16).mean(axis=(1, 3))
    return (part / part.sum()).astype(np.float32)


@dataclasses.dataclass(frozen=True)
class Photo:
    """A photograph."""

    rgb: Image  # what a program reads from the file
    truth: Any  # what a perfect measurement of it would find; None where the cloth is alone
    file: bytes | None  # None where the scene has no compression
    time: datetime.datetime | None = None

    def jpeg(self) -> bytes:
        """The JPEG file, time stamp included."""
        data = self.file or encode_jpeg(self.rgb, Jpeg(100, "444"))
        return data if self.time is None else stamped(data, self.time)

    def save(self, path: str | PathLike[str]) -> Path:
        Path(path).write_bytes(self.jpeg())
        return Path(path)


_BLOCK_ROWS = 128
_WHITE = (1 << 16) - 1
_DENOISED_PX = 2.0  # standard deviation of the bilateral filter in space
_SHARPENED_PX = 1.0  # of the unsharp mask
_EXACT_POISSON_BELOW = 4.0  # electrons; above, a normal deviate with Poisson's skewness


@dataclasses.dataclass(frozen=True)
class LinearPhoto:
    """The light that falls on the sensor, linear RGB, before noise; `truth` as of `Photo`."""

    scene: Setting
    light: Floats
    truth: Any


def expose(linear: LinearPhoto, seed: int) -> Photo:
    """The photograph that the scene's sensor makes of the light."""
    scene, sensor = linear.scene, linear.scene.sensor
    light = _mosaic(linear.light) if sensor.bayer else linear.light
    read_out = _read_out(light, sensor, np.random.default_rng(seed))
    if sensor.bayer:
        # OpenCV names a pattern by its second row and column: BG is RGGB from the corner.
        rgb16 = cv2.demosaicing(read_out, cv2.COLOR_BayerBG2RGB_EA)
        read_out = np.asarray(rgb16, np.uint16)
    levels = np.arange(_WHITE + 1) / _WHITE
    if sensor.sharpening == sensor.denoising == 0:
        rgb = np.rint(255 * sensor.encoded(levels)).astype(np.uint8)[read_out]
    else:
        encoded = sensor.encoded(levels).astype(np.float32)[read_out]
        if sensor.denoising > 0:
            encoded = cv2.bilateralFilter(encoded, 0, sensor.denoising, _DENOISED_PX)
        soft = cv2.GaussianBlur(encoded, (0, 0), _SHARPENED_PX)
        sharp = np.clip(encoded + sensor.sharpening * (encoded - soft), 0, 1)
        rgb = np.rint(255 * sharp).astype(np.uint8)
    if scene.lying:
        rgb = np.ascontiguousarray(np.rot90(rgb))
    if scene.jpeg is None:
        return Photo(rgb, linear.truth, None, scene.time)
    data = encode_jpeg(rgb, scene.jpeg)
    read = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
    return Photo(np.asarray(read, np.uint8), linear.truth, data, scene.time)


def _read_out(
    light: Floats, sensor: CameraSensor, random: np.random.Generator
) -> NDArray[np.uint16]:
    """The light as 16-bit values, with the noise of its photons and of reading them."""
    values = np.empty(light.shape, np.uint16)
    for top in range(0, light.shape[0], _BLOCK_ROWS):
        block = slice(top, top + _BLOCK_ROWS)
        expected = np.maximum(light[block], 0) * np.float32(sensor.exposure * sensor.full_well)
        normal = random.standard_normal(expected.shape, np.float32)
        # Cornish and Fisher's normal deviate with the variance and the skewness of Poisson's.
        electrons = expected + np.sqrt(expected) * normal + (normal**2 - 1) / 6
        dim = expected < _EXACT_POISSON_BELOW
        electrons[dim] = random.poisson(expected[dim])
        read = random.standard_normal(expected.shape, np.float32)
        electrons += np.float32(sensor.read_noise) * read
        light_read = np.clip(electrons / np.float32(sensor.full_well), 0, 1)
        values[block] = np.rint(light_read * np.float32(_WHITE))
    return values


def _mosaic(light: Floats) -> Floats:
    """One colour per pixel: red and green in the even rows, green and blue in the odd ones."""
    mosaic = light[..., 1].copy()
    mosaic[::2, ::2] = light[::2, ::2, 0]
    mosaic[1::2, 1::2] = light[1::2, 1::2, 2]
    return mosaic


_STRETCH = 400  # bytes that are spoilt


def damaged(data: bytes, kind: Literal["scrambled", "blanked"], seed: int) -> bytes:
    """A JPEG file with noise or zeros in a stretch of its middle half."""
    random = np.random.default_rng(seed)
    start = int(random.integers(len(data) // 4, 3 * len(data) // 4 - _STRETCH))
    # 0xff begins a marker: leaving it out keeps this a fault of the data, not of the structure.
    noise = random.integers(0, 0xFF, _STRETCH, np.uint8).tobytes()
    stretch = noise if kind == "scrambled" else bytes(_STRETCH)
    return data[:start] + stretch + data[start + _STRETCH :]

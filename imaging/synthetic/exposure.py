"""From the light on the sensor to the file: noise, colour filter, tone curve, sharpening, JPEG."""

import numpy as np
from numpy.typing import NDArray

from .jpeg_file import decode_jpeg, encode_jpeg
from .linear import LinearPhoto
from .photo import Photo, T
from .scene import Sensor

_BLOCK_ROWS = 128
_WHITE = (1 << 16) - 1
_EXACT_POISSON_BELOW = 4.0  # electrons; above, a normal deviate with Poisson's skewness


def expose(linear: LinearPhoto[T], seed: int, *, sensor: Sensor | None = None) -> Photo[T]:
    """The photograph that sensor and camera program make of the light.

    Args:
        linear: the light.
        seed: of the noise.
        sensor: another sensor than the scene's.
    """
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    scene, sensor = linear.scene, sensor or linear.scene.sensor
    light = _mosaic(linear.light) if sensor.bayer else linear.light
    read_out = _read_out(light, sensor, np.random.default_rng(seed))
    if sensor.bayer:
        # OpenCV names a pattern by its second row and column: BG is RGGB from the corner.
        rgb16 = cv2.demosaicing(read_out, cv2.COLOR_BayerBG2RGB_EA)
        read_out = np.asarray(rgb16, np.uint16)
    levels = np.arange(_WHITE + 1) / _WHITE
    if sensor.sharpening == 0:
        rgb = np.rint(255 * sensor.encoded(levels)).astype(np.uint8)[read_out]
    else:
        encoded = sensor.encoded(levels).astype(np.float32)[read_out]
        soft = cv2.GaussianBlur(encoded, (0, 0), sensor.sharpening_px)
        sharp = np.clip(encoded + sensor.sharpening * (encoded - soft), 0, 1)
        rgb = np.rint(255 * sharp).astype(np.uint8)
    if scene.lying:
        rgb = np.ascontiguousarray(np.rot90(rgb))
    if scene.jpeg is None:
        return Photo(rgb, linear.shown, None, scene.time)
    data = encode_jpeg(rgb, scene.jpeg)
    return Photo(decode_jpeg(data), linear.shown, data, scene.time)


def _read_out(
    light: NDArray[np.floating], sensor: Sensor, random: np.random.Generator
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


def _mosaic(light: NDArray[np.floating]) -> NDArray[np.floating]:
    """One colour per pixel: red and green in the even rows, green and blue in the odd ones."""
    mosaic = light[..., 1].copy()
    mosaic[::2, ::2] = light[::2, ::2, 0]
    mosaic[1::2, 1::2] = light[1::2, 1::2, 2]
    return mosaic

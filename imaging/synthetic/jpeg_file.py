"""JPEG files: written, read back, and stamped with the time."""

import datetime
import struct

import numpy as np
from numpy.typing import NDArray

from .scene import Jpeg


def encode_jpeg(rgb: NDArray[np.uint8], jpeg: Jpeg) -> bytes:
    """A JPEG file of this picture."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    factor = getattr(cv2, f"IMWRITE_JPEG_SAMPLING_FACTOR_{jpeg.subsampling}")
    options = [cv2.IMWRITE_JPEG_QUALITY, jpeg.quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), options)
    if not done:
        raise OSError(f"OpenCV could not write a JPEG of shape {rgb.shape}")
    return data.tobytes()


def decode_jpeg(data: bytes) -> NDArray[np.uint8]:
    """The picture of a JPEG file, RGB."""
    import cv2  # noqa: PLC0415 - heavy, and needed here only

    bgr = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    if bgr is None:
        raise OSError("OpenCV could not read the JPEG it wrote")
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), np.uint8)


def stamped(data: bytes, time: datetime.datetime) -> bytes:
    """The file with an EXIF block that holds DateTimeOriginal and SubSecTimeOriginal."""
    from PIL import Image  # noqa: PLC0415 - heavy, and needed here only

    exif = Image.Exif()
    camera = exif.get_ifd(0x8769)
    camera[0x9003] = time.strftime("%Y:%m:%d %H:%M:%S")
    camera[0x9291] = f"{time.microsecond // 1000:03d}"
    block = exif.tobytes()
    start_of_image, rest = data[:2], data[2:]
    return start_of_image + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + rest

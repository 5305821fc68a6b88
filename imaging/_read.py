"""Pictures from files, with the checks that the decoder leaves out."""

import os
import tempfile
import threading
from collections.abc import Callable
from os import PathLike
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from ._errors import DamagedImage, UnreadableImage

Reader = Callable[[str], NDArray[np.uint8]]
"""From a path to a picture, RGB, dtype uint8, shape (h, w, 3); it may raise `ImagingError`."""

_JPEG_START, _JPEG_END = b"\xff\xd8", b"\xff\xd9"
_COMPLAINTS = ("corrupt", "premature", "extraneous", "invalid", "bogus", "unsupported marker")
_stderr_lock = threading.Lock()


def read_image(path: str | PathLike[str]) -> NDArray[np.uint8]:
    """The picture of a file as the sensor had it: RGB, not turned by its EXIF orientation.

    OpenCV decodes damaged JPEG files in silence but for a line that libjpeg writes to the process'
    standard error; that line is caught here, and is a `DamagedImage`.

    Args:
        path: of a picture in any format that OpenCV reads; more than 8 bits are reduced to 8.

    Returns:
        Shape (h, w, 3), dtype uint8.

    Raises:
        UnreadableImage: no file, an empty or truncated one, or no picture.
        DamagedImage: the decoder complained.
    """
    place = os.fspath(path)
    try:
        data = Path(place).read_bytes()
    except OSError as error:
        raise UnreadableImage(f"the file must be readable; {error.strerror}", path=place) from error
    if not data:
        raise UnreadableImage("the file must hold a picture; it is empty", path=place, bytes=0)
    if data[:2] == _JPEG_START and _JPEG_END not in data[-4096:]:
        raise UnreadableImage(
            "a JPEG file must end with its end marker FF D9; this one is truncated: copy it again",
            path=place,
            bytes=len(data),
        )
    image, complaint = _decoded(data)
    if image is None:
        raise UnreadableImage(
            "the file must hold a picture that OpenCV can decode",
            path=place,
            bytes=len(data),
            starts_with=data[:4].hex(" "),
        )
    if complaint:
        raise DamagedImage(
            f"the decoder must not complain; it says: {complaint}", path=place, bytes=len(data)
        )
    return image


def _decoded(data: bytes) -> tuple[NDArray[np.uint8] | None, str]:
    """The picture, and what the decoder wrote to the standard error about it."""
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    buffer = np.frombuffer(data, np.uint8)
    with _stderr_lock, tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            image = cv2.imdecode(buffer, flags)
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        sink.seek(0)
        said = sink.read().decode(errors="replace").strip()
    complaints = [line for line in said.splitlines() if _is_complaint(line)]
    others = [line for line in said.splitlines() if not _is_complaint(line)]
    if others:  # written by another thread meanwhile
        os.write(2, ("\n".join(others) + "\n").encode())
    picture = None if image is None else np.asarray(image, np.uint8)
    return picture, "; ".join(complaints)


def _is_complaint(line: str) -> bool:
    return any(word in line.lower() for word in _COMPLAINTS)

"""Pictures from files, with the checks that the decoder leaves out."""

import os
import tempfile
import threading
from collections.abc import Callable
from os import PathLike
from pathlib import Path

import cv2
import numpy as np

from ..arrays import Image
from ..errors import DamagedImage, UnreadableImage
from .jpeg_damage import find_seam, read_header
from .orientation import orientation_of, shown

Reader = Callable[[str], Image]
"""From a path to a picture, RGB, dtype uint8, shape (h, w, 3); it may raise `ImagingError`."""

_JPEG_START = b"\xff\xd8"
_COMPLAINTS = ("corrupt", "premature", "extraneous", "invalid", "bogus", "unsupported marker")
_stderr_lock = threading.Lock()


def read_image(path: str | PathLike[str]) -> Image:
    """The picture of a file as it is to be shown: RGB, turned and mirrored by its EXIF orientation.

    OpenCV decodes damaged JPEG files without an error but for a line that libjpeg writes to the process'
    standard error; that line is caught here, and is a `DamagedImage`. A bit that flips in the
    file's data often earns no such line: where it has moved the level or the colour of all that
    follows, the seam is found in the picture. Where it has spoilt one block of 8 x 8 px, that stays.

    Args:
        path: of a picture in any format that OpenCV reads; more than 8 bits are reduced to 8.

    Returns:
        Shape (h, w, 3), dtype uint8.

    Raises:
        UnreadableImage: no file, an empty or truncated one, or no picture.
        DamagedImage: the decoder complained, or a seam runs through the picture.
    """
    place = os.fspath(path)
    try:
        data = Path(place).read_bytes()
    except OSError as error:
        raise UnreadableImage(f"the file must be readable; {error.strerror}", path=place) from error
    if not data:
        raise UnreadableImage("the file must hold a picture; it is empty", path=place, bytes=0)
    header = read_header(data) if data[:2] == _JPEG_START else None
    if header is not None and not header.ended:
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
    seam = None if header is None else find_seam(image, header)
    if seam is not None:
        raise DamagedImage(
            "level and colour must not jump along a row of the JPEG's blocks; they do, and stay so "
            "to the end, which a spoilt bit in the file does: copy it again from the camera",
            path=place,
            row=seam[0],
            jump_levels=seam[1],
        )
    return shown(image, orientation_of(data))


def readable_part(path: str | PathLike[str]) -> Image | None:
    """The part of a picture that can be decoded, for display; None where nothing can."""
    try:
        data = Path(path).read_bytes()
    except OSError:
        return None
    image = _decoded(data)[0] if data else None
    return None if image is None else shown(image, orientation_of(data))


def _decoded(data: bytes) -> tuple[Image | None, str]:
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

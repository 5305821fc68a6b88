"""Photographs from files: decoded, checked for damage, oriented, with their times."""

import contextlib
import dataclasses
import io
import math
import os
import tempfile
import threading
import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np

from famjax.boundary.errors import import_extra

from .camera import Camera, Image
from .errors import DamagedImage, ImagingError, UnreadableImage

_COMPLAINTS = ("corrupt", "premature", "extraneous", "invalid", "bogus", "unsupported marker")
_stderr_lock = threading.Lock()
# CIPA DC-008, EXIF 2.32
_ORIENTATION, _EXIF_IFD, _TAKEN, _FRACTION = 0x0112, 0x8769, 0x9003, 0x9291
_DIMENSIONS = 0xA002, 0xA003
_ACROSS = frozenset({5, 6, 7, 8})  # rows of the file are columns of the picture
HEIC = (".heic", ".heif")
"""File suffixes of HEIC pictures, which the extra `heic` reads."""


def read_image(path: str | PathLike[str]) -> Image:
    """Read a picture from a file as RGB, oriented according to its EXIF tag.

    OpenCV decodes damaged JPEG files without an error but for a line that libjpeg writes to the process'
    standard error; that line is caught here, and is a `DamagedImage`. A bit that flips in the
    file's data often earns no such line.

    Args:
        path: of a picture in any format that OpenCV reads, or of a HEIC file; more than 8 bits are
            reduced to 8.

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
    if _too_large(data):
        raise UnreadableImage("a picture has 178 Mpx at most; this one states more", path=place)
    if place.lower().endswith(HEIC):
        return _read_heic(place)
    image, complaint = _decoded(data)
    if image is None or "premature end" in complaint.lower():
        raise UnreadableImage(
            "the file must hold a whole picture: copy it again, or export it as JPEG", path=place
        )
    if complaint:
        raise DamagedImage(f"the decoder must not complain; it says: {complaint}", path=place)
    return image


@contextlib.contextmanager
def named(image: str | PathLike[str] | Image) -> Iterator[tuple[Image, str]]:
    """A picture, read if it is a path, and its path; a refusal of it names the path."""
    path = "" if isinstance(image, np.ndarray) else os.fspath(image)
    try:
        yield image if isinstance(image, np.ndarray) else read_image(path), path
    except ImagingError as error:
        raise error.at(path) from error if path else None


def _read_heic(path: str) -> Image:
    import_extra("pillow_heif", "heic", UnreadableImage).register_heif_opener()
    from PIL import Image, ImageOps  # noqa: PLC0415

    try:
        with Image.open(path) as picture:
            return np.array(ImageOps.exif_transpose(picture).convert("RGB"))
    except (OSError, ValueError) as error:
        raise UnreadableImage(f"the file must hold a picture; {error}", path=path) from None


def _too_large(data: bytes) -> bool:
    """Whether the header states more pixels than Pillow believes, before anything is decoded."""
    from PIL import Image as Pictures  # noqa: PLC0415

    with warnings.catch_warnings(), contextlib.suppress(OSError, SyntaxError, ValueError):
        warnings.simplefilter("ignore", Pictures.DecompressionBombWarning)
        try:
            Pictures.open(io.BytesIO(data)).close()
        except Pictures.DecompressionBombError:
            return True
    return False


def _decoded(data: bytes) -> tuple[Image | None, str]:
    """The picture, and what the decoder wrote to the standard error about it."""
    image = None
    with _stderr_lock, tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            with contextlib.suppress(cv2.error):  # nothing to decode, or more pixels than it takes
                image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        sink.seek(0)
        said = sink.read().decode(errors="replace").strip().splitlines()
    complaints = [line for line in said if any(word in line.lower() for word in _COMPLAINTS)]
    others = [line for line in said if line not in complaints]
    if others:  # written by another thread meanwhile
        os.write(2, ("\n".join(others) + "\n").encode())
    return None if image is None else np.asarray(image, np.uint8), "; ".join(complaints)


def sizes_of(path: str | PathLike[str]) -> list[tuple[int, int]]:
    """Width and height [px] by a file's header: as shown, then those of the camera's own if EXIF has them.

    Empty where the header cannot be read; the measurement reports what is wrong with the file.
    """
    return _header(path)[0]


def _header(path: str | PathLike[str]) -> tuple[list[tuple[int, int]], dict[int, Any]]:
    """`sizes_of` a picture, and its EXIF entries."""
    from PIL import Image  # noqa: PLC0415 -- loaded when pictures are

    unreadable = OSError, SyntaxError, ValueError, Image.DecompressionBombError
    with contextlib.suppress(*unreadable), Image.open(path) as picture:
        # The entries of others stand behind their pixels.
        told = "exif" in picture.info or picture.format == "TIFF"
        tags = picture.getexif() if told else Image.Exif()
        entries = tags.get_ifd(_EXIF_IFD)
        sizes = [picture.size, tuple(entries.get(tag, 0) for tag in _DIMENSIONS)]
        turn = -1 if tags.get(_ORIENTATION) in _ACROSS else 1
        return [size[::turn] for size in sizes if all(size)], entries
    return [], {}


class Timestamp(NamedTuple):
    """The time of one picture by the camera's clock.

    Attributes:
        seconds: since 1970-01-01 [s], the camera's clock read as if it showed UTC.
        resolution: smallest step of the stamp [s]; 1.0 where the camera writes whole seconds.
    """

    seconds: float
    resolution: float


def date_text(seconds: float) -> str:
    """Seconds since 1970 as ISO 8601 to the millisecond; empty for nan."""
    if not math.isfinite(seconds):
        return ""
    moment = datetime.fromtimestamp(round(seconds, 3), UTC).replace(tzinfo=None)
    return moment.isoformat(timespec="milliseconds")


def read_timestamp(path: str | Path) -> Timestamp | None:
    """Read the time at which a picture was taken; None if the file does not say or cannot be read.

    DateTimeOriginal counts whole seconds. SubSecTimeOriginal holds the digits after the decimal
    point, and without it the stamp is cut down to the second: on average half a second early. A
    camera whose clock was never set writes zeros or blanks.

    Args:
        path: a JPEG, TIFF, PNG or WebP file.

    References:
        CIPA DC-008, EXIF 2.32, tags 36867 and 37521.
    """
    entries = _header(path)[1]
    taken, fraction = (_text(entries.get(tag)) for tag in (_TAKEN, _FRACTION))
    try:
        whole = datetime.strptime(taken, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    if not (fraction.isascii() and fraction.isdigit()):
        return Timestamp(whole, 1.0)
    return Timestamp(whole + int(fraction) / 10 ** len(fraction), 10.0 ** -len(fraction))


def _text(entry: object) -> str:
    if isinstance(entry, bytes):
        entry = entry.decode("ascii", "replace")
    return str(entry or "").strip("\0 ")


@dataclasses.dataclass(frozen=True)
class Photograph:
    """A picture with the muscle upright.

    Attributes:
        rgb: shape (h, w, 3).
        camera: its centre in px of this picture.
        path: of the picture; empty for an array.
        turned: the picture was turned a quarter turn clockwise first.
    """

    rgb: Image
    camera: Camera
    path: str = ""
    turned: bool = False

    def clockwise(self) -> "Photograph":
        """The same, rotated a quarter turn clockwise."""
        u, v = self.camera.centre
        return dataclasses.replace(
            self,
            rgb=np.ascontiguousarray(np.rot90(self.rgb, -1)),
            camera=dataclasses.replace(self.camera, centre=(self.rgb.shape[0] - 1 - v, u)),
            turned=True,
        )

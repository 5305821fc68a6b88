"""Read photographs: decoding, damage checks, orientation and time stamps."""

import contextlib
import dataclasses
import io
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
_INCOMPLETE = "the file must contain a complete picture: copy it again, or export it as JPEG"
HEIC = (".heic", ".heif")
"""File suffixes of HEIC pictures; reading them requires the `heic` extra."""


def read_image(path: str | PathLike[str]) -> Image:
    """Read a picture from a file as RGB, oriented according to its EXIF tag.

    OpenCV decodes damaged JPEG files without raising an error; libjpeg only writes a message to standard
    error. That message is captured and raised as `DamagedImage`. A single flipped bit often produces no
    message.

    Args:
        path: picture in any format that OpenCV reads, or a HEIC file. Pictures with more than 8 bits per
            channel are reduced to 8.

    Returns:
        Shape (h, w, 3), dtype uint8.

    Raises:
        UnreadableImage: the file is missing, empty, truncated or not a picture.
        DamagedImage: the decoder reported damage.
    """
    place = os.fspath(path)
    try:
        data = Path(place).read_bytes()
    except OSError as error:
        raise UnreadableImage(f"cannot read the file: {error.strerror}", path=place) from error
    if place.lower().endswith(HEIC):
        return _read_heic(place)
    if fault := _header_fault(data):
        raise UnreadableImage(fault, path=place)
    image, complaint = _decoded(data)
    if image is None or "premature end" in complaint.lower():
        raise UnreadableImage(_INCOMPLETE, path=place)
    if complaint:
        raise DamagedImage(f"the file is damaged; the decoder reports: {complaint}", path=place)
    return image


@contextlib.contextmanager
def named(image: str | PathLike[str] | Image) -> Iterator[tuple[Image, str]]:
    """Yield a picture, read from its file if necessary, and its path; add the path to `ImagingError`s."""
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
        raise UnreadableImage(
            f"the file must contain a readable picture: {error}", path=path
        ) from None


def _header_fault(data: bytes) -> str:
    """Return what is wrong with the header of a picture; "" if nothing is.

    The largest picture is the one below Pillow's decompression-bomb limit.
    """
    from PIL import Image as Pictures  # noqa: PLC0415

    with warnings.catch_warnings():
        warnings.simplefilter("ignore", Pictures.DecompressionBombWarning)
        try:
            Pictures.open(io.BytesIO(data)).close()
        except Pictures.DecompressionBombError:
            return "a picture must have at most 178 Mpx, but its header states a larger size"
        except (OSError, SyntaxError, ValueError):
            return _INCOMPLETE
    return ""


def _decoded(data: bytes) -> tuple[Image | None, str]:
    """Return the picture and the decoder's messages on standard error."""
    image = None
    with _stderr_lock, tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            with contextlib.suppress(cv2.error):  # no picture, or too many pixels
                image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR_RGB)
        finally:
            os.dup2(kept, 2)
            os.close(kept)
        sink.seek(0)
        said = sink.read().decode(errors="replace").strip().splitlines()
    complaints = [line for line in said if any(word in line.lower() for word in _COMPLAINTS)]
    others = [line for line in said if line not in complaints]
    if others:  # from another thread in the meantime
        os.write(2, ("\n".join(others) + "\n").encode())
    return None if image is None else np.asarray(image, np.uint8), "; ".join(complaints)


def sizes_of(path: str | PathLike[str]) -> list[tuple[int, int]]:
    """Return sizes (width, height) [px] from the header: as displayed, and from EXIF if present.

    The list is empty if the header cannot be read; the measurement reports the cause.
    """
    return _header(path)[0]


def _header(path: str | PathLike[str]) -> tuple[list[tuple[int, int]], dict[int, Any]]:
    """Return the result of `sizes_of` and the EXIF entries."""
    from PIL import Image  # noqa: PLC0415

    unreadable = OSError, SyntaxError, ValueError, Image.DecompressionBombError
    with (
        warnings.catch_warnings(action="ignore"),
        contextlib.suppress(*unreadable),
        Image.open(path) as picture,
    ):
        # Other formats store EXIF after the pixels.
        has_exif = "exif" in picture.info or picture.format == "TIFF"
        tags = picture.getexif() if has_exif else Image.Exif()
        entries = tags.get_ifd(_EXIF_IFD)
        sizes = [picture.size, tuple(entries.get(tag, 0) for tag in _DIMENSIONS)]
        turn = -1 if tags.get(_ORIENTATION) in _ACROSS else 1
        return [size[::turn] for size in sizes if all(size)], entries
    return [], {}


class Timestamp(NamedTuple):
    """Time on the camera's clock at which a picture was taken.

    Attributes:
        seconds: time since 1970-01-01 [s]; the camera's clock is assumed to show UTC.
        resolution: smallest step of the time stamp [s]; 1.0 if the camera records whole seconds.
    """

    seconds: float
    resolution: float


def read_timestamp(path: str | Path) -> Timestamp | None:
    """Return the time at which a picture was taken; None if it is missing or cannot be read.

    The EXIF entry DateTimeOriginal contains whole seconds, and SubSecTimeOriginal the digits after the
    decimal point. Without the latter, the time is truncated to whole seconds, and is half a second early on
    average. A camera whose clock was never set writes zeros or blanks.

    Args:
        path: JPEG, TIFF, PNG or WebP file.

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
        rgb: pixels, shape (h, w, 3).
        camera: camera, with its centre in pixels of this picture.
        path: path of the picture; empty if it was passed as an array.
        turned: True if the picture was first rotated a quarter turn clockwise.
    """

    rgb: Image
    camera: Camera
    path: str = ""
    turned: bool = False

    def clockwise(self) -> "Photograph":
        """Return the photograph rotated a quarter turn clockwise."""
        u, v = self.camera.centre
        return dataclasses.replace(
            self,
            rgb=np.ascontiguousarray(np.rot90(self.rgb, -1)),
            camera=dataclasses.replace(self.camera, centre=(self.rgb.shape[0] - 1 - v, u)),
            turned=True,
        )

"""Photographs from files: decoded, checked for damage, turned as they are to be shown, with their times."""

import dataclasses
import io
import os
import tempfile
import threading
import warnings
from collections.abc import Callable, Sequence
from datetime import UTC, datetime
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .camera import Camera, Image, Single
from .errors import DamagedImage, UnreadableImage

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

Reader = Callable[[str], Image]
"""From a path to a picture, RGB, dtype uint8, shape (h, w, 3); it may raise `ImagingError`."""

_COMPLAINTS = ("corrupt", "premature", "extraneous", "invalid", "bogus", "unsupported marker")
_stderr_lock = threading.Lock()
_JPEG, _END = b"\xff\xd8", b"\xff\xd9"
# CIPA DC-008, EXIF 2.32
_ORIENTATION, _EXIF_IFD, _TAKEN, _FRACTION = 0x0112, 0x8769, 0x9003, 0x9291
_DIMENSIONS = 0xA002, 0xA003
_ACROSS = frozenset({5, 6, 7, 8})  # rows of the file are columns of the picture
_LEAST_JUMP = 4.0  # levels; a seam of 4 moves the diameter by half of its standard error
_STEPS = 2.5  # of the coding of the means, by which a sound picture may jump along a row of blocks
_SHARP = 0.15  # of the jump; a lens and a pixel's own width leave more of an edge's slope beside it
_CERTAIN = 5.0  # standard errors of the jump's median
_SCREENED, _RUN = 256, 16  # columns of the first look, and how many beside each other
_PARTS = 4  # of the width, every one of which must show the jump
_LUMA_RED_BLUE = np.array([[0.299, 0.587, 0.114], [1, 0, 0], [0, 0, 1]], np.float32)


class Header(NamedTuple):
    """What a file states ahead of its picture; of files that are no JPEG nothing is known.

    Attributes:
        orientation: EXIF's, 1 to 8; OpenCV turns TIFF files itself.
        rows: of a coding unit [px], 8, or 16 where two rows of blocks share their colour; 0 where
            the picture is coded in another way.
        step: of the coding of the blocks' means, the coarsest of brightness and colour [levels].
        ended: an end marker follows the picture's data; a preview's own ends before them.
    """

    orientation: int = 1
    rows: int = 0
    step: float = 0.0
    ended: bool = True


def read_header(data: bytes) -> Header:
    """The header of a JPEG file, as far as Pillow can follow it."""
    from PIL import Image as Pictures, JpegImagePlugin, UnidentifiedImageError  # noqa: PLC0415

    if data[:2] != _JPEG:
        return Header()
    try:
        with Pictures.open(io.BytesIO(data)) as picture:
            if not isinstance(picture, JpegImagePlugin.JpegImageFile):
                return Header()
            units = [vertical for _, _, vertical, _ in picture.layer]
            coarsest = max((table[0] for table in picture.quantization.values()), default=0)
            scan = picture.fp.tell() if picture.fp else 0  # Pillow stops where the data begin
            ended = data.rfind(_END) >= scan
            return Header(_tag(picture), 8 * max(units), coarsest / 8 * 1.772, ended)
    except (OSError, UnidentifiedImageError, SyntaxError):
        return Header(ended=data.rfind(_END) > 0)


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
    if _too_large(data):
        raise UnreadableImage("a picture has 178 Mpx at most; this one states more", path=place)
    header = read_header(data)
    if not header.ended:
        raise UnreadableImage(
            "a JPEG file must end with its end marker FF D9; this one is truncated: copy it again",
            path=place, bytes=len(data),
        )  # fmt: skip
    image, complaint = _decoded(data)
    if image is None:
        raise UnreadableImage(
            "the file must hold a picture that OpenCV can decode",
            path=place, bytes=len(data), starts_with=data[:4].hex(" "),
        )  # fmt: skip
    if complaint:
        raise DamagedImage(
            f"the decoder must not complain; it says: {complaint}", path=place, bytes=len(data)
        )
    seam = find_seam(image, header)
    if seam is not None:
        raise DamagedImage(
            "level and colour must not jump along a row of the JPEG's blocks; they do, and stay so "
            "to the end, which a spoilt bit in the file does: copy it again from the camera",
            path=place, row=seam[0], jump_levels=seam[1],
        )  # fmt: skip
    return shown(image, header.orientation)


def _too_large(data: bytes) -> bool:
    """Whether the header states more pixels than Pillow believes, before anything is decoded."""
    from PIL import Image as Pictures, UnidentifiedImageError  # noqa: PLC0415

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", Pictures.DecompressionBombWarning)
            Pictures.open(io.BytesIO(data)).close()
    except Pictures.DecompressionBombError:
        return True
    except (OSError, UnidentifiedImageError, SyntaxError, ValueError):
        pass
    return False


def _decoded(data: bytes) -> tuple[Image | None, str]:
    """The picture, and what the decoder wrote to the standard error about it."""
    flags = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION
    with _stderr_lock, tempfile.TemporaryFile() as sink:
        kept = os.dup(2)
        try:
            os.dup2(sink.fileno(), 2)
            image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
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


def shown(image: Image, orientation: int) -> Image:
    """The picture as it is to be shown, from the file's rows.

    Args:
        image: shape (h, w, 3).
        orientation: 1 to 8: 2, 4, 5 and 7 are mirrored, 3 stands on its head, 6 and 8 lie on a side.
    """
    if orientation in _ACROSS:
        image = image.swapaxes(0, 1)
    if orientation in {3, 4, 7, 8}:
        image = image[::-1]
    if orientation in {2, 3, 6, 7}:
        image = image[:, ::-1]
    return np.ascontiguousarray(image)


def sizes_of(path: str | PathLike[str]) -> list[tuple[int, int]]:
    """Width and height [px] by a file's header: as shown, then those of the camera's own if EXIF has them.

    Empty where the header cannot be read; the measurement reports what is wrong with the file.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 -- loaded when pictures are

    try:
        with Image.open(path) as picture:
            across = _tag(picture) in _ACROSS
            entries = picture.getexif().get_ifd(_EXIF_IFD) if picture.format == "JPEG" else {}
            sizes = [picture.size, tuple(entries.get(tag, 0) for tag in _DIMENSIONS)]
    except (OSError, UnidentifiedImageError, SyntaxError, Image.DecompressionBombError):
        return []
    return [(h, w) if across else (w, h) for w, h in sizes if w and h]


def _tag(picture: "Picture") -> int:
    if picture.format not in {"JPEG", "MPO", "TIFF"}:
        return 1  # the entries of others stand behind their pixels
    found = picture.getexif().get(_ORIENTATION, 1)
    return found if found in range(1, 9) else 1


def find_seam(rgb: Image, header: Header) -> tuple[int, float] | None:
    """First row and height [levels] of a jump along a row of coding units, or None.

    The unit with the spoilt difference lies somewhere in its row: from it to the right the jump is
    at the row's upper border, left of it at the lower one, and the sum of both is the same all
    across. It is sharper than any edge that a lens has drawn. With 16 rows to a unit a jump in
    colour is smoothed by the decoder and must be four times as high to be seen.

    Args:
        rgb: picture, shape (h, w, 3).
        header: of its file.
    """
    least = max(_LEAST_JUMP, _STEPS * header.step)
    if header.rows == 0 or rgb.shape[0] < 4 * header.rows or rgb.shape[1] < _PARTS * header.rows:
        return None
    borders = np.arange(header.rows, rgb.shape[0] - header.rows, header.rows)
    # Short runs of columns, evenly over the width, are quick to fetch.
    starts = np.linspace(0, rgb.shape[1] - _RUN, _SCREENED // _RUN).astype(int)
    step = _step(rgb, borders, [slice(start, start + _RUN) for start in starts])
    step = step[:-1] + step[1:]  # of a row of units: at its upper and its lower border
    often = [np.count_nonzero(sign * step >= least, axis=2).max(axis=1) for sign in (1, -1)]
    for k in np.flatnonzero(np.maximum(*often) >= step.shape[2] / 2):
        height = _seam(rgb, borders[k : k + 2], least)
        if height is not None:
            return int(borders[k]), height
    return None


def _step(
    rgb: Image, borders: NDArray[np.intp], columns: Sequence[slice] = (slice(None),)
) -> Single:
    """From the row above each border to that below it, shape (borders, 3, columns).

    Of brightness, red and blue: where the decoder smooths the colour, brightness stays sharp.
    """
    first, last, apart = borders[0], borders[-1], borders[1] - borders[0]
    below, above = rgb[first : last + 1 : apart], rgb[first - 1 : last : apart]
    change = [below[:, part].astype(np.float32) - above[:, part] for part in columns]
    return np.asarray(_LUMA_RED_BLUE @ np.concatenate(change, axis=1).swapaxes(1, 2), np.float32)


def _seam(rgb: Image, borders: NDArray[np.intp], least: float) -> float | None:
    """Height of the seam along one row of units, if it is one."""
    steps = np.stack([_step(rgb, borders + k).sum(axis=0) for k in (-1, 0, 1)])
    jump = steps[1] - (steps[0] + steps[2]) / 2  # zero for any slope
    parts = np.array_split(jump, _PARTS, axis=1)
    heights = np.stack([np.median(part, axis=1) for part in parts])
    scatter = [
        np.median(np.abs(part.T - height), axis=0)
        for part, height in zip(parts, heights, strict=True)
    ]
    certain = _CERTAIN * 1.25 * 1.48 * np.stack(scatter) / np.sqrt(jump.shape[1] / _PARTS)
    before, at, after = np.abs(np.median(steps, axis=2))
    sharp = before + after <= 2 * _SHARP * at
    everywhere = np.all(np.sign(heights[0]) * heights >= np.maximum(certain, least), axis=0)
    found = np.flatnonzero(sharp & everywhere)
    return float(np.median(heights[:, found[0]])) if found.size else None


class Timestamp(NamedTuple):
    """The time of one picture by the camera's clock.

    Attributes:
        seconds: since 1970-01-01 [s], the camera's clock read as if it showed UTC.
        resolution: smallest step of the stamp [s]; 1.0 where the camera writes whole seconds.
    """

    seconds: float
    resolution: float

    @property
    def text(self) -> str:
        """ISO 8601, as the camera's clock showed it."""
        digits = 0 if self.resolution >= 1 else 3 if self.resolution >= 1e-3 else 6
        moment = datetime.fromtimestamp(round(self.seconds, digits), UTC).replace(tzinfo=None)
        return moment.isoformat(
            timespec={0: "seconds", 3: "milliseconds"}.get(digits, "microseconds")
        )


def read_timestamp(path: str | Path) -> Timestamp | None:
    """The time at which a picture was taken; None where the file does not say, or cannot be read.

    DateTimeOriginal counts whole seconds. SubSecTimeOriginal holds the digits after the decimal
    point, and without it the stamp is cut down to the second: on average half a second early. A
    camera whose clock was never set writes zeros or blanks.

    Args:
        path: a JPEG, TIFF, PNG or WebP file.

    References:
        CIPA DC-008, EXIF 2.32, tags 36867 and 37521.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 -- loaded when pictures are

    try:
        with Image.open(path) as picture:
            entries = picture.getexif().get_ifd(_EXIF_IFD)
        taken, fraction = (_text(entries.get(tag)) for tag in (_TAKEN, _FRACTION))
        whole = datetime.strptime(taken, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except (
        OSError, UnidentifiedImageError, SyntaxError, ValueError, Image.DecompressionBombError
    ):  # fmt: skip
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
    """A picture in which the muscle stands upright.

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
        """The same turned a quarter turn clockwise."""
        u, v = self.camera.centre
        return dataclasses.replace(
            self,
            rgb=np.ascontiguousarray(np.rot90(self.rgb, -1)),
            camera=dataclasses.replace(self.camera, centre=(self.rgb.shape[0] - 1 - v, u)),
            turned=True,
        )

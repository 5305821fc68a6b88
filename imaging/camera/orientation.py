"""How a picture is to be shown: the orientation that a camera writes beside it."""

import io
from typing import TYPE_CHECKING

import numpy as np

from ..arrays import Image

if TYPE_CHECKING:
    from PIL.Image import Image as Picture

_TAG = 0x0112
_UPRIGHT = 1
_ACROSS = frozenset({5, 6, 7, 8})  # rows of the file are columns of the picture
_FORMATS = frozenset({"JPEG", "MPO", "TIFF"})
_HEAD = 1 << 17  # bytes of a JPEG file in which its EXIF block begins
_JPEG = b"\xff\xd8"


def orientation_of(data: bytes) -> int:
    """The EXIF orientation of a JPEG file, 1 to 8; 1 where it says none, and of other files.

    OpenCV turns TIFF files itself.

    References:
        CIPA DC-008, EXIF 2.32, tag 274.
    """
    if data[:2] != _JPEG or b"Exif" not in data[:_HEAD]:
        return _UPRIGHT
    from PIL import Image as Pictures, UnidentifiedImageError  # noqa: PLC0415 -- 20 ms

    try:
        with Pictures.open(io.BytesIO(data)) as picture:
            return _tag(picture)
    except (OSError, UnidentifiedImageError, SyntaxError):
        return _UPRIGHT


def shown_size(picture: "Picture") -> tuple[int, int]:
    """Width and height of an opened picture as it is to be shown [px], by its header."""
    width, height = picture.size
    return (height, width) if _tag(picture) in _ACROSS else (width, height)


def _tag(picture: "Picture") -> int:
    if picture.format not in _FORMATS:
        return _UPRIGHT  # the entries of others stand behind their pixels
    found = picture.getexif().get(_TAG, _UPRIGHT)
    return found if found in range(1, 9) else _UPRIGHT


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

"""When a picture was taken, from its EXIF data."""

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

_EXIF_IFD, _TAKEN, _FRACTION = 0x8769, 0x9003, 0x9291
"""The directory of the camera's entries, DateTimeOriginal and SubSecTimeOriginal (EXIF 2.32)."""


@dataclass(frozen=True)
class Timestamp:
    """The time of one picture by the camera's clock.

    Args:
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
    """The time at which a picture was taken; None where the file does not say.

    DateTimeOriginal counts whole seconds. SubSecTimeOriginal holds the digits after the decimal
    point, and without it the stamp is cut down to the second: on average half a second early.

    Args:
        path: a JPEG, TIFF, PNG or WebP file. One that cannot be read has no stamp.

    References:
        CIPA DC-008, EXIF 2.32, tags 36867 and 37521.
    """
    from PIL import Image, UnidentifiedImageError  # noqa: PLC0415 -- loaded when pictures are

    try:
        with Image.open(path) as picture:
            entries = picture.getexif().get_ifd(_EXIF_IFD)
    except (OSError, UnidentifiedImageError, SyntaxError):
        return None
    return _parse(_text(entries.get(_TAKEN)), _text(entries.get(_FRACTION)))


def _text(entry: object) -> str:
    if isinstance(entry, bytes):
        entry = entry.decode("ascii", "replace")
    return str(entry or "").strip("\0 ")


def _parse(taken: str, fraction: str) -> Timestamp | None:
    """A stamp of the two entries; a camera whose clock was never set writes zeros or blanks.

    >>> _parse("2021:03:04 05:06:07", "25")
    Timestamp(seconds=1614834367.25, resolution=0.01)
    """
    try:
        whole = datetime.strptime(taken, "%Y:%m:%d %H:%M:%S").replace(tzinfo=UTC).timestamp()
    except ValueError:
        return None
    if not (fraction.isascii() and fraction.isdigit()):
        return Timestamp(whole, 1.0)
    return Timestamp(whole + int(fraction) / 10 ** len(fraction), 10.0 ** -len(fraction))

"""Pictures by files, folders and patterns."""

import glob
import os
import re
from collections.abc import Sequence

from imaging import ImagingError

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
"""Files of a folder that are taken for pictures."""


def expand(photos: Sequence[str], without: str | None = None) -> list[str]:
    """The pictures that files, folders and globs name, those of one folder in natural order.

    Args:
        photos: what was named.
        without: a picture that is not one of them, the ruler's.

    Raises:
        ImagingError: something named holds no picture.
    """
    found: list[str] = []
    for photo in photos:
        if os.path.isdir(photo):
            inside = [entry.path for entry in os.scandir(photo)
                      if entry.is_file() and entry.name.lower().endswith(SUFFIXES)]  # fmt: skip
        elif os.path.exists(photo):
            inside = [photo]
        else:
            inside = [name for name in glob.glob(photo, recursive=True) if os.path.isfile(name)]
        if not inside:
            raise ImagingError(
                f"{photo} is no file, no folder with pictures ({' '.join(SUFFIXES)}) and no pattern "
                "that matches any"
            )
        found += sorted(inside, key=_natural)
    return [path for path in found if without is None or not os.path.samefile(path, without)]


def _natural(path: str) -> list[tuple[int, str]]:
    """img2 before img10."""
    return [(int(part), "") if part.isdigit() else (-1, part) for part in re.split(r"(\d+)", path)]

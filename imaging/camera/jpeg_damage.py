"""Damage of a JPEG file that its decoder does not report: no end, or a seam in the picture.

Each block's mean is coded as its difference from the block before. A spoilt difference moves the
level, or the colour, of all blocks from there on to the end of the picture. Pillow, on the same
libjpeg, does not report it either.
"""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from ..arrays import Image, Single

_LEAST_JUMP = 4.0  # levels; a seam of 4 moves the diameter by half of its standard error
_STEPS = 2.5  # of the coding of the means, by which a sound picture may jump along a row of blocks
_SHARP = 0.15  # of the jump; a lens and a pixel's own width leave more of an edge's slope beside it
_CERTAIN = 5.0  # standard errors of the jump's median
_SCREENED, _RUN = 256, 16  # columns of the first look, and how many beside each other
_PARTS = 4  # of the width, every one of which must show the jump
_FRAMES = frozenset({0xC0, 0xC1, 0xC2, 0xC9, 0xCA})  # markers of frames by the cosine transform
_LUMA_RED_BLUE = np.array([[0.299, 0.587, 0.114], [1, 0, 0], [0, 0, 1]], np.float32)
_SCAN, _TABLES, _END = 0xDA, 0xDB, b"\xff\xd9"


@dataclasses.dataclass(frozen=True)
class JpegHeader:
    """What a JPEG file states ahead of its picture.

    Attributes:
        rows: of a coding unit [px], 8, or 16 where two rows of blocks share their colour; 0 where
            the picture is coded in another way.
        step: of the coding of the blocks' means, the coarsest of brightness and colour [levels].
        ended: an end marker follows the picture's data; a preview's own ends before them.
    """

    rows: int
    step: float
    ended: bool


def read_header(data: bytes) -> JpegHeader:
    """The header of a JPEG file, as far as it can be followed.

    References:
        ITU-T T.81 (1992), annex B.
    """
    at, rows, step = 2, 0, 0.0
    while at + 4 <= len(data) and data[at] == 0xFF:
        marker, size = data[at + 1], int.from_bytes(data[at + 2 : at + 4], "big")
        part = data[at + 4 : at + 2 + size]
        if marker in _FRAMES and len(part) >= 6 + 3 * part[5]:
            rows = 8 * max(part[7 + 3 * k] & 15 for k in range(part[5]))
        elif marker == _TABLES:
            step = max(step, _coarsest_step(part))
        at += 1 if marker == 0xFF else 2 + size
        if marker == _SCAN:
            break
    return JpegHeader(rows, step, data.rfind(_END) >= at)


def _coarsest_step(tables: bytes) -> float:
    """Levels per unit of the means, the largest of some quantisation tables; of blue for colour."""
    coarsest, at = 0, 0
    while at + 65 <= len(tables):
        wide = tables[at] >> 4
        coarsest = max(coarsest, int.from_bytes(tables[at + 1 : at + 2 + wide], "big"))
        at += 1 + 64 * (1 + wide)
    return coarsest / 8 * 1.772


def find_seam(rgb: Image, header: JpegHeader) -> tuple[int, float] | None:
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
    step = _step(rgb, borders, _some_columns(rgb.shape[1]))
    step = step[:-1] + step[1:]  # of a row of units: at its upper and its lower border
    often = [np.count_nonzero(sign * step >= least, axis=2).max(axis=1) for sign in (1, -1)]
    for k in np.flatnonzero(np.maximum(*often) >= step.shape[2] / 2):
        height = _seam(rgb, borders[k : k + 2], least)
        if height is not None:
            return int(borders[k]), height
    return None


def _some_columns(width: int) -> list[slice]:
    """Columns of the first look: short runs of them, evenly over the width, are quick to fetch."""
    starts = np.linspace(0, width - _RUN, _SCREENED // _RUN).astype(int)
    return [slice(start, start + _RUN) for start in starts]


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

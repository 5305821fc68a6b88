"""Many pictures of a campaign at a glance."""

import math
import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from imaging.arrays import Image

_FACE, _GAP, _LINE = 240, 8, 15  # px: longer side of a picture, space between, line of text
_LETTERS, _LINES = 46, 4  # of a line; of what was measured or what was wrong
_GOOD, _BAD, _INK = (60, 160, 60), (210, 40, 40), (20, 20, 20)
_PAPER, _UNREADABLE = (245, 245, 245), (200, 200, 200)


@dataclass(frozen=True)
class Tile:
    """One picture of a contact sheet.

    Args:
        image: RGB, shape (h, w, 3); None where the file cannot be read.
        title: below it, the file's name.
        text: below the title, what was measured or what was wrong.
        ok: whether it was measured.
    """

    image: Image | None
    title: str
    text: str
    ok: bool


def contact_sheet(tiles: Sequence[Tile], columns: int | None = None) -> Image:
    """The pictures side by side in a frame that says whether each was measured.

    Args:
        tiles: the pictures, at least one.
        columns: number of them; about as many as rows if None.

    Returns:
        RGB, dtype uint8.
    """
    from PIL import Image as Pictures, ImageDraw  # noqa: PLC0415 -- loaded when pictures are

    across = columns or math.ceil(math.sqrt(len(tiles)))
    down = math.ceil(len(tiles) / across)
    texts = [[_shortened(tile.title, _LETTERS), *_wrapped(tile.text)] for tile in tiles]
    height = _FACE + _LINE * max(map(len, texts)) + 4
    size = across * (_FACE + _GAP) + _GAP, down * (height + _GAP) + _GAP
    sheet = Pictures.new("RGB", size, _PAPER)
    pen = ImageDraw.Draw(sheet)
    for k, (tile, text) in enumerate(zip(tiles, texts, strict=True)):
        row, column = divmod(k, across)
        top, left = _GAP + row * (height + _GAP), _GAP + column * (_FACE + _GAP)
        if tile.image is None:
            face = Pictures.new("RGB", (_FACE, _FACE), _UNREADABLE)
        else:
            face = Pictures.fromarray(tile.image)
            face.thumbnail((_FACE, _FACE))
        sheet.paste(face, (left + (_FACE - face.width) // 2, top))
        frame = left, top, left + _FACE - 1, top + _FACE - 1
        pen.rectangle(frame, outline=_GOOD if tile.ok else _BAD, width=2)
        for line, words in enumerate(text):
            ink = _INK if line == 0 or tile.ok else _BAD
            pen.text((left + 2, top + _FACE + 3 + _LINE * line), words, ink)
    return np.array(sheet)


def _wrapped(text: str) -> list[str]:
    """What fits below a picture, its beginning and its end, where the figures are."""
    return textwrap.wrap(_shortened(text, _LINES * (_LETTERS - 6)), _LETTERS)[:_LINES] or [""]


def _shortened(text: str, letters: int) -> str:
    """Without its middle where it is too long; the font has no letters but ASCII."""
    plain = text.encode("ascii", "replace").decode()
    half = (letters - 3) // 2
    return plain if len(plain) <= letters else f"{plain[:half]}...{plain[-half:]}"

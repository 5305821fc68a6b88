"""Many pictures of a campaign at a glance."""

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..arrays import Image

_FACE, _GAP, _LINE = 240, 8, 15  # px: longer side of a picture, space between, line of text
_LETTERS, _LINES = 46, 4  # of a line; of what was measured or what was wrong
_GOOD, _BAD, _PAPER, _INK = (60, 160, 60), (210, 40, 40), 245, (20, 20, 20)


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
    across = columns or int(np.ceil(np.sqrt(len(tiles))))
    texts = [_wrapped(tile.text) for tile in tiles]
    lines = max(len(text) for text in texts)
    faces = [_face(tile, text, lines) for tile, text in zip(tiles, texts, strict=True)]
    height, width = max(f.shape[0] for f in faces), max(f.shape[1] for f in faces)
    down = -(-len(tiles) // across)
    size = down * (height + _GAP) + _GAP, across * (width + _GAP) + _GAP, 3
    sheet = np.full(size, _PAPER, np.uint8)
    for k, face in enumerate(faces):
        row, column = divmod(k, across)
        top, left = _GAP + row * (height + _GAP), _GAP + column * (width + _GAP)
        sheet[top : top + face.shape[0], left : left + face.shape[1]] = face
    return sheet


def _face(tile: Tile, text: list[str], lines: int) -> Image:
    import cv2  # noqa: PLC0415

    if tile.image is None:
        small = np.full((_FACE, _FACE, 3), 200, np.uint8)
    else:
        h, w = tile.image.shape[:2]
        shrink = _FACE / max(h, w)
        size = max(1, round(w * shrink)), max(1, round(h * shrink))
        small = np.asarray(cv2.resize(tile.image, size, interpolation=cv2.INTER_AREA), np.uint8)
    face = np.full((_FACE + _LINE * (lines + 1) + 4, _FACE, 3), _PAPER, np.uint8)
    left = (_FACE - small.shape[1]) // 2
    face[: small.shape[0], left : left + small.shape[1]] = small
    colour = _GOOD if tile.ok else _BAD
    cv2.rectangle(face, (0, 0), (_FACE - 1, _FACE - 1), colour, 2)
    for line, words in enumerate([_shortened(tile.title, _LETTERS), *text]):
        ink = _INK if line == 0 or tile.ok else _BAD
        place = 2, _FACE + 13 + _LINE * line
        cv2.putText(face, words, place, cv2.FONT_HERSHEY_SIMPLEX, 0.36, ink, 1, cv2.LINE_AA)
    return face


def _wrapped(text: str) -> list[str]:
    """What fits below a picture, its beginning and its end, where the figures are."""
    return textwrap.wrap(_shortened(text, _LINES * (_LETTERS - 6)), _LETTERS)[:_LINES] or [""]


def _shortened(text: str, letters: int) -> str:
    """Without its middle where it is too long; the font has no letters but ASCII."""
    plain = text.encode("ascii", "replace").decode()
    half = (letters - 3) // 2
    return plain if len(plain) <= letters else f"{plain[:half]}...{plain[-half:]}"

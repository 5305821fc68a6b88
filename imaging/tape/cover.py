"""Where along its edge a tape can be seen, and where something else lies on it or shines on it."""

import numpy as np

from ..arrays import Array, Flags, Image
from ..camera.tone import Tone
from ..errors import MissingFitting

LEAST_SEEN = 0.6
"""Of the lit part of an edge: less than this cannot stand for all of it."""

_BEYOND = 5.0, 2.5  # px, and times the blur: how far behind an edge its tape is looked at
_ROWS = 6
_ANOTHER = 0.4  # of the way in colour from tape to braid
_NOISE = 0.04  # of chromaticity, which a grey tape on a white braid differs by no more
_SMOOTHED = 1 / 32  # of the tape's width


def behind(blur: float) -> Array:
    """Distances behind an edge at which its tape has its own colour [px], negative, shape (6,)."""
    return -np.arange(_ROWS, dtype=float) - max(_BEYOND[0], _BEYOND[1] * blur)


def tape_shows(rgb: Image, tone: Tone, colours: tuple[Array, Array], u: Array, v: Array) -> Flags:
    """The places along a tape's edge that have the tape's colour behind it.

    Chromaticity c = (R, G, B) / (R + G + B) in linear light is independent of shading. What is further from
    the tape's than 0.4 of the way to the braid's is another thing, or gloss. A tape that has the
    braid's colour, lighter or darker, cannot be distinguished from what covers it.

    Args:
        rgb: picture, shape (h, w, 3).
        tone: the camera's tone curve.
        colours: of tape and braid, encoded values 0 to 255, each of shape (3,).
        u: columns of positions along the edge and across it on the tape's side, shape (n, k).
        v: rows of them.

    Returns:
        Shape (n,).
    """
    columns = np.clip(np.rint(u).astype(np.intp), 0, rgb.shape[1] - 1)
    rows = np.clip(np.rint(v).astype(np.intp), 0, rgb.shape[0] - 1)
    light = tone.table[rgb[rows, columns]].sum(axis=1)
    width = max(1, round(_SMOOTHED * light.shape[0]))
    light = np.stack([np.convolve(one, np.ones(width), "same") for one in light.T], axis=1)
    tape, braid = (
        _chromaticity(np.interp(colour, np.arange(256), tone.table)) for colour in colours
    )
    off = np.linalg.norm(_chromaticity(light) - tape, axis=-1)
    return off < max(_ANOTHER * float(np.linalg.norm(braid - tape)), _NOISE)


def check_cover(seen: float) -> None:
    """Refuse a tape of whose edge too little is seen.

    Raises:
        MissingFitting: less than 60 % of its lit part.
    """
    if seen < LEAST_SEEN:
        raise MissingFitting(
            f"{LEAST_SEEN:.0%} or more of a tape's edge must show the tape's colour beside it; "
            "something covers it, or shines on it: clear it, or move the lamp",
            seen=seen,
        )


def _chromaticity(light: Array) -> Array:
    return light / np.maximum(light.sum(axis=-1, keepdims=True), 1e-9)

"""The light in which a tape's edge is seen: that which the braid has and the tape has not, and luma."""

import dataclasses
import math

import cv2
import numpy as np
from scipy.ndimage import map_coordinates, spline_filter

from ..arrays import Array, Image
from ..camera.tone import LUMA, Tone, amount_of_luma

_BRIGHTEST = 1.6
_BRIGHTER = 1.15  # luma of the braid over the tape's, for an edge in it
_OF_COLOUR = 1.6  # px^2

Part = tuple[slice, slice]
"""Rows and columns of a picture."""


@dataclasses.dataclass(frozen=True)
class Amounts:
    """The amount of braid against tape in a part of the picture, as a cubic spline's coefficients."""

    spline: Array
    u0: int
    v0: int

    def at(self, u: Array, v: Array) -> Array:
        """The amount at picture positions, of their shape; beyond the part that of its border."""
        where = [v - self.v0, u - self.u0]
        return np.asarray(
            map_coordinates(self.spline, where, order=3, mode="mirror", prefilter=False)
        )


def amounts_of(rgb: Image, tone: Tone, colours: tuple[Array, Array], part: Part) -> Amounts:
    """The amount of braid by the linear light that it has and the tape has not.

    Args:
        rgb: picture, shape (h, w, 3).
        tone: the camera's tone curve.
        colours: of tape and braid, encoded values 0 to 255, each of shape (3,).
        part: what is looked at.
    """
    tape, braid = (np.interp(colour, np.arange(256), tone.table) for colour in colours)
    # Luma less the tape's part in it: tape shows none, nor does a thick tape's dark rim.
    own = LUMA - tape * (tape @ LUMA) / (tape @ tape)
    towards = own / (own @ braid)
    linear = cv2.LUT(np.ascontiguousarray(rgb[part]), tone.table)
    return _splined(np.asarray(cv2.transform(linear, np.array([[*towards, 0.0]])), float), part)


def lumas(rgb: Image, tone: Tone, colours: tuple[Array, Array], part: Part) -> Amounts:
    """The amount of braid by luma, in which outlines are found: arguments as of `amounts_of`."""
    luma = cv2.cvtColor(np.ascontiguousarray(rgb[part]), cv2.COLOR_RGB2GRAY)
    return _splined(amount_of_luma(tone, *colours)[np.asarray(luma, np.uint8)].astype(float), part)


def differ_in_luma(colours: tuple[Array, Array]) -> bool:
    """Whether the braid is so much brighter than the tape that luma shows the edge between them."""
    tape, braid = (float(colour @ LUMA) for colour in colours)
    return braid > _BRIGHTER * tape


def blur_of_lens(s: float, in_luma: float) -> float:
    """Blur of an edge less what colour adds to it [px], from its blur and that in luma.

    Colour is softer than luma: a camera's mosaic has it in every second pixel, and most JPEG files
    once more, each joined by straight lines (2/3 px^2 of variance), JPEG's a mean over two pixels
    (1/4 px^2). More than that is the lens', or motion.
    """
    return min(s, max(in_luma, math.sqrt(max(s**2 - _OF_COLOUR, 0.0))))


def _splined(patch: Array, part: Part) -> Amounts:
    patch = np.clip(patch, -_BRIGHTEST, _BRIGHTEST)
    rows, columns = part
    return Amounts(np.asarray(spline_filter(patch, 3, mode="mirror")), columns.start, rows.start)

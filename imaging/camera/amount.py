"""From a pixel's luma to the amount of braid in it, linear in light."""

import numpy as np

from ..arrays import Array, Single
from .tone import Tone

LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, JPEG's own
_BRIGHTEST = 1.6  # amounts above belong to threads that glare; they would pull an edge inward
_DARKEST = -0.5


def amount_of_luma(tone: Tone, cloth: Array, braid: Array) -> Single:
    """The amount q of braid for each value of luma, 0 on cloth and 1 at the braid's median colour.

    A pixel that shows q of braid and 1 - q of cloth has in each colour the light
    b + q (a - b), and its luma is the weighted sum of the three encoded values: a rising function
    of q, inverted here. Luma is used because JPEG keeps it at full resolution.

    Args:
        tone: the camera's tone curve.
        cloth: its colour b, encoded values 0 to 255, shape (3,).
        braid: its colour a, the same.

    Returns:
        q for the values 0 to 255, held at 1.6 above, shape (256,).
    """
    values = np.arange(256.0)
    dark, bright = (np.interp(colour, values, tone.table) for colour in (cloth, braid))
    q = np.linspace(_DARKEST, _BRIGHTEST, 1024)
    light = np.clip(dark + q[:, None] * (bright - dark), 0, 1)
    luma = np.interp(light, tone.table, values) @ LUMA
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(luma), prepend=-1.0) > 0)
    return np.interp(values, luma[rising], q[rising]).astype(np.float32)

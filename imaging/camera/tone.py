"""The tone curve of a camera: from the values of a picture back to light, and to what sends it."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ..arrays import Array, Image, Single

_FEWEST_EXPOSURES = 3
_UNKNOWN_BELOW, _UNKNOWN_ABOVE = 4, 242  # Debevec's weights vanish towards 0 and 255
LUMA = np.array([0.299, 0.587, 0.114])  # ITU-R BT.601, JPEG's own
_BRIGHTEST = 1.6  # amounts above belong to threads that glare; they would pull an edge inward
_DARKEST = -0.5


@dataclasses.dataclass(frozen=True)
class Tone:
    """Linear light of every value of an 8-bit picture, taken to be the same in all three colours.

    Edges are found in linear light: on the encoded values every edge moves outward or inward with
    the lamps. A tone curve that is not the camera's moves the diameter by up to 0.8 px per edge;
    take one from an exposure bracket, or switch the camera to a neutral picture style.

    Attributes:
        table: linear light of the values 0 to 255, never falling, 1 at 255, shape (256,).

    Raises:
        ValueError: another shape, values that are not finite, a curve that falls or is flat.
    """

    table: Array

    def __post_init__(self) -> None:
        table = np.array(self.table, np.float64)
        if table.shape != (256,) or not np.all(np.isfinite(table)):
            raise ValueError(f"a tone curve has 256 finite values, got shape {table.shape}")
        fall = np.diff(table).min()
        if fall < 0 or not table[-1] > table[0]:
            raise ValueError(
                "a tone curve never falls and rises over its whole; its steepest fall is "
                f"{fall:.3g} at value {int(np.argmin(np.diff(table)))}"
            )
        table = table / table[-1]
        table.setflags(write=False)
        object.__setattr__(self, "table", table)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Tone) and np.array_equal(self.table, other.table)

    def __hash__(self) -> int:
        return hash(self.table.tobytes())

    @classmethod
    def srgb(cls) -> "Tone":
        """The sRGB curve, which a camera's neutral picture style approaches.

        E = v / 12.92 up to v = 0.04045, ((v + 0.055) / 1.055)^2.4 above.

        References:
            IEC 61966-2-1:1999, equations 5 and 6.
        """
        v = np.arange(256) / 255
        return cls(np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4))

    @classmethod
    def from_exposures(cls, images: Sequence[Image], times_s: Sequence[float]) -> "Tone":
        """The tone curve from pictures of one still scene at several exposure times.

        Debevec's least squares on each colour, averaged in the logarithm, made monotone by the
        nearest non-falling curve and continued below value 4 (a straight line to 0) and above value
        242 (a parabola through the 32 values before), where his weights vanish. Good to a few
        percent of the light.

        Args:
            images: RGB, dtype uint8, all of one shape (h, w, 3), nothing in them moving.
            times_s: exposure times [s], one for each, not all alike.

        Raises:
            ValueError: fewer than 3 pictures, other shapes, times that do not fit.

        References:
            Debevec and Malik 1997, equations 3 and 4.
        """
        import cv2  # noqa: PLC0415 - heavy, and needed here only
        from scipy.optimize import isotonic_regression  # noqa: PLC0415

        times = np.asarray(times_s, np.float32)
        shapes = {image.shape for image in images}
        if len(images) < _FEWEST_EXPOSURES or times.shape != (len(images),):
            raise ValueError(
                f"an exposure bracket has at least {_FEWEST_EXPOSURES} pictures and one time for "
                f"each; got {len(images)} pictures and times of shape {times.shape}"
            )
        if len(shapes) != 1 or np.unique(times).size == 1 or not np.all(times > 0):
            raise ValueError(
                f"the pictures must have one shape and differ in exposure time > 0; got the shapes "
                f"{sorted(shapes)} and the times {times.tolist()} s"
            )
        response = cv2.createCalibrateDebevec(samples=200).process(list(images), times)
        light = np.exp(np.log(np.maximum(response.reshape(256, 3), 1e-12)).mean(axis=1))
        values = np.arange(256.0)
        known = slice(_UNKNOWN_BELOW, _UNKNOWN_ABOVE + 1)
        rising = isotonic_regression(light[known]).x
        top = np.polynomial.Polynomial.fit(values[known][-32:], rising[-32:], 2)
        table = np.interp(values, [0.0, *values[known]], [0.0, *rising])
        beyond = slice(_UNKNOWN_ABOVE + 1, None)
        table[beyond] = np.maximum.accumulate(np.maximum(top(values[beyond]), rising[-1]))
        return cls(table)

    def linear(self, image: ArrayLike) -> Array:
        """Linear light of an 8-bit picture, 1 at value 255, of its shape.

        Raises:
            ValueError: the picture is not of dtype uint8.
        """
        image = np.asarray(image)
        if image.dtype != np.uint8:
            raise ValueError(f"a tone curve is that of 8-bit values, got dtype {image.dtype}")
        return self.table[image]


def amount_of_luma(tone: Tone, cloth: Array, braid: Array) -> Single:
    """The amount q of braid for each value of luma, 0 on cloth and 1 at the braid's median colour.

    Luma is used because JPEG keeps it at full resolution.

    Args:
        tone: the camera's tone curve.
        cloth: its colour b, encoded values 0 to 255, shape (3,).
        braid: its colour a, the same.

    Returns:
        q for the values 0 to 255, held at 1.6 above, shape (256,).
    """
    dark, bright = (np.interp(colour, np.arange(256.0), tone.table) for colour in (cloth, braid))
    return amount_of_look(tone, dark, bright, LUMA)


def amount_of_look(tone: Tone, background: Array, muscle: Array, look: Array) -> Single:
    """The amount q of muscle for each value of a weighted sum of the colours, see `amount_of_luma`.

    A pixel that shows q of muscle and 1 - q of background has in each colour the light b + q (a - b),
    and the sum is that of the three encoded values: a rising or falling function of q, inverted here.
    A muscle that is darker counts as 1 where no light is left of its colour: its own limb may be
    darker than the most of it.

    Args:
        tone: the camera's tone curve.
        background: linear light b of its colours, shape (3,).
        muscle: linear light a, the same.
        look: weights of the colours, shape (3,).
    """
    values, most = np.arange(256.0), _BRIGHTEST
    falls = background - muscle
    if float(muscle @ look) < float(background @ look):
        most = float(np.min(background[falls > 0] / falls[falls > 0]))
    q = np.linspace(_DARKEST, most, 1024)
    light = np.clip(background + q[:, None] * (muscle - background), 0, 1)
    seen = np.interp(light, tone.table, values) @ look
    if seen[-1] < seen[0]:
        seen, q = seen[::-1], q[::-1] / most
    rising = np.flatnonzero(np.diff(np.maximum.accumulate(seen), prepend=-1.0) > 0)
    return np.interp(values, seen[rising], q[rising]).astype(np.float32)

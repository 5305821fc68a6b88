"""The shape sampled over position, length and pressure, as a campaign of photographs gives it."""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float

from .._compiled import compiled_method
from .._types import Given, Real, RealArray, as_real
from ..braids.inextensible import AbstractBraid
from ..parameters import number
from .family import AbstractMeasuredFamily
from .spline import slope_matrix


class SampledSurface(AbstractMeasuredFamily):
    """Cubic splines along the axis and over the length, a line in the pressure.

    What pressure does to the threads was measured with the shape, so that the braid scales nothing
    here; it gives turns and thread length. Beyond the first and last length the end cubics go on, by
    `margin` of the range; beyond that the shape is not known, and nan. Beyond the pressures the line
    goes on.

    Attributes:
        lengths: active lengths L [m], decreasing as the muscle contracts, shape (lengths,), >= 2.
        pressures: gauge pressures [Pa], rising, shape (1,) or (2,); one for a shape that does not
            depend on them.
        diameters: D [m] at x = 0, 1/(n - 1), ..., 1, shape (pressures, lengths, stations).
        braid: of the threads.
        margin: extrapolation at either end, as part of the range of lengths.

    Raises:
        ValueError: shapes that do not match; on concrete numbers lengths that do not fall, pressures
            that do not rise, or diameters that are not positive.

    References:
        de Boor 1978, chapters IV and XVII.
    """

    lengths: Float[Given, " lengths"] = number("m")
    pressures: Float[Given, " pressures"] = number("Pa")
    diameters: Float[Given, "pressures lengths stations"] = number("m")
    braid: AbstractBraid
    margin: float = eqx.field(static=True, default=0.05)

    def __check_init__(self) -> None:
        shape = (self.pressures.size, self.lengths.size)
        if self.diameters.ndim != 3 or self.diameters.shape[:2] != shape:
            raise ValueError(
                f"diameters must have the shape (pressures, lengths, stations), here {shape} and the "
                f"stations, got {self.diameters.shape}"
            )
        if self.pressures.size not in (1, 2) or min(*self.diameters.shape[1:]) < 2:
            raise ValueError(
                "a surface needs one or two pressures, and two lengths and stations or more, got "
                f"diameters of {self.diameters.shape}"
            )
        if not 0 <= self.margin <= 0.25:
            raise ValueError(f"margin is a part of the range, 0 to 0.25, got {self.margin}")
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        if not (np.all(np.diff(self.lengths) < 0) and np.all(np.diff(self.pressures) > 0)):
            raise ValueError(
                f"lengths must fall and pressures rise, got {np.asarray(self.lengths)} m and "
                f"{np.asarray(self.pressures)} Pa"
            )
        if not np.all(np.asarray(self.diameters) > 0):
            raise ValueError(
                "every diameter of a surface must be > 0; leave out what was not measured"
            )

    def middle_pressure(self) -> RealArray:
        """Mean of the pressures [Pa]."""
        return jnp.mean(self.pressures)

    @property
    def kinks(self) -> Float[Array, " kinks"]:
        """None: slope and curvature are continuous."""
        return jnp.zeros(0, self.diameters.dtype)

    @compiled_method
    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Braid diameter D [m], broadcast shape; nan outside `length_range`.

        Args:
            x: position [-] in [0, 1].
            length: active length L [m].
            pressure: gauge pressure P [Pa].

        Returns:
            D [m], broadcast shape.
        """
        # Not made of one shape: the weights of a length serve all positions, and what is at a position
        # serves all lengths.
        x, length, pressure = as_real(x), as_real(length), as_real(pressure)
        cells = self.diameters.shape[-1] - 1
        cell = jnp.clip(jnp.floor(x * cells).astype(int), 0, cells - 1)
        t = (x * cells - cell)[..., None]
        values = self.diameters
        slopes = values @ _station_slopes(cells).T.astype(values.dtype)
        weights = self._cardinals(length, slope_matrix(self._share(self.lengths)))
        along = [
            jnp.sum(
                weights
                * (
                    (1 + 2 * t) * (1 - t) ** 2 * D.T[cell]
                    + t**2 * (3 - 2 * t) * D.T[cell + 1]
                    + t * (1 - t) * ((1 - t) * slope.T[cell] - t * slope.T[cell + 1])
                ),
                axis=-1,
            )
            for D, slope in zip(values, slopes, strict=True)
        ]
        if len(along) == 1:
            return jnp.broadcast_to(along[0], jnp.broadcast_shapes(along[0].shape, pressure.shape))
        low, high = self.pressures
        return along[0] + (pressure - low) / (high - low) * (along[1] - along[0])


@functools.cache
def _station_slopes(cells: int) -> np.ndarray:
    """Slopes [1/cell] of the spline at its evenly spaced knots, as a matrix on the values there."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 -- 0.2 s, for these surfaces alone

    knots = np.arange(cells + 1.0)
    return CubicSpline(knots, np.eye(cells + 1))(knots, 1)

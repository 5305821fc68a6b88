"""Measured shapes: profiles interpolated in length and pressure."""

import abc
import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_real, compiled_method
from .braids import AbstractBraid, diameter_from_length
from .parameters import Parametrised, number
from .profiles import AbstractProfile


def b_splines(
    knots: Float[Array, " knots"], degree: int, at: Float[Array, "..."]
) -> Float[Array, "... splines"]:
    """Return the B-splines of a knot vector at any points; the end pieces are continued beyond the ends.

    N_i,d = (x - t_i)/(t_i+d - t_i) N_i,d-1 + (t_i+d+1 - x)/(t_i+d+1 - t_i+1) N_i+1,d-1

    Args:
        knots: t, increasing; the first and the last knot occur degree + 1 times.
        degree: d >= 1.
        at: x, any shape.

    References:
        de Boor 1978, chapter X.
    """
    cell = jnp.searchsorted(knots, at, side="right") - 1
    cell = jnp.clip(cell, degree, knots.size - degree - 2)
    found = jax.nn.one_hot(cell, knots.size - 1, dtype=knots.dtype)
    x = at[..., None]
    for d in range(1, degree + 1):
        width = knots[d:] - knots[:-d]
        rate = jnp.where(width > 0, 1 / jnp.where(width > 0, width, 1.0), 0.0)
        rising = (x - knots[: -d - 1]) * rate[:-1] * found[..., :-1]
        found = rising + (knots[d + 1 :] - x) * rate[1:] * found[..., 1:]
    return found


def cardinal_splines(
    knots: Float[Array, " knots"], at: Float[Array, "..."]
) -> Float[Array, "... knots"]:
    """Return the splines that are 1 at one knot and 0 at all other knots.

    The splines are cubic, with the not-a-knot condition. With three knots, they are parabolas; with two,
    straight lines.

    Args:
        knots: increasing positions of the knots.
        at: points, any shape; the end cubics are continued beyond the ends.

    References:
        de Boor 1978, chapter IV.
    """
    degree = min(3, knots.size - 1)
    first, last = (jnp.repeat(end, degree + 1) for end in (knots[:1], knots[-1:]))
    every = jnp.concatenate([first, knots[2:-2], last])
    return b_splines(every, degree, at) @ jnp.linalg.inv(b_splines(every, degree, knots))


class AbstractMeasuredFamily(Parametrised):
    """Profiles D(x, L, P) that were measured over a range of lengths and are unknown outside it.

    Attributes:
        lengths: measured active lengths L [m], decreasing.
        braid: braid with thread length B(L, P).
        margin: extrapolation allowed at each end, as a fraction of the range of lengths.
    """

    lengths: eqx.AbstractVar[Float[Array, " profiles"]]
    braid: eqx.AbstractVar[AbstractBraid]
    margin: eqx.AbstractVar[float]

    def _check_range(self) -> None:
        if not 0 <= self.margin <= 0.25:
            raise ValueError(
                "margin must be a fraction of the measured range, between 0 and 0.25; got "
                f"{self.margin}. A cubic cannot predict the shape beyond that: measure at more lengths"
            )
        if not isinstance(self.lengths, Tracer) and not np.all(np.diff(self.lengths) < 0):
            raise ValueError(
                f"lengths must decrease from profile to profile, got {np.asarray(self.lengths)} m"
            )

    @abc.abstractmethod
    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Return the braid diameter D [m], with the broadcast shape; nan outside `length_range`.

        Args:
            x: position [-] in [0, 1].
            length: active length L [m].
            pressure: gauge pressure P [Pa].
        """

    @abc.abstractmethod
    def middle_pressure(self) -> RealArray:
        """Return a pressure [Pa] at which the shape was measured, or the mean of two such pressures."""

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest length [m] of the measured range, extended by the margin."""
        longest, shortest = self.lengths[0], self.lengths[-1]
        beyond = self.margin * (longest - shortest)
        return shortest - beyond, longest + beyond

    def knows(self, length: Real) -> Bool[Array, "..."]:
        """Return True for a length [m] within `length_range`, ends included."""
        share, rounding = self._share(length), 16 * jnp.finfo(self.lengths.dtype).eps
        return (share >= -self.margin - rounding) & (share <= 1 + self.margin + rounding)

    def _share(self, length: Real) -> RealArray:
        """Return the position in the measured range, from 0 at the longest length to 1 at the shortest."""
        return (self.lengths[0] - length) / (self.lengths[0] - self.lengths[-1])

    def _cardinals(self, length: RealArray) -> Float[Array, "... profiles"]:
        """Return the cardinal splines phi_k(L), shape (..., profiles); nan beyond the margin."""
        cardinals = cardinal_splines(self._share(self.lengths), self._share(length))
        return jnp.where(self.knows(length)[..., None], cardinals, jnp.nan)


class MeasuredFamily(AbstractMeasuredFamily):
    """Profiles measured at one pressure and several lengths, interpolated in length.

    D(x, L, P) = (sum over k of phi_k(L) D_k(x)) D_braid(L, B(L, P)) / D_braid(L, B(L, P_ref))

    The diameters at each x are interpolated in L by a cubic spline (`cardinal_splines`), which reproduces
    the measured shapes exactly at P_ref. At other pressures, they are scaled by the ratio D_braid(P) /
    D_braid(P_ref) from the braid's triangle relation. For an inelastic braid, this ratio is 1.

    At each end, the spline is extrapolated by the fraction `margin` of the measured range of lengths. This
    is enough to reach a free contraction just beyond the last photograph. Beyond that, the result is nan.

    Attributes:
        lengths: L_k [m], decreasing, shape (profiles,).
        profiles: D_k(x), one for each length, at least two.
        reference_pressure: gauge pressure P_ref [Pa] during the measurement.
        braid: braid with thread length B(L, P).
        margin: extrapolation allowed at each end, as a fraction of the range of lengths.

    Raises:
        ValueError: lengths and profiles do not match, or lengths do not decrease. A geometry that uses
            the family raises an error if a diameter is not positive.

    References:
        Chambers 2021, section 4.3 (profiles); de Boor 1978, chapter IV (interpolation).
    """

    lengths: Float[Given, " profiles"] = number("m")
    profiles: tuple[AbstractProfile, ...] = eqx.field(converter=tuple)
    reference_pressure: Float[Given, ""] = number("Pa")
    braid: AbstractBraid
    margin: float = eqx.field(static=True, default=0.05)

    def __check_init__(self) -> None:
        if self.lengths.shape != (len(self.profiles),) or len(self.profiles) < 2:
            raise ValueError(
                "a family needs at least two profiles and one length for each, got "
                f"{len(self.profiles)} profiles and lengths with shape {self.lengths.shape}"
            )
        self._check_range()

    @compiled_method
    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Return the braid diameter D [m] at x [-], length [m] and pressure [Pa]; arguments broadcast."""
        x, length = as_real(x), as_real(length)
        pairs = zip(self.profiles, self.lengths, strict=True)
        measured = jnp.stack([profile.diameter(x, at) for profile, at in pairs], axis=-1)
        interpolated = jnp.sum(self._cardinals(length) * measured, axis=-1)
        stretched, reference = (
            diameter_from_length(length, self.braid.thread_length(length, P), self.braid.turns)
            for P in (pressure, self.reference_pressure)
        )
        return interpolated * (stretched / reference)

    def middle_pressure(self) -> RealArray:
        """Return P_ref [Pa]."""
        return self.reference_pressure


class SampledSurface(AbstractMeasuredFamily):
    """A measured shape, interpolated by cubic splines in position and length and linearly in pressure.

    The measured shape already includes the stretch of the threads, so the braid does not scale the
    diameters; it only provides turns and thread length. In length, the spline is extrapolated at each end
    by the fraction `margin` of the range; beyond that, the result is nan. In pressure, the extrapolation
    is linear.

    Attributes:
        lengths: at least two active lengths L [m], decreasing, shape (lengths,).
        pressures: increasing gauge pressures [Pa], shape (1,) or (2,); one if the shape does not depend on
            the pressure.
        diameters: D [m] at x = 0, 1/(n - 1), ..., 1, shape (pressures, lengths, stations).
        braid: braid of the muscle.
        margin: extrapolation allowed at each end, as a fraction of the range of lengths.

    Raises:
        ValueError: shapes do not match, lengths do not decrease, pressures do not increase, or a
            diameter is not positive. Traced values are not checked.
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
                f"diameters must have the shape (pressures, lengths, stations), here beginning with "
                f"{shape}; got {self.diameters.shape}"
            )
        if self.pressures.size not in (1, 2) or min(*self.diameters.shape[1:]) < 2:
            raise ValueError(
                "a surface needs one or two pressures, and at least two lengths and stations; got "
                f"diameters with shape {self.diameters.shape}"
            )
        self._check_range()
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        if not (np.all(np.diff(self.pressures) > 0) and np.all(np.asarray(self.diameters) > 0)):
            raise ValueError(
                "pressures must increase and every diameter must be > 0; omit states that were not "
                "measured"
            )

    def middle_pressure(self) -> RealArray:
        """Return the mean of the pressures [Pa]."""
        return jnp.mean(self.pressures)

    @compiled_method
    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Return the braid diameter D [m] at x [-], length [m] and pressure [Pa]; arguments broadcast."""
        # Not broadcast first: the splines of lengths and of positions are smaller apart.
        x, length, pressure = as_real(x), as_real(length), as_real(pressure)
        knots, degree, inverse = _even_splines(self.diameters.shape[-1])
        dtype = self.diameters.dtype
        at = b_splines(jnp.asarray(knots, dtype), degree, x) @ inverse.astype(dtype)
        weights = self._cardinals(length)
        along = [jnp.sum(weights * (at @ D.T), axis=-1) for D in self.diameters]
        if len(along) == 1:
            return jnp.broadcast_to(along[0], jnp.broadcast_shapes(along[0].shape, pressure.shape))
        low, high = self.pressures
        return along[0] + (pressure - low) / (high - low) * (along[1] - along[0])


@functools.cache
def _even_splines(stations: int) -> tuple[np.ndarray, int, np.ndarray]:
    """Return knots, degree and coefficients of the cardinal splines for evenly spaced stations."""
    from scipy.interpolate import make_interp_spline  # noqa: PLC0415 -- 0.2 s, only for a surface

    degree = min(3, stations - 1)
    spline = make_interp_spline(np.linspace(0, 1, stations), np.eye(stations), k=degree)
    return spline.t, degree, spline.c

"""Families of profiles over contraction and pressure: measured and interpolated, or assumed."""

import abc
import functools
from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_real, compiled, compiled_method
from .braids import AbstractBraid, diameter_from_length
from .parameters import Parametrised, number
from .profiles import AbstractAssumedShape, AbstractProfile, cardinal_splines, slope_matrix


class AbstractProfileFamily(Parametrised):
    """Diameter D at position x, active length L and gauge pressure P."""

    @abc.abstractmethod
    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Braid diameter D [m] at position x [-], length [m] and pressure [Pa], broadcast shape."""

    @abc.abstractmethod
    def breakpoints(self, length: Real, pressure: Real) -> Float[Array, "... kinks"]:
        """Increasing positions x [-] between 0 and 1 at which slope or diameter is discontinuous."""

    def at(self, pressure: Real) -> "IsobaricProfile":
        """Return the profile at one gauge pressure [Pa], a scalar."""
        return IsobaricProfile(self, pressure)


class IsobaricProfile(AbstractProfile):
    """A family of profiles at one pressure.

    Attributes:
        family: D(x, L, P).
        pressure: P [Pa], a scalar.
    """

    family: AbstractProfileFamily
    pressure: Float[Given, ""] = number("Pa")

    def diameter(self, x: Real, length: Real) -> RealArray:
        """Braid diameter D [m] at position x [-] of active length L [m], broadcast shape."""
        return self.family.diameter(x, length, self.pressure)

    def breakpoints(self, length: Real) -> Float[Array, "... kinks"]:
        """Positions x [-] of the family's kinks at active length L [m] and this pressure."""
        return self.family.breakpoints(length, self.pressure)


class AssumedShapeFamily(AbstractProfileFamily):
    """An assumed shape whose middle diameter follows from the braid's triangle relation.

    D_m = sqrt(B(L, P)^2 - L^2) / (pi N), as if the threads ran straight from fitting to fitting.

    Attributes:
        braid: braid with thread length B and turns N.
        shape: assumed shape; its own middle diameter is replaced.
    """

    braid: AbstractBraid
    shape: AbstractAssumedShape

    def diameter(self, x: Real, length: Real, pressure: Real) -> RealArray:
        """Braid diameter D [m] at position x [-], length [m] and pressure [Pa], broadcast shape."""
        return self._shape_at(length, pressure).diameter(x, length)

    def breakpoints(self, length: Real, pressure: Real) -> Float[Array, "... kinks"]:
        """Positions x [-] of the shape's kinks."""
        return self._shape_at(length, pressure).breakpoints(length)

    def _shape_at(self, length: Real, pressure: Real) -> AbstractAssumedShape:
        thread_length = self.braid.thread_length(length, pressure)
        middle = diameter_from_length(length, thread_length, self.braid.turns)
        return eqx.tree_at(lambda shape: shape.middle_diameter, self.shape, middle)


class AbstractMeasuredFamily(AbstractProfileFamily):
    """Profiles measured over a range of lengths and unknown outside it.

    Attributes:
        lengths: measured active lengths L [m], decreasing.
        braid: braid with thread length B(L, P).
        margin: extrapolation at each end, as a fraction of the range of lengths.
    """

    lengths: eqx.AbstractVar[Float[Array, " profiles"]]
    braid: eqx.AbstractVar[AbstractBraid]
    margin: eqx.AbstractVar[float]

    @abc.abstractmethod
    def middle_pressure(self) -> RealArray:
        """A pressure [Pa] at which the shape is known."""

    @property
    @abc.abstractmethod
    def kinks(self) -> Float[Array, " kinks"]:
        """Increasing positions x [-] at which any profile has a kink."""

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest length [m]: the measured range, extended by the margin."""
        longest, shortest = self.lengths[0], self.lengths[-1]
        beyond = self.margin * (longest - shortest)
        return shortest - beyond, longest + beyond

    def knows(self, length: Real) -> Bool[Array, "..."]:
        """Return True where a length [m] lies within `length_range`, ends included."""
        share, rounding = self._share(length), 16 * jnp.finfo(self.lengths.dtype).eps
        return (share >= -self.margin - rounding) & (share <= 1 + self.margin + rounding)

    def _share(self, length: Real) -> RealArray:
        """Position in the measured range, from 0 at the longest length to 1 at the shortest."""
        return (self.lengths[0] - length) / (self.lengths[0] - self.lengths[-1])

    def _cardinals(
        self, length: RealArray, slopes: Float[Array, "profiles profiles"]
    ) -> Float[Array, "... profiles"]:
        """Cardinal splines phi_k(L) for a `slope_matrix`, shape (..., profiles); nan beyond the margin."""
        cardinals = cardinal_splines(self._share(self.lengths), slopes, self._share(length))
        return jnp.where(self.knows(length)[..., None], cardinals, jnp.nan)

    def breakpoints(self, length: Real, pressure: Real) -> Float[Array, "... kinks"]:
        """Positions x [-] of all kinks, the same at every length and pressure."""
        del length, pressure
        return self.kinks


class MeasuredFamily(AbstractMeasuredFamily):
    """Profiles measured at one pressure and several lengths, interpolated over the length.

    D(x, L, P) = (sum over k of phi_k(L) D_k(x)) D_braid(L, B(L, P)) / D_braid(L, B(L, P_ref))

    The diameters at each x are interpolated in L by a cubic spline with continuous second derivative
    (not-a-knot; a parabola through three profiles, a line through two). Each phi_k is 1 at its own
    length and 0 at the others, so the family returns the measured shapes exactly at P_ref. At other
    pressures the diameters are scaled by the ratio of the braid's triangle diameters, which is 1 for
    an inelastic braid.

    The end cubics extrapolate by `margin` of the measured range of lengths, enough to reach a free
    contraction just beyond the last photograph. Beyond the margin the result is nan.

    Attributes:
        lengths: L_k [m], decreasing as the muscle contracts, shape (profiles,).
        profiles: D_k(x), at least two.
        reference_pressure: pressure P_ref [Pa] of the measurement.
        braid: braid with thread length B(L, P).
        margin: extrapolation at each end, as a fraction of the range of lengths.

    Raises:
        ValueError: lengths and profiles do not match, or an interpolated diameter is not positive.
            Values are checked only if they are not traced.

    References:
        Chambers 2021, section 4.3 (profiles); de Boor 1978, chapter IV (interpolation).
    """

    lengths: Float[Given, " profiles"] = number("m")
    profiles: tuple[AbstractProfile, ...]
    reference_pressure: Float[Given, ""] = number("Pa")
    braid: AbstractBraid
    margin: float = eqx.field(static=True)
    _slopes: Float[Array, "profiles profiles"]

    def __init__(
        self,
        lengths: Real | Sequence[float],
        profiles: Sequence[AbstractProfile],
        reference_pressure: Real,
        braid: AbstractBraid,
        *,
        margin: float = 0.05,
    ) -> None:
        """See the class; profiles and lengths have the same order."""
        self.lengths = as_real(lengths)
        self.profiles = tuple(profiles)
        self.reference_pressure = as_real(reference_pressure)
        self.braid = braid
        self.margin = margin
        if self.lengths.shape != (len(self.profiles),) or len(self.profiles) < 2:
            raise ValueError(
                "a family needs at least two profiles and one length for each, got "
                f"{len(self.profiles)} profiles and lengths with shape {self.lengths.shape}"
            )
        if not 0 <= margin <= 0.25:
            raise ValueError(
                f"margin is a fraction of the measured range between 0 and 0.25, got {margin}: a cubic "
                "cannot predict the shape further out. Measure more lengths instead"
            )
        if not isinstance(self.lengths, Tracer) and not jnp.all(jnp.diff(self.lengths) < 0):
            raise ValueError(
                "the lengths of a family must decrease from profile to profile, got "
                f"{np.asarray(self.lengths)}"
            )
        self._slopes = slope_matrix(self._share(self.lengths))

    def __check_init__(self) -> None:
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        x, lengths = jnp.linspace(0, 1, 129), jnp.linspace(*self.length_range(), 33)
        diameter = np.asarray(_diameters(self, x, lengths))
        if not np.all(diameter > 0):
            row, column = np.unravel_index(np.argmin(diameter), diameter.shape)
            raise ValueError(
                "the diameter of a family must be > 0 at every length and position; it is "
                f"{diameter[row, column]:.4g} at L = {lengths[row]:.4g}, x = {x[column]:.3f}. "
                "Check the profile measured nearest to that length, the margin, and that the threads "
                "are longer than the active length"
            )

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
        x, length = as_real(x), as_real(length)
        pairs = zip(self.profiles, self.lengths, strict=True)
        measured = jnp.stack([profile.diameter(x, at) for profile, at in pairs], axis=-1)
        interpolated = jnp.sum(self._cardinals(length, self._slopes) * measured, axis=-1)
        stretched, reference = (
            diameter_from_length(length, self.braid.thread_length(length, P), self.braid.turns)
            for P in (pressure, self.reference_pressure)
        )
        return interpolated * (stretched / reference)

    def middle_pressure(self) -> RealArray:
        """P_ref [Pa]."""
        return self.reference_pressure

    @property
    def kinks(self) -> Float[Array, " kinks"]:
        """Positions x [-] at which any measured profile has a kink."""
        pairs = zip(self.profiles, self.lengths, strict=True)
        return jnp.sort(jnp.concatenate([profile.breakpoints(at) for profile, at in pairs]))


@compiled
def _diameters(family: MeasuredFamily, x: RealArray, lengths: RealArray) -> RealArray:
    """Diameters [m] at the reference pressure, shape (lengths, positions)."""
    return family.diameter(x, lengths[:, None], family.reference_pressure)


class SampledSurface(AbstractMeasuredFamily):
    """A measured shape, interpolated by cubic splines in position and length and linearly in pressure.

    The measured shape already includes the stretch of the threads, so the braid does not scale the
    diameters; it only provides turns and thread length. The end cubics extrapolate in length by
    `margin` of the range; beyond it the result is nan. In pressure the extrapolation is linear.

    Attributes:
        lengths: active lengths L [m], decreasing as the muscle contracts, shape (lengths,), >= 2.
        pressures: increasing gauge pressures [Pa], shape (1,) or (2,); one for a shape that does not
            depend on the pressure.
        diameters: D [m] at x = 0, 1/(n - 1), ..., 1, shape (pressures, lengths, stations).
        braid: braid of the muscle.
        margin: extrapolation at each end, as a fraction of the range of lengths.

    Raises:
        ValueError: shapes do not match, lengths do not decrease, pressures do not increase, or a
            diameter is not positive. Values are checked only if they are not traced.

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
                f"diameters must have the shape (pressures, lengths, stations), which begins with "
                f"{shape}; got {self.diameters.shape}"
            )
        if self.pressures.size not in (1, 2) or min(*self.diameters.shape[1:]) < 2:
            raise ValueError(
                "a surface needs one or two pressures, and at least two lengths and stations; got "
                f"diameters with shape {self.diameters.shape}"
            )
        if not 0 <= self.margin <= 0.25:
            raise ValueError(
                f"margin is a fraction of the range between 0 and 0.25, got {self.margin}"
            )
        if any(isinstance(leaf, Tracer) for leaf in jax.tree.leaves(self)):
            return
        if not (np.all(np.diff(self.lengths) < 0) and np.all(np.diff(self.pressures) > 0)):
            raise ValueError(
                f"lengths must decrease and pressures increase, got {np.asarray(self.lengths)} m and "
                f"{np.asarray(self.pressures)} Pa"
            )
        if not np.all(np.asarray(self.diameters) > 0):
            raise ValueError(
                "every diameter of a surface must be > 0; omit states that were not measured"
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
        # Not broadcast first: spline weights depend only on the length, cell terms only on x.
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
    """Matrix from values at evenly spaced knots to slopes [1/cell] of the spline there."""
    from scipy.interpolate import CubicSpline  # noqa: PLC0415 -- 0.2 s, for these surfaces alone

    knots = np.arange(cells + 1.0)
    return CubicSpline(knots, np.eye(cells + 1))(knots, 1)

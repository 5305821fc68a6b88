"""Continue a force model safely beyond its data, so that the force is C1, monotone and never negative."""

import functools
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_number, as_real, compiled, compiled_method
from .boundary.errors import InputError
from .compile_options import quick_jit
from .muscle import AbstractMuscle
from .slip import CentredSlip, SlipState

_STRAIGHT = 0.8  # linear fraction of the saturation


def bent(step: Real, ends: Float[Array, "2"]) -> RealArray:
    """Saturate a step smoothly: linear up to four fifths of a limit X, which is never exceeded.

    y = x for |x| <= 4/5 X. Beyond that, |y| = X (4/5 + t/(5 (1 + t))), t = 5 |x|/X - 4, and y has the
    sign of x. The function is C1, with a positive slope everywhere.

    Args:
        step: x, any shape.
        ends: 1/X for negative and for positive steps, >= 0, shape (2,); zero for no limit.

    Returns:
        y, with the unit and shape of x.
    """
    inverse = jnp.where(step < 0, ends[0], ends[1])
    way = inverse * jnp.abs(step)
    t = jnp.maximum(way - _STRAIGHT, 0.0) / (1 - _STRAIGHT)
    beyond = _STRAIGHT + (1 - _STRAIGHT) * t / (1 + t)
    limited = way > _STRAIGHT
    return jnp.where(limited, jnp.sign(step) * beyond / jnp.where(limited, inverse, 1.0), step)


def taut(force: RealArray, width: RealArray) -> RealArray:
    """Clip a force at zero, with a smooth cubic transition between 0 and a width [N].

    F = w (2 t^2 - t^3), t = G/w: exactly zero for G <= 0 and exactly G for G >= w, C1 and monotone.
    F is below G by at most 0.15 w.

    Args:
        force: G [N], negative if the model pushes.
        width: w [N], > 0.

    Returns:
        F [N], >= 0.
    """
    t = jnp.clip(force / width, 0.0, 1.0)
    return jnp.asarray(jnp.where(force >= width, force, width * t**2 * (2 - t)))


def stopped(step: RealArray, stiffness: RealArray, onset: RealArray) -> RealArray:
    """Return an end stop's force [N] at penetration x [m]: zero for x <= 0, C1, with bounded stiffness.

    F = k x^2/(2 s) for x < s, and k (x - s/2) beyond.

    Args:
        step: penetration x [m], any shape.
        stiffness: k [N/m], > 0.
        onset: penetration s [m], > 0, over which the stiffness rises to k.
    """
    on = jnp.clip(step, 0.0, onset)
    return stiffness * (on**2 / (2 * onset) + jnp.maximum(step - onset, 0.0))


def untaut(force: RealArray, width: RealArray) -> RealArray:
    """Return the G [N] for which `taut` returns a force F [N] >= 0; zero for F = 0, nan for F < 0.

    G/w is the middle root of 2 t^2 - t^3 = F/w, t = (2 + 4 cos(arccos(1 - 27 F/(16 w))/3 - 2 pi/3))/3.
    """
    part = force / width
    blended = (part > 0) & (part < 1)
    angle = jnp.arccos(1 - 27 / 16 * jnp.where(blended, part, 0.5)) / 3
    t = (2 + 4 * jnp.cos(angle - 2 * jnp.pi / 3)) / 3
    return jnp.where(blended, width * t, jnp.where(force >= 0, force, jnp.nan))


LENGTHS, PRESSURES = 33, 65
"""Numbers of lengths and pressures in the grid on which the model is checked."""


class Region(eqx.Module):
    """A rectangular region of lengths and pressures.

    Attributes:
        length: shortest and longest active length [m], shape (2,).
        pressure: lowest and highest gauge pressure [Pa], shape (2,).
    """

    length: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure: Float[Given, "2"] = eqx.field(converter=as_number)

    @classmethod
    def of(cls, length: Sequence[float] | np.ndarray, pressure: Sequence[float] | np.ndarray):
        """Return the smallest region that contains these lengths [m] and pressures [Pa].

        Raises:
            InputError: lengths or pressures are negative, not finite, or all equal.
        """
        L, P = np.asarray(length, float), np.asarray(pressure, float)
        for name, values, unit in (("lengths", L, "m"), ("pressures", P, "Pa")):
            if not (values.size and np.isfinite(values).all() and values.min() >= 0):
                raise InputError(f"{name} must be finite and >= 0, got {values} {unit}")
            if not values.max() > values.min():
                raise InputError(f"a region needs two different {name}, got {values} {unit}")
        return cls([L.min(), L.max()], [P.min(), P.max()])


class Slopes(NamedTuple):
    """A force and its derivatives, all with the same shape.

    Attributes:
        force: F [N].
        stiffness: dF/dL [N/m].
        area: dF/dP [m2].
        stiffening: d2F/dLdP [m].
    """

    force: Any  # arrays of NumPy or JAX
    stiffness: Any
    area: Any
    stiffening: Any


def slopes(force: Callable, length: RealArray, pressure: RealArray) -> Slopes:
    """Return a force and its derivatives at lengths [m] and pressures [Pa] with the same shape."""
    along = jnp.ones_like(length), jnp.ones_like(pressure)

    def in_length(pressure: RealArray) -> tuple[RealArray, RealArray]:
        return jax.jvp(lambda L: force(L, pressure), (length,), along[:1])

    (value, stiffness), (area, stiffening) = jax.jvp(in_length, (pressure,), along[1:])
    return Slopes(value, stiffness, area, stiffening)


def grid_slopes(muscle: AbstractMuscle, region: Region) -> Slopes:
    """Return the force and its derivatives on a grid over a region, shapes (LENGTHS, PRESSURES)."""
    L = jnp.linspace(region.length[0], region.length[1], LENGTHS)
    P = jnp.linspace(region.pressure[0], region.pressure[1], PRESSURES)
    return slopes(muscle.force, *jnp.meshgrid(L, P, indexing="ij"))


def rising(at: Slopes) -> Bool[Array | np.ndarray, "lengths pressures"]:
    """Return a mask of states where the force is finite and does not fall as length or pressure rises."""
    finite = abs(sum(at)) < np.inf
    return finite & (at.stiffness >= 0) & (at.area >= 0)


def slack(at: Slopes) -> Bool[Array, "lengths pressures"]:
    """Return a mask of states that are slack, as are their neighbours on the grid."""
    count, other = at.force.shape
    padded = jnp.pad(jnp.asarray(at.force) <= 0, 1, constant_values=True)
    shifted = [padded[i : i + count, j : j + other] for i in range(3) for j in range(3)]
    return functools.reduce(jnp.logical_and, shifted)


def rising_region(muscle: AbstractMuscle, data: Region) -> tuple[Region, Slopes]:
    """Return the largest part of a region where the force does not fall as length or pressure rises.

    The force is 0 where the muscle is slack, so the model may do anything there, except at the longest
    length and the highest pressure, from which it is continued to states in which the muscle pulls. The
    search covers all rectangles on a grid of 33 lengths and 65 pressures. It runs on the host and cannot
    be traced.

    Args:
        muscle: the model.
        data: region covered by the data.

    Returns:
        (region, force and derivatives on its grid lines).

    Raises:
        InputError: the largest such rectangle has fewer than two cells in length or in pressure.
    """
    at = Slopes(*(np.asarray(one) for one in _grid_slopes(muscle, data)))
    rises = np.asarray(rising(at))
    for good in (rises | np.asarray(slack(at)), rises):
        (i0, i1), (j0, j1) = (
            _inner(low, high, count - 1)
            for (low, high), count in zip(largest_block(good), good.shape, strict=True)
        )
        if rises[i1, j0 : j1 + 1].all() and rises[i0 : i1 + 1, j1].all():
            break
    if (i1 - i0 + 1, j1 - j0 + 1) == rises.shape:
        return data, at
    L = np.linspace(float(data.length[0]), float(data.length[1]), LENGTHS)
    P = np.linspace(float(data.pressure[0]), float(data.pressure[1]), PRESSURES)
    if min(i1 - i0, j1 - j0) < 2:
        raise InputError(
            "the model cannot be continued safely beyond its data: its force must rise with length and "
            f"pressure, but does so at only {good.sum()} of {good.size} states from {L[0]:.4g} to "
            f"{L[-1]:.4g} m and {P[0]:.4g} to {P[-1]:.4g} Pa. Check the model's stiffness and the units"
        )
    part = Slopes(*(one[i0 : i1 + 1, j0 : j1 + 1] for one in at))
    return Region([L[i0], L[i1]], [P[j0], P[j1]]), part


_grid_slopes = quick_jit(grid_slopes)


def largest_share(good: Bool[np.ndarray, "lengths pressures"]) -> float:
    """Return the fraction [-] of the grid cells that lie in the largest rectangle of good states."""
    if good.all():
        return 1.0
    (i0, i1), (j0, j1) = largest_block(good)
    return (i1 - i0) * (j1 - j0) / float(np.prod(np.subtract(good.shape, 1)))


def _inner(low: int, high: int, last: int) -> tuple[int, int]:
    """Shrink a range by one grid line at each end inside the data: the force may fall between lines."""
    return low + (low > 0), high - (high < last)


def largest_block(good: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """Return the first and last grid lines of the largest rectangle of good states."""
    bad = np.pad(np.cumsum(np.cumsum(~good, 0), 1), ((1, 0), (1, 0)))
    best, found = -1, ((0, 0), (0, 0))
    for low in range(good.shape[0]):
        for high in range(low, good.shape[0]):
            strip = bad[high + 1] - bad[low]  # bad states in columns before each
            clean = strip[None, 1:] == strip[:-1, None]  # [first, last]
            first, last = np.nonzero(np.triu(clean))
            if not first.size:
                continue
            k = int(np.argmax(last - first))
            area = (high - low) * int(last[k] - first[k])
            if area > best:
                best, found = area, ((low, high), (int(first[k]), int(last[k])))
    return found


def continued_volume(
    muscle: AbstractMuscle, region: Region, length: Real, pressure: Real
) -> RealArray:
    """Return the volume V [m3] at any length [m] and pressure [Pa]; V is > 0 and C1. Arguments broadcast.

    Inside the region, V is the model's volume. Beyond an edge, the volume is extrapolated linearly if it
    grows. If it shrinks by the fraction s in linear extrapolation, V/(1 + s) is used, which is always > 0.

    Args:
        muscle: the model.
        region: region in which the model's geometry is used unchanged.
        length: active length L [m].
        pressure: gauge pressure P [Pa].
    """
    at = jnp.broadcast_arrays(as_real(length), as_real(pressure))
    return _continued(muscle, region, *at)


@compiled
def _continued(
    muscle: AbstractMuscle, region: Region, length: RealArray, pressure: RealArray
) -> RealArray:
    L = jnp.clip(length, region.length[0], region.length[1])
    P = jnp.clip(pressure, region.pressure[0], region.pressure[1])

    def along(pressure: RealArray) -> RealArray:
        volume, slope = jax.jvp(
            lambda length: muscle.volume(length, pressure), (L,), (jnp.ones_like(L),)
        )
        return _grown(volume, slope * (length - L))

    volume, slope = jax.jvp(along, (P,), (jnp.ones_like(P),))
    return _grown(volume, slope * (pressure - P))


def _grown(volume: RealArray, change: RealArray) -> RealArray:
    """Return V + dV for dV >= 0, else V/(1 - dV/V)."""
    shrunk = volume / (1 - jnp.minimum(change, 0.0) / volume)
    return jnp.where(change < 0, shrunk, volume + change)


# Travel, relative to the rest length, at which a stop carries the region's largest force.
_STOP = 0.01
_ONSET = _STOP / 2
_AT_ONCE = 1e12  # 1/m and 1/Pa: allows no step
_SPARE = 1.05  # safety factor for values between grid lines


class ContinuedMuscle(AbstractMuscle):
    """A model that is unchanged inside a region and extrapolated outside it; not clipped at zero.

        H(L, P) = F(L_c, P) + F_L(L_c, P) y(L - L_c)                  L_c: L clipped to the region
        G(L, P) = H(L, P_c) + H_P(L, P_c) y(P - P_c) + S(L)           P_c: P clipped to the region

    Inside the region, G equals the model's force F to the last bit. G is C1 across every edge where the
    muscle pulls, because F is C2. The step y (see `bent`) is linear unless linear extrapolation would make
    the stiffness F_L or the area F_P negative while the muscle pulls. In that case, y saturates at a limit
    X that keeps both >= 0. S is the force of two end stops outside the region. The first pulls beyond the
    straight-thread length; the second pushes below the length at which the braid locks. A stop carries
    the region's largest force at a travel of 1 % of the rest length.

    If the model is `rising` on the region's edges where the muscle pulls, then outside the region, wherever
    G > 0, dG/dL >= 0 and dG/dP >= 0. Outside the region, F_L is clipped at zero.

    Attributes:
        muscle: the model.
        region: region in which the model is used unchanged.
        stops: lengths [m] at which the stops begin, shape (2,).
        stop_stiffness: stiffness of the stops [N/m].
        length_ends: 1/X [1/m] for steps below and above the region's lengths, shape (2,).
        pressure_ends: 1/X [1/Pa] for steps below and above the region's pressures, shape (2,).
    """

    muscle: AbstractMuscle
    region: Region
    stops: Float[Given, "2"] = eqx.field(converter=as_number)
    stop_stiffness: Float[Given, ""] = eqx.field(converter=as_number)
    length_ends: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure_ends: Float[Given, "2"] = eqx.field(converter=as_number)

    @compiled_method
    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the continued force G [N] at any length [m] and pressure [Pa]; arguments broadcast.

        G can be negative.
        """
        length, pressure = jnp.broadcast_arrays(as_real(length), as_real(pressure))
        L = jnp.clip(length, self.region.length[0], self.region.length[1])
        P = jnp.clip(pressure, self.region.pressure[0], self.region.pressure[1])
        step = bent(length - L, self.length_ends)

        def along(pressure: RealArray) -> RealArray:
            force, stiffness = jax.jvp(
                lambda length: self.muscle.force(length, pressure), (L,), (jnp.ones_like(L),)
            )
            return force + jnp.maximum(stiffness, 0.0) * step

        force, area = jax.jvp(along, (P,), (jnp.ones_like(P),))
        force += jnp.maximum(area, 0.0) * bent(pressure - P, self.pressure_ends)
        stop = self.stop_stiffness, self.stop_onset
        return (
            force + stopped(length - self.stops[1], *stop) - stopped(self.stops[0] - length, *stop)
        )

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the lengths [m] beyond the stops at which a stop carries four times the largest force."""
        travel = 4 * _STOP * self.muscle.rest_length
        return self.stops[0] - travel, self.stops[1] + travel

    @property
    def stop_onset(self) -> RealArray:
        """Travel [m] over which a stop's stiffness builds up."""
        return _ONSET * self.muscle.rest_length

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m] of the model."""
        return self.muscle.rest_length


def _ends(at: Slopes) -> tuple[np.ndarray, np.ndarray]:
    """Return the values of 1/X that keep area and stiffness >= 0 outside the region."""

    def end(falling: np.ndarray, held: np.ndarray) -> float:
        falls, holds = falling > 0, held > 0
        rate = np.where(falls & holds, falling, 0.0) / np.where(holds, held, 1.0)
        rate = np.where(falls & ~holds, _AT_ONCE, rate)
        return min(_SPARE * rate.max(), _AT_ONCE)

    # Shortened or vented, such a muscle becomes slack before its stiffness or area has fallen to 0.
    K, A, mixed = at.stiffness, at.area, at.stiffening
    before = np.asarray(slack(at)) | (mixed * at.force <= K * A)
    down = np.where(before, 0.0, mixed)
    lengths = np.stack([end(down[0], A[0]), end(-mixed[-1], A[-1])])
    pressures = np.stack([end(down[:, 0], K[:, 0]), end(-mixed[:, -1], K[:, -1])])
    return lengths, pressures


_SLACK = 1e-3  # width of the blend at zero force, relative to the region's largest force


class SafeMuscle(AbstractMuscle):
    """A muscle model for the region of its data, with a passive continuation outside that region.

    F = taut(G). Inside the region, G is the model's force; outside, G is the monotone continuation with end
    stops (`ContinuedMuscle`). `taut` returns 0 for G <= 0 and G above a small force w. At any length and
    pressure, F is finite, >= 0 and C1, and F does not fall as the length increases. At constant pressure,
    the muscle therefore acts as a spring, and no simulation can gain energy from it. Below the length at
    which the braid locks, the muscle does not pull. Beyond the straight-thread length, a stiff stop resists
    further extension.

    With hysteresis, the force also depends on the history, which the caller stores as a state. `start`
    creates the state, `pull` returns the force at the end of a step, and `moved` completes the step. In
    both branches of a loop, the force rises with length, and it is higher while the muscle lengthens.
    Clipping at zero preserves this, so every closed loop dissipates energy. The other methods use the
    static map.

    Attributes:
        continued: model of G, which is not clipped at zero; see `model_force`.
        slack_width: w [N].
        data: region covered by the data; `region` is the part of it in which the model is monotone.
        hysteresis: hysteresis about the static map, or None.

    >>> import famjax
    >>> braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=1.1, length=0.3)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.02, 0.0018, embedded=True))
    >>> muscle = famjax.Muscle(shape, famjax.PolynomialMaterial([6e5, 2e5, 1e5]), 4e4)
    >>> safe = SafeMuscle.of(muscle, length=[0.24, 0.3], pressure=[5e4, 6e5])
    >>> print(f"{safe.force(0.1, 4e5):.0f} {abs(safe.force(0.28, 4e5) - muscle.force(0.28, 4e5)):.2f}")
    0 0.00
    """

    continued: ContinuedMuscle
    slack_width: Float[Array, ""]
    data: Region
    hysteresis: CentredSlip | None = None

    @classmethod
    def of(
        cls,
        muscle: AbstractMuscle,
        length: Sequence[float] | np.ndarray,
        pressure: Sequence[float] | np.ndarray,
        *,
        hysteresis: CentredSlip | None = None,
    ) -> "SafeMuscle":
        """Create a safe muscle from a model.

        Args:
            muscle: the model.
            length: active lengths [m] of the data, or their minimum and maximum.
            pressure: gauge pressures [Pa] of the data, or their minimum and maximum.
            hysteresis: hysteresis about the model's force, or None.

        Raises:
            InputError: the region is invalid, or the model is not monotone; see `rising_region`.
        """
        data = Region.of(length, pressure)
        region, at = rising_region(muscle, data)
        lock, straight = muscle.stops()  # nan, or inside the region, for some models
        stops = jnp.stack([
            jnp.fmin(lock, region.length[0]), jnp.fmax(straight, region.length[1])
        ])  # fmt: skip
        largest = abs(at.force).max()
        stiffness = largest / (_STOP * muscle.rest_length)
        continued = ContinuedMuscle(muscle, region, stops, stiffness, *_ends(at))
        return cls(continued, as_real(_SLACK * largest), data, hysteresis)

    @property
    def region(self) -> Region:
        """Region in which the model is used unchanged."""
        return self.continued.region

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences stating where in the data's region the model is replaced; only for a single muscle."""
        found = []
        for name, unit, scale in (("length", "mm", 1e3), ("pressure", "kPa", 1e-3)):
            had, kept = (
                scale * np.asarray(getattr(one, name), float) for one in (self.data, self.region)
            )
            if (had != kept).any():
                found.append(
                    f"the force of the model rises with length and pressure only for {name}s from "
                    f"{kept[0]:.4g} to {kept[1]:.4g} {unit}; from there to the limits of the data, "
                    f"{had[0]:.4g} and {had[1]:.4g} {unit}, it is replaced by a continuation"
                )
        return tuple(found)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Return the static force F [N] >= 0 at any length [m] and pressure [Pa]; arguments broadcast."""
        return taut(self.continued.force(length, pressure), self.slack_width)

    def model_force(self, length: Real, pressure: Real) -> RealArray:
        """Return the continued force G [N]; arguments broadcast.

        G is not clipped at zero, so it is negative if the muscle is slack.
        """
        return self.continued.force(length, pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Return the shortest and longest active length [m] for the equilibrium search."""
        return self.continued.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Rest length L0 [m] of the model."""
        return self.continued.rest_length

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Return the longest active length L [m] at which the muscle carries a load [N] >= 0.

        The length is found from the continued force G, for which it exists even if the muscle is slack
        over a range of lengths; see `AbstractMuscle.length_at_load`.
        """
        return self.continued.length_at_load(
            untaut(as_real(load), self.slack_width), pressure, throw=throw
        )

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Return the gauge pressure [Pa] at which the force rises from zero; see `AbstractMuscle`."""
        return self.continued.onset_pressure(length, highest, throw=throw)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Return the fluid volume V [m3]; see `famjax.continuation.continued_volume`. Arguments broadcast.

        Raises:
            InputError: the model has no geometry.
        """
        return continued_volume(self.continued.muscle, self.region, length, pressure)

    def start(self, length: Real, pressure: Real) -> SlipState:
        """Return the hysteresis state at the start of a history, at a length [m] and a pressure [Pa].

        This is the state that the muscle reaches from the start of the identified cycles: from the vented
        state at this length, or from the longest length of the strokes. Without hysteresis, the
        state is empty.
        """
        if self.hysteresis is None:
            return SlipState(jnp.zeros(2), jnp.zeros(0), jnp.zeros(0))
        return self.hysteresis.start(as_real(length), as_real(pressure))

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """Return the state after a monotone motion to a length [m] and pressure [Pa]."""
        if self.hysteresis is None:
            return state
        return self.hysteresis.slip.moved(state, length, pressure)

    def pull(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """Return the force [N] after one step from a state to a scalar length [m] and pressure [Pa].

        The state is not changed, so an integrator can try several end points. Call `moved` to complete
        the step.
        """
        force = self.continued.force(length, pressure)
        if self.hysteresis is not None:
            force += self.hysteresis.added(self.moved(state, length, pressure), length, pressure)
        return taut(force, self.slack_width)

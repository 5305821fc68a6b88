"""Continuation beyond the data: lines that bend towards an end, a force that never pushes; C1, monotone."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from ._arrays import Given, Real, RealArray, as_number, as_real, compiled
from .boundary.errors import InputError
from .compile_options import quick_jit
from .muscle import AbstractMuscle
from .slip import CentredSlip, SlipState

if TYPE_CHECKING:
    AnyArray = Any  # NumPy's or JAX's
else:
    AnyArray = Array | np.ndarray


_STRAIGHT = 0.8  # of the way to the end


def bent(step: Real, ends: Float[Array, "2"]) -> RealArray:
    """A step beyond an edge: straight for four fifths of the way to an end that it never passes.

    y = x for |x| <= 4/5 X, beyond it y = X (4/5 + t/(5 (1 + t))), t = 5 |x|/X - 4, with x's sign.
    C1, and its slope is positive everywhere.

    Args:
        step: x, any shape.
        ends: 1/X below and above, >= 0; zero for no end. Shape (2,).

    Returns:
        y of x's unit, x's shape.
    """
    inverse = jnp.where(step < 0, ends[0], ends[1])
    way = inverse * jnp.abs(step)
    t = jnp.maximum(way - _STRAIGHT, 0.0) / (1 - _STRAIGHT)
    beyond = _STRAIGHT + (1 - _STRAIGHT) * t / (1 + t)
    limited = way > _STRAIGHT
    return jnp.where(limited, jnp.sign(step) * beyond / jnp.where(limited, inverse, 1.0), step)


def taut(force: RealArray, width: RealArray) -> RealArray:
    """The force, cut at zero; between 0 and a width [N] a cubic blends the two.

    F = w (2 t^2 - t^3), t = G/w: exactly zero for G <= 0, exactly G for G >= w, C1, rising. It is
    below G by 0.15 w at most.

    Args:
        force: G [N] as if the muscle could push.
        width: w [N], > 0.

    Returns:
        F [N], >= 0.
    """
    t = jnp.clip(force / width, 0.0, 1.0)
    return jnp.asarray(jnp.where(force >= width, force, width * t**2 * (2 - t)))


def stopped(step: RealArray, stiffness: RealArray, onset: RealArray) -> RealArray:
    """Force [N] of a stop after a travel [m] into it: zero before it, C1, with bounded stiffness.

    k x^2/(2 s) on the first s, then k (x - s/2).

    Args:
        step: x [m], any shape.
        stiffness: k [N/m], > 0.
        onset: s [m], > 0.
    """
    on = jnp.clip(step, 0.0, onset)
    return stiffness * (on**2 / (2 * onset) + jnp.maximum(step - onset, 0.0))


def untaut(force: RealArray, width: RealArray) -> RealArray:
    """The force G [N] of which `taut` makes F [N] >= 0; zero for F = 0, nan below.

    The root of 2 t^2 - t^3 = F/w in [0, 1], t = (2 + 4 cos(arccos(1 - 27 F/(16 w))/3 - 2 pi/3))/3,
    of the three real roots the middle one.
    """
    part = force / width
    blended = (part > 0) & (part < 1)
    angle = jnp.arccos(1 - 27 / 16 * jnp.where(blended, part, 0.5)) / 3
    t = (2 + 4 * jnp.cos(angle - 2 * jnp.pi / 3)) / 3
    return jnp.where(blended, width * t, jnp.where(force >= 0, force, jnp.nan))


LENGTHS, PRESSURES = 33, 65
"""Grid on which the model is looked at, lines of each."""


class Region(eqx.Module):
    """A range of lengths and one of pressures.

    Attributes:
        length: shortest and longest active length [m], shape (2,).
        pressure: lowest and highest gauge pressure [Pa], shape (2,).
    """

    length: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure: Float[Given, "2"] = eqx.field(converter=as_number)

    @classmethod
    def of(cls, length: Sequence[float] | np.ndarray, pressure: Sequence[float] | np.ndarray):
        """The smallest region that contains these lengths [m] and pressures [Pa].

        Raises:
            InputError: they are not finite, negative, or span nothing.
        """
        L, P = np.asarray(length, float), np.asarray(pressure, float)
        for name, values, unit in (("lengths", L, "m"), ("pressures", P, "Pa")):
            if not (values.size and np.isfinite(values).all() and values.min() >= 0):
                raise InputError(f"{name} must be finite and >= 0, got {values} {unit}")
            if not values.max() > values.min():
                raise InputError(f"a region needs two {name} that differ, got {values} {unit}")
        return cls([L.min(), L.max()], [P.min(), P.max()])


class Slopes(NamedTuple):
    """A force with its slopes, all of one shape.

    Attributes:
        force: F [N].
        stiffness: dF/dL [N/m].
        area: dF/dP [m2].
        stiffening: d2F/dLdP [m].
    """

    force: AnyArray
    stiffness: AnyArray
    area: AnyArray
    stiffening: AnyArray


def slopes(muscle: AbstractMuscle, length: RealArray, pressure: RealArray) -> Slopes:
    """Force and slopes at lengths [m] and pressures [Pa] of one shape."""
    along = jnp.ones_like(length), jnp.ones_like(pressure)

    def in_length(pressure: RealArray) -> tuple[RealArray, RealArray]:
        return jax.jvp(lambda L: muscle.force(L, pressure), (length,), along[:1])

    (force, stiffness), (area, stiffening) = jax.jvp(in_length, (pressure,), along[1:])
    return Slopes(force, stiffness, area, stiffening)


def grid_slopes(muscle: AbstractMuscle, region: Region) -> Slopes:
    """Force and slopes on the grid over a region, each of shape (LENGTHS, PRESSURES)."""
    L = jnp.linspace(region.length[0], region.length[1], LENGTHS)
    P = jnp.linspace(region.pressure[0], region.pressure[1], PRESSURES)
    return slopes(muscle, *jnp.meshgrid(L, P, indexing="ij"))


def rising(at: Slopes) -> Bool[Array | np.ndarray, "lengths pressures"]:
    """Where the force is finite and does not fall with length or pressure."""
    finite = abs(sum(at)) < np.inf
    return finite & (at.stiffness >= 0) & (at.area >= 0)


def rising_region(muscle: AbstractMuscle, data: Region) -> tuple[Region, Slopes]:
    """The largest part of a region in which the force does not fall with length or pressure.

    Looked for among the rectangles of a grid of 33 lengths and 65 pressures, by their area. It is
    the whole region where the model allows. On the host: it cannot be traced.

    Args:
        muscle: the model.
        data: the region of the data.

    Returns:
        (the part, force and slopes at the grid's lines in it).

    Raises:
        InputError: there is no such part of two cells by two.
    """
    at = Slopes(*(np.asarray(one) for one in _grid_slopes(muscle, data)))
    good = np.asarray(rising(at))
    if good.all():
        return data, at
    (i0, i1), (j0, j1) = (
        _inner(low, high, count - 1)
        for (low, high), count in zip(largest_block(good), good.shape, strict=True)
    )
    L = np.linspace(float(data.length[0]), float(data.length[1]), LENGTHS)
    P = np.linspace(float(data.pressure[0]), float(data.pressure[1]), PRESSURES)
    if min(i1 - i0, j1 - j0) < 2:
        raise InputError(
            "the model has no region in which its pull rises with length and pressure: of "
            f"{good.size} states between {L[0]:.4g} and {L[-1]:.4g} m, {P[0]:.4g} and {P[-1]:.4g} Pa "
            f"{good.sum()} do. It cannot be continued safely: look at its stiffness, and at the units"
        )
    part = Slopes(*(one[i0 : i1 + 1, j0 : j1 + 1] for one in at))
    return Region([L[i0], L[i1]], [P[j0], P[j1]]), part


_grid_slopes = quick_jit(grid_slopes)


def largest_share(good: Bool[np.ndarray, "lengths pressures"]) -> float:
    """Fraction [-] of a grid's cells in the largest rectangle of good cells."""
    if good.all():
        return 1.0
    (i0, i1), (j0, j1) = largest_block(good)
    return (i1 - i0) * (j1 - j0) / float(np.prod(np.subtract(good.shape, 1)))


def _inner(low: int, high: int, last: int) -> tuple[int, int]:
    """One line in from an end that is not the data's: what just rises on it may fall between its states."""
    return low + (low > 0), high - (high < last)


def largest_block(good: np.ndarray) -> tuple[tuple[int, int], tuple[int, int]]:
    """First and last lines of the largest rectangle of good cells in a grid."""
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
    """V [m3] at any length [m] and pressure [Pa], broadcast shape: positive, C1, rising as at the edge.

    Inside the region it is the muscle's own. Beyond an edge it goes on with the slope of the edge
    where it grows, and where it shrinks as V/(1 + s), which never reaches zero.

    Args:
        muscle: the model.
        region: where its geometry is taken as it is.
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
    """V + dV where that grows, V/(1 - dV/V) where it shrinks: C1 and positive."""
    shrunk = volume / (1 - jnp.minimum(change, 0.0) / volume)
    return jnp.where(change < 0, shrunk, volume + change)


_STOP = 0.01  # of the rest length: there a stop takes the largest force of the region
_ONSET = _STOP / 2
_AT_ONCE = 1e12  # 1/m and 1/Pa: no step at all
_SPARE = 1.05  # ends are this much nearer than grid lines say, for what lies between them


class ContinuedMuscle(AbstractMuscle):
    """A model inside a region, continued by straight lines outside; not cut at zero force.

        H(L, P) = F(L_c, P) + F_L(L_c, P) y(L - L_c)                  L_c: L held in the region
        G(L, P) = H(L, P_c) + H_P(L, P_c) y(P - P_c) + S(L)           P_c: P held in the region

    Inside it is the model itself, to the last bit. Across every edge it is C1, as F is C2. y is a
    straight line (`bent`) unless slopes of the model at the edge would then turn the pull round:
    where the stiffness falls along the pressure, or the area F_P along the length, y ends at the
    step that leaves both >= 0. S are two stops, outside of the region: one from where the threads
    are straight, one below where the braid locks, which pushes; each takes the largest force of
    the region on a hundredth of the rest length.

    So dG/dL >= 0 at every pressure and dG/dP >= 0 at every length outside, whatever the model, if
    it is `rising` on the region's edges: F_L >= 0 is held by cutting it at zero there.

    Attributes:
        muscle: the model.
        region: where it is taken as it is.
        stops: lengths [m] at which the stops begin, shape (2,).
        stop_stiffness: [N/m].
        length_ends: 1/X [1/m] of the steps below and above the region's lengths, shape (2,).
        pressure_ends: 1/X [1/Pa] of those below and above its pressures, shape (2,).
    """

    muscle: AbstractMuscle
    region: Region
    stops: Float[Given, "2"] = eqx.field(converter=as_number)
    stop_stiffness: Float[Given, ""] = eqx.field(converter=as_number)
    length_ends: Float[Given, "2"] = eqx.field(converter=as_number)
    pressure_ends: Float[Given, "2"] = eqx.field(converter=as_number)

    @classmethod
    def of(cls, muscle: AbstractMuscle, region: Region, stops: AnyArray, at: Slopes):
        """Continue a model; a pure function that can be traced and mapped over muscles.

        Args:
            muscle: the model.
            region: in which it rises, see `rising_region`.
            stops: where the braid locks and where its threads are straight [m], shape (2,); what
                lies within the region is moved to its edge, and so is nan.
            at: force and slopes on a grid over the region.
        """
        ends = jnp.fmin(stops[0], region.length[0]), jnp.fmax(stops[1], region.length[1])
        stiffness = abs(at.force).max() / (_STOP * muscle.rest_length)
        return cls(muscle, region, jnp.stack(ends), stiffness, *_ends(at))

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Continued pull G [N] at any length [m] and pressure [Pa], broadcast shape; may be < 0."""
        return _force(self, *jnp.broadcast_arrays(as_real(length), as_real(pressure)))

    def length_range(self) -> tuple[RealArray, RealArray]:
        """The stops [m], including the travel of a stop under four times the largest force."""
        travel = 4 * _STOP * self.muscle.rest_length
        return self.stops[0] - travel, self.stops[1] + travel

    @property
    def stop_onset(self) -> RealArray:
        """Travel [m] on which a stop's stiffness builds up."""
        return _ONSET * self.muscle.rest_length

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.muscle.rest_length


def _ends(at: Slopes) -> tuple[Float[Array, "2"], Float[Array, "2"]]:
    """The nearest ends, as 1/X, that keep area and stiffness >= 0 beyond lengths and pressures."""
    xp = at.force.__array_namespace__()

    def end(falling: AnyArray, held: AnyArray) -> AnyArray:
        falls, holds = falling > 0, held > 0
        rate = xp.where(falls & holds, falling, 0.0) / xp.where(holds, held, 1.0)
        rate = xp.where(falls & ~holds, _AT_ONCE, rate)
        return xp.asarray(xp.minimum(_SPARE * rate.max(), _AT_ONCE))

    K, A, mixed = at.stiffness, at.area, at.stiffening
    lengths = xp.stack([end(mixed[0], A[0]), end(-mixed[-1], A[-1])])
    pressures = xp.stack([end(mixed[:, 0], K[:, 0]), end(-mixed[:, -1], K[:, -1])])
    return jnp.asarray(lengths), jnp.asarray(pressures)


@compiled
def _force(of: ContinuedMuscle, length: RealArray, pressure: RealArray) -> RealArray:
    L = jnp.clip(length, of.region.length[0], of.region.length[1])
    P = jnp.clip(pressure, of.region.pressure[0], of.region.pressure[1])
    step = bent(length - L, of.length_ends)

    def along(pressure: RealArray) -> RealArray:
        force, stiffness = jax.jvp(
            lambda length: of.muscle.force(length, pressure), (L,), (jnp.ones_like(L),)
        )
        return force + jnp.maximum(stiffness, 0.0) * step

    force, area = jax.jvp(along, (P,), (jnp.ones_like(P),))
    force += jnp.maximum(area, 0.0) * bent(pressure - P, of.pressure_ends)
    stop = of.stop_stiffness, of.stop_onset
    return force + stopped(length - of.stops[1], *stop) - stopped(of.stops[0] - length, *stop)


_SLACK = 1e-3  # width of the blend into slack, of the largest force of the region


class SafeMuscle(AbstractMuscle):
    """A muscle inside the region of its data, with a passive continuation outside.

    F = taut(G), G the model in the region and monotone lines and stops beyond (`ContinuedMuscle`),
    taut(G) = 0 for G <= 0 and G from a small force w up (`taut`). At any length and pressure, also
    at twice those of the data or at none, F is finite, >= 0, C1, and rises with the length: at
    constant pressure the muscle is a spring, from which no simulator can gain energy. Below the
    length at which its braid locks it pulls no longer, whatever the pressure; beyond the length at
    which the threads are straight a stiff stop holds it.

    With hysteresis the pull also depends on the history, which the caller keeps as a state: `start`
    makes it, `pull` asks for the force at the end of a step, `moved` ends the step. Both branches
    of any loop rise with the length and the lengthening one is the higher, and cutting them at zero
    leaves that so: every closed loop takes energy up. All of this without state is the static map.

    Attributes:
        continued: G, not cut at zero; `model_force` asks it.
        slack_width: w [N].
        data: the region of the data. `region` is the part of it in which the model is monotone.
        hysteresis: about the static map, or None.

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
        """Make the safe muscle of a model.

        Args:
            muscle: the model.
            length: active lengths [m] at which it was identified, or the least and the greatest.
            pressure: gauge pressures [Pa], likewise.
            hysteresis: about the model's force.

        Raises:
            InputError: no region, or the model is monotone nowhere in it; see `rising_region`.
        """
        data = Region.of(length, pressure)
        region, at = rising_region(muscle, data)
        return cls.within(muscle, region, at, data, hysteresis)

    @classmethod
    def within(
        cls,
        muscle: AbstractMuscle,
        region: Region,
        at: Slopes | None = None,
        data: Region | None = None,
        hysteresis: CentredSlip | None = None,
    ) -> "SafeMuscle":
        """Make the safe muscle of a model that is known to be monotone in a region; can be traced.

        Args:
            muscle: the model.
            region: in which it rises.
            at: its force and slopes on a grid over the region; computed unless given.
            data: the region of the data, if it is another one.
            hysteresis: about the model's force.
        """
        at = grid_slopes(muscle, region) if at is None else at
        continued = ContinuedMuscle.of(muscle, region, _stops(muscle), at)
        width = as_real(_SLACK * abs(at.force).max())
        return cls(continued, width, region if data is None else data, hysteresis)

    @property
    def region(self) -> Region:
        """The region in which the force is that of the model."""
        return self.continued.region

    @property
    def notes(self) -> tuple[str, ...]:
        """Parts of the data's region in which the model was replaced, in sentences; for one muscle."""
        found = []
        for name, unit, scale in (("length", "mm", 1e3), ("pressure", "kPa", 1e-3)):
            had, kept = (
                scale * np.asarray(getattr(one, name), float) for one in (self.data, self.region)
            )
            if (had != kept).any():
                found.append(
                    f"the model is monotone from {kept[0]:.4g} to {kept[1]:.4g} {unit} of {name} only; "
                    f"the data reach from {had[0]:.4g} to {had[1]:.4g}"
                )
        return tuple(found)

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at any length [m] and gauge pressure [Pa], broadcast shape; >= 0."""
        return taut(self.continued.force(length, pressure), self.slack_width)

    def model_force(self, length: Real, pressure: Real) -> RealArray:
        """G [N], the continued model not cut at zero, broadcast shape; below zero where slack."""
        return self.continued.force(length, pressure)

    def length_range(self) -> tuple[RealArray, RealArray]:
        """Shortest and longest active length [m] for the equilibrium search."""
        return self.continued.length_range()

    @property
    def rest_length(self) -> RealArray:
        """Active length L0 [m] of zero contraction."""
        return self.continued.rest_length

    def length_at_load(self, load: Real, pressure: Real, *, throw: bool = True) -> RealArray:
        """Longest active length L [m] at which the muscle carries a load >= 0 [N].

        That of the continued muscle, which has one where this one is slack at a range of lengths;
        see `AbstractMuscle.length_at_load`.
        """
        return self.continued.length_at_load(
            untaut(as_real(load), self.slack_width), pressure, throw=throw
        )

    def onset_pressure(self, length: Real, highest: Real, *, throw: bool = True) -> RealArray:
        """Gauge pressure [Pa] at which the force rises from zero; see `AbstractMuscle`."""
        return self.continued.onset_pressure(length, highest, throw=throw)

    def volume(self, length: Real, pressure: Real) -> RealArray:
        """Volume V [m3] of the fluid, `famjax.continuation.continued_volume`, broadcast shape.

        Raises:
            InputError: the muscle is of a model without a geometry.
        """
        return continued_volume(self.continued.muscle, self.region, length, pressure)

    def start(self, length: Real, pressure: Real) -> SlipState:
        """The state of the hysteresis at the start of a history, at a length and a pressure.

        Reached from where the cycles of the identified records begin: from the vented muscle of
        that length, or after strokes from its longest one. Empty without hysteresis.
        """
        if self.hysteresis is None:
            return SlipState(jnp.zeros(2), jnp.zeros(0), jnp.zeros(0))
        return self.hysteresis.start(as_real(length), as_real(pressure))

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """The state after a monotone motion to a length [m] and pressure [Pa]."""
        if self.hysteresis is None:
            return state
        return self.hysteresis.slip.moved(state, length, pressure)

    def pull(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """Force [N] after one step from a state to a length [m] and pressure [Pa]; scalars.

        The state itself is not changed, so that an integrator can try several ends of a step;
        `moved` ends the step.
        """
        force = self.continued.force(length, pressure)
        if self.hysteresis is not None:
            force += self.hysteresis.added(self.moved(state, length, pressure), length, pressure)
        return taut(force, self.slack_width)


@compiled
def _stops(muscle: AbstractMuscle) -> Float[Array, "2"]:
    return muscle.stops()

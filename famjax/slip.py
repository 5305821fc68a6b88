"""The Maxwell-slip element, a spring in series with a dry slider, and its coordinates in a muscle."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from ._arrays import Given, Real, RealArray, as_number, as_real, compiled_method

if TYPE_CHECKING:
    Either: TypeAlias = Any  # NumPy's or JAX's, as the arguments are
else:
    Either: TypeAlias = Real


def slip(deflection: Either, change: Either, threshold: Either) -> Either:
    """Deflection of an element after its coordinate has moved one way by `change`.

        s <- min(max(s + dq, -delta), delta)

    Exact for a motion of any size that does not turn round. Takes NumPy's arrays or JAX's.

    Args:
        deflection: s before.
        change: dq, of the same unit.
        threshold: delta > 0 at which the slider gives way.

    Returns:
        s afterwards, broadcast shape.

    References:
        Rizos & Fassois 2004, Chaos 14(2), 431-445: the element and its identification.

    >>> float(slip(0.5, 2.0, 1.0)), float(slip(1.0, -1.5, 1.0))
    (1.0, -0.5)
    """
    moved = deflection + change
    xp = jnp if isinstance(moved, jax.Array) else np
    return xp.minimum(xp.maximum(moved, -threshold), threshold)


def slip_shares(pressure: Either, modulus: Either) -> tuple[Either, Either]:
    """Rates of the coordinates of wall and braid in the strain, 1 + P/E and P/E [-].

    Takes NumPy's arrays or JAX's; see `MaxwellSlip`.

    Args:
        pressure: gauge pressure P [Pa].
        modulus: E [Pa].
    """
    ratio = pressure / modulus
    return 1 + ratio, ratio


def slip_coordinates(
    length: Either, pressure: Either, rest_length: Either, modulus: Either
) -> tuple[Either, Either]:
    """Coordinates of wall and braid [-], -eps (1 + P/E) and -eps P/E, broadcast shape.

    Takes NumPy's arrays or JAX's; see `MaxwellSlip`.

    Args:
        length: L [m].
        pressure: gauge pressure P [Pa].
        rest_length: L0 [m].
        modulus: E [Pa].
    """
    strain = length / rest_length - 1
    wall, braid = slip_shares(pressure, modulus)
    return strain * wall, strain * braid


class SlipElements(eqx.Module):
    """Elements side by side on one coordinate.

    Attributes:
        threshold: delta of each element, in the unit of the coordinate, > 0, shape (k,).
        strength: force [N] of each element while it slides, >= 0, shape (k,).
    """

    threshold: Float[Given, " k"] = eqx.field(converter=as_number)
    strength: Float[Given, " k"] = eqx.field(converter=as_number)

    @classmethod
    def none(cls) -> "SlipElements":
        """No elements."""
        return cls(jnp.zeros(0), jnp.zeros(0))

    def force(self, deflection: Float[Array, "*n k"]) -> RealArray:
        """Sum [N] of strength times s / delta, shape (*n,)."""
        return jnp.sum(self.strength * deflection / self.threshold, axis=-1)

    def energy(self, deflection: Float[Array, "*n k"]) -> RealArray:
        """Energy stored in the springs, force times the unit of the coordinate, shape (*n,)."""
        return jnp.sum(self.strength * deflection**2 / (2 * self.threshold), axis=-1)

    def heat(self, deflection: Float[Array, "n k"], change: Float[Array, " m"]) -> RealArray:
        """Sum of strength times path slid, of deflections in order and the motions between them."""
        slid = jnp.abs(change[:, None] - jnp.diff(deflection, axis=0))
        return jnp.sum(self.strength * slid)


class SlipState(eqx.Module):
    """State of the elements after a history.

    Attributes:
        coordinates: of wall and braid [-].
        wall: deflections of the elements on the first, shape (k,).
        braid: deflections of those on the second, shape (m,).
    """

    coordinates: Float[Array, "2"]
    wall: Float[Array, " k"]
    braid: Float[Array, " m"]


class MaxwellSlip(eqx.Module):
    """The part of a pull that depends on the history: elements on two coordinates.

        q_w = -eps (1 + P/E),   q_b = -eps P/E,   eps = (L0 - L)/L0

        F_h = (1 + P/E) sum_w S_i s_i/delta_i  +  (P/E) sum_b S_i s_i/delta_i

    Both coordinates are the strain of the wall along the axis: as it is, enlarged by a pressure
    that is not small beside the modulus E of rubber, and the part that the pressure adds. Elements
    on the second have the strength of dry friction under the pressure's normal force. At constant
    pressure both coordinates move with the contraction, and full sliding takes c0 + c1 P. At
    constant length they move in proportion to contraction and pressure: a muscle at rest length
    has no loop, and one that is held shorter pulls less while it is filled than while it is vented.

    A force f on a coordinate q pulls with f dq/dL and takes up the volume -f dq/dP, so that machine
    and fluid together do the work f dq on it. Over any history that is what the springs store and
    the sliders turn into heat; over a closed one it is never negative, as strengths are not.

    Attributes:
        wall: elements on q_w, thresholds [-]; their strength is that without pressure.
        braid: elements on q_b, thresholds [-]; their strength is that at the pressure E.
        rest_length: L0 [m].
        modulus: E [Pa].

    References:
        Rizos & Fassois 2004, Chaos 14(2), 431-445. Vo-Minh, Tjahjowidodo, Ramon & Van Brussel 2011,
        IEEE/ASME Transactions on Mechatronics 16(1), 177-186: Maxwell-slip elements for the loops of
        pneumatic muscles.

    >>> slip = MaxwellSlip(SlipElements.none(), SlipElements([0.01], [30.0]), 0.3, 1e6)
    >>> P = [0.0, 4e5, 2e5]  # filled, then vented, at a contraction of 0.1
    >>> print(slip.along([0.27] * 3, P))
    [  0. -12.   6.]
    """

    wall: SlipElements
    braid: SlipElements
    rest_length: Float[Given, ""] = eqx.field(converter=as_number)
    modulus: Float[Given, ""] = eqx.field(converter=as_number)

    def coordinates(self, length: Real, pressure: Real) -> tuple[RealArray, RealArray]:
        """Coordinates of wall and braid [-], see `slip_coordinates`."""
        L, P = as_real(length), as_real(pressure)
        return slip_coordinates(L, P, self.rest_length, self.modulus)

    def start(self, length: Real, pressure: Real) -> SlipState:
        """The state with all springs relaxed at a length [m] and a gauge pressure [Pa]."""
        q = jnp.stack(self.coordinates(length, pressure))
        return SlipState(
            q, jnp.zeros_like(self.wall.threshold), jnp.zeros_like(self.braid.threshold)
        )

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """The state after a motion to a length [m] and a pressure [Pa] that does not turn round."""
        q = jnp.stack(self.coordinates(length, pressure))
        change = q - state.coordinates
        return SlipState(
            q,
            jnp.asarray(slip(state.wall, change[0], self.wall.threshold)),
            jnp.asarray(slip(state.braid, change[1], self.braid.threshold)),
        )

    def force(self, state: SlipState, pressure: Real) -> RealArray:
        """The elements' part of the pull F_h [N]; positive after the muscle was lengthened."""
        wall, braid = slip_shares(as_real(pressure), self.modulus)
        return wall * self.wall.force(state.wall) + braid * self.braid.force(state.braid)

    def added(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """Force [N] that the history adds to the static force at that pressure, at the state's length."""
        del length
        return self.force(state, pressure)

    def volume(self, state: SlipState, length: Real) -> RealArray:
        """The elements' share of the fluid volume [m3], which makes them passive."""
        shortened = self.rest_length - as_real(length)
        both = self.wall.force(state.wall) + self.braid.force(state.braid)
        return shortened / self.modulus * both

    def energy(self, state: SlipState) -> RealArray:
        """Energy [J] stored in the springs."""
        return self.rest_length * (self.wall.energy(state.wall) + self.braid.energy(state.braid))

    @compiled_method
    def states(
        self,
        length: Float[Array | np.ndarray, " n"] | Sequence[float],
        pressure: Float[Array | np.ndarray, " n"] | Sequence[float],
    ) -> SlipState:
        """The state at each point of a history that starts relaxed, by `jax.lax.scan`.

        Args:
            length: L [m] in the order of time, shape (n,); every turning point must be among them.
            pressure: gauge pressure P [Pa], shape (n,).

        Returns:
            The states, each leaf with a leading axis (n,).
        """

        def step(state: SlipState, at: tuple[Array, Array]) -> tuple[SlipState, SlipState]:
            after = self.moved(state, *at)
            return after, after

        L, P = as_real(length), as_real(pressure)
        return jax.lax.scan(step, self.start(L[0], P[0]), (L, P))[1]

    @compiled_method
    def along(
        self,
        length: Float[Array | np.ndarray, " n"] | Sequence[float],
        pressure: Float[Array | np.ndarray, " n"] | Sequence[float],
    ) -> Float[Array, " n"]:
        """F_h [N] along a history that starts relaxed, shape (n,); see `states`."""
        return jax.vmap(self.force)(self.states(length, pressure), as_real(pressure))

    @compiled_method
    def heat(
        self,
        length: Float[Array | np.ndarray, " n"] | Sequence[float],
        pressure: Float[Array | np.ndarray, " n"] | Sequence[float],
    ) -> Float[Array, ""]:
        """Energy [J] that the sliders dissipate over a history; never negative."""
        states = self.states(length, pressure)
        change = jnp.diff(states.coordinates, axis=0)
        wall = self.wall.heat(states.wall, change[:, 0])
        return self.rest_length * (wall + self.braid.heat(states.braid, change[:, 1]))


Cycle = Literal["ramp", "stroke"]
"""Pressure up and down at one length, or shorter and longer at one pressure."""


def there_and_back(path: Sequence[Either], threshold: Either) -> tuple[Either, Either]:
    """Deflections of relaxed elements when a path reaches a point, reverses and returns to it.

    Args:
        path: coordinate at the start, at other ends of motions, at the point, at the turn and at the
            point again. Between two of them it moves one way.
            Arrays of one shape (*n,), NumPy's or JAX's.
        threshold: of the elements, shape (k,).

    Returns:
        (deflection on the way there, and on the way back), shape (*n, k).
    """
    s: list[Either] = [0.0 * path[0][..., None] * threshold]
    for before, after in itertools.pairwise(path):
        s.append(slip(s[-1], (after - before)[..., None], threshold))
    return s[-3], s[-1]


@dataclasses.dataclass(frozen=True)
class ReferenceCycle:
    """The cycle whose mean of branches is the static map.

    Attributes:
        kind: what moves, the pressure or the length.
        start, turn: ends of the motion, gauge pressures [Pa] or lengths [m].
        cycled: the same cycle went before; otherwise all is relaxed at the start.
    """

    kind: Cycle
    start: float
    turn: float
    cycled: bool


class CentredSlip(eqx.Module):
    """Hysteresis around a static map: zero mean over both branches of the map's cycles.

    The mean of two branches is not where relaxed elements would be: below their thresholds they
    are springs. Their mean over the cycle, which depends on length and pressure alone, is
    therefore subtracted: a static force, which changes neither branch against the other.

    Attributes:
        slip: the elements.
        cycle: of the static map.
    """

    slip: MaxwellSlip
    cycle: ReferenceCycle = eqx.field(static=True)

    def middle(
        self, length: Num[Array | np.ndarray, "*n"], pressure: Num[Array | np.ndarray, "*n"]
    ) -> Float[Array, "*n"]:
        """Mean [N] of the elements' force over both branches of the cycle through a point.

        Beyond the turn of the reference cycle, the cycle turns at the point itself.
        """
        there, back = self._ends(length, pressure)
        start, at, turn = (
            self.slip.coordinates(*where) for where in (there, (length, pressure), back)
        )
        shares = slip_shares(jnp.asarray(pressure), self.slip.modulus)
        before = [start, turn] if self.cycle.cycled else []
        total = jnp.zeros(())
        for k, elements in enumerate((self.slip.wall, self.slip.braid)):
            path = [one[k] for one in (*before, start, at, turn, at)]
            out, home = there_and_back(path, elements.threshold)
            total = total + shares[k] * elements.force(jnp.asarray(out + home) / 2)
        return total

    def start(self, length: Real, pressure: Real) -> SlipState:
        """The state at the start of a history, at a length [m] and a pressure [Pa], both scalars.

        Reached from the start of the reference cycle: from the vented muscle of that length, or from
        the longest length under that pressure. After a cycle, if one went before.
        """
        there, back = self._ends(as_real(length), as_real(pressure))
        state = self.slip.start(*there)
        for at in [back, there] if self.cycle.cycled else []:
            state = self.slip.moved(state, *at)
        return self.slip.moved(state, length, pressure)

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """The state after a motion to a length [m] and a pressure [Pa] that does not turn round."""
        return self.slip.moved(state, length, pressure)

    def added(self, state: SlipState, length: Real, pressure: Real) -> RealArray:
        """Force [N] that the history adds to the static map at that length and pressure."""
        return self.slip.force(state, pressure) - self.middle(as_real(length), as_real(pressure))

    def along(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[Array, " n"]:
        """Hysteresis [N] to be added to the static map along a history, shape (n,).

        The history begins where the reference cycle does: vented at the first length, or at the
        longest length under the first pressure.

        Args:
            length: L [m] in the order of time, shape (n,); every turning point must be among them.
            pressure: gauge pressure P [Pa], shape (n,).
        """
        there, back = self._ends(length[:1], pressure[:1])
        first = [there, back, there] if self.cycle.cycled else [there]
        L = np.concatenate([*(np.asarray(at[0]) for at in first), length])
        P = np.concatenate([*(np.asarray(at[1]) for at in first), pressure])
        return self.slip.along(L, P)[len(first) :] - self.middle(length, pressure)

    def _ends(
        self, length: Num[Array | np.ndarray, "*n"], pressure: Num[Array | np.ndarray, "*n"]
    ) -> tuple[tuple, tuple]:
        """Length and pressure at the start and at the turn of the cycle through each point."""
        if self.cycle.kind == "ramp":
            low, high = jnp.minimum, jnp.maximum
            return (
                (length, low(pressure, self.cycle.start)),
                (length, high(pressure, self.cycle.turn)),
            )
        return (
            (jnp.maximum(length, self.cycle.start), pressure),
            (jnp.minimum(length, self.cycle.turn), pressure),
        )

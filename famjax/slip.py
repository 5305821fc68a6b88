"""Maxwell-slip elements (springs in series with friction sliders) and their coordinates in a muscle."""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any, Literal, TypeAlias

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Num

from ._arrays import Given, Real, RealArray, as_number, as_real, compiled_method

Either: TypeAlias = Any  # an array of NumPy or JAX, as the arguments are
History: TypeAlias = Float[Array | np.ndarray, " n"] | Sequence[float]


def slip(deflection: Either, change: Either, threshold: Either) -> Either:
    """Return the deflection of an element after its coordinate has changed monotonically.

        s <- min(max(s + dq, -delta), delta)

    The result is exact for a change of any size. Arguments may be NumPy or JAX arrays.

    Args:
        deflection: s before the change.
        change: dq, in the same unit.
        threshold: delta > 0, the deflection at which the slider moves.

    Returns:
        s after the change, with the broadcast shape.

    References:
        Rizos & Fassois 2004, Chaos 14(2), 431-445: the element and its identification.

    >>> float(slip(0.5, 2.0, 1.0)), float(slip(1.0, -1.5, 1.0))
    (1.0, -0.5)
    """
    moved = deflection + change
    xp = jnp if isinstance(moved, jax.Array) else np
    return xp.minimum(xp.maximum(moved, -threshold), threshold)


def slip_shares(pressure: Either, modulus: Either) -> tuple[Either, Either]:
    """Return the derivatives of the wall and braid coordinates with respect to strain: 1 + P/E and P/E [-].

    Arguments may be NumPy or JAX arrays; see `MaxwellSlip`.

    Args:
        pressure: gauge pressure P [Pa].
        modulus: modulus E [Pa] of the rubber.
    """
    ratio = pressure / modulus
    return 1 + ratio, ratio


def slip_coordinates(
    length: Either, pressure: Either, rest_length: Either, modulus: Either
) -> tuple[Either, Either]:
    """Return the wall and braid coordinates [-], -eps (1 + P/E) and -eps P/E, with the broadcast shape.

    Arguments may be NumPy or JAX arrays; see `MaxwellSlip`.

    Args:
        length: L [m].
        pressure: gauge pressure P [Pa].
        rest_length: L0 [m].
        modulus: modulus E [Pa] of the rubber.
    """
    strain = length / rest_length - 1
    wall, braid = slip_shares(pressure, modulus)
    return strain * wall, strain * braid


class SlipElements(eqx.Module):
    """Maxwell-slip elements in parallel on one coordinate.

    Attributes:
        threshold: delta of each element, in the unit of the coordinate, > 0, shape (k,).
        strength: force [N] of each element while it slides, >= 0, shape (k,).
    """

    threshold: Float[Given, " k"] = eqx.field(converter=as_number)
    strength: Float[Given, " k"] = eqx.field(converter=as_number)

    @classmethod
    def none(cls) -> "SlipElements":
        """Create an empty set of elements."""
        return cls(jnp.zeros(0), jnp.zeros(0))

    def force(self, deflection: Float[Array, "*n k"]) -> RealArray:
        """Return the total force [N], the sum of strength times s / delta, shape (*n,)."""
        return jnp.sum(self.strength * deflection / self.threshold, axis=-1)


class SlipState(eqx.Module):
    """State of the elements after a history.

    Attributes:
        coordinates: wall and braid coordinates [-].
        wall: deflections of the elements on the first coordinate, shape (k,).
        braid: deflections of the elements on the second coordinate, shape (m,).
    """

    coordinates: Float[Array, "2"]
    wall: Float[Array, " k"]
    braid: Float[Array, " m"]


class MaxwellSlip(eqx.Module):
    """The history-dependent part of a muscle's force: elements on two coordinates.

        q_w = -eps (1 + P/E),   q_b = -eps P/E,   eps = (L0 - L)/L0

        F_h = (1 + P/E) sum_w S_i s_i/delta_i  +  (P/E) sum_b S_i s_i/delta_i

    The first coordinate is the axial strain of the wall, increased by the pressure P, which is not small
    compared with the modulus E of the rubber. The second coordinate is this increase alone; its elements
    model dry friction under the normal force due to the pressure. At constant pressure, both coordinates
    follow the contraction, and the friction force in full sliding is linear in the pressure, c0 + c1 P. At
    constant length, the change in both coordinates is proportional to the contraction and to the change
    in pressure. A muscle at rest length therefore shows no loop, and a shortened muscle pulls less during
    filling than during venting.

    A force f on a coordinate q adds f dq/dL to the muscle's force and displaces the volume
    -f dq/dP, so the testing machine and the fluid together do the work f dq. This work is stored in
    the springs or dissipated by the sliders, so a closed cycle never creates energy.

    Attributes:
        wall: elements on q_w, with thresholds [-] and with strengths for zero pressure.
        braid: elements on q_b, with thresholds [-] and with strengths for the pressure E.
        rest_length: L0 [m].
        modulus: modulus E [Pa] of the rubber.

    References:
        Rizos & Fassois 2004, Chaos 14(2), 431-445. Vo-Minh, Tjahjowidodo, Ramon & Van Brussel 2011,
        IEEE/ASME Transactions on Mechatronics 16(1), 177-186: Maxwell-slip elements for the loops of
        pneumatic muscles.

    >>> slip = MaxwellSlip(SlipElements.none(), SlipElements([0.01], [30.0]), 0.3, 1e6)
    >>> P = [0.0, 4e5, 2e5]  # filling, then venting, at a contraction of 0.1
    >>> print(slip.along([0.27] * 3, P))
    [  0. -12.   6.]
    """

    wall: SlipElements
    braid: SlipElements
    rest_length: Float[Given, ""] = eqx.field(converter=as_number)
    modulus: Float[Given, ""] = eqx.field(converter=as_number)

    def coordinates(self, length: Real, pressure: Real) -> tuple[RealArray, RealArray]:
        """Return the wall and braid coordinates [-]; see `slip_coordinates`."""
        L, P = as_real(length), as_real(pressure)
        return slip_coordinates(L, P, self.rest_length, self.modulus)

    def start(self, length: Real, pressure: Real) -> SlipState:
        """Return the state with relaxed springs at a length [m] and a gauge pressure [Pa]."""
        q = jnp.stack(self.coordinates(length, pressure))
        return SlipState(
            q, jnp.zeros_like(self.wall.threshold), jnp.zeros_like(self.braid.threshold)
        )

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """Return the state after a monotone motion to a length [m] and a pressure [Pa]."""
        q = jnp.stack(self.coordinates(length, pressure))
        change = q - state.coordinates
        return SlipState(
            q,
            jnp.asarray(slip(state.wall, change[0], self.wall.threshold)),
            jnp.asarray(slip(state.braid, change[1], self.braid.threshold)),
        )

    def force(self, state: SlipState, pressure: Real) -> RealArray:
        """Return the elements' force F_h [N]; positive after lengthening."""
        wall, braid = slip_shares(as_real(pressure), self.modulus)
        return wall * self.wall.force(state.wall) + braid * self.braid.force(state.braid)

    def added(self, state: SlipState, length: Real, pressure: Real, force: Real = 0.0) -> RealArray:
        """Return the force [N] to be added to the static force [N].

        The result does not depend on the static force.
        """
        del length, force
        return self.force(state, pressure)

    @compiled_method
    def states(self, length: History, pressure: History) -> SlipState:
        """Return the state at each point in a history that starts with relaxed springs.

        Args:
            length: L [m] in time order, shape (n,), including every turning point.
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
    def along(self, length: History, pressure: History) -> Float[Array, " n"]:
        """Return F_h [N] along a history that starts with relaxed springs, shape (n,); see `states`."""
        return jax.vmap(self.force)(self.states(length, pressure), as_real(pressure))

    @compiled_method
    def heat(self, length: History, pressure: History) -> Float[Array, ""]:
        """Return the energy [J] dissipated during a history, which is never negative."""
        states, heat = self.states(length, pressure), jnp.zeros_like(self.rest_length)
        change = jnp.diff(states.coordinates, axis=0)
        for k, (elements, s) in enumerate(((self.wall, states.wall), (self.braid, states.braid))):
            slid = jnp.abs(change[:, k, None] - jnp.diff(s, axis=0))
            heat += jnp.sum(elements.strength * slid)
        return self.rest_length * heat


Cycle = Literal["ramp", "stroke"]
"""Kind of cycle: a pressure ramp up and down at constant length, or a stroke at constant pressure."""


def there_and_back(path: Sequence[Either], threshold: Either) -> tuple[Either, Either]:
    """Return the deflections of initially relaxed elements on reaching a point and on returning to it.

    Args:
        path: coordinate at the start, at other turning points, at the point, at the last turn and at
            the point again, as NumPy or JAX arrays with the same shape (*n,). The coordinate changes
            monotonically from one entry to the next.
        threshold: thresholds of the elements, shape (k,).

    Returns:
        (deflection on the way there, deflection on the way back), shape (*n, k).
    """
    s: list[Either] = [0.0 * path[0][..., None] * threshold]
    for before, after in itertools.pairwise(path):
        s.append(slip(s[-1], (after - before)[..., None], threshold))
    return s[-3], s[-1]


@dataclasses.dataclass(frozen=True)
class ReferenceCycle:
    """The cycle for which the mean of the two branches is the static map.

    Attributes:
        kind: "ramp" if the pressure changes, "stroke" if the length changes.
        start, turn: gauge pressures [Pa] or lengths [m] at which the cycle starts and turns.
        cycled: True if an identical cycle precedes it; False if the elements are relaxed at the start.
    """

    kind: Cycle
    start: float
    turn: float
    cycled: bool


class CentredSlip(eqx.Module):
    """Hysteresis about a static map, with zero mean over the two branches of the reference cycle.

    Elements below their thresholds act as springs, so the mean of their force over a cycle is not zero.
    This mean depends only on length and pressure, and is subtracted as a static force. The difference
    between the branches is not affected.

    Attributes:
        slip: the elements.
        cycle: reference cycle of the static map.
    """

    slip: MaxwellSlip
    cycle: ReferenceCycle = eqx.field(static=True)

    def middle(
        self, length: Num[Array | np.ndarray, "*n"], pressure: Num[Array | np.ndarray, "*n"]
    ) -> Float[Array, "*n"]:
        """Return the mean [N] of the elements' force over both branches of the cycle through a point.

        If the point lies beyond the turn of the reference cycle, the cycle turns at the point.
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
        """Return the state at the start of a history, at a length [m] and a pressure [Pa], both scalars.

        This is the state that the muscle reaches from the start of the reference cycle: from the vented
        state at this length, or from the longest length at this pressure. If `cycled`, a full cycle
        precedes it.
        """
        there, back = self._ends(as_real(length), as_real(pressure))
        state = self.slip.start(*there)
        for at in [back, there] if self.cycle.cycled else []:
            state = self.slip.moved(state, *at)
        return self.slip.moved(state, length, pressure)

    def moved(self, state: SlipState, length: Real, pressure: Real) -> SlipState:
        """Return the state after a monotone motion to a length [m] and a pressure [Pa]."""
        return self.slip.moved(state, length, pressure)

    def added(self, state: SlipState, length: Real, pressure: Real, force: Real = 0.0) -> RealArray:
        """Return the force [N] to be added to the static force [N].

        The result does not depend on the static force.
        """
        del force
        return self.slip.force(state, pressure) - self.middle(as_real(length), as_real(pressure))

    def along(
        self, length: Float[np.ndarray, " n"], pressure: Float[np.ndarray, " n"]
    ) -> Float[Array, " n"]:
        """Return the hysteresis force [N] to be added to the static map along a history, shape (n,).

        The history starts where the reference cycle starts: vented at the first length, or at the longest
        length and the first pressure.

        Args:
            length: L [m] in time order, shape (n,), including every turning point.
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
        """Return lengths and pressures at the start and at the turn of the cycle through each point."""
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

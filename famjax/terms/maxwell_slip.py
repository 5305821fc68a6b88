"""Hysteresis with memory: Maxwell-slip elements along a history of lengths and pressures.

Both branches of a loop, minor loops inside it and the memory of turning points follow from elements
of several thresholds, without a rate.
"""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._compiled import compiled
from .._types import Given, Real, RealArray, as_number, as_real
from .slip_elements import SlipElements, slip, slip_coordinates, slip_shares


class SlipState(eqx.Module):
    """Where a history has led: all that the force of the elements depends on.

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
        """What the history adds to the static pull [N] at that pressure; the state holds its length."""
        del length
        return self.force(state, pressure)

    def volume(self, state: SlipState, length: Real) -> RealArray:
        """The elements' part of the fluid's volume [m3], without which they are not passive."""
        shortened = self.rest_length - as_real(length)
        both = self.wall.force(state.wall) + self.braid.force(state.braid)
        return shortened / self.modulus * both

    def energy(self, state: SlipState) -> RealArray:
        """Energy [J] stored in the springs."""
        return self.rest_length * (self.wall.energy(state.wall) + self.braid.energy(state.braid))

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
        return _states(self, as_real(length), as_real(pressure))

    def along(
        self,
        length: Float[Array | np.ndarray, " n"] | Sequence[float],
        pressure: Float[Array | np.ndarray, " n"] | Sequence[float],
    ) -> Float[Array, " n"]:
        """F_h [N] along a history that starts relaxed, shape (n,); see `states`."""
        return _along(self, as_real(length), as_real(pressure))

    def heat(
        self,
        length: Float[Array | np.ndarray, " n"] | Sequence[float],
        pressure: Float[Array | np.ndarray, " n"] | Sequence[float],
    ) -> Float[Array, ""]:
        """Energy [J] that the sliders have turned into heat along a history, never negative."""
        return _heat(self, as_real(length), as_real(pressure))


@compiled
def _states(of: MaxwellSlip, length: Float[Array, " n"], pressure: Float[Array, " n"]) -> SlipState:
    def step(state: SlipState, at: tuple[Array, Array]) -> tuple[SlipState, SlipState]:
        after = of.moved(state, *at)
        return after, after

    return jax.lax.scan(step, of.start(length[0], pressure[0]), (length, pressure))[1]


@compiled
def _along(
    of: MaxwellSlip, length: Float[Array, " n"], pressure: Float[Array, " n"]
) -> Float[Array, " n"]:
    return jax.vmap(of.force)(of.states(length, pressure), pressure)


@compiled
def _heat(
    of: MaxwellSlip, length: Float[Array, " n"], pressure: Float[Array, " n"]
) -> Float[Array, ""]:
    states = of.states(length, pressure)
    change = jnp.diff(states.coordinates, axis=0)
    wall = of.wall.heat(states.wall, change[:, 0])
    return of.rest_length * (wall + of.braid.heat(states.braid, change[:, 1]))

"""Feed-forward that knows the hysteresis: a pressure for each point of a trajectory, and back."""

from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._arrays import Real, RealArray, as_real, compiled
from ..muscle import AbstractMuscle, longest_equilibrium
from .inverse import HasForce, inverse_pressure
from .outcome import Answer, Outcome


@runtime_checkable
class HasMemory(Protocol):
    """Hysteresis along a history, as `famjax.slip.MaxwellSlip` or a `CentredSlip` of a fit."""

    def start(self, length: Real, pressure: Real) -> Any:
        """The state at a length [m] and a gauge pressure [Pa] at which a history begins."""
        ...

    def moved(self, state: Any, length: Real, pressure: Real) -> Any:
        """The state after a motion to a length and a pressure that does not turn round."""
        ...

    def added(self, state: Any, length: Real, pressure: Real) -> RealArray:
        """What the history adds to the static pull [N] in a state at that length and pressure."""
        ...


class CommandedPressure(Answer):
    """Pressures for a trajectory, each leaf of shape (n,).

    Attributes:
        pressure: gauge pressure P [Pa] at each point, within the limits; where the force is not
            attained that of the nearest pull, and the history goes on from there.
        code: an `Outcome` at each point: FEASIBLE, FORCE_LOW, FORCE_HIGH or NO_STATE.
    """

    pressure: RealArray
    code: Int[Array, "..."]


class FollowedLength(Answer):
    """Lengths that follow from a history of pressures, each leaf of shape (n,).

    Attributes:
        length: active length L [m] at each point; nan from where there is none.
        code: an `Outcome` at each point: FEASIBLE or NO_EQUILIBRIUM.
    """

    length: RealArray
    code: Int[Array, "..."]


class _Loaded(eqx.Module):
    """A muscle whose history is given: its pull at a next length and pressure."""

    muscle: HasForce
    memory: HasMemory
    state: Any

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Pull [N] of muscle and hysteresis after a motion to there."""
        moved = self.memory.moved(self.state, length, pressure)
        return self.muscle.force(length, pressure) + self.memory.added(moved, length, pressure)


def pressure_along(
    muscle: HasForce,
    memory: HasMemory,
    length: Real,
    force: Real,
    pressures: tuple[Real, Real],
) -> CommandedPressure:
    """The pressures at which a muscle with hysteresis pulls with given forces at given lengths.

    F(L, P) + F_h(history, P) = F at every point: the branch on which the muscle is follows from the
    points before, so that nothing is asked of a sign of the velocity, and turning points and minor
    loops are those of the elements. The history begins at the first length and the lowest pressure.

    Args:
        muscle: its static force.
        memory: its hysteresis, such as `HysteresisFit.centred` of `fitting.fit_hysteresis`.
        length: L [m] in the order of time, shape (n,); every turning point among them.
        force: F [N] there, a load or a demand, shape (n,) or ().
        pressures: lowest and highest gauge pressure [Pa].

    Returns:
        Pressures and codes, shape (n,); by `jax.lax.scan`, differentiable by the implicit function
        theorem at every point.

    References:
        Vo-Minh, Tjahjowidodo, Ramon & Van Brussel 2011, IEEE/ASME Transactions on Mechatronics
        16(1), 177-186: feed-forward of pneumatic muscles with Maxwell-slip elements.
    """
    lengths, forces = jnp.broadcast_arrays(as_real(length), as_real(force))
    low, high = (as_real(one) for one in pressures)
    return _pressure_along(muscle, memory, lengths, forces, low, high)


@compiled
def _pressure_along(
    muscle: HasForce,
    memory: HasMemory,
    lengths: Float[Array, " n"],
    forces: Float[Array, " n"],
    low: RealArray,
    high: RealArray,
) -> CommandedPressure:
    def step(state: Any, wanted: tuple[Array, Array]) -> tuple[Any, CommandedPressure]:
        L, F = wanted
        found = inverse_pressure(_Loaded(muscle, memory, state), F, L, low, high)
        # Where there is no state the history waits at the lowest pressure.
        P = jnp.where(jnp.isfinite(found.pressure), found.pressure, low)
        return memory.moved(state, L, P), CommandedPressure(found.pressure, found.code)

    return jax.lax.scan(step, memory.start(lengths[0], low), (lengths, forces))[1]


def length_along(
    muscle: AbstractMuscle,
    memory: HasMemory,
    pressure: Real,
    load: Real,
    *,
    start: Real | None = None,
) -> FollowedLength:
    """The lengths to which a muscle with hysteresis goes under a load: the inverse of the commands.

    Args:
        muscle: its static force, with its `length_range`.
        memory: its hysteresis.
        pressure: gauge pressure P [Pa] in the order of time, shape (n,).
        load: [N], shape (n,) or ().
        start: length [m] at which the history begins, at the first pressure; None for the rest
            length.

    Returns:
        Lengths and codes, shape (n,): of every state the longest at which the pull has fallen to
        the load. Without an equilibrium the muscle stays where it was.
    """
    pressures, loads = jnp.broadcast_arrays(as_real(pressure), as_real(load))
    first = muscle.rest_length if start is None else as_real(start)
    return _length_along(muscle, memory, pressures, loads, first)


@compiled
def _length_along(
    muscle: AbstractMuscle,
    memory: HasMemory,
    pressures: Float[Array, " n"],
    loads: Float[Array, " n"],
    first: RealArray,
) -> FollowedLength:
    shortest, longest = muscle.length_range()

    def step(carry: tuple, given: tuple[Array, Array]) -> tuple[tuple, FollowedLength]:
        (state, before), (P, load) = carry, given
        loaded = _Loaded(muscle, memory, state)
        length, found = longest_equilibrium(lambda L: loaded.force(L, P), shortest, longest, load)
        L = jnp.where(found, length, before)
        code = jnp.where(found, Outcome.FEASIBLE, Outcome.NO_EQUILIBRIUM)
        return (memory.moved(state, L, P), L), FollowedLength(length, code)

    first = jnp.asarray(first, jnp.result_type(pressures, first))
    return jax.lax.scan(step, (memory.start(first, pressures[0]), first), (pressures, loads))[1]

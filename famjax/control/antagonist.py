"""Two muscles that pull a joint against each other: torque, stiffness, equilibrium."""

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._arrays import Given, Real, RealArray, as_number, as_real, at_each
from ..compile_options import quick_jit
from .crossing import ROUNDED, first_crossing
from .held_pair import HeldPair
from .inverse import HasForce
from .outcome import Answer, Outcome
from .paths import AbstractPath

_CELLS = 64
_T = TypeVar("_T")


class Range(Answer):
    """What a joint can do at an angle, each leaf of the broadcast shape of what was asked.

    Attributes:
        lowest, highest: bounds, both attained; nan where the code is not FEASIBLE.
        code: an `Outcome`.
    """

    lowest: RealArray
    highest: RealArray
    code: Int[Array, "..."]


class PairPressures(Answer):
    """Pressures of an antagonistic pair, each leaf of the broadcast shape of what was asked.

    Attributes:
        flexor: gauge pressure [Pa] of the flexor.
        extensor: that of the extensor.
        stiffness: K [N m/rad] that they give.
        torque: [N m] that they give.
        code: an `Outcome`. Where it is not FEASIBLE the pressures are of the nearest feasible state,
            in torque first and then in stiffness; nan where there is none, and beyond the angles.
    """

    flexor: RealArray
    extensor: RealArray
    stiffness: RealArray
    torque: RealArray
    code: Int[Array, "..."]


class JointEquilibrium(Answer):
    """Where a joint comes to rest.

    Attributes:
        angle: [rad]; nan where there is no equilibrium.
        stiffness: K [N m/rad] there.
        code: an `Outcome`: FEASIBLE, NO_EQUILIBRIUM or NO_STATE.
    """

    angle: RealArray
    stiffness: RealArray
    code: Int[Array, "..."]


class Antagonist(eqx.Module):
    """A joint that a flexor and an extensor turn against each other.

        torque = r_f F_f + r_e F_e,   K = -d torque / d angle = sum r^2 dF/dL - F dr/d angle

    at constant pressures, with the moment arms r_f > 0 > r_e and the pulls F at the lengths of the
    paths. A muscle that would push is slack, F = 0. Pressures are those at rest: how long they take
    is a matter of `AirLine`, friction one of `pressure_along`.

    A method called as it is compiles quickly (of a bundled muscle's pair in some 15 s) and runs
    slowly; within your own `jax.jit`, `equinox.filter_jit(pair.pressures_for)`, it is compiled with all of
    XLA's optimisation: three times as long, to run three times as fast. Ask many states in one call.

    Attributes:
        flexor: the muscle that raises the angle, with `force(length, pressure)`.
        extensor: its antagonist.
        paths: of both, in that order; see `Pulley` and `Lever`.
        pressures: lowest and highest gauge pressure [Pa], shape (2,).
        angles: lowest and highest angle [rad] of the joint, shape (2,). What is asked of an angle
            outside has the code BEYOND_ANGLES and is nan; `pulls`, `torque` and `stiffness`, which
            have no code, go on.
        least_pull: [N], >= 0: the inverse maps keep both muscles at least as taut.

    References:
        Hogan 1984, IEEE Transactions on Automatic Control 29(8), 681-690: co-contraction sets the
        stiffness apart from the torque.
    """

    flexor: HasForce
    extensor: HasForce
    paths: tuple[AbstractPath, AbstractPath]
    pressures: Float[Given, "2"] = eqx.field(converter=as_number)
    angles: Float[Given, "2"] = eqx.field(converter=as_number)
    least_pull: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)

    def pulls(self, angle: Real, flexor: Real, extensor: Real) -> tuple[RealArray, RealArray]:
        """Pulls [N] of flexor and extensor at an angle [rad] and two pressures [Pa], broadcast shape.

        Zero where a muscle is slack.
        """
        return _each(self, _pulls, angle, flexor, extensor)

    def torque(self, angle: Real, flexor: Real, extensor: Real) -> RealArray:
        """Torque [N m] of the pair at an angle [rad] and two pressures [Pa], broadcast shape."""
        return _each(self, _torque, angle, flexor, extensor)

    def stiffness(self, angle: Real, flexor: Real, extensor: Real) -> RealArray:
        """Stiffness K [N m/rad] at constant pressures, broadcast shape; a slack muscle adds none."""
        return _each(self, _stiffness, angle, flexor, extensor)

    def torque_range(self, angle: Real) -> Range:
        """Least and largest torque [N m] with both muscles taut, of the angle's shape.

        Exact: the pulls rise with the pressure, so that the ends are those of the pressures.
        """
        return _each(self, _torque_range, angle)

    def stiffness_range(self, angle: Real, torque: Real = 0.0) -> Range:
        """Least and largest stiffness K [N m/rad] at an angle with a torque, broadcast shape.

        The pressures that give the torque are one curve in the box of pressures, from the state in
        which one muscle is at its least pull or pressure to that in which one is at its highest
        pressure. On it K is continuous, so that every stiffness in between is attained: this is the
        whole feasible set. The bounds are those of the ends of the curve and of the extrema inside,
        found in 32 cells and refined to the last digit.

        Args:
            angle: [rad].
            torque: of the pair [N m]; at rest the load's, with the opposite sign.

        Returns:
            The range with its code. Where that is not FEASIBLE the range is nan. Differentiable.
        """
        return _each(self, _stiffness_range, angle, torque)

    def pressures_for(self, angle: Real, stiffness: Real, torque: Real = 0.0) -> PairPressures:
        """The pressures at which the joint has a stiffness and a torque at an angle.

        Where several do, as K turns round along the curve, those with the least co-contraction.

        Args:
            angle: [rad].
            stiffness: K [N m/rad] at constant pressures.
            torque: of the pair [N m]; 0 for a joint that rests there without a load.

        Returns:
            The pressures with their code, of broadcast shape. Differentiable in all arguments and
            numbers of the pair by the implicit function theorem.
        """
        return _each(self, _pressures_for, angle, stiffness, torque)

    def equilibrium(self, flexor: Real, extensor: Real, torque: Real = 0.0) -> JointEquilibrium:
        """The angle at which the joint rests, the first stable one from the lowest angle.

        Args:
            flexor: gauge pressure [Pa].
            extensor: gauge pressure [Pa].
            torque: that the pair must have there [N m], the load's with the opposite sign.

        Returns:
            The angle with its code, of broadcast shape; looked for in 64 cells of the joint's
            angles. Differentiable by the implicit function theorem.
        """
        return _each(self, _equilibrium, flexor, extensor, torque)

    def at(self, angle: RealArray) -> HeldPair:
        """The pair held at an angle [rad], shape ()."""
        low, high = self.pressures
        return HeldPair(self.flexor, self.extensor, self.paths, low, high, self.least_pull, angle)


@quick_jit
def _batch(pair: Antagonist, one: Callable[..., _T], *given: RealArray) -> _T:
    return at_each(lambda *at: one(pair, *at), *given)


def _each(pair: Antagonist, one: Callable[..., _T], *given: Real) -> _T:
    return _batch(pair, one, *(as_real(value) for value in given))


def _pulls(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> tuple[RealArray, RealArray]:
    one, other = pair.at(angle).pulls(flexor, extensor)
    return jnp.where(one < 0, 0.0, one), jnp.where(other < 0, 0.0, other)


def _torque(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> RealArray:
    held = pair.at(angle)
    torque = held.torque(angle, flexor, extensor, slack=True)
    return jnp.where(held.known(flexor, extensor), torque, jnp.nan)


def _stiffness(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> RealArray:
    held = pair.at(angle)
    stiffness = held.stiffness(flexor, extensor, slack=True)
    return jnp.where(held.known(flexor, extensor), stiffness, jnp.nan)


def _torque_range(pair: Antagonist, angle: RealArray) -> Range:
    reach = pair.at(angle).reach()
    return _range(reach.lowest, reach.highest, _within(pair, angle, reach.code))


def _stiffness_range(pair: Antagonist, angle: RealArray, torque: RealArray) -> Range:
    curve = pair.at(angle).curve(torque)
    lowest, highest = jax.vmap(curve.stiffness)(curve.extremes())
    return _range(lowest, highest, _within(pair, angle, curve.code))


def _within(pair: Antagonist, angle: RealArray, code: Int[Array, ""]) -> Int[Array, ""]:
    """The code, or BEYOND_ANGLES where the angle is beyond the joint's by more than rounding."""
    low, high = pair.angles
    rounding = ROUNDED * jnp.finfo(angle.dtype).eps * jnp.maximum(jnp.abs(low), jnp.abs(high))
    beyond = (angle < low - rounding) | (angle > high + rounding)
    return jnp.where(beyond, Outcome.BEYOND_ANGLES, code)


def _range(lowest: RealArray, highest: RealArray, code: Int[Array, ""]) -> Range:
    there = code == Outcome.FEASIBLE
    return Range(jnp.where(there, lowest, jnp.nan), jnp.where(there, highest, jnp.nan), code)


def _pressures_for(
    pair: Antagonist, angle: RealArray, stiffness: RealArray, torque: RealArray
) -> PairPressures:
    curve = pair.at(angle).curve(torque)
    crossing = curve.share_of(stiffness)
    flexor, extensor = curve.pressures(crossing.at)
    beyond = jnp.where(stiffness < crossing.lowest, Outcome.STIFFNESS_LOW, Outcome.STIFFNESS_HIGH)
    beyond = jnp.where(jnp.isfinite(stiffness), beyond, Outcome.NO_STATE)
    code = jnp.where(crossing.found | (curve.code != Outcome.FEASIBLE), curve.code, beyond)
    code = _within(pair, angle, code)
    there = curve.exists & jnp.isfinite(stiffness) & (code != Outcome.BEYOND_ANGLES)

    def kept(value: RealArray) -> RealArray:
        return jnp.where(there, value, jnp.nan)

    made = curve.pair.stiffness(flexor, extensor, slack=False)
    return PairPressures(kept(flexor), kept(extensor), kept(made), kept(curve.torque), code)


def _equilibrium(
    pair: Antagonist, flexor: RealArray, extensor: RealArray, torque: RealArray
) -> JointEquilibrium:
    def torque_at(angle: RealArray) -> RealArray:
        return _torque(pair, angle, flexor, extensor)

    angles = jnp.linspace(pair.angles[0], pair.angles[1], _CELLS + 1)
    crossing = first_crossing(torque_at, angles, torque, falling_only=True)
    known = jnp.isfinite(crossing.highest) & jnp.isfinite(torque)
    code = jnp.where(crossing.found, Outcome.FEASIBLE, Outcome.NO_EQUILIBRIUM)
    stiffness = pair.at(crossing.at).stiffness(flexor, extensor, slack=True)
    return JointEquilibrium(
        jnp.where(crossing.found, crossing.at, jnp.nan),
        jnp.where(crossing.found, stiffness, jnp.nan),
        jnp.where(known, code, Outcome.NO_STATE),
    )

"""Two muscles that pull a joint against each other: torque, stiffness, equilibrium."""

import abc
from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._arrays import Given, Real, RealArray, as_number, as_real, at_each, of_each
from ..compile_options import quick_jit
from .inverse import ROUNDED, Answer, Crossing, HasForce, Outcome, bracketed, first_crossing

_ANGLES, _SHARES = (
    64,
    32,
)  # cells in which an equilibrium, an extremum of the stiffness is looked for
_ROUNDS = 7  # each to a 16th: to 1 part in 1e9 of the curve, squared in the value
_T = TypeVar("_T")


# --- the paths of muscles over a joint


class AbstractPath(eqx.Module):
    """Length of a muscle over the angle of a joint.

    A path of your own is a class with `length`. The moment arm follows by automatic differentiation:
    dL/dt = -r d(angle)/dt, so that the torque of a pull F is r F by virtual work.
    """

    @abc.abstractmethod
    def length(self, angle: Real) -> RealArray:
        """Active length L [m] of the muscle at an angle [rad] of the joint, of the angle's shape."""

    def moment_arm(self, angle: Real) -> RealArray:
        """Moment arm r = -dL/d(angle) [m], of the angle's shape; positive where a pull raises it."""
        angles = as_real(angle)
        return -jax.jvp(self.length, (angles,), (jnp.ones_like(angles),))[1]


class Pulley(AbstractPath):
    """A muscle whose cable runs over a pulley on the joint: L = L_0 - r angle.

    Attributes:
        radius: r [m], the moment arm: positive for a muscle that raises the angle, negative for its
            antagonist.
        middle_length: L_0 [m], active length of the muscle at angle 0.

    >>> Pulley(0.02, 0.28).length(0.5)
    Array(0.27, dtype=float64)
    """

    radius: Float[Given, ""] = eqx.field(converter=as_number)
    middle_length: Float[Given, ""] = eqx.field(converter=as_number)

    def length(self, angle: Real) -> RealArray:
        """L_0 - r angle [m], of the angle's shape."""
        return self.middle_length - self.radius * as_real(angle)


class Lever(AbstractPath):
    """A muscle between two pins, on the base and on a link that turns about the joint.

    L = |R(angle) a - b| - l: the moment arm is the distance of the line through the pins from the
    joint, and vanishes at the dead centres, where they and the joint lie on one line.

    Attributes:
        link_pin: a [m], on the link, from the joint, at angle 0, shape (2,).
        base_pin: b [m], on the base, from the joint, shape (2,).
        dead_length: l [m], what of the distance is end-fittings, rods and cable, >= 0.
    """

    link_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    base_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    dead_length: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)

    def length(self, angle: Real) -> RealArray:
        """Distance of the pins less the dead length [m], of the angle's shape."""
        turned = as_real(angle)
        x, y = self.link_pin
        cos, sin = jnp.cos(turned), jnp.sin(turned)
        across = cos * x - sin * y - self.base_pin[0]
        along = sin * x + cos * y - self.base_pin[1]
        return jnp.hypot(across, along) - self.dead_length


# --- answers


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
    is a matter of `famjax.plant`, friction one of `pressure_along`.

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

    def at(self, angle: RealArray) -> "HeldPair":
        """The pair held at an angle [rad], shape ()."""
        return HeldPair(self, angle)


@quick_jit
def _batch(pair: Antagonist, one: Callable[..., _T], *given: RealArray) -> _T:
    return at_each(lambda *at: one(pair, *at), *given)


def _each(pair: Antagonist, one: Callable[..., _T], *given: Real) -> _T:
    return _batch(pair, one, *(as_real(value) for value in given))


def _pulls(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> tuple[RealArray, RealArray]:
    pulls = pair.at(angle).forces(angle, flexor, extensor)
    taut = jnp.where(pulls < 0, 0.0, pulls)
    return taut[0], taut[1]


def _torque(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> RealArray:
    return pair.at(angle).torque(angle, flexor, extensor, slack=True)


def _stiffness(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> RealArray:
    return pair.at(angle).stiffness(flexor, extensor, slack=True)


def _torque_range(pair: Antagonist, angle: RealArray) -> Range:
    lowest, highest, *_, code = pair.at(angle).reach()
    return _range(lowest, highest, _within(pair, angle, code))


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
    exists = jnp.isin(curve.code, jnp.array(_NEAREST))
    there = exists & jnp.isfinite(stiffness) & (code != Outcome.BEYOND_ANGLES)
    made = curve.pair.stiffness(flexor, extensor, slack=False)
    flexor, extensor, made, torque = (
        jnp.where(there, one, jnp.nan) for one in (flexor, extensor, made, curve.torque)
    )
    return PairPressures(flexor, extensor, made, torque, code)


_NEAREST = (Outcome.FEASIBLE, Outcome.TORQUE_LOW, Outcome.TORQUE_HIGH)
"""Codes of a curve that there is, of the torque that was asked for or of the nearest."""


def _equilibrium(
    pair: Antagonist, flexor: RealArray, extensor: RealArray, torque: RealArray
) -> JointEquilibrium:
    angles = jnp.linspace(pair.angles[0], pair.angles[1], _ANGLES + 1)
    crossing = first_crossing(
        lambda angle: _torque(pair, angle, flexor, extensor), angles, torque, falling_only=True
    )
    known = jnp.isfinite(crossing.highest) & jnp.isfinite(torque)
    code = jnp.where(crossing.found, Outcome.FEASIBLE, Outcome.NO_EQUILIBRIUM)
    stiffness = pair.at(crossing.at).stiffness(flexor, extensor, slack=True)
    return JointEquilibrium(
        jnp.where(crossing.found, crossing.at, jnp.nan),
        jnp.where(crossing.found, stiffness, jnp.nan),
        jnp.where(known, code, Outcome.NO_STATE),
    )


# --- the pair at one angle


class HeldPair(eqx.Module):
    """A pair held at an angle [rad]; all numbers of shape (), of both muscles (2,), flexor first."""

    joint: Antagonist
    angle: RealArray

    def arms(self, angle: RealArray) -> Float[Array, "2"]:
        """Moment arms r [m]."""
        return jnp.stack([path.moment_arm(angle) for path in self.joint.paths])

    def forces(
        self, angle: RealArray, flexor: RealArray, extensor: RealArray
    ) -> Float[Array, "2 ..."]:
        """Forces [N] by the formula, at another angle [rad] and two pressures [Pa] of one shape.

        Negative where a muscle is slack, nan where it has no state.
        """
        lengths = [path.length(angle) for path in self.joint.paths]
        muscles = (self.joint.flexor, self.joint.extensor)
        return of_each(_force, muscles, lengths, [flexor, extensor])

    def torque(
        self, angle: RealArray, flexor: RealArray, extensor: RealArray, *, slack: bool
    ) -> RealArray:
        """Torque [N m] at another angle [rad]; with `slack` a muscle that would push does not.

        Without, a muscle that has no state pulls with nothing.
        """
        forces = self.forces(angle, flexor, extensor)
        missing = jnp.isnan(forces)
        taut = jnp.where(missing | (slack & (forces < 0)), 0.0, forces)
        total = jnp.sum(self.arms(angle) * taut)
        return jnp.where(slack & jnp.any(missing), jnp.nan, total)

    def stiffness(self, flexor: RealArray, extensor: RealArray, *, slack: bool) -> RealArray:
        """K = -d torque / d angle [N m/rad] at constant pressures [Pa]."""
        total, slope = jax.jvp(
            lambda angle: self.torque(angle, flexor, extensor, slack=slack),
            (self.angle,),
            (jnp.ones_like(self.angle),),
        )
        return jnp.where(jnp.isnan(total), jnp.nan, -slope)

    def reach(
        self,
    ) -> tuple[
        RealArray,
        RealArray,
        Float[Array, "2 2"],
        Float[Array, "2"],
        Float[Array, "2"],
        Int[Array, ""],
    ]:
        """Lowest and highest torque [N m] of taut muscles; limits and least pulls; arms; the code.

        Limits are the pulls [N], 0 for nan, at the least and the highest pressure, a row for each
        muscle; a least pull is at least `least_pull`.
        """
        ends, arms = self.joint.pressures, self.arms(self.angle)
        raw = self.forces(self.angle, ends, ends)
        limits = _number(raw)
        least, most = jnp.maximum(limits[:, 0], self.joint.least_pull), limits[:, 1]
        code = jnp.where(jnp.all(least <= most), Outcome.FEASIBLE, Outcome.SLACK)
        code = jnp.where((arms[0] > 0) & (arms[1] < 0), code, Outcome.MOMENT_ARM)
        code = jnp.where(jnp.all(jnp.isfinite(raw)), code, Outcome.NO_STATE)
        lowest, highest = (
            arms[0] * least[0] + arms[1] * most[1],
            arms[0] * most[0] + arms[1] * least[1],
        )
        return lowest, highest, limits, least, arms, code

    def curve(self, torque: RealArray) -> "CoContraction":
        """The pressures that give a torque [N m], or the nearest torque that the pair has."""
        lowest, highest, limits, least, (r_f, r_e), code = self.reach()
        most = limits[:, 1]
        rounding = ROUNDED * jnp.finfo(lowest.dtype).eps * (r_f * most[0] - r_e * most[1])
        feasible = code == Outcome.FEASIBLE
        code = jnp.where(feasible & (torque < lowest - rounding), Outcome.TORQUE_LOW, code)
        code = jnp.where(feasible & (torque > highest + rounding), Outcome.TORQUE_HIGH, code)
        code = jnp.where(jnp.isfinite(torque), code, Outcome.NO_STATE)
        torque = jnp.where(jnp.isfinite(torque), jnp.clip(torque, lowest, highest), lowest)
        # Arms of the wrong sign have another code, and are not to divide by zero.
        arm = jnp.where(r_f > 0, r_f, 1.0)
        ends = jnp.stack([
            jnp.maximum(least[0], (torque - r_e * least[1]) / arm),
            jnp.minimum(most[0], (torque - r_e * most[1]) / arm),
        ])  # fmt: skip
        start, end = jax.vmap(lambda pull: self.pressure(0, limits, pull))(ends)
        return CoContraction(self, torque, start, end, limits, code)

    def pressure(self, which: int, limits: Float[Array, "2 2"], pull: RealArray) -> RealArray:
        """The pressure [Pa] of a pull [N] that a muscle has between the limits, to rounding.

        Args:
            which: 0 for the flexor, 1 for the extensor.
            limits: see `reach`.
            pull: [N]. At a limit, or beyond it by rounding, the limit is the answer.
        """
        muscle = (self.joint.flexor, self.joint.extensor)[which]
        length = self.joint.paths[which].length(self.angle)
        low, high = jax.lax.stop_gradient(limits[which])
        size = jnp.where(high == low, 1.0, jnp.abs(high - low))

        def residual(pressure: RealArray) -> RealArray:
            return (_number(muscle.force(length, pressure)) - pull) / size

        return bracketed(residual, *self.joint.pressures)


class CoContraction(eqx.Module):
    """The pressures at which a pair has a torque: a curve, on which both rise together.

    Attributes:
        pair: the pair at its angle.
        torque: [N m], the nearest that the pair has.
        start, end: flexor's gauge pressure [Pa] at the ends of the curve.
        limits: see `HeldPair.reach`.
        code: an `Outcome`: FEASIBLE, TORQUE_LOW or TORQUE_HIGH, or why there is no curve.
    """

    pair: HeldPair
    torque: RealArray
    start: RealArray
    end: RealArray
    limits: Float[Array, "2 2"]
    code: Int[Array, ""]

    def pressures(self, share: RealArray) -> tuple[RealArray, RealArray]:
        """Pressures [Pa] of flexor and extensor at a share [-] of the way from start to end."""
        pair = self.pair
        r_f, r_e = pair.arms(pair.angle)
        flexor = self.start + share * (self.end - self.start)
        length = pair.joint.paths[0].length(pair.angle)
        pull = _number(pair.joint.flexor.force(length, flexor))
        wanted = (r_f * pull - self.torque) / jnp.where(r_e < 0, -r_e, 1.0)
        return flexor, pair.pressure(1, self.limits, wanted)

    def stiffness(self, share: RealArray) -> RealArray:
        """K [N m/rad] there."""
        return self.pair.stiffness(*self.pressures(share), slack=False)

    def extremes(self) -> Float[Array, "2"]:
        """Shares [-] of the way at which the stiffness is least and largest; not differentiated.

        What depends on the place of an extremum changes there in second order only.
        """
        held = jax.lax.stop_gradient(self)
        even = jnp.linspace(0.0, 1.0, _SHARES + 1, dtype=self.start.dtype)

        def extreme(sign: RealArray) -> RealArray:
            def nearer(_: object, ends: tuple) -> tuple[RealArray, RealArray, RealArray]:
                shares = ends[0] + even * (ends[1] - ends[0])
                at = jnp.argmin(sign * jax.vmap(held.stiffness)(shares))
                left, right = jnp.maximum(at - 1, 0), jnp.minimum(at + 1, _SHARES)
                return shares[left], shares[right], shares[at]

            return jax.lax.fori_loop(0, _ROUNDS, nearer, (even[0], even[-1], even[0]))[2]

        return jax.vmap(extreme)(jnp.array([1.0, -1.0], even.dtype))

    def share_of(self, stiffness: RealArray) -> Crossing:
        """The first share [-] of the way with a stiffness [N m/rad], or that with the nearest."""
        even = jnp.linspace(0.0, 1.0, _SHARES + 1, dtype=self.start.dtype)
        shares = jnp.sort(jnp.concatenate([even, self.extremes()]))
        return first_crossing(self.stiffness, shares, stiffness)


def _force(muscle: HasForce, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)


def _number(value: RealArray) -> RealArray:
    """The value, 0 where it is not a number: nan would spoil the derivatives of others in a batch."""
    return jnp.where(jnp.isfinite(value), value, 0.0)

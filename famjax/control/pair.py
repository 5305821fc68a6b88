"""Antagonistic pairs of muscles on a joint: torque, stiffness, equilibrium."""

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

_ANGLES, _SHARES = 64, 32  # cells of the search for an equilibrium, and for a stiffness extremum
_ROUNDS = 7  # each narrows the interval to a 16th: 1 part in 1e9 of the curve
_T = TypeVar("_T")


# --- paths of muscles over a joint


class AbstractPath(eqx.Module):
    """Length of a muscle as a function of the joint angle.

    Your own path is a class with `length`. The moment arm r = -dL/d(angle) follows by automatic
    differentiation, and by virtual work the torque of a pull F is r F.
    """

    @abc.abstractmethod
    def length(self, angle: Real) -> RealArray:
        """Active length L [m] of the muscle at a joint angle [rad], with the angle's shape."""

    def moment_arm(self, angle: Real) -> RealArray:
        """Moment arm r = -dL/d(angle) [m], with the angle's shape; positive if a pull raises the angle."""
        angles = as_real(angle)
        return -jax.jvp(self.length, (angles,), (jnp.ones_like(angles),))[1]


class Pulley(AbstractPath):
    """A muscle with a cable over a pulley on the joint: L = L_0 - r angle.

    Attributes:
        radius: moment arm r [m]; positive for a muscle that raises the angle, negative for its
            antagonist.
        middle_length: active length L_0 [m] at angle 0.

    >>> Pulley(0.02, 0.28).length(0.5)
    Array(0.27, dtype=float64)
    """

    radius: Float[Given, ""] = eqx.field(converter=as_number)
    middle_length: Float[Given, ""] = eqx.field(converter=as_number)

    def length(self, angle: Real) -> RealArray:
        """L_0 - r angle [m], with the angle's shape."""
        return self.middle_length - self.radius * as_real(angle)


class Lever(AbstractPath):
    """A muscle between two pins, one on the base and one on a link that turns about the joint.

    L = |R(angle) a - b| - l. The moment arm is the distance between the joint and the line through the
    pins. It vanishes at the dead centres, where pins and joint lie on one line.

    Attributes:
        link_pin: position a [m] on the link relative to the joint at angle 0, shape (2,).
        base_pin: position b [m] on the base relative to the joint, shape (2,).
        dead_length: total length l [m] of end-fittings, rods and cable, >= 0.
    """

    link_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    base_pin: Float[Given, "2"] = eqx.field(converter=as_number)
    dead_length: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)

    def length(self, angle: Real) -> RealArray:
        """Distance between the pins minus the dead length [m], with the angle's shape."""
        turned = as_real(angle)
        x, y = self.link_pin
        cos, sin = jnp.cos(turned), jnp.sin(turned)
        across = cos * x - sin * y - self.base_pin[0]
        along = sin * x + cos * y - self.base_pin[1]
        return jnp.hypot(across, along) - self.dead_length


# --- answers


class Range(Answer):
    """Range of torque or stiffness at an angle; every field has the broadcast shape of the arguments.

    Attributes:
        lowest, highest: attained bounds; nan where the code is not FEASIBLE.
        code: an `Outcome`.
    """

    lowest: RealArray
    highest: RealArray
    code: Int[Array, "..."]


class PairPressures(Answer):
    """Pressures of an antagonistic pair; every field has the broadcast shape of the arguments.

    Attributes:
        flexor: gauge pressure [Pa] of the flexor.
        extensor: gauge pressure [Pa] of the extensor.
        stiffness: resulting stiffness K [N m/rad].
        torque: resulting torque [N m].
        code: an `Outcome`. If it is not FEASIBLE, the pressures belong to the feasible state nearest
            in torque and then in stiffness; nan if there is none, or outside the angles.
    """

    flexor: RealArray
    extensor: RealArray
    stiffness: RealArray
    torque: RealArray
    code: Int[Array, "..."]


class JointEquilibrium(Answer):
    """Equilibrium of a joint.

    Attributes:
        angle: equilibrium angle [rad]; nan if there is none.
        stiffness: stiffness K [N m/rad] at this angle.
        code: an `Outcome`: FEASIBLE, NO_EQUILIBRIUM or NO_STATE.
    """

    angle: RealArray
    stiffness: RealArray
    code: Int[Array, "..."]


class Antagonist(eqx.Module):
    """A joint driven by a flexor and an extensor.

        torque = r_f F_f + r_e F_e,   K = -d torque / d angle = sum r^2 dF/dL - F dr/d angle

    at constant pressures, with the moment arms r_f > 0 > r_e and the pulls F at the path lengths. A
    muscle that would push is slack, F = 0. Pressures are static; `famjax.plant` describes their
    dynamics, and `pressure_along` includes friction.

    A direct call of a method compiles quickly (about 15 s for a pair of bundled muscles) and runs
    slowly. Inside your own `jax.jit` or `equinox.filter_jit(pair.pressures_for)` it is fully optimised:
    compilation takes three times as long, and the program runs three times as fast. Evaluate many
    states in one call.

    Attributes:
        flexor: muscle that raises the angle, with `force(length, pressure)`.
        extensor: its antagonist.
        paths: paths of flexor and extensor; see `Pulley` and `Lever`.
        pressures: lowest and highest gauge pressure [Pa], shape (2,).
        angles: lowest and highest angle [rad] of the joint, shape (2,). Results outside are nan with
            the code BEYOND_ANGLES; `pulls`, `torque` and `stiffness` have no code and are not limited.
        least_pull: least pull [N] of both muscles in the inverse maps, >= 0.

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
        """Least and largest torque [N m] with both muscles taut, with the angle's shape.

        The result is exact, because the pulls rise with the pressure.
        """
        return _each(self, _torque_range, angle)

    def stiffness_range(self, angle: Real, torque: Real = 0.0) -> Range:
        """Least and largest stiffness K [N m/rad] at an angle and a torque, broadcast shape.

        The pressures with this torque form one curve in the box of pressures, from least pull or
        pressure of one muscle to the highest pressure of one muscle. K is continuous on the curve, so
        every stiffness between the bounds is attained. The bounds are the extrema over the curve and
        its ends, located in 32 cells and refined to machine precision.

        Args:
            angle: joint angle [rad].
            torque: torque of the pair [N m]; at rest, the load's torque with the opposite sign.

        Returns:
            Range and code; nan where the code is not FEASIBLE. Differentiable.
        """
        return _each(self, _stiffness_range, angle, torque)

    def pressures_for(self, angle: Real, stiffness: Real, torque: Real = 0.0) -> PairPressures:
        """Pressures at which the joint has a given stiffness and torque at an angle.

        If several states qualify, the one with the least co-contraction is returned.

        Args:
            angle: joint angle [rad].
            stiffness: K [N m/rad] at constant pressures.
            torque: torque of the pair [N m]; 0 for a joint at rest without a load.

        Returns:
            Pressures and code, broadcast shape. Differentiable with respect to all arguments and
            parameters by the implicit function theorem.
        """
        return _each(self, _pressures_for, angle, stiffness, torque)

    def equilibrium(self, flexor: Real, extensor: Real, torque: Real = 0.0) -> JointEquilibrium:
        """First stable equilibrium angle, counted from the lowest angle.

        Args:
            flexor: gauge pressure [Pa].
            extensor: gauge pressure [Pa].
            torque: torque of the pair [N m], the load's torque with the opposite sign.

        Returns:
            Angle and code, broadcast shape; the search covers 64 cells of the joint's range.
            Differentiable by the implicit function theorem.
        """
        return _each(self, _equilibrium, flexor, extensor, torque)

    def at(self, angle: RealArray) -> "HeldPair":
        """Return the pair held at an angle [rad], shape ()."""
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
    """Return the code, or BEYOND_ANGLES if the angle is outside the joint's range beyond rounding."""
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
"""Codes with an existing curve, at the requested or the nearest torque."""


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
    """A pair held at an angle [rad]; scalars have shape (), values for both muscles (2,), flexor first."""

    joint: Antagonist
    angle: RealArray

    def arms(self, angle: RealArray) -> Float[Array, "2"]:
        """Moment arms r [m]."""
        return jnp.stack([path.moment_arm(angle) for path in self.joint.paths])

    def forces(
        self, angle: RealArray, flexor: RealArray, extensor: RealArray
    ) -> Float[Array, "2 ..."]:
        """Unclipped forces [N] at another angle [rad] and two pressures [Pa] with the same shape.

        Negative where a muscle is slack, nan at impossible states.
        """
        lengths = [path.length(angle) for path in self.joint.paths]
        muscles = (self.joint.flexor, self.joint.extensor)
        return of_each(_force, muscles, lengths, [flexor, extensor])

    def torque(
        self, angle: RealArray, flexor: RealArray, extensor: RealArray, *, slack: bool
    ) -> RealArray:
        """Torque [N m] at another angle [rad].

        With `slack`, negative forces are zero and impossible states are nan; without it, impossible
        states count as zero force.
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
        """Lowest and highest torque [N m] of taut muscles, limits, least pulls, moment arms, code.

        Limits are the pulls [N] at the lowest and the highest pressure, one row for each muscle, with 0
        for nan. The least pulls are not below `least_pull`.
        """
        ends, arms = self.joint.pressures, self.arms(self.angle)
        raw = self.forces(self.angle, ends, ends)
        limits = _number(raw)
        least, most = jnp.maximum(limits[:, 0], self.joint.least_pull), limits[:, 1]
        code = jnp.where(jnp.all(least <= most), Outcome.FEASIBLE, Outcome.SLACK)
        code = jnp.where((arms[0] > 0) & (arms[1] < 0), code, Outcome.MOMENT_ARM)
        code = jnp.where(jnp.all(jnp.isfinite(raw)), code, Outcome.NO_STATE)
        lowest = arms[0] * least[0] + arms[1] * most[1]
        highest = arms[0] * most[0] + arms[1] * least[1]
        return lowest, highest, limits, least, arms, code

    def curve(self, torque: RealArray) -> "CoContraction":
        """Return the curve of pressures with a torque [N m], or with the nearest possible torque."""
        lowest, highest, limits, least, (r_f, r_e), code = self.reach()
        most = limits[:, 1]
        rounding = ROUNDED * jnp.finfo(lowest.dtype).eps * (r_f * most[0] - r_e * most[1])
        feasible = code == Outcome.FEASIBLE
        code = jnp.where(feasible & (torque < lowest - rounding), Outcome.TORQUE_LOW, code)
        code = jnp.where(feasible & (torque > highest + rounding), Outcome.TORQUE_HIGH, code)
        code = jnp.where(jnp.isfinite(torque), code, Outcome.NO_STATE)
        torque = jnp.where(jnp.isfinite(torque), jnp.clip(torque, lowest, highest), lowest)
        # Avoid division by zero; a moment arm with the wrong sign already has its own code.
        arm = jnp.where(r_f > 0, r_f, 1.0)
        ends = jnp.stack([
            jnp.maximum(least[0], (torque - r_e * least[1]) / arm),
            jnp.minimum(most[0], (torque - r_e * most[1]) / arm),
        ])  # fmt: skip
        start, end = jax.vmap(lambda pull: self.pressure(0, limits, pull))(ends)
        return CoContraction(self, torque, start, end, limits, code)

    def pressure(self, which: int, limits: Float[Array, "2 2"], pull: RealArray) -> RealArray:
        """Return the pressure [Pa] at which a muscle has a pull [N] between its limits.

        Args:
            which: 0 for the flexor, 1 for the extensor.
            limits: see `reach`.
            pull: pull [N]; at or beyond a limit by rounding, the result is the limit.
        """
        muscle = (self.joint.flexor, self.joint.extensor)[which]
        length = self.joint.paths[which].length(self.angle)
        low, high = jax.lax.stop_gradient(limits[which])
        size = jnp.where(high == low, 1.0, jnp.abs(high - low))

        def residual(pressure: RealArray) -> RealArray:
            return (_number(muscle.force(length, pressure)) - pull) / size

        return bracketed(residual, *self.joint.pressures)


class CoContraction(eqx.Module):
    """Curve of pressures at which a pair has a torque; both pressures rise together along it.

    Attributes:
        pair: the pair at its angle.
        torque: torque [N m], the requested one or the nearest possible.
        start, end: flexor's gauge pressure [Pa] at the ends of the curve.
        limits: see `HeldPair.reach`.
        code: an `Outcome`: FEASIBLE, TORQUE_LOW or TORQUE_HIGH, or the reason why no curve exists.
    """

    pair: HeldPair
    torque: RealArray
    start: RealArray
    end: RealArray
    limits: Float[Array, "2 2"]
    code: Int[Array, ""]

    def pressures(self, share: RealArray) -> tuple[RealArray, RealArray]:
        """Pressures [Pa] of flexor and extensor at a fraction [-] of the curve."""
        pair = self.pair
        r_f, r_e = pair.arms(pair.angle)
        flexor = self.start + share * (self.end - self.start)
        length = pair.joint.paths[0].length(pair.angle)
        pull = _number(pair.joint.flexor.force(length, flexor))
        wanted = (r_f * pull - self.torque) / jnp.where(r_e < 0, -r_e, 1.0)
        return flexor, pair.pressure(1, self.limits, wanted)

    def stiffness(self, share: RealArray) -> RealArray:
        """Stiffness K [N m/rad] at a fraction of the curve."""
        return self.pair.stiffness(*self.pressures(share), slack=False)

    def extremes(self) -> Float[Array, "2"]:
        """Fractions [-] of the curve with the least and the largest stiffness; not differentiated.

        At an extremum the stiffness depends on the position only in second order.
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
        """First fraction [-] of the curve with a stiffness [N m/rad], or with the nearest one."""
        even = jnp.linspace(0.0, 1.0, _SHARES + 1, dtype=self.start.dtype)
        shares = jnp.sort(jnp.concatenate([even, self.extremes()]))
        return first_crossing(self.stiffness, shares, stiffness)


def _force(muscle: HasForce, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)


def _number(value: RealArray) -> RealArray:
    """Replace nan and inf by 0, so they do not contaminate the derivatives of a batch."""
    return jnp.where(jnp.isfinite(value), value, 0.0)

"""Antagonistic pairs of muscles on a joint: torque, stiffness and pressures."""

import abc
from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._arrays import Given, Real, RealArray, as_number, as_real, at_each, of_each
from ..compile_options import quick_jit
from .inverse import ROUNDED, Outcome, bracketed, first_crossing

_SHARES = 32  # cells of the search for a stiffness extremum
_ROUNDS = 7  # each narrows the interval to a 16th: 1 part in 1e9 of the curve


# --- paths of muscles over a joint


class AbstractPath(eqx.Module):
    """Length of a muscle as a function of the joint angle.

    To define your own path, write a class with the method `length`. The moment arm r = -dL/d(angle) is
    computed by automatic differentiation. By virtual work, the torque due to a force F is r F.
    """

    @abc.abstractmethod
    def length(self, angle: Real) -> RealArray:
        """Return the active length L [m] of the muscle at a joint angle [rad], with the angle's shape."""

    def moment_arm(self, angle: Real) -> RealArray:
        """Return the moment arm r = -dL/d(angle) [m], with the angle's shape.

        The moment arm is positive if pulling increases the angle.
        """
        angles = as_real(angle)
        return -jax.jvp(self.length, (angles,), (jnp.ones_like(angles),))[1]


class Pulley(AbstractPath):
    """Path of a muscle with a cable over a pulley on the joint: L = L_0 - r angle.

    Attributes:
        radius: moment arm r [m]; positive for a muscle that increases the angle, negative for its
            antagonist.
        middle_length: active length L_0 [m] at angle 0.

    >>> Pulley(0.02, 0.28).length(0.5)
    Array(0.27, dtype=float64)
    """

    radius: Float[Given, ""] = eqx.field(converter=as_number)
    middle_length: Float[Given, ""] = eqx.field(converter=as_number)

    def length(self, angle: Real) -> RealArray:
        """Return L_0 - r angle [m], with the angle's shape."""
        return self.middle_length - self.radius * as_real(angle)


# --- the pair


class PairPressures(eqx.Module):
    """Pressures of an antagonistic pair; every field has the broadcast shape of the arguments.

    Attributes:
        flexor: gauge pressure [Pa] of the flexor.
        extensor: gauge pressure [Pa] of the extensor.
        stiffness: resulting stiffness K [N m/rad].
        torque: resulting torque [N m].
        code: an `Outcome`. If it is not FEASIBLE, the pressures are those of the feasible state that is
            nearest in torque and then in stiffness; nan if there is no such state.
    """

    flexor: RealArray
    extensor: RealArray
    stiffness: RealArray
    torque: RealArray
    code: Int[Array, "..."]


class Antagonist(eqx.Module):
    """A joint driven by a flexor and an extensor.

        torque = r_f F_f + r_e F_e,   K = -d torque / d angle = sum r^2 dF/dL - F dr/d angle

    at constant pressures, with the moment arms r_f > 0 > r_e and the forces F at the path lengths. A
    muscle that would have to push is slack, F = 0. Pressures are static; `famjax.plant` models dynamics
    and friction.

    If you call a method directly, it compiles quickly (about 15 s for a pair of bundled muscles) but runs
    slowly. Inside your own `jax.jit` or `equinox.filter_jit(pair.pressures_for)`, it is fully optimised:
    it takes three times as long to compile, and runs three times as fast. Evaluate many states in one
    call.

    Attributes:
        flexor: muscle that increases the angle, with `force(length, pressure)`.
        extensor: antagonist of the flexor.
        paths: paths of the flexor and extensor, such as `Pulley`.
        pressures: lowest and highest allowed gauge pressures [Pa], shape (2,).
        least_pull: minimum force [N] of each muscle in the inverse maps, >= 0.

    References:
        Hogan 1984, IEEE Transactions on Automatic Control 29(8), 681-690: co-contraction sets the
        stiffness independently of the torque.
    """

    flexor: Any
    extensor: Any
    paths: tuple[AbstractPath, AbstractPath]
    pressures: Float[Given, "2"] = eqx.field(converter=as_number)
    least_pull: Float[Given, ""] = eqx.field(converter=as_number, default=0.0)

    def torque(self, angle: Real, flexor: Real, extensor: Real) -> RealArray:
        """Return the pair's torque [N m] at an angle [rad] and two pressures [Pa]; arguments broadcast."""
        return _each(_torque, self, angle, flexor, extensor)

    def pressures_for(self, angle: Real, stiffness: Real, torque: Real = 0.0) -> PairPressures:
        """Return the pressures at which the joint has a given stiffness and torque at a given angle.

        The pressures that produce this torque form one curve within the pressure limits. It starts where
        one muscle is at its minimum force or pressure, and ends where one muscle is at the highest
        pressure. K is continuous along the curve, so every stiffness between its extrema can be attained.
        The extrema are located on a grid of 32 cells and refined to machine precision. To obtain the
        lowest or highest possible stiffness, request one that cannot be attained. If several states
        qualify, the one with the least co-contraction is returned.

        Args:
            angle: joint angle [rad].
            stiffness: K [N m/rad] at constant pressures.
            torque: torque of the pair [N m]; 0 for a joint at rest without a load.

        Returns:
            The pressures and the code, with the broadcast shape. By the implicit function theorem,
            they are differentiable with respect to all arguments and parameters.
        """
        return _each(_pressures_for, self, angle, stiffness, torque)


@quick_jit
def _batch(one: Callable[..., Any], pair: Antagonist, *given: RealArray) -> Any:
    return at_each(lambda *at: one(pair, *at), *given)


def _each(one: Callable[..., Any], pair: Antagonist, *given: Real) -> Any:
    return _batch(one, pair, *(as_real(value) for value in given))


def _pressures_for(
    pair: Antagonist, angle: RealArray, stiffness: RealArray, torque: RealArray
) -> PairPressures:
    curve = _curve(pair, angle, torque)
    even = jnp.linspace(0.0, 1.0, _SHARES + 1, dtype=curve.start.dtype)
    shares = jnp.sort(jnp.concatenate([even, curve.extremes()]))
    crossing = first_crossing(curve.stiffness, shares, stiffness)
    beyond = jnp.where(stiffness < crossing.lowest, Outcome.STIFFNESS_LOW, Outcome.STIFFNESS_HIGH)
    code = jnp.where(crossing.found | (curve.code != Outcome.FEASIBLE), curve.code, beyond)
    code = jnp.where(jnp.isfinite(stiffness), code, Outcome.NO_STATE)
    flexor, extensor = curve.pressures(crossing.at)
    found = flexor, extensor, curve.stiffness(crossing.at), curve.torque
    # Up to TORQUE_HIGH, the curve exists at the requested or the nearest torque.
    a, b, K, T = (jnp.where(code <= Outcome.TORQUE_HIGH, x, jnp.nan) for x in found)
    return PairPressures(a, b, K, T, code)


# --- the pair at one angle: scalars of shape (), flexor first


def _arms(pair: Antagonist, angle: RealArray) -> Float[Array, "2"]:
    """Return the moment arms r [m]."""
    return jnp.stack([path.moment_arm(angle) for path in pair.paths])


def _forces(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> Float[Array, "2 ..."]:
    """Return unclipped forces [N] at two pressures [Pa]: negative if slack, nan in impossible states."""
    lengths = [path.length(angle) for path in pair.paths]
    return of_each(
        lambda one, *at: one.force(*at), (pair.flexor, pair.extensor), lengths, [flexor, extensor]
    )


def _torque(
    pair: Antagonist, angle: RealArray, flexor: RealArray, extensor: RealArray
) -> RealArray:
    forces = _forces(pair, angle, flexor, extensor)
    return jnp.sum(_arms(pair, angle) * jnp.where(forces < 0, 0.0, forces))


def _curve(pair: Antagonist, angle: RealArray, torque: RealArray) -> "CoContraction":
    """Return the curve of pressures that produce a torque [N m], or the nearest possible torque."""
    r_f, r_e = _arms(pair, angle)
    raw = _forces(pair, angle, pair.pressures, pair.pressures)
    limits = _finite(raw)
    least, most = jnp.maximum(limits[:, 0], pair.least_pull), limits[:, 1]
    lowest, highest = r_f * least[0] + r_e * most[1], r_f * most[0] + r_e * least[1]
    rounding = ROUNDED * jnp.finfo(lowest.dtype).eps * (r_f * most[0] - r_e * most[1])
    code = jnp.array(Outcome.FEASIBLE, int)
    for wrong, outcome in (
        (torque < lowest - rounding, Outcome.TORQUE_LOW),
        (torque > highest + rounding, Outcome.TORQUE_HIGH),
        (jnp.any(least > most), Outcome.SLACK),
        ((r_f <= 0) | (r_e >= 0), Outcome.MOMENT_ARM),
        (~(jnp.all(jnp.isfinite(raw)) & jnp.isfinite(torque)), Outcome.NO_STATE),
    ):
        code = jnp.where(wrong, outcome, code)
    torque = jnp.where(jnp.isfinite(torque), jnp.clip(torque, lowest, highest), lowest)
    # Avoid division by zero; a moment arm with the wrong sign already has its own code.
    arm = jnp.where(r_f > 0, r_f, 1.0)
    pulls = jnp.stack([
        jnp.maximum(least[0], (torque - r_e * least[1]) / arm),
        jnp.minimum(most[0], (torque - r_e * most[1]) / arm),
    ])  # fmt: skip
    start, end = jax.vmap(lambda pull: _pressure(pair, angle, 0, limits, pull))(pulls)
    return CoContraction(pair, angle, torque, start, end, limits, code)


def _pressure(
    pair: Antagonist, angle: RealArray, which: int, limits: Float[Array, "2 2"], pull: RealArray
) -> RealArray:
    """Return the pressure [Pa] at which the flexor (0) or the extensor (1) exerts a given force [N].

    For a force at or beyond its limits, the result is the pressure limit.
    """
    muscle, length = (pair.flexor, pair.extensor)[which], pair.paths[which].length(angle)
    low, high = jax.lax.stop_gradient(limits[which])
    size = jnp.where(high == low, 1.0, jnp.abs(high - low))
    return bracketed(lambda P: (_finite(muscle.force(length, P)) - pull) / size, *pair.pressures)


class CoContraction(eqx.Module):
    """Curve of pressures at which a pair exerts a given torque; along it, both pressures rise together.

    Attributes:
        pair: the pair.
        angle: joint angle [rad].
        torque: torque [N m], either as requested or the nearest possible.
        start, end: gauge pressure [Pa] of the flexor at the ends of the curve.
        limits: forces [N] at the lowest and the highest pressure, one row for each muscle.
        code: an `Outcome`: FEASIBLE, TORQUE_LOW or TORQUE_HIGH, or the reason why no curve exists.
    """

    pair: Antagonist
    angle: RealArray
    torque: RealArray
    start: RealArray
    end: RealArray
    limits: Float[Array, "2 2"]
    code: Int[Array, ""]

    def pressures(self, share: RealArray) -> tuple[RealArray, RealArray]:
        """Return the pressures [Pa] of the flexor and extensor at a fraction [-] along the curve."""
        r_f, r_e = _arms(self.pair, self.angle)
        flexor = self.start + share * (self.end - self.start)
        pull = _finite(self.pair.flexor.force(self.pair.paths[0].length(self.angle), flexor))
        wanted = (r_f * pull - self.torque) / jnp.where(r_e < 0, -r_e, 1.0)
        return flexor, _pressure(self.pair, self.angle, 1, self.limits, wanted)

    def stiffness(self, share: RealArray) -> RealArray:
        """Return the stiffness K = -d torque / d angle [N m/rad] at a fraction [-] along the curve."""
        flexor, extensor = self.pressures(share)

        def torque(angle: RealArray) -> RealArray:
            forces = _finite(_forces(self.pair, angle, flexor, extensor))
            return jnp.sum(_arms(self.pair, angle) * forces)

        return -jax.jvp(torque, (self.angle,), (jnp.ones_like(self.angle),))[1]

    def extremes(self) -> Float[Array, "2"]:
        """Return the fractions [-] along the curve at which the stiffness is lowest and highest.

        The fractions are not differentiated: at an extremum, the stiffness depends on the position only
        to second order.
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


def _finite(value: RealArray) -> RealArray:
    """Replace nan and inf with 0, so they do not contaminate the derivatives of a batch."""
    return jnp.where(jnp.isfinite(value), value, 0.0)

"""An antagonistic pair at one angle: its torque and stiffness, and the curve of co-contraction."""

from collections.abc import Sequence

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._arrays import RealArray, of_each
from .crossing import ROUNDED, Crossing, bracketed, first_crossing
from .inverse import HasForce
from .outcome import Outcome
from .paths import AbstractPath

_CELLS = 32
_ROUNDS = 7  # each to a 16th: to 1 part in 1e9 of the curve, squared in the value


class HeldPair(eqx.Module):
    """A flexor and an extensor on a joint, all numbers of shape ().

    Attributes:
        flexor, extensor: the muscles.
        paths: of both, in that order.
        low, high: least and highest gauge pressure [Pa].
        least_pull: [N].
        angle: of the joint [rad].
    """

    flexor: HasForce
    extensor: HasForce
    paths: tuple[AbstractPath, AbstractPath]
    low: RealArray
    high: RealArray
    least_pull: RealArray
    angle: RealArray

    @property
    def arms(self) -> tuple[RealArray, RealArray]:
        """Moment arms r [m] of flexor and extensor."""
        flexor, extensor = self.paths
        return flexor.moment_arm(self.angle), extensor.moment_arm(self.angle)

    def pulls(self, flexor: RealArray, extensor: RealArray) -> tuple[RealArray, RealArray]:
        """Pulls [N] by the formula at two pressures [Pa]: negative where slack, nan with no state."""
        return self._forces([path.length(self.angle) for path in self.paths], [flexor, extensor])

    def _forces(
        self, lengths: Sequence[RealArray], pressures: Sequence[RealArray]
    ) -> tuple[RealArray, RealArray]:
        """Forces [N] of flexor and extensor, each at its length [m] and pressures [Pa] of one shape."""
        both = of_each(_force, (self.flexor, self.extensor), lengths, pressures)
        return both[0], both[1]

    def torque(
        self, angle: RealArray, flexor: RealArray, extensor: RealArray, *, slack: bool
    ) -> RealArray:
        """Torque [N m] at another angle [rad]; 0 where there is no state, see `known`.

        With `slack` a muscle that would push pulls with nothing.
        """
        total = jnp.zeros_like(angle)
        forces = self._forces([path.length(angle) for path in self.paths], [flexor, extensor])
        for force, path in zip(forces, self.paths, strict=True):
            taut = (force >= 0) if slack else jnp.isfinite(force)
            total = total + path.moment_arm(angle) * jnp.where(taut, force, 0.0)
        return total

    def stiffness(self, flexor: RealArray, extensor: RealArray, *, slack: bool) -> RealArray:
        """K = -d torque / d angle [N m/rad] at constant pressures [Pa]."""

        def torque(angle: RealArray) -> RealArray:
            return self.torque(angle, flexor, extensor, slack=slack)

        return -jax.jvp(torque, (self.angle,), (jnp.ones_like(self.angle),))[1]

    def known(self, flexor: RealArray, extensor: RealArray) -> Bool[Array, ""]:
        """Whether both muscles have a state."""
        one, other = self.pulls(flexor, extensor)
        return jnp.isfinite(one) & jnp.isfinite(other)

    def reach(self) -> "PairReach":
        """What the pair can do at its angle."""
        (r_f, r_e), ends = self.arms, jnp.stack([self.low, self.high])
        lengths = [path.length(self.angle) for path in self.paths]
        raw = jnp.stack(self._forces(lengths, [ends, ends]))
        limits = _number(raw)
        least = jnp.maximum(limits[:, 0], self.least_pull)
        flexor, extensor = ((least[k], limits[k, 1]) for k in (0, 1))
        lowest = r_f * flexor[0] + r_e * extensor[1]
        highest = r_f * flexor[1] + r_e * extensor[0]
        taut = (flexor[0] <= flexor[1]) & (extensor[0] <= extensor[1])
        code = jnp.where(taut, Outcome.FEASIBLE, Outcome.SLACK)
        code = jnp.where((r_f > 0) & (r_e < 0), code, Outcome.MOMENT_ARM)
        code = jnp.where(jnp.all(jnp.isfinite(raw)), code, Outcome.NO_STATE)
        return PairReach(lowest, highest, flexor, extensor, limits, code)

    def curve(self, torque: RealArray) -> "CoContraction":
        """The pressures that give a torque [N m], or the nearest torque that the pair has."""
        (r_f, r_e), reach = self.arms, self.reach()
        flexor, extensor, lowest, highest = (
            reach.flexor, reach.extensor, reach.lowest, reach.highest,
        )  # fmt: skip
        rounding = ROUNDED * jnp.finfo(lowest.dtype).eps * (r_f * flexor[1] - r_e * extensor[1])
        beyond = jnp.where(
            torque < lowest - rounding,
            Outcome.TORQUE_LOW,
            jnp.where(torque > highest + rounding, Outcome.TORQUE_HIGH, Outcome.FEASIBLE),
        )
        code = jnp.where(reach.code == Outcome.FEASIBLE, beyond, reach.code)
        code = jnp.where(jnp.isfinite(torque), code, Outcome.NO_STATE)
        torque = jnp.where(jnp.isfinite(torque), jnp.clip(torque, lowest, highest), lowest)
        # Arms of the wrong sign have another code, and are not to divide by zero.
        arm = jnp.where(r_f > 0, r_f, 1.0)
        ends = (
            jnp.maximum(flexor[0], (torque - r_e * extensor[0]) / arm),
            jnp.minimum(flexor[1], (torque - r_e * extensor[1]) / arm),
        )
        start, end = jax.vmap(lambda pull: self.pressure(0, reach.limits, pull))(jnp.stack(ends))
        return CoContraction(self, torque, start, end, reach.limits, code)

    def pressure(self, which: int, limits: Float[Array, "2 2"], pull: RealArray) -> RealArray:
        """The pressure [Pa] of a pull [N] that a muscle has between the limits, to rounding.

        Args:
            which: 0 for the flexor, 1 for the extensor.
            limits: its pull [N], and the other's, at the least and the highest pressure.
            pull: [N].
        """
        muscle = (self.flexor, self.extensor)[which]
        length = self.paths[which].length(self.angle)

        def residual(pressure: RealArray) -> RealArray:
            return (_number(muscle.force(length, pressure)) - pull) / size

        values = jax.lax.stop_gradient(limits[which])
        size = jnp.where(values[1] == values[0], 1.0, jnp.abs(values[1] - values[0]))
        left = (values - jax.lax.stop_gradient(pull)) / size
        # At a limit, or beyond it by rounding, the limit is the answer.
        left = jnp.stack([jnp.minimum(left[0], 0.0), jnp.maximum(left[1], 0.0)])
        return bracketed(residual, (self.low, left[0]), (self.high, left[1]))


class PairReach(eqx.Module):
    """What a pair can do at its angle.

    Attributes:
        lowest, highest: torque [N m] with both muscles taut.
        flexor, extensor: least and largest taut pull [N], a number in any case.
        limits: pulls [N] of both, a row each, at the least and the highest pressure; 0 for nan.
        code: an `Outcome`.
    """

    lowest: RealArray
    highest: RealArray
    flexor: tuple[RealArray, RealArray]
    extensor: tuple[RealArray, RealArray]
    limits: Float[Array, "2 2"]
    code: Int[Array, ""]


class CoContraction(eqx.Module):
    """The pressures at which a pair has a torque: a curve, on which both rise together.

    Attributes:
        pair: the pair at its angle.
        torque: [N m], the nearest that the pair has.
        start, end: flexor's gauge pressure [Pa] at the ends of the curve.
        limits: see `PairReach`.
        code: an `Outcome`: FEASIBLE, TORQUE_LOW or TORQUE_HIGH, or why there is no curve.
    """

    pair: HeldPair
    torque: RealArray
    start: RealArray
    end: RealArray
    limits: Float[Array, "2 2"]
    code: Int[Array, ""]

    @property
    def exists(self) -> Bool[Array, ""]:
        """Whether there is a curve, of this or of the nearest torque."""
        reached = (Outcome.FEASIBLE, Outcome.TORQUE_LOW, Outcome.TORQUE_HIGH)
        return jnp.any(jnp.stack([self.code == one for one in reached]))

    def pressures(self, share: RealArray) -> tuple[RealArray, RealArray]:
        """Pressures [Pa] of flexor and extensor at a share [-] of the way from start to end."""
        pair, (r_f, r_e) = self.pair, self.pair.arms
        flexor = self.start + share * (self.end - self.start)
        length = pair.paths[0].length(pair.angle)
        pull = _number(pair.flexor.force(length, flexor))
        arm = jnp.where(r_e < 0, -r_e, 1.0)
        wanted = (r_f * pull - self.torque) / arm
        return flexor, pair.pressure(1, self.limits, wanted)

    def stiffness(self, share: RealArray) -> RealArray:
        """K [N m/rad] there."""
        return self.pair.stiffness(*self.pressures(share), slack=False)

    def extremes(self) -> Float[Array, "2"]:
        """Shares [-] of the way at which the stiffness is least and largest; not differentiated.

        What depends on the place of an extremum changes there in second order only.
        """
        held = jax.lax.stop_gradient(self)
        even = jnp.linspace(0.0, 1.0, _CELLS + 1, dtype=self.start.dtype)

        def extreme(sign: RealArray) -> RealArray:
            def nearer(_: object, ends: tuple) -> tuple[RealArray, RealArray, RealArray]:
                shares = ends[0] + even * (ends[1] - ends[0])
                at = jnp.argmin(sign * jax.vmap(held.stiffness)(shares))
                left, right = jnp.maximum(at - 1, 0), jnp.minimum(at + 1, _CELLS)
                return shares[left], shares[right], shares[at]

            return jax.lax.fori_loop(0, _ROUNDS, nearer, (even[0], even[-1], even[0]))[2]

        return jax.vmap(extreme)(jnp.array([1.0, -1.0], even.dtype))

    def share_of(self, stiffness: RealArray) -> Crossing:
        """The first share [-] of the way with a stiffness [N m/rad], or that with the nearest."""
        even = jnp.linspace(0.0, 1.0, _CELLS + 1, dtype=self.start.dtype)
        shares = jnp.sort(jnp.concatenate([even, self.extremes()]))
        return first_crossing(self.stiffness, shares, stiffness)


def _force(muscle: HasForce, length: RealArray, pressure: RealArray) -> RealArray:
    return muscle.force(length, pressure)


def _number(value: RealArray) -> RealArray:
    """The value, 0 where it is not a number: nan would spoil the derivatives of others in a batch."""
    return jnp.where(jnp.isfinite(value), value, 0.0)

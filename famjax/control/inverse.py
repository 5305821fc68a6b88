"""The pressure for a force: at one state, and along a trajectory with hysteresis."""

import enum
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Bool, Float, Int

from .._arrays import Real, RealArray, as_real, at_each, compiled
from ..muscle import bisected

_CELLS = 16
ROUNDED = 64  # times the precision, per largest value: a few sums and powers of rounded numbers


class Outcome(enum.IntEnum):
    """Outcome of an inverse map; `message` is a sentence with a remedy.

    Results carry it as an integer array `code`, so that one point of a batch that cannot be reached
    leaves the others as they are. `FEASIBLE` is 0. As text an outcome is its name, a colon and its
    message; `Outcome.words` has those of codes, be they one or an array of any shape.

    >>> print(Outcome(2).name, "/", Outcome.FEASIBLE)
    FORCE_HIGH / FEASIBLE: what was asked for is attained
    >>> Outcome.words([0, 2])
    array(['FEASIBLE', 'FORCE_HIGH'], dtype='<U10')
    """

    message: str

    def __new__(cls, code: int, message: str) -> "Outcome":
        """A code with its sentence."""
        made = int.__new__(cls, code)
        made._value_, made.message = code, message
        return made

    FEASIBLE = 0, "what was asked for is attained"
    FORCE_LOW = 1, "less than the muscle pulls at any allowed pressure: ask for more, or shorten it"
    FORCE_HIGH = (
        2,
        "more than the muscle pulls at any allowed pressure: ask for less, or lengthen it",
    )
    STIFFNESS_LOW = 3, "too soft for that torque: ask for at least stiffness_range(...).lowest"
    STIFFNESS_HIGH = 4, "too stiff for that torque: ask for at most stiffness_range(...).highest"
    TORQUE_LOW = 5, "below all torques of the taut pair at that angle: see torque_range"
    TORQUE_HIGH = 6, "above all torques of the taut pair at that angle: see torque_range"
    SLACK = 7, "a muscle is too short for the least pull at that angle: lengthen its path"
    NO_STATE = 8, "no force at that length, or an input is nan: compare muscle.length_range()"
    MOMENT_ARM = 9, "the lever has passed its dead centre, or the paths are exchanged"
    NO_EQUILIBRIUM = 10, "no equilibrium within the joint's angles: lower the load, or widen them"
    BEYOND_ANGLES = 11, "the angle is outside the joint's own: widen Antagonist.angles"

    def __str__(self) -> str:
        return f"{self.name}: {self.message}"

    @classmethod
    def words(cls, codes: Any, *, messages: bool = False) -> Any:
        """The names of codes.

        Args:
            codes: of a result, an integer or an array of integers of any shape; not traced.
            messages: the full sentences as well, each after its name.

        Returns:
            A text for one code, or an array of texts of the codes' shape.

        Raises:
            ValueError: a number that is no code.
        """
        given = np.asarray(codes)
        texts = [str(one) if messages else one.name for one in map(cls, given.ravel().tolist())]
        return np.array(texts).reshape(given.shape) if given.ndim else texts[0]


class Answer(eqx.Module):
    """A result with status codes; its printed form shows the numbers, and the codes as words.

    Attributes:
        code: an `Outcome` of each member.
    """

    code: eqx.AbstractVar[jax.Array]

    @property
    def outcome(self) -> Any:
        """The codes' names: a text for one code, or an array of texts; not while JAX traces."""
        return Outcome.words(self.code)

    def __repr__(self) -> str:
        leaves = {name: getattr(self, name) for name in self.__dataclass_fields__}
        if any(isinstance(one, Tracer) or not hasattr(one, "dtype") for one in leaves.values()):
            return eqx.tree_pformat(self)
        del leaves["code"]
        form: Any = {"threshold": 12, "separator": ", ", "formatter": {"float": "{:.6g}".format}}
        said = {name: np.array2string(np.asarray(one), **form) for name, one in leaves.items()}
        said["outcome"] = str(self.outcome)
        parts = ", ".join(f"{name}={' '.join(text.split())}" for name, text in said.items())
        return f"{type(self).__name__}({parts})"


@runtime_checkable
class HasForce(Protocol):
    """Any object with a force: a `Muscle`, a published model, a muscle from a file."""

    def force(self, length: Real, pressure: Real) -> RealArray:
        """Static pull F [N] at active length L [m] and gauge pressure P [Pa]."""
        ...


# --- the first place at which a function takes a value


class Crossing(eqx.Module):
    """Where a function takes a value, and its values at the stations.

    Attributes:
        at: the first such place; where there is none, the station of the nearest value, nan where
            no value is a number.
        found: whether the value is taken.
        lowest, highest: values at the stations, nan where none is a number; not differentiated.
    """

    at: RealArray
    found: Bool[Array, ""]
    lowest: RealArray
    highest: RealArray


def first_crossing(
    function: Callable[[RealArray], RealArray],
    stations: Float[Array, " n"],
    target: RealArray,
    *,
    falling_only: bool = False,
) -> Crossing:
    """First position between stations where a function reaches a given value.

    The stations are walked in their order to the first cell with the value between its ends, and
    that cell is bisected to the last digit. A value that is beyond all others by rounding alone is
    found at the nearest station.

    Args:
        function: f(x), of a scalar. What it depends on besides x is differentiated by the implicit
            function theorem, to any order.
        stations: x, rising, shape (n,); not differentiated.
        target: value that is looked for, shape ().
        falling_only: pass cells in which the function rises.
    """
    stations = jax.lax.stop_gradient(stations)
    values = jax.lax.stop_gradient(jax.vmap(function)(stations))
    wanted = jax.lax.stop_gradient(target)
    numbers = jnp.isfinite(values)
    known = jnp.any(numbers)
    least_at = jnp.argmin(jnp.where(numbers, values, jnp.inf))
    most_at = jnp.argmax(jnp.where(numbers, values, -jnp.inf))
    lowest = jnp.where(known, values[least_at], jnp.nan)
    highest = jnp.where(known, values[most_at], jnp.nan)
    size = jnp.where(known, jnp.maximum(jnp.abs(lowest), jnp.abs(highest)), 1.0)

    # A value beyond the others by rounding is one of theirs.
    inside = jnp.clip(wanted, lowest, highest)
    within = jnp.abs(wanted - inside) <= ROUNDED * jnp.finfo(values.dtype).eps * size
    left = jnp.where(within, inside, wanted) - values
    before, after = left[:-1], left[1:]
    falls = (before <= 0) & (after >= 0)
    rises = (before >= 0) & (after <= 0)
    cells = numbers[:-1] & numbers[1:] & (falls if falling_only else falls | rises)
    found, cell = jnp.any(cells), jnp.argmax(cells)
    change = jnp.abs(values[cell + 1] - values[cell])
    scale = jnp.where(found & (change > 0), change, jnp.maximum(size, 1.0))
    root = bracketed(
        lambda x: (function(x) - target) / scale,
        stations[cell],
        stations[cell + 1],
        falls=values[cell] > values[cell + 1],
    )
    nearest = stations[jnp.where(wanted > highest, most_at, least_at)]
    at = jnp.where(found, root, jnp.where(known, nearest, jnp.nan))
    return Crossing(at, found & jnp.isfinite(wanted), lowest, highest)


def bracketed(
    residual: Callable[[RealArray], RealArray],
    low: RealArray,
    high: RealArray,
    *,
    falls: Bool[Array, ""] | bool = False,
) -> RealArray:
    """The root of a residual between two points, with the derivatives of the implicit function theorem.

    Bisected to the last digit of the bracket. Where it holds no root some point of it is returned.

    Args:
        residual: r(x), of a scalar, of order one in the bracket.
        low: lower end, shape ().
        high: upper end.
        falls: whether the residual does, from the one to the other.
    """
    low, high = jax.lax.stop_gradient((low, high))
    width, fine = jnp.where(high == low, 1.0, high - low), jnp.finfo(jnp.result_type(low))
    sign = jnp.where(falls, -1.0, 1.0)
    share = bisected(
        lambda share: sign * residual(low + share * width),
        jnp.zeros_like(width),
        jnp.ones_like(width),
        tolerance=float(fine.eps),
        max_steps=fine.nmant + 2,
    )
    return low + share * width


# --- the pressure for a force


class InversePressure(Answer):
    """A pressure for a force, of the broadcast shape of the arguments.

    Attributes:
        pressure: P [Pa], within the limits. Where the force is not attained, that of the nearest
            pull; nan where the muscle has no state.
        force: pull [N] at that pressure.
        code: an `Outcome`: FEASIBLE, FORCE_LOW, FORCE_HIGH or NO_STATE.
    """

    pressure: RealArray
    force: RealArray
    code: Int[Array, "..."]

    @property
    def feasible(self) -> Array:
        """Whether the force is attained, of the same shape."""
        return self.code == Outcome.FEASIBLE


def pressure_for_force(
    muscle: HasForce, force: Real, length: Real, pressures: tuple[Real, Real]
) -> InversePressure:
    """The lowest pressure at which a muscle pulls with a given force at a given length.

    F(L, P) = F: bracketed in 16 cells between the limits and bisected to the last digit, so that
    it is found where dF/dP > 0 throughout and also where the force turns round. A muscle only pulls:
    a negative force is FORCE_LOW, and the answer the pressure of the least pull; force zero is
    answered by the pressure of the onset.

    Args:
        muscle: with `force(length, pressure)`.
        force: F [N].
        length: active length L [m].
        pressures: lowest and highest gauge pressure [Pa], lowest < highest.

    Returns:
        The pressure with its code, of the broadcast shape of force and length. Differentiable in
        force, length and every number of the muscle by the implicit function theorem, to any order;
        where the force is not attained, the limits do not depend on them.

    >>> import famjax, numpy as np
    >>> braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
    >>> muscle = famjax.Muscle(shape, famjax.materials.NeoHookeanMaterial(3e5), 40e3)
    >>> found = pressure_for_force(muscle, np.array([500.0, 5000.0]), 0.28, (0.0, 6e5))
    >>> [f"{kPa:.1f}" for kPa in found.pressure / 1e3], [Outcome(int(c)).name for c in found.code]
    (['284.0', '600.0'], ['FEASIBLE', 'FORCE_HIGH'])
    """
    low, high = (as_real(one) for one in pressures)
    return _at_each_state(muscle, as_real(force), as_real(length), low, high)


@compiled
def _at_each_state(
    muscle: HasForce, force: RealArray, length: RealArray, low: RealArray, high: RealArray
) -> InversePressure:
    def one(F: RealArray, L: RealArray, low: RealArray, high: RealArray) -> InversePressure:
        return _inverse(lambda P: muscle.force(L, P), F, low, high)

    return at_each(one, force, length, low, high)


def _inverse(
    pull: Callable[[RealArray], RealArray], force: RealArray, low: RealArray, high: RealArray
) -> InversePressure:
    """The pressure of a pull, one number each."""
    # What is below zero is no pull; nearest to it is none at all.
    wanted = jnp.where(force < 0, jnp.zeros_like(force), force)
    crossing = first_crossing(pull, jnp.linspace(low, high, _CELLS + 1), wanted)
    known = jnp.isfinite(crossing.highest) & jnp.isfinite(force)
    below = (force < 0) | (force < crossing.lowest)
    beyond = jnp.where(below, Outcome.FORCE_LOW, Outcome.FORCE_HIGH)
    code = jnp.where(crossing.found & (force >= 0), Outcome.FEASIBLE, beyond)
    return InversePressure(
        jnp.where(known, crossing.at, jnp.nan),
        jnp.where(known, pull(crossing.at), jnp.nan),
        jnp.where(known, code, Outcome.NO_STATE).astype(int),
    )


# --- along a trajectory


@runtime_checkable
class HasMemory(Protocol):
    """Hysteresis along a history: a `famjax.slip.MaxwellSlip` or a `CentredSlip` of a fit."""

    def start(self, length: Real, pressure: Real) -> Any:
        """The state at the start of a history, at a length [m] and a gauge pressure [Pa]."""
        ...

    def moved(self, state: Any, length: Real, pressure: Real) -> Any:
        """The state after a monotone motion to a length and a pressure."""
        ...

    def added(self, state: Any, length: Real, pressure: Real) -> RealArray:
        """Force [N] that the history adds to the static force at that length and pressure."""
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

        def pull(P: RealArray) -> RealArray:
            return muscle.force(L, P) + memory.added(memory.moved(state, L, P), L, P)

        found = _inverse(pull, F, low, high)
        # Where there is no state the history waits at the lowest pressure.
        P = jnp.where(jnp.isfinite(found.pressure), found.pressure, low)
        return memory.moved(state, L, P), CommandedPressure(found.pressure, found.code)

    return jax.lax.scan(step, memory.start(lengths[0], low), (lengths, forces))[1]

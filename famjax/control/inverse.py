"""Find the pressure required for a force, and the roots of functions that may not be monotone."""

import enum
from collections.abc import Callable
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Int

from .._arrays import Real, RealArray, as_real, at_each, compiled
from ..muscle import bisected

_CELLS = 16
ROUNDED = 64  # rounding allowance in units of eps times the largest value


class Outcome(enum.IntEnum):
    """Outcome of an inverse map; `message` describes the problem and its remedy.

    Results contain the outcome as an integer array `code`, so one infeasible point does not affect the
    rest of a batch. `FEASIBLE` is 0. `str(outcome)` returns the name, a colon and the message.
    `Outcome.words` converts one code or an array of codes to names.

    >>> print(Outcome(2).name, "/", Outcome.FEASIBLE)
    FORCE_HIGH / FEASIBLE: the requested value is attained
    >>> Outcome.words([0, 2])
    array(['FEASIBLE', 'FORCE_HIGH'], dtype='<U10')
    """

    message: str

    def __new__(cls, code: int, message: str) -> "Outcome":
        """Create an outcome from its code and message."""
        made = int.__new__(cls, code)
        made._value_, made.message = code, message
        return made

    FEASIBLE = 0, "the requested value is attained"
    FORCE_LOW = (
        1,
        "the force is too low for the allowed pressures: request a larger force, or shorten the muscle",
    )
    FORCE_HIGH = (
        2,
        "the force is too high for the allowed pressures: request a smaller force, or lengthen the muscle",
    )
    STIFFNESS_LOW = (
        3,
        "the stiffness is too low for this torque: the result has the lowest possible stiffness",
    )
    STIFFNESS_HIGH = (
        4,
        "the stiffness is too high for this torque: the result has the highest possible stiffness",
    )
    TORQUE_LOW = (
        5,
        "the torque is too low for this angle with both muscles taut: request a larger torque",
    )
    TORQUE_HIGH = (
        6,
        "the torque is too high for this angle with both muscles taut: request a smaller torque",
    )
    SLACK = 7, "at this angle, a muscle is too short to exert the minimum force: lengthen its path"
    NO_STATE = (
        8,
        "the force is undefined at this length (see muscle.length_range()), or an input is nan",
    )
    MOMENT_ARM = (
        9,
        "a moment arm has the wrong sign: the joint is at a dead centre, or the paths are swapped",
    )

    def __str__(self) -> str:
        return f"{self.name}: {self.message}"

    @classmethod
    def words(cls, codes: Any) -> np.ndarray:
        """Convert an untraced integer or integer array to an array of names with the same shape.

        Raises:
            ValueError: an integer is not a valid code.
        """
        given = np.asarray(codes)
        names = [cls(code).name for code in given.ravel().tolist()]
        return np.array(names).reshape(given.shape)


# --- first crossing of a value


class Crossing(NamedTuple):
    """First position at which a function reaches a value.

    Attributes:
        at: the position. If the value is not reached, the station with the nearest value; nan if no
            station has a finite value.
        found: True if the value is reached.
        lowest, highest: lowest and highest values at the stations; nan if none is finite. They are not
            differentiated.
    """

    at: RealArray
    found: Bool[Array, ""]
    lowest: RealArray
    highest: RealArray


def first_crossing(function: Callable, stations: RealArray, target: RealArray) -> Crossing:
    """Find the first position between stations where a function reaches a target value.

    The search bisects the first cell whose end values bracket the target, to machine precision. A
    target that lies outside all values only because of rounding is found at the nearest station.

    Args:
        function: f(x) of a scalar. The implicit function theorem provides derivatives of any order with
            respect to other variables.
        stations: increasing x, shape (n,); not differentiated.
        target: target value, shape ().
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

    # A target outside the values by rounding alone is clipped to them.
    inside = jnp.clip(wanted, lowest, highest)
    within = jnp.abs(wanted - inside) <= ROUNDED * jnp.finfo(values.dtype).eps * size
    left = jnp.where(within, inside, wanted) - values
    before, after = left[:-1], left[1:]
    cells = numbers[:-1] & numbers[1:] & (jnp.sign(before) * jnp.sign(after) <= 0)
    found, cell = jnp.any(cells), jnp.argmax(cells)
    change = jnp.abs(values[cell + 1] - values[cell])
    scale = jnp.where(found & (change > 0), change, jnp.maximum(size, 1.0))
    falls = values[cell] > values[cell + 1]
    ends = stations[cell], stations[cell + 1]
    root = bracketed(lambda x: (function(x) - target) / scale, *ends, falls=falls)
    nearest = stations[jnp.where(wanted > highest, most_at, least_at)]
    at = jnp.where(found, root, jnp.where(known, nearest, jnp.nan))
    return Crossing(at, found & jnp.isfinite(wanted), lowest, highest)


def bracketed(
    residual: Callable, low: RealArray, high: RealArray, *, falls: Any = False
) -> RealArray:
    """Find a bracketed root by bisection, differentiable by the implicit function theorem.

    If the bracket contains no root, some point in the bracket is returned.

    Args:
        residual: r(x) of a scalar, with values of order one in the bracket.
        low: lower end of the bracket, shape ().
        high: upper end of the bracket, shape ().
        falls: True if the residual decreases from the lower to the upper end.
    """
    low, high = jax.lax.stop_gradient((low, high))
    width = jnp.where(high == low, 1.0, high - low)
    sign = jnp.where(falls, -1.0, 1.0)
    share = bisected(
        lambda share: sign * residual(low + share * width), jnp.zeros_like(width),
        jnp.ones_like(width),
    )  # fmt: skip
    return low + share * width


# --- pressure at one state


class InversePressure(eqx.Module):
    """Pressure required for a force; every field has the broadcast shape of the arguments.

    Attributes:
        pressure: P [Pa] within the limits. If the force cannot be attained, the pressure with the nearest
            force; nan if the force is undefined.
        force: force [N] at this pressure.
        code: an `Outcome`: FEASIBLE, FORCE_LOW, FORCE_HIGH or NO_STATE.
    """

    pressure: RealArray
    force: RealArray
    code: Int[Array, "..."]


def pressure_for_force(
    muscle: Any, force: Real, length: Real, pressures: tuple[Real, Real]
) -> InversePressure:
    """Find the lowest pressure at which a muscle pulls with a given force at a given length.

    The solution of F(L, P) = F is bracketed in one of 16 cells between the limits and then bisected to
    machine precision, so the force need not be monotone in pressure. A muscle can only pull: for a
    negative force, the function returns FORCE_LOW and the pressure with the least force. For a force of
    zero, it returns the onset pressure.

    Args:
        muscle: object with `force(length, pressure)`.
        force: F [N].
        length: active length L [m].
        pressures: lowest and highest gauge pressure [Pa], lowest < highest.

    Returns:
        The pressure and the code, with the broadcast shape of force and length. By the implicit
        function theorem, the pressure is differentiable to any order with respect to force, length
        and every number in the muscle. Where the force cannot be attained, the pressure does not
        depend on them.

    >>> import famjax, numpy as np
    >>> braid = famjax.Braid.from_rest(diameter=0.023, braid_angle=1.1, length=0.296)
    >>> shape = famjax.EstimatedGeometry(braid, famjax.Bladder(0.296, 0.023, 1.8e-3, embedded=True))
    >>> muscle = famjax.Muscle(shape, famjax.materials.NeoHookeanMaterial(3e5), 40e3)
    >>> found = pressure_for_force(muscle, np.array([500.0, 5000.0]), 0.28, (0.0, 6e5))
    >>> [f"{kPa:.1f}" for kPa in found.pressure / 1e3], [Outcome(int(c)).name for c in found.code]
    (['284.0', '600.0'], ['FEASIBLE', 'FORCE_HIGH'])
    """
    return _at_each_state(muscle, *map(as_real, (force, length, *pressures)))


@compiled
def _at_each_state(muscle: Any, *states: RealArray) -> InversePressure:
    def one(F: RealArray, L: RealArray, low: RealArray, high: RealArray) -> InversePressure:
        stations = jnp.linspace(low, high, _CELLS + 1)
        wanted = jnp.where(F < 0, jnp.zeros_like(F), F)
        crossing = first_crossing(lambda P: muscle.force(L, P), stations, wanted)
        known = jnp.isfinite(crossing.highest) & jnp.isfinite(F)
        below = (F < 0) | (crossing.lowest > F)
        beyond = jnp.where(below, Outcome.FORCE_LOW, Outcome.FORCE_HIGH)
        code = jnp.where(crossing.found & (F >= 0), Outcome.FEASIBLE, beyond)
        return InversePressure(
            jnp.where(known, crossing.at, jnp.nan),
            jnp.where(known, muscle.force(L, crossing.at), jnp.nan),
            jnp.where(known, code, Outcome.NO_STATE).astype(int),
        )

    return at_each(one, *states)

"""Tune the gains and set-pressure ramp of a pressure controller on simulations of uncertain plants."""

import dataclasses
import itertools
import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from scipy.optimize import minimize

from ..boundary.errors import InputError
from ..plant import TICK, AbstractCircuit, Command, Plant, PressureController
from ..units import PSI

NOISE, CORRELATION = 0.25 * PSI, 0.01
"""Standard deviation [Pa] and correlation time [s] of the noise in pressure readings; ASSUMED."""
_STEPS = 25  # of the search at most
_LEG = 4.0  # s of a stroke there, and of it back: the second half stands for the rest of it
_BEFORE = 1.0  # s in which a plant comes to rest at the pressure before
_LATE = 1.0  # s at the end of the settling
_OVERSHOOT = 0.08  # of a step: none that costs nothing
_MARGIN = 2.0 * PSI  # below the limit
_GOOD = 0.1 * PSI  # an error that matters as much as one in a hundred of overshoot too many
_RANGE = np.log([(0.1, 40.0), (0.05, 200.0), (2.0, 200.0)])  # counts/psi, counts/(psi s), psi/s
_FIRST = 4.0, 8.0, 20.0  # start of the search, in the same units
_PER_COUNT = np.array([1 / 255 / PSI, 1 / 255 / PSI, PSI])
_CERTAIN = "supply", "bias", "relief", "critical_ratio", "full_speed", "exponent"
_SPREAD = {"displacement": 0.05, "needle": 0.05}
_OTHERS = 0.3


class Gains(NamedTuple):
    """Tuned quantities.

    Attributes:
        proportional: K_p [1/Pa], with the output as a fraction of full output.
        integral: K_i [1/(Pa s)].
        ramp: ramp of the set pressure [Pa/s].
    """

    proportional: float
    integral: float
    ramp: float

    @classmethod
    def per_psi(cls, proportional: float, integral: float, ramp: float) -> "Gains":
        """Convert from counts/psi (255 counts are full output), counts/(psi s) and psi/s."""
        return cls(*(np.array([proportional, integral, ramp]) * _PER_COUNT).tolist())

    def in_counts(self) -> tuple[float, float, float]:
        """Return the gains in counts/psi, counts/(psi s) and psi/s."""
        proportional, integral, ramp = (np.array(self) / _PER_COUNT).tolist()
        return proportional, integral, ramp


@dataclasses.dataclass(frozen=True)
class Duty:
    """Task for a controller: steps in the set pressure, each followed by strokes.

    Attributes:
        pressures: set pressures [Pa], in order; the first step starts from 0.
        stroke: stroke of the machine [m].
        rate: speed of the strokes [m/s].
        settle: time [s] between a step and the strokes.
        limit: pressure [Pa] at which the device trips.
    """

    pressures: tuple[float, ...]
    stroke: float
    rate: float
    settle: float
    limit: float

    def __post_init__(self) -> None:
        """Check the task.

        Raises:
            InputError: there is no pressure, a pressure reaches the limit, or a time or rate is too small.
        """
        pressures_fit = self.pressures and all(0 < one < self.limit for one in self.pressures)
        if not (pressures_fit and self.rate > 0 and self.stroke > 0 and self.settle > _LATE):
            raise InputError(
                "set pressures must be above 0 and below the limit, stroke and rate above 0, and the "
                f"settling time above {_LATE:g} s, got {self}"
            )


class Expected(NamedTuple):
    """Expected behaviour of every plant at every set pressure, shape (plants, pressures).

    Attributes:
        rms: root mean square pressure error [Pa] during the strokes.
        overshoot: overshoot [Pa] beyond the set pressure before the strokes begin.
        late: root mean square pressure error [Pa] at the end of the settling time.
        highest: highest pressure [Pa].
        force: mean force [N] during the strokes.
    """

    rms: Any
    overshoot: Any
    late: Any
    highest: Any
    force: Any


def drawn_circuits(circuit: Any, count: int = 8, seed: int = 0) -> list[AbstractCircuit]:
    """Return the circuit and random variations of it, which represent a rig that was not measured.

    The distribution is log-uniform: the pump and needle valve vary within 5 %, and all other
    parameters within 30 %, clipped to their ranges.

    Args:
        circuit: nominal circuit.
        count: number of circuits, including the nominal circuit.
        seed: random seed.
    """
    rng, found, known = np.random.default_rng(seed), [circuit], circuit.declared()
    for _ in range(count - 1):
        values = {}
        for name in [name for name in known if name not in _CERTAIN]:
            spread = _SPREAD.get(name, _OTHERS)
            value = float(circuit.parameters()[name]) * math.exp(rng.uniform(-spread, spread))
            values[name] = float(np.clip(value, known[name].low, known[name].high))
        found.append(circuit.with_parameters(values))
    return found


def expect(
    plants: Sequence[Plant], feed_forwards: np.ndarray, gains: Gains, duty: Duty, seed: int = 0
) -> Expected:
    """Simulate a controller with the given gains.

    Args:
        plants: plants with the same structure, each with one driven muscle.
        feed_forwards: polynomial coefficients of the output that holds a set pressure, one row for each
            plant; see `PressureController`.
        gains: gains of the controller.
        duty: task for the controller.
        seed: random seed for the sensor noise.
    """
    found = _figures(*_batched(plants), jnp.asarray(feed_forwards), jnp.log(jnp.array(gains)),
                     *_course(duty, seed))  # fmt: skip
    return jax.tree.map(np.asarray, found)


def tune(
    plants: Sequence[Plant],
    feed_forwards: np.ndarray,
    duty: Duty,
    *,
    seed: int = 0,
    progress: Callable[[int, int], Any] | None = None,
) -> Gains:
    """Find the gains and the ramp that best hold the pressure during strokes, averaged over all plants.

    Minimises the mean square pressure error during strokes and at the end of the settling time, with
    penalties for overshoot beyond 8 % of a step and for pressures within 2 psi of the limit. The gradient
    is computed through the simulation, which includes sensor noise and therefore penalises large gains.

    Args:
        plants: as for `expect`.
        feed_forwards: as for `expect`.
        duty: task for the controller.
        seed: random seed for the sensor noise.
        progress: called with the number of completed steps and the maximum number.

    Raises:
        InputError: no gains were found that hold the set pressures on every plant.
    """
    arrays, static = _batched(plants)
    course, feed = _course(duty, seed), jnp.asarray(feed_forwards)
    slowest = np.ptp([0.0, *duty.pressures]) / len(duty.pressures) / PSI / (0.6 * duty.settle)
    box = np.array(_RANGE)
    box[2, 0] = np.clip(math.log(slowest), *box[2])

    def cost(x: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = _cost(arrays, static, feed, jnp.asarray(x), duty.limit, *course)
        if not np.isfinite(value):
            return 1e9, np.zeros(3)
        return float(value), np.asarray(slope)

    done = itertools.count(1)
    found = minimize(
        cost, np.clip(np.log(_FIRST), *box.T), jac=True, bounds=box, method="L-BFGS-B",
        options={"maxiter": _STEPS, "ftol": 1e-5},
        callback=progress and (lambda _: progress(next(done), _STEPS)),
    )  # fmt: skip
    if found.fun >= 1e9:
        raise InputError(
            "found no gains that hold the set pressures: check that the pump or supply can reach these "
            "pressures, and that the circuit is correct"
        )
    return Gains.per_psi(*np.exp(found.x).tolist())


def _batched(plants: Sequence[Plant]) -> tuple[Plant, Plant]:
    """Return the stacked parameters of plants with the same structure, and the static part they share."""
    parts = [eqx.partition(one, eqx.is_array) for one in plants]
    return jax.tree.map(lambda *leaves: jnp.stack(leaves), *(one[0] for one in parts)), parts[0][1]


def _course(duty: Duty, seed: int) -> tuple[Any, ...]:
    """Return set pressures before and after each step [Pa], rates [m/s], noise [Pa] and numbers of ticks.

    The three numbers of ticks are those before the strokes, in a simulated leg and in a whole leg.
    """
    whole = duty.stroke / duty.rate
    ready, leg, whole = (round(t / TICK) for t in (_BEFORE + duty.settle, min(_LEG, whole), whole))
    legs = np.repeat([0.0, -duty.rate, duty.rate], [ready, leg, leg])
    keep = math.exp(-TICK / CORRELATION)
    rng = np.random.default_rng(seed)
    noise = rng.normal(scale=NOISE * math.sqrt(1 - keep**2), size=(legs.size, len(duty.pressures)))
    for k in range(1, legs.size):
        noise[k] += keep * noise[k - 1]
    after = np.array(duty.pressures, float)
    before = np.concatenate([[0.0], after[:-1]])
    return *map(jnp.asarray, (before, after, legs, noise.T)), (ready, leg, whole)


@eqx.filter_jit
def _figures(arrays: Plant, static: Plant, feed: Array, gains: Array, *course: Any) -> Expected:
    before, after, rates, noise, counts = course
    proportional, integral, ramp = jnp.exp(gains)
    begin, (ready, leg, whole) = round(_BEFORE / TICK), counts
    time = TICK * (jnp.arange(rates.size) - begin)

    def one(plant: Plant, forward: Array, low: Array, high: Array, noise: Array) -> Expected:
        controller = PressureController(proportional, integral, forward)
        way = jnp.sign(high - low) * ramp * jnp.maximum(time, 0.0)
        wanted = jnp.where(high > low, jnp.minimum(low + way, high), jnp.maximum(low + way, high))
        wanted = jnp.where(time < 0, low, wanted)

        def tick(carry: tuple, at: tuple) -> tuple[tuple, tuple]:
            state, controlled, signal = carry
            set_pressure, rate, error = at
            state = plant.step(state, Command(signal, 0.0, rate), TICK)
            reading = state.pressure + error
            controlled, signal = controller.step(controlled, set_pressure, reading, TICK)
            return (state, controlled, signal), (state.pressure, state.force)

        held = jnp.polyval(forward[::-1], low)
        at_rest = plant.start(plant.muscle.rest_length, low)
        at_rest = eqx.tree_at(lambda one: one.opening, at_rest, plant.circuit.opening(held))
        first = at_rest, controller.start(), held
        _, (pressure, force) = jax.lax.scan(tick, first, (wanted, rates, noise))
        error, late = pressure - high, ready - round(_LATE / TICK)
        legs = error[ready:].reshape(2, leg) ** 2
        lasting = jnp.mean(legs[:, leg // 2 :]) * (whole - leg)
        beyond = jnp.sign(high - low) * error[begin:ready]
        return Expected(
            jnp.sqrt((jnp.sum(legs) / 2 + lasting) / whole),
            jnp.maximum(jnp.max(beyond), 0.0),
            jnp.sqrt(jnp.mean(error[late:ready] ** 2)),
            jnp.max(pressure[begin:]),
            jnp.mean(force[ready:]),
        )

    over_pressures = jax.vmap(one, (None, None, 0, 0, 0))
    return jax.vmap(
        lambda own, forward: over_pressures(eqx.combine(own, static), forward, before, after, noise)
    )(arrays, feed)


@eqx.filter_jit
def _cost(
    arrays: Plant, static: Plant, feed: Array, x: Array, limit: float, *course: Any
) -> tuple[Array, Array]:
    """Return the cost and its gradient with respect to the logarithms of the gains (counts and psi)."""

    def cost(x: Array) -> tuple[Array, Array]:
        seen = _figures(arrays, static, feed, x + np.log(_PER_COUNT), *course)
        step = jnp.abs(course[1] - course[0])
        over = jnp.maximum(seen.overshoot / step - _OVERSHOOT, 0.0) / 0.01
        near = jnp.maximum(seen.highest - limit + _MARGIN, 0.0) / _MARGIN
        each = (seen.rms / _GOOD) ** 2 + (seen.late / _GOOD) ** 2 + over**2 + near**2
        value = jnp.mean(each)
        return value, value

    slope, value = jax.jacfwd(cost, has_aux=True)(x)
    return value, slope

"""Feed-forward with a fitted hysteresis, against a plant that was fitted on other records."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from famjax.control import Outcome, pressure_along, pressure_for_force
from famjax.muscle import longest_equilibrium
from famjax.slip import CentredSlip, MaxwellSlip, SlipElements
from fitting.records import BranchPairs, HysteresisFit, fit_hysteresis

REST, TOP, LOAD = 0.296, 6e5, 250.0
HALF = 0.5  # of the tracking error without compensation: the promise


@pytest.fixture(scope="module")
def muscle() -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=jnp.deg2rad(62.0), length=REST)
    bladder = famjax.Bladder(REST, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial([5.9e6, -19.0e6, 25.8e6])
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 40e3)


def _truth() -> MaxwellSlip:
    """Richer than what is fitted: twenty thresholds that no grid has, in both coordinates."""
    rng = np.random.default_rng(5)
    wall, braid = np.sort(rng.uniform(1e-3, 6e-2, (2, 20)), axis=1)
    strength = rng.gamma(2.0, 1.0, (2, 20))
    return MaxwellSlip(
        SlipElements(wall, 0.8 * strength[0]), SlipElements(braid, 2.5 * strength[1]), REST, 1.3e6
    )


def _fitted(contractions: list[float], seed: int, thresholds: int) -> HysteresisFit:
    """From noisy ramps at these lengths."""
    rng, parts, truth = np.random.default_rng(seed), [], _truth()
    P = np.linspace(0, TOP, 25)
    for contraction in contractions:
        L = REST * (1 - contraction)
        whole = np.asarray(truth.along(np.full(49, L), np.concatenate([P, P[-2::-1]])))
        half = (whole[24:][::-1] - whole[:25]) / 2 + 0.5 * rng.normal(size=25)
        parts.append(BranchPairs.ramp(L, P[2:-1], half[2:-1], turn_pressure=TOP, rest_length=REST))
    grid = np.geomspace(2e-3, 5e-2, thresholds)
    return fit_hysteresis(BranchPairs.joined(parts), thresholds=(grid, grid))


@pytest.fixture(scope="module")
def model() -> CentredSlip:
    return _fitted([0.03, 0.09, 0.15], seed=1, thresholds=4).centred


@pytest.fixture(scope="module")
def plant() -> CentredSlip:
    return _fitted([0.01, 0.06, 0.12, 0.18], seed=2, thresholds=12).centred


def _trajectory() -> np.ndarray:
    """Strokes and minor loops inside of them."""
    t = np.linspace(0, 1, 160)
    return REST * (1 - 0.09 - 0.05 * np.sin(4 * np.pi * t) - 0.02 * np.sin(14 * np.pi * t))


def _followed(muscle: famjax.Muscle, memory, pressures: jax.Array, first) -> np.ndarray:
    """The lengths to which the muscle goes under the load: of each state the longest."""
    shortest, longest = muscle.length_range()

    def step(state: object, P: jax.Array) -> tuple:
        def pull(L: jax.Array) -> jax.Array:
            return muscle.force(L, P) + memory.added(memory.moved(state, L, P), L, P)

        length, found = longest_equilibrium(pull, shortest, longest, jnp.asarray(LOAD))
        return memory.moved(state, length, P), jnp.where(found, length, jnp.nan)

    start = memory.start(jnp.asarray(first), pressures[0])
    found = np.asarray(jax.jit(lambda P: jax.lax.scan(step, start, P)[1])(pressures))
    assert np.isfinite(found).all()
    return found


@pytest.mark.slow
def test_the_tracking_error_is_halved(
    muscle: famjax.Muscle, model: CentredSlip, plant: CentredSlip
) -> None:
    wanted = _trajectory()
    static = pressure_for_force(muscle, LOAD, wanted, (0.0, TOP))
    known = pressure_along(muscle, model, wanted, LOAD, (0.0, TOP))
    assert not np.any(static.code)
    assert not np.any(known.code)
    errors = []
    for command in (static, known):
        followed = _followed(muscle, plant, command.pressure, muscle.rest_length)
        errors.append(float(np.sqrt(np.mean((followed - wanted)[10:] ** 2))))
    assert errors[1] <= HALF * errors[0]


@pytest.mark.slow
def test_codes_and_derivatives(muscle: famjax.Muscle, model: CentredSlip) -> None:
    wanted = _trajectory()[:12]
    force = np.where(np.arange(12) == 6, 1e5, LOAD)
    found = pressure_along(muscle, model, wanted, force, (0.0, TOP))
    assert found.code.tolist() == [Outcome.FORCE_HIGH if k == 6 else 0 for k in range(12)]
    assert float(found.pressure[6]) == TOP

    def last(load: jax.Array) -> jax.Array:
        return pressure_along(muscle, model, wanted, load, (0.0, TOP)).pressure[-1]

    central = (last(LOAD + 1e-3) - last(LOAD - 1e-3)) / 2e-3
    np.testing.assert_allclose(jax.jit(jax.grad(last))(LOAD), central, rtol=1e-5)

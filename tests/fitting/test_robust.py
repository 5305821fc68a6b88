"""Huber's objective: outliers found, and the optimum that of the function written down."""

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from fitting import ForceData, Identification, InputError, Specimen, identify
from fitting.search import huber_factor

pytestmark = pytest.mark.slow

SPECIMEN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
TRUTH = (0.022, math.radians(65), 30e3, 4e6, -6e6, 6e6)
NOISE, OUTLIERS = 2.0, 5
L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 8), np.linspace(3e5, 7e5, 5)))


def force(values: jax.Array) -> jax.Array:
    diameter, angle, deadband = values[:3]
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=angle, length=0.3)
    geometry = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, diameter, 0.002, embedded=True))
    return famjax.Muscle(geometry, famjax.PolynomialMaterial(values[3:]), deadband).force(L, P)


@pytest.fixture(scope="module")
def spoilt() -> tuple[ForceData, np.ndarray]:
    rng = np.random.default_rng(41)
    read = np.asarray(force(jnp.array(TRUTH))) + rng.normal(0, NOISE, L.size)
    wrong = rng.choice(L.size, OUTLIERS, replace=False)
    read[wrong] += rng.uniform(60, 150, OUTLIERS)
    return ForceData(read, P, L, SPECIMEN), wrong


@pytest.fixture(scope="module")
def robust(spoilt: tuple[ForceData, np.ndarray]) -> Identification:
    return identify(spoilt[0], starts=8, objective="huber")


def test_outliers_are_named_and_do_not_move_the_truth(
    spoilt: tuple[ForceData, np.ndarray], robust: Identification
) -> None:
    data, wrong = spoilt
    assert robust.converged
    assert set(wrong) <= set(np.flatnonzero(robust.weights < 0.5))
    assert any("Huber's objective" in warning for warning in robust.warnings)
    clean = np.asarray(force(jnp.array(TRUTH)))

    def off(result: Identification) -> float:
        return float(np.sqrt(np.mean((result.model_force() - clean) ** 2)))

    assert off(robust) < 2 * NOISE
    assert off(identify(data, starts=8)) > 3 * off(robust)
    for estimate, truth in zip(robust.estimates, TRUTH, strict=True):
        assert abs(estimate.value - truth) < 3 * estimate.stderr, estimate.name


def test_the_optimum_is_that_of_the_function_itself(
    spoilt: tuple[ForceData, np.ndarray], robust: Identification
) -> None:
    """Its gradient by automatic differentiation, with the threshold that the weights tell."""
    data, _ = spoilt
    residual = np.abs(robust.residuals)
    outlying = robust.weights < 0.999
    (threshold,) = np.unique((robust.weights * residual)[outlying].round(6))
    # Not tuned: 1.345 times the noise that the median shows.
    assert threshold == pytest.approx(1.345 * NOISE, rel=0.6)
    np.testing.assert_allclose(robust.weights, huber_factor(residual, threshold) ** 2, atol=1e-6)
    scale = jnp.abs(jnp.array(TRUTH))

    def objective(shares: jax.Array) -> jax.Array:
        size = jnp.abs(force(shares * scale) - data.force)
        near = size <= threshold
        return jnp.sum(jnp.where(near, size**2 / 2, threshold * size - threshold**2 / 2))

    at = jnp.array([e.value for e in robust.estimates]) / scale
    slope = np.asarray(jax.jit(jax.grad(objective))(at))
    steepness = np.sqrt(np.diag(np.asarray(jax.jit(jax.hessian(objective))(at))))
    assert np.abs(slope / steepness).max() < 1e-3 * NOISE


def test_an_objective_must_be_known(spoilt: tuple[ForceData, np.ndarray]) -> None:
    with pytest.raises(InputError, match="the objective is one of sum_of_squares, huber"):
        identify(dataclasses.replace(spoilt[0]), objective="median")


def mean_rmse(values: np.ndarray, data: ForceData) -> float:
    square = (np.asarray(force(jnp.asarray(values))) - data.force) ** 2
    return float(np.mean([math.sqrt(square[data.pressure == one].mean()) for one in np.unique(P)]))


def test_mean_rmse_is_least_where_nothing_near_is_less(
    spoilt: tuple[ForceData, np.ndarray],
) -> None:
    data, _ = spoilt
    found = identify(data, starts=8, objective="mean_rmse", constraint="none")
    assert found.converged
    values = np.array([one.value for one in found.estimates])
    least = mean_rmse(values, data)
    squares = identify(data, starts=8, constraint="none")
    assert least < mean_rmse(np.array([one.value for one in squares.estimates]), data)
    held = np.array([one.at_bound for one in found.estimates])
    for place in np.flatnonzero(~held):
        for step in (-1e-4, 1e-4):
            near = values * np.where(np.arange(values.size) == place, 1 + step, 1)
            assert mean_rmse(near, data) > least * (1 - 1e-9)
    assert not any("Huber" in warning for warning in found.warnings)
    assert (found.weights == 1).all()  # no reading counts as an outlier in the verdict

"""The convex core against independent solvers, and its derivatives against finite differences."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

from fitting.convex import Status, certificate_of, solve_qp

OBJECTIVE = 1e-8  # relative; Clarabel's own accuracy at the tolerances set below
CERTIFIED = 1e-12  # relative; a few roundings of a well-scaled problem
DIFFERENCE = 1e-6  # central differences with step 1e-6

solve = jax.jit(solve_qp)


def polynomial_problem(
    rng: np.random.Generator, order: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A law that dips, seen through noise, asked to rise everywhere on [0, 1]."""
    powers, scale = np.arange(1, order + 1), 10.0 ** rng.uniform(-3, 3, order)
    x = rng.uniform(0, 1, 40)
    b = x - 3 * x**2 + 2.5 * x**3 + 0.02 * rng.normal(size=40)
    A = x[:, None] ** powers * scale
    G = powers * np.linspace(0, 1, 33)[:, None] ** (powers - 1) * scale
    return A, b, G, np.zeros(33)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(6))
def test_optimum_agrees_with_clarabel(
    order: int, seed: int, clarabel_objective: Callable[..., float]
) -> None:
    A, b, G, h = polynomial_problem(np.random.default_rng(seed), order)
    best = solve(A, b, G, h)
    assert Status(int(best.status)) is Status.OPTIMAL
    assert float(best.objective) == pytest.approx(clarabel_objective(A, b, G, h), rel=OBJECTIVE)
    assert float(best.kkt_residual) < CERTIFIED
    assert float(best.duality_gap) < CERTIFIED
    assert (np.asarray(best.multipliers) >= 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_positive_coefficients_agree_with_nnls(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(30, 8)), rng.normal(size=30)
    x, _ = optimize.nnls(A, b)
    best = solve(A, b, np.eye(8), np.zeros(8))
    np.testing.assert_allclose(best.x, x, atol=1e-12)
    np.testing.assert_array_equal(best.active, x == 0)


def test_certificate_exposes_a_wrong_point() -> None:
    """The certificate must not be a formality: spoil the problem after solving and it shows."""
    A, b, G, h = (jnp.asarray(v) for v in polynomial_problem(np.random.default_rng(1), 3))
    best = solve(A, b, G, h)
    scale = jnp.linalg.norm(A, axis=0)
    to_x = jnp.linalg.inv(jnp.linalg.qr(A / scale)[1]) / scale[:, None]
    _, kkt_residual, gap = certificate_of(A, b, G, h, best.x * 1.01, best.multipliers, to_x)
    assert float(kkt_residual) > 1e-4
    assert float(gap) > 1e-6


def test_infeasible_and_rank_deficient_are_told_apart() -> None:
    opposite = np.array([[1.0, 0.0], [-1.0, 0.0]])
    best = solve(np.eye(2), np.ones(2), opposite, np.array([2.0, -1.0]))
    assert Status(int(best.status)) is Status.INFEASIBLE
    assert np.isnan(best.x).all()
    best = solve(np.ones((3, 2)), np.ones(3), opposite, np.array([0.0, -1.0]))
    assert Status(int(best.status)) is Status.RANK_DEFICIENT
    assert np.isnan(best.x).all()


def test_too_few_rows_is_refused() -> None:
    with pytest.raises(ValueError, match="at least as many rows as columns"):
        solve_qp(np.ones((1, 2)), np.ones(1), np.zeros((0, 2)), np.zeros(0))


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_derivatives_hold_at_active_constraints(seed: int) -> None:
    rng = np.random.default_rng(seed)
    A, b, G, h = polynomial_problem(rng, 3)
    assert np.asarray(solve(A, b, G, h).active).any()
    direction = [v * rng.normal(size=v.shape) for v in (A, b, G)] + [rng.normal(size=h.shape)]

    def along(step: float) -> jnp.ndarray:
        moved = [v + step * d for v, d in zip((A, b, G, h), direction, strict=True)]
        return solve(*moved).x

    forward = jax.jvp(along, (0.0,), (1.0,))[1]
    reverse = jax.jacrev(along)(0.0)
    central = (along(1e-6) - along(-1e-6)) / 2e-6
    size = float(jnp.max(jnp.abs(central)))
    np.testing.assert_allclose(forward, central, atol=DIFFERENCE * size, rtol=0)
    np.testing.assert_allclose(reverse, forward, atol=1e-10 * size, rtol=0)


@pytest.mark.slow
def test_batch_equals_loop() -> None:
    problems = [polynomial_problem(np.random.default_rng(seed), 3) for seed in range(5)]
    batch = jax.vmap(solve_qp)(*(np.stack(parts) for parts in zip(*problems, strict=True)))
    loop = np.stack([solve(*problem).x for problem in problems])
    np.testing.assert_allclose(batch.x, loop, rtol=1e-9)


def test_float32_is_kept() -> None:
    A, b, G, h = (v.astype(np.float32) for v in polynomial_problem(np.random.default_rng(2), 2))
    best = solve(A, b, G, h)
    assert best.x.dtype == jnp.float32
    double = solve(*(v.astype(float) for v in (A, b, G, h))).x
    np.testing.assert_allclose(best.x, double, atol=1e-3 * np.abs(double).max(), rtol=0)

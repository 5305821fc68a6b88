"""The convex core against independent solvers, on easy, degenerate and impossible problems."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from maps import clarabel_objective
from scipy import optimize
from slow_cases import slow_after

from fitting.convex import Status, certificate_of, nearest_point, solve_qp

CERTIFIED = 1e-12  # relative; a few roundings of a well-scaled problem
solve = jax.jit(solve_qp)


def polynomial_problem(rng: np.random.Generator, order: int) -> tuple[np.ndarray, ...]:
    """A law that dips, seen through noise, asked to rise everywhere on [0, 1]."""
    powers, scale = np.arange(1, order + 1), 10.0 ** rng.uniform(-3, 3, order)
    x = rng.uniform(0, 1, 40)
    b = x - 3 * x**2 + 2.5 * x**3 + 0.02 * rng.normal(size=40)
    A = x[:, None] ** powers * scale
    G = powers * np.linspace(0, 1, 33)[:, None] ** (powers - 1) * scale
    return A, b, G, np.zeros(33)


@pytest.mark.parametrize("order", [1, 2, 3, 4])
@pytest.mark.parametrize("seed", range(6))
def test_optimum_agrees_with_clarabel(order, seed):
    A, b, G, h = polynomial_problem(np.random.default_rng(seed), order)
    h += 0.05 * (seed % 3 - 1)  # the least slope
    best = solve(A, b, G, h)
    assert Status(int(best.status)) is Status.OPTIMAL
    theirs = clarabel_objective(A, b, G, h)  # to its own accuracy
    assert float(best.objective) == pytest.approx(theirs, rel=1e-8)
    assert float(best.kkt_residual) < CERTIFIED
    assert float(best.duality_gap) < CERTIFIED
    assert (np.asarray(best.multipliers) >= 0).all()


@pytest.mark.parametrize("seed", range(8))
def test_positive_coefficients_agree_with_nnls(seed):
    rng = np.random.default_rng(seed)
    A, b = rng.normal(size=(30, 8)), rng.normal(size=30)
    x, _ = optimize.nnls(A, b)
    best = solve(A, b, np.eye(8), np.zeros(8))
    np.testing.assert_allclose(best.x, x, atol=1e-12)
    np.testing.assert_array_equal(best.active, x == 0)


def test_certificate_exposes_a_wrong_point():
    A, b, G, h = (jnp.asarray(v) for v in polynomial_problem(np.random.default_rng(1), 3))
    best = solve(A, b, G, h)
    scale = jnp.linalg.norm(A, axis=0)
    to_x = jnp.linalg.inv(jnp.linalg.qr(A / scale)[1]) / scale[:, None]
    _, kkt_residual, gap = certificate_of(A, b, G, h, best.x * 1.01, best.multipliers, to_x)
    assert float(kkt_residual) > 1e-4
    assert float(gap) > 1e-6


def test_infeasible_and_rank_deficient_are_told_apart_and_too_few_rows_refused():
    opposite = np.array([[1.0, 0.0], [-1.0, 0.0]])
    best = solve(np.eye(2), np.ones(2), opposite, np.array([2.0, -1.0]))
    assert Status(int(best.status)) is Status.INFEASIBLE
    assert np.isnan(best.x).all()
    best = solve(np.ones((3, 2)), np.ones(3), opposite, np.array([0.0, -1.0]))
    assert Status(int(best.status)) is Status.RANK_DEFICIENT
    assert np.isnan(best.x).all()
    with pytest.raises(ValueError, match="at least as many rows as columns"):
        solve_qp(np.ones((1, 2)), np.ones(1), np.zeros((0, 2)), np.zeros(0))


@pytest.mark.parametrize("seed", slow_after(1, range(4)))
def test_derivatives_hold_at_active_constraints(seed):
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
    np.testing.assert_allclose(forward, central, atol=1e-6 * size, rtol=0)
    np.testing.assert_allclose(reverse, forward, atol=1e-10 * size, rtol=0)


@pytest.mark.slow
def test_batch_equals_loop():
    problems = [polynomial_problem(np.random.default_rng(seed), 3) for seed in range(5)]
    batch = jax.vmap(solve_qp)(*(np.stack(parts) for parts in zip(*problems, strict=True)))
    loop = np.stack([solve(*problem).x for problem in problems])
    np.testing.assert_allclose(batch.x, loop, rtol=1e-9)


def test_float32_is_kept():
    A, b, G, h = (v.astype(np.float32) for v in polynomial_problem(np.random.default_rng(2), 2))
    best = solve(A, b, G, h)
    assert best.x.dtype == jnp.float32
    double = solve(*(v.astype(float) for v in (A, b, G, h))).x
    np.testing.assert_allclose(best.x, double, atol=1e-3 * np.abs(double).max(), rtol=0)


EXACT = 1e-12  # a few roundings of a problem of unit size
MEMBERS, UNKNOWNS, ROWS = 200, 4, 17
one = jax.jit(nearest_point)
many = jax.jit(jax.vmap(nearest_point, in_axes=(0, None, 0)))


def rising_cubics(seed: int) -> tuple[np.ndarray, ...]:
    """Polynomials asked to rise at 17 points, in metrics and with optima that scatter."""
    rng = np.random.default_rng(seed)
    powers = np.arange(1, UNKNOWNS + 1)
    Q, R = np.linalg.qr(np.linspace(0, 1, 60)[:, None] ** powers)
    G = powers * np.linspace(0, 1, ROWS)[:, None] ** (powers - 1) @ np.linalg.inv(R)
    G /= np.linalg.norm(G, axis=1)[:, None]
    hessians = np.einsum("ki,mk,kj->mij", Q, rng.exponential(size=(MEMBERS, 60)), Q)
    J = np.linalg.inv(np.linalg.cholesky(hessians)).transpose(0, 2, 1)
    centre = np.array([1.0, -3.0, 2.0, 0.3]) @ R.T + rng.normal(size=(MEMBERS, UNKNOWNS))
    return G @ J, np.zeros(ROWS), centre


def optimality(G: np.ndarray, h: np.ndarray, centre: np.ndarray, found: object, k: int) -> float:
    """Largest violation of the Kuhn-Tucker conditions of one member."""
    y, multipliers = found.y[k], np.zeros(len(h))
    np.add.at(multipliers, np.asarray(found.rows[k]), np.asarray(found.multipliers[k]))
    slack = G[k] @ y - h
    stationarity = y - centre[k] - G[k].T @ multipliers
    worst = [np.abs(stationarity).max(), -slack.min(), -multipliers.min()]
    return max(*worst, np.abs(multipliers * slack).max())


def test_a_batch_is_optimal():
    problem = rising_cubics(0)
    found = many(*problem)
    assert (np.asarray(found.status) == int(Status.OPTIMAL)).all()
    assert np.asarray(found.used).sum(axis=1).max() >= 2
    assert max(optimality(*problem, found, k) for k in range(0, MEMBERS, 7)) < EXACT


@pytest.mark.parametrize("seed", range(5))
def test_feasibility_agrees_with_linear_programming(seed):
    """Random half-spaces, half of which leave nothing."""
    rng = np.random.default_rng(seed)
    verdicts = []
    for _ in range(30):
        G, h = rng.normal(size=(ROWS, UNKNOWNS)), 1.2 * rng.normal(size=ROWS) - 1.5
        G, h = G / np.linalg.norm(G, axis=1)[:, None], h / np.linalg.norm(G, axis=1)
        linear = optimize.linprog(np.zeros(UNKNOWNS), -G, -h, bounds=(None, None))
        found = one(G, h, rng.normal(size=UNKNOWNS))
        expected = Status.OPTIMAL if linear.status == 0 else Status.INFEASIBLE
        assert Status(int(found.status)) is expected
        verdicts.append(expected)
    assert len(set(verdicts)) == 2


def test_duplicated_and_opposite_rows():
    """Equalities as pairs of rows, each twice, and a row that is off."""
    G = np.array([[1.0, 0, 0, 0], [-1, 0, 0, 0], [1, 0, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 0]])
    G = np.concatenate([G, np.tile(np.eye(4)[1], (ROWS - 5, 1))])
    h = np.concatenate([[2.0, -2, 2, -2, -1], np.full(ROWS - 5, 3.0)])
    found = one(G, h, np.array([0.0, 0, 5, 6]))
    assert Status(int(found.status)) is Status.OPTIMAL
    np.testing.assert_allclose(found.y, [2, 3, 5, 6], atol=EXACT)


def test_a_member_without_solution_leaves_the_others_alone():
    G, h, centre = rising_cubics(3)
    spoilt = centre.copy()
    spoilt[5] = np.nan
    found, whole = many(G, h, spoilt), many(G, h, centre)
    kept = np.arange(MEMBERS) != 5
    assert np.isnan(found.y[5]).all()
    np.testing.assert_array_equal(np.asarray(found.y)[kept], np.asarray(whole.y)[kept])

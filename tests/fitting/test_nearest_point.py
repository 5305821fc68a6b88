"""The dual active set against other solvers, on easy, degenerate and impossible problems."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import optimize

from fitting.convex import Status, cholesky, inverse_lower, nearest_point

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


def test_a_batch_is_optimal() -> None:
    problem = rising_cubics(0)
    found = many(*problem)
    assert (np.asarray(found.status) == int(Status.OPTIMAL)).all()
    assert np.asarray(found.used).sum(axis=1).max() >= 2
    assert max(optimality(*problem, found, k) for k in range(0, MEMBERS, 7)) < EXACT


@pytest.mark.parametrize("seed", range(5))
def test_feasibility_agrees_with_linear_programming(seed: int) -> None:
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


def test_duplicated_and_opposite_rows() -> None:
    """Equalities as pairs of rows, each twice, and a row that is off."""
    G = np.array([[1.0, 0, 0, 0], [-1, 0, 0, 0], [1, 0, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 0]])
    G = np.concatenate([G, np.tile(np.eye(4)[1], (ROWS - 5, 1))])
    h = np.concatenate([[2.0, -2, 2, -2, -1], np.full(ROWS - 5, 3.0)])
    found = one(G, h, np.array([0.0, 0, 5, 6]))
    assert Status(int(found.status)) is Status.OPTIMAL
    np.testing.assert_allclose(found.y, [2, 3, 5, 6], atol=EXACT)


def test_a_member_without_solution_leaves_the_others_alone() -> None:
    G, h, centre = rising_cubics(3)
    spoilt = centre.copy()
    spoilt[5] = np.nan
    found, whole = many(G, h, spoilt), many(G, h, centre)
    kept = np.arange(MEMBERS) != 5
    assert np.isnan(found.y[5]).all()
    np.testing.assert_array_equal(np.asarray(found.y)[kept], np.asarray(whole.y)[kept])


@pytest.mark.parametrize("n", [1, 4, 8, 9])
def test_triangles(n: int) -> None:
    root = np.random.default_rng(n).normal(size=(2 * n, n))
    L = cholesky(jnp.asarray(root.T @ root))
    np.testing.assert_allclose(L, np.linalg.cholesky(root.T @ root), atol=1e-12 * n)
    np.testing.assert_allclose(inverse_lower(L) @ L, np.eye(n), atol=1e-11)
    assert np.isnan(cholesky(-jnp.eye(n))).any()

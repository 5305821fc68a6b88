"""Bounded least squares: the exact step in the box, against SciPy."""

import numpy as np
import pytest
from scipy import optimize

from fitting.search import step_in_box

EXACT = 1e-9  # of SciPy's own tolerance


@pytest.mark.parametrize("p", [1, 3, 7])
def test_the_step_is_that_of_scipy_and_meets_bounds_exactly(p: int) -> None:
    rng = np.random.default_rng(p)
    count, met = 40, 0
    J = rng.normal(size=(count, 12, p)) @ np.diag(10.0 ** rng.uniform(-2, 1, p))
    r, damping = rng.normal(size=(count, 12)), 10.0 ** rng.uniform(-6, 0, count)
    u = np.where(rng.uniform(size=(count, p)) < 0.2, 0.0, rng.uniform(size=(count, p)))
    moves = step_in_box(J, r, damping, -u, 1 - u)
    for k, move in enumerate(moves):
        A = np.concatenate([J[k], np.sqrt(damping[k]) * np.eye(p)])
        b = np.concatenate([-r[k], np.zeros(p)])
        theirs = optimize.lsq_linear(A, b, (-u[k], 1 - u[k] + 1e-300), method="bvls", tol=1e-14)
        ours = ((A @ move - b) ** 2).sum() / 2
        assert ours <= theirs.cost * (1 + EXACT)
        assert (move >= -u[k]).all()
        assert (move <= 1 - u[k]).all()
        met += ((move == -u[k]) | (move == 1 - u[k])).sum()
    assert met > count / 2


def test_nothing_to_move() -> None:
    assert step_in_box(
        np.zeros((2, 3, 0)), np.ones((2, 3)), np.ones(2), *np.zeros((2, 2, 0))
    ).shape == (2, 0)

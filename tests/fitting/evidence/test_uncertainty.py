"""Covariances against the textbook on a linear problem, with and without equal noise."""

import numpy as np

from fitting.covariance import covariance

EXACT = 1e-10

rng = np.random.default_rng(2)
X = rng.normal(size=(40, 3)) * [1.0, 1e3, 1e-4]
FREE = np.zeros(3, bool)
NONE = np.zeros((0, 3))


def test_linear_least_squares() -> None:
    residual = rng.normal(size=40)
    found = covariance(X, residual, NONE, FREE)
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(found.matrix, inverse * (residual @ residual) / 37, rtol=EXACT)
    meat = X.T @ (residual[:, None] ** 2 * X)
    np.testing.assert_allclose(found.sandwich, inverse @ meat @ inverse * 40 / 37, rtol=EXACT)
    assert found.degrees_of_freedom == 37


def test_unequal_noise_shows_in_the_sandwich_alone() -> None:
    """Noise that grows with one column: over many draws the sandwich is right, the other not."""
    column = np.linspace(-1, 1, 200)
    x = np.stack([np.ones(200), column, column**2], axis=1)
    slopes, plain, robust = [], [], []
    for _ in range(400):
        y = rng.normal(size=200) * np.abs(column)
        best, *_ = np.linalg.lstsq(x, y, rcond=None)
        found = covariance(x, x @ best - y, NONE, FREE)
        slopes.append(best[1])
        plain.append(found.plain_stderr[1])
        robust.append(found.sandwich_stderr[1])
    spread = np.std(slopes)
    assert abs(np.mean(robust) / spread - 1) < 0.1  # 400 draws know a spread to 4 %
    assert np.mean(plain) / spread < 0.85


def test_the_larger_of_both_errors_is_given() -> None:
    # Noisy where the first column is large: it is known less well than equal noise says, another better.
    found = covariance(X, np.random.default_rng(0).normal(size=40) * X[:, 0] ** 2, NONE, FREE)
    ratio = found.sandwich_stderr / found.plain_stderr
    assert ratio[0] > 1.2
    assert ratio.min() < 1
    larger = np.maximum(found.plain_stderr, found.sandwich_stderr)
    np.testing.assert_array_equal(found.stderr, larger)


def test_active_constraints_and_held_parameters_have_no_error() -> None:
    residual = rng.normal(size=40)
    held = np.array([False, True, False])
    found = covariance(X, residual, np.array([[1.0, 0.0, 0.0]]), held)
    assert np.isnan(found.stderr[:2]).all()
    assert np.isnan(found.sandwich_stderr[:2]).all()
    alone = covariance(X[:, 2:], residual, np.zeros((0, 1)), np.zeros(1, bool))
    np.testing.assert_allclose(found.stderr[2], alone.stderr[0], rtol=EXACT)
    nothing = covariance(X, residual, NONE, np.ones(3, bool))
    assert np.isnan(nothing.matrix).all()


def test_a_ridge_has_no_standard_error() -> None:
    twin = np.concatenate([X, X[:, :1]], axis=1)
    found = covariance(twin, rng.normal(size=40), np.zeros((0, 4)), np.zeros(4, bool))
    assert found.condition > 1e10
    assert np.isnan(found.stderr).all()

"""Fourier fits: exact on their own curves, from any start, into the muscle's model."""

import numpy as np
import pytest
from rendering import INCH, PUBLISHED_CONTRACTIONS, published_shape

import famjax
from fitting.shapes import fit_fourier

X = np.linspace(0, 1, 801)
EXACT = 1e-9  # m; the terms of a wide profile cancel to a hundredth of their size


@pytest.mark.parametrize("contraction", PUBLISHED_CONTRACTIONS)
def test_three_terms_are_found_again(contraction):
    true = np.asarray(published_shape(contraction)(X))
    fit = fit_fourier(X, true, n_terms=3)
    assert fit.rmse < 2e-5 * true.max()
    assert fit.max_error >= fit.rmse
    assert fit.r_squared > 1 - 1e-6


@pytest.mark.parametrize("w", [1.3, 2.2, 3.7, 5.6, 6.28, 9.0, 11.5])
@pytest.mark.parametrize("symmetric", [False, True])
def test_the_wave_number_is_found_wherever_it_is(w, symmetric):
    random = np.random.default_rng(int(10 * w))
    a, b = 0.003 * random.normal(size=(2, 2))
    n = np.arange(1, 3)
    if symmetric:
        b = a * np.tan(n * w / 2)
    angle = n * w * X[:, None]
    true = 0.03 + np.cos(angle) @ a + np.sin(angle) @ b
    fit = fit_fourier(X, true, n_terms=2, symmetric=symmetric)
    assert fit.rmse < EXACT
    np.testing.assert_allclose(fit.diameter(X), true, atol=1e-8)


def test_a_symmetric_fit_is_even_about_the_middle():
    random = np.random.default_rng(4)
    noisy = np.asarray(published_shape(0.175)(X)) + 1e-4 * random.normal(size=X.size)
    fit = fit_fourier(X, noisy, n_terms=3, symmetric=True)
    np.testing.assert_allclose(fit.diameter(X), fit.diameter(1 - X), rtol=1e-9)
    n = np.arange(1, 4)
    np.testing.assert_allclose(
        fit.sines, fit.cosines * np.tan(n * fit.frequency / 2), rtol=1e-8, atol=1e-14
    )


@pytest.mark.parametrize("symmetric", [False, True])
def test_it_is_the_muscles_own_profile(symmetric):
    true = np.asarray(published_shape(0.2625)(X))
    fit = fit_fourier(X, true, n_terms=3, symmetric=symmetric)
    profile = famjax.profiles.FourierProfile(fit.mean, fit.cosines, fit.sines, fit.frequency)
    rounding = 1e-9  # the tests run the model in float64
    spread = np.abs(fit.cosines).sum() + np.abs(fit.sines).sum() + abs(fit.mean)
    np.testing.assert_allclose(
        np.asarray(profile.diameter(X, 1.0)), fit.diameter(X), atol=rounding * spread
    )


def test_more_terms_fit_no_worse():
    random = np.random.default_rng(0)
    shape = np.asarray(published_shape(0.35)(X)) + 2e-5 * random.normal(size=X.size)
    errors = [fit_fourier(X, shape, n_terms=k).rmse for k in range(6)]
    assert np.all(np.diff(errors) <= 1e-7)  # what the cut of singular values leaves
    assert errors[3] < 0.001 * INCH < errors[1]


def test_the_standard_errors_are_those_of_repeated_fits():
    true = 0.03 + 0.004 * np.cos(4.5 * X) - 0.002 * np.sin(4.5 * X)
    random = np.random.default_rng(1)
    fits = [
        fit_fourier(X[::2], true[::2] + 1e-5 * random.normal(size=X[::2].size), n_terms=1)
        for _ in range(60)
    ]
    found = np.array([[f.mean, f.cosines[0], f.sines[0], f.frequency] for f in fits])
    claimed = np.median([f.stderr for f in fits], axis=0)
    ratio = found.std(axis=0, ddof=1) / claimed
    # 60 repeats know a spread to 9 %, and 800 residuals their correlation to about as much.
    assert np.all((ratio > 0.7) & (ratio < 1.35))


def test_statistics_are_their_definitions():
    random = np.random.default_rng(2)
    shape = np.asarray(published_shape(0.0)(X)) + 1e-4 * random.normal(size=X.size)
    fit = fit_fourier(X, shape, n_terms=2)
    off = shape - fit.diameter(X)
    assert fit.sse == pytest.approx(off @ off, rel=1e-6)
    assert fit.rmse == pytest.approx(np.sqrt(np.mean(off**2)), rel=1e-6)
    total = np.sum((shape - shape.mean()) ** 2)
    assert fit.r_squared == pytest.approx(1 - fit.sse / total)
    assert fit.adjusted_r_squared == pytest.approx(
        1 - (1 - fit.r_squared) * (X.size - 1) / (X.size - 6)
    )


def test_no_terms_give_the_mean():
    fit = fit_fourier(X, 0.03 + 0 * X, n_terms=0)
    assert fit.mean == pytest.approx(0.03)
    assert fit.cosines.size == 0


@pytest.mark.parametrize(
    ("x", "d", "match"),
    [
        (X[:10], X[:10], "one shape"),
        (X, X[:-1], "one shape"),
        (X, np.full(X.shape, np.nan), "finite"),
    ],
)
def test_what_cannot_be_fitted_is_refused(x, d, match):
    with pytest.raises(ValueError, match=match):
        fit_fourier(x, d)

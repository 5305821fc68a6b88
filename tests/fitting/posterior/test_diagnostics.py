"""R-hat and effective sizes against processes of known correlation, and against two peers."""

import numpy as np
import pytest

from fitting.posterior import effective_size, effective_size_of_tails, r_hat


def chains(rho: float, seed: int = 0, count: int = 4, draws: int = 1000) -> np.ndarray:
    """An autoregressive process: its effective size is (1 - rho)/(1 + rho) of its draws."""
    rng = np.random.default_rng(seed)
    x = np.zeros((count, draws))
    x[:, 0] = rng.normal(size=count)
    for k in range(1, draws):
        x[:, k] = rho * x[:, k - 1] + np.sqrt(1 - rho**2) * rng.normal(size=count)
    return x


@pytest.mark.parametrize("rho", [-0.3, 0.0, 0.5, 0.9])
def test_effective_size_of_a_known_process(rho: float) -> None:
    found = np.mean([effective_size(chains(rho, seed)) for seed in range(8)])
    assert found == pytest.approx(4000 * (1 - rho) / (1 + rho), rel=0.12)  # of eight sets of chains


def test_r_hat_sees_place_spread_and_drift() -> None:
    alike = chains(0.0)
    assert 0.999 < r_hat(alike) < 1.005
    assert r_hat(alike + np.array([0, 0, 0, 1.0])[:, None]) > 1.05
    assert r_hat(alike * np.array([1, 1, 1, 3.0])[:, None]) > 1.05
    assert r_hat(alike + np.linspace(0, 2, 1000)) > 1.05


def test_nothing_that_varies_has_no_size() -> None:
    assert np.isnan(effective_size(np.ones((4, 100))))
    assert np.isnan(r_hat(np.ones((4, 100))))


@pytest.mark.slow
def test_as_blackjax_finds_them() -> None:
    blackjax = pytest.importorskip("blackjax")
    if not hasattr(blackjax, "ess_bulk"):
        pytest.skip("this blackjax has no rank-normalised diagnostics")
    x = np.exp(chains(0.6))
    assert effective_size(x) == pytest.approx(float(blackjax.ess_bulk(x)), rel=0.02)


def test_as_arviz_finds_them() -> None:
    arviz = pytest.importorskip("arviz")
    x = np.exp(chains(0.6))
    assert effective_size(x) == pytest.approx(float(arviz.ess(x)), rel=0.02)
    assert effective_size_of_tails(x) == pytest.approx(float(arviz.ess(x, method="tail")), rel=0.02)
    assert r_hat(x) == pytest.approx(float(arviz.rhat(x)), abs=1e-4)

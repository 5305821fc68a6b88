"""The posterior of a measured muscle: chains that agree, arrays that others read, refusals."""

import sys

import numpy as np
import pytest

import fitting
from fitting import Identification
from fitting.posterior import Posterior, load_blackjax

pytest.importorskip("blackjax")


@pytest.fixture(scope="module")
def result() -> Identification:
    return fitting.identify(fitting.load_bundled("DMSP-20-300"))


@pytest.fixture(scope="module")
def posterior(result: Identification) -> Posterior:
    return fitting.sample(result, draws=300)


@pytest.mark.slow
def test_chains_of_a_measured_muscle_agree(posterior: Posterior) -> None:
    assert posterior.r_hat < 1.01
    assert posterior.effective_size > 400
    assert posterior.converged
    assert not posterior.divergent.any()
    assert posterior.kept == 1
    assert not posterior.joint


@pytest.mark.slow
def test_ridge_at_a_bound(posterior: Posterior, result: Identification) -> None:
    diameter, angle = posterior.draws("braid_diameter"), posterior.draws("braid_angle")
    assert ((diameter >= 0.020) & (diameter <= 0.0236)).all()
    assert np.corrcoef(diameter.ravel(), angle.ravel())[0, 1] < -0.97
    assert np.quantile(diameter, 0.9) > 0.02355  # the data alone would go further
    # Where the bound plays no part the linear theory holds.
    deadband = posterior.summary["deadband_pressure"]
    stderr = result.estimate("deadband_pressure").stderr
    assert deadband.mean == pytest.approx(
        result.estimate("deadband_pressure").value, abs=0.3 * stderr
    )
    assert deadband.std == pytest.approx(stderr, rel=0.15)
    assert posterior.summary["noise"].mean == pytest.approx(8.0, abs=0.5)


@pytest.mark.slow
def test_arviz_reads_the_groups(posterior: Posterior) -> None:
    groups = posterior.groups()
    assert {a.shape for a in groups["posterior"].values()} == {(4, 300)}
    arviz = pytest.importorskip("arviz")
    new = int(arviz.__version__.partition(".")[0]) >= 1
    data = arviz.from_dict(groups) if new else arviz.from_dict(**groups)
    table = arviz.summary(data)
    assert list(table.index) == list(posterior.names)
    np.testing.assert_array_equal(data["posterior"]["E_1"].values, posterior.draws("E_1"))


def test_refusals(result: Identification) -> None:
    with pytest.raises(fitting.InputError, match="noise must be one standard deviation > 0"):
        fitting.sample(result, noise=-1.0)
    with pytest.raises(fitting.InputError, match="draws must be a whole number >= 4, got 1"):
        fitting.sample(result, draws=1)


def test_without_blackjax(result: Identification, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(fitting.InputError, match=r"pip install \"famjax\[posterior\]\""):
        load_blackjax()
    with pytest.raises(fitting.InputError, match="blackjax, which is not installed"):
        fitting.sample(result)


@pytest.mark.parametrize("rho", [-0.3, 0.0, 0.5, 0.9])
def test_what_chains_show_is_that_of_a_known_process(rho: float) -> None:
    """An autoregressive process is worth (1 - rho)/(1 + rho) of its draws; one that is off is told."""
    rng = np.random.default_rng(0)
    x = np.zeros((4, 1000, 8))
    x[:, 0] = rng.normal(size=(4, 8))
    for k in range(1, 1000):
        x[:, k] = rho * x[:, k - 1] + np.sqrt(1 - rho**2) * rng.normal(size=(4, 8))

    def made(samples: np.ndarray) -> Posterior:
        of_draws = np.zeros(samples.shape[:2])
        names, kinds = tuple("abcdefgh"), ("number",) * 8
        return Posterior(
            names, kinds, samples, of_draws > 0, of_draws, of_draws, None, 1.0, 0, False, "made"
        )

    alike = made(x)
    found = np.mean([one.effective_size for one in alike.summary.values()])
    assert found == pytest.approx(4000 * (1 - rho) / (1 + rho), rel=0.12)  # of eight processes
    assert alike.r_hat < 1.05
    assert made(x + 3 * np.arange(4)[:, None, None]).r_hat > 1.1
    assert made(x + np.linspace(0, 5, 1000)[:, None]).r_hat > 1.1  # a drift

"""The posterior: the map into a box, coefficients against quadrature, and chains of a measured muscle."""

import sys

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from maps import KNOWN, cylinder
from scipy import stats

import famjax
import fitting
from fitting import ForceData, Identification
from fitting.density import BoxMap
from fitting.posterior import Posterior, load_blackjax

pytest.importorskip("blackjax")


@pytest.fixture
def ridge() -> BoxMap:
    """Two parameters correlated by -0.999, the mean beyond a bound, and one far from every bound."""
    std = np.array([0.3, 0.2, 0.01])
    correlation = np.array([[1, -0.999, 0], [-0.999, 1, 0.02], [0, 0.02, 1]])
    spread = correlation * np.outer(std, std)
    return BoxMap.of(np.zeros(3), np.ones(3), np.array([1.2, 0.3, 0.5]), spread)


@pytest.mark.slow
def test_volume_is_that_of_the_derivative(ridge):
    rng = np.random.default_rng(0)
    bent = ridge.along(np.linspace(0.5, 1, 7), {1: 0.3 + np.linspace(0, 1, 7) ** 3})

    @eqx.filter_jit
    def all_at(box: BoxMap, z: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        return *jax.vmap(box)(z), jax.vmap(jax.jacfwd(lambda z: box(z)[0]))(z)

    for box in (ridge, bent):
        v, log_volume, slopes = all_at(box, jnp.asarray(rng.normal(scale=2, size=(20, 3))))
        assert (v >= 0).all()
        assert (v <= 1).all()
        np.testing.assert_allclose(np.linalg.slogdet(slopes)[1], log_volume, rtol=1e-9)


@pytest.mark.parametrize("z", [-300.0, -30.0, 30.0, 300.0])
def test_far_out_it_stays_finite_and_inside(ridge, z):
    at = jnp.full(3, z)
    v, log_volume = ridge(at)
    assert np.isfinite(log_volume)
    assert np.isfinite(jax.grad(lambda z: ridge(z)[1])(at)).all()
    assert (v > -1e-12).all()
    assert (v < 1 + 1e-12).all()


def test_far_from_bounds_it_is_the_linear_map():
    spread = np.array([[1e-4, 5e-5], [5e-5, 1e-4]])
    box = BoxMap.of(np.zeros(2), np.ones(2), np.full(2, 0.5), spread)
    z = np.array([0.7, -1.1])
    v, _ = box(jnp.asarray(z))
    np.testing.assert_allclose(v[box.order], 0.5 + np.linalg.cholesky(spread) @ z, rtol=1e-12)


NOISE = 3.0
HELD = {"braid_diameter": (0.022,) * 2, "braid_angle": (np.deg2rad(64),) * 2,
        "deadband_pressure": (3e4,) * 2}  # fmt: skip


def forces(E: np.ndarray, L: np.ndarray, P: np.ndarray) -> np.ndarray:
    def force(E: np.ndarray) -> jax.Array:
        return famjax.Muscle(cylinder(angle=64), famjax.PolynomialMaterial(E), 3e4).force(L, P)

    none = np.asarray(force(np.zeros(2)))
    columns = np.stack([np.asarray(force(1e6 * one)) - none for one in np.eye(2)]) / 1e6
    return none + E @ columns


def held_map(E: tuple[float, float], limit: float | None = None, *, deep: bool = True) -> ForceData:
    contraction, lowest = (0.3, 1e5) if deep else (0.08, 2e5)
    grid = np.meshgrid(0.3 * (1 - np.linspace(0, contraction, 6)), np.linspace(lowest, 5e5, 4))
    L, P = (axis.ravel() for axis in grid)
    read = forces(np.array([E]), L, P)[0] + NOISE * np.random.default_rng(3).normal(size=L.size)
    return ForceData(read, P, L, KNOWN, force_limit=limit)


def quadrature(data: ForceData, allowed, censored: bool) -> np.ndarray:
    """Mean and standard deviation of both coefficients, shape (2, 2)."""
    plain = fitting.identify(data, order=2, bounds=HELD, constraint="none", censored=censored)
    C = plain.covariance[-2:, -2:] * (NOISE**2 * 24 / max(np.sum(plain.residuals**2), 1.0))
    axes = np.linspace(-9, 9, 361)
    root = np.linalg.cholesky(C)
    E = plain.coefficients[0] + np.stack(np.meshgrid(axes, axes), -1).reshape(-1, 2) @ root.T
    at = data.loaded
    model = forces(E, data.length, data.pressure)
    log = stats.norm.logpdf(data.force[at], model[:, at], NOISE).sum(axis=1)
    if censored:
        log += stats.norm.logcdf(-model[:, data.slack] / NOISE).sum(axis=1)
        limit = data.force_limit or np.inf
        log += stats.norm.logcdf((model[:, data.saturated] - limit) / NOISE).sum(axis=1)
    weight = np.exp(log - log.max()) * allowed(E)
    weight /= weight.sum()
    mean = weight @ E
    return np.stack([mean, np.sqrt(weight @ (E - mean) ** 2)])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("E", "constraint", "censored", "limit"),
    [
        ((3e6, -2e6), "none", False, None),  # normal
        ((2e6, -4e5), "positive", False, None),  # E_2 = 0 at the optimum: its slack is sampled
        ((3e6, -2e6), "none", True, 450.0),  # slack and saturated readings: Tobit
        ((2e6, -4e5), "positive", True, 450.0),
    ],
)
def test_coefficients_are_those_of_quadrature(E, constraint, censored, limit):
    data = held_map(E, limit, deep=censored)
    assert data.loaded.all() != censored
    options = {"constraint": constraint, "censored": censored}
    result = fitting.identify(data, order=2, bounds=HELD, **options)
    posterior = fitting.sample(result, noise=NOISE, seed=1)

    def allowed(E: np.ndarray) -> np.ndarray:
        return (E >= 0).all(axis=1) if constraint == "positive" else np.ones(len(E))

    mean, std = quadrature(data, allowed, censored)
    for k, name in enumerate(("E_1", "E_2")):
        one = posterior.summary[name]
        error = std[k] / np.sqrt(one.effective_size)
        assert one.mean == pytest.approx(mean[k], abs=4 * error)
        assert one.std == pytest.approx(std[k], rel=4 / np.sqrt(one.effective_size))


@pytest.fixture(scope="module")
def measured() -> Identification:
    return fitting.identify(fitting.load_bundled("DMSP-20-300"))


@pytest.mark.slow
def test_chains_of_a_measured_muscle_agree_and_hold_a_ridge_at_a_bound(measured):
    posterior = fitting.sample(measured, draws=300)
    assert posterior.r_hat < 1.01
    assert posterior.effective_size > 400
    assert posterior.converged
    assert not posterior.divergent.any()
    diameter, angle = posterior.draws("braid_diameter"), posterior.draws("braid_angle")
    assert ((diameter >= 0.020) & (diameter <= 0.0236)).all()
    assert np.corrcoef(diameter.ravel(), angle.ravel())[0, 1] < -0.97
    assert np.quantile(diameter, 0.9) > 0.02355  # the data alone would go further
    # Where the bound plays no part the linear theory holds.
    drawn, known = posterior.summary["deadband_pressure"], measured.estimate("deadband_pressure")
    assert drawn.mean == pytest.approx(known.value, abs=0.3 * known.stderr)
    assert drawn.std == pytest.approx(known.stderr, rel=0.15)
    assert posterior.summary["noise"].mean == pytest.approx(8.0, abs=0.5)


def test_refusals_and_what_is_said_without_blackjax(measured, monkeypatch):
    with pytest.raises(fitting.InputError, match="noise must be a standard deviation > 0"):
        fitting.sample(measured, noise=-1.0)
    with pytest.raises(fitting.InputError, match="draws must be a whole number >= 4, got 1"):
        fitting.sample(measured, draws=1)
    monkeypatch.setitem(sys.modules, "blackjax", None)
    with pytest.raises(fitting.InputError, match=r"pip install \"famjax\[posterior\]\""):
        load_blackjax()
    with pytest.raises(fitting.InputError, match="blackjax, which is not installed"):
        fitting.sample(measured)


@pytest.mark.parametrize("rho", [-0.3, 0.0, 0.5, 0.9])
def test_what_chains_show_is_that_of_a_known_process(rho):
    """An autoregressive process is worth (1 - rho)/(1 + rho) of its draws; one that is off is told."""
    rng = np.random.default_rng(0)
    x = np.zeros((4, 1000, 8))
    x[:, 0] = rng.normal(size=(4, 8))
    for k in range(1, 1000):
        x[:, k] = rho * x[:, k - 1] + np.sqrt(1 - rho**2) * rng.normal(size=(4, 8))

    def made(samples: np.ndarray) -> Posterior:
        of_draws = np.zeros(samples.shape[:2])
        names, kinds = tuple("abcdefgh"), ("number",) * 8
        return Posterior(names, kinds, samples, of_draws > 0, None)

    alike = made(x)
    found = np.mean([one.effective_size for one in alike.summary.values()])
    assert found == pytest.approx(4000 * (1 - rho) / (1 + rho), rel=0.12)  # of eight processes
    assert alike.r_hat < 1.05
    assert made(x + 3 * np.arange(4)[:, None, None]).r_hat > 1.1
    assert made(x + np.linspace(0, 5, 1000)[:, None]).r_hat > 1.1  # a drift

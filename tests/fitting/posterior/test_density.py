"""The posterior of coefficients against quadrature of the readings' own likelihood, force by force.

The geometry is held, so that the quadrature needs two coefficients only; the muscle's force comes from
`famjax.Muscle`, which the sampler does not call.
"""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy import stats

import famjax
import fitting
from fitting import ForceData, Specimen
from fitting.density import density_of

pytest.importorskip("blackjax")

NOISE = 3.0
SPECIMEN = Specimen("held", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
HELD = {"braid_diameter": (0.022,) * 2, "braid_angle": (np.deg2rad(64),) * 2,
        "deadband_pressure": (3e4,) * 2}  # fmt: skip


def forces(E: np.ndarray, L: np.ndarray, P: np.ndarray) -> np.ndarray:
    """Of muscles with coefficients in the first axis, shape (muscles, readings)."""
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=np.deg2rad(64), length=0.3)
    geometry = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, 0.022, 0.002, embedded=True))

    def force(E: np.ndarray) -> jax.Array:
        return famjax.Muscle(geometry, famjax.PolynomialMaterial(E), 3e4).force(L, P)

    none = np.asarray(force(np.zeros(2)))
    columns = np.stack([np.asarray(force(1e6 * one)) - none for one in np.eye(2)]) / 1e6
    return none + E @ columns


def held_map(E: tuple[float, float], limit: float | None = None, *, deep: bool = True) -> ForceData:
    contraction, lowest = (0.3, 1e5) if deep else (0.08, 2e5)
    grid = np.meshgrid(0.3 * (1 - np.linspace(0, contraction, 6)), np.linspace(lowest, 5e5, 4))
    L, P = (axis.ravel() for axis in grid)
    read = forces(np.array([E]), L, P)[0] + NOISE * np.random.default_rng(3).normal(size=L.size)
    return ForceData(read, P, L, SPECIMEN, force_limit=limit)


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
        ((3e6, -2e6), "none", False, None),  # normal: integrated and drawn
        ((2e6, -4e5), "positive", False, None),  # E_2 = 0 at the optimum: its slack is sampled
        ((3e6, -2e6), "none", True, 450.0),  # slack and saturated readings: Tobit
        ((2e6, -4e5), "positive", True, 450.0),
    ],
)
def test_coefficients_are_those_of_quadrature(
    E: tuple[float, float], constraint: str, censored: bool, limit: float | None
) -> None:
    data = held_map(E, limit, deep=censored)
    assert data.loaded.all() != censored
    if not censored and constraint == "none":  # no coordinate is left to sample
        result = fitting.identify(data, order=2, bounds=HELD, constraint=constraint)
        with pytest.raises(fitting.InputError, match="there is nothing to sample"):
            density_of(result, NOISE)
        posterior = fitting.sample(result, noise=(NOISE, NOISE * 1.0001), seed=1)
    else:
        result = fitting.identify(
            data, order=2, bounds=HELD, constraint=constraint, censored=censored
        )
        posterior = fitting.sample(result, noise=NOISE, seed=1)
    assert posterior.joint == censored

    def allowed(E: np.ndarray) -> np.ndarray:
        return (E >= 0).all(axis=1) if constraint == "positive" else np.ones(len(E))

    mean, std = quadrature(data, allowed, censored)
    for k, name in enumerate(("E_1", "E_2")):
        one = posterior.summary[name]
        error = std[k] / np.sqrt(one.effective_size)
        assert one.mean == pytest.approx(mean[k], abs=4 * error)
        assert one.std == pytest.approx(std[k], rel=4 / np.sqrt(one.effective_size))


@pytest.mark.slow
def test_density_is_the_integral_over_the_coefficients() -> None:
    """Two geometries: the ratio of their masses is that of quadrature over the coefficients."""
    data = held_map((3e6, -2e6), deep=False)
    bounds = HELD | {"deadband_pressure": (0.0, 6e4)}
    result = fitting.identify(data, order=2, bounds=bounds, constraint="none")
    density, _ = density_of(result, NOISE)
    u = result.end.u[0] + np.array([-0.02, 0.03])
    found = np.diff([float(density.log_posterior(jnp.array([at]))) for at in u])[0]

    def mass(at: float) -> float:
        held = bounds | {"deadband_pressure": (6e4 * at,) * 2}
        plain = fitting.identify(data, order=2, bounds=held, constraint="none")
        rss = float(np.sum(plain.residuals**2))
        axes = np.linspace(-8, 8, 201)
        root = np.linalg.cholesky(plain.covariance[-2:, -2:])
        E = plain.coefficients[0] + np.stack(np.meshgrid(axes, axes), -1).reshape(-1, 2) @ root.T
        model = plain.residuals + data.force
        away = forces(E, data.length, data.pressure) - forces(
            plain.coefficients, data.length, data.pressure
        )
        square = np.sum((model - data.force + away) ** 2, axis=1)
        return -rss / 2 / NOISE**2 + np.log(
            np.sum(np.exp(-(square - rss) / 2 / NOISE**2)) * abs(np.linalg.det(root))
        )

    assert found == pytest.approx(mass(u[1]) - mass(u[0]), abs=1e-6)

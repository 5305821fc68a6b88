"""Posteriors: chains that agree, their time, and truths from the prior whose ranks are uniform.

Where the posterior is right the rank of the truth among its draws is uniform, for every parameter.
Geometry is uniform in its box, coefficients are normal and Drucker-stable, the logarithm of the noise
is uniform; each map is identified and sampled as a user does it.

References:
    Talts, Betancourt, Simpson, Vehtari & Gelman 2018, arXiv:1804.06788.
"""

import time

import jax
import jax.numpy as jnp
import numpy as np
from fits import fit
from jaxtyping import Float
from row import Case, tell
from scipy import stats

import famjax
import fitting
from fitting import ForceData, Parameter, Specimen

TRUTHS = 200
_SPECIMEN = Specimen("calibration", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
_BOX = {"braid_diameter": (0.020, 0.0236), "braid_angle": np.deg2rad((60.0, 70.0)),
        "deadband_pressure": (0.0, 1e5)}  # fmt: skip
_LAW = {"E_1": (2e6, 1e6), "E_2": (-2e6, 3e6)}
_NOISE, _WEIGHED, _LIMIT = (1.0, 10.0), 3.0, 900.0  # N; against which the fit weighs the priors


def sampled(case: Case) -> dict[str, float]:
    """The posterior of the standard fit, and its CPU time once it is compiled."""
    result = fit(case)
    fitting.sample(result, seed=1)
    begin = time.process_time()
    found = fitting.sample(result)
    return {
        "largest R-hat": found.r_hat,
        "smallest effective size, bulk and tails": found.effective_size,
        "CPU time after compilation [s]": time.process_time() - begin,
    }


def calibration(_: Case, censored: bool) -> dict[str, float]:
    """Smallest p of the hypothesis that ranks are uniform, times the number of parameters."""
    found = ranks(TRUTHS, 0, censored=censored)
    p = [float(stats.kstest(values, "uniform").pvalue) for values in found.values()]
    return {"smallest p of uniform ranks x parameters": min(p) * len(p)}


def ranks(count: int, seed: int, *, censored: bool) -> dict[str, Float[np.ndarray, " count"]]:
    """Part of the draws below the truth; with `censored` slack and saturated readings take part."""
    rng = np.random.default_rng(seed)
    parameters = {name: Parameter(prior=of, unit="Pa") for name, of in _LAW.items()}
    found: dict[str, list[float]] = {name: [] for name in (*_BOX, *_LAW, "noise")}
    for done in range(count):
        truth, data = _truth_and_map(rng, censored)
        result = fitting.identify(
            data,
            order=len(_LAW),
            parameters=parameters,
            noise=_WEIGHED,
            starts=6,
            censored=censored,
        )
        posterior = fitting.sample(result, noise=_NOISE, chains=4, draws=100, warmup=200, seed=done)
        for name, values in found.items():
            draws = posterior.draws(name)[:, ::4].ravel()
            values.append(((draws < truth[name]).sum() + rng.uniform()) / (draws.size + 1))
        if done % 20 == 19:
            tell(f"{done + 1} of {count} truths")
    return {name: np.array(values) for name, values in found.items()}


@jax.jit
def _force_and_margin(
    truth: dict[str, jax.Array], L: jax.Array, P: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Force [N] at every reading, and the smallest modulus [Pa] along the path."""
    braid = famjax.Braid.from_rest(
        diameter=truth["braid_diameter"], braid_angle=truth["braid_angle"], length=0.3
    )
    bladder = famjax.Bladder(0.3, truth["braid_diameter"], 0.002, embedded=True)
    law = famjax.PolynomialMaterial(jnp.stack([truth[name] for name in _LAW]))
    geometry = famjax.EstimatedGeometry(braid, bladder)
    muscle = famjax.Muscle(geometry, law, truth["deadband_pressure"])
    path = jnp.linspace(0.3, L.min(), 200)
    return muscle.force(L, P), famjax.path_modulus(law, geometry, path, P.max()).min()


def _truth_and_map(rng: np.random.Generator, censored: bool) -> tuple[dict[str, float], ForceData]:
    """A truth from the prior, and a map that it makes.

    Raises:
        RuntimeError: a reading is slack that should not be: the map would lose it.
    """
    contractions = np.linspace(0, 0.3, 8) if censored else np.linspace(0, 0.06, 6)
    pressures = np.linspace(0.5e5, 6e5, 5) if censored else np.linspace(3e5, 7e5, 5)
    L, P = (axis.ravel() for axis in np.meshgrid(0.3 * (1 - contractions), pressures))
    while True:
        truth = {name: float(rng.uniform(*ends)) for name, ends in _BOX.items()}
        truth |= {name: float(rng.normal(*of)) for name, of in _LAW.items()}
        force, margin = _force_and_margin(truth, L, P)
        if margin >= 0:
            break
    truth["noise"] = float(np.exp(rng.uniform(*np.log(_NOISE))))
    read = np.asarray(force) + truth["noise"] * rng.normal(size=L.size)
    data = ForceData(read, P, L, _SPECIMEN, force_limit=_LIMIT if censored else None)
    if not censored and not data.loaded.all():
        raise RuntimeError(f"{(~data.loaded).sum()} readings are slack: choose another grid")
    return truth, data

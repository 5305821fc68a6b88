"""Simulation-based calibration of the posterior: truths from the prior, maps from the truths.

    python benchmarks/calibration.py [--draws 200] [--seed 0] [--censored]

Where the posterior is right the rank of the truth among its draws is uniform, for every parameter.
Geometry uniform in its box, coefficients normal and Drucker-stable, the logarithm of the noise
uniform; each map is identified and sampled as a user would do it. With `--censored` a muscle goes
slack within its map, and the load cell ends below its largest forces.

References:
    Talts, Betancourt, Simpson, Vehtari & Gelman 2018, arXiv:1804.06788.
"""

import argparse
import math
import sys
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy import stats

import famjax
import fitting
from fitting import ForceData, Parameter, Specimen

SPECIMEN = Specimen("calibration", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
CONTRACTIONS = {False: np.linspace(0, 0.06, 6), True: np.linspace(0, 0.3, 8)}
PRESSURES = {False: np.linspace(3e5, 7e5, 5), True: np.linspace(0.5e5, 6e5, 5)}
LIMIT = {False: None, True: 900.0}  # N
BOX = {"braid_diameter": (0.020, 0.0236), "braid_angle": np.deg2rad((60.0, 70.0)),
       "deadband_pressure": (0.0, 1e5)}  # fmt: skip
LAW = {"E_1": (2e6, 1e6), "E_2": (-2e6, 3e6)}
NOISE = (1.0, 10.0)  # N
_WEIGHED = 3.0  # N, against which the fit weighs the priors
_CHAINS, _DRAWS, _WARMUP, _THIN = 4, 100, 200, 4
_STATIONS = 200


@jax.jit
def _force_and_margin(
    truth: dict[str, jax.Array], L: jax.Array, P: jax.Array
) -> tuple[jax.Array, jax.Array]:
    """Force [N] at every reading, and the smallest modulus [Pa] along the path."""
    braid = famjax.Braid.from_rest(
        diameter=truth["braid_diameter"], braid_angle=truth["braid_angle"], length=0.3
    )
    bladder = famjax.Bladder(0.3, truth["braid_diameter"], 0.002, embedded=True)
    law = famjax.PolynomialMaterial(jnp.stack([truth[name] for name in LAW]))
    geometry = famjax.EstimatedGeometry(braid, bladder)
    muscle = famjax.Muscle(geometry, law, truth["deadband_pressure"])
    path = jnp.linspace(0.3, L.min(), _STATIONS)
    return muscle.force(L, P), famjax.path_modulus(law, geometry, path, P.max()).min()


def truth_and_map(rng: np.random.Generator, censored: bool) -> tuple[dict[str, float], ForceData]:
    """A truth from the prior, and a map that it makes.

    Raises:
        RuntimeError: a reading is slack that should not be: the map would lose it.
    """
    grid = np.meshgrid(0.3 * (1 - CONTRACTIONS[censored]), PRESSURES[censored])
    L, P = (axis.ravel() for axis in grid)
    while True:
        truth = {name: float(rng.uniform(*ends)) for name, ends in BOX.items()}
        truth |= {name: float(rng.normal(*of)) for name, of in LAW.items()}
        force, margin = _force_and_margin(truth, L, P)
        if margin >= 0:
            break
    truth["noise"] = float(np.exp(rng.uniform(*np.log(NOISE))))
    read = np.asarray(force) + truth["noise"] * rng.normal(size=L.size)
    data = ForceData(read, P, L, SPECIMEN, force_limit=LIMIT[censored])
    if not censored and not data.loaded.all():
        raise RuntimeError(f"{(~data.loaded).sum()} readings are slack: choose another grid")
    return truth, data


def ranks(
    count: int, seed: int, *, censored: bool = False, progress: Callable[[int], None] | None = None
) -> dict[str, Float[np.ndarray, " count"]]:
    """Part of the draws that lie below the truth, by parameter; uniform where the posterior is right.

    Args:
        count: truths.
        seed: of everything.
        censored: whether the maps have slack and saturated readings, which take part.
        progress: called with the number done.
    """
    rng = np.random.default_rng(seed)
    parameters = {name: Parameter(prior=of, unit="Pa") for name, of in LAW.items()}
    found: dict[str, list[float]] = {name: [] for name in (*BOX, *LAW, "noise")}
    for done in range(count):
        truth, data = truth_and_map(rng, censored)
        result = fitting.identify(
            data, order=len(LAW), parameters=parameters, noise=_WEIGHED, starts=6, censored=censored
        )
        posterior = fitting.sample(
            result, noise=NOISE, chains=_CHAINS, draws=_DRAWS, warmup=_WARMUP, seed=done
        )
        for name, of_name in found.items():
            draws = posterior.draws(name)[:, ::_THIN].ravel()
            below = int((draws < truth[name]).sum())
            of_name.append((below + rng.uniform()) / (draws.size + 1))
        if progress is not None:
            progress(done + 1)
    return {name: np.array(values) for name, values in found.items()}


def uniformity(found: dict[str, Float[np.ndarray, " count"]]) -> dict[str, float]:
    """P of the hypothesis that the ranks of each parameter are uniform (Kolmogorov & Smirnov)."""
    return {name: float(stats.kstest(values, "uniform").pvalue) for name, values in found.items()}


def main() -> int:
    """Print p for every parameter; exit code 1 if one is below 0.05 over their number."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--draws", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--censored", action="store_true")
    given: Any = parser.parse_args()
    jax.config.update("jax_enable_x64", True)

    def told(done: int) -> None:
        if not done % 20:
            print(f"{done} of {given.draws}", file=sys.stderr, flush=True)

    p = uniformity(ranks(given.draws, given.seed, censored=given.censored, progress=told))
    for name, value in p.items():
        print(f"{name:18} p = {value:.3f}")
    least = min(p.values())
    print(f"smallest p {least:.4f}, limit {0.05 / len(p):.4f}")
    return 0 if least >= 0.05 / len(p) and math.isfinite(least) else 1


if __name__ == "__main__":
    sys.exit(main())

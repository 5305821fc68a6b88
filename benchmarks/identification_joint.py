"""Joint identification of geometry and law against lmfit, and the bootstrap of a whole sweep.

    python benchmarks/identification_joint.py

lmfit gets the same force, compiled, the same six parameters, bounds and starts, and no constraint,
which it has no form for: so neither have we here. A start counts as missed whose RMSE is more than
1 % above the best that anybody found.
"""

import json
import os
import time
from collections.abc import Callable
from typing import Any, TypeVar

os.environ.setdefault("PJRT_NPROC", "16")

import jax
import jax.numpy as jnp
import lmfit
import numpy as np
from identification_problem import GEOMETRY, force_map
from specimen import geometries

import famjax
import fitting
from fitting.plausible import any_units

Result = TypeVar("Result")

MAPS = ("DMSP-20-300", "DMSP-10-250")
STARTS = 16
MISSED = 0.01


def joint(name: str, starts: int = STARTS) -> list[dict[str, Any]]:
    """Cubic law, two numbers of the braid and the deadband of a bundled map, by us and by lmfit.

    Args:
        name: of the map.
        starts: number of them.

    Returns:
        One row for each solver.
    """
    data = fitting.load_bundled(name)
    first, _ = _timed(lambda: fitting.identify(data, order=3, constraint="none", starts=starts))
    seconds, ours = _timed(
        lambda: fitting.identify(data, order=3, constraint="none", starts=starts)
    )
    begin = time.perf_counter()
    theirs = _by_lmfit(ours, starts)
    lmfit_seconds = time.perf_counter() - begin
    own = ours.errors.rmse * np.sqrt(ours.starts / ours.starts[0])
    best = min(own.min(), theirs.min())
    task = f"joint identification of {name}, {starts} starts"
    return [
        _row(task, "this project, second call", seconds, own, best, seconds)
        | {"compile_seconds": first - seconds},
        _row(task, "lmfit, least squares by differences", lmfit_seconds, theirs, best, seconds),
    ]


def _row(
    task: str, solver: str, seconds: float, rmse: np.ndarray, best: float, ours: float
) -> dict[str, Any]:
    return {
        "task": task,
        "solver": solver,
        "seconds": seconds,
        "ratio": seconds / ours,
        "best_rmse_N": float(rmse.min()),
        "missed": int((rmse > (1 + MISSED) * best).sum()),
        "starts": rmse.size,
    }


def _by_lmfit(ours: fitting.Identification, starts: int) -> np.ndarray:
    """RMSE [N] that lmfit reaches from random starts in the same box."""
    data, at = ours.data, ours.data.loaded
    L, P, F = (jnp.asarray(a[at]) for a in (data.length, data.pressure, data.force))
    geometry = ours.muscle.geometry
    assert isinstance(geometry, famjax.EstimatedGeometry)
    bladder, thickness = geometry.bladder, geometry.braid.thickness
    names = ("braid_diameter", "braid_angle", "deadband_pressure")

    @jax.jit
    def residual(diameter: Any, angle: Any, deadband: Any, E: Any) -> jax.Array:
        braid = famjax.Braid.from_rest(
            diameter=diameter, braid_angle=angle, length=bladder.rest_length, thickness=thickness
        )
        shape = famjax.EstimatedGeometry(braid, bladder)
        return famjax.Muscle(shape, famjax.PolynomialMaterial(E), deadband).force(L, P) - F

    rng, found = np.random.default_rng(0), []
    for _ in range(starts):
        parameters = lmfit.Parameters()
        for name in names:
            low, high = ours.estimate(name).min, ours.estimate(name).max
            parameters.add(name, value=rng.uniform(low, high), min=low, max=high)
        for n in range(1, 4):
            parameters.add(f"E_{n}", value=1e6 * rng.normal())

        def of(p: lmfit.Parameters) -> np.ndarray:
            v = p.valuesdict()
            E = jnp.array([v["E_1"], v["E_2"], v["E_3"]])
            return np.asarray(residual(*(v[name] for name in names), E))

        fit = lmfit.minimize(of, parameters)
        found.append(float(np.sqrt(np.mean(fit.residual**2))))
    return np.array(found)


@any_units()
def sweep_bootstrap(replicates: int) -> dict[str, Any]:
    """The 48 fits of the reconstruction with bootstrap errors, through the public call."""
    data, geometry = force_map(), geometries()[GEOMETRY]
    first, _ = _timed(lambda: fitting.sweep(data, geometry, bootstrap=replicates))
    seconds, found = _timed(lambda: fitting.sweep(data, geometry, bootstrap=replicates))
    fits = len(found.rows) * (replicates + 1)
    return {
        "task": f"48 fits with {replicates} bootstrap replicates each",
        "solver": "this project, second call",
        "seconds": seconds,
        "compile_seconds": first - seconds,
        "microseconds_per_fit": seconds / fits * 1e6,
    }


def _timed(call: Callable[[], Result]) -> tuple[float, Result]:
    begin = time.perf_counter()
    found = call()
    return time.perf_counter() - begin, found


def main() -> None:
    """Run all and print one JSON object a line."""
    jax.config.update("jax_enable_x64", True)
    for name in MAPS:
        for row in joint(name):
            print(json.dumps(row), flush=True)
    for replicates in (1000, 10000):
        print(json.dumps(sweep_bootstrap(replicates)), flush=True)


if __name__ == "__main__":
    main()

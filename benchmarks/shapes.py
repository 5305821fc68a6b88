"""The shape from mechanics: the printed specimen with nothing fitted, and its speed beside SciPy's."""

import subprocess
import time

import jax
import numpy as np
import reconstruction  # noqa: F401 -- first: it puts the folder of the chapters on `sys.path`

# isort: split
import equilibrium_shape as example
import shape_oracles as oracles
from row import Case

import famjax

_PREDICTED = (980.0, 774.0, 568.0, 363.0, 157.0)
"""Blocked forces [lbf] at 100 to 20 psi of a first prototype, whose wall did not thin."""
_IMPORT = "import time, jax; print(time.process_time())"
_FIRST = """
import time, jax
jax.config.update("jax_enable_x64", True)
import famjax, jax.numpy as jnp
muscle = famjax.EquilibriumMuscle(famjax.Braid(9.89, 1.09, 0.011), famjax.Bladder(9.28125, 0.875, 0.0625),
                                  famjax.PolynomialMaterial([257.8, -57.9, 32.7]), end_diameter=0.863)
start = time.process_time()
muscle.force(jnp.full(4, 8.0), 100.0).block_until_ready()
print(time.process_time() - start)
"""


def printed(_: Case) -> dict[str, float]:
    """Errors of the printed specimen."""
    rows = example.rows()
    shapes = [row for row in rows if "mid_diameter_in" in row and row["law"] == "uniaxial"]
    mids = [row["mid_diameter_in"] / row["published_mid_diameter_in"] - 1 for row in shapes]
    free = [
        row["free_contraction"] - row["published_free_contraction"]
        for row in rows
        if "free_contraction" in row and row["law"] == "isotropic"
    ]
    blocked = {
        row["pressure_psi"]: row["blocked_force_lbf"]
        for row in rows
        if "free_contraction" in row and row["law"] == "uniaxial"
    }
    off = [blocked[p] - f for p, f in zip((100, 80, 60, 40, 20), _PREDICTED, strict=True)]
    return {
        "mid diameter, largest error [%]": 100 * float(np.max(np.abs(mids))),
        "D(x), largest RMSE [in]": max(row["profile_rmse_in"] for row in shapes),
        "free contraction, isotropic law, largest error": float(np.max(np.abs(free))),
        "blocked force, largest difference from the prototype [lbf]": float(np.max(np.abs(off))),
    }


def one_law(_: Case) -> dict[str, float]:
    """Error of one law, free of pressure, fitted to the ten printed figures."""
    return {"RMSE [lbf]": example.one_law_fit()["rmse_lbf"]}


def work(_: Case) -> dict[str, float]:
    """What is left over of the fluid's work in strokes of the printed specimen."""
    muscle, pressures = example.muscle("uniaxial"), np.array([100.0, 80.0, 60.0, 40.0, 20.0])
    ends = np.array([muscle.length_at_load(0.0, pressure) for pressure in pressures])
    budget = famjax.work_budget(muscle, pressures, float(muscle.rest_length), ends)
    return {
        "left over, part of the fluid's work": float(
            np.max(np.abs(budget.left_over / budget.fluid))
        )
    }


def speed(case: Case) -> dict[str, float]:
    """540 states after compiling against `solve_bvp` on as many, and what the first call costs."""
    muscle, one = example.muscle("uniaxial"), oracles.Specimen()
    contraction, P = np.meshgrid(np.linspace(0, 0.36, 60), np.linspace(20, 100, 9), indexing="ij")
    L = one.L0 * (1 - contraction)
    force = np.asarray(muscle.force(L, P))
    there = np.isfinite(force)
    holes = [not there[: there[:, j].sum(), j].all() for j in range(9)]
    times = []
    for _ in range(case.repeat):
        start = time.perf_counter()
        jax.block_until_ready(muscle.force(L, P))
        times.append(time.perf_counter() - start)
    sample = np.flatnonzero(there)[::12]
    shape = muscle.profile(L.ravel()[sample], P.ravel()[sample])
    Z, half = np.linspace(0, 0.5, 101), np.linspace(0, 0.5, 51)
    spent, worst = 0.0, 0.0
    for k, i in enumerate(sample):
        guess = np.interp(Z, half, np.asarray(shape.radius[k, :51]))
        start = time.perf_counter()
        F, _ = oracles.boundary_values(
            one, float(L.flat[i]), float(P.flat[i]), guess, float(force.flat[i])
        )
        spent += time.perf_counter() - start
        worst = max(worst, abs(F - force.flat[i]))
    cost = []
    for code in (_IMPORT, _FIRST):
        done = subprocess.run([case.python, "-c", code], capture_output=True, text=True, check=True)
        cost.append(float(done.stdout))
    return {
        "times faster than solve_bvp": spent / sample.size * L.size / min(times),
        "largest difference of the force [lbf]": worst,
        "pressures with a gap between states that were found": float(sum(holes)),
        "tracing and compiling, CPU time / import of jax": cost[1] / cost[0],
    }

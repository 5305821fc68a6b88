"""Datasets of the simulated rig, fitted: is the muscle found again that the rig pulled on?

    python benchmarks/rig_datasets.py [--seeds N] [--first SEED] [--json FILE]

`famjax rig simulate` of the reference work's 7/8 in muscle with the latex of its chapter 6, 40, 70 and
100 psi with two cycles each, and `famjax fit dataset.csv --law polynomial`: E_1, E_2, deadband and thread
length against the simulated muscle's, in their own standard errors, and the force at all readings against
its force without friction. An estimate at a bound is held there and has no standard error: it counts where
the bound is the truth.
"""

import argparse
import contextlib
import io
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

import famjax
import fitting
from famjax.__main__ import main
from famjax.chain import reference_muscle

PLAN = """[plan]
pressures_psi = [40, 70, 100]
cycles = 2
stroke_in = 3.4
rate_in_per_s = 0.04
settle_s = 10

[rig]
circuit = "air"
pressure_limit_psi = 110
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
"""


def fitted(seed: int) -> dict[str, Any]:
    """One dataset, fitted: distances from the truth in standard errors, and the error of the force."""
    with tempfile.TemporaryDirectory() as folder:
        plan, output = Path(folder) / "plan.toml", Path(folder) / "rig"
        plan.write_text(PLAN)
        words = ["rig", "simulate", str(plan), "--seed", str(seed), "--output", str(output)]
        with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
            try:
                main(words)
            except SystemExit as end:
                if end.code:
                    raise RuntimeError(f"famjax {' '.join(words)} ended with {end.code}") from None
        data = fitting.read_csv(output / "dataset.csv")
    found = fitting.identify(data)
    muscle, L, P = reference_muscle(), data.length[data.loaded], data.pressure[data.loaded]
    error = found.predict(L, P) - np.asarray(muscle.force(L, P))
    law, geometry = muscle.material, muscle.geometry
    assert isinstance(law, famjax.PolynomialMaterial)
    assert isinstance(geometry, famjax.EstimatedGeometry)
    E_1, E_2, _ = law.coefficients
    thread = geometry.braid.rest_thread_length
    known = {"E_1": E_1, "E_2": E_2, "deadband_pressure": 0.0, "thread_length": thread}
    distances = {}
    for name, value in known.items():
        one = {e.name: e for e in (*found.all_estimates, *found.derived)}[name]
        away, std = one.value - float(value), one.stderr
        at_truth = one.at_bound and abs(away) <= 1e-9 * max(abs(one.value), 1.0)
        distances[name] = 0.0 if at_truth else away / std if std else math.inf
    rms = float(np.sqrt(np.mean(error**2)))
    return {"seed": seed, "standard_errors": distances, "rms_N": rms}


def run(first: int, count: int) -> dict[str, Any]:
    """All seeds, with the largest distance of every parameter and its root mean square."""
    rows = []
    for seed in range(first, first + count):
        rows.append(fitted(seed))
        said = ", ".join(f"{k} {v:+.2f}" for k, v in rows[-1]["standard_errors"].items())
        print(f"seed {seed}: {said}; {rows[-1]['rms_N']:.2f} N", flush=True)
    names = list(rows[0]["standard_errors"])
    all_of = {name: np.array([row["standard_errors"][name] for row in rows]) for name in names}
    return {
        "seeds": count,
        "largest": {name: float(np.abs(z).max()) for name, z in all_of.items()},
        "rms": {name: float(np.sqrt(np.mean(z**2))) for name, z in all_of.items()},
        "largest_of_all": float(max(np.abs(z).max() for z in all_of.values())),
        "largest_rms_N": max(row["rms_N"] for row in rows),
        "rows": rows,
    }


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seeds", type=int, default=20, help="number of datasets")
    parser.add_argument("--first", type=int, default=0, help="the first seed")
    parser.add_argument("--json", metavar="FILE", help="also write the figures there")
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    found = run(given.first, given.seeds)
    for name in found["largest"]:
        print(
            f"{name}: largest {found['largest'][name]:.2f} standard errors, RMS {found['rms'][name]:.2f}"
        )
    print(f"force against the truth: RMS at most {found['largest_rms_N']:.2f} N")
    if given.json:
        Path(given.json).write_text(json.dumps(found, indent=1), encoding="utf-8")

"""What a fit of a simulated test's dataset says of the muscle that was simulated, by the command line."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting import load_fit, read_csv

PLAN = """
[plan]
pressures_kPa = [150, 250, 350, 450, 550]
cycles = 3
stroke_mm = 55
rate_mm_per_s = 1.5
settle_s = 5

[rig]
circuit = "air"
pressure_limit_psi = 110
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
"""
LAW = ["--law", "polynomial", "--order", "2"]
PARAMETERS = ("thread_length", "deadband_pressure", "E_1", "E_2")


def fitted(run: Callable, data: object, folder: Path) -> dict:
    assert run("fit", data, *LAW, "--output", folder)[0] == 0
    return json.loads((folder / "fit.json").read_text())


def entries(fit: dict) -> dict[str, dict]:
    return fit["parameters"] | fit["derived"]


@pytest.mark.slow
def test_a_fit_of_the_dataset_returns_the_muscle_that_was_simulated(
    run: Callable, tmp_path: Path
) -> None:
    """Within three of its own standard errors; the forces within 1.6 N of the truth's."""
    truth = entries(fitted(run, "DMSP-20-300", tmp_path / "truth"))
    muscle = load_fit(tmp_path / "truth" / "fit.json").muscle
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    for seed in range(3):
        folder = tmp_path / f"seed{seed}"
        fit = tmp_path / "truth" / "fit.json"
        simulated = run("rig", "simulate", plan, "--fit", fit, "--seed", seed, "--output", folder)
        assert simulated[0] == 0
        found = entries(fitted(run, folder / "dataset.csv", folder))
        for name in PARAMETERS:
            error = found[name]["value"] - truth[name]["value"]
            assert abs(error) < 3 * found[name]["stderr"], (seed, name)
        data = read_csv(folder / "dataset.csv")
        assert np.unique(data.pressures.level).size == 5
        again = load_fit(folder / "fit.json").muscle
        apart = [one.force(data.length, data.pressure) for one in (again, muscle)]
        assert np.sqrt(np.mean(np.square(np.subtract(*apart)))) < 1.6

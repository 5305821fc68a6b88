"""How near the chain comes to a muscle that is known: twins made and evaluated, against their truth.

`python benchmarks/twins.py --seeds 20 --size small --json FILE`. Each twin is made in a folder of its
own and evaluated by `famjax characterise`, as a person would; then its results are held against
`truth.json`.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import jax
import numpy as np

import famjax
import fitting
from famjax.chain.folder import TwinMuscle, read_sheet
from fitting.shapes import Pictures

INCH, PSI = 0.0254, 6894.757293168361
HELD_OUT = {"small": (55.0, 85.0), "large": (15.0, 35.0, 55.0, 75.0, 95.0)}
"""Set pressures [psi] between those of the test."""
WITHIN = 1.96


def evaluated(seed: int, size: str, folder: Path) -> float:
    """Make and evaluate a twin; CPU time of the evaluation [s]."""
    command = [sys.executable, "-m", "famjax"]
    subprocess.run(
        [*command, "twin", str(folder), "--seed", str(seed), "--size", size],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    begin = time.monotonic()
    subprocess.run(
        [*command, "characterise", str(folder)],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return time.monotonic() - begin


def compared(folder: Path, size: str) -> dict[str, Any]:
    """A twin's results against its truth."""
    truth = json.loads((folder / "truth.json").read_text())
    results = folder / "results"
    true = TwinMuscle(
        tuple(truth["coefficients"]), truth["deadband"], truth["turns"], truth["friction"]
    ).muscle()
    known: Any = true.geometry
    found = json.loads((results / "measured" / "figures.json").read_text())
    saved = fitting.load_fit(results / "measured" / "fit.json")
    sheet = read_sheet(folder)
    rest = sheet.specimen.rest_length
    surface = fitting.shape_surface(results / "pictures" / "measurements.nc")
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    shape = np.asarray(known.family.diameter(x, surface.lengths[:, None], 0.0))
    error = surface.diameters[0] - shape
    pictures = Pictures.of(results / "pictures" / "measurements.nc")
    lengths = np.array([truth["lengths_m"][Path(name).name] for name in pictures.names])
    strain = np.linspace(0.0, _largest_strain(true, surface.lengths), 200)
    stress, truly = (np.asarray(law(one).stress(strain)) for one in (saved.muscle, true))
    data = fitting.read_csv(results / "records" / "dataset.csv", {})
    at = np.linspace(max(data.length.min(), surface.lengths[-1]), data.length.max(), 12)
    pressures = np.array(HELD_OUT[size]) * PSI
    force = np.asarray(jax.jit(true.force)(at, pressures[:, None]))
    rows = fitting.predict(saved, at, pressures)
    table = {(row["length_m"], row["pressure_Pa"]): row for row in rows}
    got = np.array([[table[L, P]["force_N"] for L in at] for P in pressures])
    low, high = (
        np.array([[table[L, P][key] for L in at] for P in pressures])
        for key in ("low_95_N", "high_95_N")
    )
    names = ["E_1", "E_2", "E_3", "deadband_pressure", "turns"]
    values = dict(
        zip(names, [*truth["coefficients"], truth["deadband"], truth["turns"]], strict=True)
    )
    off = {
        name: (found["values"][name] - value) / found["std"][name] for name, value in values.items()
    }
    return {
        "diameter_rms_in": float(np.sqrt(np.mean(error**2)) / INCH),
        "diameter_largest_in": float(np.abs(error).max() / INCH),
        "contraction_largest": float(np.abs(pictures.length - lengths).max() / rest),
        "stress_largest": float(np.abs(stress - truly).max() / np.abs(truly).max()),
        "force_rms": float(np.sqrt(np.mean((got - force) ** 2)) / force.max()),
        "force_covered": float(np.mean((low <= force) & (force <= high))),
        "parameters_covered": float(np.mean([abs(one) <= WITHIN for one in off.values()])),
        "off": off,
        "rmse_N": {
            name: json.loads((results / name / "figures.json").read_text())["rmse_N"]
            for name in ("cylinder", "average-diameter", "measured", "virtual-work")
        },
    }


def law(muscle: famjax.Muscle) -> Any:
    """The law of a muscle's bladder."""
    return muscle.material


def _largest_strain(true: famjax.Muscle, lengths: np.ndarray) -> float:
    """The largest strain that the bladder has seen."""
    shape = true.geometry.dimensions(lengths, 0.0)
    return float(np.max(np.asarray(shape.hoop_strain)))


def main() -> int:
    """Make, evaluate and compare; print a line for each twin, and the whole."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--size", choices=tuple(HELD_OUT), default="small")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    every = []
    for seed in range(given.first, given.first + given.seeds):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "twin"
            seconds = evaluated(seed, given.size, folder)
            every.append({"seed": seed, "seconds": seconds, **compared(folder, given.size)})
        print(json.dumps(every[-1]), flush=True)
    figures = {
        key: max(one[key] for one in every)
        for key in ("diameter_rms_in", "contraction_largest", "stress_largest", "force_rms")
    } | {
        key: float(np.mean([one[key] for one in every]))
        for key in ("force_covered", "parameters_covered", "seconds")
    }
    print(json.dumps(figures, indent=1))
    if given.json:
        given.json.write_text(json.dumps({"twins": every, **figures}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

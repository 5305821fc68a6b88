"""How near the chain comes to a muscle that is known: twins made and evaluated, against their truth.

`python benchmarks/twins.py --seeds 20 --size small --json FILE`. Each twin is made in a folder of its
own and evaluated by `famjax characterise`, as a person would; then its results are held against
`truth.toml`. A twin takes a minute or more: `--jobs 2` or `--dask tcp://host:8786` makes several at
once, each of them with one process for its pictures, and `--resume FOLDER` goes on after a stop.
All figures but the seconds are the same.
"""

import argparse
import csv
import dataclasses
import functools
import json
import math
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

import famjax
import fitting
from famjax.boundary.tasks import AnyExecutor, Store, run_tasks
from famjax.chain.folder import GEOMETRIES, read_sheet
from famjax.commands.options.engine import EngineOptions
from fitting.shapes import Pictures

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))
from rendering.folder import TRUE_LENGTHS, write_twin
from rendering.folder_truth import TRUTH, TwinMuscle, drawn_truth, read_truth

INCH, PSI = 0.0254, 6894.757293168361
HELD_OUT = {"small": (55.0, 85.0), "large": (15.0, 35.0, 55.0, 75.0, 95.0)}
"""Set pressures [psi] between those of the test."""
WITHIN = 1.96


def campaign(
    seeds: Sequence[int],
    size: str,
    *,
    executor: AnyExecutor = None,
    resume: Path | None = None,
) -> list[dict[str, Any]]:
    """The figures of twins, each made, evaluated and compared in a task.

    Args:
        seeds: of the twins.
        size: "small" or "large".
        executor: see `AnyExecutor`.
        resume: JSONL file to which the figures of each finished one are written.
    """
    settings = {"version": famjax.__version__, "seeds": list(seeds), "size": size}
    store = Store(resume, "campaign of twins", settings, len(seeds))
    # Several at once share the cores; alone, a twin has them all for its pictures.
    jobs = None if executor is None else 1
    run_tasks(
        functools.partial(twin, size, jobs), seeds, executor=executor, store=store,
        progress=lambda done, total: print(f"{done} of {total} twins", file=sys.stderr, flush=True),
        names=[f"twin {seed}" for seed in seeds],
    )  # fmt: skip
    return list(store)


def twin(size: str, jobs: int | None, seed: int) -> dict[str, Any]:
    """The figures of one twin; its pictures are measured by so many processes, or all cores."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "twin"
        seconds = evaluated(seed, size, jobs, folder)
        return {"seed": seed, "seconds": seconds, **compared(folder, size)}


def evaluated(seed: int, size: str, jobs: int | None, folder: Path) -> float:
    """Make and evaluate a twin; wall time of the evaluation [s]."""
    command = [sys.executable, "-m", "famjax"]
    write_twin(folder, seed=seed, size="large" if size == "large" else "small")
    begin = time.monotonic()
    subprocess.run(
        [*command, "characterise", str(folder), *([] if jobs is None else ["--jobs", str(jobs)])],
        check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    return time.monotonic() - begin


def compared(folder: Path, size: str) -> dict[str, Any]:
    """A twin's results against its truth."""
    truth = read_truth(folder / TRUTH, drawn_truth(0, "small", flawed=True)).muscle
    results = folder / "results"
    true = truth.muscle()
    known: Any = true.geometry
    found = json.loads((results / "measured" / "figures.json").read_text())
    saved = fitting.load_fit(results / "measured" / "fit.json")
    sheet = read_sheet(folder)
    rest = sheet.specimen.rest_length
    surface = fitting.shape_surface(results / "pictures" / "measurements.nc")
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    # A picture at rest may be measured a hair longer than the muscle.
    where = np.minimum(surface.lengths, truth.rest_length)
    shape = np.asarray(known.family.diameter(x, where[:, None], 0.0))
    error = surface.diameters[0] - shape
    pictures = Pictures.of(results / "pictures" / "measurements.nc")
    with (folder / TRUE_LENGTHS).open(encoding="utf-8", newline="") as file:
        known_lengths = {row["picture"]: float(row["length_m"]) for row in csv.DictReader(file)}
    lengths = np.array([known_lengths[Path(name).name] for name in pictures.names])
    strain = np.linspace(0.0, _largest_strain(true, where), 200)
    stress, truly = (np.asarray(law(one).stress(strain)) for one in (saved.muscle, true))
    data = fitting.read_csv(results / "records" / "dataset.csv", {})
    at = np.linspace(max(data.length.min(), surface.lengths[-1]), data.length.max(), 12)
    held_out = np.array(HELD_OUT[size]) * PSI
    pressures = np.concatenate([held_out, np.unique(data.pressures.level[data.loaded])])
    # A reading is never below zero: what is slack pulls nothing.
    pull = jax.jit(lambda muscle: jnp.maximum(muscle.force(at, pressures[:, None]), 0.0))
    force = np.asarray(pull(true))
    rows = fitting.predict(saved, at, pressures)
    table = {(row["length_m"], row["pressure_Pa"]): row for row in rows}
    got, low, high = (
        np.array([[table[L, P][key] for L in at] for P in pressures])
        for key in ("force_N", "low_95_N", "high_95_N")
    )
    left_out = got[: held_out.size] - force[: held_out.size]
    inside = (low <= force) & (force <= high)
    # The same muscle but for the shape that the photographs show.
    shown = surface.geometry(
        dataclasses.replace(sheet.specimen, **_dimensions(truth)), braid=known.family.braid
    )
    as_shown = np.asarray(pull(famjax.Muscle(shown, true.material, true.deadband_pressure)))
    names = ["E_1", "E_2", "E_3", "deadband_pressure", "turns"]
    values = dict(zip(names, [*truth.coefficients, truth.deadband, truth.turns], strict=True))
    off = {
        name: (found["values"][name] - value) / found["std"][name] for name, value in values.items()
    }
    return {
        "diameter_rms_in": float(np.sqrt(np.mean(error**2)) / INCH),
        "diameter_largest_in": float(np.abs(error).max() / INCH),
        "contraction_largest": float(np.abs(pictures.length - lengths).max() / rest),
        "stress_largest": float(np.abs(stress - truly).max() / np.abs(truly).max()),
        "force_rms": float(np.sqrt(np.mean(left_out**2)) / force.max()),
        "shape_force_rms": float(np.sqrt(np.mean((as_shown - force) ** 2)) / force.max()),
        "held_out_covered": float(np.mean(inside[: held_out.size])),
        "measured_covered": float(np.mean(inside[held_out.size :])),
        "parameters_covered": float(np.mean([abs(one) <= WITHIN for one in off.values()])),
        "intervals": inside.size + len(off),
        "intervals_with_truth": int(inside.sum()) + sum(abs(one) <= WITHIN for one in off.values()),
        "off": {name: one if math.isfinite(one) else None for name, one in off.items()},
        "rmse_N": {
            name: json.loads((results / name / "figures.json").read_text())["rmse_N"]
            for name in GEOMETRIES
            if (results / name).exists()
        },
    }


def _dimensions(truth: TwinMuscle) -> dict[str, float]:
    """The specimen as it is, not as the sheet has it."""
    names = ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
    return {name: getattr(truth, name) for name in names}


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
    parser.add_argument("--jobs", type=int)
    parser.add_argument("--dask")
    parser.add_argument("--resume", type=Path)
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    jax.config.update("jax_enable_x64", True)
    seeds = range(given.first, given.first + given.seeds)
    with EngineOptions(jobs=given.jobs, dask=given.dask).executor() as executor:
        every = campaign(seeds, given.size, executor=executor, resume=given.resume)
    for one in every:
        print(json.dumps(one))
    figures = {
        key: max(one[key] for one in every)
        for key in (
            "diameter_rms_in", "contraction_largest", "stress_largest", "force_rms",
            "shape_force_rms",
        )
    } | {
        key: float(np.mean([one[key] for one in every]))
        for key in ("held_out_covered", "measured_covered", "parameters_covered", "seconds")
    }  # fmt: skip
    total, right = (sum(one[key] for one in every) for key in ("intervals", "intervals_with_truth"))
    figures["covered"] = right / total
    print(json.dumps(figures, indent=1))
    if given.json:
        given.json.write_text(json.dumps({"twins": every, **figures}, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())

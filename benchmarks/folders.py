"""Characterisation folders end to end: twins of known muscles, and clocks.

A twin is a folder made by the simulated rig and camera; it is evaluated by `famjax characterise`, as a
person would, and its results are held against its truth.
"""

import csv
import dataclasses
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from row import Case, tell

# isort: split
from rendering.folder import TRUE_LENGTHS, write_twin
from rendering.folder_truth import TRUTH, drawn_truth, read_truth

import famjax
import fitting
from famjax.app import simulate
from famjax.app.folder import read_sheet
from famjax.plant import LinearMcKibben
from famjax.units import INCH, PSI
from fitting.records import MachineLog, synchronise
from fitting.shapes import Pictures
from rig.control import Control
from rig.plan import Isobaric, PlanFile
from rig.simulation import MachineClock

TWINS, CLOCKS = 20, 100
HELD_OUT = np.array([55.0, 85.0]) * PSI
"""Set pressures between those of a small twin's test."""


def twins(_: Case) -> dict[str, float]:
    """The largest errors of small twins, and how many of their intervals hold the truth."""
    every = []
    for seed in range(TWINS):
        with tempfile.TemporaryDirectory() as place:
            folder = Path(place) / "twin"
            write_twin(folder, seed=seed)
            begin = time.monotonic()
            _run(_characterise(folder))
            every.append(_against_truth(folder) | {"seconds": time.monotonic() - begin})
        tell(f"twin {seed}: {json.dumps(every[-1])}")
    within = sum(one["within"] for one in every) / sum(one["intervals"] for one in every)
    largest = {name: max(one[name] for one in every) for name in every[0] if "error" in name}
    return largest | {
        "95 % intervals of parameters and forces, part with the truth": within,
        "evaluation from cold, mean wall time [s]": float(
            np.mean([one["seconds"] for one in every])
        ),
    }


def _characterise(folder: Path, jobs: int = os.cpu_count() or 1) -> list[str]:
    return [sys.executable, "-m", "famjax", "characterise", str(folder), "--jobs", str(jobs)]


def _run(words: list[str]) -> None:
    subprocess.run(words, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


def _against_truth(folder: Path) -> dict[str, Any]:
    """A twin's results against its truth."""
    truth = read_truth(folder / TRUTH, drawn_truth(0, "small", flawed=True)).muscle
    results, true = folder / "results", truth.muscle()
    known: Any = true.geometry
    found = json.loads((results / "measured" / "figures.json").read_text())
    saved = fitting.load_fit(results / "measured" / "fit.json")
    table = results / "pictures" / "measurements.nc"
    surface, pictures = fitting.shape_surface(table), Pictures.of(table)
    # A picture at rest may be measured a hair longer than the muscle.
    where = np.minimum(surface.lengths, truth.rest_length)
    x = np.linspace(0, 1, surface.diameters.shape[-1])
    shape = np.asarray(known.family.diameter(x, where[:, None], 0.0))
    with (folder / TRUE_LENGTHS).open(encoding="utf-8", newline="") as file:
        true_lengths = {row["picture"]: float(row["length_m"]) for row in csv.DictReader(file)}
    off_lengths = pictures.length - [true_lengths[Path(name).name] for name in pictures.names]
    largest = float(np.max(np.asarray(known.dimensions(where, 0.0).hoop_strain)))
    laws: tuple[Any, Any] = (saved.muscle, true)
    stress, truly = (
        np.asarray(one.material.stress(np.linspace(0.0, largest, 200))) for one in laws
    )
    data = fitting.read_csv(results / "records" / "dataset.csv")
    at = np.linspace(max(data.length.min(), surface.lengths[-1]), data.length.max(), 12)
    pressures = np.concatenate([HELD_OUT, np.unique(data.pressures.level[data.loaded])])

    def pull(muscle: famjax.Muscle) -> np.ndarray:
        """A reading is never below zero: what is slack pulls nothing."""
        return np.maximum(np.asarray(muscle.force(at, pressures[:, None])), 0.0)

    force, rows = pull(true), fitting.predict(saved, at, pressures)
    states = {(row["length_m"], row["pressure_Pa"]): row for row in rows}
    got, low, high = (np.array([[states[L, P][key] for L in at] for P in pressures])
                      for key in ("force_N", "low_95_N", "high_95_N"))  # fmt: skip
    inside = (low <= force) & (force <= high)
    # The same muscle but for the shape that the photographs show.
    sizes = ("rest_length", "wall_thickness", "bladder_diameter", "braid_thickness")
    specimen = dataclasses.replace(
        read_sheet(folder).specimen, **{name: getattr(truth, name) for name in sizes}
    )
    shown = surface.geometry(specimen, braid=known.family.braid)
    as_shown = pull(famjax.Muscle(shown, laws[1].material, true.deadband_pressure))
    values = zip(["E_1", "E_2", "E_3", "deadband_pressure", "turns"],
                 [*truth.coefficients, truth.deadband, truth.turns], strict=True)  # fmt: skip
    off = [abs(found["values"][name] - value) / found["std"][name] for name, value in values]

    def rms(error: np.ndarray) -> float:
        return float(np.sqrt(np.mean(error**2)))

    return {
        "diameter, RMS error [in]": rms(surface.diameters[0] - shape) / INCH,
        "contraction, largest error": float(np.abs(off_lengths).max() / truth.rest_length),
        "stress over the visited strains, largest error / largest":
            float(np.abs(stress - truly).max() / np.abs(truly).max()),
        "force at pressures held out, RMS error / largest": rms((got - force)[:2]) / force.max(),
        "force from photographs and true profiles, RMS error / largest":
            rms(as_shown - force) / force.max(),
        "intervals": inside.size + len(off),
        "within": int(inside.sum()) + sum(one <= 1.96 for one in off),
    }  # fmt: skip


def clocks(_: Case) -> dict[str, float]:
    """Errors of offset and rate of two clocks over their stated standard errors, RMS over 100 seeds."""
    found: dict[str, list[float]] = {}
    for seed in range(CLOCKS):
        for way, errors in (("load", _by_load(seed)), ("motion", _by_motion(seed))):
            for name, error in zip(("offset", "rate"), errors, strict=True):
                found.setdefault(f"by the {way}, {name}, RMS error / standard error", []).append(
                    error
                )
    return {name: float(np.sqrt(np.mean(np.square(errors)))) for name, errors in found.items()}


def _by_load(seed: int) -> tuple[float, float]:
    """A test on the simulated rig, whose machine's clock is laid onto the journal by the load."""
    rng = np.random.default_rng((seed, 0))
    friction, turns = rng.uniform(0.005, 0.03), 1.09 * rng.uniform(0.97, 1.03)
    low = float(rng.uniform(30, 45))
    plan = Isobaric((low * PSI, (low + 20) * PSI, (low + 40) * PSI), 1, 2.0 * INCH, 0.3 * INCH,
                    settle=3.0)  # fmt: skip
    clock = MachineClock(float(rng.uniform(-50, 50)), float(rng.uniform(-1e-4, 1e-4)))
    with tempfile.TemporaryDirectory() as folder:
        found = simulate(
            PlanFile(plan, "air", 115 * PSI, Control.per_psi(4, 2)), folder,
            muscle=LinearMcKibben(turns=turns), clock=clock,
            clock_rate=float(rng.uniform(-3e-3, 3e-3)), friction=friction, seed=seed,
        ).analysis.alignment  # fmt: skip
    apart = float(found.journal_time(found.reference)) - clock.true_time(found.reference)
    gain = 1 / (1 + clock.rate) - 1
    return apart / found.offset_error, (found.rate - gain) / found.rate_error


def _by_motion(seed: int) -> tuple[float, float]:
    """Lengths in photographs of a stroke there and back, laid onto a machine's displacement."""
    rng = np.random.default_rng((seed, 1))
    offset, rate = rng.uniform(-30, 30), 1 + rng.uniform(-3e-4, 3e-4)

    def displacement(at: np.ndarray) -> np.ndarray:
        return 2.8 * INCH * (1 - np.abs(2 * np.clip((at - 10) / 240, 0, 1) - 1))

    taken, logged = 0.4 + 1.09 * np.arange(220), np.arange(0, 270.0, 0.1)
    middle = taken.mean()
    at = taken + offset + (rate - 1) * (taken - middle) + rng.normal(0, 0.01, taken.size)
    lengths = 9.28 * INCH - displacement(at) + rng.normal(0, 0.001 * INCH, taken.size)
    found = synchronise(taken, lengths, MachineLog(logged, displacement(logged), source="log"))
    apart = found.offset - offset - (rate - 1) * (found.reference - middle)
    return apart / found.offset_stderr, (found.rate - rate) / found.rate_stderr

"""Promises of the chain from records and photographs to a muscle, on twins of known truth."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from promise import Case, Direction, Promise, shown

HERE = Path(__file__).resolve().parent
TWINS = 20


def twins(figure: str) -> Callable[[Case], float]:
    """A figure of `twins.py`."""

    def measure(case: Case) -> float:
        def compute() -> dict[str, Any]:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "found.json"
                command = [sys.executable, str(HERE / "twins.py"), "--seeds", str(TWINS)]
                subprocess.run(
                    [*command, "--json", str(path)], check=True, stdout=subprocess.DEVNULL
                )
                return json.loads(path.read_text(encoding="utf-8"))

        return case.once("twins", compute)[figure]

    return measure


def counted(program: str, figure: str) -> Callable[[Case], float]:
    """How many entries, or which number, a program of this folder writes under a name."""

    def measure(case: Case) -> float:
        def compute() -> dict[str, Any]:
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "found.json"
                # Its exit code says the same as the figures: it is 1 where one is not as it must be.
                subprocess.run(
                    [sys.executable, str(HERE / program), "--json", str(path)],
                    check=False, stdout=subprocess.DEVNULL,
                )  # fmt: skip
                return json.loads(path.read_text(encoding="utf-8"))

        found = case.once(program, compute)[figure]
        return float(len(found) if isinstance(found, list) else found)

    return measure


def _folders() -> Iterable[Promise]:
    """What a folder does that is damaged, killed, or that lacks parts."""
    for program, figure, name, statistic, limit, direction in (
        ("damaged_folders.py", "damages", "damaged folders, tried", "damages", 37.0, "at least"),
        ("damaged_folders.py", "wrong", "damaged folders, not told at the right step",
         "damages that stop or warn elsewhere, or with another message", 0.0, "at most"),
        ("killed_evaluations.py", "kills", "killed evaluations, kills", "kills", 10.0, "at least"),
        ("killed_evaluations.py", "differing", "killed evaluations, other bytes",
         "files of the results that differ", 0.0, "at most"),
    ):  # fmt: skip
        yield Promise(16, name, counted(program, figure), f"python benchmarks/{program}",
                      "the small twin of seed 3", "all", statistic, limit,
                      "at most" if direction == "at most" else "at least", seed=3,
                      cost="long")  # fmt: skip
    tests = "python -m pytest -m 'slow or not slow' tests/"
    for file, name, statistic in (
        ("famjax/app/test_folder.py", "folders without pictures, test, log or ruler",
         "said in terminal and report"),
        ("famjax/app/test_folder.py", "the truth of a twin is not there while it is evaluated",
         "it comes back"),
        ("rendering/test_made_folder.py", "a twin of the same truth and seed", "files that differ"),
    ):  # fmt: skip
        yield shown(16, name, tests + file, statistic, 0.0)


def _rows() -> Iterable[Promise]:
    rows: list[tuple[str, str, str, float, Direction]] = [
        ("diameter_rms_in", "diameter", "largest RMS error of a twin [in]", 0.002, "at most"),
        ("contraction_largest", "contraction", "largest error", 0.002, "at most"),
        ("stress_largest", "stress over the visited strains", "largest error / largest", 0.03,
         "at most"),
        ("force_rms", "force at pressures held out", "RMS error / largest force", 0.005, "at most"),
        ("shape_force_rms", "force from photographs against force from true profiles",
         "RMS difference / largest force", 0.001, "at most"),
        ("covered", "95 % intervals of parameters and forces", "part with the truth", 0.88,
         "at least"),
        ("covered", "95 % intervals of parameters and forces", "part with the truth", 0.99,
         "at most"),
        ("seconds", "a small twin from cold", "mean wall time [s]", 180.0, "at most"),
    ]  # fmt: skip
    for figure, name, statistic, limit, direction in rows:
        yield Promise(16, f"twins, {name}, {direction}", twins(figure), "python benchmarks/twins.py",
                      "small twins", f"{TWINS} twins", statistic, limit, direction, seed=0,
                      cost="long")  # fmt: skip


CHAIN: tuple[Promise, ...] = (*_rows(), *_folders())
"""Issue 16."""

"""Promises of the chain from records and photographs to a muscle, on twins of known truth."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from promise import Case, Direction, Promise

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


def _rows() -> Iterable[Promise]:
    rows: list[tuple[str, str, str, float, Direction]] = [
        ("diameter_rms_in", "diameter", "largest RMS error of a twin [in]", 0.002, "at most"),
        ("contraction_largest", "contraction", "largest error", 0.002, "at most"),
        ("stress_largest", "stress over the visited strains", "largest error / largest", 0.03,
         "at most"),
        ("force_rms", "force at pressures held out", "RMS error / largest force", 0.005, "at most"),
        ("parameters_covered", "95 % intervals of parameters", "part with the truth", 0.88,
         "at least"),
        ("parameters_covered", "95 % intervals of parameters", "part with the truth", 0.99,
         "at most"),
        ("seconds", "a small twin from cold", "mean wall time [s]", 180.0, "at most"),
    ]  # fmt: skip
    for figure, name, statistic, limit, direction in rows:
        yield Promise(16, f"twins, {name}, {direction}", twins(figure), "python benchmarks/twins.py",
                      "small twins", f"{TWINS} twins", statistic, limit, direction, seed=0,
                      cost="long")  # fmt: skip


CHAIN: tuple[Promise, ...] = tuple(_rows())
"""Issue 16."""

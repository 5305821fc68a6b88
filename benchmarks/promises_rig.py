"""Promises of the rig: its firmware, link, journal and simulation, by their own benchmarks."""

import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

from promise import CannotRunError, Case, Direction, Promise, shown

HERE = Path(__file__).resolve().parent


def _program(case: Case, words: Sequence[str]) -> dict[str, Any]:
    """The object that a benchmark writes with `--json FILE`, run once for all its figures."""

    def compute() -> dict[str, Any]:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "found.json"
            found = subprocess.run(
                [sys.executable, str(HERE / words[0]), *words[1:], "--json", str(path)],
                capture_output=True, text=True, check=False,
            )  # fmt: skip
            if not path.exists():
                said = (found.stderr.strip() or found.stdout.strip()).splitlines()
                raise RuntimeError(f"exit code {found.returncode}: {said[-1] if said else ''}")
            return json.loads(path.read_text(encoding="utf-8"))

    return case.once(tuple(words), compute)


def rig(words: Sequence[str], *path: str) -> Callable[[Case], float]:
    """A figure of one of the rig's benchmarks."""

    def measure(case: Case) -> float:
        found: Any = _program(case, words)
        for key in path:
            if key not in found:
                raise CannotRunError(f"{words[0]} did not measure {key} on this machine")
            found = found[key]
        return found

    return measure


def isobar(fluid: str, statistic: str) -> Callable[[Case], float]:
    """Pressure of the simulated isobars [psi]: largest error of a mean, least or largest spread."""

    def measure(case: Case) -> float:
        rows = _program(case, ("rig_simulated.py", "isobaric", "--no-speed"))["rows"]
        if statistic == "mean":
            return max(abs(row[f"mean_{fluid}_psi"] - row["set_psi"]) for row in rows)
        spread = [row[f"std_{fluid}_psi"] for row in rows]
        return min(spread) if statistic == "least" else max(spread)

    return measure


def _rigs() -> Iterable[Promise]:
    identity, link = ("rig_firmware.py", "identity"), ("rig_link.py",)
    firmware, isobaric = " ".join(identity), "rig_simulated.py isobaric"
    rows: list[tuple[str, str, Callable[[Case], float], str, float, Direction]] = [
        (firmware, "Python = C", rig(identity, "python_c", "ticks"), "equal ticks", 3e6,
         "at least"),
        (firmware, "AVR = C", rig(identity, "avr_c", "records"), "equal records", 1e5,
         "at least"),
        (firmware, "over-pressure", rig(identity, "safety", "over_pressure", "greatest_s"),
         "time to output 0 [s], 1000 phases", 6.5e-3, "at most"),
        (firmware, "silence, latest", rig(identity, "safety", "silence", "greatest_s"),
         "time to output 0 [s]", 1.005, "at most"),
        (firmware, "silence, earliest", rig(identity, "safety", "silence", "least_s"),
         "time to output 0 [s]", 0.995, "at least"),
        (firmware, "hang", rig(identity, "safety", "hang", "greatest_s"),
         "time to output 0 [s]", 0.27, "at most"),
        (link[0], "damaged line, samples", rig(link, "damaged", "samples"), "samples", 1e7,
         "at least"),
        (link[0], "damaged line, lost", rig(link, "damaged", "lost"), "samples", 0, "at most"),
        (link[0], "damaged line, wrong", rig(link, "damaged", "wrong"), "samples", 0, "at most"),
        (link[0], "kill -9", rig(link, "kills", "worst_lost_s"), "largest loss [s], 50 kills", 0.02,
         "at most"),
        (link[0], "torn journal", rig(link, "tears", "wrong_rows"), "wrong rows, 1000 tears", 0,
         "at most"),
    ]  # fmt: skip
    for fluid in ("air", "water"):
        rows.extend([
            (isobaric, f"{fluid}, mean", isobar(fluid, "mean"), "largest error of a mean [psi]",
             0.1, "at most"),
            (isobaric, f"{fluid}, spread", isobar(fluid, "largest"),
             "largest standard deviation [psi]", 0.45, "at most"),
            (isobaric, f"{fluid}, least spread", isobar(fluid, "least"),
             "least standard deviation [psi]", 0.15, "at least"),
        ])  # fmt: skip
    for program, name, measure, statistic, limit, direction in rows:
        yield Promise(6, f"rig, {name}", measure, f"python benchmarks/{program}", "simulated rig",
                      "all", statistic, limit, direction, cost="long")  # fmt: skip


def _faults() -> Iterable[Promise]:
    words = ("rig_firmware.py", "faults")
    rows: list[tuple[str, tuple[str, str], str, float, Direction]] = [
        ("transducer that lies", ("faults", "cases"), "combinations of fault, pressure, time, gains",
         1000, "at least"),
        ("transducer that lies, too high", ("faults", "exceeded"),
         "true pressures over limit + 2 % or set + 25 psi", 0, "at most"),
        ("sound tests", ("sound", "tests"), "tests, published gains, air and water", 200, "at least"),
        ("sound tests, tripped", ("sound", "tripped"), "false trips", 0, "at most"),
    ]  # fmt: skip
    for name, path, statistic, limit, direction in rows:
        yield Promise(15, f"rig, {name}", rig(words, *path), f"python benchmarks/{' '.join(words)}",
                      "simulated rig", "all", statistic, limit, direction, cost="long")  # fmt: skip


def _datasets() -> Iterable[Promise]:
    words = ("rig_simulated.py", "datasets")
    rows = [
        ("E_1, E_2, deadband, thread length", "largest_of_all", "largest standard errors", 3.0),
        ("force against the truth", "largest_rms_N", "largest RMS of a seed [N]", 1.6),
    ]
    for name, key, statistic, limit in rows:
        yield Promise(15, f"dataset of a simulated rig, {name}", rig(words, key),
                      f"python benchmarks/{' '.join(words)}", "seeds 0 to 19", "all", statistic, limit,
                      cost="long")  # fmt: skip


RIG: tuple[Promise, ...] = (
    *_rigs(),
    *_faults(),
    *_datasets(),
    shown(6, "tests of the rig without real time", "pytest tests/rig", "time [s]", 60.0),
)
"""Issues 6 and 15."""

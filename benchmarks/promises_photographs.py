"""Promises of the photogrammetry, on rendered scenes of known truth."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from promise import Case, Cost, Direction, Promise

HERE = Path(__file__).resolve().parent
SIZE = (2650, 1100)
"""Rows and columns of the pictures."""
ATTACKS = 200
BEFORE = (0.000903, 0.000445)
"""Median standard errors [in] of length and mean diameter on these sound pictures before issue 15."""


def photograph(section: str, what: str, *, least: bool = False) -> Callable[[Case], float]:
    """A figure of `imaging_accuracy.py` on full-size scenes."""

    def measure(case: Case) -> float:
        import imaging_accuracy  # noqa: PLC0415 -- OpenCV

        more = (100,) if section == "own_errors" else ()
        rows = case.once(section, lambda: list(getattr(imaging_accuracy, section)(SIZE, *more)))
        found = [row.found for row in rows if row.what.startswith(what)]
        return min(found) if least else max(found)

    return measure


def attack(figure: str) -> Callable[[Case], float]:
    """A figure of `photograph_attacks.py` on 200 scenes of seed 0."""

    def measure(case: Case) -> float:
        import photograph_attacks  # noqa: PLC0415 -- OpenCV

        def compute() -> dict[str, float]:
            return photograph_attacks.figures(photograph_attacks.attacked(0, ATTACKS))

        return case.once("photograph_attacks", compute)[figure]

    return measure


def photograph_speed(ratio: str) -> Callable[[Case], float]:
    """A ratio of `imaging_speed.py`."""

    def measure(case: Case) -> float:
        def compute() -> dict[str, Any]:
            command = [sys.executable, str(HERE / "imaging_speed.py"), "--json"]
            found = subprocess.run(command, capture_output=True, text=True, check=False)
            return json.loads(found.stdout)["ratios"]

        return case.once("imaging_speed", compute)[ratio]

    return measure


def _photographs() -> Iterable[Promise]:
    rows: list[tuple[str, str, float]] = [
        ("accuracy", "diameter, bias [in]", 0.0008), ("accuracy", "diameter, RMS [in]", 0.0015),
        ("accuracy", "length [in]", 0.0015), ("accuracy", "volume, relative", 1e-3),
        ("accuracy", "three-term Fourier RMSE [in]", 0.0015),
        ("harsh_light", "harsh light, diameter bias [in]", 0.002),
        ("harsh_light", "frontal light, diameter bias [in]", 0.002),
        ("stroke", "contraction over a stroke", 0.002),
        ("rulers", "scale from the ruler, relative", 5e-5),
        ("own_errors", "normalised error", 1.5),
    ]  # fmt: skip
    call = "python benchmarks/imaging_accuracy.py"
    for section, what, limit in rows:
        cost: Cost = "long" if section == "own_errors" else "minutes"
        yield Promise(5, f"photographs, {what}", photograph(section, what), call, "rendered scenes",
                      "2650 x 1100 px", f"{what}, largest", limit, cost=cost)  # fmt: skip
    yield Promise(5, "photographs, normalised error, least",
                  photograph("own_errors", "normalised error", least=True), call, "rendered scenes",
                  "100 scenes", "RMS of error / standard error, least", 0.7, "at least",
                  cost="long")  # fmt: skip
    for name, limit, up in (("crop", 15.0, True), ("file", 1.6, False), ("workers", 1.7, True)):
        yield Promise(5, f"photographs, speed, {name}", photograph_speed(name),
                      "python benchmarks/imaging_speed.py", "rendered scenes", "quiet machine",
                      f"ratio '{name}' of CPU time, workers of wall time", limit,
                      "at least" if up else "at most")  # fmt: skip


def braid_angle(what: str) -> Callable[[Case], float]:
    """A figure of `imaging_accuracy.braid_angles`."""

    def measure(case: Case) -> float:
        import imaging_accuracy  # noqa: PLC0415 -- OpenCV

        rows = case.once("braid_angle", lambda: list(imaging_accuracy.braid_angles(60)))
        return next(row.found for row in rows if row.what.startswith(what))

    return measure


def _braid_angles() -> Iterable[Promise]:
    figures: list[tuple[str, float, Direction]] = [
        ("angle at z within 0.3 deg, part", 0.95, "at least"),
        ("mean angle of a picture, largest error [deg]", 0.3, "at most"),
        ("angle at z within its 95 % interval, part", 0.88, "at least"),
        ("angle at z within its 95 % interval, part", 0.99, "at most"),
        ("strands counted right, part", 0.95, "at least"),
    ]
    for what, limit, direction in figures:
        name = f"photographs, braid {what}, {direction}"
        yield Promise(15, name, braid_angle(what), "python benchmarks/imaging_accuracy.py",
                      "rendered scenes", "60 scenes of 150 to 260 px/in", what, limit, direction,
                      cost="minutes")  # fmt: skip


def _attacks() -> Iterable[Promise]:
    rows: list[tuple[str, float, Direction]] = [
        ("silent errors", 2, "at most"),
        ("sound, measured without a warning", 0.85, "at least"),
        ("sound, median standard error of the length [in]", BEFORE[0], "at most"),
        ("sound, median standard error of the diameter [in]", BEFORE[1], "at most"),
    ]
    for figure, limit, direction in rows:
        yield Promise(15, f"photographs that deceive, {figure}", attack(figure),
                      "python benchmarks/photograph_attacks.py", "rendered scenes",
                      f"{ATTACKS} scenes with faults at random", figure, limit, direction,
                      seed=0, cost="long")  # fmt: skip


PHOTOGRAPHS: tuple[Promise, ...] = (*_photographs(), *_braid_angles(), *_attacks())
"""Issues 5 and 15."""

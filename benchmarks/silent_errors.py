"""Whether the default answer of `famjax fit MAP.csv` is ever silently wrong between the readings.

    python benchmarks/silent_errors.py [--group own hard bundled] [--count N] [--seed 0] [--jobs 2]
        [--data NAME=READINGS.csv ...] [--json FILE]

Every map of `dense_truth.py` is read, chosen for, judged and predicted as bare `famjax fit` and `famjax
predict` do it, on a dense grid of states inside the measured range. A state is wrong where the error is
more than 3 half-widths of the 95 % band, or more than 10 % of the largest force and outside the band. A
map is bad where a state is wrong; it is silently wrong where moreover the verdict states no doubt and the
state is said to be inside. A verdict that doubts only because the rest length was not given states none:
it says nothing of the force. `--data` takes maps of others: beside READINGS.csv, which `famjax fit` takes,
lies READINGS.truth.csv, with columns pressure_kPa,length_mm,force_N of states inside the measured range.
"""

import argparse
import concurrent.futures
import csv
import dataclasses
import functools
import itertools
import json
import multiprocessing
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

import numpy as np
from dense_truth import COUNTS, TruthMap, maps

from famjax.boundary.errors import InputError
from fitting import ForceData, load_fit, predict
from fitting.cli.inputs import load_fitting, load_map
from fitting.cli.problem import Asked, Problem, judged
from fitting.saved import SavedFit, fit_as_dict

HALF_BANDS, PERCENT = 3.0, 10.0
"""Beyond these an answer is wrong: half-widths of its band; part of the largest force."""


@dataclasses.dataclass(frozen=True)
class Answer:
    """Predictions of a saved fit at states, shape (n,) each.

    Attributes:
        force, low, high: prediction and ends of its 95 % band [N], nan where there is none.
        inside: whether the state is said to be inside what was measured.
    """

    force: np.ndarray
    low: np.ndarray
    high: np.ndarray
    inside: np.ndarray


@dataclasses.dataclass(frozen=True)
class Row:
    """One map, its answer held against its truth.

    Attributes:
        group, name, seed, about: of the map.
        law: the family that was chosen.
        verdict, reasons: its level, and what it doubts.
        rmse_percent: over the states at which truth or answer pulls, in % of the largest force.
        worst_half_bands: largest error in half-widths of the band there.
        worst_percent: largest error in % of the largest force.
        worst_at: the state, "mm, kPa: answer for truth N", of the largest error in half-widths.
        coverage: % of the states that pull whose band holds the truth.
        half_band_percent: mean half-width of the band there, in % of the largest force.
        bad: whether a state is wrong, warned of or not.
        silent: whether a state is wrong and nothing warns of it.
        silent_but_for_lines: as `silent`, with a verdict that doubts for want of lines taken as a warning.
        seconds: for all of it.
        failure: why there is no answer, "" where there is one; a refusal is not silent.
    """

    group: str
    name: str
    seed: int
    about: str
    law: str = ""
    verdict: str = ""
    reasons: tuple[str, ...] = ()
    rmse_percent: float = np.nan
    worst_half_bands: float = np.nan
    worst_percent: float = np.nan
    worst_at: str = ""
    coverage: float = np.nan
    half_band_percent: float = np.nan
    bad: bool = False
    silent: bool = False
    silent_but_for_lines: bool = False
    seconds: float = np.nan
    failure: str = ""


def default_fit(data: ForceData) -> SavedFit:
    """What bare `famjax fit` saves of a map, read back."""

    def silence(*_: object) -> None:
        return None

    problem = Problem.of(data, Asked())
    result, choice = problem.solve(silence)
    evidence = problem.evidence(result, choice, silence)
    judgement = judged(result, choice, evidence, silence)
    document = fit_as_dict(result, evidence, choice=choice, judgement=judgement)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "fit.json"
        path.write_text(json.dumps(document, allow_nan=False), encoding="utf-8")
        return load_fit(path)


def answer(fit: SavedFit, length: np.ndarray, pressure: np.ndarray) -> Answer:
    """What `famjax predict` says at pairs of lengths [m] and pressures [Pa], shape (n,) each."""
    L, row_of = np.unique(length, return_inverse=True)
    rows = [
        row for k, at in enumerate(L) for row in predict(fit, np.array([at]), pressure[row_of == k])
    ]
    order = np.argsort(np.argsort(row_of, kind="stable"))
    force, low, high = (
        np.array([row[name] for row in rows], float)[order]
        for name in ("force_N", "low_95_N", "high_95_N")
    )
    return Answer(force, low, high, np.array([row["inside"] for row in rows], bool)[order])


def compared(one: TruthMap, truth: np.ndarray, fit: SavedFit) -> Row:
    """A fit against the truth at the states of a map.

    A muscle that is slack reads 0: so does an answer below 0, and a band that reaches below.

    Args:
        one: the map.
        truth: at its states [N].
        fit: of its readings.
    """
    found, document = answer(fit, one.length, one.pressure), fit.document
    largest = document["max_force_N"]
    force, low = np.maximum(found.force, 0.0), np.maximum(found.low, 0.0)
    half, error = np.fmax(found.high - force, force - low), force - truth  # the end at 0 is nearer
    known = np.isfinite(error) & np.isfinite(half)
    pulls = known & ((truth > 0) | (force > 0))
    if not pulls.any():
        return _failed(one, "no answer at any state that pulls")
    percent = 100 * np.abs(error) / largest
    halves = np.divide(np.abs(error), half, where=known & (half > 0), out=np.zeros(half.size))
    covered = (low <= truth) & (truth <= np.maximum(found.high, 0.0))
    wrong = known & ((halves > HALF_BANDS) | ((percent > PERCENT) & ~covered))
    unwarned = bool((wrong & found.inside).any())
    worst = int(np.argmax(np.where(pulls, halves, -1.0)))
    return Row(
        one.group, one.name, one.seed, one.about,
        law=document["choice"]["chosen"],
        verdict=document["verdict"],
        reasons=tuple(document["reasons"]),
        rmse_percent=float(100 * np.sqrt(np.mean(error[pulls] ** 2)) / largest),
        worst_half_bands=float(halves[worst]),
        worst_percent=float(percent[known].max()),
        worst_at=f"{one.length[worst] * 1e3:.1f} mm, {one.pressure[worst] / 1e3:.0f} kPa: "
        f"{force[worst]:.4g} +- {half[worst]:.2g} for {truth[worst]:.4g} N",
        coverage=float(100 * np.mean(covered[pulls])),
        half_band_percent=float(100 * np.mean(half[pulls]) / largest),
        bad=bool(wrong.any()),
        silent=unwarned and not document["reasons"],
        silent_but_for_lines=unwarned and document["verdict"] == "identified",
        failure="" if known.all() else f"no answer at {(~known).sum()} of {known.size} states",
    )  # fmt: skip


def examined(one: TruthMap) -> Row:
    """The row of a map; whatever ends its fit stands in it."""
    begin = time.perf_counter()
    load_fitting()  # float64 and kept programs, as every command has them
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "map.csv"
            path.write_text(one.readings, encoding="utf-8")
            fit = default_fit(load_map(str(path), {}))
        truth = one.force
        if truth is None:
            truth = np.maximum(answer(_whole(one.reference), one.length, one.pressure).force, 0.0)
        row = compared(one, truth, fit)
    except (InputError, ArithmeticError, LookupError, RuntimeError, TypeError, ValueError) as error:
        row = _failed(one, f"{type(error).__name__}: {(str(error).splitlines() or [''])[0]}")
    return dataclasses.replace(row, seconds=time.perf_counter() - begin)


@functools.lru_cache
def _whole(name: str) -> SavedFit:
    """The fit of a whole bundled map with its lines."""
    return default_fit(load_map(name, {}))


def _failed(one: TruthMap, why: str) -> Row:
    return Row(one.group, one.name, one.seed, one.about, failure=why)


def examine(given: Iterable[TruthMap], jobs: int = 1) -> Iterator[Row]:
    """The rows of maps in their order, each map in one of so many processes."""
    if jobs <= 1:
        yield from map(examined, given)
        return
    spawned = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(jobs, mp_context=spawned) as pool:
        yield from pool.map(examined, given)


def given_map(entry: str) -> TruthMap:
    """A map of others: NAME=READINGS.csv, beside which lies READINGS.truth.csv.

    Raises:
        InputError: one of the files is not there, or the entry or the truth's columns are not these.
    """
    name, equals, path = entry.partition("=")
    if not equals:
        raise InputError(f"--data must be NAME=READINGS.csv, got {entry!r}")
    readings, truth = Path(path), Path(path).with_suffix(".truth.csv")
    for file in (readings, truth):
        if not file.is_file():
            raise InputError(f"no such file: {file}; readings and their truth lie side by side")
    with truth.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    columns = ("length_mm", "pressure_kPa", "force_N")
    missing = [column for column in columns if not rows or column not in rows[0]]
    if missing:
        raise InputError(f"{truth} must have columns {','.join(columns)}; missing: {missing}")
    length, pressure, force = (np.array([float(row[c]) for row in rows]) for c in columns)
    return TruthMap(
        "given", name, 0, readings.name, readings.read_text(encoding="utf-8"), length / 1e3,
        pressure * 1e3, force,
    )  # fmt: skip


def summary(rows: Sequence[Row]) -> dict[str, dict[str, float]]:
    """Figures of each group: counts, means over its maps, and parts of its verdicts."""
    found = {}
    for group in dict.fromkeys(row.group for row in rows):
        every = [row for row in rows if row.group == group]
        answered = [row for row in every if row.verdict]
        found[group] = {
            "maps": len(every),
            "without an answer": len(every) - len(answered),
            "silently wrong": sum(row.silent for row in every),
            "silently wrong, want of lines a warning": sum(
                row.silent_but_for_lines for row in every
            ),
            "bad": sum(row.bad for row in every),
        }
        if not answered:
            continue
        found[group] |= {
            "mean RMSE, %": float(np.mean([row.rmse_percent for row in answered])),
            "mean half-band, %": float(np.mean([row.half_band_percent for row in answered])),
            "mean coverage, %": float(np.mean([row.coverage for row in answered])),
            "worst coverage, %": min(row.coverage for row in answered),
            "worst error, half-bands": max(row.worst_half_bands for row in answered),
            "worst error, %": max(row.worst_percent for row in answered),
        } | {
            f"{level}, part": float(np.mean([row.verdict == level for row in answered]))
            for level in ("identified", "identified with doubts", "not identified")
        }
    return found


def line(row: Row) -> str:
    """A row as it is printed."""
    mark = "SILENT" if row.silent else "bad" if row.bad else ""
    level = {"identified with doubts": "doubts", "not identified": "NOT"}
    figures = (
        f"{row.rmse_percent:6.2f} {row.worst_half_bands:7.2f} {row.worst_percent:7.2f} "
        f"{row.coverage:6.1f} {row.half_band_percent:6.2f}"
    )
    return (
        f"{row.name:12} {row.seed:4} {figures} {mark:6} "
        f"{level.get(row.verdict, row.verdict):10} {row.seconds:5.0f} s  {row.law:42.42} | {row.about}"
        + f" | {row.worst_at}" * row.bad
        + f" | {row.failure}" * bool(row.failure)
    )


def main(arguments: Sequence[str] | None = None) -> int:
    """Print a line for each map, and the figures of each group; 1 where one is silently wrong."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--group", nargs="+", choices=tuple(COUNTS), help="groups of maps; all if omitted"
    )
    parser.add_argument("--count", type=int, help="maps of each group")
    parser.add_argument(
        "--seed", type=int, default=0, help="of the first map; they go on from there"
    )
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    parser.add_argument("--data", nargs="+", default=[], metavar="NAME=READINGS.csv")
    parser.add_argument("--json", type=Path, help="file for rows and figures")
    given = parser.parse_args(arguments)
    groups = given.group or ([] if given.data else list(COUNTS))
    every = itertools.chain(
        map(given_map, given.data), *(maps(group, given.count, given.seed) for group in groups)
    )
    print(
        "map          seed  RMSE%  halves  worst%  cover  half%  wrong  verdict     time   law | map"
    )
    rows = []
    for row in examine(every, given.jobs):
        rows.append(row)
        print(line(row), flush=True)
        if given.json:
            _write(given.json, rows)
    for group, figures in summary(rows).items():
        print(f"\n{group}")
        for name, value in figures.items():
            print(f"  {name}: {value:.4g}")
    return int(any(row.silent for row in rows))


def _write(path: Path, rows: Sequence[Row]) -> None:
    """Rows and figures so far; what is not a number is null."""

    def plain(figures: dict) -> dict:
        return {
            k: None if isinstance(v, float) and not np.isfinite(v) else v
            for k, v in figures.items()
        }

    document = {
        "rows": [plain(dataclasses.asdict(row)) for row in rows],
        "figures": {group: plain(figures) for group, figures in summary(rows).items()},
    }
    path.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())

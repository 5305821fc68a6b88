"""Promises of the time that a user waits: whole processes, in multiples of an import."""

import math
import tempfile
import time
from collections.abc import Callable, Iterable
from pathlib import Path

import first_answer
from promise import CannotRunError, Case, Cost, Promise

_NEWEST = 1.3
"""Times as much that the newest JAX may take."""


def first(row: first_answer.Row | first_answer.Check, regime: str) -> Callable[[Case], float]:
    """The multiple, CPU seconds or programs of a row of `first_answer.py`."""

    def measure(case: Case) -> float:
        (line,) = (line for line in _lines(case, case.python, row) if line.regime == regime)
        if math.isnan(line.value):
            raise RuntimeError(line.note)
        return line.value

    return measure


def _lines(
    case: Case, python: str, row: first_answer.Row | first_answer.Check
) -> list[first_answer.Line]:
    def compute() -> list[first_answer.Line]:
        with tempfile.TemporaryDirectory(prefix="first-answer-") as folder:
            machine = first_answer.Machine(python, _map_of(case), Path(folder))
            lines = first_answer.measure(
                machine, [row], repeat=case.repeat, regimes=("cold", "second")
            )
        return lines[1:]

    return case.once(("first answer", python, row.name), compute)


def _map_of(case: Case) -> str:
    """What `famjax fit` is given: the name of a bundled map, or the path of a file."""
    if case.data is None:
        return first_answer.DATA
    path = Path(case.data.source)
    return str(path.resolve()) if path.exists() else case.name


def on_newest(row: first_answer.Row) -> Callable[[Case], float]:
    """The largest ratio of a row's multiples with the newest JAX to those with this one."""

    def measure(case: Case) -> float:
        if case.other_python is None:
            raise CannotRunError("needs --other-python, an interpreter with the newest JAX")
        here = {line.regime: line for line in _lines(case, case.python, row)}
        there = {line.regime: line for line in _lines(case, case.other_python, row)}
        for line in (*here.values(), *there.values()):
            if math.isnan(line.value):
                raise RuntimeError(line.note)
        return max(there[regime].value / here[regime].value for regime in here)

    return measure


def wall_of_the_main_job(case: Case) -> float:
    """Wall time [s] of `famjax fit` with an empty cache."""
    with tempfile.TemporaryDirectory(prefix="first-answer-") as folder:
        machine = first_answer.Machine(case.python, _map_of(case), Path(folder))
        began = time.perf_counter()
        machine.run(first_answer.FIT, None)
        return time.perf_counter() - began


def _first_answer() -> Iterable[Promise]:
    call = "python benchmarks/first_answer.py --rows"
    for row in first_answer.ROWS:
        cost: Cost = "long" if row.long else "minutes"
        for regime in ("cold", "second"):
            if not math.isnan(row.limit(regime)):
                yield Promise(
                    row.issue, f"first answer, {row.name}, {regime}", first(row, regime),
                    f"{call} '{row.name}'", first_answer.DATA, "whole process, children included",
                    "least CPU time / that of the import", row.limit(regime), cost=cost,
                )  # fmt: skip
    for check in first_answer.CHECKS:
        counts = not math.isnan(check.programs)
        yield Promise(
            12, f"first answer, {check.name}", first(check, ""), f"{call} '{check.name}'",
            first_answer.DATA, "one process", "programs compiled" if counts else "CPU [s]",
            check.programs if counts else check.seconds,
        )  # fmt: skip
    for row in first_answer.ROWS:
        if not (math.isnan(row.second) and math.isnan(row.cold)):
            yield Promise(
                row.issue, f"newest JAX, {row.name}", on_newest(row), f"{call} '{row.name}' --python PATH",
                first_answer.DATA, "whole process, children included",
                "multiple / that with the pinned JAX, the larger of two regimes", _NEWEST,
                cost="long",
            )  # fmt: skip


FIRST_ANSWER: tuple[Promise, ...] = (
    Promise(2, "wall time of the main job", wall_of_the_main_job, "famjax fit", first_answer.DATA,
            "empty cache, installed", "wall time [s]", 60.0),
    *_first_answer(),
)  # fmt: skip
"""Issue 12's table, and the wall time of issue 2."""

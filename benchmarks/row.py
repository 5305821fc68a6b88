"""A row of the acceptance table, what a measure is given, and how its figure is judged."""

import contextlib
import dataclasses
import importlib
import io
import math
import os
import sys
from collections.abc import Callable, Hashable, Iterator
from pathlib import Path
from typing import Any, Literal, TypeVar

import fitting

os.environ.setdefault("PJRT_NPROC", "16")  # before JAX starts
HERE = Path(__file__).resolve().parent
TESTS = HERE.parent / "tests"
if (
    str(TESTS) not in sys.path
):  # renderers of known truth, what drives the firmware, targets of exports
    sys.path += [str(TESTS), str(TESTS / "rig"), str(TESTS / "famjax" / "export")]

Found = TypeVar("Found")
Cost = Literal["quick", "minutes", "long"]
Limit = tuple[str, Literal["<=", ">="], float, str]
"""The statistic with its unit, the direction, the limit, and the reason of the limit."""


class CannotRunError(RuntimeError):
    """What a measure needs is not here; the text says what."""


def load(name: str) -> fitting.ForceData:
    """The bundled map of that name, or else the file."""
    return fitting.load_bundled(name) if name in fitting.bundled_names() else fitting.read_csv(name)


def files(path: str | Path) -> list[str]:
    """A CSV file, or those of a folder by name, without those of a truth."""
    path = Path(path)
    inside = [str(one) for one in path.glob("*.csv") if not one.name.endswith(".truth.csv")]
    return sorted(inside) if path.is_dir() else [str(path)]


@dataclasses.dataclass
class Case:
    """What a row is measured on.

    Attributes:
        name: of the data.
        source: a bundled name, a CSV file or a folder of them; empty where the row needs none.
        python: the interpreter whose processes are timed.
        repeat: repetitions of a time, of which the least counts.
        known: what has been computed, shared by all cases of a run.
    """

    name: str = ""
    source: str = ""
    python: str = sys.executable
    repeat: int = 3
    known: dict[Hashable, Any] = dataclasses.field(default_factory=dict)

    def once(self, key: Hashable, compute: Callable[[], Found]) -> Found:
        """What `compute` returns, computed once in a run for this data and key."""
        if (self.name, key) not in self.known:
            self.known[self.name, key] = compute()
        return self.known[self.name, key]

    @property
    def paths(self) -> list[str]:
        """A bundled name, or the CSV files.

        Raises:
            CannotRunError: there are none.
        """
        if not self.source:
            raise CannotRunError(f"needs maps that are not bundled: --data '{self.name}=PATH'")
        return [self.source] if self.source in fitting.bundled_names() else files(self.source)

    @property
    def series(self) -> list[fitting.ForceData]:
        """The force maps."""
        return self.once("maps", lambda: [load(path) for path in self.paths])

    @property
    def map(self) -> fitting.ForceData:
        """The one force map, or the first."""
        return self.series[0]


@dataclasses.dataclass(frozen=True)
class Row:
    """One acceptance figure with its limit.

    Attributes:
        name: what is measured. `--only` matches this name or the statistic.
        measure: "module:function" of a function (case) or (case, of) that returns figures by name.
        of: second argument of the function, None for none.
        command: what a user runs or calls to see it.
        data: name of a bundled map, which `--data` replaces; otherwise what it is computed from.
        filter: part of the data.
        statistic: the figure's name, with its unit.
        direction, limit: "<=" or ">=", and the number.
        reason: of the limit.
        seed: of everything random, None where nothing is.
        cost: "quick" takes seconds once the fits that it shares with others are made.
        of_its_data: the limit belongs to this data set; for another one none is known.
    """

    name: str
    measure: str
    of: Hashable
    command: str
    data: str
    filter: str
    statistic: str
    direction: str
    limit: float
    reason: str
    seed: int | None
    cost: Cost
    of_its_data: bool

    @property
    def title(self) -> str:
        """Name and statistic."""
        return f"{self.name}: {self.statistic}"

    def kept(self, value: float) -> bool:
        """Whether a value keeps the limit; nan does not."""
        return value <= self.limit if self.direction == "<=" else value >= self.limit


def rows(
    name: str, measure: str, *limits: Limit, command: str, data: str | tuple[str, ...],
    part: str = "all", of: Hashable = None, seed: int | None = None, cost: Cost = "minutes",
    of_its_data: bool = False,
) -> Iterator[Row]:  # fmt: skip
    """Rows that one measure returns the figures of, on each of the data."""
    for one in (data,) if isinstance(data, str) else data:
        for statistic, direction, limit, reason in limits:
            yield Row(
                name, measure, of, command, one, part, statistic, direction, limit, reason, seed,
                cost, of_its_data,
            )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of a row: the value, nan where there is none, the verdict, and why there is none."""

    row: Row
    data: str
    value: float
    verdict: Literal["holds", "does NOT hold", "measured", "not run"]
    why: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON; what there is none of is None."""
        row = {k: v for k, v in vars(self.row).items() if k not in ("measure", "of", "of_its_data")}
        value = self.value if math.isfinite(self.value) else None
        return row | {"data": self.data, "value": value, "verdict": self.verdict, "why": self.why}

    def line(self) -> str:
        """The outcome as it is printed."""
        row, found = self.row, "" if math.isnan(self.value) else f" {self.value:.6g}"
        seed = "" if row.seed is None else f"seed {row.seed}"
        parts = [self.data, row.filter, seed, row.command, self.why]
        head = f"{self.verdict:13} {row.title}{found} ({row.direction} {row.limit:g}: {row.reason})"
        return " | ".join([head, *filter(None, parts)])


def judge(row: Row, case: Case, *, own_data: bool) -> Outcome:
    """Measure a row and hold it to its limit; a measure that fails does not hold.

    Args:
        row: the row.
        case: what it is measured on.
        own_data: these are the data that the limit was set for, or stand in for them.
    """
    module, _, function = row.measure.partition(":")
    arguments = () if row.of is None else (row.of,)

    def figures() -> dict[str, float] | Exception:
        measure = getattr(importlib.import_module(module), function)
        try:
            return measure(case, *arguments)
        except (ArithmeticError, AssertionError, AttributeError, ImportError, LookupError, OSError,
                RuntimeError, TypeError, ValueError) as error:  # fmt: skip
            return error

    found = case.once((row.measure, row.of), figures)
    if isinstance(found, CannotRunError):
        return Outcome(row, case.name, math.nan, "not run", str(found))
    if isinstance(found, Exception):
        why = f"{type(found).__name__}: {found}".partition("\n")[0]
        return Outcome(row, case.name, math.nan, "does NOT hold", why)
    if row.statistic not in found:
        return Outcome(row, case.name, math.nan, "not run", "this machine cannot measure it")
    value = float(found[row.statistic])
    if row.of_its_data and not own_data:
        return Outcome(row, case.name, value, "measured", f"the limit is that of {row.data}")
    return Outcome(row, case.name, value, "holds" if row.kept(value) else "does NOT hold")


def command(*words: object) -> tuple[int, str, str]:
    """Exit code, standard output and standard error of a command of famjax in this process."""
    from famjax.__main__ import main  # noqa: PLC0415

    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([*map(str, words)])
        except SystemExit as end:
            return int(end.code or 0), out.getvalue(), err.getvalue()
    return 0, out.getvalue(), err.getvalue()


def tell(text: str) -> None:
    """What is under way, on standard error."""
    print(f"  {text}", file=sys.stderr, flush=True)

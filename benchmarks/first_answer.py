"""How long a user waits for the first answer, in CPU seconds of whole processes.

    python benchmarks/first_answer.py [--rows PATTERN ...] [--repeat N] [--long] [--python PATH]
                                      [--data MAP] [--json FILE] [--list]

Each command and each library call runs in four regimes: `cold`, a fresh process with an empty
compilation cache; `second`, another process with the cache that the first one has filled; `again`,
the same once more in one process; `other`, in that process with other numbers. Beside them the same
fit by scripts that a user writes with SciPy and with lmfit. A figure is the user and system time of
the process and its children, the least of the repetitions, over that of

    python -c "import jax, equinox, optimistix"

which runs between them in the same way. Commands find their cache by FAMJAX_CACHE_DIR, library
calls by JAX's own variables; both are in a temporary folder that nothing else uses. Rows that take
minutes run with `--long`, or when `--rows` names them in full. `--python` measures this tree with
another interpreter, in which its dependencies are installed.

This file imports the standard library alone: what it imports is no part of what it measures.
"""

import argparse
import dataclasses
import fnmatch
import json
import math
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
STEPS = HERE / "first_answer_steps.py"
INPUTS = HERE / "first_answer_inputs.py"
DATA = "DMSP-20-300"
UNIT = ("-c", "import jax, equinox, optimistix")
REGIMES = ("cold", "second", "again", "other")

Step = tuple[str, ...]
"""What follows the interpreter on a command line; {data}, {inputs} and {root} are filled in."""


def famjax(*arguments: str) -> Step:
    """A command of famjax."""
    return ("-m", "famjax", *arguments)


def polynomial(data: str) -> Step:
    """`famjax fit` of the polynomial law, not of one that is chosen."""
    return famjax("fit", data, "--law", "polynomial")


CHOOSE, SWEEP, COMPARE = (famjax(command, "{data}") for command in ("fit", "sweep", "compare"))
FIT = polynomial("{data}")
PREDICT = famjax("predict", "{inputs}/fit.json", "--length", "270mm,250mm", "--pressure", "5bar")

_LIBRARY = """import jax
jax.config.update("jax_enable_x64", True)
import famjax, fitting, first_answer_inputs as inputs
data = inputs.load({map!r})
"""
_CALLS = {
    "identify": "print('rmse_N', fitting.identify(data).errors.rmse)",
    "sweep": """L0, D0 = data.specimen.rest_length, 1.1 * (data.specimen.nominal_diameter or 0.02)
braid = famjax.Braid.from_rest(diameter=D0, braid_angle=1.08, length=L0)
bladder = famjax.Bladder(L0, D0, data.specimen.wall_thickness, embedded=data.specimen.embedded)
fitting.sweep(data, famjax.EstimatedGeometry(braid, bladder), deadband=4e4)
""",
    "compare": "fitting.compare(data)",
}


def library(call: str, name: str = "{data}") -> Step:
    """A call of the library on a map, imports included."""
    return ("-c", _LIBRARY.replace("{map!r}", f"'{name}'") + _CALLS[call])


@dataclasses.dataclass(frozen=True)
class Row:
    """One thing that a user does.

    Attributes:
        name: by which `--rows` chooses it.
        step: what is run; in the regimes cold, second and again.
        other: what is run in the regime other, None for none.
        prime: what has filled the cache before the regime second, in place of `step` itself; there
            is no cold regime then.
        cold, second: limits as multiples of the import, nan for none.
        long: takes minutes.
        peer: a program of another author, which has one regime.
        issue: that set the limits.
    """

    name: str
    step: Step
    other: Step | None = None
    prime: Step | None = None
    cold: float = math.nan
    second: float = math.nan
    long: bool = False
    peer: bool = False
    issue: int = 12

    def limit(self, regime: str) -> float:
        """Of a regime; nan for none."""
        return {"cold": self.cold, "second": self.second}.get(regime, math.nan)


ROWS = (
    Row("famjax --help", famjax("--help"), cold=0.3, second=0.3),
    Row("famjax fit --help", famjax("fit", "--help"), cold=0.3, second=0.3),
    Row("famjax predict", PREDICT, cold=1.5, second=1.2,
        other=famjax("predict", "{inputs}/fit.json", "--length", "262mm", "--pressure", "4bar,6bar")),
    Row("famjax fit", FIT, polynomial("{inputs}/repeated.csv"), cold=3, second=1.8),
    Row("famjax fit, map of another size", polynomial("{inputs}/smaller.csv"), prime=FIT, second=2.2),
    Row("famjax fit, another specimen", polynomial("{inputs}/specimen.csv"), prime=FIT, second=2.2),
    Row("famjax fit, the model chosen", CHOOSE, famjax("fit", "{inputs}/repeated.csv"), cold=9,
        second=5.4, issue=14),
    Row("famjax fit, another law, new to the cache", famjax("fit", "{data}", "--law", "ogden"),
        prime=FIT, second=2.2),
    Row("famjax fit, another law", famjax("fit", "{data}", "--law", "ogden"), second=2.2),
    Row("famjax sweep", SWEEP, famjax("sweep", "{inputs}/specimen.csv"), cold=4, second=2, long=True),
    Row("famjax compare", COMPARE, famjax("compare", "{inputs}/repeated.csv"), cold=25, second=12,
        long=True),
    Row("famjax measure", famjax("measure", "{inputs}/photo.jpg", "--ruler", "{inputs}/ruler.jpg"),
        famjax("measure", "{inputs}/photo2.jpg", "--ruler", "{inputs}/ruler.jpg"), cold=1.5, second=1.5),
    Row("famjax reproduce", famjax("reproduce"), cold=40, second=25, long=True),
    Row("identify", library("identify"), library("identify", "{inputs}/repeated.csv")),
    Row("sweep", library("sweep"), library("sweep", "{inputs}/specimen.csv"), long=True),
    Row("compare", library("compare"), library("compare", "{inputs}/repeated.csv"), long=True),
    Row("SciPy script", ("{root}/benchmarks/rivals/fit_scipy.py", "{map}"), peer=True),
    Row("lmfit script", ("{root}/benchmarks/rivals/fit_lmfit.py", "{map}"), peer=True),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Check:
    """A call of the library in a process that has done others, which may not cost more than this.

    Attributes:
        name: by which `--rows` chooses it.
        before: steps that the process has done.
        step: what is looked at.
        seconds: limit of its CPU time [s], nan for none.
        programs: limit of the number of programs compiled, nan for none.
    """

    name: str
    before: tuple[Step, ...]
    step: Step
    seconds: float = math.nan
    programs: float = math.nan


_IMPORTS: Step = ("-c", _LIBRARY.partition("data =")[0])
CHECKS = (
    Check("identify, first call after import", (_IMPORTS,), library("identify"), seconds=4.0),
    Check("identify, renamed specimen", (library("identify"),),
          library("identify", "{inputs}/renamed.csv"), programs=0),
    Check("identify, another map in the same bucket", (library("identify"),),
          library("identify", "{inputs}/repeated.csv"), programs=0),
)  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Line:
    """One measured figure.

    Attributes:
        row: name of the row.
        regime: see the head of this file; "" for a check.
        value: multiple of the import, CPU seconds, or number of programs; nan where it failed.
        unit: "x", "s" or "programs".
        limit: nan for none.
        seconds: CPU time [s].
        note: what else was found out, or why there is no figure.
    """

    row: str
    regime: str
    value: float
    unit: str
    limit: float
    seconds: float
    note: str = ""

    @property
    def holds(self) -> bool | None:
        """Whether the limit is kept; None where there is none."""
        return None if math.isnan(self.limit) else self.value <= self.limit


class FailedRunError(RuntimeError):
    """A process ended with another exit code than 0."""


@dataclasses.dataclass
class Machine:
    """Runs steps in fresh processes of an interpreter, each in an empty folder of its own.

    Attributes:
        python: the interpreter.
        data: name of a bundled map, or file.
        folder: for everything that is written.
    """

    python: str
    data: str
    folder: Path

    def run(self, step: Step, cache: Path | None, library: bool | None = None) -> tuple[float, str]:
        """CPU time [s] of a process with its children, and what it has printed.

        Args:
            step: see `Step`.
            cache: folder of the compilation cache, None for an empty one or, of a library call,
                for none.
            library: whether JAX's own cache is switched on, which commands see to themselves; None
                for what the step is.

        Raises:
            FailedRunError: with the last line of what it said.
        """
        where = Path(tempfile.mkdtemp(dir=self.folder))
        argv = [self.python, *self.filled(step)]
        around = self._environment(cache, step[0] == "-c" if library is None else library)
        with (where / "out").open("w+") as out, (where / "err").open("w+") as err:
            process = subprocess.Popen(argv, cwd=where, env=around, stdout=out, stderr=err)
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            for stream in (out, err):
                stream.seek(0)
            said, wrong = out.read(), err.read().strip().splitlines()
        if process.returncode:
            last = wrong[-1] if wrong else "nothing on standard error"
            raise FailedRunError(f"exit code {process.returncode}: {last}")
        return used.ru_utime + used.ru_stime, said

    def in_one_process(self, steps: Sequence[Step], cache: Path | None) -> list[dict[str, Any]]:
        """CPU time [s] and number of programs compiled, `seconds` and `programs`, of each step."""
        plan = Path(tempfile.mkdtemp(dir=self.folder)) / "steps.json"
        plan.write_text(json.dumps([self.filled(step) for step in steps]), encoding="utf-8")
        self.run((str(STEPS), str(plan)), cache, library=steps[0][0] == "-c")
        return json.loads(plan.read_text(encoding="utf-8"))

    def filled(self, step: Step) -> list[str]:
        """The step with its places filled in, and its inputs made."""
        places = {
            "{inputs}": str(self.folder / "inputs"), "{root}": str(ROOT), "{data}": self.data,
            "{map}": self.data_file(),
        }  # fmt: skip
        filled = []
        for word in step:
            for name in re.findall(r"\{inputs\}/([\w.]+)", word):
                self._make(name)
            for place, text in places.items():
                word = word.replace(place, text)  # noqa: PLW2901
            filled.append(word)
        return filled

    def data_file(self) -> str:
        """The CSV file of the map, for programs that know no bundled ones."""
        bundled = ROOT / "fitting" / "data" / f"{self.data.lower()}.csv"
        return str(bundled if bundled.exists() else self.data)

    def _make(self, name: str) -> None:
        inputs = self.folder / "inputs"
        if (inputs / name).exists():
            return
        inputs.mkdir(exist_ok=True)
        if name == "fit.json":
            self.run(famjax("fit", "{data}", "--output", str(inputs)), None)
        else:
            kind = "maps" if name.endswith(".csv") else "photos"
            self.run((str(INPUTS), str(inputs), self.data, kind), None)

    def _environment(self, cache: Path | None, library: bool) -> dict[str, str]:
        """This tree first, and a cache of its own; a user's is not touched.

        What Python has compiled of this tree it keeps, as on a user's machine.
        """
        ours = {"FAMJAX_CACHE_DIR", "JAX_COMPILATION_CACHE_DIR", "PYTHONDONTWRITEBYTECODE"}
        given = {key: value for key, value in os.environ.items() if key not in ours}
        path = [str(ROOT), str(HERE), *filter(None, [given.get("PYTHONPATH")])]
        given["PYTHONPATH"] = os.pathsep.join(path)
        given["FAMJAX_CACHE_DIR"] = str(cache or tempfile.mkdtemp(dir=self.folder))
        if library and cache is not None:
            given["JAX_COMPILATION_CACHE_DIR"] = str(cache)
            # JAX leaves out what compiles in less than a second, which is nearly everything here.
            given["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
            given["JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES"] = "-1"
        return given


def measure(
    machine: Machine,
    rows: Sequence[Row | Check],
    *,
    repeat: int = 3,
    regimes: Sequence[str] = REGIMES,
    progress: Callable[[str], None] = lambda _: None,
) -> list[Line]:
    """Every row in every regime.

    Args:
        machine: where they run.
        rows: what runs.
        repeat: how often; the least CPU time counts. Long rows run once.
        regimes: some of `REGIMES`.
        progress: called with the name of the next row.

    Returns:
        One line for each row and regime, the import first.
    """
    machine.run(UNIT, None)  # reads the files once, so that the first figure does not
    units = [machine.run(UNIT, None)[0]]
    found: list[Line] = []
    for row in rows:
        progress(row.name)
        times = 1 if isinstance(row, Row) and row.long else repeat
        if isinstance(row, Check):
            found.append(_checked(machine, row, times))
        else:
            found += _measured(machine, row, times, regimes, units)
        units.append(machine.run(UNIT, None)[0])
    unit = min(units)
    lines = [
        dataclasses.replace(line, value=line.seconds / unit) if line.unit == "x" else line
        for line in found
    ]
    return [Line("import jax, equinox, optimistix", "", unit, "s", math.nan, unit), *lines]


def _measured(
    machine: Machine, row: Row, times: int, regimes: Sequence[str], units: list[float]
) -> list[Line]:
    """The lines of a row, without their multiples; a unit is measured before every repetition."""
    least: dict[str, float] = {}
    note = ""
    try:
        for _ in range(times):
            units.append(machine.run(UNIT, None)[0])
            seconds, said = _once(machine, row, regimes)
            note = _figure(said)
            for regime, value in seconds.items():
                least[regime] = min(least.get(regime, math.inf), value)
    except FailedRunError as error:
        wanted = [r for r in regimes if not math.isnan(row.limit(r))] or ["second"]
        return [
            Line(row.name, r, math.nan, "x", row.limit(r), math.nan, str(error)) for r in wanted
        ]
    return [
        Line(
            row.name,
            regime,
            math.nan,
            "x",
            row.limit(regime),
            least[regime],
            note if regime in {"cold", "second"} else "",
        )
        for regime in REGIMES
        if regime in least and regime in regimes
    ]


def _once(machine: Machine, row: Row, regimes: Sequence[str]) -> tuple[dict[str, float], str]:
    """CPU time [s] of each regime, from a cache that is empty at first, and what was printed."""
    cache = Path(tempfile.mkdtemp(dir=machine.folder))
    machine.filled(row.step)  # its inputs are made before
    first, said = machine.run(row.prime or row.step, cache)
    seconds = {} if row.prime else {"cold": first}
    if row.peer:
        return seconds, said
    if "second" in regimes:
        seconds["second"], said = machine.run(row.step, cache)
    last = [row.other] if row.other and "other" in regimes else []
    if last or "again" in regimes:
        _, *later = machine.in_one_process([row.step, row.step, *last], cache)
        seconds |= dict(zip(("again", "other"), (one["seconds"] for one in later), strict=False))
    return seconds, said


def _figure(said: str) -> str:
    """The RMSE among what a program has printed, or nothing."""
    found = re.search(r"(?:rmse_N|RMSE) +([0-9.]+)", said)
    return f"RMSE {float(found[1]):.4g} N" if found else ""


def _checked(machine: Machine, check: Check, times: int) -> Line:
    """The line of a check."""
    counts = not math.isnan(check.programs)
    unit, limit = ("programs", check.programs) if counts else ("s", check.seconds)
    try:
        ends = [
            machine.in_one_process([*check.before, check.step], None)[-1]
            for _ in range(1 if counts else times)
        ]
    except FailedRunError as error:
        return Line(check.name, "", math.nan, unit, limit, math.nan, str(error))
    seconds = min(end["seconds"] for end in ends)
    value = max(end["programs"] for end in ends) if counts else seconds
    return Line(check.name, "", value, unit, limit, seconds)


def chosen(patterns: Iterable[str], *, long: bool, peers: bool = True) -> list[Row | Check]:
    """Rows and checks by name.

    Args:
        patterns: as for file names, `famjax fit*`; none for all.
        long: those too that take minutes; one that is named in full is taken in any case.
        peers: programs of other authors too.

    Raises:
        ValueError: a pattern that fits nothing, with the names.
    """
    every: list[Row | Check] = [*ROWS, *CHECKS]
    patterns = list(patterns)
    for pattern in patterns:
        if not fnmatch.filter([row.name for row in every], pattern):
            names = "\n  ".join(row.name for row in every)
            raise ValueError(f"no row is called {pattern!r}; there are\n  {names}")
    return [
        row
        for row in every
        if row.name in patterns
        or (
            (not patterns or any(fnmatch.fnmatch(row.name, one) for one in patterns))
            and (long or isinstance(row, Check) or not row.long)
            and (peers or isinstance(row, Check) or not row.peer)
        )
    ]


def table(lines: Sequence[Line]) -> str:
    """The printed lines."""
    said = [f"{'row':44} {'regime':7} {'measured':>14} {'limit':>8} {'CPU s':>8}"]
    for line in lines:
        verdict = {True: "holds", False: "does NOT hold", None: ""}[line.holds]
        limit = "" if math.isnan(line.limit) else f"{line.limit:g}"
        value = f"{line.value:.3g} {line.unit}"
        said.append(
            f"{line.row:44} {line.regime:7} {value:>14} {limit:>8} {line.seconds:8.2f}  "
            f"{'  '.join(filter(None, [verdict, line.note]))}".rstrip()
        )
    return "\n".join(said)


def as_dicts(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """The lines for JSON; what there is none of is None."""
    rows = [{**dataclasses.asdict(line), "holds": line.holds} for line in lines]
    for row in rows:
        for key, value in row.items():
            if isinstance(value, float) and math.isnan(value):
                row[key] = None
    return rows


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table; exit code 1 if a limit is not kept."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--rows", nargs="+", default=[], metavar="PATTERN", help="'famjax fit*'")
    parser.add_argument("--regimes", nargs="+", choices=REGIMES, default=REGIMES)
    parser.add_argument("--repeat", type=int, default=3, help="the least of so many counts")
    parser.add_argument("--long", action="store_true", help="rows of minutes too, which run once")
    parser.add_argument("--python", default=sys.executable, help="the interpreter that is measured")
    parser.add_argument("--data", default=DATA, help="another force map, CSV or a bundled name")
    parser.add_argument("--json", type=Path, help="file for the lines")
    parser.add_argument("--list", action="store_true", help="print the names of the rows and end")
    given = parser.parse_args(arguments)
    if given.repeat < 1:
        parser.error(f"--repeat must be at least 1, got {given.repeat}")
    try:
        rows = chosen(given.rows, long=given.long or given.list, peers=given.data == DATA)
    except ValueError as error:
        parser.error(str(error))
    if given.list:
        print("\n".join(row.name for row in rows))
        return 0
    data = str(Path(given.data).resolve()) if Path(given.data).exists() else given.data
    with tempfile.TemporaryDirectory(prefix="first-answer-") as folder:
        lines = measure(
            Machine(given.python, data, Path(folder)),
            rows,
            repeat=given.repeat,
            regimes=given.regimes,
            progress=lambda name: print(f"  {name} ...", file=sys.stderr, flush=True),
        )
    print(table(lines))
    if given.json:
        given.json.write_text(json.dumps(as_dicts(lines), indent=1, allow_nan=False))
    return 1 if any(line.holds is False for line in lines) else 0


if __name__ == "__main__":
    sys.exit(main())

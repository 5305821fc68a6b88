"""Every acceptance figure as one line: what holds, and what does not.

    python benchmarks/promises.py [--only PATTERN ...] [--data [NAME=]MAP ...] [--quick | --long]
                                  [--list] [--json FILE] [--reference FILE]

A promise is measured anew each time it is printed; its limit is the issue's. `--data` takes other
force maps of the same form, CSV files or folders of them. `--data MAP.csv` measures what is asked of
any map (certificates, optimality, time), and prints errors whose limit belongs to another muscle
without a verdict. `--data DMSP-20-300=MAP.csv` puts a map in the place of one, limits and all;
`--data 'a series=FOLDER'` gives the specimens of a series.
`--reference` holds every figure to 1e-6 of an earlier run's `--json`.
"""

import argparse
import dataclasses
import fnmatch
import json
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import jax
from first_answer_inputs import load
from promise import VERDICTS, Case, Outcome, Promise, judge, shown
from promises_chain import CHAIN
from promises_choice import CHOICE
from promises_default import DEFAULT
from promises_export import EXPORT
from promises_first_answer import FIRST_ANSWER
from promises_fits import FITS
from promises_kernels import KERNELS
from promises_photographs import PHOTOGRAPHS
from promises_posterior import POSTERIOR
from promises_rig import RIG
from promises_scaling import SCALING
from promises_tables import TABLES
from promises_verdict import VERDICT

import fitting

WHOLE: tuple[Promise, ...] = (
    shown(12, "the README's tests", "the README's test command on two quiet cores",
          "wall time [min]", 5.0),
    shown(12, "continuous integration", ".ci/run on two quiet cores", "wall time [min]", 14.0),
    shown(12, "figures of issues 2 to 4 as before", "python benchmarks/promises.py --reference FILE",
          "figures changed by more than 1e-6", 0.0),
    shown(12, "what cannot be used is refused in a sentence, before any work",
          "pytest tests/famjax/app tests/fitting/cli tests/fitting/data", "failed tests", 0.0),
    shown(12, "a modeller's own laws, terms and models", "pytest", "failed tests", 0.0),
)  # fmt: skip
"""What only the whole test run shows."""

PROMISES: tuple[Promise, ...] = tuple(
    sorted(
        (
            *FITS,
            *CHOICE,
            *DEFAULT,
            *TABLES,
            *KERNELS,
            *PHOTOGRAPHS,
            *POSTERIOR,
            *RIG,
            *SCALING,
            *FIRST_ANSWER,
            *VERDICT,
            *CHAIN,
            *EXPORT,
            *WHOLE,
        ),
        key=lambda one: one.issue,
    )
)
COSTS = {"quick": {"quick"}, "usual": {"quick", "minutes"}, "long": {"quick", "minutes", "long"}}
AS_BEFORE = 1e-6
"""Relative change of a figure from an earlier run that counts as none."""


def chosen(patterns: Sequence[str], cost: str) -> list[Promise]:
    """Promises by name.

    Args:
        patterns: as for file names, or part of a name, or `issue 4`; none for all.
        cost: key of `COSTS`.

    Raises:
        ValueError: a pattern that fits nothing.
    """
    for pattern in patterns:
        if not any(_fits(one, pattern) for one in PROMISES):
            raise ValueError(f"no promise fits {pattern!r}; --list prints all of them")
    return [
        one
        for one in PROMISES
        if one.cost in COSTS[cost]
        and (not patterns or any(_fits(one, pattern) for pattern in patterns))
    ]


def _fits(promise: Promise, pattern: str) -> bool:
    return fnmatch.fnmatch(f"issue {promise.issue}: {promise.name}", f"*{pattern}*")


def given_data(words: Iterable[str]) -> tuple[dict[str, str], list[str]]:
    """Maps in the place of named ones, and maps that stand for themselves.

    Args:
        words: of `--data`, `[NAME=]PATH`.

    Raises:
        ValueError: a path that is not there, or a folder without a CSV file.
    """
    places: dict[str, str] = {}
    others: list[str] = []
    for word in words:
        name, equals, path = word.rpartition("=")
        if not equals and path in fitting.bundled_names():
            others.append(path)
            continue
        if not Path(path).exists():
            raise ValueError(f"--data must be a CSV file or a folder of them; there is no {path}")
        files = sorted(map(str, Path(path).glob("*.csv"))) if Path(path).is_dir() else [path]
        if not files:
            raise ValueError(f"the folder {path} has no CSV file")
        if equals:
            places[name] = path if Path(path).is_dir() else files[0]
        else:
            others += files
    return places, others


def cases(
    promises: Sequence[Promise], places: dict[str, str], others: Sequence[str], shared: Case
) -> Iterator[tuple[Promise, Case, bool]]:
    """Each promise with what it is measured on, and whether its limit is that of these data.

    Args:
        promises: chosen ones.
        places: maps in the place of named ones.
        others: maps that stand for themselves: promises of maps are measured on each of them, once.
        shared: interpreter, repetitions, and what is known already.
    """
    loaded: dict[str, Case] = {}

    def case(name: str, source: str) -> Case:
        if source not in loaded:
            files = sorted(map(str, Path(source).glob("*.csv"))) if Path(source).is_dir() else []
            maps = tuple(load(one) for one in files or [source])
            loaded[source] = dataclasses.replace(
                shared, data=maps[0] if len(maps) == 1 else None, name=name, maps=maps
            )
        return loaded[source]

    seen: set[tuple[str, str]] = set()
    bundled = fitting.bundled_names()
    for promise in promises:
        if promise.data in places:
            yield (
                promise,
                case(f"{promise.data}={places[promise.data]}", places[promise.data]),
                True,
            )
        elif others and promise.data in bundled:
            for other in others:
                if (promise.name, other) not in seen:
                    seen.add((promise.name, other))
                    yield promise, case(other, other), promise.data == other
        elif promise.data in bundled:
            yield promise, case(promise.data, promise.data), True
        else:
            yield promise, dataclasses.replace(shared, name=promise.data), True


def line(outcome: Outcome) -> str:
    """An outcome as one line."""
    one = outcome.promise
    asked = f"{one.direction} {one.limit:g}"
    found = "" if outcome.value != outcome.value else f"{outcome.value:.6g}"
    seed = "" if one.seed is None else f"seed {one.seed}"
    parts = [one.statistic, outcome.data, one.filter, seed, one.command, outcome.why]
    head = f"{outcome.verdict:13} issue {one.issue:<3} {one.name}: {found} ({asked})"
    return f"{head} | {' | '.join(filter(None, parts))}"


def compared(outcomes: Sequence[Outcome], reference: Sequence[dict[str, Any]]) -> list[str]:
    """Figures that are no longer as they were, one line each.

    Args:
        outcomes: of this run.
        reference: rows of an earlier run's `--json`.
    """
    before = {(row["issue"], row["name"], row["data"]): row["value"] for row in reference}
    changes = []
    for outcome in outcomes:
        one = outcome.promise
        was = before.get((one.issue, one.name, outcome.data))
        if one.figure and was and not abs(outcome.value / was - 1) <= AS_BEFORE:
            changes.append(f"changed       issue {one.issue:<3} {one.name}: {outcome.value:.9g}, "
                        f"was {was:.9g} | {outcome.data}")  # fmt: skip
    return changes


def main(arguments: Sequence[str] | None = None) -> int:
    """Print one line for each promise; exit code 1 if one does not hold."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument(
        "--only", nargs="+", default=[], metavar="PATTERN", help="'issue 4', 'RMSE*A1'"
    )
    parser.add_argument(
        "--data", nargs="+", default=[], metavar="[NAME=]MAP", help="other force maps"
    )
    cost = parser.add_mutually_exclusive_group()
    cost.add_argument("--quick", action="store_const", dest="cost", const="quick",
                      help="what takes seconds once the fits are made")  # fmt: skip
    cost.add_argument("--long", action="store_const", dest="cost", const="long",
                      help="also what takes many minutes")  # fmt: skip
    parser.add_argument("--repeat", type=int, default=3, help="of times; the least counts")
    parser.add_argument("--python", default=sys.executable, help="interpreter of whole processes")
    parser.add_argument("--other-python", help="one with the newest of every dependency")
    parser.add_argument("--list", action="store_true", help="print the promises and end")
    parser.add_argument("--json", type=Path, help="file for the outcomes")
    parser.add_argument("--reference", type=Path, help="an earlier run's --json")
    given = parser.parse_args(arguments)
    try:
        promises = chosen(given.only, given.cost or ("long" if given.list else "usual"))
        places, others = given_data(given.data)
        before = json.loads(given.reference.read_text()) if given.reference else []
    except (ValueError, OSError) as error:
        parser.error(str(error))
    if given.list:
        for one in promises:
            print(line(Outcome(one, one.data, float("nan"), one.cost)))
        return 0
    jax.config.update("jax_enable_x64", True)
    shared = Case(python=given.python, other_python=given.other_python, repeat=given.repeat)
    outcomes = []
    for promise, case, own_data in cases(promises, places, others, shared):
        outcomes.append(judge(promise, case, own_data=own_data))
        print(line(outcomes[-1]), flush=True)
    changed = compared(outcomes, before)
    print(*changed, sep="\n", end="\n" * bool(changed))
    counts = [(sum(one.verdict == verdict for one in outcomes), verdict) for verdict in VERDICTS]
    print(", ".join(f"{number} {verdict}" for number, verdict in counts))
    if given.json:
        rows = [one.as_dict() for one in outcomes]
        given.json.write_text(json.dumps(rows, indent=1, allow_nan=False), encoding="utf-8")
    return 1 if changed or any(one.verdict == "does NOT hold" for one in outcomes) else 0


if __name__ == "__main__":
    sys.exit(main())

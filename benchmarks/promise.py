"""What a promise is: a figure, how it is measured, on what, and its limit."""

import dataclasses
import math
import sys
from collections.abc import Callable, Hashable
from typing import Any, Literal, TypeVar

import fitting

Found = TypeVar("Found")
Cost = Literal["quick", "minutes", "long"]
Direction = Literal["at most", "at least"]


@dataclasses.dataclass
class Case:
    """What a promise is measured on.

    Attributes:
        data: the force map, None for promises that need none.
        name: of the data.
        python: the interpreter whose processes are measured.
        other_python: one with the newest of every dependency, None where there is none.
        repeat: repetitions of a time, of which the least counts.
        known: what has been computed, shared by all cases of a run.
        maps: of the specimens of a series.
    """

    data: fitting.ForceData | None = None
    name: str = ""
    python: str = sys.executable
    other_python: str | None = None
    repeat: int = 3
    known: dict[Hashable, Any] = dataclasses.field(default_factory=dict)
    maps: tuple[fitting.ForceData, ...] = ()

    def once(self, key: Hashable, compute: Callable[[], Found]) -> Found:
        """What `compute` returns, computed once in a run for this data and key."""
        whole = (self.name, key)
        if whole not in self.known:
            self.known[whole] = compute()
        return self.known[whole]

    @property
    def map(self) -> fitting.ForceData:
        """The force map of a promise that needs one.

        Raises:
            CannotRunError: there is none.
        """
        if self.data is None:
            raise CannotRunError(f"needs a map that is not bundled: --data '{self.name}=MAP.csv'")
        return self.data

    @property
    def series(self) -> tuple[fitting.ForceData, ...]:
        """The force maps of a promise that needs those of a series.

        Raises:
            CannotRunError: there are none.
        """
        if not self.maps:
            raise CannotRunError(f"needs a folder of maps: --data '{self.name}=FOLDER'")
        return self.maps


class CannotRunError(RuntimeError):
    """What a promise needs is not here; the text says what."""


@dataclasses.dataclass(frozen=True)
class Promise:
    """One acceptance figure with its limit.

    Attributes:
        issue: its number.
        name: by which `--only` chooses it.
        measure: returns the figure, None where it is shown by `command` alone.
        command: what a user runs to see it, or the public call.
        data: name of a bundled map, which `--data` replaces; otherwise what it is computed from.
        filter: which part of the data.
        statistic: the figure, with its unit.
        limit: of the issue.
        direction: "at most" or "at least".
        seed: of everything random, None where nothing is.
        cost: "quick" takes seconds once the fits it shares with others are there.
        of_its_data: the limit belongs to this data set, so that none is known for another.
        figure: the same on every machine to 1e-6; a time or a residual is not.
    """

    issue: int
    name: str
    measure: Callable[[Case], float] | None
    command: str
    data: str
    filter: str
    statistic: str
    limit: float
    direction: Direction = "at most"
    seed: int | None = None
    cost: Cost = "minutes"
    of_its_data: bool = False
    figure: bool = False

    def kept(self, value: float) -> bool:
        """Whether a value keeps the limit; nan does not."""
        return value <= self.limit if self.direction == "at most" else value >= self.limit


def shown(issue: int, name: str, command: str, statistic: str, limit: float) -> Promise:
    """A row that another command shows, and that is listed without being measured again."""
    return Promise(issue, name, None, command, "none", "-", statistic, limit)


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What came of a promise.

    Attributes:
        promise: which.
        data: what it was measured on.
        value: nan where it was not.
        verdict: see `VERDICTS`.
        why: it was not measured.
    """

    promise: Promise
    data: str
    value: float
    verdict: str
    why: str = ""

    def as_dict(self) -> dict[str, Any]:
        """For JSON; what there is none of is None."""
        kept = ("issue", "name", "command", "filter", "statistic", "limit", "direction", "seed",
                "figure")  # fmt: skip
        return {name: getattr(self.promise, name) for name in kept} | {
            "data": self.data,
            "value": self.value if math.isfinite(self.value) else None,
            "verdict": self.verdict,
            "why": self.why,
        }


VERDICTS = ("holds", "does NOT hold", "measured", "not run")
"""`measured`: there is a figure, and no limit for these data."""

_WRONG = (ArithmeticError, AttributeError, ImportError, LookupError, OSError, RuntimeError,
          TypeError, ValueError, AssertionError)  # fmt: skip


def judge(promise: Promise, case: Case, *, own_data: bool) -> Outcome:
    """Measure a promise and hold it to its limit.

    Args:
        promise: the promise.
        case: what it is measured on.
        own_data: these are the data that the limit was set for, or stand in for them.

    Returns:
        The outcome; a promise whose measurement fails does not hold.
    """
    if promise.measure is None:
        return Outcome(promise, case.name, math.nan, "not run", f"see {promise.command}")
    try:
        value = float(promise.measure(case))
    except CannotRunError as reason:
        return Outcome(promise, case.name, math.nan, "not run", str(reason))
    except _WRONG as error:
        reason = f"{type(error).__name__}: {error}".partition("\n")[0]
        return Outcome(promise, case.name, math.nan, "does NOT hold", reason)
    if promise.of_its_data and not own_data:
        return Outcome(
            promise, case.name, value, "measured", f"the limit is that of {promise.data}"
        )
    return Outcome(promise, case.name, value, "holds" if promise.kept(value) else "does NOT hold")

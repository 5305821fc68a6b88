"""Plans: generators of plain tuples, so that a test can be listed, timed, stopped and resumed.

| step | does |
|---|---|
| ("block", k, pressure) | begins block k, which is resumed as a whole |
| ("set", pressure) | sets the pressure [Pa] |
| ("wait", seconds) | waits |
| ("strokes", k, n, seconds, stroke, rate, every) | lasts while the test machine makes n cycles of block \
k: stroke [m], rate [m/s]; the camera is triggered every so many seconds, 0 for never |
| ("trigger", name) | triggers the camera |
| ("note", kind, fields) | writes a note |
| ("done", k) | block k is complete |
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Annotated, Any, Protocol

from msgspec import Meta

from famjax.boundary.toml_file import NotNegative, Positive, check_fields

from ..errors import RigError

Step = tuple[Any, ...]


class Plan(Protocol):
    """Anything that yields steps from a block on."""

    def steps(self, first_block: int = 0) -> Iterator[Step]:
        """The steps from block `first_block` on, the same ones every time."""
        ...


@dataclasses.dataclass(frozen=True)
class Isobaric:
    """Constant pressures, at each of them strokes of the test machine, neglecting its ramps.

    At each pressure: set, settle, then `cycles` strokes there and back at `rate`.

    Attributes:
        pressures: set pressures [Pa gauge], shape (n,), in their order, each >= 0.
        cycles: strokes there and back at each pressure, >= 1.
        stroke: of the test machine [m], > 0.
        rate: of the crosshead [m/s], > 0.
        settle: time at the pressure before the first stroke [s], >= 0.
        photograph_every: time between triggers of the camera during strokes [s]; 0 for none.
    """

    pressures: Annotated[
        tuple[NotNegative, ...],
        Meta(min_length=1, description="one pressure at least, each a number >= 0 and finite"),
    ]
    cycles: Annotated[int, Meta(ge=1, description="a whole number >= 1")]
    stroke: Positive
    rate: Positive
    settle: NotNegative = 10.0
    photograph_every: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self, RigError)

    def steps(self, first_block: int = 0) -> Iterator[Step]:
        """The steps from the block of pressure `first_block` on."""
        if not 0 <= first_block <= len(self.pressures):
            raise RigError(
                f"the plan has blocks 0 to {len(self.pressures) - 1}, it cannot start at {first_block}"
            )
        seconds = self.cycles * 2 * self.stroke / self.rate
        strokes = self.cycles, seconds, self.stroke, self.rate, self.photograph_every
        for block, pressure in list(enumerate(self.pressures))[first_block:]:
            yield ("block", block, pressure)
            yield ("set", pressure)
            yield ("wait", self.settle)
            yield ("strokes", block, *strokes)
            yield ("done", block)


def duration(plan: Plan, first_block: int = 0) -> float:
    """How long a plan lasts [s], neglecting the device's answers.

    >>> plan = Isobaric((1e5, 2e5), cycles=3, stroke=0.05, rate=0.001, settle=5.0)
    >>> round(duration(plan), 6)
    610.0
    """
    return math.fsum(seconds_of(step) for step in plan.steps(first_block))


def seconds_of(step: Step) -> float:
    """How long one step lasts [s]."""
    field = {"wait": 1, "strokes": 3}.get(step[0])
    return float(step[field]) if field else 0.0


def highest_pressure(plan: Plan, first_block: int = 0) -> float:
    """The highest set pressure [Pa] of a plan, 0 where it sets none."""
    return max((step[1] for step in plan.steps(first_block) if step[0] == "set"), default=0.0)


def next_block(notes: Iterable[Mapping[str, Any]]) -> int:
    """The block with which a plan resumes, from the notes of its journal.

    >>> next_block([{"note": "done", "block": 0}, {"note": "block", "block": 1}])
    1
    """
    passed = (note["block"] + 1 for note in notes if note["note"] in {"done", "skipped"})
    return max(passed, default=0)

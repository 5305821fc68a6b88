"""What a test does: plans as generators of plain tuples, and the file PLAN.toml.

A plan can be listed, timed, stopped and resumed.

| step | does |
|---|---|
| ("block", k, pressure) | begins block k, which is resumed as a whole |
| ("set", pressure) | sets the pressure [Pa] |
| ("wait", seconds) | waits |
| ("strokes", k, n, seconds, stroke, rate, every) | lasts while the test machine makes n cycles of block \
k: stroke [m], rate [m/s]; the camera is triggered every so many seconds, 0 for never |
| ("done", k) | block k is complete |
"""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

from msgspec import Meta

from famjax.boundary.toml_file import (
    Form,
    NotNegative,
    Positive,
    Text,
    check_fields,
    from_entries,
    read_toml,
)

from .control import JUMP_LIMIT, Control, Guards, RigSettings
from .errors import RigError

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


def next_block(notes: Iterable[Mapping[str, Any]]) -> int:
    """The block with which a plan resumes, from the notes of its journal.

    >>> next_block([{"note": "done", "block": 0}, {"note": "block", "block": 1}])
    1
    """
    passed = (note["block"] + 1 for note in notes if note["note"] in {"done", "skipped"})
    return max(passed, default=0)


@dataclasses.dataclass(frozen=True)
class PlanFile:
    """A test as its file describes it.

    Attributes:
        plan: what to do.
        circuit: "air" or "water".
        pressure_limit: [Pa gauge]; there is no default.
        control: gains.
        calibration: path of the calibration, absolute; None where the file names none.
        jump_limit: change of the pressure within 10 ms that trips [Pa].
        guards: when the device rejects its reading as implausible.
    """

    plan: Isobaric
    circuit: str
    pressure_limit: float
    control: Control
    calibration: Path | None = None
    jump_limit: float = JUMP_LIMIT
    guards: Guards = dataclasses.field(default_factory=Guards)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pressure_limit) and self.pressure_limit >= 0):
            raise RigError(
                f"pressure_limit must be a pressure >= 0 and finite, got {self.pressure_limit} Pa; "
                "give the muscle's or the circuit's, whichever is lower"
            )

    @property
    def settings(self) -> RigSettings:
        """What the device controls and trips with."""
        return RigSettings(self.pressure_limit, self.control, self.jump_limit, self.guards)


def read_plan(path: str | Path) -> PlanFile:
    """The test in a TOML file.

    [plan]
    pressures_psi = [20, 40, 60]
    cycles = 3
    stroke_in = 2.0
    rate_in_per_s = 0.04
    settle_s = 10

    [rig]
    circuit = "air"
    pressure_limit_psi = 110
    proportional_counts_per_psi = 4
    integral_counts_per_psi_s = 2
    calibration = "calibration.toml"

    [rig] may have integral_limits_counts = [-128, 128], and jump_limit_psi = 15: a change within
    10 ms that trips; and the guards against an implausible reading, see `Guards`:
    reading_floor_counts, reading_ceiling_counts = 963, still_s = 0.7, frozen_output_counts = 4,
    frozen_s = 0.75, stall_s = 3.

    Raises:
        RigError: what is wrong with the file; a missing pressure limit above all.
    """
    content = read_toml(path, "plan", RigError)
    if content.keys() != {"plan", "rig"} or not all(isinstance(t, dict) for t in content.values()):
        raise RigError(f"{path}: a plan has the tables [plan] and [rig], got {sorted(content)}")
    of_plan, of_rig = (f"{path}: [{table}]: " for table in ("plan", "rig"))
    plan = from_entries(Isobaric, content["plan"], _PLAN_FORM, where=of_plan, error=RigError)
    rig = from_entries(_RigTable, content["rig"], _RIG_FORM, where=of_rig, error=RigError)
    gains = Control.per_psi(rig.proportional_counts_per_psi, rig.integral_counts_per_psi_s)
    return PlanFile(
        plan,
        rig.circuit,
        rig.pressure_limit,
        dataclasses.replace(gains, integral_limits=rig.integral_limits_counts),
        Path(path).parent.absolute() / rig.calibration if rig.calibration else None,
        rig.jump_limit,
        Guards(**{field.name: getattr(rig, field.name) for field in dataclasses.fields(Guards)}),
    )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _RigTable(Guards):
    """The table [rig]."""

    circuit: Literal["air", "water"]
    pressure_limit: NotNegative
    proportional_counts_per_psi: NotNegative
    integral_counts_per_psi_s: NotNegative
    integral_limits_counts: Annotated[
        tuple[Annotated[int, Meta(ge=-255, le=0)], Annotated[int, Meta(ge=0, le=255)]],
        Meta(description="[-255..0, 0..255]"),
    ] = Control.integral_limits
    calibration: Text | None = None
    jump_limit: NotNegative = JUMP_LIMIT
    still: Positive = Guards.still  # checked once it is in seconds
    frozen: Positive = Guards.frozen
    stall: Positive = Guards.stall


_PLAN_FORM = Form(
    {"pressures": "pressure", "stroke": "length", "rate": "rate"}
    | dict.fromkeys(("settle", "photograph_every"), "time")
)
_RIG_FORM = Form(
    kinds={
        **dict.fromkeys(("pressure_limit", "jump_limit"), "pressure"),
        **dict.fromkeys(("still", "frozen", "stall"), "time"),
    },
    keys={
        "floor": "reading_floor_counts",
        "ceiling": "reading_ceiling_counts",
        "frozen_output": "frozen_output_counts",
    },
)

"""Test plans: strokes of a test machine at constant pressures, and the file PLAN.toml."""

import dataclasses
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

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

from .control import Control, RigSettings
from .errors import RigError


@dataclasses.dataclass(frozen=True)
class Isobaric:
    """Strokes of the test machine at constant pressures, neglecting the machine's acceleration.

    For each pressure, the rig sets the pressure and lets it settle; the test machine then makes `cycles`
    strokes there and back at `rate`.

    Attributes:
        pressures: set pressures [Pa gauge] in order, shape (n,), each >= 0.
        cycles: strokes there and back at each pressure, >= 1.
        stroke: stroke of the test machine [m], > 0.
        rate: crosshead speed [m/s], > 0.
        settle: settling time before the first stroke [s], >= 0.
        rise: part of the settling time [s] during which the set pressure ramps linearly; 0 for a step.
    """

    pressures: Annotated[
        tuple[NotNegative, ...],
        Meta(min_length=1, description="at least one pressure, each a finite number >= 0"),
    ]
    cycles: Annotated[int, Meta(ge=1, description="a whole number >= 1")]
    stroke: Positive
    rate: Positive
    settle: NotNegative = 10.0
    rise: NotNegative = 0.0

    def __post_init__(self) -> None:
        check_fields(self, RigError)
        if self.rise > self.settle:
            raise RigError(f"rise_s must not exceed settle_s ({self.settle:g}), got {self.rise:g}")

    @property
    def stroke_seconds(self) -> float:
        """Duration of the strokes at one pressure [s]."""
        return self.cycles * 2 * self.stroke / self.rate

    def duration(self, first_block: int = 0) -> float:
        """Return the duration of the plan from a given block onwards [s], neglecting response times.

        >>> plan = Isobaric((1e5, 2e5), cycles=3, stroke=0.05, rate=0.001, settle=5.0)
        >>> round(plan.duration(), 6)
        610.0
        """
        return len(self.pressures[first_block:]) * (self.settle + self.stroke_seconds)


@dataclasses.dataclass(frozen=True)
class PlanFile:
    """Contents of a plan file.

    Attributes:
        plan: strokes and pressures.
        circuit: "air" or "water".
        pressure_limit: pressure limit [Pa gauge], required.
        control: controller gains.
        calibration: absolute path of the calibration file, if any.
        unit: pressure unit of the file, used in messages.
        limits: further fields of `RigSettings`.
    """

    plan: Isobaric
    circuit: str
    pressure_limit: float
    control: Control
    calibration: Path | None = None
    unit: str = "kPa"
    limits: Mapping[str, Any] = dataclasses.field(default_factory=dict)

    def __post_init__(self) -> None:
        if not math.isfinite(self.pressure_limit):
            raise RigError(f"the pressure limit must be finite, got {self.pressure_limit}")

    @property
    def settings(self) -> RigSettings:
        """Control and trip settings of the device."""
        return RigSettings(self.pressure_limit, self.control, unit=self.unit, **self.limits)


def read_plan(path: str | Path) -> PlanFile:
    """Read a plan from a TOML file.

    [plan]
    pressures_psi = [20, 40, 60]
    cycles = 3
    stroke_in = 2.0
    rate_in_per_s = 0.04
    settle_s = 10
    rise_s = 1

    [rig]
    circuit = "air"
    pressure_limit_psi = 110
    proportional_counts_per_psi = 4
    integral_counts_per_psi_s = 2
    calibration = "calibration.toml"

    [rig] may also contain integral_limits_counts = [-128, 128], jump_limit_psi = 15,
    frozen_output_counts = 4, frozen_s = 0.75 and stall_s = 3, see `RigSettings`.

    Raises:
        RigError: the file is invalid, or has no pressure limit.
    """
    content = read_toml(path, "plan", RigError)
    _refuse_decimal_commas(path)
    if content.keys() != {"plan", "rig"} or not all(isinstance(t, dict) for t in content.values()):
        raise RigError(
            f"{path}: a plan must have the tables [plan] and [rig], got {sorted(content)}"
        )
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
        next(key for key in content["plan"] if key.startswith("pressures_"))[len("pressures_") :],
        {name: getattr(rig, name) for name in ("jump_limit", "frozen_output", "frozen", "stall")},
    )


_LIST = re.compile(r"^\s*(\w+)\s*=\s*\[([^\[\]#]*)\]", re.MULTILINE).findall


def _refuse_decimal_commas(path: str | Path) -> None:
    """Reject a list such as [20,5, 40,5], which TOML reads as four numbers; two may be intended."""
    for name, items in _LIST(Path(path).read_text(encoding="utf-8")):
        words = items.split(",")
        tight = [bool(re.match(r"\d", word)) for word in words[1:]]
        short = len(words) % 2 == 0 and all(
            re.fullmatch(r"\d", word.strip()) for word in words[1::2]
        )
        if any(tight) and (not all(tight) or short):
            raise RigError(
                f"{path}: {name} = [{items.strip()}] seems to contain decimal commas: use decimal points, "
                "as in 20.5, and a space after each comma"
            )


@dataclasses.dataclass(frozen=True, kw_only=True)
class _RigTable:
    """The [rig] table of a plan file."""

    circuit: Literal["air", "water"]
    pressure_limit: NotNegative
    proportional_counts_per_psi: NotNegative
    integral_counts_per_psi_s: NotNegative
    integral_limits_counts: Annotated[
        tuple[Annotated[int, Meta(ge=-255, le=0)], Annotated[int, Meta(ge=0, le=255)]],
        Meta(description="[-255..0, 0..255]"),
    ] = Control.integral_limits
    calibration: Text | None = None
    jump_limit: NotNegative = RigSettings.jump_limit
    frozen_output: int = RigSettings.frozen_output
    frozen: Positive = RigSettings.frozen
    stall: Positive = RigSettings.stall


_PLAN_FORM = Form(
    {"pressures": "pressure", "stroke": "length", "rate": "rate"}
    | dict.fromkeys(("settle", "rise"), "time")
)
_RIG_FORM = Form(
    {"pressure_limit": "pressure", "jump_limit": "pressure", "frozen": "time", "stall": "time"},
    {"frozen_output": "frozen_output_counts"},
)

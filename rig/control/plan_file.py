"""PLAN.toml: what to do, on which circuit, under which limit; units in every key."""

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from famjax.boundary.toml_file import Form, NotNegative, Positive, Text, from_entries, read_toml

from ..errors import RigError
from .limits_and_gains import JUMP_LIMIT, Control, Guards, RigSettings
from .plan import Isobaric


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
    plan = isobaric_from_dict(content["plan"], where=f"{path}: [plan]: ")
    rig = from_entries(
        _RigTable, content["rig"], _RIG_FORM, where=f"{path}: [rig]: ", error=RigError
    )
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


def isobaric_from_dict(entries: Mapping[str, Any], where: str = "") -> Isobaric:
    """An isobaric plan from entries whose keys end with their units, and `cycles`.

    Args:
        entries: as in the table [plan].
        where: the place of the entries, for messages.

    Raises:
        RigError: a key is unknown, has no or an unknown unit, or is missing, or a value cannot be.

    >>> isobaric_from_dict(
    ...     {"pressures_bar": [1, 2], "cycles": 3, "stroke_mm": 50, "rate_mm_per_s": 1}
    ... ).pressures
    (100000.0, 200000.0)
    """
    return from_entries(Isobaric, entries, _PLAN_FORM, where=where, error=RigError)


_PLAN_FORM = Form(
    {"pressures": "pressure", "stroke": "length", "rate": "rate"}
    | dict.fromkeys(("settle", "photograph_every"), "time")
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


_TIMES = dict.fromkeys(("still", "frozen", "stall"), "time")
_COUNTS = ("floor", "reading_floor"), ("ceiling", "reading_ceiling"), ("frozen_output",) * 2
_RIG_FORM = Form(
    kinds={"pressure_limit": "pressure", "jump_limit": "pressure", **_TIMES},
    keys={name: f"{key}_counts" for name, key in _COUNTS},
)

"""PLAN.toml: what to do, on which circuit, under which limit; units in every key."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

from famjax.boundary.units import to_si, unit_of_key

from ..errors import RigError
from .plan import Isobaric, isobaric_from_dict
from .settings import JUMP_LIMIT, Control

PRECONDITIONS: dict[str, tuple[str, ...]] = {
    "air": (
        "The supply regulator is set no higher than the muscle and the hoses bear.",
        "A normally open dump valve vents the muscle when it loses its supply.",
        "The proportional valve exhausts at 0 % output.",
        "Nobody stands in line with the muscle's ends.",
    ),
    "water": (
        "A mechanical relief valve is fitted: software cannot stop the peak when the needle valve "
        "blocks (239 psi and more were computed in a circuit that trips within 6 ms).",
        "A normally open dump valve leads to the tank.",
        "The pump stops at 0 % output, and its supply has a switch within reach.",
        "The circuit is bled: trapped air stores energy.",
    ),
}
"""What must hold before a circuit is pressurised, and no software can see."""

_PLAN_TABLES = {"plan", "rig"}


@dataclasses.dataclass(frozen=True)
class PlanFile:
    """A test as it stands in a file.

    Attributes:
        plan: what to do.
        circuit: "air" or "water".
        pressure_limit: [Pa gauge]; there is no default.
        control: gains.
        calibration: path of the calibration, absolute; None where the file names none.
        jump_limit: change of the pressure within 10 ms that trips [Pa].
    """

    plan: Isobaric
    circuit: str
    pressure_limit: float
    control: Control
    calibration: Path | None = None
    jump_limit: float = JUMP_LIMIT


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
    10 ms that trips.

    Raises:
        RigError: what is wrong with the file; a missing pressure limit above all.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RigError(f"cannot read the plan {path}: {error}") from None
    try:
        return _plan_file(content, path.parent.absolute())
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def _plan_file(content: dict[str, Any], folder: Path) -> PlanFile:
    if content.keys() != _PLAN_TABLES or not all(isinstance(t, dict) for t in content.values()):
        raise RigError(f"a plan has the tables [plan] and [rig], got {sorted(content)}")
    fields: dict[str, Any] = {}
    gains: dict[str, Any] = {}
    for key, value in content["rig"].items():
        if key in {"proportional_counts_per_psi", "integral_counts_per_psi_s"}:
            gains[key.split("_")[0]] = _number(key, value)
        elif key == "integral_limits_counts":
            gains[key.removesuffix("_counts")] = _limits(value)
        elif unit := unit_of_key(key, "pressure_limit", "pressure"):
            fields["pressure_limit"] = to_si(_number(key, value), unit, "pressure")
        elif unit := unit_of_key(key, "jump_limit", "pressure"):
            fields["jump_limit"] = to_si(_number(key, value), unit, "pressure")
        elif key == "circuit":
            fields[key] = _circuit(value)
        elif key == "calibration":
            fields[key] = folder / str(value)
        else:
            raise RigError(f"unknown entry {key!r} of [rig]; known are {_KNOWN}")
    if "pressure_limit" not in fields:
        raise RigError("[rig] must have a pressure limit, as in pressure_limit_psi = 110")
    missing = [k for k in ("circuit",) if k not in fields] + [
        f"{k}_counts_per_psi{s}"
        for k, s in (("proportional", ""), ("integral", "_s"))
        if k not in gains
    ]
    if missing:
        raise RigError(f"[rig] must have {', '.join(missing)}")
    limits = gains.get("integral_limits", Control.integral_limits)
    control = dataclasses.replace(
        Control.per_psi(gains["proportional"], gains["integral"]), integral_limits=limits
    )
    return PlanFile(plan=isobaric_from_dict(content["plan"]), control=control, **fields)


_KNOWN = (
    "circuit, pressure_limit_<unit>, jump_limit_<unit>, proportional_counts_per_psi, "
    "integral_counts_per_psi_s, integral_limits_counts, calibration"
)


def _number(key: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not value >= 0:
        raise RigError(f"{key} must be a number >= 0, got {value!r}")
    return float(value)


def _limits(value: Any) -> tuple[int, int]:
    match value:
        case [int(low), int(high)] if -255 <= low <= 0 <= high <= 255:
            return low, high
    raise RigError(f"integral_limits_counts must be [-255..0, 0..255], got {value!r}")


def _circuit(value: Any) -> str:
    if value not in PRECONDITIONS:
        raise RigError(f"circuit must be {' or '.join(PRECONDITIONS)}, got {value!r}")
    return str(value)

"""A rig's calibration as one TOML file: both sensors and the feed-forward, units in every key."""

import dataclasses
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import RigError
from .feed_forward import FeedForward
from .sensor import Sensor

_SENSOR_KEYS = {
    "gain": "gain_{unit}_per_count",
    "zero": "zero_counts",
    "gain_std": "gain_std_{unit}_per_count",
    "zero_std": "zero_std_counts",
    "correlation": "correlation",
    "scatter": "scatter_{unit}",
}
_FEED_FORWARD_KEYS = {
    "coefficients": "coefficients_counts",
    "scale": "scale_Pa",
    "pressure_range": "pressure_range_Pa",
    "covariance": "covariance_counts2",
    "scatter": "scatter_counts",
}


@dataclasses.dataclass(frozen=True)
class Calibration:
    """What turns a rig's counts into pascals and newtons and holds a pressure.

    Attributes:
        pressure: the transducer, Pa gauge; its gain is positive, as the device's trip needs.
        force: the load cell, N, positive when the muscle pulls.
        feed_forward: output that holds a pressure.
    """

    pressure: Sensor
    force: Sensor
    feed_forward: FeedForward = dataclasses.field(default_factory=FeedForward.bias)

    def __post_init__(self) -> None:
        if self.pressure.gain <= 0:
            raise RigError(
                f"the transducer's gain must be positive, got {self.pressure.gain:g} Pa/count: the "
                "device trips when counts rise; swap its wires"
            )


def calibration_as_dict(calibration: Calibration) -> dict[str, Any]:
    """The calibration with the unit in each key; what is not known or unlimited is left out."""
    content: dict[str, Any] = {}
    for name, unit in (("pressure", "Pa"), ("force", "N")):
        content[name] = _known(getattr(calibration, name), _SENSOR_KEYS, unit)
    content["feed_forward"] = _known(calibration.feed_forward, _FEED_FORWARD_KEYS)
    return content


def calibration_from_dict(content: dict[str, Any]) -> Calibration:
    """The calibration of such a dictionary.

    Raises:
        RigError: a sensor is missing, a key is unknown or a value is no number.
    """
    missing = {"pressure", "force"} - content.keys()
    unknown = content.keys() - {"pressure", "force", "feed_forward"}
    if missing or unknown:
        raise RigError(
            "a calibration must have [pressure] and [force] and may have [feed_forward]; "
            f"missing: {sorted(missing)}, unknown: {sorted(unknown)}"
        )
    parts: dict[str, Any] = {
        name: Sensor(**_fields(name, content[name], _SENSOR_KEYS, unit))
        for name, unit in (("pressure", "Pa"), ("force", "N"))
    }
    if "feed_forward" in content:
        given = _fields("feed_forward", content["feed_forward"], _FEED_FORWARD_KEYS)
        parts["feed_forward"] = FeedForward(**given)
    return Calibration(**parts)


def read_calibration(path: str | Path) -> Calibration:
    """The calibration in a TOML file.

    Raises:
        RigError: the file cannot be read or is not a calibration.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise RigError(f"cannot read the calibration {path}: {error}") from None
    try:
        return calibration_from_dict(content)
    except RigError as error:
        raise RigError(f"{path}: {error}") from None


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write the calibration as TOML; reading it back gives the same numbers."""
    lines = ["# value = gain (counts - zero), counts: sum of five readings, 0..5115"]
    for section, entries in calibration_as_dict(calibration).items():
        lines.append(f"\n[{section}]")
        lines += [f"{key} = {_toml(value)}" for key, value in entries.items()]
    Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")


def _known(part: Any, keys: dict[str, str], unit: str = "") -> dict[str, Any]:
    values = {key.format(unit=unit): getattr(part, name) for name, key in keys.items()}
    return {k: v for k, v in values.items() if v != () and np.isfinite(v).all()}


def _fields(section: str, entries: Any, keys: dict[str, str], unit: str = "") -> dict[str, Any]:
    names = {key.format(unit=unit): name for name, key in keys.items()}
    if not isinstance(entries, dict):
        raise RigError(f"{section} must be a table, got {entries!r}")
    fields = {}
    for key, value in entries.items():
        if key not in names:
            raise RigError(f"[{section}] has the unknown key {key!r}; known: {', '.join(names)}")
        fields[names[key]] = _numbers(f"[{section}] {key}", value)
    required = [key for key in list(names)[: 2 if unit else 1] if key not in entries]
    if required:
        raise RigError(f"[{section}] must have {', '.join(required)}")
    return fields


def _numbers(key: str, value: Any) -> Any:
    """A number as a float, lists of them as tuples."""
    if isinstance(value, list):
        return tuple(_numbers(key, item) for item in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise RigError(f"{key} must be a number or a list of numbers, got {value!r}")
    return float(value)


def _toml(value: Any) -> str:
    if isinstance(value, tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return repr(float(value))

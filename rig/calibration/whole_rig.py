"""A rig's calibration as one TOML file: both sensors and the feed-forward, units in every key."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from famjax.boundary.toml_file import Form, from_entries, read_toml, to_entries, toml_text

from ..errors import RigError
from .feed_forward import FeedForward
from .sensor import Sensor


def _sensor_form(unit: str) -> Form:
    return Form(
        keys={
            "gain": f"gain_{unit}_per_count",
            "zero": "zero_counts",
            "gain_std": f"gain_std_{unit}_per_count",
            "zero_std": "zero_std_counts",
            "scatter": f"scatter_{unit}",
        }
    )


_FORMS = {
    "pressure": _sensor_form("Pa"),
    "force": _sensor_form("N"),
    "feed_forward": Form(
        keys={
            "coefficients": "coefficients_counts",
            "scale": "scale_Pa",
            "pressure_range": "pressure_range_Pa",
            "covariance": "covariance_counts2",
            "scatter": "scatter_counts",
        }
    ),
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
    return {name: to_entries(getattr(calibration, name), form) for name, form in _FORMS.items()}


def calibration_from_dict(content: Mapping[str, Any], where: str = "") -> Calibration:
    """The calibration of such a dictionary.

    Args:
        content: a table for each sensor, and one for the feed-forward or none.
        where: the place of the tables, for messages.

    Raises:
        RigError: a sensor is missing, a key is unknown or a value is no number.
    """
    tables = from_entries(_Tables, content, where=where, error=RigError)
    kinds: dict[str, Any] = {"pressure": Sensor, "force": Sensor, "feed_forward": FeedForward}
    return Calibration(
        **{
            name: from_entries(kinds[name], table, form, where=f"{where}[{name}]: ", error=RigError)
            for name, form in _FORMS.items()
            if (table := getattr(tables, name)) is not None
        }
    )


def read_calibration(path: str | Path) -> Calibration:
    """The calibration in a TOML file.

    Raises:
        RigError: the file cannot be read or is not a calibration.
    """
    return calibration_from_dict(read_toml(path, "calibration", RigError), where=f"{path}: ")


def write_calibration(path: str | Path, calibration: Calibration) -> None:
    """Write the calibration as TOML; reading it back gives the same numbers."""
    _write(path, calibration_as_dict(calibration))


def update_calibration(path: str | Path, name: str, part: Sensor | FeedForward) -> None:
    """Put one part into a calibration's file and keep its other parts; the file is made if need be.

    Args:
        path: of the file.
        name: pressure, force or feed_forward.
        part: what was found.

    Raises:
        RigError: the file cannot be read, or the calibration cannot be.
    """
    known = read_toml(path, "calibration", RigError) if Path(path).exists() else {}
    content = known | {name: to_entries(part, _FORMS[name])}
    if {"pressure", "force"} <= content.keys():
        calibration_from_dict(content, where=f"{path}: ")
    _write(path, {name: content[name] for name in _FORMS if name in content})


def _write(path: str | Path, content: dict[str, Any]) -> None:
    heading = "# value = gain (counts - zero), counts: sum of five readings, 0..5115\n"
    Path(path).write_text(heading + toml_text(content), encoding="utf-8")


@dataclasses.dataclass(frozen=True)
class _Tables:
    """The tables of a calibration."""

    pressure: dict[str, Any]
    force: dict[str, Any]
    feed_forward: dict[str, Any] | None = None

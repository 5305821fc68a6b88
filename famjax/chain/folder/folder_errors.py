"""Errors that all readings of a folder share: stated in the sheet, of the sensors, of the clocks."""

import dataclasses
import json
import math
from pathlib import Path

import numpy as np

import fitting
from fitting.data import SharedErrors
from fitting.evidence import Move
from fitting.records import write_dataset
from rig.calibration import Calibration

from ..isobaric_analysis import Analysis
from .sheet import Sheet

CLOCK = "clock"
"""Source of error: the alignment of the journal's clock and the log's."""
_CLOCK_MAP, _SENSORS = "dataset-clock.csv", "sensors.json"


def write_shared(clock_moved: Analysis, calibration: Calibration, place: Path) -> None:
    """Write what the records' step knows of shared errors into its folder.

    Args:
        clock_moved: the analysis with the clocks a standard error apart.
        calibration: of the journal's sensors.
        place: folder of the step.
    """
    write_dataset(clock_moved.characterisation, place / _CLOCK_MAP)
    sensor = calibration.pressure
    known = {
        "pressure_reading": sensor.gain_std / sensor.gain,
        "pressure_zero": sensor.zero_std * sensor.gain,
    }
    text = json.dumps({name: std for name, std in known.items() if math.isfinite(std)}, indent=1)
    (place / _SENSORS).write_text(text + "\n", encoding="utf-8")


def shared_errors(sheet: Sheet, records: Path) -> SharedErrors:
    """The errors of the sheet, and where it states none of the pressure those of the calibration.

    Args:
        sheet: of the folder.
        records: folder of the records' step.
    """
    path = records / _SENSORS
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
    stated = sheet.errors.stated()
    return dataclasses.replace(
        sheet.errors, **{name: std for name, std in known.items() if name not in stated}
    )


def clock_moves(data: fitting.ForceData, records: Path) -> dict[str, list[Move]]:
    """The map as it would be with the clocks a standard error apart; none without a record."""
    path = records / _CLOCK_MAP
    if not path.exists():
        return {}
    known = dataclasses.asdict(data.specimen)
    other = fitting.read_csv(path, known)
    moved = {name: getattr(data, name).copy() for name in ("force", "pressure", "length")}
    # A stroke's end may have a reading more or less: what has no partner stays where it is.
    near = np.abs(data.length[:, None] - other.length) + np.where(
        np.abs(data.pressures.level[:, None] - other.pressures.level)
        > np.abs(np.diff(np.unique(data.pressures.level), append=np.inf)).min() / 2,
        np.inf, 0.0,
    )  # fmt: skip
    partner = np.argmin(near, axis=1)
    found = near[np.arange(data.force.size), partner] < np.ptp(data.length) / 60
    for name, values in moved.items():
        values[found] = getattr(other, name)[partner[found]]
    return {CLOCK: [Move(dataclasses.replace(data, **moved))]}

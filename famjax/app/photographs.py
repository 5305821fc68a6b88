"""Combine photographs of a stroke with the machine log, and check them against the other records."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from fitting.records import (
    MachineLog,
    OtherMotion,
    SyncError,
    Synchronisation,
    read_machine_log,
    synchronise,
)
from imaging import Table
from imaging.cli import AddLog

from .checks import CONTRADICTS, NOT_KNOWN, Check
from .folder import ASSUMED, Sheet

_NEAR = 10.0  # s, largest error of a given clock offset


def read_log_of_pictures(path: str | Path, **how: Any) -> MachineLog:
    """Read the machine log from a photographed test; see `read_machine_log`."""
    return read_machine_log(
        path, needed=("time", "displacement"), welcome=("force", "pressure"), **how
    )


def add_log(machine: MachineLog, guess: float | None) -> AddLog:
    """Return a function that adds the log to a table, or adds a note if the clocks cannot be aligned.

    Args:
        machine: log from the testing machine.
        guess: machine time at the first picture [s], accurate to 10 s; None if unknown.
    """

    def added(table: Table) -> Table:
        try:
            return with_log(table, machine, camera_clock(table, machine, guess))
        except SyncError as error:
            note = f"No force is available: {type(error).__name__}: {error}"
            return dataclasses.replace(table, notes=(*table.notes, note))

    return added


def camera_clock(table: Table, machine: MachineLog, guess: float | None) -> Synchronisation:
    """Align the clocks of the camera and the machine, using the motion that both recorded.

    Args:
        table: table of pictures.
        machine: log from the testing machine.
        guess: machine time at the first picture [s], accurate to 10 s; None if unknown.

    Raises:
        SyncError: see `synchronise`.
    """
    # The scale error is common to all lengths and does not affect the alignment.
    known = np.nan_to_num(table["contraction_stderr"]) * table.rest_length
    stderr = float(np.median(known[table.ok])) if table.ok.any() else 0.0
    near = None if guess is None else (guess, _NEAR)
    return synchronise(table["time"], table["length"], machine, length_stderr=stderr, near=near)


def with_log(table: Table, log: MachineLog, clock: Synchronisation) -> Table:
    """Add the machine's readings at the time of each picture to the table.

    The standard errors include the alignment of the clocks, the resolution of the time stamps and the
    linear interpolation between rows of the log. Values outside the time range of the log are nan.

    Args:
        table: table of pictures.
        log: log from the testing machine.
        clock: alignment of the camera's clock with the machine's, see `synchronise`.
    """
    time = table["time"]
    at = clock.log_time(time)
    step = 0.0 if math.isnan(table.stamp_resolution) else table.stamp_resolution / math.sqrt(12)
    stderr = np.hypot(clock.log_time_stderr(time), step)
    columns = {**table.columns, "log_time": at}
    columns["displacement"] = log.at("displacement", at)[0]
    for name in ("force", "pressure"):
        if getattr(log, name) is not None:
            columns[name], columns[f"{name}_stderr"] = log.at(name, at, stderr)
    notes = [
        f"At the middle of the series, the machine's clock is {clock.offset:.4g} +- "
        f"{clock.offset_stderr:.2g} s ahead of the time since the first picture. It runs "
        f"{clock.rate:.6f} +- {clock.rate_stderr:.1g} times as fast as the camera's. "
        f"{clock.n_pictures} lengths agree with the displacement to {clock.rms * 1e3:.3g} mm RMS."
    ]
    if outside := int(np.sum(np.isfinite(at) & np.isnan(columns["displacement"]))):
        notes.append(
            f"{outside} pictures lie outside the time range of the log; their force is unknown."
        )
    if lost := len(log.unread) + log.missing_rows:
        notes.append(f"{lost} rows of the log are missing or do not contain numbers.")
    return dataclasses.replace(
        table,
        columns=columns,
        notes=(*table.notes, *notes),
        provenance={**table.provenance, "log": log.source, "log_sha256": log.sha256},
    )


def picture_checks(sheet: Sheet, table: Table) -> list[Check]:
    """Check the table of pictures against the other records.

    Args:
        sheet: sheet in the folder.
        table: table of pictures, with the log if the folder has one.
    """
    reasons = sorted({text.partition(":")[0] for text in table.error if text})
    measured = Check.of(
        "fraction of pictures that could be measured", float(np.mean(table.ok)), (0.9, 1.0),
        say=f"Retake the pictures that failed ({', '.join(reasons)}); see measurements.csv for details.",
    )  # fmt: skip
    found = [measured, *_diameter(sheet, table)]
    if sheet.records.machine_log is None:
        return found
    if "log_time" not in table.columns:
        verdict = CONTRADICTS if OtherMotion.__name__ in table.notes[-1] else NOT_KNOWN
        say = (
            f"{table.notes[-1]}. Copy the pictures from the camera unchanged, with their time stamps. "
            "Check the unit of the displacement and the ruler's pitch, and check that the pictures and the "
            "log are from the same test. If all strokes look alike, set log_offset_s in [photographs]."
        )
        return [
            *found,
            Check(
                "motion recorded by camera and machine", "the same motion", verdict, verdict, say
            ),
        ]
    outside = np.isnan(table["displacement"][table.ok])
    inside = Check.of(
        "fraction of pictures outside the time range of the log", float(outside.mean()), (0.0, 0.1),
        say=f"{outside.sum()} pictures were taken before or after the log: export the whole log.",
    )  # fmt: skip
    return [*found, inside, *_scale(sheet, table)]


def _scale(sheet: Sheet, table: Table) -> list[Check]:
    """Check the scale, ruler and rest length by fitting a line to length against displacement."""
    rest, records = sheet.specimen.rest_length, sheet.records
    towards = -1.0 if records.shortening_positive else 1.0
    x, y = towards * (table["displacement"] - records.zero_displacement), table["length"]
    use = np.isfinite(x) & np.isfinite(y)
    (slope, zero), covariance = np.polyfit(x[use], y[use], 1, cov="unscaled")
    scatter = np.std(y[use] - slope * x[use] - zero, ddof=2)
    slope_std, zero_std = scatter * np.sqrt(np.diag(covariance))
    scale_std = float(table.provenance.get("scale_relative_stderr", 0.0))
    rest_std = math.hypot(
        sheet.errors.rest_length or ASSUMED.rest_length, zero_std, scale_std * rest
    )
    std = math.hypot(sheet.errors.shortening or ASSUMED.shortening, slope_std, scale_std)
    return [
        Check.about(
            "ratio of photographed length to machine displacement", slope, 1.0, std,
            say="If the photographed rest length has the same relative error, the ruler was not in the "
            "plane of the muscle's axis. Otherwise the machine's frame deflects under load, its "
            "displacement is out of calibration, or a unit or a sign is wrong: check the unit of the "
            "displacement, shortening_positive, the ruler's pitch and the scale.",
        ),
        Check.about(
            "photographed length at the machine's rest position, compared with the rest length",
            zero * 1e3, rest * 1e3, rest_std * 1e3, unit="mm",
            say="Measure the rest length again, between the edges seen in the pictures. Set "
            "zero_displacement if the machine did not read zero there. Check that the pictures show "
            "this muscle.",
        ),
    ]  # fmt: skip


def _diameter(sheet: Sheet, table: Table) -> list[Check]:
    """Compare the mean diameter at the longest photographed length with that of bladder and braid."""
    specimen = sheet.specimen
    nominal = specimen.bladder_diameter or specimen.nominal_diameter
    if nominal is None or not table.ok.any():
        return []
    seen = float(table["mean_diameter"][table.ok][np.argmax(table["length"][table.ok])])
    least = nominal + 2 * specimen.braid_thickness if specimen.bladder_diameter else 0.8 * nominal
    return [
        Check.of("ratio of photographed diameter near rest to diameter of bladder with braid",
              seen / least, (0.97, 1.5), (0.85, 2.2),
              say="A braid is never narrower than its bladder and rarely much wider: check "
              "bladder_diameter and its unit, and check that the pictures show this specimen. The "
              "bladder strain depends on this diameter.")
    ]  # fmt: skip

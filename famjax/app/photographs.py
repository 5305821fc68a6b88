"""Combine photographs of a stroke with the machine log, and check them against other records."""

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
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

from .checks import ANY, Check, units_of
from .folder import ASSUMED, Photographs, Sheet

_NEAR = 10.0  # s, largest error of a given clock offset


def read_log_of_pictures(path: str | Path, **how: Any) -> MachineLog:
    """Read the machine log of a photographed test; see `read_machine_log`."""
    return read_machine_log(
        path, needed=("time", "displacement"), welcome=("force", "pressure"), **how
    )


def add_log(machine: MachineLog, guess: float | None) -> AddLog:
    """Return a function that adds the log to a table, or a note if the clocks cannot be aligned.

    Args:
        machine: log of the test machine.
        guess: lead of its clock over the first picture [s], within 10 s; None if unknown.
    """

    def added(table: Table) -> Table:
        try:
            clock = camera_clock(table, machine, guess)
        except SyncError as error:
            note = f"No force is available: SyncError: {error}"
            return dataclasses.replace(table, notes=(*table.notes, note))
        return with_log(table, machine, clock)

    return added


def camera_clock(table: Table, machine: MachineLog, guess: float | None) -> Synchronisation:
    """Align the camera's clock with the machine's, from the motion that both recorded.

    Args:
        table: table of the pictures.
        machine: log of the test machine.
        guess: lead of the machine's clock over the first picture [s], within 10 s; None if unknown.

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

    The errors cover the alignment of the clocks, the resolution of the time stamps and the linear
    interpolation between rows of the log. Values outside the log are nan.

    Args:
        table: table of the pictures.
        log: log of the test machine.
        clock: alignment of the camera's clock with the machine's, see `synchronise`.

    Raises:
        InputError: no picture has a time.
    """
    if not len(table) or "time" not in table.columns:
        raise InputError(f"{log.source}: the table has no pictures with a time")
    time = table["time"]
    at = clock.log_time(time)
    step = 0.0 if math.isnan(table.stamp_resolution) else table.stamp_resolution / math.sqrt(12)
    stderr = np.hypot(clock.log_time_stderr(time), step)
    columns = {**table.columns, "log_time": at}
    columns["displacement"] = log.at("displacement", at)[0]
    for name in ("force", "pressure"):
        if getattr(log, name) is not None:
            columns[name], columns[f"{name}_stderr"] = log.at(name, at, stderr)
    outside = int(np.sum(np.isfinite(at) & np.isnan(columns["displacement"])))
    notes = [
        f"At the middle of the series, the machine's clock is {clock.offset:.4g} +- "
        f"{clock.offset_stderr:.2g} s ahead of the time since the first picture. It runs "
        f"{clock.rate:.6f} +- {clock.rate_stderr:.1g} times as fast as the camera's. "
        f"{clock.n_pictures} lengths follow the displacement within {clock.rms * 1e3:.3g} mm RMS."
    ]
    if outside:
        notes.append(f"{outside} pictures lie outside the log and have no force.")
    if log.unread:
        lines = ", ".join(map(str, log.unread[:5]))
        notes.append(f"{len(log.unread)} lines of the log are not numbers: {lines}.")
    if log.missing_rows:
        notes.append(f"{log.missing_rows} rows are missing from the log.")
    return dataclasses.replace(
        table,
        columns=columns,
        notes=(*table.notes, *notes),
        provenance={**table.provenance, "log": log.source, "log_sha256": log.sha256},
    )


_FEWEST = 6  # pictures with a time needed to align two clocks

_GIVE = 0.05  # largest compliance of a machine frame, as a fraction of the motion
_TRIED = (25.4, 1 / 25.4, 2.54, 1 / 2.54, 10.0, 0.1, 1000.0, 1e-3)  # ratios of wrong units


def picture_checks(
    sheet: Sheet,
    photographs: Photographs,
    table: Table,
    machine: MachineLog | None,
    lengths: np.ndarray,
) -> list[Check]:
    """Check the table of the pictures against the other records.

    Args:
        sheet: sheet of the folder.
        photographs: its section on photographs.
        table: table of the pictures.
        machine: log of the same test; None if the force is given as a map.
        lengths: lengths of the force readings [m], shape (n,).
    """
    found = [_measured(table), _cover(table, lengths), *_diameter(sheet, table)]
    if machine is None:
        return found
    guess, what = photographs.log_offset, "clocks of camera and machine"
    if np.isfinite(table["time"][table.ok]).sum() < _FEWEST:
        say = (
            f"Fewer than {_FEWEST} pictures have a time in their EXIF data, so their force and pressure "
            "are not known: copy the pictures from the camera unchanged."
        )
        return [*found, Check.of(what, math.nan, ANY, say=say)]
    try:
        clock = camera_clock(table, machine, guess)
    except OtherMotion as error:
        return [found[0], _unlike(error, table, machine, guess)]
    except SyncError as error:
        say = (
            f"{error}. The force and pressure at each picture are not known. Set log_offset_s in "
            "[photographs] to the lead of the log over the first picture."
        )
        return [*found, Check.of(what, math.nan, ANY, say=say)]
    return [
        *found, *_scale(sheet, photographs, table, machine, clock), _outside(table, machine, clock)
    ]  # fmt: skip


def _measured(table: Table) -> Check:
    """Check the fraction of pictures that could be measured."""
    reasons = sorted({text.partition(":")[0] for text in table.error if text})
    return Check.of(
        "fraction of pictures that could be measured", float(np.mean(table.ok)), (0.9, 1.0),
        say=f"measurements.csv gives the reasons ({', '.join(reasons)}); repeat those pictures.",
    )  # fmt: skip


def _unlike(error: OtherMotion, table: Table, machine: MachineLog, guess: float | None) -> Check:
    """Explain lengths that do not follow the displacement: a wrong unit, or another test."""
    y = table["length"][table.ok]
    plain = float(np.ptp(y)) / float(np.ptp(machine.displacement))
    for ratio in (plain, *_TRIED):
        scaled = dataclasses.replace(machine, displacement=machine.displacement * ratio)
        try:
            clock = camera_clock(table, scaled, guess)
        except SyncError:
            continue
        slope = ratio * _line(table, scaled, clock)[0]
        units = units_of(slope)
        remedy = f"in the ratio of {units}" if units else "but not one to one"
        return Check.about(
            "ratio of photographed length to machine displacement", slope, 1.0, 0.01,
            say=f"They follow each other, {remedy}: check the unit of the displacement in the log's "
            "header, the ruler's pitch or the scale in [photographs], and that pictures and log belong to "
            "one test.",
        )  # fmt: skip
    return Check.of(
        "fraction of the lengths' variance explained by the displacement", error.explained,
        (0.9, 1.0), (0.9, 1.0),
        say=f"{error} No unit explains this: the pictures belong to another test, or their times were "
        "changed. Give the log and journal of these pictures, and the original files of the camera.",
    )  # fmt: skip


def _line(
    table: Table, machine: MachineLog, clock: Synchronisation
) -> tuple[float, float, float, float]:
    """Fit length against displacement: slope, its standard error, length at machine zero, its error."""
    at = clock.log_time(table["time"])
    x = clock.sense * machine.at("displacement", at)[0]
    y = table["length"]
    use = np.isfinite(x) & np.isfinite(y)
    line, covariance = np.polyfit(x[use], y[use], 1, cov="unscaled")
    scatter = np.std(y[use] - np.polyval(line, x[use]), ddof=2)
    slope_std, zero_std = scatter * np.sqrt(np.diag(covariance))
    return float(line[0]), float(slope_std), float(line[1]), float(zero_std)


def _scale(
    sheet: Sheet,
    photographs: Photographs,
    table: Table,
    machine: MachineLog,
    clock: Synchronisation,
) -> list[Check]:
    """Check scale, ruler and rest length by the slope and offset of length against displacement."""
    slope, slope_std, zero, zero_std = _line(table, machine, clock)
    rest, records = sheet.specimen.rest_length, sheet.records
    towards = -1.0 if records.shortening_positive else 1.0
    expected = rest - towards * slope * records.zero_displacement
    scale_std = float(table.provenance.get("scale_relative_stderr", 0.0))
    rest_std = math.hypot(
        sheet.errors.rest_length or ASSUMED.rest_length, zero_std, scale_std * rest
    )
    std = math.hypot(sheet.errors.shortening or ASSUMED.shortening, slope_std, scale_std)
    both = abs((zero / expected - 1) - (slope - 1)) < 3 * math.hypot(std, rest_std / rest)
    units = units_of(slope)
    if units:
        cause = f"This is the ratio of {units}: correct the unit of displacement, pitch or scale."
    elif both and abs(slope - 1) > 2 * std and abs(zero - expected) > 2 * rest_std:
        cause = f"Slope and rest length have the same error. {_ruler(slope, photographs.distance)}"
    elif abs(slope - 1) > _GIVE:
        cause = (
            "No frame is this compliant: pictures and log belong to two tests, or the scale of the "
            "pictures or the displacement is wrong."
        )
    else:
        cause = (
            "The machine's frame deflects under load, or its displacement is out of calibration. If the "
            "ruler had been outside the plane of the axis, the rest length would be wrong as well."
        )
    sign = Check.of(
        "direction of the length relative to the displacement", clock.sense * towards, (1.0, 1.0),
        (1.0, 1.0), say="The pictures show the opposite sign of the displacement: "
        f"shortening_positive must be {str(clock.sense < 0).lower()} in [records].",
    )  # fmt: skip
    rest_say = (
        "The slope has the same relative error: see its check."
        if both and abs(slope - 1) > 2 * std
        else "Measure the rest length again between the edges that the pictures show. State "
        "zero_displacement if the machine was not at zero there. Or the pictures show another muscle."
    )
    return [
        sign,
        Check.about("ratio of photographed length to machine displacement", slope, 1.0, std,
                    say=cause),
        Check.about("photographed length at machine zero against the rest length",
                    zero * 1e3, expected * 1e3, rest_std * 1e3, unit="mm", say=rest_say),
    ]  # fmt: skip


def _ruler(slope: float, distance: float | None) -> str:
    """Explain a scale that is wrong by this factor."""
    if distance is None:
        return "The scale may be wrong: was the ruler in the plane of the muscle's axis?"
    away = distance * abs(1 - slope) * 1e3
    side = "nearer to the camera" if slope < 1 else "farther from the camera"
    return (
        f"The scale is as if the ruler had been {away:.3g} mm {side} than the muscle's axis: photograph it "
        "in the plane of the axis, or check distance and pitch."
    )


def _outside(table: Table, machine: MachineLog, clock: Synchronisation) -> Check:
    """Check for pictures taken while the log was not running."""
    at = clock.log_time(table["time"])
    at = at[np.isfinite(at)]
    outside = float(np.mean((at < machine.time[0]) | (at > machine.time[-1])))
    return Check.of(
        "fraction of pictures taken outside the log", outside, (0.0, 0.1),
        say=f"The log covers {machine.time[-1] - machine.time[0]:.4g} s, the pictures "
        f"{np.ptp(at):.4g} s: export the whole log, or omit the other pictures.",
    )  # fmt: skip


def _cover(table: Table, lengths: np.ndarray) -> Check:
    """Check how many force readings lie within the lengths of the pictures."""
    seen = table["length"][table.ok]
    inside = (lengths >= seen.min()) & (lengths <= seen.max()) if seen.size else np.zeros(1)
    low, high = (float(one) * 1e3 for one in (seen.min(), seen.max()))
    return Check.of(
        "fraction of force readings within the lengths of the pictures", float(np.mean(inside)),
        (0.85, 1.0), (0.3, 1.0),
        say=f"The pictures show {low:.4g} to {high:.4g} mm, the force {lengths.min() * 1e3:.4g} to "
        f"{lengths.max() * 1e3:.4g} mm; other readings are left out. Photograph the whole stroke, and "
        "check rest_length and the scale.",
    )  # fmt: skip


def _diameter(sheet: Sheet, table: Table) -> Sequence[Check]:
    """Compare the average diameter at the rest length with the bladder and its braid.

    For inextensible threads, D^2 is linear in L^2.
    """
    specimen = sheet.specimen
    nominal = specimen.bladder_diameter or specimen.nominal_diameter
    if nominal is None or table.ok.sum() < _FEWEST:
        return []
    L, D = table["length"][table.ok], table["mean_diameter"][table.ok]
    near = np.quantile(L, 0.5) <= L
    square = np.polyval(np.polyfit(L[near] ** 2, D[near] ** 2, 1), specimen.rest_length**2)
    least = nominal + 2 * specimen.braid_thickness if specimen.bladder_diameter else 0.8 * nominal
    return [
        Check.of("ratio of photographed diameter at rest to the diameter of bladder and braid",
              math.sqrt(max(float(square), 0.0)) / least, (0.97, 1.3), (0.85, 2.0),
              say="A braid is never narrower than its bladder and rarely much wider: check "
              "bladder_diameter, its unit, and that the pictures show this specimen. The strain of the "
              "bladder depends on it.")
    ]  # fmt: skip

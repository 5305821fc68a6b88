"""Photographs of a stroke joined with the machine's log, and cross-checks with the other records."""

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

from .checks import Check, units_of
from .folder import ASSUMED, Photographs, Sheet

_ANYTHING = (-math.inf, math.inf)
_NEAR = 10.0  # s, by which the offset of the clocks that was given may be wrong


def read_log_of_pictures(path: str | Path, **how: Any) -> MachineLog:
    """Read a log that gives pictures their force; see `read_machine_log`.

    Raises:
        InputError: as `read_machine_log`.
    """
    return read_machine_log(
        path, needed=("time", "displacement"), welcome=("force", "pressure"), **how
    )


def add_log(machine: MachineLog, guess: float | None) -> AddLog:
    """A function that adds the log to a table, or a note on why the clocks could not be aligned.

    Args:
        machine: its log.
        guess: what its clock is ahead of the first picture [s], within 10 s; None if nothing is known.
    """

    def added(table: Table) -> Table:
        try:
            clock = camera_clock(table, machine, guess)
        except SyncError as error:
            note = f"There is no force: SyncError: {error}"
            return dataclasses.replace(table, notes=(*table.notes, note))
        return with_log(table, machine, clock)

    return added


def camera_clock(table: Table, machine: MachineLog, guess: float | None) -> Synchronisation:
    """The camera's clock against the machine's, from the motion that both recorded.

    Args:
        table: of the pictures.
        machine: its log.
        guess: what the machine's clock is ahead of the first picture [s], within 10 s; None if nothing
            is known of it.

    Raises:
        SyncError: as `synchronise`.
    """
    # Of the errors of length that of the scale does not count, which is common to all.
    known = np.nan_to_num(table["contraction_stderr"]) * table.rest_length
    stderr = float(np.median(known[table.ok])) if table.ok.any() else 0.0
    near = {} if guess is None else {"window": _NEAR, "guess": guess}
    return synchronise(table["time"], table["length"], machine, length_stderr=stderr, **near)


def with_log(table: Table, log: MachineLog, clock: Synchronisation) -> Table:
    """Add to the table the machine's readings at the time of each picture.

    The errors are those of interpolation: of the clocks, of the step of the time stamps, and of
    straight lines between the rows of the log. Outside the log there is nan.

    Args:
        table: of the pictures.
        log: of the machine.
        clock: of the camera against the machine's, see `synchronise`.

    Raises:
        InputError: the table has no pictures with a time.
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
        f"In the middle of the pictures the machine's clock is {clock.offset:.4g} +- "
        f"{clock.offset_stderr:.2g} s ahead of the time since the first picture, and it runs "
        f"{clock.rate:.6f} +- {clock.rate_stderr:.1g} times as fast as the camera's; "
        f"{clock.n_pictures} lengths follow the displacement within {clock.rms * 1e3:.3g} mm "
        f"RMS, {clock.largest * 1e3:.3g} mm at most."
    ]
    if outside:
        notes.append(f"{outside} pictures lie outside the log and have no force.")
    if log.unread:
        lines = ", ".join(map(str, log.unread[:5]))
        notes.append(f"{len(log.unread)} lines of the log are no numbers: {lines}.")
    if log.missing_rows:
        notes.append(f"{log.missing_rows} rows are missing from the log; see its gaps.")
    return dataclasses.replace(
        table,
        columns=columns,
        notes=(*table.notes, *notes),
        provenance={**table.provenance, "log": log.source, "log_sha256": log.sha256},
    )


_FEWEST = 6  # pictures with a time, to lay two clocks onto each other

_GIVE = 0.05  # of the motion, that a machine's frame may give way
_TRIED = (25.4, 1 / 25.4, 2.54, 1 / 2.54, 10.0, 0.1, 1000.0, 1e-3)  # of a wrong unit


def picture_checks(
    sheet: Sheet,
    photographs: Photographs,
    table: Table,
    machine: MachineLog | None,
    lengths: np.ndarray,
) -> list[Check]:
    """The checks of the pictures' table.

    Args:
        sheet: of the folder.
        photographs: its part on them.
        table: of the pictures.
        machine: the log of the same test, None where the force is a map.
        lengths: of the force map's readings [m], shape (n,).
    """
    found = [_measured(table), _cover(table, lengths), *_diameter(sheet, table)]
    if machine is None:
        return found
    guess, open_ = photographs.log_offset, "clocks of camera and machine"
    if np.isfinite(table["time"][table.ok]).sum() < _FEWEST:
        say = (
            f"Fewer than {_FEWEST} pictures have a time in their EXIF data, so that force and pressure "
            "at each are not known: copy the pictures from the camera unchanged."
        )
        return [*found, Check.of(open_, math.nan, _ANYTHING, say=say)]
    try:
        clock = camera_clock(table, machine, guess)
    except OtherMotion as error:
        return [found[0], _unlike(error, table, machine, guess)]
    except SyncError as error:
        say = (
            f"{error}. The force and pressure at each picture are not known; log_offset_s in "
            "[photographs] says what the log is ahead of the first picture."
        )
        return [*found, Check.of(open_, math.nan, _ANYTHING, say=say)]
    return [
        *found, *_scale(sheet, photographs, table, machine, clock), _outside(table, machine, clock)
    ]  # fmt: skip


def _measured(table: Table) -> Check:
    """The part of the pictures that could be measured."""
    reasons = sorted({text.partition(":")[0] for text in table.error if text})
    return Check.of(
        "part of the pictures that could be measured", float(np.mean(table.ok)), (0.9, 1.0),
        say=f"The reasons, {', '.join(reasons)}, are in measurements.csv; repeat those pictures.",
    )  # fmt: skip


def _unlike(error: OtherMotion, table: Table, machine: MachineLog, guess: float | None) -> Check:
    """Lengths that do not follow the displacement: a unit, or another test."""
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
        remedy = f"which is the ratio of {units}" if units else "but not one to one"
        return Check.about(
            "length in the pictures over displacement of the machine", slope, 1.0, 0.01,
            say=f"They follow each other, {remedy}: check the unit of the displacement in the log's "
            "header, that of the ruler's pitch or the scale in [photographs], and whether pictures and "
            "log are of one test.",
        )  # fmt: skip
    return Check.of(
        "part of the lengths' variance that the machine's displacement explains", error.explained,
        (0.9, 1.0), (0.9, 1.0),
        say=f"{error} In no unit do they: the pictures are of another test, or their times are not "
        "those at which they were taken. Give the log and journal of these pictures, and pictures "
        "as the camera wrote them.",
    )  # fmt: skip


def _line(
    table: Table, machine: MachineLog, clock: Synchronisation
) -> tuple[float, float, float, float]:
    """Length over displacement: slope, its standard error, length at the machine's zero, its error."""
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
    """Slope and offset of the lengths against the displacement: scale, ruler, rest length."""
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
        cause = f"Slope and rest length are off alike, {_ruler(slope, photographs.distance)}."
    elif abs(slope - 1) > _GIVE:
        cause = (
            "No frame gives way that much: the pictures and the log are of two tests, or the scale of "
            "the pictures or the displacement is wrong."
        )
    else:
        cause = (
            "The machine's frame gives way under load, or its displacement is out of calibration; "
            "if the ruler lay beside the plane of the axis, the rest length would be off as well."
        )
    sign = Check.of(
        "sense in which the length follows the displacement", clock.sense * towards, (1.0, 1.0),
        (1.0, 1.0), say="The pictures show that the displacement is counted the other way: "
        f"shortening_positive must be {str(clock.sense < 0).lower()} in [records].",
    )  # fmt: skip
    rest_say = (
        "Its slope is off by the same factor: see there."
        if both and abs(slope - 1) > 2 * std
        else "Measure the rest length again, between the same edges as the pictures show; state "
        "zero_displacement where the machine was not at zero there; or the pictures are of another "
        "muscle."
    )
    return [
        sign,
        Check.about("length in the pictures over displacement of the machine", slope, 1.0, std,
                    say=cause),
        Check.about("length in the pictures at the machine's zero, and the rest length",
                    zero * 1e3, expected * 1e3, rest_std * 1e3, unit="mm", say=rest_say),
    ]  # fmt: skip


def _ruler(slope: float, distance: float | None) -> str:
    """What a scale that is off by this factor may come from."""
    if distance is None:
        return (
            "so that the scale of the pictures is: was the ruler in the plane of the muscle's axis?"
        )
    away = distance * abs(1 - slope) * 1e3
    side = "nearer to the camera" if slope < 1 else "farther from the camera"
    return (
        f"so that the scale of the pictures is, as if the ruler had been {away:.3g} mm {side} than "
        "the muscle's axis: photograph it in the plane of the axis, or check distance and pitch"
    )


def _outside(table: Table, machine: MachineLog, clock: Synchronisation) -> Check:
    """Pictures while the log did not run."""
    at = clock.log_time(table["time"])
    at = at[np.isfinite(at)]
    outside = float(np.mean((at < machine.time[0]) | (at > machine.time[-1])))
    return Check.of(
        "part of the pictures that were taken while the log did not run", outside, (0.0, 0.1),
        say=f"The log covers {machine.time[-1] - machine.time[0]:.4g} s, the pictures "
        f"{np.ptp(at):.4g} s: export the whole log, or leave the other pictures out.",
    )  # fmt: skip


def _cover(table: Table, lengths: np.ndarray) -> Check:
    """The part of the force's readings that lie within the lengths of the pictures."""
    seen = table["length"][table.ok]
    inside = (lengths >= seen.min()) & (lengths <= seen.max()) if seen.size else np.zeros(1)
    low, high = (float(one) * 1e3 for one in (seen.min(), seen.max()))
    return Check.of(
        "part of the force's readings within the lengths of the pictures", float(np.mean(inside)),
        (0.85, 1.0), (0.3, 1.0),
        say=f"The pictures show {low:.4g} to {high:.4g} mm, the force {lengths.min() * 1e3:.4g} to "
        f"{lengths.max() * 1e3:.4g} mm; what lies outside is left out. Photograph the whole stroke, and "
        "check rest_length and the scale.",
    )  # fmt: skip


def _diameter(sheet: Sheet, table: Table) -> Sequence[Check]:
    """The average diameter at the rest length against the bladder and its braid.

    D^2 falls in a straight line with L^2, as threads that keep their length have it.
    """
    specimen = sheet.specimen
    nominal = specimen.bladder_diameter or specimen.nominal_diameter
    if nominal is None or table.ok.sum() < _FEWEST:
        return []
    L, D = table["length"][table.ok], table["mean_diameter"][table.ok]
    near = np.quantile(L, 0.5) <= L
    square = np.polyval(np.polyfit(L[near] ** 2, D[near] ** 2, 1), specimen.rest_length**2)
    least = nominal + 2 * specimen.braid_thickness
    if specimen.bladder_diameter is None:
        least = 0.8 * nominal
    return [
        Check.of("average diameter in the pictures at the rest length, over that of bladder and braid",
              math.sqrt(max(float(square), 0.0)) / least, (0.97, 1.3), (0.85, 2.0),
              say="No braid is narrower than its bladder, and few are much wider: check "
              "bladder_diameter, its unit, and that the pictures are of this specimen. The strain of "
              "the bladder follows from it.")
    ]  # fmt: skip

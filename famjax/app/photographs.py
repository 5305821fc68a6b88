"""Photographs of a stroke and the machine's log to one table: both clocks, and force at each picture."""

import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.errors import InputError
from fitting.records import MachineLog, SyncError, Synchronisation, read_machine_log, synchronise
from imaging import Table
from imaging.cli import AddLog

_NEAR = 10.0  # s, by which the offset of the clocks that was given may be wrong


def read_log_of_pictures(path: str | Path, **how: Any) -> MachineLog:
    """A log that gives pictures their force; of `read_machine_log`, which see.

    Raises:
        InputError: as `read_machine_log`.
    """
    return read_machine_log(
        path, needed=("time", "displacement"), welcome=("force", "pressure"), **how
    )


def add_log(machine: MachineLog, guess: float | None) -> AddLog:
    """What gives a table the log, or a note why the clocks could not be brought together.

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
    """The camera's clock against the machine's, by the motion that both have seen.

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
    """The table with what the machine read when each picture was taken.

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

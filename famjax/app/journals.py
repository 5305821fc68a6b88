"""A rig's journal as columns in SI on the host's clock, and as CSV."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from famjax.units import PSI
from fitting.records import ClockMap, fit_clock
from rig.calibration import READINGS
from rig.errors import RigError
from rig.journal import Record, read_journal, stored_calibration
from rig.protocol import TICK_HZ, TICKS


def table(record: Record) -> dict[str, NDArray[Any]]:
    """The journal as columns, a row for each record, neglecting the shortest latency of the line.

    Args:
        record: a journal read back, with the calibration of its sensors.

    Returns:
        Arrays of shape (n,): time on the host's clock, as that of the notes, nan in a boot too short
        to determine it (half a second); time on the device's;
        pressure and force as means over the ticks of a record; the set pressure that the device
        controlled for, nan where unknown; output [0..255] and integral [counts]; state and
        fault as the indices of `STATES` and `FAULTS`; sync; the plan's block, -1 outside of one.

    Raises:
        RigError: there is no calibration.
    """
    calibration = stored_calibration(record)
    known, governing = [settings for _, settings in record.settings], record.governing()
    scale = READINGS / np.array([*(s.ticks_per_record for s in known), READINGS])[governing]
    set_point = np.array([*(s.law.set_point_psi for s in known), np.nan])[governing] * PSI
    flags = record.column("flags")
    device = record.column("tick") / TICK_HZ
    time = np.full(len(device), np.nan)
    for epoch, clock in clocks(record).items():
        mine = record.epoch == epoch
        time[mine] = clock.host(device[mine])
    return {
        "time_s": time,
        "device_time_s": device,
        "pressure_Pa": calibration.pressure.value(record.column("pressure_sum") * scale),
        "force_N": calibration.force.value(record.column("force_sum") * scale),
        "set_pressure_Pa": set_point,
        "output": record.column("output"),
        "integral": record.column("integral") / 32768,
        "state": flags & 3,
        "fault": flags >> 4,
        "sync": flags >> 2 & 1,
        "block": _blocks(record, time),
        "epoch": record.epoch,
        "seq": record.column("seq"),
    }


def clocks(record: Record) -> dict[int, ClockMap]:
    """The map from device to host time of each epoch that has two clock notes or more."""
    found = {}
    pairs = _clock_pairs(record)
    for epoch in np.unique(record.epoch).tolist():
        mine = [pair for pair in pairs if pair[0] == epoch]
        if len(mine) > 1:
            ticks, arrivals = [tick for _, tick, _ in mine], [at for *_, at in mine]
            found[epoch] = fit_clock(np.array(ticks) / TICK_HZ, arrivals)
    return found


def _clock_pairs(record: Record) -> list[tuple[int, int, float]]:
    """(epoch, tick, arrival [s]) of every clock note whose record is there."""
    epochs = record.epoch.tolist()
    parts = [record.epoch_parts[epoch] for epoch in epochs]
    boots, ticks = record.column("boot").tolist(), record.column("tick").tolist()
    keys = zip(parts, boots, (tick % TICKS for tick in ticks), strict=True)
    at = dict(zip(keys, zip(epochs, ticks, strict=True), strict=True))
    pairs = []
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if (
            note["note"] == "clock"
            and (record_at := at.get((part, note["boot"], note["tick"]))) is not None
        ):
            pairs.append((*record_at, note["arrival_s"]))
    return pairs


def _blocks(record: Record, time: NDArray[np.float64]) -> NDArray[np.int64]:
    """The plan's block at each row, -1 outside."""
    blocks = np.full(len(time), -1)
    part_of_row = np.array(record.epoch_parts, np.int64)[record.epoch]
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] in {"block", "done", "end"}:
            after = (part_of_row == part) & (time >= note["at"])
            blocks[after] = note["block"] if note["note"] == "block" else -1
    return blocks


def convert(journal: str | Path, target: str | Path) -> Path:
    """Write the records of a journal as a CSV table, the unit in the name of each column.

    Raises:
        RigError: another ending, or the journal cannot be read.
    """
    target = Path(target)
    if target.suffix != ".csv":
        raise RigError(f"the target must end in .csv, got {target.name!r}")
    columns = table(read_journal(journal))
    with target.open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file)
        writer.writerow(columns)
        writer.writerows(zip(*(column.tolist() for column in columns.values()), strict=True))
    return target

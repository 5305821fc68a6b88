"""Tests at constant pressure: from journal and machine log to curves, figures and a picture."""

import csv
import dataclasses
import math
from collections import defaultdict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from famjax.boundary.errors import InputError
from famjax.boundary.units import factor, finite_or_none, unit_system
from famjax.units import PSI
from fitting.records import (
    Alignment,
    Characterisation,
    ClockMap,
    IsobaricRecord,
    MachineLog,
    align_by_load,
    characterise,
    combine,
    fit_clock,
)
from rig.calibration import READINGS
from rig.errors import RigError
from rig.journal import Record, read_journal, stored_calibration
from rig.protocol import TICK_HZ, TICKS


def table(record: Record) -> dict[str, NDArray[Any]]:
    """Return the journal as columns with one row per record.

    Neglects the shortest latency of the serial line.

    Args:
        record: journal, with the calibration of its sensors.

    Returns:
        Arrays of shape (n,): time on the host's clock, as in the notes, nan in a boot of less than half
        a second; time on the device's clock; pressure and force, averaged over the ticks of a record;
        the set pressure of the controller, nan if unknown; output [0..255] and integral [counts]; state
        and fault as indices of `STATES` and `FAULTS`; sync; the plan's block, -1 outside a block.

    Raises:
        RigError: the journal has no calibration.
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
    """Fit the map from device time to host time for each epoch with at least two clock notes."""
    epochs = record.epoch.tolist()
    parts = [record.epoch_parts[epoch] for epoch in epochs]
    boots, ticks = record.column("boot").tolist(), record.column("tick").tolist()
    keys = zip(parts, boots, (tick % TICKS for tick in ticks), strict=True)
    at = dict(zip(keys, zip(epochs, ticks, strict=True), strict=True))
    pairs = defaultdict[int, list[tuple[int, float]]](list)
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] == "clock" and (part, note["boot"], note["tick"]) in at:
            epoch, tick = at[part, note["boot"], note["tick"]]
            pairs[epoch].append((tick, note["arrival_s"]))
    return {
        epoch: fit_clock(np.array(seen) / TICK_HZ, arrivals)
        for epoch, mine in sorted(pairs.items()) if len(mine) > 1
        for seen, arrivals in [[list(one) for one in zip(*mine, strict=True)]]
    }  # fmt: skip


def _blocks(record: Record, time: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the plan's block at each row, -1 outside a block."""
    blocks = np.full(len(time), -1)
    part_of_row = np.array(record.epoch_parts, np.int64)[record.epoch]
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] in {"block", "done", "end"}:
            after = (part_of_row == part) & (time >= note["at"])
            blocks[after] = note["block"] if note["note"] == "block" else -1
    return blocks


def convert(journal: str | Path, target: str | Path) -> Path:
    """Write the records of a journal as a CSV table with the unit in each column name.

    Raises:
        RigError: the target has another suffix, or the journal cannot be read.
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


_APART = 3.0  # largest ratio of the durations of two records of one test
_STRETCH = 0.05  # largest stretch of a muscle, as a fraction of the rest length
_MOST_POINTS = 20_000  # points drawn of a pressure record


class Loads(NamedTuple):
    """Fit of the load in the journal as gain x load of the log + zero, at the same times.

    Attributes:
        gain: gain [-].
        zero: zero [N].
        scatter: RMS residual, relative to the range of the journal's load [-].
    """

    gain: float
    zero: float
    scatter: float


@dataclasses.dataclass(frozen=True)
class Analysis:
    """Result of a test.

    Attributes:
        alignment: alignment of the machine's clock with the journal's.
        record: the test on one clock.
        characterisation: curves and figures.
        loads: comparison of both loads.
    """

    alignment: Alignment
    record: IsobaricRecord
    characterisation: Characterisation
    loads: Loads


def analyse(
    journal: Record,
    log: MachineLog,
    *,
    rest_length: float,
    near: tuple[float, float] | None = None,
    skip_cycles: int = 0,
    shortening_positive: bool = False,
    zero_displacement: float = 0.0,
    pushing_positive: bool = False,
    alignment: Alignment | None = None,
) -> Analysis:
    """Characterise a muscle from the two records of one test.

    A device record is an average over its ticks. Its time is the middle of these ticks: half a record
    minus half a tick before its last tick.

    Args:
        journal: journal of the rig.
        log: log of the test machine.
        rest_length: L0 [m].
        near: approximate offset of the clocks and its largest error [s], if known.
        skip_cycles: number of strokes to skip at the start of each pressure.
        shortening_positive: True if the machine's displacement grows as the muscle shortens.
        zero_displacement: displacement reading at L0 [m].
        pushing_positive: True if the machine's force is positive in compression.
        alignment: known alignment of the clocks; None computes it.

    Returns:
        Alignment, record and characterisation.

    Raises:
        RigError: the records do not belong together, or contain no complete stroke.
    """
    if log.force is None:
        raise RigError(f"{log.source} needs a column with the force of the machine; export it too")
    columns = table(journal)
    known = np.isfinite(columns["time_s"])
    if known.sum() < 2:
        raise RigError(f"{journal.path} has no clock notes: its records have no time of the host")
    device = columns["device_time_s"][known]
    period = float(np.median(np.diff(device)))
    time = columns["time_s"][known] - (period - 1 / TICK_HZ) / 2
    rising = np.concatenate([[True], np.diff(np.maximum.accumulate(time)) > 0])
    time = time[rising]
    pressure, force = columns["pressure_Pa"][known][rising], columns["force_N"][known][rising]
    if alignment is None:
        errors = [clock.error for clock in clocks(journal).values()]
        error = max((one for one in errors if math.isfinite(one)), default=0.0)
        alignment = _by_load(time, force, log, near, error, pushing_positive=pushing_positive)
    record = combine(
        log, alignment, time, pressure, _set_pressures(journal), rest_length=rest_length,
        shortening_positive=shortening_positive, zero_displacement=zero_displacement,
        pushing_positive=pushing_positive,
    )  # fmt: skip
    over, under = record.length.max() - rest_length, rest_length - record.length.min()
    if over > max(under, _STRETCH * rest_length):
        raise InputError(
            f"{log.source}: the machine would have stretched the muscle, from {record.length.min():.5g} "
            f"to {record.length.max():.5g} m with a rest length of {rest_length:.5g} m, but a stroke "
            f"shortens it: shortening_positive must be {str(not shortening_positive).lower()}, or check "
            "zero_displacement and the rest length"
        )
    curves = characterise(record, skip_cycles=skip_cycles)
    return Analysis(alignment, record, curves, _loads(time, force, record))


def _by_load(
    time: np.ndarray,
    force: np.ndarray,
    log: MachineLog,
    near: tuple[float, float] | None,
    time_error: float,
    *,
    pushing_positive: bool,
) -> Alignment:
    """Align the clocks by load; if the loads disagree, name the column of the log that agrees."""
    sign = -1.0 if pushing_positive else 1.0
    load = sign * log.channel("force")
    try:
        return align_by_load(time, force, log.time, load, near=near, time_error=time_error)
    except InputError as error:
        opposite = "the force with the opposite sign"
        known = {"the displacement": log.displacement, **log.others}
        others = {opposite: -load} | {
            f"{sign}{name}": values if not sign else -values
            for name, values in known.items() for sign in ("", "the negative of ")
            if np.isfinite(values).all()
        }  # fmt: skip
        for name, values in others.items():
            try:
                align_by_load(time, force, log.time, values, near=near)
            except InputError:
                continue
            remedy = f"pushing_positive must be {str(not pushing_positive).lower()}"
            if name != opposite:
                remedy = "are columns swapped or wrongly named?"
            raise InputError(
                f"{log.source}: the load of the journal does not agree with the log's force but with "
                f"{name}: {remedy}"
            ) from None
        ours, theirs = (float(t[-1] - t[0]) for t in (time, log.time))
        much = f". The journal covers {ours:.4g} s and the log {theirs:.4g} s: check the unit of its time"
        apart = max(ours, theirs) > _APART * min(ours, theirs)
        raise InputError(f"{log.source}: {error}{much if apart else ''}") from None


def _loads(time: np.ndarray, force: np.ndarray, record: IsobaricRecord) -> Loads:
    """Fit the journal's load to the log's at the rows of the record."""
    ours = np.interp(record.time, time, force)
    gain, zero = np.polyfit(record.force, ours, 1)
    left = ours - gain * record.force - zero
    return Loads(float(gain), float(zero), float(np.sqrt(np.mean(left**2)) / np.ptp(ours)))


def _set_pressures(journal: Record) -> list[tuple[float, float]]:
    """Return times [s] and the set pressure from then on [Pa]; nan after an end."""
    return sorted(
        (float(note["at"]), float(note["pressure_Pa"]) if note["note"] == "set" else math.nan)
        for note in journal.notes if note["note"] in {"set", "end"}
    )  # fmt: skip


def figures(found: Analysis) -> dict[str, Any]:
    """Return the figures of an analysis for JSON, with units in the keys; None if not measured."""
    rows = [
        {key: finite_or_none(value) for key, value in row.items()}
        for row in found.characterisation.rows()
    ]
    aligned = found.alignment
    alignment = {
        "offset_s": aligned.offset,
        "reference_s": aligned.reference,
        "offset_error_s": aligned.offset_error,
        "rate": aligned.rate,
        "rate_error": finite_or_none(aligned.rate_error),
    }
    return {"isobars": rows, "alignment": alignment, "notes": list(found.characterisation.notes)}


def branches_csv(muscle: Characterisation) -> str:
    """Return both branches of every isobar over length as CSV in SI; empty cells if not measured."""
    lines = ["set_pressure_Pa,length_m,shortening_N,lengthening_N"]
    for bar in muscle.isobars:
        for row in zip(bar.length, bar.shortening, bar.lengthening, strict=True):
            cells = ("" if math.isnan(value) else f"{value:.8g}" for value in row)
            lines.append(f"{bar.set_pressure:.8g},{','.join(cells)}")
    return "\n".join(lines) + "\n"


def plot_characterisation(found: Analysis, system: str = "metric") -> Figure:
    """Plot both branches over contraction at every set pressure, and the pressure error over time.

    Args:
        found: analysis of a test.
        system: "si", "metric" or "us".

    Returns:
        A figure with two axes.

    Raises:
        InputError: the unit system is unknown.
    """
    units = unit_system(system)
    pressure_unit, force_unit = units["pressure"], units["force"]
    N, Pa = factor(force_unit, "force"), factor(pressure_unit, "pressure")
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    muscle, record = found.characterisation, found.record
    shades = np.linspace(0.15, 0.9, len(muscle.isobars))
    for shade, bar in zip(shades, muscle.isobars, strict=True):
        contraction = (muscle.rest_length - bar.length) / muscle.rest_length
        colour = (0.1, 0.25, float(shade))
        left.plot(contraction, bar.shortening / N, color=colour, lw=1.2)
        left.plot(contraction, bar.lengthening / N, color=colour, lw=1.2, ls="--")
        label = f"{bar.set_pressure / Pa:.4g}"
        left.annotate(label, (contraction[0], bar.lengthening[0] / N), fontsize=7)
    left.set(xlabel="contraction (L0 - L)/L0", ylabel=f"force [{force_unit}]")
    left.set_title(
        f"shortening (solid), lengthening (dashed); set pressure [{pressure_unit}]", fontsize=9
    )
    held = np.isfinite(record.set_pressure)
    step = max(1, int(held.sum()) // _MOST_POINTS)
    error = (record.pressure - record.set_pressure)[held][::step] / Pa
    right.plot(record.time[held][::step], error, lw=0.5, color=(0.1, 0.25, 0.5))
    strokes = [bar.largest_pressure_error for bar in muscle.isobars]
    largest = 1.5 * max(strokes) / Pa
    right.axhline(0, color="k", lw=0.5)
    right.set(xlabel="time [s]", ylabel=f"pressure - set pressure [{pressure_unit}]",
              ylim=(-largest, largest))  # fmt: skip
    right.set_title("pressure error (steps of the set pressure exceed the axis)", fontsize=9)
    return figure

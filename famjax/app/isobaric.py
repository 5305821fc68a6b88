"""Analyse constant-pressure tests: compute curves and key figures from the journal and machine log."""

import dataclasses
import math
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
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
    """Return the journal as columns, with one row per record.

    The minimum latency of the serial line is neglected.

    Args:
        record: journal, with the calibration of its sensors.

    Returns:
        Arrays of shape (n,): time on the host's clock, as in the notes (nan for a boot that lasted
        less than half a second); time on the device's clock; pressure and force, averaged over the
        ticks of a record; set pressure of the controller (nan if unknown); output [0..255] and
        integral [counts]; state and fault as indices into `STATES` and `FAULTS`; sync; block of the
        plan (-1 outside a block).

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
    """Fit the map from device time to host time for each epoch that has at least two clock notes."""
    columns = (record.epoch, record.column("boot"), record.column("tick"))
    rows = zip(*(column.tolist() for column in columns), strict=True)
    at = {
        (record.epoch_parts[epoch], boot, tick % TICKS): (epoch, tick) for epoch, boot, tick in rows
    }
    pairs = defaultdict[int, list[tuple[int, float]]](list)
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] == "clock" and (part, note["boot"], note["tick"]) in at:
            epoch, tick = at[part, note["boot"], note["tick"]]
            pairs[epoch].append((tick, note["arrival_s"]))
    every = {epoch: np.array(mine).T for epoch, mine in sorted(pairs.items()) if len(mine) > 1}
    return {
        epoch: fit_clock(ticks / TICK_HZ, arrivals) for epoch, (ticks, arrivals) in every.items()
    }


def _blocks(record: Record, time: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the block of the plan for each row; -1 outside a block."""
    blocks = np.full(len(time), -1)
    part_of_row = np.array(record.epoch_parts, np.int64)[record.epoch]
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] in {"block", "done", "end"}:
            after = (part_of_row == part) & (time >= note["at"])
            blocks[after] = note["block"] if note["note"] == "block" else -1
    return blocks


def convert(journal: str | Path, target: str | Path) -> Path:
    """Write the records in a journal as a CSV table, with the unit in each column name.

    Raises:
        RigError: the target does not end in .csv, or the journal cannot be read.
    """
    target = Path(target)
    if target.suffix != ".csv":
        raise RigError(f"the target must end in .csv, got {target.name!r}")
    pd.DataFrame(table(read_journal(journal))).to_csv(target, index=False)
    return target


_NEAR = 5.0  # s, largest error of a given clock offset
_STRETCH = 0.05  # largest stretch of a muscle, as a fraction of the rest length
_MOST_POINTS = 20_000  # points drawn of a pressure record


@dataclasses.dataclass(frozen=True)
class Analysis:
    """Results from the analysis of a test.

    Attributes:
        alignment: alignment of the machine's clock with the journal's.
        record: readings from the test, all on one clock.
        characterisation: curves and key figures.
        loads: gain of the load in the journal relative to that in the log, and residual scatter of the
            load relative to its range [-].
    """

    alignment: Alignment
    record: IsobaricRecord
    characterisation: Characterisation
    loads: tuple[float, float]


def analyse(
    journal: Record,
    log: MachineLog,
    *,
    rest_length: float,
    near: float | None = None,
    skip_cycles: int = 0,
    shortening_positive: bool = False,
    zero_displacement: float = 0.0,
    pushing_positive: bool = False,
    alignment: Alignment | None = None,
) -> Analysis:
    """Characterise a muscle from the journal and the machine log of one test.

    A device record is an average over its ticks. Its time is set to the middle of these ticks, which is
    half a record minus half a tick before the last tick.

    Args:
        journal: journal recorded by the rig.
        log: log from the testing machine.
        rest_length: L0 [m].
        near: approximate offset between the clocks [s], accurate to 5 s; None if unknown.
        skip_cycles: number of strokes to skip at the start of each pressure.
        shortening_positive: True if the machine's displacement increases as the muscle shortens.
        zero_displacement: displacement reading at L0 [m].
        pushing_positive: True if the machine's force is positive in compression.
        alignment: alignment of the clocks, if known; computed if None.

    Returns:
        Alignment, record and characterisation.

    Raises:
        RigError: the records are not from the same test, or contain no complete stroke.
    """
    if log.force is None:
        raise RigError(
            f"{log.source} must have a column with the force measured by the testing machine: export it too"
        )
    columns: Any = pd.DataFrame(table(journal))
    columns = columns[np.isfinite(columns.time_s)].copy()
    if len(columns) < 2:
        raise RigError(
            f"{journal.path} must contain clock notes: without them, its records have no time on the "
            "host's clock"
        )
    period = float(np.median(np.diff(columns.device_time_s)))
    columns["time_s"] -= (period - 1 / TICK_HZ) / 2
    latest = columns.time_s.cummax().shift(fill_value=-math.inf)
    columns = columns[columns.time_s > latest]
    time, force = columns.time_s.to_numpy(), columns.force_N.to_numpy()
    if alignment is None:
        errors = (clock.error for clock in clocks(journal).values())
        error = max((one for one in errors if math.isfinite(one)), default=0.0)
        load = -log.force if pushing_positive else log.force
        window = None if near is None else (near, _NEAR)
        try:
            alignment = align_by_load(time, force, log.time, load, near=window, time_error=error)
        except InputError as problem:
            covered = " and ".join(f"{np.ptp(one):.4g} s" for one in (time, log.time))
            raise InputError(
                f"{log.source}: {problem}. Check the force column in the log, its sign "
                f"(pushing_positive is {str(pushing_positive).lower()}), and the unit of time: the "
                f"journal and the log cover {covered}, respectively"
            ) from None
    record = combine(
        log, alignment, time, columns.pressure_Pa.to_numpy(), _set_pressures(journal),
        rest_length=rest_length,
        shortening_positive=shortening_positive, zero_displacement=zero_displacement,
        pushing_positive=pushing_positive,
    )  # fmt: skip
    over, under = record.length.max() - rest_length, rest_length - record.length.min()
    if over > max(under, _STRETCH * rest_length):
        raise InputError(
            f"{log.source}: a stroke must shorten the muscle, but with these settings the muscle "
            f"stretches from {record.length.min():.5g} to {record.length.max():.5g} m, with a rest length "
            f"of {rest_length:.5g} m. Set shortening_positive to {str(not shortening_positive).lower()}, "
            "or correct zero_displacement or the rest length"
        )
    curves = characterise(record, skip_cycles=skip_cycles)
    return Analysis(alignment, record, curves, _loads(time, force, record))


def _loads(time: np.ndarray, force: np.ndarray, record: IsobaricRecord) -> tuple[float, float]:
    """Fit the load in the journal to the load in the log; return the gain and the relative scatter."""
    ours = np.interp(record.time, time, force)
    gain, zero = np.polyfit(record.force, ours, 1)
    left = ours - gain * record.force - zero
    return float(gain), float(np.sqrt(np.mean(left**2)) / np.ptp(ours))


def _set_pressures(journal: Record) -> list[tuple[float, float]]:
    """Return times [s], each with the set pressure [Pa] from then on; nan after an end note."""
    return sorted(
        (float(note["at"]), float(note["pressure_Pa"]) if note["note"] == "set" else math.nan)
        for note in journal.notes if note["note"] in {"set", "end"}
    )  # fmt: skip


def figures(found: Analysis) -> dict[str, Any]:
    """Return the key figures of an analysis for JSON, with units in the keys; None if not measured."""
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


def plot_characterisation(found: Analysis, system: str = "metric") -> Figure:
    """Plot both branches against contraction at every set pressure, and the pressure error over time.

    Args:
        found: analysis of a test.
        system: "si", "metric" or "us".

    Returns:
        A figure with two axes.

    Raises:
        InputError: the unit system is unknown.
    """
    units = unit_system(system)
    N, Pa = (factor(units[kind], kind) for kind in ("force", "pressure"))
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    left, right = figure.subplots(1, 2)
    muscle, record = found.characterisation, found.record
    for shade, bar in zip(np.linspace(0.15, 0.9, len(muscle.isobars)), muscle.isobars, strict=True):
        contraction = 1 - bar.length / muscle.rest_length
        left.plot(contraction, bar.shortening / N, color=(0.1, 0.25, shade))
        left.plot(contraction, bar.lengthening / N, "--", color=(0.1, 0.25, shade))
        at = (contraction[0], bar.lengthening[0] / N)
        left.annotate(f"{bar.set_pressure / Pa:.4g}", at, fontsize=7)
    title = f"shortening (solid), lengthening (dashed); set pressure [{units['pressure']}]"
    left.set(xlabel="contraction (L0 - L)/L0", ylabel=f"force [{units['force']}]", title=title)
    held = np.flatnonzero(np.isfinite(record.set_pressure))
    held = held[:: max(1, held.size // _MOST_POINTS)]
    error = (record.pressure - record.set_pressure)[held] / Pa
    largest = 1.5 * max(bar.largest_pressure_error for bar in muscle.isobars) / Pa
    right.axhline(0, color="k", lw=0.5)
    right.plot(record.time[held], error, lw=0.5, color=(0.1, 0.25, 0.5))
    title = "pressure error (off scale at steps in the set pressure)"
    label = f"pressure - set pressure [{units['pressure']}]"
    right.set(xlabel="time [s]", ylabel=label, ylim=(-largest, largest), title=title)
    return figure

"""Photographs of a stroke and the machine's log to one table: campaign, clocks and files."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor
from famjax.boundary.units import finite_or_none
from fitting.records import MachineLog, SyncError, Synchronisation, synchronise
from imaging import ImagingError, Recipe, Table, process, write_recipe
from imaging.campaign import column_name

from .check_pictures import write_check_pictures
from .picture_files import expand

LOG_OF_PICTURES: dict[str, Any] = {
    "needed": ("time", "displacement"),
    "welcome": ("force", "pressure"),
}
"""What `read_machine_log` is to find where a log gives pictures their force."""
_NEAR = 10.0  # s, by which the offset of the clocks that was given may be wrong


@dataclasses.dataclass(frozen=True)
class CampaignOutcome:
    """The result of a campaign.

    Args:
        table: of the pictures.
        files: that were written.
        complete: whether every picture was measured, and the log, if there is one, was merged.
    """

    table: Table
    files: list[Path]
    complete: bool


def measure_pictures(
    photos: Sequence[str],
    *,
    recipe: Recipe,
    provenance: dict[str, str],
    log: MachineLog | None = None,
    log_offset: float | None = None,
    rest_length: float | None = None,
    executor: AnyExecutor | Literal["auto"] = "auto",
    system: str = "us",
    output: Path = Path("famjax-measure"),
    resume: bool = True,
    overlays: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> CampaignOutcome:
    """Measure the pictures; write table, recipe and check pictures.

    Args:
        photos: files, folders and globs.
        recipe: see `picture_recipe`.
        provenance: see `process`; the picture named as `ruler` in it is not measured.
        log: of the test machine, see `LOG_OF_PICTURES`.
        log_offset: what the machine's clock is ahead of the first picture [s], within 10 s.
        rest_length: [m]; the longest measured picture if None.
        executor: as of `process`.
        system: units of CSV and plots.
        output: folder, made if need be.
        resume: continue from the results in the folder.
        overlays: number of check pictures.
        progress: called with (pictures done, pictures).

    Raises:
        ImagingError: input that cannot be used.
    """
    paths = expand(photos, without=provenance.get("ruler"))
    table = process(
        paths,
        recipe,
        output,
        resume=resume,
        progress=progress,
        executor=executor,
        rest_length=rest_length,
        provenance=provenance,
    )
    merged = table if log is None else _merged(table, log, log_offset)
    try:
        files = [
            merged.write_csv(output / "measurements.csv", system),
            merged.write_netcdf(output / "measurements.nc"),
            write_recipe(recipe, output / "recipe.toml"),
            *write_check_pictures(merged, recipe, output, overlays, system),
        ]
    except OSError as error:
        raise ImagingError(f"a file cannot be written: {error}", path=output) from None
    complete = bool(table.ok.all()) and (log is None or "log_time" in merged.columns)
    return CampaignOutcome(merged, files, complete)


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


def _merged(table: Table, machine: MachineLog, guess: float | None) -> Table:
    """The table with the log, or a note why the clocks could not be brought together."""
    try:
        clock = camera_clock(table, machine, guess)
    except SyncError as error:
        note = f"There is no force: SyncError: {error}"
        return dataclasses.replace(table, notes=(*table.notes, note))
    return with_log(table, machine, clock)


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


def as_document(outcome: CampaignOutcome, system: str) -> dict[str, Any]:
    """For JSON: what is not known is null."""
    table = outcome.table
    columns = {column_name(name, system): table.in_units(name, system) for name in table.columns}
    return {
        "pictures": len(table),
        "ok": int(table.ok.sum()),
        "complete": outcome.complete,
        "notes": list(table.notes),
        "files": [str(path) for path in outcome.files],
        "rows": [
            {
                "path": path,
                "ok": not table.error[k],
                "error": table.error[k],
                "warnings": table.warnings[k] if table.warnings else "",
            }
            | {name: finite_or_none(values[k]) for name, values in columns.items()}
            for k, path in enumerate(table.path)
        ],
    }

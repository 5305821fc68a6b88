"""What `famjax measure` does besides parsing: campaign, clocks and files."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from famjax.boundary.units import parse_quantity
from imaging.campaign.check_pictures import write_check_pictures
from imaging.campaign.columns import column_name
from imaging.campaign.machine_log import MachineLog, read_machine_log
from imaging.campaign.run import process
from imaging.campaign.sync import synchronise
from imaging.campaign.table import Table
from imaging.errors import ImagingError, SyncError
from imaging.recipe import Recipe
from imaging.shape.recipe_file import write_recipe

from .measure_options import expand

_NEAR = 10.0  # s, by which the offset of the clocks that was given may be wrong


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What a campaign has come to.

    Args:
        table: of the pictures.
        files: that were written.
        complete: whether every picture was measured, and the log, if there is one, was merged.
    """

    table: Table
    files: list[Path]
    complete: bool


def measure_command(
    photos: Sequence[str],
    *,
    recipe: Recipe,
    provenance: dict[str, str],
    log: Path | None = None,
    log_offset: str | None = None,
    rest_length: str | None = None,
    workers: int | None = None,
    system: str = "us",
    output: Path = Path("famjax-measure"),
    resume: bool = True,
    overlays: int = 12,
    progress: Callable[[int, int], None] | None = None,
) -> Outcome:
    """Measure the pictures and write table, recipe and the pictures for people to check.

    Args:
        photos: files, folders and globs.
        recipe: see `command_recipe`.
        provenance: see `process`; the picture named as `ruler` in it is not measured.
        log: of the test machine.
        log_offset: what the machine's clock is ahead of the first picture, `12s`, within 10 s.
        rest_length: `9.28in`; the longest measured picture if None.
        workers: number of processes.
        system: units of CSV and plots.
        output: folder, made if need be.
        resume: go on with what is there.
        overlays: number of pictures drawn for people to check.
        progress: called with (pictures done, pictures).

    Raises:
        ImagingError: input that cannot be used.
    """
    paths = expand(photos, without=provenance.get("ruler"))
    machine = None if log is None else read_machine_log(log)
    guess = None if log_offset is None else parse_quantity(log_offset, "time")
    table = process(
        paths,
        recipe,
        output,
        resume=resume,
        progress=progress,
        workers=workers,
        rest_length=None if rest_length is None else parse_quantity(rest_length, "length"),
        provenance=provenance,
    )
    merged = table if machine is None else _merged(table, machine, guess)
    try:
        files = [
            merged.write_csv(output / "measurements.csv", system),
            merged.write_netcdf(output / "measurements.nc"),
            write_recipe(recipe, output / "recipe.toml"),
            *write_check_pictures(merged, recipe, output, overlays, system),
        ]
    except OSError as error:
        raise ImagingError(f"a file cannot be written: {error}", path=output) from None
    complete = bool(table.ok.all()) and (machine is None or "log_time" in merged.columns)
    return Outcome(merged, files, complete)


def _merged(table: Table, machine: MachineLog, guess: float | None) -> Table:
    """The table with the log, or a note why the clocks could not be brought together."""
    # Of the errors of length that of the scale does not count, which is common to all.
    known = np.nan_to_num(table["contraction_stderr"]) * table.rest_length
    stderr = float(np.median(known[table.ok])) if table.ok.any() else 0.0
    near = {} if guess is None else {"window": _NEAR, "guess": guess}
    try:
        clock = synchronise(table["time"], table["length"], machine, length_stderr=stderr, **near)
    except SyncError as error:
        note = f"There is no force: SyncError: {error}"
        return dataclasses.replace(table, notes=(*table.notes, note))
    return table.with_log(machine, clock)


def as_document(outcome: Outcome, system: str) -> dict[str, Any]:
    """For JSON: what is not known is null."""
    table = outcome.table
    names = {name: column_name(name, system) for name in table.columns}
    return {
        "pictures": len(table),
        "ok": int(table.ok.sum()),
        "complete": outcome.complete,
        "notes": list(table.notes),
        "files": [str(path) for path in outcome.files],
        "rows": [
            {"path": path, "ok": not table.error[k], "error": table.error[k]}
            | {
                shown: None
                if math.isnan(value := table.in_units(name, system)[k])
                else float(value)
                for name, shown in names.items()
            }
            for k, path in enumerate(table.path)
        ],
    }

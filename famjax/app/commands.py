"""Commands that use several packages: `measure` with a log, rig tests and characterisation folders."""

import dataclasses
import functools
import json
import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import imaging.cli
from famjax.boundary.errors import InputError
from famjax.boundary.files import check_output
from famjax.boundary.units import sentence_in_units, unit_system
from famjax.compilation_cache import start_jax
from famjax.console import (
    Jobs,
    Seed,
    Units,
    in_units,
    print_json,
    print_rows,
    progress,
    tell_columns,
)
from rig.cli import ended_in_words

if TYPE_CHECKING:
    from famjax import AbstractMuscle
    from imaging.cli import AddLog


@functools.wraps(imaging.cli.measure)
def measure(*photos: str, **options: Any) -> int:
    """Run `imaging.cli.measure` with a reader for machine logs."""

    def read_log(path: Path, *, offset: float | None, **how: Any) -> "AddLog":
        from .photographs import add_log, read_log_of_pictures

        machine = read_log_of_pictures(path, **how)
        tell_columns(machine.taken)
        return add_log(machine, offset)

    return imaging.cli.measure(*photos, **options, read_log=read_log)


def new(folder: Path) -> int:
    """Create a characterisation folder with a commented sheet for you to fill in.

    Fill in the sheet `characterisation.toml`, copy the journal, machine log, pictures and ruler
    photograph into the folder, and run `famjax characterise FOLDER`.

    Parameters
    ----------
    folder
        Folder to create. An existing folder must not contain a sheet.
    """
    from .folder import SHEET

    check_output(folder)
    path = folder / SHEET
    if path.exists():
        raise InputError(f"{path} already exists: edit it, or choose another folder")
    folder.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(Path(__file__).parent / "templates" / SHEET, path)
    print(
        f"written: {path}; fill it in, add your data files, and run: famjax characterise {folder}"
    )
    return 0


def characterise(
    folder: Path,
    *,
    jobs: Jobs = None,
    units: Units | None = None,
) -> int:
    """Evaluate a characterisation folder: process forces and pictures, fit geometries, write a report.

    The sheet `characterisation.toml` describes the files in the folder; `famjax new` creates one. A
    completed step is skipped unless its files or options have changed, so you can resume an interrupted
    run. Up to five geometries are fitted.

    Each step has its own folder in `FOLDER/results`. The report is `report/report.html`, with its figures
    as SVG in `report/figures` and its numbers as CSV in `report/tables`. Cross-checks compare two
    measurements of the same quantity, such as the length in the pictures and the displacement of the
    testing machine. The run stops if two measurements contradict each other. Doubtful values, missing
    values and pictures that could not be measured are printed and listed in the report.

    Parameters
    ----------
    folder
        Folder with a `characterisation.toml`.
    jobs
        Set the number of processes that measure pictures; default: one per core.
    units
        Choose the units for tables and figures: si, metric or us; default: the system set in [units] in
        the sheet, or metric.
    """
    start_jax()

    from .evaluation import evaluate
    from .folder import read_sheet

    sheet = read_sheet(folder)
    sheet = dataclasses.replace(sheet, units=units or sheet.units)
    tell = functools.partial(print, file=sys.stderr, flush=True)
    for said in evaluate(sheet, executor="auto" if jobs is None else jobs, tell=tell):
        tell(said)
    print("written:", sheet.results / "report" / "report.html")
    return 0


def rig_simulate(
    plan: Path,
    *,
    fit: Path | None = None,
    seed: Seed = 0,
    output: Path = Path("famjax-rig"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Run a test on a simulated rig, much faster than real time.

    Simulates the device, serial line, recorder and testing machine with noise and clock errors. The
    recorded files are then read back and analysed as if they came from a real test. Writes `test.fam`
    (journal), `machine.csv` (machine log), `dataset.csv` (for `famjax fit`), `characterisation.json` and
    `characterisation.png`.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; it must set a pressure limit.
    fit
        Simulate the muscle in this `fit.json`; default: the 7/8 in muscle from the reference work.
    seed
        Set the seed for all noise; the same seed produces the same files.
    output
        Write the files to this folder; it is created if missing and must not contain a journal.
    units
        Choose the units for the figure and the table: si, metric or us.
    json_
        Print one JSON object on standard output, and nothing else.
    """
    start_jax()
    from rig import read_plan

    from .isobaric import figures, plot_characterisation
    from .simulation import simulate

    with ended_in_words():
        test = read_plan(plan)
        muscle, known = _simulated_muscle(fit)
        with progress("simulating") as show:
            done = simulate(test, output, muscle=muscle, specimen=known, seed=seed, progress=show)
    found, picture = done.analysis, output / "characterisation.png"
    document, numbers = figures(found), output / "characterisation.json"
    plot_characterisation(found, units).savefig(picture, dpi=150)
    numbers.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    paths = [str(path) for path in (*done.paths, numbers, picture)]
    if json_:
        print_json(document | {"files": paths})
        return 0
    print_rows(f"Isobars of {known['name']}", in_units(document["isobars"], unit_system(units)))
    print(found.alignment)
    for note in found.characterisation.notes:
        print("note:", sentence_in_units(note, units))
    print("written:", ", ".join(paths))
    return 0


def rig_convert(journal: Path, target: Path) -> int:
    """Convert the records in a journal to a CSV file with units; the journal itself is not changed.

    Parameters
    ----------
    journal
        Journal to convert.
    target
        File to write, ending in .csv.
    """
    from .isobaric import convert

    with ended_in_words():
        print("written:", convert(journal, target))
    return 0


def _simulated_muscle(fit: Path | None) -> tuple["AbstractMuscle", dict[str, Any]]:
    """Return the muscle from a fit, or the reference work's muscle, with its specimen entries."""
    from .simulation import reference_muscle

    if fit is None:
        return reference_muscle(), {
            "name": "7/8 in, simulated", "wall_thickness_in": 0.0625, "bladder_diameter_in": 0.875,
            "braid_thickness_in": 0.011, "nominal_diameter_in": 0.875,
        }  # fmt: skip
    from fitting.saved import card_of, load_fit

    saved = load_fit(fit)
    specimen = saved.document["data"]["specimen"]
    return card_of(saved, count=0).safe(), {  # a slack muscle does not push
        key: value for key, value in specimen.items()
        if value is not None and not key.startswith("rest_length")
    }  # fmt: skip

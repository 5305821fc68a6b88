"""Commands that join packages: photographs with a log, a rig's tests, a characterisation folder."""

import functools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import imaging.cli
from famjax.boundary.units import parse_quantity
from famjax.compilation_cache import start_jax
from famjax.console import (
    Jobs,
    Seed,
    Units,
    add_cwd_to_path,
    parse_entries,
    print_json,
    print_rows,
    progress,
)
from rig.cli import ended_in_words

if TYPE_CHECKING:
    from famjax import AbstractMuscle
    from imaging.cli import AddLog

    from .isobaric import Analysis


@functools.wraps(imaging.cli.measure)
def measure(*photos: str, **options: Any) -> int:
    """The command of `imaging`, with a reader of logs."""

    def read_log(path: Path, *, offset: float | None, **how: Any) -> "AddLog":
        from .photographs import add_log, read_log_of_pictures

        return add_log(read_log_of_pictures(path, **how), offset)

    return imaging.cli.measure(*photos, **options, read_log=read_log)


def new(folder: Path) -> int:
    """Write the sheet of a new characterisation folder, with a comment on every entry.

    Fill in `characterisation.toml`, lay journal, log, pictures and ruler beside it, and run
    `famjax characterise FOLDER`.

    Parameters
    ----------
    folder
        Folder; created if missing. It must not have a sheet yet.
    """
    from famjax.boundary.errors import InputError
    from famjax.boundary.files import check_output

    from .folder import SHEET, skeleton

    check_output(folder)
    path = folder / SHEET
    if path.exists():
        raise InputError(f"{path} is there already: edit it, or give another folder")
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(skeleton(), encoding="utf-8")
    print(
        f"written: {path}; fill it in, lay the files beside it, then: famjax characterise {folder}"
    )
    return 0


def characterise(
    folder: Path,
    *,
    only: tuple[str, ...] = (),
    force: tuple[str, ...] = (),
    jobs: Jobs = None,
    units: Units | None = None,
) -> int:
    """Evaluate a characterisation folder: force, pictures, shape, fits of four geometries, report.

    `characterisation.toml` describes the folder; `famjax new` writes one. A step that was done with
    the same files and options is not done again, and stopped work goes on.

    Writes into `FOLDER/results`, a folder for each step, and `report/report.html`. What two sources
    say of one thing is compared, such as the length in the pictures and the machine's displacement:
    where they contradict each other the work stops, and what is doubtful or not known is said here
    and in the report, as are pictures that could not be measured. The report's figures are in
    `report/figures` as SVG, its numbers in `report/tables` as CSV.

    Parameters
    ----------
    folder
        With a `characterisation.toml`.
    only
        Steps to carry out, repeatable: records, pictures, shape, cylinder, elastic-cylinder,
        average-diameter, measured, virtual-work, report.
    force
        Steps to carry out again, repeatable.
    jobs
        Set the number of processes that measure the pictures; default: one for each core.
    units
        Choose the units of tables and pictures: si, metric or us; default: those of [units] in the
        sheet, or metric.
    """
    start_jax()
    from famjax.boundary.files import Origin

    from .evaluation import evaluation_steps
    from .folder import RESULTS, read_sheet, run_steps
    from .report.page import first_run, report_step

    sheet = read_sheet(folder)
    results, system = folder / RESULTS, units or sheet.units
    results.mkdir(exist_ok=True)
    origin = first_run(results, Origin.of_this_command())
    steps = evaluation_steps(
        sheet, executor="auto" if jobs is None else jobs, origin=origin, system=system
    )
    steps.append(report_step(sheet, steps, origin=origin, system=system))
    run_steps(
        steps, results, only=only, force=force,
        tell=lambda text: print(text, file=sys.stderr, flush=True),
    )  # fmt: skip
    report = results / "report" / "report.html"
    if report.exists():
        print("written:", report)
    return 0


def rig_simulate(
    plan: Path,
    *,
    fit: Path | None = None,
    own: tuple[str, ...] = (),
    baud: Literal[115200, 500000] = 115200,
    seed: Seed = 0,
    output: Path = Path("famjax-rig"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Carry out the same test against a simulated rig, far faster than real time.

    Device, serial line, recorder and test machine are simulated with their noise and clocks; what
    they write is read back and analysed as a real test's is. Writes `test.fam` (journal),
    `machine.csv` (the machine's log), `dataset.csv` (for `famjax fit`), `characterisation.json` and
    `characterisation.png`.

    Parameters
    ----------
    plan
        TOML file with the tables [plan] and [rig]; a pressure limit is needed.
    fit
        A `fit.json` of the muscle; the reference work's 7/8 in muscle unless given.
    own
        A module that you trust, repeatable, with the classes of your own of which the fit's muscle is
        made: `--own my_rubber`. Without it no module is imported that a file names.
    baud
        Of the firmware.
    seed
        Of all noise; the same seed gives the same files.
    output
        Write the files to this folder; it is created if missing and must not hold a journal.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    start_jax()
    from rig import read_plan

    from .simulation import simulate

    with ended_in_words():
        test = read_plan(plan)
        muscle, specimen = _simulated_muscle(fit, own)
        with progress("simulating") as show:
            done = simulate(
                test, output, muscle=muscle, specimen=specimen, baud=baud, seed=seed, progress=show
            )
        return _report_test(done.analysis, [*done.paths], output, units, json_)


def rig_characterise(
    journal: Path,
    log: Path,
    *,
    rest_length: str,
    log_columns: tuple[str, ...] = (),
    log_units: tuple[str, ...] = (),
    log_decimal: Literal[".", ","] | None = None,
    sync_column: str | None = None,
    near: str | None = None,
    near_within: str = "5s",
    skip_cycles: int = 0,
    shortening_positive: bool = False,
    pushing_positive: bool = False,
    zero_displacement: str = "0mm",
    specimen: tuple[str, ...] = (),
    output: Path = Path("famjax-rig"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Turn a test's journal and the test machine's log into curves, figures and a dataset to fit.

    Writes `dataset.csv`, `characterisation.json` and `characterisation.png`.

    Parameters
    ----------
    journal
        The rig's journal.
    log
        The machine's log: any delimited text with time, displacement and force with their units.
    rest_length
        Active length at zero contraction with its unit, `9.28125in`.
    log_columns
        Column of the log where its names do not tell, by its name or its number from 1,
        `force="Load 2"`, repeatable: time, displacement, force.
    log_units
        Unit of a column in place of the log's, `force=kN`, repeatable.
    log_decimal
        The log's decimal sign where the numbers do not tell.
    sync_column
        Column of the log with the rig's sync pulses (`run` raises pin D7 at each pressure's first
        stroke); without it the load aligns the clocks.
    near
        Approximate offset from the machine's time to the journal's, with its unit; needed where
        equal strokes leave it ambiguous.
    near_within
        Largest error of that offset.
    skip_cycles
        First strokes at each pressure that are left out.
    shortening_positive
        The machine's displacement grows as the muscle shortens.
    pushing_positive
        The machine's force is positive in compression.
    zero_displacement
        What the machine shows at the rest length.
    specimen
        Describe the muscle for the fit, key_unit=value, repeatable.
    output
        Write the files to this folder; it is created if missing.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from fitting.records import read_machine_log, write_dataset
    from rig import read_journal

    from .isobaric import analyse

    with ended_in_words():
        entries = parse_entries(specimen, "specimen", "wall_thickness_mm=1.6")
        rest, zero = (
            parse_quantity(rest_length, "length"),
            parse_quantity(zero_displacement, "length"),
        )
        roughly = near and (parse_quantity(near, "time"), parse_quantity(near_within, "time"))
        found = analyse(
            read_journal(journal),
            read_machine_log(
                log,
                columns=parse_entries(log_columns, "log-columns", 'force="Load 2"'),
                units=parse_entries(log_units, "log-units", "force=kN"),
                decimal=log_decimal,
            ),
            rest_length=rest,
            sync_column=sync_column,
            near=roughly or None,
            skip_cycles=skip_cycles,
            shortening_positive=shortening_positive,
            pushing_positive=pushing_positive,
            zero_displacement=zero,
        )
        output.mkdir(parents=True, exist_ok=True)
        path = write_dataset(found.characterisation, output / "dataset.csv", specimen=entries)
        return _report_test(found, [path], output, units, json_)


def rig_convert(journal: Path, target: Path) -> int:
    """Write a journal's records as a table with units; the journal stays the record.

    Parameters
    ----------
    journal
        The journal.
    target
        File to write, .csv.
    """
    from .isobaric import convert

    with ended_in_words():
        print("written:", convert(journal, target))
    return 0


def _report_test(
    found: "Analysis", paths: list[Path], output: Path, units: str, json_: bool
) -> int:
    """Write figures and picture of a test, and print its table."""
    from .isobaric import figures, plot_characterisation, table_rows

    document = figures(found)
    picture, numbers = output / "characterisation.png", output / "characterisation.json"
    plot_characterisation(found, units).savefig(picture, dpi=150)
    numbers.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    paths = [*(path for path in paths if path != numbers), numbers, picture]
    if json_:
        print_json(document | {"files": [str(p) for p in paths]})
        return 0
    print_rows("Isobars", table_rows(found.characterisation, units))
    print(found.alignment)
    for note in found.characterisation.notes:
        print("note:", note)
    print("written:", ", ".join(map(str, paths)))
    return 0


def _simulated_muscle(
    fit_json: Path | None, own: Sequence[str]
) -> tuple["AbstractMuscle", dict[str, Any]]:
    """The muscle of a fit, or the reference work's, and its entries in a dataset."""
    from famjax import Muscle
    from famjax.muscle import MeanMuscle

    from .simulation import reference_muscle

    if fit_json is None:
        muscle, others = reference_muscle(), ()
        known = {"name": "7/8 in, simulated", "wall_thickness_in": 0.0625, "bladder_diameter_in": 0.875,
                 "braid_thickness_in": 0.011, "nominal_diameter_in": 0.875}  # fmt: skip
    else:
        from fitting import load_fit

        if own:
            add_cwd_to_path()
        saved = load_fit(fit_json, own=own)
        muscle = saved.muscle
        others = tuple(one.muscle for one in saved.outlook.others if isinstance(one.muscle, Muscle))
        specimen = saved.document["data"]["specimen"]
        known = {key: value for key, value in specimen.items() if not key.startswith("rest_length")}
        known = {key: value for key, value in known.items() if value is not None}
    # A chosen model may be the mean of several.
    return MeanMuscle((muscle, *others)) if others else muscle, known

"""Commands of `famjax rig` that need the muscle or the records; its others are in `rig_cli`."""

import json
from pathlib import Path
from typing import Literal

from ..boundary.units import parse_quantity
from .loading import load_fitting
from .options.entries import parse_entries
from .options.whole_numbers import Seed
from .rig_cli import ended_in_words
from .terminal import print_rows, progress


def rig_simulate(
    plan: Path,
    *,
    fit: Path | None = None,
    baud: Literal[115200, 500000] = 115200,
    seed: Seed = 0,
    output: Path = Path("famjax-rig"),
    units: Literal["si", "metric", "us"] = "us",
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
    baud
        Of the firmware.
    seed
        Of all noise; the same seed gives the same files.
    output
        Folder for the files, made if need be; must not hold a journal.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.chain import simulate
    from rig import read_plan

    with ended_in_words():
        test = read_plan(plan)
        muscle, specimen = _simulated_muscle(fit)
        with progress("simulating") as show:
            done = simulate(
                test, output, muscle=muscle, specimen=specimen, baud=baud, seed=seed, progress=show
            )
        return report_test(done.analysis, [*done.paths], output, units, json_)


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
    units: Literal["si", "metric", "us"] = "us",
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
        Folder for the files, made if need be.
    units
        Of the picture and the table: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from famjax.chain import analyse
    from fitting.records import read_machine_log, write_dataset
    from rig import read_journal

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
        return report_test(found, [path], output, units, json_)


def rig_convert(journal: Path, target: Path) -> int:
    """Write a journal's records as a table with units; the journal stays the record.

    Parameters
    ----------
    journal
        The journal.
    target
        File to write: .nc (NetCDF) or .csv.
    """
    from famjax.chain.journals import convert

    with ended_in_words():
        print("written:", convert(journal, target))
    return 0


def report_test(found, paths: list[Path], output: Path, units: str, json_: bool) -> int:
    """Write figures and picture of a test, and print its table."""
    from famjax.chain import figures, plot_characterisation, table_rows

    document = figures(found)
    picture, numbers = output / "characterisation.png", output / "characterisation.json"
    plot_characterisation(found, units).savefig(picture, dpi=150)
    numbers.write_text(json.dumps(document, indent=1, allow_nan=False) + "\n", encoding="utf-8")
    paths = [*(path for path in paths if path != numbers), numbers, picture]
    if json_:
        print(json.dumps(document | {"files": [str(p) for p in paths]}, allow_nan=False))
        return 0
    print_rows("Isobars", table_rows(found.characterisation, units))
    print(found.alignment)
    for note in found.characterisation.notes:
        print("note:", note)
    print("written:", ", ".join(map(str, paths)))
    return 0


def _simulated_muscle(fit_json: Path | None):
    """A famjax muscle, tabulated for the rig, and its entries in a dataset."""
    from famjax.chain import reference_muscle, simulated_muscle

    if fit_json is None:
        muscle, others = reference_muscle(), ()
        known = {"name": "7/8 in, simulated", "wall_thickness_in": 0.0625, "bladder_diameter_in": 0.875,
                 "braid_thickness_in": 0.011, "nominal_diameter_in": 0.875}  # fmt: skip
    else:
        saved = load_fitting().load_fit(fit_json)
        muscle, others = saved.muscle, tuple(one.muscle for one in saved.others)
        specimen = saved.document["data"]["specimen"]
        known = {key: value for key, value in specimen.items() if not key.startswith("rest_length")}
        known = {key: value for key, value in known.items() if value is not None}
    members = (muscle, *others)  # a chosen model may be the mean of several
    low = max(float(one.geometry.length_range()[0]) for one in members)
    return simulated_muscle(members, shortest=low), known

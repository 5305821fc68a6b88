"""From a journal and a machine's log to curves, figures and a dataset."""

import json
from pathlib import Path
from typing import Literal

from ...boundary.units import parse_quantity
from ..options.entries import parse_entries
from ..terminal import print_rows
from .problems import rig_problems


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

    with rig_problems():
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

"""`famjax new` and `famjax characterise`: a characterisation folder end to end."""

import sys
from pathlib import Path
from typing import Literal

from .lean_imports import load_matplotlib, load_scipy
from .loading import load_fitting
from .options.engine import UNNAMED, EngineOptions


def new(folder: Path) -> int:
    """Write the sheet of a new characterisation folder, with a comment on every entry.

    Fill in `characterisation.toml`, lay journal, log, pictures and ruler beside it, and run
    `famjax characterise FOLDER`.

    Parameters
    ----------
    folder
        Made if need be; must not have a sheet yet.
    """
    from famjax.boundary.errors import InputError
    from famjax.boundary.files import check_output
    from famjax.chain.folder import SHEET, SKELETON

    check_output(folder)
    path = folder / SHEET
    if path.exists():
        raise InputError(f"{path} is there already: edit it, or give another folder")
    folder.mkdir(parents=True, exist_ok=True)
    path.write_text(SKELETON, encoding="utf-8")
    print(
        f"written: {path}; fill it in, lay the files beside it, then: famjax characterise {folder}"
    )
    return 0


def characterise(
    folder: Path,
    *,
    only: tuple[str, ...] = (),
    force: tuple[str, ...] = (),
    engine: EngineOptions = UNNAMED,
    units: Literal["si", "metric", "us"] = "us",
) -> int:
    """Evaluate a characterisation folder: force, pictures, shape, fits of four geometries, report.

    What lies in the folder says its `characterisation.toml`; `famjax new` writes one. A step that
    was done with the same files and options is not done again, and stopped work goes on.

    Writes into `FOLDER/results`, a folder for each step, and `report/report.html`. What two sources
    say of one thing is compared, such as the length in the pictures and the machine's displacement:
    where they contradict each other the work stops, and what is doubtful or not known is said here
    and in the report, as are pictures that could not be measured. The report's figures are in
    `report/figures` as SVG, PDF and CSV.

    Parameters
    ----------
    folder
        With a `characterisation.toml`.
    only
        Steps to carry out, repeatable: records, pictures, shape, cylinder, elastic-cylinder,
        average-diameter, measured, virtual-work, report.
    force
        Steps to carry out again, repeatable.
    engine
        Where the pictures are measured; one process for each core unless given.
    units
        Of tables and pictures: si, metric or us.
    """
    load_fitting()
    load_scipy()
    load_matplotlib()
    from famjax.boundary.origin import Origin
    from famjax.chain.folder import (
        RESULTS,
        evaluation_steps,
        first_run,
        read_sheet,
        report_step,
        run_steps,
    )

    sheet = read_sheet(folder)
    results = folder / RESULTS
    results.mkdir(exist_ok=True)
    origin = first_run(results, Origin.of_this_command())
    with engine.executor("auto") as executor:
        steps = evaluation_steps(sheet, executor=executor, origin=origin, system=units)
        steps.append(report_step(sheet, steps, origin=origin, system=units))
        run_steps(
            steps, results, only=only, force=force,
            tell=lambda text: print(text, file=sys.stderr, flush=True),
        )  # fmt: skip
    report = results / "report" / "report.html"
    if report.exists():
        print("written:", report)
    return 0

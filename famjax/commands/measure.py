"""`famjax measure`."""

import json
import os
import re
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter

from .lean_imports import load_matplotlib, load_scipy
from .options.engine import UNNAMED, EngineOptions
from .options.entries import parse_entries
from .options.recipe import RecipeOptions
from .terminal import print_rows, progress

_UNSAID = RecipeOptions()
_SHOWN = 20  # pictures on the console


def measure(
    *photos: str,
    how: RecipeOptions = _UNSAID,
    log: Path | None = None,
    log_offset: str | None = None,
    log_columns: tuple[str, ...] = (),
    log_units: tuple[str, ...] = (),
    log_decimal: Literal[".", ","] | None = None,
    rest_length: str | None = None,
    engine: EngineOptions = UNNAMED,
    units: Literal["si", "metric", "us"] = "us",
    output: Path = Path("famjax-measure"),
    resume: Annotated[bool, Parameter(negative="--no-resume")] = True,
    overlays: int = 12,
    json_: bool = False,
) -> int:
    """Measure the shape of a muscle in photographs, each picture with its errors.

    Writes `measurements.csv` (one row per picture), `measurements.nc` (with the profiles),
    `recipe.toml` (all choices), `contact_sheet.png`, `profiles.png` and `overlays/`. A stopped
    campaign goes on when it is run again. Exit code 3 when some pictures could not be measured, or
    not be matched to the log: they are in the table with the reason.

    Parameters
    ----------
    photos
        Files, folders and patterns such as `'stroke/*.jpg'`, all pictures of one size.
    how
        How to measure.
    log
        Of the test machine, CSV with columns such as `time_s,displacement_in,force_lbf,
        pressure_psi`: each picture gets force and pressure; the clocks are matched by the motion.
    log_offset
        What the machine's clock is ahead of the first picture, `12s`, within 10 s; needed where the
        motion repeats itself.
    log_columns
        Column of the log where its names do not tell, by its name or its number from 1,
        `force="Load 2"`, repeatable: time, displacement, force, pressure.
    log_units
        Unit of a column in place of the log's, `force=kN`, repeatable.
    log_decimal
        The log's decimal sign where the numbers do not tell.
    rest_length
        Against which contraction is counted, `9.28in`; the longest measured picture unless given.
    engine
        Where the pictures are measured; unless given one process for each core, and none for up to
        four pictures.
    units
        Of CSV, plots and output: us (in, lbf, psi), metric (mm, N, kPa) or si.
    output
        Folder for the files, made if need be.
    resume
        Go on with what is in the folder, or measure all again.
    overlays
        Number of pictures drawn with what was found in them, for a check by eye.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    # Idle threads of OpenBLAS spin, and its matrices here are small; NumPy reads this when it loads.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    load_scipy()
    load_matplotlib()
    from famjax.chain import LOG_OF_PICTURES, as_document, expand, measure_pictures
    from fitting.records import read_machine_log
    from imaging import ImagingError

    from ..boundary.errors import InputError
    from ..boundary.units import parse_quantity
    from .options.photographs import command_recipe, set_up

    measured: list[int] = []
    try:
        with progress("measuring") as show, engine.executor("auto") as executor:

            def count(done: int, total: int) -> None:
                measured.append(done)
                show(done, total)

            expand(photos)  # a picture that is not there is said before what its recipe lacks
            recipe, provenance = command_recipe(how)
            setting = set_up(recipe, how, units == "us")
            provenance["set_up"] = "; ".join(
                f"{row['what']}: {row['value']} ({row['source']})" for row in setting
            )
            machine = None
            if log is not None:
                machine = read_machine_log(
                    log, columns=parse_entries(log_columns, "log-columns", 'force="Load 2"'),
                    units=parse_entries(log_units, "log-units", "force=kN"), decimal=log_decimal,
                    **LOG_OF_PICTURES,
                )  # fmt: skip
            outcome = measure_pictures(
                photos,
                recipe=recipe,
                provenance=provenance,
                log=machine,
                log_offset=None if log_offset is None else parse_quantity(log_offset, "time"),
                rest_length=None if rest_length is None else parse_quantity(rest_length, "length"),
                executor=executor,
                system=units,
                output=output,
                resume=resume,
                overlays=overlays,
                progress=count,
            )
    except InputError as error:
        # What a picture was refused for has a name, which the documentation explains.
        named = type(error) not in (InputError, ImagingError)
        print(f"famjax: {type(error).__name__ + ': ' if named else ''}{error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        done = f"{measured[-1]} measured pictures are" if measured else "what was measured is"
        print(
            f"famjax: stopped; {done} kept in {output}. Run the same command again to go on",
            file=sys.stderr,
        )
        return 130
    document = as_document(outcome, units)
    if "frame_size" in provenance:
        document["notes"].append(f"The camera's frame is {provenance['frame_size']}.")
    document["set_up"] = setting
    if json_:
        print(json.dumps(document, allow_nan=False))
    else:
        print_rows("set-up", setting)
        _print_figures([row for row in document["rows"] if row["ok"]])
        failed = [row for row in document["rows"] if not row["ok"]]
        print(f"{document['ok']} of {document['pictures']} pictures measured")
        shown = [{key: row[key] for key in ("path", "error")} for row in failed[:20]]
        if failed:
            print_rows(f"{len(shown)} of {len(failed)} that failed", shown)
        for note in document["notes"]:
            print(f"note: {note}")
        print("written:", ", ".join(document["files"]))
    return 0 if outcome.complete else 3


def _print_figures(rows: list[dict[str, Any]]) -> None:
    """Length, diameter and distance of the first pictures, with their standard errors."""
    shown = []
    for row in rows[:_SHOWN]:
        figures: dict[str, Any] = {"path": row["path"]}
        for name in ("length", "mean_diameter", "distance"):
            key = next(key for key in row if re.fullmatch(rf"{name}_(in|mm|m)", key))
            figures[key] = f"{row[key]:.5g} +- {row[key.replace(name, f'{name}_stderr')]:.2g}"
        shown.append(figures | {"warned": "yes" if row["warnings"] else ""})
    if shown:
        print_rows(f"{len(shown)} of {len(rows)} measured, with standard errors", shown)

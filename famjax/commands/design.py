"""`famjax design`."""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .loading import load_fitting
from .terminal import Output, print_rows

_SHOWN = 10  # rows of a front on the terminal; all are in the file


def design(
    require: tuple[str, ...] = ("pressure_psi=100",),
    *,
    catalogue: tuple[Path, ...] = (),
    bundled: Annotated[bool, Parameter(negative="--no-bundled")] = True,
    search: float = 2e4,
    objective: tuple[str, ...] = (),
    vary: tuple[str, ...] = (),
    end_fittings: Annotated[bool, Parameter(negative="--no-end-fittings")] = True,
    output: Path = Path("famjax-design"),
    units: Literal["si", "metric", "us"] = "us",
    json_: bool = False,
) -> int:
    """Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement.

    Writes `design.json` (all rows: Pareto front, its most balanced design refined, what each limit leaves
    out, end-fittings, buckling of the tubes), `design.png` and `feasible.csv`. Exits with 1 where nothing
    is feasible, and names the nearest miss.

    Parameters
    ----------
    require
        What the muscle must do, key_unit=value, repeatable: pressure_psi=100, the greatest that there
        is and the only one that is needed; force_lbf=900 (at force_contraction, else blocked),
        force_contraction=0.1, contraction=0.3, stroke_mm=50, largest_diameter_in=2.2,
        longest_length_mm=400 (space between the end-fittings), thread_factor=3 and tube_factor=2.
    catalogue
        Your own catalogue files, repeatable; the bundled one shows the format.
    bundled
        Whether to search the bundled catalogue too.
    search
        About how many candidates to evaluate: a grid of rest lengths and pressures for each bladder and
        braid that can be built.
    objective
        What the front weighs, repeatable: outer_diameter, rest_length, pressure, air (free air of a
        stroke), of which less is better; force, blocked_force, contraction, stroke, of which more
        is. Outer_diameter, rest_length and air if omitted.
    vary
        Range of a search, key_unit=least:greatest, or one number to keep it fixed:
        rest_length_mm=100:600, pressure_psi=20:100. If omitted, a quarter of the pressure to all of it,
        and a quarter of the longest length, or of 500 mm, to all of it.
    end_fittings
        Whether a swage tube of the catalogue must fit.
    output
        Folder for the files, created if missing.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.boundary.origin import Origin

    from ..design.catalogue import load_catalogue
    from ..design.report import design_document, design_picture, feasible_table, summary
    from ..design.search import DEFAULT_OBJECTIVES, search as search_catalogue
    from .options.designs import number_of_candidates, parse_ranges, parse_requirement

    place = Output(output)
    requirement, offered = parse_requirement(require), load_catalogue(catalogue, bundled=bundled)
    found = search_catalogue(
        offered, requirement, **parse_ranges(vary, requirement),
        about=number_of_candidates(search), objectives=objective or DEFAULT_OBJECTIVES,
        end_fittings=end_fittings,
    )  # fmt: skip
    document = design_document(found, offered, system=units)
    document["origin"] = Origin.of_this_command().as_dict()
    files: dict[str, bytes] = {}
    if found.refined:
        files["design.png"] = design_picture(found, system=units)
        files["feasible.csv"] = feasible_table(found, system=units)
    paths = place.write({"design.json": document, **files})
    code = 0 if found.refined else 1
    if json_:
        print(json.dumps(document, allow_nan=False))
        return code
    for title, rows in (
        ("Refined design", document["refined"]),
        ("Front, the most balanced first", document["front"][:_SHOWN]),
        ("Nearest miss", document["nearest"]),
    ):
        if rows:
            print_rows(title, _narrow(rows))
    for line in ("", *summary(found, document["exclusions"])):
        print(line)
    for note in document["notes"]:
        print(f"note: {note}")
    place.tell(paths)
    return code


def _narrow(rows: list[dict]) -> list[dict]:
    """Rows for the terminal; the rest of their columns is in the file."""
    left = ("start", "feasibility", "tube", "blocked_force", "thread", "turns")
    return [{key: row[key] for key in row if not key.startswith(left)} for row in rows]

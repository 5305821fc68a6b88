"""`famjax design`."""

import json
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from .loading import load_fitting
from .options.engine import UNNAMED, EngineOptions
from .terminal import Output, print_rows, progress

_SHOWN = 10  # rows of a front on the terminal; all are in the file


def design(
    require: tuple[str, ...] = ("pressure_psi=100",),
    *,
    catalogue: tuple[Path, ...] = (),
    bundled: Annotated[bool, Parameter(negative="--no-bundled")] = True,
    tube: tuple[str, ...] = (),
    rest_length_mm: float = 235.74375,
    search: float | None = None,
    objective: tuple[str, ...] = (),
    vary: tuple[str, ...] = (),
    front_step: float = 0.01,
    end_fittings: Annotated[bool, Parameter(negative="--no-end-fittings")] = True,
    table: Literal["csv", "parquet"] = "csv",
    output: Path = Path("famjax-design"),
    units: Literal["si", "metric", "us"] = "us",
    engine: EngineOptions = UNNAMED,
    json_: bool = False,
) -> int:
    """Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement.

    Writes `design.json` (all rows, also force and diameter over contraction) and `design.png`. With
    --search it varies rest length, pressure and the angle of braids made to order as well, and writes
    the Pareto front, its best designs refined, and a table of feasible ones beside them; exit code 1
    where nothing is feasible.

    Parameters
    ----------
    require
        What the muscle must do, key_unit=value, repeatable: pressure_psi=100, force_lbf=900 (at
        force_contraction, else blocked), contraction=0.3, largest_diameter_in=2.2,
        force_contraction=0.1. The pressure is needed. With --search also stroke_mm=50,
        force_stroke_mm=20 (the travel at which the force is asked for), longest_length_mm=400 (space
        between the end-fittings), and the safety factors burst_factor=2, pull_factor=2,
        thread_factor=3 and tube_factor=2; the pressure is then the greatest that there is.
    catalogue
        Your own catalogue files, repeatable; the bundled one shows the format.
    bundled
        Whether to search the bundled catalogue too.
    tube
        What is known of the swage tubes, key_unit=value, repeatable: modulus_psi=10e6,
        yield_stress_psi=40e3, free_length_in=2.6, supported_length_in=1.85. What is not given is
        the catalogue's, else assumed, and the output says so.
    rest_length_mm
        Active length at rest, for thread length and turns; that of the reference work's specimen.
    search
        About how many candidates to evaluate, such as 1e6: a grid of rest lengths and pressures for
        each bladder and braid that can be built.
    objective
        What the front weighs, repeatable: outer_diameter, rest_length, pressure, air (free air of a
        stroke), of which less is better; force, blocked_force, contraction, stroke, of which more
        is. Unless given: outer_diameter, rest_length and air.
    vary
        Range of a search, key_unit=least:greatest: rest_length_mm=100:600, pressure_psi=20:100. Unless
        given: a quarter of the pressure to all of it, a quarter of the longest length to all of it,
        or half of --rest-length-mm to twice that.
    front_step
        Share by which designs on the front differ; 0 for all of them.
    end_fittings
        Whether a swage tube of the catalogue must fit a design that a search finds.
    table
        Form of the table of feasible designs, at most 100000 rows: csv, or parquet.
    output
        Folder for the files, made if need be.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.boundary.origin import Origin

    place, rest_length, code = Output(output), rest_length_mm / 1e3, 0
    files: dict[str, bytes] = {}
    tables: dict[str, list[dict]] = {}
    said: list[str] = []
    if search is None:
        from famjax.boundary.errors import InputError

        from ..design.document import design_document, design_picture
        from .options.designs import parse_requirement, parse_tube

        if objective or vary or engine != UNNAMED:
            raise InputError(
                "--objective, --vary, --jobs and --dask are of a search: add --search 1e6"
            )
        document = design_document(
            parse_requirement(require), catalogue, bundled=bundled, rest_length=rest_length,
            system=units, tube=parse_tube(tube),
        )  # fmt: skip
        files["design.png"] = design_picture(document, units)
        tables = {
            "Braid angle of each braid on each bladder": document["braid_angles"],
            "Candidates, the best first": document["candidates"],
            "End-fittings that enter the bladder's bore": [
                row for row in document["end_fittings"] if row["feasible"]
            ],
            "Buckling of the swage tubes in the die": document["tube_buckling"],
            "Safety factors of tested muscles": document["safety_factors"],
        }
    else:
        from ..design.catalogue_file import load_catalogue
        from ..design.document import LATEX
        from ..design.space import (
            feasible_table,
            search_document,
            search_picture,
            search_space,
            summary,
        )
        from ..design.space.limits import DEFAULT_OBJECTIVES
        from ..materials import PolynomialMaterial
        from .options.designs import (
            number_of_candidates,
            parse_ranges,
            parse_search_requirement,
            parse_tube,
        )

        requirement, limits = parse_search_requirement(require, end_fittings=end_fittings)
        with progress("candidates") as show, engine.executor() as executor:
            found = search_space(
                load_catalogue(list(catalogue), bundled=bundled), requirement,
                ranges=parse_ranges(vary, requirement, limits, rest_length), limits=limits,
                about=number_of_candidates(search), objectives=objective or DEFAULT_OBJECTIVES,
                material=PolynomialMaterial(LATEX), tube=parse_tube(tube), front_step=front_step,
                executor=executor, progress=show,
            )  # fmt: skip
        document, said = search_document(found, system=units), ["", *summary(found, system=units)]
        if found.feasible:
            files["design.png"] = search_picture(found, system=units)
            files[f"feasible.{table}"] = feasible_table(found, table, system=units)
            tables = {
                "Refined designs": _narrow(document["refined"]),
                "Front, the most balanced first": _narrow(document["front"][:_SHOWN]),
            }
        else:
            code = 1
    document["origin"] = Origin.of_this_command().as_dict()
    paths = place.write({"design.json": document, **files})
    if json_:
        print(json.dumps(document, allow_nan=False))
        return code
    for title, rows in tables.items():
        print_rows(title, rows)
    for line in (*said, *(f"note: {note}" for note in document["notes"])):
        print(line)
    place.tell(paths)
    return code


def _narrow(rows: list[dict]) -> list[dict]:
    """Rows for the terminal; the rest of their columns is in the file."""
    left = ("start", "feasibility", "tube", "nominal_diameter", "blocked_force", "burst", "pull",
            "thread")  # fmt: skip
    return [{key: row[key] for key in row if not key.startswith(left)} for row in rows]

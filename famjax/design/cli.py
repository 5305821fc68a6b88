"""The command `famjax design`, with options in the form `key_unit=value` that are converted to SI."""

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, TypeVar

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, from_entries
from famjax.console import Output, Units, parse_entries, print_json, print_rows

_T = TypeVar("_T")
_SHOWN = 10  # rows of the front printed; the file contains all
_USUAL = 0.5  # default of the longest rest length [m]

_FORM = Form(
    kinds={
        "pressure": "pressure",
        "force": "force",
        **dict.fromkeys(("largest_diameter", "longest_length", "rest_length"), "length"),
        **dict.fromkeys(("stroke", "force_stroke"), "length"),
    }
)


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
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Search a catalogue of braids, bladders and tubes for a muscle that meets your requirements.

    Writes `design.json` (Pareto front, refined design with its end-fitting, number of candidates that
    each requirement excludes), `feasible.csv`, and the refined design as a muscle card, `card.json`. If
    no candidate is feasible, prints the nearest miss and exits with code 1.

    Parameters
    ----------
    require
        Set a requirement as key_unit=value, repeatable: pressure_psi=100 (supply pressure, required),
        force_lbf=900 (blocked force, or the force at force_stroke_mm=40 or force_contraction=0.1),
        contraction=0.3, stroke_mm=50, largest_diameter_in=2.2, longest_length_mm=400 (between the
        end-fittings), thread_factor=3.
    catalogue
        Add your own catalogue file, repeatable; the bundled catalogue,
        `famjax/data/catalogue.toml`, shows the format.
    bundled
        Also search the bundled catalogue.
    search
        Set the approximate number of candidates. They form a grid of rest lengths and pressures for each
        pair of bladder and braid that can be built.
    objective
        Choose an objective for the Pareto front, repeatable. Minimised: outer_diameter, rest_length,
        pressure, air (free air per stroke). Maximised: force, blocked_force, contraction, stroke.
        Default: outer_diameter, rest_length and air.
    vary
        Set a search range as key_unit=lowest:highest, or fix a value with a single number:
        rest_length_mm=100:600, pressure_psi=20:100. Each range that is omitted runs from a quarter of the
        full value to the full value: the supply pressure, or the longest length (500 mm if not set).
    end_fittings
        Require that a swage tube in the catalogue fits.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object on standard output, and nothing else.
    """
    from famjax.boundary.files import Origin
    from famjax.compilation_cache import start_jax

    start_jax()
    from famjax.cards import write_card

    from .catalogue import load_catalogue
    from .report import design_card, design_document, feasible_table, summary
    from .search import DEFAULT_OBJECTIVES, Requirement, search as search_catalogue

    place = Output(output)
    if not 1 <= search < math.inf:
        raise InputError(f"--search must be >= 1 and finite, as in --search 1e6, got {search}")
    requirement = _read(Requirement, require, "--require", "pressure_psi=100")
    varied = _read(_Varied, vary, "--vary", "rest_length_mm=100:600")
    longest = requirement.longest_length if requirement.longest_length < math.inf else _USUAL
    found = search_catalogue(
        load_catalogue(catalogue, bundled=bundled), requirement,
        rest_length=varied.rest_length or (longest / 4, longest), pressure=varied.pressure,
        about=int(search), objectives=objective or DEFAULT_OBJECTIVES, end_fittings=end_fittings,
    )  # fmt: skip
    document = design_document(found, system=units)
    document["origin"] = Origin.of_this_command().as_dict()
    files = {"feasible.csv": feasible_table(found, system=units)} if found.refined else {}
    paths = place.write({"design.json": document, **files})
    if (card := design_card(found)) is not None:
        paths.append(write_card(card, output / "card.json"))
    code = 0 if found.refined else 1
    if json_:
        print_json(document)
        return code
    for title, rows in (
        ("Refined design", document["refined"]),
        ("Pareto front, most balanced design first", document["front"][:_SHOWN]),
        ("Nearest miss", document["nearest"]),
    ):
        if rows:
            print_rows(title, _narrow(rows))
    for line in ("", *summary(found, system=units)):
        print(line)
    place.tell(paths)
    return code


def _narrow(rows: list[dict]) -> list[dict]:
    """Return the rows without the columns that are shown only in the file."""
    left = ("tube", "diameter_on", "blocked_force", "thread", "turns")
    return [{key: row[key] for key in row if not key.startswith(left)} for row in rows]


# --- options


@dataclasses.dataclass(frozen=True)
class _Varied:
    """Ranges to search; None if a range is not specified."""

    pressure: tuple[float, float] | None = None
    rest_length: tuple[float, float] | None = None


def _read(kind: type[_T], entries: Iterable[str], option: str, example: str) -> _T:
    """Read entries with one number, or with two numbers separated by a colon, into a dataclass."""
    given = parse_entries(entries, option, example)
    try:
        numbers = {key: [float(one) for one in text.split(":")] for key, text in given.items()}
    except ValueError as error:
        raise InputError(f"{option}: {error}: use a number, as in {example}") from None
    values = {
        key: one * 2 if kind is _Varied and len(one) == 1 else one if len(one) > 1 else one[0]
        for key, one in numbers.items()
    }
    return from_entries(kind, values, _FORM, where=f"{option}: ")

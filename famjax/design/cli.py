"""`famjax design`, and its options `key_unit=value` as numbers in SI."""

import dataclasses
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeVar

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, from_entries
from famjax.console import Output, Units, parse_entries, print_json, print_rows

if TYPE_CHECKING:
    from .search import Range, Requirement

_T = TypeVar("_T")
_SHOWN = 10  # rows of a front on the terminal; all are in the file
_USUAL = 0.5  # longest rest length [m] where none is asked for

_FORM = Form(
    kinds={
        **dict.fromkeys(("largest_diameter", "stroke", "longest_length", "rest_length"), "length"),
        "pressure": "pressure",
        "force": "force",
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
    """Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement.

    Writes `design.json` (all rows: Pareto front, its most balanced design refined, what each limit leaves
    out, end-fittings) and `feasible.csv`. Exits with 1 where nothing
    is feasible, and names the nearest miss.

    Parameters
    ----------
    require
        What the muscle must do, key_unit=value, repeatable: pressure_psi=100, the greatest that there
        is and the only one that is needed; force_lbf=900 (at force_contraction, else blocked),
        force_contraction=0.1, contraction=0.3, stroke_mm=50, largest_diameter_in=2.2,
        longest_length_mm=400 (space between the end-fittings), thread_factor=3.
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
    from famjax.boundary.files import Origin
    from famjax.compilation_cache import start_jax

    start_jax()
    from .catalogue import load_catalogue
    from .report import design_document, feasible_table, summary
    from .search import DEFAULT_OBJECTIVES, search as search_catalogue

    place = Output(output)
    if not 1 <= search < math.inf:
        raise InputError(f"--search must be >= 1 and finite, as in --search 1e6; got {search}")
    requirement, offered = parse_requirement(require), load_catalogue(catalogue, bundled=bundled)
    found = search_catalogue(
        offered, requirement, **parse_ranges(vary, requirement), about=int(search),
        objectives=objective or DEFAULT_OBJECTIVES, end_fittings=end_fittings,
    )  # fmt: skip
    document = design_document(found, offered, system=units)
    document["origin"] = Origin.of_this_command().as_dict()
    files = {"feasible.csv": feasible_table(found, system=units)} if found.refined else {}
    paths = place.write({"design.json": document, **files})
    code = 0 if found.refined else 1
    if json_:
        print_json(document)
        return code
    for title, rows in (
        ("Refined design", document["refined"]),
        ("Front, the most balanced first", document["front"][:_SHOWN]),
        ("Nearest miss", document["nearest"]),
    ):
        if rows:
            print_rows(title, _narrow(rows))
    for line in ("", *summary(found, system=units)):
        print(line)
    place.tell(paths)
    return code


def _narrow(rows: list[dict]) -> list[dict]:
    """Rows for the terminal; the rest of their columns is in the file."""
    left = ("start", "feasibility", "tube", "blocked_force", "thread", "turns")
    return [{key: row[key] for key in row if not key.startswith(left)} for row in rows]


# --- options


def parse_requirement(entries: Iterable[str]) -> "Requirement":
    """Parse a requirement from entries such as `force_lbf=900`, `stroke_mm=50`, `contraction=0.3`.

    Args:
        entries: `key_unit=value`; the keys are the fields of `Requirement`, and `pressure` is
            required.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that no muscle can meet.

    >>> parse_requirement(["pressure_bar=7", "stroke_mm=50"]).stroke
    0.05
    """
    from .search import Requirement

    return _read(Requirement, entries, "--require", "pressure_psi=100")


@dataclasses.dataclass(frozen=True)
class _Varied:
    """What a search varies; None where it is not said."""

    pressure: tuple[float, float] | None = None
    rest_length: tuple[float, float] | None = None


def parse_ranges(entries: Iterable[str], requirement: "Requirement") -> "dict[str, Range]":
    """Parse the ranges of a search, such as `rest_length_mm=100:600` and `pressure_psi=20:100`.

    Args:
        entries: `key_unit=least:greatest`; one number keeps it fixed. What is not given goes from a
            quarter of the required pressure, and of the longest length or 0.5 m, to all of it.
        requirement: in SI.

    Raises:
        InputError: an entry that cannot be read, with what is known.

    >>> asked = parse_requirement(["pressure_kPa=700"])
    >>> parse_ranges(["rest_length_mm=100:600"], asked)
    {'pressure': (175000.0, 700000.0), 'rest_length': (0.1, 0.6)}
    """
    varied = _read(_Varied, entries, "--vary", "rest_length_mm=100:600")
    longest = requirement.longest_length if requirement.longest_length < math.inf else _USUAL
    return {
        "pressure": varied.pressure or (requirement.pressure / 4, requirement.pressure),
        "rest_length": varied.rest_length or (longest / 4, longest),
    }


def _read(kind: type[_T], entries: Iterable[str], option: str, example: str) -> _T:
    """A dataclass of entries with one number each, or two about a colon where it has a pair."""
    given = parse_entries(entries, option, example)
    try:
        numbers = {key: [float(one) for one in text.split(":")] for key, text in given.items()}
    except ValueError as error:
        raise InputError(f"{option}: {error}; give a number, as in {example}") from None
    values = {
        key: one * 2 if kind is _Varied and len(one) == 1 else one if len(one) > 1 else one[0]
        for key, one in numbers.items()
    }
    return from_entries(kind, values, _FORM, where=f"{option}: ")

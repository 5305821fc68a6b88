"""`famjax design`, and its options `key_unit=value` as numbers in SI."""

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS
from famjax.console import Jobs, Output, Units, print_json, print_rows, progress

if TYPE_CHECKING:
    from .catalogue_search import Requirement
    from .space import SearchLimits, SearchRanges
    from .swage_tube import TubeOptions

_SHOWN = 10  # rows of a front on the terminal; all are in the file
_REQUIREMENT = {
    "pressure": "pressure",
    "force": "force",
    "contraction": "number",
    "largest_diameter": "length",
    "force_contraction": "number",
}
_LIMITS = {
    "stroke": "length",
    "force_stroke": "length",
    "longest_length": "length",
    "burst_factor": "number",
    "pull_factor": "number",
    "thread_factor": "number",
    "tube_factor": "number",
    "bore_stretch": "number",
}
_VARIED = {"rest_length": "length", "pressure": "pressure"}
_TUBE = {
    "modulus": "stress",
    "yield_stress": "stress",
    "free_length": "length",
    "supported_length": "length",
}


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
    units: Units = "us",
    jobs: Jobs = None,
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
        Folder for the files, created if missing.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    jobs
        Number of processes of a search.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    from famjax.boundary.origin import Origin
    from famjax.compilation_cache import start_jax

    start_jax()

    place, rest_length, code = Output(output), rest_length_mm / 1e3, 0
    files: dict[str, bytes] = {}
    tables: dict[str, list[dict]] = {}
    said: list[str] = []
    if search is None:
        from .document import design_document, design_picture

        if objective or vary or jobs is not None:
            raise InputError("--objective, --vary and --jobs are of a search: add --search 1e6")
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
        from famjax.materials import PolynomialMaterial

        from .catalogue_file import load_catalogue
        from .document import LATEX
        from .space import (
            feasible_table,
            search_document,
            search_picture,
            search_space,
            summary,
        )
        from .space.limits import DEFAULT_OBJECTIVES

        requirement, limits = parse_search_requirement(require, end_fittings=end_fittings)
        with progress("candidates") as show:
            found = search_space(
                load_catalogue(list(catalogue), bundled=bundled), requirement,
                ranges=parse_ranges(vary, requirement, limits, rest_length), limits=limits,
                about=number_of_candidates(search), objectives=objective or DEFAULT_OBJECTIVES,
                material=PolynomialMaterial(LATEX), tube=parse_tube(tube), front_step=front_step,
                executor=jobs, progress=show,
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
        print_json(document)
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


def parse_requirement(entries: Iterable[str]) -> "Requirement":
    """The requirement that entries such as `force_lbf=900` and `contraction=0.3` make.

    Args:
        entries: `key_unit=value`; keys pressure, force, contraction, largest_diameter and
            force_contraction. Pressure is needed; without a force or contraction none is asked.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that only a search can
            keep to.

    >>> parse_requirement(["pressure_psi=100", "contraction=0.3"]).contraction
    0.3
    """
    given = _parse(entries, _REQUIREMENT | _LIMITS, "requirement")
    if of_a_search := [name for name in given if name in _LIMITS]:
        raise InputError(
            f"the requirement {of_a_search[0]} needs a search over rest lengths and pressures: add "
            "--search 1e6"
        )
    return _requirement(given)


def parse_search_requirement(
    entries: Iterable[str], *, end_fittings: bool
) -> tuple["Requirement", "SearchLimits"]:
    """What a search keeps to: a requirement, and more such as `stroke_mm=50` and `burst_factor=2`.

    Args:
        entries: `key_unit=value`; the keys of `parse_requirement` and those of `SearchLimits`.
        end_fittings: whether a swage tube of the catalogue must fit.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that nothing can keep to.

    >>> parse_search_requirement(["pressure_bar=7", "stroke_mm=50"], end_fittings=True)[1].stroke
    0.05
    """
    given = _parse(entries, _REQUIREMENT | _LIMITS, "requirement")
    limits = {name: value for name, value in given.items() if name in _LIMITS}
    requirement = {name: value for name, value in given.items() if name in _REQUIREMENT}
    from .space import SearchLimits

    return _requirement(requirement), SearchLimits(**limits, end_fittings=end_fittings)


def _requirement(given: Mapping[str, float]) -> "Requirement":
    if "pressure" not in given:
        raise InputError("a requirement needs the pressure, as in --require pressure_psi=100")
    from .catalogue_search import Requirement

    try:
        return Requirement(**{"force": 0.0, "contraction": 0.0, **given})
    except ValueError as error:
        raise InputError(str(error)) from None


def number_of_candidates(about: float) -> int:
    """The number that an option such as 1e6 asks for.

    Raises:
        InputError: it is not a number of candidates.

    >>> number_of_candidates(1e6)
    1000000
    """
    if not 1 <= about < math.inf:
        raise InputError(f"--search must be >= 1 and finite, as in --search 1e6; got {about}")
    return int(about)


def parse_ranges(
    entries: Iterable[str], requirement: "Requirement", limits: "SearchLimits", rest_length: float
) -> "SearchRanges":
    """What a search varies: entries such as `rest_length_mm=100:600` and `pressure_psi=20:100`.

    Args:
        entries: `key_unit=least:greatest`; one number keeps it fixed. What is not given goes from a
            quarter of the required pressure to all of it, and from a quarter of the longest length
            to all of it or, without such a limit, from half of a usual length to twice that.
        requirement: in SI.
        limits: in SI.
        rest_length: that usual length [m].

    Raises:
        InputError: an entry that cannot be read, with what is known.

    >>> asked, limits = parse_search_requirement(["pressure_kPa=700"], end_fittings=True)
    >>> parse_ranges(["rest_length_mm=100:600"], asked, limits, 0.25)
    SearchRanges(rest_length=(0.1, 0.6), pressure=(175000.0, 700000.0))
    """
    longest = limits.longest_length
    found = {
        "pressure": (requirement.pressure / 4, requirement.pressure),
        "rest_length": (
            (longest / 4, longest) if math.isfinite(longest) else (rest_length / 2, 2 * rest_length)
        ),
    }
    for entry in entries:
        key, _, text = entry.partition("=")
        ends = [_parse([f"{key}={end}"], _VARIED, "range") for end in text.split(":")]
        name = next(iter(ends[0]))
        if len(ends) > 2:
            raise InputError(f"range {entry!r} must read key_unit=least:greatest")
        found[name] = ends[0][name], ends[-1][name]
    from .space import SearchRanges

    return SearchRanges(**found)


def parse_tube(entries: Iterable[str]) -> "TubeOptions":
    """What entries such as `modulus_psi=28e6` and `free_length_in=3` say of the swage tubes.

    Args:
        entries: `key_unit=value`; keys modulus, yield_stress, free_length and supported_length.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that is not > 0.

    >>> parse_tube(["modulus_GPa=193", "yield_stress_MPa=215"]).yield_stress
    215000000.0
    """
    given = _parse(entries, _TUBE, "tube option")
    for name, value in given.items():
        if value <= 0:
            raise InputError(f"the tube's {name} must be > 0, got {value:.6g} in SI")
    from .swage_tube import TubeOptions

    return TubeOptions(**given)


def _parse(entries: Iterable[str], kinds: Mapping[str, str], what: str) -> dict[str, float]:
    """Numbers in SI by name; `kinds` names what may be given and the kind of its unit."""
    keys = {
        f"{name}_{unit}" if unit else name: (name, factor)
        for name, kind in kinds.items()
        for unit, factor in UNITS.get(kind, {"": 1.0}).items()
    }
    given: dict[str, float] = {}
    for entry in entries:
        key, equals, text = (part.strip() for part in entry.partition("="))
        if key not in keys:
            raise InputError(f"unknown {what} {entry!r}; known are {', '.join(keys)}")
        name, factor = keys[key]
        if name in given:
            raise InputError(f"the {what} {name} is given twice")
        try:
            given[name] = float(text) * factor
        except ValueError:
            raise InputError(f"{what} {entry!r}: {text!r} is not a number") from None
        if not equals or not math.isfinite(given[name]):
            raise InputError(f"{what} {entry!r} must read key_unit=value, finite")
    return given

"""`famjax series`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rich.console import Console

from ..loading import load_fitting, load_map, look_here
from ..options.engine import UNNAMED, EngineOptions
from ..options.whole_numbers import Seed, Starts
from ..terminal import Output, print_rows, progress

if TYPE_CHECKING:
    from fitting.verdict import Judgement


def series(
    *data: str,
    law: tuple[str, ...] = (),
    free: tuple[str, ...] = (),
    bounds: tuple[str, ...] = (),
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker",
    box: Literal["physical", "open"] = "physical",
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    starts: Starts = 8,
    seed: Seed = 0,
    output: Path = Path("famjax-series"),
    units: Literal["si", "metric", "us"] = "metric",
    engine: EngineOptions = UNNAMED,
    json_: bool = False,
) -> int:
    """Identify several muscles of a series together, to predict those of other lengths.

    One braid, one bladder and one rig for all: what differs is the length. Each law, with and
    without a deadband and a compliant rig, is judged by the specimens it predicts from the others;
    of those that are as good the plainest is kept, and predictions are the mean of it and of up to
    two more of its law. Writes `fit.json`, which
    `famjax predict fit.json --rest-length 132mm` reads, and prints a verdict; the exit code is 1
    where nothing was identified.

    Parameters
    ----------
    data
        CSV files of the force maps, as for `famjax fit`, one of each specimen, with the lines
        `# specimen: name = ...` and `# specimen: rest_length_mm = ...`.
    law
        Laws to try, repeatable; linear, mooney-rivlin and ogden unless given. As for `famjax fit`,
        module:Class for one of your own too; linear and cubic are polynomials.
    free
        Parameters that take part in all families besides braid diameter and angle, repeatable:
        series_compliance, with it series_exponent, deadband_pressure, end_length, braid_compliance.
    bounds
        Replace bounds, name_unit=min:max, repeatable; one value holds the parameter:
        `--bounds series_compliance_mm/N=0` for a rigid rig.
    constraint
        none, positive, slope or drucker, as for `famjax fit`.
    box
        physical or open, as for `famjax fit`.
    geometry
        A geometry of your own around the cylinder, module:Class, as for `famjax fit`. It needs a method
        cut_to_length, by which muscles of other lengths have it.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable, as for
        `famjax fit`.
    starts
        Number of starts of each fit.
    seed
        Of the starts; the same seed gives the same result.
    output
        Folder for the file, made if need be.
    units
        Of the tables: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    engine
        Where the families are judged.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    from famjax.boundary.origin import Origin
    from famjax.commands.options.fits import (
        as_parameters,
        parameter_kinds,
        parse_bounds,
        parse_free,
    )
    from fitting.choice import DEFAULT_LAWS
    from fitting.search.own_parts import own_parts, taking_part
    from fitting.verdict import judge_series

    place = Output(output)
    look_here()
    maps = [load_map(one, {}) for one in data]
    parts, declared = own_parts(maps, geometry, term)
    kinds = parameter_kinds(*(one for one in law if ":" in one))
    kinds |= {name: one.kind for name, one in declared.items()}
    said = parse_free(free, kinds) | as_parameters(parse_bounds(bounds, kinds), kinds)
    with progress("identifying") as show, engine.executor() as executor:
        found = fitting.identify_series(
            maps,
            laws=law or DEFAULT_LAWS,
            parameters=said | taking_part(declared, said),
            constraint=constraint,
            box=box,
            starts=starts,
            seed=seed,
            executor=executor,
            **parts,
            progress=lambda name, done, total: show(done, total, name),
        )
    judgement = judge_series(found.specimens, found.left_out)
    document = fitting.saved.series_as_dict(found, Origin.of_this_command())
    paths = place.write({"fit.json": document})
    if json_:
        said = {key: document[key] for key in ("verdict", "reasons", "parameters")}
        print(json.dumps(document["series"] | said))
    else:
        values = fitting.saved.summary_as_dict(found.specimens[0], units)["parameters"]
        _print_series(document, values, units)
        _print_verdict(judgement, found.left_out.rmse, units)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print_series(document: dict, values: dict, system: str) -> None:
    from famjax.boundary.units import unit_system
    from famjax.commands.options.answers import in_units

    units = unit_system(system)
    found = document["series"]
    errors = found["leave_one_specimen_out_N"]
    print_rows(
        "Families, by the error of specimens predicted from the others",
        in_units(
            [{"family": name, "left_out_rmse_N": error} for name, error in errors.items()], units
        ),
    )
    print_rows(
        f"Specimens, with {found['family']}; the mean of {found['averaged']} predicts them",
        in_units([{key: one[key] for key in ("name", "rest_length_m", "max_force_N", "rmse_N",
                                             "predicted_rmse_N")} for one in found["specimens"]], units),
    )  # fmt: skip
    print_rows(
        "Parameters, shared",
        [{"parameter": name, "value": of["value"], "unit": of["unit"], "std_error": of["stderr"]}
         for name, of in values.items()],
    )  # fmt: skip
    for warning in document["warnings"]:
        print(f"note: {warning}")


def _print_verdict(judgement: "Judgement", left_out_rmse: float, system: str) -> None:
    """The level with the gravest reason, then how well specimens predict one another."""
    from famjax.boundary.sentence import Quantity, in_units

    first, *others = [in_units(one, system) for one in judgement.reasons] or [""]
    console = Console(highlight=False)
    for other in (*others, in_units(judgement.unchecked, system)):
        if other:
            console.print(f"note: {other}", markup=False)
    predicted = Quantity(left_out_rmse, "force", 3).in_units(system)
    said = (
        f"{judgement.level.capitalize()}: {first}" if first else f"{judgement.level.capitalize()}."
    )
    console.print(
        f"{said} RMSE of specimens predicted from the others: {predicted}.",
        style="bold", markup=False,
    )  # fmt: skip

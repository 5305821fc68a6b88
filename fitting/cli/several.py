"""Many maps or many fits: `famjax sweep`, `compare`, `series` and `ramps`."""

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Parameter, validators
from rich.console import Console

from famjax.console import (
    Jobs,
    Output,
    Units,
    add_cwd_to_path,
    in_units,
    print_json,
    print_rows,
    progress,
    whole,
)

from .fit import Constraint, load_fitting, load_map

if TYPE_CHECKING:
    from fitting.sweeps import SweepRow
    from fitting.verdict import Judgement

SweptOrders = Annotated[
    tuple[int, ...], Parameter(converter=whole, validator=validators.Number(gte=1, lte=4))
]
"""Orders of the polynomial law that a sweep has."""
_CURVES = 3
"""Fits whose force curves are drawn, those with the smallest BIC."""


def sweep(
    data: str = "DMSP-20-300",
    *,
    braid_diameter: str | None = None,
    braid_angle: str | None = None,
    deadband: str | None = None,
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    order: SweptOrders = (1, 2, 3, 4),
    dependence: tuple[Literal["fixed", "linear", "free"], ...] = ("fixed", "linear", "free"),
    constraint: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker"),
    objective: Literal["sum_of_squares", "mean_rmse"] = "sum_of_squares",
    specimen: tuple[str, ...] = (),
    output: Path = Path("famjax-sweep"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Fit every permutation of order, pressure dependence and constraint at one geometry.

    Writes `sweep.json` with all fits in SI, and pictures of errors and force curves. Without a
    geometry the one that `famjax fit` identifies with its standard law is taken.

    Parameters
    ----------
    data
        CSV file or the name of a bundled map, as for `famjax fit`.
    braid_diameter
        D0 at rest with its unit, `21.6mm`.
    braid_angle
        Braid angle at rest from the circumference with its unit, `63deg`.
    deadband
        Pressure before the muscle acts with its unit, `43kPa`.
    geometry
        A geometry of your own around the cylinder, module:Class, as for `famjax fit`; its numbers are
        identified with the standard law.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable; as --geometry.
    order
        Orders of the law, repeatable, 1 to 4.
    dependence
        Of the coefficients on pressure, repeatable: fixed, linear, free.
    constraint
        On the coefficients, repeatable: none, positive, slope, drucker.
    objective
        sum_of_squares; mean_rmse: mean over pressures of the RMSE, as the reference work.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    output
        Folder for the files, created if missing.
    units
        Of tables and pictures: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()

    from famjax.boundary.files import as_png
    from famjax.boundary.units import parse_quantity
    from fitting.posing import own_parts, taking_part
    from fitting.reading import parse_specimen
    from fitting.sweeps import plot_curves, plot_errors

    place = Output(output)
    measured = load_map(data, parse_specimen(specimen))
    add_cwd_to_path()
    parts, declared = own_parts([measured], geometry, term)
    given = {"braid_diameter": braid_diameter, "braid_angle": braid_angle, "deadband": deadband}
    missing = [name for name, text in given.items() if text is None]
    if len(missing) < len(given) and (missing or parts):
        raise fitting.InputError(
            f"the geometry needs {', '.join(given)} together, or none of them to identify it"
            + (f"; missing: {', '.join(missing)}" if missing else ", as with --geometry and --term")
        )
    with progress("identifying the geometry") as show:
        terms = parts.get("terms")
        if missing:
            known = fitting.identify(measured, **parts, parameters=taking_part(declared, {}))
            shape, dead = known.muscle.geometry, known.estimate("deadband_pressure").value
            if terms is not None:
                named = {name: known.estimate(name).value for name in terms.declared()}
                terms = terms.with_parameters(named)
        else:
            at_rest = {
                "braid_diameter": parse_quantity(str(braid_diameter), "length"),
                "braid_angle": parse_quantity(str(braid_angle), "angle"),
            }
            shape = fitting.families.EstimatedSource(measured.specimen).geometry(at_rest)
            dead = parse_quantity(str(deadband), "pressure")
        found = fitting.sweep(
            measured, shape, deadband=dead, terms=terms, orders=order, dependences=dependence,
            constraints=constraint, objective=objective,
            progress=lambda done, total: show(done, total, "sweeping"),
        )  # fmt: skip
        best = sorted(found.rows, key=lambda row: row.bic)[:_CURVES]
        paths = place.write(
            {
                "sweep.json": finite({"rows": [row.as_dict() for row in found.rows]}),
                "errors.png": as_png(plot_errors(found, units)),
                "curves.png": as_png(plot_curves(found, best, units)),
            }
        )
    rows = [_swept_row(row, units) for row in found.rows]
    if json_:
        print_json({"rows": rows})
        return 0
    # What cannot be said in a word is said once, below the table.
    sentences = {row["verdict"]: "" for row in rows} | {"stable": "", "not stable": ""}
    del sentences["stable"], sentences["not stable"]
    marks = {sentence: f"see ({k})" for k, sentence in enumerate(sentences, 1)}
    print_rows(
        f"{len(rows)} fits of {measured.specimen.name}",
        [{**row, "verdict": marks.get(row["verdict"], row["verdict"])} for row in rows],
    )
    for k, sentence in enumerate(sentences, 1):
        print(f"({k}) {sentence}")
    place.tell(paths)
    return 0


def finite(value: Any) -> Any:
    """Lists and mappings with None for what is not finite, as JSON has it."""
    if isinstance(value, dict):
        return {key: finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [finite(one) for one in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _swept_row(row: "SweepRow", system: str) -> dict[str, Any]:
    """One line of the table of a sweep, the unit in each name; what is not known is None."""
    from famjax.boundary.units import from_si, unit_system

    force, stress = unit_system(system)["force"], unit_system(system)["stress"]
    numbers = {
        f"rmse_{force}": from_si(row.rmse, force, "force"),
        f"mae_{force}": from_si(row.mae, force, "force"),
        f"blocked_force_error_{force}": from_si(row.blocked_error, force, "force"),
        "free_contraction_error": row.free_contraction_error,
        "aicc": row.aicc,
        "bic": row.bic,
        f"left_out_rmse_{force}": from_si(row.cross_validated_rmse, force, "force"),
        f"stability_margin_{stress}": from_si(row.margin, stress, "stress"),
        "condition": row.condition,
    }
    return {
        "pressure": row.dependence,
        "order": row.order,
        "constraint": row.constraint,
        "n_coefficients": row.n_coefficients,
        **finite(numbers),
        "verdict": row.verdict,
    }


_STARTS = 32
"""Of each nonlinear fit of a comparison."""
_COLUMNS = {
    "model": "label",
    "n parameters": "n_parameters",
    "inner lengths out N": "lolo_interior_rmse_N",
    "rmse N": "rmse_N",
    "pressures out N": "lopo_rmse_N",
    "lengths out N": "lolo_rmse_N",
    "max error N": "max_error_N",
}
"""Of the table, and where they are in `compare.json`; "out" is the RMSE on what was left out."""


def compare(
    data: str = "DMSP-20-300",
    *,
    models: tuple[str, ...] = (),
    own: tuple[str, ...] = (),
    specimen: tuple[str, ...] = (),
    output: Path = Path("famjax-compare"),
    jobs: Jobs = None,
    json_: bool = False,
) -> int:
    """Fit every published static force model, and famjax's own, to one force map.

    Each is fitted to all loaded readings, and again without each pressure and each length, which it
    then predicts ("pressures out" and "lengths out" in the table; of inner lengths, neither the longest
    nor the shortest). The table is ordered by the error on inner lengths left out. The choice of `famjax
    fit` is made anew without what it predicts. A minute or two for all of them.

    Writes `compare.json` and `compare.png`. Finished rows are kept in the folder `rows`, from which a
    stopped comparison goes on.

    Parameters
    ----------
    data
        CSV file or the name of a bundled map, as for `famjax fit`.
    models
        Names of the models, repeatable; all unless given. An unknown one prints those there are.
    own
        A model of your own beside them, module:Class, repeatable: a whole model, or a law, a geometry
        or a force term that is identified with the rest of a muscle. `--own my_model:Gent`.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    output
        Folder for the files, created if missing.
    jobs
        Number of processes.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    from famjax.boundary.files import Origin, as_png, make_output
    from fitting.comparison import plot_comparison
    from fitting.reading import parse_specimen

    place = Output(output)
    add_cwd_to_path()
    measured = load_map(data, parse_specimen(specimen))
    make_output(output)
    kept = output / "rows.jsonl"
    with progress("comparing") as show:
        table = fitting.compare(
            measured, models or None, own=own, starts=_STARTS, executor=jobs, resume=kept,
            progress=show,
        )  # fmt: skip
    document = {
        **table.as_dict(),
        "origin": Origin.of_this_command().as_dict(),
        "starts": _STARTS,
        "seed": 0,
    }
    paths = place.write({"compare.json": document, "compare.png": as_png(plot_comparison(table))})
    kept.unlink()
    if json_:
        print_json(document)
        return 0
    rows = [{name: row[key] for name, key in _COLUMNS.items()} for row in document["models"]]
    print_rows(f"{document['specimen']}, largest force {document['max_force_N']:.5g} N", rows)
    for row in document["models"]:
        remarks = [f"at a bound: {', '.join(row['at_bound'])}"] if row["at_bound"] else []
        remarks += [row["note"]] if row["note"] else []
        if remarks:
            print(f"note: {row['label']}: {'; '.join(remarks)}")
    place.tell(paths)
    return 0


def series(
    *data: str,
    law: tuple[str, ...] = (),
    free: tuple[str, ...] = (),
    bounds: tuple[str, ...] = (),
    constraint: Constraint = "drucker",
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    output: Path = Path("famjax-series"),
    units: Units = "metric",
    jobs: Jobs = None,
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
    geometry
        A geometry of your own around the cylinder, module:Class, as for `famjax fit`. It needs a method
        cut_to_length, by which muscles of other lengths have it.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable, as for
        `famjax fit`.
    output
        Folder for the file, created if missing.
    units
        Of the tables: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    jobs
        Number of processes.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    from famjax.boundary.files import Origin
    from famjax.boundary.units import si_unit
    from fitting.posing import own_parts, taking_part
    from fitting.series import DEFAULT_LAWS
    from fitting.verdict import judge_series

    from .problem import parameter_kinds, parse_bounds, parse_free

    place = Output(output)
    add_cwd_to_path()
    maps = [load_map(one, {}) for one in data]
    parts, declared = own_parts(maps, geometry, term)
    kinds = parameter_kinds(*(one for one in law if ":" in one))
    kinds |= {name: one.kind for name, one in declared.items()}
    said = parse_free(free, kinds) | {
        name: fitting.Parameter(min=low, max=high, unit=si_unit(kinds.get(name, "stress")))
        for name, (low, high) in parse_bounds(bounds, kinds).items()
    }
    with progress("identifying") as show:
        found = fitting.identify_series(
            maps,
            laws=law or DEFAULT_LAWS,
            parameters=said | taking_part(declared, said),
            constraint=constraint,
            executor=jobs,
            **parts,
            progress=lambda name, done, total: show(done, total, name),
        )
    judgement = judge_series(found.specimens, found.left_out)
    document = fitting.saved.series_as_dict(found, Origin.of_this_command())
    paths = place.write({"fit.json": document})
    if json_:
        said = {key: document[key] for key in ("verdict", "reasons", "parameters")}
        print_json(document["series"] | said)
    else:
        values = fitting.saved.summary_as_dict(found.specimens[0], units)["parameters"]
        _print_series(document, values, units)
        _print_verdict(judgement, found.left_out.rmse, units)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print_series(document: dict, values: dict, system: str) -> None:
    from famjax.boundary.units import unit_system

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
    from famjax.boundary.units import Quantity, sentence_in_units

    first, *others = [sentence_in_units(one, system) for one in judgement.reasons] or [""]
    console = Console(highlight=False)
    for other in (*others, sentence_in_units(judgement.unchecked, system)):
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


def ramps(
    *records: str,
    atmosphere: str,
    specimen: tuple[str, ...] = (),
    columns: str | None = None,
    branches: Literal["both", "fill", "vent"] = "both",
    period_s: float | None = None,
    step_kPa: Annotated[float, Parameter(name="--step-kPa")] = 25.0,
    slack_below_N: Annotated[float | None, Parameter(name="--slack-below-N")] = None,
    length_std_mm: float | None = None,
    output: Path = Path("famjax-ramps"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Turn raw isometric pressure ramps into a static force map with its noise and hysteresis.

    Writes `map.csv` (which `famjax fit` reads), `ramps.png`, `ramps.json` and, where records were filled
    and vented, `branches.csv` (which `famjax assess --hysteresis` reads).

    Parameters
    ----------
    records
        Raw records with the length at which each was taken, `test8.csv=73.25mm`; or a list, a CSV
        file with the columns `file,length_mm`.
    atmosphere
        What the pressure sensor reads at atmosphere, `8.94kPa`, or the interval of each record in
        which the muscle is vented, `0s:0.5s`.
    specimen
        Describe the muscle, key_unit=value, repeatable; rest_length is needed.
    columns
        Names of the columns, with units, where the records have no header that names them.
    branches
        Which branch the map holds: the mean of both, fill or vent.
    period_s
        Time between valve pulses; found in the record unless given.
    step_kPa
        Of the pressures of the map.
    slack_below_N
        Force under which the muscle does not pull; found from the clamp of the sensor unless given.
    length_std_mm
        Standard deviation of the lengths, where it is known.
    output
        Folder for the files, created if missing.
    units
        Of summary, picture and map: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    load_fitting()
    from famjax.boundary.files import Origin
    from fitting.reading import parse_specimen
    from fitting.records import parse_atmosphere, ramps_command

    place = Output(output)
    summary, files = ramps_command(
        records,
        atmosphere=parse_atmosphere(atmosphere),
        columns=columns,
        specimen=parse_specimen(specimen),
        period=period_s,
        step=step_kPa * 1e3,
        slack_below=slack_below_N,
        branches=branches,
        length_std=None if length_std_mm is None else length_std_mm / 1e3,
        system=units,
    )
    origin = Origin.of_this_command()
    summary["origin"] = origin.as_dict()
    files["map.csv"] = "\n".join(origin.comments()).encode() + b"\n" + files["map.csv"]
    paths = place.write({**files, "ramps.json": summary})
    if json_:
        print_json(summary)
        return 0
    print_rows("Records", summary["records"])
    print_rows("Lengths", summary["lengths"])
    for note in summary["notes"]:
        print(f"note: {note}")
    place.tell(paths)
    return 0

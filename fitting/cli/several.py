"""Commands for several maps or several fits: `famjax sweep`, `compare`, `series` and `ramps`."""

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, validators

from famjax.console import (
    Columns,
    Jobs,
    Output,
    Signed,
    Units,
    add_cwd_to_path,
    in_units,
    parse_columns,
    print_json,
    print_lines,
    print_rows,
    progress,
    tell_columns,
    whole,
)

from .fit import Constraint, Ends, load_fitting, load_map

SweptOrders = Annotated[
    tuple[int, ...], Parameter(converter=whole, validator=validators.Number(gte=1, lte=4))
]
"""Orders of the polynomial law in a sweep."""
_CURVES = 3
"""Number of fits with plotted force curves; those with the smallest BIC are plotted."""
_SWEPT = {
    "pressure": "dependence", "order": "order", "constraint": "constraint",
    "n coefficients": "n_coefficients", "rmse_N": "rmse", "mae_N": "mae",
    "blocked force error_N": "blocked_error", "free contraction error": "free_contraction_error",
    "aicc": "aicc", "bic": "bic", "left out rmse_N": "cross_validated_rmse",
    "stability margin_Pa": "margin", "condition": "condition", "verdict": "verdict",
}  # fmt: skip
"""Columns of the table of a sweep, and their keys in `sweep.json`."""


def sweep(
    data: str = "DMSP-20-300",
    *,
    braid_diameter: str | None = None,
    braid_angle: str | None = None,
    deadband: str | None = None,
    order: SweptOrders = (1, 2, 3, 4),
    dependence: tuple[Literal["fixed", "linear", "free"], ...] = ("fixed", "linear", "free"),
    constraint: tuple[Constraint, ...] = ("none", "positive", "slope", "drucker"),
    objective: Literal["sum_of_squares", "mean_rmse"] = "sum_of_squares",
    specimen: tuple[str, ...] = (),
    column: Columns = (),
    output: Path = Path("famjax-sweep"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Fit all combinations of order, pressure dependence and constraint at one geometry.

    Writes `sweep.json` with all fits in SI, and figures of errors and force curves. By default, the
    geometry is identified as in `famjax fit --law polynomial`.

    Parameters
    ----------
    data
        Read this CSV file or bundled map, as for `famjax fit`.
    braid_diameter
        Set the braid diameter at rest, D0, with its unit: `21.6mm`.
    braid_angle
        Set the braid angle at rest, measured from the circumference, with its unit: `63deg`.
    deadband
        Set the pressure below which the muscle does not act, with its unit: `43kPa`.
    order
        Try these orders of the law, repeatable, 1 to 4.
    dependence
        Try these dependences of the coefficients on pressure, repeatable: fixed, linear, free.
    constraint
        Try these constraints, repeatable: none, positive, slope, drucker.
    objective
        Choose the objective. mean_rmse: the mean over pressures of the RMSE, as in the reference work.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    column
        Name the column of a quantity that is not recognised, as for `famjax fit`, repeatable.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units of tables and figures: si, metric or us.
    json_
        Print one JSON object, in SI, and nothing else.
    """
    fitting = load_fitting()

    from famjax.boundary.files import as_png
    from famjax.boundary.units import parse_quantity, unit_system
    from fitting.specimen import parse_specimen
    from fitting.sweeps import plot_curves, plot_errors

    place = Output(output)
    measured = load_map(data, parse_specimen(specimen), column)
    given = {"braid_diameter": braid_diameter, "braid_angle": braid_angle, "deadband": deadband}
    missing = [name for name, text in given.items() if text is None]
    if 0 < len(missing) < len(given):
        raise fitting.InputError(
            f"give {', '.join(given)} together, or none of them to identify the geometry; missing: "
            f"{', '.join(missing)}"
        )
    with progress("identifying the geometry, sweeping"):
        if missing:
            known = fitting.identify(measured)
            shape, dead = known.muscle.geometry, known.estimate("deadband_pressure").value
        else:
            kinds = {"braid_diameter": "length", "braid_angle": "angle"}
            at_rest = {name: parse_quantity(str(given[name]), kind) for name, kind in kinds.items()}
            shape = fitting.families.EstimatedSource(measured.specimen).geometry(at_rest)
            dead = parse_quantity(str(deadband), "pressure")
        found = fitting.sweep(
            measured, shape, deadband=dead, orders=order, dependences=dependence,
            constraints=constraint, objective=objective,
        )  # fmt: skip
    best = sorted(found.rows, key=lambda row: row.bic)[:_CURVES]
    rows = [_finite(row.as_dict()) for row in found.rows]
    paths = place.write(
        {
            "sweep.json": {"rows": rows},
            "errors.png": as_png(plot_errors(found, units)),
            "curves.png": as_png(plot_curves(found, best, units)),
        }
    )
    if json_:
        print_json({"rows": rows})
        return 0
    # Longer verdicts are printed once, below the table.
    long = dict.fromkeys(
        row["verdict"] for row in rows if " " in row["verdict"].removeprefix("not ")
    )
    marks = {verdict: f"see ({k})" for k, verdict in enumerate(long, 1)}
    shown = [{name: row[key] for name, key in _SWEPT.items()} for row in rows]
    shown = [{**row, "verdict": marks.get(row["verdict"], row["verdict"])} for row in shown]
    stress = {**unit_system(units), "pressure": unit_system(units)["stress"]}
    print_rows(f"{len(rows)} fits of {measured.specimen.name}", in_units(shown, stress))
    for verdict, mark in marks.items():
        print(f"{mark.removeprefix('see ')} {verdict}")
    place.tell(paths)
    return 0


def _finite(value: Any) -> Any:
    """Replace non-finite numbers in lists and mappings by None, as in JSON."""
    from famjax.boundary.units import finite_or_none

    if isinstance(value, dict):
        return {key: _finite(one) for key, one in value.items()}
    if isinstance(value, list):
        return [_finite(one) for one in value]
    return finite_or_none(value) if isinstance(value, float) else value


_STARTS = 32
"""Number of starts of each nonlinear fit in a comparison."""
_COLUMNS = {
    "model": "label",
    "n parameters": "n_parameters",
    "inner lengths out N": "lolo_interior_rmse_N",
    "rmse N": "rmse_N",
    "pressures out N": "lopo_rmse_N",
    "lengths out N": "lolo_rmse_N",
    "max error N": "max_error_N",
}
"""Columns of the table, and their keys in `compare.json`; "out" is the held-out RMSE."""


def compare(
    data: str = "DMSP-20-300",
    *,
    models: tuple[str, ...] = (),
    own: tuple[str, ...] = (),
    specimen: tuple[str, ...] = (),
    column: Columns = (),
    output: Path = Path("famjax-compare"),
    jobs: Jobs = None,
    json_: bool = False,
) -> int:
    """Fit published static force models, and famjax's own, to one force map.

    Each model is fitted to all loaded readings, and cross-validated by pressure and by length
    ("pressures out", "lengths out"; inner lengths exclude the longest and the shortest). The table is
    sorted by the held-out error on inner lengths, which is missing if the other readings do not
    determine the model. All models take a minute or two.

    Writes `compare.json`. Finished rows are stored in `rows.jsonl`, from which an interrupted comparison
    resumes.

    Parameters
    ----------
    data
        Read this CSV file or bundled map, as for `famjax fit`.
    models
        Fit only these models, repeatable. An unknown name prints the list of models.
    own
        Add a model of your own, module:Class, repeatable: `--own my_model:Gent`. It may be a complete
        model, or a law, geometry or force term, which is identified with the rest of a muscle.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    column
        Name the column of a quantity that is not recognised, as for `famjax fit`, repeatable.
    output
        Write the files to this folder; it is created if missing.
    jobs
        Set the number of processes.
    json_
        Print one JSON object and nothing else.
    """
    fitting = load_fitting()
    from famjax.boundary.files import Origin, check_output
    from fitting.specimen import parse_specimen

    place = Output(output)
    add_cwd_to_path()
    measured = load_map(data, parse_specimen(specimen), column)
    check_output(output)
    output.mkdir(parents=True, exist_ok=True)
    kept = output / "rows.jsonl"
    with progress("comparing") as show:
        table = fitting.compare(
            measured, models or None, own=own, starts=_STARTS, executor=jobs, resume=kept,
            progress=show,
        )  # fmt: skip
    origin = Origin.of_this_command().as_dict()
    document = {**table.as_dict(), "origin": origin, "starts": _STARTS, "seed": 0}
    paths = place.write({"compare.json": document})
    kept.unlink()
    if json_:
        print_json(document)
        return 0
    rows = [{name: row[key] for name, key in _COLUMNS.items()} for row in document["models"]]
    print_rows(f"{document['specimen']}, largest force {document['max_force_N']:.5g} N", rows)
    for row in document["models"]:
        bounds = f"at a bound: {', '.join(row['at_bound'])}" if row["at_bound"] else ""
        if remarks := "; ".join(filter(None, (bounds, row["note"]))):
            print(f"note: {row['label']}: {remarks}")
    place.tell(paths)
    return 0


def series(
    *data: str,
    column: Columns = (),
    law: tuple[str, ...] = (),
    free: tuple[str, ...] = (),
    bounds: tuple[str, ...] = (),
    constraint: Constraint = "drucker",
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    ends: Ends = "cylinder",
    output: Path = Path("famjax-series"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Identify several muscles of a series together, to predict muscles of other lengths.

    All specimens share braid, bladder and rig; only the length differs. Each law, with and without a
    deadband and a compliant rig, is cross-validated over specimens. The first law with a held-out error
    at most half above the smallest is kept. Predictions average it with up to two more models with the
    same law.

    Writes `fit.json`, for `famjax predict fit.json --rest-length 132mm`, and prints a verdict. The exit
    code is 1 if nothing was identified.

    Parameters
    ----------
    data
        Read these CSV files, one per specimen, with the lines `# specimen: name = ...` and
        `# specimen: rest_length_mm = ...`.
    column
        Name the column of a quantity that is not recognised, as for `famjax fit`, repeatable.
    law
        Try these laws, repeatable; default: linear, mooney-rivlin and ogden. linear and cubic are
        polynomials; other names, and module:Class, are as for `famjax fit`.
    free
        Identify another parameter in all models, repeatable: series_compliance, series_exponent,
        deadband_pressure, end_length, braid_compliance.
    bounds
        Replace bounds, name_unit=min:max, repeatable. A single value fixes the parameter:
        `--bounds series_compliance_mm/N=0` for a rigid rig.
    constraint
        Restrict the law: none, positive, slope or drucker, as for `famjax fit`.
    geometry
        Wrap the cylinder in a geometry of your own, module:Class, as for `famjax fit`. The class must have
        a method cut_to_length.
    term
        Add a force term of your own, module:Class, repeatable, as for `famjax fit`.
    ends
        Choose the model of the ends: cylinder, or equilibrium to try each law also with the shape from
        mechanics, which takes minutes.
    output
        Write the file to this folder; it is created if missing.
    units
        Choose the units of the tables: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print one JSON object and nothing else.
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
    maps = [load_map(one, {}, column) for one in data]
    parts, declared = own_parts(maps, geometry, term)
    kinds = parameter_kinds(*(one for one in law if ":" in one))
    kinds |= {name: one.kind for name, one in declared.items()}
    said = parse_free(free, kinds) | {
        name: fitting.Parameter(min=low, max=high, unit=si_unit(kinds.get(name, "stress")))
        for name, (low, high) in parse_bounds(bounds, kinds).items()
    }
    with progress("identifying") as show:
        found = fitting.identify_series(
            maps, laws=law or DEFAULT_LAWS, parameters=said | taking_part(declared, said),
            constraint=constraint, ends=ends, **parts,
            progress=lambda name, done, total: show(done, total, name),
        )  # fmt: skip
    judgement = judge_series(found.specimens, found.left_out)
    document = fitting.saved.series_as_dict(found, Origin.of_this_command())
    paths = place.write({"fit.json": document})
    if json_:
        said = {key: document[key] for key in ("verdict", "reasons", "parameters")}
        print_json(document["series"] | said)
    else:
        values = fitting.saved.summary_as_dict(found.specimens[0], units)["parameters"]
        _print_series(document, values, units)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print_series(document: Mapping[str, Any], values: Mapping[str, Any], system: str) -> None:
    from famjax.boundary.units import Quantity, text_in_units, unit_system

    units, found = unit_system(system), document["series"]
    errors = found["leave_one_specimen_out_N"]
    families = [{"family": name, "left_out_rmse_N": error} for name, error in errors.items()]
    print_rows("Models, by held-out error over specimens", in_units(families, units))
    columns = ("name", "rest_length_m", "max_force_N", "rmse_N", "predicted_rmse_N")
    specimens = [{key: one[key] for key in columns} for one in found["specimens"]]
    title = f"Specimens, with {found['family']}; predictions average {found['averaged']} models"
    print_rows(title, in_units(specimens, units))
    shared = [
        {"parameter": name, "value": of["value"], "unit": of["unit"], "std_error": of["stderr"]}
        for name, of in values.items()
    ]
    print_rows("Shared parameters", shared)
    told = [document["unchecked"], *document["reasons"][1:], *document["warnings"]]
    for note in filter(None, told):
        print(f"note: {text_in_units(note, system)}")
    reason = text_in_units(" ".join(document["reasons"][:1]), system)
    predicted = Quantity(found["predicted_rmse_N"], "force", 3).in_units(system)
    print_lines([
        ("verdict", f"{document['verdict'].capitalize()}. {reason}".strip()),
        ("RMSE", f"{predicted} on held-out specimens."),
    ])  # fmt: skip


def ramps(
    *records: str,
    atmosphere: Annotated[str, Signed],
    specimen: tuple[str, ...] = (),
    column: Columns = (),
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

    Writes `map.csv` (for `famjax fit`), `ramps.png`, `ramps.json` and, if records were filled and
    vented, `branches.csv` (for `famjax assess --hysteresis`).

    Parameters
    ----------
    records
        Read these raw records, each with its length: `test8.csv=73.25mm`; or a CSV file with the
        columns `file,length_mm`.
    atmosphere
        State the pressure reading at atmosphere, `8.94kPa`, or the interval in which the muscle is vented
        in each record, `0s:0.5s`.
    specimen
        Describe the muscle, key_unit=value, repeatable; rest_length is required.
    column
        Name the column of a quantity that is not recognised: `force="Kraft [N]"`, by name or number, with
        the unit, repeatable; `pressure=-` ignores a column. Also `decimal=,` and, for absolute
        pressures, `atmosphere=101.3kPa`.
    branches
        Choose the branch of the map: both (mean), fill or vent.
    period_s
        Set the time between valve pulses; default: detected from the record.
    step_kPa
        Set the spacing of the pressures of the map.
    slack_below_N
        Set the force below which the muscle does not pull; default: derived from noise and sensor clamp.
    length_std_mm
        State the standard deviation of the lengths.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units of summary, figure and map: si, metric or us.
    json_
        Print one JSON object and nothing else.
    """
    load_fitting()
    from famjax.boundary.files import Origin
    from fitting.records import parse_atmosphere, ramps_command
    from fitting.specimen import parse_specimen

    place = Output(output)
    with progress("reading ramps"):
        summary, files = ramps_command(
            records, atmosphere=parse_atmosphere(atmosphere), columns=parse_columns(column),
            specimen=parse_specimen(specimen), period=period_s, step=step_kPa * 1e3,
            slack_below=slack_below_N, branches=branches, system=units, tell=tell_columns,
            length_std=None if length_std_mm is None else length_std_mm / 1e3,
        )  # fmt: skip
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

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
    print_table,
    progress,
    tell_columns,
    whole,
)

from .fit import Asked, Constraint, load_fitting, load_map

SweptOrders = Annotated[
    tuple[int, ...], Parameter(converter=whole, validator=validators.Number(gte=1, lte=4))
]
"""Orders of the polynomial law in a sweep."""
_SWEPT = {
    "pressure": "dependence", "order": "order", "constraint": "constraint", "rmse_N": "rmse",
    "blocked force error_N": "blocked_error", "free contraction error": "free_contraction_error",
    "bic": "bic", "held-out rmse_N": "cross_validated_rmse", "stability margin_Pa": "margin",
    "verdict": "verdict",
}  # fmt: skip
"""Columns of the sweep table, and their keys in `sweep.json`."""


def sweep(
    data: str = "DMSP-20-300",
    *,
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
    """Fit all combinations of order, pressure dependence and constraint for one geometry.

    Writes `sweep.json` with all fits in SI. The geometry is first identified as by
    `famjax fit --law polynomial`.

    Parameters
    ----------
    data
        Read this CSV file or bundled map, as for `famjax fit`.
    order
        Try these orders of the polynomial law, from 1 to 4 (repeatable).
    dependence
        Try these pressure dependences of the coefficients (repeatable): fixed, linear, free.
    constraint
        Try these constraints (repeatable): none, positive, slope, drucker.
    objective
        Choose what to minimise. sum_of_squares: the sum of squared residuals; mean_rmse: the RMSE averaged
        over pressures, as in the reference work.
    specimen
        Describe the muscle, key_unit=value (repeatable).
    column
        Assign an unrecognised column to its quantity, as for `famjax fit` (repeatable).
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for the table: si, metric or us.
    json_
        Print one JSON object in SI units and nothing else.
    """
    fitting = load_fitting()
    from famjax.boundary.units import unit_system

    place = Output(output)
    measured = load_map(data, specimen, column)
    with progress("identifying the geometry, sweeping"):
        known = fitting.identify(measured)
        found = fitting.sweep(
            measured, known.muscle.geometry, deadband=known.estimate("deadband_pressure").value,
            orders=order, dependences=dependence, constraints=constraint, objective=objective,
        )  # fmt: skip
    rows = fitting.saved.as_json([row.as_dict() for row in found.rows])
    paths = place.write({"sweep.json": {"rows": rows}})
    if json_:
        print_json({"rows": rows})
        return 0
    shown = [{name: row[key] for name, key in _SWEPT.items()} for row in rows]
    shown = [{**row, "verdict": row["verdict"].partition(":")[0]} for row in shown]
    stress = {**unit_system(units), "pressure": unit_system(units)["stress"]}
    print_rows(f"{len(rows)} fits to {measured.specimen.name}", in_units(shown, stress))
    place.tell(paths)
    return 0


_STARTS = 32
"""Number of starts of each nonlinear fit in a comparison."""
_COLUMNS = {
    "model": "label", "n parameters": "n_parameters", "held-out inner lengths N": "lolo_interior_rmse_N",
    "rmse N": "rmse_N", "held-out pressures N": "lopo_rmse_N", "held-out lengths N": "lolo_rmse_N",
    "max error N": "max_error_N",
}  # fmt: skip
"""Columns of the table, and their keys in `compare.json`; the "held-out" columns contain RMSE values."""


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
    """Compare published static force models with famjax's own on one force map.

    Each model is fitted to all loaded readings and cross-validated by pressure and by length
    ("held-out" columns; inner lengths exclude the longest and the shortest). The table is
    sorted by the held-out error at inner lengths, which is missing if the other readings do not
    determine the model. Fitting all models takes a minute or two.

    Writes `compare.json`. Finished rows are stored in `rows.jsonl`, from which an interrupted comparison
    resumes.

    Parameters
    ----------
    data
        Read this CSV file or bundled map, as for `famjax fit`.
    models
        Fit only these models (repeatable). For an unknown name, the error message lists all models.
    own
        Add your own model, module:Class (repeatable), as in `--own my_model:Gent`. It may be a complete
        model, or a law, geometry or force term, which is then identified with the rest of the muscle.
    specimen
        Describe the muscle, key_unit=value (repeatable).
    column
        Assign an unrecognised column to its quantity, as for `famjax fit` (repeatable).
    output
        Write the files to this folder; it is created if missing.
    jobs
        Set the number of processes.
    json_
        Print one JSON object in SI units and nothing else.
    """
    fitting = load_fitting()
    from famjax.boundary.files import Origin

    place = Output(output)
    add_cwd_to_path()
    measured = load_map(data, specimen, column)
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
        stopped = [f"{name} is at a bound" for name in row["at_bound"]]
        if remarks := "; ".join(filter(None, (*stopped, row["note"]))):
            print(f"note: {row['label']}: {remarks}")
    place.tell(paths)
    return 0


def series(
    *data: str,
    column: Columns = (),
    law: tuple[str, ...] = (),
    free: tuple[str, ...] = (),
    bounds: tuple[str, ...] = (),
    output: Path = Path("famjax-series"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Identify several muscles of one series together, to predict muscles of other lengths.

    All specimens must have the same braid, bladder and rig; only the length differs. Each law, with and
    without a deadband and a compliant rig, is cross-validated over specimens. The first law with a held-out
    error of at most 1.5 times the smallest is kept. Predictions are averaged over this model and up to two
    more models with the same law.

    Writes `fit.json`, for use with `famjax predict fit.json --rest-length 132mm`, and prints a verdict. The
    exit code is 1 if no muscle was identified.

    Parameters
    ----------
    data
        Read these CSV files, one for each specimen, with the lines `# specimen: name = ...` and
        `# specimen: rest_length_mm = ...`.
    column
        Assign an unrecognised column to its quantity, as for `famjax fit` (repeatable).
    law
        Try these laws (repeatable); default: linear, mooney-rivlin and ogden. linear and cubic are
        polynomial laws; other names, and module:Class, are as for `famjax fit`.
    free
        Also identify this parameter in all models (repeatable): series_compliance, series_exponent,
        deadband_pressure, end_length, braid_compliance.
    bounds
        Set the bounds on a parameter, name_unit=min:max (repeatable). A single value fixes the parameter,
        as in `--bounds series_compliance_mm/N=0` for a rigid rig.
    output
        Write the file to this folder; it is created if missing.
    units
        Choose the units for the tables: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print the contents of `fit.json` and nothing else.
    """
    fitting = load_fitting()
    from famjax.boundary.files import Origin
    from famjax.boundary.units import si_unit
    from fitting.report import parameter_table
    from fitting.series import DEFAULT_LAWS
    from fitting.verdict import judge_series

    from .problem import identify_options

    place = Output(output)
    add_cwd_to_path()
    maps = [load_map(one, (), column) for one in data]
    laws = [one for one in law if ":" in one]
    options, kinds = identify_options(maps, Asked(free=free, bounds=bounds), laws)
    options["parameters"] |= {
        name: fitting.Parameter(min=low, max=high, unit=si_unit(kinds[name]))
        for name, (low, high) in options.pop("bounds").items()
    }
    with progress("identifying") as show:
        found = fitting.identify_series(
            maps, laws=law or DEFAULT_LAWS, **options,
            progress=lambda name, done, total: show(done, total, name),
        )  # fmt: skip
    judgement = judge_series(found.specimens, found.left_out)
    document = fitting.saved.series_as_dict(found, Origin.of_this_command())
    paths = place.write({"fit.json": document})
    if json_:
        print_json(document)
    else:
        _print_series(document, parameter_table(found.specimens[0], units), units)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print_series(document: Mapping[str, Any], shared: tuple[str, Any, Any], system: str) -> None:
    from famjax.boundary.units import Quantity, sentence_in_units, unit_system

    units, found = unit_system(system), document["series"]
    errors = found["leave_one_specimen_out_N"]
    families = [{"family": name, "left_out_rmse_N": error} for name, error in errors.items()]
    print_rows("Error of each model on held-out specimens", in_units(families, units))
    title = f"Specimens, fitted with {found['family']}"
    print_rows(title, in_units(found["specimens"], units))
    print_table("Shared parameters", *shared[1:])
    first, *further = *document["reasons"], ""
    for note in filter(None, (document["unchecked"], *further, *document["warnings"])):
        print(f"note: {sentence_in_units(note, system)}")
    predicted = Quantity(found["predicted_rmse_N"], "force", 3).in_units(system)
    verdict = f"{document['verdict'].capitalize()}. {sentence_in_units(first, system)}".strip()
    print_lines([("verdict", verdict), ("RMSE", f"{predicted} on held-out specimens.")])


def ramps(
    *records: str,
    atmosphere: Annotated[str, Signed],
    specimen: tuple[str, ...] = (),
    column: Columns = (),
    step_kPa: Annotated[float, Parameter(name="--step-kPa")] = 25.0,
    slack_below_N: Annotated[float | None, Parameter(name="--slack-below-N")] = None,
    output: Path = Path("famjax-ramps"),
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Turn raw isometric pressure ramps into a static force map with its noise and hysteresis.

    Writes `map.csv` (for `famjax fit`), `ramps.png`, `ramps.json` and, if the records include filling and
    venting, `branches.csv` (for `famjax assess --hysteresis`).

    Parameters
    ----------
    records
        Read these raw records, each with its length, as in `test8.csv=73.25mm`; or a CSV file that lists
        them in the columns `file,length_mm`.
    atmosphere
        Specify the pressure sensor's reading when the muscle is vented, such as `8.94kPa`.
    specimen
        Describe the muscle, key_unit=value (repeatable); rest_length is required.
    column
        Assign an unrecognised column to its quantity by the column's name or number, with the unit
        (repeatable), as in `force="Kraft [N]"`. Use `pressure=-` to ignore a column, `decimal=,` for
        decimal commas, and `atmosphere=101.3kPa` for absolute pressures.
    step_kPa
        Set the spacing between the pressures in the map.
    slack_below_N
        Set the force below which the muscle counts as slack. By default it is derived from the noise and
        the sensor's lower limit.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for summary, figure and map: si, metric or us.
    json_
        Print one JSON object in SI units and nothing else.
    """
    load_fitting()
    from famjax.boundary.files import Origin
    from famjax.boundary.units import parse_quantity, unit_system
    from fitting.records import ramps_command
    from fitting.specimen import parse_specimen

    place = Output(output)
    with progress("reading ramps"):
        summary, files = ramps_command(
            records, atmosphere=parse_quantity(atmosphere, "pressure"), columns=parse_columns(column),
            specimen=parse_specimen(specimen), step=step_kPa * 1e3, slack_below=slack_below_N,
            system=units, tell=tell_columns,
        )  # fmt: skip
    origin, said = Origin.of_this_command(), unit_system(units)
    rows = {name: in_units(summary[name], said) for name in ("records", "lengths")}
    summary = {**in_units([summary], said)[0], **rows, "origin": origin.as_dict()}
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

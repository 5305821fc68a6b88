"""The command `famjax`. Every command is one call of the library, its result printed and saved."""

import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

# jaxlib on few cores can hang when two threads run batched LAPACK at once; this must be set first.
os.environ.setdefault("PJRT_NPROC", "16")

try:
    from cyclopts import App, CycloptsError, Parameter
    from rich.console import Console
    from rich.progress import Progress
    from rich.table import Table
except ImportError as missing:
    sys.exit(
        f"the famjax command needs its extra 'app' ({missing}); install it with\n"
        '    python -m pip install "famjax[app]"'
    )

from . import __version__

if TYPE_CHECKING:
    from fitting import Evidence, Identification

app = App(
    name="famjax",
    version=f"famjax {__version__}",
    help="Fluidic artificial muscles: from measured force maps to identified, stable models.",
    help_format="markdown",
)


@app.command
def fit(
    data: str = "DMSP-20-300",
    *,
    law: Literal["polynomial", "ogden", "mooney-rivlin", "saturating", "monotone"] = "polynomial",
    order: int | None = None,
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker",
    dependence: Literal["fixed", "linear", "free"] = "fixed",
    box: Literal["physical", "open"] = "physical",
    bounds: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    free: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    prior: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    noise_N: Annotated[float | None, Parameter(name="--noise-N")] = None,
    validate: Annotated[bool, Parameter(negative=())] = False,
    profile: Annotated[bool, Parameter(negative=())] = False,
    bootstrap: int = 0,
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    starts: int = 16,
    seed: int = 0,
    output: Path = Path("famjax-fit"),
    units: Literal["si", "metric", "us"] = "metric",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Identify a muscle from a measured force map.

    Writes `fit.json` (everything, SI), `fit.png` and `report.html` into the output folder.

    Parameters
    ----------
    data
        CSV file with columns such as `pressure_psi,length_in,force_lbf`, or the name of a bundled
        map (DMSP-20-300, DMSP-10-250). Lines `# specimen: rest_length_mm = 296` describe the muscle.
    law
        Of the bladder: polynomial in strain, one-term Ogden, Mooney-Rivlin, saturating, or monotone
        (tangent modulus >= 0 at knots).
    order
        Order of the polynomial law, sigma = E_1 eps + E_2 eps|eps| + ...; 3 unless given.
    constraint
        none; positive: E_n >= 0; slope: stress rises on the strain range; drucker: stable along
        the actuation path.
    dependence
        Of the coefficients on pressure: fixed (none), linear, or free at each pressure.
    box
        physical: the geometry of a buildable muscle (braid diameter from the bore to 3.6 mm above,
        braid angle 60 to 70 deg to the circumference); open: geometry as a fit parameter.
    bounds
        Replace bounds, name_unit=min:max, repeatable: `--bounds braid_diameter_mm=20:23.6`.
        One value holds the parameter: `--bounds deadband_pressure_kPa=40`.
    free
        Parameters that take part besides braid diameter, angle and deadband, repeatable:
        end_factor (rounded ends), rest_length, braid_compliance (stretch of all threads),
        series_compliance (of the rig). `--bounds` and `--prior` make them take part too.
    prior
        What is known of a parameter, name_unit=mean+-std, repeatable: `--prior
        rest_length_mm=296+-0.5`; `--prior length_offset_mm=0+-0.25` for errors of every length.
    noise_N
        Standard deviation of one reading, against which priors are weighed.
    validate
        Also leave out each pressure and each length, and predict it.
    profile
        Also hold each parameter beside its optimum: which are identified, and how far.
    bootstrap
        Number of bootstrap replicates for standard errors and prediction bands.
    specimen
        Describe the muscle, key_unit=value, repeatable: `--specimen rest_length_mm=296`. Keys:
        rest_length, wall_thickness, nominal_diameter, bladder_diameter, braid_thickness (with a
        unit), embedded (true or false: threads inside the wall), name.
    starts
        Number of starts of the geometry.
    seed
        Of the starts; the same seed gives the same result.
    output
        Folder for the files, made if need be.
    units
        Of table, picture and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = _fitting()
    from fitting._evidence import gather  # noqa: PLC0415
    from fitting._options import (  # noqa: PLC0415
        parse_bounds,
        parse_free,
        parse_priors,
        parse_specimen,
    )
    from fitting._report import check_output, write_fit  # noqa: PLC0415

    check_output(output)
    measured = _load(data, parse_specimen(specimen))
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task(f"identifying {measured.specimen.name}", total=starts)
        result = fitting.identify(
            measured,
            law=law,
            order=order,
            constraint=constraint,
            dependence=dependence,
            box=box,
            bounds=parse_bounds(bounds),
            parameters=parse_free(free) | parse_priors(prior),
            noise=noise_N,
            starts=starts,
            seed=seed,
            progress=lambda done, total: progress.update(task, completed=done, total=total),
        )

        def show(what: str, done: int, total: int) -> None:
            progress.update(task, description=what, completed=done, total=total)

        evidence = gather(
            result,
            validation=validate,
            profiles=profile,
            replicates=bootstrap,
            seed=seed,
            progress=show,
        )
        paths = write_fit(result, output, units, evidence)
    if json_:
        print(json.dumps(fitting.summary_as_dict(result, units, evidence), allow_nan=False))
    else:
        _print_fit(result, units, evidence)
        print("written:", ", ".join(str(path) for path in paths))
    return 0 if result.converged else 1


def _fitting():
    """The fitting package, with JAX in float64."""
    from . import require  # noqa: PLC0415

    fitting = require("fitting")
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    return fitting


def _load(data: str, specimen: dict):
    from fitting import bundled_names, load_bundled, read_csv  # noqa: PLC0415

    if data.upper() in bundled_names() and not Path(data).exists():
        return load_bundled(data.upper(), specimen)
    return read_csv(data, specimen)


def _print_fit(result: "Identification", units: str, evidence: "Evidence") -> None:
    from fitting._report import notes, tables, verdict  # noqa: PLC0415

    console = Console(highlight=False)
    console.print(f"[bold]{result.data.specimen.name}[/bold]  ({result.data.source})")
    for title, header, rows in tables(result, units, evidence):
        table = Table(title=title, title_justify="left", box=None, pad_edge=False)
        for column, name in enumerate(header):
            table.add_column(name, justify="left" if column == 0 else "right", overflow="fold")
        for row in rows:
            table.add_row(*row)
        console.print()
        console.print(table)
    console.print()
    for warning in notes(result, evidence):
        console.print(f"note: {warning}", markup=False)
    console.print(verdict(result), style="bold", markup=False)


@app.command
def sweep(
    data: str = "DMSP-20-300",
    *,
    braid_diameter: str | None = None,
    braid_angle: str | None = None,
    deadband: str | None = None,
    order: Annotated[tuple[int, ...], Parameter(negative=())] = (1, 2, 3, 4),
    objective: Literal["sum_of_squares", "mean_rmse", "huber"] = "sum_of_squares",
    bootstrap: int = 0,
    seed: int = 0,
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    output: Path = Path("famjax-sweep"),
    units: Literal["si", "metric", "us"] = "metric",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Fit every permutation of order, pressure dependence and constraint at one geometry.

    Writes `sweep.jsonl`, from which a stopped sweep goes on, and pictures of errors and force
    curves. Without a geometry the one that `famjax fit` identifies with its standard law is taken.

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
    order
        Orders of the law, repeatable, 1 to 4.
    objective
        sum_of_squares; mean_rmse: mean over pressures of the RMSE, as the reference work; huber.
    bootstrap
        Number of replicates for standard deviations of the coefficients.
    seed
        Of the replicates; the same seed writes the same bytes.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    output
        Folder for the files, made if need be.
    units
        Of tables and pictures: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = _fitting()
    from fitting._options import parse_specimen  # noqa: PLC0415
    from fitting._quantities import parse_quantity  # noqa: PLC0415
    from fitting._sweep_command import sweep_command  # noqa: PLC0415

    measured = _load(data, parse_specimen(specimen))
    given = {"braid_diameter": braid_diameter, "braid_angle": braid_angle, "deadband": deadband}
    missing = [name for name, text in given.items() if text is None]
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("identifying the geometry", total=None)
        if len(missing) == len(given):
            found = fitting.identify(measured, seed=seed)
            geometry = {name: found.estimate(name).value for name in
                        ("braid_diameter", "braid_angle", "deadband_pressure")}  # fmt: skip
        elif missing:
            raise fitting.InputError(
                f"the geometry needs {', '.join(given)} together, or none of them to identify it; "
                f"missing: {', '.join(missing)}"
            )
        else:
            geometry = {
                "braid_diameter": parse_quantity(str(braid_diameter), "length"),
                "braid_angle": parse_quantity(str(braid_angle), "angle"),
                "deadband_pressure": parse_quantity(str(deadband), "pressure"),
            }
        document, paths = sweep_command(
            [measured],
            geometry=geometry,
            orders=order,
            objective=objective,
            bootstrap=bootstrap,
            seed=seed,
            output=output,
            units=units,
            progress=lambda done, total: progress.update(
                task, description="sweeping", completed=done, total=total
            ),
        )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    # What cannot be said in a word is said once, below the table.
    told = {"stable", "not stable"}
    sentences = dict.fromkeys(r["verdict"] for r in document["rows"] if r["verdict"] not in told)
    marks = {sentence: f"see ({k})" for k, sentence in enumerate(sentences, 1)}
    rows = [
        {**row, "verdict": marks.get(row["verdict"], row["verdict"])} for row in document["rows"]
    ]
    for row in rows:
        del row["data"]
    _print_rows(f"{len(rows)} fits of {measured.specimen.name}", rows)
    for k, sentence in enumerate(sentences, 1):
        print(f"({k}) {sentence}")
    print("written:", ", ".join(str(path) for path in paths))
    return 0


@app.command
def compare(
    data: str = "DMSP-20-300",
    *,
    models: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    starts: int = 32,
    seed: int = 0,
    output: Path = Path("famjax-compare"),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Fit every published static force model, and famjax's own, to one force map.

    Each is fitted to all loaded readings, and again without each pressure and each length, which it
    then predicts. Writes `compare.json` and `compare.png`.

    Parameters
    ----------
    data
        CSV file or the name of a bundled map, as for `famjax fit`.
    models
        Names of the models, repeatable; all unless given. An unknown one prints those there are.
    specimen
        Describe the muscle, key_unit=value, repeatable.
    starts
        Of each nonlinear fit.
    seed
        Of the starts; the same seed gives the same table.
    output
        Folder for the files, made if need be.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = _fitting()
    from fitting._compare_plot import plot_comparison  # noqa: PLC0415
    from fitting._options import parse_specimen  # noqa: PLC0415
    from fitting._report import as_png, check_output, write_all  # noqa: PLC0415

    check_output(output)
    measured = _load(data, parse_specimen(specimen))
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("comparing", total=None)

        def show(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, description=name)

        table = fitting.compare(measured, models or None, starts=starts, seed=seed, progress=show)
    document = table.as_dict()
    content = json.dumps(document, indent=1, allow_nan=False).encode()
    paths = write_all(
        output, {"compare.json": content, "compare.png": as_png(plot_comparison(table))}
    )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    columns = ("label", "n_parameters", "rmse_N", "lopo_rmse_N", "lolo_interior_rmse_N",
               "lolo_rmse_N", "max_error_N")  # fmt: skip
    rows = [{key: row[key] for key in columns} for row in document["models"]]
    _print_rows(f"{document['specimen']}, largest force {document['max_force_N']:.5g} N", rows)
    for row in document["models"]:
        remarks = [f"at a bound: {', '.join(row['at_bound'])}"] if row["at_bound"] else []
        remarks += [row["note"]] if row["note"] else []
        if remarks:
            print(f"note: {row['label']}: {'; '.join(remarks)}")
    print("written:", ", ".join(str(path) for path in paths))
    return 0


@app.command
def ramps(
    *records: str,
    atmosphere: str,
    specimen: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    columns: str | None = None,
    branches: Literal["both", "fill", "vent"] = "both",
    period_s: float | None = None,
    step_kPa: Annotated[float, Parameter(name="--step-kPa")] = 25.0,
    slack_below_N: Annotated[float | None, Parameter(name="--slack-below-N")] = None,
    length_std_mm: float | None = None,
    output: Path = Path("famjax-ramps"),
    units: Literal["si", "metric", "us"] = "metric",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Turn raw isometric pressure ramps into a static force map with its noise and hysteresis.

    Writes `map.csv` (which `famjax fit` reads), `ramps.png` and `ramps.json`.

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
        Folder for the files, made if need be.
    units
        Of summary, picture and map: si, metric or us.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    _fitting()
    from fitting._options import parse_specimen  # noqa: PLC0415
    from fitting._ramp_command import parse_atmosphere, ramps_command  # noqa: PLC0415
    from fitting._report import check_output, write_all  # noqa: PLC0415

    check_output(output)
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
    paths = write_all(output, files)
    if json_:
        print(json.dumps(summary, allow_nan=False))
        return 0
    _print_rows("Records", summary["records"])
    _print_rows("Lengths", summary["lengths"])
    print("written:", ", ".join(str(path) for path in paths))
    return 0


@app.command
def predict(
    fit_json: Path,
    *,
    length: tuple[str, ...],
    pressure: tuple[str, ...] = (),
    onset: Annotated[bool, Parameter(negative=())] = False,
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Predict the force of a fitted muscle, and the pressure at which it begins to pull.

    Parameters
    ----------
    fit_json
        A `fit.json` that `famjax fit` has written.
    length
        Active lengths with their unit, repeatable or separated by commas: `--length 270mm,250mm`.
    pressure
        Gauge pressures with their unit: `--pressure 500kPa`.
    onset
        Also the pressure at which the force leaves zero at each length.
    json_
        Print one JSON list to standard output and nothing else there.
    """
    fitting = _fitting()
    import numpy as np  # noqa: PLC0415

    from fitting._quantities import parse_quantities  # noqa: PLC0415

    saved = fitting.load_fit(fit_json)
    rows = fitting.predict(
        saved,
        np.array(parse_quantities(length, "length")),
        np.array(parse_quantities(pressure, "pressure")),
        onset=onset,
    )
    if json_:
        print(json.dumps(rows, allow_nan=False))
        return 0
    for title, key in (("Force", "force_N"), ("Onset", "onset_pressure_Pa")):
        chosen = [row for row in rows if key in row]
        if chosen:
            _print_rows(title, chosen)
    if not all(row["inside"] for row in rows):
        print("note: rows that are not inside lie beyond the fitted lengths or pressures")
    if saved.document.get("series_compliance_m_per_N"):
        print("note: the forces are those of the muscle itself; the rig of the fit gave way")
    return 0


@app.command
def design(
    require: Annotated[tuple[str, ...], Parameter(negative=())] = ("pressure_psi=100",),
    *,
    catalogue: Annotated[tuple[Path, ...], Parameter(negative=())] = (),
    bundled: bool = True,
    tube: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    rest_length_mm: float = 235.74375,
    output: Path = Path("famjax-design"),
    units: Literal["si", "metric", "us"] = "us",
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Search a catalogue of braids, bladders and tubes for a muscle that meets a requirement.

    Writes `design.json` (all rows, also force and diameter over contraction) and `design.png`.

    Parameters
    ----------
    require
        What the muscle must do, key_unit=value, repeatable: pressure_psi=100, force_lbf=900 (at
        force_contraction, else blocked), contraction=0.3, largest_diameter_in=2.2,
        force_contraction=0.1. The pressure is needed.
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
    output
        Folder for the files, made if need be.
    units
        Of tables and files: si, metric (mm, kPa, N) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    _fitting()
    from fitting._report import check_output, write_all  # noqa: PLC0415

    from ._design_command import design_document, design_picture  # noqa: PLC0415
    from ._design_options import parse_requirement, parse_tube  # noqa: PLC0415

    check_output(output)
    document = design_document(
        parse_requirement(require),
        catalogue,
        bundled=bundled,
        rest_length=rest_length_mm / 1e3,
        system=units,
        tube=parse_tube(tube),
    )
    content = json.dumps(document, indent=1, allow_nan=False).encode()
    paths = write_all(
        output, {"design.json": content, "design.png": design_picture(document, units)}
    )
    if json_:
        print(json.dumps(document, allow_nan=False))
        return 0
    _print_rows("Braid angle of each braid on each bladder", document["braid_angles"])
    _print_rows("Candidates, the best first", document["candidates"])
    usable = [row for row in document["end_fittings"] if row["feasible"]]
    _print_rows("End-fittings that enter the bladder's bore", usable)
    _print_rows("Buckling of the swage tubes in the die", document["tube_buckling"])
    _print_rows("Safety factors of tested muscles", document["safety_factors"])
    for note in document["notes"]:
        print("note:", note)
    print("written:", ", ".join(str(path) for path in paths))
    return 0


@app.command
def reproduce(
    *,
    output: Path = Path("famjax-reproduce"),
    json_: Annotated[bool, Parameter(name="--json", negative=())] = False,
) -> int:
    """Compute the reference work's tables and put them beside its printed figures.

    Needs a clone of the repository, where the code of the benchmarks lies beside the packages.

    Parameters
    ----------
    output
        Folder for the page with tables and figures, made if need be.
    json_
        Print the rows as one JSON list to standard output and nothing else there; chapter 7's fits
        of a synthetic reconstruction, which have no verdict, are on the page without this option.
    """
    _fitting()
    from fitting import InputError  # noqa: PLC0415
    from fitting._report import check_output  # noqa: PLC0415

    folder = Path(__file__).resolve().parents[1] / "benchmarks"
    if not (folder / "reproduce.py").exists():
        raise InputError(
            f"'famjax reproduce' runs in a clone of the repository; {folder} has no reproduce.py"
        )
    check_output(output)
    sys.path.insert(0, str(folder))
    from importlib import import_module  # noqa: PLC0415

    benchmark = import_module("reproduce")
    with Progress(console=Console(stderr=True), transient=True) as progress:
        task = progress.add_task("reproducing", total=None)

        def show(done: int, total: int, name: str) -> None:
            progress.update(task, completed=done, total=total, description=name)

        found = benchmark.reproduce(progress=show)
        synthetic = None
        if not json_:
            progress.update(task, description="chapter 7, on a synthetic reconstruction")
            synthetic = benchmark.synthetic_fits()
        paths = benchmark.write_page(output, found, synthetic)
    rows = [row.as_dict() for row in found]
    if json_:
        print(json.dumps(rows, allow_nan=False))
        return 0
    compared = [row for row in rows if row["within"] is not None]
    out = [row for row in compared if not row["within"]]
    if out:
        _print_rows("Out of tolerance", out)
    print(
        f"{len(compared) - len(out)} of {len(compared)} printed figures within tolerance; "
        f"{len(rows) - len(compared)} more computed that have no printed figure here"
    )
    print("written:", ", ".join(str(path) for path in paths))
    return 0


def _print_rows(title: str, rows: list[dict]) -> None:
    """A table of rows that share their keys; lists are left to the JSON file."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    for key in keys:
        table.add_column(key.replace("_", " "), overflow="fold")
    for row in rows:
        table.add_row(*(_cell(row[key]) for key in keys))
    console = Console(highlight=False)
    console.width = max(console.width, 130)  # folded cells are harder to read than long lines
    console.print()
    console.print(table if rows else f"{title}: none", markup=False)


def _cell(value: object) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


@app.command
def doctor() -> int:
    """Report versions, devices, precision and name clashes; exit code 1 if something is wrong."""
    from ._doctor import problems, versions  # noqa: PLC0415

    print(f"famjax {__version__}")
    for name, version in versions().items():
        print(f"  {name} {version}")
    import jax  # noqa: PLC0415

    print("devices:", ", ".join(str(device) for device in jax.devices()))
    print(
        "float64:",
        "on" if jax.config.read("jax_enable_x64") else "off in this process (JAX's default)",
        "- the famjax commands that identify switch it on themselves",
    )
    found = problems()
    for problem in found:
        print("problem:", problem)
    if not found:
        print("no problems found")
    return 1 if found else 0


def main(arguments: list[str] | None = None) -> None:
    """Run the command line: exit code 0 done, 1 no certified result, 2 bad input, 130 stopped."""
    from fitting import InputError  # noqa: PLC0415

    from .design import CatalogueError  # noqa: PLC0415

    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        print(f"famjax: {error}\nTry 'famjax --help'.", file=sys.stderr)
        sys.exit(2)
    except (InputError, CatalogueError) as error:
        print(f"famjax: {error}", file=sys.stderr)
        sys.exit(2)
    except KeyboardInterrupt:
        print(
            "famjax: stopped; nothing was written but the finished parts of a sweep, which goes on "
            "when it is run again",
            file=sys.stderr,
        )
        sys.exit(130)
    sys.exit(code or 0)


if __name__ == "__main__":
    main()

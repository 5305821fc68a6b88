"""`famjax fit` and `famjax predict`."""

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.console import Console
from rich.table import Table

from .loading import load_fitting, load_map
from .matplotlib_import import load_matplotlib
from .terminal import print_rows

if TYPE_CHECKING:
    from fitting import Identification
    from fitting.evidence import Evidence


def fit(
    data: str = "DMSP-20-300",
    *,
    law: str = "polynomial",
    order: int | None = None,
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker",
    dependence: Literal["fixed", "linear", "free"] = "fixed",
    box: Literal["physical", "open"] = "physical",
    bounds: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    free: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    prior: Annotated[tuple[str, ...], Parameter(negative=())] = (),
    noise_N: Annotated[float | None, Parameter(name="--noise-N")] = None,
    objective: Literal["sum_of_squares", "huber"] = "sum_of_squares",
    pressure_tolerance: str | None = None,
    length_tolerance: str | None = None,
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
        Of the bladder: polynomial in strain, ogden (one term), mooney-rivlin, saturating, monotone
        (tangent modulus >= 0 at knots), neo-hookean or yeoh; or module:Class for a law of your own,
        in a file of the folder that you start from: `--law my_rubber:Gent`.
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
        end_factor or end_length (rounded ends), rest_length, braid_compliance (stretch of all
        threads), series_compliance (of the rig). `--bounds` and `--prior` make them take part too.
    prior
        What is known of a parameter, name_unit=mean+-std, repeatable: `--prior
        rest_length_mm=296+-0.5`; `--prior length_offset_mm=0+-0.25` for errors of every length.
    noise_N
        Standard deviation of one reading, against which priors are weighed.
    objective
        sum_of_squares; huber: robust, so that single bad readings count little.
    pressure_tolerance
        Readings nearer than this are at one pressure: `--pressure-tolerance 1kPa`. Found from the
        gaps between the readings unless given.
    length_tolerance
        The same of lengths: `--length-tolerance 0.2mm`.
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
    fitting = load_fitting()
    load_matplotlib()
    from famjax.boundary.files import check_output
    from famjax.commands.options.fits import (
        parameter_kinds,
        parse_bounds,
        parse_free,
        parse_priors,
        parse_specimen,
    )
    from fitting.evidence import gather
    from fitting.saved import write_fit

    from .terminal import progress_bar

    check_output(output)
    if ":" in law:
        sys.path.insert(0, str(Path.cwd()))  # where a law of the user's own lies
    kinds = parameter_kinds(law) if bounds or free or prior else {}
    measured = load_map(
        data, parse_specimen(specimen), pressure=pressure_tolerance, length=length_tolerance
    )
    with progress_bar() as progress:
        task = progress.add_task(f"identifying {measured.specimen.name}", total=starts)
        result = fitting.identify(
            measured,
            law=law,
            order=order,
            constraint=constraint,
            dependence=dependence,
            box=box,
            bounds=parse_bounds(bounds, kinds),
            parameters=parse_free(free, kinds) | parse_priors(prior, kinds),
            noise=noise_N,
            objective=objective,
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
        print(json.dumps(fitting.saved.summary_as_dict(result, units, evidence), allow_nan=False))
    else:
        _print_fit(result, units, evidence)
        print("written:", ", ".join(str(path) for path in paths))
    return 0 if result.converged else 1


def _print_fit(result: "Identification", units: str, evidence: "Evidence") -> None:
    from fitting.saved import notes, tables, verdict

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


def predict(
    fit_json: Path,
    *,
    length: tuple[str, ...],
    pressure: tuple[str, ...] = (),
    onset: Annotated[bool, Parameter(negative=())] = False,
    rest_length: str | None = None,
    length_std: str | None = None,
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
    rest_length
        Of another muscle of the same series, its braid, bladder and end-fittings the same:
        `--rest-length 200mm`. From a fit of `famjax series` with an error band that knows how
        specimens differ.
    length_std
        Standard deviation of the lengths, for the error band: `--length-std 0.5mm`.
    json_
        Print one JSON list to standard output and nothing else there.
    """
    fitting = load_fitting()
    import numpy as np

    from famjax.boundary.units import parse_quantities

    sys.path.append(str(Path.cwd()))  # where a law of the user's own lies
    saved = fitting.load_fit(fit_json)
    other = None if rest_length is None else parse_quantities((rest_length,), "length")[0]
    spread = 0.0 if length_std is None else parse_quantities((length_std,), "length")[0]
    rows = fitting.predict(
        saved,
        np.array(parse_quantities(length, "length")),
        np.array(parse_quantities(pressure, "pressure")),
        onset=onset,
        rest_length=other,
        length_std=spread,
    )
    if json_:
        print(json.dumps(rows, allow_nan=False))
        return 0
    for title, key in (("Force", "force_N"), ("Onset", "onset_pressure_Pa")):
        chosen = [row for row in rows if key in row]
        if chosen:
            print_rows(title, chosen)
    if not all(row["inside"] for row in rows):
        print("note: rows that are not inside lie beyond the fitted lengths or pressures")
    if saved.document.get("series_compliance_m_per_N"):
        print("note: force_N is what the rig of the fit measures, which gives way; muscle_force_N "
              "that of the muscle alone")  # fmt: skip
    if other is not None and "series" not in saved.document:
        print("note: another length is predicted from one specimen; the band does not know how "
              "specimens differ (famjax series does)")  # fmt: skip
    if pressure and all(row.get("band") is None for row in rows):
        print("note: no error band, as the fit has no standard errors")
    return 0

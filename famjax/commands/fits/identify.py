"""`famjax fit`."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter
from rich.console import Console

from ..lean_imports import load_matplotlib
from ..loading import load_fitting, load_map, look_here
from ..options.engine import UNNAMED, EngineOptions
from ..options.whole_numbers import Order, Replicates, Seed, Starts
from ..terminal import Output, print_table, progress
from .hysteresis import load_ramps, one_map, with_hysteresis

if TYPE_CHECKING:
    from fitting import Identification
    from fitting.choice import Choice
    from fitting.evidence import Evidence
    from fitting.verdict import Judgement


_LARGE = 2000
"""Readings from which other processes choose sooner than this one, see `fitting.choose`."""


def fit(
    data: tuple[str, ...] = ("DMSP-20-300",),
    *,
    law: str | None = None,
    order: Order = None,
    constraint: Literal["none", "positive", "slope", "drucker"] = "drucker",
    dependence: Literal["fixed", "linear", "free"] = "fixed",
    box: Literal["physical", "open"] = "physical",
    bounds: tuple[str, ...] = (),
    free: tuple[str, ...] = (),
    prior: tuple[str, ...] = (),
    noise_N: Annotated[float | None, Parameter(name="--noise-N")] = None,
    objective: Literal["sum_of_squares", "huber"] = "sum_of_squares",
    censored: bool = False,
    pressure_tolerance: str | None = None,
    length_tolerance: str | None = None,
    validate: bool = False,
    profile: bool = False,
    bootstrap: Replicates = 0,
    posterior: bool = False,
    hysteresis: bool = False,
    shape: Path | None = None,
    geometry: str | None = None,
    term: tuple[str, ...] = (),
    shared_error: Annotated[tuple[str, ...], Parameter(name="--error")] = (),
    atmosphere: str | None = None,
    columns: str | None = None,
    specimen: tuple[str, ...] = (),
    starts: Starts = 16,
    seed: Seed = 0,
    output: Path = Path("famjax-fit"),
    units: Literal["si", "metric", "us"] = "metric",
    engine: EngineOptions = UNNAMED,
    json_: bool = False,
) -> int:
    """Identify a muscle from a measured force map.

    Without --law, --order or --dependence the model is chosen: families are fitted, and judged by
    what they predict of pressures and lengths that are left out. Ends with 1, the reason first and
    the files written, where nothing was identified.

    Writes `fit.json` (everything, SI), `fit.png` and `report.html` into the output folder.

    Parameters
    ----------
    data
        CSV file with columns such as `pressure_psi,length_in,force_lbf`, or the name of a bundled
        map (DMSP-20-300, DMSP-10-250), or - for standard input. Lines
        `# specimen: rest_length_mm = 296` describe the muscle.
        With --hysteresis raw ramps with their lengths, `test8.csv=73.25mm`, as `famjax ramps` takes.
    law
        Of the bladder, chosen unless given: polynomial in strain, ogden (one term), mooney-rivlin,
        saturating, monotone (tangent modulus >= 0 at knots), neo-hookean or yeoh; or module:Class
        for a law of your own, in a file of the folder that you start from: `--law my_rubber:Gent`.
    order
        Order of the polynomial law, sigma = E_1 eps + E_2 eps|eps| + ...; 3 of --law polynomial
        unless given.
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
        threads), series_compliance (of the rig), with it series_exponent (the rig gives way by a
        power of the force). `--bounds` and `--prior` make them take part too.
    prior
        What is known of a parameter, name_unit=mean+-std, repeatable: `--prior
        rest_length_mm=296+-0.5`; `--prior length_offset_mm=0+-0.25` for errors of every length.
    noise_N
        Standard deviation of one reading, against which priors are weighed.
    objective
        sum_of_squares; huber: robust, so that single bad readings count little.
    censored
        Slack readings count where the model pulls, and those at the limit of the load cell
        (`# specimen: force_limit_N = 500`) where it pulls less, one-sided; the law is the polynomial
        one unless --law names another.
    pressure_tolerance
        Readings nearer than this are at one pressure: `--pressure-tolerance 1kPa`. Found from the
        gaps between the readings unless given.
    length_tolerance
        The same of lengths: `--length-tolerance 0.2mm`.
    validate
        Also leave out each pressure and each length, and predict it; a model that is chosen is
        chosen anew without it.
    profile
        Also hold each parameter beside its optimum: which are identified, and how far.
    bootstrap
        Number of bootstrap replicates for standard errors and prediction bands.
    posterior
        Also draw from the posterior (NUTS) and write `posterior.png`: within bounds and priors, with
        --noise-N for the noise of a reading where it is known.
    hysteresis
        Also fit both branches of raw ramps, about their static map, and predict those left out.
    shape
        The muscle's shape as photographs show it, the `measurements.nc` of `famjax measure`, in place
        of a cylinder; the turns of the threads are identified, or held: `--bounds turns=1.09`. The
        law is the polynomial one unless --law names another.
    geometry
        A geometry of your own around the cylinder, module:Class: `--geometry my_ends:ConicalEnds`. The
        numbers that it declares are identified, or held by --bounds. The law is the polynomial one
        unless --law names another.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable; as --geometry.
    shared_error
        A standard error that all readings share, which no scatter shows, name_unit=value, repeatable:
        `--error wall_thickness_mm=0.05`. It is carried into parameters and bands. Names: rest_length,
        wall_thickness, bladder_diameter, braid_thickness, pressure_zero, force_zero (with a unit);
        pressure_reading, force_reading and shortening are parts of the reading: `pressure_reading=0.0025`.
    atmosphere
        Of raw ramps: what the pressure sensor reads at atmosphere, `8.94kPa`, or the interval of each
        record in which the muscle is vented, `0s:0.5s`.
    columns
        Of raw ramps: names of the columns, with units, where there is no header that names them.
    specimen
        Describe the muscle, key_unit=value, repeatable: `--specimen rest_length_mm=296`. Keys:
        rest_length, wall_thickness, nominal_diameter, bladder_diameter, braid_thickness (with a
        unit), force_limit_N (of the load cell), embedded (true or false: threads inside the wall), name.
    starts
        Number of starts of the geometry.
    seed
        Of the starts; the same seed gives the same result.
    output
        Folder for the files, made if need be.
    units
        Of table, picture and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    engine
        Where a model is chosen anew without each level (--validate), where one is chosen for a map of
        2000 readings or more, and where replicates are fitted; for these, from 10000 on it pays.
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    load_matplotlib()

    from famjax.boundary.origin import Origin
    from famjax.commands.options.fits import (
        parameter_kinds,
        parse_bounds,
        parse_errors,
        parse_free,
        parse_priors,
        parse_specimen,
    )
    from fitting.saved import write_fit
    from fitting.search.own_parts import own_parts, taking_part

    from .steps import gathered, judged

    place = Output(output)
    if posterior:
        fitting.posterior.load_blackjax()
    if geometry is not None and shape is not None:
        raise fitting.InputError(
            "--shape is a geometry already: give either --shape or --geometry, got both"
        )
    look_here()
    tolerances = {"pressure": pressure_tolerance, "length": length_tolerance}
    known, stated = parse_specimen(specimen), parse_errors(shared_error)
    measured, pairs = (
        load_ramps(data, known, atmosphere=atmosphere, columns=columns, **tolerances)
        if hysteresis
        else (load_map(one_map(data), known, **tolerances), None)
    )
    parts, declared = own_parts([measured], geometry, term)
    kinds = parameter_kinds(*filter(None, [law])) if bounds or free or prior else {}
    kinds |= {name: one.kind for name, one in declared.items()}
    kinds |= {} if shape is None else {"turns": "number"}
    options = parts | {
        "constraint": constraint,
        "box": box,
        "bounds": parse_bounds(bounds, kinds),
        "parameters": parse_free(free, kinds) | parse_priors(prior, kinds),
        "noise": noise_N,
        "objective": objective,
        "starts": starts,
        "seed": seed,
    }
    options["parameters"] |= taking_part(declared, {**options["bounds"], **options["parameters"]})
    surface = None
    if shape is not None:
        from .measured_shape import with_shape

        measured, options, surface = with_shape(measured, shape, options)
    identifying = f"identifying {measured.specimen.name}"
    with progress(identifying) as show, engine.executor() as executor:

        def tell(what: str, done: int, total: int) -> None:
            show(done, total, what)

        choice = None
        if (
            law is None
            and order is None
            and dependence == "fixed"
            and not censored
            and shape is None
            and not parts
        ):
            choice = fitting.choose(measured, **options, progress=tell)
            result = choice.chosen
        else:
            result = fitting.identify(
                measured, **options, law=law or "polynomial", order=order, dependence=dependence,
                censored=censored, progress=show,
            )  # fmt: skip
        evidence = gathered(
            result, choice, options, validation=validate, profiles=profile, replicates=bootstrap,
            posterior=posterior, errors=stated, surface=surface, executor=executor, progress=tell,
        )  # fmt: skip
        judgement = judged(result, choice, evidence, tell)
        if pairs is not None:
            evidence = with_hysteresis(evidence, pairs)
        paths = write_fit(
            result, output, units, evidence, Origin.of_this_command(), choice=choice,
            judgement=judgement,
        )  # fmt: skip
    if json_:
        summary = fitting.saved.summary_as_dict(
            result, units, evidence, choice=choice, judgement=judgement
        )
        print(json.dumps(summary, allow_nan=False))
    else:
        _print_fit(result, choice, evidence, judgement, units)
        place.tell(paths)
    return 0 if judgement.passed else 1


def _print_fit(
    result: "Identification",
    choice: "Choice | None",
    evidence: "Evidence",
    judgement: "Judgement",
    units: str,
) -> None:
    from fitting.saved import notes, tables, verdict

    print(f"{result.data.specimen.name}  ({result.data.source})")
    for title, header, rows in tables(result, units, evidence, choice):
        print_table(title, header, rows)
    console = Console(highlight=False)
    console.print()
    for warning in notes(result, evidence, choice, judgement, units):
        console.print(f"note: {warning}", markup=False)
    console.print(verdict(result, judgement, units, evidence), style="bold", markup=False)

"""`famjax fit` and `famjax assess`: a muscle from a force map, and how far it is to be believed."""

import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import Group, Parameter
from rich.console import Console

from famjax.boundary.errors import InputError, meant
from famjax.console import (
    Jobs,
    Output,
    Units,
    add_cwd_to_path,
    print_json,
    print_table,
    progress,
    whole,
)

if TYPE_CHECKING:
    from fitting import ForceData
    from fitting.evidence import Evidence

    from .problem import Problem, Tell

_DATA, _MODEL, _KNOWN, _OUTPUT = (
    Parameter(group=Group(name, sort_key=k))
    for k, name in enumerate(("Data", "Model", "What you know", "Output"), start=1)
)
Constraint = Literal["none", "positive", "slope", "drucker"]
Objective = Literal["sum_of_squares", "mean_rmse", "huber"]
_STANDARD_INPUT = "<stdin>"
"""What the command line puts in the place of `-`."""


def _check_replicates(_: Any, value: int) -> None:
    if value < 0 or value == 1:
        raise ValueError(f"It must be 0, for no replicates, or 2 and more; got {value}")


Replicates = Annotated[int, Parameter(converter=whole, validator=_check_replicates)]
"""Number of replicates of a bootstrap, 0 for none."""


def load_fitting() -> ModuleType:
    """The fitting package, with JAX in float64; compiled programs are kept on disk."""
    import fitting
    from famjax.compilation_cache import start_jax

    start_jax()
    return fitting


def load_map(data: str, specimen: Mapping[str, Any]) -> "ForceData":
    """A force map: a bundled one by its name, a CSV file, or standard input; specimen in SI."""
    from fitting import load_bundled, read_csv
    from fitting.reading import bundled_map_name, bundled_names

    if bundled_map_name(data) is not None and not Path(data).exists():
        return load_bundled(data, specimen)
    if data == _STANDARD_INPUT:
        return read_csv(sys.stdin, specimen)
    if not Path(data).exists():
        known = bundled_names()
        raise InputError(
            f"no such file: {data}; bundled maps are {' and '.join(known)}{meant(data, known)}"
        )
    return read_csv(data, specimen)


def fit(
    data: Annotated[tuple[str, ...], _DATA] = ("DMSP-20-300",),
    *,
    specimen: Annotated[tuple[str, ...], _DATA] = (),
    censored: Annotated[bool, _DATA] = False,
    law: Annotated[str | None, _MODEL] = None,
    order: Annotated[int | None, _MODEL, Parameter(converter=whole)] = None,
    constraint: Annotated[Constraint, _MODEL] = "drucker",
    free: Annotated[tuple[str, ...], _MODEL] = (),
    geometry: Annotated[str | None, _MODEL] = None,
    term: Annotated[tuple[str, ...], _MODEL] = (),
    shape: Annotated[Path | None, _MODEL] = None,
    objective: Annotated[Objective, _MODEL] = "sum_of_squares",
    bounds: Annotated[tuple[str, ...], _KNOWN] = (),
    prior: Annotated[tuple[str, ...], _KNOWN] = (),
    noise_N: Annotated[float | None, _KNOWN, Parameter(name="--noise-N")] = None,
    shared_error: Annotated[tuple[str, ...], _KNOWN, Parameter(name="--error")] = (),
    output: Annotated[Path, _OUTPUT] = Path("famjax-fit"),
    units: Annotated[Units, _OUTPUT] = "metric",
    json_: Annotated[bool, _OUTPUT] = False,
) -> int:
    """Identify a muscle from a measured force map.

    Without --law or --order the model is chosen: several are fitted, and judged by what they predict of
    pressures and lengths that are left out. Where nothing was identified it prints why, still writes
    the files, and exits with 1.

    Writes `fit.json` (everything, SI), `fit.png` and `report.html` into the output folder. `famjax
    assess` says more of how far the fit is to be believed.

    Parameters
    ----------
    data
        CSV file with columns such as `pressure_psi,length_in,force_lbf`, or the name of a bundled
        map (DMSP-20-300, DMSP-10-250), or - for standard input. Lines
        `# specimen: rest_length_mm = 296` describe the muscle.
    specimen
        Describe the muscle, key_unit=value, repeatable: `--specimen rest_length_mm=296`. Keys:
        rest_length, wall_thickness, nominal_diameter, bladder_diameter, braid_thickness (with a
        unit), force_limit_N (of the load cell), embedded (true or false: threads inside the wall), name.
    censored
        Use slack readings as upper bounds of the force, and those at the limit of the load cell
        (`# specimen: force_limit_N = 500`) as lower bounds; the law is the polynomial one unless
        --law names another.
    law
        Bladder law. If omitted, several are tried and the best predictor is kept: polynomial in
        strain, ogden (one term), mooney-rivlin, saturating, monotone (tangent modulus >= 0 at knots),
        neo-hookean or yeoh; or module:Class for a law of your own, in a file of the folder that you
        start from: `--law my_rubber:Gent`.
    order
        Order of the polynomial law, sigma = E_1 eps + E_2 eps|eps| + ...; 3 of --law polynomial
        unless given.
    constraint
        none; positive: E_n >= 0; slope: stress rises on the strain range; drucker: stable along
        the actuation path.
    free
        Identify these too, besides braid diameter, angle and deadband, repeatable:
        end_factor or end_length (rounded ends), rest_length, braid_compliance (stretch of all
        threads), series_compliance (of the rig), with it series_exponent (the rig gives way by a
        power of the force). `--bounds` and `--prior` do so as well.
    geometry
        A geometry of your own around the cylinder, module:Class: `--geometry my_ends:ConicalEnds`. The
        numbers that it declares are identified, or held by --bounds. The law is the polynomial one
        unless --law names another.
    term
        A force term of your own beside braid and bladder, module:Class, repeatable; as --geometry.
    shape
        The muscle's shape as photographs show it, the `measurements.nc` of `famjax measure`, in place
        of a cylinder; the turns of the threads are identified, or held: `--bounds turns=1.09`. The
        law is the polynomial one unless --law names another.
    objective
        sum_of_squares; mean_rmse: mean over pressures of the RMSE, as the reference work; huber: robust, so
        that single bad readings count little.
    bounds
        Replace bounds, name_unit=min:max, repeatable: `--bounds braid_diameter_mm=20:23.6`.
        One value holds the parameter: `--bounds deadband_pressure_kPa=40`. Unless given, the geometry
        is that of a buildable muscle: braid diameter from the bore to 3.6 mm above, braid angle 60 to
        70 deg to the circumference.
    prior
        What is known of a parameter, name_unit=mean+-std, repeatable: `--prior
        rest_length_mm=296+-0.5`.
    noise_N
        Standard deviation of one reading, against which priors are weighed.
    shared_error
        A standard error that all readings share, which no scatter shows, name_unit=value, repeatable:
        `--error wall_thickness_mm=0.05`. It is carried into parameters and bands. Names: rest_length,
        wall_thickness, bladder_diameter, braid_thickness, pressure_zero, force_zero (with a unit);
        pressure_reading, force_reading and shortening are parts of the reading: `pressure_reading=0.0025`.
    output
        Folder for the files, created if missing.
    units
        Of table, picture and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    from fitting.reading import parse_specimen

    from .problem import Asked, Problem

    place = Output(output)
    add_cwd_to_path()
    if len(data) != 1:
        raise fitting.InputError(
            f"a fit takes one force map, got {len(data)}: {', '.join(data)}. Several muscles of one "
            "series: famjax series; raw ramps of one muscle: famjax ramps"
        )
    asked = Asked(
        law=law, order=order, constraint=constraint, free=free, geometry=geometry, term=term,
        shape=None if shape is None else str(shape.absolute()), bounds=bounds, prior=prior,
        noise=noise_N, error=shared_error, censored=censored, objective=objective,
    )  # fmt: skip
    problem = Problem.of(load_map(data[0], parse_specimen(specimen)), asked)
    with _telling("identifying") as tell:
        return _finish(problem, place, units, tell, as_json=json_)


def assess(
    fit_json: Path,
    *,
    validate: bool = False,
    profile: bool = False,
    bootstrap: Replicates = 0,
    posterior: bool = False,
    hysteresis: Path | None = None,
    own: tuple[str, ...] = (),
    jobs: Jobs = None,
    output: Path | None = None,
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Test a fit on readings left out, and find how far each parameter is known.

    The fit is made anew from the readings and options in its file, which takes as long as it did, and
    the files are written again with what was asked for here; of an earlier assessment nothing stays.

    Parameters
    ----------
    fit_json
        A `fit.json` of `famjax fit`.
    validate
        Leave out each pressure and each length, and predict it; a model that was chosen is chosen anew
        without it.
    profile
        Hold each parameter beside its optimum: which are identified, and how far.
    bootstrap
        Number of bootstrap replicates for standard errors and prediction bands.
    posterior
        Draw from the posterior (NUTS), within bounds and priors and with --noise-N of the fit for the
        noise of a reading.
    hysteresis
        Fit both branches of raw ramps, the `branches.csv` of `famjax ramps`, about the fit, and predict
        those left out.
    own
        A module that you trust, repeatable, with the classes of your own of which the file's muscle is
        made: `--own my_rubber`. Without it no module is imported that a file names.
    jobs
        Number of processes that choose the model anew (--validate).
    output
        Folder for the files; that of the fit unless given.
    units
        Of table, picture and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print one JSON object to standard output and nothing else there.
    """
    fitting = load_fitting()
    from .problem import Problem

    if not (validate or profile or bootstrap or posterior or hysteresis):
        raise fitting.InputError(
            "say what to assess: --validate, --profile, --bootstrap, --posterior or --hysteresis"
        )
    if posterior:
        fitting.posterior.load_blackjax()
    place = Output(fit_json.parent if output is None else output)
    if own:
        add_cwd_to_path()
    pairs = None if hysteresis is None else fitting.records.read_branches(hysteresis)
    problem = Problem.read(fitting.load_fit(fit_json, own=own).document, own)
    with _telling("identifying") as tell:
        return _finish(
            problem, place, units, tell, as_json=json_, pairs=pairs, validation=validate,
            profiles=profile, replicates=bootstrap, posterior=posterior, executor=jobs,
        )  # fmt: skip


@contextmanager
def _telling(what: str) -> Iterator["Tell"]:
    with progress(what) as show:
        yield lambda what, done, total: show(done, total, what)


def _finish(
    problem: "Problem",
    place: Output,
    units: Units,
    tell: "Tell",
    *,
    as_json: bool,
    pairs: Any = None,
    **wanted: Any,
) -> int:
    """Solve a problem, find the evidence that is wanted, write the files and print what was found."""
    import dataclasses

    from famjax.boundary.files import Origin
    from fitting import report, saved
    from fitting.records import fit_hysteresis, leave_out

    from .problem import judged

    result, choice = problem.solve(tell)
    evidence: Evidence = problem.evidence(result, choice, tell, **wanted)
    judgement = judged(result, choice, evidence, tell)
    if pairs is not None:
        evidence = dataclasses.replace(evidence, hysteresis=leave_out(fit_hysteresis(pairs)))
    paths = report.write_fit(
        result, place.folder, units, evidence, Origin.of_this_command(), choice=choice,
        judgement=judgement, problem=problem.as_dict(),
    )  # fmt: skip
    if as_json:
        print_json(
            saved.summary_as_dict(result, units, evidence, choice=choice, judgement=judgement)
        )
        return 0 if judgement.passed else 1
    print(f"{result.data.specimen.name}  ({result.data.source})")
    for title, header, rows in report.tables(result, units, evidence, choice):
        print_table(title, header, rows)
    console = Console(highlight=False)
    console.print()
    for warning in report.notes(result, evidence, choice, judgement, units):
        console.print(f"note: {warning}", markup=False)
    console.print(report.verdict(result, judgement, units, evidence), style="bold", markup=False)
    place.tell(paths)
    return 0 if judgement.passed else 1

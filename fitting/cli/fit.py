"""`famjax fit` and `famjax assess`: identify a muscle from a force map, and test the result."""

import dataclasses
import sys
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Group, Parameter

from famjax.boundary.errors import InputError, meant
from famjax.console import (
    Columns,
    Jobs,
    Output,
    Units,
    add_cwd_to_path,
    parse_columns,
    tell_columns,
    whole,
    whole_number,
)

if TYPE_CHECKING:
    from fitting import ForceData


_DATA, _MODEL, _KNOWN, _OUTPUT = (
    Parameter(group=Group(name, sort_key=k))
    for k, name in enumerate(("Data", "Model", "Prior knowledge", "Output"), start=1)
)
Constraint = Literal["none", "positive", "slope", "drucker"]
Objective = Literal["sum_of_squares", "mean_rmse", "huber", "censored"]
Ends = Literal["cylinder", "equilibrium"]
_STANDARD_INPUT = "<stdin>"
"""Text that replaces `-` on the command line."""


def load_fitting() -> ModuleType:
    """Import the fitting package with JAX in float64; compiled programs are cached on disk."""
    import fitting
    from famjax.compilation_cache import start_jax

    start_jax()
    return fitting


def load_map(data: str, specimen: tuple[str, ...], column: tuple[str, ...]) -> "ForceData":
    """Load a bundled map, a file or standard input, and print how its columns were interpreted.

    Args:
        data: name of a bundled map, path, or `-` for standard input.
        specimen: values of `--specimen`.
        column: values of `--column`.
    """
    from fitting import load_bundled, read_csv
    from fitting.data import bundled_map_name, bundled_names
    from fitting.specimen import parse_specimen

    if bundled_map_name(data) is not None and not Path(data).exists():
        return load_bundled(data, parse_specimen(specimen))
    given = data == _STANDARD_INPUT
    if not given and not Path(data).exists():
        known = bundled_names()
        raise InputError(
            f"no such file: {data}; bundled maps are {' and '.join(known)}{meant(data, known)}"
        )
    found = read_csv(sys.stdin if given else data, parse_specimen(specimen), parse_columns(column))
    tell_columns(found.taken)
    return found


@Parameter(name="*")
@dataclasses.dataclass(frozen=True, kw_only=True)
class Asked:
    """Options of `famjax fit` that define the problem to solve, as typed.

    Parameters
    ----------
    law
        Choose the bladder law: polynomial, ogden (one term), mooney-rivlin, saturating, neo-hookean or
        yeoh. If omitted, several laws are tried and the one that predicts best is kept.
        `--law my_rubber:Gent` uses your own class Gent from the file my_rubber.py in the current folder.
    order
        Set the order of the polynomial law, sigma = E_1 eps + E_2 eps|eps| + ...; default: 3.
    constraint
        Constrain the law. positive: every E_n >= 0; slope: the stress increases over the strain range;
        drucker: the law is stable along the actuation path; none: no constraint.
    free
        Also identify this parameter (repeatable): end_factor or end_length (rounded ends), rest_length,
        braid_compliance (stretching threads), series_compliance (elastic rig), series_exponent (rig
        deflection proportional to a power of the force).
    geometry
        Wrap the cylinder in your own geometry class, such as `--geometry my_ends:ConicalEnds`. The
        parameters that the class declares are identified. The law then defaults to polynomial.
    term
        Add your own force term, module:Class (repeatable). The parameters that the class declares are
        identified.
    shape
        Use the shape measured in photographs (`measurements.nc`, written by `famjax measure`) instead of a
        cylinder. The number of thread turns is identified; `--bounds turns=1.09` fixes it. With
        `--ends equilibrium`, the photographed profiles and the force are fitted together.
    ends
        Choose the end model: cylinder, or equilibrium (the shape is computed from mechanics). Without
        --law, equilibrium adds one more model to choose from. The optimum of this model cannot be
        certified.
    objective
        Choose what to minimise. sum_of_squares: the sum of squared residuals; mean_rmse: the RMSE averaged
        over pressures, as in the reference work; huber: a sum that gives outliers less weight; censored:
        the sum of squares, with slack readings as upper bounds on the force and readings at the load
        cell's limit as lower bounds.
    bounds
        Set the bounds on a parameter, name_unit=min:max (repeatable), as in
        `--bounds braid_diameter_mm=20:23.6`. A single value fixes the parameter, as in
        `--bounds deadband_pressure_kPa=40`.
    prior
        Specify prior knowledge of a parameter, name_unit=mean+-std (repeatable), as in
        `--prior rest_length_mm=296+-0.5`.

    shared_error
        Specify a standard error, name_unit=value (repeatable). noise_N is the noise of a single force
        reading, used to weight the priors. All others are calibration errors shared by all readings.
        Include the unit for rest_length, wall_thickness, bladder_diameter, braid_thickness, pressure_zero
        and force_zero; pressure_reading, force_reading and shortening are relative errors without a unit.
    """

    law: Annotated[str | None, _MODEL] = None
    order: Annotated[int | None, _MODEL, Parameter(converter=whole)] = None
    constraint: Annotated[Constraint, _MODEL] = "drucker"
    free: Annotated[tuple[str, ...], _MODEL] = ()
    geometry: Annotated[str | None, _MODEL] = None
    term: Annotated[tuple[str, ...], _MODEL] = ()
    shape: Annotated[str | None, _MODEL] = None
    ends: Annotated[Ends, _MODEL] = "cylinder"
    objective: Annotated[Objective, _MODEL] = "sum_of_squares"
    bounds: Annotated[tuple[str, ...], _KNOWN] = ()
    prior: Annotated[tuple[str, ...], _KNOWN] = ()
    shared_error: Annotated[tuple[str, ...], _KNOWN, Parameter(name="--error")] = ()

    @property
    def chosen(self) -> bool:
        """True if the law is to be chosen from several."""
        named = (self.law, self.order, self.geometry, self.shape)
        given = any(one is not None for one in named) or self.term
        return not given and self.objective != "censored"


def fit(
    data: Annotated[tuple[str, ...], _DATA] = ("DMSP-20-300",),
    /,
    *,
    specimen: Annotated[tuple[str, ...], _DATA] = (),
    column: Annotated[Columns, _DATA] = (),
    asked: Asked = Asked(),
    output: Annotated[Path, _OUTPUT] = Path("famjax-fit"),
    units: Annotated[Units, _OUTPUT] = "metric",
    verbose: Annotated[bool, _OUTPUT] = False,
    json_: Annotated[bool, _OUTPUT] = False,
) -> int:
    """Fit a muscle model to a measured force map.

    Without --law or --order, several models are fitted and compared by cross-validation over pressures and
    lengths. The model with the smallest held-out error is kept.

    Writes `fit.json` (all results in SI units), `fit.png` and `report.html`. The exit code is 1 if no
    muscle was identified. Use `famjax assess` for further tests of the fit.

    Parameters
    ----------
    data
        Read this CSV or .xlsx file with columns such as `pressure_kPa,length_mm,force_N`, this bundled map
        (DMSP-20-300 or DMSP-10-250), or standard input (-). Lines in the file such as
        `# specimen: rest_length_mm = 296` describe the muscle.
    specimen
        Describe the muscle, key_unit=value (repeatable), as in `--specimen rest_length_mm=296`. Keys:
        rest_length, wall_thickness, nominal_diameter, bladder_diameter, braid_thickness,
        force_limit (of the load cell), embedded (true if the threads run inside the wall), name.
    column
        Assign an unrecognised column to its quantity by the column's name or number, with the unit
        (repeatable), as in `force="Kraft [N]"`. Use `pressure=-` to ignore a column, `decimal=,` for
        decimal commas, and `atmosphere=101.3kPa` for absolute pressures.
    output
        Write the files to this folder; it is created if missing.
    units
        Choose the units for output and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    verbose
        Print all tables and notes from the report.
    json_
        Print the contents of `fit.json` and nothing else.
    """
    fitting = load_fitting()
    from .problem import solve

    place = Output(output)
    add_cwd_to_path()
    if len(data) != 1:
        raise fitting.InputError(
            f"famjax fit accepts one force map, got {len(data)}: {', '.join(data)}. For several "
            "muscles use famjax series; for raw ramps from one muscle use famjax ramps"
        )
    if asked.shape is not None:
        asked = dataclasses.replace(asked, shape=str(Path(asked.shape).absolute()))
    measured = load_map(data[0], specimen, column)
    return solve(measured, asked, place, units, verbose=verbose, as_json=json_)


def assess(
    fit_json: Path,
    *,
    validate: bool = False,
    profile: bool = False,
    bootstrap: Annotated[int | None, whole_number(2)] = None,
    posterior: bool = False,
    hysteresis: Path | None = None,
    own: tuple[str, ...] = (),
    jobs: Jobs = None,
    output: Path | None = None,
    units: Units = "metric",
    json_: bool = False,
) -> int:
    """Test a fit on held-out readings, and determine how well each parameter is known.

    Repeats the fit with the readings and options stored in `fit.json`, runs the tests, and writes the files
    again with their results. Prints all tables and notes.

    Parameters
    ----------
    fit_json
        Read this `fit.json`, written by `famjax fit`.
    validate
        Cross-validate: leave out each pressure and each length in turn, and predict its readings. If the
        model was chosen from several, the choice is repeated each time.
    profile
        Compute profile likelihoods, which show the range that the readings allow for each parameter.
    bootstrap
        Compute standard errors and prediction bands by bootstrap, with this number of replicates.
    posterior
        Sample the posterior (with NUTS) within the bounds and priors. If the fit was made with
        `--error noise_N`, that noise is used.
    hysteresis
        Fit a hysteresis model to both branches of raw ramps (`branches.csv`, written by `famjax ramps`),
        and cross-validate it.
    own
        Trust this module, which contains your own classes (repeatable), as in `--own my_rubber`. Other
        modules are not imported.
    jobs
        Set the number of processes for --validate.
    output
        Write the files to this folder; default: the folder that contains the fit.
    units
        Choose the units for output and report: si, metric (mm, kPa, N, MPa) or us (in, psi, lbf).
    json_
        Print the contents of `fit.json` and nothing else.
    """
    fitting = load_fitting()
    from .problem import asked_of, solve

    if not (validate or profile or bootstrap or posterior or hysteresis):
        raise fitting.InputError(
            "choose a test: --validate, --profile, --bootstrap, --posterior or --hysteresis"
        )
    if posterior:
        fitting.posterior.load_blackjax()
    place = Output(fit_json.parent if output is None else output)
    if own:
        add_cwd_to_path()
    pairs = None if hysteresis is None else fitting.records.read_branches(hysteresis)
    saved = fitting.load_fit(fit_json, own=own)
    return solve(
        saved.data, asked_of(saved, own), place, units, verbose=True, as_json=json_, pairs=pairs,
        validation=validate, profiles=profile, replicates=bootstrap or 0, posterior=posterior,
        executor=jobs,
    )  # fmt: skip

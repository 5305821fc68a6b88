"""Quantify the uncertainty of an identification: validation, profiles, bootstrap, shared errors.

Some errors are shared by all readings, such as errors in a transducer's gain, the rest length, the wall
thickness or a photographed shape. Neither scatter nor repetition reveals them. Each of them changes the
readings or the geometry, and thereby the optimum. To first order, the parameters change by

    d theta = -(J^T J)^-1 J^T d r

where d r is the change in the weighted residual at fixed parameters and J is the derivative of the residual
with respect to the parameters, restricted to directions left free by constraints and bounds (see `carry`).
Nothing is refitted.

References:
    JCGM 100:2008 (GUM), section 5: independent contributions add in quadrature.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, NotNegative
from famjax.boundary.units import Quantity, finite_or_none

from .bands import ModelError, model_error, numbers_by_parameters
from .covariance import free_root
from .data import ForceData, Specimen
from .engine import Point, predict, report_of
from .posing import Geometry, source_of
from .posterior import Posterior, posterior_as_dict, posterior_warnings, sample
from .problem import Part
from .records.hysteresis import (
    HysteresisFit,
    hysteresis_as_dict,
    hysteresis_table,
    hysteresis_warnings,
)
from .result import Identification
from .summary import held_and_active, joint_derivatives
from .validation import (
    Bootstrap,
    LeftOut,
    Profile,
    bootstrap,
    groups_of,
    leave_out_each,
    profile,
    validate,
)

FORM = Form(
    kinds={
        "rest_length": "length", "pressure_zero": "pressure", "force_zero": "force",
        "wall_thickness": "length", "bladder_diameter": "length", "braid_thickness": "length",
    }
)  # fmt: skip
"""Form of the entries in files, such as `wall_thickness_mm` and `pressure_reading`."""


@dataclasses.dataclass(frozen=True)
class SharedErrors:
    """Standard errors shared by all readings of a map; 0 means exact.

    Attributes:
        rest_length: error in L0, and therefore in every length [m].
        shortening: relative error in the displacement of the testing machine [-].
        pressure_reading: relative error of the pressure transducer [-].
        pressure_zero: offset of the pressure transducer [Pa].
        force_reading: relative error of the load cell [-].
        force_zero: offset of the load cell [N].
        wall_thickness: error in the bladder's wall thickness at rest [m].
        bladder_diameter: error in the bladder's outer diameter at rest [m], if a value is given.
        braid_thickness: error in the braid's thickness [m].
    """

    rest_length: NotNegative = 0.0
    shortening: NotNegative = 0.0
    pressure_reading: NotNegative = 0.0
    pressure_zero: NotNegative = 0.0
    force_reading: NotNegative = 0.0
    force_zero: NotNegative = 0.0
    wall_thickness: NotNegative = 0.0
    bladder_diameter: NotNegative = 0.0
    braid_thickness: NotNegative = 0.0

    def __post_init__(self) -> None:
        for name, value in dataclasses.asdict(self).items():
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"the standard error of {name} must be >= 0, got {value}")

    def stated(self) -> dict[str, float]:
        """Return the errors that are not 0."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value > 0}

    def moved(self, data: ForceData, name: str) -> ForceData:
        """Return the map as it would be if one quantity were off by its standard error.

        Args:
            data: the map.
            name: name of the error.

        Raises:
            InputError: an error is stated for bladder_diameter, but the specimen has no value for it.
        """
        by, specimen, length = getattr(self, name), data.specimen, data.length
        column, _, how = name.partition("_")
        if column in {"pressure", "force"}:
            values = getattr(data, column)
            values = values * (1 + by) if how == "reading" else values + by
            return dataclasses.replace(data, **{column: values})
        if name == "shortening":
            rest = specimen.rest_length
            return dataclasses.replace(data, length=rest - (rest - length) * (1 + by))
        if getattr(specimen, name) is None:
            raise InputError(
                f"an error in {name} was stated, but the specimen has no {name}: remove the error"
            )
        if name == "rest_length":
            length = length + by
        specimen = dataclasses.replace(specimen, **{name: getattr(specimen, name) + by})
        return dataclasses.replace(data, length=length, specimen=specimen)


DRAWS = 32
"""Number of random draws of a measured shape, enough to estimate a standard error to within an eighth."""


@dataclasses.dataclass(frozen=True)
class Move:
    """A changed map or geometry.

    Attributes:
        data: the changed map, with the same number of readings; None if unchanged.
        geometry: see `identify`.
    """

    data: ForceData | None
    geometry: Geometry | None = None


Moves = Mapping[str, Sequence[Move]]
"""Changes to the map or geometry, by source of error: either one change by a standard error, or several
random draws."""


@dataclasses.dataclass(frozen=True)
class Carried:
    """Effect of shared errors on an identification.

    Attributes:
        names: parameters, then coefficients.
        sources: sources of error.
        effects: standard error of each parameter from each source [SI], shape (sources, parameters);
            0 if the parameter is held fixed or at a bound.
        directions: independent directions in which the muscle's stored values vary, each one standard
            deviation long, see `muscle_spread`.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    effects: Float[np.ndarray, "sources parameters"]
    directions: Float[np.ndarray, "directions numbers"]

    @property
    def std(self) -> dict[str, float]:
        """Standard error of each parameter from all sources [SI]."""
        total = np.sqrt(np.sum(self.effects**2, axis=0))
        return dict(zip(self.names, total.tolist(), strict=True))

    def by_source(self) -> dict[str, dict[str, float]]:
        """Return the standard error of each parameter from each source [SI]."""
        return {
            source: dict(zip(self.names, row.tolist(), strict=True))
            for source, row in zip(self.sources, self.effects, strict=True)
        }


def moves_of(
    data: ForceData,
    errors: SharedErrors,
    geometry_of: Callable[[Specimen], Geometry | None] = lambda _: None,
) -> dict[str, list[Move]]:
    """Convert stated errors into changes to the map and its geometry.

    Args:
        data: the map.
        errors: standard errors.
        geometry_of: returns the geometry of the fit for a specimen, see `identify`.
    """
    return {
        name: [Move(moved := errors.moved(data, name), geometry_of(moved.specimen))]
        for name in errors.stated()
    }


def carry(result: Identification, moves: Moves) -> Carried:
    """Propagate shared errors to the parameters and forces of a fit.

    The theory is linear in errors and parameters: each error must change the parameters only slightly, and
    active constraints and bounds must stay active.

    Args:
        result: a fit of one specimen.
        moves: changes by source of error.

    Raises:
        InputError: several specimens were identified together, a changed map has a different number of
            readings, or a changed geometry is of a different kind or has an undefined force at the optimum.
    """
    problem, point = result.problem, result.end.point
    if len(problem.parts) > 1:
        raise InputError("shared errors require a fit of one specimen, got a joint fit of several")
    part = problem.parts[result.place]
    _, jacobian, rows = joint_derivatives(point)
    held, rows, bent = held_and_active(problem, result.end, rows)
    root, _ = free_root(np.concatenate([jacobian, bent]), rows, held)
    readings = jacobian[: part.force.size]
    slopes = numbers_by_parameters(result)
    force, numbers = _at(part, point)
    effects, directions = [], []
    for source, several in moves.items():
        steps = []
        for move in several:
            there, others = _at(_moved(part, result.data, move, source), point)
            steps.append(-root @ (root.T @ (readings.T @ (part.weight * (there - force)))))
            change = slopes @ steps[-1] + others - numbers
            directions.append(change / np.sqrt(len(several)))
        if not np.isfinite(steps).all():
            raise InputError(
                f"with the stated error in {source}, the force is undefined (nan) at some readings: check "
                "the value and unit of this error"
            )
        effects.append(np.sqrt(np.mean(np.square(steps), axis=0)))
    names = problem.names + result.coefficient_names
    return Carried(names, tuple(moves), np.array(effects), np.array(directions))


def _at(part: Part, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Return the unweighted residual [N], and the values stored in the muscle, followed by the rig's."""
    problem, inputs = dataclasses.replace(point.problem, parts=(part,)), part.inputs
    given = point.parameters, point.x
    predicted = predict(problem, 0, *given, inputs.length, inputs.pressure)
    numbers = report_of(part, dataclasses.replace(point, reached=predicted), 0).numbers
    rig = point.parameters[list(part.rig)] if part.rig else [0.0]
    return predicted - part.force, np.append(numbers, rig)


def _moved(part: Part, data: ForceData, move: Move, source: str) -> Part:
    """Return the part with changed readings and geometry."""
    moved = data if move.data is None else move.data
    if moved.force.shape != data.force.shape:
        raise InputError(
            f"{source}: the changed map must have {data.force.size} readings, as in the fit"
        )
    family = part.family
    family = dataclasses.replace(
        family, rest=np.asarray(moved.specimen.rest_length),
        source=source_of(moved, move.geometry, family.nonlinear),
    )  # fmt: skip
    loaded = np.flatnonzero(data.loaded)
    censored = np.flatnonzero(data.slack | data.saturated)[: part.force.size - loaded.size]
    rows = np.concatenate([loaded, censored])
    inputs = dataclasses.replace(
        part.inputs, length=moved.length[rows], pressure=moved.pressure[rows]
    )
    force = part.force + (moved.force - data.force)[rows] * (part.side == 0)
    if jax.tree.structure(family) != jax.tree.structure(part.family):
        raise InputError(f"{source}: the changed geometry must be of the same kind as in the fit")
    return dataclasses.replace(part, family=family, inputs=inputs, force=force)


Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, header and rows of a table, as text."""

_DISAGREE = 1.5
"""Warn if two estimates of the same standard error differ by more than this ratio."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Validation and uncertainty of an identification; parts not requested are empty.

    Attributes:
        validations: leave-one-out errors.
        profiles: profile likelihoods of the parameters.
        bootstrap: bootstrap replicates, or None.
        hysteresis: fit of both branches, or None.
        error: prediction error from held-out readings; None if the law depends on pressure or several
            specimens were identified together.
        left_out: held-out errors, by "pressure" and "length", from which `error` is estimated; empty if
            `error` is None.
        posterior: posterior draws, or None.
        shared: effect of shared errors, or None.
    """

    validations: tuple[LeftOut, ...] = ()
    profiles: tuple[Profile, ...] = ()
    bootstrap: Bootstrap | None = None
    hysteresis: HysteresisFit | None = None
    error: ModelError | None = None
    left_out: Mapping[str, LeftOut] = dataclasses.field(default_factory=dict)
    posterior: Posterior | None = None
    shared: Carried | None = None


def gather(
    result: Identification,
    *,
    progress: Callable[[str, int, int], None],
    validation: bool = False,
    profiles: bool = False,
    replicates: int = 0,
    seed: int = 0,
    known: tuple[ModelError, Mapping[str, LeftOut]] | None = None,
    posterior: bool = False,
    noise: float | None = None,
    shared: Moves | None = None,
) -> Evidence:
    """Compute the requested evidence.

    Args:
        result: the fit.
        progress: called with (task, done, total).
        validation: True to leave out each pressure and each length in turn.
        profiles: True to compute profile likelihoods.
        replicates: number of bootstrap replicates.
        seed: random seed for the bootstrap and the posterior.
        known: prediction error and the held-out errors from which it is estimated, if a choice provides
            them; otherwise they are computed.
        posterior: True to sample the posterior.
        noise: known standard deviation of a reading [N], for the posterior.
        shared: changes due to shared errors, see `carry`.
    """

    def told(what: str) -> Callable[[int, int], None]:
        return functools.partial(progress, what)

    kinds = left_out_kinds(result) if validation else ()
    drawn = sampled = None
    if replicates:
        drawn = bootstrap(result, replicates, seed=seed, progress=told("bootstrap"))
    if posterior:
        sampled = sample(result, noise=noise, seed=seed, progress=told("posterior"))
    error, left_out = _error(result) if known is None else known
    return Evidence(
        validations=tuple(
            validate(result, k, progress=told(f"leaving one {k} out")) for k in kinds
        ),
        profiles=profile(result, progress=told("profile likelihood")) if profiles else (),
        bootstrap=drawn,
        error=error,
        left_out=left_out,
        posterior=sampled,
        shared=carry(result, shared) if shared else None,
    )


def _error(result: Identification) -> tuple[ModelError | None, Mapping[str, LeftOut]]:
    """Return the prediction error from held-out lengths and groups of neighbouring pressures."""
    problem = result.problem
    if len(problem.parts) > 1 or result.law.material.depends_on_pressure:
        return None, {}
    kinds = {kind: (groups_of(problem, kind), 1) for kind in ("length", "pressure")}
    found = leave_out_each([(problem, result.end.u)], kinds)[0]
    left_out = {kind: one for kind, one in found.items() if np.isfinite(one.error).all()}
    return model_error(result.data, result.residuals, left_out, result.n_parameters), left_out


def left_out_kinds(result: Identification) -> tuple[str, ...]:
    """Return the kinds of levels that can be left out."""
    data, kinds = result.data, ("pressure", "length")
    return tuple(kind for kind in kinds if np.unique(data.levels(kind)[data.loaded]).size > 1)


def evidence_as_dict(evidence: Evidence) -> dict[str, Any]:
    """Return the evidence as JSON-ready data in SI; null for missing numbers."""
    document: dict[str, Any] = {}
    if evidence.error is not None:
        document["model_error"] = evidence.error.as_dict()
    for one in evidence.validations:
        document[f"leave_one_{one.groups}_out"] = {
            "rmse_N": finite_or_none(one.rmse),
            "interior_rmse_N": finite_or_none(one.interior_rmse),
            "left_out": one.values.tolist(),
            "group_rmse_N": [finite_or_none(value) for value in one.group_rmse],
        }
    if evidence.profiles:
        document["profiles"] = {
            one.name: {
                "verdict": one.verdict,
                "interval_95": [finite_or_none(end) for end in one.interval],
            }
            for one in evidence.profiles
        }
    if evidence.bootstrap is not None:
        drawn = evidence.bootstrap
        document["bootstrap"] = {
            "replicates": len(drawn.samples),
            "failed": drawn.failed,
            "stderr": {name: finite_or_none(value) for name, value in drawn.stderr.items()},
            "interval_95": {name: drawn.interval(name) for name in drawn.names},
        }
    if evidence.hysteresis is not None:
        document["hysteresis"] = hysteresis_as_dict(evidence.hysteresis)
    if evidence.posterior is not None:
        document["posterior"] = posterior_as_dict(evidence.posterior)
    if evidence.shared is not None:
        document["shared_errors"] = evidence.shared.by_source()
    return document


def evidence_tables(evidence: Evidence, result: Identification, system: str) -> list[Table]:
    """Return the evidence as text tables in a unit system: held-out errors and parameter errors."""

    def text(value: float, kind: str, digits: int, none: str = "open") -> str:
        known = math.isfinite(value)
        return Quantity(value, kind, digits).in_units(system) if known else none

    tables: list[Table] = []
    if evidence.validations:
        rows = [("in sample", result.errors.rmse, math.nan)]
        rows += [
            (f"leave one {v.groups} out", v.rmse, v.interior_rmse) for v in evidence.validations
        ]
        shown = [(what, *(text(error, "force", 4, "") for error in two)) for what, *two in rows]
        tables.append(("Validation", ("", "RMSE", "excluding the extremes"), shown))
    if evidence.hysteresis is not None:
        tables.append(hysteresis_table(evidence.hysteresis, system))
    stderr = {one.name: one.stderr for one in result.estimates}
    kinds = {one.name: one.kind for one in result.estimates}
    title, columns = ["Parameter errors"], dict[str, dict[str, tuple[float, ...]]]()
    if evidence.shared is not None:
        for source, errors in evidence.shared.by_source().items():
            columns[source.replace("_", " ")] = {name: (error,) for name, error in errors.items()}
        columns["total"] = {
            name: (math.hypot(stderr.get(name, math.nan), error),)
            for name, error in evidence.shared.std.items()
        }
    if evidence.profiles:
        columns["95 % from profile likelihood"] = {p.name: p.interval for p in evidence.profiles}
    if (drawn := evidence.bootstrap) is not None:
        title.append(f"bootstrap with {len(drawn.samples)} replicates ({drawn.failed} more failed)")
        columns["95 % from the bootstrap"] = {name: drawn.interval(name) for name in drawn.names}
    if (posterior := evidence.posterior) is not None:
        title.append(repr(posterior))
        kinds |= dict(zip(posterior.names, posterior.kinds, strict=True))
        columns["95 % from the posterior"] = {
            name: (one.low, one.high) for name, one in posterior.summary.items()
        }
    if columns:
        shown = []
        for name, kind in kinds.items():
            cells = [
                " to ".join(text(end, kind, 2 if len(ends) == 1 else 5) for end in ends)
                for ends in (column.get(name, ()) for column in columns.values())
            ]
            if any(cells):
                scatter = text(stderr.get(name, math.nan), kind, 2, "")
                shown.append((name, scatter, *cells))
        tables.append(("; ".join(title), ("parameter", "scatter", *columns), shown))
    return tables


def evidence_warnings(evidence: Evidence, result: Identification) -> tuple[str, ...]:
    """Return warnings where different kinds of evidence disagree."""
    found = []
    for one in evidence.profiles:
        if one.verdict in {"flat", "one-sided"}:
            limits = "do not limit" if one.verdict == "flat" else "limit only one side of"
            found.append(f"The data {limits} the range of {one.name} (profile likelihood).")
    spread = {} if evidence.bootstrap is None else evidence.bootstrap.stderr
    for estimate in result.estimates:
        drawn = spread.get(estimate.name, math.nan)
        ratio = drawn / estimate.stderr if estimate.stderr else math.nan
        if math.isfinite(ratio) and not 1 / _DISAGREE < ratio < _DISAGREE:
            found.append(
                f"The bootstrap standard error of {estimate.name} is {ratio:.2g} times that from "
                "linear theory, so both are uncertain."
            )
    for one in evidence.validations:
        if one.rmse > 2 * result.errors.rmse and np.isfinite(one.rmse):
            found.append(
                f"The error with one {one.groups} left out is {one.rmse / result.errors.rmse:.2g} "
                f"times the in-sample error: predictions at other {one.groups}s may be much less accurate."
            )
    if evidence.hysteresis is not None:
        found += hysteresis_warnings(evidence.hysteresis)
    if evidence.posterior is not None:
        own = result.residuals * np.sqrt(result.weights)
        if result.data.force_std is not None:
            own = own / result.data.force_std[result.data.loaded]
        found += posterior_warnings(evidence.posterior, float(np.sqrt(np.mean(own**2))))
    return tuple(found)

"""What is known about an identification beyond its optimum: validation, profiles, bootstrap, shared errors.

A transducer's gain, the rest length, the wall, the shape that photographs showed: no scatter of the
readings tells of errors that all of them share, and no repetition. Each moves the readings, or the
geometry, and with them the optimum. To first order the parameters move by

    d theta = -(J^T J)^-1 J^T d r

with d r what the weighted residual changes by where the parameters stay, J its derivative in them, in
the directions that constraints and bounds leave free (`carry`). Nothing is fitted again.

References:
    JCGM 100:2008 (GUM), section 5: independent sources add in squares.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import jax
import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.toml_file import Form, NotNegative
from famjax.boundary.units import Quantity, finite_or_none, si_unit

from .bands import ModelError, model_error, numbers_by_parameters
from .covariance import free_root
from .data import ForceData, Specimen
from .engine import Point, predict, report_of
from .posing import Geometry, source_of
from .posterior import Posterior, posterior_as_dict, posterior_table, posterior_warnings, sample
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
    LEVELS,
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
"""How they are spelt: `wall_thickness_mm`, `pressure_reading`."""


@dataclasses.dataclass(frozen=True)
class SharedErrors:
    """Standard errors of what all readings of a map have in common; 0 where it is exact.

    Attributes:
        rest_length: of L0, and of every length with it [m].
        shortening: of the machine's displacement, as part of it.
        pressure_reading: of the transducer, as part of the reading.
        pressure_zero: of its zero [Pa].
        force_reading: of the load cell, as part of the reading.
        force_zero: of its zero [N].
        wall_thickness: of the bladder's wall at rest [m].
        bladder_diameter: of its outer diameter at rest [m], where it was given.
        braid_thickness: [m].
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
        """Those that are not 0."""
        return {name: value for name, value in dataclasses.asdict(self).items() if value > 0}

    def moved(self, data: ForceData, name: str) -> ForceData:
        """A map as it would be, were one of the errors its standard error.

        Args:
            data: the map.
            name: of the error.

        Raises:
            InputError: an error of a bladder's diameter that was not given.
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
                "an error of bladder_diameter was given, but no bladder_diameter: the bladder fills "
                "the braid, leave the error out"
            )
        if name == "rest_length":
            length = length + by
        specimen = dataclasses.replace(specimen, **{name: getattr(specimen, name) + by})
        return dataclasses.replace(data, length=length, specimen=specimen)


DRAWS = 32
"""Shapes as probable as the measured one: they tell a standard error to an eighth of itself."""


@dataclasses.dataclass(frozen=True)
class Move:
    """A map and its geometry as they would be, were something else true.

    Attributes:
        data: the map, of as many readings; None where it is as it was.
        geometry: as for `identify`.
    """

    data: ForceData | None
    geometry: Geometry | None = None


Moves = Mapping[str, Sequence[Move]]
"""By source of error: one move of a standard error, or several, as probable as what is."""


@dataclasses.dataclass(frozen=True)
class Carried:
    """What errors that all readings share do to an identification.

    Attributes:
        names: of the parameters, the coefficients last.
        sources: of error.
        effects: standard error of each parameter by each source [SI], shape (sources, parameters);
            0 of what is held or at a bound.
        directions: in which the muscle's numbers vary with them, one standard deviation each,
            independent of one another, as `muscle_spread` has those of the scatter.
    """

    names: tuple[str, ...]
    sources: tuple[str, ...]
    effects: Float[np.ndarray, "sources parameters"]
    directions: Float[np.ndarray, "directions numbers"]

    @property
    def std(self) -> dict[str, float]:
        """Standard error of each parameter by all sources together [SI]."""
        total = np.sqrt(np.sum(self.effects**2, axis=0))
        return dict(zip(self.names, total.tolist(), strict=True))

    def by_source(self) -> dict[str, dict[str, float]]:
        """Standard error of each parameter by source [SI]."""
        return {
            source: dict(zip(self.names, row.tolist(), strict=True))
            for source, row in zip(self.sources, self.effects, strict=True)
        }


def moves_of(
    data: ForceData,
    errors: SharedErrors,
    geometry_of: Callable[[Specimen], Geometry | None] = lambda _: None,
) -> dict[str, list[Move]]:
    """The moves that stated errors stand for.

    Args:
        data: the map.
        errors: standard errors.
        geometry_of: from a specimen to the geometry of the fit, as for `identify`.
    """
    return {
        name: [Move(moved := errors.moved(data, name), geometry_of(moved.specimen))]
        for name in errors.stated()
    }


def drawn_moves(geometry_of: Callable[[int], Geometry]) -> list[Move]:
    """The moves of a measured shape's uncertainty.

    Args:
        geometry_of: from the number of a draw, below `DRAWS`, to its geometry.
    """
    return [Move(None, geometry_of(draw)) for draw in range(DRAWS)]


def carry(result: Identification, moves: Moves) -> Carried:
    """What errors that all readings share do to the parameters, and to the forces, of a fit.

    Linear theory, in the errors and in the parameters. It holds where an error moves the parameters
    by less than their own range; active constraints and bounds stay where they are.

    Args:
        result: a fit of one specimen.
        moves: by source of error; each source is one standard error, or draws of it about what was
            fitted.

    Raises:
        InputError: specimens that were identified together, a map of other readings, a geometry of
            another kind, or one that has no force at the optimum.
    """
    problem, point = result.problem, result.end.point
    if len(problem.parts) > 1:
        raise InputError(
            "shared errors are carried through the fit of one specimen, not of several"
        )
    part = problem.parts[result.place]
    _, jacobian, rows = joint_derivatives(point)
    held, rows, bent = held_and_active(problem, result.end, rows)
    root = free_root(np.concatenate([jacobian, bent]), rows, held).root
    readings = jacobian[: part.force.size]
    slopes = numbers_by_parameters(result)
    force, numbers = _at(part, point)
    effects, directions = [], []  # of each source, of each move
    for source, several in moves.items():
        steps, changes = [], []
        for move in several:
            other = _moved(part, result.data, move, source)
            there, others = _at(other, point)
            step = -root @ (root.T @ (readings.T @ (part.weight * (there - force))))
            steps.append(step)
            changes.append(slopes @ step + others - numbers)
        if not np.isfinite(steps).all():
            raise InputError(f"with the error of {source} the muscle has no force at some readings")
        weigh = 1 / np.sqrt(len(several))
        effects.append(np.sqrt(np.mean(np.square(steps), axis=0)))
        directions += [weigh * change for change in changes]
    count = len(problem.names) + len(problem.linear)
    return Carried(
        problem.names + result.coefficient_names,
        tuple(moves),
        np.array(effects).reshape(len(moves), count),
        np.array(directions).reshape(-1, numbers.size),
    )


def _at(part: Part, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Residual [N], not weighted, and the muscle's numbers, the rig's last."""
    problem, inputs = dataclasses.replace(point.problem, parts=(part,)), part.inputs
    given = point.parameters, point.x
    predicted = predict(problem, 0, *given, inputs.length, inputs.pressure)
    numbers = report_of(part, dataclasses.replace(point, reached=predicted), 0).numbers
    rig = point.parameters[list(part.rig)] if part.rig else [0.0]
    return predicted - part.force, np.append(numbers, rig)


def _moved(part: Part, data: ForceData, move: Move, source: str) -> Part:
    """The same part with readings and geometry moved."""
    moved = data if move.data is None else move.data
    if moved.force.shape != data.force.shape:
        raise InputError(
            f"the map moved by the error of {source} must have the {data.force.size} readings of the "
            f"fit's, got {moved.force.size}"
        )
    family = part.family
    geometry = source_of(moved, move.geometry, family.nonlinear).as_arrays()
    family = dataclasses.replace(
        family, source=geometry, rest=np.asarray(moved.specimen.rest_length)
    )
    loaded = np.flatnonzero(data.loaded)
    censored = np.flatnonzero(data.slack | data.saturated)[: part.force.size - loaded.size]
    rows = np.concatenate([loaded, censored])
    inputs = dataclasses.replace(
        part.inputs, length=moved.length[rows], pressure=moved.pressure[rows]
    )
    force = part.force + (moved.force - data.force)[rows] * (part.side == 0)
    if jax.tree.structure(family) != jax.tree.structure(part.family):
        raise InputError(
            f"the geometry moved by the error of {source} must be of the kind that was fitted"
        )
    return dataclasses.replace(part, family=family, inputs=inputs, force=force)


Table = tuple[str, tuple[str, ...], list[tuple[str, ...]]]
"""Title, header and rows of text."""

_DISAGREE = 1.5
"""Factor between two estimates of one error bar beyond which a reader is warned."""


@dataclasses.dataclass(frozen=True)
class Evidence:
    """Validation and uncertainty of an identification; whatever was not asked for is empty.

    Attributes:
        validations: by leave-one-out.
        profiles: of the parameters.
        bootstrap: replicates, or None.
        hysteresis: of both branches, or None.
        error: of predictions, as readings left out show it; None of a law that depends on pressure
            and of specimens identified together.
        left_out: errors of the fit itself on groups of "pressure" and "length" left out, which the error
            is made of; empty where it is None.
        posterior: draws, or None.
        shared: what errors that all readings share do, or None.
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
    """The evidence that is asked for.

    Args:
        result: the fit.
        progress: called with (what, done, total) as it comes.
        validation: leave out each pressure and each length.
        profiles: profile likelihoods.
        replicates: of the bootstrap.
        seed: of the bootstrap and of the posterior.
        known: the error of predictions and the errors on what was left out that it is made of, where a
            choice knows them; found by leaving out otherwise.
        posterior: draw from it.
        noise: standard deviation of a reading [N], where it is known, of the posterior.
        shared: errors that all readings share, see `carry`.
    """

    def told(what: str) -> Callable[[int, int], None]:
        return functools.partial(progress, what)

    error, left_out = _error(result) if known is None else known
    kinds = left_out_kinds(result) if validation else ()
    drawn, sampled = None, None
    if replicates:
        drawn = bootstrap(result, replicates, seed=seed, progress=told("bootstrap"))
    if posterior:
        sampled = sample(result, noise=noise, seed=seed, progress=told("posterior"))
    return Evidence(
        validations=tuple(
            validate(result, kind, progress=told(f"leave one {kind} out")) for kind in kinds
        ),
        profiles=profile(result, progress=told("profile likelihood")) if profiles else (),
        bootstrap=drawn,
        error=error,
        left_out=left_out,
        posterior=sampled,
        shared=carry(result, shared) if shared else None,
    )


def _error(result: Identification) -> tuple[ModelError | None, Mapping[str, LeftOut]]:
    """The error of predictions, by leaving out each length and groups of neighbouring pressures."""
    problem = result.problem
    if result.dependence != "fixed" or len(problem.parts) > 1:
        return None, {}
    kinds = {kind: (groups_of(problem, kind), 1) for kind in ("length", "pressure")}
    found = leave_out_each([(problem, result.end.u)], kinds)[0]
    left_out = {kind: one for kind, one in found.items() if np.isfinite(one.error).all()}
    return model_error(result.data, result.residuals, left_out, result.n_parameters), left_out


def left_out_kinds(result: Identification) -> tuple[str, ...]:
    """What can be left out."""
    data, kinds = result.data, ("pressure", "length")
    return tuple(kind for kind in kinds if np.unique(data.levels(kind)[data.loaded]).size > 1)


def evidence_as_dict(evidence: Evidence) -> dict[str, Any]:
    """The evidence as JSON-ready data in SI; null where there is no number."""
    document: dict[str, Any] = {}
    if evidence.error is not None:
        document["model_error"] = evidence.error.as_dict()
    for one in evidence.validations:
        document[f"leave_one_{one.groups}_out"] = {
            "rmse_N": finite_or_none(one.rmse),
            "interior_rmse_N": finite_or_none(one.interior_rmse),
            "left_out": one.values.tolist(),
            "group_rmse_N": _finite(one.group_rmse),
        }
    if evidence.profiles:
        document["profiles"] = {
            one.name: {
                "verdict": one.verdict,
                "unit": si_unit(one.kind),
                "values": one.values.tolist(),
                "excess": _finite(one.excess),
                **{f"interval_{100 * at:.0f}": _finite(ends) for at, ends in one.intervals.items()},
            }
            for one in evidence.profiles
        }
    if evidence.bootstrap is not None:
        drawn = evidence.bootstrap
        document["bootstrap"] = {
            "replicates": len(drawn.samples),
            "failed": drawn.failed,
            "units": "SI",
            "stderr": {name: finite_or_none(value) for name, value in drawn.stderr.items()},
            "interval_95": {name: drawn.interval(name) for name in drawn.names},
            "band_95_N": drawn.band().tolist(),
        }
    if evidence.hysteresis is not None:
        document["hysteresis"] = hysteresis_as_dict(evidence.hysteresis)
    if evidence.posterior is not None:
        document["posterior"] = posterior_as_dict(evidence.posterior)
    if evidence.shared is not None:
        document["shared_errors"] = evidence.shared.by_source()
    return document


def _finite(values: Iterable[float]) -> list[float | None]:
    return [finite_or_none(value) for value in values]


def evidence_tables(evidence: Evidence, result: Identification, system: str) -> list[Table]:
    """The evidence as tables of text in a unit system."""

    def text(value: float, kind: str, digits: int, none: str = "none") -> str:
        known = math.isfinite(value)
        return Quantity(value, kind, digits).in_units(system) if known else none

    def interval(ends: tuple[float, float], kind: str) -> str:
        return " to ".join(text(end, kind, 5, none="open") for end in ends)

    tables: list[Table] = []
    if evidence.validations:
        rows = [("in sample", result.errors.rmse, math.nan)]
        rows += [
            (f"leave one {one.groups} out", one.rmse, one.interior_rmse)
            for one in evidence.validations
        ]
        shown = [
            (what, *(text(error, "force", 4, "") for error in errors)) for what, *errors in rows
        ]
        tables.append(("Validation", ("", "RMSE", "without the extremes"), shown))
    if evidence.profiles:
        shown = [
            (one.name, *(interval(one.intervals[at], one.kind) for at in LEVELS), one.verdict)
            for one in evidence.profiles
        ]
        levels = tuple(f"{100 * at:.0f} %" for at in LEVELS)
        tables.append(("Profile likelihood", ("parameter", *levels, "verdict"), shown))
    if evidence.bootstrap is not None:
        drawn = evidence.bootstrap
        shown = [
            (
                one.name, text(drawn.stderr[one.name], one.kind, 2),
                interval(drawn.interval(one.name), one.kind),
            )
            for one in result.estimates
            if one.name in drawn.names
        ]  # fmt: skip
        failed = f", {drawn.failed} more did not converge" if drawn.failed else ""
        title = f"Bootstrap, {len(drawn.samples)} replicates{failed}"
        tables.append((title, ("parameter", "std. error", "95 %"), shown))
    if evidence.hysteresis is not None:
        tables.append(hysteresis_table(evidence.hysteresis, system))
    if evidence.posterior is not None:
        tables.append(posterior_table(evidence.posterior, system))
    if evidence.shared is not None:
        scatter = np.sqrt(np.diag(result.covariance))
        every = np.vstack([scatter, evidence.shared.effects])
        every = np.vstack([every, np.sqrt(np.sum(every**2, axis=0))])
        names, sources = evidence.shared.names, evidence.shared.sources
        shown = []
        for one in result.estimates:
            errors = every[:, names.index(one.name)] if one.name in names else [math.nan]
            if math.isfinite(errors[0]):
                # What has no effect has one of rounding.
                kept = [error if error > 1e-9 * errors[-1] else 0.0 for error in errors]
                shown.append((one.name, *(text(error, one.kind, 2) for error in kept)))
        header = "parameter", "scatter", *(s.replace("_", " ") for s in sources), "all together"
        tables.append(("Standard errors by source", header, shown))
    return tables


def evidence_warnings(evidence: Evidence, result: Identification) -> tuple[str, ...]:
    """Where the levels of evidence disagree."""
    found = []
    for one in evidence.profiles:
        if one.verdict in {"flat", "one-sided"}:
            side = "on neither side" if one.verdict == "flat" else "on one side only"
            found.append(f"The data bound {one.name} {side} (profile likelihood).")
    spread = {} if evidence.bootstrap is None else evidence.bootstrap.stderr
    for estimate in result.estimates:
        drawn = spread.get(estimate.name, math.nan)
        ratio = drawn / estimate.stderr if estimate.stderr else math.nan
        if math.isfinite(ratio) and not 1 / _DISAGREE < ratio < _DISAGREE:
            found.append(
                f"The standard error of {estimate.name} by bootstrap is {ratio:.2g} times that of "
                "the linear theory: believe neither too far."
            )
    for one in evidence.validations:
        if one.rmse > 2 * result.errors.rmse and np.isfinite(one.rmse):
            found.append(
                f"With one {one.groups} left out the error is {one.rmse / result.errors.rmse:.2g} "
                "times that in sample: do not extrapolate in it."
            )
    if evidence.hysteresis is not None:
        found += hysteresis_warnings(evidence.hysteresis)
    if evidence.posterior is not None:
        own = result.residuals * np.sqrt(result.weights)
        if result.data.force_std is not None:
            own = own / result.data.force_std[result.data.loaded]
        found += posterior_warnings(evidence.posterior, float(np.sqrt(np.mean(own**2))))
    return tuple(found)

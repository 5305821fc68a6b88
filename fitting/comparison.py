"""Compare published static models with famjax's own on one force map.

Every model, published or not, is a family with free parameters. All models are fitted to the map, refitted
without some of its readings, and used to predict those readings, in the same way.
"""

import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from jaxtyping import Bool, Float

import famjax
from famjax.boundary.errors import InputError, check_seed, class_named, class_path
from famjax.boundary.tasks import AnyExecutor, Store, run_tasks
from famjax.boundary.units import finite_or_none

from .arguments import check_float64, check_names, check_whole
from .checks import check_affine
from .choice import MOST, choose, validate_choice
from .data import ForceData, check_maps
from .identification import identify
from .model_families import ModelFamily, peer_families
from .posing import own_parts, taking_part
from .problem import Part, Problem
from .response import MapInputs
from .search import End, best_of, descend_all, latin_hypercube
from .summary import joint_derivatives
from .validation import LeftOut, leave_out_each, validate

KINDS = ("pressure", "length")
"""Kinds of levels that are left out in turn."""

_RIDGE = 1e-9  # for columns of unit length: far below the weight of any reading
_STARTS = 4  # for each refit of famjax's own models, as in `validate`

OwnModel: TypeAlias = ModelFamily | famjax.AbstractMuscle | type | str
"""A user's own model: an instance with declared parameters, its `ModelFamily`, or the class (also as
`module:Class`) of a model, law, geometry or force term."""


@dataclasses.dataclass(frozen=True)
class PeerFit:
    """A published model fitted to a force map.

    Attributes:
        family: the model, and its parameters with units and bounds.
        problem: the least-squares problem that was solved.
        end: end point of the best descent.
    """

    family: ModelFamily
    problem: Problem = dataclasses.field(repr=False)
    end: End = dataclasses.field(repr=False)

    @property
    def predicted(self) -> Float[np.ndarray, " points"]:
        """Predicted force [N] at the loaded readings."""
        return self.end.point.force

    @property
    def values(self) -> dict[str, float]:
        """Values of the parameters [SI], by name."""
        numbers = (*self.end.point.parameters.tolist(), *self.end.point.x.tolist())
        return dict(zip(self.problem.names + self.problem.linear, numbers, strict=True))

    @property
    def at_bound(self) -> tuple[str, ...]:
        """Names of the parameters at a bound."""
        problem, x = self.problem, self.end.point.x
        low, high = problem.coefficient_min, problem.coefficient_max
        margin = 1e-9 * np.abs(x).max(initial=0.0)
        reached = np.concatenate([
            np.minimum(self.end.u, 1 - self.end.u) <= 1e-9, np.minimum(x - low, high - x) <= margin
        ])  # fmt: skip
        return tuple(np.array(problem.names + problem.linear)[reached].tolist())

    def determines(self, kept: Bool[np.ndarray, " points"]) -> bool:
        """Return whether the kept readings determine the predictions at the other readings."""
        _, jacobian, _ = joint_derivatives(self.end.point)
        columns = jacobian[: kept.size]
        size = np.linalg.norm(columns[kept], axis=0)
        columns = columns / np.where(size > 0, size, 1.0)
        _, values, directions = np.linalg.svd(columns[kept], full_matrices=False)
        # Smaller singular values of unit columns are rounding.
        known, others = directions[values > 1e-7 * values[0]], columns[~kept]
        missed = np.linalg.norm(others - others @ known.T @ known)
        return bool(missed <= 1e-6 * np.linalg.norm(others))


def fit_peer(
    name: str | ModelFamily, data: ForceData, *, starts: int = 32, seed: int = 0
) -> PeerFit:
    """Fit a published model to the loaded readings of a map by least squares.

    Args:
        name: one of `peer_families(data)`, or your own family.
        data: the force map. Readings are weighted by 1/`force_std`, if it is given.
        starts: number of starts.
        seed: random seed for the starts.

    Raises:
        InputError: the name is unknown, there are no starts or too few readings, or the force is undefined
            (nan) at some reading.
        RuntimeError: float64 is off.
    """
    check_float64()
    check_whole("starts", starts, 1)
    known = peer_families(data)
    if isinstance(name, str) and name not in known:
        raise InputError(
            f"unknown published model {name!r}; available for this map: {', '.join(known)}"
        )
    family = known[name] if isinstance(name, str) else name
    points, needed = int(data.loaded.sum()), len(family.declared)
    if points < needed:
        raise InputError(
            f"{family.label} has {needed} parameters, but the map has {points} loaded readings: "
            "take more readings, or choose a model with fewer parameters"
        )
    problem, searched = _posed(family, data), len(family.searched)
    begin = latin_hypercube(searched, starts if searched else 1, seed)
    try:
        best = best_of(descend_all(problem, begin))
    except InputError:
        raise InputError(
            f"from every starting point, the force of {family.label} is undefined (nan) at some reading. "
            "The model may not apply to a muscle longer than its rest length: check the lengths and the "
            "rest length"
        ) from None
    return PeerFit(family, problem, best)


def _posed(family: ModelFamily, data: ForceData) -> Problem:
    """Set up the fit of a model to the loaded readings of a map.

    Raises:
        InputError: the force is not affine in the parameters declared linear.
    """
    at, nothing = data.loaded, np.zeros(1)
    count = int(at.sum())
    inputs = MapInputs(
        data.length[at], data.pressure[at], data.force[at], nothing, nothing, np.zeros((1, 0))
    )
    weight = np.ones(count) if data.force_std is None else 1 / data.force_std[at]
    models = family.family
    part = Part(
        data.specimen.name, models, inputs, data.force[at], weight, np.arange(len(models.nonlinear)),
        {kind: data.levels(kind)[at] for kind in KINDS}, np.zeros(count, int),
    )  # fmt: skip
    low, high = (np.array([getattr(d, end) for d in family.searched]) for end in ("low", "high"))
    least, most = (np.array([getattr(d, end) for d in family.linear]) for end in ("low", "high"))
    problem = Problem(
        (part,), models.nonlinear, low, high, models.linear, least, most, ridge=_RIDGE
    )
    if models.linear:
        check_affine(problem)
    return problem


@dataclasses.dataclass(frozen=True)
class _Fit:
    """A fitted model and the values for its row in the table.

    Attributes:
        n_parameters, at_bound, notes: see `ComparisonRow`.
        error: prediction minus reading [N] at the loaded readings.
        left_out: returns the held-out errors for "pressure" or "length".
    """

    n_parameters: int
    error: Float[np.ndarray, " points"]
    left_out: Callable[[str], LeftOut]
    at_bound: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def _chosen(data: ForceData, starts: int, seed: int) -> _Fit:
    """Choose a model automatically; repeat the choice without each length and pressure group (of eight)."""
    choice = choose(data, starts=starts, seed=seed)
    result = choice.chosen
    return _Fit(
        result.n_parameters, result.residuals,
        lambda kind: validate_choice(
            choice, kind, most=8 if kind == "pressure" else MOST, starts=_STARTS, seed=seed
        ),
        result.stopped, (f"chosen family: {choice.name}",),
    )  # fmt: skip


def _identified(data: ForceData, starts: int, seed: int, options: Mapping[str, Any]) -> _Fit:
    """Fit a muscle with `identify`."""
    result = identify(data, starts=starts, seed=seed, **options)
    notes = () if result.converged else ("the fit did not converge",)
    if not np.isfinite(result.errors.rmse):
        notes += ("the model's force is undefined (nan) at some readings",)
    return _Fit(
        result.n_parameters, result.residuals,
        lambda kind: validate(result, kind, starts=_STARTS), result.stopped, notes,
    )  # fmt: skip


def _of_family(data: ForceData, starts: int, seed: int, family: ModelFamily) -> _Fit:
    """Fit a model with declared parameters."""
    fit = fit_peer(family, data, starts=starts, seed=seed)
    notes = () if fit.end.converged else ("the best descent did not converge",)

    def left_out(kind: str) -> LeftOut:
        level = data.left_out_as(kind)[data.loaded]
        if not all(fit.determines(level != one) for one in np.unique(level)):
            raise InputError("the remaining readings do not determine the held-out predictions")
        fits, kinds = [(fit.problem, fit.end.u)], {kind: (None, 8 if family.searched else 1)}
        return leave_out_each(fits, kinds, seed=seed, settled=True, least=2)[0][kind]

    error = fit.predicted - data.force[data.loaded]
    return _Fit(len(family.declared), error, left_out, fit.at_bound, notes)


_Model: TypeAlias = tuple[str, str, Callable[[ForceData, int, int], _Fit]]
"""Label, note, and the function that fits the model."""


def _models(data: ForceData) -> dict[str, _Model]:
    """Return all models available for a map, by name."""
    own = {
        "famjax_choice": ("famjax, automatic choice (nested)", "", _chosen),
        "famjax_cubic": ("famjax, odd cubic", "", functools.partial(_identified, options={"order": 3})),
        "famjax_ogden": ("famjax, Ogden", "", functools.partial(_identified, options={"law": "ogden"})),
    }  # fmt: skip
    return own | {name: _as_model(family) for name, family in peer_families(data).items()}


def _as_model(family: ModelFamily) -> _Model:
    return family.label, family.note, functools.partial(_of_family, family=family)


@dataclasses.dataclass(frozen=True)
class ComparisonRow:
    """One row of the comparison table. Errors [N] are for the loaded readings; nan if unavailable.

    Attributes:
        name: name of the model.
        label: authors and variant.
        n_parameters: number of fitted parameters.
        rmse, max_error: in-sample RMSE and largest error.
        lopo_rmse: held-out RMSE with each pressure left out in turn.
        lolo_interior_rmse: held-out RMSE with each length left out, excluding the shortest and longest.
        lolo_rmse: held-out RMSE with each length left out.
        at_bound: parameters at a bound.
        note: remarks.
    """

    name: str
    label: str
    n_parameters: int = 0
    rmse: float = math.nan
    max_error: float = math.nan
    lopo_rmse: float = math.nan
    lolo_interior_rmse: float = math.nan
    lolo_rmse: float = math.nan
    at_bound: tuple[str, ...] = ()
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return the row as JSON-ready data: null for nan, lists for tuples, and units in the keys."""
        return {
            f"{key}_N" if isinstance(value, float) else key:
            finite_or_none(value) if isinstance(value, float) else value
            for key, value in (dataclasses.asdict(self) | {"at_bound": list(self.at_bound)}).items()
        }  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Comparison table for a force map, sorted by the error on held-out interior lengths.

    Attributes:
        data: the force map.
        rows: one row for each model.
    """

    data: ForceData
    rows: tuple[ComparisonRow, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return the table as JSON-ready data with units in the keys."""
        return {
            "specimen": self.data.specimen.name,
            "sha256": self.data.sha256,
            "n_loaded": int(self.data.loaded.sum()),
            "max_force_N": self.data.max_force,
            "models": [row.as_dict() for row in self.rows],
        }


def compare(
    data: ForceData,
    models: Sequence[str] | None = None,
    *,
    own: Sequence[OwnModel] = (),
    starts: int = 32,
    seed: int = 0,
    executor: AnyExecutor = None,
    resume: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Comparison:
    """Compare published models, famjax's models and your own on one force map.

    Every model is fitted to all loaded readings. It is then refitted without each pressure and each length,
    and predicts the readings left out. The bounds of the published models are wide, see `peer_families`.

    Args:
        data: the force map.
        models: names of published models, or famjax_choice, famjax_cubic, famjax_ogden; all by default.
        own: your own models, see `OwnModel`.
        starts: number of starts for each nonlinear fit.
        seed: random seed for the starts.
        executor: executor for the models, each of which is a task, see
            `famjax.boundary.tasks.AnyExecutor`.
        resume: JSONL file that stores finished rows, so that an interrupted comparison can continue. It is
            created if missing. Your own models are recognised only by their names.
        progress: called with (models done, total).

    Returns:
        The table. A model that cannot be fitted to this map has a note instead of errors.

    Raises:
        InputError: a name is unknown, the map has only one pressure or length, the `resume` file is from
            another comparison, or the executor failed.
    """
    check_maps(data)
    check_seed(seed)
    check_whole("starts", starts, 1)
    known = tuple(_models(data))
    chosen = known if models is None else check_names("models", models)
    for name in chosen:
        if name not in known:
            raise InputError(f"unknown model {name!r}; available for this map: {', '.join(known)}")
    for kind in KINDS:
        if np.unique(data.levels(kind)[data.loaded]).size < 2:
            raise InputError(
                f"leaving out a {kind} requires loaded readings at two or more {kind}s, but all "
                f"{int(data.loaded.sum())} are at one {kind}"
            )
    tasks = [*chosen, *(_own_model(one, data) for one in own)]
    names = [one if isinstance(one, str) else one[0] for one in tasks]
    settings = {
        "version": famjax.__version__, "data": data.sha256, "models": names, "starts": starts, "seed": seed,
        "tolerances": [data.pressure_tolerance, data.length_tolerance],
    }  # fmt: skip
    store = Store(resume, "comparison", settings, len(tasks))
    row = functools.partial(_row, data, starts, seed)
    run_tasks(row, tasks, executor=executor, store=store, progress=progress, names=names)
    rows = [ComparisonRow(**{**part, "at_bound": tuple(part["at_bound"])}) for part in store]
    return Comparison(data, tuple(sorted(rows, key=_place)))


def _place(row: ComparisonRow) -> tuple[float, float, int]:
    """Sort key: error on held-out interior lengths, in-sample error (as printed), number of parameters."""
    out, within = (
        math.inf if math.isnan(one) else float(f"{one:.4g}")
        for one in (row.lolo_interior_rmse, row.rmse)
    )
    return out, within, row.n_parameters


def _own_model(given: OwnModel, data: ForceData) -> tuple[str, _Model]:
    """Return the name and table entry of a user's own model.

    Raises:
        InputError: the class is unknown, or some of its fields have no known value.
    """
    if isinstance(given, famjax.AbstractMuscle):
        given = ModelFamily.of(given)
    if isinstance(given, ModelFamily):
        return given.label, _as_model(given)
    kind: Any = given
    if isinstance(given, str):
        kind = class_named(given, famjax.parameters.Parametrised, "model")
    path = given if isinstance(given, str) else class_path(kind)
    if issubclass(kind, famjax.AbstractMuscle):
        fields = {one.name for one in dataclasses.fields(kind)}
        known = {"rest_length": data.specimen.rest_length} if "rest_length" in fields else {}
        try:
            return path, _as_model(ModelFamily.of(kind.template(**known), path))
        except ValueError as error:
            raise InputError(f"the model {path} cannot be created for the fit: {error}") from None
    if issubclass(kind, famjax.materials.AbstractMaterial):
        options: dict[str, Any] = {"law": kind}
    else:
        is_geometry = issubclass(kind, famjax.geometries.AbstractGeometry)
        parts, declared = own_parts([data], *((kind, ()) if is_geometry else (None, (kind,))))
        options = {**parts, "parameters": taking_part(declared, {})}
    return path, (path, "", functools.partial(_identified, options=options))


def _row(
    data: ForceData, starts: int, seed: int, model: str | tuple[str, _Model]
) -> dict[str, Any]:
    """Return a model's table row as plain values; a model that cannot be fitted has only a note."""
    name, (label, note, fitted) = (model, _models(data)[model]) if isinstance(model, str) else model
    notes = [note] if note else []
    try:
        fit = fitted(data, starts, seed)
    except InputError as refused:
        failed = ComparisonRow(name, label, note="; ".join([*notes, str(refused)]))
        return dataclasses.asdict(failed)
    left_out = {}
    for kind in KINDS:
        try:
            left_out[kind] = fit.left_out(kind)
        except InputError as refused:
            notes.append(f"with one {kind} left out: {refused}")
    size, pressure, length = np.abs(fit.error), left_out.get("pressure"), left_out.get("length")
    return dataclasses.asdict(
        ComparisonRow(
            name, label, fit.n_parameters,
            rmse=float(np.sqrt(np.mean(size**2))), max_error=float(size.max()),
            lopo_rmse=pressure.rmse if pressure else math.nan,
            lolo_interior_rmse=length.interior_rmse if length else math.nan,
            lolo_rmse=length.rmse if length else math.nan,
            at_bound=fit.at_bound, note="; ".join([*notes, *fit.notes]),
        )
    )  # fmt: skip

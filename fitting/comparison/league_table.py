"""The league table: every published model fitted to one force map and tested on held-out parts."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

import famjax
from famjax import peers
from famjax.boundary.class_path import class_path
from famjax.boundary.errors import InputError, check_seed
from famjax.boundary.tasks import AnyExecutor, Store, can_travel, run_tasks

from ..arguments import check_names, check_whole
from ..data import ForceData, check_maps, data_frame, html_table
from .cross_validation import (
    CrossValidation,
    FitAndPredict,
    Groups,
    check_groups,
    cross_validate,
    held_out_errors,
)
from .fit import fit_and_cross_validate_peer, forces_of
from .hocking import ANGLE, fit_hocking_wereley, hocking_orders
from .own_models import CHOICE, OWN, check_options, choice_row, identified_row, own_model
from .peer_family import Model, PeerContext, PeerFamily, Values
from .published import peer_families
from .row import ComparisonRow

if TYPE_CHECKING:
    import pandas

_LEFT_OUT: tuple[Groups, Groups] = ("pressure", "length")

_Model: TypeAlias = (
    tuple[str, int, FitAndPredict] | tuple[str, Mapping[str, Any]] | PeerFamily | type | str
)
OwnModel: TypeAlias = _Model | famjax.AbstractMuscle
"""A model of one's own: (name, number of parameters, what fits a map and returns the force of length
and pressure); or (name, options of `identify`), such as `("gent", {"law": Gent})`; or a family of
peers, see `PeerFamily.of`, or a model that has one; or the class, or `module:Class`, of a whole model, a
law, a geometry or a force term."""


@dataclasses.dataclass(frozen=True, repr=False)
class Comparison:
    """The table of a force map, the smallest error on interior lengths left out first.

    Attributes:
        data: the force map.
        rows: of the models.
    """

    data: ForceData
    rows: tuple[ComparisonRow, ...]

    def __repr__(self) -> str:
        best = self.rows[0] if self.rows else None
        first = (
            ""
            if best is None
            else (
                f", {best.label} the best with {best.lolo_interior_rmse:.4g} N on interior lengths left out"
            )
        )
        return f"Comparison({self.data.specimen.name}: {len(self.rows)} models{first})"

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each model, the unit in each column's name; lists are left out.

        Raises:
            InputError: pandas is not installed.
        """
        return data_frame(
            {key: value for key, value in row.items() if not isinstance(value, list | dict)}
            for row in self.as_dict()["models"]
        )

    def _repr_html_(self) -> str:
        header = ("model", "parameters", "interior lengths out [N]", "in sample [N]")
        rows = [
            (row.label, row.n_parameters, row.lolo_interior_rmse, row.rmse) for row in self.rows
        ]
        return html_table(repr(self), header, rows)

    def as_dict(self) -> dict[str, Any]:
        """The table for JSON, the unit in each key."""
        return {
            "specimen": self.data.specimen.name,
            "source": self.data.source,
            "sha256": self.data.sha256,
            "rest_length_m": self.data.specimen.rest_length,
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
    progress: Callable[[int, int, str], None] | None = None,
) -> Comparison:
    """The league table of published models, and of others, on one force map.

    Every model is fitted to all loaded readings, and again without each pressure and each length,
    which are then predicted. The bounds of the peers are wide: see `peer_families`.

    Args:
        data: the force map.
        models: names out of `comparable_models(data)`; all where None.
        own: further models, see `OwnModel`.
        starts: of each nonlinear fit.
        seed: of the starts.
        executor: what fits the models, each a task: this process, processes or a cluster, see
            `famjax.boundary.tasks.AnyExecutor`. A model of your own that cannot be sent to another
            process, such as a function within a function, is fitted in this one.
        resume: JSONL file to which each finished row is written, created if missing; a comparison that was
            stopped goes on from there. Models of your own are known by their names.
        progress: called with (models done, models, name of the next one).

    Returns:
        The table. A model that cannot be fitted to this map is in it with a note and no errors.

    Raises:
        InputError: an unknown name, a map with one pressure or one length only, the folder of
            another comparison, or the executor is gone.
    """
    check_maps(data)
    check_seed(seed)
    check_whole("starts", starts, 1)
    known = comparable_models(data)
    chosen = known if models is None else check_names("models", models)
    unknown = [name for name in chosen if name not in known]
    if unknown:
        raise InputError(f"unknown model {unknown[0]!r}; known for this map are {', '.join(known)}")
    for groups in _LEFT_OUT:
        check_groups(data, groups)
    further: list[_Model] = [
        PeerFamily.of(model) if isinstance(model, famjax.AbstractMuscle) else model for model in own
    ]
    for model in further:
        if isinstance(model, str | type):
            own_model(model, data)
        elif isinstance(model, tuple) and len(model) == 2:
            check_options(*model)
    tasks = [_Task(model, data, starts, seed) for model in (*chosen, *further)]
    names = [task.name for task in tasks]
    settings = {
        "version": famjax.__version__,
        "data": data.sha256,
        "tolerances": [data.pressure_tolerance, data.length_tolerance],
        "models": names,
        "starts": starts,
        "seed": seed,
    }
    store = Store(resume, "comparison", settings, len(tasks))

    def tell(done: int, total: int) -> None:
        if progress is not None:
            following = (name for index, name in enumerate(names) if index not in store)
            progress(done, total, next(following, ""))

    for index, task in enumerate(tasks):
        if executor is not None and index not in store and not can_travel(task):
            tell(sum(done in store for done in range(len(tasks))), len(tasks))
            store.keep(index, _row(task))
    run_tasks(_row, tasks, executor=executor, store=store, progress=tell, names=names)
    rows = [ComparisonRow.from_dict(part) for part in store]
    rows.sort(key=_place)
    return Comparison(data, tuple(rows))


def _place(row: ComparisonRow) -> tuple[bool, float, float, int]:
    """In the table: by interior lengths left out, then in sample; equal models by their parameters."""
    error = row.lolo_interior_rmse
    known = not math.isnan(error)
    in_sample = math.inf if math.isnan(row.rmse) else float(f"{row.rmse:.6g}")
    return (not known, float(f"{error:.6g}") if known else 0.0, in_sample, row.n_parameters)


def comparable_models(data: ForceData) -> tuple[str, ...]:
    """The names of all models that can be compared on a map, fitted ones first."""
    return (CHOICE, *OWN, *peer_families(data), "hocking_wereley", *_published(data))


def _published(data: ForceData) -> dict[str, PeerFamily]:
    """Models with published or nominal constants for a muscle of this size; nothing is free."""
    specimen = data.specimen
    bore, rest = specimen.nominal_diameter, specimen.rest_length
    if bore is None:
        return {}

    def nominal(_: Values) -> Model:
        return peers.Gaylord(famjax.Braid.from_rest(diameter=bore, braid_angle=ANGLE, length=rest))

    found = {"gaylord_nominal": PeerFamily("Gaylord 1958, bore and 28.6 deg", (), nominal)}
    for muscle, size in {"10 mm": 10e-3, "20-200": 20e-3, "20-400": 20e-3}.items():
        if math.isclose(bore, size, rel_tol=1e-6):
            found[f"sarosi_published_{muscle.replace(' ', '_')}"] = PeerFamily(
                f"Sarosi 2012, constants of {muscle}",
                (),
                lambda _, muscle=muscle: peers.Sarosi.published(muscle, rest_length=rest),
            )
    if specimen.name in {"DMSP-10-250", "DMSP-20-300"}:
        found["martens_published"] = PeerFamily(
            "Martens & Boblan 2017, their constants",
            (),
            lambda _: peers.Martens.published(specimen.name),
        )
    at = PeerContext.of(data)
    return {name: dataclasses.replace(one, origin=(name, at)) for name, one in found.items()}


@dataclasses.dataclass(frozen=True)
class _Task:
    """One row of the table.

    Attributes:
        model: a known name without a colon, or a model of one's own.
        data: the force map.
        starts, seed: of the fits.
    """

    model: _Model
    data: ForceData
    starts: int
    seed: int

    @property
    def name(self) -> str:
        """Of the row."""
        if isinstance(self.model, PeerFamily):
            return self.model.label
        if isinstance(self.model, type):
            return class_path(self.model)
        return self.model if isinstance(self.model, str) else self.model[0]


def _row(task: _Task) -> dict[str, Any]:
    """The row of a task, made plain."""
    model, data, starts, seed = task.model, task.data, task.starts, task.seed
    if isinstance(model, type) or (isinstance(model, str) and ":" in model):
        model = own_model(model, data)
    if isinstance(model, str):
        row = _known_row(model, data, starts, seed)
    elif isinstance(model, PeerFamily):
        row = _peer_row(model.label, model, data, starts, seed)
    elif len(model) == 2:
        what, options = model
        row = identified_row(what, what, options, data, starts, seed)
    else:
        name, count, fit_and_predict = model
        row = _own_row(ComparisonRow(name, name, count), fit_and_predict, data)
    return row.as_dict()


def _known_row(name: str, data: ForceData, starts: int, seed: int) -> ComparisonRow:
    if name == CHOICE:
        return choice_row(data, starts, seed)
    if name in OWN:
        what, options = OWN[name]
        label = f"famjax, {what}, physical box"
        return identified_row(name, label, options, data, starts, seed)
    families, published = peer_families(data), _published(data)
    if name in published:
        return _published_row(name, published[name], data)
    if name in families:
        return _peer_row(name, families[name], data, starts, seed)
    count = sum(hocking_orders(data).values())
    label = "Hocking & Wereley 2012, order 4 per pressure"
    note = "geometry held at the nominal one; lower orders where a pressure has few lengths"
    return _own_row(ComparisonRow(name, label, count, note=note), fit_hocking_wereley, data)


def _peer_row(
    name: str, family: PeerFamily, data: ForceData, starts: int, seed: int
) -> ComparisonRow:
    row = ComparisonRow(name, family.label, len(family.parameters), note=family.note)
    try:
        fit, held_out = fit_and_cross_validate_peer(
            family, data, _LEFT_OUT, starts=starts, seed=seed
        )
    except InputError as refused:
        return row.noted(str(refused))
    if not fit.converged:
        row = row.noted("the best descent did not converge")
    if not fit.determined:
        row = row.noted("the readings do not determine all its parameters")
    for groups, found in zip(_LEFT_OUT, held_out, strict=True):
        if found.ambiguous:
            count = f"{len(found.ambiguous)} of {len(found.errors)}"
            row = row.noted(f"not determined without a {groups}, for {count} of them")
    row = dataclasses.replace(row, at_bound=fit.at_bound)
    return row.with_errors(fit.predicted - data.force[data.loaded], *held_out)


def _published_row(name: str, family: PeerFamily, data: ForceData) -> ComparisonRow:
    predicted = forces_of(family, data)
    held_out = [held_out_errors(data, groups, predicted) for groups in _LEFT_OUT]
    row = ComparisonRow(name, family.label, 0)
    return row.with_errors(predicted - data.force[data.loaded], *held_out)


def _own_row(row: ComparisonRow, fit_and_predict: FitAndPredict, data: ForceData) -> ComparisonRow:
    at = data.loaded
    try:
        predict = fit_and_predict(data)
    except InputError as refused:
        return row.noted(str(refused))
    predicted = np.asarray(predict(data.length[at], data.pressure[at]), float)
    held_out: list[CrossValidation | None] = [None, None]
    for place, groups in enumerate(_LEFT_OUT):
        try:
            held_out[place] = cross_validate(fit_and_predict, data, groups)
        except InputError as refused:
            row = row.noted(f"without a {groups}: {refused}")
    return row.with_errors(predicted - data.force[at], *held_out)

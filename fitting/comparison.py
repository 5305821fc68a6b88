"""Published static models and famjax's own on one force map: fits, cross-validation, a league table.

`compare` makes the table, `fit_peer` fits one model, `cross_validate` leaves readings out.
"""

import dataclasses
import functools
import inspect
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import famjax
from famjax import peers
from famjax.boundary.errors import InputError, check_seed, class_named, class_path
from famjax.boundary.tasks import AnyExecutor, Store
from famjax.boundary.units import finite_or_none
from famjax.compile_options import as_arrays, quick_jit
from famjax.parameters import Declared

from .arguments import check_names, check_whole
from .checks import check_affine
from .choice import MOST, choose, validate_choice
from .data import ForceData, check_maps, data_frame
from .descent import End, descend_many
from .engine import Point, predict
from .families import EstimatedSource
from .identification import identify
from .model_families import ModelFamily, peer_families
from .posing import own_parts, taking_part
from .problem import Part, Problem
from .response import MapInputs, linear_response
from .search import latin_hypercube
from .tasks import run_fits
from .validation import LeftOut, check_groups as check_left_out, leave_out_each

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

KINDS = ("pressure", "length")
"""What is left out of a map in turn."""
CHOICE = "famjax_choice"
OWN: Mapping[str, tuple[str, dict[str, Any]]] = {
    "famjax_cubic": ("odd cubic", {"order": 3}),
    "famjax_ogden": ("Ogden", {"law": "ogden"}),
}
"""Label and options of `identify` by name."""

_MAX_STEPS = 150
_RIDGE = 1e-9  # of columns of unit length: far below any reading's weight
_DEPENDENT = 1e-7  # part of a column of unit length that the others do not explain
_FOLD_STARTS = 8  # of the refits; the first is the fit to the whole map
_AS_GOOD = 1e-3  # parts of the cost by which two refits may differ and be called equally good
_DISAGREE = 0.01  # parts of the largest force by which they then may predict different forces
_AT_BOUND = 1e-9  # parts of the interval, or of the largest value, within which a bound is reached
_STARTS = 4  # of each refit of famjax's own models, as `validate` has them
_PRESSURE_GROUPS = 8  # that the choice is made anew without, as it judges its families
_ORDER = 4  # of Hocking and Wereley's law
_ANGLE = math.radians(90 - 28.6)  # from the circumference: the nominal one of Festo muscles

Predictor: TypeAlias = Callable[[np.ndarray, np.ndarray], Any]
"""Force [N] of arrays of length [m] and pressure [Pa]."""

OwnModel: TypeAlias = (
    tuple[str, Mapping[str, Any]] | ModelFamily | famjax.AbstractMuscle | type | str
)
"""A model of one's own: (name, options of `identify`), such as `("gent", {"law": Gent})`; or a model with
declared parameters, or the family of one; or the class, or `module:Class`, of a whole model, a law, a
geometry or a force term."""


@dataclasses.dataclass(frozen=True)
class PeerFit:
    """A published model fitted to a force map.

    Attributes:
        name: in the registry.
        family: parameters with units and bounds.
        values: parameters [SI] by name.
        at_bound: names of the parameters that ended on a bound.
        predicted: force [N] at the loaded readings, shape (points,).
        converged: whether the best descent ended at a stationary point.
        determined: whether the readings determine all linear parameters; if not, the values are
            the smallest that fit.
        problem: as it was posed.
    """

    name: str
    family: ModelFamily
    values: dict[str, float]
    at_bound: tuple[str, ...]
    predicted: Float[np.ndarray, " points"]
    converged: bool
    determined: bool
    problem: Problem = dataclasses.field(repr=False)

    @property
    def model(self) -> famjax.AbstractMuscle:
        """The fitted model."""
        return self.family.build({name: jnp.asarray(v) for name, v in self.values.items()})


def fit_peer(
    name: str | ModelFamily, data: ForceData, *, starts: int = 32, seed: int = 0
) -> PeerFit:
    """The peer of that name that fits the loaded readings of a map best, by least squares.

    Parameters in which the force is linear are solved for, by orthogonal factorisation or, where
    they are bounded, by the convex core; of those that the readings leave open, the smallest are
    taken. The others are sought in their box from many starts.

    Args:
        name: one of `peer_families(data)`, or a family of your own.
        data: the force map. Readings count with 1/std, if given.
        starts: number of starts.
        seed: of the starts.

    Returns:
        The fit.

    Raises:
        InputError: an unknown name, no starts, too few readings, or a model that has no force at
            a reading.
        RuntimeError: float64 is off.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "fits need float64, and JAX computes in float32 by default. Put this line before any "
            'other use of JAX: jax.config.update("jax_enable_x64", True)'
        )
    check_whole("starts", starts, 1)
    if isinstance(name, str):
        known = peer_families(data)
        if name not in known:
            raise InputError(f"unknown peer {name!r}; known for this map: {', '.join(known)}")
        family = known[name]
    else:
        family, name = name, name.label
    points = int(data.loaded.sum())
    if points < len(family.declared):
        raise InputError(
            f"{family.label} has {len(family.declared)} parameters and the map {points} loaded "
            "readings: give more readings or choose a peer with fewer parameters"
        )
    problem, searched = _posed(family, data), len(family.nonlinear)
    begin = latin_hypercube(searched, starts if searched else 1, seed)
    ends, determined = _fitted([problem] * len(begin), begin)
    costs = np.array([one.cost for one in ends])
    if not np.isfinite(costs).any():
        raise InputError(
            f"{family.label} has no finite force at some reading, wherever it was started: its "
            "form may not hold for a muscle longer than at rest; check lengths and rest length"
        )
    best = int(np.nanargmin(costs))
    point = ends[best].point
    numbers = (*point.parameters.tolist(), *point.x.tolist())
    values = dict(zip(problem.names + problem.linear, numbers, strict=True))
    return PeerFit(
        name, family, values, _bounds_reached(family, values), point.force, ends[best].converged,
        determined[best], problem,
    )  # fmt: skip


def cross_validate_peer(
    fit: PeerFit, data: ForceData, groups: str = "pressure", *, seed: int = 0
) -> tuple[LeftOut, tuple[float, ...]]:
    """The errors of a peer at each pressure or length when refitted to the others.

    The readings left out have no weight. One start is the fit to the whole map; as that has seen them,
    refits from the other starts come first wherever they are as good.

    Args:
        fit: of the whole map.
        data: the same map.
        groups: "pressure" or "length".
        seed: of the starts.

    Returns:
        (errors, nan where no refit had a finite force; levels without which fits of equal cost predict
        different forces, as what is left does not determine the model).

    Raises:
        InputError: other groups, or fewer than two of them.
    """
    check_groups(data, groups)
    labels = data.left_out_as(groups)[data.loaded]
    levels = np.unique(labels)
    searched = len(fit.family.nonlinear)
    place = [(fit.values[str(d.name)] - d.low) / (d.high - d.low) for d in fit.family.declared
             if not d.linear]  # fmt: skip
    begin = np.clip(place, 0, 1)[None]  # rounding only can have left the box
    if searched:
        begin = np.vstack([begin, latin_hypercube(searched, _FOLD_STARTS - 1, seed)])
    folds = [fit.problem.with_readings(factor=1.0 * (labels != level)) for level in levels]
    ends, determined = _fitted(
        [one for one in folds for _ in begin], np.tile(begin, (len(folds), 1))
    )
    predicted, ambiguous = np.full(labels.size, math.nan), []
    for k, level in enumerate(levels):
        held, own = labels == level, range(k * len(begin), (k + 1) * len(begin))
        least = min((ends[j].cost for j in own if np.isfinite(ends[j].cost)), default=math.inf)
        good = [j for j in own if ends[j].cost <= (1 + _AS_GOOD) * least]
        if good:
            force = np.stack([ends[j].point.force[held] for j in good])
            predicted[held] = force[-1]
            apart = np.ptp(force, axis=0).max() > _DISAGREE * data.max_force
            if apart or not all(determined[j] for j in good):
                ambiguous.append(float(level))
    return _left_out(data, groups, predicted), tuple(ambiguous)


def cross_validate(
    fit_and_predict: Callable[[ForceData], Predictor], data: ForceData, groups: str = "pressure"
) -> LeftOut:
    """The errors of a model at each pressure or length when fitted to the others.

    For each group in turn the model is fitted to the readings outside it, slack ones included, and
    the group's loaded readings are predicted.

    Args:
        fit_and_predict: takes a force map and returns a function of length [m] and pressure [Pa].
        data: the force map.
        groups: "pressure" or "length".

    Returns:
        The errors.

    Raises:
        InputError: unknown groups, fewer than two of them, or a fit that refuses its readings.

    >>> from fitting import load_bundled
    >>> def mean(train):
    ...     force = train.force[train.loaded].mean()
    ...     return lambda length, pressure: force + 0 * length
    >>> print(f"{cross_validate(mean, load_bundled('DMSP-20-300'), 'length').rmse:.0f}")
    393
    """
    check_groups(data, groups)
    labels, predicted = data.left_out_as(groups), np.full(data.force.size, math.nan)
    for level in np.unique(labels[data.loaded]):
        held = (labels == level) & data.loaded
        predict_held = fit_and_predict(data.part(labels != level))
        predicted[held] = predict_held(data.length[held], data.pressure[held])
    return _left_out(data, groups, predicted[data.loaded])


def check_groups(data: ForceData, groups: str) -> None:
    """There must be two pressures or lengths with loaded readings to leave one out.

    Raises:
        InputError: there is one, or it is not known what to leave out.
    """
    if groups not in KINDS or not isinstance(data, ForceData):
        raise InputError(f"a model is cross-validated by pressure or length, got {groups!r}")
    if np.unique(data.levels(groups)[data.loaded]).size < 2:
        raise InputError(
            f"to leave out a {groups} there must be loaded readings at two of them or more; all "
            f"{int(data.loaded.sum())} share one"
        )


def _left_out(data: ForceData, groups: str, predicted: Float[np.ndarray, " points"]) -> LeftOut:
    """Errors of predictions [N] of the loaded readings, each without its own group."""
    level = data.left_out_as(groups)[data.loaded]
    group = np.unique(level, return_inverse=True)[1]
    return LeftOut(groups, level, group, predicted - data.force[data.loaded])


def _posed(family: ModelFamily, data: ForceData) -> Problem:
    """The problem of fitting a model to the loaded readings of a map.

    Raises:
        InputError: the force is not affine in what is said to be linear.
    """
    at, nothing = data.loaded, np.zeros(1)
    count = int(at.sum())
    inputs = MapInputs(
        data.length[at], data.pressure[at], data.force[at], nothing, nothing, np.zeros((1, 0))
    )
    weight = np.ones(count) if data.force_std is None else 1 / data.force_std[at]
    searched = [d for d in family.declared if not d.linear]
    linear = [d for d in family.declared if d.linear]
    part = Part(
        data.specimen.name, as_arrays(family), inputs, data.force[at], weight,
        np.arange(len(searched)), np.arange(len(linear)),
        {kind: data.levels(kind)[at] for kind in KINDS}, np.zeros(count, int),
    )  # fmt: skip
    problem = Problem(
        parts=(part,),
        names=family.nonlinear,
        low=np.array([d.low for d in searched]),
        high=np.array([d.high for d in searched]),
        linear=family.linear,
        coefficient_min=np.array([d.low for d in linear]),
        coefficient_max=np.array([d.high for d in linear]),
        ridge=_RIDGE if searched else 0.0,
    )
    if linear:
        check_affine(problem)
    return problem


def _fitted(
    problems: Sequence[Problem], starts: Float[np.ndarray, "fits p"]
) -> tuple[list[End], list[bool]]:
    """Where each descent ended, and whether the readings determine all linear parameters there."""
    ends = descend_many(problems, list(starts), max_steps=_MAX_STEPS)
    like = problems[0]
    if not like.names:
        found = [_smallest(end) for end in ends]
        return [end for end, _ in found], [known for _, known in found]
    limits = np.concatenate([like.coefficient_min, like.coefficient_max])
    if not like.linear or np.isfinite(limits).any():
        return ends, [True] * len(ends)
    A = np.stack([end.point.programme[0] for end in ends])
    size = np.linalg.norm(A, axis=1, keepdims=True)
    triangles = np.linalg.qr(A / np.where(size > 0, size, 1.0), mode="r")
    least = np.abs(np.diagonal(triangles, axis1=1, axis2=2)).min(axis=1)
    return ends, (least > _DEPENDENT).tolist()


def _smallest(end: End) -> tuple[End, bool]:
    """The least-squares solution where nothing is searched; the smallest where there are many."""
    A, b, _, _ = end.point.programme
    size = np.linalg.norm(A, axis=0)
    size[size == 0] = 1.0
    found, _, rank, _ = np.linalg.lstsq(A / size, b)
    x = found / size
    point: Point = dataclasses.replace(end.point, x=x, residual=A @ x - b)
    return dataclasses.replace(end, point=point, converged=True), bool(rank == A.shape[1])


def _bounds_reached(family: ModelFamily, values: dict[str, float]) -> tuple[str, ...]:
    largest = max((abs(values[name]) for name in family.linear), default=0.0)
    reached = []
    for d in family.declared:
        margin = _AT_BOUND * (largest if d.linear else d.high - d.low)
        value = values[str(d.name)]
        if min(abs(value - end) for end in (d.low, d.high)) <= margin:
            reached.append(str(d.name))
    return tuple(reached)


def hocking_orders(data: ForceData) -> dict[float, int]:
    """Number of coefficients that the loaded readings determine at each pressure [Pa].

    It is the number of lengths at which the bladder is strained there, four at most. Pressures
    with none are left out.
    """
    pressure, length, strained = data.pressures.level, data.lengths.level, data.strained
    return {
        float(level): min(_ORDER, np.unique(length[strained & (pressure == level)]).size)
        for level in np.unique(pressure[strained])
    }


def fit_hocking_wereley(train: ForceData) -> Predictor:
    """The force of a polynomial bladder whose coefficients were fitted at each pressure by itself.

    The geometry is not fitted: the braid lies at the bore, or mid-wall where it is embedded, at
    the nominal angle. Where a pressure has fewer strained lengths than coefficients, the lower
    orders are taken. Between pressures the coefficients are interpolated, outside them the nearest
    ones are kept.

    Args:
        train: the force map.

    Returns:
        The force [N] of length [m] and pressure [Pa].

    Raises:
        InputError: the specimen has no nominal diameter, or no reading a strained bladder.

    References:
        Hocking & Wereley 2012; see `famjax.peers.hocking_wereley`.
    """
    specimen = train.specimen
    if specimen.nominal_diameter is None:
        raise InputError(
            "Hocking and Wereley's fit takes the geometry as known: give the specimen's "
            "nominal_diameter (--specimen nominal_diameter_mm=...)"
        )
    orders = hocking_orders(train)
    if not orders:
        raise InputError(
            "Hocking and Wereley's coefficients need loaded readings away from the rest length, "
            f"{specimen.rest_length * 1e3:.5g} mm: there are none"
        )
    diameter = specimen.nominal_diameter + (specimen.wall_thickness if specimen.embedded else 0.0)
    geometry = EstimatedSource(specimen).geometry(
        {"braid_diameter": diameter, "braid_angle": _ANGLE}
    )
    law = peers.hocking_wereley(geometry, np.array([0.0, 2.0]), np.ones((2, _ORDER)))
    names = [f"E_{n + 1}" for n in range(_ORDER)]
    declared = tuple(Declared("Pa", name, linear=True) for name in names)
    family = as_arrays(ModelFamily(law, declared, _at_both_nodes))

    def parts(length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Braid force per pressure [m2], and bladder force [N] of each E_n = 1 Pa."""
        lengths, where = np.unique(length, return_inverse=True)
        none, nothing = np.zeros(lengths.size), np.zeros(1)
        at = MapInputs(lengths, none + 1, none, nothing, nothing, np.zeros((1, 0)))
        found = quick_jit(linear_response)(family, "none", at, np.zeros(0), np.zeros(_ORDER), none)
        return np.asarray(found.force)[where], np.asarray(found.columns)[where]

    loaded = train.part(train.loaded)
    area, columns = parts(loaded.length)
    coefficients = np.zeros((len(orders), _ORDER))
    for row, (level, order) in enumerate(orders.items()):
        at = train.pressures.level[train.loaded] == level
        bladder = loaded.force[at] - level * area[at]
        coefficients[row, :order] = np.linalg.lstsq(columns[at, :order], bladder, rcond=None)[0]

    def force(length: np.ndarray, pressure: np.ndarray) -> Float[np.ndarray, " n"]:
        area, columns = parts(length)
        at = np.stack([np.interp(pressure, list(orders), E_n) for E_n in coefficients.T], axis=-1)
        return pressure * area + np.sum(columns * at, axis=-1)

    return force


def _at_both_nodes(model: Any, values: dict[str, Any]) -> dict[str, Any]:
    del model
    return {f"{name}_at_node_{k}": value for name, value in values.items() for k in (1, 2)}


@dataclasses.dataclass(frozen=True)
class ComparisonRow:
    """One model in the table. Errors are of loaded readings [N]; nan where there is none.

    Attributes:
        name: of the model.
        label: authors and variant.
        n_parameters: fitted to the map; 0 for published constants.
        rmse, mae, max_error: in sample.
        lopo_rmse: with each pressure in turn left out and predicted.
        lolo_interior_rmse: with each length left out, the shortest and the longest not counted.
        lolo_rmse: with each length left out, all counted.
        at_bound: parameters that ended on a bound.
        note: what else to know.
    """

    name: str
    label: str
    n_parameters: int
    rmse: float = math.nan
    mae: float = math.nan
    max_error: float = math.nan
    lopo_rmse: float = math.nan
    lolo_interior_rmse: float = math.nan
    lolo_rmse: float = math.nan
    at_bound: tuple[str, ...] = ()
    note: str = ""

    def as_dict(self) -> dict[str, Any]:
        """The row for JSON: no nan, lists for tuples."""
        row = dataclasses.asdict(self)
        errors = {key for key, value in row.items() if isinstance(value, float)}
        return {
            f"{key}_N" if key in errors else key: finite_or_none(value) if key in errors else value
            for key, value in {**row, "at_bound": list(self.at_bound)}.items()
        }

    def noted(self, note: str) -> "ComparisonRow":
        """The row with one more note."""
        return dataclasses.replace(self, note="; ".join(filter(None, (self.note, note))))

    def with_errors(
        self, error: Float[np.ndarray, " points"], left_out: Mapping[str, LeftOut]
    ) -> "ComparisonRow":
        """The row with its errors [N]: in sample at the loaded readings, and on what was left out."""
        size, length = np.abs(error), left_out.get("length")
        return dataclasses.replace(
            self,
            rmse=float(np.sqrt(np.mean(size**2))),
            mae=float(size.mean()),
            max_error=float(size.max()),
            lopo_rmse=left_out["pressure"].rmse if "pressure" in left_out else math.nan,
            lolo_interior_rmse=length.interior_rmse if length else math.nan,
            lolo_rmse=length.rmse if length else math.nan,
        )


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
        return f"Comparison({self.data.specimen.name}: {len(self.rows)} models)"

    def to_pandas(self) -> "pandas.DataFrame":
        """A row for each model, the unit in each column's name; lists are left out.

        Raises:
            InputError: pandas is not installed.
        """
        return data_frame(
            {key: value for key, value in row.items() if not isinstance(value, list | dict)}
            for row in self.as_dict()["models"]
        )

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
            `famjax.boundary.tasks.AnyExecutor`.
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
    for name in chosen:
        if name not in known:
            raise InputError(f"unknown model {name!r}; known for this map are {', '.join(known)}")
    for groups in KINDS:
        check_groups(data, groups)
    tasks = [*chosen, *(_own_model(one, data) for one in own)]
    names = [one if isinstance(one, str) else one.label if isinstance(one, ModelFamily) else one[0]
             for one in tasks]  # fmt: skip
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

    row = functools.partial(_row, data, starts, seed)
    run_fits(row, tasks, executor=executor, store=store, progress=tell, names=names)
    rows = [ComparisonRow(**{**part, "at_bound": tuple(part["at_bound"])}) for part in store]
    return Comparison(data, tuple(sorted(rows, key=_place)))


def comparable_models(data: ForceData) -> tuple[str, ...]:
    """The names of all models that can be compared on a map, fitted ones first."""
    return (CHOICE, *OWN, *peer_families(data), "hocking_wereley", *_published(data))


def _place(row: ComparisonRow) -> tuple[bool, float, float, int]:
    """In the table: by interior lengths left out, then in sample; equal models by their parameters."""
    error = row.lolo_interior_rmse
    known = not math.isnan(error)
    in_sample = math.inf if math.isnan(row.rmse) else float(f"{row.rmse:.6g}")
    return (not known, float(f"{error:.6g}") if known else 0.0, in_sample, row.n_parameters)


def _own_model(given: OwnModel, data: ForceData) -> ModelFamily | tuple[str, dict[str, Any]]:
    """A model of a user's own as a family, or as a name and options of `identify`.

    Raises:
        InputError: no such class or option, or a class that cannot be fitted alone.
    """
    if isinstance(given, ModelFamily):
        return given
    if isinstance(given, famjax.AbstractMuscle):
        return ModelFamily.of(given)
    if isinstance(given, tuple):
        name, options = given
        unknown = options.keys() - inspect.signature(identify).parameters.keys()
        if unknown:
            raise InputError(f"{name}: identify has no option {', '.join(sorted(unknown))}")
        return name, dict(options)
    kind: Any = given
    if isinstance(given, str):
        kind = class_named(given, famjax.parameters.Parametrised, "model")
    path = given if isinstance(given, str) else class_path(kind)
    if issubclass(kind, famjax.AbstractMuscle):
        fields = {one.name for one in dataclasses.fields(kind)}
        known = {"rest_length": data.specimen.rest_length} if "rest_length" in fields else {}
        try:
            return ModelFamily.of(kind.template(**known), path)
        except ValueError as error:
            raise InputError(f"{path} cannot be fitted by its class alone: {error}") from None
    if issubclass(kind, famjax.materials.AbstractMaterial):
        return path, {"law": kind}
    is_geometry = issubclass(kind, famjax.geometries.AbstractGeometry)
    parts, declared = own_parts([data], *((kind, ()) if is_geometry else (None, (kind,))))
    return path, {**parts, "parameters": taking_part(declared, {})}


def _published(data: ForceData) -> dict[str, ModelFamily]:
    """Models with published or nominal constants for a muscle of this size; nothing is free."""
    bore, rest, name = (
        data.specimen.nominal_diameter, data.specimen.rest_length, data.specimen.name,
    )  # fmt: skip
    if bore is None:
        return {}
    braid = famjax.Braid.from_rest(diameter=bore, braid_angle=_ANGLE, length=rest)
    found: dict[str, tuple[str, Any]] = {
        "gaylord_nominal": ("Gaylord 1958, bore and 28.6 deg", peers.Gaylord(braid))
    }
    for muscle, size in {"10 mm": 10e-3, "20-200": 20e-3, "20-400": 20e-3}.items():
        if math.isclose(bore, size, rel_tol=1e-6):
            found[f"sarosi_published_{muscle.replace(' ', '_')}"] = (
                f"Sarosi 2012, constants of {muscle}",
                peers.Sarosi.published(muscle, rest_length=rest),
            )
    if name in {"DMSP-10-250", "DMSP-20-300"}:
        model = peers.Martens.published(name)
        found["martens_published"] = "Martens & Boblan 2017, their constants", model
    return {key: ModelFamily(model, (), label=label) for key, (label, model) in found.items()}


def _row(
    data: ForceData, starts: int, seed: int, model: str | ModelFamily | tuple[str, dict[str, Any]]
) -> dict[str, Any]:
    """The row of a model, as plain values."""
    if model == CHOICE:
        row = _choice_row(data, starts, seed)
    elif model == "hocking_wereley":
        row = _hocking_row(data)
    elif isinstance(model, str) and model in OWN:
        what, options = OWN[model]
        label = f"famjax, {what}"
        row = identified_row(model, label, options, data, starts, seed)
    elif isinstance(model, tuple):
        name, options = model
        row = identified_row(name, name, options, data, starts, seed)
    elif isinstance(model, str):
        families = {**_published(data), **peer_families(data)}
        row = _peer_row(model, families[model], data, starts, seed)
    else:
        row = _peer_row(model.label, model, data, starts, seed)
    return dataclasses.asdict(row)


def _peer_row(
    name: str, family: ModelFamily, data: ForceData, starts: int, seed: int
) -> ComparisonRow:
    row = ComparisonRow(name, family.label, len(family.declared), note=family.note)
    if not family.declared:
        problem = _posed(family, data)
        at = problem.parts[0].inputs
        force = predict(problem, 0, np.zeros(0), np.zeros(0), at.length, at.pressure)
        error = force - data.force[data.loaded]
        return row.with_errors(error, {kind: _left_out(data, kind, force) for kind in KINDS})
    try:
        fit = fit_peer(family, data, starts=starts, seed=seed)
    except InputError as refused:
        return row.noted(str(refused))
    if not fit.converged:
        row = row.noted("the best descent did not converge")
    if not fit.determined:
        row = row.noted("the readings do not determine all its parameters")
    left_out = {}
    for kind in KINDS:
        left_out[kind], ambiguous = cross_validate_peer(fit, data, kind, seed=seed)
        if ambiguous:
            count = f"{len(ambiguous)} of {left_out[kind].values.size}"
            row = row.noted(f"not determined without a {kind}, for {count} of them")
    row = dataclasses.replace(row, at_bound=fit.at_bound)
    return row.with_errors(fit.predicted - data.force[data.loaded], left_out)


def _hocking_row(data: ForceData) -> ComparisonRow:
    label = "Hocking & Wereley 2012, order 4 per pressure"
    note = "geometry held at the nominal one; lower orders where a pressure has few lengths"
    count = sum(hocking_orders(data).values())
    row, at = ComparisonRow("hocking_wereley", label, count, note=note), data.loaded
    try:
        found = np.asarray(fit_hocking_wereley(data)(data.length[at], data.pressure[at]))
    except InputError as refused:
        return row.noted(str(refused))
    left_out = {}
    for kind in KINDS:
        try:
            left_out[kind] = cross_validate(fit_hocking_wereley, data, kind)
        except InputError as refused:
            row = row.noted(f"without a {kind}: {refused}")
    return row.with_errors(found - data.force[at], left_out)


def _choice_row(data: ForceData, starts: int, seed: int) -> ComparisonRow:
    """What `choose` finds, made anew without each length and each group of pressures that it predicts."""
    row = ComparisonRow(CHOICE, "famjax, its own choice (nested)", 0)
    try:
        choice = choose(data, starts=starts, seed=seed)
    except InputError as refused:
        return row.noted(str(refused))
    left_out: dict[str, Any] = {}
    for kind, most in (("pressure", _PRESSURE_GROUPS), ("length", MOST)):
        try:
            left_out[kind] = validate_choice(choice, kind, most=most, starts=_STARTS, seed=seed)
        except InputError as refused:
            row = row.noted(f"without a {kind}: {refused}")
    result = choice.chosen
    bounds = tuple(one.name for one in result.estimates if one.at_bound)
    row = dataclasses.replace(row, n_parameters=result.n_parameters, at_bound=bounds)
    return row.noted(f"it chose: {choice.name}").with_errors(result.residuals, left_out)


def identified_row(
    name: str, label: str, options: Mapping[str, Any], data: ForceData, starts: int, seed: int
) -> ComparisonRow:
    """The row of a muscle that `identify` fits; one that it refuses has a note and no errors."""
    row = ComparisonRow(name, label, 0)
    try:
        result = identify(data, starts=starts, seed=seed, **options)
    except InputError as refused:
        return row.noted(str(refused))
    bounds = tuple(one.name for one in result.estimates if one.at_bound)
    row = dataclasses.replace(row, n_parameters=result.n_parameters, at_bound=bounds)
    kinds = {}
    for kind in KINDS:
        try:
            check_left_out(result, kind)
        except InputError as refused:
            row = row.noted(f"without a {kind}: {refused}")
        else:
            kinds[kind] = None, _STARTS
    fits = [(result.problem, result.end.u)]
    left_out = leave_out_each(fits, kinds, seed=result.seed + 1, settled=True, least=2)[0]
    row = row.with_errors(result.residuals, left_out)
    if not result.converged:
        row = row.noted("the fit did not converge")
    if not np.isfinite(result.errors.rmse):
        row = row.noted("the model has no force at some readings")
    return row


def plot_comparison(comparison: Comparison) -> "Figure":
    """The figure of a league table, the best model on top, errors on a logarithmic axis.

    Args:
        comparison: what `compare` returned.

    Returns:
        A figure, not shown; save it with `savefig`.
    """
    from matplotlib.figure import Figure  # noqa: PLC0415 -- when something is drawn

    rows = [row for row in comparison.rows if math.isfinite(row.rmse)]
    data, limit, places = comparison.data, comparison.data.max_force, range(len(rows))
    figure = Figure(figsize=(9.0, 1.6 + 0.27 * len(rows)), layout="constrained")
    axes = figure.subplots()
    for key, label, marker in (
        ("rmse", "all readings fitted", "o"),
        ("lopo_rmse", "each pressure left out", "d"),
        ("lolo_interior_rmse", "each inner length left out", "s"),
        ("lolo_rmse", "each length left out", "|"),
    ):
        axes.plot([min(getattr(row, key), limit) for row in rows], places, marker, label=label)
    axes.axvline(limit, color="0.8", lw=0.8, ls="--")
    axes.grid(axis="y", color="0.93")
    axes.set(
        xscale="log",
        xlabel="root mean square error, N (dashed: the largest force, and beyond)",
        ylim=(len(rows) - 0.5, -0.5),
    )
    named = [f"{row.label} [{row.n_parameters}]{' *' if row.at_bound else ''}" for row in rows]
    axes.set_yticks(list(places), named, fontsize=8)
    figure.legend(frameon=False, fontsize=8, ncols=4, loc="outside lower center")
    axes.set_title(
        f"{data.specimen.name}: {int(data.loaded.sum())} loaded readings, up to "
        f"{limit:.4g} N\n[parameters], * at a bound",
        fontsize=10,
    )
    return figure

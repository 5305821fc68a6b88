"""The sweep: all permutations of order, pressure dependence and constraint at fixed geometry."""

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import jax
import numpy as np

import famjax
from famjax.boundary.errors import InputError, check_seed
from famjax.boundary.tasks import AnyExecutor, Store, run_tasks

from ..arguments import check_numbers, check_whole, shown
from ..convex import Status
from ..data import ForceData, several_maps
from ..posing import fingerprint
from .design import Design
from .fits import solve
from .forms import CONSTRAINTS, DEPENDENCES, OBJECTIVES, Forms, n_coefficients, named
from .linear_model import LinearModel
from .readings import Readings, arrange
from .result import Sweep, SweepRow
from .scores import score

FEASIBLE = 1e-9
"""Violation of a constraint per largest coefficient that counts as rounding."""

_CHUNK = 250  # replicates
_Part: TypeAlias = tuple[int, int]


def sweep(
    data: ForceData | Sequence[ForceData],
    geometry: famjax.geometries.AbstractGeometry | Sequence[famjax.geometries.AbstractGeometry],
    *,
    deadband: float | Sequence[float] = 0.0,
    terms: famjax.terms.AbstractForceTerm | None = None,
    orders: Sequence[int] = (1, 2, 3, 4),
    dependences: Sequence[str] = DEPENDENCES,
    constraints: Sequence[str] = CONSTRAINTS,
    objective: str = "sum_of_squares",
    bootstrap: int = 0,
    seed: int = 0,
    executor: AnyExecutor = None,
    resume: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> Sweep:
    """All permutations of the law at fixed geometry, each a certified global optimum.

    The force is linear in the coefficients, so that every one of these fits is convex. Constraints
    hold between the readings as well.

    Args:
        data: one force map, or several.
        geometry: of all of them, or one for each; nothing of it is identified.
        deadband: P_d [Pa], of all or one for each.
        terms: force terms besides braid and bladder, the same for all maps; nothing of them is
            identified.
        orders: of the law, 1 to 4.
        dependences: of the coefficients on pressure, among "fixed", "linear" and "free".
        constraints: among "none", "positive", "slope" and "drucker".
        objective: "sum_of_squares", "mean_rmse" (over pressures, as the reference work) or "huber".
        bootstrap: number of replicates, readings drawn anew at each pressure, for the standard
            deviations of the coefficients; with "sum_of_squares" only.
        seed: of the replicates; the same seed gives the same numbers, whatever does them.
        executor: what does the replicates, in chunks: this process, processes or a cluster, see
            `famjax.boundary.tasks.AnyExecutor`.
        resume: JSONL file to which each finished part is written, created if missing; a sweep that was
            stopped goes on from there.
        progress: called with (parts done, parts).

    Returns:
        The fits.

    Raises:
        InputError: the data or options cannot be used, the folder is that of another sweep, or the
            executor is gone.
        RuntimeError: float64 is off.

    References:
        Chambers 2021, sections 7.1 to 7.3.
    """
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "a sweep needs float64, and JAX computes in float32 by default. Put this line before "
            'any other use of JAX: jax.config.update("jax_enable_x64", True)'
        )
    maps = (data,) if isinstance(data, ForceData) else several_maps(data)
    geometries = _one_each(geometry, famjax.geometries.AbstractGeometry, len(maps), "geometry")
    if not maps:
        raise InputError("a sweep needs a force map, got none")
    dead = check_numbers("deadband", deadband)
    if not ((dead >= 0) & np.isfinite(dead)).all():
        raise InputError(f"the deadband is a gauge pressure [Pa], zero or above; got {deadband}")
    deadbands = _one_each(float(dead) if dead.ndim == 0 else dead, float, len(maps), "deadband")
    forms = Forms.of(orders, dependences, constraints)
    check_options(objective, bootstrap, seed)
    further = None if terms is None else famjax.terms.SumOfTerms((terms,))
    tasks = [
        _Task(one, shape, float(dead), further, forms, objective)
        for one, shape, dead in zip(maps, geometries, deadbands, strict=True)
    ]
    settings = {
        "version": famjax.__version__,
        "data": [one.sha256 for one in maps],
        "names": [one.specimen.name for one in maps],
        "tolerances": [[one.pressure_tolerance, one.length_tolerance] for one in maps],
        "geometry": [fingerprint(shape) for shape in geometries],
        "deadband_Pa": [float(dead) for dead in deadbands],
        "terms": None if further is None else fingerprint(further),
        "orders": list(forms.orders),
        "dependences": list(forms.dependences),
        "constraints": list(forms.constraints),
        "objective": objective,
        "bootstrap": bootstrap,
        "seed": seed,
    }
    parts = [(k, part) for k in range(len(maps)) for part in _parts(bootstrap)]
    store = Store(resume, "sweep", settings, len(parts))
    done = sum(index in store for index in range(len(parts)))
    for index, (k, part) in enumerate(parts):
        if part is None and index not in store:
            if progress is not None:
                progress(done, len(parts))
            store.keep(index, tasks[k].fits())
            done += 1
    if bootstrap:
        from .replicates import Chunks, chunk_sums  # noqa: PLC0415 -- of JAX, which the fits are not

        designs = [task.designed for task in tasks]
        chunks = Chunks(designs, forms, parts, seed, size=_CHUNK)
        run_tasks(chunk_sums, chunks, executor=executor, store=store, progress=progress)
    elif progress is not None:
        progress(len(parts), len(parts))
    each, rows = len(parts) // len(maps), []
    for k, task in enumerate(tasks):
        rows += task.rows(store[index] for index in range(k * each, (k + 1) * each))
    return Sweep(
        rows=tuple(rows),
        pressures=tuple(task.readings.pressure for task in tasks),
        data=maps,
        geometries=geometries,
        deadbands=tuple(float(dead) for dead in deadbands),
        objective=objective,
        replicates=bootstrap,
        seed=seed,
        models=tuple(task.model for task in tasks),
    )


@dataclasses.dataclass(frozen=True)
class _Given:
    """What a linear problem is made of.

    Attributes:
        key: equal where all of it is; deadband [Pa] and highest order at its end.
        geometry: of the muscle.
        further: force terms besides braid and bladder, or None.
        readings: of the force map.
    """

    key: tuple[Any, ...]
    geometry: famjax.geometries.AbstractGeometry = dataclasses.field(compare=False)
    further: famjax.terms.SumOfTerms | None = dataclasses.field(compare=False)
    readings: Readings = dataclasses.field(compare=False)


@functools.lru_cache(maxsize=2)
def _linear(given: _Given) -> tuple[LinearModel, Callable[[], Design]]:
    """The model and the design of some readings, which several sweeps of them share."""
    (*_, deadband, order), readings = given.key, given.readings
    model = LinearModel(
        given.geometry, deadband, order, readings.pressure, readings.path_end, given.further
    )
    return model, functools.cache(lambda: Design.of(model, readings))


class _Task:
    """One force map of a sweep."""

    def __init__(
        self,
        data: ForceData,
        geometry: famjax.geometries.AbstractGeometry,
        deadband: float,
        further: famjax.terms.SumOfTerms | None,
        forms: Forms,
        objective: str,
    ) -> None:
        self.data, self.forms, self._objective = data, forms, objective
        highest = forms.orders[-1]
        self.readings = arrange(data, float(geometry.rest_length), highest)
        key = (
            jax.tree.structure((geometry, further)), fingerprint((geometry, further)),
            fingerprint(vars(self.readings)), deadband, highest,
        )  # fmt: skip
        self.model, self.designed = _linear(_Given(key, geometry, further, self.readings))

    def fits(self) -> dict[str, np.ndarray]:
        """All fits with their scores."""
        design = self.designed()
        fits, square = solve(design, self.forms, self._objective, leave_out=True)
        scores = score(design, self.model, self.readings, fits.coefficients, self.forms)
        return {
            **{f"fits.{name}": np.asarray(leaf) for name, leaf in vars(fits).items()},
            **{f"scores.{name}": np.asarray(leaf) for name, leaf in vars(scores).items()},
            "left_out_N2": np.asarray(square),
        }

    def rows(self, parts: Iterable[dict[str, np.ndarray]]) -> Iterator[SweepRow]:
        """The rows of the finished parts: the fits, then chunks of replicates."""
        of_parts = iter(parts)
        found = next(of_parts)
        fits, scores = (
            {
                name.removeprefix(kind): value
                for name, value in found.items()
                if name.startswith(kind)
            }
            for kind in ("fits.", "scores.")
        )
        left_out_square = found["left_out_N2"]
        spread = _spread(of_parts, fits["coefficients"].shape)
        count = self.readings.there.sum(axis=1)
        for d, dependence in enumerate(self.forms.dependences):
            for o, order in enumerate(self.forms.orders):
                for c, constraint in enumerate(self.forms.constraints):
                    at = (d, o, c)
                    status, margin = Status(int(fits["status"][at])), float(scores["margin"][at])
                    largest = float(np.abs(fits["coefficients"][at]).max())
                    rmse, mae = scores["rmse"][at], scores["mae"][at]
                    blocked = scores["blocked_error"][at]
                    free = scores["free_contraction_error"][at]
                    beyond = left_out_square[at].sum() / count.sum()
                    stable = "stable" if margin >= -FEASIBLE * largest else "not stable"
                    yield SweepRow(
                        data=self.data.specimen.name,
                        dependence=dependence,
                        order=order,
                        constraint=constraint,
                        n_coefficients=n_coefficients(dependence, order, count.size),
                        coefficients=fits["coefficients"][at][:, :order],
                        coefficients_std=spread[at][:, :order],
                        objective=float(fits["objective"][at]),
                        rmse=float(rmse.mean()),
                        mae=float(mae.mean()),
                        pooled_rmse=float(np.sqrt(count @ rmse**2 / count.sum())),
                        rmse_by_pressure=rmse,
                        mae_by_pressure=mae,
                        blocked_error=float(np.abs(blocked).mean()),
                        blocked_error_by_pressure=blocked,
                        free_contraction_error=_mean_of_known(np.abs(free)),
                        free_contraction_error_by_pressure=free,
                        aicc=float(scores["aicc"][at]),
                        bic=float(scores["bic"][at]),
                        cross_validated_rmse=float(np.sqrt(beyond)),
                        margin=margin,
                        condition=float(fits["condition"][at]),
                        kkt_residual=float(fits["kkt_residual"][at]),
                        duality_gap=float(fits["duality_gap"][at]),
                        status=status,
                        verdict=stable if status is Status.OPTIMAL else status.message,
                    )


def _mean_of_known(values: np.ndarray) -> float:
    """Mean of what is not nan, nan where all is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _spread(chunks: Iterable[dict[str, np.ndarray]], shape: tuple[int, ...]) -> np.ndarray:
    """Standard deviations over replicates, nan with fewer than two."""
    total, square, count = np.zeros(shape), np.zeros(shape), np.zeros(())
    for chunk in chunks:
        total, square = total + chunk["sum"], square + chunk["square"]
        count = count + chunk["count"]
    enough = count > 1
    count = np.where(enough, count, 2)
    variance = (square - total**2 / count) / (count - 1)
    return np.where(enough, np.sqrt(np.maximum(variance, 0)), np.nan)


def _parts(bootstrap: int) -> list[_Part | None]:
    """The fits, then replicates (first, count) in chunks."""
    firsts = range(0, bootstrap, _CHUNK)
    return [None, *((first, min(_CHUNK, bootstrap - first)) for first in firsts)]


def _one_each(given: Any, kind: Any, count: int, name: str) -> tuple[Any, ...]:
    """One of something for each force map."""
    if isinstance(given, type):
        raise InputError(
            f"the {name} of a sweep is known: give one, with its numbers, got the class {given.__name__}"
        )
    if not isinstance(given, kind) and not isinstance(given, Iterable):
        raise InputError(f"the {name} of a sweep must be a {kind.__name__}, got {shown(given)}")
    each = (given,) * count if isinstance(given, kind) else tuple(given)
    if len(each) != count:
        raise InputError(
            f"give one {name} for all force maps or one for each of {count}; got {len(each)}"
        )
    return each


def check_options(objective: str, bootstrap: int, seed: int) -> None:
    """Raise unless these options of a sweep go together; nothing is read or computed for it.

    Raises:
        InputError: they do not.
    """
    check_seed(seed)
    named("objective", [objective], OBJECTIVES)
    check_whole("bootstrap, the number of replicates,", bootstrap)
    if bootstrap and objective != "sum_of_squares":
        raise InputError(
            f"bootstrap replicates need the objective sum_of_squares, got {objective}: leave "
            "bootstrap out, or take that objective"
        )

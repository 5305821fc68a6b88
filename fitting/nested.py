"""Validation of a choice: made anew without each pressure and each length, which it then predicts."""

import dataclasses
import functools
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int

import famjax
from famjax.boundary.tasks import AnyExecutor, Store

from .choice import Choice, choose
from .data import ForceData, groups_of_levels
from .tasks import run_fits
from .validation import LeftOut, levels_of_groups

_STARTS = 4
MOST = 20
"""Folds at most."""


@dataclasses.dataclass(frozen=True)
class NestedValidation(LeftOut):
    """Errors of a choice on what neither the fits nor the choice had seen.

    One "pressure" or one "length" was left out after another; neighbouring ones together, where there
    are many.

    Attributes:
        inside: whether each reading lies within the 95 % band of its prediction.
        width: full width [N] of that band.
        names: of the family that was chosen without each group.
    """

    inside: Bool[np.ndarray, " points"]
    width: Float[np.ndarray, " points"]
    names: tuple[str, ...]

    @property
    def covered(self) -> float:
        """Part of the readings inside their 95 % bands."""
        return float(np.mean(self.inside))


def validate_choice(
    choice: Choice,
    groups: str = "length",
    *,
    most: int = MOST,
    executor: AnyExecutor = None,
    resume: Path | str | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,
) -> NestedValidation:
    """The errors of a choice on pressures or lengths that neither it nor its fits have seen.

    Every level costs a choice of its own, five seconds of a core for a hundred readings: two
    processes pay for four levels already.

    Args:
        choice: from `choose`.
        groups: "pressure" or "length".
        most: groups; with more levels neighbouring ones are left out together.
        executor: what chooses without the levels, each a task: this process, processes or a cluster,
            see `famjax.boundary.tasks.AnyExecutor`; the numbers are the same.
        resume: JSONL file to which each finished level is written, created if missing; a validation
            that was stopped goes on from there.
        progress: called with (levels done, levels).
        options: as `choose` was given; a fold has four starts at the most.

    Raises:
        InputError: the file of another validation, or the executor is gone.
    """
    options["starts"] = min(options.get("starts", _STARTS), _STARTS)
    data = choice.data
    levels = data.levels(groups)[data.loaded]
    group = groups_of_levels(levels, np.unique(levels), most)
    count = int(group.max()) + 1
    settings = {
        "version": famjax.__version__,
        "data": data.sha256,
        "tolerances": [data.pressure_tolerance, data.length_tolerance],
        "groups": groups,
        "options": {name: repr(value) for name, value in sorted(options.items())},
    }
    store = Store(resume, "validation", settings, count)
    run_fits(
        functools.partial(_fold, data, groups, group, options), range(count), executor=executor,
        store=store, progress=progress,
        names=[f"{groups} {value:.6g}" for value in levels_of_groups(levels, group)],
    )  # fmt: skip
    error, inside, width = np.zeros(levels.size), np.zeros(levels.size, bool), np.zeros(levels.size)
    names = []
    for k, part in enumerate(store):
        mine = group == k
        error[mine], inside[mine], width[mine] = part["error"], part["inside"], part["width"]
        names.append(part["name"])
    return NestedValidation(groups, levels, group, error, inside, width, tuple(names))


def _fold(
    data: ForceData,
    groups: str,
    group: Int[np.ndarray, " points"],
    options: Mapping[str, Any],
    k: int,
) -> dict[str, Any]:
    """The choice without one group of the loaded readings, and its errors on them."""
    mine, levels = group == k, data.levels(groups)
    rest = choose(data.part(~np.isin(levels, levels[data.loaded][mine])), **options)
    at = data.length[data.loaded][mine], data.pressure[data.loaded][mine]
    error = rest.predict(*at) - data.force[data.loaded][mine]
    half = rest.half_band(*at)
    return {
        "name": rest.name, "error": error, "inside": np.abs(error) <= half, "width": 2 * half,
    }  # fmt: skip

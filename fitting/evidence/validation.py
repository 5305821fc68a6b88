"""Validation of an identification on readings it has not seen: one pressure, length or muscle out."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor

from ..engine.problem import Problem
from ..search.multi_start import latin_hypercube
from ..search.result import Identification
from ..trace import run_fits
from .refit import Refit, refit

GROUPS = ("pressure", "length", "specimen")
_CHUNK = 16  # groups


@dataclasses.dataclass(frozen=True)
class Validation:
    """Errors on what was left out.

    Attributes:
        groups: what was left out together: one "pressure", one "length" or one "specimen".
        values: the pressures [Pa] or lengths [m] left out one after another, or specimen numbers.
        group_rmse: root mean square error [N] on each while it was left out.
        rmse: over all readings, each predicted while it was left out [N].
        interior_rmse: the same over all groups but the lowest and the highest, which are
            extrapolations [N]; nan with fewer than three groups.
        refits: the refits, one for each group; `converged` says of each whether it did.
    """

    groups: str
    values: Float[np.ndarray, " groups"]
    group_rmse: Float[np.ndarray, " groups"]
    rmse: float
    interior_rmse: float
    refits: Refit


def validate(
    result: Identification,
    groups: str = "pressure",
    *,
    starts: int = 4,
    executor: AnyExecutor = None,
    progress: Callable[[int, int], None] | None = None,
) -> Validation:
    """The errors of an identification on pressures, lengths or muscles that it has not seen.

    Everything that was identified is identified again without the group, from the optimum and
    from other starts, and predicts it. All refits run at once.

    Args:
        result: from `identify`, or one of `identify_together` for all of these.
        groups: what is left out together.
        starts: descents for each group, one of them from the optimum of all readings.
        executor: what does the groups, sixteen in a task: this process, processes or a cluster, see
            `famjax.boundary.tasks.AnyExecutor`; the results are the same. What is one task only, or
            cannot be sent to another process, is done in this one.
        progress: called with (refits done, refits).

    Returns:
        The errors.

    Raises:
        InputError: fewer than two groups, an unknown kind of group, free coefficients that cannot
            predict a pressure, or the executor is gone.
    """
    problem = result.problem
    if groups not in GROUPS:
        raise InputError(f"groups are one of {', '.join(GROUPS)}, got {groups!r}")
    if groups == "pressure" and result.dependence == "free":
        raise InputError("coefficients free in pressure say nothing of a pressure that is left out")
    if starts < 1:
        raise InputError(f"at least one start is needed for each group, got {starts}")
    if groups == "specimen":
        check_nothing_own(result)
    label = problem.levels(groups)
    values = np.unique(label[problem.side == 0])
    if values.size < 2:
        raise InputError(f"leaving one {groups} out needs two or more; there is {values.size}")
    out = label == values[:, None]
    cube = latin_hypercube(len(problem.free), starts, result.seed + 1)
    cube[0] = result.end.u
    chunks = [out[first : first + _CHUNK] for first in range(0, len(out), _CHUNK)]
    parts = list(
        run_fits(
            functools.partial(_without, problem, cube), chunks,
            executor=executor if len(chunks) > 1 else None,
            progress=progress and (lambda n, _: progress(min(n * _CHUNK, len(out)), len(out))),
        )
    )  # fmt: skip
    found = Refit(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    out = out & (problem.side == 0)
    square = np.where(out, found.residual, 0.0) ** 2
    group_rmse = np.sqrt(square.sum(axis=1) / out.sum(axis=1))
    inner = slice(1, -1)
    return Validation(
        groups=groups,
        values=values,
        group_rmse=group_rmse,
        rmse=float(np.sqrt(square.sum() / out.sum())),
        interior_rmse=(
            float(np.sqrt(square[inner].sum() / out[inner].sum())) if values.size > 2 else np.nan
        ),
        refits=found,
    )


def _without(
    problem: Problem, cube: Float[np.ndarray, "starts p"], out: Bool[np.ndarray, "groups points"]
) -> dict[str, Any]:
    """The refits without some groups of readings, from some points of the unit box."""
    found = refit([problem.with_readings(factor=1.0 * ~one) for one in out], [cube] * len(out))
    return vars(found)


def check_nothing_own(result: Identification) -> None:
    """A muscle that is left out must be known from the others alone.

    Raises:
        InputError: parameters or coefficients are its own.
    """
    problem = result.problem
    own = [problem.names[k] for k in problem.free if "[" in problem.names[k]]
    if own or len(problem.linear) > result.order:
        raise InputError(
            f"{own[0] if own else 'the law'} is a specimen's own, so nothing is known of it without "
            "its readings: identify the specimens with own=() and own_law=False"
        )

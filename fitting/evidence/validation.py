"""Validation of an identification on readings it has not seen: one pressure, length or muscle out."""

import dataclasses
import functools
from collections.abc import Callable
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor

from ..arguments import check_whole
from ..problem import Problem
from ..result import Identification, check_identified
from ..search import latin_hypercube
from ..tasks import run_fits
from .leave_out import group_of_each
from .left_out import LeftOut
from .refit import Refit, refit

GROUPS = ("pressure", "length", "specimen")
_CHUNK = 16  # groups


@dataclasses.dataclass(frozen=True)
class Validation(LeftOut):
    """Errors on one "pressure", one "length" or one "specimen" after another while it was left out.

    Attributes:
        refits: the refits, one for each group; `converged` says of each whether it did.
    """

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
    check_identified(result)
    check_whole("starts", starts, 1)
    problem, group = result.problem, singles(result, groups)
    cube = latin_hypercube(len(problem.free), starts, result.seed + 1)
    cube[0] = result.end.u
    count = int(group.max()) + 1
    chunks = [range(first, min(first + _CHUNK, count)) for first in range(0, count, _CHUNK)]
    parts = list(
        run_fits(
            functools.partial(_without, problem, cube, group), chunks,
            executor=executor if len(chunks) > 1 else None,
            progress=progress and (lambda n, _: progress(min(n * _CHUNK, count), count)),
        )
    )  # fmt: skip
    found = Refit(**{name: np.concatenate([part[name] for part in parts]) for name in parts[0]})
    at = np.flatnonzero(problem.side == 0)
    return Validation(
        groups, problem.levels(groups)[at], group[at], found.residual[group[at], at], found
    )


def singles(result: Identification, groups: str) -> Int[np.ndarray, " points"]:
    """The group of every reading where each level is left out by itself, see `group_of_each`.

    Raises:
        InputError: as from `validate`.
    """
    if groups not in GROUPS:
        raise InputError(f"groups are one of {', '.join(GROUPS)}, got {groups!r}")
    if groups == "pressure" and result.dependence == "free":
        raise InputError("coefficients free in pressure say nothing of a pressure that is left out")
    if groups == "specimen":
        check_nothing_own(result)
    group = group_of_each(result.problem, groups, least=2)
    if group is None:
        raise InputError(f"leaving one {groups} out needs two or more; there is 1")
    return group


def _without(
    problem: Problem,
    cube: Float[np.ndarray, "starts p"],
    group: Int[np.ndarray, " points"],
    numbers: range,
) -> dict[str, Any]:
    """The refits without some groups of readings, from some points of the unit box."""
    without = [problem.with_readings(factor=1.0 * (group != k)) for k in numbers]
    return vars(refit(without, [cube] * len(without)))


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

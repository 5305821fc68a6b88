"""The same identification again with other readings or bounds: what validation and uncertainty need."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from ..descent import ROUNDED, End, descend_many
from ..problem import Problem


@dataclasses.dataclass(frozen=True)
class Refit:
    """Where refits ended; leading axis of refits.

    Attributes:
        parameters: nonlinear parameters [SI], shape (refits, q).
        x: coefficients [Pa], shape (refits, n).
        cost: half the weighted sum of squares, priors included, shape (refits,).
        residual: model minus reading [N] at every reading, those left out too, (refits, points).
        steps: steps taken.
        converged: the end is stationary.
    """

    parameters: Float[np.ndarray, "refits q"]
    x: Float[np.ndarray, "refits n"]
    cost: Float[np.ndarray, " refits"]
    residual: Float[np.ndarray, "refits points"]
    steps: Int[np.ndarray, " refits"]
    converged: Bool[np.ndarray, " refits"]


def refit(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    *,
    max_steps: int = 200,
    tolerance: float = 1e-10,
    promise: float = ROUNDED,
) -> Refit:
    """The refits of problems that have the same parameters; arguments as of `best_ends`."""
    ends = best_ends(problems, starts, max_steps=max_steps, tolerance=tolerance, promise=promise)
    return Refit(
        parameters=np.stack([end.point.parameters for end in ends]),
        x=np.stack([end.point.x for end in ends]),
        cost=np.array([end.cost for end in ends]),
        residual=np.stack(
            [force_error(problem, end) for problem, end in zip(problems, ends, strict=True)]
        ),
        steps=np.array([end.steps for end in ends]),
        converged=np.array([end.converged for end in ends]),
    )


def best_ends(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    *,
    max_steps: int = 200,
    tolerance: float = 1e-10,
    promise: float = ROUNDED,
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """The best ends of descents, one for each problem.

    Args:
        problems: with other readings, weights or bounds.
        starts: of each, points of the unit box of its own free parameters.
        max_steps: of each descent, see `descend_many`; what is only compared need not be an optimum
            to the last digit.
        tolerance: likewise.
        promise: likewise.
        progress: called with (descents done, descents).
    """
    which = np.repeat(np.arange(len(problems)), [len(points) for points in starts])
    counter = itertools.count(1)

    def ended(_: int) -> None:
        if progress is not None:
            progress(next(counter), len(which))

    tried = descend_many(
        [problems[k] for k in which.tolist()], [start for points in starts for start in points],
        max_steps=max_steps, tolerance=tolerance, promise=promise, progress=ended,
    )  # fmt: skip
    costs = np.array([end.cost for end in tried])
    costs[~np.isfinite(costs)] = np.inf
    first = np.searchsorted(which, np.arange(len(problems)))
    return [
        tried[int(start) + int(np.argmin(of_one))]
        for start, of_one in zip(first, np.split(costs, first[1:]), strict=True)
    ]


def force_error(problem: Problem, end: End) -> Float[np.ndarray, " points"]:
    """Model minus reading [N] at every reading, whatever its weight."""
    return end.point.force - problem.force

"""Levels left out one after another, and what the refits without them predict of them."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float, Int

from ..data.levels import groups_of_levels
from ..problem import Problem
from ..search import latin_hypercube
from .left_out import LeftOut
from .refit import best_ends, force_error

GROUPS = 8
"""Of neighbouring levels that say much the same of one another: pressures, and many lengths."""
_SINGLE = 10  # lengths at most are left out one by one
_FEWEST = 3  # levels: without one of two, the other tells nothing of it
_QUICK = {"max_steps": 30, "tolerance": 1e-5, "promise": 1e-6}
"""A prediction need not wait for the last digit of the fit that it is made by."""


def leave_out_each(
    fits: Sequence[tuple[Problem, Float[np.ndarray, " _"]]],
    kinds: Mapping[str, tuple[int | None, int]],
    *,
    seed: int = 0,
    settled: bool = False,
    least: int = _FEWEST,
    progress: Callable[[int, int], None] | None = None,
) -> list[dict[str, LeftOut]]:
    """The errors of several fits on each level of some kinds while it was left out, all refits in step.

    Args:
        fits: what was fitted, and its optimum in the unit box, from which every refit starts.
        kinds: "pressure", "length" or "specimen"; in how many groups neighbouring levels are left out
            together, each alone with None (as far as `MOST_APART`), and the descents of each refit, the
            one from the optimum among them.
        seed: of the other starts.
        settled: whether each refit goes on to its last digit, as where families are all but alike.
        least: levels of a kind that say something of one another.
        progress: called with (refits done, refits).

    Returns:
        The errors of each fit by kind, without those of which there are too few levels, or one specimen.
    """
    problems, starts = [], []
    found: list[dict[str, tuple[np.ndarray, int]]] = []
    for problem, u in fits:
        found.append({})
        for kind, (groups, count) in kinds.items():
            group = group_of_each(problem, kind, groups, least)
            if group is None:
                continue
            found[-1][kind] = group, len(problems)
            cube = latin_hypercube(len(problem.free), count, seed)
            cube[0] = u
            for k in range(int(group.max()) + 1):
                problems.append(problem.with_readings(factor=1.0 * (group != k)))
                starts.append(cube)
    if not problems:
        return [{} for _ in fits]
    ends = best_ends(problems, starts, progress=progress, **({} if settled else _QUICK))

    def errors(problem: Problem, kind: str, group: np.ndarray, first: int) -> LeftOut:
        at = np.flatnonzero(problem.side == 0)
        left_out = np.stack(
            [force_error(problems[first + k], ends[first + k]) for k in range(group.max() + 1)]
        )
        of_each = left_out[group[at], at]
        return LeftOut(kind, problem.levels(kind)[at], group[at], of_each)

    return [
        {kind: errors(problem, kind, *place) for kind, place in of_one.items()}
        for (problem, _), of_one in zip(fits, found, strict=True)
    ]


def groups_of(problem: Problem, kind: str) -> int | None:
    """In how many groups a model's error is sought; None for each level by itself."""
    if kind == "length" and np.unique(problem.levels("length")).size <= _SINGLE:
        return None
    return GROUPS


def grouped(
    problem: Problem, kind: str, error: Float[np.ndarray, " points"], *, groups: int | None = None
) -> LeftOut | None:
    """Errors at all readings in the groups in which `leave_out_each` takes them.

    Args:
        problem: what was fitted.
        kind: "pressure", "length" or "specimen".
        error: prediction less reading [N].
        groups: their number, as for `leave_out_each`.

    Returns:
        The errors; None where there are fewer than three levels, or one specimen.
    """
    group, at = group_of_each(problem, kind, groups), problem.side == 0
    return None if group is None else LeftOut(kind, problem.levels(kind)[at], group[at], error[at])


def group_of_each(
    problem: Problem, kind: str, groups: int | None = None, least: int = _FEWEST
) -> Int[np.ndarray, " points"] | None:
    """The group of every reading; -1 of a censored one at a level where none is anything else.

    Args:
        problem: what was fitted.
        kind: "pressure", "length" or "specimen".
        groups: their number, as for `leave_out_each`.
        least: with fewer levels, or with one specimen, there are no groups.
    """
    level = problem.levels(kind)
    values = np.unique(level[problem.side == 0])
    if values.size < (2 if kind == "specimen" else least):
        return None
    return groups_of_levels(level, values, groups)

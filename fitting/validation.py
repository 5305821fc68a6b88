"""Cross-validation: a fit is made again without some readings, and predicts them.

Levels of pressure or length, or specimens, are left out one after another, all refits at once.
"""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError

from .arguments import check_whole
from .data import groups_of_levels
from .problem import Problem
from .result import Identification, check_identified
from .search import End, descend_many, latin_hypercube

GROUPS = ("pressure", "length", "specimen")
"""What can be left out together."""

NEIGHBOURS = 8
"""Groups of neighbouring levels that say much the same of one another: pressures, and many lengths."""
_SINGLE = 10  # lengths at most are left out one by one
_FEWEST = 3  # levels: without one of two, the other tells nothing of it
_QUICK: dict[str, Any] = {"max_steps": 30, "tolerance": 1e-5, "promise": 1e-6}
"""A prediction need not wait for the last digit of the fit that it is made by."""


@dataclasses.dataclass(frozen=True)
class LeftOut:
    """Errors of predictions of readings that the fit had not seen.

    Attributes:
        groups: what was left out together, readings of one "pressure", "length" or "specimen".
        level: of each reading [Pa or m], or the number of its specimen, shape (points,).
        group: number of each reading's group, shape (points,).
        error: prediction less reading [N] while its group was left out, shape (points,).
    """

    groups: str
    level: Float[np.ndarray, " points"]
    group: Int[np.ndarray, " points"]
    error: Float[np.ndarray, " points"]

    @staticmethod
    def of_mean(several: Sequence["LeftOut"], weights: Sequence[float]) -> "LeftOut":
        """Errors of the weighted mean of several predictions of the same."""
        error = np.average([one.error for one in several], axis=0, weights=weights)
        return dataclasses.replace(several[0], error=error)

    @property
    def values(self) -> Float[np.ndarray, " groups"]:
        """What was left out one after another, see `level`; means where a group has several."""
        return levels_of_groups(self.level, self.group)

    @property
    def group_rmse(self) -> Float[np.ndarray, " groups"]:
        """Root mean square error [N] of each group while it was left out."""
        return np.sqrt(np.bincount(self.group, self.error**2) / np.bincount(self.group))

    @property
    def rmse(self) -> float:
        """Over all readings [N]."""
        return _root_mean_square(self.error)

    @property
    def interior_rmse(self) -> float:
        """Over all groups but the lowest and the highest [N], which are extrapolations; nan if none."""
        return _root_mean_square(self.error[(self.group > 0) & (self.group < self.group.max())])


def columns_of(left_out: Mapping[str, LeftOut]) -> dict[str, float]:
    """RMSE [N] on pressures, interior lengths, end lengths or specimens left out; groups weigh alike.

    The shortest and the longest length, left out, are extrapolated to.
    """
    found = {}
    for kind, one in left_out.items():
        groups = one.group_rmse
        if kind == "length":
            found["interior length"] = _root_mean_square(groups[1:-1])
            found["end length"] = _root_mean_square(groups[[0, -1]])
        else:
            found[kind] = _root_mean_square(groups)
    return {name: error for name, error in found.items() if np.isfinite(error)}


def _root_mean_square(values: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else np.nan


def levels_of_groups(
    level: Float[np.ndarray, " points"], group: Int[np.ndarray, " points"]
) -> Float[np.ndarray, " groups"]:
    """The level of each group; the mean over its readings where it has several."""
    first = level[np.unique(group, return_index=True)[1]]
    return first + np.bincount(group, level - first[group]) / np.bincount(group)


def validate(
    result: Identification,
    groups: str = "pressure",
    *,
    starts: int = 4,
    progress: Callable[[int, int], None] | None = None,
) -> LeftOut:
    """The errors of an identification on pressures, lengths or muscles that it has not seen.

    Everything that was identified is identified again without the group, from the optimum and
    from other starts, and predicts it. All refits run at once.

    Args:
        result: from `identify`, or one of `identify_together` for all of these.
        groups: what is left out together.
        starts: descents for each group, one of them from the optimum of all readings.
        progress: called with (descents done, descents).

    Raises:
        InputError: fewer than two groups, or an unknown kind of group.
    """
    check_identified(result)
    check_whole("starts", starts, 1)
    check_groups(result, groups)
    fits = [(result.problem, result.end.u)]
    seed, kinds = result.seed + 1, {groups: (None, starts)}
    return leave_out_each(fits, kinds, seed=seed, settled=True, least=2, progress=progress)[0][
        groups
    ]


def check_groups(result: Identification, groups: str) -> None:
    """Refuse groups of which each alone cannot be left out, and predicted from the others.

    Raises:
        InputError: as from `validate`.
    """
    if groups not in GROUPS:
        raise InputError(f"groups are one of {', '.join(GROUPS)}, got {groups!r}")
    if groups == "specimen":
        check_nothing_own(result)
    if _group_of_each(result.problem, groups, None, 2) is None:
        raise InputError(f"leaving one {groups} out needs two or more; there is 1")


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
        progress: called with (descents done, descents).

    Returns:
        The errors of each fit by kind, without those of which there are too few levels, or one specimen.
    """
    problems, starts = [], []
    places: list[tuple[int, str, np.ndarray, int]] = []
    for number, (problem, u) in enumerate(fits):
        for kind, (groups, count) in kinds.items():
            group = _group_of_each(problem, kind, groups, least)
            if group is None:
                continue
            places.append((number, kind, group, len(problems)))
            cube = latin_hypercube(len(problem.free), count, seed)
            cube[0] = u
            for k in range(int(group.max()) + 1):
                problems.append(problem.with_readings(factor=1.0 * (group != k)))
                starts.append(cube)
    found: list[dict[str, LeftOut]] = [{} for _ in fits]
    ends = best_ends(problems, starts, progress=progress, **({} if settled else _QUICK))
    for number, kind, group, first in places:
        problem, groups = fits[number][0], int(group.max()) + 1
        error = np.stack([force_error(problem, end) for end in ends[first : first + groups]])
        at = np.flatnonzero(problem.side == 0)
        found[number][kind] = LeftOut(
            kind, problem.levels(kind)[at], group[at], error[group[at], at]
        )
    return found


def groups_of(problem: Problem, kind: str) -> int | None:
    """In how many groups a model's error is sought; None for each level by itself."""
    if kind == "length" and np.unique(problem.levels("length")).size <= _SINGLE:
        return None
    return NEIGHBOURS


def _group_of_each(
    problem: Problem, kind: str, groups: int | None, least: int
) -> Int[np.ndarray, " points"] | None:
    """The group of every reading; -1 of a censored one at a level where none is anything else.

    With fewer levels than the least, or with one specimen, there are no groups.
    """
    level = problem.levels(kind)
    values = np.unique(level[problem.side == 0])
    if values.size < (2 if kind == "specimen" else least):
        return None
    return groups_of_levels(level, values, groups)


def best_ends(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    *,
    progress: Callable[[int, int], None] | None = None,
    **settings: Any,
) -> list[End]:
    """The best ends of descents, one for each problem.

    Args:
        problems: with other readings, weights or bounds.
        starts: of each, points of the unit box of its own free parameters.
        progress: called with (descents done, descents).
        **settings: of each descent, see `descend_many`; what is only compared need not be an optimum
            to the last digit.
    """
    which = np.repeat(np.arange(len(problems)), [len(points) for points in starts])
    tried = descend_many(
        [problems[k] for k in which.tolist()], [start for points in starts for start in points],
        progress=progress, **settings,
    )  # fmt: skip
    costs = np.array([end.cost if np.isfinite(end.cost) else np.inf for end in tried])
    return [
        tried[int(of_one[np.argmin(costs[of_one])])]
        for of_one in (np.flatnonzero(which == k) for k in range(len(problems)))
    ]


def force_error(problem: Problem, end: End) -> Float[np.ndarray, " points"]:
    """Model minus reading [N] at every reading, whatever its weight."""
    return end.point.force - problem.force

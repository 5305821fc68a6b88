"""The outer search: descents from many starts, and constraints made exact between the stations."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError, check_seed

from ..engine.descent import End, descend, descend_many
from ..engine.margin import constraint_margin
from ..engine.problem import Problem

FEASIBLE = 1e-9
"""Violation of a constraint that counts as rounding, in parts of the largest coefficient."""
NEAR = 1e-9
"""Part of the cost that a step promises at the end of a descent that is only compared with others."""


def latin_hypercube(n_free: int, count: int, seed: int) -> Float[np.ndarray, "k p"]:
    """Latin hypercube in the unit box, away from its faces."""
    rng = np.random.default_rng(check_seed(seed))
    cells = rng.permuted(np.tile(np.arange(count), (n_free, 1)), axis=1).T
    return (cells + rng.uniform(0.05, 0.95, (count, n_free))) / count


def descend_all(
    problem: Problem,
    starts: Float[np.ndarray, "k p"],
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """The ends of the descents from all starts; the best of them goes on to its last digit."""
    counter = itertools.count(1)

    def ended(_: int) -> None:
        if progress is not None:
            progress(next(counter), len(starts))

    ends = descend_many([problem] * len(starts), list(starts), promise=NEAR, progress=ended)
    best = _lowest(ends)
    if best is not None:
        ends[best] = descend(problem, ends[best].u)
    return ends


def best_of(ends: Sequence[End]) -> End:
    """The end of the lowest cost; one whose cost is nan never is.

    Raises:
        InputError: none has a cost.
    """
    best = _lowest(ends)
    if best is None:
        raise InputError(
            "no start ended at a force for every reading: somewhere in the box the bladder does "
            "not fit in the braid or a length cannot be reached; narrow the bounds"
        )
    return ends[best]


def _lowest(ends: Sequence[End]) -> int | None:
    """Place of the lowest cost; None where none is finite."""
    costs = np.array([end.cost for end in ends])
    return int(np.nanargmin(costs)) if np.isfinite(costs).any() else None


def refine(problem: Problem, best: End, spare: int) -> tuple[End, Problem]:
    """The best of the descents, with the constraint made to hold between the stations.

    Where the law is found to violate it, that point becomes a station and the descent goes on.

    Args:
        problem: of the descents.
        best: their best end.
        spare: number of stations at the end of each path that are free to be placed.

    Returns:
        The end of the last descent with everything known of its fit, and the problem with the
        stations placed.
    """
    kind = problem.constraint
    for exchange in range(spare):
        if kind not in ("drucker", "slope"):
            break
        found = constraint_margin(problem, best.point, kind)
        lowest = min(float(one.value.min()) for one in found)
        if lowest >= -FEASIBLE * np.abs(best.point.x).max():
            break
        parts = []
        for part, one in zip(problem.parts, found, strict=True):
            stations = part.inputs.stations.copy()
            stations[:, exchange - spare] = one.position
            parts.append(part.with_stations(stations))
        problem = dataclasses.replace(problem, parts=tuple(parts))
        best = descend(problem, best.u)
    return dataclasses.replace(best, point=problem.solve(best.point.parameters)), problem

"""The best of a front, improved between the points of the grid."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from ..._compiled import compiled
from ..._types import RealArray
from ...materials.abstract_material import AbstractMaterial
from .chunk import Columns, evaluate_at
from .front import Floats, costs_of
from .grid import AXES
from .limits import BALANCED, CONSTRAINTS, OBJECTIVES
from .performance import Numbers, free_contraction, performance

_BACK = 1 - np.concatenate([[0.0], 10.0 ** np.arange(-15, 0), [1.0]])
"""Shares of the way from the start to what the solver found: the longest that keeps to everything."""

_REST = 1e-3  # of the other objectives, where one is the goal
_STEPS = 60
_TOLERANCE = 1e-10  # of the goal, in shares of it


@dataclasses.dataclass(frozen=True)
class Refinement:
    """The best of a front for one goal, and what became of it between the points of the grid.

    Attributes:
        goal: the objective that was improved; "balanced" is all of them at once.
        start: the best of the front for that goal: pair and numbers by name, those of the columns.
        end: the same refined, at rest length, pressure and, where the braid is made to order,
            nominal diameter. It keeps to everything that is asked for. The pair may be another one.
        gain: by how much the goal is better, >= 0: the change of the objective as a share [-] of
            what it was, or of "balanced" the difference of `balance`.
    """

    goal: str
    start: dict[str, Any]
    end: dict[str, Any]
    gain: float


@dataclasses.dataclass(frozen=True)
class _Start:
    """Where the solver begins: goal, its weights of the costs, pair, varied numbers in SI."""

    goal: int
    weights: NDArray[np.float64]
    pair: int
    at: NDArray[np.float64]


def refine(space: Mapping[str, Any], front: Columns, pairs: int) -> list[Refinement]:
    """The best of a front for each objective and for all at once, improved.

    What is varied on the grid is varied within its range, to make the goal as good as it can be
    while every constraint is kept: sequential quadratic programming with derivatives by autodiff
    (Kraft 1988, of SciPy), from the best candidate of each of the best pairs. A step that would not
    keep to everything is cut until it does.

    Args:
        space: of `search_chunk`.
        front: its columns, in the order of preference.
        pairs: number of pairs that are tried for each goal; 0 refines nothing.

    Returns:
        A refinement for "balanced" and for each objective.

    References:
        Kraft 1988, DFVLR-FB 88-28: sequential least squares programming.
    """
    if not pairs:
        return []
    goals = (BALANCED, *space["objectives"])
    primaries, weights = _goals(costs_of(front, space["objectives"]))
    starts = _starts(space, front, weights, pairs)
    ways = [_way(space, start) for start in starts]
    pair = np.repeat([start.pair for start in starts], len(_BACK))
    columns, margins = evaluate_at(
        space, pair, dict(zip(AXES, np.concatenate(ways).T, strict=True))
    )
    costs = costs_of(columns, space["objectives"])
    kept = np.all(margins >= 0, axis=-1)
    of_goal = np.repeat([start.goal for start in starts], len(_BACK))
    found = []
    for k, goal in enumerate(goals):
        mine = np.flatnonzero(of_goal == k)
        first = mine[len(_BACK) - 1]  # where the first of them starts: the best of the front
        score, primary = costs @ weights[k], costs @ primaries[k]
        # A cost that is equal after rounding may be of a figure that is worse by its last digit.
        allowed = kept[mine] & ((primary[mine] < primary[first]) | (mine == first))
        best = mine[np.argmin(np.where(allowed, score[mine], np.inf))]
        start, end = (
            {name: values[at].item() for name, values in columns.items()} for at in (first, best)
        )
        gain = (
            primary[first] - primary[best] if goal == BALANCED else abs(end[goal] / start[goal] - 1)
        )
        found.append(Refinement(goal, start, end, float(gain)))
    return found


def _goals(costs: Floats) -> tuple[Floats, Floats]:
    """Weights of the costs for each goal, (goals, objectives): its own, and with some of the rest.

    For all at once they make `balance`. An objective of its own takes a little of the others along,
    which decides where it leaves something open.
    """
    span = costs.max(axis=0) - costs.min(axis=0)
    balanced = np.where(span > 0, 1 / np.where(span > 0, span, 1.0), 0.0)
    own = np.vstack([balanced, np.eye(len(span))])
    return own, own + np.vstack([0 * balanced, np.full((len(span),) * 2, _REST)])


def _starts(space: Mapping[str, Any], front: Columns, weights: Floats, pairs: int) -> list[_Start]:
    """For each goal the best of the front, and the best of each of the next best pairs."""
    scores = costs_of(front, space["objectives"]) @ weights.T
    starts = []
    for k, score in enumerate(scores.T):
        order = np.argsort(score, kind="stable")
        _, firsts = np.unique(front["pair"][order], return_index=True)
        starts += [
            _Start(
                k, weights[k], int(front["pair"][at]),
                np.array([front[name][at] for name in AXES], dtype=np.float64),
            )
            for at in order[np.sort(firsts)[:pairs]]
        ]  # fmt: skip
    return starts


def _way(space: Mapping[str, Any], start: _Start) -> Floats:
    """From what the solver found back to the start, (points, 3), in SI; the start itself is last."""
    low, high, _ = (ends[start.pair] for ends in space["grid"])
    free = high > low
    found = start.at.copy()
    if free.any():
        found[free] = _least(space, start, free)
    way = start.at + _BACK[:, None] * (found - start.at)
    way[0], way[-1] = found, start.at
    return way


def _least(space: Mapping[str, Any], start: _Start, free: NDArray[np.bool_]) -> Floats:
    """What the solver makes of the free numbers, in SI, whether or not it keeps to everything."""
    from scipy.optimize import minimize  # noqa: PLC0415 -- 0.2 s, for a refinement alone

    at, pair, weights = start.at, start.pair, start.weights
    low, high = (ends[pair][free] for ends in space["grid"][:2])
    known = {name: jnp.asarray(values[pair]) for name, values in space["pairs"].items()}
    demand = {name: jnp.asarray(value) for name, value in space["demand"].items()}
    wanted = [list(OBJECTIVES).index(name) for name in space["objectives"]]
    memory: dict[bytes, tuple[NDArray, NDArray, NDArray, NDArray]] = {}

    def numbers(x: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Costs and margins at shares of the ranges, and their derivatives."""
        if x.tobytes() not in memory:
            varied = at.copy()
            varied[free] = low + x * (high - low)
            values, slopes = _costs_and_margins(
                jnp.asarray(varied), known, demand, space["material"]
            )
            y, dy = np.asarray(values, dtype=np.float64), np.asarray(slopes, dtype=np.float64)
            there = np.isfinite(y) & np.isfinite(dy).all(-1)
            y = np.where(there, y, -1.0)  # a margin that is not there is missed by all of it
            dy = np.where(there[:, None], dy, 0.0)[:, free] * (high - low)
            n = len(OBJECTIVES)
            memory[x.tobytes()] = y[:n][wanted], y[n:], dy[:n][wanted], dy[n:]
        return memory[x.tobytes()]

    x = (at[free] - low) / (high - low)
    first = float(numbers(x)[0] @ weights)
    kept: dict[str, Any] = {
        "type": "ineq", "fun": lambda x: numbers(x)[1], "jac": lambda x: numbers(x)[3]
    }  # fmt: skip
    found = minimize(
        lambda x: float(numbers(x)[0] @ weights) - first, x, jac=lambda x: weights @ numbers(x)[2],
        method="SLSQP", bounds=[(0.0, 1.0)] * len(x), constraints=[kept],
        options={"maxiter": _STEPS, "ftol": _TOLERANCE},
    )  # fmt: skip
    return low + np.clip(found.x, 0.0, 1.0) * (high - low)


@compiled
def _costs_and_margins(
    varied: RealArray, known: Numbers, demand: Numbers, material: AbstractMaterial | None
) -> tuple[RealArray, RealArray]:
    """Costs of all objectives and margins of all constraints at (3,), and their derivatives."""

    def both(varied: RealArray) -> tuple[RealArray, RealArray]:
        candidate = known | dict(zip(AXES, varied, strict=True))
        candidate["free_contraction"] = free_contraction(candidate, material)
        columns, margins = performance(candidate, demand, material)
        costs = [
            jnp.log(columns[name]) * (1 if side == "least" else -1)
            for name, side in OBJECTIVES.items()
        ]
        values = jnp.stack([*costs, *(jnp.asarray(margins[name]) for name in CONSTRAINTS)])
        return values, values

    slopes, values = jax.jacfwd(both, has_aux=True)(varied)
    return values, slopes

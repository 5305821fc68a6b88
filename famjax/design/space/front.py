"""The Pareto front of many candidates, thinned to what a person tells apart."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .limits import OBJECTIVES

Floats = NDArray[np.float64]
_OF_ZERO = 1000.0


def costs_of(columns: Mapping[str, NDArray], objectives: Sequence[str]) -> Floats:
    """Costs, the less the better: logarithms of the objectives, with a sign, (n, objectives).

    That of zero is taken as -1000, beyond every number's: good where the least is looked for, bad
    where the most is.
    """
    signs = [1.0 if OBJECTIVES[name] == "least" else -1.0 for name in objectives]
    with np.errstate(divide="ignore"):
        logs = [np.log(np.asarray(columns[name], dtype=np.float64)) for name in objectives]
    costs = [sign * log for sign, log in zip(signs, logs, strict=True)]
    return np.clip(np.stack(costs, axis=-1), -_OF_ZERO, _OF_ZERO)


def front_members(costs: Floats, index: NDArray[np.int64], step: float = 0.0) -> NDArray[np.int64]:
    """Which candidates make the front: a part of the Pareto front, a step apart at the least.

    The costs are cut into boxes of log(1 + step). Of the boxes that no other is better than, each
    gives the candidate of the least sum of costs, of equal ones that of the lowest number. None of
    them is dominated by any candidate, and for every candidate there is one of them that is in no
    objective worse by more than the share `step`. Without a step it is the whole front. The front
    of several fronts is that of all their candidates, in whatever order they are joined.

    Args:
        costs: from `costs_of`, (n, objectives).
        index: numbers of the candidates, (n,), each once.
        step: share [-], >= 0.

    Returns:
        Positions in `costs`, in the order of `index`.

    References:
        Laumanns, Thiele, Deb & Zitzler 2002, Evolutionary Computation 10(3): epsilon-dominance.
    """
    boxes = np.floor(costs / np.log1p(step)) if step > 0 else costs
    order = np.lexsort((index, costs.sum(-1), *boxes.T))
    sorted_boxes = boxes[order]
    first = np.ones(len(order), dtype=bool)
    first[1:] = np.any(sorted_boxes[1:] != sorted_boxes[:-1], axis=-1)
    one_each = order[first]
    kept = one_each[_minimal(boxes[one_each])]
    return kept[np.argsort(index[kept])]


def _minimal(boxes: Floats) -> NDArray[np.int64]:
    """Positions of rows, each there once, that no other row is nowhere above."""
    ranks = [np.unique(column, return_inverse=True)[1] for column in boxes.T]
    # The sum of ranks rises with dominance, so that the first of what is left is never dominated.
    at = np.argsort(np.sum(ranks, axis=0), kind="stable")
    left = np.stack(ranks, axis=-1)[at].astype(np.int32)
    found = []
    while len(at):
        found.append(at[0])
        better = np.any(left < left[0], axis=-1)
        at, left = at[better], left[better]
    return np.array(found, dtype=np.int64)


def balance(costs: Floats) -> Floats:
    """How far each member of a front is from the best in everything, (n,).

    The sum over the objectives of how far a cost is on the way from the front's least, 0, to its
    greatest, 1.
    """
    low, high = costs.min(axis=0), costs.max(axis=0)
    return ((costs - low) / np.where(high > low, high - low, 1.0)).sum(-1)

"""One chunk of a search, and what the chunks are joined to."""

import dataclasses
from collections.abc import Iterable, Mapping
from typing import Any

import jax.numpy as jnp
import numpy as np
from numpy.typing import NDArray

from .front import costs_of, front_members
from .grid import SearchGrid
from .limits import COLUMNS, CONSTRAINTS
from .performance import performances

Columns = dict[str, NDArray]
"""Candidates: `index`, `pair` and the numbers of `COLUMNS`, each (n,), in SI."""


def search_chunk(space: Mapping[str, Any], first: int) -> dict[str, Any]:
    """Evaluate the candidates from a number on, and keep what may matter.

    Args:
        space: arrays and names alone: "grid" (low, high, counts of a `SearchGrid`), "pairs" and
            "demand" (see `performance`), "material", "objectives", "front_step", "chunk" and "states"
            (numbers of candidates and of their states, the one shape that is compiled), "table_rows".
        first: number of the first candidate.

    Returns:
        "feasible" their number; "excluded", "alone" and "closest": by constraint, how many fail it,
        how many fail nothing else, and the best margin; "front" and "sample": columns of feasible
        ones; "nearest": columns of the candidate whose worst "shortfall" is the least, a share
        of the limit, 1 where the braid jams before; of equal ones that with the least sum of them,
        "shortfalls". Numbers and arrays alone.
    """
    total = SearchGrid(*space["grid"]).total
    columns, margins = evaluate(space, np.arange(first, min(first + space["chunk"], total)))
    kept = margins >= 0  # nan is not
    fails = ~kept
    feasible = np.flatnonzero(kept.all(axis=-1))
    shortfalls = np.where(fails, np.fmin(-margins, 1.0), 0.0)
    worst = {"shortfall": shortfalls.max(axis=-1), "shortfalls": shortfalls.sum(axis=-1)}
    nearest = np.lexsort(_nearness(columns | worst)[::-1])[:1]
    found = rows_at(columns, feasible)
    return {
        "feasible": len(feasible),
        "excluded": fails.sum(axis=0),
        "alone": (fails & (fails.sum(axis=-1) == 1)[:, None]).sum(axis=0),
        "closest": np.fmax.reduce(margins, axis=0),
        "front": _front(found, space),
        "sample": _sample(found, space["table_rows"]),
        "nearest": rows_at(columns | worst, nearest),
    }


def evaluate(
    space: Mapping[str, Any], index: NDArray[np.int64]
) -> tuple[Columns, NDArray[np.floating]]:
    """Columns of some candidates of the grid, and their margins, (n, constraints)."""
    varied = SearchGrid(*space["grid"]).candidates(index)
    columns, margins = evaluate_at(space, varied.pop("pair"), varied)
    return {"index": index} | columns, margins


def evaluate_at(
    space: Mapping[str, Any], pair: NDArray[np.int64], varied: Mapping[str, NDArray[np.float64]]
) -> tuple[Columns, NDArray[np.floating]]:
    """The same anywhere: of pairs (n,), at the numbers that are varied, each (n,), in SI.

    Evaluated in chunks of the one shape, the last of them filled up.
    """
    demand = {name: jnp.asarray(value) for name, value in space["demand"].items()}
    of_state = ("nominal_diameter", "pressure")
    same = np.stack([pair, *(varied[name] for name in of_state)])
    state = np.cumsum(np.any(np.diff(same, axis=-1, prepend=same[:, :1]) != 0, axis=0))
    parts, first = [], 0
    while first < len(pair):
        beyond = np.searchsorted(state, state[first] + space["states"])
        last = min(first + space["chunk"], int(beyond))
        at = np.minimum(np.arange(first, first + space["chunk"]), last - 1)
        begin = np.searchsorted(state, state[first] + np.arange(space["states"]))
        begin = np.minimum(begin, last - 1)
        states = {name: values[pair[begin]] for name, values in space["pairs"].items()}
        states |= {name: varied[name][begin] for name in of_state}
        numbers, margins = performances(
            {name: jnp.asarray(values) for name, values in states.items()},
            jnp.asarray(state[at] - state[first]),
            jnp.asarray(varied["rest_length"][at]),
            demand,
            space["material"],
        )
        kept = slice(last - first)
        parts.append(
            (
                {name: np.asarray(numbers[name])[kept] for name in COLUMNS},
                np.stack([np.asarray(margins[name])[kept] for name in CONSTRAINTS], axis=-1),
            )
        )
        first = last
    columns = joined([columns for columns, _ in parts])
    return {"pair": pair} | columns, np.concatenate([margins for _, margins in parts])


def _nearness(columns: Columns) -> tuple[NDArray, ...]:
    """What the nearest miss has the least of, what counts most first; rounding decides no tie."""
    worst, together = (np.round(columns[name], 6) for name in ("shortfall", "shortfalls"))
    return worst, together, columns["index"]


def rows_at(columns: Columns, at: NDArray[np.int64] | slice) -> Columns:
    """Some rows of all columns."""
    return {name: values[at] for name, values in columns.items()}


def joined(parts: Iterable[Columns]) -> Columns:
    """The rows of several, one after the other."""
    columns = list(parts)
    return {name: np.concatenate([one[name] for one in columns]) for name in columns[0]}


def _front(found: Columns, space: Mapping[str, Any]) -> Columns:
    costs = costs_of(found, space["objectives"])
    return rows_at(found, front_members(costs, found["index"], space["front_step"]))


def _sample(found: Columns, rows: int) -> Columns:
    """At most so many, in the order of their numbers: those whose scrambled number is the least.

    Which they are depends on all that are found, and not on the order in which they are.
    """
    if len(found["index"]) <= rows:
        return found
    least = np.argpartition(_scrambled(found["index"]), rows)[:rows]
    return rows_at(found, np.sort(least))


def _scrambled(index: NDArray[np.int64]) -> NDArray[np.uint64]:
    """A one-to-one scrambling of whole numbers (splitmix64; Steele, Lea & Flood 2014)."""
    z = index.astype(np.uint64) + np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@dataclasses.dataclass
class Tally:
    """What the chunks of a search are joined to; no larger than front and sample.

    Attributes:
        space: of `search_chunk`.
        feasible: those that keep to everything.
        excluded: (constraints,), candidates that fail each.
        alone: (constraints,), candidates that fail each and nothing else.
        closest: (constraints,), best margin.
        front: columns of the front so far.
        sample: columns of the table so far.
        nearest: columns of the nearest miss, and its shortfall.
        done: indices of the chunks that it holds.
    """

    space: Mapping[str, Any]
    feasible: int = 0
    excluded: Any = 0
    alone: Any = 0
    closest: Any = -np.inf
    front: Columns = dataclasses.field(default_factory=dict)
    sample: Columns = dataclasses.field(default_factory=dict)
    nearest: Columns = dataclasses.field(default_factory=dict)
    done: set[int] = dataclasses.field(default_factory=set)

    def __contains__(self, index: int) -> bool:
        return index in self.done

    def keep(self, index: int, part: Mapping[str, Any]) -> None:
        """Join what one chunk found; the order of the chunks does not matter."""
        self.done.add(index)
        self.feasible += part["feasible"]
        self.excluded = self.excluded + part["excluded"]
        self.alone = self.alone + part["alone"]
        self.closest = np.fmax(self.closest, part["closest"])
        if part["feasible"]:
            front, sample = part["front"], part["sample"]
            if self.front:
                front = joined([self.front, front])
                sample = joined([self.sample, sample])
            self.front = _front(front, self.space)
            self.sample = _sample(sample, self.space["table_rows"])
        if not self.nearest or _nearness(part["nearest"]) < _nearness(self.nearest):
            self.nearest = part["nearest"]

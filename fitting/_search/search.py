"""The outer search: multi-start descent over the geometry, and constraints made exact."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from .._convex.qp import Optimum
from .._errors import InputError
from .._model.margin import path_margin, slope_margin
from .._model.part import Part
from .._model.problem import Problem
from .box import BoxOptimum, minimise_in_box
from .quick_jit import quick_jit

FEASIBLE = 1e-9
"""Violation of a constraint that counts as rounding, in parts of the largest coefficient."""
_CHUNK = 8


class Search(eqx.Module):
    """A problem with the box in which its nonlinear parameters are sought.

    Attributes:
        problem: the fit for given parameters.
        names: of the parameters.
        low, high: bounds of the parameters [SI], shape (q,).
        free: places of the parameters that may move, those with low < high.
    """

    problem: Problem
    names: tuple[str, ...] = eqx.field(static=True)
    low: Float[Array, " q"]
    high: Float[Array, " q"]
    free: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def in_box(
        cls, problem: Problem, names: tuple[str, ...], low: np.ndarray, high: np.ndarray
    ) -> "Search":
        """The search of a problem's parameters between two bounds [SI]."""
        free = tuple(int(k) for k in np.flatnonzero(low < high))
        return cls(problem, names, jnp.asarray(low), jnp.asarray(high), free)

    def parameters(self, u: Float[Array, " p"]) -> Float[Array, " q"]:
        """The parameters [SI] at a point of the unit box."""
        at = jnp.asarray(self.free, int)
        return self.low.at[at].add(u * (self.high - self.low)[at])

    def descend(self, start: Float[Array, " p"]) -> BoxOptimum:
        """One descent from a point of the unit box."""
        return minimise_in_box(lambda u: self.problem.residual(self.parameters(u)), start)


@quick_jit
def _descend_chunk(search: Search, starts: Float[Array, "k p"]) -> BoxOptimum:
    return jax.vmap(search.descend)(starts)


@quick_jit
def solve(problem: Problem, parameters: Float[Array, " q"]) -> Optimum:
    """The convex fit of every block with given parameters."""
    return problem.solve(parameters)


@quick_jit
def offsets(problem: Problem, parameters: Float[Array, " q"]) -> Float[Array, " k"]:
    """What the coefficients have to explain at every reading; nan where there is no geometry."""
    return jnp.sum(problem.programmes(parameters)[1], axis=0)


@quick_jit
def rows_known(problem: Problem, parameters: Float[Array, " q"]) -> Array:
    """Whether every constraint row is a number."""
    _, _, G, h = problem.programmes(parameters)
    return jnp.isfinite(jnp.sum(G) + jnp.sum(h))


def latin_hypercube(n_free: int, count: int, seed: int) -> Float[np.ndarray, "k p"]:
    """Latin hypercube in the unit box, away from its faces."""
    rng = np.random.default_rng(seed)
    cells = rng.permuted(np.tile(np.arange(count), (n_free, 1)), axis=1).T
    return (cells + rng.uniform(0.05, 0.95, (count, n_free))) / count


def descend(
    search: Search, starts: np.ndarray, progress: Callable[[int, int], None] | None
) -> BoxOptimum:
    """The ends of all descents, in chunks of one shape so that one compilation serves them all."""
    chunks = []
    for first in range(0, len(starts), _CHUNK):
        chunk = starts[first : first + _CHUNK]
        padded = np.concatenate([chunk, np.repeat(chunk[-1:], _CHUNK - len(chunk), axis=0)])
        ended = _descend_chunk(search, jnp.asarray(padded))
        kept = slice(len(chunk))
        chunks.append(jax.tree.map(lambda leaf, kept=kept: np.asarray(leaf)[kept], ended))
        if progress is not None:
            progress(min(first + _CHUNK, len(starts)), len(starts))
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *chunks)


def best_of(ends: BoxOptimum) -> BoxOptimum:
    """The end of the lowest cost; one whose cost is nan never is."""
    if not np.isfinite(ends.cost).any():
        raise InputError(
            "no start ended at a force for every reading: somewhere in the box the bladder does "
            "not fit in the braid or a length cannot be reached; narrow the bounds"
        )
    return jax.tree.map(lambda leaf: jnp.asarray(leaf[np.nanargmin(ends.cost)]), ends)


def refine(search: Search, best: BoxOptimum, spare: int) -> tuple[BoxOptimum, Search]:
    """The best of the descents, with the constraint made to hold between the stations.

    Where the law is found to violate it, that point becomes a station and the descent goes on.

    Args:
        search: of the descents.
        best: their best end.
        spare: number of stations at the end of each path that are free to be placed.

    Returns:
        The end of the last descent, and the search with the stations placed.
    """
    margins = {"drucker": path_margin, "slope": slope_margin}
    if search.problem.constraint not in margins:
        return best, search
    margin = margins[search.problem.constraint]
    for exchange in range(spare):
        parameters = search.parameters(best.u)
        x = solve(search.problem, parameters).x
        found = margin(search.problem, parameters, x)
        if min(value.min() for _, value in found) >= -FEASIBLE * float(jnp.max(jnp.abs(x))):
            break
        parts = tuple(
            _with_station(part, exchange - spare, position)
            for part, (position, _) in zip(search.problem.parts, found, strict=True)
        )
        search = eqx.tree_at(lambda s: s.problem.parts, search, parts)
        again = _descend_chunk(search, jnp.tile(best.u, (_CHUNK, 1)))
        best = jax.tree.map(lambda leaf: leaf[0], again)
    return best, search


def _with_station(part: Part, place: int, position: np.ndarray) -> Part:
    """The part with one station of each path moved."""
    moved = eqx.tree_at(lambda p: p.stations, part, part.stations.at[..., place].set(position))
    return moved.tabulated()

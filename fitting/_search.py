"""The outer search: multi-start descent over the geometry, and constraints made exact."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from ._box import BoxOptimum, minimise_in_box
from ._margin import path_margin, slope_margin
from ._problem import STATIONS, Problem
from ._qp import Optimum

_CHUNK = 8
FEASIBLE = 1e-9
"""Violation of a constraint between stations that counts as rounding, in parts of the largest E_n."""


class Search(eqx.Module):
    """A problem with the box in which its geometry is sought.

    Attributes:
        problem: the fit for a given geometry.
        low, high: bounds of the geometry [SI], shape (3,).
        free: positions of the parameters that may move, those with low < high.
    """

    problem: Problem
    low: Float[Array, " 3"]
    high: Float[Array, " 3"]
    free: tuple[int, ...] = eqx.field(static=True)

    @classmethod
    def in_box(cls, problem: Problem, low: np.ndarray, high: np.ndarray) -> "Search":
        """The search of a problem's geometry between two bounds [SI]."""
        free = tuple(int(k) for k in np.flatnonzero(low < high))
        return cls(problem, jnp.asarray(low), jnp.asarray(high), free)

    def geometry(self, u: Float[Array, " p"]) -> Float[Array, " 3"]:
        """The geometry [SI] at a point of the unit box."""
        at = jnp.asarray(self.free, int)
        return self.low.at[at].add(u * (self.high - self.low)[at])

    def descend(self, start: Float[Array, " p"]) -> BoxOptimum:
        """One descent from a point of the unit box."""
        return minimise_in_box(lambda u: self.problem.residual(self.geometry(u)), start)


@eqx.filter_jit
def _descend_chunk(search: Search, starts: Float[Array, "k p"]) -> BoxOptimum:
    return jax.vmap(search.descend)(starts)


@eqx.filter_jit
def solve(problem: Problem, geometry: Float[Array, " 3"]) -> Optimum:
    """The convex fit of every block at one geometry."""
    return problem.solve(geometry)


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


def refine(search: Search, ends: BoxOptimum) -> tuple[BoxOptimum, Search]:
    """The best of the descents, with the constraint made to hold between the stations.

    Where the law is found to violate it, that point becomes a station and the descent goes on.
    """
    best = jax.tree.map(lambda leaf: jnp.asarray(leaf[np.nanargmin(ends.cost)]), ends)
    margins = {"drucker": path_margin, "slope": slope_margin}
    if search.problem.constraint not in margins:
        return best, search
    margin = margins[search.problem.constraint]
    for exchange in range(search.problem.stations.shape[-1] - STATIONS):
        geometry = search.geometry(best.u)
        x = solve(search.problem, geometry).x
        muscle = search.problem.muscle(geometry, search.problem.material(x))
        position, value = margin(search.problem, geometry, muscle)
        if value.min() >= -FEASIBLE * float(jnp.max(jnp.abs(x))):
            break
        stations = search.problem.stations.at[..., STATIONS + exchange].set(position)
        search = eqx.tree_at(lambda s: s.problem.stations, search, stations)
        again = _descend_chunk(search, jnp.tile(best.u, (_CHUNK, 1)))
        best = jax.tree.map(lambda leaf: leaf[0], again)
    return best, search

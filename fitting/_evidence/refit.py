"""The same identification again with other readings: what validation and uncertainty are made of."""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from .._search.quick_jit import quick_jit
from .._search.search import Search

_CHUNK = 16


class Readings(eqx.Module):
    """What changes from one refit to another; leading axis of refits in a batch.

    Attributes:
        force: [N] of all parts one after another, shape (points,).
        weights: factors on the weights of the readings, shape (points,); 0 leaves a reading out.
        low, high: bounds of the nonlinear parameters [SI], shape (q,).
        coefficient_min, coefficient_max: bounds of the coefficients, shape (order,).
    """

    force: Float[Array, "*batch points"]
    weights: Float[Array, "*batch points"]
    low: Float[Array, "*batch q"]
    high: Float[Array, "*batch q"]
    coefficient_min: Float[Array, "*batch order"]
    coefficient_max: Float[Array, "*batch order"]

    @classmethod
    def of(cls, search: Search) -> "Readings":
        """The readings and bounds of a search as they are."""
        force = jnp.concatenate([part.force for part in search.problem.parts])
        problem = search.problem
        return cls(
            force,
            jnp.ones_like(force),
            search.low,
            search.high,
            problem.coefficient_min,
            problem.coefficient_max,
        )

    def repeated(self, count: int) -> "Readings":
        """A batch of the same readings."""
        return jax.tree.map(lambda leaf: jnp.tile(leaf, (count, *(1,) * leaf.ndim)), self)


class Refit(eqx.Module):
    """Where a refit ended; leading axis of refits in a batch.

    Attributes:
        parameters: nonlinear parameters [SI], shape (q,).
        x: coefficients [Pa], shape (blocks, n).
        cost: half the weighted sum of squares, priors included.
        residual: model minus reading [N] at every reading, those left out too, shape (points,).
        steps: steps taken.
        converged: the end is stationary.
    """

    parameters: Float[Array, "*batch q"]
    x: Float[Array, "*batch blocks n"]
    cost: Float[Array, "*batch"]
    residual: Float[Array, "*batch points"]
    steps: Int[Array, "*batch"]
    converged: Array


def with_readings(search: Search, readings: Readings) -> Search:
    """The search with other readings and bounds."""
    parts, first = [], 0
    for part in search.problem.parts:
        here = slice(first, first + part.force.shape[0])
        first = here.stop
        parts.append(
            eqx.tree_at(
                lambda p: (p.force, p.weights),
                part,
                (readings.force[here], part.weights * readings.weights[here]),
            )
        )
    return eqx.tree_at(
        lambda s: (
            s.problem.parts,
            s.low,
            s.high,
            s.problem.coefficient_min,
            s.problem.coefficient_max,
        ),
        search,
        (
            tuple(parts),
            readings.low,
            readings.high,
            readings.coefficient_min,
            readings.coefficient_max,
        ),
    )


@quick_jit
def _refit_chunk(search: Search, readings: Readings, starts: Float[Array, "batch p"]) -> Refit:
    def one(readings: Readings, start: Float[Array, " p"]) -> Refit:
        changed = with_readings(search, readings)
        end = changed.descend(start)
        parameters = changed.parameters(end.u)
        problem = changed.problem
        reaches = problem.reaches(parameters)
        x = problem.solve(parameters).x
        return Refit(
            parameters=parameters,
            x=x,
            cost=end.cost,
            residual=problem.force_error(parameters, x, reaches),
            steps=end.steps,
            converged=end.converged,
        )

    return jax.vmap(one)(readings, starts)


def refit(
    search: Search,
    readings: Readings,
    starts: Float[np.ndarray, "batch p"],
    progress: Callable[[int, int], None] | None = None,
) -> Refit:
    """The ends of descents with other readings, one start each, in chunks of one shape.

    Args:
        search: whose problem, stations and free parameters are kept.
        readings: a batch.
        starts: points of the unit box of the changed bounds, one for each of the batch.
        progress: called with (refits done, refits).

    Returns:
        The batch of refits, as numpy arrays.
    """
    count, chunks = len(starts), []
    for first in range(0, count, _CHUNK):
        # The last chunk is filled with the last member, so that one compilation serves all.
        members = np.minimum(np.arange(first, first + _CHUNK), count - 1)
        chunk = jax.tree.map(lambda leaf, members=members: leaf[members], readings)
        ended = _refit_chunk(search, chunk, jnp.asarray(starts)[members])
        kept = slice(min(_CHUNK, count - first))
        chunks.append(jax.tree.map(lambda leaf, kept=kept: np.asarray(leaf)[kept], ended))
        if progress is not None:
            progress(min(first + _CHUNK, count), count)
    return jax.tree.map(lambda *leaves: np.concatenate(leaves), *chunks)


def best_starts(found: Refit, per_member: int) -> Refit:
    """Of several refits of each member, one after another, the one of the lowest cost."""
    cost = np.where(np.isfinite(found.cost), found.cost, np.inf).reshape(-1, per_member)
    member = np.arange(cost.shape[0])
    return jax.tree.map(
        lambda leaf: leaf.reshape(-1, per_member, *leaf.shape[1:])[member, cost.argmin(axis=1)],
        found,
    )

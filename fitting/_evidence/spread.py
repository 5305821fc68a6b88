"""How the numbers of a muscle vary together: the error band of its force anywhere.

The linear theory (delta method): with J the derivatives of the muscle's numbers in the identified
parameters and C their covariance, J C J^T is that of the numbers. It is kept as the columns of a
root of it: directions of one standard deviation each, independent of one another.
"""

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .._model.geometry_source import EstimatedSource
from .._search.result import Identification
from .._search.search import solve
from .bootstrap import Bootstrap
from .pull import flatten

_NEGLIGIBLE = 1e-12  # of the largest variance of independent directions: rounding


def muscle_spread(
    result: Identification, drawn: Bootstrap | None = None
) -> Float[np.ndarray, "directions numbers"]:
    """Directions in which the numbers of the mounted muscle vary, one standard deviation each.

    Args:
        result: an identification. What is held or at a bound does not vary.
        drawn: its bootstrap, whose covariance then takes the place of that of linear theory.

    Returns:
        One row for each independent direction, of the arrays of `famjax.MountedMuscle(muscle,
        compliance)` one after another; no rows where there are no standard errors.
    """
    search, q = result.search, len(result.search.names)
    problem, parameters = search.problem, search.parameters(jnp.asarray(result.unit_optimum))
    x = solve(problem, parameters).x
    k = _part_of(result)

    @jax.jit
    def slopes(at: Float[Array, " p"]) -> Float[Array, "numbers p"]:
        def numbers(at: Float[Array, " p"]) -> Float[Array, " numbers"]:
            muscle = problem.muscles(at[:q], at[q:].reshape(x.shape))[k]
            return flatten(famjax.MountedMuscle(muscle, problem.parts[k].compliance(at[:q])))[0]

        return jax.jacfwd(numbers)(at)

    covariance = result.covariance if drawn is None else _covariance(result, drawn)
    return (np.asarray(slopes(jnp.concatenate([parameters, x.ravel()]))) @ _root(covariance)).T


def _part_of(result: Identification) -> int:
    """Which of the specimens identified together this is."""
    parts = result.search.problem.parts
    if len(parts) == 1:
        return 0
    names = [p.source.specimen.name for p in parts if isinstance(p.source, EstimatedSource)]
    return names.index(result.data.specimen.name)


def _covariance(result: Identification, drawn: Bootstrap) -> Float[np.ndarray, "p p"]:
    """The covariance of bootstrap replicates, with nan for what they hold."""
    search = result.search
    moving = [*search.free, *range(len(search.names), len(result.covariance))]
    covariance = np.full_like(result.covariance, np.nan)
    covariance[np.ix_(moving, moving)] = np.cov(drawn.samples.T)
    return covariance


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p directions"]:
    """R with R R^T = C; rows of what has no variance are zero."""
    std = np.sqrt(np.diag(covariance))
    std = np.where(std > 0, std, 0.0)
    scale = np.outer(std, std)
    correlation = np.where(scale > 0, covariance / np.where(scale > 0, scale, 1.0), 0.0)
    variance, directions = np.linalg.eigh(correlation)
    kept = variance > _NEGLIGIBLE * max(variance.max(initial=0.0), _NEGLIGIBLE)
    return std[:, None] * directions[:, kept] * np.sqrt(variance[kept])

"""How the numbers of a muscle vary together: the error band of its force anywhere.

The linear theory (delta method): with J the derivatives of the muscle's numbers in the identified
parameters and C their covariance, J C J^T is that of the numbers. It is kept as the columns of a
root of it: directions of one standard deviation each, independent of one another.
"""

from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree
from jaxtyping import Array, Float

import famjax

from .._search.result import Identification
from .bootstrap import Bootstrap

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
    problem, point = result.problem, result.end.point
    part, q = problem.parts[result.place], len(problem.names)
    own = point.x[part.coefficients]
    value, slope, _ = part.program(
        point.parameters[part.at], own, point.linear[result.place].reached
    )
    slopes = np.zeros((value.numbers.size + 1, q + point.x.size))
    np.add.at(slopes[:-1].T, part.at, slope.numbers)
    slopes[:-1, q + part.coefficients] = value.number_columns
    if part.compliance is not None:
        slopes[-1, part.compliance] = 1.0
    covariance = result.covariance if drawn is None else _covariance(result, drawn)
    return (slopes @ _root(covariance)).T


def force_std(
    mounted: famjax.MountedMuscle,
    spread: Float[np.ndarray, "directions numbers"],
    length: Float[np.ndarray, " n"],
    pressure: Float[np.ndarray, " n"],
    *,
    of: Callable[[famjax.MountedMuscle], famjax.Muscle | famjax.MountedMuscle],
    length_std: float = 0.0,
) -> Float[np.ndarray, " n"]:
    """Standard deviation [N] of a force, by linear theory.

    Args:
        mounted: the identified muscle in its rig.
        spread: from `muscle_spread`.
        length: active lengths [m].
        pressure: gauge pressures [Pa].
        of: what pulls, made of the mounted muscle: itself, the muscle alone, or another length.
        length_std: standard deviation of the lengths [m].
    """
    flat, unflat = _flat(mounted)
    L, P = jnp.asarray(length), jnp.asarray(pressure)

    @jax.jit
    def variance(flat: Float[Array, " numbers"]) -> Float[Array, " n"]:
        def along(direction: Float[Array, " numbers"]) -> Float[Array, " n"]:
            return jax.jvp(lambda f: of(unflat(f)).force(L, P), (flat,), (direction,))[1]

        stiffness = jax.jvp(lambda L: of(unflat(flat)).force(L, P), (L,), (jnp.ones_like(L),))[1]
        total = (length_std * stiffness) ** 2
        return total + jnp.sum(jax.vmap(along)(jnp.asarray(spread)) ** 2, axis=0)

    return np.sqrt(np.asarray(variance(flat)))


def _flat(
    mounted: famjax.MountedMuscle,
) -> tuple[Float[Array, " numbers"], Callable[[Float[Array, " numbers"]], famjax.MountedMuscle]]:
    """All numbers of a mounted muscle in one row, and the way back."""
    numbers, rest = eqx.partition(mounted, eqx.is_inexact_array)
    flat, unflat = ravel_pytree(numbers)
    return flat, lambda changed: eqx.combine(unflat(changed), rest)


def _covariance(result: Identification, drawn: Bootstrap) -> Float[np.ndarray, "p p"]:
    """The covariance of bootstrap replicates, with nan for what they hold."""
    problem = result.problem
    moving = [*problem.free, *range(len(problem.names), len(result.covariance))]
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

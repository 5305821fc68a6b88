"""Triangles of a handful of unknowns, written out: LAPACK is called once per member of a batch."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from .arrays import AnyArray, fixed, namespace

_WRITTEN_OUT = 8  # largest number of unknowns


def cholesky(matrix: Float[AnyArray, "*batch n n"]) -> Float[AnyArray, "*batch n n"]:
    """The lower triangle L with L L^T = matrix; nan where the matrix is not positive definite."""
    xp, n = namespace(matrix), matrix.shape[-1]
    if n > _WRITTEN_OUT:
        return xp.linalg.cholesky(matrix)
    index, rest, columns = np.arange(n), matrix, []
    for j in range(n):
        column = xp.where(index >= j, rest[..., j] / xp.sqrt(rest[..., j, j])[..., None], 0.0)
        rest = rest - column[..., :, None] * column[..., None, :]
        columns.append(column)
    return xp.stack(columns, axis=-1)


def inverse_lower(lower: Float[AnyArray, "*batch n n"]) -> Float[AnyArray, "*batch n n"]:
    """The inverse of a lower triangle with a diagonal without zeros."""
    xp, n = namespace(lower), lower.shape[-1]
    if n > _WRITTEN_OUT:
        return xp.linalg.inv(lower)
    unit, rows = np.eye(n, dtype=lower.dtype), []
    for i in range(n):
        known = sum((lower[..., i, j, None] * rows[j] for j in range(i)), start=0.0)
        rows.append((unit[i] - known) / lower[..., i, i, None])
    return xp.stack(rows, axis=-2)


def inverse_upper(
    R: Float[AnyArray, "*batch n n"], size: int
) -> tuple[Float[AnyArray, "*batch n n"], Float[AnyArray, "*batch"], Bool[AnyArray, "*batch"]]:
    """The inverse of an upper triangle, its condition number, and whether it is singular.

    A singular one is replaced by the identity, so that its part of a batch stays finite.

    Args:
        R: with columns of unit length.
        size: the larger dimension of the matrix whose factor it is, for the rounding.
    """
    xp, still, eps = namespace(R), fixed(R), jnp.finfo(R.dtype).eps
    unit, both = np.eye(R.shape[-1], dtype=R.dtype), (-2, -1)
    norm = xp.sqrt(xp.sum(still**2, axis=both))
    zero = abs(xp.diagonal(still, axis1=-2, axis2=-1)) <= eps * norm[..., None]
    trial = inverse_lower(xp.swapaxes(still, *both) + unit * xp.where(zero, 1.0, 0.0)[..., None, :])
    condition = norm * xp.sqrt(xp.sum(trial**2, axis=both))
    condition = xp.where(zero.any(axis=-1), xp.inf, condition)
    deficient = ~(condition * 10 * size * eps < 1)
    # The trial of a singular one may overflow, and so would its derivative.
    R = xp.where(deficient[..., None, None], unit, R)
    return xp.swapaxes(inverse_lower(xp.swapaxes(R, *both)), *both), condition, deficient

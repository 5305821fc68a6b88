"""Triangles of a handful of unknowns, written out: LAPACK is called once per member of a batch."""

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

_WRITTEN_OUT = 8  # largest number of unknowns


def cholesky(matrix: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The lower triangle L with L L^T = matrix; nan where the matrix is not positive definite."""
    n = matrix.shape[0]
    if n > _WRITTEN_OUT:
        return jnp.linalg.cholesky(matrix)
    index, rest, columns = jnp.arange(n), matrix, []
    for j in range(n):
        column = jnp.where(index >= j, rest[:, j] / jnp.sqrt(rest[j, j]), 0.0)
        rest = rest - column[:, None] * column
        columns.append(column)
    return jnp.stack(columns, axis=1)


def inverse_lower(lower: Float[Array, "n n"]) -> Float[Array, "n n"]:
    """The inverse of a lower triangle with a diagonal without zeros."""
    n = lower.shape[0]
    unit = jnp.eye(n, dtype=lower.dtype)
    if n > _WRITTEN_OUT:
        return jax.scipy.linalg.solve_triangular(lower, unit, lower=True)
    inverse = jnp.zeros_like(lower)
    for i in range(n):
        inverse = inverse.at[i].set((unit[i] - lower[i] @ inverse) / lower[i, i])
    return inverse

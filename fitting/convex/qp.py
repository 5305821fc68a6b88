"""The convex core: least squares under linear inequalities, exact, small, batched, differentiable.

    minimise 1/2 |A x - b|^2   subject to   G x >= h

The columns are scaled, the rows compressed by one QR factorisation A = Q R, and in y = R x the
optimum is the point of a polyhedron nearest to Q^T b (`_active_set`). The certificate is computed
on the problem as it was given.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from .active_set import nearest_point
from .small_dense import inverse_upper
from .status import Status as Status


class Optimum(eqx.Module):
    """The optimum of one quadratic programme with its certificate.

    Attributes:
        x: minimiser, shape (n,); nan unless `status` is OPTIMAL.
        multipliers: of the rows of G x >= h, shape (m,), >= 0.
        active: rows that hold with equality and carry a multiplier, shape (m,).
        objective: 1/2 |A x - b|^2.
        kkt_residual: largest violation of the optimality conditions, relative to |b|.
        duality_gap: primal minus dual objective, relative to the objective.
        condition: |A| |A^+| in the Frobenius norm, with columns scaled to unit length; at most n
            times the ratio of the singular values.
        status: a `Status`.
    """

    x: Float[Array, " n"]
    multipliers: Float[Array, " m"]
    active: Bool[Array, " m"]
    objective: Float[Array, ""]
    kkt_residual: Float[Array, ""]
    duality_gap: Float[Array, ""]
    condition: Float[Array, ""]
    status: Int[Array, ""]


def unit_rows(
    rows: Float[Array, "m n"], offsets: Float[Array, " m"]
) -> tuple[Float[Array, "m n"], Float[Array, " m"], Float[Array, " m"]]:
    """Rows scaled to unit length, their offsets, and the lengths; an empty row keeps its sign."""
    square = jnp.sum(rows**2, axis=1)
    empty = square == 0
    size = jnp.where(empty, 1.0, jnp.sqrt(jnp.where(empty, 1.0, square)))
    return rows / size[:, None], offsets / size, size


def solve_qp(
    A: Float[Array | np.ndarray, "k n"],
    b: Float[Array | np.ndarray, " k"],
    G: Float[Array | np.ndarray, "m n"],
    h: Float[Array | np.ndarray, " m"],
) -> Optimum:
    """The certified minimiser of 1/2 |A x - b|^2 subject to G x >= h.

    Args:
        A: design matrix, any units per column, k >= n.
        b: data.
        G: constraint rows; a row of zeros with h <= 0 switches a constraint off.
        h: constraint offsets.

    Returns:
        The optimum. `x` may be differentiated in A, b, G and h; everything else is data.

    Raises:
        ValueError: fewer rows than columns in A.

    >>> import numpy as np
    >>> best = solve_qp(np.eye(2), np.array([1.0, -1.0]), np.eye(2), np.zeros(2))
    >>> best.x.tolist(), best.active.tolist()
    ([1.0, 0.0], [False, True])
    """
    if A.shape[0] < A.shape[1]:
        raise ValueError(
            f"A needs at least as many rows as columns, got shape {A.shape}: "
            "give more data points or fewer coefficients"
        )
    A, b, G, h = (jnp.asarray(value) for value in (A, b, G, h))
    scale = jax.lax.stop_gradient(jnp.linalg.norm(A, axis=0))
    scale = jnp.where(scale > 0, scale, 1.0)
    Q, R = jnp.linalg.qr(A / scale)
    J, condition, deficient = inverse_upper(R, max(A.shape))
    centre = Q.T @ b
    rows, offsets, size = unit_rows((G / scale) @ J, h)
    nearest = nearest_point(rows, offsets, centre)
    m = G.shape[0]
    multipliers, active = jnp.zeros(m, b.dtype), jnp.zeros(m, bool)
    if m:
        multipliers = multipliers.at[nearest.rows].add(nearest.multipliers)
        active = active.at[nearest.rows].max(nearest.used)
    x = (J @ nearest.y) / scale
    status = jnp.where(deficient, int(Status.RANK_DEFICIENT), nearest.status)
    # Comparisons with nan are all false: a constraint that has no number would bind nowhere.
    known = jnp.isfinite(jnp.sum(G) + jnp.sum(h))
    status = jnp.where(known, status, int(Status.STALLED))
    certificate = certificate_of(
        *(jax.lax.stop_gradient(v) for v in (A, b, G, h, x, multipliers / size, J, scale, size))
    )
    return Optimum(
        x=jnp.where(status == int(Status.OPTIMAL), x, jnp.nan),
        multipliers=jax.lax.stop_gradient(multipliers / size),
        active=active,
        condition=condition,
        status=status,
        **certificate,
    )


def certificate_of(
    A: Float[Array, "k n"],
    b: Float[Array, " k"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    x: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    J: Float[Array, "n n"],
    scale: Float[Array, " n"],
    size: Float[Array, " m"],
) -> dict[str, Float[Array, ""]]:
    """Optimality measured on the problem as it was given, not on its compressed form."""
    tiny = jnp.finfo(b.dtype).tiny
    residual = A @ x - b
    slack = (G @ x - h) / size  # distances to the constraints in the metric of the data
    weights = multipliers * size
    stationarity = (A.T @ residual - G.T @ multipliers) / scale
    violations = jnp.concatenate(
        [jnp.abs(stationarity), jnp.maximum(-slack, 0), jnp.maximum(-weights, 0)]
    )
    objective = residual @ residual / 2
    # primal - dual = multipliers . slack + 1/2 |R^-T stationarity|^2, free of cancellation
    excess = J.T @ stationarity
    gap = weights @ slack + excess @ excess / 2
    size_b = jnp.linalg.norm(b)
    return {
        "objective": objective,
        "kkt_residual": jnp.max(violations) / jnp.maximum(size_b, tiny),
        "duality_gap": jnp.abs(gap)
        / jnp.maximum(objective, jnp.finfo(b.dtype).eps * size_b**2 + tiny),
    }

"""The convex core: least squares under linear inequalities, exact, small, batched, differentiable.

    minimise 1/2 |A x - b|^2   subject to   G x >= h

The columns are scaled, the rows compressed by one QR factorisation, and the dual active-set method
of Goldfarb & Idnani walks from the unconstrained optimum to the constrained one. Its last active
set is then solved once more as a system of equations. That solve is what gets differentiated: it
is the implicit function theorem at the optimum, exact while the active set is strict.

References:
    Goldfarb & Idnani 1983, Mathematical Programming 27, 1-33.
"""

import enum

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int


class Status(enum.IntEnum):
    """How a quadratic programme ended; `message` says what to do about it."""

    OPTIMAL = 0
    RANK_DEFICIENT = 1
    INFEASIBLE = 2
    STALLED = 3

    @property
    def message(self) -> str:
        """A full sentence with a remedy."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OPTIMAL: "the optimum was found and certified",
    Status.RANK_DEFICIENT: (
        "the data cannot tell the coefficients apart: use a lower order, fewer pressure-dependent "
        "coefficients, or readings at more lengths"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the constraints: the bounds on the coefficients contradict the "
        "constraint, or one another; widen them or choose a weaker constraint"
    ),
    Status.STALLED: (
        "the active set kept changing: check the data for columns of very different size, "
        "or constraint rows that are nearly the same"
    ),
}


class Optimum(eqx.Module):
    """The optimum of one quadratic programme with its certificate.

    Attributes:
        x: minimiser, shape (n,); nan unless `status` is OPTIMAL.
        multipliers: of the rows of G x >= h, shape (m,), >= 0.
        active: rows that hold with equality and carry a multiplier, shape (m,).
        objective: 1/2 |A x - b|^2.
        kkt_residual: largest violation of the optimality conditions, relative to |b|.
        duality_gap: primal minus dual objective, relative to the objective.
        condition: condition number of A with columns scaled to unit length.
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


class _Walk(eqx.Module):
    """State of the active-set walk; slot k holds the active row `rows[k]` where `used[k]`."""

    y: Float[Array, " n"]
    multipliers: Float[Array, " n"]
    rows: Int[Array, " n"]
    used: Bool[Array, " n"]
    entering: Int[Array, ""]
    entering_multiplier: Float[Array, ""]
    steps: Int[Array, ""]
    status: Int[Array, ""]
    done: Bool[Array, ""]


def _equality_solve(
    normals: Float[Array, "n n"],
    used: Bool[Array, " n"],
    target: Float[Array, " n"],
    offsets: Float[Array, " n"],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The point y nearest to `target` with normals y = offsets in the used slots.

    Returns:
        (y, multipliers) with y = target + normals^T multipliers; unused slots carry zero.
    """
    n = target.shape[0]
    free = jnp.diag(jnp.where(used, 0.0, 1.0).astype(target.dtype))
    system = jnp.block([[jnp.eye(n, dtype=target.dtype), -normals.T], [normals, free]])
    solved = jnp.linalg.solve(system, jnp.concatenate([target, jnp.where(used, offsets, 0.0)]))
    return solved[:n], solved[n:]


def _walk(
    rows: Float[Array, "m n"], offsets: Float[Array, " m"], centre: Float[Array, " n"]
) -> _Walk:
    """The active set of the projection of `centre` on {y: rows y >= offsets}, rows of unit length."""
    m, n = rows.shape
    eps = float(jnp.finfo(centre.dtype).eps)
    tolerance = 32 * eps * (jnp.linalg.norm(centre) + jnp.max(jnp.abs(offsets)))

    def step(state: _Walk) -> _Walk:
        slack = rows @ state.y - offsets
        # A row that only enters in part (a blocking one had to leave first) stays at hand.
        entering = jnp.where(state.entering >= 0, state.entering, jnp.argmin(slack))
        done = (state.entering < 0) & (slack[entering] >= -tolerance)
        normal = rows[entering]
        normals = jnp.where(state.used[:, None], rows[state.rows], 0.0)
        direction, minus_share = _equality_solve(
            normals, state.used, normal, jnp.zeros_like(normal)
        )
        share = -minus_share
        square = direction @ normal
        independent = (square > 1e4 * eps**1.5) & ~jnp.all(state.used)
        full = jnp.where(
            independent, -slack[entering] / jnp.where(independent, square, 1.0), jnp.inf
        )
        blocks = state.used & (share > eps)
        ratios = jnp.where(blocks, state.multipliers / jnp.where(blocks, share, 1.0), jnp.inf)
        leaving = jnp.argmin(ratios)
        partial = ratios[leaving]
        length = jnp.minimum(full, partial)
        infeasible = jnp.isinf(length) & ~done
        length = jnp.where(jnp.isfinite(length), length, 0.0)
        enters = full <= partial
        slot = jnp.where(enters, jnp.argmin(state.used), leaving)
        entering_multiplier = state.entering_multiplier + length
        multipliers = state.multipliers - length * share
        moved = _Walk(
            y=jnp.where(independent, state.y + length * direction, state.y),
            multipliers=multipliers.at[slot].set(jnp.where(enters, entering_multiplier, 0.0)),
            rows=state.rows.at[slot].set(jnp.where(enters, entering, 0)),
            used=state.used.at[slot].set(enters),
            entering=jnp.where(enters, -1, entering),
            entering_multiplier=jnp.where(enters, 0.0, entering_multiplier),
            steps=state.steps + 1,
            status=state.status,
            done=state.done,
        )
        stop = done | infeasible
        kept = jax.tree.map(lambda old, new: jnp.where(stop, old, new), state, moved)
        status = jnp.where(infeasible, int(Status.INFEASIBLE), state.status)
        return eqx.tree_at(lambda s: (s.status, s.done), kept, (status, stop))

    limit = 20 * n + 20
    start = _Walk(
        y=centre,
        multipliers=jnp.zeros(n, centre.dtype),
        rows=jnp.zeros(n, int),
        used=jnp.zeros(n, bool),
        entering=jnp.array(-1),
        entering_multiplier=jnp.zeros((), centre.dtype),
        steps=jnp.array(0),
        status=jnp.array(int(Status.OPTIMAL)),
        done=jnp.array(m == 0),
    )
    if m == 0:
        return start
    end = jax.lax.while_loop(lambda s: ~s.done & (s.steps < limit), step, start)
    status = jnp.where(end.done, end.status, int(Status.STALLED))
    return eqx.tree_at(lambda s: s.status, end, status)


def _unit_rows(
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
    singular = jnp.linalg.svd(jax.lax.stop_gradient(R), compute_uv=False)
    deficient = singular[-1] <= 10 * max(A.shape) * jnp.finfo(A.dtype).eps * singular[0]
    # A deficient problem is solved as if it were not, so that its lane stays finite until the end.
    R = jnp.where(deficient, jnp.eye(A.shape[1], dtype=R.dtype), R)
    centre = Q.T @ b
    rows, offsets, size = _unit_rows(
        jax.scipy.linalg.solve_triangular(R, (G / scale).T, trans="T").T, h
    )

    walk = _walk(*(jax.lax.stop_gradient(v) for v in (rows, offsets, centre)))
    if G.shape[0]:
        normals = jnp.where(walk.used[:, None], rows[walk.rows], 0.0)
        y, slot_multipliers = _equality_solve(normals, walk.used, centre, offsets[walk.rows])
        multipliers = jnp.zeros(G.shape[0], y.dtype)
        multipliers = multipliers.at[walk.rows].add(jnp.where(walk.used, slot_multipliers, 0.0))
        active = jnp.zeros(G.shape[0], bool).at[walk.rows].max(walk.used)
    else:
        y, multipliers, active = centre, jnp.zeros(0, centre.dtype), jnp.zeros(0, bool)
    x = jax.scipy.linalg.solve_triangular(R, y) / scale

    status = jnp.where(deficient, int(Status.RANK_DEFICIENT), walk.status)
    certificate = _certificate(
        *(jax.lax.stop_gradient(v) for v in (A, b, G, h, x, multipliers / size, R, scale, size))
    )
    return Optimum(
        x=jnp.where(status == int(Status.OPTIMAL), x, jnp.nan),
        multipliers=jax.lax.stop_gradient(multipliers / size),
        active=active,
        condition=singular[0] / singular[-1],
        status=status,
        **certificate,
    )


def _certificate(
    A: Float[Array, "k n"],
    b: Float[Array, " k"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    x: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    R: Float[Array, "n n"],
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
    excess = jax.scipy.linalg.solve_triangular(R, stationarity, trans="T")
    gap = weights @ slack + excess @ excess / 2
    size_b = jnp.linalg.norm(b)
    return {
        "objective": objective,
        "kkt_residual": jnp.max(violations) / jnp.maximum(size_b, tiny),
        "duality_gap": jnp.abs(gap)
        / jnp.maximum(objective, jnp.finfo(b.dtype).eps * size_b**2 + tiny),
    }

"""The convex core: an exact, differentiable solver for small least-squares problems with inequalities.

    minimise 1/2 |A x - b|^2   subject to   G x >= h

The columns are scaled and the rows compressed by one QR factorisation, A = Q R. In terms of y = R x, the
optimum is the point of a polyhedron nearest to Q^T b. A dual active-set method finds this point, starting
at the unconstrained optimum. In each step the most violated row enters the active set, and rows whose
multipliers would change sign leave it. If N contains the normals of the active rows, the inverse of the
optimality system has the blocks

    P = I - N^T (N N^T)^-1 N,   N* = (N N^T)^-1 N.

The method stores both and updates them with a rank-one matrix for each row that enters or leaves.
Derivatives follow from the implicit function theorem applied to the active rows; they are exact if no
multiplier is zero. Every function solves one problem, in float32 or float64; use `jax.vmap` for a batch.

References:
    Goldfarb & Idnani 1983, Mathematical Programming 27, 1-33.
"""

import dataclasses
import enum
import math
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

if TYPE_CHECKING:
    AnyArray = Any  # a JAX or NumPy array
else:
    AnyArray = Array | np.ndarray

_REFINEMENTS = 2
_STEPS = 20  # per unknown; beyond these the method has stalled
_WRITTEN_OUT = 8  # largest triangle inverted without LAPACK, which is called once per batch member


def bucket(count: int, least: int = 8) -> int:
    """Return the power of two to which a size is padded."""
    return max(least, 2 ** math.ceil(math.log2(max(count, 1))))


class Status(enum.IntEnum):
    """Outcome of a quadratic programme; `message` describes it and suggests a remedy."""

    OPTIMAL = 0
    RANK_DEFICIENT = 1
    INFEASIBLE = 2
    STALLED = 3

    @property
    def message(self) -> str:
        """Description of the outcome, with a remedy for a failure."""
        return _MESSAGES[self]


_MESSAGES = {
    Status.OPTIMAL: "the optimum was found and certified",
    Status.RANK_DEFICIENT: (
        "the data do not determine the coefficients separately: use a lower order, fewer "
        "pressure-dependent coefficients, or readings at more lengths"
    ),
    Status.INFEASIBLE: (
        "no coefficients satisfy the constraints: the bounds on the coefficients contradict the "
        "constraint or one another. Widen the bounds or choose a weaker constraint"
    ),
    Status.STALLED: (
        "the solver stalled because its active set kept changing: check for columns of very "
        "different magnitude and for nearly identical constraint rows"
    ),
}


class Optimum(eqx.Module):
    """Optimum of a quadratic programme with its certificate.

    Attributes:
        x: minimiser, shape (n,); nan unless `status` is OPTIMAL.
        multipliers: multipliers of the rows of G x >= h, shape (m,), >= 0.
        active: true for rows that are satisfied with equality and have a multiplier, shape (m,).
        objective: 1/2 |A x - b|^2.
        kkt_residual: largest violation of the optimality conditions, relative to |b|.
        duality_gap: primal minus dual objective, relative to the objective.
        condition: |A| |A^+| in the Frobenius norm with columns scaled to unit length, at most n times
            the ratio of the singular values.
        status: a `Status`.
    """

    x: Float[AnyArray, "*batch n"]
    multipliers: Float[AnyArray, "*batch m"]
    active: Bool[AnyArray, "*batch m"]
    objective: Float[AnyArray, "*batch"]
    kkt_residual: Float[AnyArray, "*batch"]
    duality_gap: Float[AnyArray, "*batch"]
    condition: Float[AnyArray, "*batch"]
    status: Int[AnyArray, "*batch"]


def solve_qp(
    A: Float[AnyArray, "k n"],
    b: Float[AnyArray, " k"],
    G: Float[AnyArray, "m n"],
    h: Float[AnyArray, " m"],
) -> Optimum:
    """Minimise 1/2 |A x - b|^2 subject to G x >= h, and certify the optimum.

    Args:
        A: design matrix, k >= n; each column may have its own unit.
        b: data.
        G: constraint rows; a row of zeros with h <= 0 switches a constraint off.
        h: constraint offsets.

    Returns:
        The optimum. Only `x` is differentiable, with respect to A, b, G and h.

    Raises:
        ValueError: fewer rows than columns in A.

    >>> import numpy as np
    >>> best = solve_qp(np.eye(2), np.array([1.0, -1.0]), np.eye(2), np.zeros(2))
    >>> best.x.tolist(), best.active.tolist()
    ([1.0, 0.0], [False, True])
    """
    if A.shape[0] < A.shape[1]:
        raise ValueError(
            f"A must have at least as many rows as columns, got shape {A.shape}: "
            "use more data points or fewer coefficients"
        )
    given: Any = tuple(jnp.asarray(value) for value in (A, b, G, h))
    A, b, G, h = jax.lax.stop_gradient(given)
    eps, n = float(jnp.finfo(b.dtype).eps), A.shape[1]
    scale = jnp.linalg.norm(A, axis=0)
    scale = jnp.where(scale > 0, scale, 1.0)
    Q, R = orthogonal(A / scale)
    zero = abs(jnp.diagonal(R)) <= eps * jnp.linalg.norm(R)
    inverse = inverse_lower(R.T + jnp.diag(jnp.where(zero, 1.0, 0.0).astype(R.dtype))).T
    condition = jnp.linalg.norm(R) * jnp.linalg.norm(inverse)
    condition = jnp.where(zero.any(), jnp.inf, condition)
    deficient = ~(condition * 10 * max(A.shape) * eps < 1)
    to_x = jnp.where(deficient, jnp.eye(n, dtype=R.dtype), inverse) / scale[:, None]
    normals = G @ to_x
    size = jnp.sqrt(jnp.sum(normals**2, axis=1))
    size = jnp.where(size > 0, size, 1.0)
    near = nearest_point(normals / size[:, None], h / size, Q.T @ b)
    own = size[near.rows] if size.size else jnp.ones(n, b.dtype)
    status = jnp.where(deficient, int(Status.RANK_DEFICIENT), near.status)
    # Comparisons with nan are false, so a constraint that is nan would never bind.
    known = jnp.isfinite(jnp.sum(G) + jnp.sum(h) + jnp.sum(A) + jnp.sum(b))
    status = jnp.where(known, status, int(Status.STALLED))
    x = jnp.where(status == int(Status.OPTIMAL), _on_face(*given, near, to_x, own), jnp.nan)
    multipliers, active = jnp.zeros_like(h), jnp.zeros(h.shape, bool)
    if h.size:
        multipliers = multipliers.at[near.rows].add(near.multipliers / own)
        active = active.at[near.rows].max(near.used)
    still = jax.lax.stop_gradient(x)
    certificate = certificate_of(A, b, G, h, still, multipliers, to_x)
    return Optimum(x, multipliers, active, *certificate, condition, status)


@jax.custom_jvp
def _on_face(
    A: Array, b: Array, G: Array, h: Array, near: "NearestPoint", to_x: Array, own: Array
) -> Float[Array, " n"]:
    """Return the minimiser x = to_x y; `own` contains the lengths of the rows in y by slot."""
    del A, b, G, h, own
    return to_x @ near.y


@_on_face.defjvp
def _on_face_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    A, b, G, _, near, to_x, own = primals
    dA, db, dG, dh, *_ = tangents
    x = to_x @ near.y
    gradient = dA.T @ (A @ x - b) + A.T @ (dA @ x - db)
    push, shift = jnp.zeros_like(x), jnp.zeros_like(x)
    if G.shape[0]:
        rows = jnp.where(near.used[:, None], dG[near.rows], 0.0)
        push = (near.multipliers / own) @ rows
        shift = (jnp.where(near.used, dh[near.rows], 0.0) - rows @ x) / own
    P, pseudo = jnp.split(near.inverse, 2)
    return x, to_x @ (P @ (to_x.T @ (push - gradient)) + shift @ pseudo)


def certificate_of(
    A: Float[Array, "k n"],
    b: Float[Array, " k"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    x: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    to_x: Float[Array, "n n"],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Return the objective, the KKT residual and the duality gap at a point of the original problem.

    Args:
        A: design matrix.
        b: data.
        G: constraint rows.
        h: constraint offsets.
        x: the point.
        multipliers: multipliers of the rows.
        to_x: R^-1 of A = Q R, which scales the rows to the metric of the data.
    """
    tiny, eps = jnp.finfo(b.dtype).tiny, jnp.finfo(b.dtype).eps
    size = jnp.sqrt(jnp.sum((G @ to_x) ** 2, axis=1))
    size = jnp.where(size > 0, size, 1.0)
    scale = jnp.sqrt(jnp.sum(A**2, axis=0))
    scale = jnp.where(scale > 0, scale, 1.0)
    residual = A @ x - b
    slack, weights = (G @ x - h) / size, multipliers * size  # in the metric of the data
    stationarity = A.T @ residual - G.T @ multipliers
    violations = jnp.concatenate(
        [jnp.abs(stationarity) / scale, jnp.maximum(-slack, 0), jnp.maximum(-weights, 0)]
    )
    objective, data = residual @ residual / 2, jnp.linalg.norm(b)
    # primal - dual = multipliers . slack + 1/2 |R^-T stationarity|^2, free of cancellation
    excess = to_x.T @ stationarity
    gap = jnp.abs(weights @ slack + excess @ excess / 2)
    kkt_residual = jnp.max(violations, initial=0.0) / jnp.maximum(data, tiny)
    return objective, kkt_residual, gap / jnp.maximum(objective, eps * data**2 + tiny)


class NearestPoint(eqx.Module):
    """State of the active-set method: the point and its active rows, in n slots.

    Attributes:
        y: the point, shape (n,).
        inverse: P stacked on N* for the active rows, shape (2 n, n).
        multipliers: multipliers of the slots, shape (n,); zero if unused.
        rows: row of G in each slot, shape (n,).
        used: true for slots with an active row, shape (n,).
        entering, entering_multiplier: row that enters next (-1 if none), and its multiplier.
        steps: number of rows that entered or left.
        infeasible: true if no point satisfies the rows.
    """

    y: Float[AnyArray, "*batch n"]
    inverse: Float[AnyArray, "*batch rows n"]
    multipliers: Float[AnyArray, "*batch n"]
    rows: Int[AnyArray, "*batch n"]
    used: Bool[AnyArray, "*batch n"]
    entering: Int[AnyArray, "*batch"]
    entering_multiplier: Float[AnyArray, "*batch"]
    steps: Int[AnyArray, "*batch"]
    infeasible: Bool[AnyArray, "*batch"]

    @property
    def status(self) -> Int[Array, "*batch"]:
        """OPTIMAL, INFEASIBLE or STALLED."""
        status = jnp.where(self.entering < 0, int(Status.OPTIMAL), int(Status.STALLED))
        return jnp.where(self.infeasible, int(Status.INFEASIBLE), status)


def nearest_point(
    G: Float[Array, "m n"], h: Float[Array, " m"], centre: Float[Array, " n"]
) -> NearestPoint:
    """Find the point y nearest to `centre` that satisfies G y >= h.

    This function is not differentiable; `solve_qp` is.

    Args:
        G: constraint rows, of unit length or zero.
        h: offsets; a row of zeros with h <= 0 switches a constraint off.
        centre: c, the unconstrained optimum.
    """
    n, zero = centre.shape[0], jnp.zeros_like(centre)
    eps, unit = float(jnp.finfo(centre.dtype).eps), jnp.eye(n, dtype=centre.dtype)

    def most_violated(y: Float[Array, " n"]) -> Int[Array, ""]:
        """Return the row with the least slack, or -1 if no row is violated."""
        row = jnp.argmin(G @ y - h)
        normal, offset = G[row], h[row]
        size = jnp.sqrt((normal @ normal) * (centre @ centre)) + jnp.abs(offset)
        return jnp.where(normal @ y - offset < -32 * eps * size, row, -1)

    def step(at: NearestPoint) -> NearestPoint:
        """Add one row to the active set, or remove one."""
        normal = G[at.entering]
        image = at.inverse @ normal
        direction, share = image[:n], image[n:]
        square = direction @ normal
        independent = (square > 1e4 * eps**1.5 * (normal @ normal)) & ~jnp.all(at.used)
        missing = h[at.entering] - normal @ at.y
        full = jnp.where(independent, missing / jnp.where(independent, square, 1.0), jnp.inf)
        blocks = at.used & (share > eps)
        ratios = jnp.where(blocks, at.multipliers / jnp.where(blocks, share, 1.0), jnp.inf)
        partial = jnp.min(ratios)
        enters = full <= partial
        infeasible = jnp.isinf(jnp.minimum(full, partial))
        length = jnp.where(infeasible, 0.0, jnp.minimum(full, partial))
        slot = jnp.arange(n) == jnp.where(enters, jnp.argmin(at.used), jnp.argmin(ratios))
        # P and N* change along w, the direction that the row adds to the span or takes from it.
        row = jnp.where(slot, 1.0, 0.0).astype(at.y.dtype) @ at.inverse[n:]
        w = jnp.where(enters, direction, row)
        square = jnp.where(enters, square, row @ row)
        above = jnp.where(enters, direction, -row)
        below = jnp.where(enters, share - slot, at.inverse[n:] @ row)
        change = jnp.concatenate([above, below]) / jnp.where(square > 0, square, 1.0)
        y = at.y + jnp.where(independent, length, 0.0) * direction
        pull = at.entering_multiplier + length
        multipliers = at.multipliers - length * share
        return NearestPoint(
            y=y,
            inverse=at.inverse - change[:, None] * w,
            multipliers=jnp.where(slot, jnp.where(enters, pull, 0.0), multipliers),
            rows=jnp.where(slot, jnp.where(enters, at.entering, 0), at.rows),
            used=jnp.where(slot, enters, at.used),
            # A row whose full step was blocked tries again.
            entering=jnp.where(enters & ~infeasible, most_violated(y), at.entering),
            entering_multiplier=jnp.where(enters, 0.0, pull),
            steps=at.steps + 1,
            infeasible=infeasible,
        )

    start = NearestPoint(
        centre, jnp.concatenate([unit, 0 * unit]), zero, jnp.zeros(n, int), jnp.zeros(n, bool),
        jnp.array(-1), zero.sum(), jnp.array(0), jnp.array(False),
    )  # fmt: skip
    if not G.shape[0]:
        return start
    start = dataclasses.replace(start, entering=most_violated(centre))
    limit = _STEPS * (n + 1)
    found = jax.lax.while_loop(
        lambda at: (at.entering >= 0) & ~at.infeasible & (at.steps < limit), step, start
    )
    # Refine y - N^T l = c and N y = h on the active rows.
    N = jnp.where(found.used[:, None], G[found.rows], 0.0)
    offsets = jnp.where(found.used, h[found.rows], 0.0)
    y, multipliers, P, pseudo = found.y, found.multipliers, found.inverse[:n], found.inverse[n:]
    for _ in range(_REFINEMENTS):
        dual, along = centre + multipliers @ N - y, (offsets - N @ y) @ pseudo
        y = y + P @ dual + along
        multipliers = multipliers + pseudo @ (along - dual)
    return dataclasses.replace(found, y=y, multipliers=multipliers)


def orthogonal(
    A: Float[Array, "k n"],
) -> tuple[Float[Array, "k n"], Float[Array, "n n"]]:
    """Return Q and R of A = Q R; for few columns, by applying Gram-Schmidt twice (Giraud et al. 2005).

    LAPACK is equally accurate, but takes 0.3 s to load.
    """
    n = A.shape[1]
    if n > _WRITTEN_OUT:
        return jnp.linalg.qr(A)
    found, rows = jnp.zeros((0, A.shape[0]), A.dtype), []
    for j in range(n):
        rest, shares = A[:, j], jnp.zeros(j, A.dtype)
        for _ in range(2 * (j > 0)):
            share = found @ rest
            rest, shares = rest - share @ found, shares + share
        size = jnp.sqrt(rest @ rest)
        found = jnp.concatenate([found, (rest / jnp.where(size > 0, size, 1.0))[None]])
        rows.append(jnp.concatenate([shares, size[None], jnp.zeros(n - 1 - j, A.dtype)]))
    return found.T, jnp.stack(rows, axis=1)


def inverse_lower(
    lower: Float[AnyArray, "*batch n n"],
) -> Float[AnyArray, "*batch n n"]:
    """Invert a lower triangular matrix that has no zeros on its diagonal."""
    n = lower.shape[-1]
    if n > _WRITTEN_OUT:
        return jnp.linalg.inv(lower)
    unit, rows = np.eye(n, dtype=lower.dtype), []
    for i in range(n):
        known = sum((lower[..., i, j, None] * rows[j] for j in range(i)), start=0.0)
        rows.append((unit[i] - known) / lower[..., i, i, None])
    return jnp.stack(rows, axis=-2)

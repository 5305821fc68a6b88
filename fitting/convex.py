"""The convex core: least squares under linear inequalities, exact, small and differentiable.

    minimise 1/2 |A x - b|^2   subject to   G x >= h

The columns are scaled, the rows compressed by one QR factorisation A = Q R, and in y = R x the
optimum is the point of a polyhedron nearest to Q^T b. A dual active-set method finds it: it starts at
the unconstrained optimum, the most violated row enters, and rows whose multiplier would change its
sign leave. With N the normals of the active rows it keeps

    P = I - N^T (N N^T)^-1 N,   N* = (N N^T)^-1 N,

the blocks of the inverse of the optimality system, and each row that enters or leaves is one
rank-one update of both. The derivative is that of the implicit function theorem on the active rows,
exact while the active set is strict. Every function takes one problem, in float32 or float64:
`jax.vmap` makes a batch of it.

References:
    Goldfarb & Idnani 1983, Mathematical Programming 27, 1-33.
"""

import enum
import math
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

if TYPE_CHECKING:
    AnyArray = Any  # of JAX or NumPy, which no checker can know
else:
    AnyArray = Array | np.ndarray

_REFINEMENTS = 2
_WRITTEN_OUT = (
    8  # largest triangle that is written out: LAPACK is called once per member of a batch
)


def bucket(count: int, least: int = 8) -> int:
    """The size to which a shape is padded: a power of two."""
    return max(least, 2 ** math.ceil(math.log2(max(count, 1))))


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
        condition: |A| |A^+| in the Frobenius norm, with columns scaled to unit length; at most n
            times the ratio of the singular values.
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
    given: Any = tuple(jnp.asarray(value) for value in (A, b, G, h))
    face, condition, status = jax.lax.stop_gradient(_active_face(*given))
    x = jnp.where(status == int(Status.OPTIMAL), _on_face(*given, face), jnp.nan)
    multipliers, active = jnp.zeros_like(given[3]), jnp.zeros(given[3].shape, bool)
    if given[3].size:
        multipliers = multipliers.at[face.rows].add(face.multipliers)
        active = active.at[face.rows].max(face.used)
    A, b, G, h, still = jax.lax.stop_gradient((*given, x))
    certificate = certificate_of(A, b, G, h, still, multipliers, face.to_x)
    return Optimum(x, multipliers, active, *certificate, condition, status)


class _Face(eqx.Module):
    """The face on which an optimum lies: x = to_x y; slots of rows, with P above N* (`inverse`).

    Attributes:
        x, to_x: shapes (n,) and (n, n).
        inverse: of the unit normals in y, shape (2 n, n).
        multipliers, rows, used, size: of the slots; `size` is the length of a row in y, shape (n,).
    """

    x: Float[Array, " n"]
    to_x: Float[Array, "n n"]
    inverse: Float[Array, "rows n"]
    multipliers: Float[Array, " n"]
    rows: Int[Array, " n"]
    used: Bool[Array, " n"]
    size: Float[Array, " n"]


def _active_face(
    A: Float[Array, "k n"], b: Float[Array, " k"], G: Float[Array, "m n"], h: Float[Array, " m"]
) -> tuple[_Face, Float[Array, ""], Int[Array, ""]]:
    """The face of the optimum, the condition of A, and the status."""
    n = A.shape[1]
    scale = jnp.linalg.norm(A, axis=0)
    scale = jnp.where(scale > 0, scale, 1.0)
    Q, R = jnp.linalg.qr(A / scale)
    J, condition, deficient = inverse_upper(R, max(A.shape))
    to_x = J / scale[:, None]
    normals = G @ to_x
    size = jnp.sqrt(jnp.sum(normals**2, axis=1))
    size = jnp.where(size > 0, size, 1.0)
    near = nearest_point(normals / size[:, None], h / size, Q.T @ b)
    own = size[near.rows] if size.size else jnp.ones(n, b.dtype)
    face = _Face(
        to_x @ near.y, to_x, near.inverse, near.multipliers / own, near.rows, near.used, own
    )
    status = jnp.where(deficient, int(Status.RANK_DEFICIENT), near.status)
    # Comparisons with nan are all false: a constraint that has no number would bind nowhere.
    known = jnp.isfinite(jnp.sum(G) + jnp.sum(h) + jnp.sum(A) + jnp.sum(b))
    return face, condition, jnp.where(known, status, int(Status.STALLED))


@jax.custom_jvp
def _on_face(A: Array, b: Array, G: Array, h: Array, face: _Face) -> Float[Array, " n"]:
    """The minimiser on its face."""
    del A, b, G, h
    return face.x


@_on_face.defjvp
def _on_face_jvp(primals: tuple, tangents: tuple) -> tuple[Array, Array]:
    A, b, G, _, face = primals
    dA, db, dG, dh, _ = tangents
    n, x = face.x.shape[0], face.x
    gradient = dA.T @ (A @ x - b) + A.T @ (dA @ x - db)
    push, shift = jnp.zeros_like(x), jnp.zeros_like(x)
    if G.shape[0]:
        rows = jnp.where(face.used[:, None], dG[face.rows], 0.0)
        push = face.multipliers @ rows
        shift = (jnp.where(face.used, dh[face.rows], 0.0) - rows @ x) / face.size
    P, pseudo = face.inverse[:n], face.inverse[n:]
    return x, face.to_x @ (P @ (face.to_x.T @ (push - gradient)) + shift @ pseudo)


def certificate_of(
    A: Float[Array, "k n"],
    b: Float[Array, " k"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    x: Float[Array, " n"],
    multipliers: Float[Array, " m"],
    to_x: Float[Array, "n n"],
) -> tuple[Float[Array, ""], Float[Array, ""], Float[Array, ""]]:
    """Objective, KKT residual and duality gap of a point, on the problem as it was given.

    Args:
        A: of the programme.
        b: likewise.
        G: likewise.
        h: likewise.
        x: the point.
        multipliers: of the rows.
        to_x: R^-1 of A = Q R, by which the rows are measured in the metric of the data.
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
    """The point, and the rows that hold it; slot k has the row `rows[k]` where `used[k]`.

    Attributes:
        y: the point, shape (n,).
        multipliers: of the slots, shape (n,), zero where not used.
        rows: indices into G, shape (n,).
        used: shape (n,).
        steps: rows that entered or left.
        status: OPTIMAL, INFEASIBLE or STALLED.
        inverse: P above N* of the active rows, shape (2 n, n).
    """

    y: Float[AnyArray, "*batch n"]
    multipliers: Float[AnyArray, "*batch n"]
    rows: Int[AnyArray, "*batch n"]
    used: Bool[AnyArray, "*batch n"]
    steps: Int[AnyArray, "*batch"]
    status: Int[AnyArray, "*batch"]
    inverse: Float[AnyArray, "*batch rows n"]


def nearest_point(
    G: Float[Array, "m n"], h: Float[Array, " m"], centre: Float[Array, " n"]
) -> NearestPoint:
    """The point y nearest to `centre` with G y >= h.

    Args:
        G: constraint rows, of unit length or zero.
        h: offsets; a row of zeros with h <= 0 is off.
        centre: c, the unconstrained optimum.

    Returns:
        The point. `y` and `multipliers` may be differentiated in every argument.
    """
    of = _Polyhedron(G, h, centre)
    return of.finish(of.advance(of.start()))


class _Walk(eqx.Module):
    """State of the walk: P above N*, and the row that is about to enter, -1 when none is."""

    y: Float[Array, "*batch n"]
    inverse: Float[Array, "*batch rows n"]
    multipliers: Float[Array, "*batch n"]
    rows: Int[Array, "*batch n"]
    used: Bool[Array, "*batch n"]
    entering: Int[Array, "*batch"]
    entering_multiplier: Float[Array, "*batch"]
    steps: Int[Array, "*batch"]
    infeasible: Bool[Array, "*batch"]

    @property
    def arrived(self) -> Bool[Array, "*batch"]:
        """Whether nothing is left to do."""
        return (self.entering < 0) | self.infeasible


class _Polyhedron(eqx.Module):
    """A polyhedron and a point, and the walk through active sets to the nearest one."""

    G: Float[Array, "m n"]
    h: Float[Array, " m"]
    centre: Float[Array, " n"]

    @property
    def limit(self) -> int:
        """Number of steps after which a walk has stalled."""
        return 20 * self.centre.shape[0] + 20

    def most_violated(self, y: Float[Array, " n"]) -> Int[Array, ""]:
        """The row with the least slack, or -1 where none is violated."""
        row = jnp.argmin(self.G @ y - self.h)
        normal, offset = self.G[row], self.h[row]
        size = jnp.sqrt((normal @ normal) * (self.centre @ self.centre)) + jnp.abs(offset)
        noise = 32 * jnp.finfo(y.dtype).eps * size
        return jnp.where(normal @ y - offset < -noise, row, -1)

    def start(self) -> _Walk:
        """The unconstrained optimum, with no active row."""
        of = jax.lax.stop_gradient(self)
        n, zero = self.centre.shape[0], jnp.zeros_like(of.centre)
        unit = jnp.eye(n, dtype=zero.dtype)
        return _Walk(
            y=of.centre,
            inverse=jnp.concatenate([unit, jnp.zeros_like(unit)]),
            multipliers=zero,
            rows=jnp.zeros(n, int),
            used=jnp.zeros(n, bool),
            entering=of.most_violated(of.centre) if self.G.shape[0] else jnp.array(-1),
            entering_multiplier=jnp.zeros((), zero.dtype),
            steps=jnp.array(0),
            infeasible=jnp.array(False),
        )

    def advance(self, walk: _Walk) -> _Walk:
        """The walk after its last step, or after `limit` steps."""
        of = jax.lax.stop_gradient(self)
        return jax.lax.while_loop(
            lambda at: ~at.arrived & (at.steps < of.limit),
            lambda at: of._step(at),  # noqa: PLW0108 -- a bound method of arrays has no hash
            jax.lax.stop_gradient(walk),
        )

    def _step(self, at: _Walk) -> _Walk:
        """One row enters or leaves."""
        n, eps = at.y.shape[0], float(jnp.finfo(at.y.dtype).eps)
        normal = self.G[at.entering]
        image = at.inverse @ normal
        direction, share = image[:n], image[n:]
        square = direction @ normal
        independent = (square > 1e4 * eps**1.5 * (normal @ normal)) & ~jnp.all(at.used)
        missing = self.h[at.entering] - normal @ at.y
        full = jnp.where(independent, missing / jnp.where(independent, square, 1.0), jnp.inf)
        blocks = at.used & (share > eps)
        ratios = jnp.where(blocks, at.multipliers / jnp.where(blocks, share, 1.0), jnp.inf)
        partial = jnp.min(ratios)
        enters = full <= partial
        infeasible = jnp.isinf(jnp.minimum(full, partial))
        length = jnp.where(infeasible, 0.0, jnp.minimum(full, partial))
        slot = jnp.arange(n) == jnp.where(enters, jnp.argmin(at.used), jnp.argmin(ratios))
        # P and N* change along w: what the entering row adds to the span, or the leaving one takes.
        row = jnp.where(slot, 1.0, 0.0).astype(at.y.dtype) @ at.inverse[n:]
        w = jnp.where(enters, direction, row)
        w_square = jnp.where(enters, square, row @ row)
        change = jnp.concatenate(
            [
                jnp.where(enters, direction, -row),
                jnp.where(enters, share - slot, at.inverse[n:] @ row),
            ]
        )
        change = change / jnp.where(w_square > 0, w_square, 1.0)
        y = at.y + jnp.where(independent, length, 0.0) * direction
        entering_multiplier = at.entering_multiplier + length
        multipliers = at.multipliers - length * share
        return _Walk(
            y=y,
            inverse=at.inverse - change[:, None] * w,
            multipliers=jnp.where(slot, jnp.where(enters, entering_multiplier, 0.0), multipliers),
            rows=jnp.where(slot, jnp.where(enters, at.entering, 0), at.rows),
            used=jnp.where(slot, enters, at.used),
            # A row that a blocking one kept from entering in full stays at hand.
            entering=jnp.where(enters & ~infeasible, self.most_violated(y), at.entering),
            entering_multiplier=jnp.where(enters, 0.0, entering_multiplier),
            steps=at.steps + 1,
            infeasible=infeasible,
        )

    def finish(self, walk: _Walk) -> NearestPoint:
        """The point that the active set of the walk stands for."""
        if self.G.shape[0]:
            normals = self.G[walk.rows]
            y, multipliers = _refined(
                jnp.where(walk.used[:, None], normals, 0.0),
                jnp.where(walk.used, self.h[walk.rows], 0.0),
                self.centre,
                (walk.y, walk.multipliers, walk.inverse),
            )
        else:
            y, multipliers = self.centre, walk.multipliers
        status = jnp.where(walk.arrived, int(Status.OPTIMAL), int(Status.STALLED))
        status = jnp.where(walk.infeasible, int(Status.INFEASIBLE), status)
        return NearestPoint(y, multipliers, walk.rows, walk.used, walk.steps, status, walk.inverse)


@jax.custom_jvp
def _refined(
    normals: Float[Array, "n n"],
    offsets: Float[Array, " n"],
    centre: Float[Array, " n"],
    near: tuple[Float[Array, " n"], Float[Array, " n"], Float[Array, "rows n"]],
) -> tuple[Float[Array, " n"], Float[Array, " n"]]:
    """The y and l of y - N^T l = c, N y = h, where unused slots hold zeros.

    `near` has y and l as the walk has found them, which are refined here, and its inverse (P, N*).
    """
    n = centre.shape[0]
    y, multipliers, inverse = near
    P, pseudo = inverse[:n], inverse[n:]
    for _ in range(_REFINEMENTS):
        dual = centre + multipliers @ normals - y
        along = (offsets - normals @ y) @ pseudo
        y = y + P @ dual + along
        multipliers = multipliers + pseudo @ (along - dual)
    return y, multipliers


@_refined.defjvp
def _refined_jvp(primals: tuple, tangents: tuple) -> tuple:
    normals, offsets, centre, near = primals
    d_normals, d_offsets, d_centre, _ = tangents
    y, multipliers = _refined(normals, offsets, centre, near)
    n = centre.shape[0]
    free = jnp.diag(jnp.where(jnp.any(normals != 0, axis=1), 0.0, 1.0).astype(centre.dtype))
    system = jnp.block([[jnp.eye(n, dtype=centre.dtype), -normals.T], [normals, free]])
    change = jnp.linalg.solve(
        system,
        jnp.concatenate([d_centre + d_normals.T @ multipliers, d_offsets - d_normals @ y]),
    )
    return (y, multipliers), (change[:n], change[n:])


def cholesky(
    matrix: Float[AnyArray, "*batch n n"],
) -> Float[AnyArray, "*batch n n"]:
    """The lower triangle L with L L^T = matrix; nan where the matrix is not positive definite."""
    n = matrix.shape[-1]
    if n > _WRITTEN_OUT:
        return jnp.linalg.cholesky(matrix)
    index, rest, columns = np.arange(n), matrix, []
    for j in range(n):
        column = jnp.where(index >= j, rest[..., j] / jnp.sqrt(rest[..., j, j])[..., None], 0.0)
        rest = rest - column[..., :, None] * column[..., None, :]
        columns.append(column)
    return jnp.stack(columns, axis=-1)


def inverse_lower(
    lower: Float[AnyArray, "*batch n n"],
) -> Float[AnyArray, "*batch n n"]:
    """The inverse of a lower triangle with a diagonal without zeros."""
    n = lower.shape[-1]
    if n > _WRITTEN_OUT:
        return jnp.linalg.inv(lower)
    unit, rows = np.eye(n, dtype=lower.dtype), []
    for i in range(n):
        known = sum((lower[..., i, j, None] * rows[j] for j in range(i)), start=0.0)
        rows.append((unit[i] - known) / lower[..., i, i, None])
    return jnp.stack(rows, axis=-2)


def inverse_upper(
    R: Float[AnyArray, "*batch n n"], size: int
) -> tuple[
    Float[AnyArray, "*batch n n"],
    Float[AnyArray, "*batch"],
    Bool[AnyArray, "*batch"],
]:
    """The inverse of an upper triangle, its condition number, and whether it is singular.

    A singular one is replaced by the identity, so that its part of a batch stays finite.

    Args:
        R: with columns of unit length.
        size: the larger dimension of the matrix whose factor it is, for the rounding.
    """
    eps = float(jnp.finfo(R.dtype).eps)
    still = jax.lax.stop_gradient(R)
    unit, both = np.eye(R.shape[-1], dtype=R.dtype), (-2, -1)
    norm = jnp.sqrt(jnp.sum(still**2, axis=both))
    zero = abs(jnp.diagonal(still, axis1=-2, axis2=-1)) <= eps * norm[..., None]
    trial = inverse_lower(
        jnp.swapaxes(still, *both) + unit * jnp.where(zero, 1.0, 0.0)[..., None, :]
    )
    condition = norm * jnp.sqrt(jnp.sum(trial**2, axis=both))
    condition = jnp.where(zero.any(axis=-1), jnp.inf, condition)
    deficient = ~(condition * 10 * size * eps < 1)
    # The trial of a singular one may overflow, and so would its derivative.
    R = jnp.where(deficient[..., None, None], unit, R)
    return jnp.swapaxes(inverse_lower(jnp.swapaxes(R, *both)), *both), condition, deficient

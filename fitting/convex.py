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

import dataclasses
import enum
import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from famjax.compile_options import quick_options

if TYPE_CHECKING:
    AnyArray = Any  # of JAX or NumPy, which no checker can know
else:
    AnyArray = Array | np.ndarray

_REFINEMENTS = 2
_PARALLEL = 1e-8  # squared sine of the angle to the other rows below which no guess is trusted
_CHUNK = 500  # members whose state fits the cache together
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
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    centre: Float[Array, " n"],
    J: Float[Array, "n n"] | None = None,
    guess: tuple[Int[Array, " n"], Bool[Array, " n"]] | None = None,
) -> NearestPoint:
    """The point y nearest to `centre` with G J y >= h.

    Args:
        G: constraint rows, of unit length or zero; members of a batch may share them.
        h: offsets; a row of zeros with h <= 0 is off.
        centre: c, the unconstrained optimum.
        J: well-conditioned; None for the identity.
        guess: `rows` and `used` of a neighbouring problem's point, from which to start.

    Returns:
        The point. `y` and `multipliers` may be differentiated in every argument.
    """
    of = _Polyhedron(G, h, centre, J)
    return of.finish(of.advance(of.start() if guess is None else of.start_from(*guess), of.limit))


def nearest_points(
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    centre: Float[Array, "batch n"],
    J: Float[Array, "batch n n"],
    guess: tuple[Int[Array, "*batch n"], Bool[Array, "*batch n"]] | None = None,
) -> NearestPoint:
    """Many points of one polyhedron: `nearest_point` over a batch that shares its rows.

    A batch walks as long as its slowest member. So all take a few steps, in chunks that fit the
    cache, and those that have not arrived are then put together.

    Args:
        G: constraint rows, of unit length or zero.
        h: offsets.
        centre: c of each member.
        J: of each member, well-conditioned.
        guess: `rows` and `used` of a neighbouring problem's point, from which all start, or of one
            for each.

    Returns:
        The points, with a leading axis.
    """
    count, n = centre.shape
    chunk = min(count, _CHUNK)
    padded = -(-count // chunk) * chunk
    members = jnp.minimum(jnp.arange(padded), count - 1)
    centre, J = centre[members], J[members]

    def in_chunks(function: Callable[..., PyTree], *leaves: PyTree) -> PyTree:
        def one(chunk: PyTree) -> PyTree:
            return jax.vmap(lambda c, J, *rest: function(_Polyhedron(G, h, c, J), *rest))(*chunk)

        split = jax.tree.map(lambda leaf: leaf.reshape(-1, chunk, *leaf.shape[1:]), leaves)
        done = jax.lax.map(one, split)
        return jax.tree.map(lambda leaf: leaf.reshape(padded, *leaf.shape[2:]), done)

    def first(of: "_Polyhedron", *own: Array) -> _Walk:
        return of.advance(of.start() if guess is None else of.start_from(*(own or guess)), n)

    own = () if guess is None or guess[0].ndim == 1 else (each[members] for each in guess)
    walk = in_chunks(first, centre, J, *own)
    slow_first = jnp.argsort(walk.arrived)
    at = jax.tree.map(lambda leaf: leaf[slow_first], (centre, J, walk))
    points = in_chunks(lambda of, walk: of.finish(of.advance(walk, of.limit)), *at)
    return jax.tree.map(lambda leaf: leaf[jnp.argsort(slow_first)[:count]], points)


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
    J: Float[Array, "n n"] | None

    @property
    def limit(self) -> int:
        """Number of steps after which a walk has stalled."""
        return 20 * self.centre.shape[0] + 20

    def normal(self, row: Int[Array, ""]) -> Float[Array, " n"]:
        """A row as a normal in y."""
        return self.G[row] if self.J is None else self.J.T @ self.G[row]

    def normals(self, rows: Int[Array, " k"]) -> Float[Array, "k n"]:
        """Rows as normals in y."""
        return self.G[rows] if self.J is None else self.G[rows] @ self.J

    def most_violated(self, y: Float[Array, " n"]) -> Int[Array, ""]:
        """The row with the least slack, or -1 where none is violated."""
        x = y if self.J is None else self.J @ y
        row = jnp.argmin(self.G @ x - self.h)
        normal, offset = self.normal(row), self.h[row]
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

    def start_from(self, rows: Int[Array, " n"], used: Bool[Array, " n"]) -> _Walk:
        """The optimum on the face of the given rows if it is dual feasible, else `start`."""
        of = jax.lax.stop_gradient(self)
        cold, n = self.start(), self.centre.shape[0]
        normals = jnp.where(used[:, None], of.normals(rows), 0.0)

        def enter(
            k: Int[Array, ""], at: tuple[Float[Array, "rows n"], Bool[Array, ""]]
        ) -> tuple[Float[Array, "rows n"], Bool[Array, ""]]:
            inverse, valid = at
            image = inverse @ normals[k]
            square = image[:n] @ normals[k]
            parallel = used[k] & (square <= _PARALLEL * (normals[k] @ normals[k]))
            change = image - jnp.where(jnp.arange(2 * n) == n + k, used[k], 0.0)
            change = change / jnp.where(square > 0, square, 1.0)
            return inverse - change[:, None] * image[:n], valid & ~parallel

        inverse, valid = jax.lax.fori_loop(0, n, enter, (cold.inverse, jnp.array(True)))
        step = (jnp.where(used, of.h[rows], 0.0) - normals @ of.centre) @ inverse[n:]
        multipliers = jnp.where(used, inverse[n:] @ step, 0.0)
        valid &= jnp.all(multipliers >= 0)
        y = of.centre + step
        warm = dataclasses.replace(
            cold,
            y=y,
            inverse=inverse,
            multipliers=multipliers,
            rows=jnp.where(used, rows, 0),
            used=used,
            entering=of.most_violated(y),
        )
        return jax.tree.map(lambda w, c: jnp.where(valid, w, c), warm, cold)

    def advance(self, walk: _Walk, limit: int) -> _Walk:
        """The walk after its last step, or after `limit` steps in all."""
        of = jax.lax.stop_gradient(self)
        return jax.lax.while_loop(
            lambda at: ~at.arrived & (at.steps < limit),
            lambda at: of._step(at),  # noqa: PLW0108 -- a bound method of arrays has no hash
            jax.lax.stop_gradient(walk),
        )

    def _step(self, at: _Walk) -> _Walk:
        """One row enters or leaves."""
        n, eps = at.y.shape[0], float(jnp.finfo(at.y.dtype).eps)
        normal = self.normal(at.entering)
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
            normals = self.normals(walk.rows)
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
    xp, n = matrix.__array_namespace__(), matrix.shape[-1]
    if n > _WRITTEN_OUT:
        return xp.linalg.cholesky(matrix)
    index, rest, columns = np.arange(n), matrix, []
    for j in range(n):
        column = xp.where(index >= j, rest[..., j] / xp.sqrt(rest[..., j, j])[..., None], 0.0)
        rest = rest - column[..., :, None] * column[..., None, :]
        columns.append(column)
    return xp.stack(columns, axis=-1)


def inverse_lower(
    lower: Float[AnyArray, "*batch n n"],
) -> Float[AnyArray, "*batch n n"]:
    """The inverse of a lower triangle with a diagonal without zeros."""
    xp, n = lower.__array_namespace__(), lower.shape[-1]
    if n > _WRITTEN_OUT:
        return xp.linalg.inv(lower)
    unit, rows = np.eye(n, dtype=lower.dtype), []
    for i in range(n):
        known = sum((lower[..., i, j, None] * rows[j] for j in range(i)), start=0.0)
        rows.append((unit[i] - known) / lower[..., i, i, None])
    return xp.stack(rows, axis=-2)


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
    xp, eps = R.__array_namespace__(), float(jnp.finfo(R.dtype).eps)
    still = R if isinstance(R, np.ndarray) else jax.lax.stop_gradient(R)
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


def nearest_points_of_each(
    G: Float[AnyArray, "batch m n"],
    centre: Float[AnyArray, "batch n"],
    J: Float[AnyArray, "batch n n"],
    guess: tuple[Int[AnyArray, "batch n"], Bool[AnyArray, "batch n"]] | None,
) -> NearestPoint:
    """The points of cones G J y >= 0, each its own; of NumPy's arrays by a program for many sizes.

    Args:
        G: constraint rows, of unit length or zero.
        centre: c of each member.
        J: of each member, well-conditioned.
        guess: `rows` and `used` of neighbouring problems' points.

    Returns:
        The points, with a leading axis; NumPy's arrays of NumPy's.
    """
    if not isinstance(centre, np.ndarray):
        return _in_cones(G, centre, J, guess)
    count, m, n = G.shape
    members, rows = bucket(count, 16), bucket(m, 32)
    every = np.minimum(np.arange(members), count - 1)
    padded = np.zeros((members, rows, n))
    padded[:, :m] = G[every]
    none = np.zeros((members, n), int), np.zeros((members, n), bool)
    own = none if guess is None else tuple(np.asarray(one)[every] for one in guess)
    found = _cones_program()(padded, centre[every], J[every], own)
    return jax.tree.map(lambda leaf: np.asarray(leaf)[:count], found)


def _in_cones(G: Any, centre: Any, J: Any, guess: Any) -> NearestPoint:
    h = jnp.where(jnp.any(G != 0, axis=2), 0.0, -1.0)
    return jax.vmap(nearest_point)(G, h, centre, J, guess)


@functools.cache
def _cones_program() -> Any:
    return jax.jit(_in_cones, compiler_options=quick_options())

"""The point of a polyhedron nearest to a given one: a dual active-set method for small problems.

    minimise 1/2 |y - c|^2   subject to   G J y >= h

The walk of Goldfarb & Idnani starts at c and lets the most violated row enter; rows whose
multiplier would change its sign leave. With N the normals of the active rows it keeps

    P = I - N^T (N N^T)^-1 N,   N* = (N N^T)^-1 N,

the blocks of the inverse of the optimality system, and each row that enters or leaves is one
rank-one update of both. Nothing is factorised, so a batch is code without calls. At the end y and
the multipliers are refined on the equations of the last active set. Those equations are what gets
differentiated: the implicit function theorem, exact while the active set is strict.

References:
    Goldfarb & Idnani 1983, Mathematical Programming 27, 1-33.
"""

import dataclasses
from collections.abc import Callable

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, PyTree

from .arrays import AnyArray
from .host_qp import nearest_points as nearest_points_on_host
from .status import Status

_REFINEMENTS = 2
_PARALLEL = 1e-8  # squared sine of the angle to the other rows below which no guess is trusted
_CHUNK = 500  # members whose state fits the cache together


class NearestPoint(eqx.Module):
    """The point, and the rows that hold it; slot k has the row `rows[k]` where `used[k]`.

    Attributes:
        y: the point, shape (n,).
        multipliers: of the slots, shape (n,), zero where not used.
        rows: indices into G, shape (n,).
        used: shape (n,).
        steps: rows that entered or left.
        status: OPTIMAL, INFEASIBLE or STALLED.
    """

    y: Float[AnyArray, "*batch n"]
    multipliers: Float[AnyArray, "*batch n"]
    rows: Int[AnyArray, "*batch n"]
    used: Bool[AnyArray, "*batch n"]
    steps: Int[AnyArray, "*batch"]
    status: Int[AnyArray, "*batch"]


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
    of = _Programme(G, h, centre, J)
    walk = of.start() if guess is None else of.start_from(*guess)
    return of.finish(of.advance(walk, of.limit))


def nearest_points(
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    centre: Float[Array, "batch n"],
    J: Float[Array, "batch n n"],
    guess: tuple[Int[Array, "*batch n"], Bool[Array, "*batch n"]] | None = None,
    *,
    single: bool = False,
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
        single: walk in float32, then go on from there in the precision of what is given. For
            devices that compute slowly in float64; the points are the same to rounding.

    Returns:
        The points, with a leading axis.
    """
    count, n = centre.shape
    if single:
        G4, h4, centre4, J4 = (array.astype(jnp.float32) for array in (G, h, centre, J))
        near = nearest_points(G4, h4, centre4, J4, guess)
        guess = near.rows, near.used
    chunk = min(count, _CHUNK)
    padded = -(-count // chunk) * chunk
    members = jnp.minimum(jnp.arange(padded), count - 1)
    centre, J = centre[members], J[members]

    def in_chunks(function: Callable[..., PyTree], *leaves: PyTree) -> PyTree:
        def one(chunk: PyTree) -> PyTree:
            return jax.vmap(lambda c, J, *rest: function(_Programme(G, h, c, J), *rest))(*chunk)

        split = jax.tree.map(lambda leaf: leaf.reshape(-1, chunk, *leaf.shape[1:]), leaves)
        done = jax.lax.map(one, split)
        return jax.tree.map(lambda leaf: leaf.reshape(padded, *leaf.shape[2:]), done)

    def first(of: "_Programme", *own: Array) -> _Walk:
        return of.advance(of.start() if guess is None else of.start_from(*(own or guess)), n)

    own = () if guess is None or guess[0].ndim == 1 else (each[members] for each in guess)
    walk = in_chunks(first, centre, J, *own)
    slow_first = jnp.argsort(walk.arrived)
    at = jax.tree.map(lambda leaf: leaf[slow_first], (centre, J, walk))
    points = in_chunks(lambda of, walk: of.finish(of.advance(walk, of.limit)), *at)
    return jax.tree.map(lambda leaf: leaf[jnp.argsort(slow_first)[:count]], points)


def nearest_of_each(
    G: Float[AnyArray, "batch m n"],
    centre: Float[AnyArray, "batch n"],
    J: Float[AnyArray, "batch n n"],
    guess: tuple[Int[AnyArray, "batch n"], Bool[AnyArray, "batch n"]] | None,
) -> NearestPoint:
    """The points of cones G J y >= 0, each its own: by JAX, or of NumPy's arrays on the host.

    Args:
        G: constraint rows, of unit length or zero.
        centre: c of each member.
        J: of each member, well-conditioned.
        guess: `rows` and `used` of neighbouring problems' points.

    Returns:
        The points, with a leading axis.
    """
    if not isinstance(centre, np.ndarray):
        h = jnp.where(jnp.any(G != 0, axis=2), 0.0, -1.0)
        return jax.vmap(nearest_point)(G, h, centre, J, guess)
    shape = centre.shape
    guesses = None if guess is None else [rows[used] for rows, used in zip(*guess, strict=True)]
    y, active, held, status = nearest_points_on_host(G, np.zeros(G.shape[:2]), centre, J, guesses)
    multipliers, rows, used = np.zeros(shape), np.zeros(shape, int), np.zeros(shape, bool)
    for one, (own, push) in enumerate(zip(active, held, strict=True)):
        rows[one, : own.size], multipliers[one, : own.size] = own, push
        used[one, : own.size] = True
    return NearestPoint(y, multipliers, rows, used, used.sum(axis=1), status)


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


class _Programme(eqx.Module):
    """One programme, and the walk through its active sets."""

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
            y, multipliers = _on_face(
                jnp.where(walk.used[:, None], normals, 0.0),
                jnp.where(walk.used, self.h[walk.rows], 0.0),
                self.centre,
                (walk.y, walk.multipliers, walk.inverse),
            )
        else:
            y, multipliers = self.centre, walk.multipliers
        status = jnp.where(walk.arrived, int(Status.OPTIMAL), int(Status.STALLED))
        status = jnp.where(walk.infeasible, int(Status.INFEASIBLE), status)
        return NearestPoint(y, multipliers, walk.rows, walk.used, walk.steps, status)


@jax.custom_jvp
def _on_face(
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


@_on_face.defjvp
def _on_face_jvp(primals: tuple, tangents: tuple) -> tuple:
    normals, offsets, centre, near = primals
    d_normals, d_offsets, d_centre, _ = tangents
    y, multipliers = _on_face(normals, offsets, centre, near)
    n = centre.shape[0]
    free = jnp.diag(jnp.where(jnp.any(normals != 0, axis=1), 0.0, 1.0).astype(centre.dtype))
    system = jnp.block([[jnp.eye(n, dtype=centre.dtype), -normals.T], [normals, free]])
    change = jnp.linalg.solve(
        system,
        jnp.concatenate([d_centre + d_normals.T @ multipliers, d_offsets - d_normals @ y]),
    )
    return (y, multipliers), (change[:n], change[n:])

"""One fit of a sweep as masks of a padded problem, whitened.

A fit that is free in pressure is one small problem per pressure; one that is fixed or linear in
pressure couples them, with the coefficients at the lowest and the highest pressure as unknowns. A
lower order, a fixed law and each constraint are masks.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from .._convex.constraint import Constraint
from .._convex.objectives import AbstractObjective, Huber, MeanRmse, SumOfSquares
from .._convex.path_functions import AbstractPathFunctions
from ..engine.qp import inverse_upper
from .forms import CONSTRAINTS, DEPENDENCES, HUBER, NORMAL_MAD
from .problem import Design, compressed


class Unknowns(eqx.Module):
    """What a fit solves for, before any constraint: masks of a padded problem, whitened.

    Attributes:
        paths: indices of its pressures.
        factor: of its pressures, shape (paths, order + 1, order + 1).
        basis: of the coefficients there, shape (paths, basis); zeros switch an unknown off.
        used: which coefficients the law has, shape (order,).
        to_x: from whitened unknowns to scaled coefficients, shape (order, basis, n).
        start: the unconstrained optimum of the sum of squares, shape (n,).
        condition: of the columns.
        deficient: whether the data cannot tell its coefficients apart.
    """

    paths: Int[Array, " paths"]
    factor: Float[Array, "paths rows rows"]
    basis: Float[Array, "paths basis"]
    used: Bool[Array, " order"]
    to_x: Float[Array, "order basis n"]
    start: Float[Array, " n"]
    condition: Float[Array, ""]
    deficient: Bool[Array, ""]

    @property
    def blocks(self) -> tuple[Float[Array, "paths rows n"], Float[Array, "paths rows"]]:
        """W and c of the compressed readings: residuals W y - c."""
        columns = self.factor[:, :, :-1]
        W = jnp.einsum("pke,pb,ebn->pkn", columns, self.basis, self.to_x)
        return W, self.factor[:, :, -1]


class _PickedFunctions(AbstractPathFunctions):
    """One of several functions, on some of their paths.

    Attributes:
        functions: of all paths.
        pick: which of them.
        paths: of the fit, among all.
    """

    functions: tuple[AbstractPathFunctions, ...]
    pick: Int[Array, ""]
    paths: Int[Array, " paths"]

    def __call__(self, path: Int[Array, " k"], s: Float[Array, " k"]) -> Float[Array, "k order"]:
        """phi_n of the function that is picked."""
        return jnp.stack([phi(self.paths[path], s) for phi in self.functions])[self.pick]

    @property
    def cubic(self) -> Bool[Array, ""]:
        """As the function that is picked."""
        return jnp.stack([phi.cubic for phi in self.functions])[self.pick]


def coupled(of: Design, form: Int[Array, ""], order: Int[Array, ""]) -> Unknowns:
    """Those of a law that is fixed (`form` 0) or linear (1) in pressure.

    Args:
        of: the shared problem.
        form: index into `DEPENDENCES`.
        order: of the law.
    """
    every = jnp.arange(of.target.shape[0])
    both = [_triangle(of, dependence) for dependence in (0, 1)]
    basis, R, c = (jnp.stack(leaves)[form] for leaves in zip(*both, strict=True))
    return _unknowns(of, every, basis, R, c, order)


def free(of: Design, order: Int[Array, ""], path: Int[Array, ""]) -> Unknowns:
    """Those at one pressure of a law that is free in pressure."""
    R, c = of.factor[path, :-1, :-1], of.factor[path, :-1, -1]
    return _unknowns(of, path[None], jnp.ones((1, 1)), R, c, order)


def _triangle(of: Design, dependence: int) -> tuple[Array, Array, Array]:
    """Basis, triangle and right-hand side of a law that is the same, or linear, in pressure.

    Args:
        of: the shared problem.
        dependence: index into `DEPENDENCES`, 0 or 1.

    Returns:
        Basis of shape (pressures, 2), R of shape (2 order, 2 order) and c of shape (2 order,), of
        the unknowns order by order. A fixed law has the first of each two unknowns only.
    """
    rows, right = of.factor[:, :, :-1], of.factor[:, :, -1].ravel()
    order = of.unit.shape[0]
    if dependence == DEPENDENCES.index("linear"):
        columns = jnp.einsum("pke,pb->pkeb", rows, of.basis).reshape(right.size, 2 * order)
        triangle = compressed(columns, right)
        return of.basis, triangle[:-1, :-1], triangle[:-1, -1]
    triangle = compressed(rows.reshape(right.size, order), right)
    basis = jnp.zeros_like(of.basis).at[:, 0].set(1.0)
    R = jnp.eye(2 * order).at[::2, ::2].set(triangle[:-1, :-1])
    return basis, R, jnp.zeros(2 * order).at[::2].set(triangle[:-1, -1])


def _unknowns(
    of: Design,
    paths: Int[Array, " paths"],
    basis: Float[Array, "paths basis"],
    R: Float[Array, "n n"],
    c: Float[Array, " n"],
    order: Int[Array, ""],
) -> Unknowns:
    """Masks and scales of a law.

    Args:
        of: the shared problem.
        paths: indices of the pressures.
        basis: of the coefficients there; a column of zeros switches an unknown off.
        R: triangle of the highest order; a lower one is its leading block.
        c: right-hand side.
        order: of the law.
    """
    highest, n_basis = of.unit.shape[0], basis.shape[1]
    used = jnp.arange(highest) < order
    mask = (used[:, None] & jnp.any(basis != 0, axis=0)).ravel()
    size = jnp.sqrt(jnp.sum(R**2, axis=0))
    scale = jax.lax.stop_gradient(jnp.where(mask & (size > 0), size, 1.0))
    # An unknown that is off has a unit diagonal.
    R = jnp.where(mask[:, None] & mask, R / scale, jnp.eye(mask.size))
    J, condition, deficient = inverse_upper(R, of.target.size)
    own = jnp.linalg.norm(jnp.where(mask[:, None], J, 0.0))
    return Unknowns(
        paths=paths,
        factor=of.factor[paths],
        basis=basis,
        used=used,
        to_x=jnp.where(mask[:, None], J / scale[:, None], 0.0).reshape(highest, n_basis, -1),
        start=jnp.where(mask, c, 0.0),
        condition=jnp.where(deficient, condition, jnp.sqrt(jnp.sum(mask)) * own),
        deficient=deficient,
    )


def constraint_of(of: Design, at: Unknowns, kind: Int[Array, ""]) -> Constraint:
    """What some unknowns have to satisfy.

    Args:
        of: the shared problem.
        at: the unknowns.
        kind: index into `CONSTRAINTS`.
    """
    pick = jnp.where(kind == CONSTRAINTS.index("slope"), 0, 1)
    table = jax.tree.map(lambda s, d: jnp.stack([s, d])[pick][at.paths], of.slope, of.drucker)
    return Constraint(
        table=table,
        exact=_PickedFunctions(of.functions, pick, at.paths),
        grid=of.grid,
        positive=kind == CONSTRAINTS.index("positive"),
        on=kind != CONSTRAINTS.index("none"),
        basis=at.basis,
        to_x=at.to_x,
        used=at.used,
    )


def objective_of(
    name: str,
    of: Design,
    at: Unknowns,
    threshold: Float[Array, ""],
    keep: Float[Array, " paths"],
) -> AbstractObjective:
    """The objective of a fit in its unknowns.

    Args:
        name: one of `OBJECTIVES`.
        of: the shared problem.
        at: the unknowns.
        threshold: see `huber_threshold`.
        keep: weights of the pressures; 0 leaves one out.
    """
    if name == "huber":
        weight = of.weight[at.paths]
        W = jnp.einsum("pke,pb,ebn->pkn", of.A[at.paths] * weight[..., None], at.basis, at.to_x)
        there = jnp.where(weight > 0, keep[:, None], 0.0)
        return Huber(W, of.target[at.paths] * weight, there, threshold)
    W, c = at.blocks
    if name == "mean_rmse":
        return MeanRmse(W, c, keep, jnp.sum(of.weight[at.paths] > 0, axis=1) * 1.0)
    return SumOfSquares(W, c, keep)


def huber_threshold(of: Design) -> Float[Array, ""]:
    """1.345 standard deviations of the noise, by the residuals of a law free in pressure.

    At each pressure it has the highest order, but no more coefficients than half the readings: a
    law that goes through all of them shows no noise.
    """
    there, y = of.weight > 0, of.target * of.weight

    def residuals(
        A: Float[Array, "k n"], y: Float[Array, " k"], n_readings: Int[Array, ""]
    ) -> Float[Array, " k"]:
        # The first columns of Q span the law of a lower order.
        Q, _ = jnp.linalg.qr(A)
        Q = jnp.where(2 * jnp.arange(1, A.shape[1] + 1) <= n_readings, Q, 0.0)
        return y - Q @ (Q.T @ y)

    count = jnp.sum(there, axis=1)
    left = jax.vmap(residuals)(of.A * of.weight[..., None], y, count)
    shows = there & (count > 1)[:, None]
    spread = NORMAL_MAD * jnp.nanmedian(jnp.where(shows, jnp.abs(left), jnp.nan))
    size = jnp.sqrt(jnp.sum(y**2) / jnp.sum(there))
    # Of pressures with one reading each there is no spread.
    return jax.lax.stop_gradient(HUBER * jnp.fmax(spread, 1e-9 * size))

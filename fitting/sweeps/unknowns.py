"""What the fits of a sweep solve for, whitened: masks of one padded problem.

A fit that is free in pressure is one small problem per pressure; one that is fixed or linear in
pressure couples them, with the coefficients at the lowest and the highest pressure as unknowns. A
lower order and a fixed law are masks, so that all fits of a kind are one batch.
"""

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from ..convex import inverse_upper
from .arrays import AnyArray, fixed, namespace
from .design import Design, compressed


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Unknowns:
    """What fits solve for, before any constraint; with y the residuals have a curvature of one.

    Attributes:
        paths: indices of the pressures of each, shape (b, paths).
        on_y: scaled coefficients at these per unknown, shape (b, paths, order, n).
        start: the unconstrained optimum of the sum of squares, shape (b, n).
        condition: of the columns, shape (b,).
        deficient: whether the data cannot tell the coefficients apart, shape (b,).
    """

    paths: Int[AnyArray, "b paths"]
    on_y: Float[AnyArray, "b paths order n"]
    start: Float[AnyArray, "b n"]
    condition: Float[AnyArray, " b"]
    deficient: Bool[AnyArray, " b"]


def coupled(of: Design, dependences: Sequence[str], orders: Sequence[int]) -> Unknowns:
    """Those of laws that are "fixed" or "linear" in pressure: by dependence, then by order."""
    xp, factor, highest = namespace(of.A), of.factor(), of.unit.shape[0]
    rows, right = factor[:, :, :-1], factor[:, :, -1].ravel()
    bases, R, c = [], [], []
    for dependence in dependences:
        # The unknowns go order by order; a fixed law has the first of each two only.
        basis, first = of.basis, np.array([1.0, 0.0])
        if dependence == "linear":
            columns = rows[..., None] * basis[:, None, None, :]
            triangle = compressed(columns.reshape(right.size, -1), right)
            triangle, end = triangle[:-1, :-1], triangle[:-1, -1]
        else:
            basis = xp.ones((len(rows), 1)) * first
            triangle = compressed(rows.reshape(right.size, highest), right)
            triangle, end = triangle[:-1, :-1], xp.kron(triangle[:-1, -1], first)
            triangle = xp.kron(triangle, np.diag(first))
        bases.append(basis)
        R.append(triangle)
        c.append(end)
    bases, R, c = (xp.repeat(xp.stack(each), len(orders), axis=0) for each in (bases, R, c))
    used = np.tile(np.arange(highest) < np.array(orders)[:, None], (len(dependences), 1))
    every = np.tile(np.arange(len(rows)), (len(used), 1))
    return _unknowns(of, every, bases, R, c, used)


def free(of: Design, orders: Sequence[int]) -> Unknowns:
    """Those of laws that are free in pressure: by order, then by pressure."""
    factor, highest, count = of.factor(), of.unit.shape[0], len(of.target)
    used = np.repeat(np.arange(highest) < np.array(orders)[:, None], count, axis=0)
    every = np.tile(np.arange(count), len(orders))
    R, c = factor[every, :-1, :-1], factor[every, :-1, -1]
    return _unknowns(of, every[:, None], np.ones((every.size, 1, 1)), R, c, used)


def _unknowns(
    of: Design,
    paths: Int[np.ndarray, "b paths"],
    basis: Float[AnyArray, "b paths basis"],
    R: Float[AnyArray, "b n n"],
    c: Float[AnyArray, "b n"],
    used: Bool[np.ndarray, "b order"],
) -> Unknowns:
    """Masks and scales of laws.

    Args:
        of: the shared problem.
        paths: indices of the pressures.
        basis: of the coefficients there; a column of zeros switches an unknown off.
        R: triangle of the highest order; a lower one is its leading block.
        c: right-hand side.
        used: which coefficients the law has.
    """
    xp, (b, n) = namespace(R), c.shape
    mask = (used[:, :, None] & (basis != 0).any(axis=1)[:, None, :]).reshape(b, n)
    size = xp.sqrt((R**2).sum(axis=1))
    scale = fixed(xp.where(mask & (size > 0), size, 1.0))
    # An unknown that is off has a unit diagonal.
    R = xp.where(mask[:, :, None] & mask[:, None, :], R / scale[:, None], np.eye(n))
    J, condition, deficient = inverse_upper(R, of.target.size)
    J = xp.where(mask[:, :, None], J, 0.0)
    on = mask.sum(axis=1)
    to_x = (J / scale[:, :, None]).reshape(b, 1, used.shape[1], -1, n)
    return Unknowns(
        paths=paths,
        on_y=(basis[:, :, None, None, :] @ to_x)[..., 0, :],
        start=xp.where(mask, c, 0.0),
        # Of the unknowns that are on: the columns of R have unit length, and so have the others.
        condition=xp.sqrt(on * (condition**2 / n - (n - on))),
        deficient=deficient,
    )

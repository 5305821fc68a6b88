"""All fits of a sweep at once: one `jit(vmap(...))` over the masks of the padded problem."""

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from .._convex.convex_fit import ConvexFit, minimise
from ..engine.status import Status
from .forms import CONSTRAINTS
from .padded import (
    Unknowns,
    constraint_of,
    coupled,
    free,
    huber_threshold,
    objective_of,
)
from .problem import Design


class Fits(eqx.Module):
    """All fits of a sweep, with leading axes (dependences, orders, constraints).

    Attributes:
        coefficients: E_n [Pa] at each pressure, shape (..., pressures, order); nan unless OPTIMAL.
        objective: minimum of the objective; of a free law, summed or averaged over pressures.
        kkt_residual, duality_gap: worst of a fit's problems.
        condition: largest of a fit's problems.
        steps: Newton steps, most of a fit's problems.
        active: rows with a multiplier, in all.
        status: the worst `Status` of a fit's problems.
    """

    coefficients: Float[Array, "*fits pressures order"]
    objective: Float[Array, "*fits"]
    kkt_residual: Float[Array, "*fits"]
    duality_gap: Float[Array, "*fits"]
    condition: Float[Array, "*fits"]
    steps: Int[Array, "*fits"]
    active: Int[Array, "*fits"]
    status: Int[Array, "*fits"]


def solve_all(
    of: Design,
    orders: tuple[int, ...],
    objective: str,
    *,
    exchange: bool = True,
    leave_out: bool = False,
) -> tuple[Fits, Float[Array, "2 orders constraints _"]]:
    """Every form, order and constraint at once, in the order of `DEPENDENCES` and `CONSTRAINTS`.

    Args:
        of: the linear problem.
        orders: of the law, up to that of the design.
        objective: one of `OBJECTIVES`.
        exchange: False poses constraints at the stations only, not between them.
        leave_out: also fit without each pressure in turn.

    Returns:
        The fits. And of those without a pressure, the sum of squares [N^2] there: fixed and linear
        in pressure, shape (2, orders, constraints, pressures), the last axis empty unless asked
        for. A linear law says nothing about a third pressure when there are only two: nan.
    """
    n_pressures, degrees = of.target.shape[0], jnp.asarray(orders)
    together = over_all(lambda form, order: coupled(of, form, order), jnp.arange(2), degrees)
    apart = over_all(lambda order, path: free(of, order, path), degrees, jnp.arange(n_pressures))
    threshold = huber_threshold(of)
    keeps = jnp.ones((1, n_pressures))
    if leave_out:
        keeps = jnp.concatenate([keeps, 1 - jnp.eye(n_pressures)])

    def solved(
        at: Unknowns, kind: Int[Array, ""], keep: Float[Array, " paths"], along_path: bool
    ) -> tuple:
        constraint = constraint_of(of, at, kind)
        aim = objective_of(objective, of, at, threshold, keep)
        fit = minimise(aim, constraint, at.start, exchange=exchange and along_path)
        status = jnp.where(at.deficient, int(Status.RANK_DEFICIENT), fit.status)
        coefficients = constraint.coefficients(fit.y) * of.unit
        coefficients = jnp.where(status == int(Status.OPTIMAL), coefficients, jnp.nan)
        return eqx.tree_at(lambda f: f.status, fit, status), coefficients, at.condition

    def of_kinds(kinds: Int[Array, " kinds"], along_path: bool) -> tuple:
        coupled_fits = over_all(
            lambda kind, form, order, left: solved(
                _picked(together, form, order), kind, keeps[left], along_path
            ),
            *(kinds, *_indices(together.condition), jnp.arange(keeps.shape[0])),
        )
        free_fits = over_all(
            lambda kind, order, path: solved(
                _picked(apart, order, path), kind, jnp.ones(1), along_path
            ),
            *(kinds, *_indices(apart.condition)),
        )
        return _without_places(coupled_fits), _without_places(free_fits)

    # Only what has to hold along a path can be violated between stations.
    parts = [of_kinds(jnp.arange(2), False), of_kinds(jnp.arange(2, len(CONSTRAINTS)), True)]
    coupled_fits, free_fits = jax.tree.map(lambda *leaves: jnp.concatenate(leaves), *parts)
    coupled_fits = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 2), coupled_fits)
    free_fits = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 0, 1), free_fits)
    total = jnp.mean if objective == "mean_rmse" else jnp.sum
    whole = jax.tree.map(lambda leaf: leaf[:, :, :, 0], coupled_fits)
    fits = jax.tree.map(
        lambda some, last: jnp.concatenate([some, last[None]]),
        _as_fits(*whole, axis=None, total=total),
        _as_fits(*free_fits, axis=-1, total=total),
    )
    return fits, _left_out(of, coupled_fits[1][:, :, :, 1:])


def _without_places(fits: tuple) -> tuple:
    """The fits without the rows that held them, of which kinds have different numbers."""
    fit, *rest = fits
    return eqx.tree_at(lambda f: (f.rows, f.dips), fit, (None, None)), *rest


def _left_out(
    of: Design, coefficients: Float[Array, "2 orders constraints left pressures order"]
) -> Float[Array, "2 orders constraints left"]:
    """Sum of squares [N^2] at each pressure of the fits that left it out."""
    left, n_pressures = coefficients.shape[3], coefficients.shape[4]
    own = jnp.arange(left)
    at = coefficients[:, :, :, own, own] / of.unit
    residual = jnp.einsum("ple,...pe->...pl", of.A[:left], at) - of.target[:left]
    square = jnp.sum(jnp.where(of.weight[:left] > 0, residual, 0.0) ** 2, axis=-1)
    known = n_pressures > 1 + jnp.arange(2)
    return jnp.where(known[:, None, None, None], square, jnp.nan)


def _indices(leaf: Array) -> list[Int[Array, " _"]]:
    return [jnp.arange(size) for size in leaf.shape]


def _picked(of: Unknowns, *at: Int[Array, ""]) -> Unknowns:
    """One of an array of them."""
    return jax.tree.map(lambda leaf: leaf[at], of)


def over_all(function: Callable, *axes: Int[Array, " _"], one_by_one: bool = False) -> Any:
    """The function at all combinations, with one axis for each argument.

    Args:
        function: of one scalar per axis.
        axes: values of each argument.
        one_by_one: False for one vmap over all; True where each is itself a large batch.
    """
    shape = tuple(axis.size for axis in axes)
    combined = [grid.ravel() for grid in jnp.meshgrid(*axes, indexing="ij")]
    if one_by_one:
        found = jax.lax.map(lambda at: function(*at), tuple(combined))
    else:
        found = jax.vmap(function)(*combined)
    return jax.tree.map(lambda leaf: leaf.reshape(*shape, *leaf.shape[1:]), found)


def _as_fits(
    fit: ConvexFit,
    coefficients: Float[Array, "*fits paths order"],
    condition: Float[Array, "*fits"],
    axis: int | None,
    total: Callable,
) -> Fits:
    """The fits, those of an axis of pressures put together."""

    def over(reduce: Callable, leaf: Array) -> Array:
        return leaf if axis is None else reduce(leaf, axis=axis)

    return Fits(
        coefficients=coefficients if axis is None else coefficients[..., 0, :],
        objective=over(total, fit.objective),
        kkt_residual=over(jnp.max, fit.kkt_residual),
        duality_gap=over(jnp.max, fit.duality_gap),
        condition=over(jnp.max, condition),
        steps=over(jnp.max, fit.steps),
        active=over(jnp.sum, fit.active),
        status=over(jnp.max, fit.status),
    )

"""The fits of a sweep, all at once: on the host in NumPy, and in JAX for batches and derivatives."""

import dataclasses
from collections.abc import Sequence

import jax
import numpy as np
from jaxtyping import Float, Int

from ..convex import Status
from .arrays import AnyArray, namespace, of_each
from .constraint import Constraint
from .design import Design
from .forms import Forms
from .minimise import ConvexFits, minimise
from .objectives import AbstractObjective, Huber, MeanRmse, SumOfSquares
from .unknowns import Unknowns, coupled, free

_TOGETHER = 64  # fits at once on the host: more, and their arrays leave the cache


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class Fits:
    """The fits of a sweep, with leading axes (dependences, orders, constraints) of its forms.

    Attributes:
        coefficients: E_n [Pa] at each pressure, shape (..., pressures, order); nan unless OPTIMAL.
        objective: minimum of the objective; of a free law, summed or averaged over pressures.
        kkt_residual, duality_gap: worst of a fit's problems.
        condition: largest of a fit's problems.
        steps: Newton steps, most of a fit's problems.
        active: rows with a multiplier, in all.
        status: the worst `Status` of a fit's problems.
    """

    coefficients: Float[AnyArray, "*fits pressures order"]
    objective: Float[AnyArray, "*fits"]
    kkt_residual: Float[AnyArray, "*fits"]
    duality_gap: Float[AnyArray, "*fits"]
    condition: Float[AnyArray, "*fits"]
    steps: Int[AnyArray, "*fits"]
    active: Int[AnyArray, "*fits"]
    status: Int[AnyArray, "*fits"]


@dataclasses.dataclass(frozen=True)
class Solved:
    """Programmes, posed and solved, along a leading axis.

    Attributes:
        form: place of each among the unknowns.
        objective, constraint: of each.
        fits: of each.
    """

    form: Int[AnyArray, " b"]
    objective: AbstractObjective
    constraint: Constraint
    fits: ConvexFits


def solve(
    of: Design, forms: Forms, objective: str, *, exchange: bool = True, leave_out: bool = False
) -> tuple[Fits, Float[AnyArray, "*fits pressures"]]:
    """The fits of all forms.

    Args:
        of: the linear problem.
        forms: of the law.
        objective: one of `OBJECTIVES`.
        exchange: False poses constraints at the stations only, not between them.
        leave_out: also fit without each pressure in turn.

    Returns:
        The fits. And of those without a pressure, the sum of squares [N^2] there, nan where
        the form says nothing about another pressure: a free law, and a linear one of two.
    """
    xp, count, kinds = namespace(of.A), len(of.target), forms.constraints
    keeps = np.ones((1, count))
    if leave_out:
        keeps = np.concatenate([keeps, 1 - np.eye(count)])
    fits, left_out = [], []
    shared = [form for form in forms.dependences if form != "free"]
    if shared:
        unknowns = coupled(of, shared, forms.orders)
        found = _fits(of, unknowns, solved(of, unknowns, kinds, keeps, objective, exchange))
        shape = len(kinds), len(shared), len(forms.orders), len(keeps)
        found = _by_form(found, shape, (1, 2, 0, 3))
        fits.append(jax.tree.map(lambda leaf: leaf[:, :, :, 0], found))
        known = count > 1 + (np.array(shared) == "linear")
        square = _beyond(of, found.coefficients[:, :, :, 1:])
        left_out.append(xp.where(of_each(known, 3), square, np.nan))
    if "free" in forms.dependences:
        unknowns = free(of, forms.orders)
        found = _fits(of, unknowns, solved(of, unknowns, kinds, keeps[:1, :1], objective, exchange))
        found = _by_form(found, (len(kinds), len(forms.orders), count), (1, 0, 2))
        fits.append(jax.tree.map(lambda leaf: leaf[None], _over_pressures(found, objective)))
        left_out.append(np.full((1, *forms.shape[1:], count), np.nan))
    whole = jax.tree.map(lambda *leaves: xp.concatenate(leaves), *fits)
    return whole, xp.concatenate(left_out)


def solved(
    of: Design,
    unknowns: Unknowns,
    constraints: Sequence[str],
    keeps: Float[np.ndarray, "k paths"],
    objective: str,
    exchange: bool = True,
) -> list[Solved]:
    """The programmes of all constraints, unknowns and weights of pressures, in that order.

    Args:
        of: the linear problem.
        unknowns: of all forms.
        constraints: some of `CONSTRAINTS`, in their order.
        keeps: weights of the pressures; 0 leaves one out.
        objective: one of `OBJECTIVES`.
        exchange: False poses constraints at the stations only.
    """
    found = []
    # Only what has to hold along a path can be violated between stations.
    for along in (False, True):
        kinds = [kind for kind in constraints if (kind in ("slope", "drucker")) is along]
        axes = len(kinds), len(unknowns.start), len(keeps)
        kind, form, left = (axis.ravel() for axis in np.indices(axes))
        size = _TOGETHER if isinstance(of.A, np.ndarray) else kind.size
        for first in range(0, kind.size, size or 1):
            here = slice(first, first + size)
            one, on_y = form[here], unknowns.on_y[form[here]]
            names, paths = np.array(kinds)[kind[here]], unknowns.paths[form[here]]
            if along:
                path = paths + len(of.target) * of_each(names == "drucker")
                constraint = Constraint.along(on_y, path, of.functions, of.table, of.stations)
            else:
                constraint = Constraint.positive(on_y, names == "positive")
            aim = _objective(objective, of, paths, on_y, keeps[left[here]])
            fits = minimise(aim, constraint, unknowns.start[one], exchange=exchange and along)
            found.append(Solved(one, aim, constraint, fits))
    return found


def _objective(
    name: str,
    of: Design,
    paths: Int[np.ndarray, "b paths"],
    on_y: Float[AnyArray, "b paths order n"],
    keep: Float[np.ndarray, "b paths"],
) -> AbstractObjective:
    """The objectives; a pressure that is not kept counts for nothing."""
    xp, there = namespace(of.A), of.there[paths] * 1.0
    keep = xp.asarray(keep)
    if name == "huber":
        weight = of.weight[paths]
        W, c = (of.A[paths] * weight[..., None]) @ on_y, of.target[paths] * weight
        return Huber(W, c, keep, there, of.huber_threshold())
    factor = of.factor()[paths]
    W, c = factor[..., :-1] @ on_y, factor[..., -1]
    if name == "mean_rmse":
        return MeanRmse(W, c, keep, there.sum(axis=2))
    return SumOfSquares(W, c, keep)


def _fits(of: Design, unknowns: Unknowns, batches: Sequence[Solved]) -> Fits:
    """What is known of programmes, one after another; nothing where there is no optimum."""
    xp, parts = namespace(of.A), []
    for batch in batches:
        found = batch.fits
        deficient = unknowns.deficient[batch.form]
        status = xp.where(deficient, int(Status.RANK_DEFICIENT), found.status)
        optimal, lost = status == int(Status.OPTIMAL), (
            (status == int(Status.RANK_DEFICIENT)) | (status == int(Status.INFEASIBLE))
        )  # fmt: skip
        E = batch.constraint.coefficients(found.y) * of.unit
        numbers = (found.objective, found.kkt_residual, found.duality_gap)
        parts.append(
            Fits(
                xp.where(of_each(optimal, 2), E, np.nan),
                *(xp.where(lost, np.nan, number) for number in numbers),
                condition=unknowns.condition[batch.form],
                steps=xp.where(lost, 0, found.steps),
                active=xp.where(lost, 0, found.active),
                status=status,
            )
        )
    return jax.tree.map(lambda *leaves: xp.concatenate(leaves), *parts)


def _by_form(fits: Fits, shape: tuple[int, ...], order: tuple[int, ...]) -> Fits:
    """The fits with axes of a shape, in another order."""

    def arranged(leaf: AnyArray) -> AnyArray:
        leaf = leaf.reshape(*shape, *leaf.shape[1:])
        return leaf.transpose(*order, *range(len(shape), leaf.ndim))

    return jax.tree.map(arranged, fits)


def _over_pressures(each: Fits, objective: str) -> Fits:
    """The fits at the pressures of an axis, put together."""
    value = each.objective
    return Fits(
        coefficients=each.coefficients[..., 0, :],
        objective=value.mean(axis=-1) if objective == "mean_rmse" else value.sum(axis=-1),
        kkt_residual=each.kkt_residual.max(axis=-1),
        duality_gap=each.duality_gap.max(axis=-1),
        condition=each.condition.max(axis=-1),
        steps=each.steps.max(axis=-1),
        active=each.active.sum(axis=-1),
        status=each.status.max(axis=-1),
    )


def _beyond(
    of: Design, coefficients: Float[AnyArray, "*fits left pressures order"]
) -> Float[AnyArray, "*fits pressures"]:
    """Sum of squares [N^2] at each pressure of the fits that left it out; nan without them."""
    xp, left = namespace(of.A), np.arange(coefficients.shape[-3])
    if not left.size:
        return xp.full((*coefficients.shape[:-3], len(of.target)), np.nan)
    own = coefficients[..., left, left, :] / of.unit
    residual = xp.where(of.there, (of.A @ own[..., None])[..., 0] - of.target, 0.0)
    return (residual**2).sum(axis=-1)

"""Constrained fits: Newton steps on quadratic programmes, with constraints made exact.

A constraint g(y, s) >= 0 for all s of a path is first posed at stations. Each step minimises the
objective's quadratic model under the rows known so far; where the result violates the constraint
between them, the point becomes a row too. When this has come near, the last steps are Newton's on
the optimality conditions in y, the multipliers and the touching points at once: with g' = 0 at a
touching point, moving it adds l phi' phi'^T / g'' to the curvature. The derivative of a fit is that
of the last such step.

Both drivers run this code, each with its own solver of the quadratic programmes.

References:
    Hettich & Kortanek 1993, SIAM Review 35, 380-429 (semi-infinite programming by reduction).
"""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from ..convex import NearestPoint, Status, cholesky, inverse_lower, nearest_points_of_each
from .arrays import AnyArray, fixed, loop, namespace, of_each
from .constraint import PER_PATH, Constraint, Dips, length, unit
from .objectives import AbstractObjective, Model

_SPARE = 16  # rows kept for points between the stations
_PER_STEP = 4  # points that become rows at a time
_STEPS = 40
_LOOSE = 0.1  # share of the majorant in the curvature: a tenth of a step is then one with it alone
_LEAST = 1e-4  # of that share: a curvature that nearly vanishes would drown the rows in rounding
_LOOSER = 10.0  # by which that grows with a step that is shortened, and falls with a whole one
_LAST_STEPS = 20  # at most, to make a near solution exact
_SHORTENED = (1.0, 0.5, 0.25, 0.1, 0.02)  # parts of a step that are tried
_NEAR = 1e-6  # violation per largest coefficient, and relative change by a step, of a near solution
_OUTSIDE = 1e-10  # violation of a unit row per |y|, far below what makes a point a row
_CORNER = 1e-10  # relative change by a step of a near solution at a corner of the objective
_STILL = 1e-24  # squared relative change of an exact solution
_CERTIFIED = 1e-10  # largest residual of the optimality conditions of an exact one
_NONE = 1e-3  # of the length that the data pull at: shorter unknowns are rounding

Rows = tuple[Int[AnyArray, "b n"], Bool[AnyArray, "b n"]]
"""Indices of active rows, and which of them are used."""


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class ConvexFits:
    """The minimisers with their certificates, along a leading axis.

    Attributes:
        y: minimisers, shape (b, n); differentiable.
        objective: its value.
        active: number of rows with a multiplier.
        kkt_residual: largest violation of the optimality conditions, relative.
        duality_gap: by how much a point within |y| of y may be better, per objective.
        steps: Newton steps before the last ones.
        status: a `Status`.
        normals: rows of the last programme, of unit length or zero, shape (b, m, n).
        rows: those of them that are active, for a neighbouring fit to start from.
    """

    y: Float[AnyArray, "b n"]
    objective: Float[AnyArray, " b"]
    active: Int[AnyArray, " b"]
    kkt_residual: Float[AnyArray, " b"]
    duality_gap: Float[AnyArray, " b"]
    steps: Int[AnyArray, " b"]
    status: Int[AnyArray, " b"]
    normals: Float[AnyArray, "b m n"]
    rows: Rows


def minimise(
    objective: AbstractObjective,
    constraint: Constraint,
    start: Float[AnyArray, "b n"],
    *,
    exchange: bool = True,
) -> ConvexFits:
    """The certified minimisers of convex objectives under constraints along paths.

    Args:
        objective: in unknowns y in which its curvature is of order one.
        constraint: on the same unknowns.
        start: where to start, such as the minimiser of the sum of squares.
        exchange: False poses the constraint at the stations only.

    Returns:
        The fits. `y` may be differentiated once, through objective and constraint.
    """
    still, (b, n) = fixed((objective, constraint)), start.shape
    xp = namespace(start)
    near = _Near(
        y=fixed(start),
        rows=(xp.zeros((b, n), int), xp.zeros((b, n), bool)),
        found=xp.zeros((b, _SPARE if exchange else 0, n)),
        filled=xp.zeros(b, int),
        dips=Dips.none(xp.zeros((b, PER_PATH * constraint.on_y.shape[1] * exchange))),
        loose=xp.full(b, _LOOSE),
        steps=xp.zeros(b, int),
        status=xp.full(b, int(Status.OPTIMAL)),
        done=xp.zeros(b, bool),
    )
    if exchange or not objective.quadratic:
        near = loop(lambda at: ~at.done & (at.steps < _STEPS), _towards, still, near)
    dips = near.dips
    if isinstance(start, np.ndarray):
        # The dips that matter come first; on the host the others need not be carried along.
        most = dips.matters.sum(axis=1).max(initial=0)
        dips = jax.tree.map(lambda leaf: leaf[:, :most], dips)
    posed = constraint.posed.shape[1]
    last = _Last(
        y=near.y,
        turned=xp.zeros_like(near.y),
        multipliers=xp.zeros(dips.s.shape),
        dips=dips,
        rows=(near.rows[0], near.rows[1] & (near.rows[0] < posed)),
        steps=xp.zeros(b, int),
        # Without a dip that matters the rows at the stations are all there are.
        done=(near.status != int(Status.OPTIMAL))
        | (~dips.matters.any(axis=1) & objective.quadratic),
    )
    guess = None
    if exchange or not objective.quadratic:
        last = loop(
            lambda at: ~at.done & (at.steps < _LAST_STEPS),
            lambda given, at: _exactly(*given, at, at.rows)[0],
            still,
            last,
        )
        guess = last.rows
    # What is differentiated is this step, and its derivative is the fit's with all its curvature.
    least = _LEAST if isinstance(start, np.ndarray) else 0.0
    last, G, nearest = _exactly(objective, constraint, fixed(last), guess, least)
    return _certified(objective, last, G, nearest, near)


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Near:
    """Where the search is: the point, its active rows, and the points that became rows."""

    y: Float[AnyArray, "b n"]
    rows: Rows
    found: Float[AnyArray, "b spare n"]
    filled: Int[AnyArray, " b"]
    dips: Dips
    loose: Float[AnyArray, " b"]
    steps: Int[AnyArray, " b"]
    status: Int[AnyArray, " b"]
    done: Bool[AnyArray, " b"]


def _towards(given: tuple[AbstractObjective, Constraint], at: _Near) -> _Near:
    """A step, after which little changes and little is violated in the end."""
    objective, constraint = given
    xp, iteration = namespace(at.y), at.steps * 1.0
    G = xp.concatenate([constraint.posed, at.found], axis=1)
    model = objective.model(at.y, iteration)
    if objective.quadratic:
        nearest, y = _solved(model, model.hessian, at.y, G, at.rows)
        still, loose = xp.ones(len(y), bool), at.loose
    else:
        # From outside, a step with the majorant leads to a point that is no worse than any inside.
        outside = ((G @ at.y[..., None])[..., 0] < -_OUTSIDE * of_each(length(at.y))).any(axis=1)
        share = of_each(xp.where(outside, 1.0, at.loose), 2)
        curvature = model.hessian + share * (model.majorant - model.hessian)
        nearest, y = _solved(model, curvature, at.y, G, at.rows)
        near = xp.where(objective.at_corner(y), _CORNER, _NEAR)
        still = length(y - at.y) <= near * length(y)
        tried = [at.y + part * (y - at.y) for part in _SHORTENED]
        best = xp.argmin(xp.stack([objective.value(v, iteration) for v in tried]), axis=0)
        best = xp.where(outside, 0, best)
        y = xp.stack(tried)[best, np.arange(len(y))]
        loose = xp.where(
            best > 0, xp.minimum(at.loose * _LOOSER, 1.0), xp.maximum(at.loose / _LOOSER, _LEAST)
        )
        loose = xp.where(outside, at.loose, loose)
    found, filled, dips = at.found, at.filled, at.dips
    if found.shape[1]:
        dips = constraint.dips(y)
        path, s, slack = (leaf[:, :_PER_STEP] for leaf in (dips.path, dips.s, dips.slack))
        enters = (slack < -_NEAR) & ~dips.station[:, :_PER_STEP]
        slots = (of_each(filled) + enters.cumsum(axis=1) - enters) % _SPARE
        placed = enters[..., None] & (slots[..., None] == np.arange(_SPARE))
        rows = unit(constraint.rows(path, s)[0])
        new = xp.swapaxes(placed * 1.0, 1, 2) @ rows
        found = xp.where(placed.any(axis=1)[..., None], new, found)
        filled, still = filled + enters.sum(axis=1), still & ~enters.any(axis=1)
    return _Near(
        y=y,
        rows=(nearest.rows, nearest.used),
        found=found,
        filled=filled,
        dips=dips,
        loose=loose,
        steps=at.steps + 1,
        status=nearest.status,
        done=still | (nearest.status != int(Status.OPTIMAL)),
    )


@jax.tree_util.register_dataclass
@dataclasses.dataclass(frozen=True)
class _Last:
    """A solution with its dips and their multipliers, of rows that are not scaled.

    `turned` is what its rows lose, times their multipliers, as the dips move with the last step.
    """

    y: Float[AnyArray, "b n"]
    turned: Float[AnyArray, "b n"]
    multipliers: Float[AnyArray, "b k"]
    dips: Dips
    rows: Rows
    steps: Int[AnyArray, " b"]
    done: Bool[AnyArray, " b"]


def _exactly(
    objective: AbstractObjective,
    constraint: Constraint,
    at: _Last,
    guess: Rows | None,
    least: float = _LEAST,
) -> tuple[_Last, Float[AnyArray, "b m n"], NearestPoint]:
    """A Newton step on the optimality conditions in y, multipliers and dips."""
    xp, n, dips, posed = namespace(at.y), at.y.shape[1], at.dips, constraint.posed.shape[1]
    matters, moving = dips.matters, xp.zeros((len(at.y), n, n))
    G, size = constraint.posed, xp.ones(dips.s.shape)
    if dips.s.shape[1]:
        _, first, second = constraint.rows(dips.path, dips.s, 2)
        bend, turn = ((rows @ at.y[..., None])[..., 0] for rows in (second, first))
        free = matters & dips.moves & (bend > 0) & (dips.s > 0) & (dips.s < 1)
        bend = xp.where(free, bend, 1.0)
        s = xp.clip(dips.s - xp.where(free, turn / bend, 0.0), 0.0, 1.0)
        weight = xp.where(free, at.multipliers / bend, 0.0)
        moving = xp.swapaxes(weight[..., None] * first, 1, 2) @ first
        dips = dataclasses.replace(dips, s=s)
        rows = xp.where(matters[..., None], constraint.rows(dips.path, s)[0], 0.0)
        G, size = xp.concatenate([G, unit(rows)], axis=1), fixed(length(rows))
    model = objective.model(at.y, xp.full(len(at.y), float(_STEPS)))
    curvature = model.hessian + least * (model.majorant - model.hessian)
    nearest, y = _solved(model, curvature + moving, at.y, G, guess)
    holds = nearest.rows[..., None] == posed + np.arange(size.shape[1])
    multipliers = (nearest.multipliers[:, None] @ (holds * 1.0))[:, 0]
    change = y - at.y
    last = _Last(
        y=y,
        turned=(moving @ change[..., None])[..., 0],
        multipliers=multipliers / xp.where(size > 0, size, 1.0),
        dips=dips,
        rows=(nearest.rows, nearest.used),
        steps=at.steps + 1,
        done=((change**2).sum(axis=1) <= _STILL * (y**2).sum(axis=1))
        | (nearest.status != int(Status.OPTIMAL)),
    )
    return last, G, nearest


def _solved(
    model: Model,
    curvature: Float[AnyArray, "b n n"],
    y: Float[AnyArray, "b n"],
    G: Float[AnyArray, "b m n"],
    guess: Rows | None,
) -> tuple[NearestPoint, Float[AnyArray, "b n"]]:
    """The minimisers of models at y with that curvature, under the rows."""
    xp = namespace(y)
    # An unknown that the data and the rows do not depend on stays where it is.
    absent = (curvature == 0).all(axis=1)
    H = curvature + xp.where(absent, 1.0, 0.0)[:, None] * np.eye(y.shape[1])
    with np.errstate(all="ignore"):
        J = xp.swapaxes(inverse_lower(cholesky(H)), 1, 2)
    # With H = (J J^T)^-1 the centre J^-1 y - J^T g is J^T (H y - g).
    right = (H @ y[..., None])[..., 0] - model.gradient
    centre = (right[:, None] @ J)[:, 0]
    # A curvature that is not positive: what is left of the data does not determine the law.
    known = xp.isfinite(J).all(axis=(1, 2))
    nearest = nearest_points_of_each(G, centre, J, guess)
    status = xp.where(known, nearest.status, int(Status.RANK_DEFICIENT))
    return dataclasses.replace(nearest, status=status), (J @ nearest.y[..., None])[..., 0]


def _certified(
    objective: AbstractObjective,
    last: _Last,
    G: Float[AnyArray, "b m n"],
    nearest: NearestPoint,
    near: _Near,
) -> ConvexFits:
    """The fits, their optimality measured at the points themselves and not in the last models."""
    xp, tiny = namespace(last.y), float(jnp.finfo(last.y.dtype).tiny)
    y, turned, still, rows = fixed((last.y, last.turned, objective, G))
    iteration = xp.full(len(y), float(_STEPS))
    model, multipliers = still.model(y, iteration), nearest.multipliers
    every = np.arange(len(y))[:, None]
    normals = xp.zeros((*nearest.rows.shape, y.shape[1]))
    if G.shape[1]:
        normals = xp.where(nearest.used[..., None], rows[every, nearest.rows], 0.0)
    stationarity = model.gradient + turned - (multipliers[:, None] @ normals)[:, 0]
    slack = (rows @ y[..., None])[..., 0]
    size = length(y)
    # Where the optimum is no law at all, what the data pull at it says what is rounding.
    pull_of_none = length(fixed(still.model(xp.zeros_like(y), iteration).gradient))
    pull = xp.trace(model.majorant, axis1=1, axis2=2) * size
    pull = xp.maximum(xp.maximum(pull, pull_of_none), tiny)
    largest = xp.maximum(xp.maximum(size, _NONE * pull_of_none), tiny)
    violations = [
        abs(stationarity).max(axis=1) / pull,
        (-slack).max(axis=1, initial=0.0) / largest,
        (-multipliers).max(axis=1, initial=0.0) / pull,
    ]
    kkt_residual = fixed(xp.stack(violations).max(axis=0))
    value = objective.value(last.y, iteration)
    gap = abs((multipliers * (normals @ y[..., None])[..., 0]).sum(axis=1))
    gap = gap + length(stationarity) * size + still.rounded(y)
    scale = float(jnp.finfo(y.dtype).eps) * still.value(xp.zeros_like(y), iteration) + tiny
    exact = xp.where(kkt_residual < _CERTIFIED, int(Status.OPTIMAL), int(Status.STALLED))
    status = xp.where(near.status == int(Status.OPTIMAL), nearest.status, near.status)
    return ConvexFits(
        y=last.y,
        objective=value,
        active=nearest.used.sum(axis=1),
        kkt_residual=kkt_residual,
        duality_gap=fixed(gap / xp.maximum(value, scale)),
        steps=near.steps,
        status=xp.where(status == int(Status.OPTIMAL), exact, status),
        normals=rows,
        rows=(nearest.rows, nearest.used),
    )

"""One constrained fit: Newton steps on quadratic programmes, with constraints made exact.

A constraint g(y, s) >= 0 for all s of a path is first posed at a grid. Each step minimises the
objective's quadratic model under the rows known so far; where the result violates the constraint
between them, the point becomes a row too. When this has come near, the last steps are Newton's on
the optimality conditions in y, the multipliers and the touching points at once: with g' = 0 at a
touching point, moving it adds l phi' phi'^T / g'' to the curvature. The derivative of a fit is that
of the last such step, in which g'' is that of the cubics.

References:
    Hettich & Kortanek 1993, SIAM Review 35, 380-429 (semi-infinite programming by reduction).
"""

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from ..engine.active_set import NearestPoint, nearest_point
from ..engine.small_dense import cholesky, inverse_lower
from ..engine.status import Status
from .constraint import Constraint, Dips, Points, posed
from .objectives import AbstractObjective, Model

SPARE = 12
"""Rows kept for points between the grid."""

_PER_STEP = 2  # points that become rows at a time
_STEPS = 40
_NEWTON = 0.9  # share of the Newton curvature: a tenth of a step is then one with the majorant
_LAST_STEPS = 12  # at most, to make a near solution exact
_SHORTENED = (1.0, 0.5, 0.25, 0.1, 0.02)  # parts of a step that are tried
_NEAR = 1e-6  # violation per largest coefficient, and relative change by a step, of a near solution
_OUTSIDE = 1e-10  # violation of a unit row per |y|, far below what makes a point a row
_CORNER = 1e-10  # relative change by a step of a near solution at a corner of the objective
_STILL = 1e-24  # squared relative change of an exact solution
_CERTIFIED = 1e-10  # largest residual of the optimality conditions of an exact one


class ConvexFit(eqx.Module):
    """The minimiser with its certificate.

    Attributes:
        y: minimiser, shape (n,); differentiable.
        objective: its value.
        active: number of rows with a multiplier.
        kkt_residual: largest violation of the optimality conditions, relative.
        duality_gap: by how much a point within |y| of y may be better, per objective.
        steps: Newton steps before the last ones.
        status: a `Status`.
        rows: `rows` and `used` of the last programme, for a neighbouring fit to start from.
        dips: points of its last rows.
    """

    y: Float[Array, " n"]
    objective: Float[Array, ""]
    active: Int[Array, ""]
    kkt_residual: Float[Array, ""]
    duality_gap: Float[Array, ""]
    steps: Int[Array, ""]
    status: Int[Array, ""]
    rows: tuple[Int[Array, " n"], Bool[Array, " n"]]
    dips: Points


def minimise(
    objective: AbstractObjective,
    constraint: Constraint,
    start: Float[Array, " n"],
    *,
    exchange: bool = True,
) -> ConvexFit:
    """The certified minimiser of a convex objective under a constraint along paths.

    Args:
        objective: in unknowns y in which its curvature is of order one.
        constraint: on the same unknowns.
        start: where to start, such as the minimiser of the sum of squares.
        exchange: False poses the constraint at the grid only.

    Returns:
        The fit. `y` may be differentiated once, through objective and constraint.
    """
    fixed = jax.lax.stop_gradient((objective, constraint))
    near = _start(jax.lax.stop_gradient(start), constraint.basis.shape[0])
    if exchange or not objective.quadratic:
        near = _search(*fixed, near, exchange)
    if exchange:
        last = jax.lax.stop_gradient(_refined(*fixed, near))
        last, G, h, point = _last_step(objective, constraint, last, exact=True)
        y, dips, turned = last.y, last.dips, last.turned
    else:
        G, h = constraint.grid_rows()
        model = objective.model(near.y, jnp.asarray(float(_STEPS)))
        guess = None if objective.quadratic else near.rows
        point, y = _solved(model, model.hessian, near.y, G, h, guess)
        dips, turned = Points(jnp.full(1, -1), jnp.zeros(1)), jnp.zeros_like(y)
    return _certified(objective, y, turned, G, h, point, near, dips)


def _solved(
    model: Model,
    curvature: Float[Array, "n n"],
    y: Float[Array, " n"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    guess: tuple[Int[Array, " n"], Bool[Array, " n"]] | None,
) -> tuple[NearestPoint, Float[Array, " n"]]:
    """The minimiser of the model at y with that curvature, under the rows."""
    # An unknown that the data and the rows do not depend on stays where it is.
    absent = jnp.all(curvature == 0, axis=0)
    H = curvature + jnp.diag(jnp.where(absent, 1.0, 0.0).astype(y.dtype))
    J = inverse_lower(cholesky(H)).T
    # With H = (J J^T)^-1 the centre J^-1 y - J^T g is J^T (H y - g).
    point = nearest_point(G, h, J.T @ (H @ y - model.gradient), J, guess)
    return point, J @ point.y


class _State(eqx.Module):
    """Where the search is: the point, its active rows, and the points that became rows."""

    y: Float[Array, " n"]
    rows: tuple[Int[Array, " n"], Bool[Array, " n"]]
    found: Points
    filled: Int[Array, ""]
    dips: Dips
    steps: Int[Array, ""]
    status: Int[Array, ""]
    done: Bool[Array, ""]


def _none(n: int) -> tuple[Int[Array, " n"], Bool[Array, " n"]]:
    return jnp.zeros(n, int), jnp.zeros(n, bool)


def _start(y: Float[Array, " n"], paths: int) -> _State:
    nowhere = Points(jnp.full(2 * paths, -1), jnp.zeros(2 * paths, y.dtype))
    return _State(
        y=y,
        rows=_none(y.size),
        found=Points(jnp.full(SPARE, -1), jnp.zeros(SPARE, y.dtype)),
        filled=jnp.array(0),
        dips=Dips(nowhere, jnp.full(2 * paths, jnp.inf), jnp.zeros(2 * paths, bool)),
        steps=jnp.array(0),
        status=jnp.array(int(Status.OPTIMAL)),
        done=jnp.array(False),
    )


def _search(
    objective: AbstractObjective, constraint: Constraint, state: _State, exchange: bool
) -> _State:
    """Steps until little changes and little is violated."""
    grid_G, grid_h = constraint.grid_rows()

    def step(at: _State) -> _State:
        iteration = at.steps.astype(at.y.dtype)
        found_G, found_h = posed(constraint.cubic_rows(at.found))
        G, h = jnp.concatenate([grid_G, found_G]), jnp.concatenate([grid_h, found_h])
        model = objective.model(at.y, iteration)
        # From outside, a step with the majorant leads to a point that is no worse than any inside.
        outside = jnp.any(G @ at.y - h < -_OUTSIDE * jnp.linalg.norm(at.y))
        share = jnp.where(outside, 0.0, _NEWTON)
        curvature = model.majorant + share * (model.hessian - model.majorant)
        point, y = _solved(model, curvature, at.y, G, h, at.rows)
        still = jnp.array(True)
        if not objective.quadratic:
            near = jnp.where(objective.at_corner(y), _CORNER, _NEAR)
            still = jnp.sum((y - at.y) ** 2) <= near**2 * jnp.sum(y**2)
            tried = at.y + jnp.asarray(_SHORTENED)[:, None] * (y - at.y)
            values = jax.vmap(lambda v: objective.value(v, iteration))(tried)
            y = tried[jnp.where(outside, 0, jnp.argmin(values))]
        found, filled, dips, exact = at.found, at.filled, at.dips, jnp.array(True)
        if exchange:
            dips = constraint.dips(y)
            found, filled, exact = _exchanged(dips, at)
        return _State(
            y=y,
            rows=(point.rows, point.used),
            found=found,
            filled=filled,
            dips=dips,
            steps=at.steps + 1,
            status=point.status,
            done=(still & exact) | (point.status != int(Status.OPTIMAL)),
        )

    return jax.lax.while_loop(lambda at: ~at.done & (at.steps < _STEPS), step, state)


def _exchanged(dips: Dips, at: _State) -> tuple[Points, Int[Array, ""], Bool[Array, ""]]:
    """The points with the deepest dips, their number, and whether none is violated."""
    weakest = jnp.argsort(dips.slack[: dips.slack.size // 2])[:_PER_STEP]
    enters = dips.slack[weakest] < -_NEAR
    slots = (at.filled + jnp.cumsum(enters) - enters) % SPARE
    slots = jnp.where(enters, slots, SPARE)
    found = jax.tree.map(
        lambda old, new: old.at[slots].set(new[weakest], mode="drop"), at.found, dips.at
    )
    return found, at.filled + jnp.sum(enters), ~jnp.any(enters)


class _Last(eqx.Module):
    """A solution with its dips and their multipliers, of rows that are not scaled.

    `turned` is what its rows lose, times their multipliers, as the dips move with the last step.
    """

    y: Float[Array, " n"]
    turned: Float[Array, " n"]
    multipliers: Float[Array, " k"]
    dips: Points
    rows: tuple[Int[Array, " n"], Bool[Array, " n"]]
    steps: Int[Array, ""]
    done: Bool[Array, ""]


def _refined(objective: AbstractObjective, constraint: Constraint, near: _State) -> _Last:
    """The exact solution near another, for the cubics in place of the functions."""
    rows, used = near.rows
    # Without a dip that matters the rows at the stations are all there are, and the point is exact.
    matters = jnp.any(~near.dips.station & (near.dips.slack < _NEAR))
    n_grid = constraint.basis.shape[0] * constraint.grid.shape[0]
    last = _Last(
        y=near.y,
        turned=jnp.zeros_like(near.y),
        multipliers=jnp.zeros(2 * constraint.basis.shape[0], near.y.dtype),
        dips=near.dips.at,
        rows=(rows, used & (rows < n_grid)),
        steps=jnp.array(0),
        done=~matters if objective.quadratic else jnp.array(False),
    )
    return jax.lax.while_loop(
        lambda at: ~at.done & (at.steps < _LAST_STEPS),
        lambda at: _last_step(objective, constraint, at, exact=False)[0],
        last,
    )


def _last_step(
    objective: AbstractObjective, constraint: Constraint, at: _Last, *, exact: bool
) -> tuple[_Last, Float[Array, "m n"], Float[Array, " m"], NearestPoint]:
    """A Newton step on the optimality conditions in y, multipliers and dips."""
    dips, moving = constraint.touching(at.y, at.dips, at.multipliers)
    rows = constraint.exact_rows(dips, at.y) if exact else constraint.cubic_rows(dips)
    G, h = posed(rows)
    grid_G, grid_h = constraint.grid_rows()
    G, h = jnp.concatenate([grid_G, G]), jnp.concatenate([grid_h, h])
    model = objective.model(at.y, jnp.asarray(float(_STEPS)))
    point, y = _solved(model, model.hessian + moving, at.y, G, h, at.rows)
    multipliers = jnp.zeros(G.shape[0]).at[point.rows].add(point.multipliers)
    multipliers = multipliers[grid_h.size :]
    size = jnp.linalg.norm(jax.lax.stop_gradient(rows), axis=1)
    last = _Last(
        y=y,
        turned=moving @ (y - at.y),
        multipliers=multipliers / jnp.where(size > 0, size, 1.0),
        dips=dips,
        rows=(point.rows, point.used),
        steps=at.steps + 1,
        done=jnp.sum((y - at.y) ** 2) <= _STILL * jnp.sum(y**2),
    )
    return last, G, h, point


def _certified(
    objective: AbstractObjective,
    y: Float[Array, " n"],
    turned: Float[Array, " n"],
    G: Float[Array, "m n"],
    h: Float[Array, " m"],
    point: NearestPoint,
    near: _State,
    dips: Points,
) -> ConvexFit:
    """The fit, its optimality measured at the point itself and not in the last model."""
    at, turned, rows, offsets = jax.lax.stop_gradient((y, turned, G, h))
    last, tiny = jnp.asarray(float(_STEPS)), jnp.finfo(y.dtype).tiny
    model = objective.model(at, last)
    normals = jnp.where(point.used[:, None], rows[point.rows], 0.0)
    stationarity = model.gradient + turned - point.multipliers @ normals
    slack = rows @ at - offsets
    size = jnp.linalg.norm(at)
    gradient_size = jnp.trace(model.majorant) * size
    violations = [
        jnp.max(jnp.abs(stationarity)) / jnp.maximum(gradient_size, tiny),
        jnp.max(-slack, initial=0.0) / jnp.maximum(size, tiny),
        jnp.max(-point.multipliers) / jnp.maximum(gradient_size, tiny),
    ]
    kkt_residual = jax.lax.stop_gradient(jnp.max(jnp.stack(violations)))
    value = objective.value(y, last)
    gap = jnp.abs(point.multipliers @ (normals @ at)) + jnp.linalg.norm(stationarity) * size
    gap += objective.rounded(at)
    scale = jnp.finfo(y.dtype).eps * objective.value(jnp.zeros_like(y), last) + tiny
    exact = jnp.where(kkt_residual < _CERTIFIED, int(Status.OPTIMAL), int(Status.STALLED))
    status = jnp.where(point.status != int(Status.OPTIMAL), point.status, exact)
    return ConvexFit(
        y=y,
        objective=value,
        active=jnp.sum(point.used),
        kkt_residual=kkt_residual,
        duality_gap=jax.lax.stop_gradient(gap / jnp.maximum(value, scale)),
        steps=near.steps,
        status=status,
        rows=(point.rows, point.used),
        dips=dips,
    )

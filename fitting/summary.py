"""Summarise an optimum as an identification: covariance, estimates with errors, certificate."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from jaxtyping import Bool, Float, Int

import famjax
from famjax.boundary.units import Quantity, Sentence

from .convex import Status
from .covariance import Covariance, covariance
from .data import ForceData
from .engine import Point, muscle_at, partial, predict, report_of, solve
from .parameters import Entry
from .pictured import PictureFit
from .posing import Posed, own_names
from .problem import Problem
from .response import Report
from .result import Certificate, Errors, Estimate, Identification, Solved
from .search import End, Margin, Weights, constraint_margin, pseudo_residual, rounding_of

_STEP = 1e-3  # finite-difference step on a path, for the curvature of the modulus


@dataclasses.dataclass(frozen=True)
class Optimal:
    """An optimum with its covariance and coefficients.

    Attributes:
        problem: the problem with refined stations.
        end: end of the best descent.
        order: number of coefficients of one law.
        spread: covariance of the nonlinear parameters followed by the coefficients.
        at_bound: True for nonlinear parameters at a bound.
    """

    problem: Problem
    end: End
    order: int
    spread: Covariance
    at_bound: Bool[np.ndarray, " q"]

    @property
    def point(self) -> Point:
        """The fit at the optimum."""
        return self.end.point

    @property
    def coefficients(self) -> Float[np.ndarray, "nodes order"]:
        """Coefficients [Pa] of every node; one empty node if no parameter is linear."""
        return self.point.x.reshape(-1 if self.order else 1, self.order)


def joint_derivatives(
    point: Point,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k p"], Float[np.ndarray, "m p"]]:
    """Weighted residual, its Jacobian and the Jacobian of the constraints, in (parameters, x)."""
    A, G = point.A, point.G
    d_residual, d_slack = partial(point)
    columns = np.zeros((len(d_residual), A.shape[1]))
    columns[: len(A)] = A
    return (
        point.residual,
        np.concatenate([d_residual, columns], axis=1),
        np.concatenate([d_slack, G], axis=1),
    )


def optimal(problem: Problem, end: End, order: int, weights: Weights | None = None) -> Optimal:
    """Return the optimum at the end of a descent, with its covariance; `weights` of the objective."""
    point = end.point
    residual, jacobian, rows = joint_derivatives(point)
    held, rows, bent = held_and_active(problem, end, rows)
    n_priors = residual.size - problem.force.size
    # An inactive censored reading carries no information on noise or parameters.
    off = np.zeros(residual.size, bool)
    off[: problem.force.size] = (problem.side != 0) & (residual[: problem.force.size] == 0)
    residual, jacobian = residual[~off], jacobian[~off]
    if weights is not None and weights.threshold is not None:
        # Restore the original weights; residuals become Huber's pseudo-residuals.
        own = np.concatenate([1 / weights.factor, np.ones(n_priors)])
        unknowns = int(np.sum(~held)) - len(set(map(tuple, rows)))
        jacobian = own[:, None] * jacobian
        residual = pseudo_residual(
            own * residual, weights.factor.size, weights.threshold, max(unknowns, 1)
        )
    spread = covariance(
        jacobian, residual, rows, held, bent=bent, n_priors=n_priors, noise=problem.noise
    )
    at_bound = np.isin(np.arange(len(problem.names)), problem.free) & held[: len(problem.names)]
    return Optimal(problem, end, order, spread, at_bound)


def held_and_active(
    problem: Problem, end: End, rows: Float[np.ndarray, "m p"]
) -> tuple[Bool[np.ndarray, " p"], Float[np.ndarray, "a p"], Float[np.ndarray, "c p"]]:
    """Find parameters that are fixed or at a bound, and the effect of active constraints on the others.

    Neighbouring active stations represent one point at which the law touches the constraint. This point
    moves with the parameters, which adds curvature: for the modulus m(s) with multiplier l the cost gains
    l m_s m_s^T / m_ss, with m_s the derivative of the modulus gradient in s.

    Args:
        problem: the problem with refined stations.
        end: the optimum.
        rows: gradients of all constraints with respect to all parameters.

    Returns:
        (fixed or at a bound; gradients of the active constraints; roots of the added curvature).
    """
    point = end.point
    held = np.ones(len(problem.names) + len(problem.linear), bool)
    held[problem.free] = (end.u <= 1e-9) | (end.u >= 1 - 1e-9)
    held[len(problem.names) :] = False
    pull = np.zeros(len(rows))
    pull[point.rows] = point.multipliers
    touches, n_path = _touching(problem, pull)
    others = np.sort(point.rows[point.rows >= n_path])
    means = [pull[one] @ rows[one] / pull[one].sum() for one in touches]
    active = np.concatenate([np.array(means).reshape(-1, rows.shape[1]), rows[others]])
    return held, active, _bent(problem, point, pull, touches)


def _touching(
    problem: Problem, pull: Float[np.ndarray, " m"]
) -> tuple[list[Int[np.ndarray, " _"]], int]:
    """Return the active rows of each touched point on a path, and the number of path rows."""
    found, first = [], 0
    for part, rows_of_part in zip(problem.parts, problem.path_rows, strict=True):
        if not rows_of_part:
            continue
        count = part.inputs.stations.shape[1]
        for own in part.inputs.stations:
            active = np.flatnonzero(pull[first : first + count] > 0)
            active = active[np.argsort(own[active])]
            apart = np.flatnonzero(np.diff(own[active]) > 1 / (count - 1)) + 1
            found += [first + rows for rows in np.split(active, apart) if rows.size]
            first += count
    return found, first


def _bent(
    problem: Problem,
    point: Point,
    pull: Float[np.ndarray, " m"],
    touches: Sequence[Int[np.ndarray, " _"]],
) -> Float[np.ndarray, "c p"]:
    """Roots of the curvature added by the touched points, by finite differences in their position."""
    p = len(problem.names) + len(problem.linear)
    stations = np.concatenate([part.inputs.stations.ravel() for part in problem.parts])
    middles = [pull[rows] @ stations[rows] / pull[rows].sum() for rows in touches]
    inner = [k for k, s in enumerate(middles) if _STEP < s < 1 - _STEP]
    if not inner:
        return np.zeros((0, p))
    sides = []
    for step in (-_STEP, _STEP):
        moved, first = stations.copy(), 0
        for k in inner:
            moved[touches[k]] = middles[k] + step
        parts = []
        for part in problem.parts:
            own = part.inputs.stations
            parts.append(part.with_stations(moved[first : first + own.size].reshape(own.shape)))
            first += own.size
        other = dataclasses.replace(problem, parts=tuple(parts))
        found = dataclasses.replace(solve(other, point.parameters), x=point.x)
        rows = np.concatenate([partial(found)[1], found.G], axis=1)
        sides.append((rows, found.G @ point.x - found.h))
    (low, m_low), (high, m_high) = sides
    first_of = [touches[k][0] for k in inner]
    slope = (high - low)[first_of] / (2 * _STEP)
    # The modulus is zero at the point itself.
    bend = (m_low + m_high)[first_of] / _STEP**2
    weight = np.array([pull[touches[k]].sum() for k in inner]) / np.where(bend > 0, bend, np.inf)
    return np.sqrt(weight)[:, None] * slope


_DERIVED_KINDS = {"thread_length": "length"}  # anything else is a number


def coefficient_stderr(found: Optimal) -> Float[np.ndarray, "nodes order"]:
    """Standard errors [Pa] of the coefficients."""
    return found.spread.stderr[len(found.problem.names) :].reshape(found.coefficients.shape)


def estimates(found: Optimal, table: Mapping[str, Entry]) -> tuple[Estimate, ...]:
    """Return estimates of all nonlinear parameters, then of the coefficients of every node."""
    names = found.problem.names + found.problem.linear
    values = np.concatenate([found.point.parameters, found.coefficients.ravel()])
    ends = np.array([(table[name].min, table[name].max) for name in names])
    rounding = 1e-9 * np.abs(found.coefficients).max(initial=0.0)
    stopped = np.min(np.abs(values[:, None] - ends), axis=1) <= rounding
    stopped[: len(found.at_bound)] = found.at_bound
    return tuple(
        Estimate(
            name=name,
            value=float(value),
            stderr=float(stderr),
            sandwich_stderr=float(sandwich),
            min=table[name].min,
            max=table[name].max,
            at_bound=bool(at_bound) and not table[name].fixed,
            fixed=table[name].fixed,
            kind=table[name].kind,
            prior=table[name].prior,
        )
        for name, value, stderr, sandwich, at_bound in zip(
            names, values, found.spread.stderr, found.spread.sandwich_stderr, stopped, strict=True
        )
    )


def concerning(
    estimates: tuple[Estimate, ...], data: ForceData, nodes: slice, found: Optimal
) -> tuple[Estimate, ...]:
    """Return the estimates for one specimen, without the coefficients of a law with several nodes."""
    count = len(found.problem.names)
    mine = own_names(found.problem.names, data.specimen.name)
    geometry = tuple(e for e in estimates[:count] if e.name in mine)
    laws = of_nodes(estimates, found)[nodes]
    return geometry + (laws[0] if len(laws) == 1 else ())


def of_nodes(estimates: tuple[Estimate, ...], found: Optimal) -> tuple[tuple[Estimate, ...], ...]:
    """Return the coefficient estimates of every node."""
    first, order = len(found.problem.names), found.order
    if not order:
        return ((),)
    return tuple(estimates[k : k + order] for k in range(first, len(estimates), order))


def derived(found: Optimal, place: int, reported: Report) -> tuple[Estimate, ...]:
    """Return the derived quantities of a specimen, with errors from the delta method."""
    part = found.problem.parts[place]
    names, values, slopes = part.family.derived_names, reported.derived, reported.d_derived.T
    own = part.at[: len(slopes)]
    both = np.stack([found.spread.matrix, found.spread.sandwich])[:, own][:, :, own]
    both = np.where(np.isfinite(both), both, 0.0)
    variance = np.einsum("id,kij,jd->kd", slopes, both, slopes).max(axis=0)
    stderr = np.where(variance > 0, np.sqrt(np.maximum(variance, 0)), math.nan)
    return tuple(
        Estimate(name, float(value), float(error), 0.0, math.inf, False, False,
                 _DERIVED_KINDS.get(name, "number"))
        for name, value, error in zip(names, values, stderr, strict=True)
    )  # fmt: skip


_STATIONARY = 1e-6
_PERFECT = 1e-18  # a smaller cost, relative to the squared data, is rounding


def summarise(
    posed: Posed,
    found: Optimal,
    ends: Sequence[End],
    seed: int,
    weights: Weights | None = None,
    pictures: PictureFit | None = None,
) -> tuple[Identification, ...]:
    """Return the identifications at an optimum, one per force map."""
    problem, point = found.problem, found.point
    margins = {kind: constraint_margin(problem, point, kind) for kind in ("drucker", "slope")}
    certificate = _certificate(found, ends, margins)
    feasible = problem.constraint == "none" or certificate.constraint_margin >= -rounding_of(point)
    certified = point.status == Status.OPTIMAL and math.isfinite(certificate.kkt_residual)
    # The gradient of a perfect fit is only rounding.
    perfect = found.end.cost <= _PERFECT * float(problem.force @ problem.force)
    stationary = certificate.gradient_residual <= _STATIONARY or perfect
    estimated = estimates(found, posed.table)
    results = []
    for k, (one, part) in enumerate(zip(posed.data, problem.parts, strict=True)):
        reported = report_of(part, point, k)
        nodes, muscle = _nodes_of(found, k), muscle_at(problem, point, k)
        force = predict(problem, k, point.parameters, point.x, one.length, one.pressure)
        errors = _errors(one, force)
        strain_range, own = float(np.max(reported.largest_strain)), certificate
        if isinstance(muscle, famjax.EquilibriumMuscle):
            strain_range, margin = shape_reached(muscle, one)
            own = dataclasses.replace(certificate, shape_margin=margin)
        results.append(
            Identification(
                data=one,
                mounted=part.mounted(muscle, point.parameters),
                estimates=concerning(estimated, one, nodes, found),
                node_estimates=(),
                derived=derived(found, k, reported),
                coefficients=found.coefficients[nodes],
                coefficients_stderr=coefficient_stderr(found)[nodes],
                node_pressures=None,
                strain_range=strain_range,
                residuals=force[one.loaded] - one.force[one.loaded],
                errors=errors,
                certificate=own,
                active_constraints=_active_sentences(found),
                law=posed.law,
                constraint=posed.constraint,
                dependence="fixed",
                seed=seed,
                weights=_own_weights(weights, problem, k),
                converged=bool(
                    certified and feasible and stationary and math.isfinite(errors.rmse)
                ),
                degrees_of_freedom=found.spread.degrees_of_freedom,
                names=problem.names,
                covariance=found.spread.matrix,
                place=k,
                solved=Solved(problem, found.end),
                pictures=pictures,
            )
        )
    return tuple(results)


def _own_weights(weights: Weights | None, problem: Problem, k: int) -> Float[np.ndarray, " points"]:
    """Relative weight of each loaded reading of a specimen in Huber's objective.

    Other objectives give 1: the weights of the mean RMSE belong to pressures and mark no outliers.
    """
    if weights is None or weights.threshold is None:
        return np.ones(int((problem.parts[k].side == 0).sum()))
    return weights.factor[problem.readings[k]] ** 2


def _nodes_of(found: Optimal, place: int) -> slice:
    """Return the rows of the coefficients that belong to a part: its own, or all."""
    part = found.problem.parts[place]
    if not found.order:
        return slice(0, 1)
    first = int(part.coefficients[0]) // found.order
    return slice(first, first + part.coefficients.size // found.order)


def _certificate(
    found: Optimal, ends: Sequence[End], margins: Mapping[str, list[Margin]]
) -> Certificate:
    problem, point = found.problem, found.point
    lowest = {
        kind: min(float(one.value.min()) for one in of_parts) for kind, of_parts in margins.items()
    }
    costs = np.array([end.cost for end in ends])
    rounding = _PERFECT * float(problem.force @ problem.force)
    return Certificate(
        kkt_residual=point.kkt_residual,
        duality_gap=point.duality_gap,
        gradient_residual=found.end.gradient_residual,
        condition=found.spread.condition,
        stability_margin=lowest["drucker"],
        slope_margin=lowest["slope"],
        constraint_margin={
            "none": math.nan,
            "positive": float(found.coefficients.min(initial=math.inf)),
            **lowest,
        }[problem.constraint],
        between_stations=0.0,
        n_starts=len(ends),
        n_agreeing=int(np.sum(costs <= np.nanmin(costs) * (1 + 1e-6) + rounding)),
    )


def shape_reached(muscle: famjax.EquilibriumMuscle, data: ForceData) -> tuple[float, float]:
    """Return the largest strain [-] and the smallest shape stiffness [N/m] over the loaded readings."""
    at = data.length[data.loaded], data.pressure[data.loaded]
    shape = muscle.profile(*at)
    strains = np.abs([shape.axial_strain, shape.hoop_strain])
    return float(np.max(strains)), float(np.min(muscle.margin(*at)))


def _errors(data: ForceData, force: np.ndarray) -> Errors:
    loaded = data.loaded
    residual = force[loaded] - data.force[loaded]
    pulls = force[data.slack]
    return Errors(
        rmse=float(np.sqrt(np.mean(residual**2))),
        mae=float(np.mean(np.abs(residual))),
        max=float(np.max(np.abs(residual))),
        max_force=data.max_force,
        n_points=int(loaded.sum()),
        n_slack=int(data.slack.sum()),
        slack_violations=int((pulls > 0).sum()),
        max_slack_force=float(np.fmax.reduce(pulls, initial=0.0)),
    )


def _active_sentences(found: Optimal) -> tuple[str, ...]:
    """Describe each active constraint of the convex fit in one sentence."""
    problem, first, sentences = found.problem, 0, []
    active = np.sort(found.point.rows)
    for place, count in enumerate(problem.path_rows):
        here = active[(active >= first) & (active < first + count)]
        sentences += [_path_sentence(found, place, int(row) - first) for row in here]
        first += count
    positive = problem.constraint == "positive"
    for limits, side in ((problem.lowest, "lower"), (problem.coefficient_max, "upper")):
        for row in active[(active >= first) & (active < first + limits.size)]:
            place = int(row - first)
            if positive and side == "lower" and limits[place] == 0:
                sentences.append(Sentence(f"{problem.linear[place]} = 0", _at_node(found, place)))
            else:
                sentences.append(f"{problem.linear[place]} at its {side} bound")
        first += limits.size
    return tuple(dict.fromkeys(sentences))


def _path_sentence(found: Optimal, place: int, row: int) -> str:
    problem = found.problem
    part = problem.parts[place]
    path, station = divmod(row, part.inputs.stations.shape[1])
    at = ""
    if part.coefficients.size > found.order:
        at = Sentence(" at ", Quantity(part.inputs.path_pressure[path], "pressure"))
    share = float(part.inputs.stations[path, station])
    if problem.constraint == "slope":
        return Sentence(f"tangent modulus is 0 at {share:.1%} of the strain range", at)
    return Sentence(f"Drucker modulus is 0 at {share:.1%} of the actuation path", at)


def _at_node(found: Optimal, place: int) -> str:
    part = found.problem.parts[0]
    if part.coefficients.size == found.order:
        return ""
    return Sentence(
        " at ", Quantity(cast(Any, part.family).nodes[place // found.order], "pressure")
    )

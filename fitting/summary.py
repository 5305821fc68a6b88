"""Convert an optimum into an identification: covariance, estimates with errors, certificate."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

import famjax

from .convex import Status
from .covariance import Covariance, covariance
from .data import ForceData
from .engine import Point, muscle_at, partial, predict, report_of, solve
from .pictured import PictureFit
from .posing import Posed
from .problem import Part, Problem
from .response import Constraint, Report
from .result import Certificate, Errors, Estimate, Identification, Solved
from .search import End, Weights, constraint_margin, pseudo_residual, rounding_of

_STEP = 1e-3  # finite-difference step on a path, for the curvature of the modulus


def joint_derivatives(
    point: Point,
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, "k p"], Float[np.ndarray, "m p"]]:
    """Return the weighted residual, and the Jacobians of residual and constraints for (parameters, x)."""
    A, G = point.A, point.G
    d_residual, d_slack = partial(point)
    columns = np.zeros((len(d_residual), A.shape[1]))
    columns[: len(A)] = A
    return (
        point.residual,
        np.concatenate([d_residual, columns], axis=1),
        np.concatenate([d_slack, G], axis=1),
    )


def _covariance(
    problem: Problem, end: End, weights: Weights | None
) -> tuple[Covariance, Bool[np.ndarray, " p"]]:
    """Return the covariance of parameters and coefficients, and True for those fixed or at a bound."""
    residual, jacobian, rows = joint_derivatives(end.point)
    held, rows, bent = held_and_active(problem, end, rows)
    n_priors = residual.size - problem.force.size
    # An inactive censored reading carries no information on noise or parameters.
    off = np.zeros(residual.size, bool)
    off[: problem.force.size] = (problem.side != 0) & (residual[: problem.force.size] == 0)
    residual, jacobian = residual[~off], jacobian[~off]
    if weights is not None and weights.threshold is not None:
        # Restore the original weights; residuals become Huber's pseudo-residuals.
        own = np.concatenate([1 / weights.factor, np.ones(n_priors)])
        unknowns = max(int(np.sum(~held)) - len(set(map(tuple, rows))), 1)
        jacobian = own[:, None] * jacobian
        residual = pseudo_residual(own * residual, weights.factor.size, weights.threshold, unknowns)
    options = {"bent": bent, "n_priors": n_priors, "noise": problem.noise}
    return covariance(jacobian, residual, rows, held, **options), held


def held_and_active(
    problem: Problem, end: End, rows: Float[np.ndarray, "m p"]
) -> tuple[Bool[np.ndarray, " p"], Float[np.ndarray, "a p"], Float[np.ndarray, "c p"]]:
    """Find parameters that are fixed or at a bound, and the effect of active constraints on the others.

    Neighbouring active stations represent one point at which the law touches the constraint. This point
    moves with the parameters, which adds curvature: for the modulus m(s) with multiplier l, the curvature
    of the cost increases by l m_s m_s^T / m_ss, where m_s is the derivative of the modulus gradient with
    respect to s.

    Args:
        problem: the problem with refined stations.
        end: the optimum.
        rows: gradients of all constraints with respect to all parameters.

    Returns:
        (fixed or at a bound; gradients of the active constraints; rows r whose r^T r add up to the added
        curvature).
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
    """Return the active rows at each point where a constraint is active, and the number of path rows."""
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
    """Return rows r whose r^T r add up to the curvature from active constraints, by finite differences."""
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


def _estimates(
    posed: Posed, part: Part, point: Point, spread: Covariance, held: Bool[np.ndarray, " p"]
) -> tuple[Estimate, ...]:
    """Return the estimates for one specimen: its nonlinear parameters, then its coefficients."""
    problem, x = point.problem, point.x
    names, count = problem.names + problem.linear, len(problem.names)
    table, values = [posed.table[name] for name in names], [*point.parameters, *x]
    ends = np.array([(one.min, one.max) for one in table])
    near = np.min(np.abs(np.array(values)[:, None] - ends), axis=1)
    stopped = near <= 1e-9 * np.abs(x).max(initial=0.0)
    stopped[:count] = held[:count]
    return tuple(
        Estimate(
            name=names[k],
            value=float(values[k]),
            stderr=float(spread.stderr[k]),
            at_bound=bool(stopped[k]) and not table[k].fixed,
            fixed=table[k].fixed,
            **dataclasses.asdict(table[k]),
        )
        for k in (*part.at, *(count + part.coefficients))
    )


def _derived(part: Part, spread: Covariance, reported: Report) -> tuple[Estimate, ...]:
    """Return the derived quantities of a specimen, with errors from the delta method."""
    names, values, slopes = part.family.derived_names, reported.derived, reported.d_derived.T
    own = part.at[: len(slopes)]
    both = np.stack([spread.matrix, spread.sandwich])[:, own][:, :, own]
    both = np.where(np.isfinite(both), both, 0.0)
    variance = np.einsum("id,kij,jd->kd", slopes, both, slopes).max(axis=0)
    stderr = np.where(variance > 0, np.sqrt(np.maximum(variance, 0)), math.nan)
    kinds = {"thread_length": "length"}  # anything else is a number
    return tuple(
        Estimate(name, float(value), float(error), 0.0, math.inf, False, False,
                 kinds.get(name, "number"))
        for name, value, error in zip(names, values, stderr, strict=True)
    )  # fmt: skip


_STATIONARY = 1e-6
_PERFECT = 1e-18  # a smaller cost, relative to the squared data, is rounding


def summarise(
    posed: Posed,
    end: End,
    ends: Sequence[End],
    seed: int,
    weights: Weights | None = None,
    pictures: PictureFit | None = None,
) -> tuple[Identification, ...]:
    """Return the identifications at an optimum, one for each force map.

    Args:
        posed: the problem before its stations were refined.
        end: the optimum, with the refined problem in its point.
        ends: end points of all descents.
        seed: random seed of the starts.
        weights: weights used by the objective, if any.
        pictures: photographed and computed profiles, if fitted together.
    """
    point, problem, order = end.point, end.point.problem, posed.law.order
    spread, held = _covariance(problem, end, weights)
    rounding = _PERFECT * float(problem.force @ problem.force)
    certificate = _certificate(problem, end, ends, spread.condition, rounding)
    feasible = problem.constraint == "none" or certificate.constraint_margin >= -rounding_of(point)
    certified = point.status == Status.OPTIMAL and math.isfinite(certificate.kkt_residual)
    # The gradient of a perfect fit is only rounding.
    stationary = certificate.gradient_residual <= _STATIONARY or end.cost <= rounding
    results = []
    # Other objectives give 1: the weights of the mean RMSE mark no outliers.
    factor = None if weights is None or weights.threshold is None else weights.factor
    for k, (one, part) in enumerate(zip(posed.data, problem.parts, strict=True)):
        reported = report_of(part, point, k)
        muscle = muscle_at(problem, point, k)
        force = predict(problem, k, point.parameters, point.x, one.length, one.pressure)
        errors, loaded = _errors(one, force), one.loaded
        strain_range, own = float(np.max(reported.largest_strain)), certificate
        if not isinstance(muscle, famjax.Muscle):
            at = one.length[loaded], one.pressure[loaded]
            shape, margin = muscle.profile(*at), float(np.min(muscle.margin(*at)))
            strain_range = float(np.max(np.abs([shape.axial_strain, shape.hoop_strain])))
            own = dataclasses.replace(certificate, shape_margin=margin)
        results.append(
            Identification(
                data=one,
                mounted=part.mounted(muscle, point.parameters),
                estimates=_estimates(posed, part, point, spread, held),
                derived=_derived(part, spread, reported),
                coefficients=point.x[part.coefficients].reshape(-1 if order else 1, order),
                strain_range=strain_range,
                residuals=force[loaded] - one.force[loaded],
                errors=errors,
                certificate=own,
                active_constraints=_active(problem, point),
                law=posed.law,
                constraint=posed.constraint,
                seed=seed,
                weights=np.ones(loaded.sum())
                if factor is None
                else factor[problem.readings[k]] ** 2,
                converged=bool(
                    certified and feasible and stationary and math.isfinite(errors.rmse)
                ),
                degrees_of_freedom=spread.degrees_of_freedom,
                names=problem.names,
                covariance=spread.matrix,
                place=k,
                solved=Solved(problem, end),
                pictures=pictures,
            )
        )
    return tuple(results)


def _certificate(
    problem: Problem, end: End, ends: Sequence[End], condition: float, rounding: float
) -> Certificate:
    point = end.point

    def margin(kind: Constraint) -> float:
        return min(float(one.value.min()) for one in constraint_margin(problem, point, kind))

    stability, own = margin("drucker"), math.nan
    if problem.constraint == "positive":
        own = float(point.x.min(initial=math.inf))
    elif problem.constraint != "none":
        own = stability if problem.constraint == "drucker" else margin("slope")
    costs = np.array([end.cost for end in ends])
    return Certificate(
        kkt_residual=point.kkt_residual,
        duality_gap=point.duality_gap,
        gradient_residual=end.gradient_residual,
        condition=condition,
        stability_margin=stability,
        constraint_margin=own,
        n_starts=len(ends),
        n_agreeing=int(np.sum(costs <= np.nanmin(costs) * (1 + 1e-6) + rounding)),
    )


def _errors(data: ForceData, force: np.ndarray) -> Errors:
    loaded = data.loaded
    residual = force[loaded] - data.force[loaded]
    pulls = force[data.slack]
    return Errors(
        rmse=float(np.sqrt(np.mean(residual**2))),
        max=float(np.max(np.abs(residual))),
        max_force=data.max_force,
        n_points=int(loaded.sum()),
        max_slack_force=float(np.fmax.reduce(pulls, initial=0.0)),
    )


_MODULI = {
    "drucker": "Drucker modulus is 0 at a point {:.1%} along the actuation path",
    "slope": "tangent modulus is 0 at {:.1%} of the largest strain",
}


def _active(problem: Problem, point: Point) -> tuple[str, ...]:
    """Describe each active constraint of the convex fit in one phrase."""
    rows, told = np.sort(point.rows), []
    stations = [part.inputs.stations.ravel() for part in problem.parts]
    first = sum(problem.path_rows)
    for share in np.concatenate(stations)[rows[rows < first]]:
        told.append(_MODULI[problem.constraint].format(share))
    bounds = [f"{name} at its {end} bound" for end in ("lower", "upper") for name in problem.linear]
    return tuple(dict.fromkeys([*told, *(bounds[row - first] for row in rows[rows >= first])]))

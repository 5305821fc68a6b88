"""From an optimum to what a reader needs: estimates with errors, certificate, warnings."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.sentence import Quantity, Sentence

from ..convex import Status
from ..data.force_data import ForceData
from ..descent import End
from ..engine import Point, numbers_of, report_of
from ..families.muscle_family import MuscleFamily
from ..margins import Margin, constraint_margin
from ..problem import Part, Problem
from ..response import unflat
from .estimates import coefficient_stderr, concerning, derived, estimates, of_nodes
from .multi_start import rounding_of
from .optimal import Optimal
from .posing import Posed
from .result import Certificate, Errors, Identification, force_at_readings
from .robust import Robust

_STATIONARY = 1e-6
_PERFECT = 1e-18  # a cost of this part of the data's own square is zero but for rounding


def summarise(
    posed: Posed,
    found: Optimal,
    ends: Sequence[End],
    seed: int,
    robust: Robust | None = None,
) -> tuple[Identification, ...]:
    """The identifications, one for each force map, that an optimum stands for."""
    problem, point = found.problem, found.point
    margins = {kind: constraint_margin(problem, point, kind) for kind in ("drucker", "slope")}
    certificate = _certificate(found, ends, margins)
    feasible = problem.constraint == "none" or certificate.constraint_margin >= -rounding_of(point)
    certified = point.status == Status.OPTIMAL and math.isfinite(certificate.kkt_residual)
    # A fit without error has only rounding left, and that has no direction.
    perfect = found.end.cost <= _PERFECT * float(problem.force @ problem.force)
    stationary = certificate.gradient_residual <= _STATIONARY or perfect
    order = np.argsort([end.cost for end in ends])
    estimated = estimates(found, posed.table)
    results = []
    for k, (one, part) in enumerate(zip(posed.data, problem.parts, strict=True)):
        reported = report_of(part, point, k)
        nodes, muscle = _nodes_of(found, k), _muscle_of(part, reported.numbers)
        force = force_at_readings(one, problem, k, point)
        errors = _errors(one, force)
        pressures = getattr(muscle.material, "node_pressures", None)
        results.append(
            Identification(
                data=one,
                mounted=part.mounted(muscle, point.parameters),
                length_offsets=point.parameters[part.at[len(part.family.nonlinear) :]],
                estimates=concerning(estimated, one, nodes, found),
                node_estimates=() if pressures is None else of_nodes(estimated, found),
                derived=derived(found, k, reported),
                coefficients=found.coefficients[nodes],
                coefficients_stderr=coefficient_stderr(found)[nodes],
                node_pressures=None if pressures is None else np.asarray(pressures),
                strain_range=float(np.max(reported.largest_strain)),
                residuals=force[one.loaded] - one.force[one.loaded],
                errors=errors,
                certificate=certificate,
                active_constraints=_active_sentences(found),
                starts=np.array([ends[i].cost for i in order]),
                start_parameters=np.stack([ends[i].point.parameters for i in order]),
                law=posed.law,
                constraint=posed.constraint,
                dependence=posed.dependence,
                box=posed.box,
                seed=seed,
                weights=_own_weights(robust, problem, k),
                converged=bool(
                    certified and feasible and stationary and math.isfinite(errors.rmse)
                ),
                degrees_of_freedom=found.spread.degrees_of_freedom,
                covariance=found.spread.matrix,
                problem=problem,
                end=found.end,
                place=k,
            )
        )
    return tuple(results)


def muscle_at(problem: Problem, point: Point, place: int) -> famjax.Muscle:
    """The muscle of a part at a fit; nothing is compiled for it."""
    part = problem.parts[place]
    return _muscle_of(part, numbers_of(part, point))


def _muscle_of(part: Part, numbers: Float[np.ndarray, " l"]) -> famjax.Muscle:
    return cast(MuscleFamily, part.family).final(unflat(part.family, numbers))


def _own_weights(robust: Robust | None, problem: Problem, k: int) -> Float[np.ndarray, " points"]:
    """The part of its own weight with which each loaded reading of a specimen counts."""
    if robust is None:
        return np.ones(int((problem.parts[k].side == 0).sum()))
    return robust.weight[problem.readings[k]] ** 2


def _nodes_of(found: Optimal, place: int) -> slice:
    """Which rows of the coefficients belong to a part: its own, or all."""
    part = found.problem.parts[place]
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
            "positive": float(found.coefficients.min()),
            **lowest,
        }[problem.constraint],
        between_stations=max(one.bound for one in margins["drucker"]),
        n_starts=len(ends),
        n_agreeing=int(np.sum(costs <= np.nanmin(costs) * (1 + 1e-6) + rounding)),
    )


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
        max_slack_force=float(pulls.max(initial=0.0)),
    )


def _active_sentences(found: Optimal) -> tuple[str, ...]:
    """One sentence for each active row of the convex fit."""
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
        return Sentence(f"tangent modulus 0 at {share:.1%} of the strain range", at)
    reported = report_of(part, found.point, place)
    contraction = share * (1 - float(reported.path_end[path] / reported.rest))
    return Sentence(f"Drucker modulus 0 at contraction {contraction:.4f}", at)


def _at_node(found: Optimal, place: int) -> str:
    part = found.problem.parts[0]
    if part.coefficients.size == found.order:
        return ""
    return Sentence(
        " at ", Quantity(cast(Any, part.family).nodes[place // found.order], "pressure")
    )

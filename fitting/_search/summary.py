"""From an optimum to what a reader needs: estimates with errors, certificate, warnings."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

import famjax

from .._convex.qp import Status
from .._data.force_data import ForceData
from .._model.margin import path_margin, slope_margin
from .._model.parameters import Entry
from .._model.part import Part
from .._model.problem import PressureDependence, Problem
from .box import BoxOptimum
from .doubts import warnings
from .estimates import coefficient_stderr, concerning, derived, estimates, of_nodes
from .optimal import Optimal, optimal
from .result import Certificate, Errors, Identification
from .robust import Robust
from .search import FEASIBLE, Search

_STATIONARY = 1e-6
_PERFECT = 1e-18  # a cost of this part of the data's own square is zero but for rounding


def summarise(
    data: Sequence[ForceData],
    search: Search,
    best: BoxOptimum,
    ends: BoxOptimum,
    table: Mapping[str, Entry],
    *,
    dependence: PressureDependence,
    box: str,
    seed: int,
    robust: Robust | None = None,
) -> tuple[Identification, ...]:
    """The identifications, one for each force map, that the best descent stands for."""
    found = optimal(search, best, robust)
    problem, optimum = search.problem, found.optimum
    certificate = _certificate(found, best, ends, np.concatenate([d.force for d in data]))
    allowed = -FEASIBLE * np.abs(found.coefficients).max()
    feasible = problem.constraint == "none" or certificate.constraint_margin >= allowed
    certified = bool(np.all(np.asarray(optimum.status) == int(Status.OPTIMAL)))
    certified &= math.isfinite(certificate.kkt_residual)
    # A fit without error has only rounding left, and that has no direction.
    perfect = float(best.cost) <= _PERFECT * sum(float(one.force @ one.force) for one in data)
    stationary = certificate.gradient_residual <= _STATIONARY or perfect
    muscles = problem.muscles(found.parameters, optimum.x)
    order = np.argsort(ends.cost)
    estimated = estimates(found, table)
    results = []
    for k, (one, part, muscle) in enumerate(zip(data, problem.parts, muscles, strict=True)):
        nodes = _nodes_of(problem, k)
        material = muscle.material
        offsets = found.parameters[jnp.asarray(part.offsets, int)]
        result = Identification(
            data=one,
            muscle=muscle,
            series_compliance=float(part.compliance(found.parameters)),
            length_offsets=np.asarray(offsets),
            estimates=concerning(estimated, one, nodes, problem),
            node_estimates=(
                of_nodes(estimated, problem)
                if isinstance(material, famjax.PressurePolynomialMaterial)
                else ()
            ),
            derived=derived(found, part),
            coefficients=found.coefficients[nodes],
            coefficients_stderr=coefficient_stderr(found)[nodes],
            node_pressures=(
                np.asarray(material.node_pressures)
                if isinstance(material, famjax.PressurePolynomialMaterial)
                else None
            ),
            strain_range=float(jnp.max(part.largest_strain(found.parameters))),
            residuals=np.zeros(0),
            errors=_errors(one, one.force),
            certificate=certificate,
            active_constraints=_active_sentences(problem, found),
            starts=np.asarray(ends.cost)[order],
            start_parameters=np.asarray(jax.vmap(search.parameters)(jnp.asarray(ends.u)[order])),
            law=problem.law,
            constraint=problem.constraint,
            dependence=dependence,
            box=box,
            seed=seed,
            weights=_own_weights(robust, problem, k),
            converged=certified and feasible and stationary,
            warnings=(),
            degrees_of_freedom=found.spread.degrees_of_freedom,
            covariance=found.spread.matrix,
            search=search,
            unit_optimum=np.asarray(best.u),
        )
        force = result.model_force()
        loaded = one.loaded
        result = dataclasses.replace(
            result,
            residuals=force[loaded] - one.force[loaded],
            errors=_errors(one, force),
            converged=result.converged and bool(np.isfinite(force[loaded]).all()),
        )
        results.append(
            dataclasses.replace(result, warnings=warnings(result, found.spread, search.names))
        )
    return tuple(results)


def _own_weights(robust: Robust | None, problem: Problem, k: int) -> Float[np.ndarray, " points"]:
    """The part of its own weight with which each loaded reading of a specimen counts."""
    sizes = [part.force.shape[0] for part in problem.parts]
    if robust is None:
        return np.ones(sizes[k])
    first = sum(sizes[:k])
    return robust.weight[first : first + sizes[k]] ** 2


def _nodes_of(problem: Problem, part: int) -> slice:
    """Which rows of the coefficients belong to a part: its own, or all."""
    own = len(problem.parts) > 1 and problem.nodes == len(problem.parts)
    return slice(part, part + 1) if own else slice(None)


def _certificate(
    found: Optimal, best: BoxOptimum, ends: BoxOptimum, force: np.ndarray
) -> Certificate:
    problem, optimum = found.problem, found.optimum
    stability, slope = (
        min(float(value.min()) for _, value in margin(problem, found.parameters, optimum.x))
        for margin in (path_margin, slope_margin)
    )
    return Certificate(
        kkt_residual=float(jnp.max(optimum.kkt_residual)),
        duality_gap=float(jnp.max(optimum.duality_gap)),
        gradient_residual=float(best.gradient_residual),
        condition=found.spread.condition,
        stability_margin=stability,
        slope_margin=slope,
        constraint_margin={
            "none": math.nan,
            "positive": float(found.coefficients.min()),
            "slope": slope,
            "drucker": stability,
        }[problem.constraint],
        n_starts=len(ends.cost),
        n_agreeing=int(
            np.sum(ends.cost <= np.nanmin(ends.cost) * (1 + 1e-6) + _PERFECT * force @ force)
        ),
    )


def _errors(data: ForceData, force: np.ndarray) -> Errors:
    loaded = data.loaded
    residual = force[loaded] - data.force[loaded]
    pulls = force[~loaded]
    return Errors(
        rmse=float(np.sqrt(np.mean(residual**2))),
        mae=float(np.mean(np.abs(residual))),
        max=float(np.max(np.abs(residual))),
        max_force=data.max_force,
        n_points=int(loaded.sum()),
        n_slack=int((~loaded).sum()),
        slack_violations=int((pulls > 0).sum()),
        max_slack_force=float(pulls.max(initial=0.0)),
    )


def _active_sentences(problem: Problem, found: Optimal) -> tuple[str, ...]:
    """One sentence for each active row of the convex fit."""
    active = np.asarray(found.optimum.active)
    sentences, first = [], 0
    for part in problem.parts:
        count = part.path_end.shape[1] * (problem.rows_per_path(part) + 2 * problem.order)
        for block, row in np.argwhere(active[:, first : first + count]):
            sentences.append(_active_sentence(problem, part, found, int(block), int(row)))
        first += count
    return tuple(dict.fromkeys(sentences))


def _active_sentence(problem: Problem, part: Part, found: Optimal, block: int, row: int) -> str:
    per_path, paths = problem.rows_per_path(part), part.path_end.shape[1]
    names = tuple(problem.law.coefficients)
    if row >= paths * per_path:
        which = (row - paths * per_path) % (2 * problem.order)
        side = "lower" if which < problem.order else "upper"
        return f"{names[which % problem.order]} at its {side} bound"
    path, station = divmod(row, per_path)
    several = problem.blocks * problem.nodes > 1 and len(problem.parts) == 1
    pressure = float(part.path_pressure[block, path]) / 1e3
    at = f" at {pressure:.4g} kPa" if several else ""
    if problem.constraint == "positive":
        return f"{names[station]} = 0{at}"
    place = float(part.stations[block, path, station])
    if problem.constraint == "slope":
        return f"tangent modulus 0 at {place:.1%} of the strain range{at}"
    rest, end = part.path_ends(found.parameters)
    contraction = place * (1 - float(end[block, path] / rest))
    return f"Drucker modulus 0 at contraction {contraction:.4f}{at}"

"""From an optimum to what a reader needs: estimates with errors, certificate, warnings."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import famjax

from .._convex.qp import Optimum, Status
from .._data.force_data import ForceData
from .._model.geometry_source import EstimatedSource
from .._model.margin import path_margin, slope_margin
from .._model.parameters import Entry
from .._model.part import Part
from .._model.problem import PressureDependence, Problem
from .box import BoxOptimum
from .build import own_names
from .doubts import warnings
from .quick_jit import quick_jit
from .result import Certificate, Errors, Estimate, Identification
from .search import FEASIBLE, Search, solve
from .uncertainty import Covariance, covariance

_STATIONARY = 1e-6
_PERFECT = 1e-18  # a cost of this part of the data's own square is zero but for rounding


@dataclasses.dataclass(frozen=True)
class Optimal:
    """An optimum and all that is derived of it before it is told to a reader.

    Attributes:
        search: with its stations placed.
        parameters: nonlinear parameters [SI], shape (q,).
        optimum: of the convex fit.
        spread: covariance of the nonlinear parameters and then the coefficients.
        at_bound: nonlinear parameters on a bound.
    """

    search: Search
    parameters: Float[Array, " q"]
    optimum: Optimum
    spread: Covariance
    at_bound: Bool[np.ndarray, " q"]

    @property
    def problem(self) -> Problem:
        """The problem of the search."""
        return self.search.problem

    @property
    def coefficients(self) -> Float[np.ndarray, "nodes order"]:
        """Coefficients [Pa] of every node of every block."""
        return np.asarray(self.optimum.x).reshape(-1, self.problem.order)


@quick_jit
def joint_derivatives(
    problem: Problem, parameters: Float[Array, " q"], x: Float[Array, "blocks n"]
) -> tuple[Array, Array, Array]:
    """Weighted residual, its Jacobian and that of the constraint rows, in (parameters, x)."""
    reaches = problem.reaches(parameters)

    def both(parameters: Float[Array, " q"], flat: Float[Array, " n"]) -> tuple[Array, Array]:
        coefficients = flat.reshape(x.shape)
        _, _, G, h = problem.programmes(parameters, reaches)
        slack = (jnp.einsum("bmn,bn->bm", G, coefficients) - h).ravel()
        return problem.joint_residual(parameters, coefficients, reaches), slack

    residual, _ = both(parameters, x.ravel())
    (rp, rx), (cp, cx) = jax.jacfwd(both, argnums=(0, 1))(parameters, x.ravel())
    return residual, jnp.concatenate([rp, rx], axis=1), jnp.concatenate([cp, cx], axis=1)


def optimal(search: Search, best: BoxOptimum) -> Optimal:
    """The optimum at the end of a descent, with its covariance."""
    parameters = search.parameters(best.u)
    optimum = solve(search.problem, parameters)
    moves, at_bound = np.zeros((2, len(search.names)), bool)
    u = np.asarray(best.u)
    moves[list(search.free)] = True
    at_bound[list(search.free)] = (u <= 1e-9) | (u >= 1 - 1e-9)
    held = np.concatenate([at_bound | ~moves, np.zeros(search.problem.n_coefficients, bool)])
    residual, jacobian, rows = map(
        np.asarray, joint_derivatives(search.problem, parameters, optimum.x)
    )
    active = np.asarray(optimum.active).ravel()
    n_priors = residual.size - sum(part.force.shape[0] for part in search.problem.parts)
    noise = float(search.problem.prior_weight)
    spread = covariance(jacobian, residual, rows[active], held, n_priors=n_priors, noise=noise)
    return Optimal(search, parameters, optimum, spread, at_bound)


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
) -> tuple[Identification, ...]:
    """The identifications, one for each force map, that the best descent stands for."""
    found = optimal(search, best)
    problem, optimum = search.problem, found.optimum
    certificate = _certificate(found, best, ends, np.concatenate([d.force for d in data]))
    allowed = -FEASIBLE * np.abs(found.coefficients).max()
    feasible = problem.constraint == "none" or certificate.constraint_margin >= allowed
    certified = bool(np.all(np.asarray(optimum.status) == int(Status.OPTIMAL)))
    certified &= math.isfinite(certificate.kkt_residual)
    muscles = problem.muscles(found.parameters, optimum.x)
    order = np.argsort(ends.cost)
    estimates = _estimates(found, table)
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
            estimates=_concerning(estimates, one, nodes, problem),
            derived=_derived(found, part),
            coefficients=found.coefficients[nodes],
            coefficients_stderr=_coefficient_stderr(found)[nodes],
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
            converged=certified and feasible and certificate.gradient_residual <= _STATIONARY,
            warnings=(),
            degrees_of_freedom=found.spread.degrees_of_freedom,
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


def _coefficient_stderr(found: Optimal) -> Float[np.ndarray, "nodes order"]:
    return found.spread.stderr[len(found.search.names) :].reshape(found.coefficients.shape)


def _estimates(found: Optimal, table: Mapping[str, Entry]) -> tuple[Estimate, ...]:
    """Every nonlinear parameter, then the coefficients of every node."""
    linear = tuple(found.problem.law.coefficients)
    names = found.search.names + linear * len(found.coefficients)
    values = np.concatenate([found.parameters, found.coefficients.ravel()])
    ends = np.array([(table[name].min, table[name].max) for name in names])
    rounding = 1e-9 * np.abs(found.coefficients).max()
    stopped = np.min(np.abs(values[:, None] - ends), axis=1) <= rounding
    stopped[: len(found.at_bound)] = found.at_bound
    return tuple(
        _estimate(name, float(value), errors, table[name], bool(at_bound))
        for name, value, errors, at_bound in zip(
            names,
            values,
            zip(found.spread.stderr, found.spread.sandwich_stderr, strict=True),
            stopped,
            strict=True,
        )
    )


def _estimate(
    name: str, value: float, errors: tuple[float, float], entry: Entry, stopped: bool
) -> Estimate:
    return Estimate(
        name=name,
        value=value,
        stderr=float(errors[0]),
        sandwich_stderr=float(errors[1]),
        min=entry.min,
        max=entry.max,
        at_bound=stopped and not entry.fixed,
        fixed=entry.fixed,
        kind=entry.kind,
        prior=entry.prior,
    )


def _concerning(
    estimates: tuple[Estimate, ...], data: ForceData, nodes: slice, problem: Problem
) -> tuple[Estimate, ...]:
    """The estimates that concern one specimen; a law with several nodes is told elsewhere."""
    count = len(estimates) - problem.n_coefficients
    mine = own_names([e.name for e in estimates[:count]], data.specimen.name)
    geometry = tuple(e for e in estimates[:count] if e.name in mine)
    order = problem.order
    laws = [estimates[count + k * order :][:order] for k in range(problem.n_coefficients // order)]
    return geometry + (laws[nodes][0] if len(laws[nodes]) == 1 else ())


def _derived(found: Optimal, part: Part) -> tuple[Estimate, ...]:
    """Thread length and turns of an estimated geometry, with errors by the delta method."""
    source = part.source
    if not isinstance(source, EstimatedSource):
        return ()

    def quantities(parameters: Float[Array, " q"]) -> Float[Array, " 2"]:
        geometry = source.geometry(part.values(parameters))
        if isinstance(geometry, famjax.EndEffectGeometry):
            geometry = geometry.cylinder
        assert isinstance(geometry, famjax.EstimatedGeometry)
        return jnp.stack([geometry.braid.rest_thread_length, geometry.braid.turns])

    slopes = np.asarray(jax.jit(jax.jacfwd(quantities))(found.parameters))
    count = len(found.search.names)
    matrix = found.spread.matrix[:count, :count]
    known = np.isfinite(np.diag(matrix))
    matrix = np.where(known[:, None] & known, matrix, 0.0)
    variance = np.einsum("ij,jk,ik->i", slopes, matrix, slopes)
    stderr = np.where(variance > 0, np.sqrt(variance), math.nan)
    return tuple(
        Estimate(name, float(value), float(error), 0.0, math.inf, False, False, kind)
        for name, kind, value, error in zip(
            ("thread_length", "turns"),
            ("length", "number"),
            quantities(found.parameters),
            stderr,
            strict=True,
        )
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

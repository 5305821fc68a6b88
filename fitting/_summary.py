"""From an optimum to what a reader needs: estimates with errors, certificate, warnings."""

import dataclasses
import math

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

import famjax

from ._box import BoxOptimum
from ._data import ForceData
from ._geometry_source import EstimatedSource
from ._margin import path_margin, slope_margin
from ._parameters import GEOMETRY, Bounds, coefficient_names, kind_of
from ._problem import PressureDependence, Problem
from ._qp import Optimum, Status
from ._result import Certificate, Errors, Estimate, Identification
from ._search import FEASIBLE, Search, solve
from ._uncertainty import CONDITION_LIMIT, Covariance, covariance

_STATIONARY = 1e-6
_PERFECT = 1e-18  # a cost of this part of the data's own square is zero but for rounding
_RIDGE = 0.98


@eqx.filter_jit
def _joint_derivatives(
    problem: Problem, geometry: Float[Array, " 3"], x: Float[Array, "blocks n"]
) -> tuple[Array, Array, Array]:
    """Weighted residual, its Jacobian and that of the constraint rows, in (geometry, x)."""

    def both(geometry: Float[Array, " 3"], flat: Float[Array, " n"]) -> tuple[Array, Array]:
        A, b, G, h = problem.programmes(geometry)
        coefficients = flat.reshape(x.shape)
        residual = jnp.sum(jnp.einsum("bkn,bn->bk", A, coefficients) - b, axis=0)
        return residual, (jnp.einsum("bmn,bn->bm", G, coefficients) - h).ravel()

    residual, _ = both(geometry, x.ravel())
    (rg, rx), (cg, cx) = jax.jacfwd(both, argnums=(0, 1))(geometry, x.ravel())
    return residual, jnp.concatenate([rg, rx], axis=1), jnp.concatenate([cg, cx], axis=1)


def summarise(
    data: ForceData,
    search: Search,
    best: BoxOptimum,
    ends: BoxOptimum,
    limits: dict[str, Bounds],
    dependence: PressureDependence,
    box: str,
    seed: int,
) -> Identification:
    """The identification that the best descent stands for."""
    problem, geometry = search.problem, search.geometry(best.u)
    optimum = solve(problem, geometry)
    material = problem.material(optimum.x)
    muscle = problem.muscle(geometry, material)
    coefficients = np.asarray(optimum.x).reshape(-1, problem.order)
    at_bound = _geometry_at_bound(search, best)
    held = np.concatenate([at_bound | ~_moves(search), np.zeros(coefficients.size, bool)])
    residual, jacobian, rows = map(np.asarray, _joint_derivatives(problem, geometry, optimum.x))
    active = np.asarray(optimum.active).ravel()
    spread = covariance(jacobian, residual, rows[active], held)
    stability = path_margin(problem, geometry, muscle)[1]
    slope = slope_margin(problem, geometry, muscle)[1]
    certificate = Certificate(
        kkt_residual=float(jnp.max(optimum.kkt_residual)),
        duality_gap=float(jnp.max(optimum.duality_gap)),
        gradient_residual=float(best.gradient_residual),
        condition=spread.condition,
        stability_margin=float(stability.min()),
        slope_margin=float(slope.min()),
        constraint_margin={
            "none": math.nan,
            "positive": float(coefficients.min()),
            "slope": float(slope.min()),
            "drucker": float(stability.min()),
        }[problem.constraint],
        n_starts=len(ends.cost),
        n_agreeing=int(
            np.sum(ends.cost <= best.cost * (1 + 1e-6) + _PERFECT * data.force @ data.force)
        ),
    )
    feasible = not certificate.constraint_margin < -FEASIBLE * np.abs(coefficients).max()
    optimal = bool(np.all(np.asarray(optimum.status) == int(Status.OPTIMAL)))
    loaded = data.loaded
    force = np.asarray(eqx.filter_jit(muscle.force)(data.length, data.pressure))
    estimates = _geometry_estimates(geometry, spread, limits, at_bound)
    if coefficients.shape[0] == 1:
        estimates += _coefficient_estimates(coefficients[0], spread, limits)
    result = Identification(
        data=data,
        muscle=muscle,
        estimates=estimates,
        derived=_derived(problem, geometry, spread),
        coefficients=coefficients,
        coefficients_stderr=spread.stderr[len(GEOMETRY) :].reshape(coefficients.shape),
        node_pressures=(
            np.asarray(material.node_pressures)
            if isinstance(material, famjax.PressurePolynomialMaterial)
            else None
        ),
        strain_range=float(jnp.max(problem.largest_strain(geometry))),
        residuals=force[loaded] - data.force[loaded],
        errors=_errors(data, force),
        certificate=certificate,
        active_constraints=_active_sentences(problem, optimum),
        starts=np.sort(ends.cost),
        order=problem.order,
        constraint=problem.constraint,
        dependence=dependence,
        box=box,
        seed=seed,
        converged=optimal and feasible and certificate.gradient_residual <= _STATIONARY,
        warnings=(),
    )
    return dataclasses.replace(result, warnings=_warnings(result, spread))


def _moves(search: Search) -> Bool[np.ndarray, " 3"]:
    moves = np.zeros(len(GEOMETRY), bool)
    moves[list(search.free)] = True
    return moves


def _geometry_at_bound(search: Search, best: BoxOptimum) -> Bool[np.ndarray, " 3"]:
    at_bound = np.zeros(len(GEOMETRY), bool)
    u = np.asarray(best.u)
    at_bound[list(search.free)] = (u <= 1e-9) | (u >= 1 - 1e-9)
    return at_bound


def _geometry_estimates(
    geometry: Array, spread: Covariance, limits: dict[str, Bounds], at_bound: np.ndarray
) -> tuple[Estimate, ...]:
    return tuple(
        Estimate(
            name=name,
            value=float(geometry[k]),
            stderr=float(spread.stderr[k]),
            min=limits[name].min,
            max=limits[name].max,
            at_bound=bool(at_bound[k]),
            fixed=limits[name].fixed,
            kind=kind_of(name),
        )
        for k, name in enumerate(GEOMETRY)
    )


def _coefficient_estimates(
    values: np.ndarray, spread: Covariance, limits: dict[str, Bounds]
) -> tuple[Estimate, ...]:
    scale = np.abs(values).max()
    estimates = []
    for k, name in enumerate(coefficient_names(values.size)):
        bound = limits[name]
        near = min(abs(values[k] - bound.min), abs(values[k] - bound.max))
        estimates.append(
            Estimate(
                name=name,
                value=float(values[k]),
                stderr=float(spread.stderr[len(GEOMETRY) + k]),
                min=bound.min,
                max=bound.max,
                at_bound=bool(near <= 1e-9 * scale) and not bound.fixed,
                fixed=bound.fixed,
                kind="stress",
            )
        )
    return tuple(estimates)


def _derived(problem: Problem, geometry: Array, spread: Covariance) -> tuple[Estimate, ...]:
    """Thread length and turns of an estimated geometry, with errors by the delta method."""
    if not isinstance(problem.source, EstimatedSource):
        return ()

    def quantities(geometry: Float[Array, " 3"]) -> Float[Array, " 2"]:
        muscle = problem.muscle(geometry, famjax.PolynomialMaterial(jnp.zeros(1)))
        assert isinstance(muscle.geometry, famjax.EstimatedGeometry)
        return jnp.stack([muscle.geometry.braid.rest_thread_length, muscle.geometry.braid.turns])

    slopes = np.asarray(jax.jit(jax.jacfwd(quantities))(geometry))
    matrix = spread.matrix[: len(GEOMETRY), : len(GEOMETRY)]
    known = np.isfinite(np.diag(matrix))
    matrix = np.where(known[:, None] & known, matrix, 0.0)
    variance = np.einsum("ij,jk,ik->i", slopes, matrix, slopes)
    stderr = np.where(variance > 0, np.sqrt(variance), math.nan)
    return tuple(
        Estimate(name, float(value), float(error), 0.0, math.inf, False, False, kind)
        for name, kind, value, error in zip(
            ("thread_length", "turns"),
            ("length", "number"),
            quantities(geometry),
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


def _active_sentences(problem: Problem, optimum: Optimum) -> tuple[str, ...]:
    """One sentence for each active row of the convex fit."""
    rest, stations = problem.rest_length, problem.path_end.shape[1]
    per_path = problem.constraint_rows_per_path
    sentences = []
    for block, row in np.argwhere(np.asarray(optimum.active)):
        if row >= stations * per_path:
            which = (row - stations * per_path) % (2 * problem.order)
            side = "lower" if which < problem.order else "upper"
            sentences.append(f"E_{which % problem.order + 1} at its {side} bound")
            continue
        path, station = divmod(int(row), per_path)
        pressure = float(problem.path_pressure[block, path]) / 1e3
        at = (
            ""
            if problem.basis.shape[1] * problem.weights.shape[0] == 1
            else f" at {pressure:.4g} kPa"
        )
        if problem.constraint == "positive":
            sentences.append(f"E_{station + 1} = 0{at}")
            continue
        part = float(problem.stations[block, path, station])
        if problem.constraint == "slope":
            sentences.append(f"tangent modulus 0 at {part:.1%} of the strain range{at}")
        else:
            contraction = part * (1 - float(problem.path_end[block, path]) / rest)
            sentences.append(f"Drucker modulus 0 at contraction {contraction:.4f}{at}")
    return tuple(dict.fromkeys(sentences))


def _warnings(result: Identification, spread: Covariance) -> tuple[str, ...]:
    """What a reader must know before using the numbers."""
    warnings = list(result.data.notes)
    if result.box == "open":
        warnings.append(
            "The box is open: braid diameter and angle are then only fit parameters, not the "
            "dimensions of a muscle that could be built."
        )
    stopped = [e.name for e in result.estimates if e.at_bound]
    if stopped:
        warnings.append(
            f"At a bound: {', '.join(stopped)}. The data alone would go further, so no standard "
            "error is given; the errors of the others hold with these kept where they are."
        )
    if not np.isfinite(spread.condition) or spread.condition > CONDITION_LIMIT:
        warnings.append(
            "The parameters cannot be told apart by these data, so no standard errors are given: "
            "fix one of them by --bounds, or add lengths and pressures."
        )
    warnings += _ridges(spread)
    if result.active_constraints:
        warnings.append(
            f"The {result.constraint} constraint is active: standard errors hold along it only."
        )
    if result.certificate.stability_margin < -FEASIBLE * np.abs(result.coefficients).max():
        warnings.append(
            f"The law is NOT Drucker-stable on the actuation path (margin "
            f"{result.certificate.stability_margin / 1e6:.4g} MPa): do not extrapolate or simulate "
            "with it; --constraint drucker gives the best stable law."
        )
    errors = result.errors
    if errors.max_slack_force > 2 * errors.rmse:
        warnings.append(
            f"The model pulls at {errors.slack_violations} of {errors.n_slack} slack readings, by "
            f"up to {errors.max_slack_force:.3g} N."
        )
    if result.certificate.n_agreeing < 2 < result.certificate.n_starts:
        warnings.append("Only one start reached the best objective: try more (--starts).")
    if not result.converged:
        warnings.append("The fit did NOT converge; its numbers are not an optimum.")
    return tuple(warnings)


def _ridges(spread: Covariance) -> list[str]:
    """Pairs of geometry parameters that the data determine only together."""
    correlation = spread.correlation
    ridges = []
    for i, first in enumerate(GEOMETRY):
        for j in range(i + 1, len(GEOMETRY)):
            if abs(correlation[i, j]) > _RIDGE:
                ridges.append(
                    f"Ridge: {first} and {GEOMETRY[j]} are correlated by "
                    f"{correlation[i, j]:.4f}; only a combination of them is known well."
                )
    return ridges

"""Estimates of an optimum: every parameter with its error, its bounds, and what follows from it."""

import math
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

import famjax

from .._data.force_data import ForceData
from .._model.geometry_source import EstimatedSource
from .._model.parameters import Entry
from .._model.part import Part
from .._model.problem import Problem
from .build import own_names
from .optimal import Optimal
from .result import Estimate


def coefficient_stderr(found: Optimal) -> Float[np.ndarray, "nodes order"]:
    return found.spread.stderr[len(found.search.names) :].reshape(found.coefficients.shape)


def estimates(found: Optimal, table: Mapping[str, Entry]) -> tuple[Estimate, ...]:
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


def concerning(
    estimates: tuple[Estimate, ...], data: ForceData, nodes: slice, problem: Problem
) -> tuple[Estimate, ...]:
    """The estimates that concern one specimen; a law with several nodes is told elsewhere."""
    count = len(estimates) - problem.n_coefficients
    mine = own_names([e.name for e in estimates[:count]], data.specimen.name)
    geometry = tuple(e for e in estimates[:count] if e.name in mine)
    laws = of_nodes(estimates, problem)[nodes]
    return geometry + (laws[0] if len(laws) == 1 else ())


def of_nodes(estimates: tuple[Estimate, ...], problem: Problem) -> tuple[tuple[Estimate, ...], ...]:
    """The coefficients of every node."""
    count, order = len(estimates) - problem.n_coefficients, problem.order
    return tuple(estimates[k : k + order] for k in range(count, len(estimates), order))


def derived(found: Optimal, part: Part) -> tuple[Estimate, ...]:
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

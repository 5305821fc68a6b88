"""Estimates of an optimum: every parameter with its error, its bounds, and what follows from it."""

import math
from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from ..data.force_data import ForceData
from ..families.parameters import Entry
from ..response import Report
from .build import own_names
from .optimal import Optimal
from .result import Estimate

_DERIVED_KINDS = {"thread_length": "length"}  # anything else is a number


def coefficient_stderr(found: Optimal) -> Float[np.ndarray, "nodes order"]:
    """Standard errors [Pa] of the coefficients."""
    return found.spread.stderr[len(found.problem.names) :].reshape(found.coefficients.shape)


def estimates(found: Optimal, table: Mapping[str, Entry]) -> tuple[Estimate, ...]:
    """Every nonlinear parameter, then the coefficients of every node."""
    names = found.problem.names + found.problem.linear
    values = np.concatenate([found.point.parameters, found.coefficients.ravel()])
    ends = np.array([(table[name].min, table[name].max) for name in names])
    rounding = 1e-9 * np.abs(found.coefficients).max()
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
    """The estimates that concern one specimen; of a law with several nodes, none of them."""
    count = len(found.problem.names)
    mine = own_names(found.problem.names, data.specimen.name)
    geometry = tuple(e for e in estimates[:count] if e.name in mine)
    laws = of_nodes(estimates, found)[nodes]
    return geometry + (laws[0] if len(laws) == 1 else ())


def of_nodes(estimates: tuple[Estimate, ...], found: Optimal) -> tuple[tuple[Estimate, ...], ...]:
    """The coefficients of every node."""
    first, order = len(found.problem.names), found.order
    return tuple(estimates[k : k + order] for k in range(first, len(estimates), order))


def derived(found: Optimal, place: int, reported: Report) -> tuple[Estimate, ...]:
    """What follows from a specimen's parameters, with errors by the delta method."""
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

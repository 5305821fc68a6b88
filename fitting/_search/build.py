"""From force maps and a parameter table to the problem and the box in which it is searched."""

import math
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from .._data.force_data import ForceData
from .._model.geometry_source import AbstractGeometrySource, EstimatedSource
from .._model.laws import AbstractLaw
from .._model.parameters import Entry, base_name, names_of
from .._model.part import Part
from .._model.problem import Constraint, PressureDependence, Prior, Problem
from .search import Search

STATIONS = 49
"""Stations along the actuation path at which the constraint is posed from the start."""
EXCHANGES = 8
"""Spare stations, filled with the points between the others where the constraint is violated."""


def build_search(
    data: Sequence[ForceData],
    sources: Sequence[AbstractGeometrySource],
    table: Mapping[str, Entry],
    law: AbstractLaw,
    *,
    constraint: Constraint,
    dependence: PressureDependence,
    own_law: bool = False,
    noise: float = 1.0,
) -> Search:
    """The search for the parameters of a table.

    Args:
        data: one force map for each specimen; several only with a law fixed in pressure.
        sources: what the geometry of each follows from.
        table: all parameters, the coefficients last; a name that ends in `[specimen]` is that
            specimen's own.
        law: family of the law.
        constraint: on the coefficients.
        dependence: of the coefficients on pressure.
        own_law: whether each specimen has its own coefficients.
        noise: standard deviation [N] of a reading, against which priors are weighed; one where
            the readings have standard deviations of their own.

    Returns:
        The search, with every nonlinear parameter in the order of the table.
    """
    linear = tuple(law.coefficients)
    names = tuple(name for name in table if name not in linear)
    parts = tuple(
        _part(one, source, names, dependence, (k, len(data)) if own_law else (0, 1))
        for k, (one, source) in enumerate(zip(data, sources, strict=True))
    )
    problem = Problem(
        parts=tuple(part.tabulated() for part in parts),
        law=law,
        shape=tuple(names.index(name) for name in law.shape),
        coefficient_min=jnp.asarray([table[name].min for name in linear]),
        coefficient_max=jnp.asarray([table[name].max for name in linear]),
        priors=_priors(names, table),
        coefficient_priors=_priors(linear, table),
        prior_weight=jnp.asarray(noise, float),
        constraint=constraint,
    )
    low, high = (np.array(ends) for ends in zip(*(_interval(table[n]) for n in names), strict=True))
    return Search.in_box(problem, names, low, high)


def _interval(entry: Entry) -> tuple[float, float]:
    """Bounds, finite: where there are none, four standard deviations of the prior."""
    mean, std = entry.prior or (0.0, math.inf)
    low = entry.min if math.isfinite(entry.min) else mean - 4 * std
    high = entry.max if math.isfinite(entry.max) else mean + 4 * std
    return low, high


def _priors(names: Sequence[str], table: Mapping[str, Entry]) -> tuple[Prior, ...]:
    return tuple(
        Prior(place, *prior)
        for place, name in enumerate(names)
        if (prior := table[name].prior) is not None
    )


def _part(
    data: ForceData,
    source: AbstractGeometrySource,
    names: Sequence[str],
    dependence: PressureDependence,
    own: tuple[int, int],
) -> Part:
    """One force map as a part of the problem.

    The actuation path at a pressure runs from rest to the longest length at which the muscle is
    slack there, so that it includes the free contraction; where no reading is slack, to the
    shortest length. A law fixed in pressure has one path, to the shortest length in the map.
    """
    loaded = data.loaded
    pressure, length = data.pressure[loaded], data.length[loaded]
    pressure_level, length_level = data.pressures.level[loaded], data.lengths.level[loaded]
    levels = np.unique(pressure_level)
    weights = 1 / data.force_std[loaded] if data.force_std is not None else np.ones(pressure.size)
    ends = np.array([_path_end(data, level) for level in levels])
    if dependence == "fixed":
        node, nodes = own
        weights = weights[None]
        basis = np.eye(nodes)[np.full(pressure.size, node)]
        # Where threads stretch the strains depend on pressure too, and that monotonically.
        at = [0, -1] if _stretches(source, names) else [-1]
        path_pressure = levels[None, at]
        path_end = np.full(path_pressure.shape, data.length.min())
        path_basis = np.tile(np.eye(nodes)[node], (*path_pressure.shape, 1))
    elif dependence == "linear":
        weights = weights[None]
        basis = _linear_basis(pressure, levels)
        path_pressure, path_end = levels[None], ends[None]
        path_basis = _linear_basis(levels, levels)[None]
    else:
        weights = weights * (pressure_level == levels[:, None])
        basis = np.ones((pressure.size, 1))
        path_pressure, path_end = levels[:, None], ends[:, None]
        path_basis = np.ones((levels.size, 1, 1))
    stations = np.concatenate([np.linspace(0, 1, STATIONS), np.zeros(EXCHANGES)])
    mine = own_names(names, data.specimen.name)
    offsets = names_of(mine, like="length_offset")
    return Part(
        force=jnp.asarray(data.force[loaded]),
        pressure=jnp.asarray(pressure),
        length=jnp.asarray(length),
        weights=jnp.asarray(weights),
        basis=jnp.asarray(basis),
        pressure_level=jnp.asarray(pressure_level),
        length_level=jnp.asarray(length_level),
        length_index=jnp.asarray(np.unique(length_level, return_inverse=True)[1]),
        path_pressure=jnp.asarray(path_pressure),
        path_basis=jnp.asarray(path_basis),
        path_end=jnp.asarray(path_end),
        stations=jnp.asarray(np.broadcast_to(stations, (*path_end.shape, stations.size))),
        source=source,
        rest_length=data.specimen.rest_length,
        where=tuple((base_name(n), names.index(n)) for n in mine if n not in offsets),
        offsets=tuple(names.index(n) for n in offsets),
    )


def _stretches(source: AbstractGeometrySource, names: Sequence[str]) -> bool:
    """Whether dimensions depend on pressure."""
    inextensible = isinstance(source, EstimatedSource) and source.thread is None
    return not inextensible or any(base_name(n) == "braid_compliance" for n in names)


def own_names(names: Sequence[str], specimen: str) -> tuple[str, ...]:
    """The parameters that concern a specimen: the shared ones and its own."""
    return tuple(n for n in names if "[" not in n or n.endswith(f"[{specimen}]"))


def _linear_basis(pressure: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Shares of the coefficients at the lowest and the highest pressure, shape (..., 2)."""
    share = (pressure - levels[0]) / (levels[-1] - levels[0]) if levels.size > 1 else 0 * pressure
    return np.stack([1 - share, share], axis=-1)


def _path_end(data: ForceData, level: float) -> float:
    at = data.pressures.level == level
    shortest_loaded = data.length[at & data.loaded].min()
    slack = data.length[at & ~data.loaded & (data.length < shortest_loaded)]
    return float(slack.max(initial=-math.inf)) if slack.size else float(shortest_loaded)

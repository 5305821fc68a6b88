"""From force maps and a parameter table to the problem that the engine solves."""

import math
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np

import famjax

from ..data.force_data import ForceData
from ..families.geometry_source import AbstractGeometrySource
from ..families.laws import Law
from ..families.muscle_family import MuscleFamily
from ..families.parameters import Entry, base_name, names_of
from ..problem import Part, Prior, Problem
from ..response import STATIONS, Constraint, MapInputs

EXCHANGES = 8
"""Spare stations, filled with the points between the others where the constraint is violated."""


def pose(
    data: Sequence[ForceData],
    sources: Sequence[AbstractGeometrySource],
    table: Mapping[str, Entry],
    law: Law,
    *,
    terms: famjax.terms.SumOfTerms | None = None,
    constraint: Constraint,
    dependence: str,
    own_law: bool = False,
    noise: float = 1.0,
    censored: bool = False,
) -> Problem:
    """The problem of identifying the parameters of a table.

    Args:
        data: one force map for each specimen; several only with a law fixed in pressure.
        sources: what the geometry of each follows from.
        table: all parameters, the coefficients last; a name that ends in `[specimen]` is that
            specimen's own.
        law: family of the law.
        terms: further force terms, or None.
        constraint: on the coefficients.
        dependence: of the coefficients on pressure.
        own_law: whether each specimen has its own coefficients.
        noise: standard deviation [N] of a reading, against which priors are weighed; one where
            the readings have standard deviations of their own.
        censored: whether slack and saturated readings take part, one-sided.

    Returns:
        The problem, with every nonlinear parameter in the order of the table.
    """
    linear = tuple(law.coefficients)
    names = tuple(name for name in table if name not in linear)
    parts, order = [], len(linear)
    for k, (one, source) in enumerate(zip(data, sources, strict=True)):
        first = k * order if own_law else 0
        parts.append(_part(one, source, law, terms, names, dependence, first, censored=censored))
    nodes = (
        (len(data) if own_law else 1)
        if dependence == "fixed"
        else cast(MuscleFamily, parts[0].family).n_nodes
    )
    low, high = (np.array(ends) for ends in zip(*(_interval(table[n]) for n in names), strict=True))
    return Problem(
        parts=tuple(parts),
        names=names,
        low=low,
        high=high,
        linear=linear * nodes,
        coefficient_min=np.array([table[name].min for name in linear] * nodes),
        coefficient_max=np.array([table[name].max for name in linear] * nodes),
        priors=_priors(names, table),
        coefficient_priors=tuple(
            Prior(prior.place + node * order, prior.mean, prior.std)
            for node in range(nodes)
            for prior in _priors(linear, table)
        ),
        noise=noise,
        constraint=constraint,
    )


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
    law: Law,
    terms: famjax.terms.SumOfTerms | None,
    names: Sequence[str],
    dependence: str,
    first: int,
    *,
    censored: bool,
) -> Part:
    """One force map as a part of the problem.

    The actuation path at a pressure runs from rest to the longest length at which the muscle is
    slack there, so that it includes the free contraction; where no reading is slack, to the
    shortest length. A law fixed in pressure has one path, to the shortest length in the map.
    """
    loaded = data.loaded
    mine = own_names(names, data.specimen.name)
    offsets = names_of(mine, like="length_offset")
    at = [names.index(n) for n in mine if n not in offsets] + [names.index(n) for n in offsets]
    levels = np.unique(data.pressures.level[loaded])
    nodes = {"fixed": None, "linear": levels[[0, -1]], "free": levels}[dependence]
    searched = tuple(base_name(n) for n in mine if n not in offsets)
    family = MuscleFamily.of(
        data.specimen, source, law, searched, terms, nodes, nearest=dependence == "free"
    )
    if dependence == "fixed":
        # Where threads stretch the strains depend on pressure too, and that monotonically.
        path_pressure = levels[[0, -1]] if family.stretches else levels[-1:]
        if law.material.depends_on_pressure:
            path_pressure = levels
        path_end = np.full(path_pressure.shape, data.length.min())
    else:
        path_pressure = levels
        path_end = np.array([path_end_at(data, level) for level in levels])
    stations = np.concatenate([np.linspace(0, 1, STATIONS - EXCHANGES), np.zeros(EXCHANGES)])
    side = np.where(data.slack, 1, np.where(data.saturated, -1, 0))
    rows = np.concatenate([np.flatnonzero(loaded), np.flatnonzero(side)[: None if censored else 0]])
    side = side[rows]
    limit = 0.0 if data.force_limit is None else data.force_limit
    force = np.where(side == 0, data.force[rows], np.where(side > 0, 0.0, limit))
    lengths = data.lengths.level
    inputs = MapInputs(
        length=data.length[rows],
        pressure=data.pressure[rows],
        force=force,
        length_index=np.searchsorted(np.unique(lengths[loaded]), lengths[rows]),
        path_pressure=path_pressure,
        path_end=path_end,
        stations=np.tile(stations, (path_end.size, 1)),
    )
    weight = 1 / data.force_std[rows] if data.force_std is not None else np.ones(rows.size)
    coefficients = range(first, first + len(family.linear))
    levels = {kind: data.levels(kind)[rows] for kind in ("pressure", "length")}
    return Part(
        data.specimen.name, family, inputs, force, weight, np.array(at, int),
        np.array(coefficients, int), levels, side,
    )  # fmt: skip


def own_names(names: Sequence[str], specimen: str) -> tuple[str, ...]:
    """The parameters that concern a specimen: the shared ones and its own."""
    return tuple(n for n in names if "[" not in n or n.endswith(f"[{specimen}]"))


def path_end_at(data: ForceData, level: float) -> float:
    """Shortest length [m] of the actuation path at a pressure level [Pa]."""
    at = data.pressures.level == level
    shortest_loaded = data.length[at & data.loaded].min()
    slack = data.length[at & data.slack & (data.length < shortest_loaded)]
    return float(slack.max(initial=-math.inf)) if slack.size else float(shortest_loaded)

"""From what a user asks to the problem that is searched: table of parameters, checks, program."""

import dataclasses
import hashlib
import math
import re
import types
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import equinox as eqx
import jax
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.class_path import class_named, class_path
from famjax.boundary.errors import InputError
from famjax.geometries import AbstractGeometry
from famjax.parameters import Declared
from famjax.terms import AbstractForceTerm

from .arguments import check_mapping, check_names
from .checks import (
    check_affine,
    check_censored,
    check_count,
    check_lengths,
    check_options,
    check_priors,
    check_solvable,
    check_source,
    known_bounds,
)
from .data import ForceData, check_maps, several_maps
from .families import (
    AbstractGeometrySource,
    EstimatedSource,
    KnownSource,
    Law,
    LawGiven,
    MuscleFamily,
    WrappedSource,
    law_named,
)
from .parameters import Entry, Parameter, base_name, complete_table
from .problem import Part, Prior, Problem
from .response import STATIONS, Constraint, MapInputs, PressureDependence
from .search import latin_hypercube

Geometry = (
    AbstractGeometrySource
    | famjax.geometries.AbstractGeometry
    | Callable[[famjax.geometries.AbstractGeometry], famjax.geometries.AbstractGeometry]
    | str
)
"""What a geometry may be given as."""


@dataclasses.dataclass(frozen=True)
class Posed:
    """A problem that is ready to be searched.

    Attributes:
        data: one force map for each specimen.
        problem: what is searched.
        table: all parameters by name, SI.
        law: family of the law.
        constraint, dependence: as asked for.
    """

    data: tuple[ForceData, ...]
    problem: Problem
    table: dict[str, Entry]
    law: Law
    constraint: Constraint
    dependence: PressureDependence

    def starts(self, count: int, seed: int) -> Float[np.ndarray, "k p"]:
        """Points of the unit box of the free parameters, from which to descend."""
        return latin_hypercube(len(self.problem.free), count, seed)


def pose_one(
    data: ForceData,
    *,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    dependence: str = "fixed",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    censored: bool = False,
    program: Callable[[Problem], Problem] = lambda problem: problem,
) -> Posed:
    """The problem of `identify` with these arguments, which says what they are.

    `program` puts it into another compiled program than its own, see `Within`.

    Raises:
        InputError: the data cannot support the fit, with the reason.
        RuntimeError: float64 is off.
    """
    check_maps(data)
    check_mapping("bounds", bounds, "from names to (low, high) in SI")
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    given, chosen = dict(bounds or {}), law_named(law, order)
    named = {**given, **(parameters or {})}
    source = source_of(data, geometry, tuple(named))
    if isinstance(source, KnownSource):
        given |= known_bounds(data, source.known, named)
    further = _further(terms)
    table = _table(data, source, further, chosen, given, parameters or {})
    return _posed(
        (data,), (source,), table, chosen, terms=further, constraint=constraint,
        dependence=dependence, noise=noise, censored=censored, program=program,
    )  # fmt: skip


def pose_together(
    data: Sequence[ForceData],
    *,
    own: Sequence[str] = ("deadband_pressure",),
    own_law: bool = False,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    censored: bool = False,
) -> Posed:
    """The problem of `identify_together` with these arguments, which says what they are.

    Raises:
        InputError: the data cannot support the fit, with the reason.
        RuntimeError: float64 is off.
    """
    data = several_maps(data)
    names = [one.specimen.name for one in data]
    if len(set(names)) < len(names) or not names:
        raise InputError(f"specimens identified together need different names, got {names}")
    own = check_names("own", own)
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    chosen = law_named(law, order)
    if isinstance(geometry, famjax.geometries.AbstractGeometry | AbstractGeometrySource):
        raise InputError(
            "a known geometry is that of one specimen: give a class or a function of the estimated "
            f"geometry, such as lambda shape: EndEffectGeometry(shape, 1.0); got {type(geometry)}"
        )
    rows, further = {**chosen.shape, **chosen.coefficients}, _further(terms)
    sources = tuple(source_of(one, geometry, tuple(parameters or {})) for one in data)
    tables = [
        _table(one, source, further, chosen, {}, parameters or {})
        for one, source in zip(data, sources, strict=True)
    ]
    unknown = sorted(set(own) - set(tables[0]))
    if unknown:
        raise InputError(f"own parameter {unknown[0]!r} is not one of {', '.join(tables[0])}")
    mixed = [n for n in own if n in rows]
    if mixed:
        raise InputError(f"{mixed[0]} belongs to the law: use own_law=True")
    table: dict[str, Entry] = {}
    for name, entry in tables[0].items():
        if name in own:
            table |= {f"{name}[{who}]": of[name] for who, of in zip(names, tables, strict=True)}
        else:
            table[name] = _shared(name, entry, [of[name] for of in tables])
    return _posed(
        tuple(data), sources, table, chosen, terms=further, constraint=constraint,
        dependence="fixed", noise=noise, own_law=own_law, censored=censored,
    )  # fmt: skip


def _further(terms: famjax.terms.AbstractForceTerm | None) -> famjax.terms.SumOfTerms | None:
    """Terms besides those that every muscle has."""
    try:
        return None if terms is None else famjax.terms.SumOfTerms((terms,))
    except ValueError as error:
        raise InputError(f"terms: {error}") from None


def _table(
    data: ForceData,
    source: AbstractGeometrySource,
    further: famjax.terms.SumOfTerms | None,
    law: Law,
    bounds: Mapping[str, tuple[float, float]],
    parameters: Mapping[str, Parameter],
) -> dict[str, Entry]:
    """All parameters that the fit of a specimen may have."""
    of_terms = {} if further is None else further.declared()
    declared = {**source.declared, **of_terms}
    rows = {**law.shape, **law.coefficients}
    twice = [*(of_terms.keys() & source.declared.keys()), *(declared.keys() & rows.keys())]
    if twice:
        raise InputError(
            f"{twice[0]} is a parameter of two parts, of law, geometry and terms: give one of them another "
            "name, by famjax.parameter(name=...)"
        )
    own = {name: Entry(one.low, one.high, one.kind) for name, one in declared.items()}
    return complete_table(data.specimen, rows, bounds, parameters, own)


def source_of(
    data: ForceData, geometry: Geometry | None, named: tuple[str, ...]
) -> AbstractGeometrySource:
    """What the dimensions follow from, with those of its parameters that are named."""
    if geometry is None:
        return EstimatedSource(data.specimen)
    if isinstance(geometry, str):
        geometry = class_named(geometry, famjax.geometries.AbstractGeometry, "geometry")
    if isinstance(geometry, AbstractGeometrySource):
        return geometry
    if isinstance(geometry, famjax.geometries.AbstractGeometry):
        known = KnownSource(geometry)
        return KnownSource(geometry, tuple(n for n in known.declared if n in named))
    if not callable(geometry):
        raise InputError(
            "a geometry is one of famjax.geometries, or a class, a function or module:Class that makes "
            f"one of the estimated geometry; got a {type(geometry).__name__}"
        )
    wrapped = WrappedSource(EstimatedSource(data.specimen), geometry)
    own = tuple(n for n in wrapped.declared if n in named)
    return WrappedSource(wrapped.inner, geometry, own)


def _shared(name: str, entry: Entry, of_each: Sequence[Entry]) -> Entry:
    """A parameter that all specimens share, within the bounds of all of them."""
    low, high = max(one.min for one in of_each), min(one.max for one in of_each)
    if low > high:
        raise InputError(
            f"{name} cannot be shared: one specimen has it at {low:.6g} or above, another at "
            f"{high:.6g} or below (SI); name it in own, or give bounds that hold for all"
        )
    return dataclasses.replace(entry, min=low, max=high)


def _posed(
    data: tuple[ForceData, ...],
    sources: tuple[AbstractGeometrySource, ...],
    table: dict[str, Entry],
    law: Law,
    *,
    terms: famjax.terms.SumOfTerms | None,
    constraint: str,
    dependence: str,
    noise: float | None,
    own_law: bool = False,
    censored: bool = False,
    program: Callable[[Problem], Problem] = lambda problem: problem,
) -> Posed:
    """The problem of a table that is complete, checked."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "identification needs float64, and JAX computes in float32 by default. Put this "
            "line before any other use of JAX: "
            'jax.config.update("jax_enable_x64", True)'
        )
    posed, form = check_options(law, constraint, dependence)
    weighted = [one.force_std is not None for one in data]
    if any(weighted) and not all(weighted):
        raise InputError(
            "some specimens have standard deviations of their forces (force_std) and some have "
            "not: readings identified together are weighed alike, so give them to all or none"
        )
    if censored:
        check_censored(table)
    for one, source in zip(data, sources, strict=True):
        own = {base_name(name): table[name] for name in own_names(tuple(table), one.specimen.name)}
        check_source(source, table)
        check_lengths(one, own)
        check_priors(one, own, noise)
    check_count(data, law, form, table, own_law=own_law)
    problem = program(
        pose(
            data, sources, table, law, terms=terms, constraint=posed, dependence=form, own_law=own_law,
            noise=noise or 1.0, censored=censored,
        )
    )  # fmt: skip
    check_affine(problem)
    check_solvable(problem)
    return Posed(data, problem, table, law, posed, form)


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
    at = [names.index(n) for n in mine]
    levels = np.unique(data.pressures.level[loaded])
    nodes = {"fixed": None, "linear": levels[[0, -1]], "free": levels}[dependence]
    searched = tuple(base_name(n) for n in mine)
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
    inputs = MapInputs(
        length=data.length[rows],
        pressure=data.pressure[rows],
        force=force,
        path_pressure=path_pressure,
        path_end=path_end,
        stations=np.tile(stations, (path_end.size, 1)),
    )
    weight = 1 / data.force_std[rows] if data.force_std is not None else np.ones(rows.size)
    if data.count is not None and data.force_std is None:
        weight = np.sqrt(data.count[rows])
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


def own_parts(
    data: Sequence[ForceData], geometry: str | type | None, terms: Sequence[str | type]
) -> tuple[dict[str, Any], dict[str, Declared]]:
    """The options of `identify` that these classes are, and the numbers that they declare.

    Args:
        data: the maps, which have one set of parts.
        geometry: a geometry around the estimated one, its class or module:Class, or None.
        terms: each force term, its class or module:Class.

    Returns:
        (options, declarations by name).

    Raises:
        InputError: a class that is not found or is something else, or a term that needs a number
            which it does not declare.
    """
    options: dict[str, Any] = {}
    declared: dict[str, Declared] = {}
    if geometry is not None:
        if isinstance(geometry, str):
            geometry = class_named(geometry, AbstractGeometry, "geometry")
        options["geometry"] = geometry
        for one in data:
            declared |= source_of(one, options["geometry"], ()).declared
    for path in terms:
        kind = class_named(path, AbstractForceTerm, "force term") if isinstance(path, str) else path
        try:
            term = kind.template()
        except ValueError as error:
            raise InputError(
                f"the force term {path} cannot be identified by its class: {error}"
            ) from None
        options["terms"] = options["terms"] + term if "terms" in options else term
    if terms:
        # Of two numbers of one name the later one has a longer one in the sum.
        declared |= options["terms"].declared()
    return options, declared


def taking_part(
    declared: Mapping[str, Declared], named: Mapping[str, object]
) -> dict[str, Parameter]:
    """All numbers of a user's own parts that are not named otherwise, in their declared ranges."""
    return {name: Parameter() for name in declared if name not in named}


def fingerprint(part: Any) -> str:
    """A digest of a law, geometry or term of a user's own: its class, what is static in it, its numbers."""
    leaves, treedef = jax.tree.flatten(part)
    digest = hashlib.sha256(f"{_named(part)} {_ADDRESS.sub('', str(treedef))}".encode())
    for leaf in leaves:
        if eqx.is_array_like(leaf):
            digest.update(np.ascontiguousarray(leaf, "<f8").tobytes())
        else:
            digest.update(_named(leaf).encode())
    return digest.hexdigest()


_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


def _named(value: Any) -> str:
    named = value if isinstance(value, type | types.FunctionType) else type(value)
    return class_path(named) + ("" if named is value else _ADDRESS.sub("", repr(value)))

"""Set up a fit from the user's options: parameter table, checks and problem."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, cast

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError, class_named
from famjax.geometries import AbstractGeometry
from famjax.parameters import Declared
from famjax.terms import AbstractForceTerm

from .arguments import check_float64, check_mapping, check_names
from .checks import (
    check_affine,
    check_count,
    check_law,
    check_solvable,
    check_specimen,
    known_bounds,
)
from .data import ForceData, several_maps
from .families import (
    AbstractGeometrySource,
    EstimatedSource,
    KnownSource,
    Law,
    LawGiven,
    WrappedSource,
    law_named,
)
from .parameters import Entry, Parameter, base_name, complete_table
from .problem import Part, Prior, Problem
from .response import STATIONS, Constraint, MapInputs, MuscleFamily
from .search import latin_hypercube

Geometry = (
    AbstractGeometrySource
    | famjax.geometries.AbstractGeometry
    | Callable[[famjax.geometries.AbstractGeometry], famjax.geometries.AbstractGeometry]
    | str
    | Mapping[str, AbstractGeometrySource]
)
"""Types accepted as a geometry; a mapping contains one geometry for each specimen name."""


@dataclasses.dataclass(frozen=True)
class Posed:
    """A fit that is ready to be solved.

    Attributes:
        data: one force map per specimen.
        problem: optimisation problem.
        table: all parameters in SI units, keyed by name.
        law: bladder law.
        constraint: constraint on the coefficients, see `identify`.
        near: values [SI], keyed by name, around which starting points are sampled; None to sample the
            whole box.
    """

    data: tuple[ForceData, ...]
    problem: Problem
    table: dict[str, Entry]
    law: Law
    constraint: Constraint
    near: Mapping[str, float] | None = None

    def starts(self, count: int, seed: int) -> Float[np.ndarray, "k p"]:
        """Sample starting points in the unit box of the free parameters."""
        free, cube = self.problem.free, latin_hypercube(len(self.problem.free), count, seed)
        if self.near is None:
            return cube
        low, high = self.problem.low[free], self.problem.high[free]
        values = np.array([self.near[self.problem.names[k]] for k in free])
        about = (values - low) / (high - low) + _SCATTER * (cube - 0.5)
        about[0] -= _SCATTER * (cube[0] - 0.5)
        return np.clip(about, 0.0, 1.0)


_SCATTER = 0.1  # width of the starts around `near`, relative to the box
EXCHANGES = 8
"""Number of spare stations on each path, placed where the constraint is violated between the others."""


def pose(
    data: Sequence[ForceData],
    *,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    censored: bool = False,
    own: Sequence[str] = (),
    program: Callable[[Problem], Problem] = lambda problem: problem,
    near: Mapping[str, float] | None = None,
) -> Posed:
    """Set up the fit that the arguments of `identify` or `identify_together` describe.

    `program` embeds the problem in a shared compiled program, see `Within`; for `near`, see `Posed`.

    Raises:
        InputError: the data do not support the fit; the message states the reason.
        RuntimeError: float64 is off.
    """
    check_float64()
    data, own = several_maps(data), check_names("own", own)
    names = [one.specimen.name for one in data]
    if len(set(names)) < len(names) or not names:
        raise InputError(f"specimens identified together must have different names, got {names}")
    check_mapping("bounds", bounds, "from names to (low, high) in SI")
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    bounds, parameters = dict(bounds or {}), dict(parameters or {})
    family, further = law_named(law, order), _further(terms)
    check_law(family, constraint)
    if len(data) > 1 and isinstance(geometry, AbstractGeometry | AbstractGeometrySource):
        raise InputError(
            "a known geometry applies to one specimen only: for several specimens, pass a class, or a "
            "function of the estimated geometry, such as lambda shape: EndEffectGeometry(shape, 1.0); got "
            f"{type(geometry)}"
        )
    if len({one.force_std is None for one in data}) > 1:
        raise InputError(
            "some specimens have standard deviations of the force (force_std) and others do not: readings "
            "identified together must be weighted in the same way, so set force_std for all or for none"
        )
    sources = [source_of(one, geometry, (*bounds, *parameters)) for one in data]
    tables = [
        _table(one, source, further, family, bounds, parameters)
        for one, source in zip(data, sources, strict=True)
    ]
    unknown = sorted(set(own) - tables[0].keys())
    if unknown:
        raise InputError(
            f"unknown parameter {unknown[0]!r} in own; choose from {', '.join(tables[0])}"
        )
    mixed = [name for name in own if name in {**family.shape, **family.coefficients}]
    if mixed:
        raise InputError(
            f"{mixed[0]} belongs to the law, which all specimens share: remove it from own"
        )
    for one, source, table in zip(data, sources, tables, strict=True):
        check_specimen(one, source, table, noise, censored=censored)
    table: dict[str, Entry] = {}
    for name in tables[0]:
        if name in own:
            table |= {f"{name}[{who}]": of[name] for who, of in zip(names, tables, strict=True)}
        else:
            table[name] = _shared(name, [of[name] for of in tables])
    check_count(data, family, table)
    linear = tuple(family.coefficients)
    nonlinear = tuple(name for name in table if name not in linear)
    parts = tuple(
        _part(one, source, family, further, nonlinear, censored=censored)
        for one, source in zip(data, sources, strict=True)
    )
    low, high = np.array([_interval(name, table[name]) for name in nonlinear]).T
    least = np.array([table[name].min for name in linear])
    most = np.array([table[name].max for name in linear])
    problem = program(
        Problem(
            parts, nonlinear, low, high, linear, least, most,
            priors=_priors(nonlinear, table), coefficient_priors=_priors(linear, table),
            noise=noise or 1.0, constraint=cast(Any, constraint),
        )
    )  # fmt: skip
    check_affine(problem)
    if linear:  # otherwise the middle of the box may not be a valid muscle
        check_solvable(problem, data)
    return Posed(data, problem, table, family, cast(Any, constraint), near)


def _further(terms: famjax.terms.AbstractForceTerm | None) -> famjax.terms.SumOfTerms | None:
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
    if isinstance(source, KnownSource):
        bounds = {**bounds, **known_bounds(data, source.known, {**bounds, **parameters})}
    of_terms = {} if further is None else further.declared()
    declared = {**source.declared, **of_terms}
    rows = {**law.shape, **law.coefficients}
    twice = [*(of_terms.keys() & source.declared.keys()), *(declared.keys() & rows.keys())]
    if twice:
        raise InputError(
            f"{twice[0]} is declared more than once, in the law, geometry or terms: rename one with "
            "famjax.parameter(name=...)"
        )
    own = {name: Entry(one.low, one.high, one.kind) for name, one in declared.items()}
    return complete_table(data.specimen, rows, bounds, parameters, own)


def source_of(
    data: ForceData, geometry: Geometry | None, named: tuple[str, ...]
) -> AbstractGeometrySource:
    """Return the geometry source, with the named parameters free."""
    if geometry is None:
        return EstimatedSource(data.specimen)
    if isinstance(geometry, str):
        geometry = class_named(geometry, famjax.geometries.AbstractGeometry, "geometry")
    if isinstance(geometry, Mapping):
        geometry = geometry[data.specimen.name]
    if isinstance(geometry, AbstractGeometrySource):
        return geometry
    if isinstance(geometry, AbstractGeometry):
        return KnownSource(geometry, tuple(n for n in geometry.declared() if n in named))
    if not callable(geometry):
        raise InputError(
            "geometry must be a geometry from famjax.geometries, or a class, function or module:Class that "
            f"wraps the estimated geometry; got a {type(geometry).__name__}"
        )
    wrapped = WrappedSource(EstimatedSource(data.specimen), cast(Any, geometry))
    return dataclasses.replace(wrapped, identified=tuple(n for n in wrapped.declared if n in named))


def _shared(name: str, of_each: Sequence[Entry]) -> Entry:
    """Intersect the bounds of a shared parameter."""
    low, high = max(one.min for one in of_each), min(one.max for one in of_each)
    if low > high:
        raise InputError(
            f"{name} cannot be shared: one specimen requires at least {low:.6g}, another at most "
            f"{high:.6g} (SI). List it in own, or set bounds that suit all specimens"
        )
    return dataclasses.replace(of_each[0], min=low, max=high)


def _interval(name: str, entry: Entry) -> tuple[float, float]:
    """Return the bounds of a parameter that is found by search; they must be finite."""
    if not math.isfinite(entry.max - entry.min):
        raise InputError(
            f"{name} is found by search, so it needs finite bounds; got {entry.min:.4g} to {entry.max:.4g} "
            "(SI): declare it with famjax.parameter(low=..., high=...), set bounds, or declare it with "
            'linear=True and kind="stress" if the force is linear in it'
        )
    return entry.min, entry.max


def _priors(names: Sequence[str], table: Mapping[str, Entry]) -> tuple[Prior, ...]:
    found = zip(np.eye(len(names)), (table[name].prior for name in names), strict=True)
    return tuple(Prior(row, *prior) for row, prior in found if prior is not None)


def _part(
    data: ForceData,
    source: AbstractGeometrySource,
    law: Law,
    terms: famjax.terms.SumOfTerms | None,
    names: Sequence[str],
    *,
    censored: bool,
) -> Part:
    """Build the part of the problem for one force map.

    If the law does not depend on pressure, the actuation path runs from rest to the shortest length in
    the map. Otherwise there is one path for each pressure, which ends at the longest slack length or, if
    no reading is slack, at the shortest loaded length.
    """
    mine = own_names(names, data.specimen.name)
    levels = np.unique(data.pressures.level[data.loaded])
    searched = tuple(base_name(n) for n in mine)
    rest = np.asarray(data.specimen.rest_length)
    family = MuscleFamily(searched, tuple(law.coefficients), source, law, rest, terms)
    if law.material.depends_on_pressure:
        path_pressure, path_end = levels, np.array([path_end_at(data, level) for level in levels])
    else:
        # With elastic threads, the strains also depend on pressure, monotonically.
        stretches = source.stretches or "braid_compliance" in searched
        path_pressure = levels[[0, -1]] if stretches else levels[-1:]
        path_end = np.full(path_pressure.shape, data.length.min())
    stations = np.concatenate([np.linspace(0, 1, STATIONS - EXCHANGES), np.zeros(EXCHANGES)])
    side = np.where(data.slack, 1, np.where(data.saturated, -1, 0))
    rows = np.flatnonzero(data.loaded)
    if censored:
        rows = np.concatenate([rows, np.flatnonzero(side)])
    side = side[rows]
    limit = 0.0 if data.force_limit is None else data.force_limit
    force = np.where(side == 0, data.force[rows], np.where(side > 0, 0.0, limit))
    weight = 1 / data.force_std[rows] if data.force_std is not None else np.ones(rows.size)
    if data.count is not None and data.force_std is None:
        weight = np.sqrt(data.count[rows])
    return Part(
        data.specimen.name, family,
        MapInputs(
            data.length[rows], data.pressure[rows], force, path_pressure, path_end,
            np.tile(stations, (path_end.size, 1)),
        ),
        force, weight, np.array([names.index(n) for n in mine], int),
        {kind: data.levels(kind)[rows] for kind in ("pressure", "length")}, side,
    )  # fmt: skip


def own_names(names: Sequence[str], specimen: str) -> tuple[str, ...]:
    """Return the names of the shared parameters and of those that belong to this specimen."""
    return tuple(n for n in names if "[" not in n or n.endswith(f"[{specimen}]"))


def path_end_at(data: ForceData, level: float) -> float:
    """Return the shortest length [m] of the actuation path at a pressure level [Pa]."""
    at = data.pressures.level == level
    shortest_loaded = data.length[at & data.loaded].min()
    slack = data.length[at & data.slack & (data.length < shortest_loaded)]
    return float(slack.max(initial=-math.inf)) if slack.size else float(shortest_loaded)


def own_parts(
    data: Sequence[ForceData], geometry: str | type | None, terms: Sequence[str | type]
) -> tuple[dict[str, Any], dict[str, Declared]]:
    """Convert custom classes to options for `identify`, and collect the parameters that they declare.

    Args:
        data: force maps to which the classes apply.
        geometry: class that wraps the estimated geometry, or its name as `module:Class`; None for none.
        terms: classes of force terms, or their names as `module:Class`.

    Returns:
        (options, parameter declarations keyed by name).

    Raises:
        InputError: a class is missing or has the wrong type, or a term needs a value that it does
            not declare.
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
                f"the force term {path} cannot be created from its class alone: {error}"
            ) from None
        options["terms"] = options["terms"] + term if "terms" in options else term
    if terms:
        # If two parameters share a name, the sum of terms renames the later one.
        declared |= options["terms"].declared()
    return options, declared


def taking_part(
    declared: Mapping[str, Declared], named: Mapping[str, object]
) -> dict[str, Parameter]:
    """Return free parameters, within their declared ranges, for all declared names not set by the user."""
    return {name: Parameter() for name in declared if name not in named}

"""From what a user asks to the problem that is searched: table of parameters, checks, program."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.class_path import class_named
from famjax.boundary.errors import InputError

from ..arguments import check_mapping, check_names
from ..data.force_data import ForceData, check_maps, several_maps
from ..families.geometry_source import (
    AbstractGeometrySource,
    EstimatedSource,
    KnownSource,
    WrappedSource,
)
from ..families.laws import Law, LawGiven, law_named
from ..families.parameters import Entry, Parameter, base_name, complete_table
from ..problem import Problem
from ..response import Constraint, PressureDependence
from .build import own_names, pose
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
from .multi_start import latin_hypercube

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
        constraint, dependence, box: as asked for.
    """

    data: tuple[ForceData, ...]
    problem: Problem
    table: dict[str, Entry]
    law: Law
    constraint: Constraint
    dependence: PressureDependence
    box: str

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
    box: str = "physical",
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
    table = _table(data, source, further, chosen, box, given, parameters or {})
    return _posed(
        (data,), (source,), table, chosen, terms=further, constraint=constraint,
        dependence=dependence, box=box, noise=noise, censored=censored, program=program,
    )  # fmt: skip


def pose_together(
    data: Sequence[ForceData],
    *,
    own: Sequence[str] = ("deadband_pressure",),
    own_law: bool = False,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    box: str = "physical",
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
        _table(one, source, further, chosen, box, {}, parameters or {})
        for one, source in zip(data, sources, strict=True)
    ]
    if "length_offset" in own:
        raise InputError("length_offset is always each specimen's own: leave it out of own")
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
        dependence="fixed", box=box, noise=noise, own_law=own_law, censored=censored,
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
    box: str,
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
    return complete_table(data.specimen, box, rows, bounds, parameters, own)


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
    box: str,
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
    full = _with_offsets(table, data, law)
    for one, source in zip(data, sources, strict=True):
        own = {base_name(name): full[name] for name in own_names(tuple(full), one.specimen.name)}
        check_source(source, table)
        check_lengths(one, own)
        check_priors(one, own, noise)
    check_count(data, law, form, full, own_law=own_law)
    problem = program(
        pose(
            data, sources, full, law, terms=terms, constraint=posed, dependence=form, own_law=own_law,
            noise=noise or 1.0, censored=censored,
        )
    )  # fmt: skip
    check_affine(problem)
    check_solvable(problem)
    return Posed(data, problem, full, law, posed, form, box)


def _with_offsets(table: dict[str, Entry], data: Sequence[ForceData], law: Law) -> dict[str, Entry]:
    """The table with one offset for each distinct length in place of `length_offset`."""
    if "length_offset" not in table:
        return table
    full = {n: entry for n, entry in table.items() if n != "length_offset"}
    linear = {n: full.pop(n) for n in law.coefficients}
    for one in data:
        tag = f"[{one.specimen.name}]" if len(data) > 1 else ""
        for length in np.unique(one.lengths.level[one.loaded]):
            full[f"length_offset_at_{length * 1e3:.12g}mm{tag}"] = table["length_offset"]
    return full | linear

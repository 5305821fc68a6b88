"""Identification of muscles from force maps: geometry outside, a certified convex fit inside."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import jax
import numpy as np

import famjax
from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..families.geometry_source import (
    AbstractGeometrySource,
    EstimatedSource,
    KnownSource,
    WrappedSource,
)
from ..families.laws import Law, LawGiven, law_named
from ..families.parameters import Entry, Parameter, complete_table
from .build import EXCHANGES, pose
from .checks import (
    check_affine,
    check_count,
    check_lengths,
    check_options,
    check_priors,
    check_solvable,
    check_source,
    known_bounds,
)
from .multi_start import best_of, descend_all, latin_hypercube, refine
from .optimal import optimal
from .result import Identification
from .robust import check_objective, descend_huber
from .summary import Asked, summarise

Geometry = (
    AbstractGeometrySource
    | famjax.geometries.AbstractGeometry
    | Callable[[famjax.geometries.AbstractGeometry], famjax.geometries.AbstractGeometry]
)
"""What a geometry may be given as."""


def identify(
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
    objective: str = "sum_of_squares",
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """The muscle that fits a force map best, among those that satisfy the constraint.

    The force is linear in the coefficients of the law: for every geometry they are the certified
    optimum of a convex programme. The nonlinear parameters (braid diameter, braid angle, deadband,
    and those that `parameters` names) are sought from many starts by Gauss-Newton with derivatives
    through that programme (variable projection).

    Args:
        data: the force map; slack readings are censored.
        law: "polynomial", "ogden", "mooney-rivlin", "saturating", "monotone", "neo-hookean",
            "yeoh"; or a class of your own, derived from `famjax.materials.AbstractMaterial`, whose numbers
            are declared by `famjax.parameter`, as a class, an instance, or "module:Class".
        order: of the polynomial law, 1 to 8; 3 unless given.
        constraint: "none", "positive" (every coefficient >= 0), "slope" (rising stress on the
            strain range) or "drucker" (positive second-order work along the actuation path). It
            holds between the stations as well.
        dependence: of the polynomial's coefficients on pressure: "fixed" (none), "linear" or
            "free".
        box: "physical" or "open", see `standard_table`.
        bounds: intervals (min, max) in SI by parameter name, which replace those of the box; an
            interval of one value holds the parameter there.
        parameters: the same with units, held values and priors. Naming one of these makes it take
            part: `rest_length`, `end_factor` (k of Tondu & Lopez) or `end_length` (dead length
            L0 (1 - 1/k)), `braid_compliance` (of all threads), `series_compliance` (of the rig),
            `length_offset` (one for each length, with a prior).
        noise: standard deviation of one reading [N], against which priors are weighed; needed
            with priors where the data have no `force_std`.
        objective: "sum_of_squares" or "huber", which counts residuals beyond 1.345 standard
            deviations of the noise, as the median of the residuals shows it, by their size and
            not their square; validation and uncertainty keep the weights found.
        geometry: what the muscle's dimensions follow from. None: a cylinder in an inextensible
            braid. `EstimatedSource(specimen, n_threads, thread)`: in an elastic one. A geometry,
            such as a `famjax.MeasuredGeometry`: as it is, and of it only what `bounds` or
            `parameters` name is identified. A function, or class, that makes a geometry of the
            estimated one: its declared parameters take part where they are named.
        terms: further force terms, such as `famjax.terms.Spring`; their declared parameters take part
            where they are named. A term with a `deadband_pressure` takes the place of Gaylord's.
        starts: number of starts, Latin hypercube over the box.
        seed: of the starts.
        progress: called with (starts done, starts) as the descents end.

    Returns:
        The identified muscle with errors, certificate and warnings.

    Raises:
        InputError: the data cannot support the fit, with the reason.
        RuntimeError: float64 is off.

    References:
        Golub & Pereyra 1973 (variable projection); Chambers 2021, chapter 7.
    """
    given, chosen = dict(bounds or {}), law_named(law, order)
    named = {**given, **(parameters or {})}
    source = _source(data, geometry, tuple(named))
    if isinstance(source, KnownSource):
        given |= known_bounds(data, source.known, named)
    further = _further(terms)
    table = _table(data, source, further, chosen, box, given, parameters or {})
    return _identified(
        (data,), (source,), table, chosen, terms=further, constraint=constraint,
        dependence=dependence, box=box, noise=noise, objective=objective, starts=starts, seed=seed,
        progress=progress,
    )[0]  # fmt: skip


def _further(terms: famjax.terms.AbstractForceTerm | None) -> famjax.terms.SumOfTerms | None:
    """Terms besides those that every muscle has."""
    return None if terms is None else famjax.terms.SumOfTerms((terms,))


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
    declared = {**source.declared, **({} if further is None else further.declared())}
    own = {name: Entry(one.low, one.high, one.kind) for name, one in declared.items()}
    rows = {**law.shape, **law.coefficients}
    return complete_table(data.specimen, box, rows, bounds, parameters, own)


def _source(
    data: ForceData, geometry: Geometry | None, named: tuple[str, ...]
) -> AbstractGeometrySource:
    """What the dimensions follow from, with those of its parameters that are named."""
    if geometry is None:
        return EstimatedSource(data.specimen)
    if isinstance(geometry, AbstractGeometrySource):
        return geometry
    if isinstance(geometry, famjax.geometries.AbstractGeometry):
        known = KnownSource(geometry)
        return KnownSource(geometry, tuple(n for n in known.declared if n in named))
    wrapped = WrappedSource(EstimatedSource(data.specimen), geometry)
    own = tuple(n for n in wrapped.declared if n in named)
    return WrappedSource(wrapped.inner, geometry, own)


def identify_together(
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
    objective: str = "sum_of_squares",
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Identification, ...]:
    """Several specimens identified at once, with shared and own parameters.

    Args:
        data: one force map for each specimen, with different names.
        own: parameters that each specimen has for itself; all others are shared.
        own_law: whether each specimen has its own coefficients of the law.
        law: as in `identify`, and all that follows.
        order: of the polynomial law.
        constraint: on the coefficients.
        box: of the standard bounds; those of a shared parameter are what all specimens allow.
        parameters: bounds, held values and priors, the same for every specimen.
        noise: standard deviation of one reading [N].
        objective: "sum_of_squares" or "huber".
        geometry: a class or function of the estimated geometry of each specimen.
        terms: further force terms, the same for every specimen; see `identify`.
        starts: number of starts.
        seed: of the starts.
        progress: called with (starts done, starts).

    Returns:
        One identification for each specimen. Shared parameters, certificate and starts are the
        same in all; an own parameter is called `name[specimen]`.

    Raises:
        InputError: the data cannot support the fit, with the reason.
        RuntimeError: float64 is off.
    """
    names = [one.specimen.name for one in data]
    if len(set(names)) < len(names) or not names:
        raise InputError(f"specimens identified together need different names, got {names}")
    chosen = law_named(law, order)
    if isinstance(geometry, famjax.geometries.AbstractGeometry | AbstractGeometrySource):
        raise InputError(
            "a known geometry is that of one specimen: give a class or a function of the estimated "
            f"geometry, such as lambda shape: EndEffectGeometry(shape, 1.0); got {type(geometry)}"
        )
    rows, further = {**chosen.shape, **chosen.coefficients}, _further(terms)
    sources = tuple(_source(one, geometry, tuple(parameters or {})) for one in data)
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
    return _identified(
        tuple(data), sources, table, chosen, terms=further, constraint=constraint,
        dependence="fixed", box=box, noise=noise, objective=objective, starts=starts, seed=seed,
        own_law=own_law, progress=progress,
    )  # fmt: skip


def _shared(name: str, entry: Entry, of_each: Sequence[Entry]) -> Entry:
    """A parameter that all specimens share, within the bounds of all of them."""
    low, high = max(one.min for one in of_each), min(one.max for one in of_each)
    if low > high:
        raise InputError(
            f"{name} cannot be shared: one specimen has it at {low:.6g} or above, another at "
            f"{high:.6g} or below (SI); name it in own, or give bounds that hold for all"
        )
    return dataclasses.replace(entry, min=low, max=high)


def _identified(
    data: tuple[ForceData, ...],
    sources: tuple[AbstractGeometrySource, ...],
    table: dict[str, Entry],
    law: Law,
    *,
    terms: famjax.terms.SumOfTerms | None = None,
    constraint: str,
    dependence: str,
    box: str,
    noise: float | None,
    objective: str,
    starts: int,
    seed: int,
    own_law: bool = False,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Identification, ...]:
    """The identifications, one for each force map, of a table that is complete."""
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "identification needs float64, and JAX computes in float32 by default. Put this "
            "line before any other use of JAX: "
            'jax.config.update("jax_enable_x64", True)'
        )
    posed, form = check_options(law, constraint, dependence, starts)
    check_objective(objective)
    weighted = [one.force_std is not None for one in data]
    if any(weighted) and not all(weighted):
        raise InputError(
            "some specimens have standard deviations of their forces (force_std) and some have "
            "not: readings identified together are weighed alike, so give them to all or none"
        )
    full = _with_offsets(table, data, law)
    for one, source in zip(data, sources, strict=True):
        own = {
            name.removesuffix(f"[{one.specimen.name}]"): entry
            for name, entry in full.items()
            if "[" not in name or name.endswith(f"[{one.specimen.name}]")
        }
        check_source(source, table)
        check_lengths(one, own)
        check_priors(one, own, noise)
    check_count(data, law, form, full, own_law=own_law)
    problem = pose(
        data, sources, full, law, terms=terms, constraint=posed, dependence=form, own_law=own_law,
        noise=noise or 1.0,
    )  # fmt: skip
    check_affine(problem)
    check_solvable(problem)
    cube, robust = latin_hypercube(len(problem.free), starts, seed), None
    if objective == "huber":
        best, ends, robust = descend_huber(problem, cube, progress)
        problem = problem.with_readings(factor=robust.weight)
    else:
        ends = descend_all(problem, cube, progress)
        best = best_of(ends)
    best, problem = refine(problem, best, EXCHANGES)
    found = optimal(problem, best, law.order, robust)
    asked = Asked(law, posed, form, box, seed)
    return summarise(data, found, ends, full, asked, robust)


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

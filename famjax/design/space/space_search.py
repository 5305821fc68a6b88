"""The search: every candidate of a space of designs, in chunks of one shape."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from ...boundary.errors import InputError
from ...boundary.tasks import AnyExecutor, run_tasks
from ...materials.abstract_material import AbstractMaterial
from ..catalogue import Catalogue
from ..catalogue_search import Requirement
from ..swage_tube import TubeOptions, TubeStrength, assumption_notes, tube_strengths
from .chunk import Columns, Tally, search_chunk
from .front import balance, costs_of
from .grid import SearchGrid
from .limits import CONSTRAINTS, DEFAULT_OBJECTIVES, SearchLimits, SearchRanges, check_objectives
from .pairs import BuildablePair, buildable_pairs
from .performance import demand_numbers, pair_numbers
from .refinement import Refinement, refine

CHUNK = 16384
"""Candidates evaluated at once: some 60 MiB of working memory."""

_ROUNDING = 1e-9  # relative: the same pressure in two units


@dataclasses.dataclass(frozen=True)
class Exclusion:
    """What a constraint leaves out.

    Attributes:
        constraint: one of `CONSTRAINTS`.
        limit: what is asked for, in SI.
        excluded: candidates that do not keep to it.
        alone: those that keep to everything else.
        closest: the best that any candidate reaches, in SI; nan where none can be evaluated.
    """

    constraint: str
    limit: float
    excluded: int
    alone: int
    closest: float


@dataclasses.dataclass(frozen=True)
class SpaceSearch:
    """What a search of a space of designs found.

    Columns are `index` and `pair`, a position in `pairs`, and in SI: `rest_length` L0 [m],
    `pressure` P [Pa], `braid_angle` theta0 [rad] from the circumference, `nominal_diameter` of the
    braid [m], `blocked_force` [N], `force` [N] where it is asked for, usable `contraction` [-],
    `stroke` [m], `outer_diameter` [m], `air` [m3] of free air to fill it, and the factors [-] of
    `SearchLimits`, nan where nothing is known.

    Attributes:
        requirement: as given.
        limits: as given.
        ranges: as given.
        objectives: as given.
        front_step: as given.
        pairs: that can be built; the others are in `left_out`.
        left_out: pairs that cannot be built, by reason: "braid", "end_fitting", "untested".
        grid: the candidates.
        feasible: how many candidates keep to everything.
        exclusions: of every constraint that leaves out some candidate.
        front: columns of the front, the most balanced first; see `front_members`.
        sample: columns of feasible candidates, all or an even choice of them.
        nearest: columns of the nearest miss, with its `shortfall`; empty where something is feasible.
        refined: the best of the front for each objective, and for all at once, refined.
        notes: sentences on what was assumed, and on where a range ends the front.
    """

    requirement: Requirement
    limits: SearchLimits
    ranges: SearchRanges
    objectives: tuple[str, ...]
    front_step: float
    pairs: tuple[BuildablePair, ...]
    left_out: dict[str, int]
    grid: SearchGrid
    feasible: int
    exclusions: tuple[Exclusion, ...]
    front: Columns
    sample: Columns
    nearest: Columns
    refined: tuple[Refinement, ...]
    notes: tuple[str, ...]


def search_space(
    catalogue: Catalogue,
    requirement: Requirement,
    *,
    ranges: SearchRanges,
    limits: SearchLimits | None = None,
    about: int = 1_000_000,
    objectives: Sequence[str] = DEFAULT_OBJECTIVES,
    material: AbstractMaterial | None = None,
    tube: TubeOptions | None = None,
    front_step: float = 0.01,
    table_rows: int = 100_000,
    refined_pairs: int = 4,
    chunk: int = CHUNK,
    executor: AnyExecutor = None,
    progress: Callable[[int, int], None] | None = None,
) -> SpaceSearch:
    """The Pareto front of every pair of a catalogue at every rest length, pressure and braid angle.

    The candidates are a grid: each pair that can be built, at evenly spaced rest lengths and
    pressures, and nominal diameters of the braid where it is made to order. They are evaluated in
    chunks of one shape, so that memory does not grow with their number, and what is found does not
    depend on the chunk. The best of the front for each objective, and for all at once, is then
    improved between the points of the grid.

    Args:
        catalogue: from `load_catalogue`.
        requirement: in SI; its pressure is the greatest that may be given to the muscle.
        ranges: of rest length and pressure, in SI.
        limits: what is kept to beside the requirement; None for `SearchLimits()`.
        about: number of candidates; the grid has at most so many, but one for each pair.
        objectives: of `OBJECTIVES`; the fewer, the shorter the front.
        material: of the bladders whose rubber the catalogue does not know, in Pa; None neglects
            them.
        tube: what is known of the swage tubes beside the catalogue.
        front_step: share [-] by which members of the front differ, >= 0; see `front_members`.
        table_rows: most rows of `sample`.
        refined_pairs: pairs that are tried for each refinement; 0 for none.
        chunk: candidates evaluated at once.
        executor: what evaluates the chunks, see `famjax.boundary.tasks.AnyExecutor`. A worker
            compiles for some seconds first, so that one process is best up to 1e7 candidates.
        progress: called with the number of candidates done and of all.

    Returns:
        What was found; `front` is empty where no candidate keeps to everything.

    Raises:
        InputError: a material that is no polynomial beside bladders whose coefficients the
            catalogue gives; an unknown objective, a pressure range beyond the requirement's pressure, a
            number out of its range, a catalogue without swage tubes.

    >>> from famjax.design import Requirement, SearchLimits, SearchRanges, load_catalogue
    >>> found = search_space(
    ...     load_catalogue(),
    ...     Requirement(pressure=690e3, force=2000.0, contraction=0.2),
    ...     ranges=SearchRanges(rest_length=(0.1, 0.6), pressure=(200e3, 690e3)),
    ...     limits=SearchLimits(stroke=0.05),
    ...     about=2000, chunk=512,
    ... )
    >>> found.grid.total, found.pairs[found.front["pair"][0]].name
    (1859, 'bladder 0.875 in x 0.0625 in under Kevlar 1.5 in')
    """
    limits = limits or SearchLimits()
    wanted = check_objectives(objectives)
    _check(requirement, ranges, about=about, chunk=chunk, table_rows=table_rows, step=front_step)
    strengths = tube_strengths(catalogue, tube)
    pairs, left_out = buildable_pairs(catalogue, limits, strengths)
    grid = SearchGrid.of(pairs, ranges, about)
    space = {
        "grid": (grid.low, grid.high, grid.counts),
        "pairs": pair_numbers(pairs, material),
        "demand": demand_numbers(requirement, limits),
        "material": material,
        "objectives": wanted,
        "front_step": front_step,
        "chunk": chunk,
        "states": grid.most_states(chunk),
        "table_rows": table_rows,
    }

    def report(done: int, _: int) -> None:
        if progress is not None:
            progress(min(done * chunk, grid.total), grid.total)

    work = functools.partial(search_chunk, space)
    tally = Tally(space)
    run_tasks(work, range(0, grid.total, chunk), executor=executor, store=tally, progress=report)
    front = _balanced(tally.front, wanted) if tally.feasible else {}
    notes = assumption_notes(map(_of_the_section, strengths)) if limits.end_fittings else []
    return SpaceSearch(
        requirement, limits, ranges, wanted, front_step, tuple(pairs), left_out, grid,
        tally.feasible, _exclusions(tally, space["demand"]), front, tally.sample,
        {} if tally.feasible else tally.nearest,
        tuple(refine(space, front, refined_pairs) if tally.feasible else ()),
        (*notes, *_at_the_ends(front, ranges)),
    )  # fmt: skip


def _of_the_section(strength: TubeStrength) -> TubeStrength:
    """What matters of a tube's strength here: its yield load."""
    assumed = tuple(name for name in strength.assumed if name == "yield_stress")
    return dataclasses.replace(strength, assumed=assumed)


def _check(
    requirement: Requirement, ranges: SearchRanges, *, about: int, chunk: int, table_rows: int,
    step: float,
) -> None:  # fmt: skip
    for name, value, least in (
        ("about", about, 1),
        ("chunk", chunk, 1),
        ("table_rows", table_rows, 0),
    ):
        if value < least:
            raise InputError(f"{name} must be >= {least}, got {value}")
    if not 0 <= step < 1:
        raise InputError(f"front_step must be in [0, 1), got {step}; 0.01 is 1 %")
    if ranges.pressure[1] > requirement.pressure * (1 + _ROUNDING):
        raise InputError(
            f"the pressure range ends at {ranges.pressure[1]:.6g} Pa, above the pressure of the "
            f"requirement, {requirement.pressure:.6g} Pa, which is the greatest that there is"
        )


def _balanced(front: Columns, objectives: Sequence[str]) -> Columns:
    """The front in the order of `balance`, the most balanced first."""
    order = np.argsort(balance(costs_of(front, objectives)), kind="stable")
    return {name: values[order] for name, values in front.items()}


def _exclusions(tally: Tally, demand: Mapping[str, float]) -> tuple[Exclusion, ...]:
    found = []
    if not tally.nearest:
        return ()
    rows: list[NDArray] = [tally.excluded, tally.alone, tally.closest]
    for (name, (_, side)), excluded, alone, margin in zip(CONSTRAINTS.items(), *rows, strict=True):
        limit = demand[name]
        if excluded:
            reached = limit * (1 - margin if side == "most" else 1 + margin)
            found.append(Exclusion(name, limit, int(excluded), int(alone), float(reached)))
    return tuple(sorted(found, key=lambda one: -one.excluded))


def _at_the_ends(front: Columns, ranges: SearchRanges) -> list[str]:
    """A sentence for each end of a range at which most of the front lies."""
    if not front:
        return []
    notes = []
    for name in ("rest_length", "pressure"):
        least, greatest = getattr(ranges, name)
        for end, word in ((least, "least"), (greatest, "greatest")):
            share = np.mean(np.isclose(front[name], end, rtol=1e-6, atol=0.0))
            if least < greatest and share > 0.5:
                notes.append(
                    f"{share:.0%} of the front has the {word} {name.replace('_', ' ')} of its range: "
                    "widen the range, or ask for what makes another one worth while, such as a stroke."
                )
    return notes

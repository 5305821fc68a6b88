"""Identification of a muscle from a force map: geometry outside, a certified convex fit inside."""

import math
from collections.abc import Callable, Mapping

import jax
import jax.numpy as jnp
import numpy as np

import famjax

from ._data import ForceData
from ._errors import InputError
from ._geometry_source import AbstractGeometrySource, EstimatedSource, KnownSource
from ._parameters import GEOMETRY, Bounds, coefficient_names, complete_bounds
from ._problem import (
    CONSTRAINTS,
    DEPENDENCES,
    Constraint,
    PressureDependence,
    build_problem,
    geometry_bounds,
)
from ._qp import Status
from ._result import Identification
from ._search import Search, descend, latin_hypercube, refine, solve
from ._summary import summarise

_MAX_ORDER = 8
_SAME_LENGTH = 1e-6  # relative; rest lengths of geometry and specimen are the same number


def identify(
    data: ForceData,
    *,
    order: int = 3,
    constraint: str = "drucker",
    dependence: str = "fixed",
    box: str = "physical",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    geometry: AbstractGeometrySource | famjax.AbstractGeometry | None = None,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """The muscle that fits a force map best, among those that satisfy the constraint.

    The force is linear in the coefficients E_n: for every geometry they are the certified optimum
    of a convex programme. The geometry (braid diameter, braid angle, deadband) is sought from many
    starts by Gauss-Newton with derivatives through that programme (variable projection).

    Args:
        data: the force map; slack readings are censored.
        order: of the stress law, 1 to 8.
        constraint: "none", "positive" (E_n >= 0), "slope" (rising stress on the strain range) or
            "drucker" (positive second-order work along the actuation path). It holds between the
            stations as well.
        dependence: of the coefficients on pressure: "fixed" (none), "linear" or "free".
        box: "physical" or "open", see `default_bounds`.
        bounds: intervals (min, max) in SI by parameter name, which replace those of the box; an
            interval of one value holds the parameter there.
        geometry: what the muscle's dimensions follow from. None: a cylinder in an inextensible
            braid. `EstimatedSource(specimen, n_threads, thread)`: in an elastic one. A geometry,
            such as a `famjax.MeasuredGeometry`: as it is, and only the deadband is identified.
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
    if not jax.config.read("jax_enable_x64"):
        raise RuntimeError(
            "identification needs float64, and JAX computes in float32 by default. Put this line "
            'before any other use of JAX: jax.config.update("jax_enable_x64", True)'
        )
    constraint, dependence = _check_options(order, constraint, dependence, starts)
    given = dict(bounds or {})
    if isinstance(geometry, famjax.AbstractGeometry):
        given |= _known_bounds(data, geometry)
        geometry = KnownSource(geometry)
    source = EstimatedSource(data.specimen) if geometry is None else geometry
    limits = complete_bounds(data.specimen, box, order, given)
    _check_lengths(data, limits)
    _check_count(data, order, dependence, limits)
    problem = build_problem(
        data,
        order=order,
        constraint=constraint,
        dependence=dependence,
        bounds=limits,
        source=source,
    )
    search = Search.in_box(problem, *geometry_bounds(limits))
    _check_solvable(search)
    ends = descend(search, latin_hypercube(len(search.free), starts, seed), progress)
    best, search = refine(search, ends)
    return summarise(data, search, best, ends, limits, dependence, box, seed)


def _check_options(
    order: int, constraint: str, dependence: str, starts: int
) -> tuple[Constraint, PressureDependence]:
    """The named choices, if they are among those there are."""
    if not 1 <= order <= _MAX_ORDER:
        raise InputError(f"the order of the law lies between 1 and {_MAX_ORDER}, got {order}")
    if constraint not in CONSTRAINTS:
        raise InputError(f"the constraint is one of {', '.join(CONSTRAINTS)}, got {constraint!r}")
    if dependence not in DEPENDENCES:
        raise InputError(
            f"the pressure dependence is one of {', '.join(DEPENDENCES)}, got {dependence!r}"
        )
    if starts < 1:
        raise InputError(f"at least one start is needed, got {starts}")
    return constraint, dependence


def _known_bounds(
    data: ForceData, geometry: famjax.AbstractGeometry
) -> dict[str, tuple[float, float]]:
    """Diameter and angle of a known geometry at rest and without pressure, as held parameters."""
    rest = float(geometry.rest_length)
    if abs(rest / data.specimen.rest_length - 1) > _SAME_LENGTH:
        raise InputError(
            f"the geometry's rest length, {rest * 1e3:.6g} mm, must be the specimen's, "
            f"{data.specimen.rest_length * 1e3:.6g} mm: set rest_length of the specimen"
        )
    at = geometry.dimensions(rest, 0.0)
    diameter, angle = 2 * float(at.radius), float(at.braid_angle)
    return {"braid_diameter": (diameter, diameter), "braid_angle": (angle, angle)}


def _check_lengths(data: ForceData, limits: dict[str, Bounds]) -> None:
    """Every length must be within what a braid in the box can reach."""
    rest, steepest = data.specimen.rest_length, limits["braid_angle"].max
    longest = rest / math.sin(steepest)
    longest_reading = int(np.argmax(data.length))
    if data.length[longest_reading] >= longest:
        raise InputError(
            f"reading {longest_reading + 1} has the length {data.length[longest_reading] * 1e3:.5g} "
            f"mm, longer than its thread: with a rest length of {rest * 1e3:.5g} mm and a braid "
            f"angle of at most {math.degrees(steepest):.4g} deg one thread has {longest * 1e3:.5g} "
            "mm. Check the unit of the length column and the rest length"
        )
    shortest = longest * math.sin(famjax.NEUTRAL_ANGLE)
    pulling = np.where(data.loaded, data.length, np.inf)
    reading = int(np.argmin(pulling))
    if pulling[reading] <= shortest:
        raise InputError(
            f"reading {reading + 1} pulls at the length {pulling[reading] * 1e3:.5g} mm, a "
            f"contraction of {1 - pulling[reading] / rest:.3f}, but no braid of at most "
            f"{math.degrees(steepest):.4g} deg pulls when shorter than {shortest * 1e3:.5g} mm "
            f"(rest length {rest * 1e3:.5g} mm). Check the lengths and the rest length"
        )


def _check_count(
    data: ForceData, order: int, dependence: PressureDependence, limits: dict[str, Bounds]
) -> None:
    """There must be more readings than parameters, and pressures for a law that depends on them."""
    pressures = data.pressure[data.loaded]
    levels = np.unique(pressures)
    if dependence != "fixed" and levels.size < 2:
        raise InputError(
            f"a law that is {dependence} in pressure needs readings at two pressures or more; all "
            f"{pressures.size} loaded readings are at {levels[0] / 1e3:.5g} kPa. Use a law that "
            "does not depend on pressure (--dependence fixed)"
        )
    free_geometry = sum(not limits[name].fixed for name in GEOMETRY)
    free_coefficients = sum(not limits[name].fixed for name in coefficient_names(order))
    nodes = {"fixed": 1, "linear": 2, "free": levels.size}[dependence]
    unknowns = free_geometry + nodes * free_coefficients
    if pressures.size < unknowns:
        raise InputError(
            f"{pressures.size} loaded readings cannot determine {unknowns} parameters "
            f"({free_geometry} of the geometry, {nodes * free_coefficients} coefficients): give "
            "more readings, a lower order, or fix parameters by bounds"
        )
    if unknowns == 0:
        raise InputError("every parameter is fixed by its bounds: there is nothing to identify")
    rest = data.specimen.rest_length
    lengths = np.unique(data.length[data.loaded & (data.length != rest)])
    if lengths.size < order:
        raise InputError(
            f"a law of order {order} needs loaded readings at {order} or more lengths away from the "
            f"rest length, {rest * 1e3:.5g} mm, where the bladder is not strained; there are "
            f"{lengths.size}. Use a lower order, or measure at more lengths"
        )
    if dependence == "free":
        strained = data.loaded & (data.length != rest)
        known = np.array(
            [np.unique(data.length[strained & (data.pressure == P)]).size for P in levels]
        )
        poor = levels[known < order] / 1e3
        if poor.size:
            raise InputError(
                f"free coefficients need loaded readings at {order} or more lengths away from the "
                f"rest length at every pressure; too few at {', '.join(f'{P:.4g}' for P in poor)} "
                "kPa. Use --dependence linear, a lower order, or leave those pressures out"
            )


def _check_solvable(search: Search) -> None:
    """The convex fit must have a solution in the middle of the box."""
    middle = search.low + (search.high - search.low) / 2
    offsets = search.problem.programmes(middle)[1]
    lost = np.flatnonzero(~np.isfinite(np.asarray(jnp.sum(offsets, axis=0))))
    if lost.size:
        raise InputError(
            f"the geometry has no dimensions at the loaded reading {lost[0] + 1} (length "
            f"{float(search.problem.length[lost[0]]) * 1e3:.5g} mm): the bladder does not fit in the "
            "braid there, or the length is outside what was measured"
        )
    statuses = [Status(int(code)) for code in np.unique(solve(search.problem, middle).status)]
    worst = statuses[-1]
    if worst in {Status.RANK_DEFICIENT, Status.INFEASIBLE}:
        raise InputError(worst.message)

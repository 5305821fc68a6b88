"""Identify muscles from force maps: an outer search for the geometry around a certified convex fit."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from .arguments import check_whole
from .data import ForceData, several_maps
from .families import LawGiven
from .mechanics import check_ends, equilibrium_options
from .parameters import Parameter
from .pictured import join, read_pictures
from .posing import EXCHANGES, Geometry, Posed, pose
from .result import Identification
from .search import best_of, check_objective, descend_all, descend_reweighted, refine
from .shapes import Pictures
from .summary import summarise


def identify(
    data: ForceData,
    *,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    objective: str = "sum_of_squares",
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    ends: str = "cylinder",
    pictures: Any = None,
    censored: bool = False,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> Identification:
    """Find the muscle that best fits a force map while satisfying the constraint.

    The force is linear in the coefficients of the law, so for each geometry a convex programme finds their
    certified optimum. The Gauss-Newton method, from many starting points, optimises the nonlinear
    parameters: braid diameter, braid angle, deadband, and those named in `parameters`. It differentiates
    through the convex programme (variable projection).

    Args:
        data: the force map; see `censored` for slack readings.
        law: "polynomial", "ogden", "mooney-rivlin", "saturating", "neo-hookean" or
            "yeoh"; or your own subclass of `famjax.materials.AbstractMaterial`, whose parameters are
            declared with `famjax.parameter`, given as a class, an instance, or "module:Class".
        order: order of the polynomial law, 1 to 8; default: 3.
        constraint: "none", "positive" (every coefficient >= 0), "slope" (stress increases over the
            strain range) or "drucker" (positive second-order work along the actuation path). "slope"
            and "drucker" are also enforced between the points at which they are evaluated.
        bounds: intervals (min, max) in SI by parameter name, in place of those in `standard_table`.
            Equal bounds fix the parameter.
        parameters: bounds with units, fixed values and priors. Optional parameters are fitted only if
            named here: `rest_length`, `end_factor` (k of Tondu & Lopez) or `end_length` (dead length
            L0 (1 - 1/k)), `braid_compliance` (of all threads), `series_compliance` (of the rig) and
            `series_exponent` (rig deflection as a power of the force, see `famjax.muscle.give_way`).
        noise: standard deviation of one reading [N], used to weight priors. Required with priors if
            the data have no `force_std`.
        objective: "sum_of_squares"; "huber", which counts residuals beyond 1.345 standard deviations
            linearly, with the noise estimated from the median residual; or "mean_rmse", the RMSE averaged
            over pressures (Chambers 2021, equation 7.6). Validation and uncertainty estimates use the final
            weights. To weight a region more heavily, reduce the `force_std` of its readings.
        geometry: source of the muscle's dimensions. If None, a cylinder in an inextensible braid is used. A
            geometry, such as `famjax.MeasuredGeometry`, is used as given, except for parameters named in
            `bounds` or `parameters`. A function or class must wrap the estimated geometry, for example with
            elastic threads; its declared parameters are fitted if they are named in those arguments.
        terms: further force terms, such as your own spring; their declared parameters are fitted if
            they are named in `bounds` or `parameters`. A term that has a `deadband_pressure` replaces
            Gaylord's term.
        ends: "cylinder", or "equilibrium" to compute the shape from mechanics between end-fittings with an
            identified diameter (`famjax.EquilibriumMuscle`). The force is then nonlinear in the law's
            parameters, so the optimum is local and has no certificate, and no constraint applies.
        pictures: photographed profiles to fit together with the force: a `measurements.nc` that
            contains pressures, or its table; only with ends="equilibrium".
        censored: True to penalise, with one-sided squares, a model that pulls at slack readings or
            pulls less than the load cell's limit at saturated ones. The fit remains convex.
        starts: number of starting points, sampled from the box as a Latin hypercube.
        seed: random seed for the starts.
        progress: called with (starts done, total starts) after each descent.

    Returns:
        The identified muscle with standard errors, certificate and warnings.

    Raises:
        InputError: the data cannot support the fit, or an option is invalid; the message states the reason.
        RuntimeError: float64 is off.

    References:
        Golub & Pereyra 1973 (variable projection); Chambers 2021, chapter 7.
    """
    check_whole("starts", starts, 1)
    check_objective(objective, censored=censored)
    asked: dict[str, Any] = {
        "law": law, "order": order, "constraint": constraint, "bounds": bounds,
        "parameters": parameters, "geometry": geometry, "terms": terms,
    }  # fmt: skip
    if check_ends(ends, asked) == "equilibrium":
        asked = equilibrium_options((data,), law, order, bounds, parameters, seed)
    if pictures is not None and (ends != "equilibrium" or objective != "sum_of_squares"):
        raise InputError(
            "pictures can be fitted together with the force only if ends='equilibrium' and "
            "objective='sum_of_squares'. To use the measured shape, pass "
            "geometry=fitting.shape_surface(pictures).geometry(data.specimen)"
        )
    shapes = None if pictures is None else read_pictures(pictures)
    posed = pose((data,), noise=noise, censored=censored, **asked)
    (found,) = solve(
        posed, posed.starts(starts, seed), objective=objective, seed=seed, progress=progress,
        pictures=shapes, noise=noise or (None if data.force_std is None else 1.0),
    )  # fmt: skip
    return found


def identify_together(
    data: Sequence[ForceData],
    *,
    own: Sequence[str] = ("deadband_pressure",),
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    objective: str = "sum_of_squares",
    geometry: Geometry | None = None,
    terms: famjax.terms.AbstractForceTerm | None = None,
    ends: str = "cylinder",
    censored: bool = False,
    starts: int = 16,
    seed: int = 0,
    progress: Callable[[int, int], None] | None = None,
) -> tuple[Identification, ...]:
    """Identify several specimens in one fit, with shared and individual parameters.

    Args:
        data: one force map per specimen, with distinct names.
        own: parameters with a separate value for each specimen; all others are shared.
        law: bladder law, see `identify`.
        order: order of the polynomial law.
        constraint: constraint on the coefficients, see `identify`.
        parameters: bounds, fixed values and priors, the same for every specimen.
        noise: standard deviation of one reading [N].
        objective: see `identify`.
        geometry: a class or function that wraps the estimated geometry of each specimen.
        terms: further force terms, the same for every specimen; see `identify`.
        ends: see `identify`; with "equilibrium" all specimens share one law.
        censored: see `identify`.
        starts: number of starts.
        seed: random seed for the starts.
        progress: called with (starts done, total starts).

    Returns:
        One identification per specimen. The shared parameters, the certificate and the starts are the
        same in all of them; an individual parameter is named `name[specimen]`.

    Raises:
        InputError: the data cannot support the fit, or an option is invalid; the message states the reason.
        RuntimeError: float64 is off.
    """
    check_whole("starts", starts, 1)
    check_objective(objective, censored=censored)
    asked: dict[str, Any] = {
        "law": law, "order": order, "constraint": constraint, "parameters": parameters,
        "geometry": geometry, "terms": terms, "own": own,
    }  # fmt: skip
    if check_ends(ends, asked) == "equilibrium":
        asked = equilibrium_options(several_maps(data), law, order, None, parameters, seed, own)
    posed = pose(data, noise=noise, censored=censored, **asked)
    return solve(
        posed, posed.starts(starts, seed), objective=objective, seed=seed, progress=progress
    )


def solve(
    posed: Posed,
    starts: Float[np.ndarray, "k p"],
    *,
    objective: str = "sum_of_squares",
    seed: int,
    progress: Callable[[int, int], None] | None = None,
    pictures: Pictures | None = None,
    noise: float | None = None,
) -> tuple[Identification, ...]:
    """Solve a posed problem and return one identification per force map.

    Args:
        posed: the problem.
        starts: starting points in the unit box of the free parameters.
        objective: see `identify`.
        seed: random seed of the starts, stored in the identification.
        progress: called with (starts done, total starts).
        pictures: photographed profiles to fit together with the force of a single map.
        noise: standard deviation of a force reading, used to weight the pictures; None if unknown.

    Raises:
        InputError: from every starting point, the force is undefined (nan) at some reading.
    """
    problem, weights, shapes = posed.problem, None, None
    if objective != "sum_of_squares":
        best, ends, weights = descend_reweighted(problem, starts, objective, progress)
        problem = problem.with_readings(factor=weights.factor)
    else:
        ends = descend_all(problem, starts, progress)
        best = best_of(ends)
    if pictures is not None:
        best, problem, shapes = join(problem, best, pictures, noise)
    best, _ = refine(problem, best, EXCHANGES)
    best = best_of([best])  # with a compliant rig, the refined point may have no finite force
    return summarise(posed, best, ends, seed, weights, shapes)

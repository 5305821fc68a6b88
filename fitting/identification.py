"""Identification of muscles from force maps: geometry outside, a certified convex fit inside."""

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
from .summary import optimal, summarise


def identify(
    data: ForceData,
    *,
    law: LawGiven = "polynomial",
    order: int | None = None,
    constraint: str = "drucker",
    dependence: str = "fixed",
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
        dependence: of the polynomial's coefficients on pressure: "fixed" (none) or "linear".
        bounds: intervals (min, max) in SI by parameter name, which replace those of `standard_table`; an
            interval of one value holds the parameter there.
        parameters: the same with units, held values and priors. Naming one of these makes it take
            part: `rest_length`, `end_factor` (k of Tondu & Lopez) or `end_length` (dead length
            L0 (1 - 1/k)), `braid_compliance` (of all threads), `series_compliance` (of the rig), with
            it `series_exponent` (of a rig that gives way by a power of the force, see
            `famjax.muscle.give_way`).
        noise: standard deviation of one reading [N], against which priors are weighed; needed
            with priors where the data have no `force_std`.
        objective: "sum_of_squares"; "huber", which counts residuals beyond 1.345 standard
            deviations of the noise, as the median of the residuals shows it, by their size and
            not their square; or "mean_rmse", the mean over pressures of the RMSE (Chambers 2021, equation
            7.6). Validation and uncertainty keep the weights found. Readings of a region weigh more by
            a smaller `force_std`.
        geometry: what the muscle's dimensions follow from. None: a cylinder in an inextensible
            braid. `EstimatedSource(specimen, n_threads, thread)`: in an elastic one. A geometry,
            such as a `famjax.MeasuredGeometry`: as it is, and of it only what `bounds` or
            `parameters` name is identified. A function, or class, that makes a geometry of the
            estimated one: its declared parameters take part where they are named.
        terms: further force terms, such as `famjax.terms.Spring`; their declared parameters take part
            where they are named. A term with a `deadband_pressure` takes the place of Gaylord's.
        ends: "cylinder", or "equilibrium": the shape follows from mechanics between end-fittings whose
            diameter is identified, `famjax.EquilibriumMuscle`. The force is not linear in the law then,
            so that the fit has a local optimum and no certificate, and no constraint is placed.
        pictures: photographs whose profiles are fitted together with the force, a `measurements.nc` with
            pressures or its table; for ends="equilibrium".
        censored: whether slack readings count where the model pulls at them, and saturated ones
            where it pulls less than the load cell's limit, as one-sided squares; the fit stays convex.
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
    check_whole("starts", starts, 1)
    check_objective(objective, censored=censored)
    asked: dict[str, Any] = {
        "law": law, "order": order, "constraint": constraint, "dependence": dependence,
        "bounds": bounds, "parameters": parameters, "geometry": geometry, "terms": terms,
    }  # fmt: skip
    if check_ends(ends, asked) == "equilibrium":
        asked = equilibrium_options((data,), law, order, bounds, parameters, seed)
    elif pictures is not None:
        raise InputError(
            "pictures are fitted together with the force only for ends='equilibrium'. To use the measured "
            "shape instead, give geometry=fitting.shape_surface(pictures).geometry(data.specimen)"
        )
    shapes = None if pictures is None else read_pictures(pictures)
    if shapes is not None and objective != "sum_of_squares":
        raise InputError(f"with pictures the objective is sum_of_squares, got {objective!r}")
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
    own_law: bool = False,
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
    """Several specimens identified at once, with shared and own parameters.

    Args:
        data: one force map for each specimen, with different names.
        own: parameters that each specimen has for itself; all others are shared.
        own_law: whether each specimen has its own coefficients of the law.
        law: as in `identify`, and all that follows.
        order: of the polynomial law.
        constraint: on the coefficients.
        parameters: bounds, held values and priors, the same for every specimen.
        noise: standard deviation of one reading [N].
        objective: as in `identify`.
        geometry: a class or function of the estimated geometry of each specimen.
        terms: further force terms, the same for every specimen; see `identify`.
        ends: as in `identify`; with "equilibrium" all share one law.
        censored: as in `identify`.
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
    check_whole("starts", starts, 1)
    check_objective(objective, censored=censored)
    asked: dict[str, Any] = {
        "law": law, "order": order, "constraint": constraint, "parameters": parameters,
        "geometry": geometry, "terms": terms, "own": own, "own_law": own_law,
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
    """The identifications for a posed problem, one per force map.

    Args:
        posed: the problem.
        starts: points of the unit box of the free parameters.
        objective: as in `identify`.
        seed: of the starts, which the identification knows.
        progress: called with (starts done, starts).
        pictures: fitted together with the force of the one map.
        noise: standard deviation of a force reading by which they are weighed; None if not stated.

    Raises:
        InputError: no start ends at a force for every reading.
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
    best, problem = refine(problem, best, EXCHANGES)
    best = best_of([best])  # a rig that gives way may have a force there only by way of the descent
    found = optimal(problem, best, posed.law.order, weights)
    return summarise(posed, found, ends, seed, weights, shapes)

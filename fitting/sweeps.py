"""Fit all combinations of order, pressure dependence and constraint for one geometry."""

import dataclasses
import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from .arguments import check_float64, check_names, check_whole, is_number, shown
from .convex import Status
from .data import ForceData, check_maps
from .response import CONSTRAINTS, DEPENDENCES
from .sweep_fits import Design, LinearMuscle, fits_of

OBJECTIVES = ("sum_of_squares", "mean_rmse")

FEASIBLE = 1e-9
"""Violation of a constraint, relative to the largest coefficient, that counts as rounding error."""

_HIGHEST_ORDER = 4
"""Highest order for which the tangent modulus is a cubic, so that its constraint is exact."""


@dataclasses.dataclass(frozen=True)
class SweepRow:
    """One fit in a sweep, in SI.

    Attributes:
        dependence, order, constraint: options of the law.
        n_coefficients: number of coefficients.
        coefficients: E_n [Pa] at each pressure, shape (pressures, order).
        objective: minimum of the objective: half the sum of squares, or the mean RMSE.
        rmse, mae: root mean square and mean absolute error [N], averaged over pressures.
        rmse_by_pressure, mae_by_pressure: the same at each pressure [N].
        blocked_error: mean over pressures of |model - measured| blocked force [N].
        blocked_error_by_pressure: model minus measured blocked force [N].
        free_contraction_error: mean of |model - measured| [-] over pressures with both values; nan if none.
        free_contraction_error_by_pressure: model minus measured [-]; nan if the model's force does not
            fall to zero, or the measured force is never close to zero.
        bic: Bayesian information criterion for independent normal errors and unconstrained coefficients.
        cross_validated_rmse: RMSE [N] at held-out pressures; nan if the law cannot predict other pressures.
        margin: smallest modulus along the actuation paths [Pa]; Drucker-stable when >= 0.
        kkt_residual, duality_gap: certificate of optimality.
        status: status of the solver.
        verdict: "stable", "not stable", or the reason why there is no fit.
    """

    dependence: str
    order: int
    constraint: str
    n_coefficients: int
    coefficients: Float[np.ndarray, "pressures order"]
    objective: float
    rmse: float
    mae: float
    rmse_by_pressure: Float[np.ndarray, " pressures"]
    mae_by_pressure: Float[np.ndarray, " pressures"]
    blocked_error: float
    blocked_error_by_pressure: Float[np.ndarray, " pressures"]
    free_contraction_error: float
    free_contraction_error_by_pressure: Float[np.ndarray, " pressures"]
    bic: float
    cross_validated_rmse: float
    margin: float
    kkt_residual: float
    duality_gap: float
    status: Status
    verdict: str

    def as_dict(self) -> dict[str, Any]:
        """Return JSON-ready numbers and lists; nan is left unchanged."""
        plain = {k: v.tolist() if isinstance(v, np.ndarray) else v for k, v in vars(self).items()}
        return plain | {"status": self.status.name}


@dataclasses.dataclass(frozen=True, repr=False)
class Sweep:
    """Result of `sweep`.

    Attributes:
        rows: all fits, in the order of dependence, order and constraint.
        pressures: pressure levels of the force map [Pa].
    """

    rows: tuple[SweepRow, ...]
    pressures: Float[np.ndarray, " pressures"]


def sweep(
    data: ForceData,
    geometry: famjax.geometries.AbstractGeometry,
    *,
    deadband: float = 0.0,
    terms: famjax.terms.AbstractForceTerm | None = None,
    orders: Sequence[int] = (1, 2, 3, 4),
    dependences: Sequence[str] = DEPENDENCES,
    constraints: Sequence[str] = CONSTRAINTS,
    objective: str = "sum_of_squares",
) -> Sweep:
    """Fit all combinations of law options at a fixed geometry, each to a certified global optimum.

    The force is linear in the coefficients, so every fit is convex. Constraints are also enforced between
    the readings.

    Args:
        data: the force map.
        geometry: the fixed geometry.
        deadband: P_d [Pa].
        terms: fixed force terms in addition to braid and bladder.
        orders: orders of the law, 1 to 4.
        dependences: how the coefficients depend on pressure: any of "fixed", "linear" and "free".
        constraints: constraints on the coefficients: any of "none", "positive", "slope" and "drucker".
        objective: "sum_of_squares", or "mean_rmse" over pressures, as in the reference work.

    Returns:
        The fits.

    Raises:
        InputError: the data or options cannot be used.
        RuntimeError: float64 is off.

    References:
        Chambers 2021, sections 7.1 to 7.3.
    """
    check_float64()
    check_maps(data)
    if not isinstance(geometry, famjax.geometries.AbstractGeometry):
        raise InputError(
            f"a sweep needs a famjax geometry with all dimensions, got {shown(geometry)}"
        )
    if not (is_number(deadband) and 0 <= deadband < math.inf):
        raise InputError(f"the deadband must be a gauge pressure [Pa] >= 0, got {shown(deadband)}")
    if isinstance(orders, str) or not isinstance(orders, Iterable) or not tuple(orders):
        raise InputError(
            f"orders must be a list of whole numbers from 1 to {_HIGHEST_ORDER}, such as [1, 2]; got "
            f"{shown(orders)}"
        )
    each = sorted({check_whole("each of the orders", one, 1, _HIGHEST_ORDER) for one in orders})
    dependences = _named("dependences", check_names("dependences", dependences), DEPENDENCES)
    constraints = _named("constraints", check_names("constraints", constraints), CONSTRAINTS)
    _named("objective", [objective], OBJECTIVES)
    further = None if terms is None else famjax.terms.SumOfTerms((terms,))
    muscle = LinearMuscle(geometry, float(deadband), further, each[-1])
    of = Design.of(muscle, data)
    rows = [
        row for form in dependences for row in _rows(of, form, tuple(each), constraints, objective)
    ]
    return Sweep(tuple(rows), of.pressure)


def _named(what: str, given: Sequence[str], known: Sequence[str]) -> tuple[str, ...]:
    """Return the given options in their standard order."""
    strange = [value for value in given if value not in known]
    if strange or not given:
        raise InputError(f"{what} must be chosen from {', '.join(known)}; got {strange or 'none'}")
    return tuple(value for value in known if value in given)


def _rows(
    of: Design,
    dependence: str,
    orders: tuple[int, ...],
    constraints: tuple[str, ...],
    objective: str,
) -> Iterator[SweepRow]:
    """Yield the fits with one dependence, with their errors, information criteria and stability."""
    fits, left_out = fits_of(of, dependence, orders, constraints, objective)
    E, count = fits.coefficients, of.there.sum(axis=1)
    residual, n = of.residual(E), count.sum()
    rmse = np.sqrt((residual**2).sum(axis=-1) / count)
    mae = np.abs(residual).sum(axis=-1) / count
    blocked, free = _end_errors(of, E)
    square = ((of.weight * residual) ** 2).sum(axis=(-2, -1))
    margin = of.tables["drucker"].weakest(E)[0].min(axis=-1)
    nodes = {"fixed": 1, "linear": min(2, count.size), "free": count.size}[dependence]
    for at in np.ndindex(fits.status.shape):
        order, status = orders[at[0]], Status(int(fits.status[at]))
        k = nodes * order
        stable = margin[at] >= -FEASIBLE * float(np.abs(E[at]).max())
        known = np.abs(free[at][np.isfinite(free[at])])
        yield SweepRow(
            dependence, order, constraints[at[1]],
            n_coefficients=k,
            coefficients=E[at][:, :order],
            objective=float(fits.objective[at]),
            rmse=float(rmse[at].mean()), mae=float(mae[at].mean()),
            rmse_by_pressure=rmse[at], mae_by_pressure=mae[at],
            blocked_error=float(np.abs(blocked[at]).mean()),
            blocked_error_by_pressure=blocked[at],
            free_contraction_error=float(known.mean()) if known.size else math.nan,
            free_contraction_error_by_pressure=free[at],
            bic=float(n * np.log(square[at] / n) + (k + 1) * np.log(n)),
            cross_validated_rmse=float(np.sqrt(left_out[at].sum() / n)),
            margin=float(margin[at]),
            kkt_residual=float(fits.kkt_residual[at]), duality_gap=float(fits.duality_gap[at]),
            status=status,
            verdict=status.message if status else "stable" if stable else "not stable",
        )  # fmt: skip


def _end_errors(
    of: Design, E: Float[np.ndarray, "*fits pressures order"]
) -> tuple[Float[np.ndarray, "*fits pressures"], Float[np.ndarray, "*fits pressures"]]:
    """Return fitted minus measured blocked force [N] and free contraction [-], by pressure.

    The measured blocked force is the mean of the readings at rest. The measured free contraction is
    extrapolated by a line through the readings below a tenth of the largest force, or at the two shortest
    lengths. Each difference is nan if the quantity was not measured.
    """
    muscle, rest = of.muscle, of.muscle.rest_length
    # Search up to twice the largest measured contraction.
    reached = 2.0 * (1 - of.path_end.min() / rest)
    contraction = min(reached, 1 - muscle.shortest_length / rest) * np.linspace(0, 1, 129)
    braid, bladder = muscle.columns(rest * (1 - contraction), of.pressure[:, None])
    force = braid + (bladder @ E[..., None])[..., 0]
    falls = (force[..., :-1] > 0) & (force[..., 1:] <= 0)
    at = falls.argmax(axis=-1)
    before, after = (
        np.take_along_axis(force, (at + k)[..., None], axis=-1)[..., 0] for k in (0, 1)
    )
    drop = np.where(before > after, before - after, 1.0)
    step = contraction[at + 1] - contraction[at]
    free = np.where(falls.any(axis=-1), contraction[at] + step * before / drop, np.nan)
    measured = np.full((2, len(of.pressure)), np.nan)
    rows = zip(of.force, 1 - of.length / of.muscle.rest_length, of.there, strict=True)
    for k, (read, shorter, there) in enumerate(rows):
        F, contraction = read[there], shorter[there]
        at_rest = np.abs(contraction) < 1e-3
        if at_rest.any():
            measured[0, k] = F[at_rest].mean()
        near = 0.1 * F.max() >= F
        if np.unique(contraction[near]).size < 3:
            near = contraction >= np.unique(contraction)[-2:][0]
        if np.unique(F[near]).size > 1:
            slope, at_zero = np.polyfit(F[near], contraction[near], 1)
            measured[1, k] = at_zero if slope < 0 else np.nan
    return force[..., 0] - measured[0], free - measured[1]

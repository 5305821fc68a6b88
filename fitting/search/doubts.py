"""What a reader must know before using the numbers of an identification."""

from typing import TYPE_CHECKING

import numpy as np

from famjax.boundary.sentence import Quantity, Sentence

from ..covariance import CONDITION_LIMIT
from .multi_start import rounding_of

if TYPE_CHECKING:
    from .result import Identification

_RIDGE = 0.98
_OUTLYING = 0.5  # of the full weight of a reading
_PULLED = 2.0  # standard deviations of a prior
_UNEQUAL = 2.0  # between standard errors with and without the belief in equal noise


def doubts(result: "Identification") -> tuple[str, ...]:
    """Full sentences, the assumptions on the data first."""
    data, condition = result.data, result.certificate.condition
    found = [*data.notes, *(of.note for of in (data.pressures, data.lengths) if of.note)]
    if result.box == "open":
        found.append(
            "The box is open: braid diameter and angle are then only fit parameters, not the "
            "dimensions of a muscle that could be built."
        )
    stopped = [e.name for e in result.estimates if e.at_bound]
    if stopped:
        found.append(
            f"At a bound: {', '.join(stopped)}. The data alone would go further, so no standard "
            "error is given; the errors of the others hold with these kept where they are."
        )
    if not np.isfinite(condition) or condition > CONDITION_LIMIT:
        found.append(
            "The parameters cannot be told apart by these data, so no standard errors are given: "
            "fix one of them by --bounds, or add lengths and pressures."
        )
    found += _pulled(result)
    outliers = result.weights < _OUTLYING
    if outliers.any():
        found.append(
            f"{outliers.sum()} of {outliers.size} readings lie so far off that they count less than "
            f"{_OUTLYING:g} of what the others do (Huber's objective); look at them."
        )
    names = result.problem.names + result.problem.linear
    plain = dict(zip(names, np.sqrt(np.diag(result.covariance)), strict=True))
    unequal = [
        e.name for e in result.estimates
        if e.stderr > 0 and not 1 / _UNEQUAL < e.sandwich_stderr / plain[e.name] < _UNEQUAL
    ]  # fmt: skip
    if unequal:
        found.append(
            f"The residuals are not equal noise: the sandwich's standard errors of "
            f"{', '.join(unequal)} differ by more than a factor of {_UNEQUAL:g} from those of equal "
            "noise; the larger are given."
        )
    found += _ridges(result)
    if result.active_constraints:
        found.append(
            "A constraint or a bound on the coefficients is active: standard errors hold along it "
            "only."
        )
    if not result.certificate.stability_margin >= -rounding_of(result.end.point):
        found.append(
            Sentence(
                "The law is NOT Drucker-stable on the actuation path (margin ",
                Quantity(result.certificate.stability_margin, "stress"),
                "): do not extrapolate or simulate with it; --constraint drucker gives the best stable "
                "law.",
            )
        )
    errors = result.errors
    if errors.max_slack_force > 2 * errors.rmse:
        found.append(
            Sentence(
                f"The model pulls at {errors.slack_violations} of {errors.n_slack} slack readings, by "
                "up to ",
                Quantity(errors.max_slack_force, "force", 3),
                ".",
            )
        )
    if result.certificate.n_agreeing < 2 < result.certificate.n_starts:
        found.append("Only one start reached the best objective: try more, by starts in Python.")
    if not result.converged:
        found.append("The fit did NOT converge; its numbers are not an optimum.")
    return tuple(found)


def _pulled(result: "Identification") -> list[str]:
    """Parameters that the data drag far from what was said to be known of them."""
    return [
        f"{e.name} lies {abs(e.value - e.prior[0]) / e.prior[1]:.1f} standard deviations of its "
        "prior away from it: the prior is too narrow, or the parameter makes up for a fault of "
        "the model."
        for e in result.estimates
        if e.prior is not None and abs(e.value - e.prior[0]) > _PULLED * e.prior[1]
    ]


def _ridges(result: "Identification") -> list[str]:
    """Pairs of nonlinear parameters that the data determine only together."""
    names, stderr = result.problem.names, np.sqrt(np.diag(result.covariance))
    correlation = result.covariance / np.outer(stderr, stderr)
    return [
        f"Ridge: {first} and {names[j]} are correlated by {correlation[i, j]:.4f}; only a "
        "combination of them is known well."
        for i, first in enumerate(names)
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) > _RIDGE
    ]

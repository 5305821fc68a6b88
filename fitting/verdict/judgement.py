"""The verdict on a fit: identified, identified with doubts, or not identified."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np

from ..search.result import Identification
from .suspect import Suspicion

Level = Literal["identified", "identified with doubts", "not identified"]

_MISFIT = 5.0  # % of the largest force: no muscle of rubber and threads is missed by so much
_POOR = 2.0  # %, likewise: a muscle may be, but a good fit is four times better
_PULL = 0.1  # of the largest force, pulled where the readings are slack
_NOISE = 3.0  # standard deviations of the readings
_GEOMETRY = ("braid_diameter", "braid_angle", "deadband_pressure", "rest_length", "end_factor")


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Whether a fit may be believed.

    Attributes:
        level: the verdict.
        reasons: sentences, the gravest first; empty for "identified".
        suspicions: what in the data would explain a misfit.
    """

    level: Level
    reasons: tuple[str, ...]
    suspicions: tuple[Suspicion, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether something was identified."""
        return self.level != "not identified"


def judge(result: Identification, suspicions: Sequence[Suspicion] = ()) -> Judgement:
    """The verdict on a fit.

    Args:
        result: the fit.
        suspicions: from `suspect`.
    """
    errors = result.errors
    grave, doubts = [one.sentence for one in suspicions], []
    if not result.converged:
        grave.insert(0, "The fit did not converge: its numbers are not an optimum.")
    if errors.rmse_percent > _MISFIT:
        grave.append(
            f"The model misses the readings by {errors.rmse_percent:.3g} % of the largest force; no "
            f"muscle of rubber and threads is missed by more than {_MISFIT:g} %. Check units, signs "
            "and columns, and the specimen's rest length, bore and wall."
        )
    elif errors.rmse_percent > _POOR:
        doubts.append(
            f"The model misses the readings by {errors.rmse_percent:.3g} % of the largest force."
        )
    pulled = errors.max_slack_force
    if pulled > _PULL * errors.max_force:
        grave.append(
            f"The model pulls with up to {pulled:.3g} N at {errors.slack_violations} of "
            f"{errors.n_slack} readings that are slack."
        )
    elif pulled > 2 * errors.rmse:
        doubts.append(
            f"The model pulls with up to {pulled:.3g} N at slack readings, more than twice its error."
        )
    doubts += _doubts(result)
    if grave:
        return Judgement("not identified", (*grave, *doubts), tuple(suspicions))
    return Judgement("identified with doubts" if doubts else "identified", tuple(doubts))


def _doubts(result: Identification) -> list[str]:
    """What does not condemn a fit by itself."""
    found = []
    stopped = [e.name for e in result.estimates if e.at_bound and e.name in _GEOMETRY]
    if stopped:
        found.append(
            f"{', '.join(stopped)} {'is' if len(stopped) == 1 else 'are'} at a bound: the data alone "
            "would go further."
        )
    std = result.data.force_std
    if std is not None:
        scatter = float(np.sqrt(np.mean((result.residuals / std[result.data.loaded]) ** 2)))
        if scatter > _NOISE and result.errors.rmse_percent > 1.0:
            found.append(
                f"The misfit is {scatter:.3g} times the standard deviation of the readings: the "
                "model is wrong by more than their noise."
            )
    if _one_sided(result):
        found.append(
            "The residuals of whole lengths lie on one side: the model, or a length, is off."
        )
    margin = result.certificate.stability_margin
    if not margin >= -1e-9 * float(np.abs(result.coefficients).max()):
        found.append(
            "The law is not Drucker-stable on the actuation path: do not extrapolate with it."
        )
    return found


def _one_sided(result: Identification) -> bool:
    """Whether the residuals of most lengths have one sign each, where the fit is not a good one."""
    level = result.data.lengths.level[result.data.loaded]
    signs = [
        abs(np.sign(result.residuals[level == one]).mean())
        for one in np.unique(level)
        if (level == one).sum() >= 5
    ]
    return len(signs) >= 3 and result.errors.rmse_percent > 1.0 and float(np.mean(signs)) > 0.9

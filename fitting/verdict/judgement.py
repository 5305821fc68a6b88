"""The verdict on a fit: identified, identified with doubts, or not identified."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from famjax.boundary.sentence import Quantity, Sentence

from ..covariance import CONDITION_LIMIT
from ..evidence.left_out import LeftOut
from ..result import Estimate, Identification
from .runs import runs_deviation
from .suspicion import Suspicion, counted

Level = Literal["identified", "identified with doubts", "not identified"]

_MISFIT = 5.0  # % of the largest force: no muscle of rubber and threads is missed by so much
POOR = 2.0
"""Misfit [%], likewise: a muscle may be, but a good fit is four times better."""
_PULL = 0.1  # of the largest force, pulled where the readings are slack
_NOISE = 3.0  # standard deviations of the readings
_MOST_OUTLIERS = 0.25  # of the readings
_RUNS = -3.0  # standard deviations below what chance gives
_TOLD = 1.0  # %: below, a model that is wrong by more than the noise is still a good one
_RIDGE, _KNOWN = 0.995, 0.1  # correlation; standard error in parts of what the bounds leave
_LEFT_OUT = 0.05  # RMSE of what is left out, of the largest force
_GEOMETRY = ("braid_diameter", "braid_angle", "deadband_pressure", "rest_length", "end_factor")
_PLAIN_AT = {
    "deadband_pressure": "low", "end_factor": "low", "end_length": "low", "braid_compliance": "low",
    "series_compliance": "low", "series_exponent": "high",
}  # fmt: skip
"""Bounds at which a parameter says that something is not there, which is no doubt."""


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Whether a fit may be believed.

    Attributes:
        level: the verdict.
        reasons: sentences, the gravest first; empty for "identified".
        suspicions: what in the data would explain a misfit.
        unchecked: a sentence on what could not be checked, as it is not known of the specimen; "" where
            all is known. A fit with an unknown rest length is not above doubt.
    """

    level: Level
    reasons: tuple[str, ...]
    suspicions: tuple[Suspicion, ...] = ()
    unchecked: str = ""

    @property
    def passed(self) -> bool:
        """Whether something was identified."""
        return self.level != "not identified"


def judge(
    result: Identification,
    suspicions: Sequence[Suspicion] = (),
    left_out: Mapping[str, LeftOut] | None = None,
    open_question: str = "",
) -> Judgement:
    """The verdict on a fit.

    Args:
        result: the fit.
        suspicions: from `suspect`.
        left_out: errors on what was left out, by "pressure" and "length", where they are known.
        open_question: where models that fit the readings alike differ by more than they can settle.
    """
    errors = result.errors
    grave = [one.sentence for one in suspicions if one.grave]
    doubts = [one.sentence for one in suspicions if not one.grave]
    if not result.converged:
        grave.append(
            "The fit did not converge: its numbers are not an optimum. Try more starts (starts=) or a "
            "law of fewer coefficients (--law)."
        )
    kept = counted(result)
    rmse = math.sqrt(float(np.mean(result.residuals[kept] ** 2)))
    if not kept.all():
        _judge_outliers(kept, rmse, grave, doubts)
    misfit = 100 * rmse / errors.max_force
    if not misfit <= _MISFIT:
        grave.append(
            f"The model misses the readings by {misfit:.3g} % of the largest force; no muscle of "
            f"rubber and threads is missed by more than {_MISFIT:g} %. Check units, signs and "
            "columns, and the specimen's rest length, bore and wall."
        )
    elif misfit > POOR:
        doubts.append(f"The model misses the readings by {misfit:.3g} % of the largest force.")
    pulled = errors.max_slack_force
    if pulled > _PULL * errors.max_force:
        grave.append(
            Sentence(
                "The model pulls with up to ",
                Quantity(pulled, "force", 3),
                f" at {errors.slack_violations} of {errors.n_slack} readings that are slack.",
            )
        )
    elif pulled > max(2 * errors.rmse, _TOLD / 100 * errors.max_force):
        doubts.append(
            Sentence(
                "The model pulls with up to ",
                Quantity(pulled, "force", 3),
                " at slack readings, more than twice its error.",
            )
        )
    doubts += [
        *_of_one_pressure(result),
        *of_bounds(result),
        *_of_residuals(result, misfit),
        *of_ridges(result),
    ]
    doubts += _of_left_out(left_out or {}, errors.max_force)
    doubts += [open_question] if open_question else []
    if grave:
        return Judgement("not identified", (*grave, *doubts), tuple(suspicions), unchecked(result))
    unsure = doubts or "rest_length" in result.data.assumed
    level = "identified with doubts" if unsure else "identified"
    return Judgement(level, tuple(doubts), tuple(suspicions), unchecked(result))


def _of_one_pressure(result: Identification) -> list[str]:
    """What readings at a single pressure leave to the model."""
    loaded = result.data.loaded
    levels = np.unique(result.data.pressures.level[loaded])
    if levels.size > 1:
        return []
    return [
        Sentence(
            "All loaded readings are at one pressure, ",
            Quantity(float(np.median(result.data.pressure[loaded])), "pressure"),
            ": they do not tell the deadband from the diameter and the angle, and forces at other "
            "pressures are the model's alone. Measure at two pressures or more.",
        )
    ]


_CHECKS = {
    "rest_length": "the rest length (taken from the longest reading, which a fit follows)",
    "nominal_diameter": "the bore (so that a wrong unit of force or pressure may pass for another size)",
    "wall_thickness": "the wall (to which the coefficients, not the force, are inverse)",
    "bladder_diameter": "where the braid runs (taken to be inside the wall)",
}
"""What an assumed value of the specimen leaves open, the gravest first."""


def unchecked(result: Identification) -> str:
    """What the description of the specimen leaves open."""
    left = [check for name, check in _CHECKS.items() if name in result.data.assumed]
    if not left:
        return ""
    listed = ", ".join(left[:-1]) + " and " * (len(left) > 1) + left[-1]
    return f"Not checked, as it is not said of the specimen: {listed}."


def _judge_outliers(kept: np.ndarray, rmse: float, grave: list[str], doubts: list[str]) -> None:
    """What Huber's objective has made of outliers, and the error [N] of the others."""
    count = int((~kept).sum())
    sentence = Sentence(
        f"{count} of {kept.size} readings lie so far off that Huber's objective counts them for "
        "less than a quarter; the RMSE of the others is ",
        Quantity(rmse, "force", 3),
        ".",
    )
    (doubts if count <= _MOST_OUTLIERS * kept.size else grave).append(sentence)


def _of_left_out(left_out: Mapping[str, LeftOut], max_force: float) -> list[str]:
    """Pressures, or lengths between the shortest and the longest, that the others predict badly."""
    found = []
    for kind, one in left_out.items():
        inner = one.group_rmse[1:-1] if kind == "length" else one.group_rmse
        if not inner.size or inner.max() <= _LEFT_OUT * max_force:
            continue
        worst = int(inner.argmax()) + (kind == "length")
        found.append(
            Sentence(
                f"The {kind} ",
                Quantity(float(one.values[worst]), kind),
                " is missed by ",
                Quantity(float(inner.max()), "force", 3),
                f" ({100 * inner.max() / max_force:.2g} % of the largest force) where it is left out: the "
                f"{kind}s do not agree with one another, or are too few for the model.",
            )
        )
    return found


def _stopped(estimate: Estimate) -> bool:
    """Whether a parameter is at a bound where no rigid rig, cylinder or vanishing coefficient lies."""
    if not estimate.at_bound:
        return False
    low = estimate.value - estimate.min < estimate.max - estimate.value
    plain = _PLAIN_AT.get(estimate.name, "low" if estimate.kind == "stress" else "")
    return plain != ("low" if low else "high")


def of_bounds(result: Identification) -> list[str]:
    """Parameters that are at a bound, and a law that is not stable."""
    found = []
    stopped = [e.name for e in result.estimates if _stopped(e)]
    if stopped:
        found.append(
            f"{', '.join(stopped)} {'is' if len(stopped) == 1 else 'are'} at a bound: the data alone "
            "would go further."
        )
    margin = result.certificate.stability_margin
    if not margin >= -1e-9 * float(np.abs(result.coefficients).max()):
        found.append(
            "The law is not Drucker-stable on the actuation path: do not extrapolate with it."
        )
    return found


def _of_residuals(result: Identification, misfit: float) -> list[str]:
    """Residuals that are no noise, where they are not small, either."""
    found = []
    std = result.data.force_std
    if std is not None:
        scatter = float(np.sqrt(np.mean((result.residuals / std[result.data.loaded]) ** 2)))
        if scatter > _NOISE and misfit > _TOLD:
            found.append(
                f"The misfit is {scatter:.3g} times the standard deviation of the readings: the "
                "model is wrong by more than their noise."
            )
    data = result.data
    level, pressure = data.lengths.level[data.loaded], data.pressure[data.loaded]
    deviation = runs_deviation(result.residuals[np.lexsort((pressure, level))])
    if deviation < _RUNS and misfit > _TOLD:
        found.append(
            "The residuals keep their sign from reading to reading (a runs test finds "
            f"{-deviation:.2g} standard deviations fewer changes than chance): the model, or a "
            "length, is off by more than the noise."
        )
    return found


def of_ridges(result: Identification) -> list[str]:
    """Parameters of the geometry of which only a combination is known."""
    condition = result.certificate.condition
    if not condition <= CONDITION_LIMIT:
        return [
            "The parameters cannot be told apart by these data: fix one of them, or add lengths and "
            "pressures."
        ]
    problem = result.problem
    places = [k for k, name in enumerate(problem.names) if name.partition("[")[0] in _GEOMETRY]
    covariance = result.covariance[np.ix_(places, places)]
    std = np.sqrt(np.diag(covariance))
    wide = std > _KNOWN * (problem.high - problem.low)[places]
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.abs(np.triu(covariance / np.outer(std, std), 1))
    ridges = np.where(np.logical_or.outer(wide, wide), np.nan_to_num(correlation), 0.0)
    if not (ridges > _RIDGE).any():
        return []
    i, j = np.unravel_index(int(np.argmax(ridges)), ridges.shape)
    first, second = (problem.names[places[int(k)]] for k in (i, j))
    return [
        f"{first} and {second} are known only together (correlation {ridges[i, j]:.4f}), and each "
        "alone badly."
    ]

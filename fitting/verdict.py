"""The verdict on a fit, or on a series: identified, identified with doubts, or not identified."""

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from jaxtyping import Float

from famjax.boundary.units import Quantity, Sentence

from .faults import Suspicion
from .result import Identification, Remark, of_parameters, remarks
from .validation import LeftOut


def runs_deviation(residuals: Float[np.ndarray, " n"]) -> float:
    """By how many standard deviations there are more runs of one sign than chance gives.

    With n1 positive and n2 negative residuals in random order the number of runs has the mean
    1 + 2 n1 n2 / n and the variance (mean - 1)(mean - 2)/(n - 1).

    Args:
        residuals: in the order in which neighbours would be alike, shape (n,); zeros are left out.

    Returns:
        Below zero where there are fewer; 0 with fewer than 10 residuals. All of one sign have a
        single run, and their deviation is -inf.

    References:
        Wald & Wolfowitz 1940.

    >>> print(f"{runs_deviation(np.array([1.0, -1.0] * 8)):.2f}")
    3.62
    >>> print(f"{runs_deviation(np.array([1.0] * 8 + [-1.0] * 8)):.2f}")
    -3.62
    """
    signs = np.sign(residuals[residuals != 0])
    if signs.size < 10:
        return 0.0
    n, positive = signs.size, int((signs > 0).sum())
    mean = 1 + 2 * positive * (n - positive) / n
    variance = (mean - 1) * (mean - 2) / (n - 1)
    runs = 1 + int((np.diff(signs) != 0).sum())
    return float((runs - mean) / np.sqrt(variance)) if variance > 0 else -np.inf


Level = Literal["identified", "identified with doubts", "not identified"]
LEVELS: tuple[Level, ...] = ("identified", "identified with doubts", "not identified")
"""By the gravest finding."""

_MISFIT = 5.0  # % of the largest force: no muscle of rubber and threads is missed by so much
POOR = 2.0
"""Misfit [%], likewise: a muscle may be, but a good fit is four times better."""
_NOISE = 3.0  # standard deviations of the readings
_RUNS = -3.0  # standard deviations below what chance gives
_TOLD = 1.0  # %: below, a model that is wrong by more than the noise is still a good one
_LEFT_OUT = 0.05  # RMSE of what is left out, of the largest force


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Verdict on whether a fit can be trusted.

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


def _judgement(
    said: Sequence[Remark],
    results: Sequence[Identification],
    suspicions: Sequence[Suspicion] = (),
) -> Judgement:
    """The verdict that follows from remarks."""
    reasons = [one for one in sorted(said, key=lambda one: -one.level) if one.level]
    worst = max((one.level for one in reasons), default=0)
    unsure = any("rest_length" in one.data.assumed for one in results)
    level = LEVELS[max(worst, int(unsure))]
    sentences = tuple(one.sentence for one in reasons)
    return Judgement(level, sentences, tuple(suspicions), _unchecked(results[0]))


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
    largest = result.errors.max_force
    misfit = 100 * result.counted_rmse / largest
    found = [Remark(1 + one.grave, one.sentence) for one in suspicions]
    if not misfit <= POOR:
        sentence = f"The model misses the readings by {misfit:.3g} % of the largest force"
        grave = not misfit <= _MISFIT
        more = (
            f"; no muscle of rubber and threads is missed by more than {_MISFIT:g} %. Check units, signs "
            "and columns, and the specimen's rest length, bore and wall."
        )
        found.append(Remark(1 + grave, sentence + (more if grave else ".")))
    found += remarks(result)
    found += [
        Remark(1, sentence)
        for sentence in (
            *_of_one_pressure(result),
            *_of_residuals(result, misfit),
            *_of_left_out(left_out or {}, largest),
            *filter(None, [open_question]),
        )
    ]
    return _judgement(found, [result], suspicions)


def _of_one_pressure(result: Identification) -> list[str]:
    """What readings at a single pressure cannot determine."""
    data, loaded = result.data, result.data.loaded
    if np.unique(data.pressures.level[loaded]).size > 1:
        return []
    return [
        Sentence(
            "All loaded readings are at one pressure, ",
            Quantity(float(np.median(data.pressure[loaded])), "pressure"),
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


def _unchecked(result: Identification) -> str:
    """What is missing in the description of the specimen."""
    left = [check for name, check in _CHECKS.items() if name in result.data.assumed]
    if not left:
        return ""
    listed = ", ".join(left[:-1]) + " and " * (len(left) > 1) + left[-1]
    return f"Not checked, as it is not said of the specimen: {listed}."


def _of_left_out(left_out: Mapping[str, LeftOut], max_force: float) -> list[str]:
    """Pressures or interior lengths that are predicted badly from the others."""
    found = []
    for kind, one in left_out.items():
        errors = one.group_rmse
        if kind == "length":
            errors[[0, -1]] = 0.0
        worst = int(errors.argmax())
        missed = float(errors[worst])
        if missed > _LEFT_OUT * max_force:
            found.append(
                Sentence(
                    *(f"The {kind} ", Quantity(float(one.values[worst]), kind)),
                    *(" is missed by ", Quantity(missed, "force", 3)),
                    f" ({100 * missed / max_force:.2g} % of the largest force) where it is left out: the "
                    f"{kind}s do not agree with one another, or are too few for the model.",
                )
            )
    return found


def _of_residuals(result: Identification, misfit: float) -> list[str]:
    """Residuals that are not noise and not small."""
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


_FOREIGN = 15.0  # % of its largest force: specimens of one series do not differ by so much


def judge_series(specimens: Sequence[Identification], left_out: LeftOut) -> Judgement:
    """The verdict on one model of several muscles that differ in length.

    Specimens of one make differ by more than a muscle is missed by alone, so that a series is held to
    less than one muscle is, see `judge`; by how much they differ is said, and is in the bands.

    Args:
        specimens: the identification of each, with shared parameters.
        left_out: errors on each specimen while it was left out.
    """
    first = specimens[0]
    missed = [one.errors.rmse_percent for one in specimens]
    names = [one.data.specimen.name for one in specimens]
    worst = max(range(len(specimens)), key=missed.__getitem__)
    said = f"misses {names[worst]} by {missed[worst]:.3g} % of its largest force"
    found = [] if first.converged else [one for one in remarks(first) if one.level == 2]
    if not missed[worst] <= _FOREIGN:
        sentence = (
            f"The model of all {said}; specimens of one series differ by less than {_FOREIGN:g} %. Its "
            "map is of another make of muscle, or wrong: see what famjax fit says of it alone, and "
            "leave it out."
        )
        found.append(Remark(2, sentence))
    elif missed[worst] > POOR:
        most = int(left_out.group_rmse.argmax())
        sentence = Sentence(
            f"The specimens differ: the model of all {said}; predicted from the others, "
            f"{names[most]} is missed by ",
            Quantity(float(left_out.group_rmse[most]), "force", 3),
            ". A muscle never measured differs as much; the band of its prediction says so.",
        )
        found.append(Remark(1, sentence))
    return _judgement([*found, *of_parameters(first)], specimens)

"""Judge a fit or a series: identified, identified with doubts, or not identified."""

import dataclasses
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.units import Quantity, Sentence

from .faults import Suspicion
from .result import Identification, Remark, of_parameters, remarks
from .validation import LeftOut


def runs_deviation(residuals: Float[np.ndarray, " n"]) -> float:
    """Return the number of runs of one sign minus its expected value, in standard deviations.

    For n1 positive and n2 negative residuals in random order, the number of runs has the mean
    1 + 2 n1 n2 / n and the variance (mean - 1)(mean - 2)/(n - 1).

    Args:
        residuals: residuals, sorted so that neighbours would be correlated, shape (n,); zeros are ignored.

    Returns:
        Negative if there are too few runs; 0 for fewer than 10 residuals; -inf if all have one sign.

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


LEVELS = ("identified", "identified with doubts", "not identified")
"""Verdict levels; the most serious finding decides."""

POOR = 2.0
"""Misfit [% of the largest force] above which a fit is doubtful; good fits are four times better."""
_GOOD = 1.0  # misfit [%] of a good model, even if its error exceeds the noise


@dataclasses.dataclass(frozen=True)
class Judgement:
    """Verdict on whether a fit can be trusted, with reasons.

    Attributes:
        level: the verdict.
        reasons: sentences, most serious first; empty for "identified".
        suspicions: faults in the data that would explain a misfit.
        unchecked: a sentence about what could not be checked for lack of specimen data, or "". A fit with
            an unknown rest length is at best "identified with doubts".
    """

    level: str
    reasons: tuple[str, ...]
    suspicions: tuple[Suspicion, ...] = ()
    unchecked: str = ""

    @property
    def passed(self) -> bool:
        """True unless the level is `not identified`."""
        return self.level != "not identified"


def _judgement(
    said: Sequence[Remark], results: Sequence[Identification], suspicions: Sequence[Suspicion] = ()
) -> Judgement:
    """Combine remarks into a verdict."""
    reasons = [one for one in sorted(said, key=lambda one: -one.level) if one.level]
    worst = max((one.level for one in reasons), default=0)
    unsure = any("rest_length" in one.data.assumed for one in results)
    level = LEVELS[max(worst, int(unsure))]
    left = [check for name, check in _CHECKS.items() if name in results[0].data.assumed]
    unchecked = "Not checked for lack of specimen data: "
    unchecked = f"{unchecked}{'; '.join(left)}." if left else ""
    return Judgement(level, tuple(r.sentence for r in reasons), tuple(suspicions), unchecked)


def judge(
    result: Identification,
    suspicions: Sequence[Suspicion] = (),
    left_out: Mapping[str, LeftOut] | None = None,
    open_question: str = "",
) -> Judgement:
    """Judge a fit.

    Args:
        result: the fit.
        suspicions: result of `suspect`.
        left_out: held-out errors by "pressure" and "length", if known.
        open_question: a sentence about models that fit equally well but disagree, or "".
    """
    largest = result.errors.max_force
    misfit = 100 * result.counted_rmse / largest
    found = [Remark(1 + one.grave, one.sentence) for one in suspicions]
    if not misfit <= POOR:
        grave = not misfit <= 5.0
        remedy = "; check units, signs and columns, and the rest length, bore and wall" * grave
        sentence = (
            f"The RMS deviation of the model from the readings is {misfit:.3g} % of the largest "
            f"force{remedy}."
        )
        found.append(Remark(1 + grave, sentence))
    found += remarks(result)
    data, doubts = result.data, list[str]()
    if np.unique(data.pressures.level[data.loaded]).size == 1:
        doubts.append(
            "All loaded readings are at one pressure, so they cannot separate the deadband from diameter "
            "and angle, and forces at other pressures rely on the model alone. Measure at two or more "
            "pressures."
        )
    doubts += _of_residuals(result, misfit) + _of_left_out(left_out or {}, largest)
    doubts += [open_question] if open_question else []
    found += [Remark(1, sentence) for sentence in doubts]
    return _judgement(found, [result], suspicions)


_CHECKS = {
    "rest_length": "the rest length (taken from the longest reading)",
    "nominal_diameter": "the bore (a wrong unit of force or pressure may look like a different bore)",
    "wall_thickness": "the wall thickness (it changes the coefficients and the volume, but not the force)",
    "bladder_diameter": "the position of the braid (assumed inside the wall)",
}
"""Consequences of assumed specimen data, most serious first."""


def _of_left_out(left_out: Mapping[str, LeftOut], max_force: float) -> list[str]:
    """Return doubts about pressures or interior lengths that are predicted poorly from the others."""
    found = []
    for kind, one in left_out.items():
        errors = one.group_rmse
        if kind == "length":
            errors[[0, -1]] = 0.0
        worst = int(errors.argmax())
        missed = float(errors[worst])
        if missed > 0.05 * max_force:
            found.append(
                Sentence(
                    *(f"When the {kind} of ", Quantity(float(one.values[worst]), kind)),
                    " is left out, its readings are predicted with an error of ",
                    Quantity(missed, "force", 3),
                    f" ({100 * missed / max_force:.2g} % of the largest force): the {kind}s are "
                    "inconsistent, or too few for the model.",
                )
            )
    return found


def _of_residuals(result: Identification, misfit: float) -> list[str]:
    """Return doubts about residuals that are neither noise nor small."""
    if not misfit > _GOOD:
        return []
    data, found = result.data, []
    if data.force_std is not None:
        scatter = float(np.sqrt(np.mean((result.residuals / data.force_std[data.loaded]) ** 2)))
        if scatter > 3.0:
            found.append(
                f"The misfit is {scatter:.3g} times the standard deviation of the readings: the model "
                "error exceeds the noise."
            )
    level, pressure = data.lengths.level[data.loaded], data.pressure[data.loaded]
    deviation = runs_deviation(result.residuals[np.lexsort((pressure, level))])
    if deviation < -3.0:
        found.append(
            "The residuals keep their sign from reading to reading (the number of sign changes is "
            f"{-deviation:.2g} standard deviations below its expected value): the model, or a length, is "
            "wrong by more than the noise."
        )
    return found


def judge_series(specimens: Sequence[Identification], left_out: LeftOut) -> Judgement:
    """Judge one model of several muscles that differ in length.

    Specimens of one make differ by more than the misfit of a single muscle, so the limits are wider than in
    `judge`. The verdict states how much the specimens differ, and the bands include the difference.

    Args:
        specimens: identification of each specimen, with shared parameters.
        left_out: held-out errors of each specimen.
    """
    first = specimens[0]
    missed = {one.data.specimen.name: one.errors.rmse_percent for one in specimens}
    worst = max(missed, key=missed.__getitem__)
    said = (
        f"the RMSE of their common model is {missed[worst]:.3g} % of the largest force for {worst}"
    )
    found = [] if first.converged else [one for one in remarks(first) if one.level == 2]
    if not missed[worst] <= 15.0:
        remedy = "that map is wrong, or its muscle is of another make: check it with famjax fit"
        found.append(Remark(2, f"The specimens are not a series: {said}; {remedy}."))
    elif missed[worst] > POOR:
        most = int(left_out.group_rmse.argmax())
        other = (
            f"; the prediction of {specimens[most].data.specimen.name} from the others is off by "
        )
        error = Quantity(float(left_out.group_rmse[most]), "force", 3)
        included = ". A new muscle may differ by as much; its prediction band allows for this."
        found.append(Remark(1, Sentence(f"The specimens differ: {said}{other}", error, included)))
    return _judgement([*found, *of_parameters(first)], specimens)

"""What a verdict says of fits whose faults are known."""

import dataclasses
import itertools
import math

import numpy as np
import pytest

from fitting import Identification
from fitting.faults import Suspicion
from fitting.validation import LeftOut
from fitting.verdict import judge, runs_deviation

SUSPICION = Suspicion("a cause", "The data look wrong.", 0.01)


def with_misfit(result: Identification, percent: float) -> Identification:
    """The fit with residuals of alternating sign and this size."""
    size = percent / 100 * result.errors.max_force
    residuals = size * np.where(np.arange(result.residuals.size) % 2, 1.0, -1.0)
    return dataclasses.replace(
        result, residuals=residuals, errors=dataclasses.replace(result.errors, rmse=size)
    )


def test_a_sound_map_passes(fitted20: Identification) -> None:
    verdict = judge(fitted20)
    assert verdict.passed
    assert "identified" in verdict.level


@pytest.mark.parametrize(
    ("percent", "level"), [(3.0, "identified with doubts"), (6.0, "not identified")]
)
def test_misfit_against_the_largest_force(
    fitted20: Identification, percent: float, level: str
) -> None:
    verdict = judge(with_misfit(fitted20, percent))
    assert verdict.level == level
    assert any(f"misses the readings by {percent:.3g} %" in one for one in verdict.reasons)


def test_no_optimum_is_no_identification(fitted20: Identification) -> None:
    verdict = judge(dataclasses.replace(fitted20, converged=False))
    assert not verdict.passed
    assert "did NOT converge" in verdict.reasons[0]


def test_a_grave_suspicion_is_the_first_reason_and_another_is_a_doubt(
    fitted20: Identification,
) -> None:
    grave = judge(with_misfit(fitted20, 6.0), [SUSPICION])
    assert not grave.passed
    assert grave.reasons[0] == SUSPICION.sentence
    mild = judge(fitted20, [dataclasses.replace(SUSPICION, grave=False)])
    assert mild.level == "identified with doubts"
    assert mild.reasons[0] == SUSPICION.sentence


def test_residuals_that_keep_their_sign_are_a_doubt(fitted20: Identification) -> None:
    poor = with_misfit(fitted20, 1.5)
    told = "keep their sign from reading to reading"
    assert not any(told in one for one in judge(poor).reasons)
    level = poor.data.lengths.level[poor.data.loaded]
    by_length = np.where(level > np.median(level), 1.0, -1.0) * np.abs(poor.residuals)
    verdict = judge(dataclasses.replace(poor, residuals=by_length))
    assert verdict.level == "identified with doubts"
    assert any(told in one for one in verdict.reasons)


def test_parameters_that_cannot_be_told_apart_are_a_doubt(fitted20: Identification) -> None:
    ill = dataclasses.replace(fitted20.certificate, condition=math.inf)
    verdict = judge(dataclasses.replace(fitted20, certificate=ill))
    assert verdict.level == "identified with doubts"
    assert any("do not determine every parameter" in one for one in verdict.reasons)


def test_a_ridge_is_named_with_its_correlation(fitted20: Identification) -> None:
    covariance = np.array(fitted20.covariance)
    i, j = (fitted20.problem.names.index(name) for name in ("braid_angle", "deadband_pressure"))
    covariance[i, i], covariance[j, j] = 1e-3, 1e9  # 1.8 deg of 10, 32 kPa of 100
    covariance[i, j] = covariance[j, i] = -0.999e3
    verdict = judge(dataclasses.replace(fitted20, covariance=covariance))
    assert verdict.level == "identified with doubts"
    assert any(
        "braid_angle and deadband_pressure have a correlation of -0.9990" in one
        for one in verdict.reasons
    )
    known = dataclasses.replace(fitted20, covariance=1e-4 * covariance)
    assert not any("Ridge" in one for one in judge(known).reasons)


def test_lengths_that_disagree_are_a_doubt(fitted20: Identification) -> None:
    error = np.full(fitted20.residuals.size, 0.1 * fitted20.errors.max_force)
    level = fitted20.data.lengths.level[fitted20.data.loaded]
    group = np.unique(level, return_inverse=True)[1]
    left_out = {"length": LeftOut("length", level, group, error)}
    verdict = judge(fitted20, left_out=left_out)
    assert verdict.level == "identified with doubts"
    assert any("missed by" in one and "left out" in one for one in verdict.reasons)


def test_runs_have_the_mean_and_the_variance_of_all_orders() -> None:
    """By counting the runs of every order of 6 positive and 5 negative residuals."""
    counts = []
    for places in itertools.combinations(range(11), 6):
        signs = np.isin(np.arange(11), places)
        counts.append(1 + int((signs[1:] != signs[:-1]).sum()))
    residuals = np.array([1.0] * 6 + [-1.0] * 5)
    expected = (2 - np.mean(counts)) / np.std(counts)
    assert runs_deviation(residuals) == pytest.approx(expected, rel=1e-12)

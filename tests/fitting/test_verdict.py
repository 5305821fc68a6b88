"""What a verdict says of fits whose faults are known, and the faults that it names."""

import dataclasses
import itertools
import math
from collections.abc import Callable

import numpy as np
import pytest
from maps import cylinder
from slow_cases import slow_after

import famjax
from fitting import ForceData, Identification, Parameter, Specimen, identify
from fitting.faults import Suspicion, doubtful, suspect
from fitting.validation import LeftOut
from fitting.verdict import judge, runs_deviation

SUSPICION = Suspicion("a cause", "The data look wrong.", 0.01)


def with_misfit(result: Identification, percent: float) -> Identification:
    size = percent / 100 * result.errors.max_force
    residuals = size * np.where(np.arange(result.residuals.size) % 2, 1.0, -1.0)
    errors = dataclasses.replace(result.errors, rmse=size)
    return dataclasses.replace(result, residuals=residuals, errors=errors)


DOUBTS = {
    "misses the readings by 3 %": (lambda fit: with_misfit(fit, 3.0), True),
    "misses the readings by 6 %": (lambda fit: with_misfit(fit, 6.0), False),
    "did NOT converge": (lambda fit: dataclasses.replace(fit, converged=False), False),
    "do not determine every parameter": (
        lambda fit: dataclasses.replace(
            fit, certificate=dataclasses.replace(fit.certificate, condition=math.inf)), True),
}  # fmt: skip
"""What a verdict says of a fit made worse, and whether it is still an identification."""


@pytest.mark.parametrize("told", DOUBTS)
def test_a_doubt_or_a_failure_is_named(fitted20, told):
    worse, passed = DOUBTS[told]
    verdict = judge(worse(fitted20))
    assert verdict.passed == passed
    assert verdict.level == ("identified with doubts" if passed else "not identified")
    assert any(told in one for one in verdict.reasons)


def test_a_sound_map_passes_and_a_grave_suspicion_is_the_first_reason_another_a_doubt(fitted20):
    sound = judge(fitted20)
    assert sound.passed
    assert "identified" in sound.level
    grave = judge(with_misfit(fitted20, 6.0), [SUSPICION])
    assert not grave.passed
    assert grave.reasons[0] == SUSPICION.sentence
    mild = judge(fitted20, [dataclasses.replace(SUSPICION, grave=False)])
    assert (mild.level, mild.reasons[0]) == ("identified with doubts", SUSPICION.sentence)


def test_residuals_that_keep_their_sign_are_a_doubt(fitted20):
    poor = with_misfit(fitted20, 1.5)
    told = "keep their sign from reading to reading"
    assert not any(told in one for one in judge(poor).reasons)
    level = poor.data.lengths.level[poor.data.loaded]
    by_length = np.where(level > np.median(level), 1.0, -1.0) * np.abs(poor.residuals)
    verdict = judge(dataclasses.replace(poor, residuals=by_length))
    assert verdict.level == "identified with doubts"
    assert any(told in one for one in verdict.reasons)


def test_a_ridge_is_named_with_its_correlation(fitted20):
    covariance = np.array(fitted20.covariance)
    i, j = (fitted20.problem.names.index(name) for name in ("braid_angle", "deadband_pressure"))
    covariance[i, i], covariance[j, j] = 1e-3, 1e9  # 1.8 deg of 10, 32 kPa of 100
    covariance[i, j] = covariance[j, i] = -0.999e3
    verdict = judge(dataclasses.replace(fitted20, covariance=covariance))
    assert verdict.level == "identified with doubts"
    told = "braid_angle and deadband_pressure have a correlation of -0.9990"
    assert any(told in one for one in verdict.reasons)
    known = dataclasses.replace(fitted20, covariance=1e-4 * covariance)
    assert not any("Ridge" in one for one in judge(known).reasons)


def test_lengths_that_disagree_are_a_doubt(fitted20):
    error = np.full(fitted20.residuals.size, 0.1 * fitted20.errors.max_force)
    level = fitted20.data.lengths.level[fitted20.data.loaded]
    group = np.unique(level, return_inverse=True)[1]
    verdict = judge(fitted20, left_out={"length": LeftOut("length", level, group, error)})
    assert verdict.level == "identified with doubts"
    assert any("its readings are predicted with an error" in one for one in verdict.reasons)


def test_runs_have_the_mean_and_the_variance_of_all_orders():
    """By counting the runs of every order of 6 positive and 5 negative residuals."""
    counts = []
    for places in itertools.combinations(range(11), 6):
        signs = np.isin(np.arange(11), places)
        counts.append(1 + int((signs[1:] != signs[:-1]).sum()))
    residuals = np.array([1.0] * 6 + [-1.0] * 5)
    expected = (2 - np.mean(counts)) / np.std(counts)
    assert runs_deviation(residuals) == pytest.approx(expected, rel=1e-12)


def fit(data: ForceData) -> Identification:
    return identify(data, law="ogden", parameters={"end_factor": Parameter()}, starts=4)


def known_muscle(bore: float, rest: float, angle_deg: float) -> ForceData:
    law = famjax.materials.MooneyRivlinMaterial(0.2e6, 0.05e6)
    muscle = famjax.Muscle(cylinder(bore + 2e-3, angle_deg, rest, 1.5e-3), law, 25e3)
    grid = np.meshgrid(rest * np.linspace(1, 0.84, 8), np.linspace(1.2e5, 6e5, 6))
    L, P = (one.ravel() for one in grid)
    force = np.asarray(muscle.force(L, P))
    noise = 3e-3 * force.max() * np.random.default_rng(1).normal(size=force.size)
    specimen = Specimen("known", rest, 1.5e-3, nominal_diameter=bore, embedded=True)
    return ForceData(np.where(force > 0, force + noise, 0.0), P, L, specimen)


def changed(data: ForceData, **sizes: float) -> ForceData:
    return dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, **sizes))


def causes(data: ForceData) -> str:
    """What is suspected of a map in which nothing is to be identified."""
    result = fit(data)
    assert doubtful(result)
    found = suspect(result)
    assert not judge(result, found).passed
    assert len(found) <= 3
    return "; ".join(one.cause for one in found)


@pytest.mark.slow
def test_nothing_is_suspected_of_sound_maps(dmsp20, dmsp10):
    for data in (dmsp20, dmsp10, known_muscle(0.03, 0.35, 65.0)):
        result = fit(data)
        assert suspect(result) == ()
        assert judge(result).passed


def column(name: str, said: str, factor: float) -> Callable[[ForceData], ForceData]:
    """A column in another unit than its header says."""
    units = {"force": "N", "pressure": "kPa", "length": "mm"} | {name: said}
    return lambda data: dataclasses.replace(
        data, units=units, **{name: getattr(data, name) * factor}
    )


def one_length_negative(data: ForceData) -> ForceData:
    at = data.length == np.unique(data.length)[-2]
    return dataclasses.replace(data, force=np.where(at, -data.force, data.force))


FAULTS = {
    "the pressures are in psi, not kPa": (column("pressure", "kPa", 1 / 6.894757), 10),
    "the forces are in lbf, not N": (column("force", "N", 1 / 4.44822), 10),
    "the forces are in kN, not N": (column("force", "N", 1e-3), 10),
    "the forces are in N, not kgf": (column("force", "kgf", 9.80665), 10),
    "the pressures are in bar, not MPa": (column("pressure", "MPa", 10.0), 10),
    "the pressures are absolute, not gauge": (
        lambda data: dataclasses.replace(data, pressure=data.pressure + 101.3e3), 10),
    "forces have the wrong sign": (one_length_negative, 20),
    # The force hardly depends on the wall: no misfit shows one of 18 mm in a bore of 20 mm.
    "the wall is too thick, or the diameter too small": (
        lambda data: changed(data, wall_thickness=18e-3), 20),
    "the nominal diameter is a radius, or that of a smaller muscle": (
        lambda data: changed(data, nominal_diameter=10e-3), 20),
    "the nominal diameter is that of a larger muscle": (
        lambda data: changed(data, nominal_diameter=40e-3), 20),
}  # fmt: skip
"""A fault, and the bundled map in which it is made, by its bore in mm."""


@pytest.mark.parametrize("cause", slow_after(0, list(FAULTS)))
def test_a_fault_is_named(dmsp10, dmsp20, cause):
    fault, bore = FAULTS[cause]
    assert cause.strip() in causes(fault(dmsp10 if bore == 10 else dmsp20))


@pytest.mark.slow
def test_outliers_and_one_giant(dmsp20):
    rows = np.random.default_rng(3).choice(np.flatnonzero(dmsp20.loaded), 5, replace=False)
    force = dmsp20.force.copy()
    force[rows] += 0.35 * dmsp20.max_force
    (found,) = suspect(fit(dataclasses.replace(dmsp20, force=force)))
    assert found.cause.startswith("5 readings are outliers")
    assert "--objective huber" in found.sentence
    for row in rows:
        assert str(row + 1) in found.cause
    force = dmsp20.force.copy()
    force[rows[0]] = 99999.0
    assert causes(dataclasses.replace(dmsp20, force=force)).startswith(
        f"1 reading is an outlier (number {rows[0] + 1}"
    )


@pytest.mark.slow
def test_two_muscles_in_one_file():
    one, other = known_muscle(0.02, 0.3, 66.0), known_muscle(0.034, 0.3, 64.0)
    names = "force", "pressure", "length"
    columns = {name: np.append(getattr(one, name), getattr(other, name)) for name in names}
    found = causes(dataclasses.replace(one, **columns))
    assert "the file contains two muscles, one of them" in found
    assert f"reading {one.force.size}" in found or f"reading {one.force.size + 1}" in found

"""Other laws, other parameters, several muscles: truth recovered, bad tables refused."""

import dataclasses
import math

import numpy as np
import pytest

import famjax
from fitting import (
    ForceData,
    Identification,
    InputError,
    Parameter,
    Specimen,
    bootstrap,
    identify,
    identify_together,
    profile,
)

pytestmark = pytest.mark.slow

RECOVERED = 1e-6  # relative: noise-free readings, as the project promises
SPECIMEN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)
OGDEN = famjax.materials.OgdenMaterial([2 * 1.2e6 / -6.0], [-6.0])
COMPLIANCE, END_FACTOR = 2e-6, 1.1

L, P = (g.ravel() for g in np.meshgrid(np.linspace(0.3, 0.25, 6), np.linspace(2.5e5, 7e5, 6)))


def known_muscle(diameter: float = 0.022, deadband: float = 30e3) -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=diameter, braid_angle=math.radians(65), length=0.3)
    cylinder = famjax.EstimatedGeometry(braid, famjax.Bladder(0.3, diameter, 0.002, embedded=True))
    return famjax.Muscle(famjax.geometries.EndEffectGeometry(cylinder, END_FACTOR), OGDEN, deadband)


def readings(muscle: famjax.Muscle | famjax.MountedMuscle, name: str = "known") -> ForceData:
    force = np.asarray(muscle.force(L, P))
    assert force.min() > 0
    return ForceData(force, P, L, dataclasses.replace(SPECIMEN, name=name))


TABLE = {"end_factor": Parameter(), "series_compliance": Parameter()}


@pytest.fixture(scope="module")
def mounted() -> Identification:
    """Six nonlinear parameters, one of them implicit, of exact readings."""
    data = readings(famjax.MountedMuscle(known_muscle(), COMPLIANCE))
    return identify(data, law="ogden", parameters=TABLE, starts=8)


@pytest.fixture(scope="module")
def noisy(mounted: Identification) -> Identification:
    """The same with noise; nothing new is compiled."""
    noise = np.random.default_rng(5).normal(0, 2.0, L.size)
    data = dataclasses.replace(mounted.data, force=mounted.data.force + noise)
    return identify(data, law=famjax.materials.OgdenMaterial, parameters=TABLE, starts=8)


TRUTH = {
    "braid_diameter": 0.022,
    "braid_angle": math.radians(65),
    "deadband_pressure": 30e3,
    "end_factor": END_FACTOR,
    "series_compliance": COMPLIANCE,
    "ogden_exponent": -6.0,
    "shear_modulus": 1.2e6,
}


def test_compliant_rig_and_end_factor_are_recovered(mounted: Identification) -> None:
    assert mounted.converged
    assert mounted.errors.rmse < 1e-5
    assert mounted.n_parameters == 7
    for name, value in TRUTH.items():
        assert mounted.estimate(name).value == pytest.approx(value, rel=RECOVERED), name
    np.testing.assert_allclose(mounted.predict(L, P), mounted.data.force, atol=1e-5)
    assert mounted.certificate.stability_margin > 0


def test_noisy_estimates_lie_within_three_standard_errors(noisy: Identification) -> None:
    for name, value in TRUTH.items():
        estimate = noisy.estimate(name)
        assert not estimate.at_bound
        assert abs(estimate.value - value) < 3 * estimate.stderr, name
    assert 1.2 < noisy.errors.rmse < 2.8  # 2 N of noise, seven parameters spent


def test_profile_agrees_with_the_standard_error(noisy: Identification) -> None:
    """Near the optimum the problem is quadratic: one standard error is one unit of excess."""
    (one,) = profile(noisy, ["braid_angle"], points=6)
    estimate = noisy.estimate("braid_angle")
    low, high = one.intervals[0.68]
    assert one.verdict == "identified"
    assert one.excess.min() == pytest.approx(0, abs=1e-6)
    assert (high - low) / 2 == pytest.approx(estimate.stderr, rel=0.15)
    (coefficient,) = profile(noisy, ["shear_modulus"], points=6)
    low, high = coefficient.intervals[0.68]
    assert (high - low) / 2 == pytest.approx(noisy.estimate("shear_modulus").stderr, rel=0.15)
    with pytest.raises(InputError, match="no identified parameter 'E_1'"):
        profile(noisy, ["E_1"])


def test_bootstrap_agrees_with_the_standard_errors(noisy: Identification) -> None:
    drawn = bootstrap(noisy, 60, seed=1)
    assert drawn.failed == 0
    for name in ("braid_angle", "shear_modulus", "deadband_pressure"):
        ratio = drawn.stderr[name] / noisy.estimate(name).stderr
        assert 0.6 < ratio < 1.6, name  # 60 replicates know a standard deviation to 10 %
        low, high = drawn.interval(name)
        assert low < noisy.estimate(name).value < high
    band = drawn.band()
    assert band.shape == (2, L.size)
    again = bootstrap(noisy, 60, seed=1)
    np.testing.assert_array_equal(again.samples, drawn.samples)


def test_two_muscles_share_what_they_share() -> None:
    data = [
        readings(known_muscle(0.022, 30e3), "thick"),
        readings(known_muscle(0.0205, 15e3), "thin"),
    ]
    thick, thin = identify_together(
        data,
        own=("braid_diameter", "deadband_pressure"),
        law="ogden",
        parameters={"end_factor": Parameter()},
        starts=4,
    )
    assert thick.converged
    assert thick.estimate("braid_diameter[thick]").value == pytest.approx(0.022, rel=RECOVERED)
    assert thin.estimate("braid_diameter[thin]").value == pytest.approx(0.0205, rel=RECOVERED)
    assert thin.estimate("deadband_pressure[thin]").value == pytest.approx(15e3, rel=RECOVERED)
    for name in ("braid_angle", "end_factor", "ogden_exponent", "shear_modulus"):
        assert thick.estimate(name) == thin.estimate(name)
        assert thin.estimate(name).value == pytest.approx(TRUTH[name], rel=RECOVERED)
    assert thin.errors.n_points == L.size
    with pytest.raises(KeyError):
        thin.estimate("braid_diameter[thick]")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"law": "rubber"}, "the law must be one of polynomial, ogden"),
        ({"law": "ogden", "order": 3}, "only the polynomial law"),
        (
            {"law": "ogden", "dependence": "linear"},
            "only the polynomial law may depend on pressure",
        ),
        ({"law": "ogden", "constraint": "slope"}, "directions do not interact"),
        ({"parameters": {"spam": Parameter()}}, "unknown parameter 'spam'"),
        (
            {"parameters": {"rest_length": Parameter(prior=(300.0, 1.0))}},
            "is a length and needs a unit",
        ),
        (
            {"parameters": {"rest_length": Parameter(prior=(300.0, 0.0), unit="mm")}},
            "a mean and a standard deviation > 0",
        ),
        (
            {"parameters": {"rest_length": Parameter(prior=(300.0, 1.0), unit="mm")}},
            "weighted against the force noise, which is unknown",
        ),
        ({"parameters": {"end_factor": Parameter(min=1.2, max=1.1)}}, "must not exceed the upper"),
        ({"parameters": {"end_factor": Parameter(vary=False)}}, "vary=False goes with the value"),
        ({"parameters": {"end_factor": Parameter(value=1.1)}}, "vary=False goes with the value"),
        ({"parameters": {"series_compliance": Parameter(min=-1.0, unit="mm/N")}}, "must be >= 0"),
        (
            {
                "parameters": {"end_factor": Parameter(max=1.3)},
                "bounds": {"end_factor": (1.0, 1.2)},
            },
            "give its bounds once",
        ),
        ({"noise": -1.0}, "noise of a reading must be a force > 0 in N"),
        (
            {"geometry": known_muscle().geometry, "parameters": {"end_length": Parameter()}},
            "a known geometry has no such parameter",
        ),
    ],
)
def test_tables_that_contradict_themselves_are_refused(options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        identify(readings(known_muscle()), **options)

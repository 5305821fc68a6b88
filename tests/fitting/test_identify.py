"""Identification: the figures it must reach, its certificate, and truth recovered."""

import dataclasses
import math
from collections.abc import Callable

import jax.numpy as jnp
import numpy as np
import pytest

import famjax
from fitting import ForceData, Identification, InputError, Specimen, identify
from fitting.engine import solve
from fitting.families import EstimatedSource
from fitting.posing import pose
from fitting.response import CONSTRAINTS

OBJECTIVE = 1e-6  # relative agreement with an independent convex solver that the project promises
ROUNDING = 1e-9  # certificates in float64

SPECIMEN = Specimen("known", 0.3, 0.002, nominal_diameter=0.02, embedded=True)


def known_muscle(law: famjax.materials.AbstractMaterial) -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=0.022, braid_angle=math.radians(65), length=0.3)
    bladder = famjax.Bladder(0.3, 0.022, 0.002, embedded=True)
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, 30e3)


def readings(muscle: famjax.Muscle, noise: float = 0.0, seed: int = 0) -> ForceData:
    lengths, pressures = np.linspace(0.3, 0.25, 8), np.linspace(3e5, 7e5, 5)
    L, P = (grid.ravel() for grid in np.meshgrid(lengths, pressures))
    force = np.asarray(muscle.force(L, P)) + noise * np.random.default_rng(seed).normal(size=L.size)
    assert force.min() > 0  # none slack: all tests share one shape, and with it one compilation
    return ForceData(force, P, L, SPECIMEN)


SOFTENING = famjax.PolynomialMaterial([4e6, -6e6, 6e6])


def test_dmsp20_in_bounds_of_a_muscle_that_can_be_built(fitted20: Identification) -> None:
    assert fitted20.converged
    assert fitted20.errors.rmse <= 7.6  # N: the target of the project on table A1
    assert fitted20.certificate.kkt_residual < ROUNDING
    assert fitted20.certificate.duality_gap < ROUNDING
    assert fitted20.certificate.gradient_residual < 1e-6
    assert fitted20.certificate.stability_margin > 0
    assert fitted20.certificate.n_agreeing >= 8
    assert fitted20.errors.n_points == 60


def test_dmsp10_in_bounds_of_a_muscle_that_can_be_built(dmsp10: ForceData) -> None:
    result = identify(dmsp10)
    assert result.converged
    assert result.errors.rmse <= 1.9  # N: the target of the project on table A2
    assert result.certificate.stability_margin > 0


WIDE = {
    "braid_diameter": (5e-3, 40e-3),
    "braid_angle": (0.785, 1.396),
    "deadband_pressure": (0.0, 2e5),
}


@pytest.mark.parametrize(("name", "target"), [("dmsp20", 4.6), ("dmsp10", 1.8)])
def test_wide_bounds_fit_better_and_leave_a_ridge(
    name: str, target: float, request: pytest.FixtureRequest
) -> None:
    result = identify(request.getfixturevalue(name), bounds=WIDE, starts=8)
    assert result.converged
    assert result.errors.rmse <= target
    assert any("Ridge: braid_diameter and braid_angle" in warning for warning in result.warnings)


@pytest.mark.parametrize(
    ("order", "dependence", "constraint"),
    [(order, "fixed", constraint) for order in (1, 2, 3, 4) for constraint in CONSTRAINTS]
    + [(3, "linear", constraint) for constraint in ("none", "drucker")],
)
def test_convex_fit_agrees_with_clarabel(
    order: int, dependence: str, constraint: str, clarabel_objective: Callable[..., float]
) -> None:
    """Every order, constraint and dependence, at one geometry, block by block."""
    data = readings(known_muscle(SOFTENING), noise=8.0)
    problem = pose((data,), order=order, constraint=constraint, dependence=dependence).problem
    geometry = np.array([0.0215, math.radians(64.0), 25e3])  # beside the truth: constraints bite
    point = solve(problem, geometry)
    assert point.cost == pytest.approx(
        clarabel_objective(point.A, point.b, point.G, point.h), rel=OBJECTIVE
    )
    assert point.kkt_residual < ROUNDING


def test_truth_is_recovered_from_exact_readings() -> None:
    truth = known_muscle(SOFTENING)
    result = identify(readings(truth), starts=8)
    assert result.converged
    assert result.errors.rmse < 1e-6
    expected = [0.022, math.radians(65), 30e3, 4e6, -6e6, 6e6]
    np.testing.assert_allclose([e.value for e in result.estimates], expected, rtol=1e-6)


def test_readings_that_repeat_weigh_by_their_number() -> None:
    data = readings(known_muscle(SOFTENING), noise=2.0)
    rows = np.append(np.arange(data.force.size), [3, 3, 3, 20])
    repeated = ForceData(data.force[rows], data.pressure[rows], data.length[rows], SPECIMEN)
    assert repeated.count is not None
    weighted = dataclasses.replace(data, force_std=1 / np.sqrt(repeated.count))
    one, other = (identify(each, starts=1) for each in (repeated, weighted))
    for name in ("braid_angle", "E_1"):
        assert one.estimate(name).value == pytest.approx(other.estimate(name).value, rel=1e-9)


def test_errors_cover_the_truth() -> None:
    """At 2 N of noise the truth lies within three standard errors, and they are not absurd."""
    result = identify(readings(known_muscle(SOFTENING), noise=2.0, seed=3), starts=8)
    expected = [0.022, math.radians(65), 30e3, 4e6, -6e6, 6e6]
    for estimate, truth in zip(result.estimates, expected, strict=True):
        assert not estimate.at_bound
        assert abs(estimate.value - truth) < 3 * estimate.stderr < 3 * abs(truth)
    assert 1.0 < result.errors.rmse < 3.0


@pytest.mark.slow
def test_drucker_holds_between_the_stations() -> None:
    """A law that wants to fall: the constraint is active inside the path and holds everywhere."""
    falling = famjax.PolynomialMaterial([4e6, -18e6, 22e6])
    data = readings(known_muscle(falling))
    held = {name: (v, v) for name, v in zip(
        ("braid_diameter", "braid_angle", "deadband_pressure"), (0.022, math.radians(65), 30e3),
        strict=True)}  # fmt: skip
    loose = identify(data, constraint="none", bounds=held, starts=1)
    assert loose.certificate.stability_margin < -1e5
    assert any("NOT Drucker-stable" in warning for warning in loose.warnings)
    stable = identify(data, bounds=held, starts=1)
    assert stable.active_constraints
    assert "Drucker modulus is 0" in stable.active_constraints[0]
    largest = np.abs(stable.coefficients).max()
    lengths = jnp.linspace(data.length.min(), 0.3, 20011)  # not the stations
    modulus = famjax.path_modulus(stable.muscle.material, stable.muscle.geometry, lengths, 1e5)
    assert float(modulus.min()) > -1e-9 * largest
    assert stable.certificate.stability_margin == pytest.approx(
        float(modulus.min()), abs=1e-9 * largest
    )
    assert stable.errors.rmse > loose.errors.rmse


def test_slope_constraint_is_exact_by_roots() -> None:
    falling = famjax.PolynomialMaterial([4e6, -18e6, 22e6])
    result = identify(readings(known_muscle(falling)), constraint="slope", starts=4)
    strain = np.linspace(0, result.strain_range, 50021)
    E = result.coefficients[0]
    tangent = E[0] + 2 * E[1] * strain + 3 * E[2] * strain**2
    assert tangent.min() > -1e-9 * np.abs(E).max()
    assert result.certificate.slope_margin == pytest.approx(tangent.min(), abs=1e-6 * abs(E[0]))


def test_positive_constraint(dmsp20: ForceData) -> None:
    result = identify(dmsp20, constraint="positive", starts=4)
    assert result.converged
    assert (result.coefficients >= -1e-6).all()
    at_zero = [s for s in result.active_constraints if s.endswith("= 0")]
    assert at_zero
    zero = result.estimate(at_zero[0].split(" ")[0])
    assert math.isnan(zero.stderr)  # never an error bar of zero


@pytest.mark.slow
def test_a_law_that_is_linear_in_pressure_is_recovered() -> None:
    law = famjax.materials.PressurePolynomialMaterial([3e5, 7e5], [[4e6, -3e6], [3e6, -1e6]])
    linear = identify(readings(known_muscle(law)), order=2, dependence="linear", starts=4)
    assert linear.errors.rmse < 1e-6
    np.testing.assert_allclose(linear.coefficients, law.node_coefficients, rtol=1e-6)


@pytest.mark.slow
def test_elastic_braid_is_identified() -> None:
    """The truth has soft threads: the elastic geometry finds it, the inelastic one cannot."""
    thread = famjax.braids.LinearThread(8e9, 1e-7)
    source = EstimatedSource(SPECIMEN, 200.0, thread)
    geometry = source.geometry({"braid_diameter": 0.022, "braid_angle": math.radians(65)})
    data = readings(famjax.Muscle(geometry, SOFTENING, 30e3))
    elastic = identify(data, geometry=source, starts=8)
    expected = [0.022, math.radians(65), 30e3, 4e6, -6e6, 6e6]
    np.testing.assert_allclose([e.value for e in elastic.estimates], expected, rtol=1e-5)
    assert identify(data, starts=8).errors.rmse > 100 * elastic.errors.rmse


class Silent(famjax.EstimatedGeometry):
    """A geometry that declares nothing of itself."""

    def declared(self) -> dict[str, famjax.parameters.Declared]:
        return {}


def test_weights_follow_the_standard_deviations() -> None:
    data = readings(known_muscle(SOFTENING), noise=5.0, seed=1)
    std = np.where(data.length > 0.26, 1.0, 1e4)
    result = identify(dataclasses.replace(data, force_std=std), starts=4)
    heavy = data.length[data.loaded] > 0.26
    assert (
        np.abs(result.residuals[heavy]).mean()
        < np.abs(identify(data, starts=4).residuals[heavy]).mean()
    )


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"order": 0}, "order of the law must be a whole number 1 to 8, got 0"),
        ({"constraint": "convex"}, "the constraint is one of none, positive, slope, drucker"),
        ({"dependence": "cubic"}, "the pressure dependence is one of"),
        ({"starts": 0}, "whole number >= 1"),
        ({"bounds": {"spam": (0.0, 1.0)}}, "unknown parameter 'spam'"),
        ({"bounds": {"E_1": (2e6, 1e6)}}, "the lower one, 2e.06, must not exceed the upper one"),
        ({"bounds": {"braid_angle": (1.0, 1.6)}}, "lies between 0.1 and 1.57 rad"),
        ({"bounds": {"braid_diameter": (0.02, math.inf)}}, "needs finite bounds"),
        ({"bounds": {"E_1": (-2e6, -1e6)}, "constraint": "positive"}, "no coefficients satisfy"),
        ({"order": 7}, "needs loaded readings at 7 or more lengths away from the rest length"),
    ],
)
def test_what_cannot_be_fitted_is_refused(dmsp20: ForceData, options: dict, message: str) -> None:
    with pytest.raises(InputError, match=message):
        identify(dmsp20, **options)


def test_float64_is_asked_for_with_the_line_that_enables_it(dmsp20: ForceData) -> None:
    import jax

    with (
        jax.enable_x64(False),
        pytest.raises(RuntimeError, match=r'jax\.config\.update\("jax_enable_x64", True\)'),
    ):
        identify(dmsp20)

"""Covariances, left-out errors and shared errors against textbooks, refits and replicates."""

import dataclasses
import functools

import numpy as np
import pytest
from maps import known_muscle, readings
from scipy import stats
from scipy.interpolate import CubicSpline

import famjax
import fitting
from fitting import ForceData, Identification, identify, validate
from fitting.bands import spline_variance
from fitting.covariance import covariance
from fitting.engine import solve
from fitting.evidence import Carried, Move, SharedErrors, carry, gather, moves_of
from fitting.summary import joint_derivatives
from fitting.validation import LeftOut, best_ends, leave_out_each

EXACT = 1e-10
RNG = np.random.default_rng(2)
X = RNG.normal(size=(40, 3)) * [1.0, 1e3, 1e-4]
FREE = np.zeros(3, bool)
NONE = np.zeros((0, 3))


def test_linear_least_squares():
    residual = RNG.normal(size=40)
    found = covariance(X, residual, NONE, FREE)
    inverse = np.linalg.inv(X.T @ X)
    np.testing.assert_allclose(found.matrix, inverse * (residual @ residual) / 37, rtol=EXACT)
    meat = X.T @ (residual[:, None] ** 2 * X)
    np.testing.assert_allclose(found.sandwich, inverse @ meat @ inverse * 40 / 37, rtol=EXACT)
    assert found.degrees_of_freedom == 37


def test_the_larger_of_both_errors_is_given():
    # Noisy where the first column is large: it is known less well than equal noise says, another better.
    found = covariance(X, np.random.default_rng(0).normal(size=40) * X[:, 0] ** 2, NONE, FREE)
    plain = np.sqrt(np.diag(found.matrix))
    ratio = found.sandwich_stderr / plain
    assert ratio[0] > 1.2
    assert ratio.min() < 1
    np.testing.assert_array_equal(found.stderr, np.maximum(plain, found.sandwich_stderr))


def test_active_constraints_held_parameters_and_a_ridge_have_no_error():
    residual = RNG.normal(size=40)
    held = np.array([False, True, False])
    found = covariance(X, residual, np.array([[1.0, 0.0, 0.0]]), held)
    assert np.isnan(found.stderr[:2]).all()
    assert np.isnan(found.sandwich_stderr[:2]).all()
    alone = covariance(X[:, 2:], residual, np.zeros((0, 1)), np.zeros(1, bool))
    np.testing.assert_allclose(found.stderr[2], alone.stderr[0], rtol=EXACT)
    assert np.isnan(covariance(X, residual, NONE, np.ones(3, bool)).matrix).all()
    twin = np.concatenate([X, X[:, :1]], axis=1)
    found = covariance(twin, residual, np.zeros((0, 4)), np.zeros(4, bool))
    assert found.condition > 1e10
    assert np.isnan(found.stderr).all()


def left_out_of(result: Identification, **kinds: tuple[int | None, int]) -> dict[str, LeftOut]:
    return leave_out_each([(result.problem, result.end.u)], kinds)[0]


def test_errors_are_those_of_a_validation(fitted20):
    found = left_out_of(fitted20, length=(None, 4))["length"]
    expected = validate(fitted20, "length")
    assert found.rmse == pytest.approx(expected.rmse, rel=1e-3)
    assert found.interior_rmse == pytest.approx(expected.interior_rmse, rel=1e-3)
    assert found.group_rmse == pytest.approx(expected.group_rmse, rel=1e-2)


def test_neighbouring_pressures_are_left_out_together(fitted20):
    found = left_out_of(fitted20, pressure=(4, 1))["pressure"]
    assert set(found.group) == {0, 1, 2, 3}
    assert (np.diff(found.group[np.argsort(found.level, kind="stable")]) >= 0).all()
    assert found.rmse > fitted20.errors.rmse


def test_two_levels_cannot_be_left_out(dmsp20):
    few = dmsp20.part(dmsp20.lengths.level >= 0.28)
    result = identify(few, law="neo-hookean", starts=2)
    assert "length" not in left_out_of(result, length=(None, 1))


def test_the_spline_is_the_natural_one():
    known, at = np.array([0.0, 0.2, 0.5, 1.0]), np.array([0.1, 0.35, 0.9, 1.3, -0.4])
    values = np.array([1.0, -0.3, 0.8, 0.1])
    cubes, lines = np.abs(known[:, None] - known) ** 3, np.vander(known, 2, increasing=True)
    system = np.block([[cubes, lines], [lines.T, np.zeros((2, 2))]])
    right = np.vstack([np.abs(known[:, None] - at) ** 3, np.vander(at, 2, increasing=True).T])
    weights = np.linalg.solve(system, right)[:4]
    spline = CubicSpline(known, values, bc_type="natural")
    assert (weights.T @ values)[:3] == pytest.approx(spline(at[:3]))
    covariance = np.abs(known[:, None] - known) ** 3
    cross = np.abs(known[:, None] - at) ** 3
    expected = np.einsum("ki,kl,li->i", weights, covariance, weights)
    expected -= 2 * np.sum(weights * cross, axis=0)
    assert spline_variance(known, at) == pytest.approx(expected)


STATED = SharedErrors(
    rest_length=1e-4, shortening=1e-3, pressure_reading=2e-3, pressure_zero=300.0,
    force_reading=2e-3, wall_thickness=2e-5,
)  # fmt: skip


def fitted(data: ForceData) -> fitting.Identification:
    return fitting.identify(data, starts=1, bounds={"braid_diameter": (0.0236, 0.0236)})


@pytest.fixture(scope="module")
def found() -> fitting.Identification:
    return fitted(fitting.load_bundled("DMSP-20-300"))


@pytest.fixture(scope="module")
def carried(found: fitting.Identification) -> Carried:
    return carry(found, moves_of(found.data, STATED))


def numbers(result: fitting.Identification) -> np.ndarray:
    return np.concatenate([result.end.point.parameters, result.end.point.x])


@pytest.mark.parametrize("source", STATED.stated())
def test_the_effect_is_that_of_readings_moved_and_fitted_again(source, found, carried):
    moved = fitted(STATED.moved(found.data, source))
    scale = np.maximum(np.abs(numbers(found)), 1.0)
    apart = np.abs(numbers(moved) - numbers(found)) / scale
    effect = carried.effects[carried.sources.index(source)] / scale
    # Left: effects to second order in errors of a few parts in a thousand.
    np.testing.assert_allclose(effect, apart, rtol=0.08, atol=1e-6)


@pytest.mark.slow
def test_an_error_widens_the_band_and_is_told(found, tmp_path):
    told = {}
    for errors in (SharedErrors(), SharedErrors(force_reading=0.02)):
        evidence = gather(
            found, validation=False, profiles=False, replicates=0, seed=0,
            progress=lambda *_: None, shared=moves_of(found.data, errors),
        )  # fmt: skip
        fitting.report.write_fit(found, tmp_path, "si", evidence)
        saved = fitting.load_fit(tmp_path / "fit.json")
        told[errors.force_reading] = fitting.predict(saved, np.array([0.28]), np.array([5e5]))[0]
        headers = [header for _, header, _ in fitting.report.Findings(found, evidence).tables("si")]
        assert any("all together" in one for one in headers) == bool(errors.force_reading)
    plain, wide = told[0.0], told[0.02]
    added = np.sqrt((wide["high_95_N"] - wide["force_N"]) ** 2
                    - (plain["high_95_N"] - plain["force_N"]) ** 2)  # fmt: skip
    assert added == pytest.approx(1.96 * 0.02 * wide["force_N"], rel=0.02)
    assert wide["band"] == "left out, shared errors"


def test_what_cannot_be_moved_is_refused(found):
    with pytest.raises(ValueError, match=r"standard error of pressure_zero must be >= 0, got -1"):
        SharedErrors(pressure_zero=-1.0)
    with pytest.raises(fitting.InputError, match="no bladder_diameter"):
        moves_of(found.data, SharedErrors(bladder_diameter=1e-4))
    fewer = fitting.load_bundled("DMSP-10-250")
    with pytest.raises(fitting.InputError, match="must have 126 readings"):
        carry(found, {"other": [Move(fewer)]})
    shape = functools.partial(famjax.geometries.EndEffectGeometry, end_factor=1.05)
    with pytest.raises(fitting.InputError, match="of the same kind as in the fit"):
        carry(found, {"ends": [Move(None, shape)]})
    alike = dataclasses.replace(found.data, notes=("another",))
    assert carry(found, {"nothing": [Move(alike)]}).std["E_1"] == 0


@pytest.mark.slow
def test_intervals_cover_over_200_replicates():
    """The hit rates lie within the 99.9 % range of a binomial with the promised probability."""
    data = readings(known_muscle())
    exact = identify(data, starts=8)
    truth = np.array([e.value for e in exact.estimates])
    noise = np.random.default_rng(11).normal(0, 2.0, (200, data.force.size))
    batch = [exact.problem.with_readings(force=exact.problem.force + drawn) for drawn in noise]
    ends = best_ends(batch, [exact.end.u[None]] * 200)
    assert all(end.converged for end in ends)
    points = [end.point for end in ends]
    values = np.array([np.concatenate([point.parameters, point.x]) for point in points])
    errors = []
    for problem, point in zip(batch, points, strict=True):
        residual, jacobian, _ = joint_derivatives(solve(problem, point.parameters))
        held = np.zeros(jacobian.shape[1], bool)
        errors.append(covariance(jacobian, residual, np.zeros((0, held.size)), held).stderr)
    pulls = np.abs(values - truth) / np.array(errors)
    freedom = data.force.size - truth.size
    for level in (0.68, 0.95):
        inside = (pulls < stats.t.ppf((1 + level) / 2, freedom)).sum(axis=0)
        low, high = stats.binom.ppf([0.0005, 0.9995], 200, level)
        assert (low <= inside).all(), (level, inside)
        assert (inside <= high).all(), (level, inside)

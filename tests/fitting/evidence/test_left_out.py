"""Errors on what was left out, and the error of predictions that is made of them."""

import dataclasses

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fitting import ForceData, Identification, identify, validate
from fitting.bands import ModelError, model_error, spline_variance
from fitting.validation import LeftOut, leave_out_each


def left_out_of(result: Identification, **kinds: tuple[int | None, int]) -> dict[str, LeftOut]:
    return leave_out_each([(result.problem, result.end.u)], kinds)[0]


def test_errors_are_those_of_a_validation(fitted20: Identification) -> None:
    found = left_out_of(fitted20, length=(None, 4))["length"]
    expected = validate(fitted20, "length")
    assert found.rmse == pytest.approx(expected.rmse, rel=1e-3)
    assert found.interior_rmse == pytest.approx(expected.interior_rmse, rel=1e-3)
    assert found.group_rmse == pytest.approx(expected.group_rmse, rel=1e-2)


def test_neighbouring_pressures_are_left_out_together(fitted20: Identification) -> None:
    found = left_out_of(fitted20, pressure=(4, 1))["pressure"]
    assert set(found.group) == {0, 1, 2, 3}
    order = np.argsort(found.level, kind="stable")
    assert (np.diff(found.group[order]) >= 0).all()
    assert found.rmse > fitted20.errors.rmse


def test_two_levels_cannot_be_left_out(dmsp20: ForceData) -> None:
    few = dmsp20.part(dmsp20.lengths.level >= 0.28)
    result = identify(few, law="neo-hookean", starts=2)
    assert "length" not in left_out_of(result, length=(None, 1))


def test_the_splines_variance_is_zero_where_it_was_measured_and_grows_away() -> None:
    known = np.array([0.24, 0.25, 0.27, 0.30])
    assert spline_variance(known, known) == pytest.approx(0, abs=1e-12)
    away = spline_variance(known, np.array([0.285, 0.31, 0.32, 0.34]))
    assert (np.diff(away) > 0).all()
    inside = spline_variance(known, np.array([0.245, 0.26, 0.285]))
    assert inside[0] < inside[1] < inside[2]  # wider gaps are known less


def test_the_spline_is_the_natural_one() -> None:
    """Its best linear predictor, by the same matrix, is SciPy's natural cubic spline."""
    known, at = np.array([0.0, 0.2, 0.5, 1.0]), np.array([0.1, 0.35, 0.9, 1.3, -0.4])
    values = np.array([1.0, -0.3, 0.8, 0.1])
    system = np.block(
        [
            [np.abs(known[:, None] - known) ** 3, np.vander(known, 2, increasing=True)],
            [np.vander(known, 2, increasing=True).T, np.zeros((2, 2))],
        ]
    )
    right = np.vstack([np.abs(known[:, None] - at) ** 3, np.vander(at, 2, increasing=True).T])
    weights = np.linalg.solve(system, right)[:4]
    spline = CubicSpline(known, values, bc_type="natural")
    assert (weights.T @ values)[:3] == pytest.approx(spline(at[:3]))
    covariance = np.abs(known[:, None] - known) ** 3
    cross = np.abs(known[:, None] - at) ** 3
    expected = np.einsum("ki,kl,li->i", weights, covariance, weights) - 2 * np.sum(
        weights * cross, axis=0
    )
    assert spline_variance(known, at) == pytest.approx(expected)


def test_a_map_may_have_thousands_of_levels() -> None:
    known = np.sort(np.random.default_rng(0).uniform(0.2, 0.3, 20_000))  # 3 GB as a dense system
    middles = (known[1:] + known[:-1]) / 2
    assert spline_variance(known, known) == pytest.approx(0, abs=1e-12)
    # The widest gap is 6e-4 of the range, and its cube 2e-10: the variance is of that size.
    assert 0 < spline_variance(known, middles).max() < 1e-8
    assert spline_variance(known[[0, -1]], middles).max() > 0.1


def test_one_level_tells_nothing_but_distance() -> None:
    assert spline_variance(np.array([2.0]), np.array([2.0, 3.0, 4.0])) == pytest.approx(
        [0, 0.125, 1.0]
    )


def test_the_error_survives_its_file(fitted20: Identification) -> None:
    left = left_out_of(fitted20, length=(None, 1), pressure=(None, 1))
    found = model_error(fitted20.data, fitted20.residuals, left, fitted20.n_parameters)
    again = ModelError.from_dict(found.as_dict())
    at = np.array([0.2, 0.26, 0.33]), np.array([1e5, 4e5, 9e5])
    assert (again.std(*at) == found.std(*at)).all()
    assert again.factor() == found.factor()
    assert "left out" in found.covers
    assert (found.std(*at) >= found.noise).all()


def test_few_lengths_are_said_to_be_a_priors(fitted20: Identification) -> None:
    found = model_error(fitted20.data, fitted20.residuals, {}, fitted20.n_parameters)
    assert "With too few lengths to leave one out" in found.covers
    assert found.length.scale == pytest.approx(found.pressure.scale)


def test_levels_that_all_but_coincide_have_an_error(fitted20: Identification) -> None:
    """Lengths that differ by micrometres are known from one another to the last digit."""
    data, residual = fitted20.data, fitted20.residuals
    level = data.lengths.level[data.loaded] + 1e-9 * np.arange(residual.size)
    twins = dataclasses.replace(
        data, length=data.length + 1e-9 * np.arange(data.length.size), length_tolerance=1e-12
    )
    left = LeftOut("length", level, np.arange(residual.size), residual)
    found = model_error(twins, residual, {"length": left}, 6)
    assert np.isfinite(found.length.scale)


def test_levels_close_together_say_little_of_the_error_between_others(dmsp20: ForceData) -> None:
    """Noise at 100 kPa, left out beside 101 kPa, is no proof of a law that is off by the whole force."""
    rng, noise = np.random.default_rng(4), 5.0
    levels = np.array([100e3, 101e3, 102e3, 200e3, 300e3, 301e3, 400e3, 500e3])
    pressure, length = (g.ravel() for g in np.meshgrid(levels, np.linspace(0.25, 0.3, 6)))
    data = ForceData(np.full(48, 1e3) + np.arange(48), pressure, length, dmsp20.specimen)
    data = dataclasses.replace(data, pressure_tolerance=0.0)
    residual = rng.normal(0, noise, 48)
    group = np.searchsorted(levels, pressure)
    out = LeftOut("pressure", pressure, group, rng.normal(0, 1.3 * noise, 48))
    found = model_error(data, residual, {"pressure": out}, 6)
    half = found.factor() * found.std(np.array([0.28, 0.28]), np.array([250e3, 600e3]))
    assert (half > 2 * noise).all()
    assert (half < 0.2 * data.max_force).all()

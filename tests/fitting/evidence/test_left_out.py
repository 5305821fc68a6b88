"""Errors on what was left out, and the error of predictions that is made of them."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fitting import ForceData, Identification, identify, validate
from fitting.bands import spline_variance
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


def test_one_level_tells_nothing_but_distance() -> None:
    assert spline_variance(np.array([2.0]), np.array([2.0, 3.0, 4.0])) == pytest.approx(
        [0, 0.125, 1.0]
    )

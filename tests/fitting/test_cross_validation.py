"""Cross-validation against loops written out by hand, with models that are means and lines."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from fitting import ForceData, InputError, Specimen
from fitting.comparison import cross_validate

EXACT = 1e-12  # the same sums

SPECIMEN = Specimen("test", 0.3, 1.8e-3, 20e-3)


@pytest.fixture
def data() -> ForceData:
    """Three lengths by four pressures, two readings slack."""
    P, L = (grid.ravel() for grid in np.meshgrid([1e5, 2e5, 3e5, 4e5], [0.3, 0.28, 0.26]))
    force = P * (1e-3 - (0.3 - L) / 60) - 90 + 5 * np.sin(40 * L + P)
    return ForceData(np.maximum(force, 0.0), P, L, SPECIMEN)


def _line(train: ForceData) -> Callable:
    """Least squares of 1, P, P L over the loaded readings."""
    at = train.loaded

    def columns(length: np.ndarray, pressure: np.ndarray) -> np.ndarray:
        return np.stack([np.ones_like(length), pressure, pressure * length], axis=1)

    known = columns(train.length[at], train.pressure[at])
    solved = np.linalg.lstsq(known, train.force[at], rcond=None)[0]
    return lambda length, pressure: columns(length, pressure) @ solved


@pytest.mark.parametrize("groups", ["pressure", "length"])
def test_each_group_is_predicted_from_the_others(data: ForceData, groups: str) -> None:
    found = cross_validate(_line, data, groups)
    label, at = getattr(data, groups), data.loaded
    square, inner = [], []
    levels = np.unique(label[at])
    for level in levels:
        keep = label != level
        train = ForceData(data.force[keep], data.pressure[keep], data.length[keep], SPECIMEN)
        held = ~keep & at
        error = _line(train)(data.length[held], data.pressure[held]) - data.force[held]
        square.extend(error**2)
        if level not in (levels[0], levels[-1]):
            inner.extend(error**2)
    assert at.sum() < at.size
    assert found.rmse == pytest.approx(math.sqrt(np.mean(square)), rel=EXACT)
    assert found.interior_rmse == pytest.approx(math.sqrt(np.mean(inner)), rel=EXACT)
    assert found.values.tolist() == levels.tolist()


def test_slack_readings_are_fitted_with_and_never_predicted(data: ForceData) -> None:
    seen = []

    def fit(train: ForceData) -> Callable:
        seen.append(int((~train.loaded).sum()))
        return lambda length, pressure: np.ones_like(length)

    found = cross_validate(fit, data, "length")
    slack = int((~data.loaded).sum())
    assert slack > 0
    assert sum(seen) == slack * (len(seen) - 1)
    assert found.error.size == data.loaded.sum()


def test_two_groups_have_no_interior(data: ForceData) -> None:
    keep = data.length > 0.27
    two = ForceData(data.force[keep], data.pressure[keep], data.length[keep], SPECIMEN)
    assert math.isnan(cross_validate(_line, two, "length").interior_rmse)


def test_groups_that_cannot_be_left_out_are_refused(data: ForceData) -> None:
    with pytest.raises(InputError, match="by pressure or length, got 'day'"):
        cross_validate(_line, data, "day")
    keep = data.length == 0.3
    one = ForceData(data.force[keep], data.pressure[keep], data.length[keep], SPECIMEN)
    with pytest.raises(InputError, match="readings at two of them or more; all 4 share one"):
        cross_validate(_line, one, "length")

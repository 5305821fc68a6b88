"""Cross-validation against loops written out by hand, with models that are means and lines."""

import math
from collections.abc import Callable, Sequence

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
    assert [error.group for error in found.errors] == levels.tolist()
    assert sum(error.n_readings for error in found.errors) == at.sum() == found.predicted.size
    pooled = sum(error.n_readings * error.rmse**2 for error in found.errors) / at.sum()
    assert math.sqrt(pooled) == pytest.approx(found.rmse, rel=EXACT)


def test_slack_readings_are_fitted_with_and_never_predicted(data: ForceData) -> None:
    seen = []

    def fit(train: ForceData) -> Callable:
        seen.append(int((~train.loaded).sum()))
        return lambda length, pressure: np.ones_like(length)

    found = cross_validate(fit, data, "length")
    slack = int((~data.loaded).sum())
    assert slack > 0
    assert sum(seen) == slack * (len(seen) - 1)
    assert found.predicted.size == data.loaded.sum()


def test_two_groups_have_no_interior(data: ForceData) -> None:
    keep = data.length > 0.27
    two = ForceData(data.force[keep], data.pressure[keep], data.length[keep], SPECIMEN)
    assert math.isnan(cross_validate(_line, two, "length").interior_rmse)


def test_specimens_are_predicted_from_the_others() -> None:
    maps = [
        ForceData(
            np.array([1.0, 3.0]) + k,
            np.array([1e5, 2e5]),
            np.array([0.3, 0.3]),
            Specimen(f"muscle {k}", 0.3 + 0.01 * k, 1.8e-3),
        )
        for k in range(3)
    ]

    def mean(train: Sequence[ForceData], specimen: Specimen) -> Callable:
        level = np.mean([one.force for one in train]) + specimen.rest_length
        return lambda length, pressure: np.full_like(length, level)

    found = cross_validate(mean, maps, "specimen")
    expected = [
        np.mean([maps[j].force for j in range(3) if j != k]) + 0.3 + 0.01 * k for k in range(3)
    ]
    np.testing.assert_allclose(found.predicted, np.repeat(expected, 2), rtol=EXACT)
    assert [error.group for error in found.errors] == ["muscle 0", "muscle 1", "muscle 2"]
    force = np.concatenate([one.force for one in maps])
    assert found.rmse == pytest.approx(
        math.sqrt(np.mean((found.predicted - force) ** 2)), rel=EXACT
    )


def test_bad_requests_are_refused(data: ForceData) -> None:
    with pytest.raises(InputError, match="groups must be one of pressure, length, specimen"):
        cross_validate(_line, data, "day")
    with pytest.raises(InputError, match="give a sequence of force maps"):
        cross_validate(_line, data, "specimen")
    with pytest.raises(InputError, match="two force maps or more; got 1"):
        cross_validate(lambda train, specimen: _line(train[0]), [data], "specimen")
    with pytest.raises(InputError, match="give one force map"):
        cross_validate(_line, [data, data], "length")
    keep = data.length == 0.3
    one = ForceData(data.force[keep], data.pressure[keep], data.length[keep], SPECIMEN)
    with pytest.raises(InputError, match="readings at two of them or more; all 4 share one"):
        cross_validate(_line, one, "length")

"""Levels: what counts as one pressure or one length in a map of measured values."""

import numpy as np
import pytest

from fitting import ForceData, InputError, Specimen
from fitting.data import MOST_APART, groups_of_levels, levels_of

SPECIMEN = Specimen("measured", 0.3, 0.002, nominal_diameter=0.02)


def measured(values: np.ndarray, times: int, std: float, seed: int) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(0, std, (times, values.size))
    return (values + noise).ravel()


@pytest.mark.parametrize("seed", range(100, 120))
@pytest.mark.parametrize(("times", "std"), [(2, 20.0), (3, 150.0), (8, 300.0)])
def test_readings_about_nominal_pressures_find_their_level(
    seed: int, times: int, std: float
) -> None:
    rng = np.random.default_rng(seed)
    nominal = rng.choice(np.arange(40e3, 640e3, 20e3), rng.integers(4, 20), replace=False)
    found = levels_of(measured(nominal, times, std, seed), "pressure")
    expected = np.tile(np.arange(nominal.size)[np.argsort(np.argsort(nominal))], times)
    np.testing.assert_array_equal(np.unique(found.level, return_inverse=True)[1], expected)
    assert "found from the gaps" in found.note


@pytest.mark.parametrize("seed", range(20))
def test_no_levels_are_seen_where_there_are_none(seed: int) -> None:
    values = np.random.default_rng(seed).uniform(0, 6e5, 40)
    found = levels_of(values, "pressure")
    np.testing.assert_array_equal(found.level, values)
    assert found.tolerance == 0
    assert "no gaps divide them" in found.note


def gauge_of_1_kpa(rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Readings at seven set pressures and eight lengths, rounded so that most values repeat."""
    P, L = (grid.ravel() for grid in np.meshgrid(np.arange(1, 8) * 70e3, np.arange(8) * 5e-3 + 0.2))
    return np.round((P + rng.normal(0, 400, P.size)) / 1e3) * 1e3, L


@pytest.mark.parametrize("seed", range(20))
def test_values_that_a_gauge_rounds_are_on_the_level_that_was_set(seed: int) -> None:
    pressure, length = gauge_of_1_kpa(np.random.default_rng(seed))
    assert pressure.size >= 2 * np.unique(pressure).size
    found = ForceData(np.arange(1.0, 57.0), pressure, length, SPECIMEN).pressures
    expected = np.round(pressure / 70e3)
    np.testing.assert_array_equal(np.unique(found.level, return_inverse=True)[1], expected - 1)
    assert "found from the gaps" in found.note


def test_neighbours_that_were_set_at_one_length_are_two_levels() -> None:
    """A fine grid beside a coarse one: 5 and 6 kPa were both measured at every length."""
    P, L = (g.ravel() for g in np.meshgrid([5e3, 6e3, 7e3, 300e3, 600e3], [0.3, 0.29, 0.28, 0.27]))
    found = ForceData(np.arange(1.0, 21.0), P, L, SPECIMEN).pressures
    np.testing.assert_array_equal(found.level, P)


def test_a_measured_pressure_is_left_out_with_its_neighbours() -> None:
    nominal = np.array([100e3, 200e3, 300e3])
    pressure = measured(nominal, 4, 60.0, seed=1)
    length = np.repeat([0.30, 0.29, 0.28, 0.27], 3)
    data = ForceData(pressure / 1e3, pressure, length, SPECIMEN)
    levels, counts = np.unique(data.left_out_as("pressure"), return_counts=True)
    assert counts.tolist() == [4, 4, 4]
    np.testing.assert_allclose(levels, nominal, atol=150)


def test_a_part_keeps_its_levels_and_every_column() -> None:
    """What was one pressure stays one, however few of its readings are left."""
    pressure = np.array([1e5, 1.001e5, 2e5, 2.002e5, 3e5, 3.001e5])
    n = pressure.size
    data = ForceData(
        np.linspace(10.0, 60.0, n), pressure, np.linspace(0.2, 0.25, n), SPECIMEN,
        force_std=np.full(n, 0.5), pressure_tolerance=500.0, length_tolerance=1e-4,
    )  # fmt: skip
    part = data.part(data.pressure > 1.5e5)
    np.testing.assert_array_equal(part.force, data.force[2:])
    np.testing.assert_array_equal(part.force_std, data.force_std[2:])
    np.testing.assert_array_equal(part.pressures.level, data.pressures.level[2:])
    with pytest.raises(InputError, match="nothing to fit"):
        data.part(data.pressure > 1e6)


def test_levels_are_left_out_one_by_one_and_many_of_them_with_their_neighbours() -> None:
    few = np.array([3.0, 1.0, 2.0, 2.0, 9.0])
    assert groups_of_levels(few, np.array([1.0, 2.0, 3.0])).tolist() == [2, 0, 1, 1, -1]
    many = np.random.default_rng(0).permutation(1000.0 + np.arange(400))
    group = groups_of_levels(many, np.unique(many))
    assert np.bincount(group).tolist() == [10] * MOST_APART
    assert (np.diff(group[np.argsort(many)]) >= 0).all()

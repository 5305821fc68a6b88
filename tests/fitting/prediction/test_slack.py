"""A muscle buckles and does not push: what is reported where the model is below zero."""

import jax
import numpy as np
import pytest

import famjax
from fitting import Identification, predict
from fitting.prediction import reported, seen_slack
from fitting.result import Outlook
from tests.fitting.bare import bare_fit

REST = 0.296  # m
FORCES = np.linspace(0.0, 900.0, 7)  # N, of the readings


def muscle(deadband: float) -> famjax.Muscle:
    braid = famjax.Braid.from_rest(diameter=23e-3, braid_angle=np.deg2rad(62.0), length=REST)
    bladder = famjax.Bladder(REST, 23e-3, 1.8e-3, embedded=True)
    law = famjax.PolynomialMaterial((5.9e6, -19.0e6, 25.8e6))
    return famjax.Muscle(famjax.EstimatedGeometry(braid, bladder), law, deadband)


def measured(one: famjax.Muscle, std: float = 0.0) -> Identification:
    """A fit whose largest reading is 900 N, its forces known to parts of their numbers."""
    numbers = np.append(np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(one)]), 0.0)
    outlook = Outlook(directions=std * numbers[None] if std else np.zeros((0, numbers.size)))
    at = np.linspace(0.23, 0.29, FORCES.size), np.linspace(0.0, 6e5, FORCES.size)
    return bare_fit(one, *at, FORCES, outlook)


@pytest.mark.parametrize(
    ("model", "half", "seen", "expected"),
    [
        (100.0, 10.0, False, (False, 90.0, 110.0)),
        (5.0, 10.0, False, (False, 0.0, 15.0)),
        (-5.0, 10.0, False, (True, 0.0, 5.0)),
        (-100.0, 10.0, False, (True, 0.0, 0.0)),
        (11.0, 3.5, True, (False, 0.0, 14.5)),
        (1e-13, 0.0, False, (True, 0.0, 1e-13)),
        (-5.0, np.nan, False, (True, np.nan, np.nan)),
        (np.nan, 1.0, False, (False, np.nan, np.nan)),
    ],
)
def test_what_a_reading_can_be(
    model: float, half: float, seen: bool, expected: tuple[float, bool, float, float]
) -> None:
    found = reported(np.array([model]), np.array([half]), np.array([seen]))
    assert [one[0] for one in found] == pytest.approx(expected, nan_ok=True)


def test_a_slack_reading_speaks_of_shorter_lengths_and_lower_pressures_unless_contradicted() -> (
    None
):
    length, pressure, force = [0.25, 0.25, 0.30, 0.20], [1e5, 2e5, 5e5, 3e5], [0.0, 40.0, 0.0, 5.0]
    fit = bare_fit(muscle(0.0), *map(np.array, (length, pressure, force)))
    length = np.array([0.25, 0.24, 0.2501, 0.252, 0.25, 0.29])
    pressure = np.array([1e5, 5e4, 1e5, 1e5, 1.1e5, 4e5])
    said = seen_slack(fit, length, pressure)
    assert said.tolist() == [True, True, True, False, False, False]


@pytest.mark.parametrize("deadband", [0.0, 40e3])
def test_rest_without_pressure_is_no_force(deadband: float) -> None:
    one = muscle(deadband)
    (row,) = predict(measured(one), np.array([REST]), np.array([0.0]))
    assert row["force_N"] == 0
    assert row["slack"] is True
    assert row["model_force_N"] == pytest.approx(float(one.force(REST, 0.0)), abs=1e-9)
    assert list(row) == [
        "length_m", "pressure_Pa", "force_N", "model_force_N", "force_std_N", "low_95_N",
        "high_95_N", "band", "slack", "inside", "outside",
    ]  # fmt: skip


def test_forces_and_bands_are_never_below_zero_and_slack_states_hold_no_force() -> None:
    one = muscle(40e3)
    lengths, pressures = np.linspace(0.23, REST, 9), np.linspace(0.0, 6e5, 13)
    rows = predict(measured(one, std=0.01), lengths, pressures)
    force, model, low, high = (
        np.array([row[key] for row in rows])
        for key in ("force_N", "model_force_N", "low_95_N", "high_95_N")
    )
    slack = np.array([row["slack"] for row in rows])
    np.testing.assert_array_equal(force, np.maximum(model, 0.0))
    np.testing.assert_array_equal(slack, model <= 0)
    assert 20 < slack.sum() < slack.size
    assert (low[slack] == 0).all()
    assert (low >= 0).all()
    assert (low <= force).all()
    assert (force <= high).all()
    assert (high[slack] > 0).any()  # where the band straddles zero


def test_nothing_is_said_beyond_the_limits_of_the_braid() -> None:
    fit = measured(muscle(40e3), std=0.01)
    thread = REST / np.sin(np.deg2rad(62.0))
    lock = thread / np.sqrt(3)
    closed = float(fit.muscle.length_range()[1])
    for length, why in (
        (0.2 * REST, "below the braid's lock"), (0.4 * REST, "below the braid's lock"),
        (0.999 * lock, "below the braid's lock"), (closed + 1e-4, "closes the bladder's bore"),
        (closed - 1e-4, "over 10 times the largest measured"), (1.01 * thread, "the thread's"),
    ):  # fmt: skip
        (row,) = predict(fit, np.array([length]), np.array([3e5]))
        assert why in row["outside"]
        keys = ("force_N", "model_force_N", "force_std_N", "low_95_N", "high_95_N", "band", "slack")
        assert [row[key] for key in keys] == [None] * 7
    (row,) = predict(fit, np.array([1.001 * lock]), np.array([3e5]))
    assert row["force_N"] == 0


def test_the_force_of_a_muscle_stays_smooth_through_zero() -> None:
    one = muscle(40e3)
    free = float(one.length_at_load(0.0, 3e5))
    step = 1e-4
    sides = np.asarray(one.force(free + step * np.array([-1.0, 0.0, 1.0]), 3e5))
    assert sides[0] < 0 < sides[2]
    assert abs(sides[1]) < 1e-6
    slope = float(jax.grad(one.force)(free, 3e5))
    assert (sides[2] - sides[0]) / (2 * step) == pytest.approx(slope, rel=1e-5)
    assert float(jax.grad(one.force)(free - 20 * step, 3e5)) > 0.5 * slope

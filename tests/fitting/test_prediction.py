"""Predictions: the muscle's own force, bands that hold what was left out, and states without a force."""

import dataclasses
import json
from pathlib import Path

import jax
import numpy as np
import pytest
from maps import bare_fit, muscle_map
from muscles import FESTO_CYLINDER
from scipy.special import stdtrit
from slow_cases import slow_after

import famjax
import fitting
from fitting import ForceData, Identification, load_fit, predict, write_csv, write_fit
from fitting.bands import pull, student_factor
from fitting.prediction import pressures_for, reported, seen_slack
from fitting.result import Outlook
from fitting.series import FROM_ONE

REST, THREAD = 0.296, 0.296 / np.sin(np.deg2rad(62.0))  # m
LENGTHS = np.linspace(0.23, 0.29, 7)  # at rest the law has a kink


def festo(deadband: float, coefficients: tuple[float, ...] = (5.9e6, -19.0e6, 25.8e6)):
    return famjax.Muscle(FESTO_CYLINDER, famjax.PolynomialMaterial(coefficients), deadband)


def measured(one: famjax.Muscle, std: float = 0.0) -> Identification:
    """A fit whose largest reading is 900 N, its forces known to parts of their numbers."""
    numbers = np.append(np.concatenate([np.ravel(leaf) for leaf in jax.tree.leaves(one)]), 0.0)
    outlook = Outlook(directions=std * numbers[None] if std else np.zeros((0, numbers.size)))
    pressures, forces = np.linspace(0.0, 6e5, 7), np.linspace(0.0, 900.0, 7)
    return bare_fit(one, LENGTHS, pressures, forces, outlook=outlook)


@pytest.mark.parametrize("rest_length", [None, 0.25])
@pytest.mark.parametrize("compliance", slow_after(2, [0.0, 2e-6]))
def test_forces_are_those_of_the_muscle_and_errors_those_of_differences(compliance, rest_length):
    mounted = famjax.MountedMuscle(festo(40e3), compliance)
    numbers = [np.asarray(leaf) for leaf in jax.tree.leaves(mounted)]
    spread = np.random.default_rng(0).normal(size=(3, sum(n.size for n in numbers)))
    spread *= 1e-3 * np.concatenate([n.ravel() for n in numbers])
    L, P = np.repeat(LENGTHS, 2) * (rest_length or REST) / REST, np.tile([2e5, 6e5], 7)
    found, std = pull(mounted, spread, L, P, rest_length=rest_length)

    def force(changed: famjax.MountedMuscle, length: np.ndarray) -> np.ndarray:
        one = changed.muscle
        one = one if rest_length is None else famjax.cut_to_length(one, rest_length)
        return np.asarray(changed.with_muscle(one).force(length, P))

    np.testing.assert_allclose(found, force(mounted, L), rtol=1e-12)
    _, unflat = jax.flatten_util.ravel_pytree(mounted)
    flat = np.concatenate([n.ravel() for n in numbers])
    step = 1e-3  # of the directions, which are a thousandth of the numbers
    ends = [[force(unflat(flat + s * step * d), L) for s in (1, -1)] for d in spread]
    slopes = [(up - down) / (2 * step) for up, down in ends]
    np.testing.assert_allclose(std, np.sqrt(np.sum(np.square(slopes), axis=0)), rtol=1e-6)


@pytest.mark.parametrize("factor", [1.0, 1.08])
def test_why_a_state_is_not_inside_and_that_nothing_is_said_beyond_the_braid(factor):
    one = festo(40e3)
    if factor > 1:
        ends = famjax.geometries.EndEffectGeometry(one.geometry, factor)
        one = dataclasses.replace(one, geometry=ends)
    fit = measured(one, std=0.01)
    longest, lock = (REST + (at - REST) / factor for at in (THREAD, THREAD / np.sqrt(3)))
    closed = float(one.length_range()[1])
    for length, pressure, why in (
        (0.27, 3e5, None), (0.27, 7e5, "the pressure is outside the measured range, 0 kPa to 600 kPa"),
        (1.001 * lock, 3e5, "the length is outside the measured range, 230 mm to 290 mm"),
    ):  # fmt: skip
        (row,) = predict(fit, np.array([length]), np.array([pressure]))
        assert (row["outside"], row["inside"]) == (why, why is None)
    for length, why in (
        (0.2 * REST, "the braid locks"), (0.999 * lock, "the braid locks (neutral angle)"),
        (closed + 1e-4, "closes the bladder's bore"), (closed - 1e-4, "over 10 times the largest measured"),
        (1.001 * longest, f"the length exceeds that of the threads, {longest * 1e3:.4g} mm"),
    ):  # fmt: skip
        (row,) = predict(fit, np.array([length]), np.array([3e5]))
        assert why in row["outside"], length
        keys = ("force_N", "model_force_N", "force_std_N", "low_95_N", "high_95_N", "band", "slack")
        assert [row[key] for key in keys] == [None] * 7
    found, beyond = predict(fit, np.array([0.27, 0.4]), np.array([]), onset=True)
    expected = float(one.onset_pressure(0.27, 6e5))
    assert found["onset_pressure_Pa"] == pytest.approx(expected, rel=1e-9)
    assert "exceeds that of the threads" in beyond["outside"]


def test_a_force_is_turned_into_its_pressure_and_back():
    one = measured(festo(40e3))
    lengths, forces = np.array([0.25, 0.28]), np.array([0.0, 100.0, 1e5])
    rows = pressures_for(one, lengths, forces)
    assert [row["inside"] for row in rows] == [True, True, False] * 2
    for row in rows:
        if row["pressure_Pa"] is None:
            assert "the force is too high" in row["outside"]
            continue
        (back,) = predict(one, np.array([row["length_m"]]), np.array([row["pressure_Pa"]]))
        assert back["force_N"] == pytest.approx(row["force_N"], abs=1e-6)
    for length, force, words in (([], [1.0], "at least one length"), ([-1.0], [1.0], "> 0"),
                                 ([0.25], [-1.0], "can only pull")):  # fmt: skip
        with pytest.raises(famjax.boundary.errors.InputError, match=words):
            pressures_for(one, np.array(length), np.array(force))


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
def test_what_a_reading_can_be(model, half, seen, expected):
    found = reported(np.array([model]), np.array([half]), np.array([seen]))
    assert [one[0] for one in found] == pytest.approx(expected, nan_ok=True)


def test_a_slack_reading_speaks_of_shorter_lengths_and_lower_pressures():
    length, pressure, force = [0.25, 0.25, 0.30, 0.20], [1e5, 2e5, 5e5, 3e5], [0.0, 40.0, 0.0, 5.0]
    fit = bare_fit(festo(0.0), *map(np.array, (length, pressure, force)))
    length = np.array([0.25, 0.24, 0.2501, 0.252, 0.25, 0.29])
    pressure = np.array([1e5, 5e4, 1e5, 1e5, 1.1e5, 4e5])
    said = seen_slack(fit, length, pressure)
    assert said.tolist() == [True, True, True, False, False, False]


@pytest.mark.parametrize("deadband", [0.0, 40e3])
def test_rest_without_pressure_is_no_force(deadband):
    one = festo(deadband)
    (row,) = predict(measured(one), np.array([REST]), np.array([0.0]))
    assert row["force_N"] == 0
    assert row["slack"] is True
    assert row["model_force_N"] == pytest.approx(float(one.force(REST, 0.0)), abs=1e-9)
    assert list(row) == [
        "length_m", "pressure_Pa", "force_N", "model_force_N", "force_std_N", "low_95_N",
        "high_95_N", "band", "slack", "inside", "outside",
    ]  # fmt: skip


def test_forces_and_bands_are_never_below_zero_and_slack_states_hold_no_force():
    one = festo(40e3)
    lengths, pressures = np.linspace(0.23, REST, 9), np.linspace(0.0, 6e5, 13)
    rows = predict(measured(one, std=0.01), lengths, pressures)
    keys = ("force_N", "model_force_N", "low_95_N", "high_95_N")
    force, model, low, high = (np.array([row[key] for row in rows]) for key in keys)
    slack = np.array([row["slack"] for row in rows])
    np.testing.assert_array_equal(force, np.maximum(model, 0.0))
    np.testing.assert_array_equal(slack, model <= 0)
    assert 20 < slack.sum() < slack.size
    assert (low[slack] == 0).all()
    assert (low >= 0).all()
    assert (low <= force).all()
    assert (force <= high).all()
    assert (high[slack] > 0).any()  # where the band straddles zero


# ---- bands of a length that was never measured

LEFT_OUT = 0.267  # m
PRESSURES = np.array([150, 250, 350, 450, 525, 600, 675]) * 1e3


@pytest.fixture(scope="module")
def thinned(dmsp20: ForceData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("map") / "map.csv"
    write_csv(dmsp20.part(np.abs(dmsp20.length - LEFT_OUT) >= 1e-6), path, system="metric")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("options", "widest"), [((), 130.0), (("--law", "polynomial"), 240.0)])
def test_a_length_left_out_lies_in_its_band(dmsp20, thinned, tmp_path, said, options, widest):
    said("fit", thinned, *options, "--output", tmp_path)
    asked = ",".join(f"{P:.0f}Pa" for P in PRESSURES)
    state = "--length", f"{LEFT_OUT}m", "--pressure", asked
    rows = json.loads(said("predict", tmp_path / "fit.json", *state, "--json"))
    at = np.abs(dmsp20.length - LEFT_OUT) < 1e-6
    measured = np.interp(PRESSURES, dmsp20.pressure[at], dmsp20.force[at])
    low, high = (np.array([row[key] for row in rows]) for key in ("low_95_N", "high_95_N"))
    assert ((low <= measured) & (measured <= high)).sum() >= 6
    assert (high - low).max() < widest
    assert all(row["band"] == "left out" for row in rows)


@pytest.mark.slow
def test_a_band_grows_with_the_distance_and_says_what_it_covers(thinned, tmp_path, said):
    told = said("fit", thinned, "--law", "ogden", "--output", tmp_path, "--verbose")
    assert "The 95 % prediction bands cover single readings" in told
    states = "--length", "280mm,225mm,340mm,100mm", "--pressure", "500kPa,900kPa"
    found = json.loads(said("predict", tmp_path / "fit.json", *states, "--json"))
    rows = {(row["length_m"], row["pressure_Pa"]): row for row in found}
    std = {at: row["force_std_N"] for at, row in rows.items()}
    assert std[0.28, 5e5] < std[0.225, 5e5]
    assert std[0.28, 5e5] < std[0.28, 9e5]
    assert rows[0.28, 5e5]["outside"] is None
    assert "thread" in rows[0.34, 5e5]["outside"]
    assert rows[0.34, 5e5]["force_N"] is None
    assert rows[0.34, 5e5]["band"] is None
    assert "pressure" in rows[0.28, 9e5]["outside"]
    told = said("predict", tmp_path / "fit.json", "--length", "340mm", "--pressure", "5bar")
    assert "no standard errors" not in told


MAKES = {"deadband": {"deadband": 3e4}, "rig": {"deadband": 0.0, "rig": (1.5e-5, 0.5)}}


def one_of(make: str, rest: float, noise: float) -> ForceData:
    lengths = np.linspace(1.0, 0.85, 6)
    return muscle_map(noise=noise, seed=5, lengths=lengths, rest=rest, **MAKES[make])


@pytest.fixture(scope="module", params=list(MAKES))
def chosen(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory):
    """The make, what is chosen of a map of it, and that from its file."""
    choice = fitting.choose(one_of(request.param, 0.25, noise=0.5))
    paths = write_fit(choice.chosen, tmp_path_factory.mktemp("fit"), choice=choice)
    return request.param, choice, load_fit(paths[0])


@pytest.mark.slow
@pytest.mark.parametrize("rest", [0.1, 0.5])
def test_the_band_holds_what_a_muscle_of_that_length_pulls(chosen, rest):
    make, _, saved = chosen
    data = one_of(make, rest, noise=0.0)
    held = []
    for length in np.unique(data.length):
        at = (data.length == length) & data.loaded
        rows = predict(saved, np.array([length]), data.pressure[at], rest_length=rest)
        assert {row["band"] for row in rows} == {"one specimen"}
        pairs = zip(rows, data.force[at], strict=True)
        held += [row["low_95_N"] <= force <= row["high_95_N"] for row, force in pairs]
    assert np.mean(held) > 0.9


@pytest.mark.slow
def test_a_prediction_is_the_mean_of_the_accounts(chosen):
    _, choice, saved = chosen
    known = choice.chosen.outlook.other_lengths
    assert len(saved.outlook.other_lengths) == len(known) > 1
    cut = [one.with_muscle(famjax.cut_to_length(one.muscle, 0.4)) for one in known.values()]
    forces = [float(one.force(0.36, 4e5)) for one in cut]
    (row,) = predict(saved, np.array([0.36]), np.array([4e5]), rest_length=0.4)
    assert row["force_N"] == pytest.approx(np.mean(forces), rel=1e-9)
    between = FROM_ONE * choice.data.max_force
    assert row["force_std_N"] == pytest.approx(np.hypot(np.std(forces), between), rel=1e-9)


def test_half_widths_are_those_of_student():
    freedoms = np.array([1, 1.5, 3, 4.5, 7, 30, 1e4])
    np.testing.assert_allclose(
        [student_factor(n) for n in freedoms], stdtrit(freedoms, 0.975), rtol=1e-9
    )

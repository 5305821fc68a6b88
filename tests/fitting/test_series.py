"""A series of muscles: a length never seen, predicted from two that were, with its error band."""

import dataclasses
import json
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from maps import cylinder

import famjax
import fitting
from fitting import ForceData, InputError, Parameter, identify_series, load_fit, predict, write_csv
from fitting.saved import series_as_dict
from fitting.series import Series
from fitting.verdict import judge_series

pytestmark = pytest.mark.slow
NOISE = 1.0  # N
LAWS = ("mooney-rivlin",)
SEEN, NEVER_SEEN = (0.09, 0.27), (0.12, 0.18, 0.35)


def in_rig(rest: float, values: jax.Array) -> famjax.MountedMuscle:
    """The truth, written down with no help of `cut_to_length`."""
    diameter, angle, compliance, *moduli = values
    shape = cylinder(diameter, jnp.degrees(angle), rest, 1.8e-3)
    law = famjax.materials.MooneyRivlinMaterial(*moduli)
    return famjax.MountedMuscle(famjax.Muscle(shape, law), compliance)


NAMES = ("braid_diameter", "braid_angle", "series_compliance", "C10", "C01")
TRUTH = jnp.array([0.012, math.radians(64), 1.1e-5, 0.5e6, 0.2e6])


def points(rest: float) -> tuple[np.ndarray, np.ndarray]:
    L, P = np.meshgrid(rest * np.linspace(1, 0.88, 4), np.linspace(1e5, 6e5, 6))
    return L.ravel(), P.ravel()


def specimen(rest: float, seed: int, stretch: float = 0.0) -> ForceData:
    """Readings in the rig; `stretch` [m] is how wrong the jig's lengths are."""
    L, P = points(rest)
    # Those that pull well in truth, so that all draws have one shape, and with it one compilation.
    keep = np.asarray(in_rig(rest, TRUTH).force(L, P)) > 15 * NOISE
    force = np.asarray(in_rig(rest, TRUTH).force(L + stretch, P))
    force = force + np.random.default_rng(seed).normal(0, NOISE, L.size)
    assert force[keep].min() > 0
    of = fitting.Specimen(f"{rest * 1e3:g} mm", rest, 1.8e-3, nominal_diameter=0.01, embedded=True)
    return ForceData(force[keep], P[keep], L[keep], of)


NO_DEADBAND = {"deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa")}


@pytest.fixture(scope="module")
def series() -> Series:
    maps = [specimen(rest, 7 + k) for k, rest in enumerate(SEEN)]
    return identify_series(maps, laws=LAWS, parameters=NO_DEADBAND)


@pytest.fixture(scope="module")
def saved(series: Series, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("series") / "fit.json"
    path.write_text(json.dumps(series_as_dict(series), allow_nan=False))
    return path


def test_the_family_that_transfers_is_chosen_and_the_truth_recovered(series):
    assert series.name == "mooney-rivlin, compliant rig"  # what the truth is
    assert series.law == "mooney-rivlin"
    assert series.weights[0] > 0.99  # of the rig that gives way
    assert list(series.candidates) == [one.candidate.name for one in series.tried]
    assert all(error > 0 for error in series.candidates.values())
    # The truth is recovered.
    first, second = series.specimens
    assert first.converged
    for name, truth in zip(NAMES, TRUTH, strict=True):
        assert first.estimate(name) == second.estimate(name)
        assert abs(first.estimate(name).value - truth) < 3.5 * first.estimate(name).stderr, name


@pytest.mark.parametrize("rest", NEVER_SEEN)
def test_a_length_never_seen_is_predicted_within_its_band(series, rest):
    L, P = points(rest)
    truth = np.asarray(in_rig(rest, TRUTH).force(L, P))
    force, std = series.predict(rest, L, P)
    assert np.sqrt(np.mean((force - truth) ** 2)) < 2 * NOISE
    assert (np.abs(force - truth) < 2 * std).mean() > 0.9
    assert std.max() < 10 * NOISE  # the band says something


def test_the_saved_series_predicts_the_same(series, saved):
    fit = load_fit(saved)
    lengths = np.array([0.125, 0.12, 0.09])
    rows = predict(fit, lengths, np.array([4e5]), rest_length=0.125, onset=True)
    force, std = series.predict(0.125, lengths, np.full(3, 4e5))
    np.testing.assert_allclose([r["model_force_N"] for r in rows[:3]], force, rtol=1e-9)
    np.testing.assert_allclose([r["force_std_N"] for r in rows[:3]], std, rtol=1e-9)
    assert rows[0]["band"] == "linear, specimens"
    assert [row["inside"] for row in rows[:3]] == [True, True, False]
    assert rows[0]["high_95_N"] - rows[0]["low_95_N"] == pytest.approx(3.92 * std[0])
    assert 0 < rows[4]["onset_pressure_Pa"] < 4e5  # shorter than at rest: pressure is needed
    assert not predict(fit, lengths, np.array([4e5]), rest_length=0.4)[0]["inside"]
    with pytest.raises(InputError, match="the rest length must be > 0"):
        predict(fit, lengths, np.array([4e5]), rest_length=0.0)


@pytest.mark.parametrize(
    ("maps", "options", "words"),
    [
        ((0.1,), {}, "at least two specimens, got 1"),
        ((0.1, 0.2), {"laws": ("spam",)}, "the law must be one of polynomial"),
        ((0.1, 0.2), {"laws": ()}, "needs a law, such as linear"),
        ((0.1, 0.2), {"laws": ("linear", "linear")}, "listed only once, but one of .*linear.* is"),
        ((0.1, 0.1), {}, "contain no information about other"),
        ((0.1, 0.2), {"parameters": {"rest_length": Parameter()}}, "rest_length cannot be shared"),
        ((0.1, 0.2), {"parameters": {"end_length": Parameter(), "end_factor": Parameter()}},
         "describe the same quantity"),
    ],
)  # fmt: skip
def test_what_is_no_series_is_refused(maps, options, words):
    data = [specimen(rest, seed) for seed, rest in enumerate(maps)]
    named = [
        dataclasses.replace(one, specimen=dataclasses.replace(one.specimen, name=f"{k}"))
        for k, one in enumerate(data)
    ]
    with pytest.raises(InputError, match=words):
        identify_series(named, **options)


def test_the_command_reads_the_maps_and_its_file_predicts(said, tmp_path, series, monkeypatch):
    """The identification itself, a minute of it, is that of the fixture."""
    given: list[ForceData] = []

    def identified(data: list[ForceData], **options: object) -> Series:
        given.extend(data)
        assert options["laws"] == LAWS
        return series

    monkeypatch.setattr(fitting, "identify_series", identified)
    meant = [specimen(rest, 7 + k) for k, rest in enumerate(SEEN)]
    maps = [write_csv(one, tmp_path / f"{k}.csv", "metric") for k, one in enumerate(meant)]
    fit = tmp_path / "out" / "fit.json"
    table = said("series", *maps, "--law", *LAWS, "--output", fit.parent)
    assert "mooney-rivlin" in table
    assert "rest length mm" in table
    assert any(line.split()[:1] == ["braid_angle"] and "deg" in line for line in table.splitlines())
    for read, one in zip(given, meant, strict=True):
        np.testing.assert_allclose(read.force, one.force, rtol=1e-9)
        np.testing.assert_allclose(read.length, one.length, rtol=1e-9)
        assert read.specimen.name == one.specimen.name
    asked = ("--length", "170mm", "--pressure", "400kPa")
    (row,) = json.loads(said("predict", fit, "--rest-length", "180mm", *asked, "--json"))
    truth = float(in_rig(0.18, TRUTH).force(0.17, 4e5))
    assert abs(row["force_N"] - truth) < 2 * NOISE
    assert row["low_95_N"] < truth < row["high_95_N"]
    out = said("predict", fit, "--length", "95mm", "--pressure", "400kPa")
    assert f"{1e3 * SEEN[0]:.4g} mm; choose another rest length with --rest-length" in out


def test_its_verdict_is_that_of_all_specimens(series, saved):
    judged = judge_series(series.specimens, series.left_out)
    assert judged.passed
    assert json.loads(saved.read_text())["verdict"] == judged.level
    in_lbf = specimen(SEEN[1], 8)
    in_lbf = dataclasses.replace(in_lbf, force=in_lbf.force / 4.448)
    wrong = identify_series([specimen(SEEN[0], 7), in_lbf], laws=LAWS)
    judged = judge_series(wrong.specimens, wrong.left_out)
    assert not judged.passed
    assert "270 mm" in judged.reasons[0] or "90 mm" in judged.reasons[0]
    assert "another make" in judged.reasons[0]

"""Raw ramps in, both branches out: `famjax ramps`, `fit`, `assess --hysteresis`, `predict --history`."""

import json
from pathlib import Path

import numpy as np
import pytest
from maps import known_muscle
from processes import command

import famjax
from famjax.slip import MaxwellSlip, SlipElements
from fitting import load_fit
from fitting.prediction import predict_history, static_rows
from fitting.records import History

# For the fit that all of these read, which then only one stage of CI makes.
pytestmark = pytest.mark.slow
REST, TOP, ZERO = 0.3, 6e5, 9e3
SLIP = MaxwellSlip(SlipElements([0.01], [6.0]), SlipElements([0.004], [12.0]), REST, 1e6)
PRESSURES = (0.0, 4e5, TOP, 4e5, 5e5, 4e5)  # fill, vent, and a minor loop


def _muscle() -> famjax.Muscle:
    return known_muscle(famjax.PolynomialMaterial([3e6, -2e6]), 2e4)


@pytest.fixture(scope="module")
def records(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Continuous ramps at four lengths, with what the pressure sensor reads at atmosphere."""
    folder, entries = tmp_path_factory.mktemp("ramps"), []
    rng = np.random.default_rng(3)
    P = np.concatenate([np.linspace(0, TOP, 1200), np.linspace(TOP, 0, 1200)])
    for length in (0.3, 0.288, 0.276, 0.264):
        L = np.full(P.size, length)
        F = np.asarray(_muscle().force(L, P)) + np.asarray(SLIP.along(L, P))
        F = np.maximum(F, 0.0) + 0.02 * rng.normal(size=F.size)
        rows = np.stack([0.01 * np.arange(P.size), (P + ZERO) / 1e3, F], axis=1)
        path = folder / f"at{1e3 * length:.0f}.csv"
        np.savetxt(path, rows, "%.6f", ",", header="time_s,pressure_kPa,force_N", comments="")
        entries.append(f"{path}={1e3 * length:g}mm")
    return entries


@pytest.fixture(scope="module")
def fitted(records: list[str], tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fit")
    known = ("rest_length_mm=300", "nominal_diameter_mm=20", "wall_thickness_mm=2")
    specimen = [word for one in known for word in ("--specimen", one)]
    for words in (
        ["ramps", *records, "--atmosphere", f"{ZERO}Pa", *specimen],
        ["fit", folder / "map.csv", "--order", "2"],
        ["assess", folder / "fit.json", "--hysteresis", folder / "branches.csv"],
    ):
        command(*words, "--output", folder)
    return folder


def test_the_fit_holds_the_hysteresis_and_the_band_its_error(fitted):
    document = json.loads((fitted / "fit.json").read_text())["hysteresis"]
    assert document["duality_gap"] < 1e-10
    # The lowest point of each record is at the kink where the muscle turns slack.
    assert document["rms_N"] < 0.12 * document["measured_rms_N"]
    assert document["left_out"]["length"]["ratio"] < 0.3
    assert "Hysteresis: half-difference" in (fitted / "report.html").read_text()
    fit = load_fit(fitted / "fit.json")
    assert fit.outlook.hysteresis is not None
    missed = max(one["rms_N"] for one in document["left_out"].values())
    L, P = np.full(6, 0.27), np.array(PRESSURES)
    rows, static = predict_history(fit, History(L, P)), static_rows(fit, L, P)
    for row, alone in zip(rows[1:], static[1:], strict=True):
        half = (row["high_95_N"] - row["low_95_N"]) / 2
        own = (alone["high_95_N"] - alone["low_95_N"]) / 2
        assert half == pytest.approx(np.hypot(own, 1.96 * missed), rel=1e-9)
        assert row["force_std_N"] == pytest.approx(np.hypot(alone["force_std_N"], missed), rel=1e-9)
        assert (row["high_95_N"] + row["low_95_N"]) / 2 == pytest.approx(row["force_N"], rel=1e-9)


def test_both_branches_are_predicted(said, fitted, tmp_path):
    path = tmp_path / "history.csv"
    rows = [f"{k},270,{P / 1e3}" for k, P in enumerate(PRESSURES)]
    path.write_text("\n".join(["time_s,length_mm,pressure_kPa", *rows]) + "\n")
    asked = "predict", fitted / "fit.json", "--history", path
    got = json.loads(said(*asked, "--json"))
    force, static = (np.array([row[key] for row in got]) for key in ("force_N", "static_force_N"))
    assert [row["time_s"] for row in got] == [0, 1, 2, 3, 4, 5]
    L, P = np.full(6, 0.27), np.array(PRESSURES)  # a length between those of the records
    true = np.asarray(_muscle().force(L, P)) + np.asarray(SLIP.along(L, P))
    np.testing.assert_allclose(force[1:], true[1:], atol=0.01 * true.max())
    assert (force[3] - force[1]) / 2 == pytest.approx((true[3] - true[1]) / 2, rel=0.1)
    assert (force[3] + force[1]) / 2 == pytest.approx(static[1], rel=1e-3)
    assert force[5] == pytest.approx(force[3], rel=1e-9)  # the minor loop leaves no trace
    table = " ".join(said(*asked).split())
    for words in (
        "Force along the history", "the force of a slack muscle is zero", "270 400",
        "length mm pressure kPa force N static force N hysteresis N",
    ):  # fmt: skip
        assert words in table

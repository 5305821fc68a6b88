"""Bands of a length that was never measured: what the field trials found wrong, on the same readings."""

import json
from pathlib import Path

import numpy as np
import pytest

from famjax.__main__ import main
from fitting import ForceData, write_csv

LEFT_OUT = 0.267  # m
PRESSURES = np.array([150, 250, 350, 450, 525, 600, 675]) * 1e3


@pytest.fixture(scope="module")
def without_a_length(dmsp20: ForceData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map as a file, in which one length is not there."""
    path = tmp_path_factory.mktemp("map") / "map.csv"
    write_csv(dmsp20.part(np.abs(dmsp20.length - LEFT_OUT) >= 1e-6), path, system="metric")
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("options", "widest"), [((), 130.0), (("--law", "polynomial"), 240.0)])
def test_a_length_left_out_lies_in_its_band(
    dmsp20: ForceData,
    without_a_length: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture,
    options: tuple[str, ...],
    widest: float,
) -> None:
    """Bands of +-5 N covered 0 of 7 readings, and bands of +-185 N said nothing."""
    with pytest.raises(SystemExit) as stop:
        main(["fit", str(without_a_length), *options, "--output", str(tmp_path)])
    assert stop.value.code in (None, 0)
    capsys.readouterr()
    asked = ",".join(f"{P:.0f}Pa" for P in PRESSURES)
    with pytest.raises(SystemExit):
        main(["predict", str(tmp_path / "fit.json"), "--length", f"{LEFT_OUT}m", "--pressure",
              asked, "--json"])  # fmt: skip
    rows = json.loads(capsys.readouterr().out)
    at = np.abs(dmsp20.length - LEFT_OUT) < 1e-6
    measured = np.interp(PRESSURES, dmsp20.pressure[at], dmsp20.force[at])
    inside = [
        row["low_95_N"] <= F <= row["high_95_N"] for row, F in zip(rows, measured, strict=True)
    ]
    widths = [row["high_95_N"] - row["low_95_N"] for row in rows]
    assert sum(inside) >= 6
    assert max(widths) < widest
    assert all(row["band"] == "left out" for row in rows)


@pytest.mark.slow
def test_a_band_grows_with_the_distance_and_says_what_it_covers(
    without_a_length: Path, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    with pytest.raises(SystemExit):
        main(["fit", str(without_a_length), "--law", "ogden", "--output", str(tmp_path)])
    said = capsys.readouterr().out
    assert "Bands of predictions, 95 %, are of single readings" in said
    with pytest.raises(SystemExit):
        main(["predict", str(tmp_path / "fit.json"), "--length", "280mm,225mm,340mm,100mm",
              "--pressure", "500kPa,900kPa", "--json"])  # fmt: skip
    rows = {
        (row["length_m"], row["pressure_Pa"]): row for row in json.loads(capsys.readouterr().out)
    }

    def std(length: float, pressure: float) -> float:
        return rows[length, pressure]["force_std_N"]

    assert std(0.28, 5e5) < std(0.225, 5e5)
    assert std(0.28, 5e5) < std(0.28, 9e5)
    assert rows[0.28, 5e5]["outside"] is None
    assert "thread" in rows[0.34, 5e5]["outside"]
    assert rows[0.34, 5e5]["force_N"] is None
    assert rows[0.34, 5e5]["band"] is None
    assert "pressure" in rows[0.28, 9e5]["outside"]
    with pytest.raises(SystemExit):
        main(["predict", str(tmp_path / "fit.json"), "--length", "340mm", "--pressure", "5bar"])
    assert "no standard errors" not in capsys.readouterr().out


@pytest.mark.slow
def test_three_lengths_are_fitted_and_bounded_by_a_prior(
    dmsp10: ForceData, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A law of three coefficients refused such a map; the band now says that it is a prior's."""
    level = dmsp10.lengths.level
    lengths = np.unique(level[dmsp10.loaded])[-3:]
    path = write_csv(dmsp10.part(level >= lengths[0]), tmp_path / "three.csv", system="metric")
    with pytest.raises(SystemExit) as stop:
        main(["fit", str(path), "--output", str(tmp_path)])
    assert stop.value.code in (None, 0)
    said = " ".join(capsys.readouterr().out.split())
    assert "too few lengths to leave one out" in said
    assert "were left out" in said


@pytest.mark.slow
def test_an_onset_lies_between_the_readings_at_its_length(
    dmsp10: ForceData, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    """A slack reading is not thrown away: at 250 mm the model alone begins 10 kPa below one."""
    with pytest.raises(SystemExit):
        main(["fit", "DMSP-10-250", "--law", "ogden", "--free", "braid_compliance",
              "--output", str(tmp_path)])  # fmt: skip
    capsys.readouterr()
    at = np.abs(dmsp10.length - 0.25) < 1e-6
    slack = dmsp10.pressure[at & ~dmsp10.loaded].max()
    pulls = dmsp10.pressure[at & dmsp10.loaded].min()
    with pytest.raises(SystemExit):
        main(
            ["predict", str(tmp_path / "fit.json"), "--length", "250mm,240mm", "--onset", "--json"]
        )
    measured, between = json.loads(capsys.readouterr().out)
    assert measured["slack_up_to_Pa"] == pytest.approx(slack)
    assert measured["pulls_from_Pa"] == pytest.approx(pulls)
    assert slack <= measured["onset_pressure_Pa"] <= pulls
    assert between["slack_up_to_Pa"] is None
    assert between["onset_pressure_Pa"] > measured["onset_pressure_Pa"]

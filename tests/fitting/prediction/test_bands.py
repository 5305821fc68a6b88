"""Bands of a length that was never measured: what the field trials found wrong, on the same readings."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from famjax.__main__ import main
from fitting import ForceData, write_csv

pytestmark = pytest.mark.slow
LEFT_OUT = 0.267  # m
PRESSURES = np.array([150, 250, 350, 450, 525, 600, 675]) * 1e3


@pytest.fixture
def command(capsys: pytest.CaptureFixture) -> Callable[..., str]:
    """What a command prints that ends well."""

    def run(*arguments: str | Path) -> str:
        with pytest.raises(SystemExit) as stop:
            main([str(one) for one in arguments])
        assert stop.value.code in (None, 0)
        return capsys.readouterr().out

    return run


@pytest.fixture(scope="module")
def without_a_length(dmsp20: ForceData, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The map as a file, in which one length is not there."""
    path = tmp_path_factory.mktemp("map") / "map.csv"
    write_csv(dmsp20.part(np.abs(dmsp20.length - LEFT_OUT) >= 1e-6), path, system="metric")
    return path


@pytest.mark.parametrize(("options", "widest"), [((), 130.0), (("--law", "polynomial"), 240.0)])
def test_a_length_left_out_lies_in_its_band(
    dmsp20: ForceData,
    without_a_length: Path,
    tmp_path: Path,
    command: Callable[..., str],
    options: tuple[str, ...],
    widest: float,
) -> None:
    """Bands of +-5 N covered 0 of 7 readings, and bands of +-185 N said nothing."""
    command("fit", without_a_length, *options, "--output", tmp_path)
    asked = ",".join(f"{P:.0f}Pa" for P in PRESSURES)
    state = "--length", f"{LEFT_OUT}m", "--pressure", asked
    rows = json.loads(command("predict", tmp_path / "fit.json", *state, "--json"))
    at = np.abs(dmsp20.length - LEFT_OUT) < 1e-6
    measured = np.interp(PRESSURES, dmsp20.pressure[at], dmsp20.force[at])
    low, high = (np.array([row[key] for row in rows]) for key in ("low_95_N", "high_95_N"))
    assert ((low <= measured) & (measured <= high)).sum() >= 6
    assert (high - low).max() < widest
    assert all(row["band"] == "left out" for row in rows)


def test_a_band_grows_with_the_distance_and_says_what_it_covers(
    without_a_length: Path, tmp_path: Path, command: Callable[..., str]
) -> None:
    said = command("fit", without_a_length, "--law", "ogden", "--output", tmp_path, "--verbose")
    assert "The 95 % bands of predictions are of single readings" in said
    states = "--length", "280mm,225mm,340mm,100mm", "--pressure", "500kPa,900kPa"
    found = json.loads(command("predict", tmp_path / "fit.json", *states, "--json"))
    rows = {(row["length_m"], row["pressure_Pa"]): row for row in found}
    std = {at: row["force_std_N"] for at, row in rows.items()}
    assert std[0.28, 5e5] < std[0.225, 5e5]
    assert std[0.28, 5e5] < std[0.28, 9e5]
    assert rows[0.28, 5e5]["outside"] is None
    assert "thread" in rows[0.34, 5e5]["outside"]
    assert rows[0.34, 5e5]["force_N"] is None
    assert rows[0.34, 5e5]["band"] is None
    assert "pressure" in rows[0.28, 9e5]["outside"]
    said = command("predict", tmp_path / "fit.json", "--length", "340mm", "--pressure", "5bar")
    assert "no standard errors" not in said

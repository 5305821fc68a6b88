import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

PLAN = """
[circuit]
fluid = "air"
supply_kPa = 700
[load]
length_mm = 285
mass_kg = 20
damping_N_s_per_m = 200
[controller]
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
[[step]]
duration_s = 1.5
set_pressure_kPa = 300
[[step]]
duration_s = 0.5
set_pressure_kPa = 200
"""


@pytest.mark.slow
def test_a_bundled_muscle_lifts_a_mass(run: Callable, tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN)
    asked = ("simulate", "DMSP-20", plan, "-o", tmp_path / "out")
    code, out, _ = run(*asked, "--json")
    assert code == 0
    first, second = json.loads(out)["steps"]
    assert first["pressure_Pa"] == pytest.approx(300e3, rel=0.06)
    assert first["force_N"] == pytest.approx(20 * 9.80665, rel=0.02)
    assert second["length_m"] > first["length_m"]
    table = np.genfromtxt(tmp_path / "out/simulation.csv", delimiter=",", names=True)
    assert table.dtype.names == ("time_s", "pressure_kPa", "length_mm", "force_N")
    assert table["time_s"] == pytest.approx(0.01 * np.arange(1, 201))
    assert (tmp_path / "out/simulation.svg").stat().st_size > 5000


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"air"', '"oil"', "fluid must be 'air' or 'water', got 'oil'"),
        ("supply_kPa = 700", "supply_kPa = -7", "supply must be finite and at least 0 Pa"),
        ("[load]", "[lode]", "unknown table 'lode'"),
        ("set_pressure_kPa = 200", "signal = 0.5", "all with a signal, or all with a set pressure"),
        ("[controller]", "[friction]", "proportional_counts_per_psi is missing"),
        ("set_pressure_kPa = 200", "set_pressure_kPa = 200\nvalve = 1", "[[step]] 2: unknown key"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_a_sentence(
    old: str, new: str, said: str, run: Callable, tmp_path: Path
) -> None:
    plan = tmp_path / "plan.toml"
    plan.write_text(PLAN.replace(old, new))
    code, _, err = run("simulate", "DMSP-20", plan, "-o", tmp_path / "out")
    assert code == 2
    assert said in err
    assert not (tmp_path / "out").exists()

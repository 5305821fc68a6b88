import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest


@pytest.mark.slow
def test_the_shape_of_a_bundled_muscle(run: Callable, tmp_path: Path) -> None:
    asked = ("shape", "DMSP-20", "--pressure", "500kPa", "-o", tmp_path / "shape")
    code, out, _ = run(*asked, "--length", "270mm", "--json")
    assert code == 0
    found = json.loads(out)
    assert 200 < found["force_N"] < 1600
    names = (tmp_path / "shape/shape.csv").read_text().partition("\n")[0].split(",")
    assert {"position_mm", "diameter_mm", "braid_angle_deg", "thread_tension_N"} <= {*names}
    table = np.genfromtxt(tmp_path / "shape/shape.csv", delimiter=",", names=True)
    assert table["position_mm"][-1] == pytest.approx(270, abs=1e-6)
    assert max(table["diameter_mm"]) == pytest.approx(1e3 * found["largest_diameter_m"])
    code, _, err = run(*asked, "--length", "900mm")
    assert code == 2
    assert "no stable shape" in err

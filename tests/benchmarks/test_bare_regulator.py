"""The bare regulator that the reference work's controller is compared with."""

import sys
from pathlib import Path

import numpy as np
import pytest

from rig import RigError
from rig.simulation import mckibben

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
from bare_regulator import Regulator  # pyright: ignore[reportMissingImports]

sys.path.pop(0)

PSI = 6894.757293168361
ATMOSPHERE = 101325.0
V = 90e-6  # m3, about the 7/8 in muscle


def test_a_bare_regulator_droops_and_relieves_as_stated() -> None:
    c = Regulator(60 * PSI)
    for rate in (2e-6, -2e-6):
        run = c.start()
        run.pressure = 60 * PSI
        for _ in range(20_000):
            run.step(0, False, V, rate, 0.0, 1e-3)  # constant volume: its loss is flow alone
        flow_anr = (run.pressure + ATMOSPHERE) * abs(rate) / 1e5
        if rate > 0:
            assert run.pressure == pytest.approx(60 * PSI - c.feed_droop * flow_anr, abs=1)
        else:
            assert run.pressure == pytest.approx(
                63 * PSI + c.relief_droop * flow_anr, abs=1
            )  # beyond the dead zone of 3 psi


def test_the_same_muscle_on_a_regulator_swings_by_several_psi() -> None:
    muscle = mckibben()
    run = Regulator(60 * PSI).start()
    length, P = muscle.rest_length, []
    for k in range(150_000):
        speed = -0.508e-3 if k < 75_000 else 0.508e-3  # 0.02 in/s
        _, volume, area, give = muscle.at(length, run.pressure)
        run.step(0, False, volume, area * speed, give, 2e-3)
        length += speed * 2e-3
        if k > 5000:
            P.append(run.pressure / PSI)
    assert 4 < np.ptp(P) < 12  # figures 3.3 and 3.4: up to 8 psi


def test_a_setting_is_a_pressure() -> None:
    with pytest.raises(RigError, match="set_pressure"):
        Regulator(0.0)

"""`famjax rig acknowledge`: a trip is cleared by a person alone, who has seen why."""

import itertools
from pathlib import Path

import pytest
from rig_commands import calibrated, run

from rig.control import Control, Rig
from rig.errors import RigError
from rig.fault import RigFault
from rig.link import VirtualLink
from rig.protocol import SAFE, TRIP
from rig.simulation import PneumaticCircuit, SimulatedRig

PSI = 6894.757293168361


def opened(sim: SimulatedRig) -> Rig:
    return Rig(
        VirtualLink(sim), sim.calibration(), pressure_limit=110 * PSI, control=Control.per_psi(4, 2)
    )


@pytest.fixture
def tripped(monkeypatch: pytest.MonkeyPatch) -> SimulatedRig:
    """A rig whose transducer was unplugged under pressure, and is plugged in again."""
    sim = SimulatedRig(PneumaticCircuit())
    with pytest.raises(RigFault, match="1023 counts"), opened(sim) as rig:  # noqa: PT012
        rig.set_pressure(20 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 1023
        rig.wait(2.0)
    assert sim.device.state == TRIP
    sim.sensor_fault = None
    sim.advance(5.0)
    sim.read()
    first = itertools.count(1000, 1000)  # a link numbers its commands from a number of its own
    monkeypatch.setattr("rig.Link", lambda opener: VirtualLink(sim, next(first)))
    return sim


def test_nothing_runs_before_a_trip_is_acknowledged(tripped: SimulatedRig) -> None:
    with (
        pytest.raises(
            RigError, match=r"the device is tripped: .* at 1023 counts .*rig acknowledge"
        ),
        opened(tripped),
    ):
        pass
    assert tripped.device.state == TRIP


def test_a_person_s_yes_clears_it(
    tripped: SimulatedRig, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    calibrated(tmp_path)
    words = ("acknowledge", "none", "--calibration", tmp_path / "calibration.toml")
    code, out, err = run(capsys, *words)
    assert code == 2
    assert "at 1023 counts (" in out
    assert "give --yes" in err
    assert tripped.device.state == TRIP
    code, out, _ = run(capsys, *words, "--yes")
    assert code == 0
    assert "acknowledged" in out
    assert tripped.device.state == SAFE
    assert "is not tripped" in run(capsys, *words)[1]


def test_a_trip_whose_cause_is_still_there_is_not_cleared(
    tripped: SimulatedRig, capsys: pytest.CaptureFixture
) -> None:
    tripped.sensor_fault = 1023
    code, _, err = run(capsys, "acknowledge", "none", "--yes")
    assert code == 2
    assert "refuses 'clear'" in err
    assert tripped.device.state == TRIP

"""Before the first pressure: limits of the reading, a tripped device, a transducer that cannot be right."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

from pathlib import Path

import pytest
from rig_commands import calibrated, write_plan

from rig import Journal, Rig, read_journal
from rig.calibration import Calibration, FeedForward, Sensor, write_calibration
from rig.control import Control, Guards, acknowledge, floor_counts, trip_text, unseen
from rig.device import Device
from rig.errors import RigError, RigFault
from rig.execution import prepare
from rig.link import VirtualLink
from rig.plan import read_plan
from rig.protocol import FAULTS, SAFE, TRIP, DeviceStatus
from rig.simulation import SimulatedRig, SimulatedSensor, load_cell, pressure_transducer

PSI = 6894.757293168361
GAINS = Control.per_psi(4, 2)
LIVE = Calibration(pressure_transducer().calibration(), load_cell().calibration())
ZERO_TO_FIVE = SimulatedSensor(0.0, 200 * PSI, 0.25 * PSI, 0.01, low_volts=0.0, high_volts=5.0)


def _rig(sim: SimulatedRig, journal: Journal | None = None, **changes: object) -> Rig:
    settings = {"pressure_limit": 110 * PSI, "control": GAINS, "journal": journal, **changes}
    return Rig(VirtualLink(sim), sim.calibration(), **settings)


def test_a_transducer_with_a_live_zero_has_a_floor_and_one_without_has_none() -> None:
    assert floor_counts(LIVE) == 61
    dead = Calibration(ZERO_TO_FIVE.calibration(), load_cell().calibration())
    assert floor_counts(dead) == 0
    assert unseen(LIVE, alive=True) == []
    assert "cannot have a floor" in unseen(dead, alive=True)[0]
    assert "hardly varies" in unseen(LIVE, alive=False)[0]


def test_what_governs_is_in_the_journal(tmp_path: Path) -> None:
    sim = SimulatedRig()
    path = tmp_path / "run.fam"
    guards = Guards(floor=70, ceiling=950, still=0.8, frozen_output=6, frozen=0.5, stall=2.0)
    with (
        Journal(path, lambda: sim.now, reserve_bytes=0) as journal,
        _rig(sim, journal, guards=guards) as rig,
    ):
        rig.wait(0.1)
    record = read_journal(path)
    settings = record.settings[-1][1]
    assert (settings.floor, settings.ceiling, settings.still) == (70, 950, 400)
    assert (settings.frozen, settings.frozen_ticks, settings.stall) == (6, 250, 1000)
    (note,) = record.notes_of("rig")
    assert note["guards"]["frozen_output"] == 6
    assert note["unseen"] == []


def test_a_trip_is_said_with_its_reading_and_kept_in_the_journal(tmp_path: Path) -> None:
    sim = SimulatedRig()
    path = tmp_path / "run.fam"
    with (
        Journal(path, lambda: sim.now, reserve_bytes=0) as journal,
        pytest.raises(RigFault, match=r"range at 3 counts \(-24.15 psi\), output \d+; it has"),
        _rig(sim, journal) as rig,
    ):
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 3
        rig.wait(1.0)
    (note,) = read_journal(path).notes_of("fault")
    assert (note["cause"], note["counts"]) == ("range", 3)
    assert note["tick"] > 1000


def test_no_program_acknowledges_but_a_person_may(tmp_path: Path) -> None:
    eeprom = bytearray(6)
    sim = SimulatedRig(device=Device(eeprom))
    with pytest.raises(RigFault, match="TRIP"), _rig(sim) as rig:
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 3
        rig.wait(1.0)
    sim.sensor_fault = None
    for again in (
        sim,
        SimulatedRig(device=Device(eeprom)),
    ):  # connected again, and switched on again
        with pytest.raises(RigError, match=r"is tripped: range at 3 counts .*then acknowledge"):
            _rig(again).__enter__()
        assert again.device.state == TRIP
    link = VirtualLink(again)
    acknowledge(link, again.calibration())
    assert again.device.state == SAFE
    with _rig(again) as rig:
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)


def test_an_acknowledgement_is_refused_while_the_cause_lasts() -> None:
    sim = SimulatedRig()
    with pytest.raises(RigFault, match="TRIP"), _rig(sim) as rig:
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 3
        rig.wait(1.0)
    with pytest.raises(RigError, match="refuses 'clear': reading out of range"):
        acknowledge(VirtualLink(sim))


@pytest.mark.parametrize("stuck_psi", [-12.0, 8.0, 37.0])
def test_a_pressure_that_does_not_vent_is_refused(stuck_psi: float) -> None:
    sim = SimulatedRig()
    sim.sensor_fault = sim.pressure_sensor.counts(stuck_psi * PSI)
    with pytest.raises(RigError, match="with the dump valve open: it is stuck"):
        _rig(sim).__enter__()
    assert sim.device.state == SAFE


def test_a_limit_above_the_compiled_ceiling_is_refused() -> None:
    sim = SimulatedRig(device=Device(trip_ceiling=500))
    with pytest.raises(RigError, match=r"refuses 'trip 552': above the compiled-in ceiling"):
        _rig(sim).__enter__()


@pytest.mark.parametrize(
    ("guards", "what"),
    [
        (Guards(floor=103), "floor must lie below the 102 counts"),
        (Guards(ceiling=500), "limit of 552 counts must not exceed the ceiling"),
    ],
)
def test_guards_that_leave_no_reading_are_refused(guards: Guards, what: str) -> None:
    with pytest.raises(RigError, match=what):
        guards.commands(LIVE, 552)


def test_a_plan_may_set_the_guards(tmp_path: Path) -> None:
    path = write_plan(tmp_path, limit="pressure_limit_psi = 110\nstill_s = 1.5\nfrozen_ms = 500")
    test = read_plan(path)
    assert (test.guards.still, test.guards.frozen, test.guards.floor) == (1.5, 0.5, None)
    path = write_plan(tmp_path, limit="pressure_limit_psi = 110\nreading_floor_counts = 2000")
    with pytest.raises(RigError, match="floor"):
        read_plan(path)


def test_water_with_the_bias_of_an_air_valve_is_refused(tmp_path: Path) -> None:
    path = calibrated(tmp_path, circuit="water", pressures="10")
    with pytest.raises(RigError, match="water circuit needs a feed-forward"):
        prepare(read_plan(path), tmp_path / "out")
    rising = FeedForward((20.0, 100.0, 0.0, 0.0), 7e5)
    write_calibration(tmp_path / "calibration.toml", Calibration(LIVE.pressure, LIVE.force, rising))
    prepare(read_plan(path), tmp_path / "out")


def test_every_trip_can_be_told() -> None:
    sensor = Calibration(Sensor(1e3, 500.0), Sensor(1.0, 0.0))
    for fault in range(2, len(FAULTS)):
        text = trip_text(
            DeviceStatus(1, 1, 1, TRIP, fault, 0, 0, 0, 0, 0, 0, 9, 200, 131, 0), sensor
        )
        assert text.startswith(f"{FAULTS[fault]} at 200 counts (72.52 psi), output 131; ")
        assert not text.endswith("; ")

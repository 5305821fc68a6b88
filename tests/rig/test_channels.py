"""Before the first pressure, and under it: foreign boards, exchanged channels, readings that cannot be."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import dataclasses

import pytest
from benches import PSI, Watched, Wired, opened, recorded

from famjax.plant import LinearMcKibben
from rig import read_journal
from rig.calibration import Calibration
from rig.channels import FlowWatch, floor_counts, numbered, unseen
from rig.control import acknowledge
from rig.device import Device
from rig.errors import RigError, RigFault
from rig.execution import run
from rig.link import VirtualLink
from rig.plan import Isobaric
from rig.protocol import RUN, SAFE, TRIP, Sample
from rig.simulation import (
    HydraulicCircuit,
    PneumaticCircuit,
    SimulatedRig,
    SimulatedSensor,
    load_cell,
    pressure_transducer,
)

LIVE = Calibration(pressure_transducer().calibration(), load_cell().calibration())
ZERO_TO_FIVE = SimulatedSensor(0.0, 200 * PSI, 0.25 * PSI, 0.01, low_volts=0.0, high_volts=5.0)


def exchanged():
    """A board with the plugs of transducer and load cell exchanged."""
    return Wired(lambda pressure, force: (force, pressure))


def stuck(at_psi):
    counts = pressure_transducer().counts(at_psi * PSI)
    return Wired(lambda _, force: (counts, force))


def cell(limit_psi):
    """A load cell with its zero at 0.5 V, for the pull at 1.2 times a limit."""
    pull = 1.2 * float(LinearMcKibben().blocked_force(limit_psi * PSI))
    return SimulatedSensor(0.0, pull, 2.0)


@pytest.mark.parametrize(
    ("sensor", "set_psi", "limit_psi"),
    [(load_cell(), 15, 30), (load_cell(), 40, 60), (cell(30), 15, 30), (cell(60), 40, 60)],
)
def test_exchanged_channels_are_refused_before_5_psi(sensor, set_psi, limit_psi):
    sim = Watched(device=exchanged(), force_sensor=sensor)
    limit = limit_psi * PSI
    with pytest.raises(RigError, match="exchanged"), opened(sim, pressure_limit=limit) as rig:
        rig.set_pressure(set_psi * PSI)
    assert sim.peak < 5
    assert sim.device.state == SAFE


@pytest.mark.parametrize("circuit", [PneumaticCircuit(leak=0.0), HydraulicCircuit()])
@pytest.mark.parametrize("sensor", [load_cell(), cell(30)])
def test_sound_channels_pass_below_5_psi(circuit, sensor):
    sim = Watched(circuit, force_sensor=sensor, seed=3)
    with opened(sim) as rig:
        assert sim.peak < 5
        rig.set_pressure(20 * PSI)
        rig.wait(2.0)
        assert sim.device.state == RUN


def test_exchanged_channels_that_the_first_fluid_does_not_show_stop_the_run():
    """No deadband, and zeros alike: the load is then held, the pressure rises as the muscle shortens."""
    muscle = LinearMcKibben(deadband_pressure=0.0)
    sim = Watched(None, muscle, device=exchanged(), force_sensor=cell(60))
    plan, words = Isobaric((20 * PSI,), 1, 0.05, 0.0025, settle=8.0), "the load rises while"
    with pytest.raises(RigFault, match=words), opened(sim, pressure_limit=60 * PSI) as rig:
        run(rig, plan, machine=sim.machine)
    assert sim.device.state == SAFE
    assert sim.peak < 60


@pytest.mark.parametrize(("slope", "says"), [(0.2, True), (-0.2, False), (0.0, False)])
def test_the_watch_says_nothing_of_a_muscle_that_shortens_as_it_fills(slope, says):
    watch, said = FlowWatch(), False
    for k in range(400):
        load, output = 400 + slope * max(k - 100, 0), 130 + 20 * (k > 100)
        record = Sample(0, k, 5 * k, 1000, 200, round(5 * load), output, 0, RUN)
        said = watch.contradicts(record, held=True) or said
    assert said == says


class Deaf(Device):
    """Acknowledges `hbms` and keeps another one."""

    def feed(self, data):
        super().feed(data)
        self._control.silent = 5000


VENT = "with the dump valve open: it is stuck"


@pytest.mark.parametrize(
    ("parts", "kind", "words"),
    [
        ({"circuit": PneumaticCircuit(supply=1.0)}, RigError, "moved neither pressure nor load"),
        ({"circuit": HydraulicCircuit(displacement=1e-12)}, RigError, "moved neither pressure"),
        ({"device": Deaf()}, RigFault, "has not taken its settings: silence 5000 not 500"),
        *[({"device": stuck(psi)}, RigError, VENT) for psi in (-12.0, 4.0, 37.0)],
        ({"device": Wired(lambda p, _: (p, 0))}, RigError, "cell reads 0 counts with the dump"),
        ({"device": Wired(lambda p, _: (p, 1023))}, RigError, "cell reads 1023 counts with the"),
        ({"device": Device(trip_ceiling=500)}, RigError, "refuses 'trip 552': above the compiled"),
    ],
)
def test_a_rig_that_cannot_be_is_refused(parts, kind, words):
    sim = SimulatedRig(**parts)
    with pytest.raises(kind, match=words):
        opened(sim).__enter__()
    assert (sim.device.state, sim.device.output) == (SAFE, 0)


def test_a_calibration_of_another_board_is_refused():
    eeprom = bytearray(b"\xff" * 8)
    sim = SimulatedRig(device=Device(eeprom))
    board = numbered(VirtualLink(sim))
    sim.advance(0.1)
    again = SimulatedRig(device=Device(eeprom))  # switched off and on
    assert numbered(VirtualLink(again)) == board == again.calibration().board != 0
    for other in (0, board % 60000 + 1):
        foreign = dataclasses.replace(again.calibration(), board=other)
        with pytest.raises(RigError, match=f"this is board {board}, the calibration is of"):
            opened(again, calibration=foreign).__enter__()
    with opened(again) as rig:
        rig.wait(0.1)


def test_a_transducer_with_a_live_zero_has_a_floor_and_one_without_has_none():
    assert floor_counts(LIVE) == 61
    dead = Calibration(ZERO_TO_FIVE.calibration(), load_cell().calibration())
    assert floor_counts(dead) == 0
    assert unseen(LIVE, alive=True) == []
    assert "cannot have a floor" in unseen(dead, alive=True)[0]
    assert "hardly varies" in unseen(LIVE, alive=False)[0]


def test_a_trip_is_said_noted_kept_and_cleared_by_a_person_alone(path):
    eeprom = bytearray(8)
    sim = SimulatedRig(device=Device(eeprom))
    words = r"range at 3 counts \(-24.15 psi\), output \d+; a broken wire"
    with pytest.raises(RigFault, match=words), recorded(path, sim) as rig:
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 3
        rig.wait(1.0)
    (note,) = read_journal(path).notes_of("fault")
    assert (note["cause"], note["counts"]) == ("range", 3)
    with pytest.raises(RigError, match="refuses 'clear': reading out of range"):
        acknowledge(VirtualLink(sim))
    sim.sensor_fault = None
    for again in (sim, SimulatedRig(device=Device(eeprom))):  # connected again, switched on again
        with pytest.raises(RigError, match=r"is tripped: range at 3 counts .*then acknowledge"):
            opened(again).__enter__()
        assert again.device.state == TRIP
    acknowledge(VirtualLink(again), again.calibration())
    assert again.device.state == SAFE
    with opened(again) as rig:
        rig.set_pressure(10 * PSI)
        rig.wait(0.5)

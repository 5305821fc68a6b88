"""Foreign boards, exchanged channels, transducers that lie: refused, or tripped before it has gone far."""

# ruff: noqa: PT012 -- the way out of a with block is what is tested

import contextlib
import dataclasses
import itertools

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
    sim = Watched(device=Wired(lambda p, f: (f, p)), force_sensor=sensor)
    limit = limit_psi * PSI
    with pytest.raises(RigError, match="swapped"), opened(sim, pressure_limit=limit) as rig:
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
    sim = Watched(None, muscle, device=Wired(lambda p, f: (f, p)), force_sensor=cell(60))
    plan, words = Isobaric((20 * PSI,), 1, 0.05, 0.0025, settle=8.0), "the load rises during"
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
        ({"circuit": PneumaticCircuit(supply=1.0)}, RigError, "changed neither the pressure nor"),
        ({"circuit": HydraulicCircuit(displacement=1e-12)}, RigError, "changed neither the"),
        ({"device": Deaf()}, RigFault, "did not accept its settings: silence 5000 not 500"),
        *[({"device": stuck(psi)}, RigError, VENT) for psi in (-12.0, 4.0, 37.0)],
        ({"device": Wired(lambda p, _: (p, 0))}, RigError, "cell reads 0 counts with the dump"),
        ({"device": Wired(lambda p, _: (p, 1023))}, RigError, "cell reads 1023 counts with the"),
        ({"device": Device(trip_ceiling=500)}, RigError, "refused 'trip 552': above the compiled"),
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
        with pytest.raises(RigError, match=f"this is board {board}, but the calibration is for"):
            opened(again, calibration=foreign).__enter__()
    with opened(again) as rig:
        rig.wait(0.1)


def test_a_transducer_with_a_live_zero_has_a_floor_and_one_without_has_none():
    assert floor_counts(LIVE) == 61
    zero_to_five = SimulatedSensor(0.0, 200 * PSI, 0.25 * PSI, 0.01, low_volts=0.0, high_volts=5.0)
    dead = Calibration(zero_to_five.calibration(), load_cell().calibration())
    assert floor_counts(dead) == 0
    assert unseen(LIVE, alive=True) == []
    assert "cannot be detected" in unseen(dead, alive=True)[0]
    assert "hardly varies" in unseen(LIVE, alive=False)[0]


def test_a_trip_is_said_noted_kept_and_cleared_by_a_person_alone(path):
    eeprom = bytearray(8)
    sim = SimulatedRig(device=Device(eeprom))
    words = r"range at 3 counts \(-24.15 psi\), output \d+; check for a broken wire"
    with pytest.raises(RigFault, match=words), recorded(path, sim) as rig:
        rig.set_pressure(30 * PSI)
        rig.wait(2.0)
        sim.sensor_fault = 3
        rig.wait(1.0)
    (note,) = read_journal(path).notes_of("fault")
    assert (note["cause"], note["counts"]) == ("range", 3)
    with pytest.raises(RigError, match="refused 'clear': reading out of range"):
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


FROZEN, NO_RESPONSE = 7, 8
FLOOR, CEILING = 51, 963
GAINS = {"air": (4.0, 2.0), "water": (0.0, 5.0)}


def test_nothing_starts_on_a_reading_that_cannot_be(bench):
    bench.command("trip", 600)
    for verb in (("run",), ("man", 50)):
        for reading in (0, FLOOR - 1, CEILING + 1, 1023):
            bench.pressure = reading
            bench.ticks(1)
            assert bench.command(*verb).reason == "reading out of range"
    bench.pressure = 100
    bench.ticks(1)
    assert not bench.command("run").reason


class Loop:
    """A person's commands, a device and its plant; the transducer lies from a moment on."""

    def __init__(self, fluid, **parts):
        circuit = PneumaticCircuit() if fluid == "air" else HydraulicCircuit(relief=None)
        self.sim = Watched(circuit, **parts, seed=11)
        self.link = VirtualLink(self.sim)

    def lie(self, pressure_psi):
        self.sim.sensor_fault = self.sim.pressure_sensor.counts(pressure_psi * PSI)

    def start(self, set_psi, limit_psi, gains, *more):
        v = self.sim.calibration().feed_forward.output(set_psi * PSI)
        limit = self.sim.pressure_sensor.counts(limit_psi * PSI)
        begin = ("cal", 101.9, 250), ("trip", limit), ("gain", *gains), *more, ("set", set_psi, v)
        for verb, *values in (*begin, ("run",)):
            self.link.command(verb, *values)

    def wait(self, seconds):
        for _ in range(round(seconds / 0.02)):
            self.link.keep_alive()
            self.link.sleep(0.02)

    @property
    def tripped(self):
        """Fault of the trip, 0 if there is none."""
        self.wait(0.1)
        return self.link.newest.fault * (self.sim.device.state == TRIP)


ROWS = [  # of the field trials: fluid, set psi, limit psi, gains, stuck at psi, other commands
    *[("water", float(s), 60.0, (0.0, 5.0), None, ()) for s in (5, 30)],
    ("water", 40.0, 110.0, (0.0, 5.0), 37.0, ()),
    ("water", 80.0, 110.0, (0.5, 2.0), 77.0, ()),
    ("air", 30.0, 60.0, (4.0, 2.0), 28.0, ()),
    ("air", 3.0, 110.0, (4.0, 2.0), 0.0, ()),
    ("air", 4.9, 110.0, (4.0, 2.0), 0.0, ()),
    ("air", 40.0, 110.0, (1.0, 2.0), None, (("ilim", -50, 50),)),
]


@pytest.mark.parametrize("before", [True, False], ids=["before", "held"])
@pytest.mark.parametrize(("fluid", "set_psi", "limit", "gains", "stuck", "more"), ROWS)
def test_every_row_of_the_field_trials_trips(fluid, set_psi, limit, gains, stuck, more, before):
    loop, shown = Loop(fluid), -1e3 if stuck is None else stuck
    if before:
        loop.lie(shown)
        with contextlib.suppress(RigError):  # where it does not start
            loop.start(set_psi, limit, gains, *more)
    else:
        loop.start(set_psi, limit, gains, *more)
        loop.wait(3.0)
        assert loop.sim.device.state == RUN
        loop.lie(shown)
    end = loop.sim.now + 10.0
    while loop.sim.device.state == RUN and loop.sim.now < end:
        loop.wait(0.5)
    loop.wait(0.5)
    assert loop.sim.device.state == (SAFE if before and stuck is None else TRIP)
    assert loop.sim.peak <= min(1.02 * limit, set_psi + 25)


@pytest.mark.parametrize("fluid", ["air", "water"])
@pytest.mark.parametrize("noise", [True, False], ids=["noise", "quiet"])
def test_a_sound_hold_does_not_trip_with_noise_or_without_and_a_frozen_one_does(fluid, *, noise):
    """A reading that stands still is sound where the transducer is quiet, and was seen to be so."""
    sensor = pressure_transducer()
    quiet = dataclasses.replace(sensor, noise=0.0)
    loop = Loop(fluid, pressure_sensor=sensor if noise else quiet)
    loop.wait(4.2)
    loop.start(30.0, 110.0, GAINS[fluid])
    loop.wait(12.0)
    assert loop.sim.device.state == RUN
    assert loop.link.session.status.alive == (2 if noise else 1)
    if noise or fluid == "air":  # a quiet one that freezes trips once the output has moved
        loop.lie(30.0 if noise else 24.0)
        loop.wait(1.1 if noise else 2.0)
        assert loop.tripped == FROZEN


@pytest.mark.parametrize("after", [0.22, 0.28])
def test_a_reading_that_leaps_to_the_set_point_and_rests_trips_below_the_limit(after):
    """Gains well above the published ones: the true pressure is near its limit when the reading leaps."""
    loop = Loop("water")
    loop.wait(3.0)
    loop.start(45.3, 60.0, (1.5, 8.0))
    loop.wait(after)
    assert loop.sim.pressure > 50 * PSI
    loop.lie(45.1)
    loop.wait(2.0)
    assert loop.tripped == FROZEN
    assert loop.sim.peak <= 1.02 * 60


@pytest.mark.parametrize("fluid", ["air", "water"])
@pytest.mark.parametrize("set_psi", [5.0, 50.0])
def test_a_blocked_line_with_noise_trips_at_the_start(fluid, set_psi):
    """The reading varies, as amplifiers do, but not with the pressure."""
    noise = [100, 103, 101, 104, 102, 100, 99, 102]
    reading = (noise[tick // 3 % len(noise)] for tick in itertools.count(1))
    device = Wired(lambda _, force: (next(reading), force))
    loop = Loop(fluid, device=device)
    loop.start(set_psi, 110.0, {"air": (4.0, 2.0), "water": (0.5, 5.0)}[fluid])
    loop.wait(5.0)
    assert loop.tripped == NO_RESPONSE
    assert loop.sim.peak <= set_psi + 25

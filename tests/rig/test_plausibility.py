"""A transducer that lies: the device trips, or refuses to start, before the pressure has gone far."""

import contextlib
import dataclasses
import itertools

import pytest
from benches import PSI, Watched, Wired

from rig.errors import RigError
from rig.link import VirtualLink
from rig.protocol import RUN, SAFE, TRIP
from rig.simulation import HydraulicCircuit, PneumaticCircuit, pressure_transducer

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

    def __init__(self, fluid, *, noise=True, device=None):
        circuit = PneumaticCircuit() if fluid == "air" else HydraulicCircuit(relief=None)
        sensor = pressure_transducer()
        sensor = sensor if noise else dataclasses.replace(sensor, noise=0.0)
        self.sim = Watched(circuit, device=device, pressure_sensor=sensor, seed=11)
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
def test_every_row_of_the_field_trials_trips_or_does_not_start(
    fluid, set_psi, limit, gains, stuck, more, *, before
):
    loop = Loop(fluid)

    def lie():
        loop.lie(-1e3 if stuck is None else stuck)

    if before:
        lie()
        with contextlib.suppress(RigError):  # where it does not start
            loop.start(set_psi, limit, gains, *more)
    else:
        loop.start(set_psi, limit, gains, *more)
        loop.wait(3.0)
        assert loop.sim.device.state == RUN
        lie()
    end = loop.sim.now + 10.0
    while loop.sim.device.state == RUN and loop.sim.now < end:
        loop.wait(0.5)
    loop.wait(0.5)
    assert loop.sim.device.state == (SAFE if before and stuck is None else TRIP)
    assert loop.sim.peak <= min(1.02 * limit, set_psi + 25)


@pytest.mark.parametrize("fluid", ["air", "water"])
@pytest.mark.parametrize("noise", [True, False], ids=["noise", "quiet"])
def test_a_sound_hold_does_not_trip_with_noise_or_without(fluid, *, noise):
    """A reading that stands still is sound where the transducer is quiet, and was seen to be so."""
    loop = Loop(fluid, noise=noise)
    loop.wait(4.2)
    loop.start(30.0, 110.0, GAINS[fluid])
    loop.wait(12.0)
    assert loop.sim.device.state == RUN
    assert loop.link.session.status.alive == (2 if noise else 1)
    if fluid == "air" and not noise:  # a quiet one that freezes trips once the output has moved
        loop.lie(24.0)
        loop.wait(2.0)
        assert loop.tripped == FROZEN


@pytest.mark.parametrize("fluid", ["air", "water"])
def test_a_reading_that_freezes_at_the_set_point_trips_within_a_second(fluid):
    loop = Loop(fluid)
    loop.start(30.0, 110.0, GAINS[fluid])
    loop.wait(5.0)
    loop.lie(30.0)
    loop.wait(1.1)
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


@pytest.mark.parametrize(
    ("fluid", "set_psi"), [("air", 5.0), ("air", 50.0), ("water", 5.0), ("water", 50.0)]
)
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

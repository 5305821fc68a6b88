"""A transducer that lies: the device trips, or refuses to start, before the pressure has gone far."""

import dataclasses
import itertools
from collections.abc import Callable, Iterator

import pytest
from bench import Bench
from native import NativeDevice

from rig.device import Device
from rig.protocol import RUN, SAFE, TRIP, DeviceSettings, DeviceStatus, Hello, frame
from rig.simulation import HydraulicCircuit, PneumaticCircuit, SimulatedRig, pressure_transducer

PSI = 6894.757293168361
RANGE, FROZEN, NO_RESPONSE = 6, 7, 8
FLOOR, CEILING = 51, 963
Make = Callable[..., Device]


@pytest.fixture(params=["python", "c"])
def make(request: pytest.FixtureRequest) -> Make:
    if request.param == "python":
        return Device
    library = request.getfixturevalue("native_library")
    return lambda eeprom=None: NativeDevice(library, eeprom)


@pytest.fixture
def bench(make: Make) -> Iterator[Bench]:
    bench = Bench(make())
    yield bench
    assert bench.torn == []


def _fault(bench: Bench) -> int:
    bench.ticks(20)
    return bench.of(DeviceStatus)[-1].fault


# ---- floor and ceiling ----


@pytest.mark.parametrize("verb", [("run",), ("man", 50)])
@pytest.mark.parametrize("reading", [0, FLOOR - 1, CEILING + 1, 1023])
def test_nothing_starts_on_a_reading_that_cannot_be(
    verb: tuple[str, int], reading: int, bench: Bench
) -> None:
    bench.command("trip", 600)
    bench.pressure = reading
    bench.ticks(1)
    assert bench.command(*verb).reason == "reading out of range"
    bench.pressure = 100
    bench.ticks(1)
    assert not bench.command(*verb).reason


def test_a_reading_below_the_floor_trips_after_three_conversions(bench: Bench) -> None:
    bench.start()
    bench.command("floor", 80)
    for reading in (79, 79, 80, 79, 79):
        bench.ticks(1, reading)
    assert bench.device.state == RUN
    bench.ticks(1, 79)
    assert (bench.device.state, bench.device.output, bench.device.dump_open) == (TRIP, 0, True)
    assert _fault(bench) == RANGE


# ---- the limit of the limit ----


def test_no_host_sets_a_limit_above_the_ceiling_compiled_in(bench: Bench) -> None:
    for counts in (901, 1000, 1023):
        assert bench.command("trip", counts).reason == "above the compiled-in ceiling"
    assert bench.command("run").reason == "no trip limit"
    assert not bench.command("trip", 900).reason
    bench.ticks(20)
    assert bench.of(DeviceSettings)[-1].trip == bench.of(Hello)[-1].trip_ceiling == 900


# ---- a trip stays ----


def test_a_trip_is_ended_by_clear_alone(bench: Bench) -> None:
    bench.start()
    bench.ticks(3, 700)
    for verb, *values in (
        ("run",),
        ("man", 50),
        ("stop",),
        ("hello",),
        ("strict", 0),
        ("trip", 800),
    ):
        bench.command(verb, *values)
        assert bench.device.state == TRIP
    assert not bench.command("clear").reason
    assert (bench.device.state, _fault(bench)) == (SAFE, 0)
    assert not bench.command("run").reason


def test_the_status_tells_when_and_at_what_it_tripped(bench: Bench) -> None:
    bench.start()
    output = bench.device.output
    bench.ticks(2, 700)
    driven = bench.device.output
    bench.ticks(1, 705)
    bench.ticks(30)
    status = bench.of(DeviceStatus)[-1]
    assert (status.state, status.fault, status.tripped_count) == (TRIP, 2, 705)
    assert status.tripped_output == driven < output
    assert 28 <= status.tick - status.tripped_at + 30 <= 60
    bench.command("clear")
    bench.ticks(20)
    assert bench.of(DeviceStatus)[-1].tripped_count == 705  # for the record


@pytest.mark.parametrize("cause", [1, 2, 8])
def test_a_trip_outlives_a_reset_and_the_device(cause: int, make: Make) -> None:
    """Opening the port resets an Uno: that must not acknowledge."""
    eeprom = bytearray(6)
    bench = Bench(make(eeprom))
    bench.start()
    bench.ticks(3, 700)
    bench.device.reset(cause)
    assert bench.device.state == TRIP
    again = Bench(make(eeprom))
    assert (again.device.state, _fault(again)) == (TRIP, 2)
    assert again.of(DeviceStatus)[-1].tripped_count == 700
    again.command("trip", 600)
    assert again.command("run").reason == "tripped: clear first"
    assert not again.command("clear").reason
    assert Bench(make(eeprom)).device.state == SAFE


def test_memory_that_was_never_written_is_no_trip(make: Make) -> None:
    for fill in (b"\xff" * 6, b"\x05\x00\x05\x00\x00\x00", b"\x05\x00\x63\x00\x00\x00"):
        assert make(bytearray(fill)).state == SAFE


# ---- frozen: in a loop with a plant ----


class Loop:
    """A person's commands, a device and its plant; the transducer lies from a moment on."""

    def __init__(self, device: Device, fluid: str, *, noise: bool = True) -> None:
        circuit = PneumaticCircuit() if fluid == "air" else HydraulicCircuit(relief=None)
        sensor = pressure_transducer()
        if not noise:
            sensor = dataclasses.replace(sensor, noise=0.0)
        self.sim = SimulatedRig(circuit, device=device, pressure_sensor=sensor, seed=11)
        self.device = device
        self.peak = 0.0

    def counts(self, pressure_psi: float) -> int:
        return self.sim.pressure_sensor.counts(pressure_psi * PSI)

    def start(
        self, set_psi: float, limit_psi: float, gains: tuple[float, float], *more: str
    ) -> None:
        calibration = self.sim.calibration()
        v = calibration.feed_forward.output(set_psi * PSI)
        limit = self.counts(limit_psi)
        for body in ("cal 101.9 250", f"trip {limit}", f"gain {gains[0]} {gains[1]}", *more,
                     f"set {set_psi} {v:.3f}", "run"):  # fmt: skip
            self.sim.write(frame(body))
            self.wait(0.02)

    def wait(self, seconds: float) -> None:
        end = self.sim.now + seconds
        while self.sim.now < end - 1e-9:
            self.sim.write(frame("0 hb"))
            for _ in range(10):
                self.sim.advance(0.002)
                self.peak = max(self.peak, self.sim.pressure / PSI)

    @property
    def fault(self) -> int:
        self.sim.read()
        self.sim.write(frame("7 status"))
        self.wait(0.1)
        lines = [line for line in self.sim.read().split(b"\n") if line.startswith(b"S")]
        return int(lines[-1].split(b",")[5])


ROWS = [  # of the field trials: fluid, set psi, limit psi, gains, stuck at psi, other commands
    *[("water", float(s), 60.0, (0.0, 5.0), None, ()) for s in (5, 10, 20, 30)],
    ("water", 40.0, 110.0, (0.0, 5.0), 37.0, ()),
    ("water", 80.0, 110.0, (0.5, 2.0), 77.0, ()),
    ("air", 30.0, 60.0, (4.0, 2.0), 28.0, ()),
    ("air", 3.0, 110.0, (4.0, 2.0), 0.0, ()),
    ("air", 4.9, 110.0, (4.0, 2.0), 0.0, ()),
    ("air", 40.0, 110.0, (1.0, 2.0), None, ("ilim -50 50",)),
]


@pytest.mark.parametrize("before", [True, False], ids=["before", "held"])
@pytest.mark.parametrize(("fluid", "set_psi", "limit", "gains", "stuck", "more"), ROWS)
def test_every_row_of_the_field_trials_trips_or_does_not_start(
    make: Make,
    fluid: str,
    set_psi: float,
    limit: float,
    gains: tuple[float, float],
    stuck: float | None,
    more: tuple[str, ...],
    *,
    before: bool,
) -> None:
    loop = Loop(make(), fluid)
    lie = 0 if stuck is None else loop.counts(stuck)
    loop.sim.sensor_fault = lie if before else None
    loop.start(set_psi, limit, gains, *more)
    if not before:
        loop.wait(3.0)
        assert loop.device.state == RUN
        loop.sim.sensor_fault = lie
    loop.wait(10.0)
    assert loop.device.state == (SAFE if before and stuck is None else TRIP)
    assert loop.peak <= min(1.02 * limit, set_psi + 25)


@pytest.mark.parametrize("fluid", ["air", "water"])
@pytest.mark.parametrize("noise", [True, False], ids=["noise", "quiet"])
def test_a_sound_hold_does_not_trip_with_noise_or_without(
    make: Make, fluid: str, *, noise: bool
) -> None:
    """A reading that stands still is sound where the transducer is quiet, and was seen to be so."""
    loop = Loop(make(), fluid, noise=noise)
    loop.wait(4.2)
    loop.start(30.0, 110.0, {"air": (4.0, 2.0), "water": (0.0, 5.0)}[fluid])
    loop.wait(20.0)
    assert loop.device.state == RUN
    loop.sim.read()
    loop.wait(1.1)
    (alive,) = {line[-6:-5] for line in loop.sim.read().split(b"\n") if line.startswith(b"S")}
    assert alive == (b"2" if noise else b"1")


@pytest.mark.parametrize("fluid", ["air", "water"])
def test_a_reading_that_freezes_at_the_set_point_trips_within_a_second(
    make: Make, fluid: str
) -> None:
    loop = Loop(make(), fluid)
    loop.start(30.0, 110.0, {"air": (4.0, 2.0), "water": (0.0, 5.0)}[fluid])
    loop.wait(5.0)
    loop.sim.sensor_fault = loop.counts(30.0)
    loop.wait(1.1)
    assert (loop.device.state, loop.fault) == (TRIP, FROZEN)


@pytest.mark.parametrize("after", [0.20, 0.22, 0.24, 0.26])
def test_a_reading_that_leaps_to_the_set_point_and_rests_trips_below_the_limit(
    make: Make, after: float
) -> None:
    """Gains well above the published ones: the true pressure is near its limit when the reading leaps."""
    loop = Loop(make(), "water")
    loop.wait(3.0)
    loop.start(45.3, 60.0, (1.5, 8.0))
    loop.wait(after)
    assert loop.sim.pressure > 50 * PSI
    loop.sim.sensor_fault = loop.counts(45.1)
    loop.wait(2.0)
    assert (loop.device.state, loop.fault) == (TRIP, FROZEN)
    assert loop.peak <= 1.02 * 60


def test_a_quiet_reading_that_freezes_trips_once_the_output_has_moved(make: Make) -> None:
    loop = Loop(make(), "air", noise=False)
    loop.wait(4.2)
    loop.start(30.0, 110.0, (4.0, 2.0))
    loop.wait(5.0)
    loop.sim.sensor_fault = loop.counts(24.0)
    loop.wait(2.0)
    assert (loop.device.state, loop.fault) == (TRIP, FROZEN)


@pytest.mark.parametrize("fluid", ["air", "water"])
@pytest.mark.parametrize("set_psi", [5.0, 20.0, 50.0])
def test_a_blocked_line_with_noise_trips_at_the_start(
    make: Make, fluid: str, set_psi: float
) -> None:
    """The reading varies, as amplifiers do, but not with the pressure."""
    device = make()
    tick, noise = device.tick, [100, 103, 101, 104, 102, 100, 99, 102]
    reading = (noise[tick // 3 % len(noise)] for tick in itertools.count(1))
    device.tick = lambda _, force: tick(next(reading), force)
    loop = Loop(device, fluid)
    loop.start(set_psi, 110.0, {"air": (4.0, 2.0), "water": (0.5, 5.0)}[fluid])
    loop.wait(5.0)
    assert (loop.device.state, loop.fault) == (TRIP, NO_RESPONSE)
    assert loop.peak <= set_psi + 25

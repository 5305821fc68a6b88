"""A whole rig in virtual time: device, sensors, serial line and plant."""

from ..calibration.feed_forward import FeedForward, fit_feed_forward
from ..calibration.whole_rig import Calibration
from ..device.core import BAUD_RATES, Device
from ..errors import RigError
from .channel import ByteChannel
from .circuits import PSI
from .hydraulic import HydraulicCircuit
from .machine import MachineClock, TestMachine
from .muscle import SimulatedMuscle, mckibben
from .plant import Plant
from .pneumatic import PneumaticCircuit
from .sensors import SimulatedSensor, load_cell, pressure_transducer

CIRCUITS = {"air": PneumaticCircuit, "water": HydraulicCircuit}
"""The circuit of each name in a plan."""

TICK = 2e-3
"""The device's tick [s] by its own clock."""


class SimulatedRig:
    r"""The far end of a serial line: a device, its sensors and its plant.

    Nothing waits: `advance` runs the rig. The same arguments give the same bytes, whatever the
    steps in which it is advanced.

    Args:
        circuit: pneumatic unless given.
        muscle: the reference work's 7/8 in muscle unless given.
        machine: a test machine at the muscle's rest length unless given.
        device: the Python port of the firmware for this baud rate unless given.
        pressure_sensor: `pressure_transducer()` unless given.
        force_sensor: `load_cell()` unless given.
        baud: of the line, one of `BAUD_RATES`.
        to_device: line from the host; at this baud rate, with no faults, unless given.
        to_host: line from the device; at this baud rate, with no faults, unless given.
        clock_rate: by which the device's clock gains on true time [-]; -0.002 is usual for an Uno.
        seed: of the sensors' noise.

    Attributes:
        now: true time [s], and the host's.
        plant: circuit, muscle and machine.
        device: the device.
        sensor_fault: counts that the converter reads in place of the pressure (1023: unplugged,
            with the input biased high), or None.

    >>> rig = SimulatedRig()
    >>> rig.write(b"1 hello\n")
    >>> rig.advance(0.1)
    >>> b"A,1,OK" in rig.read()
    True
    """

    def __init__(
        self,
        circuit: PneumaticCircuit | HydraulicCircuit | None = None,
        muscle: SimulatedMuscle | None = None,
        machine: TestMachine | None = None,
        device: Device | None = None,
        *,
        pressure_sensor: SimulatedSensor | None = None,
        force_sensor: SimulatedSensor | None = None,
        baud: int = 115200,
        to_device: ByteChannel | None = None,
        to_host: ByteChannel | None = None,
        clock_rate: float = 0.0,
        seed: int = 0,
    ) -> None:
        if not abs(clock_rate) < 0.1:
            raise RigError(f"clock_rate must be a small part, as -0.002, got {clock_rate}")
        if baud not in BAUD_RATES:
            known = " or ".join(map(str, BAUD_RATES))
            raise RigError(f"the firmware is built for {known} baud, got {baud}")
        bytes_per_tick, ring = BAUD_RATES[baud]
        muscle = muscle or mckibben()
        machine = machine or machine_for(muscle)
        self.circuit = circuit or PneumaticCircuit()
        self.plant = Plant(self.circuit.start(), muscle, machine)
        self.device = device or Device(ring=ring, bytes_per_tick=bytes_per_tick)
        self.pressure_sensor = pressure_sensor or pressure_transducer()
        self.force_sensor = force_sensor or load_cell()
        self.to_device = to_device or ByteChannel(baud=baud, limit=4096)
        self.to_host = to_host or ByteChannel(baud=baud)
        self.sensor_fault: int | None = None
        self.now = 0.0
        self._tick = TICK / (1 + clock_rate)
        self._ticks = 0
        self._pressure_noise = self.pressure_sensor.errors(TICK, seed)
        self._force_noise = self.force_sensor.errors(TICK, seed + 1)

    @property
    def machine(self) -> TestMachine:
        """The test machine."""
        return self.plant.machine

    @property
    def pressure(self) -> float:
        """True gauge pressure P [Pa] in the muscle."""
        return self.plant.circuit.pressure

    @property
    def force(self) -> float:
        """True pull F [N] of the muscle, friction included."""
        return self.plant.force

    def write(self, data: bytes) -> None:
        """Bytes from the host, now."""
        self.to_device.send(data, self.now)

    def read(self) -> bytes:
        """The bytes that have arrived at the host since the last call."""
        return self.to_host.receive(self.now)

    def advance(self, seconds: float) -> None:
        """Let time pass: the plant, then one tick of the device, every 2 ms of its clock."""
        if not seconds >= 0:
            raise RigError(f"time passes forwards, got {seconds} s")
        end = self.now + seconds
        device, plant, circuit, machine = self.device, self.plant, self.plant.circuit, self.machine
        line_in, line_out = self.to_device, self.to_host
        pressure_counts, force_counts = self.pressure_sensor.counts, self.force_sensor.counts
        pressure_noise, force_noise = self._pressure_noise, self._force_noise
        dt, output, dump_open = self._tick, device.output, device.dump_open
        while (at := (self._ticks + 1) * dt) <= end:
            self._ticks += 1
            machine.sync = device.sync
            plant.step(at, dt, output, dump_open)
            if line_in.waiting:
                device.feed(line_in.receive(at))
            counts = pressure_counts(circuit.pressure, next(pressure_noise))
            if self.sensor_fault is not None:
                counts = self.sensor_fault
            device.tick(counts, force_counts(plant.force, next(force_noise)))
            if sent := device.take():
                line_out.send(sent, at)
            output, dump_open = device.output, device.dump_open
        self.now = end

    def calibration(self) -> Calibration:
        """The result of a perfect calibration of this rig, the feed-forward included.

        The hydraulic feed-forward is the cubic fitted to the pump's steady outputs, 5 to 115 psi.
        """
        sensors = self.pressure_sensor.calibration(), self.force_sensor.calibration()
        if not isinstance(self.circuit, HydraulicCircuit):
            return Calibration(*sensors, FeedForward.bias(128.0))
        pressures = [5 * PSI * k for k in range(1, 24)]
        outputs = [self.circuit.steady_output(P) for P in pressures]
        return Calibration(*sensors, fit_feed_forward(pressures, outputs))


def machine_for(
    muscle: SimulatedMuscle, clock: MachineClock | None = None, seed: int = 0
) -> TestMachine:
    """A test machine that holds a muscle at its rest length, and stops short of its table's end.

    Args:
        muscle: to be held.
        clock: of the machine's log.
        seed: of the noise of its load.
    """
    shortest = float(muscle.lengths[0] + 0.01 * (muscle.rest_length - muscle.lengths[0]))
    return TestMachine(muscle.rest_length, shortest=shortest, clock=clock, seed=seed)

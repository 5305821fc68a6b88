"""A whole rig without hardware, in virtual time: device, sensors, serial line and plant."""

import dataclasses
import math
from collections import deque
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path

import numpy as np

from famjax.plant import (
    TICK,
    AbstractCircuit,
    AbstractMuscle,
    DahlFriction,
    HydraulicCircuit,
    LinearMcKibben,
    Plant,
    PneumaticCircuit,
    SteppedPlant,
)
from famjax.units import INCH, LBF, PSI

from .calibration import FULL_OUTPUT, READINGS, Calibration, FeedForward, Sensor, fit_feed_forward
from .device import BAUD_RATES, Device
from .errors import RigError

CIRCUITS = {"air": PneumaticCircuit, "water": HydraulicCircuit}  # of each name in a plan
_BITS_PER_BYTE = 10  # start, eight, stop
FULL_COUNTS = 1023
_STEPS = 1024  # of the converter over its reference
_REFERENCE_VOLTS = 5.0
LOG_INTERVAL = 0.02  # s of the test machine's clock (Chambers 2021, chapter 4)
_BLOCK = 4096  # noise is drawn in blocks: a draw for one reading costs as much as a whole step


@dataclasses.dataclass(frozen=True)
class SimulatedSensor:
    """A linear sensor read by a 10-bit converter with a reference of 5 V.

    counts = floor((low_volts + (high_volts - low_volts)(x - low)/(high - low) + noise) 1024 / 5)

    held within 0..1023, as the data sheet of the ATmega328P has it.

    Attributes:
        low: reading [SI] at `low_volts`.
        high: reading [SI] at `high_volts`.
        noise: standard deviation [SI], normal.
        correlation_time: [s] of the noise; 0 for white noise. Noise that is correlated survives
            the mean of several readings, as pick-up and pump ripple do.
        low_volts: output [V] at `low`; above 0, so that a broken wire differs from a low reading.
        high_volts: output [V] at `high`.
    """

    low: float
    high: float
    noise: float
    correlation_time: float = 0.0
    low_volts: float = 0.5
    high_volts: float = 4.5

    @cached_property
    def counts_per_unit(self) -> float:
        """Counts per SI unit of the reading."""
        span = (self.high_volts - self.low_volts) / (self.high - self.low)
        return span * _STEPS / _REFERENCE_VOLTS

    @cached_property
    def zero_counts(self) -> float:
        """Counts, not rounded down, at a reading of zero."""
        return self.low_volts * _STEPS / _REFERENCE_VOLTS - self.low * self.counts_per_unit

    def counts(self, reading: float, error: float = 0.0) -> int:
        """Counts [0..1023] of a reading [SI] with an error [counts], limited by the ADC."""
        counts = int(self.zero_counts + self.counts_per_unit * reading + error)
        return 0 if counts < 0 else counts if counts < FULL_COUNTS else FULL_COUNTS

    def calibration(self) -> Sensor:
        """The result of a perfect calibration of this sensor, for sums of five readings.

        A converter rounds down, so that its counts are half a count low in the mean.
        """
        return Sensor(1 / (READINGS * self.counts_per_unit), READINGS * (self.zero_counts - 0.5))

    def errors(self, interval: float, seed: int | np.random.Generator) -> Iterator[float]:
        """Endless noise [counts], one value every `interval` [s].

        The seed alone decides the values. Correlated noise is a first-order Gauss-Markov process.
        """
        rng = np.random.default_rng(seed)
        scale = self.noise * self.counts_per_unit
        keep = math.exp(-interval / self.correlation_time) if self.correlation_time else 0.0
        fresh = math.sqrt(1.0 - keep * keep) * scale
        last = float(rng.normal()) * scale
        while True:
            for draw in rng.normal(size=_BLOCK).tolist():
                last = keep * last + fresh * draw
                yield last


def pressure_transducer(
    high: float = 200 * PSI, noise: float = 0.25 * PSI, correlation_time: float = 0.01
) -> SimulatedSensor:
    """The reference work's transducer, 0 to 200 psi; its noise and their correlation are ASSUMED.

    Both are part of what is measured: with the air circuit's own motion below 0.12 psi, the printed
    standard deviations of 0.27 to 0.34 psi are mostly the transducer's.

    >>> round(1 / (pressure_transducer().counts_per_unit * PSI), 3)  # psi per count
    0.244
    """
    return SimulatedSensor(0.0, high, noise, correlation_time)


def load_cell(high: float = 1500 * LBF, noise: float = 0.5 * LBF) -> SimulatedSensor:
    """A load cell of -5 % to 100 % of its range; range and noise are ASSUMED.

    The reference work's reads up to 1000 lbf, which the 7/8 in muscle exceeds at 100 psi.
    """
    return SimulatedSensor(-0.05 * high, high, noise)


@dataclasses.dataclass(frozen=True)
class MachineClock:
    """A clock with offset and drift: reading = offset + (1 + rate) t, with t the true time.

    Attributes:
        offset: reading [s] at the true time 0.
        rate: by which it gains, s per s.
    """

    offset: float = 0.0
    rate: float = 0.0

    def reading(self, true_time: float) -> float:
        """The reading [s] at a true time [s]."""
        return self.offset + (1 + self.rate) * true_time

    def true_time(self, reading: float) -> float:
        """The true time [s] at which it shows a reading [s]."""
        return (reading - self.offset) / (1 + self.rate)


class TestMachine:
    """A screw-driven machine that shortens a muscle at constant rate and lets it out again.

    A stroke begins at the rest length, turns where the load falls to 0 (or after the given stroke),
    and ends at the rest length. Neglected: the frame's compliance and the time that
    the drive takes to reverse.

    Args:
        rest_length: L0 [m], where strokes begin and end.
        shortest: length [m] at which the machine's limit switch stops it.
        clock: of its log.
        load_noise: standard deviation of the load in its log [N]; ASSUMED.
        seed: of the noise.

    Attributes:
        length: active length L [m].
        velocity: dL/dt [m/s], negative while the muscle shortens.
        sync: whether its digital input is high.
        cycles_left: strokes that remain, the present one included.
        rows: of its log: time [s] of its own clock, displacement [m], negative where the muscle is shorter
            than at rest, force [N], sync.
    """

    __test__ = False  # not a test of pytest's

    def __init__(
        self,
        rest_length: float,
        *,
        shortest: float,
        clock: MachineClock | None = None,
        load_noise: float = 0.3 * LBF,
        seed: int = 0,
    ) -> None:
        self.rest_length, self.shortest = rest_length, shortest
        self.clock = clock or MachineClock()
        self.load_noise = load_noise
        self.length = rest_length
        self.velocity = 0.0
        self.sync = False
        self.cycles_left = 0
        self._rate, self._turn_at = 0.0, shortest
        self._rng = np.random.default_rng(seed)
        self.rows: list[tuple[float, float, float, float]] = []
        self._next_row = math.ceil(self.clock.offset / LOG_INTERVAL) * LOG_INTERVAL
        self._next_at = self.clock.true_time(self._next_row)
        self._last_load = 0.0

    @property
    def busy(self) -> bool:
        """Whether strokes are under way."""
        return self.cycles_left > 0

    def start(self, cycles: int, rate: float = 0.04 * INCH, *, stroke: float = math.inf) -> None:
        """Begin strokes from the rest length.

        Args:
            cycles: number of strokes there and back.
            rate: of the crosshead [m/s] (chapter 4: 0.04 in/s).
            stroke: largest stroke [m]; the machine also reverses at the limit switch.
        """
        self._turn_at = max(self.shortest, self.rest_length - stroke)
        self._rate, self.velocity, self.cycles_left = rate, -rate, cycles

    def step(self, now: float, dt: float, load: float) -> None:
        """Move by dt [s] up to the true time `now` [s], under the load [N] at its beginning."""
        velocity = self.velocity
        length = self.length + velocity * dt
        if velocity < 0:
            if load <= 0.0 or length <= self._turn_at:
                length = max(length, self._turn_at)
                self.velocity = self._rate
        elif velocity > 0 and length >= self.rest_length:
            length = self.rest_length
            self.cycles_left -= 1
            self.velocity = -self._rate if self.cycles_left else 0.0
        if now >= self._next_at:
            self._log(now, dt, length, load)
        self.length, self._last_load = length, load

    def _log(self, now: float, dt: float, length: float, load: float) -> None:
        """One row at its nominal time, between the last step and this one."""
        share = min(max(1 - (now - self._next_at) / dt, 0.0), 1.0)
        # The load belongs to the beginning of the step: at `share` of it, it is `share` on from there.
        force = load + share * (load - self._last_load) + self._rng.normal() * self.load_noise
        x = self.length + share * (length - self.length)
        self.rows.append((self._next_row, x - self.rest_length, force, float(self.sync)))
        self._next_row += LOG_INTERVAL
        self._next_at = self.clock.true_time(self._next_row)

    def write_log(self, path: str | Path) -> Path:
        """Write the log as a delimited file with units, as such machines do."""
        lines = ["Time,Extension,Load,Digital input", "(s),(mm),(N),(-)"]
        for time, displacement, force, sync in self.rows:
            lines.append(f"{time:.4f},{displacement * 1e3:.5f},{force:.4f},{sync:.0f}")
        path = Path(path)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


class ByteChannel:
    """One direction of a serial line: bytes arrive one by one, at its baud rate.

    Args:
        baud: bits a second; None delivers at once.
        limit: bytes that may wait; what comes on top is lost, as in a UART. None for no limit.

    Attributes:
        waiting: bytes that have not been received.
        cut: whether the cable is out: nothing enters, and bytes under way are lost.
    """

    def __init__(self, *, baud: float | None = None, limit: int | None = None) -> None:
        self._per_byte = _BITS_PER_BYTE / baud if baud else 0.0
        self._limit = limit
        self._queue: deque[tuple[float, bytes]] = deque()
        self._free_at = -math.inf
        self.waiting, self.cut = 0, False

    def send(self, data: bytes, now: float) -> None:
        """Put bytes in at a time [s], which must not go back."""
        if self.cut or not data:
            return
        if self._limit is not None:
            data = data[: max(0, self._limit - self.waiting)]
        start = now if now > self._free_at else self._free_at
        self._free_at = start + len(data) * self._per_byte
        self._queue.append((start, data))
        self.waiting += len(data)

    def receive(self, now: float) -> bytes:
        """The bytes that have arrived by a time [s]."""
        queue, arrived = self._queue, []
        if self.cut:
            queue.clear()
            self.waiting, self._free_at = 0, -math.inf
        while queue:
            start, data = queue[0]
            if start + len(data) * self._per_byte <= now + 1e-12:
                arrived.append(data)
                queue.popleft()
                continue
            n = int((now - start) / self._per_byte + 1e-9) if now > start else 0
            if n > 0:
                arrived.append(data[:n])
                queue[0] = (start + n * self._per_byte, data[n:])
            break
        out = b"".join(arrived)
        self.waiting -= len(out)
        return out


class SimulatedRig:
    r"""The far end of a serial line: a device, its sensors and its plant.

    Nothing waits: `advance` runs the rig. The same arguments give the same bytes, whatever the
    steps in which it is advanced.

    Args:
        circuit: circuit; pneumatic if omitted.
        muscle: muscle; if omitted, the 7/8 in muscle of the reference work, as a `LinearMcKibben`.
        machine: test machine; if omitted, one at the rest length of the muscle.
        device: device; if omitted, the Python port of the firmware at this baud rate.
        pressure_sensor: sensor; `pressure_transducer()` if omitted.
        force_sensor: sensor; `load_cell()` if omitted.
        baud: of the line, one of `BAUD_RATES`.
        to_device: line from the host; if omitted, one at this baud rate without faults.
        to_host: line from the device; if omitted, one at this baud rate without faults.
        clock_rate: by which the device's clock gains on true time [-]; -0.002 is usual for an Uno.
        friction: of the muscle, `DahlFriction.share`; ASSUMED.
        seed: of the sensors' noise.

    Attributes:
        now: true time [s], and the host's.
        machine: the test machine.
        plant: circuit and muscle, in operation.
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
        circuit: AbstractCircuit | None = None,
        muscle: AbstractMuscle | None = None,
        machine: TestMachine | None = None,
        device: Device | None = None,
        *,
        pressure_sensor: SimulatedSensor | None = None,
        force_sensor: SimulatedSensor | None = None,
        baud: int = 115200,
        to_device: ByteChannel | None = None,
        to_host: ByteChannel | None = None,
        clock_rate: float = 0.0,
        friction: float = 0.02,
        seed: int = 0,
    ) -> None:
        if baud not in BAUD_RATES:
            raise RigError(f"baud must be one of {', '.join(map(str, BAUD_RATES))}, got {baud}")
        bytes_per_tick, ring = BAUD_RATES[baud]
        muscle = muscle or LinearMcKibben()
        self.machine = machine or machine_for(muscle)
        self.circuit = circuit or PneumaticCircuit()
        self.device = device or Device(ring=ring, bytes_per_tick=bytes_per_tick)
        self.pressure_sensor = pressure_sensor or pressure_transducer()
        self.force_sensor = force_sensor or load_cell()
        self.to_device = to_device or ByteChannel(baud=baud, limit=4096)
        self.to_host = to_host or ByteChannel(baud=baud)
        self.sensor_fault: int | None = None
        self.now = 0.0
        self._tick = TICK / (1 + clock_rate)
        plant = Plant(self.circuit, muscle, friction=DahlFriction(friction))
        self.plant = SteppedPlant(plant, self._tick)
        self._ticks = 0
        self._pressure_noise = self.pressure_sensor.errors(TICK, seed)
        self._force_noise = self.force_sensor.errors(TICK, seed + 1)

    @property
    def pressure(self) -> float:
        """True gauge pressure P [Pa] in the muscle."""
        return self.plant.pressure

    @property
    def force(self) -> float:
        """True pull F [N] of the muscle, friction included."""
        return self.plant.force

    def write(self, data: bytes) -> None:
        """Receive bytes from the host now."""
        self.to_device.send(data, self.now)

    def read(self) -> bytes:
        """The bytes that have arrived at the host since the last call."""
        return self.to_host.receive(self.now)

    def advance(self, seconds: float) -> None:
        """Advance time: the plant, then one tick of the device, every 2 ms of its clock."""
        end = self.now + seconds
        device, plant, machine = self.device, self.plant, self.machine
        pressure_counts, force_counts = self.pressure_sensor.counts, self.force_sensor.counts
        pressure_noise, force_noise = self._pressure_noise, self._force_noise
        dt, output, dump_open = self._tick, device.output, device.dump_open
        while (at := (self._ticks + 1) * dt) <= end:
            self._ticks += 1
            machine.sync = device.sync
            machine.step(at, dt, plant.force)
            plant.step(output / FULL_OUTPUT, dump_open, machine.length)
            if self.to_device.waiting:
                device.feed(self.to_device.receive(at))
            counts = pressure_counts(plant.pressure, next(pressure_noise))
            if self.sensor_fault is not None:
                counts = self.sensor_fault
            device.tick(counts, force_counts(plant.force, next(force_noise)))
            if sent := device.take():
                self.to_host.send(sent, at)
            output, dump_open = device.output, device.dump_open
        self.now = end

    def calibration(self) -> Calibration:
        """The result of a perfect calibration of this rig, the feed-forward included.

        The hydraulic feed-forward is the cubic fitted to the pump's steady outputs, 5 to 115 psi.
        """
        sensors = self.pressure_sensor.calibration(), self.force_sensor.calibration()
        feed_forward = FeedForward.bias(128.0)
        if isinstance(self.circuit, HydraulicCircuit):
            pressures = [5 * PSI * k for k in range(1, 24)]
            outputs = [FULL_OUTPUT * self.circuit.steady_signal(P) for P in pressures]
            feed_forward = fit_feed_forward(pressures, outputs)
        return Calibration(*sensors, feed_forward, self.device.board)


def machine_for(
    muscle: AbstractMuscle, clock: MachineClock | None = None, seed: int = 0
) -> TestMachine:
    """A test machine that holds a muscle at its rest length, and stops short of its least length.

    Args:
        muscle: to be held.
        clock: of the machine's log.
        seed: of the noise of its load.
    """
    rest, least = float(muscle.rest_length), float(muscle.length_range()[0])
    return TestMachine(rest, shortest=least + 0.01 * (rest - least), clock=clock, seed=seed)

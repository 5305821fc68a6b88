"""Simulate a whole rig in virtual time: device, sensors, serial line and plant."""

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
_STEPS = 1024  # counts of the converter over its reference voltage
_REFERENCE_VOLTS = 5.0
LOG_INTERVAL = 0.02  # s of the test machine's clock (Chambers 2021, chapter 4)
_BLOCK = 4096  # noise is drawn in blocks, because single draws would double the time of a step


@dataclasses.dataclass(frozen=True)
class SimulatedSensor:
    """A linear sensor read by a 10-bit converter with a reference of 5 V.

    counts = floor((low_volts + (high_volts - low_volts)(x - low)/(high - low) + noise) 1024 / 5),

    limited to 0..1023, as in the ATmega328P data sheet.

    Attributes:
        low: reading [SI] at `low_volts`.
        high: reading [SI] at `high_volts`.
        noise: standard deviation of the normal noise [SI].
        correlation_time: correlation time of the noise [s]; 0 for white noise. Averaging does not remove
            correlated noise, such as electrical pick-up and pump ripple.
        low_volts: output [V] at `low`; above 0, to distinguish a broken wire from a low reading.
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
        """Counts at a reading of zero, before rounding down."""
        return self.low_volts * _STEPS / _REFERENCE_VOLTS - self.low * self.counts_per_unit

    def counts(self, reading: float, error: float = 0.0) -> int:
        """Return the counts [0..1023] for a reading [SI] with an error [counts]."""
        counts = int(self.zero_counts + self.counts_per_unit * reading + error)
        return 0 if counts < 0 else counts if counts < FULL_COUNTS else FULL_COUNTS

    def calibration(self) -> Sensor:
        """Return the result of a perfect calibration of this sensor, for sums of five readings.

        The converter rounds down, so its counts are low by half a count on average.
        """
        return Sensor(1 / (READINGS * self.counts_per_unit), READINGS * (self.zero_counts - 0.5))

    def errors(self, interval: float, seed: int | np.random.Generator) -> Iterator[float]:
        """Generate noise [counts], one value every `interval` [s].

        The values depend only on the seed. Correlated noise is a first-order Gauss-Markov process.
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
    """Return the transducer of the reference work, 0 to 200 psi; noise and its correlation are ASSUMED.

    The published pressures have standard deviations of 0.27 to 0.34 psi. These are mostly due to the
    transducer, because the pressure in the air circuit varies by less than 0.12 psi.

    >>> round(1 / (pressure_transducer().counts_per_unit * PSI), 3)  # psi per count
    0.244
    """
    return SimulatedSensor(0.0, high, noise, correlation_time)


def load_cell(high: float = 1500 * LBF, noise: float = 0.5 * LBF) -> SimulatedSensor:
    """Return a load cell that reads from -5 % to 100 % of its range; range and noise are ASSUMED.

    The reference work's load cell reads up to 1000 lbf, which the 7/8 in muscle exceeds at 100 psi.
    """
    return SimulatedSensor(-0.05 * high, high, noise)


@dataclasses.dataclass(frozen=True)
class MachineClock:
    """A clock with offset and drift: reading = offset + (1 + rate) t, where t is the true time.

    Attributes:
        offset: reading [s] at true time 0.
        rate: time that the clock gains per unit of true time [s/s].
    """

    offset: float = 0.0
    rate: float = 0.0

    def reading(self, true_time: float) -> float:
        """Return the reading [s] at a true time [s]."""
        return self.offset + (1 + self.rate) * true_time

    def true_time(self, reading: float) -> float:
        """Return the true time [s] for a reading [s]."""
        return (reading - self.offset) / (1 + self.rate)


class TestMachine:
    """A screw-driven test machine that lets a muscle shorten at a constant rate and extends it again.

    A stroke begins at the rest length, reverses where the load falls to 0 (or after the given stroke), and
    ends at the rest length. The compliance of the frame and the time to reverse the drive are neglected.

    Args:
        rest_length: L0 [m], where strokes begin and end.
        shortest: length [m] at which the limit switch stops the machine.
        clock: clock used for its log.
        load_noise: standard deviation of the noise on the logged load [N]; ASSUMED.
        seed: seed for the noise.

    Attributes:
        length: active length L [m].
        velocity: dL/dt [m/s], negative while the muscle shortens.
        sync: True if its digital input is high.
        cycles_left: remaining strokes, including the current one.
        rows: rows of its log: time on its own clock [s], displacement [m], negative if the muscle is
            shorter than at rest, force [N], sync.
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
        """True while strokes are in progress."""
        return self.cycles_left > 0

    def start(self, cycles: int, rate: float = 0.04 * INCH, *, stroke: float = math.inf) -> None:
        """Begin strokes from the rest length.

        Args:
            cycles: number of strokes, each there and back.
            rate: crosshead speed [m/s] (chapter 4: 0.04 in/s).
            stroke: largest stroke [m]; the machine also reverses at the limit switch.
        """
        self._turn_at = max(self.shortest, self.rest_length - stroke)
        self._rate, self.velocity, self.cycles_left = rate, -rate, cycles

    def step(self, now: float, dt: float, load: float) -> None:
        """Advance by dt [s] to the true time `now` [s], with the load [N] at the beginning of the step."""
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
        """Add a row at its nominal time, between the previous step and this one."""
        share = min(max(1 - (now - self._next_at) / dt, 0.0), 1.0)
        # The load is known at the beginning of the step and extrapolated by `share` of the step.
        force = load + share * (load - self._last_load) + self._rng.normal() * self.load_noise
        x = self.length + share * (length - self.length)
        self.rows.append((self._next_row, x - self.rest_length, force, float(self.sync)))
        self._next_row += LOG_INTERVAL
        self._next_at = self.clock.true_time(self._next_row)

    def write_log(self, path: str | Path) -> Path:
        """Write the log as a delimited file with a row of units, as real test machines do."""
        lines = ["Time,Extension,Load,Digital input", "(s),(mm),(N),(-)"]
        for time, displacement, force, sync in self.rows:
            lines.append(f"{time:.4f},{displacement * 1e3:.5f},{force:.4f},{sync:.0f}")
        path = Path(path)
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


class ByteChannel:
    """One direction of a serial line; bytes arrive one by one at the baud rate.

    Args:
        baud: bits per second; None for immediate delivery.
        limit: largest number of bytes on the line; further bytes are lost, as in a UART. None for no limit.

    Attributes:
        waiting: number of bytes that were sent but not yet received.
        cut: True if the cable is unplugged: nothing is accepted, and bytes on the line are lost.
    """

    def __init__(self, *, baud: float | None = None, limit: int | None = None) -> None:
        self._per_byte = _BITS_PER_BYTE / baud if baud else 0.0
        self._limit = limit
        self._queue: deque[tuple[float, bytes]] = deque()
        self._free_at = -math.inf
        self.waiting, self.cut = 0, False

    def send(self, data: bytes, now: float) -> None:
        """Send bytes at a time [s], which must not decrease from call to call."""
        if self.cut or not data:
            return
        if self._limit is not None:
            data = data[: max(0, self._limit - self.waiting)]
        start = now if now > self._free_at else self._free_at
        self._free_at = start + len(data) * self._per_byte
        self._queue.append((start, data))
        self.waiting += len(data)

    def receive(self, now: float) -> bytes:
        """Return the bytes that have arrived by a time [s]."""
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
    r"""A device with its sensors and its plant, at the far end of a serial line.

    `advance` runs the rig in virtual time. The same arguments produce the same bytes, regardless of
    the time steps by which the rig is advanced.

    Args:
        circuit: circuit; pneumatic if omitted.
        muscle: muscle; if omitted, the 7/8 in muscle of the reference work, as a `LinearMcKibben`.
        machine: test machine; if omitted, one at the rest length of the muscle.
        device: device; if omitted, the Python port of the firmware at this baud rate.
        pressure_sensor: sensor; `pressure_transducer()` if omitted.
        force_sensor: sensor; `load_cell()` if omitted.
        baud: baud rate of the line, one of `BAUD_RATES`.
        to_device: line from the host; if omitted, one at this baud rate without faults.
        to_host: line from the device; if omitted, one at this baud rate without faults.
        clock_rate: fraction by which the device's clock runs fast [-]; -0.002 is typical of an Uno.
        friction: friction of the muscle, see `DahlFriction.share`; ASSUMED.
        seed: seed for the sensors' noise.

    Attributes:
        now: true time, which is also the host's time [s].
        machine: test machine.
        plant: circuit and muscle.
        device: device.
        sensor_fault: counts that the converter reads instead of the pressure (1023 if unplugged with the
            input biased high), or None.

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
        """True force F [N] with which the muscle pulls, including friction; 0 if the muscle is slack."""
        return max(self.plant.force, 0.0)

    def write(self, data: bytes) -> None:
        """Receive bytes from the host."""
        self.to_device.send(data, self.now)

    def read(self) -> bytes:
        """Return the bytes that have arrived at the host since the last call."""
        return self.to_host.receive(self.now)

    def advance(self, seconds: float) -> None:
        """Advance by a time [s]; every 2 ms of the device's clock, step the plant and then the device."""
        end = self.now + seconds
        device, plant, machine = self.device, self.plant, self.machine
        pressure_counts, force_counts = self.pressure_sensor.counts, self.force_sensor.counts
        pressure_noise, force_noise = self._pressure_noise, self._force_noise
        dt, output, dump_open = self._tick, device.output, device.dump_open
        while (at := (self._ticks + 1) * dt) <= end:
            self._ticks += 1
            machine.sync = device.sync
            machine.step(at, dt, self.force)
            plant.step(output / FULL_OUTPUT, dump_open, machine.length)
            if self.to_device.waiting:
                device.feed(self.to_device.receive(at))
            counts = pressure_counts(plant.pressure, next(pressure_noise))
            if self.sensor_fault is not None:
                counts = self.sensor_fault
            device.tick(counts, force_counts(self.force, next(force_noise)))
            if sent := device.take():
                self.to_host.send(sent, at)
            output, dump_open = device.output, device.dump_open
        self.now = end

    def calibration(self) -> Calibration:
        """Return the result of a perfect calibration of this rig, including the feed-forward.

        The hydraulic feed-forward is a cubic fitted to the pump's steady outputs from 5 to 115 psi.
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
    """Return a test machine at a muscle's rest length, with a limit switch just above its shortest length.

    Args:
        muscle: muscle.
        clock: clock used for the machine's log.
        seed: seed for the noise on the machine's logged load.
    """
    rest, least = float(muscle.rest_length), float(muscle.length_range()[0])
    return TestMachine(rest, shortest=least + 0.01 * (rest - least), clock=clock, seed=seed)

"""The firmware on a simulated ATmega328P, with the interface of `Device`, and its clock beside it."""

import ctypes
import shutil
import subprocess
from pathlib import Path

from session_fuzz import Fuzz

from rig.device import Device
from rig.protocol import frame

HARNESS = Path(__file__).with_name("simavr_harness.c")
FREQUENCY = 16e6  # Hz
BIT_CYCLES = 136  # at 115200 baud: 8 * 17
TAKE = 1 << 16


def build_harness(folder: Path) -> Path | None:
    """The harness as a shared library, or None where there is no compiler or no libsimavr."""
    if shutil.which("cc") is None or not Path("/usr/include/simavr/sim_avr.h").exists():
        return None
    library = folder / "simavr_harness.so"
    command = ["cc", "-O2", "-Wall", "-fPIC", "-shared", str(HARNESS), "-o", str(library)]
    subprocess.run([*command, "-lsimavr"], check=True, capture_output=True)
    return library


class Avr:
    """A simulated Uno with the firmware of a hex file.

    `tick` returns when the firmware begins the tick: its work, and with it what it sends and the
    output, is seen in the next call.
    """

    def __init__(self, library: Path, firmware: Path) -> None:
        self._c = ctypes.CDLL(str(library))
        self._c.harness_open.restype = ctypes.c_void_p
        for name in ("harness_take", "harness_cycle", "harness_changed"):
            getattr(self._c, name).restype = ctypes.c_uint64
        opened = self._c.harness_open(str(firmware).encode(), BIT_CYCLES)
        assert opened, f"simavr cannot run {firmware}"
        self._h = ctypes.c_void_p(opened)
        self._buffer = ctypes.create_string_buffer(TAKE)
        self._waiting = b""
        self.output = 0  # what the PWM pin carried when the last tick began [counts]
        self.reset(1)

    def reset(self, cause: int) -> None:
        assert self._c.harness_reset(self._h, ctypes.c_uint8(cause)) == 0

    def feed(self, data: bytes) -> None:
        self._waiting += data

    def tick(self, pressure: int, force: int) -> None:
        data, self._waiting = self._waiting, b""
        size = ctypes.c_size_t(len(data))
        self.output = self._c.harness_tick(self._h, pressure, force, data, size)
        assert self.output >= 0

    def run(self, seconds: float, pressure: int) -> int:
        """Run freely; what the PWM pin carries at the end [counts]."""
        data, self._waiting = self._waiting, b""
        cycles, size = round(seconds * FREQUENCY), ctypes.c_size_t(len(data))
        output = self._c.harness_run(self._h, pressure, cycles, data, size)
        assert output >= 0
        return output

    def hang(self) -> None:
        assert self._c.harness_hang(self._h) == 0

    def take(self) -> bytes:
        number = self._c.harness_take(self._h, self._buffer, ctypes.c_size_t(TAKE))
        return ctypes.string_at(self._buffer, number)

    def close(self) -> None:
        self._c.harness_close(self._h)
        self._h = ctypes.c_void_p()

    @property
    def now(self) -> float:
        """Seconds since power on."""
        return self._c.harness_cycle(self._h) / FREQUENCY

    @property
    def changed(self) -> float:
        """When the PWM pin last changed what it carries [s]."""
        return self._c.harness_changed(self._h) / FREQUENCY

    @property
    def lowest_stack(self) -> int:
        """The lowest address that the stack pointer has had."""
        return self._c.harness_stack(self._h)

    @property
    def dump_open(self) -> bool:
        return not self._c.harness_pin(self._h, 4)

    @property
    def sync(self) -> bool:
        return bool(self._c.harness_pin(self._h, 7))


GOOD_PRESSURE, OVER_PRESSURE, TRIP = 200, 700, 600  # counts


def start_manual(avr: Avr, output: int = 131) -> None:
    """Reset, acknowledge, drive the output by hand; the pressure may jump and rest."""
    avr.reset(2)
    avr.run(0.004, GOOD_PRESSURE)
    commands = "1 clear", f"2 trip {TRIP}", "3 jump 1023", "4 still 60000", f"5 man {output}"
    for body in commands:
        avr.feed(frame(body))
        avr.run(0.004, GOOD_PRESSURE)
    for _ in range(20):
        if avr.run(0.001, GOOD_PRESSURE) == output:
            return
    raise AssertionError(f"the output did not come on: {avr.take()!r}")


def _begun(avr: Avr, phase: float) -> float:
    """Drive by hand up to `phase` s after a tick; the time [s]."""
    start_manual(avr)
    avr.tick(GOOD_PRESSURE, 0)
    avr.run(phase, GOOD_PRESSURE)
    return avr.now


def over_pressure_delay(avr: Avr, phase: float) -> float:
    """Seconds from a step of the pressure over the limit, `phase` s after a tick, to output 0."""
    begin = _begun(avr, phase)
    assert avr.run(0.012, OVER_PRESSURE) == 0
    assert avr.dump_open
    return avr.changed - begin


def silence_delay(avr: Avr, phase: float) -> float:
    """Seconds from the last byte of the last heartbeat to output 0."""
    _begun(avr, phase)
    line = frame("0 hb")
    avr.feed(line)
    avr.run(11 * BIT_CYCLES * len(line) / FREQUENCY, GOOD_PRESSURE)
    begin = avr.now
    assert avr.run(1.02, GOOD_PRESSURE) == 0
    return avr.changed - begin


def hang_delay(avr: Avr, phase: float) -> float:
    """Seconds from the moment the program hangs to output 0."""
    begin = _begun(avr, phase)
    avr.hang()
    assert avr.run(0.3, GOOD_PRESSURE) == 0
    return avr.changed - begin


LAG = 120  # bytes that the AVR's line may be behind the core: one tick's, and those it releases


def lock_step(core: Device, avr: Avr, fuzz: Fuzz, ticks: int) -> int:
    """Run both and compare; how many records were sent, repeated ones among them.

    The AVR finishes a tick during the next call, so its output and pins are compared a tick late.
    """
    expected, seen, records = b"", b"", 0
    pins: tuple[int, bool, bool] | None = None
    for number, tick in enumerate(fuzz.ticks(ticks)):
        if tick.reset:
            avr.run(0.0015, tick.pressure)  # what the last tick released is on the line
            seen += avr.take()
            assert expected.startswith(seen), f"before the reset at tick {number}"
            core.reset(tick.reset)
            avr.reset(tick.reset)
            avr.take()
            expected, seen, pins = b"", b"", None
        for device in (core, avr):
            device.feed(tick.bytes_in)
            device.tick(tick.pressure, tick.force)
        if pins is not None:
            shown = avr.output, avr.dump_open, avr.sync
            assert shown == pins, f"tick {number - 1}: {pins}, AVR {shown}"
        pins = core.output, core.dump_open, core.sync
        said = core.take()
        fuzz.hear(said)
        expected += said
        seen += avr.take()
        length = min(len(expected), len(seen))
        assert expected[:length] == seen[:length], f"tick {number}: {expected!r}, AVR {seen!r}"
        assert len(seen) <= len(expected), f"tick {number}: more than expected"
        assert len(expected) - length < LAG, f"tick {number}: the AVR lags"
        records += seen[:length].count(b"T,")
        expected, seen = expected[length:], b""
    return records

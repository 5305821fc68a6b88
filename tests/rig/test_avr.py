"""The firmware that ships, on a simulated ATmega328P: the same bytes as the core, in time."""

import os

import pytest
from avr import GOOD_PRESSURE, hang_delay, lock_step, over_pressure_delay, silence_delay
from processes import needs, ran
from session_fuzz import Fuzz

from rig.device import Device, firmware_folder
from rig.protocol import DeviceStatus, Hello, Splitter, frame, parse

FIRMWARE = firmware_folder()
PREBUILT_WITH = "5.4.0"  # avr-gcc of the hex file that ships
PHASES = 24  # between two ticks, at which an event may fall
TICK = 2e-3  # s
STATIC_RAM_END = 0x0100 + 1580  # .data and .bss, as `avr-size` says


@pytest.mark.parametrize("seed", [1, 2])
def test_avr_sends_what_the_port_sends(seed, avr):
    assert lock_step(Device(), avr, Fuzz(seed), 6000) > 1000


def test_no_tick_is_late_and_no_byte_is_lost_at_full_load(avr):
    fuzz, lines, said = Fuzz(5, resets=False), Splitter(), []
    rest = "7 still 60000", "8 frozen 255 2000", "9 stall 30000"
    begin = "1 board 7", "2 tele 4", "3 trip 900", "4 jump 1023", "5 gain 4 2"
    for body in (*begin, *rest, "6 run"):
        avr.feed(frame(body))
        avr.tick(GOOD_PRESSURE, 0)
        avr.tick(GOOD_PRESSURE, 0)
    for number, tick in enumerate(fuzz.ticks(3030)):
        first = number - number % 4
        line = frame(f"{first + 10} set {first % 100}.1234 128.5")
        avr.feed((line[:19], line[19:], b"", b"")[number % 4])
        avr.tick(GOOD_PRESSURE, tick.force)
        said += map(parse, lines.feed(avr.take()))
    last = [message for message in said if isinstance(message, DeviceStatus)][-1]
    assert last.good > 700
    assert (last.late, last.overrun, last.bad) == (0, 0, 0)
    assert last.state == 1


def test_stack_keeps_clear_of_the_variables(avr):
    for tick in Fuzz(6, resets=False).ticks(300):
        avr.feed(tick.bytes_in)
        avr.run(TICK, tick.pressure)
    assert avr.lowest_stack > STATIC_RAM_END + 200  # bytes never touched


def test_over_pressure_takes_the_output_off_within_6_5_ms(avr):
    delays = [over_pressure_delay(avr, TICK * k / PHASES) for k in range(PHASES)]
    assert max(delays) <= 6.5e-3
    assert min(delays) > 2 * TICK  # three conversions, not one


def test_silence_takes_the_output_off_after_a_second(avr):
    for k in range(4):
        assert silence_delay(avr, TICK * k / 4) == pytest.approx(1.0, abs=5e-3)


def test_hung_program_is_reset_by_the_watchdog(avr):
    boots = []
    for k in range(2):
        assert hang_delay(avr, TICK * k / 2) <= 0.27
        messages = [parse(line) for line in Splitter().feed(avr.take())]
        hello = [m for m in messages if isinstance(m, Hello)][-1]
        status = [m for m in messages if isinstance(m, DeviceStatus)][-1]
        assert (hello.cause, status.state, status.fault) == (8, 0, 5)
        boots.append(hello.boot)
    assert boots[1] == boots[0] + 2  # the reset of the test, and that of the watchdog


@needs("avr-gcc")
@needs("make")
def test_sources_build_without_a_warning_into_the_hex_that_ships(tmp_path):
    fast = "BAUD=500000", "BYTES_PER_TICK=91", "RING=32"
    for name, *options in (("fast", *fast, "elf"), ("hex", "hex")):
        make = "make", "-C", FIRMWARE, f"BUILD={tmp_path / name}"
        built = ran(*make, *options, env=os.environ | {"LC_ALL": "C"})
        assert built.returncode == 0, built.stderr
        assert "warning" not in built.stderr
    if PREBUILT_WITH not in ran("avr-gcc", "--version").stdout:
        pytest.skip(f"the hex that ships is of avr-gcc {PREBUILT_WITH}, this is another")
    built = tmp_path / "hex" / "famrig.hex"
    assert built.read_text() == (FIRMWARE / "famrig.hex").read_text()

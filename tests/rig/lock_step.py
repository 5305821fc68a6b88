"""The AVR beside the core: the same bytes in, the same counts, the same bytes out."""

from avr import Avr
from session_fuzz import Fuzz

from rig.device import Device

LAG = 120  # bytes that the AVR's line may be behind the core: one tick's, and those it releases


def lock_step(core: Device, avr: Avr, fuzz: Fuzz, ticks: int) -> int:
    """Run both and compare; how many records were sent, repeated ones among them.

    The AVR finishes a tick during the next call, so its output and pins are compared a tick late.

    Raises:
        AssertionError: the number of the tick and what differed.
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

"""One firmware, two executions: what the C core does the Python port does, byte for byte."""

import random
import shutil
import subprocess
from pathlib import Path

import pytest
from native import NativeDevice, build_native
from session_fuzz import Fuzz

from rig.device import Device, firmware_folder
from rig.protocol import RUN, frame

TICKS = 20_000  # per seed; the benchmark does millions


def _same(port: Device, core: NativeDevice, fuzz: Fuzz, ticks: int) -> int:
    """Run both; how many bytes they sent."""
    sent = 0
    for number, tick in enumerate(fuzz.ticks(ticks)):
        if tick.reset:
            port.reset(tick.reset)
            core.reset(tick.reset)
        for device in (port, core):
            device.feed(tick.bytes_in)
            device.tick(tick.pressure, tick.force)
        said = port.take()
        assert said == core.take(), f"tick {number}"
        assert (port.output, port.state, port.sync) == (core.output, core.state, core.sync)
        fuzz.hear(said)
        sent += len(said)
    return sent


@pytest.mark.parametrize("seed", range(5))
def test_port_and_core_agree(seed: int, native_library: Path) -> None:
    port, core = Device(), NativeDevice(native_library)
    assert _same(port, core, Fuzz(seed), TICKS) > TICKS


@pytest.mark.parametrize(("ring", "bytes_per_tick"), [(7, 21), (500, 91), (64, 200)])
def test_they_agree_with_other_options(ring: int, bytes_per_tick: int, tmp_path: Path) -> None:
    if shutil.which("cc") is None:
        pytest.skip("no C compiler 'cc' on the path")
    library = build_native(tmp_path, ring=ring, bytes_per_tick=bytes_per_tick)
    port = Device(ring=ring, bytes_per_tick=bytes_per_tick)
    core = NativeDevice(library)
    for device in (port, core):
        device.feed(frame("1 tele 1"))
    assert _same(port, core, Fuzz(ring, resets=False), TICKS // 2) > TICKS


@pytest.mark.parametrize("seed", range(4))
def test_they_agree_at_the_edges_of_every_number(seed: int, tmp_path: Path) -> None:
    """The controller in RUN, its settings at their limits: no product may overflow 32 bits."""
    if shutil.which("cc") is None:
        pytest.skip("no C compiler 'cc' on the path")
    r = random.Random(seed)
    library = build_native(tmp_path, trip_ceiling=1020)
    port, core = Device(trip_ceiling=1020), NativeDevice(library)
    rest = "floor 0", "ceiling 1023", "still 60000", "frozen 255 2000", "stall 30000"
    for body in ("trip 1020", "jump 1023", "hbms 10000", *rest, "run"):
        _both(port, core, frame(body), 0)
    for _ in range(300):
        body = r.choice(
            (
                f"set {r.choice((0, 0.0039, 500, 1023.9921))} {r.choice((0, 0.002, 128, 255))}",
                f"gain {r.choice((0, 0.0039, 0.5, 4, 127.9960))} {r.choice((0, 0.0039, 2, 127.9960))}",
                f"ilim {r.choice((-255, -128, 0))} {r.choice((0, 128, 255))}",
                f"tele {r.choice((4, 5, 49, 50))}",
                "stop",
            )
        )
        _both(port, core, frame(body), 0)
        if body == "stop":
            zero = r.choice((0, 0.0625, 102.4, 1023.9375))
            _both(port, core, frame(f"cal {zero} {r.choice((0.0157, 1, 200, 1023.9843))}"), 0)
        _both(port, core, frame("run"), 0)
        pressure = r.choice((0, 4, 511, 1018, 1019))
        for _ in range(r.randint(1, 120)):
            _both(port, core, b"", min(max(pressure + r.choice((-1, 0, 0, 1)), 0), 1019))
    assert port.state == core.state == RUN


def _both(port: Device, core: NativeDevice, line: bytes, pressure: int) -> None:
    for device in (port, core):
        device.feed(line)
        device.tick(pressure, 0)
    assert port.output == core.output
    assert port.take() == core.take()


def test_makefile_builds_the_same_core(tmp_path: Path) -> None:
    if shutil.which("make") is None or shutil.which("cc") is None:
        pytest.skip("no make or no C compiler")
    make = ["make", "-C", str(firmware_folder()), f"BUILD={tmp_path}", "host"]
    built = subprocess.run(make, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    core = NativeDevice(tmp_path / "famrig_host.so")
    assert _same(Device(), core, Fuzz(21), TICKS // 10) > TICKS // 10

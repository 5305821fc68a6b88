"""One firmware, three executions: Python = C = AVR under simavr, byte for byte, and its safety times.

A host that misbehaves sends commands right, wrong and damaged, the pressure wanders, steps and
fails, the device is reset at random. Needs `cc`; the AVR part needs libsimavr (Debian:
libsimavr-dev). The program that runs is the prebuilt `rig/firmware/famrig.hex`.

    python benchmarks/rig_identity.py --json rig_identity.json
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "rig"))

from avr import (  # pyright: ignore[reportMissingImports]
    Avr,
    build_harness,
    hang_delay,
    over_pressure_delay,
    silence_delay,
)
from lock_step import lock_step  # pyright: ignore[reportMissingImports]
from native import NativeDevice, build_native  # pyright: ignore[reportMissingImports]
from session_fuzz import Fuzz  # pyright: ignore[reportMissingImports]

from rig.device import Device, firmware_folder

CHUNK = 100_000  # ticks of one seed
TICK = 2e-3  # s
TARGETS_S = {"over_pressure": 6.5e-3, "hang": 0.27}
SILENCE_S, SILENCE_TOLERANCE_S = 1.0, 5e-3


def port_equals_core(library: Path, ticks: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Ticks and bytes that the Python port and the C core agreed on."""
    sent, done, began = 0, 0, time.perf_counter()
    for seed in range(-(-ticks // CHUNK)):
        port, core, fuzz = Device(), NativeDevice(library), Fuzz(1000 + seed)
        for tick in fuzz.ticks(min(CHUNK, ticks - done)):
            if tick.reset:
                port.reset(tick.reset)
                core.reset(tick.reset)
            for device in (port, core):
                device.feed(tick.bytes_in)
                device.tick(tick.pressure, tick.force)
            said = port.take()
            if said != core.take() or port.output != core.output:
                raise SystemExit(f"seed {seed}: port and core differ after {done} ticks")
            fuzz.hear(said)
            sent += len(said)
            done += 1
        tell(f"Python = C: {done:,} ticks, {sent:,} bytes")
    return {"ticks": done, "bytes": sent, "seconds": time.perf_counter() - began}


def avr_equals_core(
    library: Path, harness: Path, records: int, tell: Callable[[str], None]
) -> dict[str, Any]:
    """Records that the AVR and the C core agreed on."""
    done, ticks, seed, began = 0, 0, 0, time.perf_counter()
    while done < records:
        avr = Avr(harness, firmware_folder() / "famrig.hex")
        try:
            done += lock_step(NativeDevice(library), avr, Fuzz(2000 + seed), CHUNK // 5)
        except AssertionError as error:
            raise SystemExit(f"AVR and core differ, seed {seed}: {error}") from None
        avr.close()
        seed += 1
        ticks += CHUNK // 5
        tell(f"AVR = C: {done:,} records, {ticks:,} ticks")
    seconds = time.perf_counter() - began
    return {"records": done, "ticks": ticks, "seconds": seconds, "x_real": ticks * TICK / seconds}


def safety_times(harness: Path, phases: int, tell: Callable[[str], None]) -> dict[str, Any]:
    """Least and greatest delay [s] of each guard, over the phase of the event between two ticks."""
    measures = {
        "over_pressure": (over_pressure_delay, phases),
        "silence": (silence_delay, max(phases // 10, 4)),
        "hang": (hang_delay, max(phases // 10, 4)),
    }
    times: dict[str, Any] = {}
    avr = Avr(harness, firmware_folder() / "famrig.hex")
    for name, (measure, number) in measures.items():
        delays = [measure(avr, TICK * k / number) for k in range(number)]
        avr.take()
        times[name] = {"phases": number, "least_s": min(delays), "greatest_s": max(delays)}
        tell(f"{name}: {min(delays):.6f} to {max(delays):.6f} s in {number} phases")
    return times


def within_targets(times: dict[str, Any]) -> bool:
    """Whether every delay is as it must be."""
    quick = all(times[name]["greatest_s"] <= limit for name, limit in TARGETS_S.items())
    ends = (times["silence"]["least_s"], times["silence"]["greatest_s"])
    return quick and all(abs(end - SILENCE_S) <= SILENCE_TOLERANCE_S for end in ends)


def main() -> None:
    """Run all of it; exit status 1 where anything differs or is late."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--ticks", type=int, default=3_000_000, help="Python = C")
    parser.add_argument("--records", type=int, default=100_000, help="AVR = C")
    parser.add_argument("--phases", type=int, default=1000, help="of the over-pressure")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()

    def tell(text: str) -> None:
        print(text, flush=True)

    with tempfile.TemporaryDirectory() as folder:
        library = build_native(folder)
        result: dict[str, Any] = {"python_c": port_equals_core(library, options.ticks, tell)}
        harness = build_harness(Path(folder))
        if harness is None:
            tell("no libsimavr: the AVR is left out")
        else:
            result["avr_c"] = avr_equals_core(library, harness, options.records, tell)
            result["safety"] = safety_times(harness, options.phases, tell)
    if options.json:
        options.json.write_text(json.dumps(result, indent=2) + "\n")
    if "safety" in result and not within_targets(result["safety"]):
        raise SystemExit("a safety time is out of its target")


if __name__ == "__main__":
    main()

"""The firmware: one program, three executions, its safety times; and a transducer that lies.

    python benchmarks/rig_firmware.py identity [--ticks N] [--records N] [--phases N] [--json FILE]
    python benchmarks/rig_firmware.py faults [--cases 1000] [--sound 200] [--seed 0] [--json FILE]

`identity`: Python = C = AVR under simavr, byte for byte. A host that misbehaves sends commands right,
wrong and damaged, the pressure wanders, steps and fails, the device is reset at random. Needs `cc`; the
AVR part needs libsimavr (Debian: libsimavr-dev). The program that runs is the prebuilt
`rig/firmware/famrig.hex`.

`faults`: does the rig trip in time, and only then? Faults: no counts, full scale, frozen at its
last reading, stuck at another one, not varying by more than a count; before the start, while the
pressure rises, while it is held; random set pressures, limits and gains; air, and water without its
relief valve. A fault passes where the true pressure exceeds neither the limit by 2 % nor the set
pressure by 25 psi, whether the test is refused, trips or goes on. A combination that exceeds them
with a sound transducer too (water, a large step and a large integral gain) is no fault's doing: it
is replaced by the next one and counted as unsound. Sound tests have the published gains, random
pressures and strokes: none may trip.
"""

import argparse
import collections
import dataclasses
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

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

from rig.control import Control, Rig
from rig.device import Device, firmware_folder
from rig.errors import RigError, RigFault
from rig.link import VirtualLink
from rig.simulation import HydraulicCircuit, PneumaticCircuit, SimulatedRig

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


PSI, INCH = 6894.757293168361, 0.0254
KINDS = ("no counts", "full scale", "frozen", "stuck", "not varying")
WHEN = ("before", "rising", "held", "stepping")
GAINS = {"air": (4.0, 2.0), "water": (0.0, 5.0)}
"""Table 3.2 of the reference work, 7/8 in: Kp [counts/psi], Ki [counts/(psi s)]."""
HELD = 12.0
"""Time [s] under a fault."""
FULL, SHORT = 80.0, 15.0
"""Time [s] of a stroke in every tenth sound test, and in the others."""
OVER_LIMIT, OVER_SET = 0.02, 25 * PSI
MIXED_SEED = 7919


class LyingDevice(NativeDevice):
    """The firmware behind a transducer that lies from a moment on.

    Attributes:
        lie: from the true counts to what is read, or None while it is sound.
        last: what was read last.
    """

    lie: Callable[[int], int] | None = None
    last = 0

    def tick(self, pressure_counts: int, force_counts: int) -> None:
        """As `NativeDevice.tick`, with what the transducer says."""
        self.last = pressure_counts if self.lie is None else self.lie(pressure_counts)
        super().tick(self.last, force_counts)


@dataclasses.dataclass(frozen=True)
class Case:
    """One fault.

    Attributes:
        fluid: "air" or "water".
        kind: of `KINDS`.
        when: of `WHEN`.
        set_psi: what is held.
        limit_psi: of the rig.
        gains: Kp [counts/psi], Ki [counts/(psi s)].
        after_s: from the start, or from the higher set pressure, to the fault.
        below_psi: how far below the set pressure a stuck one reads.
        seed: of noise.
    """

    fluid: str
    kind: str
    when: str
    set_psi: float
    limit_psi: float
    gains: tuple[float, float]
    after_s: float
    below_psi: float
    seed: int


def random_case(rng: np.random.Generator, seed: int) -> Case:
    """A combination of everything, small set pressures as frequent as large ones."""
    fluid = str(rng.choice(["air", "water"]))
    limit = float(rng.choice([60.0, 110.0]))
    low = 2.0 if fluid == "air" else 5.0  # from where the feed-forward is known
    when = str(rng.choice(WHEN))
    air = rng.uniform(1, 8), rng.uniform(0.5, 6)
    water = rng.uniform(0, 3), rng.uniform(1, 8)
    return Case(
        fluid=fluid,
        kind=str(rng.choice(KINDS)),
        when=when,
        set_psi=float(np.exp(rng.uniform(np.log(low), np.log(0.85 * limit)))),
        limit_psi=limit,
        gains=air if fluid == "air" else water,
        after_s=float(
            rng.uniform(0, 0.4) if when in {"rising", "stepping"} else rng.uniform(0.5, 8)
        ),
        below_psi=float(rng.uniform(-5, 25)),
        seed=seed,
    )


def fault_of(
    case: Case, device: LyingDevice, counts: Callable[[float], int]
) -> Callable[[int], int]:
    """What the transducer says from now on."""
    rng = np.random.default_rng(case.seed)
    stuck = counts((case.set_psi - case.below_psi) * PSI)
    last = device.last or counts(0.0)
    return {
        "no counts": lambda _: 0,
        "full scale": lambda _: 1023,
        "frozen": lambda _: last,
        "stuck": lambda _: stuck,
        "not varying": lambda _: last + int(rng.integers(0, 2)),
    }[case.kind]


def try_case(case: Case, library: Path, *, sound: bool = False) -> tuple[float, float, str]:
    """Highest true pressure over set pressure and over limit [Pa], and what happened.

    Args:
        case: the fault.
        library: from `build_native`.
        sound: leave the fault out.
    """
    circuit = PneumaticCircuit() if case.fluid == "air" else HydraulicCircuit(relief=None)
    device = LyingDevice(library)
    sim = SimulatedRig(circuit, device=device, seed=case.seed)
    peak = 0.0
    step = sim.plant.step

    def watched(now: float, dt: float, output: int, dump_open: bool) -> None:
        nonlocal peak
        step(now, dt, output, dump_open)
        peak = max(peak, sim.pressure)

    sim.plant.step = watched
    control = Control.per_psi(*case.gains)
    limit, wanted = case.limit_psi * PSI, case.set_psi * PSI
    begin = 0.0
    if case.when == "before" and not sound:
        device.lie = fault_of(case, device, sim.pressure_sensor.counts)
    try:
        rig = Rig(VirtualLink(sim), sim.calibration(), pressure_limit=limit, control=control)
        with rig:
            if case.when == "stepping":
                lowest = 0.0 if case.fluid == "air" else 5 * PSI
                rig.set_pressure(max(wanted / 2, lowest))
                rig.wait(2.0)
            rig.set_pressure(wanted)
            begin = sim.now
            if case.when != "before":
                rig.wait(case.after_s)
                if not sound:
                    device.lie = fault_of(case, device, sim.pressure_sensor.counts)
            rig.wait(HELD)
            said = "went on"
    except (RigError, RigFault) as error:
        said = type(error).__name__ + ": " + str(error)
    sim.advance(0.5)
    return peak - wanted, peak - limit, f"{said} [{sim.now - begin:.2f} s]"


def sound_test(number: int, seed: int, library: Path) -> str:
    """What happened in a test with nothing wrong: published gains, random pressures, strokes."""
    rng = np.random.default_rng([seed, MIXED_SEED, number])
    fluid = ("air", "water")[number % 2]
    circuit = PneumaticCircuit() if fluid == "air" else HydraulicCircuit()
    device = NativeDevice(library)
    sim = SimulatedRig(circuit, device=device, seed=int(rng.integers(1 << 30)))
    rate = float(rng.choice([0.02, 0.04] if fluid == "water" else [0.02, 0.04, 0.2])) * INCH
    control = Control.per_psi(*GAINS[fluid])
    pressures = rng.uniform(0, 100, 3)
    if fluid == "water":  # with Kp = 0 a step by 30 psi truly overshoots by as much
        pressures = np.clip(np.cumsum(rng.uniform([5, -20, -20], 25)), 5, 100)
    try:
        with Rig(
            VirtualLink(sim), sim.calibration(), pressure_limit=110 * PSI, control=control
        ) as rig:
            for pressure in pressures:
                rig.set_pressure(float(pressure) * PSI)
                rig.wait(float(rng.uniform(2, 6)))
                stroke = float(rng.uniform(0.3, 3.0)) * INCH
                stroke = min(stroke, rate * (FULL if number % 10 == 0 else SHORT))
                sim.machine.start(2, rate, stroke=stroke)
                while sim.machine.busy:
                    rig.wait(0.5)
    except (RigError, RigFault) as error:
        return f"{fluid} {np.round(pressures, 1)} {rate / INCH:g} in/s {sim.now:.2f} s: {error}"
    return ""


def exceeds(case: Case, over_set: float, over_limit: float) -> bool:
    """Whether the true pressure was higher than it may be [Pa]."""
    return over_set > OVER_SET or over_limit > OVER_LIMIT * case.limit_psi * PSI


def try_faults(
    number: int, seed: int, library: Path, tell: Callable[[str], None]
) -> dict[str, Any]:
    """So many faults: the highest pressures, how many exceeded what they may, and how they ended."""
    rng = np.random.default_rng(seed)
    outcomes: collections.Counter[str] = collections.Counter()
    found: dict[str, Any] = {"cases": 0, "exceeded": 0, "unsound": 0}
    over_set, over_limit = [], []
    while found["cases"] < number:
        case = random_case(rng, int(rng.integers(1 << 30)))
        by_set, by_limit, said = try_case(case, library)
        if exceeds(case, by_set, by_limit):
            without = try_case(case, library, sound=True)
            if exceeds(case, *without[:2]) or "TRIP" in without[2]:
                found["unsound"] += 1
                continue
            found["exceeded"] += 1
            tell(f"EXCEEDED by {by_set / PSI:.1f} psi: {case}: {said}")
        found["cases"] += 1
        outcomes[said.split(" at ")[0].split(";")[0][:50]] += 1
        over_set.append(by_set / PSI)
        over_limit.append(by_limit / PSI / case.limit_psi)
    for said, cases in outcomes.most_common():
        tell(f"{cases:6d}  {said}")
    return found | {
        "over_set_psi": max(over_set, default=0.0),
        "over_limit": max(over_limit, default=0.0),
    }


def identity(options: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """What the executions agreed on and the safety times, and whether these are within their targets."""
    with tempfile.TemporaryDirectory() as folder:
        library = build_native(folder)
        found: dict[str, Any] = {"python_c": port_equals_core(library, options.ticks, tell)}
        harness = build_harness(Path(folder))
        if harness is None:
            tell("no libsimavr: the AVR is left out")
            return found, True
        found["avr_c"] = avr_equals_core(library, harness, options.records, tell)
        found["safety"] = safety_times(harness, options.phases, tell)
    return found, within_targets(found["safety"])


def faults(options: argparse.Namespace) -> tuple[dict[str, Any], bool]:
    """What faults and sound tests came to, and whether none was too high and none tripped."""
    with tempfile.TemporaryDirectory() as folder:
        library = build_native(folder)
        found = {"faults": try_faults(options.cases, options.seed, library, tell)}
        tests = (sound_test(number, options.seed, library) for number in range(options.sound))
        tripped = list(filter(None, tests))
    for text in tripped:
        tell(f"A SOUND TEST STOPPED: {text}")
    found["sound"] = {"tests": options.sound, "tripped": len(tripped)}
    return found, not (found["faults"]["exceeded"] or tripped)


def tell(text: str) -> None:
    """Print a line at once."""
    print(text, flush=True)


def main() -> None:
    """Run one of both; exit status 1 where anything differs, is late, too high or trips for nothing."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("identity")
    one.set_defaults(run=identity)
    one.add_argument("--ticks", type=int, default=3_000_000, help="Python = C")
    one.add_argument("--records", type=int, default=100_000, help="AVR = C")
    one.add_argument("--phases", type=int, default=1000, help="of the over-pressure")
    other = commands.add_parser("faults")
    other.set_defaults(run=faults)
    other.add_argument("--cases", type=int, default=1000)
    other.add_argument("--sound", type=int, default=200)
    other.add_argument("--seed", type=int, default=0)
    for command in (one, other):
        command.add_argument("--json", type=Path)
    options = parser.parse_args()
    found, right = options.run(options)
    tell(json.dumps(found, indent=2))
    if options.json:
        options.json.write_text(json.dumps(found, indent=2) + "\n")
    sys.exit(not right)


if __name__ == "__main__":
    main()

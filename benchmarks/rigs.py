"""The rig without hardware: its firmware in three executions, its guards, its link, its simulated tests.

`firmware`: Python = C = AVR under simavr, byte for byte, while a host that misbehaves sends commands
right, wrong and damaged, the pressure wanders, steps and fails, and the device is reset at random. Needs
`cc`; the AVR part needs libsimavr (Debian: libsimavr-dev).

`faults`: no counts, full scale, frozen, stuck or not varying, at random times, pressures, limits, gains. A
fault that exceeds the limits with a sound transducer too is replaced by the next one.

`isobars`: whole tests with the published gains through device, line, recorder, machine log and analysis;
circuits, noise and friction are ASSUMED where the work prints nothing. With Kp = 0 in water the integral
needs half a second to follow a turn of the stroke at rest length, in which the pressure is out by some
7 psi: most of that standard deviation.
"""

import contextlib
import dataclasses
import os
import pty
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from row import CannotRunError, Case, tell

# isort: split
from avr import (
    Avr,
    build_harness,
    hang_delay,
    lock_step,
    over_pressure_delay,
    silence_delay,
)
from faulty_channel import FaultyChannel
from native import NativeDevice, build_native
from session_fuzz import Fuzz

from famjax.app import simulate
from famjax.units import INCH, PSI
from rig.control import Control, Rig
from rig.device import Device, firmware_folder
from rig.errors import RigError, RigFault
from rig.journal import Journal, read_journal
from rig.link import Link, Lost, Session, VirtualLink, serial_opener
from rig.plan import Isobaric, PlanFile
from rig.protocol import Sample, parse
from rig.simulation import HydraulicCircuit, PneumaticCircuit, SimulatedRig

TICK, CHUNK = 2e-3, 100_000  # s; ticks of one seed
TICKS, RECORDS, PHASES = 3_000_000, 100_000, 1000
CASES, SOUND, SAMPLES, KILLS, TEARS, DATASETS = 1000, 200, 10_000_000, 50, 1000, 20
KINDS = ("no counts", "full scale", "frozen", "stuck", "not varying")
WHEN = ("before", "rising", "held", "stepping")
GAINS = {"air": (4.0, 2.0), "water": (0.0, 5.0)}
"""Table 3.2 of the reference work, 7/8 in: Kp [counts/psi], Ki [counts/(psi s)]."""


def _library(folder: str, **options: Any) -> Path:
    if shutil.which("cc") is None:
        raise CannotRunError("needs a C compiler, cc")
    return build_native(Path(folder), **options)


def firmware(_: Case) -> dict[str, float]:
    """What the executions agree on, and the delays of the guards over the phase between two ticks."""
    with tempfile.TemporaryDirectory() as folder:
        library = _library(folder)
        for seed in range(TICKS // CHUNK):
            port, core, fuzz = Device(), NativeDevice(library), Fuzz(1000 + seed)
            for tick in fuzz.ticks(CHUNK):
                for device in (port, core):
                    if tick.reset:
                        device.reset(tick.reset)
                    device.feed(tick.bytes_in)
                    device.tick(tick.pressure, tick.force)
                said = port.take()
                assert said == core.take(), f"seed {seed}: port and core differ"
                assert port.output == core.output, f"seed {seed}: port and core differ"
                fuzz.hear(said)
            tell(f"Python = C: {(seed + 1) * CHUNK:,} ticks")
        found: dict[str, float] = {"Python = C, equal ticks": float(TICKS)}
        harness = build_harness(Path(folder))
        if harness is None:
            return found
        done = seed = 0
        program = firmware_folder() / "famrig.hex"
        while done < RECORDS:
            avr = Avr(harness, program)
            done += lock_step(NativeDevice(library), avr, Fuzz(2000 + seed), CHUNK // 5)
            avr.close()
            seed += 1
            tell(f"AVR = C: {done:,} records")
        avr = Avr(harness, program)

        def delays(measure: Callable[[Avr, float], float], phases: int) -> list[float]:
            times = [measure(avr, TICK * k / phases) for k in range(phases)]
            avr.take()
            return times

        silence = delays(silence_delay, PHASES // 10)
        return found | {
            "AVR = C, equal records": float(done),
            "over-pressure to output 0 [s]": max(delays(over_pressure_delay, PHASES)),
            "silence to output 0, latest [s]": max(silence),
            "silence to output 0, earliest [s]": min(silence),
            "hang to output 0 [s]": max(delays(hang_delay, PHASES // 10)),
        }


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
class Lie:
    """One fault: fluid, kind of `KINDS`, when of `WHEN`, psi, gains per psi, s, seed of noise."""

    fluid: str
    kind: str
    when: str
    set_psi: float
    limit_psi: float
    gains: tuple[float, float]
    after_s: float
    below_psi: float
    seed: int

    @classmethod
    def drawn(cls, rng: np.random.Generator) -> "Lie":
        """A combination of everything, small set pressures as frequent as large ones."""
        fluid, limit = str(rng.choice(["air", "water"])), float(rng.choice([60.0, 110.0]))
        low = 2.0 if fluid == "air" else 5.0  # from where the feed-forward is known
        when = str(rng.choice(WHEN))
        air, water = (
            (rng.uniform(1, 8), rng.uniform(0.5, 6)),
            (rng.uniform(0, 3), rng.uniform(1, 8)),
        )
        early = when in {"rising", "stepping"}
        return cls(
            fluid, str(rng.choice(KINDS)), when,
            float(np.exp(rng.uniform(np.log(low), np.log(0.85 * limit)))), limit,
            air if fluid == "air" else water, float(rng.uniform(*((0, 0.4) if early else (0.5, 8)))),
            float(rng.uniform(-5, 25)), int(rng.integers(1 << 30)),
        )  # fmt: skip

    def says(self, device: LyingDevice, counts: Callable[[float], int]) -> Callable[[int], int]:
        """What the transducer says from now on."""
        rng, last = np.random.default_rng(self.seed), device.last or counts(0.0)
        stuck = counts((self.set_psi - self.below_psi) * PSI)
        return {
            "no counts": lambda _: 0,
            "full scale": lambda _: 1023,
            "frozen": lambda _: last,
            "stuck": lambda _: stuck,
            "not varying": lambda _: last + int(rng.integers(0, 2)),
        }[self.kind]

    def exceeds(self, library: Path, *, sound: bool = False) -> tuple[bool, str]:
        """Whether the true pressure gets too high, and how it ends; without the fault if sound."""
        circuit = PneumaticCircuit() if self.fluid == "air" else HydraulicCircuit(relief=None)
        device, peak = LyingDevice(library), 0.0
        sim = SimulatedRig(circuit, device=device, seed=self.seed)
        step = sim.plant.step

        def watched(signal: float, dump: float | bool, length: float) -> None:
            nonlocal peak
            step(signal, dump, length)
            peak = max(peak, sim.pressure)

        sim.plant.step = watched  # pyright: ignore[reportAttributeAccessIssue]
        limit, wanted = self.limit_psi * PSI, self.set_psi * PSI

        def lie() -> None:
            if not sound:
                device.lie = self.says(device, sim.pressure_sensor.counts)

        if self.when == "before":
            lie()
        said = "went on"
        try:
            with Rig(VirtualLink(sim), sim.calibration(), pressure_limit=limit,
                     control=Control.per_psi(*self.gains)) as rig:  # fmt: skip
                if self.when == "stepping":
                    rig.set_pressure(max(wanted / 2, 0.0 if self.fluid == "air" else 5 * PSI))
                    rig.wait(2.0)
                rig.set_pressure(wanted)
                if self.when != "before":
                    rig.wait(self.after_s)
                    lie()
                rig.wait(12.0)
        except (RigError, RigFault) as error:
            said = f"{type(error).__name__}: {error}"
        sim.advance(0.5)
        return peak > min(wanted + 25 * PSI, 1.02 * limit), said


def _sound_test(number: int, library: Path) -> str:
    """Why a test with nothing wrong stopped: published gains, random pressures, strokes."""
    rng = np.random.default_rng([0, 7919, number])
    fluid = ("air", "water")[number % 2]
    circuit = PneumaticCircuit() if fluid == "air" else HydraulicCircuit()
    sim = SimulatedRig(circuit, device=NativeDevice(library), seed=int(rng.integers(1 << 30)))
    rate = float(rng.choice([0.02, 0.04] if fluid == "water" else [0.02, 0.04, 0.2])) * INCH
    pressures = rng.uniform(0, 100, 3)
    if fluid == "water":  # with Kp = 0 a step by 30 psi truly overshoots by as much
        pressures = np.clip(np.cumsum(rng.uniform([5, -20, -20], 25)), 5, 100)
    try:
        with Rig(VirtualLink(sim), sim.calibration(), pressure_limit=110 * PSI,
                 control=Control.per_psi(*GAINS[fluid])) as rig:  # fmt: skip
            for pressure in pressures:
                rig.set_pressure(float(pressure) * PSI)
                rig.wait(float(rng.uniform(2, 6)))
                stroke = float(rng.uniform(0.3, 3.0)) * INCH
                stroke = min(stroke, rate * (80.0 if number % 10 == 0 else 15.0))
                sim.machine.start(2, rate, stroke=stroke)
                while sim.machine.busy:
                    rig.wait(0.5)
    except (RigError, RigFault) as error:
        return f"{fluid} {np.round(pressures, 1)} psi, {rate / INCH:g} in/s: {error}"
    return ""


def faults(_: Case) -> dict[str, float]:
    """A transducer that lies, and sound tests."""
    rng, cases, exceeded = np.random.default_rng(0), 0, 0
    with tempfile.TemporaryDirectory() as folder:
        library = _library(folder)
        while cases < CASES:
            lie = Lie.drawn(rng)
            high, said = lie.exceeds(library)
            if high:
                without, sound_said = lie.exceeds(library, sound=True)
                if without or "TRIP" in sound_said:
                    continue
                exceeded += 1
                tell(f"too high: {lie}: {said}")
            cases += 1
        tripped = [why for k in range(SOUND) if (why := _sound_test(k, library))]
    for why in tripped:
        tell(f"a sound test stopped: {why}")
    return {
        "true pressures over the limit + 2 % or the set pressure + 25 psi": float(exceeded),
        "false trips in sound tests": float(len(tripped)),
    }


def link(_: Case) -> dict[str, float]:
    """One damaged byte in a hundred, kills of the recorder, and torn journals."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        lost, wrong = damaged_line(SAMPLES, folder)
        return {
            "damaged line, records lost": float(lost),
            "damaged line, wrong records": float(wrong),
            "recorder killed, largest loss [s]": max(
                killed_recorder(folder / f"{k}.fam", random.Random(k)) for k in range(KILLS)
            ),
            "torn journals, wrong rows": float(torn_journals(TEARS, folder)),
        }


def damaged_line(samples: int, folder: Path, seed: int = 1) -> tuple[int, int]:
    """Records lost, and records that the device never sent, through a line that damages bytes both ways."""
    compiled = shutil.which("cc") is not None
    device = (NativeDevice(_library(str(folder), bytes_per_tick=23)) if compiled
              else Device(bytes_per_tick=23))  # fmt: skip
    up = FaultyChannel(baud=115_200, damage=0.01, seed=seed)
    down = FaultyChannel(damage=0.01, seed=seed + 1)
    rng, turn = np.random.default_rng(seed), np.arange(1 << 16) * 2 * np.pi / (1 << 16)
    pressure, force = (
        (middle + reach * np.sin(waves * turn) + rng.normal(0, 2, turn.size)).astype(int).tolist()
        for middle, reach, waves in ((300, 60, 40), (500, 200, 20))
    )
    session = Session(first_id=seed)
    begin = [("hello",), ("strict", 1), ("trip", 900), ("gain", 4, 2), ("run",)]
    command = session.command(*begin.pop(0))
    recent: set[bytes] = set()
    older: set[bytes] = set()
    tick = got = lost = wrong = 0
    rest, first = b"", -1
    while got < samples:
        made = b""
        for _ in range(2):  # ticks between two looks of the host at its bytes
            tick += 1
            device.feed(up.receive(tick * TICK))
            device.tick(pressure[tick % turn.size], force[tick % turn.size])
            made += device.take()
        now = tick * TICK
        down.send(made, now)
        *lines, rest = (rest + made).split(b"\n")
        recent.update(lines)
        if len(recent) > 5000:  # 50 s: more than the device can repeat
            recent, older = set(), recent
        session.keep_alive(now)
        if begin and command.done:
            command = session.command(*begin.pop(0))
        for event in session.feed(down.receive(now), now):
            if isinstance(event, Lost):
                lost += event.records
            elif isinstance(event, Sample) and first < 0:
                first = event.seq
        for line in session.take_lines().split(b"\n"):
            if line.startswith(b"T"):
                got += 1
                wrong += line not in recent and line not in older
        up.send(session.poll(now), now)
    assert session.newest is not None
    # What is neither here nor still asked for was lost, whether it was reported or not.
    return max(session.newest.seq + 1 - first - got - len(session.gaps), lost), wrong


class StreamingDevice:
    """A device behind a pty in real time; what it has sent is known at every moment."""

    def __init__(self) -> None:
        self.master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(self._slave)
        self.sent: list[tuple[float, int]] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        device, start, tick = Device(), time.monotonic(), 0
        while not self._closing.is_set():
            time.sleep(TICK)
            while tick * TICK < time.monotonic() - start:
                tick += 1
                with contextlib.suppress(BlockingIOError):
                    device.feed(os.read(self.master, 4096))
                device.tick(200 + tick % 7, 500)
                with contextlib.suppress(
                    BlockingIOError
                ):  # nothing reads: as from a UART, it is gone
                    os.write(self.master, device.take())
                if tick % 5 == 0:
                    self.sent.append((time.monotonic(), tick // 5 - 1))

    def close(self) -> set[int]:
        """End the thread; the records that were not read from the port."""
        self._closing.set()
        self._thread.join()
        os.set_blocking(self._slave, False)
        data = b""
        with contextlib.suppress(BlockingIOError):
            while piece := os.read(self._slave, 4096):
                data += piece
        os.close(self.master)
        os.close(self._slave)
        return {one.seq for one in map(parse, data.split(b"\n")) if isinstance(one, Sample)}


def killed_recorder(path: Path, rng: random.Random) -> float:
    """What SIGKILL costs [s]: records that were taken from the port and are not in the journal."""
    device = StreamingDevice()
    child = subprocess.Popen([sys.executable, __file__, device.path, str(path)])
    until = time.monotonic() + 20
    while not (path.exists() and path.stat().st_size > 2000) and time.monotonic() < until:
        time.sleep(0.05)
    time.sleep(rng.uniform(0.1, 1.5))
    killed_at = time.monotonic()
    os.kill(child.pid, signal.SIGKILL)
    child.wait()
    unread = device.close()
    last = int(read_journal(path).column("seq").max())
    return 0.01 * len({n for at, n in device.sent if at <= killed_at and n > last} - unread)


def record_for_ever(port: str, path: str) -> None:
    """The recorder that is killed."""
    line = Link(serial_opener(port))
    line.attach(Journal(path, lambda: line.now))
    line.command("hello")
    while True:
        line.keep_alive()
        line.sleep(0.1)


def torn_journals(tears: int, folder: Path) -> int:
    """Rows that were never sent, read from a journal cut, zeroed or with pages left out at random."""
    path, torn = folder / "whole.fam", folder / "torn.fam"
    device, session, now = Device(), Session(), 0.0
    with Journal(path, lambda: now) as journal:
        for tick in range(1, 30_001):
            now = tick * TICK
            device.tick(200 + tick % 11, 500 + tick % 13)
            session.feed(device.take(), now)
            journal.lines(session.take_lines())
            if tick % 500 == 0:
                journal.note("set", pressure_Pa=float(tick))
    data, rng, wrong, page = path.read_bytes(), random.Random(1), 0, 4096
    whole = {tuple(row) for row in read_journal(path).rows.tolist()}
    for tear in range(tears):
        at, other = (rng.randrange(len(data)) for _ in range(2))
        here, there = at // page * page, other // page * page
        torn.write_bytes((
            data[:at],  # cut short
            data[:here] + bytes(page) + data[here + page :],  # a page never written
            data[:at] + data[at + rng.randrange(1, 200) :],  # two halves of different lines meet
            data[:here] + data[there : there + page] + data[here + page :],  # a page of elsewhere
        )[tear % 4])  # fmt: skip
        with contextlib.suppress(ValueError):  # not readable at all
            wrong += len({tuple(row) for row in read_journal(torn).rows.tolist()} - whole)
    return wrong


def isobars(_: Case) -> dict[str, float]:
    """Pressure of whole tests, 10 pressures x 3 cycles at 0.02 in/s."""
    found = {}
    pressures = tuple(10.0 * PSI * (k + 1) for k in range(10))
    plan = Isobaric(pressures, cycles=3, stroke=3.4 * INCH, rate=0.02 * INCH, settle=10.0)
    for fluid, gains in GAINS.items():
        file = PlanFile(plan, fluid, 115 * PSI, Control.per_psi(*gains))
        with tempfile.TemporaryDirectory() as folder:
            bars = simulate(file, folder).analysis.characterisation.isobars
        spread = [bar.pressure_std / PSI for bar in bars]
        found |= {
            f"{fluid}, largest error of a mean [psi]": max(
                abs(bar.pressure - bar.set_pressure) / PSI for bar in bars
            ),
            f"{fluid}, largest standard deviation [psi]": max(spread),
            f"{fluid}, least standard deviation [psi]": min(spread),
        }
    return found


PLAN = """[plan]
pressures_psi = [40, 70, 100]
cycles = 2
stroke_in = 3.4
rate_in_per_s = 0.04
settle_s = 10
[rig]
circuit = "air"
pressure_limit_psi = 110
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
"""


if __name__ == "__main__":
    record_for_ever(*sys.argv[1:])

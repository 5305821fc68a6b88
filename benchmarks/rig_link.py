"""Nothing lost, nothing wrong: the rig's link and journal under damage, kills and torn files.

    python benchmarks/rig_link.py [--samples N] [--kills N] [--tears N] [--damage P] [--baud B]
        [--json FILE]

1. One damaged byte in a hundred, both ways, virtual time: records that the device made against
   records that the session let through, byte by byte.
2. A recorder killed with SIGKILL at random times while a device streams to it over a pty in real
   time: records that the recorder had taken from the port and that are not in the journal; and how
   far the journal is behind the device altogether, which on a busy machine is the time for which
   the recorder was not given a processor.
3. A journal cut, zeroed in pages, or with pages left out, at random places: rows that were read back
   and that the device never sent.
"""

import argparse
import contextlib
import dataclasses
import json
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
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "rig"))

from faulty_channel import FaultyChannel  # pyright: ignore[reportMissingImports]
from native import NativeDevice, build_native  # pyright: ignore[reportMissingImports]

from rig.device import Device
from rig.journal import Journal, read_journal
from rig.link import Link, serial_opener
from rig.protocol import Sample, parse
from rig.session import Lost, Session

SLICE = 2
"""Ticks between two looks of the host at its bytes: 4 ms."""
COUNTS = 1 << 16
"""Length of the plant's repeated course [ticks]."""
PAGE = 4096


def make_device(folder: Path, baud: int) -> Device:
    """The C core where there is a compiler, else its Python port, which sends the same bytes."""
    pace = {115_200: 23, 500_000: 100}[baud]
    if shutil.which("cc"):
        return NativeDevice(build_native(folder, bytes_per_tick=pace))
    return Device(bytes_per_tick=pace)


@dataclasses.dataclass
class Damaged:
    """What 1 % damaged bytes did."""

    samples: int = 0
    made: int = 0
    lost: int = 0
    lost_in_silence: int = 0
    wrong: int = 0
    recovered: int = 0
    bad_lines: int = 0
    spoilt_bytes: int = 0
    seconds: float = 0.0


class DamagedLine:
    """A device at the far end of a line with faults; what it truly sent is remembered for a while.

    Args:
        chances: of the faults of `FaultyChannel`, both ways.
        baud: of the line; the device keeps to it.
        folder: for the compiled core.
        seed: of faults and counts.
    """

    def __init__(self, chances: dict[str, float], baud: int, folder: Path, seed: int) -> None:
        self.device = make_device(folder, baud)
        damage, drop, duplicate = chances["damage"], chances["drop"], chances["duplicate"]
        self.up = FaultyChannel(baud=baud, damage=damage, drop=drop, duplicate=duplicate, seed=seed)
        self.down = FaultyChannel(damage=damage, drop=drop, duplicate=duplicate, seed=seed + 1)
        self.now = 0.0
        rng = np.random.default_rng(seed)
        turn = np.arange(COUNTS) * 2 * np.pi / COUNTS
        self._pressure = (
            (300 + 60 * np.sin(40 * turn) + rng.normal(0, 2, COUNTS)).astype(int).tolist()
        )
        self._force = (
            (500 + 200 * np.sin(20 * turn) + rng.normal(0, 2, COUNTS)).astype(int).tolist()
        )
        self._tick = 0
        self._recent: set[bytes] = set()
        self._older: set[bytes] = set()
        self._rest = b""

    def advance(self) -> bytes:
        """Two ticks; what has arrived at the host."""
        made = b""
        for _ in range(SLICE):
            self._tick += 1
            self.now = self._tick * 0.002
            arrived = self.up.receive(self.now)
            if arrived:
                self.device.feed(arrived)
            i = self._tick % COUNTS
            self.device.tick(self._pressure[i], self._force[i])
            made += self.device.take()
        if not made:
            return self.down.receive(self.now)
        self.down.send(made, self.now)
        *lines, self._rest = (self._rest + made).split(b"\n")
        self._recent.update(lines)
        if len(self._recent) > 5000:  # 50 s: more than the device can repeat
            self._recent, self._older = set(), self._recent
        return self.down.receive(self.now)

    def has_sent(self, line: bytes) -> bool:
        """Whether the device has sent just that line."""
        return line in self._recent or line in self._older


def damaged_line(
    samples: int, chances: dict[str, float], baud: int, folder: Path, seed: int
) -> Damaged:
    """Records through a line that damages bytes both ways, compared with what the device sent."""
    line, session, found = (
        DamagedLine(chances, baud, folder, seed),
        Session(first_id=seed),
        Damaged(),
    )
    for verb, *values in (("hello",), ("strict", 1), ("trip", 900), ("gain", 4, 2), ("run",)):
        session.command(verb, *values)
    began = reported = time.perf_counter()
    first = -1
    while found.samples < samples:
        data = line.advance()
        session.keep_alive(line.now)
        for event in session.feed(data, line.now):
            if isinstance(event, Lost):
                found.lost += event.records
            elif isinstance(event, Sample) and first < 0:
                first = event.seq
        for sent in session.take_lines().split(b"\n"):
            if sent.startswith(b"T"):
                found.samples += 1
                found.wrong += not line.has_sent(sent)
        line.up.send(session.poll(line.now), line.now)
        if time.perf_counter() - reported > 10:
            reported = time.perf_counter()
            progress = f"{found.samples:>10} records, {found.lost} lost, {found.wrong} wrong"
            print(f"  {progress}, {found.samples / (reported - began):.0f}/s", file=sys.stderr)
    found.made = (session.newest.seq + 1 if session.newest else 0) - first
    # What is neither here, nor reported as lost, nor still asked for, would be lost in silence.
    found.lost_in_silence = found.made - found.samples - len(session.gaps) - found.lost
    found.recovered, found.bad_lines = session.recovered, session.bad_lines
    found.spoilt_bytes = line.up.faulty + line.down.faulty
    found.seconds = time.perf_counter() - began
    return found


class StreamingDevice:
    """A device behind a pty in real time; what it has sent is known at every moment."""

    def __init__(self) -> None:
        self.master, slave = pty.openpty()
        tty.setraw(slave)
        os.set_blocking(self.master, False)
        self.path = os.ttyname(slave)
        self._slave = slave  # kept open: the pty outlives its readers
        self.device = Device()
        self.sent: list[tuple[float, int]] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        start, tick = time.monotonic(), 0
        while not self._closing.is_set():
            time.sleep(0.002)
            while tick * 0.002 < time.monotonic() - start:
                tick += 1
                with contextlib.suppress(BlockingIOError):
                    self.device.feed(os.read(self.master, 4096))
                self.device.tick(200 + tick % 7, 500)
                with contextlib.suppress(
                    BlockingIOError
                ):  # nothing reads: as from a UART, it is gone
                    os.write(self.master, self.device.take())
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
        taken = map(parse, data.split(b"\n"))
        return {sample.seq for sample in taken if isinstance(sample, Sample)}


def record_for_ever(port: str, path: str) -> None:
    """The recorder that is killed."""
    link = Link(serial_opener(port))
    link.attach(Journal(path, lambda: link.now, reserve_bytes=0))
    link.command("hello")
    while True:
        link.keep_alive()
        link.sleep(0.1)


@dataclasses.dataclass
class Kills:
    """What killing the recorder cost."""

    kills: int = 0
    worst_lost_s: float = 0.0
    worst_behind_s: float = 0.0
    median_behind_s: float = 0.0
    torn_lines: int = 0
    gaps: int = 0


def kill_recorder(kills: int, folder: Path, seed: int) -> Kills:
    """SIGKILL at random times."""
    rng, lost, behind, found = random.Random(seed), [], [], Kills()
    for kill in range(kills):
        device, path = StreamingDevice(), folder / f"kill{kill}.fam"
        child = subprocess.Popen([sys.executable, __file__, "--record", device.path, str(path)])
        until = time.monotonic() + 20
        while not (path.exists() and path.stat().st_size > 2000) and time.monotonic() < until:
            time.sleep(0.05)
        time.sleep(rng.uniform(0.1, 1.5))
        killed_at = time.monotonic()
        os.kill(child.pid, signal.SIGKILL)
        child.wait()
        unread = device.close()
        record = read_journal(path)
        last = int(record.column("seq").max())
        sent = {seq for at, seq in device.sent if at <= killed_at and seq > last}
        behind.append(len(sent) * 0.01)
        lost.append(len(sent - unread) * 0.01)
        found.torn_lines += len(record.damage)
        found.gaps += sum(gap.records for gap in record.missing)
        figures = f"{lost[-1] * 1e3:.0f} ms lost, {behind[-1] * 1e3:.0f} ms behind"
        print(f"  kill {kill + 1}: {figures}", file=sys.stderr)
    found.kills, found.worst_lost_s = kills, max(lost)
    found.worst_behind_s, found.median_behind_s = max(behind), sorted(behind)[kills // 2]
    return found


@dataclasses.dataclass
class Tears:
    """What is read from a torn journal."""

    tears: int = 0
    unreadable: int = 0
    wrong_rows: int = 0
    refused_rows: int = 0
    kept_mean: float = 0.0
    unlisted_losses: int = 0


def tear_journal(tears: int, folder: Path, seed: int) -> Tears:
    """A journal of 60 s cut, zeroed or with pages left out at random."""
    path = folder / "whole.fam"
    device, session, now = Device(), Session(), 0.0
    with Journal(path, lambda: now, reserve_bytes=0) as journal:
        for tick in range(1, 30_001):
            now = tick * 0.002
            device.tick(200 + tick % 11, 500 + tick % 13)
            session.feed(device.take(), now)
            journal.lines(session.take_lines())
            if tick % 500 == 0:
                journal.note("set", pressure_Pa=float(tick))
    data = path.read_bytes()
    whole = {tuple(row) for row in read_journal(path).rows.tolist()}
    rng, found, kept = random.Random(seed), Tears(tears), 0.0
    for tear in range(tears):
        torn = _torn(bytearray(data), rng, tear % 4)
        target = folder / "torn.fam"
        target.write_bytes(torn)
        try:
            record = read_journal(target)
        except ValueError:
            found.unreadable += 1
            continue
        rows = {tuple(row) for row in record.rows.tolist()}
        found.wrong_rows += len(rows - whole)
        found.refused_rows += len(record.refused)
        kept += len(rows) / len(whole)
        inside = sum(1 for row in whole - rows if _between(row, record.rows))
        found.unlisted_losses += abs(inside - sum(gap.records for gap in record.missing))
    found.kept_mean = kept / max(tears - found.unreadable, 1)
    return found


def _torn(data: bytearray, rng: random.Random, kind: int) -> bytes:
    at = rng.randrange(len(data))
    page = at // PAGE * PAGE
    if kind == 0:  # cut short
        return bytes(data[:at])
    if kind == 1:  # a page never written
        data[page : page + PAGE] = bytes(len(data[page : page + PAGE]))
    elif kind == 2:  # a piece left out: two halves of different lines meet
        del data[at : at + rng.randrange(1, 200)]
    else:  # a page of somewhere else
        other = rng.randrange(len(data)) // PAGE * PAGE
        data[page : page + PAGE] = data[other : other + PAGE]
    return bytes(data)


def _between(row: tuple[int, ...], rows: np.ndarray) -> bool:
    return len(rows) > 0 and bool(rows[0, 1] < row[1] < rows[-1, 1])


def main() -> None:
    """Run what is asked for and print, or write, the figures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--samples", type=int, default=10_000_000)
    parser.add_argument("--kills", type=int, default=50)
    parser.add_argument("--tears", type=int, default=1000)
    parser.add_argument("--damage", type=float, default=0.01)
    parser.add_argument("--drop", type=float, default=0.0)
    parser.add_argument("--duplicate", type=float, default=0.0)
    parser.add_argument("--baud", type=int, default=115_200, choices=(115_200, 500_000))
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--json", type=Path)
    parser.add_argument("--record", nargs=2, help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.record:
        record_for_ever(*given.record)
    results = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if given.samples:
            faults = {name: getattr(given, name) for name in ("damage", "drop", "duplicate")}
            results["damaged"] = damaged_line(given.samples, faults, given.baud, folder, given.seed)
        if given.kills:
            results["kills"] = kill_recorder(given.kills, folder, given.seed)
        if given.tears:
            results["tears"] = tear_journal(given.tears, folder, given.seed)
    text = json.dumps({k: dataclasses.asdict(v) for k, v in results.items()}, indent=2)
    if given.json:
        given.json.write_text(text + "\n", encoding="utf-8")
    print(text)


if __name__ == "__main__":
    main()

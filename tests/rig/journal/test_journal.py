"""The journal: nothing waits for the disk, and no torn file gives a wrong row."""

import errno
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from bare_rig import BareRig, Recorder

from famjax.app.isobaric import clocks
from rig.errors import RigError, RigFault
from rig.journal import Journal, Missing, read_journal
from rig.protocol import TICK_HZ, TICKS, Sample, frame

PAGE = 4096


def record(seq: int, boot: int = 0, **fields: int) -> bytes:
    values = {"p": 1000 + seq % 7, "q": 200, "f": 2500, "u": 0, "i": 0, "st": 0, **fields}
    return frame(f"T,{boot},{seq},{5 * seq + 5}," + ",".join(map(str, values.values())))


def until(holds: Callable[[], bool]) -> None:
    """Wait for another thread; ten seconds at most."""
    end = time.monotonic() + 10
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Ten seconds over a damaged line, with notes."""
    path = tmp_path_factory.mktemp("journal") / "whole.fam"
    recorder = Recorder(BareRig(1, damage=0.004))
    with Journal(path, lambda: recorder.link.now, reserve_bytes=0) as journal:
        recorder.link.attach(journal)
        for second in range(10):
            recorder.run(1.0)
            journal.note("mark", second=second, text="Größe * 5")
        recorder.link.attach(None)
    return path


def test_what_goes_in_comes_out_in_order(whole: Path) -> None:
    record = read_journal(whole)
    assert record.refused == record.missing == ()
    assert record.damaged_bytes == record.missing_notes == 0
    seq = record.column("seq")
    assert (np.diff(seq) == 1).all()
    assert seq.size > 950
    assert [note["second"] for note in record.notes_of("mark")] == list(range(10))
    assert record.notes_of("mark")[0]["text"] == "Größe * 5"
    assert (np.diff([note["n"] for note in record.notes]) == 1).all()


def tears(data: bytes, number: int) -> Iterator[bytes]:
    """Cut short, pages never written, pieces left out, pages of somewhere else, flipped bits."""
    rng = random.Random(1)
    for tear in range(number):
        torn, at = bytearray(data), rng.randrange(len(data))
        page = at // PAGE * PAGE
        match tear % 5:
            case 0:
                del torn[at:]
            case 1:
                torn[page : page + PAGE] = bytes(len(torn[page : page + PAGE]))
            case 2:
                del torn[at : at + rng.randrange(1, 300)]
            case 3:
                other = rng.randrange(len(data)) // PAGE * PAGE
                torn[page : page + PAGE] = torn[other : other + PAGE]
            case 4:
                torn[at] ^= 1 << rng.randrange(8)
        yield bytes(torn)


def test_no_tear_gives_a_wrong_row_and_every_loss_is_listed(whole: Path, tmp_path: Path) -> None:
    true = {row[1]: row for row in map(tuple, read_journal(whole).rows.tolist())}
    path = tmp_path / "torn.fam"
    damaged = 0
    for torn in tears(whole.read_bytes(), 60):
        path.write_bytes(torn)
        found = read_journal(path)
        rows = {row[1]: row for row in map(tuple, found.rows.tolist())}
        assert len(rows) == len(found.rows)
        assert all(true.get(seq) == row for seq, row in rows.items())
        first, last = min(rows), max(rows)
        inside = {seq for seq in true if first < seq < last} - rows.keys()
        listed = {s for gap in found.missing for s in range(gap.first, gap.first + gap.records)}
        assert inside == listed
        assert not any(gap.noted for gap in found.missing)
        damaged += bool(found.damaged_bytes)
    assert damaged > 30


def test_a_row_that_contradicts_its_neighbours_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "forged.fam"
    lines = [record(k) for k in range(20)]
    lines[7] = frame("T,0,7,41,1000,200,2500,0,0,0")  # a tick late, its CRC right
    lines.append(record(12, u=5))  # another line with a number that was there
    path.write_bytes(b"".join(lines))
    found = read_journal(path)
    assert found.refused == ((0, 7), (0, 12), (0, 12))
    assert found.missing == (Missing(0, 7, 1, False), Missing(0, 12, 1, False))


def test_losses_of_the_line_and_of_the_file_are_told_apart(tmp_path: Path) -> None:
    path = tmp_path / "lost.fam"
    with Journal(path, lambda: 0.0, reserve_bytes=0) as journal:
        journal.lines(b"".join(record(k) for k in range(5)))
        journal.lines(b"".join(record(k) for k in (8, 9, 12, 13, 14)))
        journal.note("lost", boot=0, first=5, records=3)
    assert read_journal(path).missing == (Missing(0, 5, 3, True), Missing(0, 10, 2, False))


def test_boots_are_kept_apart(tmp_path: Path) -> None:
    path = tmp_path / "boots.fam"
    path.write_bytes(
        b"".join([record(k) for k in range(9)] + [record(k, boot=1) for k in range(4)])
    )
    found = read_journal(path)
    assert found.epoch.tolist() == [0] * 9 + [1] * 4
    assert found.missing == ()


def test_a_page_that_stands_twice_goes_back_to_its_boot(tmp_path: Path) -> None:
    path = tmp_path / "twice.fam"
    first = [record(k) for k in range(9)]
    second = [record(k, boot=1) for k in range(20)]
    path.write_bytes(b"".join([*first, *second[:8], *first[3:6], *second[11:]]))
    found = read_journal(path)
    assert found.epoch.tolist() == [0] * 9 + [1] * 17
    assert found.missing == (Missing(1, 8, 3, False),)


def test_a_journal_is_never_overwritten_and_goes_on_after_a_torn_line(tmp_path: Path) -> None:
    path = tmp_path / "run.fam"
    with Journal(path, lambda: 1.0, reserve_bytes=0) as journal:
        journal.lines(record(0) + record(1))
    with pytest.raises(RigError, match=r"run.fam exists; give another name, or resume it"):
        Journal(path, lambda: 0.0, reserve_bytes=0)
    with path.open("ab") as file:
        file.write(record(2)[:9])
    with Journal(path, lambda: 2.0, append=True, reserve_bytes=0) as journal:
        journal.lines(record(3) + record(4) + record(5))
    found = read_journal(path)
    assert found.column("seq").tolist() == [0, 1, 3, 4, 5]
    assert found.damaged_bytes == 0  # the line that was cut before the recording went on
    assert [note["note"] for note in found.notes] == ["journal", "journal"]
    assert found.missing == ()  # nobody was recording between the two parts
    with pytest.raises(RigError, match=r"cannot write"):
        Journal(tmp_path / "none.fam", lambda: 0.0, append=True, reserve_bytes=0)


def test_what_is_no_journal_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.fam"
    path.write_bytes(b"time,pressure\n1,2\n")
    with pytest.raises(RigError, match=r"is not a journal: none of its 18 bytes"):
        read_journal(path)
    with pytest.raises(RigError, match=r"cannot read"):
        read_journal(tmp_path)
    path.write_bytes(frame('{"note":"journal","n":0,"at":0,"format":"famjax journal 9"}'))
    with pytest.raises(RigError, match=r"'famjax journal 9'; this reads 'famjax journal 1'"):
        read_journal(path)


def test_a_hanging_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    go_on = threading.Event()
    write = os.write

    def hang(file: int, data: bytes) -> int:
        assert go_on.wait(10)
        return write(file, data)

    monkeypatch.setattr(
        sys.modules[Journal.__module__], "os", SimpleNamespace(**{**vars(os), "write": hang})
    )
    journal = Journal(tmp_path / "hang.fam", lambda: 0.0, reserve_bytes=0)
    journal.lines(record(0) * 200_000)
    with pytest.raises(RigFault, match=r"MB wait for the disk"):
        journal.check()
    go_on.set()
    journal.close()


def test_a_full_disk_is_told_and_keeps_what_was_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, room, write = tmp_path / "full.fam", 600, os.write

    def limited(file: int, data: bytes) -> int:
        size = min(len(data), room - os.fstat(file).st_size)
        if size <= 0:
            raise OSError(errno.ENOSPC, "No space left on device")
        return write(file, data[:size])

    monkeypatch.setattr(
        sys.modules[Journal.__module__], "os", SimpleNamespace(**{**vars(os), "write": limited})
    )
    journal = Journal(path, lambda: 0.0, reserve_bytes=0)
    for k in range(30):
        journal.lines(record(k))
    with pytest.raises(RigFault, match=r"cannot write .*full.fam: No space left on device"):
        until(lambda: journal.check() is not None)
    with pytest.raises(RigFault, match=r"No space left"):
        journal.close()
    found = read_journal(path)
    assert path.stat().st_size == room
    assert found.column("seq").tolist() == list(range(len(found.rows)))
    assert len(found.rows) > 8
    assert found.damaged_bytes < len(record(0))


def test_recording_stops_at_the_reserve(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    free = [10**9]
    usage = SimpleNamespace(disk_usage=lambda _: SimpleNamespace(free=free[0]))
    monkeypatch.setattr(sys.modules[Journal.__module__], "shutil", usage)
    with pytest.raises(RigError, match=r"1000 MB free, the plan needs"):
        Journal(tmp_path / "a.fam", lambda: 0.0, plan_seconds=60_000)
    monkeypatch.setattr(sys.modules[Journal.__module__], "SYNC_PERIOD", 0.001)
    journal = Journal(tmp_path / "a.fam", lambda: 0.0, plan_seconds=3600)
    journal.lines(record(0))
    free[0] = 49 * 10**6
    with pytest.raises(RigFault, match=r"less than 50 MB are free"):
        until(lambda: journal.check() is not None)
    with pytest.raises(RigFault, match=r"less than 50 MB"):
        journal.close()
    assert len(read_journal(tmp_path / "a.fam").rows) == 1


RECORDER = """
import sys, time
from rig.journal import Journal
from rig.protocol import frame
journal = Journal(sys.argv[1], time.monotonic, reserve_bytes=0)
seq = 0
while True:
    journal.lines(frame(f"T,0,{seq},{5 * seq + 5},1000,200,2500,0,0,0"))
    time.sleep(0.001)
    sys.stdout.write(f"{seq}\\n")
    sys.stdout.flush()
    seq += 1
"""


@pytest.mark.parametrize("after", [40, 150])
def test_killing_the_recorder_loses_no_more_than_the_last_lines(tmp_path: Path, after: int) -> None:
    """Lines come ten times as fast as a device's: 20 lines are 20 ms here."""
    path = tmp_path / "killed.fam"
    command = [sys.executable, "-c", RECORDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        for line in child.stdout:
            if int(line) >= after:
                break
        os.kill(child.pid, signal.SIGKILL)
        handed_over = [int(rest) for rest in child.stdout.read().split("\n")[:-1]]
    found = read_journal(path)
    last = max([after, *handed_over])
    assert found.column("seq").max() >= last - 20
    assert found.missing == ()
    assert found.damaged_bytes < len(record(0))


def test_notes_are_numbered_across_threads(tmp_path: Path) -> None:
    with Journal(tmp_path / "t.fam", lambda: 0.0, reserve_bytes=0) as journal:
        threads = [
            threading.Thread(target=lambda: [journal.note("x") for _ in range(200)])
            for _ in range(4)
        ]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert [note["n"] for note in read_journal(tmp_path / "t.fam").notes] == list(range(801))


def test_time_goes_on_where_the_ticks_wrap(tmp_path: Path) -> None:
    """After 99 days a device counts its ticks from 0 again; the records and their clock go on."""
    path, begin = tmp_path / "long.fam", TICKS - 5 * 150
    with Journal(path, lambda: 0.0, reserve_bytes=0) as journal:
        for k in range(300):
            tick = (begin + 5 * k) % TICKS
            sample = Sample(0, 7000 + k, tick, 1000, 200, 2500, 0, 0, 0)
            journal.lines(frame("T," + ",".join(map(str, sample))))
            if k % 25 == 0:
                journal.note("clock", boot=0, tick=tick, arrival_s=50 + 0.01 * k)
    found = read_journal(path)
    assert found.refused == found.missing == ()
    (clock,) = clocks(found).values()
    host = clock.host(found.column("tick") / TICK_HZ)
    assert np.abs(host - (50 + 0.01 * np.arange(300))).max() < 1e-4

"""The journal: nothing waits for the disk, and no torn file gives a wrong row."""

import os
import random
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from benches import record_line, records

from famjax.app.isobaric import clocks
from rig.errors import RigError
from rig.journal import Journal, Missing, read_journal
from rig.protocol import TICK_HZ, TICKS, frame

PAGE = 4096


def opened(path, *, at=0.0, **options):
    return Journal(path, lambda: at, **options)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Ten seconds of records with notes."""
    path = tmp_path_factory.mktemp("journal") / "whole.fam"
    with opened(path) as journal:
        for second in range(10):
            journal.lines(records(*range(100 * second, 100 * second + 100)))
            journal.note("mark", second=second, text="Größe * 5")
    return path


def test_what_goes_in_comes_out_in_order(whole):
    found = read_journal(whole)
    assert found.refused == found.missing == ()
    assert found.damaged_bytes == found.missing_notes == 0
    assert found.column("seq").tolist() == list(range(1000))
    marks = found.notes_of("mark")
    assert [note["second"] for note in marks] == list(range(10))
    assert {note["text"] for note in marks} == {"Größe * 5"}
    assert (np.diff([note["n"] for note in found.notes]) == 1).all()


def tears(data, number):
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


def test_no_tear_gives_a_wrong_row_and_every_loss_is_listed(whole, path):
    true = {row[1]: row for row in map(tuple, read_journal(whole).rows.tolist())}
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


@pytest.mark.parametrize(
    ("data", "rows", "missing", "refused"),
    [
        (  # a row a tick late, its CRC right, and another line with a number that was there
            records(*range(7)) + record_line(7, 41) + records(*range(8, 20)) + record_line(12, output=5),
            [0] * 18, (Missing(0, 7, 1, False), Missing(0, 12, 1, False)),
            ((0, 7), (0, 12), (0, 12)),
        ),
        (records(*range(9)) + records(*range(4), boot=1), [0] * 9 + [1] * 4, (), ()),
        (  # a page that stands twice goes back to its boot
            records(*range(9)) + records(*range(8), boot=1) + records(3, 4, 5)
            + records(*range(11, 20), boot=1),
            [0] * 9 + [1] * 17, (Missing(1, 8, 3, False),), (),
        ),
    ],
)  # fmt: skip
def test_rows_are_sorted_into_boots_contradictions_refused(data, rows, missing, refused, path):
    path.write_bytes(data)
    found = read_journal(path)
    assert found.epoch.tolist() == rows
    assert (found.missing, found.refused) == (missing, refused)


def test_losses_of_the_line_and_of_the_file_are_told_apart(path):
    with opened(path) as journal:
        journal.lines(records(*range(5), 8, 9, 12, 13, 14))
        journal.note("lost", boot=0, first=5, records=3)
    assert read_journal(path).missing == (Missing(0, 5, 3, True), Missing(0, 10, 2, False))


def test_a_journal_is_never_overwritten_and_goes_on_after_a_torn_line(path):
    with opened(path, at=1.0) as journal:
        journal.lines(records(0, 1))
    with pytest.raises(RigError, match=r"run.fam exists: record to another folder, or resume"):
        opened(path)
    with path.open("ab") as file:
        file.write(record_line(2)[:9])
    with opened(path, at=2.0, append=True) as journal:
        journal.lines(records(3, 4, 5))
    found = read_journal(path)
    assert found.column("seq").tolist() == [0, 1, 3, 4, 5]
    assert found.damaged_bytes == 0  # the line that was cut before the recording went on
    assert [note["note"] for note in found.notes] == ["journal", "journal"]
    assert found.missing == ()  # nobody was recording between the two parts


def test_what_is_no_journal_is_refused(path):
    for content, words in (
        (b"time,pressure\n1,2\n", "is not a journal: none of its 18 bytes"),
        (frame('{"note":"journal","n":0,"at":0,"format":"famjax journal 9"}'),
         "'famjax journal 9'; this version reads 'famjax journal 1'"),
    ):  # fmt: skip
        path.write_bytes(content)
        with pytest.raises(RigError, match=words):
            read_journal(path)
    with pytest.raises(RigError, match=r"cannot read"):
        read_journal(path.parent)
    with pytest.raises(RigError, match=r"cannot write"):
        opened(path.parent / "none.fam", append=True)


def test_a_plan_longer_than_the_disk_is_refused(path, monkeypatch):
    usage = SimpleNamespace(free=10**9)
    monkeypatch.setattr("rig.journal.shutil.disk_usage", lambda _: usage)
    with pytest.raises(RigError, match=r"1000 MB free, but the plan needs 1080 MB"):
        opened(path, plan_seconds=60_000)
    assert not path.exists()


RECORDER = """
import sys, time
from rig.journal import Journal
from rig.protocol import frame
journal = Journal(sys.argv[1], time.monotonic)
seq = 0
while True:
    journal.lines(frame(f"T,0,{seq},{5 * seq + 5},1000,200,2500,0,0,0"))
    time.sleep(0.001)
    sys.stdout.write(f"{seq}\\n")
    sys.stdout.flush()
    seq += 1
"""


def test_killing_the_recorder_loses_no_more_than_the_last_lines(path):
    """Lines come ten times as fast as a device's: 20 lines are 20 ms here."""
    command = [sys.executable, "-c", RECORDER, str(path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as child:
        for line in child.stdout:
            if int(line) >= 100:
                break
        os.kill(child.pid, signal.SIGKILL)
        handed_over = [int(rest) for rest in child.stdout.read().split("\n")[:-1]]
    found = read_journal(path)
    assert found.column("seq").max() >= max([100, *handed_over]) - 20
    assert found.missing == ()
    assert found.damaged_bytes < len(record_line(0))


def test_time_goes_on_where_the_ticks_wrap(path):
    with opened(path) as journal:
        for k in range(300):
            tick = (TICKS - 5 * 150 + 5 * k) % TICKS
            journal.lines(record_line(7000 + k, tick))
            if k % 25 == 0:
                journal.note("clock", boot=0, tick=tick, arrival_s=50 + 0.01 * k)
    found = read_journal(path)
    assert found.refused == found.missing == ()
    (clock,) = clocks(found).values()
    host = clock.host(found.column("tick") / TICK_HZ)
    assert np.abs(host - (50 + 0.01 * np.arange(300))).max() < 1e-4

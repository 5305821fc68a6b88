"""Test journals: written line by line, verified when read, and checked against the control law.

A journal is an append-only text file: the device's lines verbatim, and notes in JSON with the same CRC.

    {"note":"set","n":12,"at":3.20112,"pressure_Pa":275790.3}*5A1C
    T,...*09F2

`Journal` passes queued data to the kernel within milliseconds, so that only the last milliseconds are lost
if the process is killed, and syncs the data to the disk within about a second. Neither blocks the caller.
`read_journal` reads all verifiable lines and lists what is missing; `audit` recomputes the control law.
"""

import contextlib
import csv
import dataclasses
import datetime
import json
import math
import os
import queue
import shutil
import threading
from array import array
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from famjax.boundary.units import from_si

from .calibration import Calibration, calibration_from_dict
from .errors import RigError, RigFault
from .protocol import (
    MANUAL,
    RUN,
    TICK_HZ,
    TICKS,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Sample,
    crc16,
    drive,
    frame,
    next_integral,
    parse,
    pressure_error,
)

FORMAT = "famjax journal 1"
COLUMNS = Sample._fields
# Queued bytes at which the disk counts as hung: more than ten minutes.
BACKLOG_LIMIT = 1 << 22
SYNC_PERIOD = 1.0  # s between two syncs to the disk

_sync_data: Callable[[int], None] = getattr(os, "fdatasync", os.fsync)


class Journal(contextlib.AbstractContextManager):
    """A journal open for writing.

    Lines and notes may be queued from any thread and keep their order. One thread writes them to
    the kernel at once; a second thread syncs the file to the disk every `SYNC_PERIOD`.

    Args:
        path: path of the file; created, or with `append` continued after its last complete line.
        now: function that returns the time for notes [s].
        append: True to continue an existing journal.
        plan_seconds: expected duration [s]; the disk must have room for three times as much data.
        began: start time of a simulated recording; None uses the current time.

    Raises:
        RigError: the file exists (or, with `append`, does not exist), its folder cannot be written to,
            or the disk has too little space for the plan.
    """

    def __init__(
        self,
        path: str | Path,
        now: Callable[[], float],
        *,
        append: bool = False,
        plan_seconds: float = 0.0,
        began: datetime.datetime | None = None,
    ) -> None:
        self.path = Path(path)
        self._now = now
        # 100 records, statuses and notes need 6000 bytes a second.
        folder, needed = self.path.absolute().parent, 3 * plan_seconds * 6000
        if folder.is_dir() and (free := shutil.disk_usage(folder).free) < needed:
            raise RigError(
                f"{folder} has {free / 1e6:.0f} MB free, but the plan needs {needed / 1e6:.0f} MB"
            )
        self._file = _open(self.path, append)
        self._lock = threading.Lock()  # orders the notes' numbers with the queue
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._notes = self._queued = self._written = 0
        self._failure: str | None = None
        self._closing = threading.Event()
        self._writer = threading.Thread(target=self._write, name="journal writer", daemon=True)
        self._syncer = threading.Thread(target=self._keep_synced, name="journal sync", daemon=True)
        self._writer.start()
        self._syncer.start()
        began = began or datetime.datetime.now(datetime.UTC)
        self.note("journal", format=FORMAT, wall=began.isoformat(timespec="milliseconds"))

    def __exit__(self, *_: object) -> None:
        self.close()

    def lines(self, data: bytes) -> None:
        """Queue verified lines from the device, including their line endings."""
        with self._lock:
            self._put(data)

    def note(self, kind: str, /, **fields: Any) -> None:
        """Queue a note; fields must be JSON values with finite numbers, and have units in their names."""
        with self._lock:
            content = {"note": kind, "n": self._notes, "at": round(self._now(), 6), **fields}
            text = json.dumps(content, allow_nan=False, separators=(",", ":"))
            self._put(frame(text.replace("*", r"\u002a")))  # the asterisk begins the CRC
            self._notes += 1

    @property
    def waiting(self) -> int:
        """Number of queued bytes that have not yet reached the kernel."""
        return self._queued - self._written

    def check(self) -> None:
        """Raise if the recording has failed.

        Raises:
            RigFault: the recording has failed; everything written before the failure is kept.
        """
        if self._failure is not None:
            raise RigFault(self._failure)
        if self.waiting > BACKLOG_LIMIT:
            raise RigFault(
                f"{self.waiting / 1e6:.1f} MB are waiting to be written to {self.path}: use a local disk"
            )

    def close(self) -> None:
        """Write and sync all queued data; a second call has no effect.

        Raises:
            RigFault: some data could not be written.
        """
        if self._closing.is_set():
            return
        with self._lock:
            self._closing.set()
            self._queue.put(None)
        self._writer.join()
        self._syncer.join()
        self._sync()
        os.close(self._file)
        self.check()

    def _put(self, data: bytes) -> None:
        if data and self._failure is None and not self._closing.is_set():
            self._queued += len(data)
            self._queue.put(data)

    def _write(self) -> None:
        """Write all queued data in one call, because one call per line is too slow in virtual time."""
        waiting: list[bytes | None] = []
        while not waiting or waiting[-1] is not None:  # nothing comes after None
            waiting = [self._queue.get()]
            while not self._queue.empty():
                waiting.append(self._queue.get())
            view = memoryview(b"".join(filter(None, waiting)))
            size = len(view)
            try:
                while view:
                    view = view[os.write(self._file, view) :]
            except OSError as error:
                self._fail(error)
                return
            self._written += size

    def _keep_synced(self) -> None:
        while not self._closing.wait(SYNC_PERIOD):
            self._sync()

    def _sync(self) -> None:
        try:
            _sync_data(self._file)
        except OSError as error:
            self._fail(error)

    def _fail(self, error: OSError) -> None:
        self._failure = self._failure or f"cannot write {self.path}: {error.strerror}"


def _open(path: Path, append: bool) -> int:
    flags = os.O_RDWR | os.O_APPEND if append else os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        file = os.open(path, flags | getattr(os, "O_BINARY", 0), 0o644)
    except FileExistsError:
        raise RigError(f"{path} exists: record to another folder, or resume the test") from None
    except OSError as error:
        raise RigError(f"cannot write {path}: {error.strerror}") from None
    if append and (size := os.fstat(file).st_size):
        os.lseek(file, size - 1, os.SEEK_SET)
        if os.read(file, 1) != b"\n":  # ends a line that was cut short
            os.write(file, b"\n")
    return file


class Missing(NamedTuple):
    """Records that are not in the file: first <= seq < first + records.

    Attributes:
        epoch: index of the device's boot in the file, from 0.
        first: number of the first record.
        records: number of records.
        noted: True if the recorder noted that the serial line lost them; False if the file lost them.
    """

    epoch: int
    first: int
    records: int
    noted: bool


@dataclasses.dataclass(frozen=True)
class Record:
    """The contents of a journal.

    Attributes:
        path: path of the file.
        rows: one row of counts for each record, columns as in `COLUMNS`, ordered by epoch and number,
            int64, shape (n, 9). Ticks keep increasing where the device's counter wraps.
        epoch: epoch of each row, the index of the device's boot in this file, from 0, shape (n,).
        notes: notes, in order.
        note_parts: part of the recording to which each note belongs, from 0. A recording that was
            resumed has two parts, whose clocks may differ.
        epoch_parts: part of the recording to which each epoch belongs.
        settings: (epoch, settings of the device), in file order.
        missing: missing records.
        missing_notes: number of missing notes.
        damaged_bytes: number of bytes that could not be verified. If a recording was killed and resumed
            later, the line that was cut short is not counted.
        refused: (epoch, seq) of rows that have a correct CRC but contradict their neighbours.
    """

    path: Path
    rows: NDArray[np.int64]
    epoch: NDArray[np.int64]
    notes: tuple[dict[str, Any], ...]
    note_parts: tuple[int, ...]
    epoch_parts: tuple[int, ...]
    settings: tuple[tuple[int, DeviceSettings], ...]
    missing: tuple[Missing, ...]
    missing_notes: int
    damaged_bytes: int
    refused: tuple[tuple[int, int], ...]

    def column(self, name: str) -> NDArray[np.int64]:
        """Return one of the `COLUMNS`, shape (n,)."""
        return self.rows[:, COLUMNS.index(name)]

    def governing(self) -> NDArray[np.int64]:
        """Return the index in `settings` of the settings that govern each row; -1 if unknown."""
        index = np.full(len(self.rows), -1)
        order = sorted(range(len(self.settings)), key=lambda k: self.settings[k][1].since)
        for epoch in {epoch for epoch, _ in self.settings}:
            mine = [k for k in order if self.settings[k][0] == epoch]
            rows = self.epoch == epoch
            begins = [self.settings[k][1].since for k in mine]
            latest = np.searchsorted(begins, self.rows[rows, 1], side="right")
            index[rows] = np.array([-1, *mine])[latest]
        return index

    def notes_of(self, kind: str) -> list[dict[str, Any]]:
        """Return the notes of one kind, in order."""
        return [note for note in self.notes if note["note"] == kind]


def read_journal(path: str | Path) -> Record:
    """Read a journal, even if it is torn, partly zeroed or truncated.

    A line is accepted if its CRC is correct, and a row if it is also consistent with its neighbours.

    Args:
        path: path of the journal.

    Returns:
        The verified rows in order, the notes, and a list of everything that is missing.

    Raises:
        RigError: the file cannot be read, or contains no verifiable line.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RigError(f"cannot read {path}: {error.strerror}") from None
    found = _Lines(data)
    if not found.numbers and not found.notes:
        raise RigError(f"{path} is not a journal: none of its {len(data)} bytes can be verified")
    for note in found.notes:
        if note["note"] == "journal" and note.get("format") != FORMAT:
            raise RigError(
                f"{path} has the format {note.get('format')!r}; this version reads {FORMAT!r}"
            )
    rows = np.array(found.numbers, np.int64).reshape(-1, len(COLUMNS))
    epoch = np.array(found.epochs, np.int64)
    parts = np.array([*found.epoch_parts, 0], np.int64)[epoch]
    rows, epoch, refused = _in_order(rows, epoch, parts)
    return Record(
        path, rows, epoch, tuple(found.notes), tuple(found.note_parts), tuple(found.epoch_parts),
        tuple(found.settings), _missing(rows, epoch, found.losses), found.missing_notes,
        found.damaged_bytes, refused,
    )  # fmt: skip


def stored_calibration(record: Record) -> Calibration:
    """Return the calibration stored in a journal.

    Raises:
        RigError: the journal contains no calibration.
    """
    notes = record.notes_of("rig")
    if not notes:
        raise RigError(f"{record.path} contains no calibration: record tests with `famjax rig run`")
    return calibration_from_dict(notes[-1]["calibration"])


def summary(record: Record) -> list[dict[str, Any]]:
    """Return one row for each set pressure in the plan, with the pressure held and the strokes completed.

    Returns:
        Rows with the block, the set pressure [Pa], the mean and the root-mean-square error of the pressure
        [Pa] during the strokes (nan if there were none), the number of completed strokes (there and back),
        the number of device trips, and whether the block was completed.
    """
    rows: list[dict[str, Any]] = []
    begun: dict[str, Any] = {}
    for part, note in zip(record.note_parts, record.notes, strict=True):
        if note["note"] == "block":
            rows.append({
                "block": note["block"], "set_pressure_Pa": note["pressure_Pa"], "mean_Pa": math.nan,
                "rms_error_Pa": math.nan, "strokes": 0, "trips": 0, "completed": False,
            })  # fmt: skip
        elif note["note"] == "strokes":
            begun = note
            rows[-1] |= _held(record, part, begun, math.inf, rows[-1]["set_pressure_Pa"])
        elif note["note"] == "strokes_end":
            rows[-1] |= _held(record, part, begun, note["seq"], rows[-1]["set_pressure_Pa"])
            rows[-1]["strokes"] = begun["cycles"]
        elif note["note"] == "done":
            rows[-1]["completed"] = True
        elif note["note"] == "fault" and rows:
            rows[-1]["trips"] += "cause" in note
    return rows


def _held(
    record: Record, part: int, begun: dict[str, Any], end: float, wanted: float
) -> dict[str, Any]:
    """Return mean pressure, its error and the number of whole strokes, from `begun` to record `end`."""
    epoch = max((e for e, at in enumerate(record.epoch_parts) if at == part), default=-1)
    seq = record.column("seq")
    mine = (record.epoch == epoch) & (seq > begun["seq"]) & (seq <= end)
    mine &= record.column("flags") & 3 == RUN
    if not mine.any():
        return {}
    pressure = stored_calibration(record).pressure.value(record.column("pressure_sum")[mine])
    share = np.ptp(record.column("tick")[mine]) / TICK_HZ / begun["seconds"]
    return {
        "mean_Pa": float(pressure.mean()),
        "rms_error_Pa": float(np.sqrt(np.mean((pressure - wanted) ** 2))),
        "strokes": int(share * begun["cycles"]),
    }


def write_summary(journal: Path, unit: str) -> list[str]:
    """Write a summary as CSV next to the journal; return it as lines of text, with pressures in `unit`."""
    rows = summary(read_journal(journal))
    with journal.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.DictWriter(file, rows[0] if rows else ())
        writer.writeheader()
        writer.writerows(rows)
    lines = [f"{'set':>8}{'mean':>8}{'RMS error':>11}  strokes  trips   pressures in {unit}"]
    for row in rows:
        names = ("set_pressure_Pa", "mean_Pa", "rms_error_Pa")
        set_, mean, rms = (from_si(row[name], unit, "pressure") for name in names)
        left = "" if row["completed"] else "   not completed"
        lines.append(f"{set_:8.4g}{mean:8.4g}{rms:11.3g}{row['strokes']:9}{row['trips']:7}{left}")
    return lines


class _Lines:
    """Parse the lines of a journal one by one, and separate what can be verified from the rest.

    Args:
        data: contents of the whole file.

    Attributes:
        numbers: fields of all records, one after another, in file order.
        epochs: epoch of each record, the index of the device's boot in the file, from 0.
        losses: (epoch, first, records) of losses that the recorder noted.
        notes, note_parts, epoch_parts, settings, damaged_bytes: as in `Record`. Each part of the
            recording begins with a "journal" note.
    """

    def __init__(self, data: bytes) -> None:
        self.numbers = array("q")
        self.epochs: list[int] = []
        self.notes: list[dict[str, Any]] = []
        self.note_parts: list[int] = []
        self.epoch_parts: list[int] = []
        self.losses: list[tuple[int, int, int]] = []
        self.settings: list[tuple[int, DeviceSettings]] = []
        self.damaged_bytes = 0
        self._boots: list[int] = []  # modulo 16, of each epoch
        self._epoch, self._first = -1, 0  # the present one, and the first of this part
        self._broken = True
        self._seen: set[bytes] = set()
        self._numbers: list[set[int]] = [set()]  # of the notes, part by part
        cut = 0
        for line in data.split(b"\n"):
            if line and not self._take(line):
                cut = len(line) + 1
                self.damaged_bytes += cut
            elif line:
                if line.startswith(b'{"note":"journal"'):  # it goes on behind a line that was cut
                    self.damaged_bytes -= cut
                cut = 0
        # Numbers that the notes skip.
        self.missing_notes = sum(max(part) + 1 - len(part) for part in self._numbers if part)

    def _take(self, line: bytes) -> bool:
        """Process one line; return True if it could be verified."""
        if line.startswith(b"{"):
            note = _note(line)
            if note is not None and line not in self._seen:  # else a page is duplicated
                self._seen.add(line)
                self._take_note(note)
            return note is not None
        message = parse(line)
        if type(message) is Sample:
            if self._broken or message.boot != self._boots[self._epoch]:
                self._enter(message.boot)
            self.numbers.extend(message)
            self.epochs.append(self._epoch)
        elif isinstance(message, DeviceSettings | DeviceStatus | Hello):
            self._enter(message.boot & 15)
            if isinstance(message, DeviceSettings):
                self.settings.append((self._epoch, message))
        return message is not None

    def _enter(self, boot: int) -> None:
        """Switch to the epoch of a boot: the last epoch in this part with that number, or a new one.

        A page that appears twice in the file is assigned to its own epoch.
        """
        for epoch in range(len(self._boots) - 1, self._first - 1, -1):
            if self._boots[epoch] == boot:
                self._epoch = epoch
                break
        else:
            self._epoch = len(self._boots)
            self._boots.append(boot)
            self.epoch_parts.append(len(self._numbers) - 1)
        self._broken = False

    def _take_note(self, note: dict[str, Any]) -> None:
        if note["note"] == "journal":  # a recording begins, or goes on after a pause
            self._broken, self._first = True, len(self._boots)
            if self._numbers[-1]:
                self._numbers.append(set())
            self._seen = {line for line in self._seen if line.startswith(b'{"note":"journal"')}
        self._numbers[-1].add(note["n"])
        self.notes.append(note)
        self.note_parts.append(len(self._numbers) - 1)
        if note["note"] == "lost" and note["boot"] in self._boots:
            epoch = len(self._boots) - 1 - self._boots[::-1].index(note["boot"])
            self.losses.append((epoch, note["first"], note["records"]))


def _note(line: bytes) -> dict[str, Any] | None:
    """Return the note in a line, or None if its CRC or form is wrong."""
    body, _, digits = line.rpartition(b"*")
    try:
        note = json.loads(body) if digits == b"%04X" % crc16(body) else None
    except ValueError:
        return None
    complete = isinstance(note, dict) and isinstance(note.get("n"), int) and "note" in note
    return note if complete else None


def _in_order(
    rows: NDArray[np.int64], epoch: NDArray[np.int64], parts: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[tuple[int, int], ...]]:
    """Return the rows by epoch and number, each once, and a list of the contradictory rows omitted."""
    if np.unique(epoch).size > np.unique(rows[:, 0]).size:
        # Two boots have one number: a page may be in the file twice.
        _, first = np.unique(np.column_stack((parts, rows)), axis=0, return_index=True)
        rows, epoch = rows[first], epoch[first]
    order = np.lexsort((rows[:, 1], epoch))
    rows, epoch = _unwrapped(rows[order], epoch[order]), epoch[order]
    twice = (np.diff(epoch) == 0) & (rows[1:] == rows[:-1]).all(axis=1)
    keep = np.append(~twice, True) if len(rows) else np.ones(0, bool)
    rows, epoch = rows[keep], epoch[keep]
    same = (np.diff(epoch) == 0) & (np.diff(rows[:, 1]) == 0)
    bad = _off_grid(rows, epoch)
    bad[1:] |= same
    bad[:-1] |= same
    refused = tuple(zip(epoch[bad].tolist(), rows[bad, 1].tolist(), strict=True))
    return rows[~bad], epoch[~bad], refused


def _unwrapped(rows: NDArray[np.int64], epoch: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the rows with ticks that keep increasing where the device's counter wrapped to 0."""
    back = np.rint(-np.diff(rows[:, 2], prepend=rows[:1, 2]) / TICKS).astype(np.int64)
    total = np.cumsum(np.where(np.diff(epoch, prepend=epoch[:1]) == 0, back, 0))
    # What an epoch has wrapped does not concern the next.
    rows[:, 2] += TICKS * (total - total[np.searchsorted(epoch, epoch)])
    return rows


def _off_grid(rows: NDArray[np.int64], epoch: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Return True for rows whose ticks per record differ from those before and from those after."""
    bad = np.zeros(len(rows), bool)
    if len(rows) < 4:
        return bad
    records, ticks = np.diff(rows[:, 1]), np.diff(rows[:, 2])
    broken = (np.diff(epoch) != 0) | (records == 0)
    slope = ticks / np.where(broken, 1, records)
    slope[broken] = np.nan  # equal to nothing
    like_next = np.append(slope[:-1] == slope[1:], False)
    like_last = np.insert(like_next[:-1], 0, False)
    odd = ~(like_next | like_last | broken)
    bad[1:-1] = odd[:-1] & odd[1:]
    return bad


def _missing(
    rows: NDArray[np.int64], epoch: NDArray[np.int64], losses: list[tuple[int, int, int]]
) -> tuple[Missing, ...]:
    """Return the gaps between the rows of each epoch, split into noted losses and the rest."""
    found: list[Missing] = []
    for e in np.unique(epoch).tolist():
        seq = rows[epoch == e, 1]
        noted = sorted((first, first + count) for at, first, count in losses if at == e)
        if noted and noted[0][0] < seq[0]:
            seq = np.insert(seq, 0, noted[0][0] - 1)
        for i in np.flatnonzero(np.diff(seq) > 1).tolist():
            start, end = int(seq[i]) + 1, int(seq[i + 1])
            for first, after in noted:
                a, b = max(first, start), min(after, end)
                if a < b:
                    found += [Missing(e, start, a - start, False), Missing(e, a, b - a, True)]
                    start = b
            found.append(Missing(e, start, end - start, False))
    return tuple(gap for gap in found if gap.records > 0)


@dataclasses.dataclass(frozen=True)
class Audit:
    """Result of an audit.

    Attributes:
        records: rows in the journal.
        lost: records lost on the serial line, as noted by the recorder.
        torn: records missing from the file without such a note.
        missing_notes: notes missing from the file.
        damaged_bytes: bytes in the file that cannot be verified.
        refused: rows that contradict their neighbours.
        checked: records whose output and integral were recomputed.
        equal: checked records whose recomputed values agree with the recorded ones.
        unchecked: records in RUN whose control law or preceding record is unknown.
        first_wrong: (epoch, seq) of the first record that disagrees, or None.
        ended: reason in the "end" note of the last part, or None if the recording was cut off.
    """

    records: int
    lost: int
    torn: int
    missing_notes: int
    damaged_bytes: int
    refused: int
    checked: int
    equal: int
    unchecked: int
    first_wrong: tuple[int, int] | None
    ended: str | None

    @property
    def sound(self) -> bool:
        """True if the file is complete and the recomputed records agree; losses on the line are allowed."""
        return not self.faults

    @property
    def faults(self) -> list[str]:
        """Reasons why the journal is not sound."""
        wrong, (_, at) = self.checked - self.equal, self.first_wrong or (0, 0)
        found = {
            f"records missing from the file: {self.torn}": self.torn,
            f"notes missing from the file: {self.missing_notes}": self.missing_notes,
            f"{self.damaged_bytes} bytes are damaged": self.damaged_bytes,
            f"{self.refused} rows contradict their neighbours": self.refused,
            f"{wrong} records do not follow the control law, starting with record {at}": wrong,
            "the recording was cut off": self.ended is None,
        }
        return [text for text, number in found.items() if number]

    def __str__(self) -> str:
        verdict = f"NOT sound: {'; '.join(self.faults)}" if self.faults else "sound"
        found = {**dataclasses.asdict(self), "verdict": verdict}
        return "\n".join(f"{_IN_WORDS.get(name, name):36}{value}" for name, value in found.items())


_IN_WORDS = {
    "lost": "records lost on the serial line", "torn": "records missing from the file",
    "missing_notes": "notes missing from the file", "damaged_bytes": "damaged bytes",
    "refused": "rows that contradict others", "checked": "outputs recomputed",
    "equal": "outputs that agree", "unchecked": "outputs that cannot be recomputed",
    "first_wrong": "first wrong record (boot, number)", "ended": "recording ended",
}  # fmt: skip
"""Labels of the fields of an `Audit` in print."""


def audit(record: Record) -> Audit:
    """Recompute the control law from every recorded sample, and list all missing data.

    In RUN, the integral must follow from the previous integral and the sum of the pressure counts, and the
    output must follow from the integral and the last count. In MAN, the integral must be zero; in SAFE and
    TRIP, both the integral and the output must be zero.

    Args:
        record: contents of the journal.
    """
    right, known = _recomputed(record)
    wrong = np.flatnonzero(known & ~right)[:1]
    first = list(zip(record.epoch[wrong].tolist(), record.rows[wrong, 1].tolist(), strict=True))
    last = [note for part, note in zip(record.note_parts, record.notes, strict=True)
            if part == record.note_parts[-1] and note["note"] == "end"]  # fmt: skip
    return Audit(
        records=len(record.rows),
        lost=sum(gap.records for gap in record.missing if gap.noted),
        torn=sum(gap.records for gap in record.missing if not gap.noted),
        missing_notes=record.missing_notes,
        damaged_bytes=record.damaged_bytes,
        refused=len(record.refused),
        checked=int(known.sum()),
        equal=int((right & known).sum()),
        unchecked=int((~known).sum()),
        first_wrong=first[0] if first else None,
        ended=last[-1]["reason"] if last else None,
    )


def _recomputed(record: Record) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return masks: rows whose recomputed values agree, and rows that could be recomputed."""
    right, known = np.zeros(len(record.rows), bool), np.ones(len(record.rows), bool)
    last = (-1, -1, 0, -1)  # epoch, seq, integral, state
    laws = [settings for _, settings in record.settings]
    governing = zip(record.epoch.tolist(), record.governing().tolist(), strict=True)
    for i, (row, (epoch, at)) in enumerate(zip(record.rows.tolist(), governing, strict=True)):
        _, seq, _, pressure_sum, pressure_count, _, output, integral, flags = row
        state, next_to = flags & 3, (epoch, seq - 1) == last[:2]
        if state == MANUAL:
            right[i] = integral == 0
        elif state != RUN:
            right[i] = output == 0 and integral == 0
        elif at < 0 or not (next_to or seq == 0):
            known[i] = False
        else:
            law, ticks = laws[at].law, laws[at].ticks_per_record
            before = last[2] if next_to and last[3] == RUN else 0
            expected = next_integral(law, before, pressure_error(law, pressure_sum, ticks))
            error = pressure_error(law, pressure_count)
            right[i] = integral == expected and output == drive(law, expected, error)
        last = (epoch, seq, integral, state)
    return right, known

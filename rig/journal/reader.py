"""A journal read back: verified rows only, and a list of all that is missing."""

import dataclasses
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..calibration.whole_rig import Calibration, calibration_from_dict
from ..errors import RigError
from ..protocol.control_law import TICKS
from ..protocol.messages import DeviceSettings, DeviceStatus, Sample
from .journal_lines import Damage, JournalLines
from .writer import FORMAT

COLUMNS = Sample._fields


class Missing(NamedTuple):
    """Records that are not in the file: first <= seq < first + records.

    Attributes:
        epoch: the device's boots in the file, counted from 0.
        first: number of the first record.
        records: how many.
        noted: whether the recorder knew: the line lost them. If not, the file did.
    """

    epoch: int
    first: int
    records: int
    noted: bool


@dataclasses.dataclass(frozen=True)
class Record:
    """The contents of a journal.

    Attributes:
        path: the file.
        rows: one row of counts for each record, columns as in `COLUMNS`, ordered by epoch and number,
            int64, shape (n, 9). Ticks go on beyond the device's counter, which wraps.
        epoch: of each row, shape (n,): the device's boots in this file, counted from 0.
        notes: in their order.
        note_parts: the part of the recording of each note, counted from 0: a recording that was
            resumed has two, and their clocks may differ.
        epoch_parts: the part of each epoch.
        settings: (epoch, what the device controlled with), in the order of the file.
        statuses: (epoch, status), likewise.
        comments: comment lines of the device.
        missing: records that are missing.
        missing_notes: how many notes are missing.
        damage: bytes that could not be verified.
        refused: (epoch, seq) of rows whose CRC is right but that contradict their neighbours.
    """

    path: Path
    rows: NDArray[np.int64]
    epoch: NDArray[np.int64]
    notes: tuple[dict[str, Any], ...]
    note_parts: tuple[int, ...]
    epoch_parts: tuple[int, ...]
    settings: tuple[tuple[int, DeviceSettings], ...]
    statuses: tuple[tuple[int, DeviceStatus], ...]
    comments: tuple[str, ...]
    missing: tuple[Missing, ...]
    missing_notes: int
    damage: tuple[Damage, ...]
    refused: tuple[tuple[int, int], ...]

    def column(self, name: str) -> NDArray[np.int64]:
        """One column of `COLUMNS`, shape (n,)."""
        return self.rows[:, COLUMNS.index(name)]

    def governing(self) -> NDArray[np.int64]:
        """For each row, the index in `settings` of what governed it, -1 where that is not known."""
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
        """The notes of one kind, in their order."""
        return [note for note in self.notes if note["note"] == kind]


def read_journal(path: str | Path) -> Record:
    """The record in a journal, also in one that was torn, zeroed in places or cut short.

    A line counts when its CRC is right, and a row when it also fits its neighbours.

    Args:
        path: the journal.

    Returns:
        The verified rows in order, the notes, and a list of all that is missing.

    Raises:
        RigError: the file cannot be read, or nothing in it is a journal's.
    """
    path = Path(path)
    try:
        data = path.read_bytes()
    except OSError as error:
        raise RigError(f"cannot read {path}: {error.strerror}") from None
    parts = JournalLines()
    parts.read(data)
    if not parts.numbers and not parts.notes:
        raise RigError(f"{path} is not a journal: none of its {len(data)} bytes can be verified")
    for note in parts.notes:
        if note["note"] == "journal" and note.get("format") != FORMAT:
            raise RigError(f"{path} has the format {note.get('format')!r}; this reads {FORMAT!r}")
    rows = np.array(parts.numbers, np.int64).reshape(-1, len(COLUMNS))
    rows, epoch, refused = _in_order(rows, np.array(parts.epochs, np.int64))
    return Record(
        path=path,
        rows=rows,
        epoch=epoch,
        notes=tuple(parts.notes),
        note_parts=tuple(parts.note_parts),
        epoch_parts=tuple(parts.epoch_parts),
        settings=tuple(parts.settings),
        statuses=tuple(parts.statuses),
        comments=tuple(parts.comments),
        missing=_missing(rows, epoch, parts.losses),
        missing_notes=parts.missing_notes,
        damage=tuple(parts.damage),
        refused=refused,
    )


def stored_calibration(record: Record) -> Calibration:
    """The calibration with which a journal was recorded.

    Raises:
        RigError: the journal has none.
    """
    notes = record.notes_of("rig")
    if not notes:
        raise RigError(f"{record.path} has no calibration in it; give one")
    return calibration_from_dict(notes[-1]["calibration"])


def _in_order(
    rows: NDArray[np.int64], epoch: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], tuple[tuple[int, int], ...]]:
    """Rows by epoch and number, each once; those that contradict another are left out and listed."""
    if np.unique(epoch).size > np.unique(rows[:, 0]).size:
        # Two boots have one number: a page may be in the file twice.
        _, first = np.unique(rows, axis=0, return_index=True)
        rows, epoch = rows[first], epoch[first]
    order = np.lexsort((rows[:, 1], epoch))
    rows, epoch = _unwrapped(rows[order], epoch[order]), epoch[order]
    same = (np.diff(epoch) == 0) & (np.diff(rows[:, 1]) == 0)
    equal = same & (rows[1:] == rows[:-1]).all(axis=1)
    keep = np.ones(len(rows), bool)
    keep[1:] = ~equal
    rows, epoch = rows[keep], epoch[keep]
    same = (np.diff(epoch) == 0) & (np.diff(rows[:, 1]) == 0)
    bad = np.zeros(len(rows), bool)
    bad[1:] |= same
    bad[:-1] |= same
    bad |= _off_grid(rows, epoch)
    refused = tuple(zip(epoch[bad].tolist(), rows[bad, 1].tolist(), strict=True))
    return rows[~bad], epoch[~bad], refused


def _unwrapped(rows: NDArray[np.int64], epoch: NDArray[np.int64]) -> NDArray[np.int64]:
    """Rows whose ticks go on where the device's counter began again from 0."""
    back = -np.diff(rows[:, 2], prepend=rows[:1, 2]) / TICKS
    wraps = np.where(np.diff(epoch, prepend=epoch[:1]) == 0, np.rint(back), 0).astype(np.int64)
    total = np.cumsum(wraps)
    if not total.any():
        return rows
    begins = np.searchsorted(epoch, epoch)  # what an epoch has wrapped does not concern the next
    rows = rows.copy()
    rows[:, 2] += TICKS * (total - total[begins])
    return rows


def _off_grid(rows: NDArray[np.int64], epoch: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Rows whose ticks per record disagree with what comes before and with what comes after."""
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
    """The gaps between the rows of each epoch, split into what the recorder noted and the rest."""
    found: list[Missing] = []
    for e in np.unique(epoch).tolist():
        seq = rows[epoch == e, 1]
        noted = sorted((first, first + count) for at, first, count in losses if at == e)
        if noted and noted[0][0] < seq[0]:
            seq = np.insert(seq, 0, noted[0][0] - 1)
        for i in np.flatnonzero(np.diff(seq) > 1).tolist():
            found += _split(e, int(seq[i]) + 1, int(seq[i + 1]), noted)
    return tuple(found)


def _split(epoch: int, start: int, end: int, noted: list[tuple[int, int]]) -> list[Missing]:
    parts = []
    for first, after in noted:
        a, b = max(first, start), min(after, end)
        if a < b:
            if a > start:
                parts.append(Missing(epoch, start, a - start, False))
            parts.append(Missing(epoch, a, b - a, True))
            start = b
    if start < end:
        parts.append(Missing(epoch, start, end - start, False))
    return parts

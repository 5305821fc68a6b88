"""The lines of a journal one by one: what can be verified, and where the rest is."""

import json
from array import array
from typing import Any, NamedTuple

from ..protocol.lines import crc16, parse, record_fields
from ..protocol.messages import Comment, DeviceSettings, DeviceStatus, Hello, Message


class Damage(NamedTuple):
    """Bytes of a file that cannot be verified.

    Attributes:
        offset: of the first one in the file.
        size: how many.
    """

    offset: int
    size: int


class JournalLines:
    """What reading a journal collects.

    Attributes:
        numbers: the records in the order of the file, field after field.
        epochs: of each record: the device's boots in the file, counted from 0.
        losses: (epoch, first, records) that the recorder noted.
        notes, note_parts, epoch_parts, settings, statuses, comments, damage: as in `Record`. A part
            of the recording begins with a "journal" note.
    """

    def __init__(self) -> None:
        self.numbers = array("q")
        self.epochs: list[int] = []
        self.notes: list[dict[str, Any]] = []
        self.note_parts: list[int] = []
        self.epoch_parts: list[int] = []
        self.losses: list[tuple[int, int, int]] = []
        self.settings: list[tuple[int, DeviceSettings]] = []
        self.statuses: list[tuple[int, DeviceStatus]] = []
        self.comments: list[str] = []
        self.damage: list[Damage] = []
        self._boots: list[int] = []  # modulo 16, of each epoch
        self._in_full: list[int | None] = []  # the same in full, where it is known
        self._epoch = -1
        self._first = 0  # epoch of this part of the recording
        self._broken = True
        self._seen: set[bytes] = set()
        self._numbers: list[set[int]] = [set()]  # of the notes, part by part

    @property
    def missing_notes(self) -> int:
        """How many numbers the notes skip."""
        return sum(max(part) + 1 - len(part) for part in self._numbers if part)

    def read(self, data: bytes) -> None:
        """Read a whole file."""
        offset = 0
        *lines, rest = data.split(b"\n")
        for line in lines:
            if line and not self._take(line):
                self._damaged(offset, len(line) + 1)
            offset += len(line) + 1
        if rest:
            self._damaged(offset, len(rest))

    def _take(self, line: bytes) -> bool:
        """Take one line; whether it could be verified."""
        if line.startswith(b"{"):
            note = _note(line)
            if note is not None and line not in self._seen:  # else a page is duplicated
                self._seen.add(line)
                self._take_note(note)
            return note is not None
        fields = record_fields(line)
        if fields is not None:
            boot = int(fields[0])
            if self._broken or boot != self._boots[self._epoch]:
                self._enter(boot)
            self.numbers.extend(map(int, fields))
            self.epochs.append(self._epoch)
            return True
        message = parse(line)
        if message is not None:
            self._take_message(message)
        return message is not None

    def _take_message(self, message: Message) -> None:
        if isinstance(message, DeviceSettings | DeviceStatus | Hello):
            self._enter(message.boot & 15, message.boot)
        if isinstance(message, DeviceSettings):
            self.settings.append((self._epoch, message))
        elif isinstance(message, DeviceStatus):
            self.statuses.append((self._epoch, message))
        elif isinstance(message, Comment):
            self.comments.append(message.text)

    def _enter(self, boot: int, in_full: int | None = None) -> None:
        """Go to the epoch of a boot: the last one of this part with its number, or a new one.

        A page that is in the file twice returns to its own epoch.
        """
        for epoch in range(len(self._boots) - 1, self._first - 1, -1):
            known = self._in_full[epoch]
            if self._boots[epoch] == boot and (in_full is None or known in (None, in_full)):
                self._epoch = epoch
                break
        else:
            self._epoch = len(self._boots)
            self._boots.append(boot)
            self.epoch_parts.append(len(self._numbers) - 1)
            self._in_full.append(None)
        if in_full is not None:
            self._in_full[self._epoch] = in_full
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

    def _damaged(self, offset: int, size: int) -> None:
        last = self.damage[-1] if self.damage else Damage(0, 0)
        if self.damage and last.offset + last.size == offset:
            self.damage[-1] = Damage(last.offset, last.size + size)
        else:
            self.damage.append(Damage(offset, size))


def _note(line: bytes) -> dict[str, Any] | None:
    """A note whose CRC is right."""
    body, _, digits = line.rpartition(b"*")
    if digits != b"%04X" % crc16(body):
        return None
    try:
        note = json.loads(body)
    except ValueError:
        return None
    complete = isinstance(note, dict) and isinstance(note.get("n"), int) and "note" in note
    return note if complete else None

"""Each record of a device once: gaps are requested, doubtful records need a confirmation."""

from collections.abc import Callable

from ..protocol.control_law import TICKS
from ..protocol.messages import Sample
from .events import Event, Lost, Reset
from .gaps import Gaps

JUMP = Sample(0, 0, 0, 64, 13, 64, 32, 2 << 15, 0)
"""Change from one record to the next that is odd: 2.5 psi of 200, 32 and 2 counts of output."""
MOST_TICKS = 50
"""Most ticks in a record."""
NEAR = 16
"""Most records between two that confirm each other."""


class RecordOrder:
    """The records of one conversation.

    A record that does not follow from the newest one (its tick off the grid; on a line that is being
    damaged also a value that jumps) is accepted only when the next one follows from it, or when the
    same line has come twice: a CRC of 16 bits alone lets one damaged line in 65 536 pass.

    Args:
        ring: records that the device can repeat.
        on_restart: called when the device has restarted.

    Attributes:
        newest: the last record in order, or None.
        gaps: what is missing.
        lines: verified lines, verbatim, each record once; the caller takes them.
        events: records and what happened to them; the caller takes them.
        recovered: records that came late, on request.
        repeated: records that came again.
        line_bytes: length of the last line, its end included.
        confirmed: doubtful records that turned out to be right.
    """

    def __init__(self, ring: int, on_restart: Callable[[], None]) -> None:
        self.newest: Sample | None = None
        self.gaps = Gaps(ring)
        self.lines: list[bytes] = []
        self.events: list[Event] = []
        self.recovered = self.repeated = self.confirmed = 0
        self.line_bytes = 50
        self._on_restart = on_restart
        self._begun = False
        self._next = 0
        self._ticks = 5
        self._doubtful: dict[int, set[bytes]] = {}
        self._candidate: tuple[Sample, bytes] | None = None

    def take(self, sample: Sample, line: bytes, now: float, *, suspicious: bool) -> None:
        """Take a record whose CRC is right, received at host time `now` [s]."""
        newest = self.newest
        if newest is None or sample.boot != newest.boot:
            self._take_stray(sample, line, now)
            return
        late = sample.seq < self._next
        if late and sample.seq not in self.gaps:
            self.repeated += 1
            return
        ahead = sample.seq - newest.seq
        on_grid = (sample.tick - newest.tick - self._ticks * ahead) % TICKS == 0
        if not on_grid or (suspicious and _has_jumped(sample, newest)):
            near = on_grid or ahead <= self.gaps.ring
            if not self._is_confirmed(sample, line, now, late=late, near=near):
                return
        self._accept(sample, line, now)

    def expire(self, now: float) -> None:
        """Report which of the missing records are lost."""
        if self.newest is not None:
            self._lose(self.newest.boot, self.gaps.overwritten(self._next, now))

    def give_up(self) -> None:
        """Report all records that are still missing as lost."""
        if self.newest is not None:
            self._lose(self.newest.boot, self.gaps.abandon())

    def restart(self, new_boot: int) -> None:
        """The device has restarted: missing records of the old boot are lost."""
        if self.newest is None:
            return
        old, self.newest = self.newest.boot, None
        self._lose(old, self.gaps.abandon())
        self._doubtful.clear()
        self._next = 0
        self.events.append(Reset(old, new_boot, None))
        self._on_restart()

    def _accept(self, sample: Sample, line: bytes, now: float) -> None:
        seq, newest = sample.seq, self.newest
        if newest is not None and seq > newest.seq:
            if seq == newest.seq + 1:
                self._ticks = (sample.tick - newest.tick) % TICKS
            self.newest, self.line_bytes = sample, len(line) + 1
        if seq in self.gaps:
            self.gaps.fill(seq, now)
            self.recovered += 1
        else:
            if seq > self._next:
                self._open_gap(sample, seq)
            self._next = seq + 1
        if self._doubtful:
            self._doubtful.pop(seq, None)
        self.lines += (line, b"\n")
        self.events.append(sample)

    def _is_confirmed(
        self, sample: Sample, line: bytes, now: float, *, late: bool, near: bool
    ) -> bool:
        """Whether a doubtful record is right after all; if not yet, it is requested again."""
        copies = self._doubtful.setdefault(sample.seq, set())
        if line in copies:
            self.confirmed += 1
            return True
        if late:
            copies.add(line)
            return False
        before, self._candidate = self._candidate, None
        if before is not None and self._is_wanted(before[0]) and _follows(sample, before[0]):
            self.confirmed += 2
            self._accept(*before, now)
            return True
        copies.add(line)
        self._candidate = (sample, line)
        if near:  # else its number itself is doubtful
            self._open_gap(sample, sample.seq + 1)
        return False

    def _is_wanted(self, sample: Sample) -> bool:
        return sample.seq >= self._next or sample.seq in self.gaps

    def _take_stray(self, sample: Sample, line: bytes, now: float) -> None:
        """A record of a boot that is not known: two that follow from each other begin it."""
        before, self._candidate = self._candidate, (sample, line)
        if before is None or not _follows(sample, before[0]):
            return
        first, first_line = before
        self._candidate = None
        anew, self._begun = self._begun, True
        self.restart(sample.boot)
        self._next = 0 if anew else first.seq
        self._ticks = (sample.tick - first.tick) % TICKS // (sample.seq - first.seq)
        self._accept(first, first_line, now)
        self.newest = first
        self._accept(sample, line, now)

    def _open_gap(self, sample: Sample, end: int) -> None:
        """Request next <= seq < end; those overwritten before `sample` are lost."""
        first = max(self._next, sample.seq + 1 - self.gaps.ring)
        if first > self._next:
            self.events.append(Lost(sample.boot, self._next, first - self._next))
        self.gaps.add(first, end)
        self._next = end

    def _lose(self, boot: int, seqs: list[int]) -> None:
        """Report lost records, runs of them together."""
        start = 0
        for i, seq in enumerate(seqs):
            self._doubtful.pop(seq, None)
            if i + 1 == len(seqs) or seqs[i + 1] != seq + 1:
                self.events.append(Lost(boot, seqs[start], i + 1 - start))
                start = i + 1


def _has_jumped(sample: Sample, other: Sample) -> bool:
    """Whether a value differs by more than the distance of the two explains, or the state does."""
    times = 1 + abs(sample.seq - other.seq) // 4
    return (
        abs(sample.pressure_sum - other.pressure_sum) > times * JUMP.pressure_sum
        or abs(sample.pressure_count - other.pressure_count) > times * JUMP.pressure_count
        or abs(sample.force_sum - other.force_sum) > times * JUMP.force_sum
        or abs(sample.output - other.output) > times * JUMP.output
        or abs(sample.integral - other.integral) > times * JUMP.integral
        or sample.flags != other.flags
    )


def _follows(sample: Sample, before: Sample) -> bool:
    """Whether a record can be one that comes soon after another, at whatever rate of records."""
    records, ticks = sample.seq - before.seq, (sample.tick - before.tick) % TICKS
    return (
        sample.boot == before.boot
        and 0 < records <= NEAR
        and ticks % records == 0
        and 0 < ticks // records <= MOST_TICKS
        and not _has_jumped(sample, before)
    )

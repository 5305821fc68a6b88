"""Missing records: when to request each again, and when one is lost."""

from ..protocol.lines import command_body, frame

SPACING = 0.012
"""Shortest time between two requests [s]."""
MASK_BITS = 64
_SLACK = 0.004


class Gaps:
    """The missing records of one boot.

    A request is a bit mask, and a new one takes the place of the one before; the device answers it in
    ascending order at its own pace. So each request asks for everything that is missing but what,
    at that pace, is under way; and for what will soon be overwritten in any case, since
    requests are damaged, too. At 1 % damaged bytes nothing simpler suffices.

    Args:
        ring: records that the device can repeat.

    Attributes:
        ring: as given, then as the device reports.
        pace: time [s] that the device takes for each repeated record; likewise.
        round_trip: smoothed time [s] from a request to its first answer.
    """

    def __init__(self, ring: int) -> None:
        self.ring = ring
        self.pace = 0.0085
        self.round_trip = SPACING
        self._missing: dict[int, float] = {}  # its turn in the device's answer
        self._last_request = float("-inf")
        self._oldest = 0

    def __contains__(self, seq: int) -> bool:
        return seq in self._missing

    def __len__(self) -> int:
        return len(self._missing)

    def set_pace(
        self, line_bytes: int, bytes_per_tick: int, ticks_per_record: int, tick: float
    ) -> None:
        """Estimate the device's pace from what its line carries besides new records."""
        left = max(bytes_per_tick - line_bytes / ticks_per_record, 1.0)
        self.pace = max(1.0, line_bytes / left) * tick  # it repeats one record in a tick at most

    def add(self, first: int, end: int) -> None:
        """Records first <= seq < end are missing; none older than those added before."""
        never = float("-inf")
        for seq in range(first, end):
            self._missing.setdefault(seq, never)

    def fill(self, seq: int, now: float) -> None:
        """Record `seq` has come; its turn in the answer gives the time that an answer takes."""
        taken = now - self._missing.pop(seq)
        if 0 <= taken < 0.25:
            self.round_trip += (taken - self.round_trip) / 16

    def overwritten(self, next_seq: int, now: float) -> list[int]:
        """Remove and return the records that the device has overwritten and that are not under way."""
        self._oldest = next_seq - self.ring
        if not self._missing or next(iter(self._missing)) >= self._oldest:
            return []
        gone = [
            seq
            for seq, turn in self._missing.items()
            if seq < self._oldest and now >= self._overdue(turn)
        ]
        for seq in gone:
            del self._missing[seq]
        return gone

    def abandon(self) -> list[int]:
        """Remove and return all missing records, in order."""
        gone = sorted(self._missing)
        self._missing.clear()
        self._oldest = 0
        return gone

    def request(self, now: float) -> bytes:
        """The line that asks for up to 64 records, or nothing."""
        if not self._missing or now - self._last_request < SPACING - 1e-9:
            return b""
        urgent = self._oldest + 2 * self.ring // 3
        wanted = [
            seq
            for seq, turn in self._missing.items()
            if self._oldest <= seq < urgent
            or (seq >= urgent and (now < turn or now >= self._overdue(turn)))
        ]
        if not wanted:
            return b""
        wanted.sort()
        base, mask, turn = wanted[0], 0, now
        for seq in wanted:
            if seq - base >= MASK_BITS:
                break
            mask |= 1 << (seq - base)
            self._missing[seq] = turn
            turn += self.pace
        self._last_request = now
        return frame(command_body(0, "rp", base, f"{mask:x}"))

    def _overdue(self, turn: float) -> float:
        """Time from which an answer whose turn that was is taken to be damaged."""
        return turn + 1.25 * self.round_trip + _SLACK

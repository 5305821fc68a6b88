"""The audit of a recording: is it complete, and does its output follow the control law?"""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from ..protocol.control_law import drive, next_integral, pressure_error
from ..protocol.messages import RUN, STATES
from .reader import Record


@dataclasses.dataclass(frozen=True)
class Audit:
    """What an audit found.

    Attributes:
        records: rows in the journal.
        lost: records that the line lost, as the recorder noted.
        torn: records that the file lost, without a note.
        missing_notes: notes that the file lost.
        damaged_bytes: bytes of the file that cannot be verified.
        refused: rows that contradict their neighbours.
        checked: records whose output and integral were recomputed.
        equal: those that came out as recorded.
        unchecked: records in RUN whose law or whose predecessor is not known.
        first_wrong: (epoch, seq) of the first record that did not, or None.
        ended: reason in the last "end" note, or None where the recording was cut off.
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
        """Whether the file is whole and every recomputed record equal; losses on the line do not count."""
        return (
            self.torn == self.missing_notes == self.damaged_bytes == self.refused == 0
            and self.checked == self.equal
            and self.ended is not None
        )

    def __str__(self) -> str:
        share = f"{self.equal / self.checked:.4%}" if self.checked else "none"
        return "\n".join(
            [
                f"records            {self.records}",
                f"lost on the line   {self.lost}",
                f"lost in the file   {self.torn} records, {self.missing_notes} notes, "
                f"{self.damaged_bytes} bytes damaged, {self.refused} rows refused",
                f"control law        {self.equal} of {self.checked} recomputed equal ({share}), "
                f"{self.unchecked} could not be checked",
                f"end                {self.ended or 'cut off'}",
                f"verdict            {self.verdict}",
            ]
        )

    @property
    def verdict(self) -> str:
        """Sound, or why not."""
        wrong = {
            f"the file lost {self.torn} records": self.torn,
            f"the file lost {self.missing_notes} notes": self.missing_notes,
            f"{self.damaged_bytes} bytes are damaged": self.damaged_bytes,
            f"{self.refused} rows contradict their neighbours": self.refused,
            f"{self.checked - self.equal} records do not follow the law, the first is record "
            f"{self.first_wrong and self.first_wrong[1]}": self.checked - self.equal,
            "the recording was cut off": self.ended is None,
        }
        return (
            "sound" if self.sound else f"NOT sound: {'; '.join(k for k, v in wrong.items() if v)}"
        )


def audit(record: Record) -> Audit:
    """The control law recomputed from every recorded sample, and all that is missing.

    In RUN the integral must follow from the one before and the sum of the pressure counts, and the
    output from it and the last count; in every other state but MAN both must be zero.

    Args:
        record: a journal read back.
    """
    right, known = _recomputed(record)
    wrong = np.flatnonzero(known & ~right)
    first = (int(record.epoch[wrong[0]]), int(record.rows[wrong[0], 1])) if wrong.size else None
    ends = record.notes_of("end")
    begins = record.notes_of("journal")
    return Audit(
        records=len(record.rows),
        lost=sum(gap.records for gap in record.missing if gap.noted),
        torn=sum(gap.records for gap in record.missing if not gap.noted),
        missing_notes=record.missing_notes,
        damaged_bytes=sum(damage.size for damage in record.damage),
        refused=len(record.refused),
        checked=int(known.sum()),
        equal=int((right & known).sum()),
        unchecked=int((~known).sum()),
        first_wrong=first,
        ended=ends[-1].get("reason") if ends and len(ends) >= len(begins) else None,
    )


def _recomputed(record: Record) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Which rows came out as recorded, and which could be recomputed at all."""
    right = np.zeros(len(record.rows), bool)
    known = np.ones(len(record.rows), bool)
    at, law, ticks = -1, None, 0
    last_epoch, last_seq, last_integral, last_state = -1, -1, 0, -1
    governing = zip(record.epoch.tolist(), record.governing().tolist(), strict=True)
    for i, (row, (epoch, now)) in enumerate(zip(record.rows.tolist(), governing, strict=True)):
        _, seq, _, pressure_sum, pressure_count, _, output, integral, flags = row
        if epoch != last_epoch:
            last_epoch, last_seq, last_integral, last_state = epoch, -1, 0, -1
        if now != at:
            at, law = now, None if now < 0 else record.settings[now][1].law
            ticks = 0 if now < 0 else record.settings[now][1].ticks_per_record
        state = flags & 3
        if STATES[state] == "MAN":
            right[i] = integral == 0
        elif state != RUN:
            right[i] = output == 0 and integral == 0
        elif law is None or (seq != last_seq + 1 and seq != 0):
            known[i] = False
        else:
            before = last_integral if last_state == RUN else 0
            expected = next_integral(law, before, pressure_error(law, pressure_sum, ticks))
            error = pressure_error(law, pressure_count)
            right[i] = integral == expected and output == drive(law, expected, error)
        last_seq, last_integral, last_state = seq, integral, state
    return right, known

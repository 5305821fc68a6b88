"""Who attends a run: is told what to do, sees the rig at every look, and may steer the plan."""

from collections.abc import Callable
from typing import Literal, NamedTuple

from ..protocol.messages import Sample

Request = Literal["", "go", "pause", "skip", "repeat"]
"""What an attendant asks for: nothing; strokes are under way; hold the pressure and let the plan
stand, or go on; leave this block; begin it anew."""

Phase = Literal["settling", "ready", "strokes", "paused"]
"""What a run waits for: the pressure, the first stroke, the last one, the attendant."""


class Situation(NamedTuple):
    """A run at one look.

    Attributes:
        phase: what it waits for.
        block: of the plan.
        last_block: of the plan.
        cycle: stroke there and back under way, from 1; 0 before the first.
        cycles: of the block.
        pressure: measured [Pa gauge].
        set_point: set pressure [Pa gauge].
        done: time of the plan that has passed [s].
        left: time of the plan that is left [s], waiting for people neglected.
        newest: the device's newest record.
    """

    phase: Phase
    block: int
    last_block: int
    cycle: int
    cycles: int
    pressure: float
    set_point: float
    done: float
    left: float
    newest: Sample | None


class Attendant:
    """Nobody: sees all and asks for nothing; subclasses show and steer."""

    def tell(self, text: str) -> None:
        """Something that a person at the machine has to know or do."""

    def look(self, situation: Situation) -> Request:  # noqa: ARG002 -- for subclasses
        """Called about twenty times a second; what to do."""
        return ""


class Watcher(Attendant):
    """Reports progress about every second of the plan.

    Args:
        progress: called with the seconds done and the seconds planned.
    """

    def __init__(self, progress: Callable[[float, float], None]) -> None:
        self._progress = progress
        self._due = 0.0

    def look(self, situation: Situation) -> Request:
        """Report where a second has passed."""
        if situation.done >= self._due:
            self._due = situation.done + 1.0
            self._progress(situation.done, situation.done + situation.left)
        return ""

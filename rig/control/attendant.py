"""Who attends a run: gets instructions, sees the rig at every look, and may steer the plan."""

from collections import deque
from typing import Literal, NamedTuple

import numpy as np

from ..protocol.messages import Sample

Request = Literal["", "go", "pause", "skip", "repeat"]
"""An attendant's request: none; strokes are under way; pause with the pressure held, or go on; skip
this block; repeat it."""

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
        left: time of the plan that is left [s], neglecting the time that the operator takes.
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
    """An attendant that requests nothing; subclasses display and steer."""

    def tell(self, text: str) -> None:
        """An instruction to the operator."""

    def look(self, situation: Situation) -> Request:  # noqa: ARG002 -- for subclasses
        """Called about twenty times a second; returns a request."""
        return ""


Start = Literal["at once", "asked", "load"]
"""When strokes count as begun: as soon as they are requested, when the attendant confirms them, or
when the load changes."""

AGO = 20
"""Looks that lie between the load before and the load now, a second."""
LOOKS = 40
"""Looks whose mean is the load before, two seconds."""
SPREADS = 6.0
"""Standard deviations by which the load must have changed, in three looks in a row."""
IN_A_ROW = 3


class LoadChange:
    """Detects a load that leaves its mean over the preceding seconds.

    Creep of the bladder is slow and stays within it; a stroke is not.

    Args:
        least: the smallest change that counts [unit of the load], as of a reading or two.

    >>> change = LoadChange(1.0)
    >>> any(change.seen(load) for load in [500.0, 500.4] * 50)
    False
    >>> [change.seen(load) for load in (502.0, 504.0, 506.0)]
    [False, False, True]
    """

    def __init__(self, least: float) -> None:
        self._least = least
        self._loads: deque[float] = deque(maxlen=LOOKS + AGO)
        self._beyond = 0

    def seen(self, load: float) -> bool:
        """Take the load of a look; whether strokes have begun."""
        before = list(self._loads)[:LOOKS]
        full = len(self._loads) == LOOKS + AGO
        self._loads.append(load)
        if not full:
            return False
        spread = max(SPREADS * float(np.std(before)), self._least)
        self._beyond = self._beyond + 1 if abs(load - float(np.mean(before))) > spread else 0
        return self._beyond >= IN_A_ROW

"""When a test machine's strokes begin: its start seen in the load, where nobody says so."""

from collections import deque
from typing import Literal

import numpy as np

Start = Literal["at once", "asked", "load"]
"""How a run knows that the strokes have begun: it trusts that they do when it asks for them, the
attendant says so, or the load changes."""

AGO = 20
"""Looks that lie between the load before and the load now, a second."""
LOOKS = 40
"""Looks whose mean is the load before, two seconds."""
SPREADS = 6.0
"""Standard deviations by which the load must have changed, in three looks in a row."""
IN_A_ROW = 3


class LoadChange:
    """Sees a load leave the mean of the seconds before.

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

"""Mean counts of both sensors over a time."""

from collections.abc import Callable

import numpy as np

from ..calibration.sensor import READINGS
from ..fault import RigFault
from ..protocol.messages import Sample
from .abstract_link import AbstractLink

_HELLO = 2.0  # s that a board which was reset by opening its port takes at most, twice
_UNDER_WAY = 0.1  # s in which a record that was begun before has come


def mean_counts(
    link: AbstractLink, seconds: float, wait: Callable[[float], None] | None = None
) -> tuple[float, float]:
    """Mean sums of five readings of pressure and force [counts] over a time [s].

    Args:
        link: to the device, in any state; nothing is sent.
        seconds: of the mean.
        wait: waits for a time [s] and supervises a run meanwhile; none runs unless given.

    Raises:
        RigFault: no record came.
    """
    sums: list[Sample] = []
    until = link.now + 2 * _HELLO
    if wait is None:
        link.sleep(_UNDER_WAY)
    while wait is None and link.session.settings is None and link.now < until:
        link.sleep(0.05)
    link.watch = sums.append
    try:
        (wait or link.sleep)(seconds)
    finally:
        link.watch = None
    if not sums or link.session.settings is None:
        raise RigFault(f"no record came in {seconds:g} s; check the cable")
    scale = READINGS / link.session.settings.ticks_per_record
    pressure, force = scale * np.mean([(s.pressure_sum, s.force_sum) for s in sums], axis=0)
    return float(pressure), float(force)

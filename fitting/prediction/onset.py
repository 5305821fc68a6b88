"""The pressure at which a muscle begins to pull, found on the host: nothing has to be compiled."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from jaxtyping import Float

_CELLS = 64
_ROUNDED = 64  # times the precision, per largest force, as in `Muscle.onset_pressure`


def onset_pressure(
    force: Callable[[Float[np.ndarray, " n"]], Float[np.ndarray, " n"]], highest: float
) -> float:
    """`famjax.Muscle.onset_pressure` at one length, from forces that are computed elsewhere.

    The range is walked from its upper end in 64 steps to the first one in which the force falls
    through zero, and that step again in 64, to the last digit.

    Args:
        force: F(P) [N] at gauge pressures [Pa] at a held length, 65 at a time.
        highest: pressure [Pa] up to which the onset is looked for.

    Returns:
        P [Pa]; nan where the force does not fall through zero.
    """
    upper, lower, rounding = highest, 0.0, np.nan
    while True:
        grid = np.linspace(upper, lower, _CELLS + 1)
        pull = force(grid)
        if np.isnan(rounding):
            known = np.abs(pull[np.isfinite(pull)])
            rounding = _ROUNDED * np.finfo(float).eps * known.max(initial=0.0)
        if grid[-1] == 0 and abs(pull[-1]) <= rounding:  # at rest without deadband
            pull[-1] = 0.0
        falls = np.flatnonzero((pull[:-1] > 0) & (pull[1:] <= 0))
        if not falls.size:
            return np.nan
        upper, lower = grid[falls[0]], grid[falls[0] + 1]
        if upper - lower <= 4 * np.finfo(float).eps * highest:
            return float(lower)


SAME = 5e-4
"""Part of a length by which readings at it may differ from it."""


def measured_onset(document: Mapping[str, Any], length: float) -> tuple[float, float] | None:
    """The pressures between which a muscle of that length was seen to begin to pull.

    Args:
        document: of a saved fit, with its readings.
        length: active length [m].

    Returns:
        (highest pressure [Pa] at which it was slack, 0 where it never was; lowest at which it
        pulled); None at a length that was not measured, or where readings contradict one another.
    """
    readings = document["data"]["readings"]
    columns = (readings[name] for name in ("length_m", "pressure_Pa", "force_N"))
    at, pressure, force = (np.asarray(one, float) for one in columns)
    here = np.abs(at - length) <= SAME * length
    pulls = here & (force > 0)
    if not pulls.any():
        return None
    low = float(pressure[here & (force <= 0)].max(initial=0.0))
    high = float(pressure[pulls].min())
    return (low, high) if low <= high else None

"""What in a force map would explain a misfit: the same fit of data as they would be without a fault.

Each suspicion is a change of the data that a mistake would need: a unit, absolute pressures, a
length that is off, a full load cell, outliers, two muscles in one file. A change that makes the
misfit several times smaller is named.
"""

from collections.abc import Callable

import numpy as np

from ..data.force_data import ForceData
from ..result import Identification
from .faulty_readings import Explanation, at_a_limit, kept_only, one_length_off, outliers
from .plain_faults import (
    absolute,
    no_rise,
    pulls_late,
    signs,
    small_contraction,
    steepness,
    swapped,
    thick_wall,
    wrong_rest_length,
)
from .scales import wrong_scales
from .suspicion import FAR_BETTER, GOOD, Suspicion, counted, named
from .trial import attempt, censored_misses, richest
from .two_muscles import two_muscles

_DOUBTFUL = 0.01  # of the largest force: what a good fit of a good map is below
_SURE = 0.005  # likewise: nothing simpler explains more
_MIXED = 0.013  # likewise: what is to be explained by faults of some readings
_UNEXPLAINED = 0.03  # likewise: the richest family misses no muscle's map by so much


def least_misfit(result: Identification) -> float:
    """RMSE in parts of the largest force, with what contradicts censored readings.

    Outliers of Huber's objective are not counted.
    """
    data, kept = result.data, counted(result)
    missed = censored_misses(data, result.model_force())
    squares = np.sum(result.residuals[kept] ** 2) + np.sum(missed**2)
    return float(np.sqrt(squares / kept.sum())) / result.errors.max_force


def stopped_above(result: Identification, name: str) -> bool:
    """Whether a parameter is at its upper bound."""
    return any(
        e.name == name and e.at_bound and e.max - e.value < e.value - e.min
        for e in result.estimates
    )


def cornered(result: Identification) -> bool:
    """Whether braid diameter and angle are both at the bounds of more, or of less, force."""
    sides = [
        0 if not e.at_bound else 1 if e.max - e.value < e.value - e.min else -1
        for e in result.estimates if e.name in ("braid_diameter", "braid_angle")
    ]  # fmt: skip
    return len(sides) == 2 and abs(sum(sides)) == 2


def doubtful(result: Identification) -> bool:
    """Whether a fit is so poor, or so far at its bounds, that its data are to be questioned."""
    data = result.data
    return (
        not result.converged
        or not least_misfit(result) <= _DOUBTFUL
        or stopped_above(result, "deadband_pressure")
        or cornered(result)
        or next(thick_wall(data), None) is not None
        or float(data.force.min()) < -_DOUBTFUL * data.max_force
        or steepness(data) > _STEEP
        or pulls_late(data)
    )


_STEEP = 30.0


def suspect(
    result: Identification, progress: Callable[[int, int], None] | None = None
) -> tuple[Suspicion, ...]:
    """The faults of a force map that would explain its misfit, the likeliest first.

    Args:
        result: a fit of the map.
        progress: called with (changes tried, changes).

    Returns:
        At most three.
    """
    data = kept_only(result.data, counted(result))
    plain = [*no_rise(data), *thick_wall(data)]
    if any(no_rise(data)):
        return tuple(plain)  # whatever else may be wrong does not show
    candidate = richest(data)
    here = attempt(data, candidate)
    least = min(least_misfit(result), np.inf if here is None else here.misfit)
    found = [*signs(data, here, least, candidate)] if not plain else []
    stopped = stopped_above(result, "deadband_pressure")
    found += absolute(data, here, least, candidate, stopped=stopped)
    found += small_contraction(data, least)
    if not found and least > _DOUBTFUL:
        found += wrong_rest_length(data, least)
    if not found:
        found += swapped(data, least, candidate)
    in_corner = here is None or here.corner != 0 or (cornered(result) and least > _DOUBTFUL)
    if not found and (least > GOOD or in_corner):
        found += wrong_scales(data, least, candidate, progress, cornered=in_corner)
    if not found and not plain and least > _MIXED:
        found += _of_some(data, least)
    if not found and not plain and least > _UNEXPLAINED:
        found.append(
            Suspicion(
                "no muscle explains the readings",
                f"No model of a muscle explains these readings: the richest misses them by "
                f"{least:.2%} of the largest force. Check units, signs and columns, and the "
                "specimen's rest length, bore and wall.",
                least,
            )
        )
    return tuple([*plain, *found][:3])


def _of_some(data: ForceData, least: float) -> list[Suspicion]:
    """Faults of some readings; the simplest that is as good as the best."""
    good: list[tuple[Explanation, bool]] = []
    searches = (at_a_limit, True), (outliers, True), (one_length_off, False), (two_muscles, True)
    for search, grave in searches:
        found = search(data)
        if found is not None and found[1] * FAR_BETTER < least and found[1] < GOOD:
            good.append((found, grave))
            if found[1] < _SURE:
                break
    if not good:
        return []
    best = min(found[1] for found, _ in good)
    (cause, better), grave = next(one for one in good if one[0][1] <= 2 * max(best, 1e-3))
    # What ends in no identification unexplained does not end in one explained.
    grave = grave or least > _UNEXPLAINED
    return [named(cause, least, better, grave=grave)]

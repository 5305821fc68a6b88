"""Levels: readings at one nominal pressure or length, whose measured values scatter about it."""

import dataclasses

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError
from famjax.boundary.sentence import Quantity, Sentence

MOST_APART = 40
"""Levels at most that are left out one by one; more of them in so many groups of neighbours."""

_CLEAR = 8.0  # times wider is the narrowest gap between levels than the widest one within
_WITHIN = 0.02  # of the whole range: the widest gap within a level that is taken without asking
_FINEST = 1e-4  # of the whole range: narrower gaps are all alike
_SHARED = 1.5  # readings for each level that was found: fewer, and it is chance
_NOMINAL = 2.0  # readings for each value: values that repeat exactly are nominal
_FRACTION = 0.75  # of the readings alone on their level: no levels are to be seen


@dataclasses.dataclass(frozen=True)
class Levels:
    """The level of every reading.

    Attributes:
        level: the mean of the values on the reading's level, or the value itself where all of them
            are equal; shape (n,).
        tolerance: neighbours nearer than this are on one level; 0 where only equal values are.
        note: what a reader must know, or "".
    """

    level: Float[np.ndarray, " n"]
    tolerance: float
    note: str


def levels_of(
    values: Float[np.ndarray, " n"],
    what: str,
    tolerance: float | None = None,
    beside: Float[np.ndarray, " n"] | None = None,
) -> Levels:
    """The levels of measured values: neighbours nearer than a tolerance are on one level.

    Without a tolerance, one is found where the gaps between the sorted values fall clearly into
    narrow ones, within 2 % of the range, and ones 8 times as wide that leave 1.5 readings to a
    level: the geometric mean of the two beside the divide. Values that repeat exactly, twice on
    average, are nominal, or rounded by the gauge: equal ones are on one level, and others only where
    the gaps show it and no two of them were read at one level of the other quantity, as values that
    someone set one after the other would have been.

    Args:
        values: in SI.
        what: they are, "pressure" or "length".
        tolerance: in SI, >= 0; None to find one.
        beside: level of the other quantity of each reading; None where it is not known, and values that
            repeat are nominal.

    Returns:
        The levels.

    Raises:
        InputError: a tolerance below zero, or one that chains values into a level as wide as the
            gap to the next one.

    >>> levels_of(np.array([79.97e3, 80.03e3, 80.0e3, 120.1e3, 119.9e3]), "pressure").level / 1e3
    array([ 80.,  80.,  80., 120., 120.])
    """
    given = tolerance is not None
    if given and not (np.isfinite(tolerance) and tolerance >= 0):
        raise InputError(f"the tolerance of a {what} must be >= 0, got {tolerance}")
    distinct, place = np.unique(values, return_inverse=True)
    if tolerance is None:
        tolerance = _found(distinct, values.size)
        if tolerance > 0 and values.size >= _NOMINAL * distinct.size:
            merged = _groups(distinct, tolerance)[place]
            tolerance = tolerance if _rounded(values, merged, beside) else 0.0
    group = _groups(distinct, tolerance)
    numbers = np.arange(group[-1] + 1)
    first, last = (np.searchsorted(group, numbers, side) for side in ("left", "right"))
    low, high = distinct[first], distinct[last - 1]
    if given and tolerance > 0 and (high - low).max() >= (low[1:] - high[:-1]).min(initial=np.inf):
        worst = int(np.argmax(high - low))
        raise InputError(
            f"with a tolerance of {_shown(tolerance, what)} the readings between "
            f"{_shown(low[worst], what)} and {_shown(high[worst], what)} chain into one {what}, wider "
            "than the gap to another: give a smaller tolerance"
        )
    label = group[place]
    count = np.bincount(label)
    mean = np.where(high > low, np.bincount(label, values) / count, low)
    note = ""
    if tolerance > 0 and count.size < distinct.size:
        how = "given" if given else "found from the gaps between them"
        note = Sentence(
            f"Readings whose {what}s are less than ",
            Quantity(tolerance, what),
            f" apart count as one {what} ({how}): {distinct.size} values on {count.size} levels.",
        )
    elif count.size > max(2, _FRACTION * values.size):
        note = (
            f"Hardly two readings share a {what}, and no gaps divide them into levels: leaving one "
            f"{what} out leaves out single readings. Give a tolerance "
            f"(--{what}-tolerance) if they were taken at common {what}s."
        )
    return Levels(mean[label], float(tolerance), note)


def _groups(distinct: Float[np.ndarray, " k"], tolerance: float) -> Int[np.ndarray, " k"]:
    """Number of the level of each value."""
    return np.cumsum(np.concatenate([[0], np.diff(distinct) > tolerance]))


def _rounded(
    values: Float[np.ndarray, " n"],
    group: Int[np.ndarray, " n"],
    beside: Float[np.ndarray, " n"] | None,
) -> bool:
    """Whether values of one group are a single one that was read here so, there so.

    What was set on purpose at two neighbouring values was set at both of them somewhere.
    """
    if beside is None:
        return False
    pairs = np.unique(np.stack([group, beside], axis=1), axis=0)
    with_values = np.unique(np.stack([group, beside, values], axis=1), axis=0)
    return len(with_values) == len(pairs)


def _found(distinct: Float[np.ndarray, " k"], readings: int) -> float:
    """The tolerance that the gaps show, or 0."""
    if distinct.size < 3:
        return 0.0
    span = distinct[-1] - distinct[0]
    gaps = np.sort(np.maximum(np.diff(distinct), _FINEST * span))
    divide = int(np.argmax(gaps[1:] / gaps[:-1]))
    within, between = gaps[divide], gaps[divide + 1]
    clear = between >= _CLEAR * within and within <= _WITHIN * span
    clear &= readings >= _SHARED * (gaps.size - divide)  # levels: the wide gaps, and one
    return float(np.sqrt(within * between)) if clear else 0.0


def _shown(value: float, what: str) -> str:
    return Quantity(value, what).in_units("metric")


def groups_of_levels(
    level: Float[np.ndarray, " n"], values: Float[np.ndarray, " levels"], groups: int | None = None
) -> Int[np.ndarray, " n"]:
    """In which group of neighbouring levels each reading is left out; -1 at none of the levels.

    Args:
        level: of each reading.
        values: levels to be left out, ascending.
        groups: their number; each level by itself unless given, as far as `MOST_APART` of them.
    """
    count = min(groups or MOST_APART, values.size)
    group = np.searchsorted(values, level) * count // values.size
    return np.where(np.isin(level, values), group, -1)

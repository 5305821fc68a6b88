"""Cyclic records: splitting into branches and cycles by the position alone, and the work lost.

A branch is a stretch in which the position moves one way. Holds at its ends belong to no branch.
"""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError

from ..records.stroke import turning_points

_HOLD_WIDTH = 6.0  # standard deviations of the noise within which a hold lies


@dataclasses.dataclass(frozen=True)
class Branch:
    """A stretch of a record in which the position moves one way.

    Attributes:
        start, stop: first row, and the row after the last.
        rising: the position grows.
    """

    start: int
    stop: int
    rising: bool

    @property
    def rows(self) -> slice:
        """The branch's rows of any column."""
        return slice(self.start, self.stop)


@dataclasses.dataclass(frozen=True)
class Cycle:
    """Two branches that follow each other, there and back.

    Attributes:
        first, second: the branches.
    """

    first: Branch
    second: Branch

    @property
    def rows(self) -> slice:
        """Rows from the start of the first branch to the end of the second, the hold included."""
        return slice(self.first.start, self.second.stop)


def checked_columns(
    columns: Mapping[str, ArrayLike | None],
) -> dict[str, Float[np.ndarray, " n"] | None]:
    """The columns of a record as float arrays of one length, those that are None left so.

    Raises:
        InputError: another shape, fewer than 3 readings, a value that is not finite, or a column
            `time` that runs backwards.
    """
    arrays = {
        name: None if values is None else np.asarray(values, float)
        for name, values in columns.items()
    }
    shapes = {name: values.shape for name, values in arrays.items() if values is not None}
    if len(set(shapes.values())) != 1 or any(len(shape) != 1 for shape in shapes.values()):
        raise InputError(
            "all columns of a record must be one-dimensional and equally long; got "
            + ", ".join(f"{name} of shape {shape}" for name, shape in shapes.items())
        )
    for name, values in arrays.items():
        if values is None:
            continue
        if values.size < 3:
            raise InputError(f"a record needs at least 3 readings, got {values.size}")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name} of reading {bad[0] + 1} is {values[bad[0]]}; every value must be finite: "
                "remove the reading"
            )
    time = arrays.get("time")
    if time is not None and (np.diff(time) < 0).any():
        back = int(np.flatnonzero(np.diff(time) < 0)[0])
        raise InputError(
            f"time must not run backwards; it falls from {time[back]:.6g} s to "
            f"{time[back + 1]:.6g} s at reading {back + 2}: sort the record, or split it there"
        )
    return arrays


def split_branches(position: ArrayLike, *, min_travel: float = 0.5) -> tuple[Branch, ...]:
    """The branches of a record, found by its turning points; noise and holds do not count as such.

    A turning point is an extreme from which the position comes back by at least `min_travel`.
    Readings at either end that are within the noise of a hold are left out: within six
    standard deviations of the noise from the extreme (estimated from second differences), but
    never more than 2 % of the range.

    Args:
        position: displacement, length or contraction in the order of time, shape (n,).
        min_travel: least travel of a branch, as a fraction of the record's range, in (0, 1).

    Returns:
        The branches in order, rising and falling in turn; none where nothing moves.

    Raises:
        InputError: `min_travel` outside (0, 1), or a bad column.

    >>> [(b.start, b.stop, b.rising) for b in split_branches([0, 0, 1, 2, 3, 3, 3, 2, 1, 0])]
    [(1, 5, True), (6, 10, False)]
    """
    if not 0 < min_travel < 1:
        raise InputError(f"min_travel is a fraction of the range in (0, 1), got {min_travel}")
    x = checked_columns({"position": position})["position"]
    assert x is not None
    travel = float(np.ptp(x))
    hold = min(_HOLD_WIDTH * noise_of(x), 0.02 * travel)
    turns = turning_points(x, min_travel * travel)
    return tuple(_moving_part(x, a, b, hold) for a, b in itertools.pairwise(turns))


def noise_of(values: Float[np.ndarray, " n"]) -> float:
    """Standard deviation of white noise on a smooth signal, by the median second difference."""
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6.0)))


def _moving_part(x: Float[np.ndarray, " n"], start: int, stop: int, hold: float) -> Branch:
    """The rows between two turning points without the holds: last to leave, first to arrive."""
    rising = bool(x[stop] > x[start])
    way = (x[start : stop + 1] - x[start]) * (1 if rising else -1)
    arrival = int(np.flatnonzero(way >= way[-1] - hold)[0])
    departure = int(np.flatnonzero(way[:arrival] <= hold)[-1])
    return Branch(start + departure, start + arrival + 1, rising)


def pair_cycles(branches: Sequence[Branch], *, rising_first: bool) -> tuple[Cycle, ...]:
    """The complete cycles: each branch of the first kind with the one that follows it."""
    return tuple(
        Cycle(first, second)
        for first, second in itertools.pairwise(branches)
        if first.rising == rising_first
    )


def choose_cycles(cycles: Sequence[Cycle], numbers: Sequence[int]) -> tuple[Cycle, ...]:
    """The cycles of these numbers, counted from 1.

    Raises:
        InputError: no cycles at all, none asked for, or fewer in the record than asked for.
    """
    if not cycles:
        raise InputError(
            "no complete cycle was found: the position must go there and back at least once; check "
            "the column, or lower min_travel if the cycles differ in amplitude"
        )
    if not numbers or min(numbers) < 1 or len(set(numbers)) != len(numbers):
        raise InputError(f"cycles must be different numbers from 1 up, got {list(numbers)}")
    if max(numbers) > len(cycles):
        raise InputError(
            f"cycle {max(numbers)} was asked for, but the record has {len(cycles)} complete "
            f"cycle{'s' if len(cycles) > 1 else ''}: choose among these, or record more"
        )
    return tuple(cycles[number - 1] for number in numbers)


def lost_work(position: ArrayLike, force: ArrayLike, cycle: Cycle) -> float:
    """Work [J] lost in a cycle, the integral of F dx around it by the trapezoidal rule.

    Args:
        position: x [m], such that F dx is work done on the specimen, shape (n,).
        force: F [N], shape (n,).
        cycle: rows of the record. Its ends are joined by a straight line.

    Returns:
        Work [J], positive where the force is higher while x grows.
    """
    x, F = np.asarray(position)[cycle.rows], np.asarray(force)[cycle.rows]
    return float(np.sum((np.roll(x, -1) - x) * (F + np.roll(F, -1)) / 2))

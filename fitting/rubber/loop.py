"""The hysteresis of a cyclic record: eccentric and concentric branches, their mean, lost work."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError

from .cycles import Branch, choose_cycles, lost_work, pair_cycles, split_branches
from .cyclic_record import CyclicRecord


@dataclasses.dataclass(frozen=True)
class HysteresisLoop:
    """The two branches of a cyclic record on one contraction grid.

    Attributes:
        contraction: grid [-], shape (points,), increasing, where both branches were measured.
        eccentric, concentric: pull [N] when the muscle lengthens and shortens, shape (points,).
        pressure: mean gauge pressure [Pa] of the two branches, shape (points,).
        pressure_difference: eccentric minus concentric [Pa], shape (points,): where it is not
            small, the controller and not the muscle makes part of the loop.
        lost_work: work [J] lost in each cycle, shape (cycles,), its loop area.
        speed: mean speed |dL/dt| [m/s], or None where no time is known.
        rest_length: L0 [m].
    """

    contraction: Float[np.ndarray, " points"]
    eccentric: Float[np.ndarray, " points"]
    concentric: Float[np.ndarray, " points"]
    pressure: Float[np.ndarray, " points"]
    pressure_difference: Float[np.ndarray, " points"]
    lost_work: Float[np.ndarray, " cycles"]
    speed: float | None
    rest_length: float

    @property
    def mean(self) -> Float[np.ndarray, " points"]:
        """Mean of the branches [N]: the static force, if friction is the same both ways."""
        return (self.eccentric + self.concentric) / 2

    @property
    def half_difference(self) -> Float[np.ndarray, " points"]:
        """Half the eccentric minus the concentric force [N]: the friction force."""
        return (self.eccentric - self.concentric) / 2

    @property
    def length(self) -> Float[np.ndarray, " points"]:
        """Active length L [m] of the grid."""
        return self.rest_length * (1 - self.contraction)


def hysteresis_loop(
    record: CyclicRecord,
    *,
    cycles: Sequence[int] | None = None,
    points: int = 41,
    min_travel: float = 0.5,
) -> HysteresisLoop:
    """The eccentric and concentric branches of a record on a common grid, and the work lost.

    The range that both branches cover is cut into bins of equal width. Readings of a branch, of all
    chosen cycles together, are averaged in each bin, and force and pressure taken to its middle
    along the slope between bins; curvature within a bin of width w adds F'' w^2 / 24. A bin in
    which either branch has no reading is left out.

    Args:
        record: the test at one pressure; a cycle starts in either direction.
        cycles: numbers from 1 of the cycles to use; all where None.
        points: bins of the grid, >= 3.
        min_travel: least travel of a branch as a fraction of the whole, see `split_branches`.

    Returns:
        The loop.

    Raises:
        InputError: no cycles, fewer than asked for, or too few readings that both branches share.
    """
    if points < 3:
        raise InputError(f"the grid needs at least 3 points, got {points}")
    branches = split_branches(record.length, min_travel=min_travel)
    found = pair_cycles(branches, rising_first=branches[0].rising) if branches else ()
    chosen = choose_cycles(found, range(1, max(len(found), 1) + 1) if cycles is None else cycles)
    parts = [part for cycle in chosen for part in (cycle.first, cycle.second)]
    kinds = [[part for part in parts if part.rising == rising] for rising in (True, False)]
    ranges = [record.contraction[_rows(kind)] for kind in kinds]
    low, high = max(c.min() for c in ranges), min(c.max() for c in ranges)
    edges = np.linspace(low, high, points + 1)
    lengthening, shortening = (_bin_means(record, _rows(kind), edges) for kind in kinds)
    filled = np.isfinite(lengthening[0] + shortening[0])
    if filled.sum() < 3:
        raise InputError(
            f"the branches share readings at {int(filled.sum())} of {points} contractions between "
            f"{low:.4g} and {high:.4g}, and 3 are needed: record more per branch, or ask for fewer"
        )
    grid = ((edges[:-1] + edges[1:]) / 2)[filled]
    eccentric, concentric = (
        means[1:, filled]
        + np.gradient(means[1:, filled], means[0, filled], axis=1) * (grid - means[0, filled])
        for means in (lengthening, shortening)
    )
    return HysteresisLoop(
        contraction=grid,
        eccentric=eccentric[0],
        concentric=concentric[0],
        pressure=(eccentric[1] + concentric[1]) / 2,
        pressure_difference=eccentric[1] - concentric[1],
        lost_work=np.array([lost_work(record.length, record.force, cycle) for cycle in chosen]),
        speed=_speed(record, parts),
        rest_length=record.rest_length,
    )


def _rows(branches: Sequence[Branch]) -> Int[np.ndarray, " rows"]:
    return np.concatenate([np.arange(part.start, part.stop) for part in branches])


def _bin_means(
    record: CyclicRecord, rows: Int[np.ndarray, " rows"], edges: Float[np.ndarray, " edges"]
) -> Float[np.ndarray, "3 points"]:
    """Mean contraction, force and pressure of the readings in each bin; nan in an empty one."""
    points = edges.size - 1
    columns = np.stack([record.contraction[rows], record.force[rows], record.pressure[rows]])
    columns = columns[:, (columns[0] >= edges[0]) & (columns[0] <= edges[-1])]
    number = np.digitize(columns[0], edges[1:-1])
    count = np.bincount(number, minlength=points)
    sums = np.stack([np.bincount(number, column, minlength=points) for column in columns])
    return np.where(count > 0, sums, np.nan) / np.maximum(count, 1)


def _speed(record: CyclicRecord, branches: Sequence[Branch]) -> float | None:
    if record.time is None:
        return None
    duration = sum(float(np.ptp(record.time[part.rows])) for part in branches)
    travel = sum(float(np.ptp(record.length[part.rows])) for part in branches)
    return travel / duration if duration > 0 else None

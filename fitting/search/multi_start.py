"""The outer search: descents from many starts, and constraints made exact between the stations."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError, check_seed

from ..descent import End, descend, descend_many
from ..engine import Point, solve
from ..margins import constraint_margin
from ..problem import Problem

FEASIBLE = 1e-9
"""Violation of a constraint that counts as rounding, in parts of the largest coefficient."""
_VANISHED = 1e-3  # of the coefficient that alone would carry the force
_ROUNDS = 32  # of stations that close in on touching points, at most
_FAR = 3.0  # distances between stations, within which a dip is of the same touching point
_CLOSER = 0.05  # of their distance, by which the next two stations are off the touching point
NEAR = 1e-9
"""Part of the cost that a step promises at the end of a descent that is only compared with others."""


def latin_hypercube(n_free: int, count: int, seed: int) -> Float[np.ndarray, "k p"]:
    """Latin hypercube in the unit box, away from its faces."""
    rng = np.random.default_rng(check_seed(seed))
    cells = rng.permuted(np.tile(np.arange(count), (n_free, 1)), axis=1).T
    return (cells + rng.uniform(0.05, 0.95, (count, n_free))) / count


def descend_all(
    problem: Problem,
    starts: Float[np.ndarray, "k p"],
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """The ends of the descents from all starts; the best of them goes on to its last digit."""
    counter = itertools.count(1)

    def ended(_: int) -> None:
        if progress is not None:
            progress(next(counter), len(starts))

    ends = descend_many([problem] * len(starts), list(starts), promise=NEAR, progress=ended)
    best = _lowest(ends)
    if best is not None:
        ends[best] = descend(problem, ends[best].u)
    return ends


def best_of(ends: Sequence[End]) -> End:
    """The end of the lowest cost; one whose cost is nan never is.

    Raises:
        InputError: none has a cost.
    """
    best = _lowest(ends)
    if best is None:
        raise InputError(
            "no start ended at a force for every reading: somewhere in the box the bladder does "
            "not fit in the braid or a length cannot be reached; narrow the bounds"
        )
    return ends[best]


def _lowest(ends: Sequence[End]) -> int | None:
    """Place of the lowest cost; None where none is finite."""
    costs = np.array([end.cost for end in ends])
    return int(np.nanargmin(costs)) if np.isfinite(costs).any() else None


def rounding_of(point: Point) -> float:
    """Violation of a constraint [Pa] that counts as rounding.

    In parts of the largest coefficient; of a law that all but vanishes, of a thousandth of the largest by
    which one alone would carry the force.
    """
    A, b, _, _ = point.programme
    size = np.linalg.norm(A, axis=0)
    alone = np.linalg.norm(b) / size[size > 0]
    return FEASIBLE * max(np.abs(point.x).max(initial=0), _VANISHED * alone.max(initial=0.0))


def refine(problem: Problem, best: End, spare: int) -> tuple[End, Problem]:
    """The best of the descents, with the constraint made to hold between the stations.

    Where the law is found to violate it, two stations close in on where it touches the constraint, and
    the descent goes on.

    Args:
        problem: of the descents.
        best: their best end.
        spare: number of stations at the end of each path that are free to be placed.

    Returns:
        The end of the last descent with everything known of its fit, and the problem with the
        stations placed.
    """
    kind, touching = problem.constraint, {}
    for _ in range(_ROUNDS if kind in ("drucker", "slope") else 0):
        found = constraint_margin(problem, best.point, kind)
        lowest = min(float(one.value.min()) for one in found)
        if lowest >= -rounding_of(best.point):
            break
        point, parts, first = best.point, [], 0
        for place, (part, one) in enumerate(zip(problem.parts, found, strict=True)):
            stations = part.inputs.stations.copy()
            pull = np.zeros(stations.size)
            here = (first <= point.rows) & (point.rows < first + stations.size)
            pull[point.rows[here] - first] = point.multipliers[here]
            first += stations.size
            for path in np.flatnonzero(one.value < 0):
                own, dip = stations[path], float(one.position[path])
                known = touching.setdefault((place, int(path)), [])
                near = [k for k, at in enumerate(known) if abs(at.middle - dip) < _FAR * _cell(own)]
                now = _Touch.of(own, pull.reshape(stations.shape)[path], dip)
                if near:
                    touch = near[0]
                    known[touch] = now.after(known[touch])
                else:
                    touch = len(known)
                    known.append(now)
                slot = own.size - spare + 2 * (touch % (spare // 2))
                own[slot : slot + 2] = known[touch].pair
            parts.append(part.with_stations(stations))
        problem = dataclasses.replace(problem, parts=tuple(parts))
        best = descend(problem, best.u)
    return dataclasses.replace(best, point=solve(problem, best.point.parameters)), problem


@dataclasses.dataclass(frozen=True)
class _Touch:
    """Where on a path the law touches the constraint.

    Attributes:
        middle: about where.
        half: how far off that may be.
    """

    middle: float
    half: float

    @classmethod
    def of(
        cls,
        stations: Float[np.ndarray, " stations"],
        pull: Float[np.ndarray, " stations"],
        dip: float,
    ) -> "_Touch":
        """From the active stations about a dip.

        Two on either side of it pull together as the touching point does, which lies between them, where
        the mean of their multipliers says, to second order in their distance. With one alone it is
        between that and the dip.

        Args:
            stations: of the path.
            pull: multipliers; 0 of those that are not active.
            dip: where the law is weakest.
        """
        near = (pull > 0) & (np.abs(stations - dip) < _FAR * _cell(stations))
        below, above = near & (stations <= dip), near & (stations > dip)
        if below.any() and above.any():
            low, high = float(stations[below].max()), float(stations[above].min())
            left, right = (pull[near & (stations == end)].sum() for end in (low, high))
            middle = float(left * low + right * high) / float(left + right)
            return cls(middle, _CLOSER * (high - low))
        one = dip
        if near.any():
            one = float(stations[near][np.abs(stations[near] - dip).argmin()])
        return cls((one + dip) / 2, abs(one - dip) / 2)

    def after(self, before: "_Touch") -> "_Touch":
        """What is known now: no better than how far it is from what was known before."""
        return _Touch(self.middle, max(self.half, abs(self.middle - before.middle)))

    @property
    def pair(self) -> tuple[float, float]:
        """The next two stations."""
        return max(self.middle - self.half, 0.0), min(self.middle + self.half, 1.0)


def _cell(stations: Float[np.ndarray, " stations"]) -> float:
    return 1 / (stations.size - 1)

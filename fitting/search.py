"""The outer search: descents from many starts, objectives by weights, constraints exact between stations.

Huber's objective is the sum of rho(r), rho = r^2/2 where |r| <= d, else d |r| - d^2/2. At its optimum
the weighted least squares with weights min(1, d/|r|) are stationary too, and every step towards it
lowers it (Huber 1981, section 7.8). So descent, bounds and certified convex fit stay what they are.
"""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError, check_seed

from .descent import End, descend, descend_many
from .engine import Point, solve
from .margins import constraint_margin
from .problem import Problem

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


OBJECTIVES = ("sum_of_squares", "huber", "mean_rmse")

TUNED = 1.345
"""Huber's threshold per standard deviation: 95 % efficient for normal noise (Huber 1981)."""
NORMAL_MAD = 1.4826
"""Standard deviations of normal noise in a median absolute deviation."""
_SCALED = 8  # rounds in which the noise is estimated; the threshold is then kept
_FROM_ALL = 3  # rounds that descend from every start
_REWEIGHTED = 200  # rounds, at most
_SETTLED = 1e-9  # largest change of a weight
_ROUNDING = 1e-9  # of the root mean square force: a spread below is none


@dataclasses.dataclass(frozen=True)
class Weights:
    """What an objective that is no sum of squares makes of the readings.

    Attributes:
        factor: of every reading, on its own weight, shape (points,).
        threshold: of Huber's objective, in N or in standard deviations of the readings where they have
            some; None of others.
    """

    factor: Float[np.ndarray, " points"]
    threshold: float | None


def check_objective(objective: str, *, censored: bool = False) -> None:
    """The objective must be one of those there are, and one that can be asked for."""
    if censored and objective != "sum_of_squares":
        raise InputError(
            "censored readings are one-sided squares: use objective='sum_of_squares', or leave "
            "censored out"
        )
    if objective not in OBJECTIVES:
        raise InputError(f"the objective is one of {', '.join(OBJECTIVES)}, got {objective!r}")


def descend_reweighted(
    problem: Problem,
    starts: np.ndarray,
    objective: str,
    progress: Callable[[int, int], None] | None,
) -> tuple[End, list[End], Weights]:
    """The optimum of an objective that weighted least squares reach, weighed anew until that settles.

    Huber's threshold is 1.345 standard deviations of the noise, estimated from the median of the
    residuals as the first rounds go, and kept in those that follow.

    Args:
        problem: with the readings' own weights.
        starts: points of the unit box.
        objective: "huber" or "mean_rmse".
        progress: called with (starts done, starts) in the first round.

    Returns:
        The best end, the ends of all starts as they last were, and the weights.

    Raises:
        InputError: the weights did not settle.
    """
    points = problem.force.size
    factor, threshold = np.ones(points), None
    ends = descend_all(problem, starts, progress)
    best = best_of(ends)
    for done in range(_REWEIGHTED):
        # In the readings' own weights again.
        residual, old = best.point.residual[:points] / factor, factor
        if objective == "mean_rmse":
            factor = mean_rmse_factor(residual, problem.levels("pressure"), _least(problem))
        else:
            if done < _SCALED:
                spread = NORMAL_MAD * float(np.median(np.abs(residual)))
                threshold = TUNED * max(spread, _least(problem))
            assert threshold is not None
            factor = huber_factor(residual, threshold)
        if done > _SCALED and np.abs(factor - old).max() <= _SETTLED:
            return best, ends, Weights(factor, threshold)
        changed = problem.with_readings(factor=factor)
        if done < _FROM_ALL:
            ends = descend_all(changed, starts)
            best = best_of(ends)
        else:
            best = best_of(descend_all(changed, best.u[None]))
    raise InputError(
        f"the weights of objective={objective!r} did not settle in {_REWEIGHTED} rounds: the readings "
        "leave several fits equally good. Fix parameters by bounds, or use objective='sum_of_squares'"
    )


def _least(problem: Problem) -> float:
    """A spread below which there is none, in the unit of the weighted residual."""
    return _ROUNDING * float(np.sqrt(np.mean((problem.force * problem.weight) ** 2)))


def mean_rmse_factor(
    residual: Float[np.ndarray, " points"], level: Float[np.ndarray, " points"], least: float
) -> Float[np.ndarray, " points"]:
    """Factors by which the sum of squares has the gradient of the mean RMSE, up to a constant.

    The mean of sqrt(S_p/n_p) over the pressures p lies below its tangent in the S_p, so that each round
    lowers it. One in the mean of the squares.

    Args:
        residual: in the readings' own weights.
        level: pressure of each reading.
        least: RMSE that counts as none.

    References:
        Chambers 2021, equation 7.6.
    """
    _, group = np.unique(level, return_inverse=True)
    count = np.bincount(group)
    rmse = np.maximum(np.sqrt(np.bincount(group, residual**2) / count), least)
    square = (1 / (count * rmse))[group]
    return np.sqrt(square / square.mean())


def huber_factor(residual: np.ndarray, threshold: float) -> Float[np.ndarray, " points"]:
    """sqrt(min(1, d/|r|))."""
    size = np.abs(residual)
    return np.sqrt(np.where(size > threshold, threshold / np.where(size > 0, size, 1.0), 1.0))


def pseudo_residual(
    residual: Float[np.ndarray, " k"], n_readings: int, threshold: float, unknowns: int
) -> Float[np.ndarray, " k"]:
    """Residuals whose mean square is the variance of a robust fit: K psi(r) / mean(psi').

    References:
        Huber 1981, section 7.6: K = 1 + (p/n) (1 - m)/m with m the part of readings within d.
    """
    readings = residual[:n_readings]
    within = np.mean(np.abs(readings) <= threshold)
    factor = (1 + unknowns / n_readings * (1 - within) / within) / within
    return np.concatenate(
        [factor * np.clip(readings, -threshold, threshold), residual[n_readings:]]
    )

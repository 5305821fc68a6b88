"""Bounded nonlinear least squares for many problems at once.

The method is damped Gauss-Newton with exact steps in the box: every step minimises |J d + r|^2 + mu |d|^2
with u + d inside the unit box, so bounds are met exactly. The damping mu follows Nielsen. Many descents are
evaluated together in each round, with the same results as if each were run alone.

The weakest point of a law along a path is found by sampling the path and refining each minimum. If a
constraint is violated between its stations, that point becomes a station, and the fit is repeated
(exchange).

Huber's objective is the sum of rho(r), with rho = r^2/2 for |r| <= d, else d |r| - d^2/2. Its optimum is
also stationary for least squares with the weights min(1, d/|r|), and each fit with updated weights lowers
the objective (Huber 1981, section 7.8). The certified convex fit is therefore used unchanged.

References:
    Nielsen 1999, Damping parameter in Marquardt's method, IMM-REP-1999-05.
    Murty 1974; Judice & Pires 1994 (principal pivoting for bounds).
    Hettich & Kortanek 1993, SIAM Review 35, 380-429 (exchange).
"""

import dataclasses
import itertools
from collections.abc import Callable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError, check_seed

from .engine import Batch, Chunk, Point, report_of, solve
from .problem import Part, Problem
from .programs import Layout
from .response import Constraint

_ROUNDED_OFF = 1e-8  # relative to the first residual; smaller residuals are rounding
_EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)
_TOGETHER = 128  # descents per batch, so that their arrays fit in the cache
_SNAP = 1e-12  # a step that ends this close to a face ends on it
_BLOCKS = 5  # rounds of pivots on all bounds at once; then one at a time
_SIGN = 1e-13  # relative; the sign of a smaller step or multiplier is rounding
ROUNDED = 4 * _EPS
"""Relative decrease of the cost below which a step makes no measurable difference."""


@dataclasses.dataclass(frozen=True)
class End:
    """End point of a descent.

    Attributes:
        u: point in the unit box, shape (p,).
        point: the fit at this point.
        gradient_residual: largest cosine between r and a column of J along which `u` may still
            move; zero at a stationary point.
        steps: number of accepted and rejected steps.
        converged: true if the gradient residual or the step fell below its tolerance.
    """

    u: Float[np.ndarray, " p"]
    point: Point
    gradient_residual: float
    steps: int
    converged: bool

    @property
    def cost(self) -> float:
        """Half the sum of the squared residuals."""
        return self.point.cost


def descend(problem: Problem, start: Float[np.ndarray, " p"], *, tolerance: float = 1e-10) -> End:
    """Descend from one start to a local minimum in the box of the nonlinear parameters.

    Args:
        problem: the problem.
        start: point in the unit box of the free parameters, shape (p,).
        tolerance: tolerance of the gradient residual and of the step.

    Returns:
        The end point; its cost is nan if there is no fit at the start.
    """
    return descend_many([problem], [start], tolerance=tolerance)[0]


def descend_many(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, " _"]],
    *,
    max_steps: int = 200,
    tolerance: float = 1e-10,
    promise: float = ROUNDED,
    damping: float = 1e-3,
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """Descend to local minima, each in the box of its own problem and from its own start.

    Args:
        problems: one problem for each descent. Problems with the same structure are evaluated together.
        starts: starting points, each in the unit box of its problem's free parameters.
        max_steps: largest number of steps in a descent, including rejected ones.
        tolerance: as in `descend`.
        promise: smallest relative decrease of the cost. A descent ends if its last step was accepted and
            the next one is predicted to achieve less.
        damping: initial damping, relative to the largest squared column of the Jacobian; smaller near an
            optimum.
        progress: called with (descents done, total).

    Returns:
        The end points, in the order of the problems.
    """
    layouts = {id(problem): Layout(problem) for problem in problems}
    alike: dict[tuple, list[int]] = {}
    for place, problem in enumerate(problems):
        alike.setdefault(_structure(problem, layouts[id(problem)]), []).append(place)
    ends: dict[int, End] = {}
    for places in alike.values():
        distinct = {id(problems[place]): problems[place] for place in places}
        number = {key: k for k, key in enumerate(distinct)}
        members = np.array([number[id(problems[place])] for place in places])
        batch = Batch(list(distinct.values()), [layouts[key] for key in distinct])
        points = np.full((len(places), batch.free.size), 0.5)
        own = [np.isin(batch.free, problems[place].free) for place in places]
        for point, mine, place in zip(points, own, places, strict=True):
            point[mine] = starts[place]
        for first in range(0, len(places), _TOGETHER):
            here = slice(first, first + _TOGETHER)
            with np.errstate(all="ignore"):
                for which, end in _descents(
                    batch, members[here], points[here], max_steps, tolerance, promise, damping
                ):
                    mine = first + which
                    ends[places[mine]] = dataclasses.replace(end, u=end.u[own[mine]])
                    if progress is not None:
                        progress(len(ends), len(problems))
    return [ends[place] for place in range(len(problems))]


def _structure(problem: Problem, at: Layout) -> tuple:
    """Return a key that is equal for problems that share a program and the states of their readings."""
    arrays = tuple(leaf.tobytes() for group in at.groups for leaf in group.arrays)
    return at.forms, at.sizes, arrays, problem.side.tobytes(), problem.constraint, problem.ridge


def gradient_residual(
    u: Float[np.ndarray, "b p"],
    r: Float[np.ndarray, "b k"],
    J: Float[np.ndarray, "b k p"],
    scale: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Return the largest cosine between r and a column of J along which u can still move; see `End`."""
    gradient = (r[:, None] @ J)[:, 0]
    stopped = ((u <= 0) & (gradient > 0)) | ((u >= 1) & (gradient < 0))
    # A residual that has nearly vanished has no direction; it is measured relative to the start.
    length = np.linalg.norm(r, axis=1) + _ROUNDED_OFF * scale
    size = np.linalg.norm(J, axis=1) * length[:, None]
    cosine = np.where(stopped, 0.0, np.abs(gradient)) / np.maximum(size, _TINY)
    return np.max(cosine, axis=1, initial=0.0)


def step_in_box(
    J: Float[np.ndarray, "b k p"],
    r: Float[np.ndarray, "b k"],
    damping: Float[np.ndarray, " b"],
    low: Float[np.ndarray, "b p"],
    high: Float[np.ndarray, "b p"],
) -> Float[np.ndarray, "b p"]:
    """Minimise |J d + r|^2 + damping |d|^2 with low <= d <= high.

    Principal pivoting guesses which steps are at their bounds and solves for the others. Steps that
    violate a bound are then fixed at it, and bounds whose multiplier has the wrong sign are released. At
    first all of them change together; later only the last one changes, which guarantees termination for
    every positive definite problem.
    """
    count, p = low.shape
    eye = np.broadcast_to(np.eye(p), (count, p, p))
    Q, R = np.linalg.qr(np.concatenate([J, np.sqrt(damping)[:, None, None] * eye], axis=1))
    c = -(r[:, None] @ Q[:, : r.shape[1]])[:, 0]
    side, move = np.zeros((count, p), int), np.zeros((count, p))
    left = np.arange(count)
    for done in range(_BLOCKS + 2**p):
        at, lo, hi = side[left], low[left], high[left]
        free, d = at == 0, np.where(at < 0, lo, np.where(at > 0, hi, 0.0))
        rest = c[left] - (R[left] @ d[:, :, None])[:, :, 0]
        # Columns at a bound are replaced by rows of the unit matrix.
        stacked = np.concatenate([R[left] * free[:, None], eye[left] * ~free[:, None]], axis=1)
        Q2, R2 = np.linalg.qr(stacked)
        d = d + np.linalg.solve(R2, (rest[:, None] @ Q2[:, :p]).swapaxes(1, 2))[:, :, 0] * free
        pull = (((R[left] @ d[:, :, None])[:, :, 0] - c[left])[:, None] @ R[left])[:, 0]
        size = np.linalg.norm(R[left], axis=1) * np.linalg.norm(c[left], axis=1)[:, None]
        below, above = free & (d < lo - _SIGN), free & (d > hi + _SIGN)
        release = ((at < 0) & (pull < -_SIGN * size)) | ((at > 0) & (pull > _SIGN * size))
        wrong = below | above | release
        if done >= _BLOCKS:
            last = p - 1 - np.argmax(wrong[:, ::-1], axis=1)
            wrong &= np.arange(p) == last[:, None]
        side[left] = np.where(wrong, np.where(below, -1, np.where(above, 1, 0)), at)
        move[left] = np.clip(d, lo, hi)
        left = left[wrong.any(axis=1)]
        if not left.size:
            break
    return move


def _squares(r: Float[np.ndarray, "b k"]) -> Float[np.ndarray, " b"]:
    return np.einsum("bk,bk->b", r, r)


def _descents(
    batch: Batch,
    members: Int[np.ndarray, " descents"],
    starts: Float[np.ndarray, "descents p"],
    max_steps: int,
    tolerance: float,
    promise: float,
    first_damping: float,
) -> Iterator[tuple[int, End]]:
    """Yield the index and end point of each descent when it ends."""
    count, p = starts.shape
    u, trial, at = starts.copy(), starts.copy(), np.full(count, None, object)
    r, J = np.zeros((count, batch.residuals)), np.zeros((count, batch.residuals, p))
    predicted, scale, damping, growth = (
        np.ones(count),
        np.zeros(count),
        np.zeros(count),
        np.ones(count),
    )
    residual, steps, going = np.full(count, np.inf), np.zeros(count, int), np.arange(count)

    def ended(
        gone: Bool[np.ndarray, " b"], converged: Bool[np.ndarray, " b"]
    ) -> Iterator[tuple[int, End]]:
        for k, good in zip(going[gone].tolist(), converged[gone].tolist(), strict=True):
            chunk, row = at[k]
            yield k, End(u[k].copy(), chunk.point(row), float(residual[k]), int(steps[k]), good)

    while going.size:
        mine = members[going]
        near: list[Any] = [
            None if at[k] is None else (at[k], r[k] + J[k] @ (trial[k] - u[k])) for k in going
        ]
        found: list[tuple[Chunk, int]] = batch.evaluate(
            mine, batch.parameters(mine, trial[going]), near, tolerance**0.5
        )
        value, slope = batch.residual_and_jacobian(mine, found)
        first, new = steps[going] == 0, _squares(value)
        ratio = (_squares(r[going]) - new) / predicted[going]
        better = np.isfinite(new) & (first | ((ratio > 1e-4) & np.isfinite(slope).all((1, 2))))
        for k in np.flatnonzero(better | first):
            at[going[k]] = found[k]
        moved = going[better]
        u[moved], r[moved], J[moved] = trial[moved], value[better], slope[better]
        scale[going[first]] = np.sqrt(new[first])
        # Nielsen's damping is smooth in the quality of the step and grows faster after refusals.
        growth[going] = np.where(better, 1.0, 2 * growth[going])
        factor = np.where(better, np.maximum(1 / 3, 1 - (2 * ratio - 1) ** 3), growth[going])
        begin = first_damping * np.max(np.sum(J[going] ** 2, axis=1), axis=1, initial=0.0)
        damping[going] = np.maximum(np.where(first, begin, damping[going] * factor), _TINY)
        cosine = gradient_residual(u[going], r[going], J[going], scale[going])
        residual[going] = np.where(better, cosine, np.where(first, np.nan, residual[going]))
        nowhere, over = np.isnan(residual[going]), steps[going] >= max_steps
        done = ~nowhere & ((p == 0) | (~over & (residual[going] <= tolerance)))
        steps[going] = np.where(nowhere | (p == 0), 0, np.minimum(steps[going] + 1, max_steps))
        yield from ended(nowhere | over | done, done)
        going = going[~(nowhere | over | done)]
        if not going.size:
            break
        move = step_in_box(J[going], r[going], damping[going], -u[going], 1 - u[going])
        then = u[going] + move
        trial[going] = np.where(then < _SNAP, 0.0, np.where(then > 1 - _SNAP, 1.0, then))
        cost = _squares(r[going])
        predicted[going] = cost - _squares(r[going] + (J[going] @ move[:, :, None])[:, :, 0])
        # After refusals a damped step predicts little, even far from the end.
        least = np.where(growth[going] == 1.0, promise, ROUNDED) * cost
        done = (predicted[going] <= least) | (np.abs(move).max(axis=1) <= tolerance)
        yield from ended(done, done)
        going = going[~done]


_ALIKE = 1e-4  # relative difference of the costs of two descents to the same point
NEAR = 1e-9
"""Smallest predicted relative decrease of the cost in descents that are only compared with each other."""


def latin_hypercube(n_free: int, count: int, seed: int) -> Float[np.ndarray, "k p"]:
    """Return a Latin hypercube in the unit box, away from its faces."""
    rng = np.random.default_rng(check_seed(seed))
    cells = rng.permuted(np.tile(np.arange(count), (n_free, 1)), axis=1).T
    return (cells + rng.uniform(0.05, 0.95, (count, n_free))) / count


def descend_all(
    problem: Problem,
    starts: Float[np.ndarray, "k p"],
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """Descend from all starts and return the end points; the best one is refined to full precision.

    With several starts, a long map is first searched with a sample of its readings. Distinct end points
    are then refined with all readings.
    """
    part = problem if len(starts) == 1 else problem.thinned()
    (ends,) = descend_from([part], [starts], promise=NEAR, progress=progress)
    if part is not problem:
        alike: list[list[End]] = []
        for end in sorted(ends, key=lambda end: np.nan_to_num(end.cost, nan=np.inf)):
            if not alike or not end.cost <= alike[-1][0].cost * (1 + _ALIKE):
                alike.append([])
            alike[-1].append(end)
        (found,) = descend_from([problem], [[of[0].u for of in alike]], promise=NEAR)
        ends = [end for end, of in zip(found, alike, strict=True) for _ in of]
    costs = [end.cost for end in ends]
    if np.isfinite(costs).any():
        best = int(np.nanargmin(costs))
        ends[best] = descend(problem, ends[best].u)
    return ends


def descend_from(
    problems: Sequence[Problem],
    starts: Sequence[Sequence[np.ndarray] | Float[np.ndarray, "_ _"]],
    **settings: Any,
) -> list[list[End]]:
    """Return the end points for several problems, each from its own starts; see `descend_many`."""
    each = [(one, start) for one, own in zip(problems, starts, strict=True) for start in own]
    ends = iter(descend_many([one for one, _ in each], [u for _, u in each], **settings))
    return [list(itertools.islice(ends, len(own))) for own in starts]


def best_of(ends: Sequence[End]) -> End:
    """Return the end point with the lowest cost; nan costs are ignored.

    Raises:
        InputError: no end point has a finite cost.
    """
    costs = [end.cost for end in ends]
    if not np.isfinite(costs).any():
        raise InputError(
            "from every starting point, the force was undefined at some reading: the bounds allow muscles "
            "whose bladder does not fit in the braid, or that cannot reach a measured length. Narrow the "
            "bounds"
        )
    return ends[int(np.nanargmin(costs))]


FEASIBLE = 1e-9
"""Violation of a constraint that counts as rounding, relative to the largest coefficient."""
_WITHOUT_LAW = 1e-3  # of the coefficient that alone would carry the force
_EXCHANGED = 64  # of exchange, at most
_PIECES = 4  # of each path, each with as many samples as a path has stations
_MINIMA = 3  # of the samples of a path that are closed in on
_ZOOMS = 5  # each narrows a minimum to two of the cells between its samples


class Margin(NamedTuple):
    """The weakest state on each path of a part.

    Attributes:
        position: position along the path in [0, 1], shape (paths,).
        value: modulus at this position [Pa], shape (paths,); nan if the law has none.
    """

    position: Float[np.ndarray, " paths"]
    value: Float[np.ndarray, " paths"]


def constraint_margin(problem: Problem, point: Point, kind: Constraint) -> list[Margin]:
    """Find the smallest modulus along the actuation paths, or tangent modulus over the strain range.

    Args:
        problem: problem whose paths are checked.
        point: the fit.
        kind: "drucker" for second-order work along the path, "slope" for the law's own tangent.

    Returns:
        One margin for each part. The law is stable where the value is >= 0.
    """
    return [_margin(part, point, place, kind) for place, part in enumerate(problem.parts)]


def _margin(part: Part, point: Point, place: int, kind: Constraint) -> Margin:
    paths, count = part.inputs.stations.shape
    rows, nodes = np.arange(paths), np.linspace(0, 1, count)

    def evaluate(at: Float[np.ndarray, "paths k"]) -> Float[np.ndarray, "paths k"]:
        found = report_of(part.with_stations(at), point, place)
        return found.path_modulus if kind == "drucker" else found.slope

    at = np.concatenate([(piece + nodes) / _PIECES for piece in range(_PIECES)])
    values = np.concatenate(
        [evaluate(np.tile(piece, (paths, 1))) for piece in np.split(at, _PIECES)], axis=1
    )
    if not np.isfinite(values).all():
        return Margin(np.zeros(paths), np.full(paths, np.nan))
    padded = np.pad(values, ((0, 0), (1, 1)), constant_values=np.inf)
    dips = (values <= padded[:, :-2]) & (values <= padded[:, 2:])
    several = min(_MINIMA, int(dips.sum(axis=1).max()))
    places = np.argsort(np.where(dips, values, np.inf), axis=1, kind="stable")[:, :several]
    middle, half = at[places], 1 / (count - 1) / _PIECES
    found = middle
    for _ in range(_ZOOMS):
        tried = np.clip(middle[..., None] + half * (2 * nodes - 1), 0, 1)
        found = np.stack([evaluate(tried[:, k]) for k in range(several)], axis=1)
        middle = np.take_along_axis(tried, found.argmin(axis=2)[..., None], axis=2)[..., 0]
        half *= 2 / (count - 1)
    least = found.min(axis=2)
    best = least.argmin(axis=1)
    return Margin(middle[rows, best], least[rows, best])


def rounding_of(point: Point) -> float:
    """Return the constraint violation [Pa] that counts as rounding.

    It is relative to the largest coefficient. For a law that nearly vanishes, it is relative to a
    thousandth of the largest value that a single coefficient would need to carry the force alone.
    """
    size = np.linalg.norm(point.A, axis=0)
    alone = np.linalg.norm(point.b) / size[size > 0]
    return FEASIBLE * max(np.abs(point.x).max(initial=0), _WITHOUT_LAW * alone.max(initial=0.0))


def refine(problem: Problem, best: End, spare: int) -> tuple[End, Problem]:
    """Enforce the constraint between the stations as well.

    If the weakest point of a path violates the constraint, it replaces the station that was added longest
    ago, and the descent continues.

    Args:
        problem: the problem that the descents solved.
        best: best end point of the descents.
        spare: number of stations, the last ones listed for each path, that may be replaced.

    Returns:
        The end point of the last descent with its complete fit, and the problem with its stations.
    """
    kind = problem.constraint
    for done in range(_EXCHANGED if kind in ("drucker", "slope") else 0):
        found = constraint_margin(problem, best.point, kind)
        least = -rounding_of(best.point)
        if min(float(one.value.min()) for one in found) >= least:
            break
        parts = []
        for part, one in zip(problem.parts, found, strict=True):
            stations, violated = part.inputs.stations.copy(), one.value < least
            stations[violated, -1 - done % spare] = one.position[violated]
            parts.append(part.with_stations(stations))
        problem = dataclasses.replace(problem, parts=tuple(parts))
        best = descend(problem, best.u)
    return dataclasses.replace(best, point=solve(problem, best.point.parameters)), problem


OBJECTIVES = ("sum_of_squares", "huber", "mean_rmse")

TUNED = 1.345
"""Huber's threshold per standard deviation: 95 % efficient for normal noise (Huber 1981)."""
NORMAL_MAD = 1.4826
"""Ratio of the standard deviation of normal noise to its median absolute deviation."""
_SCALED = 8  # rounds in which the noise is estimated; the threshold is then kept
_FROM_ALL = 3  # rounds that descend from every start
_REWEIGHTED = 200  # rounds, at most
_SETTLED = 1e-9  # largest change of a weight
_ROUNDING = 1e-9  # of the root mean square force: a spread below is none


@dataclasses.dataclass(frozen=True)
class Weights:
    """Weights of the readings for an objective other than the sum of squares.

    Attributes:
        factor: factor applied to the weight of each reading, shape (points,).
        threshold: threshold of Huber's objective, in N or, if the readings have standard deviations, as a
            multiple of these; None for other objectives.
    """

    factor: Float[np.ndarray, " points"]
    threshold: float | None


def check_objective(objective: str, *, censored: bool = False) -> None:
    """Check that the objective is known, and that it allows censored readings if there are any."""
    if censored and objective != "sum_of_squares":
        raise InputError(
            "censored readings, which enter as one-sided squares, require objective='sum_of_squares': "
            "use this objective, or omit censored"
        )
    if objective not in OBJECTIVES:
        raise InputError(f"objective must be one of {', '.join(OBJECTIVES)}; got {objective!r}")


def descend_reweighted(
    problem: Problem,
    starts: np.ndarray,
    objective: str,
    progress: Callable[[int, int], None] | None,
) -> tuple[End, list[End], Weights]:
    """Find the optimum of an objective by iteratively reweighted least squares.

    Huber's threshold is 1.345 standard deviations of the noise. The noise is estimated from the median
    of the residuals during the first rounds and then kept constant.

    Args:
        problem: problem with the original weights of the readings.
        starts: starting points in the unit box.
        objective: "huber" or "mean_rmse".
        progress: called with (starts done, total) in the first round.

    Returns:
        The best end point, the latest end points from all starts, and the weights.

    Raises:
        InputError: the weights did not converge.
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
        again = descend_all(changed, starts if done < _FROM_ALL else best.u[None])
        best, ends = best_of(again), again if done < _FROM_ALL else ends
    raise InputError(
        f"the weights of objective={objective!r} did not converge in {_REWEIGHTED} rounds, because "
        "several fits are equally good. Fix parameters with bounds, or use objective='sum_of_squares'"
    )


def _least(problem: Problem) -> float:
    """Return the smallest spread that is distinguished from zero, in the unit of the weighted residual."""
    return _ROUNDING * float(np.sqrt(np.mean((problem.force * problem.weight) ** 2)))


def mean_rmse_factor(
    residual: Float[np.ndarray, " points"], level: Float[np.ndarray, " points"], least: float
) -> Float[np.ndarray, " points"]:
    """Return the factors for which the sum of squares has the gradient of the mean RMSE, up to a constant.

    The mean of sqrt(S_p/n_p) over the pressures p lies below its tangent in S_p, so each round lowers it.
    The mean of the squared factors is 1.

    Args:
        residual: residuals with the original weights of the readings.
        level: pressure of each reading.
        least: lower limit of an RMSE; smaller values are replaced by it.

    References:
        Chambers 2021, equation 7.6.
    """
    _, group = np.unique(level, return_inverse=True)
    count = np.bincount(group)
    rmse = np.maximum(np.sqrt(np.bincount(group, residual**2) / count), least)
    square = (1 / (count * rmse))[group]
    return np.sqrt(square / square.mean())


def huber_factor(residual: np.ndarray, threshold: float) -> Float[np.ndarray, " points"]:
    """Return sqrt(min(1, d/|r|))."""
    size = np.abs(residual)
    return np.sqrt(np.where(size > threshold, threshold / np.where(size > 0, size, 1.0), 1.0))


def pseudo_residual(
    residual: Float[np.ndarray, " k"], n_readings: int, threshold: float, unknowns: int
) -> Float[np.ndarray, " k"]:
    """Return residuals whose mean square is the variance of a robust fit: K psi(r) / mean(psi').

    References:
        Huber 1981, section 7.6: K = 1 + (p/n) (1 - m)/m with m the fraction of readings within d.
    """
    readings = residual[:n_readings]
    within = np.mean(np.abs(readings) <= threshold)
    factor = (1 + unknowns / n_readings * (1 - within) / within) / within
    return np.concatenate(
        [factor * np.clip(readings, -threshold, threshold), residual[n_readings:]]
    )

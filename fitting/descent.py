"""Bounded nonlinear least squares, many at once: damped Gauss-Newton with exact steps in the box.

Every step minimises |J d + r|^2 + mu |d|^2 with u + d inside the unit box, so that a bound is met
exactly. The damping mu follows Nielsen. Many descents go in step: every round evaluates all of them
together, and where one ends the next takes its place. Each goes as it would alone.

References:
    Nielsen 1999, Damping parameter in Marquardt's method, IMM-REP-1999-05.
    Murty 1974; Judice & Pires 1994 (principal pivoting for bounds).
"""

import dataclasses
from collections.abc import Callable, Iterator, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from .engine import Batch, Chunk, Point
from .problem import Problem
from .programs import Layout

_VANISHED = 1e-8  # parts of the first residual below which a residual is rounding
_EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)
_TOGETHER = 128  # descents in step: more, and their arrays leave the cache
_SNAP = 1e-12  # a step that ends this near to a face was meant to end on it
_BLOCKS = 5  # rounds of pivots on all bounds at once, before one at a time
_SIGN = 1e-13  # of the largest: the sign of a smaller step or multiplier is rounding
ROUNDED = 4 * _EPS
"""Part of the cost: a step that promises less cannot be seen to descend."""


@dataclasses.dataclass(frozen=True)
class End:
    """Where a descent ended.

    Attributes:
        u: point in the unit box, shape (p,).
        point: the fit there.
        gradient_residual: largest cosine between r and a column of J along which `u` may still
            move; zero at a stationary point.
        steps: accepted and refused steps taken.
        converged: the gradient residual or the step fell below its tolerance.
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
    """A local minimiser over the box of the nonlinear parameters, from one start.

    Args:
        problem: what is fitted.
        start: point in the unit box of the free parameters, shape (p,).
        tolerance: on the gradient residual, and on the step.

    Returns:
        The end; its cost is nan where the start has no fit.
    """
    return descend_many([problem], [start], tolerance=tolerance)[0]


def descend_many(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, " _"]],
    *,
    max_steps: int = 200,
    tolerance: float = 1e-10,
    promise: float = ROUNDED,
    progress: Callable[[int], None] | None = None,
) -> list[End]:
    """Local minimisers, each over the box of a problem and from a start of its own.

    Args:
        problems: one for each descent; those that differ in numbers of readings only go in step.
        starts: of each, in the unit box of its own free parameters.
        max_steps: limit on the steps of each, refused ones included.
        tolerance: as in `descend`.
        promise: part of the cost; where the last step was accepted and the next promises less,
            a descent ends.
        progress: called with the place of each descent that has ended.

    Returns:
        The ends, in the order of the problems.
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
        batch = Batch(
            list(distinct.values()),
            [layouts[key] for key in distinct],
            bulk=len(places) > _TOGETHER,
        )
        points = np.full((len(places), batch.free.size), 0.5)
        own = [np.isin(batch.free, problems[place].free) for place in places]
        for point, mine, place in zip(points, own, places, strict=True):
            point[mine] = starts[place]
        descents = _Descents(batch, members, points, max_steps, tolerance, promise)
        for which, end in descents.ends():
            ends[places[which]] = dataclasses.replace(end, u=end.u[own[which]])
            if progress is not None:
                progress(places[which])
    return [ends[place] for place in range(len(problems))]


def _structure(problem: Problem, at: Layout) -> tuple:
    """Equal for problems of one program that have readings at the same states."""
    arrays = tuple(leaf.tobytes() for group in at.groups for leaf in group.arrays)
    return at.forms, at.sizes, arrays, problem.side.tobytes(), problem.constraint, problem.ridge


def gradient_residual(
    u: Float[np.ndarray, "b p"],
    r: Float[np.ndarray, "b k"],
    J: Float[np.ndarray, "b k p"],
    scale: Float[np.ndarray, " b"],
) -> Float[np.ndarray, " b"]:
    """Largest cosine between r and a column of J along which u may still move, see `End`."""
    gradient = (r[:, None] @ J)[:, 0]
    stopped = ((u <= 0) & (gradient > 0)) | ((u >= 1) & (gradient < 0))
    # A residual that has all but vanished has no direction left: it is measured against the start.
    length = np.linalg.norm(r, axis=1) + _VANISHED * scale
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
    """The minimisers d of |J d + r|^2 + damping |d|^2 with low <= d <= high.

    Principal pivoting: steps at their bounds are guessed, the others solved for, and those that
    break a bound, or a bound whose multiplier has the wrong sign, change sides; all of them at
    first, later the last one alone, which ends for every positive definite problem.
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


@dataclasses.dataclass
class _State:
    """Descents on their way, with a leading axis: the best points, and those to be tried next."""

    which: Int[np.ndarray, " b"]
    u: Float[np.ndarray, "b p"]
    trial: Float[np.ndarray, "b p"]
    r: Float[np.ndarray, "b k"]
    J: Float[np.ndarray, "b k p"]
    predicted: Float[np.ndarray, " b"]
    scale: Float[np.ndarray, " b"]
    damping: Float[np.ndarray, " b"]
    growth: Float[np.ndarray, " b"]
    residual: Float[np.ndarray, " b"]
    steps: Int[np.ndarray, " b"]
    at: np.ndarray  # what holds the fit, and its place in it

    def kept(self, rows: Bool[np.ndarray, " b"]) -> "_State":
        """Some of them."""
        return _State(**{name: leaf[rows] for name, leaf in vars(self).items()})

    def joined(self, other: "_State") -> "_State":
        """These and others."""
        both = {name: (leaf, getattr(other, name)) for name, leaf in vars(self).items()}
        return _State(**{name: np.concatenate(leaves) for name, leaves in both.items()})


class _Descents:
    """Descents that go in step."""

    def __init__(
        self,
        batch: Batch,
        members: Int[np.ndarray, " descents"],
        starts: Float[np.ndarray, "descents p"],
        max_steps: int,
        tolerance: float,
        promise: float,
    ) -> None:
        self._batch, self._members, self._starts = batch, members, starts
        self._max_steps, self._tolerance, self._promise = max_steps, tolerance, promise
        self._next = 0
        self._now = self._fresh(0)

    def ends(self) -> Iterator[tuple[int, End]]:
        """Number and end of each descent, as they end."""
        with np.errstate(all="ignore"):
            while self._next < len(self._starts) or self._now.which.size:
                more = min(_TOGETHER - self._now.which.size, len(self._starts) - self._next)
                if more:
                    self._now = self._now.joined(self._fresh(more))
                yield from self._evaluate()
                yield from self._move()

    def _fresh(self, count: int) -> _State:
        """The next descents at their starts."""
        new = np.arange(self._next, self._next + count)
        self._next += count
        u, p, k = self._starts[new], self._starts.shape[1], self._batch.residuals
        one = np.ones(count)
        return _State(
            which=new, u=u, trial=u, r=np.zeros((count, k)), J=np.zeros((count, k, p)),
            predicted=one, scale=0 * one, damping=0 * one, growth=2 * one, residual=np.inf * one,
            steps=np.zeros(count, int), at=np.full(count, None, object),
        )  # fmt: skip

    def _leave(
        self, gone: Bool[np.ndarray, " b"], converged: Bool[np.ndarray, " b"]
    ) -> Iterator[tuple[int, End]]:
        """The ends of those that are gone, which are taken out."""
        now = self._now
        for k in np.flatnonzero(gone):
            chunk, row = now.at[k]
            yield int(now.which[k]), End(
                now.u[k].copy(), chunk.point(row), float(now.residual[k]), int(now.steps[k]),
                bool(converged[k]),
            )  # fmt: skip
        self._now = now.kept(~gone)

    def _evaluate(self) -> Iterator[tuple[int, End]]:
        """The fits at the trial points, which become the points where they are better."""
        now, batch = self._now, self._batch
        members = self._members[now.which]
        found: list[tuple[Chunk, int]] = batch.evaluate(
            members, batch.parameters(members, now.trial), now.at.tolist(), self._tolerance**0.5
        )
        value, J = batch.residual_and_jacobian(members, found)
        first, old, new = now.steps == 0, _squares(now.r), _squares(value)
        ratio = (old - new) / now.predicted
        better = np.isfinite(new) & (first | ((ratio > 1e-4) & np.isfinite(J).all((1, 2))))
        for k in np.flatnonzero(better | first):
            now.at[k] = found[k]
        now.u = np.where(better[:, None], now.trial, now.u)
        now.r = np.where(better[:, None], value, now.r)
        now.J = np.where(better[:, None, None], J, now.J)
        now.scale = np.where(first, np.sqrt(new), now.scale)
        # Nielsen's damping: smooth in the quality of the step, growing faster after refusals.
        factor = np.where(better, np.maximum(1 / 3, 1 - (2 * ratio - 1) ** 3), now.growth)
        begin = 1e-3 * np.max(np.sum(now.J**2, axis=1), axis=1, initial=0.0)
        now.damping = np.maximum(np.where(first, begin, now.damping * factor), _TINY)
        now.growth = np.where(better, 2.0, 2 * now.growth)
        slope = gradient_residual(now.u, now.r, now.J, now.scale)
        now.residual = np.where(better, slope, now.residual)
        nowhere, nothing = first & ~better, better & (now.u.shape[1] == 0)
        now.residual = np.where(nowhere, np.nan, now.residual)
        now.steps = now.steps + 1
        over = now.steps > self._max_steps
        done = nothing | (~over & (now.residual <= self._tolerance))
        now.steps = np.where(nowhere | nothing, 0, np.minimum(now.steps, self._max_steps))
        yield from self._leave(nowhere | over | done, done)

    def _move(self) -> Iterator[tuple[int, End]]:
        """The next trial points; descents end whose step shows no descent."""
        now = self._now
        if not now.which.size:
            return
        move = step_in_box(now.J, now.r, now.damping, -now.u, 1 - now.u)
        trial = now.u + move
        now.trial = np.where(trial < _SNAP, 0.0, np.where(trial > 1 - _SNAP, 1.0, trial))
        cost = _squares(now.r)
        now.predicted = cost - _squares(now.r + (now.J @ move[:, :, None])[:, :, 0])
        # A step that is damped after refusals promises little, however far the end is.
        promise = np.where(now.growth == 2.0, self._promise, ROUNDED)
        still = np.abs(move).max(axis=1) <= self._tolerance
        done = (now.predicted <= promise * cost) | still
        yield from self._leave(done, done)

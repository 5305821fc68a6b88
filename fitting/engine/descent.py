"""Nonlinear least squares in a box, on the host: damped Gauss-Newton with exact convex steps.

Every step minimises |J d + r|^2 + mu |d|^2 with u + d inside the unit box, by the convex core, so
that a bound is met exactly and its multiplier is known, without transforms that flatten the
problem at its edge. `box.minimise_in_box` is the same in JAX.

Many descents go in step: every round evaluates all of them together, and where one ends the next
takes its place. Each goes as it would alone.
"""

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

from ..convex.arrays import AnyArray, member, namespace
from ..convex.host_qp import solve_host_qps
from .point import Point
from .problem import Problem
from .stack import Near, Stack

_VANISHED = 1e-8  # parts of the first residual below which a residual is rounding
_EPS = float(np.finfo(float).eps)
_TINY = float(np.finfo(float).tiny)
_TOGETHER = 128  # descents in step: more, and their arrays leave the cache
SNAP = 1e-12
"""A step that ends this near to a face was meant to end on it."""
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


def descend(
    problem: Problem,
    start: Float[np.ndarray, " p"],
    *,
    tolerance: float = 1e-10,
) -> End:
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
        problems: one for each descent; those that share their programs go in step.
        starts: of each, in the unit box of its own free parameters.
        max_steps: limit on the steps of each, refused ones included.
        tolerance: as in `descend`.
        promise: part of the cost; where the last step was accepted and the next promises less,
            a descent ends.
        progress: called with the place of each descent that has ended.

    Returns:
        The ends, in the order of the problems.
    """
    alike: dict[tuple, list[int]] = {}
    for place, problem in enumerate(problems):
        alike.setdefault(problem.structure, []).append(place)
    ends: dict[int, End] = {}
    for places in alike.values():
        distinct = {id(problems[place]): problems[place] for place in places}
        number = {key: k for k, key in enumerate(distinct)}
        members = np.array([number[id(problems[place])] for place in places])
        stack = Stack(list(distinct.values()))
        points = np.full((len(places), stack.free.size), 0.5)
        own = [np.isin(stack.free, problems[place].free) for place in places]
        for point, mine, place in zip(points, own, places, strict=True):
            point[mine] = starts[place]
        for which, end in _InStep(stack, members, points, max_steps, tolerance, promise).ends():
            ends[places[which]] = dataclasses.replace(end, u=end.u[own[which]])
            if progress is not None:
                progress(places[which])
    return [ends[place] for place in range(len(problems))]


def gradient_residual(
    u: Float[AnyArray, "b p"],
    r: Float[AnyArray, "b k"],
    J: Float[AnyArray, "b k p"],
    scale: Float[AnyArray, " b"],
) -> Float[AnyArray, " b"]:
    """Largest cosine between r and a column of J along which u may still move, see `End`."""
    xp = namespace(u)
    gradient = (r[:, None] @ J)[:, 0]
    stopped = ((u <= 0) & (gradient > 0)) | ((u >= 1) & (gradient < 0))
    # A residual that has all but vanished has no direction left: it is measured against the start.
    length = xp.linalg.norm(r, axis=1) + _VANISHED * scale
    size = xp.linalg.norm(J, axis=1) * length[:, None]
    cosine = xp.where(stopped, 0.0, abs(gradient)) / xp.maximum(size, xp.finfo(u.dtype).tiny)
    return xp.max(cosine, axis=1, initial=0.0)


def _squares(r: Float[np.ndarray, "b k"]) -> Float[np.ndarray, " b"]:
    return np.einsum("bk,bk->b", r, r)


class _InStep:
    """Descents that go in step; rows of the arrays are those on their way."""

    def __init__(
        self,
        stack: Stack,
        members: np.ndarray,
        starts: np.ndarray,
        max_steps: int,
        tolerance: float,
        promise: float,
    ) -> None:
        self._stack, self._members, self._starts = stack, members, starts
        self._max_steps, self._tolerance, self._promise = max_steps, tolerance, promise
        k, p = len(stack.like.force) + len(stack.like.priors), starts.shape[1]
        k += len(stack.like.coefficient_priors)
        self._which = np.zeros(0, int)  # descents
        self._u, self._trial = np.zeros((0, p)), np.zeros((0, p))
        self._r, self._J = np.zeros((0, k)), np.zeros((0, k, p))
        self._predicted, self._scale, self._damping = np.zeros(0), np.zeros(0), np.zeros(0)
        self._growth, self._residual = np.zeros(0), np.zeros(0)
        self._steps = np.zeros(0, int)
        self._at: list[Near | None] = []
        self._faces: list[np.ndarray | None] = []  # bounds of the box that the last steps met
        self._next = 0

    def ends(self):
        """Number and end of each descent, as they end."""
        with np.errstate(all="ignore"):
            while self._next < len(self._starts) or self._which.size:
                self._fill()
                yield from self._evaluate()
                yield from self._move()

    def _fill(self) -> None:
        """The next descents in the places that are vacant."""
        count = min(_TOGETHER - self._which.size, len(self._starts) - self._next)
        new = np.arange(self._next, self._next + count)
        self._next += count
        self._which = np.concatenate([self._which, new])
        for name, value in {
            "_u": self._starts[new], "_trial": self._starts[new], "_r": 0.0, "_J": 0.0,
            "_predicted": 1.0, "_scale": 0.0, "_damping": 0.0, "_growth": 2.0, "_residual": np.inf,
            "_steps": 0,
        }.items():  # fmt: skip
            old = getattr(self, name)
            more = np.broadcast_to(value, (count, *old.shape[1:])).astype(old.dtype)
            setattr(self, name, np.concatenate([old, more]))
        self._at += [None] * count
        self._faces += [None] * count

    def _leave(self, gone: np.ndarray, converged: np.ndarray):
        """The ends of those that are gone, which are taken out."""
        for k in np.flatnonzero(gone):
            points, row = self._at[k]  # pyright: ignore[reportGeneralTypeIssues]
            yield int(self._which[k]), End(
                self._u[k].copy(), member(points, row), float(self._residual[k]),
                int(self._steps[k]), bool(converged[k]),
            )  # fmt: skip
        kept = ~gone
        for name in ("_which", "_u", "_trial", "_r", "_J", "_predicted", "_scale", "_damping",
                     "_growth", "_residual", "_steps"):  # fmt: skip
            setattr(self, name, getattr(self, name)[kept])
        self._at = [at for at, keep in zip(self._at, kept, strict=True) if keep]
        self._faces = [face for face, keep in zip(self._faces, kept, strict=True) if keep]

    def _evaluate(self):
        """The fits at the trial points, which become the points where they are better."""
        members, stack = self._members[self._which], self._stack
        trial = stack.parameters(members, self._trial)
        points = stack.solve(members, trial, self._at, tolerance=self._tolerance**0.5)
        value, J = points.residual, stack.jacobian(members, points)
        first, old, new = self._steps == 0, _squares(self._r), _squares(points.residual)
        ratio = (old - new) / self._predicted
        better = np.isfinite(new) & (first | ((ratio > 1e-4) & np.isfinite(J).all((1, 2))))
        for k in np.flatnonzero(better | first):
            self._at[k] = points, int(k)
        shown = better[:, None]
        self._u = np.where(shown, self._trial, self._u)
        self._r = np.where(shown, value, self._r)
        self._J = np.where(shown[:, :, None], J, self._J)
        self._scale = np.where(first, np.sqrt(new), self._scale)
        # Nielsen's damping: smooth in the quality of the step, growing faster after refusals.
        factor = np.where(better, np.maximum(1 / 3, 1 - (2 * ratio - 1) ** 3), self._growth)
        begin = 1e-3 * np.max(np.sum(self._J**2, axis=1), axis=1, initial=0.0)
        self._damping = np.maximum(np.where(first, begin, self._damping * factor), _TINY)
        self._growth = np.where(better, 2.0, 2 * self._growth)
        slope = gradient_residual(self._u, self._r, self._J, self._scale)
        self._residual = np.where(better, slope, self._residual)
        self._steps = self._steps + 1
        nowhere = first & ~better
        nothing = np.full(self._which.size, self._u.shape[1] == 0) & better
        self._residual = np.where(nowhere, np.nan, self._residual)
        over = self._steps > self._max_steps
        done = nothing | (~over & (self._residual <= self._tolerance))
        self._steps = np.where(nowhere | nothing, 0, np.minimum(self._steps, self._max_steps))
        yield from self._leave(nowhere | over | done, done)

    def _move(self):
        """The next trial points; descents end whose step shows no descent."""
        count, p = self._u.shape
        if not count:
            return
        unit = np.eye(p)
        damped = np.concatenate([self._J, np.sqrt(self._damping)[:, None, None] * unit], axis=1)
        target = np.concatenate([-self._r, np.zeros((count, p))], axis=1)
        bounds = np.broadcast_to(np.concatenate([unit, -unit]), (count, 2 * p, p))
        limits = np.concatenate([-self._u, self._u - 1], axis=1)
        optima = solve_host_qps(damped, target, bounds, limits, self._faces)
        move, self._faces = optima.x, list(optima.rows)
        trial = self._u + move
        self._trial = np.where(trial < SNAP, 0.0, np.where(trial > 1 - SNAP, 1.0, trial))
        cost = _squares(self._r)
        self._predicted = cost - _squares(self._r + (self._J @ move[:, :, None])[:, :, 0])
        # A step that is damped after refusals promises little, however far the end is.
        promise = np.where(self._growth == 2.0, self._promise, ROUNDED)
        done = (self._predicted <= promise * cost) | (np.abs(move).max(axis=1) <= self._tolerance)
        yield from self._leave(done, done)

"""One constrained fit on the host: `convex_fit` in NumPy, for a few fits that nobody compiles.

The method is the same, step by step: an exchange of points on quadratic programmes, then Newton
steps on the optimality conditions in y, multipliers and touching points. Objectives and tables are
the same code; the arrays here have the sizes of the fit itself and not those of a batch.
"""

import dataclasses
from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int

from ..engine.host_qp import nearest_point
from ..engine.status import Status
from .objectives import AbstractObjective, Model
from .path_table import PathTable

_PER_STEP = 4  # points that become rows at a time
_STEPS = 40
_LOOSE = 0.1  # share of the majorant in the curvature: a tenth of a step is then one with it alone
_LEAST = 1e-4  # of that share: a curvature that nearly vanishes would drown the rows in rounding
_LOOSER = 10.0  # by which that grows with a step that is shortened, and falls with a whole one
_LAST_STEPS = 20  # at most, to make a near solution exact
_SHORTENED = (1.0, 0.5, 0.25, 0.1, 0.02)  # parts of a step that are tried
_NEAR = 1e-6  # violation per largest coefficient, and relative change by a step, of a near solution
_MATTERS = 1e-4  # slack per largest coefficient above which a dip stays inactive by the last steps
_OUTSIDE = 1e-10  # violation of a unit row per |y|, far below what makes a point a row
_CORNER = 1e-10  # relative change by a step of a near solution at a corner of the objective
_STILL = 1e-24  # squared relative change of an exact solution
_CERTIFIED = 1e-10  # largest residual of the optimality conditions of an exact one
_EPS, _TINY = float(np.finfo(float).eps), float(np.finfo(float).tiny)
_LAST = float(_STEPS)

PathRows = Callable[
    [Int[np.ndarray, " k"], Float[np.ndarray, " k"]], tuple[Float[np.ndarray, "k order"], ...]
]
"""phi_n at positions s, each on the path of that index, with its first and second derivative."""


@dataclasses.dataclass(frozen=True)
class Points:
    """Positions s in [0, 1] of paths, with the slack there per largest coefficient."""

    path: Int[np.ndarray, " k"]
    s: Float[np.ndarray, " k"]
    slack: Float[np.ndarray, " k"]

    def at(self, which: np.ndarray) -> "Points":
        """Some of them."""
        return Points(self.path[which], self.s[which], self.slack[which])


_NONE = np.zeros(0, int)
_NOWHERE = Points(_NONE, np.zeros(0), np.zeros(0))


@dataclasses.dataclass(frozen=True)
class HostConstraint:
    """A constraint on the coefficients along paths, as rows on the unknowns y.

    Attributes:
        on_y: coefficients of each path per unknown, E = on_y y, shape (paths, order, n).
        grid: rows posed from the start, of unit length, shape (m, n).
        table: of the functions that must not be negative; None where the rows are all there is.
        functions: the functions themselves.
        stations: nodes of the table at which the rows are posed, shape (paths, stations).
    """

    on_y: Float[np.ndarray, "paths order n"]
    grid: Float[np.ndarray, "m n"]
    table: PathTable | None = None
    functions: PathRows | None = None
    stations: Float[np.ndarray, "paths stations"] | None = None

    @classmethod
    def none(cls, on_y: Float[np.ndarray, "paths order n"]) -> "HostConstraint":
        """No constraint."""
        return cls(on_y, np.zeros((0, on_y.shape[-1])))

    @classmethod
    def positive(cls, on_y: Float[np.ndarray, "paths order n"]) -> "HostConstraint":
        """E_n >= 0 at the first and at the last path, and so between them."""
        ends = np.unique([0, len(on_y) - 1])
        return cls(on_y, _unit(on_y[ends].reshape(-1, on_y.shape[-1])))

    @classmethod
    def along(
        cls,
        on_y: Float[np.ndarray, "paths order n"],
        table: PathTable,
        grid: Int[np.ndarray, " stations"],
        functions: PathRows,
    ) -> "HostConstraint":
        """sum_n E_n phi_n >= 0 everywhere on every path."""
        rows = np.asarray(table.value)[:, grid] @ on_y
        return cls(
            on_y, _unit(rows.reshape(-1, on_y.shape[-1])), table, functions,
            np.asarray(table.nodes)[:, grid],
        )  # fmt: skip

    def coefficients(self, y: Float[np.ndarray, " n"]) -> Float[np.ndarray, "paths order"]:
        """E_n at the paths."""
        return self.on_y @ y

    def rows(
        self, phi: Float[np.ndarray, "k order"], path: Int[np.ndarray, " k"]
    ) -> Float[np.ndarray, "k n"]:
        """Rows on y of rows on the coefficients of paths."""
        return (phi[:, None, :] @ self.on_y[path])[:, 0]

    def dips(self, y: Float[np.ndarray, " n"]) -> Points:
        """The weakest places of each path, two at most, all weakest first; none at stations."""
        if self.table is None or self.stations is None:
            return _NOWHERE
        E = self.coefficients(y)
        largest = np.abs(E).max()
        if not largest > 0:
            return _NOWHERE
        least, s = self.table.minima(E)
        local = np.ones(least.shape, bool)
        local[:, 1:] = least[:, 1:] < least[:, :-1]
        local[:, :-1] &= least[:, :-1] <= least[:, 1:]
        depth = np.where(local, least, np.inf)
        paths = np.arange(len(depth))
        first = depth.argmin(axis=1)
        others = depth.copy()
        others[paths, first] = np.inf
        cells = np.concatenate([first, others.argmin(axis=1)])
        path = np.tile(paths, 2)
        slack = np.concatenate([depth[paths, first], others[path, cells][paths.size :]]) / largest
        found = Points(path, s[path, cells], slack)
        near = found.at(np.flatnonzero(slack < _MATTERS))
        return near.at(np.flatnonzero(~(self.stations[near.path] == near.s[:, None]).any(axis=1)))

    def touching(
        self, y: Float[np.ndarray, " n"], at: Points, multipliers: Float[np.ndarray, " k"]
    ) -> tuple[Points, Float[np.ndarray, "n n"]]:
        """Dips after a Newton step towards g' = 0, and the curvature that moving them adds."""
        assert self.table is not None
        assert self.functions is not None
        _, first, second = (self.rows(r, at.path) for r in self.functions(at.path, at.s))
        bend = second @ y
        free = ~self.table.at_node(at.path, at.s) & (bend > 0)
        bend = np.where(free, bend, 1.0)
        s = np.clip(at.s - np.where(free, first @ y / bend, 0.0), 0.0, 1.0)
        moving = np.where(free, multipliers / bend, 0.0)[:, None] * first
        return dataclasses.replace(at, s=s), moving.T @ first

    def rows_at(self, at: Points) -> Float[np.ndarray, "k n"]:
        """Rows at points, not scaled."""
        if self.functions is None:
            return self.grid[:0]
        return self.rows(self.functions(at.path, at.s)[0], at.path)


@dataclasses.dataclass(frozen=True)
class HostFit:
    """The minimiser with its certificate; see `ConvexFit`.

    Attributes:
        y: minimiser, shape (n,).
        objective: its value.
        active: number of rows with a multiplier.
        rows: those of them that were posed from the start, for a neighbouring fit to start from.
        kkt_residual, duality_gap: certificate.
        steps: Newton steps before the last ones.
        status: how it ended.
    """

    y: Float[np.ndarray, " n"]
    objective: float
    active: int
    rows: Int[np.ndarray, " k"]
    kkt_residual: float
    duality_gap: float
    steps: int
    status: Status

    @property
    def optimal(self) -> bool:
        """Whether it is certified."""
        return self.status is Status.OPTIMAL

    @classmethod
    def without(cls, n: int, status: Status) -> "HostFit":
        """No fit, and why."""
        return cls(np.full(n, np.nan), np.nan, 0, _NONE, np.nan, np.nan, 0, status)


def minimise_on_host(
    objective: AbstractObjective,
    constraint: HostConstraint,
    start: Float[np.ndarray, " n"],
    rows: Int[np.ndarray, " k"] = _NONE,
) -> HostFit:
    """The certified minimiser of a convex objective under a constraint along paths.

    Args:
        objective: in unknowns y in which its curvature is of order one.
        constraint: on the same unknowns.
        start: where to start, such as the minimiser of the sum of squares.
        rows: active ones there, as far as they are posed from the start.

    Returns:
        The fit.
    """
    try:
        near = _search(objective, constraint, start, rows)
        return _refined(objective, constraint, near)
    except np.linalg.LinAlgError:
        # The curvature is not positive: what is left of the data does not determine the law.
        return HostFit.without(start.size, Status.RANK_DEFICIENT)


@dataclasses.dataclass(frozen=True)
class _Step:
    """The minimiser of a quadratic model under rows, its active rows and their multipliers."""

    y: np.ndarray
    active: np.ndarray
    multipliers: np.ndarray
    status: Status

    @classmethod
    def of(
        cls, model: Model, curvature: np.ndarray, y: np.ndarray, G: np.ndarray, guess: np.ndarray
    ) -> "_Step":
        """The step from y, of a programme with rows G y >= 0 of unit length."""
        inverse = np.linalg.inv(np.linalg.cholesky(curvature))
        # With H = (J J^T)^-1 the centre J^-1 y - J^T g is J^T (H y - g).
        centre = inverse @ (curvature @ y - model.gradient)
        rows = G @ inverse.T
        size = _length(rows)
        point, active, multipliers, status = nearest_point(
            rows / size[:, None], np.zeros(len(G)), centre, guess
        )
        return cls(inverse.T @ point, active, multipliers / size[active], status)


@dataclasses.dataclass(frozen=True)
class _Near:
    """Where a search ended."""

    step: _Step
    dips: Points
    steps: int


def _search(
    objective: AbstractObjective, constraint: HostConstraint, start: np.ndarray, rows: np.ndarray
) -> _Near:
    """Steps until little changes and little is violated."""
    y, G, active, loose, steps = start, constraint.grid, rows, _LOOSE, 0
    while True:
        at = np.float64(steps)
        model = objective.model(y, at)
        # From outside, a step with the majorant leads to a point that is no worse than any inside.
        outside = (G @ y < -_OUTSIDE * np.linalg.norm(y)).any()
        curvature = model.majorant
        if not outside and not objective.quadratic:
            curvature = model.hessian + loose * (curvature - model.hessian)
        step = _Step.of(model, curvature, y, G, active)
        still = True
        if not objective.quadratic:
            reached = step.y
            near = _CORNER if objective.at_corner(reached) else _NEAR
            still = np.sum((reached - y) ** 2) <= near**2 * np.sum(reached**2)
            if not outside:
                tried = [y + share * (reached - y) for share in _SHORTENED]
                best = int(np.argmin([objective.value(v, at) for v in tried]))
                loose = min(loose * _LOOSER, 1.0) if best else max(loose / _LOOSER, _LEAST)
                reached = tried[best]
            step = dataclasses.replace(step, y=reached)
        y, active, dips = step.y, step.active, constraint.dips(step.y)
        violated = np.flatnonzero(dips.slack < -_NEAR)
        steps += 1
        done = (still and not violated.size) or steps == _STEPS
        if done or step.status is not Status.OPTIMAL:
            return _Near(step, dips, steps)
        deepest = violated[np.argsort(dips.slack[violated])[:_PER_STEP]]
        G = np.concatenate([G, _unit(constraint.rows_at(dips.at(deepest)))])


def _refined(objective: AbstractObjective, constraint: HostConstraint, near: _Near) -> HostFit:
    """The exact solution near another, and its optimality, measured at the point itself."""
    step, dips, grid = near.step, near.dips, constraint.grid
    if step.status is not Status.OPTIMAL:
        return HostFit.without(step.y.size, step.status)
    multipliers, G = np.zeros(dips.s.size), grid
    turned = np.zeros_like(step.y)
    # Without a dip that matters the rows at the stations are all there are.
    if dips.s.size or not objective.quadratic:
        active = step.active[step.active < len(grid)]
        for _ in range(_LAST_STEPS):
            moved, moving = dips, 0.0
            if dips.s.size:
                moved, moving = constraint.touching(step.y, dips, multipliers)
            rows = constraint.rows_at(moved)
            G = np.concatenate([grid, _unit(rows)])
            model = objective.model(step.y, np.float64(_LAST))
            curvature = model.hessian + _LEAST * (model.majorant - model.hessian)
            new = _Step.of(model, curvature + moving, step.y, G, active)
            if new.status is not Status.OPTIMAL:
                return HostFit.without(new.y.size, new.status)
            weights = np.zeros(len(G))
            weights[new.active] = new.multipliers
            multipliers, dips, active = weights[len(grid) :] / _length(rows), moved, new.active
            change, step = new.y - step.y, new
            turned = moving @ change if dips.s.size else turned
            if change @ change <= _STILL * (new.y @ new.y):
                break
    return _certified(objective, G, len(grid), step, turned, near.steps)


def _certified(
    objective: AbstractObjective,
    G: np.ndarray,
    posed: int,
    step: _Step,
    turned: np.ndarray,
    steps: int,
) -> HostFit:
    y, model = step.y, objective.model(step.y, np.float64(_LAST))
    normals = G[step.active]
    stationarity = model.gradient + turned - step.multipliers @ normals
    size, curvature = np.linalg.norm(y), np.trace(model.majorant)
    pull = max(curvature * size, _TINY)
    residual = max(
        np.abs(stationarity).max(initial=0.0) / pull,
        -(G @ y).min(initial=0.0) / max(size, _TINY),
        -step.multipliers.min(initial=0.0) / pull,
    )
    value = float(objective.value(y, np.float64(_LAST)))
    gap = abs(step.multipliers @ (normals @ y)) + np.linalg.norm(stationarity) * size
    gap += objective.rounded(y)
    scale = _EPS * float(objective.value(np.zeros_like(y), np.float64(_LAST))) + _TINY
    return HostFit(
        y=y,
        objective=value,
        active=step.active.size,
        rows=step.active[step.active < posed],
        kkt_residual=float(residual),
        duality_gap=float(gap / max(value, scale)),
        steps=steps,
        status=Status.OPTIMAL if residual < _CERTIFIED else Status.STALLED,
    )


def _length(rows: Float[np.ndarray, "m n"]) -> Float[np.ndarray, " m"]:
    """Lengths of rows, 1 for empty ones."""
    size = np.sqrt(np.einsum("mn,mn->m", rows, rows))
    size[size == 0] = 1.0
    return size


def _unit(rows: Float[np.ndarray, "m n"]) -> Float[np.ndarray, "m n"]:
    """Rows of unit length."""
    return rows / _length(rows)[:, None]

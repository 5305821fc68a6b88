"""The engine behind every fit: variable projection for a batch of fits.

For given nonlinear parameters, the coefficients are the optimum of a convex programme. The outer search in
`fitting.search` uses the remaining residual and its derivative through that optimum.

References:
    Golub & Pereyra 1973; Kaufman 1975 (variable projection).
    Tobin 1958; Madsen & Nielsen 1990, BIT 30 (piecewise quadratics, for censored readings).
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, NamedTuple, TypeAlias

import jax
import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.compile_options import quick_jit

from .convex import Status, bucket
from .problem import Part, Problem
from .programs import (
    MEMBERS,
    Layout,
    Projected,
    Weighing,
    form_of,
    joined,
    linear_program,
    projected_program,
    report_program,
)
from .response import Linear, MuscleFamily, Report

REACHED = 1e-13  # relative change of a compliant rig's forces at which the iteration ends
_REACHES = 25  # largest number of iterations of a compliant rig
_FEWEST = 3  # iterations after which each must at least halve the change
_READINGS = 512  # readings of a fit up to which a call takes `MEMBERS` fits
_ROUNDS = 60  # largest number of rounds in which the active censored readings settle
_FULL_STEPS = 8  # of these rounds
_ROUNDING = 1e-12  # relative to the largest residual; smaller violations do not matter


@dataclasses.dataclass(frozen=True, eq=False)
class Point:
    """The convex fit at one vector of nonlinear parameters.

    Attributes:
        problem: the problem.
        parameters: nonlinear parameters [SI], shape (q,).
        x: coefficients, shape (n,); nan without a certified optimum.
        residual: weighted residual of readings, coefficient priors and parameter priors, shape (k,).
        A, b, G, h: convex programme. A and b contain the rows of the residual. G and h contain the
            constraint along the paths, then the lower and upper bounds of all coefficients (zeros if
            unbounded).
        rows, multipliers: active rows of G and their multipliers.
        status: status of the convex fit.
        kkt_residual, duality_gap: certificate of the convex fit.
        offset, columns: linear model offset + columns x at the readings [N], shapes (points,) and
            (points, n).
        reached: force [N] about which a compliant rig was linearised.
        about: coefficients about which the model was linearised.
        keep: mask of the readings that enter the fit: all except satisfied censored ones.
    """

    problem: Problem
    parameters: Float[np.ndarray, " q"]
    x: Float[np.ndarray, " n"]
    residual: Float[np.ndarray, " k"]
    A: Float[np.ndarray, "k n"]
    b: Float[np.ndarray, " k"]
    G: Float[np.ndarray, "m n"]
    h: Float[np.ndarray, " m"]
    rows: Int[np.ndarray, " active"]
    multipliers: Float[np.ndarray, " active"]
    status: Status
    kkt_residual: float
    duality_gap: float
    offset: Float[np.ndarray, " points"]
    columns: Float[np.ndarray, "points n"]
    reached: Float[np.ndarray, " points"]
    about: Float[np.ndarray, " n"]
    keep: Bool[np.ndarray, " points"]

    @property
    def cost(self) -> float:
        """Half the sum of the squared residuals."""
        return float(self.residual @ self.residual) / 2

    @property
    def force(self) -> Float[np.ndarray, " points"]:
        """Model force [N] at the readings; the limit for a satisfied censored reading."""
        return np.where(self.keep, self.offset + self.columns @ self.x, self.problem.force)


class Chunk(NamedTuple):
    """Results of the compiled programs for a batch of fits, in padded arrays."""

    problems: list[Problem]
    layout: Layout
    parameters: Float[np.ndarray, "b q"]
    linear: Linear
    projected: Projected
    reached: Float[np.ndarray, "b readings"]
    about: Float[np.ndarray, "b coefficients"]
    keep: Float[np.ndarray, "b readings"]

    def point(self, row: int) -> Point:
        """Return one fit in the batch."""
        problem, at, found = self.problems[row], self.layout, self.projected
        n, wide, K = len(problem.linear), at.sizes.coefficients, at.sizes.readings
        extra = len(problem.coefficient_priors) + len(problem.priors)
        rows = np.concatenate([at.readings, K + np.arange(extra)])
        bounds = at.sizes.rows + np.arange(n)
        along = np.concatenate([at.rows, bounds, bounds + wide])
        optimum = found.optimum
        pull = optimum.multipliers[row, along]
        active = np.flatnonzero(optimum.active[row, along])
        force, columns = (leaf[row, at.readings] for leaf in self.linear[:2])
        return Point(
            problem=problem,
            parameters=self.parameters[row, : len(problem.names)],
            x=np.asarray(optimum.x)[row, :n],
            residual=found.residual[row, rows],
            A=np.asarray(found.A)[row, rows, :n],
            b=found.b[row, rows],
            G=np.asarray(found.G)[row, along, :n],
            h=found.h[row, along],
            rows=active,
            multipliers=pull[active],
            status=Status(int(optimum.status[row])),
            kkt_residual=float(optimum.kkt_residual[row]),
            duality_gap=float(optimum.duality_gap[row]),
            offset=force,
            columns=columns[:, :n],
            reached=self.reached[row, at.readings],
            about=self.about[row, :n],
            keep=self.keep[row, at.readings] != 0,
        )


Near: TypeAlias = tuple[tuple[Chunk, int], Float[np.ndarray, " k"]]
"""A fit, given as its chunk and row, and the residual expected at other parameters."""


class Batch:
    """Problems that differ only in readings, weights and bounds, and are fitted as one batch.

    Args:
        problems: the problems.
        layouts: layout of each problem; computed if omitted.
    """

    def __init__(
        self, problems: Sequence[Problem], layouts: Sequence[Layout] | None = None
    ) -> None:
        self.problems, self.like = list(problems), problems[0]
        layouts = layouts or [Layout(problem) for problem in problems]
        self.layout = at = layouts[0]
        self.size = max(1, min(MEMBERS, MEMBERS * _READINGS // at.sizes.readings))
        self._groups = tuple(map(joined, zip(*(one.groups for one in layouts), strict=True)))
        self._program = linear_program(at.forms, self.like.constraint, at.sizes)
        inputs = [part.inputs for part in self.like.parts]
        self._length, self._pressure = (
            at.spread(np.concatenate([getattr(one, name) for one in inputs]))
            for name in ("length", "pressure")
        )
        self._side = at.spread(self.like.side, missing=0.0)
        self._rig = np.array([any(part.rig for part in p.parts) for p in problems])
        self.low = np.stack([self._padded(p.low) for p in problems])
        self.high = np.stack([self._padded(p.high) for p in problems])
        each = [_weighing(problem, at) for problem in problems]
        self._of = Weighing(*(np.stack(leaves) for leaves in zip(*each, strict=True)))
        # Parameters that are free in one of the problems; one that holds them has no width there.
        self.free = np.flatnonzero((self.low < self.high).any(axis=0))
        eye, room = np.eye(at.sizes.parameters), ((0, at.sizes.directions), (0, 0))
        rows = [np.pad(eye[list(one.free)], room)[: at.sizes.directions] for one in problems]
        self._moves = np.stack(rows)

    def _padded(self, parameters: Float[np.ndarray, " q"]) -> Float[np.ndarray, " parameters"]:
        return np.pad(parameters, (0, self.layout.sizes.parameters - parameters.size))

    def parameters(
        self, members: Int[np.ndarray, " b"], u: Float[np.ndarray, "b p"]
    ) -> Float[np.ndarray, "b q"]:
        """Return the parameters [SI] at points in the members' unit boxes."""
        found = self.low[members]
        found[:, self.free] += u * (self.high[members] - self.low[members])[:, self.free]
        return found

    def evaluate(
        self,
        members: Int[np.ndarray, " b"],
        parameters: Float[np.ndarray, "b q"],
        near: Sequence[Near | None] | None = None,
        tolerance: float = REACHED,
    ) -> list[tuple[Chunk, int]]:
        """Compute certified convex fits with their Jacobians.

        Args:
            members: indices of the problems; an index may be repeated.
            parameters: parameters of each member [SI].
            near: initial guess for a compliant rig: a fit of the same problem at other parameters, and
                its residual extrapolated to the given parameters.
            tolerance: relative change in the forces of a compliant rig at which its iteration stops.

        Returns:
            For each member, the chunk that contains its fit, and the row in that chunk.
        """
        found: list[tuple[Chunk, int]] = []
        for first in range(0, len(members), self.size):
            here = slice(first, first + self.size)
            own = None if near is None else near[here]
            chunk = self._chunk(members[here], parameters[here], own, tolerance)
            found += [(chunk, row) for row in range(len(members[here]))]
        return found

    def _chunk(
        self,
        members: Int[np.ndarray, " b"],
        parameters: Float[np.ndarray, "b q"],
        near: Sequence[Near | None] | None,
        tolerance: float,
    ) -> Chunk:
        count = len(members)
        every = np.minimum(np.arange(self.size), count - 1)
        which, sizes = members[every], self.layout.sizes
        about, reached = np.zeros((self.size, sizes.coefficients)), self._of.force[which]
        if self._rig[members].any():
            for k, one in enumerate(near or ()):
                if one is not None:
                    about[k], reached[k] = self._expected(int(members[k]), *one)
            about, reached = about[every], reached[every]
            before = np.full(self.size, np.inf)
            for done in range(_REACHES - 1):
                chunk = self._once(which, parameters[every], about, reached)
                x = chunk.projected.optimum.x
                after = _force_of(chunk.linear, x)
                solved = np.isfinite(x).all(axis=1) & np.isfinite(after).all(axis=1)
                change = np.abs(after - reached).max(axis=1)
                going = solved & ~(change <= tolerance * np.abs(after).max(axis=1))
                going &= (done < _FEWEST) | (change < before / 2)  # far off, it may run in a circle
                before = change
                about[solved], reached[solved] = x[solved], after[solved]
                if not going.any():
                    return chunk  # the error is the square of the tolerance
        return self._once(which, parameters[every], about, reached)

    def _expected(
        self, member: int, fit: tuple[Chunk, int], residual: Float[np.ndarray, " k"]
    ) -> tuple[Float[np.ndarray, " coefficients"], Float[np.ndarray, " readings"]]:
        """Return the coefficients of a nearby fit, and the forces that match an expected residual."""
        chunk, row = fit
        weight = self._of.weight[member] * chunk.keep[row]
        off = residual[: weight.size] / np.where(weight > 0, weight, 1.0)
        force = np.where(weight > 0, self._of.force[member] + off, chunk.reached[row])
        return chunk.projected.optimum.x[row], self.layout.spread(force[self.layout.readings])

    def _once(
        self,
        members: Int[np.ndarray, " b"],
        parameters: Float[np.ndarray, "b q"],
        about: Float[np.ndarray, "b coefficients"],
        reached: Float[np.ndarray, "b readings"],
    ) -> Chunk:
        """Fit models that are linearised about given coefficients and rig forces."""
        linear, slopes = self.linear(members, parameters, about, reached)
        of = Weighing(*(leaf[members] for leaf in self._of))
        targets = of.targets + (parameters[:, None] @ of.d_targets)[:, 0]
        along = self._moves[members] @ of.d_targets
        keep, found = self._settled(linear, slopes, of._replace(targets=targets, d_targets=along))
        linear, found = jax.tree.map(np.asarray, (linear, found))
        problems = [self.problems[k] for k in members]
        return Chunk(problems, self.layout, parameters, linear, found, reached, about, keep)

    @property
    def residuals(self) -> int:
        """Number of rows of a residual."""
        sizes = self.layout.sizes
        return sizes.readings + sizes.others + sizes.coefficients

    def residual_and_jacobian(
        self, members: Int[np.ndarray, " b"], found: Sequence[tuple[Chunk, int]]
    ) -> tuple[Float[np.ndarray, "b k"], Float[np.ndarray, "b k p"]]:
        """Return residuals, and their derivatives with respect to the free parameters in the unit box."""
        r = np.stack([chunk.projected.residual[row] for chunk, row in found])
        J = np.stack([chunk.projected.jacobian[row] for chunk, row in found])
        J = self._moves[members].swapaxes(1, 2) @ J
        width = (self.high - self.low)[members][:, self.free]
        return r, J[:, self.free].swapaxes(1, 2) * width[:, None]

    def linear_at(
        self,
        parameters: Float[np.ndarray, " q"],
        about: Float[np.ndarray, " n"],
        reached: Float[np.ndarray, " points"],
    ) -> tuple[Linear, Linear]:
        """Return the first problem, linearised about given coefficients and forces, and its derivatives."""
        about = np.pad(about, (0, self.layout.sizes.coefficients - about.size))
        each = self._padded(parameters), about, self.layout.spread(reached)
        given = [np.repeat(one[None], self.size, axis=0) for one in each]
        members, (some, wide) = np.zeros(self.size, int), self._moves.shape[1:]
        found: list[tuple[Linear, Linear]] = []
        for first in range(0, wide, some):
            moves = np.eye(wide)[np.minimum(first + np.arange(some), wide - 1)]
            both = self.linear(members, *given, moves=np.repeat(moves[None], self.size, axis=0))
            found.append(jax.tree.map(lambda leaf: np.asarray(leaf)[0], both))
        slopes = zip(*(slope for _, slope in found), strict=True)
        return found[0][0], Linear(*(np.concatenate(leaves)[:wide] for leaves in slopes))

    def linear(
        self,
        members: Int[np.ndarray, " b"],
        parameters: Float[np.ndarray, "b q"],
        about: Float[np.ndarray, "b coefficients"],
        reached: Float[np.ndarray, "b readings"],
        length: Float[np.ndarray, "b readings"] | None = None,
        pressure: Float[np.ndarray, "b readings"] | None = None,
        moves: Float[np.ndarray, "b directions q"] | None = None,
    ) -> tuple[Linear, Linear]:
        """Return the linear models of `size` fits, and their derivatives."""
        length = self._length if length is None else length
        pressure = self._pressure if pressure is None else pressure
        at = np.broadcast_arrays(length, pressure, reached)
        readings = tuple(map(np.ascontiguousarray, at))
        own = tuple(
            group._replace(
                **{name: getattr(group, name)[members] for name in ("to_p", "held", "to_x")}
            )
            for group in self._groups
        )
        moves = self._moves[members] if moves is None else moves
        return self._program(own, parameters, moves, about, readings)

    def _settled(
        self, linear: Linear, slopes: Linear, of: Weighing
    ) -> tuple[Float[np.ndarray, "b readings"], Projected]:
        """Solve the convex fits to all normal readings and to the censored readings that are violated.

        A slack muscle implies F <= 0; a load cell at its limit implies F >= limit. Each such reading adds
        max(0, s (F - limit))^2 / 2 to the sum of squares, with s = 1 or -1. This term is convex in the
        coefficients. A least-squares fit that includes only the violated readings has the same gradient
        at the optimum, so its multipliers and certificate are valid for the whole problem.
        """
        side, keep = self._side, np.broadcast_to(1.0 * (self._side == 0), of.weight.shape)
        settled, at = np.zeros(len(keep), bool), np.zeros(0)
        for done in range(_ROUNDS):
            found = projected_program()(linear, slopes, of._replace(weight=of.weight * keep))
            x = np.asarray(found.optimum.x)
            excess = side * of.weight * (_force_of(linear, x) - of.force)
            size = _ROUNDING * np.abs(excess).max(axis=1, keepdims=True)
            settled = (side == 0) | ((excess > 0) == (keep > 0)) | ~(np.abs(excess) > size)
            settled = settled.all(axis=1) | ~np.isfinite(x).all(axis=1)
            if settled.all():
                return keep, found
            at = x if done < _FULL_STEPS else (at + x) / 2  # half steps end a cycle
            pulls = side * (_force_of(linear, at) - of.force) > 0
            keep = np.where(settled[:, None] | (side == 0), keep, 1.0 * pulls)
        # A problem that does not settle has no fit.
        keep = np.where(settled[:, None], keep, np.nan)
        return keep, projected_program()(linear, slopes, of._replace(weight=of.weight * keep))


def _weighing(problem: Problem, at: Layout) -> Weighing:
    """Return padded readings, bounds and priors; unused coefficients are forced to zero."""
    n, sizes, known = len(problem.linear), at.sizes, (*problem.coefficient_priors, *problem.priors)
    low, high = np.full(sizes.coefficients, -np.inf), np.full(sizes.coefficients, np.inf)
    low[:n], high[:n] = problem.lowest, problem.coefficient_max
    rows, targets = np.zeros((sizes.others, sizes.coefficients)), np.zeros(sizes.others)
    d_targets = np.zeros((sizes.parameters, sizes.others))
    for row, prior in enumerate(known):
        weight = problem.noise / prior.std
        targets[row] = weight * prior.mean
        if row < len(problem.coefficient_priors):
            rows[row, :n] = weight * prior.direction
        else:
            d_targets[: prior.direction.size, row] = -weight * prior.direction
    unused = np.arange(n, sizes.coefficients)
    rows[len(known) + unused - n, unused] = 1.0
    force, weight = at.spread(problem.force), at.spread(problem.weight, missing=0.0)
    return Weighing(force, weight, low, high, rows, targets, d_targets, np.asarray(problem.ridge))


def solve(
    problem: Problem, parameters: Float[np.ndarray, " q"], tolerance: float = REACHED
) -> Point:
    """Compute the convex fit at given parameters; `tolerance` applies to forces in a compliant rig."""
    batch = Batch([problem])
    given = batch._padded(parameters)[None]
    ((chunk, row),) = batch.evaluate(np.zeros(1, int), given, tolerance=tolerance)
    return chunk.point(row)


def partial(point: Point) -> tuple[Float[np.ndarray, "k q"], Float[np.ndarray, "m q"]]:
    """Return derivatives with respect to all nonlinear parameters, at constant coefficients.

    Returns:
        Derivatives of the weighted residual, including priors, and of G x - h.
    """
    problem, batch = point.problem, Batch([point.problem])
    at, q, n = batch.layout, len(problem.names), len(problem.linear)
    _, slopes = batch.linear_at(point.parameters, point.about, point.reached)
    force, columns, values, rows = (leaf[:q] for leaf in slopes)
    d_force = (force + columns[..., :n] @ point.x)[:, at.readings]
    d_rows = (values + rows[..., :n] @ point.x)[:, at.rows]
    extra = len(problem.coefficient_priors) + len(problem.priors)
    weight = problem.weight * point.keep
    residual = np.concatenate([weight * d_force, -batch._of.d_targets[0, :q, :extra]], axis=1)
    return residual.T, np.concatenate([d_rows, np.zeros((q, 2 * n))], axis=1).T


def predict(
    problem: Problem,
    place: int,
    parameters: Float[np.ndarray, " q"],
    x: Float[np.ndarray, " n"],
    length: Float[np.ndarray, " k"],
    pressure: Float[np.ndarray, " k"],
) -> Float[np.ndarray, " k"]:
    """Predict the force [N] that the rig of a part measures, using the fit's compiled program.

    Args:
        problem: problem of the fit.
        place: index of the part.
        parameters: nonlinear parameters [SI].
        x: coefficients.
        length: measured lengths [m].
        pressure: gauge pressures [Pa].
    """
    batch, part = Batch([problem]), problem.parts[place]
    at, members = batch.layout, np.zeros(batch.size, int)
    size = bucket(max(one.force.size for one in problem.parts), 64)
    here = at.readings[problem.readings[place].start] + np.arange(size)
    about = np.tile(np.pad(x, (0, at.sizes.coefficients - x.size)), (batch.size, 1))
    given, found = np.tile(batch._padded(parameters), (batch.size, 1)), [np.zeros(0)]
    for begin in range(0, length.size, batch.size * size):
        rows = np.minimum(begin + np.arange(batch.size * size), length.size - 1)
        own = np.tile(np.stack([batch._length, batch._pressure])[:, None], (1, batch.size, 1))
        own[:, :, here] = np.stack([length[rows], pressure[rows]]).reshape(2, batch.size, size)
        reached = np.zeros((batch.size, at.sizes.readings))
        for _ in range(_REACHES if part.rig else 1):
            linear, _ = batch.linear(members, given, about, reached, *own)
            before, reached = reached, _force_of(linear, about)
            move, largest = (np.abs(one[:, here]) for one in (reached - before, reached))
            if not np.nanmax(move, initial=0.0) > REACHED * np.nanmax(largest, initial=0.0):
                break
        found.append(reached[:, here].ravel())
    return np.concatenate(found)[: length.size]


def _force_of(linear: Linear, x: Float[np.ndarray, "b n"]) -> Float[np.ndarray, "b readings"]:
    """Return the force [N] from linear models at given coefficients."""
    force, columns = (np.asarray(leaf) for leaf in linear[:2])
    return force + (columns @ x[:, :, None])[:, :, 0]


@quick_jit
def _built(family: MuscleFamily, values: dict[str, Any]) -> Any:
    return family.build(values)


def muscle_at(problem: Problem, point: Point, place: int) -> Any:
    """Return the fitted muscle of a part."""
    part = problem.parts[place]
    names = (*part.family.nonlinear, *part.family.linear)
    numbers = np.split(np.concatenate([point.parameters[part.at], point.x]), len(names))
    return _built(part.family, {n: v.reshape(()) for n, v in zip(names, numbers, strict=True)})


def report_of(part: Part, point: Point, place: int) -> Report:
    """Return the report on a fitted part, as NumPy arrays."""
    size = bucket(part.force.size, 64)
    form, arrays = form_of(dataclasses.replace(part, within=None), size)
    reached = point.reached[point.problem.readings[place]]
    reached = np.pad(reached, (0, size - part.force.size), mode="edge")
    found = report_program(form)(arrays, point.parameters[part.at], point.x, reached)
    paths = part.inputs.path_end.size
    values = Report(*(np.asarray(leaf) for leaf in found))
    return values._replace(
        path_modulus=values.path_modulus[:paths],
        slope=values.slope[:paths],
        largest_strain=values.largest_strain[:paths],
    )

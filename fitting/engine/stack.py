"""Several fits at once that differ in numbers only: readings, weights, bounds, parameters.

For given nonlinear parameters the coefficients are the optimum of a convex programme; what is left
of the residual, and its derivative in the parameters through that optimum, is what the outer search
works with (variable projection). All of it is done for the members of a batch together, in arrays
with a leading axis of members; only a programme with active rows is solved for its member alone.

References:
    Golub & Pereyra 1973; Kaufman 1975.
"""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Float, Int

from ..convex.host_qp import solve_host_qps
from ..convex.status import Status
from .one_sided import one_sided
from .point import Linear, Point
from .program import ALL, OF_DESCENTS, OF_PATHS, OF_READINGS

if TYPE_CHECKING:
    from .problem import Part, Problem

REACHES = 25  # linear models of a compliant rig, each about the forces of the one before
REACHED = 1e-13  # relative change of the forces with which that ends
_ON_THE_WAY = 6  # of a descent: one that has not settled by then is far from its end

Asked = Literal["values", "slopes", "all"]
Near = tuple[Point, int]
"""One of several fits: all of them, and its place."""


class Stack:
    """Problems that share their programs, priors and kinds of bounds.

    Free are the parameters that are so in one of them; one that holds a parameter has a box without
    width there.
    """

    def __init__(self, problems: Sequence["Problem"]) -> None:
        self.like = like = problems[0]
        self.force = [
            np.stack([p.parts[k].force for p in problems]) for k in range(len(like.parts))
        ]
        self.weight = [
            np.stack([p.parts[k].weight for p in problems]) for k in range(len(like.parts))
        ]
        self._low, self._high, lowest, highest = (
            np.stack([getattr(p, name) for p in problems])
            for name in ("low", "high", "lowest", "coefficient_max")
        )
        self.free = np.flatnonzero((self._low < self._high).any(axis=0))
        same = (self._low == self._high).all(axis=0) & (self._low == self._low[0]).all(axis=0)
        self._moving = [
            tuple(np.flatnonzero(np.isin(p.at, self.free)).tolist()) for p in like.parts
        ]
        self._held = [
            {k: float(self._low[0, place]) for k, place in enumerate(p.at) if same[place]}
            for p in like.parts
        ]
        unit, rows, offsets = np.eye(len(like.linear)), [], []
        for limits, sign in ((lowest, 1.0), (-highest, -1.0)):
            on = np.isfinite(limits[0])
            rows.append(sign * unit[on])
            offsets.append(limits[:, on])
        self._bound_rows, self._bounds = np.concatenate(rows), np.concatenate(offsets, axis=1)

    def parameters(
        self, members: Int[np.ndarray, " b"], u: Float[np.ndarray, "b p"]
    ) -> Float[np.ndarray, "b q"]:
        """The parameters [SI] at points of the members' unit boxes."""
        found = self._low[members]
        found[:, self.free] += u * (self._high[members] - self._low[members])[:, self.free]
        return found

    def solve(
        self,
        members: Int[np.ndarray, " b"],
        parameters: Float[np.ndarray, "b q"],
        near: Sequence[Near | None] | None = None,
        *,
        asked: Asked = "slopes",
        tolerance: float = REACHED,
    ) -> Point:
        """The certified convex fits.

        Args:
            members: places of the problems, one of them several times or not at all.
            parameters: of each.
            near: fits of the same problems at other parameters, from which each may start.
            asked: whether derivatives are wanted, and what no descent needs.
            tolerance: relative change of a compliant rig's forces, before one more linear model.
        """
        count, n = len(members), len(self.like.linear)
        near = near or [None] * count
        guesses = [None if one is None else one[0].optimum.rows[one[1]] for one in near]
        if not any(part.rig for part in self.like.parts):
            nothing = [force[members] for force in self.force]
            return self._once(members, parameters, np.zeros((1, n)), nothing, guesses, asked)
        x, reached = self._reach(members, parameters, near, guesses, tolerance)
        return self._once(members, parameters, x, reached, guesses, asked)

    def _reach(
        self,
        members: np.ndarray,
        parameters: np.ndarray,
        near: Sequence[Near | None],
        guesses: list[np.ndarray | None],
        tolerance: float,
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Coefficients and forces of the parts that a compliant rig settles at.

        Each linear model is about those of the one before. `guesses` are replaced on the way.
        """
        parts, reaches = self.like.parts, REACHES if tolerance <= REACHED else _ON_THE_WAY
        x = np.zeros((len(members), len(self.like.linear)))
        reached = [force[members] for force in self.force]
        for k, one in enumerate(near):
            if one is not None:
                point, row = one
                x[k] = point.x[row]
                for force, linear in zip(reached, point.linear, strict=True):
                    force[k] = linear.reached[row]
        moving = np.arange(len(members))
        for _ in range(reaches - 1):
            found = self._once(
                members[moving], parameters[moving], x[moving],
                [force[moving] for force in reached], [guesses[k] for k in moving], "values",
            )  # fmt: skip
            solved = found.optimum.status == Status.OPTIMAL
            change = size = np.zeros(moving.size)
            for force, one, part in zip(reached, found.linear, parts, strict=True):
                after = one.force + np.einsum(
                    "bkn,bn->bk", one.columns, found.x[:, part.coefficients]
                )
                change = np.maximum(change, np.abs(after - force[moving]).max(axis=1))
                size = np.maximum(size, np.abs(after).max(axis=1))
                force[moving[solved]] = after[solved]
            x[moving[solved]] = found.x[solved]
            for k in np.flatnonzero(solved):
                guesses[moving[k]] = found.optimum.rows[k]
            moving = moving[solved & ~(change <= tolerance * size)]
            if not moving.size:
                break
        return x, reached

    def _once(
        self,
        members: np.ndarray,
        parameters: np.ndarray,
        x: np.ndarray,
        reached: Sequence[np.ndarray],
        guesses: Sequence[np.ndarray | None],
        asked: Asked,
    ) -> Point:
        """The fits by linear models about coefficients, and about forces reached by the rig."""
        linear = tuple(
            self._linear(k, parameters, x[:, part.coefficients], reached[k], asked)
            for k, part in enumerate(self.like.parts)
        )
        if self.like.side.any():
            linear = one_sided(self, members, linear, guesses)
        programme = self.programme(members, linear)
        optimum = solve_host_qps(*programme, guesses)
        residual = self._residual(programme, optimum.x, parameters)
        return Point(parameters, optimum, residual, programme, linear)

    def _linear(
        self,
        place: int,
        parameters: np.ndarray,
        x0: np.ndarray,
        reached: np.ndarray,
        asked: Asked,
    ) -> Linear:
        """The linear models of a part about x0 and the forces that the rig is taken at."""
        part = self.like.parts[place]
        # Values are asked for by problems that hold different parameters: one program serves all.
        # Those of the constraint have no part in most steps; `jacobian` sees where they have.
        which = {
            "all": (ALL, range(part.at.size), None),
            "slopes": (OF_DESCENTS, self._moving[place], self._held[place], OF_READINGS),
            "values": (OF_DESCENTS, (), None),
        }[asked]
        found: Any = part.program.of_members(
            parameters[:, part.at], x0, reached if part.rig else reached[:1], *which
        )
        value, slope, aside = found
        points = part.force.size
        force, columns = value.force[:, :points], value.columns[:, :points]
        d_force, d_columns = slope.force[:, :, :points], slope.columns[:, :, :points]
        if part.rig:
            gain = aside.gain[:, :points]
            force = reached + gain * (force - reached)
            columns, d_force = gain[:, :, None] * columns, gain[:, None] * d_force
            d_columns = gain[:, None, :, None] * d_columns
        if x0.any():
            own = x0[:, :, None]
            force = force - (columns @ own)[:, :, 0]
            d_force = d_force - (d_columns @ own[:, None])[..., 0]
        rows, values = _at_stations(part, value, x0)
        d_rows, d_values = None, None
        if slope.rows is not None:
            d_rows, d_values = _at_stations(part, slope, x0)
        return Linear(
            force=force, columns=columns, rows=rows, values=values, d_force=d_force,
            d_columns=d_columns, d_rows=d_rows, d_values=d_values, derived=value.derived,
            d_derived=slope.derived, aside=aside,
            about=np.broadcast_to(x0, (len(parameters), x0.shape[1])), reached=reached,
        )  # fmt: skip

    def programme(
        self, members: np.ndarray, linear: Sequence[Linear]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, b, G and h of the convex programmes."""
        like, count, n = self.like, len(members), len(self.like.linear)
        A, b, G, h = [], [], [], []
        for part, one, force, weight in zip(
            like.parts, linear, self.force, self.weight, strict=True
        ):
            own = weight[members]
            columns = own[:, :, None] * one.columns
            rows = one.rows
            if part.coefficients.size < n:
                columns, rows = (_wider(leaf, part.coefficients, n) for leaf in (columns, rows))
            A.append(columns)
            b.append(own * (force[members] - one.force))
            G.append(rows)
            h.append(-one.values)
        G.append(np.broadcast_to(self._bound_rows, (count, *self._bound_rows.shape)))
        h.append(self._bounds[members])
        for prior in like.coefficient_priors:
            row = np.zeros((count, 1, n))
            row[:, 0, prior.place] = like.noise / prior.std
            A.append(row)
            b.append(np.full((count, 1), like.noise / prior.std * prior.mean))
        if like.ridge:
            size = np.linalg.norm(np.concatenate(A, axis=1), axis=1)
            A.append(like.ridge * np.where(size > 0, size, 1.0)[:, :, None] * np.eye(n))
            b.append(np.zeros((count, n)))
        return (
            np.concatenate(A, axis=1), np.concatenate(b, axis=1),
            np.concatenate(G, axis=1), np.concatenate(h, axis=1),
        )  # fmt: skip

    def _residual(
        self, programme: tuple[np.ndarray, ...], x: np.ndarray, parameters: np.ndarray
    ) -> np.ndarray:
        like, (A, b, _, _) = self.like, programme
        rows = b.shape[1] - (x.shape[1] if like.ridge else 0)
        own = (A[:, :rows] @ x[:, :, None])[:, :, 0] - b[:, :rows]
        priors = [like.noise * (parameters[:, p.place] - p.mean) / p.std for p in like.priors]
        return np.concatenate([own, *(prior[:, None] for prior in priors)], axis=1)

    def jacobian(self, members: Int[np.ndarray, " b"], points: Point) -> Float[np.ndarray, "b k p"]:
        """Derivative of the members' residuals in the unit box, through the convex fit."""
        like, free = self.like, self.free
        weights = [weight[members] for weight in self.weight]
        d_residual = residual_slopes(like, weights, points)[:, :, free]
        A, b, G, _ = points.programme
        optima, n = points.optimum, points.x.shape[1]
        if n:
            readings = like.readings[-1].stop
            r = (A @ points.x[:, :, None])[:, :, 0] - b
            dA_r = np.zeros((len(members), len(like.names), n))
            for part, one, weight, here in zip(
                like.parts, points.linear, weights, like.readings, strict=True
            ):
                at = (slice(None), *np.ix_(part.at, part.coefficients))
                dA_r[at] += ((weight * r[:, here])[:, None, None] @ one.d_columns)[:, :, 0]
            dr_A = d_residual[:, :readings].transpose(0, 2, 1) @ A[:, :readings]
            d_slack, dG_l = self._pushed(points)
            dx = optima.sensitivity(G, dA_r[:, free] + dr_A, d_slack[:, :, free], dG_l[:, free])
            rows = b.shape[1] - (n if like.ridge else 0)
            d_residual[:, :rows] += A[:, :rows] @ dx.transpose(0, 2, 1)
        return d_residual * (self._high - self._low)[members][:, None, free]

    def _pushed(
        self, points: Point
    ) -> tuple[Float[np.ndarray, "b m q"], Float[np.ndarray, "b q n"]]:
        """Derivatives of G x - h at constant x, and of G^T l, of the members at which a row of G is active.

        Those of the others are left at zero.
        """
        (count, n), q = points.x.shape, len(self.like.names)
        d_slack, dG_l = np.zeros((count, points.programme[3].shape[1], q)), np.zeros((count, q, n))
        first = 0
        for k, (part, one) in enumerate(zip(self.like.parts, points.linear, strict=True)):
            last = first + one.rows.shape[1]
            push = np.zeros((count, last - first))
            here = []
            for place, (rows, multipliers) in enumerate(
                zip(points.optimum.rows, points.optimum.multipliers, strict=True)
            ):
                own = (first <= rows) & (rows < last)
                if own.any():
                    here.append(place)
                    push[place, rows[own] - first] = multipliers[own]
            if here:
                about, reached = (
                    leaf[here] if part.rig else leaf[:1] for leaf in (one.about, one.reached)
                )
                _, slope, _ = part.program.of_members(
                    points.parameters[here][:, part.at], about, reached, OF_PATHS,
                    self._moving[k], self._held[k],
                )  # fmt: skip
                d_rows, d_values = _at_stations(part, slope, about)
                x = points.x[here][:, None, part.coefficients, None]
                moved = (d_rows @ x)[..., 0] + d_values
                at = np.array(here)[:, None, None]
                d_slack[at, np.arange(first, last)[:, None], part.at] = moved.swapaxes(1, 2)
                pushing = (push[here][:, None, None] @ d_rows)[:, :, 0]
                dG_l[at, part.at[:, None], part.coefficients] += pushing
            first = last
        return d_slack, dG_l


def residual_slopes(
    like: "Problem", weights: Sequence[np.ndarray], points: Point
) -> Float[np.ndarray, "*b k q"]:
    """Derivative of the weighted residual, priors included, at constant coefficients.

    Of one fit, or of several whose problems differ from `like` in numbers alone.
    """
    d_residual = np.zeros((*points.residual.shape, len(like.names)))
    for part, one, weight, here in zip(
        like.parts, points.linear, weights, like.readings, strict=True
    ):
        own = points.x[..., None, part.coefficients, None]
        moved = one.d_force + (one.d_columns @ own)[..., 0]
        d_residual[..., here, :][..., part.at] += np.swapaxes(weight[..., None, :] * moved, -1, -2)
    for place, prior in enumerate(reversed(like.priors), 1):
        d_residual[..., -place, prior.place] = like.noise / prior.std
    return d_residual


def _at_stations(
    part: "Part", found: Any, about: Float[np.ndarray, "#b n"]
) -> tuple[Float[np.ndarray, "b *q r n"], Float[np.ndarray, "b *q r"]]:
    """Rows and values of a part's constraint at no coefficients, those of all paths one after another."""
    paths, (*leading, _, stations, n) = part.inputs.path_end.size, found.rows.shape
    rows = found.rows[..., :paths, :, :].reshape(*leading, paths * stations, n)
    values = found.values[..., :paths, :].reshape(*leading, paths * stations)
    if about.any():
        own = about[:, None, :, None] if len(leading) > 1 else about[:, :, None]
        values = values - (rows @ own)[..., 0]
    return rows, values


def _wider(values: np.ndarray, places: np.ndarray, count: int) -> np.ndarray:
    """The columns at their places among more."""
    found = np.zeros((*values.shape[:-1], count))
    found[..., places] = values
    return found

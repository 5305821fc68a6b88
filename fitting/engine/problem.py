"""A fit as the host sees it: readings, weights, bounds and priors around the compiled programs.

For given nonlinear parameters the coefficients are the optimum of a convex programme; what is left
of the residual, and its derivative in the parameters through that optimum, is what the outer search
works with (variable projection).

References:
    Golub & Pereyra 1973; Kaufman 1975.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from .host_qp import HostOptimum, solve_host_qp
from .program import Aside, Constraint, MapInputs, Program
from .status import Status

_REACHES = 25  # linear models of a compliant rig, each about the forces of the one before
_REACHED = 1e-13  # relative change of the forces with which that ends


@dataclasses.dataclass(frozen=True)
class Prior:
    """What is known of a parameter besides the data.

    Attributes:
        place: in the vector of nonlinear parameters, or among the coefficients of a law.
        mean, std: in SI.
    """

    place: int
    mean: float
    std: float


@dataclasses.dataclass(frozen=True)
class Part:
    """One force map of a fit.

    Attributes:
        name: of the specimen.
        family: its models.
        inputs: readings and paths; slack readings may be among them, with no weight.
        force: measured [N], shape (points,).
        weight: of the readings, 1/std or 1, shape (points,).
        at: places of its nonlinear parameters in the problem's vector.
        coefficients: places of its coefficients among the problem's.
        levels: of the readings by "pressure" [Pa] and "length" [m], each of shape (points,): what
            is left out together.
        program: compiled for the family.
        compliance: place of the rig's compliance in the problem's vector, or None for a rigid rig.
    """

    name: str
    family: Any
    inputs: MapInputs
    force: Float[np.ndarray, " points"]
    weight: Float[np.ndarray, " points"]
    at: Int[np.ndarray, " q"]
    coefficients: Int[np.ndarray, " n"]
    levels: dict[str, Float[np.ndarray, " points"]]
    program: Program
    compliance: int | None = None

    @classmethod
    def of(
        cls,
        name: str,
        family: Any,
        inputs: MapInputs,
        force: np.ndarray,
        weight: np.ndarray,
        at: Sequence[int],
        coefficients: Sequence[int],
        levels: dict[str, np.ndarray],
        constraint: Constraint,
    ) -> "Part":
        """A part with its program."""
        rig = [k for k, n in zip(at, family.nonlinear, strict=False) if n == "series_compliance"]
        return cls(
            name, family, inputs, force, weight, np.asarray(at, int), np.asarray(coefficients, int),
            levels, Program(family, constraint, inputs), rig[0] if rig else None,
        )  # fmt: skip

    def with_stations(self, stations: Float[np.ndarray, "paths stations"]) -> "Part":
        """The same part, its constraint posed elsewhere; nothing is compiled."""
        inputs = dataclasses.replace(self.inputs, stations=stations)
        return dataclasses.replace(self, inputs=inputs, program=self.program.at(inputs))

    def predict(
        self,
        parameters: Float[np.ndarray, " q"],
        x: Float[np.ndarray, " n"],
        length: Float[np.ndarray, " k"],
        pressure: Float[np.ndarray, " k"],
    ) -> Float[np.ndarray, " k"]:
        """What the rig would measure [N] at measured lengths and pressures, by the compiled program.

        Args:
            parameters: the part's own [SI], without offsets of lengths.
            x: its coefficients.
            length: as measured [m].
            pressure: gauge [Pa].
        """
        size, force = self.program.size, np.empty(length.size)
        p = np.zeros(self.at.size)
        p[: parameters.size] = parameters
        compliance = 0.0
        if self.compliance is not None:
            compliance = parameters[list(self.at).index(self.compliance)]
        for first in range(0, length.size, size):
            here = slice(first, first + size)
            count = length[here].size
            nothing = np.zeros(count)
            # An index beyond the offsets would be clipped to the last: all offsets are zero here.
            at = self.program.at(
                dataclasses.replace(
                    self.inputs,
                    length=length[here],
                    pressure=pressure[here],
                    force=nothing,
                    length_index=np.zeros(count, int),
                )
            )
            reached = nothing
            for _ in range(_REACHES):
                value, _, aside = at(p, x, reached)
                muscle = value.force[:count]
                if self.compliance is None:
                    reached = muscle
                    break
                move = (muscle - reached) / (1 + compliance * aside.stiffness[:count])
                reached = reached + move
                if not np.nanmax(np.abs(move), initial=0.0) > _REACHED * np.nanmax(
                    np.abs(reached), initial=0.0
                ):
                    break
            force[here] = reached
        return force


@dataclasses.dataclass(frozen=True)
class Linear:
    """The linear model of a part at one point, in all of the problem's parameters.

    Attributes:
        force: [N] at no coefficients, shape (points,).
        columns: shape (points, n) of the part's coefficients.
        rows, values: of the constraint, g = rows x + values >= 0, (r, n) and (r,).
        d_force, d_columns, d_rows, d_values: derivatives in the part's parameters.
        derived, d_derived: what follows from the parameters.
        aside: what has no derivative.
        reached: force [N] at which a compliant rig was taken.
    """

    force: np.ndarray
    columns: np.ndarray
    rows: np.ndarray
    values: np.ndarray
    d_force: np.ndarray
    d_columns: np.ndarray
    d_rows: np.ndarray
    d_values: np.ndarray
    derived: np.ndarray
    d_derived: np.ndarray
    aside: Aside
    reached: np.ndarray


@dataclasses.dataclass(frozen=True)
class Point:
    """The fit at one vector of nonlinear parameters.

    Attributes:
        parameters: [SI], shape (q,).
        x: coefficients of all parts, shape (n,); nan without a certified optimum.
        optimum: of the convex programme.
        residual: weighted, priors included, shape (k,).
        programme: (A, b, G, h) that was solved.
        linear: of each part.
    """

    parameters: Float[np.ndarray, " q"]
    x: Float[np.ndarray, " n"]
    optimum: HostOptimum
    residual: Float[np.ndarray, " k"]
    programme: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    linear: tuple[Linear, ...]

    @property
    def cost(self) -> float:
        """Half the sum of the squared residuals."""
        return float(self.residual @ self.residual) / 2


@dataclasses.dataclass(frozen=True)
class Problem:
    """Force maps, what is searched, and what is known of it.

    Attributes:
        parts: one for each force map.
        names: of the nonlinear parameters.
        low, high: their bounds [SI], shape (q,).
        linear: names of the coefficients, shape (n,), node by node.
        coefficient_min, coefficient_max: their bounds, shape (n,), infinite where there is none.
        priors: on nonlinear parameters.
        coefficient_priors: on coefficients.
        noise: of the force, in the unit of the weighted residual, by which priors are weighed.
        constraint: on the coefficients.
        ridge: of columns of unit length; above zero, what the readings leave open stays small.
    """

    parts: tuple[Part, ...]
    names: tuple[str, ...]
    low: Float[np.ndarray, " q"]
    high: Float[np.ndarray, " q"]
    linear: tuple[str, ...]
    coefficient_min: Float[np.ndarray, " n"]
    coefficient_max: Float[np.ndarray, " n"]
    priors: tuple[Prior, ...] = ()
    coefficient_priors: tuple[Prior, ...] = ()
    noise: float = 1.0
    constraint: Constraint = "none"
    ridge: float = 0.0

    @property
    def free(self) -> Int[np.ndarray, " p"]:
        """Places of the parameters that may move."""
        return np.flatnonzero(self.low < self.high)

    @property
    def force(self) -> Float[np.ndarray, " points"]:
        """Measured force [N] of all parts, one after another."""
        return np.concatenate([part.force for part in self.parts])

    @property
    def weight(self) -> Float[np.ndarray, " points"]:
        """Weights of all readings."""
        return np.concatenate([part.weight for part in self.parts])

    def levels(self, kind: str) -> Float[np.ndarray, " points"]:
        """The "pressure" [Pa] or "length" [m] level of every reading."""
        return np.concatenate([part.levels[kind] for part in self.parts])

    def with_readings(
        self, *, force: np.ndarray | None = None, factor: np.ndarray | None = None
    ) -> "Problem":
        """The problem with other forces [N], and factors on the weights of its readings."""
        parts, first = [], 0
        for part in self.parts:
            here = slice(first, first + part.force.size)
            first = here.stop
            parts.append(
                dataclasses.replace(
                    part,
                    force=part.force if force is None else force[here],
                    weight=part.weight if factor is None else part.weight * factor[here],
                )
            )
        return dataclasses.replace(self, parts=tuple(parts))

    def parameters(self, u: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
        """The parameters [SI] at a point of the unit box."""
        found = self.low.copy()
        found[self.free] += u * (self.high - self.low)[self.free]
        return found

    def solve(self, parameters: Float[np.ndarray, " q"]) -> Point:
        """The certified convex fit at these parameters."""
        n = len(self.linear)
        x, reached = np.zeros(n), [part.force for part in self.parts]
        compliant = any(part.compliance is not None for part in self.parts)
        guess = None
        for _ in range(_REACHES if compliant else 1):
            linear = tuple(
                self._linear(part, parameters, x[part.coefficients], force)
                for part, force in zip(self.parts, reached, strict=True)
            )
            programme = self._programme(linear)
            optimum = solve_host_qp(*programme, guess)
            if optimum.status is not Status.OPTIMAL:
                break
            x, before, guess = optimum.x, reached, optimum.rows
            reached = [
                one.force + one.columns @ x[part.coefficients]
                for one, part in zip(linear, self.parts, strict=True)
            ]
            change = max(np.abs(a - b).max() for a, b in zip(before, reached, strict=True))
            if not compliant or change <= _REACHED * max(np.abs(a).max() for a in reached):
                break
        return Point(
            parameters, optimum.x, optimum, self._residual(programme, optimum.x, parameters),
            programme, linear,
        )  # fmt: skip

    def _linear(
        self, part: Part, parameters: np.ndarray, x0: np.ndarray, reached: np.ndarray
    ) -> Linear:
        """The linear model of a part about x0 and the forces that the rig is taken at."""
        value, slope, aside = part.program(parameters[part.at], x0, reached)
        points, n = part.force.size, x0.size
        paths = part.inputs.path_end.size
        force, columns = value.force[:points], value.columns[:points]
        d_force, d_columns = slope.force[:, :points], slope.columns[:, :points]
        if part.compliance is not None:
            # The rig lets the force move only 1/(1 + c dF/dL) as far as the muscle's own.
            stiffness = aside.stiffness[:points]
            gain = 1 / (1 + parameters[part.compliance] * stiffness)
            force = reached + gain * (force - reached)
            columns, d_force = gain[:, None] * columns, gain * d_force
            d_columns = gain[:, None] * d_columns
        q, many = part.at.size, paths * value.rows.shape[1]
        rows, d_rows = (
            value.rows[:paths].reshape(many, n),
            slope.rows[:, :paths].reshape(q, many, n),
        )
        values = value.values[:paths].reshape(many)
        d_values = slope.values[:, :paths].reshape(q, many)
        return Linear(
            force=force - columns @ x0,
            columns=columns,
            rows=rows,
            values=values - rows @ x0,
            d_force=d_force - d_columns @ x0,
            d_columns=d_columns,
            d_rows=d_rows,
            d_values=d_values - d_rows @ x0,
            derived=value.derived,
            d_derived=slope.derived,
            aside=aside,
            reached=reached,
        )

    def _programme(
        self, linear: Sequence[Linear]
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """A, b, G and h of the convex programme."""
        n = len(self.linear)
        A, b, G, h = [], [], [], []
        for part, one in zip(self.parts, linear, strict=True):
            columns, rows = np.zeros((part.force.size, n)), np.zeros((len(one.rows), n))
            columns[:, part.coefficients] = part.weight[:, None] * one.columns
            rows[:, part.coefficients] = one.rows
            A.append(columns)
            b.append(part.weight * (part.force - one.force))
            G.append(rows)
            h.append(-one.values)
        lowest = self.coefficient_min
        if self.constraint == "positive":
            lowest = np.maximum(lowest, 0.0)
        unit = np.eye(n)
        for limits, sign in ((lowest, 1.0), (-self.coefficient_max, -1.0)):
            on = np.isfinite(limits)
            G.append(sign * unit[on])
            h.append(limits[on])
        for prior in self.coefficient_priors:
            scale = self.noise / prior.std
            A.append(scale * unit[prior.place : prior.place + 1])
            b.append(np.array([scale * prior.mean]))
        if self.ridge:
            size = np.linalg.norm(np.concatenate(A), axis=0)
            A.append(self.ridge * np.diag(np.where(size > 0, size, 1.0)))
            b.append(np.zeros(n))
        return np.concatenate(A), np.concatenate(b), np.concatenate(G), np.concatenate(h)

    def _residual(
        self, programme: tuple[np.ndarray, ...], x: np.ndarray, parameters: np.ndarray
    ) -> np.ndarray:
        A, b, _, _ = programme
        rows = len(b) - (len(self.linear) if self.ridge else 0)
        priors = [self.noise * (parameters[p.place] - p.mean) / p.std for p in self.priors]
        return np.concatenate([A[:rows] @ x - b[:rows], priors])

    def partial(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives at constant coefficients, in all nonlinear parameters.

        Returns:
            (of the weighted residual, priors included, shape (k, q); of G x - h, shape (m, q)).
        """
        q, x = len(self.names), point.x
        k, m = point.residual.size, len(point.programme[3])
        d_residual, d_slack, row, reading = np.zeros((k, q)), np.zeros((m, q)), 0, 0
        for part, one in zip(self.parts, point.linear, strict=True):
            own = x[part.coefficients]
            here = slice(reading, reading + part.force.size)
            reading = here.stop
            np.add.at(
                d_residual[here].T, part.at, part.weight * (one.d_force + one.d_columns @ own)
            )
            there = slice(row, row + len(one.rows))
            row = there.stop
            np.add.at(d_slack[there].T, part.at, one.d_rows @ own + one.d_values)
        for place, prior in enumerate(reversed(self.priors), 1):
            d_residual[-place, prior.place] = self.noise / prior.std
        return d_residual, d_slack

    def jacobian(self, point: Point) -> Float[np.ndarray, "k p"]:
        """Derivative of the residual in the unit box, through the convex fit."""
        free = self.free
        d_residual, d_slack = (leaf[:, free] for leaf in self.partial(point))
        A, b, G, _ = point.programme
        optimum = point.optimum
        if optimum.x.size:
            readings = len(self.force)
            r = A @ point.x - b
            multipliers = np.zeros(len(G))
            multipliers[optimum.rows] = optimum.multipliers
            q, n = len(self.names), optimum.x.size
            dA_r, dG_l, row, reading = np.zeros((q, n)), np.zeros((q, n)), 0, 0
            for part, one in zip(self.parts, point.linear, strict=True):
                here = slice(reading, reading + part.force.size)
                reading = here.stop
                at = np.ix_(part.at, part.coefficients)
                dA_r[at] += np.einsum("qkn,k->qn", one.d_columns, part.weight * r[here])
                there = slice(row, row + len(one.rows))
                row = there.stop
                if multipliers[there].any():
                    dG_l[at] += np.einsum("qmn,m->qn", one.d_rows, multipliers[there])
            dr = np.zeros((len(free), len(b)))
            dr[:, :readings] = d_residual[:readings].T
            dx = optimum.sensitivity(G, dA_r[free], dr, d_slack.T, dG_l[free], A)
            rows = len(b) - (n if self.ridge else 0)
            d_residual[:rows] += A[:rows] @ dx.T
        return d_residual * (self.high - self.low)[free]

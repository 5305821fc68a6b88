"""A fit as the host sees it: readings, weights, bounds and priors around the compiled programs.

For given nonlinear parameters the coefficients are the optimum of a convex programme; what is left
of the residual, and its derivative in the parameters through that optimum, is what the outer search
works with (variable projection).

References:
    Golub & Pereyra 1973; Kaufman 1975.
"""

import dataclasses
import itertools
from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Float, Int

import famjax

from ..convex.arrays import member
from .family import RIG
from .point import Point
from .program import Program
from .response import Constraint, MapInputs
from .stack import REACHED, REACHES, Asked, Stack, residual_slopes


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
        side: 0 for a reading, 1 where it is censored and the force at most that, as of a slack
            muscle, -1 where it is at least that, as at the end of a load cell, shape (points,).
        rig: places of the rig's compliance, and of its exponent where it has one, in the problem's
            vector; none for a rigid rig.
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
    side: Int[np.ndarray, " points"]
    rig: tuple[int, ...] = ()

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
        side: np.ndarray | None = None,
    ) -> "Part":
        """A part with its program; without sides every reading is what it says."""
        places = dict(zip(family.nonlinear, at, strict=False))
        rig = tuple(int(places[name]) for name in RIG if name in places)
        return cls(
            name, family, inputs, force, weight, np.asarray(at, int), np.asarray(coefficients, int),
            levels, Program(family, constraint, inputs),
            np.zeros(force.size, int) if side is None else side, rig,
        )  # fmt: skip

    def with_stations(self, stations: Float[np.ndarray, "paths stations"]) -> "Part":
        """The same part, its constraint posed elsewhere; nothing is compiled."""
        inputs = dataclasses.replace(self.inputs, stations=stations)
        return dataclasses.replace(self, inputs=inputs, program=self.program.at(inputs))

    def mounted(self, muscle: famjax.Muscle, parameters: np.ndarray) -> famjax.MountedMuscle:
        """A muscle in the rig of the problem's parameters [SI]."""
        return famjax.MountedMuscle(muscle, *(parameters[list(self.rig)] if self.rig else (0.0,)))

    def predict(
        self,
        parameters: Float[np.ndarray, " q"],
        x: Float[np.ndarray, " n"],
        length: Float[np.ndarray, " k"],
        pressure: Float[np.ndarray, " k"],
    ) -> Float[np.ndarray, " k"]:
        """What the rig would measure [N] at measured lengths and pressures, by the program of the fit.

        Args:
            parameters: the part's own [SI], without offsets of lengths.
            x: its coefficients.
            length: as measured [m].
            pressure: gauge [Pa].
        """
        p = np.zeros(self.at.size)
        p[: parameters.size] = parameters
        reached = self.program.forces(p, x, length, pressure, np.zeros(length.size))[0]
        if not self.rig:
            return reached
        for _ in range(REACHES):
            muscle, gain = self.program.forces(p, x, length, pressure, reached)
            move = gain * (muscle - reached)
            reached = reached + move
            largest = np.nanmax(np.abs(reached), initial=0.0)
            if not np.nanmax(np.abs(move), initial=0.0) > REACHED * largest:
                break
        return reached


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
    def lowest(self) -> Float[np.ndarray, " n"]:
        """Lower bounds of the coefficients, shape (n,): where these must be positive, 0 at least."""
        low = self.coefficient_min
        return np.maximum(low, 0.0) if self.constraint == "positive" else low

    @property
    def force(self) -> Float[np.ndarray, " points"]:
        """Measured force [N] of all parts, one after another."""
        return np.concatenate([part.force for part in self.parts])

    @property
    def weight(self) -> Float[np.ndarray, " points"]:
        """Weights of all readings."""
        return np.concatenate([part.weight for part in self.parts])

    @property
    def side(self) -> Int[np.ndarray, " points"]:
        """Sides of all readings, see `Part`."""
        return np.concatenate([part.side for part in self.parts])

    @property
    def readings(self) -> list[slice]:
        """Where those of each part are among all."""
        ends = itertools.accumulate((part.force.size for part in self.parts), initial=0)
        return [slice(first, end) for first, end in itertools.pairwise(ends)]

    def levels(self, kind: str) -> Float[np.ndarray, " points"]:
        """The "pressure" [Pa] or "length" [m] level of every reading, or the number of its "specimen"."""
        if kind == "specimen":
            return np.repeat(
                np.arange(1.0 * len(self.parts)), [one.force.size for one in self.parts]
            )
        return np.concatenate([part.levels[kind] for part in self.parts])

    def with_readings(
        self, *, force: np.ndarray | None = None, factor: np.ndarray | None = None
    ) -> "Problem":
        """The problem with other forces [N], and factors on the weights of its readings."""
        parts = tuple(
            dataclasses.replace(
                part,
                force=part.force if force is None else force[here],
                weight=part.weight if factor is None else part.weight * factor[here],
            )
            for part, here in zip(self.parts, self.readings, strict=True)
        )
        return dataclasses.replace(self, parts=parts)

    @property
    def structure(self) -> tuple:
        """Equal for problems that differ in readings, weights and bounds alone, held values among them."""
        limits = (np.isfinite(self.coefficient_min), np.isfinite(self.coefficient_max))
        return (
            *(part.program.contents for part in self.parts), self.side.tobytes(), self.names, self.linear,
            *(on.tobytes() for on in limits), self.priors,
            self.coefficient_priors, self.noise, self.constraint, self.ridge,
        )  # fmt: skip

    def parameters(self, u: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
        """The parameters [SI] at a point of the unit box."""
        found = self.low.copy()
        found[self.free] += u * (self.high - self.low)[self.free]
        return found

    def solve(self, parameters: Float[np.ndarray, " q"], asked: Asked = "all") -> Point:
        """The certified convex fit at these parameters, with all that is known unless less is asked."""
        found = Stack((self,)).solve(np.zeros(1, int), parameters[None], asked=asked)
        return member(found, 0)

    def partial(self, point: Point) -> tuple[np.ndarray, np.ndarray]:
        """Derivatives at constant coefficients, in all nonlinear parameters.

        Returns:
            (of the weighted residual, priors included, shape (k, q); of G x - h, shape (m, q)).
        """
        q, m = len(self.names), point.programme[3].size
        d_slack, row = np.zeros((m, q)), 0
        for part, one in zip(self.parts, point.linear, strict=True):
            there = slice(row, row + len(one.rows))
            row = there.stop
            if there.start < row:
                moved = (one.d_rows @ point.x[part.coefficients]) + one.d_values
                d_slack[there, part.at] += moved.T
        return residual_slopes(self, [part.weight for part in self.parts], point), d_slack

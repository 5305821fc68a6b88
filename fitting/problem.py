"""What is fitted: force maps with their families, weights, bounds, priors and constraint."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Float, Int

import famjax

from .response import RIG, AbstractFamily, Constraint, MapInputs


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
class Within:
    """A larger family, whose compiled program a part shares with others.

    Attributes:
        family: it; the part's own is what is left of it with some numbers held.
        nonlinear: places of the part's nonlinear parameters among its, shape (q,).
        held: its nonlinear parameters that the part has not; 0 for those that it has.
        linear: places of the part's coefficients among its, shape (n,); the others are 0.
    """

    family: AbstractFamily
    nonlinear: Int[np.ndarray, " q"]
    held: Float[np.ndarray, " whole"]
    linear: Int[np.ndarray, " n"]


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
        side: 0 for a reading, 1 where it is censored and the force at most that, as of a slack
            muscle, -1 where it is at least that, as at the end of a load cell, shape (points,).
        within: a larger family by whose program it is computed, None for one of its own.
    """

    name: str
    family: AbstractFamily
    inputs: MapInputs
    force: Float[np.ndarray, " points"]
    weight: Float[np.ndarray, " points"]
    at: Int[np.ndarray, " q"]
    coefficients: Int[np.ndarray, " n"]
    levels: dict[str, Float[np.ndarray, " points"]]
    side: Int[np.ndarray, " points"]
    within: Within | None = None

    @property
    def rig(self) -> tuple[int, ...]:
        """Places of the rig's compliance, and of its exponent where it has one; none if it is rigid."""
        places = dict(zip(self.family.nonlinear, self.at.tolist(), strict=False))
        return tuple(places[name] for name in RIG if name in places)

    def with_stations(self, stations: Float[np.ndarray, "paths stations"]) -> "Part":
        """The same part, its constraint posed elsewhere; nothing is compiled."""
        return dataclasses.replace(self, inputs=dataclasses.replace(self.inputs, stations=stations))

    def mounted(self, muscle: famjax.Muscle, parameters: np.ndarray) -> famjax.MountedMuscle:
        """A muscle in the rig of the problem's parameters [SI]."""
        return famjax.MountedMuscle(muscle, *(parameters[list(self.rig)] if self.rig else (0.0,)))


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

    @property
    def path_rows(self) -> list[int]:
        """Number of rows of the constraint along the paths of each part."""
        along = self.constraint in ("slope", "drucker")
        return [part.inputs.stations.size if along else 0 for part in self.parts]

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

    def parameters(self, u: Float[np.ndarray, " p"]) -> Float[np.ndarray, " q"]:
        """The parameters [SI] at a point of the unit box."""
        found = self.low.copy()
        found[self.free] += u * (self.high - self.low)[self.free]
        return found

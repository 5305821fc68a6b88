"""A quick fit of a map, and of what it would be without a fault: the misfit, and where it ends."""

import dataclasses

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..choice import weigh
from ..data.force_data import ForceData
from ..descent import End
from ..engine import predict
from ..ladder import Candidate, as_cylinder, ladder
from ..problem import Problem
from ..race import descended, posed_of

_AT_BOUND = 1e-6  # of the width of the interval


def censored_misses(data: ForceData, force: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How far [N] a model's force is from what a censored reading says of it, 0 at the others.

    A slack reading says that there is no pull, a saturated one that it is no less than the limit of the
    load cell. Where there is no force, nothing is contradicted.
    """
    pull, lack = np.fmax(force, 0.0), np.fmin(force - data.force, 0.0)
    return np.where(data.slack, pull, np.where(data.saturated, lack, 0.0))


@dataclasses.dataclass(frozen=True)
class Trial:
    """A fit that was tried.

    Attributes:
        data: the map.
        problem, end: of the fit.
    """

    data: ForceData
    problem: Problem
    end: End

    def predict(
        self, length: Float[np.ndarray, " k"], pressure: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, " k"]:
        """Force [N] at lengths [m] and gauge pressures [Pa]; nan where there is none."""
        point = self.end.point
        return predict(self.problem, 0, point.parameters, point.x, length, pressure)

    @property
    def misfit(self) -> float:
        """RMSE over the loaded readings in parts of the largest force, with `censored_misses`."""
        data = self.data
        force = self.predict(data.length, data.pressure)
        wrong = np.where(data.loaded, force - data.force, censored_misses(data, force))
        if not np.isfinite(wrong[data.loaded]).all():
            return np.inf
        squares = np.nansum(wrong**2) / data.loaded.sum()
        return float(np.sqrt(squares)) / data.max_force

    def side(self, name: str) -> int:
        """-1 where a parameter is at its lower bound, 1 at its upper one, 0 between."""
        place = list(self.problem.names).index(name)
        low, high = float(self.problem.low[place]), float(self.problem.high[place])
        at = (float(self.end.point.parameters[place]) - low) / (high - low) if high > low else 0.5
        return int(at > 1 - _AT_BOUND) - int(at < _AT_BOUND)

    @property
    def corner(self) -> int:
        """Of braid diameter and angle: 1 where both are as large as may be, -1 as small, else 0."""
        sides = self.side("braid_diameter"), self.side("braid_angle")
        return sides[0] if sides[0] == sides[1] else 0


def attempt(
    data: ForceData, candidate: Candidate | None = None, *, starts: int = 4
) -> Trial | None:
    """The fit of a family to a map; of the richest one that it can carry, unless given.

    Returns:
        None where there is no fit.
    """
    try:
        chosen = candidate or richest(data)
        if chosen is None:
            return None
        problem = posed_of(weigh(data), chosen, "drucker").problem
        return Trial(data, problem, descended(problem, starts, seed=0))
    except InputError:
        return None


def misfit(data: ForceData, candidate: Candidate | None = None) -> float:
    """The misfit of `attempt`; infinite where there is no fit."""
    found = attempt(data, candidate)
    return np.inf if found is None else found.misfit


def richest(data: ForceData, law: str | None = None) -> Candidate | None:
    """The family of a law, the ladder's first unless given, with a deadband; None without one."""
    candidates, _ = ladder(data)
    return next((one for one in candidates if not one.rig and law in (None, one.law)), None)


def plainest(data: ForceData) -> Candidate | None:
    """The first family of the ladder as a cylinder of stiff threads; None without one."""
    first = richest(data)
    if first is None:
        return None
    return as_cylinder(first, data)

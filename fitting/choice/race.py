"""Families of a map, each fitted to all of it and judged by what it predicts of readings left out."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..descent import End, descend_many
from ..engine import solve
from ..evidence.leave_out import groups_of, leave_out_each
from ..evidence.left_out import LeftOut
from ..evidence.refit import force_error
from ..problem import Problem
from ..search.multi_start import best_of, latin_hypercube
from ..search.posing import Posed, pose_one
from ..search.summary import muscle_at
from .ladder import FEWEST_LENGTHS, Candidate

_STEPS, _TOLERANCE = 60, 1e-6
_PROMISE = 1e-7  # of the cost: the table of families is that of full descents to five digits
_STOPPED = 1e-9  # of the interval


def posed_of(data: ForceData, candidate: Candidate, constraint: str, box: str) -> Posed:
    """The problem of a family.

    Raises:
        InputError: the map cannot carry it.
    """
    return pose_one(
        data, constraint=constraint, box=box, bounds=candidate.bounds,
        parameters=candidate.parameters, **candidate.options,
    )  # fmt: skip


def descended(problem: Problem, starts: int, seed: int) -> End:
    """The best end of a few descents, as near to an optimum as a comparison needs.

    Raises:
        InputError: no start ends at a force for every reading.
    """
    return best_of(_descents(problem, starts, seed))


def _descents(problem: Problem, starts: int, seed: int) -> list[End]:
    cube = latin_hypercube(len(problem.free), starts, seed)
    return list(
        descend_many(
            [problem] * starts, list(cube),
            max_steps=_STEPS, tolerance=_TOLERANCE, promise=_PROMISE,
        )
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A family fitted to all readings.

    Attributes:
        candidate: the family.
        posed: its problem.
        ends: of its descents in its unit box, the best first.
        mounted: the muscle in its rig.
        residuals: model less reading [N], in sample.
    """

    candidate: Candidate
    posed: Posed
    ends: Float[np.ndarray, "starts p"]
    mounted: famjax.MountedMuscle
    residuals: Float[np.ndarray, " readings"]

    @property
    def rmse(self) -> float:
        """In sample [N]."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fitted(
    data: ForceData, constraint: str, box: str, starts: int, seed: int, candidate: Candidate
) -> Fitted | str:
    """A family fitted to all readings; in words why the map cannot carry it, where it cannot."""
    try:
        posed = posed_of(data, candidate, constraint, box)
        ends = _descents(posed.problem, starts, seed)
        end = best_of(ends)
    except InputError as error:
        return str(error)
    problem = posed.problem
    if candidate.rig and _rig_of_the_bounds(problem, end):
        return "The rig of the best fit is rigid, or gives way as much as the bounds allow."
    order = np.argsort([one.cost for one in ends])
    point = solve(problem, problem.parameters(end.u))
    return Fitted(
        candidate, posed, np.stack([ends[k].u for k in order]),
        problem.parts[0].mounted(muscle_at(problem, point, 0), point.parameters),
        force_error(problem, end)[problem.side == 0],
    )  # fmt: skip


def left_out_of(seed: int, family: Fitted) -> dict[str, LeftOut] | None:
    """Errors of a family without each length and without groups of neighbouring pressures.

    None where it has no force at some of what was left out, and of a rig that gives way on a map of too
    few lengths to leave one out: nothing else tells it from a soft bladder.
    """
    problem = family.posed.problem
    if family.candidate.rig and "length" not in _kinds(problem):
        return None
    # Without some pressures the optimum stays where it was; without a length it may not.
    kinds = {
        kind: (groups_of(problem, kind), 1 if kind == "pressure" else 2) for kind in _kinds(problem)
    }
    (found,) = leave_out_each([(problem, family.ends[0])], kinds, seed=seed)
    return found if all(np.isfinite(one.error).all() for one in found.values()) else None


def _kinds(problem: Problem) -> Sequence[str]:
    """What is left out: a length only if three others are left."""
    lengths = np.unique(problem.levels("length")).size
    return ("pressure", "length") if lengths >= FEWEST_LENGTHS else ("pressure",)


def _rig_of_the_bounds(problem: Problem, end: End) -> bool:
    """Whether the rig that gives way by a power of the force is of the bounds and not of the readings."""
    at = {problem.names[place]: u for place, u in zip(problem.free, end.u, strict=True)}
    exponent, compliance = at.get("series_exponent", 1.0), at.get("series_compliance", 1.0)
    return bool("series_exponent" in at and (exponent == 0 or compliance in (0.0, 1.0)))

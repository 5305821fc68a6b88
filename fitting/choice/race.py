"""Families of a map, each fitted to all of it and judged by what it predicts of readings left out."""

import dataclasses
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..descent import End, descend_many
from ..evidence.leave_out import groups_of, leave_out_each
from ..evidence.left_out import LeftOut
from ..evidence.refit import force_error
from ..families.shared_program import sharing_one_program
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
        parameters=candidate.parameters, program=sharing_one_program, **candidate.options,
    )  # fmt: skip


def descended(problem: Problem, starts: int, seed: int) -> End:
    """The best end of a few descents, as near to an optimum as a comparison needs.

    Raises:
        InputError: no start ends at a force for every reading.
    """
    return best_of(_descents([problem], starts, seed))


def _descents(
    problems: Sequence[Problem],
    starts: int,
    seed: int,
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """The ends of a few descents of each problem, one problem after another."""
    counter = itertools.count(1)

    def ended(_: int) -> None:
        if progress is not None:
            progress(next(counter), starts * len(problems))

    cubes = [latin_hypercube(len(problem.free), starts, seed) for problem in problems]
    return descend_many(
        [problem for problem in problems for _ in range(starts)],
        [start for cube in cubes for start in cube],
        max_steps=_STEPS, tolerance=_TOLERANCE, promise=_PROMISE, progress=ended,
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
    data: ForceData,
    constraint: str,
    box: str,
    starts: int,
    seed: int,
    candidates: Sequence[Candidate],
    progress: Callable[[int, int], None] | None = None,
) -> list[Fitted | str]:
    """Families fitted to all readings, all in step; in words why the map cannot carry one, where it cannot.

    Args:
        data: the map.
        constraint: on the coefficients.
        box: of the standard bounds.
        starts: of each.
        seed: of the starts.
        candidates: the families.
        progress: called with (descents done, descents).
    """
    posed: list[Posed | str] = []
    for one in candidates:
        try:
            posed.append(posed_of(data, one, constraint, box))
        except InputError as error:
            posed.append(str(error))
    problems = [one.problem for one in posed if isinstance(one, Posed)]
    ends = iter(_descents(problems, starts, seed, progress))
    return [
        one
        if isinstance(one, str)
        else _fitted(candidate, one, [next(ends) for _ in range(starts)])
        for candidate, one in zip(candidates, posed, strict=True)
    ]


def _fitted(candidate: Candidate, posed: Posed, ends: list[End]) -> Fitted | str:
    """A family of the ends of its descents."""
    try:
        end = best_of(ends)
    except InputError as error:
        return str(error)
    problem = posed.problem
    if candidate.rig and _rig_of_the_bounds(problem, end):
        return "The rig of the best fit is rigid, or gives way as much as the bounds allow."
    order = np.argsort([one.cost for one in ends])
    return Fitted(
        candidate, posed, np.stack([ends[k].u for k in order]),
        problem.parts[0].mounted(muscle_at(problem, end.point, 0), end.point.parameters),
        force_error(problem, end)[problem.side == 0],
    )  # fmt: skip


def left_out_of(
    families: Sequence[Fitted], seed: int, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, LeftOut] | None]:
    """Errors of families without each length and without groups of neighbouring pressures.

    None of one that has no force at some of what was left out, and of a rig that gives way on a map of
    too few lengths to leave one out: nothing else tells it from a soft bladder.
    """
    told = [
        one for one in families
        if not one.candidate.rig or "length" in _kinds(one.posed.problem)
    ]  # fmt: skip
    if not told:
        return [None] * len(families)
    problem = told[0].posed.problem
    # Without some pressures the optimum stays where it was; without a length it may not.
    kinds = {
        kind: (groups_of(problem, kind), 1 if kind == "pressure" else 2) for kind in _kinds(problem)
    }
    fits = [(one.posed.problem, one.ends[0]) for one in told]
    errors = leave_out_each(fits, kinds, seed=seed, progress=progress)
    found = {
        id(one): of if all(np.isfinite(part.error).all() for part in of.values()) else None
        for one, of in zip(told, errors, strict=True)
    }
    return [found.get(id(one)) for one in families]


def _kinds(problem: Problem) -> Sequence[str]:
    """What is left out: a length only if three others are left."""
    lengths = np.unique(problem.levels("length")).size
    return ("pressure", "length") if lengths >= FEWEST_LENGTHS else ("pressure",)


def _rig_of_the_bounds(problem: Problem, end: End) -> bool:
    """Whether the rig that gives way by a power of the force is of the bounds and not of the readings."""
    at = {problem.names[place]: u for place, u in zip(problem.free, end.u, strict=True)}
    exponent, compliance = at.get("series_exponent", 1.0), at.get("series_compliance", 1.0)
    return bool("series_exponent" in at and (exponent == 0 or compliance in (0.0, 1.0)))

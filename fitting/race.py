"""Families of a map, each fitted to all of it and judged by what it predicts of readings left out."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from .data import ForceData
from .ladder import FEWEST_LENGTHS, Candidate, sharing_one_program
from .posing import Posed, pose
from .problem import Problem
from .search import End, best_of, descend_many
from .summary import muscle_at
from .validation import LeftOut, columns_of, force_error, groups_of, leave_out_each

_STEPS, _TOLERANCE = 60, 1e-6
_PROMISE = 1e-7  # of the cost: the table of families is that of full descents to five digits


def posed_of(data: ForceData, candidate: Candidate, constraint: str) -> Posed:
    """The problem of a family.

    Raises:
        InputError: the map cannot carry it.
    """
    return pose(
        (data,), bounds=candidate.bounds, parameters=candidate.parameters,
        program=sharing_one_program, **{"constraint": constraint, **candidate.options},
    )  # fmt: skip


def descended(posed: Posed, starts: int, seed: int) -> End:
    """The best end of a few descents, as near to an optimum as a comparison needs.

    Raises:
        InputError: no start ends at a force for every reading.
    """
    return best_of(_descents([posed.problem], [posed.starts(starts, seed)]))


def _descents(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    progress: Callable[[int, int], None] | None = None,
) -> list[End]:
    """The ends of the descents of each problem, one problem after another."""
    return descend_many(
        [problem for problem, own in zip(problems, starts, strict=True) for _ in own],
        [start for own in starts for start in own],
        max_steps=_STEPS, tolerance=_TOLERANCE, promise=_PROMISE, progress=progress,
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
    starts: int,
    seed: int,
    candidates: Sequence[Candidate],
    progress: Callable[[int, int], None] | None = None,
) -> list[Fitted | str]:
    """Families fitted to all readings, all in step; in words why the map cannot carry one, where it cannot.

    Args:
        data: the map.
        constraint: on the coefficients.
        starts: of each.
        seed: of the starts.
        candidates: the families.
        progress: called with (descents done, descents).
    """
    posed: list[Posed | str] = []
    for one in candidates:
        try:
            posed.append(posed_of(data, one, constraint))
        except InputError as error:
            posed.append(str(error))
    carried = [one for one in posed if isinstance(one, Posed)]
    near = [one.starts(starts, seed) for one in carried]
    ends = iter(_descents([one.problem for one in carried], near, progress))
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


ALIKE = 1.5
"""Families fit alike whose RMSE in sample is within this factor of the smallest."""
NEAR = 1.1
"""Held-out errors within this factor are not told apart, which is said."""
LITTLE_MORE = 2.0
"""Factor of the held-out error up to which a family with a certified optimum is taken instead."""
_NOISE = 1e-3  # of the largest force: smaller errors are not told apart


@dataclasses.dataclass(frozen=True)
class Tried:
    """One family that was tried.

    Attributes:
        candidate: the family.
        rmse: in sample [N].
        left_out: errors by kind of what was left out, "pressure", "length" or "specimen".
        held_out: the held-out error [N] by which families are ordered, see `held_out_error`.
        alike: whether its RMSE in sample is within `ALIKE` of the smallest of all.
    """

    candidate: Candidate
    rmse: float
    left_out: Mapping[str, LeftOut]
    held_out: float
    alike: bool

    @property
    def columns(self) -> dict[str, float]:
        """RMSE [N] on each kind of readings left out, see `columns_of`."""
        return columns_of(self.left_out)


def held_out_error(left_out: Mapping[str, LeftOut], rmse: float, max_force: float) -> float:
    """Geometric mean of the columns of `columns_of` [N], or the RMSE in sample where there are none.

    Args:
        left_out: errors by kind.
        rmse: in sample [N].
        max_force: largest force measured [N], of which errors below 0.1 % are not told apart.
    """
    errors = list(columns_of(left_out).values()) or [rmse]
    return float(np.exp(np.mean(np.log(np.hypot(errors, _NOISE * max_force)))))


def ranked(
    families: Sequence[tuple[Candidate, float, Mapping[str, LeftOut] | None]], max_force: float
) -> tuple[Tried, ...]:
    """The families with their held-out errors, in the order in which they are given.

    Args:
        families: each with its error in sample [N] and its errors on what was left out; None where
            nothing was left out of it.
        max_force: largest force measured [N].
    """
    least = max(min(rmse for _, rmse, _ in families), _NOISE * max_force)
    return tuple(
        Tried(
            candidate, rmse, left_out or {},
            math.inf if left_out is None else held_out_error(left_out, rmse, max_force),
            rmse <= ALIKE * least,
        )
        for candidate, rmse, left_out in families
    )  # fmt: skip


def preferred(tried: Sequence[Tried]) -> list[int]:
    """Places of the families, the one to believe first in front.

    The smallest held-out error comes first. Pressures, or a few specimens, hardly tell the laws apart: if
    no lengths could be left out, those within `ALIKE` of the smallest come in the order of the ladder.
    """
    least = min(one.held_out for one in tried)
    factor = 1.0 if any("length" in one.left_out for one in tried) else ALIKE

    def order(place: int) -> tuple[bool, float | tuple[int, ...]]:
        one = tried[place]
        near = one.held_out <= factor * least
        return (not near, one.candidate.rank if near else one.held_out)

    return sorted(range(len(tried)), key=order)

"""Compare candidate families by fitting each to the force map and ranking them by held-out error."""

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

import famjax
from famjax.boundary.errors import InputError

from .data import ForceData
from .engine import muscle_at
from .ladder import FEWEST_LENGTHS, Candidate, sharing_one_program
from .posing import Posed, pose
from .problem import Problem
from .search import End, best_of, descend_from
from .validation import LeftOut, columns_of, force_error, groups_of, leave_out_each

_STEPS, _TOLERANCE = 60, 1e-6
_PROMISE = 1e-7  # relative to the cost: keeps five digits of the full descents


def posed_of(data: ForceData, candidate: Candidate, constraint: str) -> Posed:
    """Set up the fit of a candidate family to a map.

    Raises:
        InputError: the map does not support this family.
    """
    return pose(
        (data,), bounds=candidate.bounds, parameters=candidate.parameters,
        program=sharing_one_program, **{"constraint": constraint, **candidate.options},
    )  # fmt: skip


def descended(posed: Posed, starts: int, seed: int) -> End:
    """Return the best end point of a few descents, with a tolerance that is sufficient for comparison.

    Raises:
        InputError: from every start, the force is undefined (nan) at some reading.
    """
    return best_of(_descents([posed.problem.thinned()], [posed.starts(starts, seed)])[0])


def _descents(
    problems: Sequence[Problem],
    starts: Sequence[Float[np.ndarray, "_ _"]],
    progress: Callable[[int, int], None] | None = None,
) -> list[list[End]]:
    return descend_from(
        problems,
        starts,
        max_steps=_STEPS,
        tolerance=_TOLERANCE,
        promise=_PROMISE,
        progress=progress,
    )


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A family fitted to a map, or to a sample of its readings if the map is long.

    Attributes:
        candidate: the family.
        posed: setup of the fit to all readings.
        problem: problem that was solved; for a long map, it contains only a sample of the readings.
        ends: end points of the descents in the unit box, best first.
        mounted: the muscle in its rig.
        residuals: in-sample residuals, model minus reading [N].
    """

    candidate: Candidate
    posed: Posed
    problem: Problem
    ends: Float[np.ndarray, "starts p"]
    mounted: famjax.MountedMuscle
    residuals: Float[np.ndarray, " readings"]

    @property
    def rmse(self) -> float:
        """In-sample RMSE [N]."""
        return float(np.sqrt(np.mean(self.residuals**2)))


def fitted(
    data: ForceData,
    constraint: str,
    starts: int,
    seed: int,
    candidates: Sequence[Candidate],
    progress: Callable[[int, int], None] | None = None,
) -> list[Fitted | str]:
    """Fit all candidate families in one batch. A long map is represented by a sample of its readings.

    Args:
        data: the force map.
        constraint: constraint on the coefficients.
        starts: number of starts per family.
        seed: random seed for the starts.
        candidates: the families.
        progress: called with (descents done, total).

    Returns:
        One item per candidate: the fit, or the reason why the map does not support the family.
    """
    posed: dict[int, Posed] = {}
    found: list[Fitted | str] = ["" for _ in candidates]
    for k, one in enumerate(candidates):
        try:
            posed[k] = posed_of(data, one, constraint)
        except InputError as error:
            found[k] = str(error)
    # Rigid rigs come first, so that they do not wait for the iteration of compliant ones.
    order = sorted(posed, key=lambda k: candidates[k].rig)
    near = [posed[k].starts(starts, seed) for k in order]
    problems = [posed[k].problem.thinned() for k in order]
    ends = _descents(problems, near, progress)
    for k, problem, own in zip(order, problems, ends, strict=True):
        found[k] = _fitted(candidates[k], posed[k], problem, own)
    return found


def _fitted(candidate: Candidate, posed: Posed, problem: Problem, ends: list[End]) -> Fitted | str:
    try:
        end = best_of(ends)
    except InputError as error:
        return str(error)
    if candidate.rig and _rig_of_the_bounds(problem, end):
        return "In its best fit, the rig is rigid, or as compliant as the bounds allow."
    order = np.argsort([one.cost for one in ends])
    return Fitted(
        candidate, posed, problem, np.stack([ends[k].u for k in order]),
        problem.parts[0].mounted(muscle_at(problem, end.point, 0), end.point.parameters),
        force_error(problem, end)[problem.side == 0],
    )  # fmt: skip


def left_out_of(
    families: Sequence[Fitted], seed: int, progress: Callable[[int, int], None] | None = None
) -> list[dict[str, LeftOut] | None]:
    """Cross-validate families by leaving out single lengths and groups of neighbouring pressures.

    The result is None for a family whose force is undefined (nan) at a held-out reading. It is also None
    for a family with a compliant rig if the map has too few lengths to leave one out, because only a
    held-out length can distinguish a compliant rig from a soft bladder.
    """
    problem = families[0].problem
    lengths = np.unique(problem.levels("length")).size >= FEWEST_LENGTHS
    kinds = {
        # Leaving out pressures hardly moves the optimum; leaving out a length may.
        kind: (groups_of(problem, kind), 1 if kind == "pressure" else 2)
        for kind in ("pressure", "length")[: 1 + lengths]
    }
    found: list[dict[str, LeftOut] | None] = [None for _ in families]
    told = [k for k, one in enumerate(families) if lengths or not one.candidate.rig]
    fits = [(families[k].problem, families[k].ends[0]) for k in told]
    errors = leave_out_each(fits, kinds, seed=seed, progress=progress)
    for k, of in zip(told, errors, strict=True):
        if all(np.isfinite(part.error).all() for part in of.values()):
            found[k] = of
    return found


def _rig_of_the_bounds(problem: Problem, end: End) -> bool:
    """Return True if the rig deflects by a power of the force and only its bounds determine it."""
    at = {problem.names[place]: u for place, u in zip(problem.free, end.u, strict=True)}
    exponent, compliance = at.get("series_exponent", 1.0), at.get("series_compliance", 1.0)
    return bool("series_exponent" in at and (exponent == 0 or compliance in (0.0, 1.0)))


ALIKE = 1.5
"""Families whose in-sample RMSE is within this factor of the smallest are said to fit equally well."""
NEAR = 1.1
"""Held-out errors within this factor of each other count as equal, and the output says so."""
LITTLE_MORE = 2.0
"""Largest ratio of held-out errors at which a family with a certified optimum is still preferred."""
_NOISE = 1e-3  # relative to the largest force; smaller errors count as equal
_TIED = 1.001  # ratio of held-out errors up to which the simpler family is preferred


@dataclasses.dataclass(frozen=True)
class Tried:
    """Result for one candidate family.

    Attributes:
        candidate: the family.
        rmse: in-sample RMSE [N].
        left_out: cross-validation errors, keyed by what is left out: "pressure", "length" or "specimen".
        held_out: held-out error [N] used for ranking, see `held_out_error`.
        alike: True if the in-sample RMSE is within a factor `ALIKE` of the smallest.
    """

    candidate: Candidate
    rmse: float
    left_out: Mapping[str, LeftOut]
    held_out: float
    alike: bool

    @property
    def columns(self) -> dict[str, float]:
        """RMSE [N] on each kind of held-out reading, see `columns_of`."""
        return columns_of(self.left_out)


def held_out_error(left_out: Mapping[str, LeftOut], rmse: float, max_force: float) -> float:
    """Return the geometric mean [N] of the errors in `columns_of`, or the in-sample RMSE if there are none.

    Args:
        left_out: cross-validation errors, keyed as in `Tried`.
        rmse: in-sample RMSE [N].
        max_force: largest measured force [N]; errors below 0.1 % of it count as equal.
    """
    errors = list(columns_of(left_out).values()) or [rmse]
    return float(np.exp(np.mean(np.log(np.hypot(errors, _NOISE * max_force)))))


def ranked(
    families: Sequence[tuple[Candidate, float, Mapping[str, LeftOut] | None]], max_force: float
) -> tuple[Tried, ...]:
    """Compute the held-out error of each family, and return the families in the given order.

    Args:
        families: tuples of the family, its in-sample RMSE [N], and its cross-validation errors, or
            None if it was not cross-validated.
        max_force: largest measured force [N].
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
    """Return the indices of the families, best first.

    The family with the smallest held-out error ranks first; among equals, the first on the ladder does.
    Held-out pressures, or only a few specimens, distinguish the laws poorly. If no lengths could be left
    out, families within a factor `ALIKE` of the smallest error therefore keep the order of the ladder.
    """
    least = min(one.held_out for one in tried)
    factor = _TIED if any("length" in one.left_out for one in tried) else ALIKE

    def order(place: int) -> tuple[bool, float | tuple[int, ...]]:
        one = tried[place]
        near = one.held_out <= factor * least
        return (not near, one.candidate.rank if near else one.held_out)

    return sorted(range(len(tried)), key=order)

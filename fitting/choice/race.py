"""Families of a map, fitted and judged by what each predicts of readings left out."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor

from ..data.force_data import ForceData
from ..descent import End, descend_many
from ..evidence.leave_out import grouped, groups_of, leave_out_each
from ..evidence.left_out import LeftOut
from ..evidence.refit import force_error
from ..problem import Problem
from ..search.multi_start import best_of, latin_hypercube
from ..search.posing import Posed, pose_one
from ..tasks import run_fits
from .ladder import FEWEST_LENGTHS, Candidate
from .ranking import ALIKE, score

_STEPS, _TOLERANCE = 60, 1e-6
_PROMISE = 1e-7  # of the cost: the table of families is that of full descents to five digits


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
    (end,) = _descended([problem], starts, seed)
    return best_of(end)


def _descended(problems: Sequence[Problem], starts: int, seed: int) -> list[list[End]]:
    """The ends of a few descents of each problem, all of them in step."""
    cubes = [latin_hypercube(len(problem.free), starts, seed) for problem in problems]
    ends = iter(
        descend_many(
            [problem for problem in problems for _ in range(starts)],
            [start for cube in cubes for start in cube],
            max_steps=_STEPS, tolerance=_TOLERANCE, promise=_PROMISE,
        )
    )  # fmt: skip
    return [list(itertools.islice(ends, starts)) for _ in problems]


def without_a_rig(problem: Problem, end: End) -> bool:
    """Whether the rig that gives way by a power of the force is of the bounds and not of the readings."""
    at = {problem.names[place]: u for place, u in zip(problem.free, end.u, strict=True)}
    exponent, compliance = at.get("series_exponent", 1.0), at.get("series_compliance", 1.0)
    return bool("series_exponent" in at and (exponent == 0 or compliance in (0.0, 1.0)))


def rmse_of(problem: Problem, end: End) -> float:
    """Root mean square error [N] of a fit over its readings."""
    return float(np.sqrt(np.mean(force_error(problem, end) ** 2)))


@dataclasses.dataclass(frozen=True)
class Fitted:
    """A family fitted to all readings: ends of its descents in its unit box, the best first; its score."""

    candidate: Candidate
    posed: Posed
    ends: Float[np.ndarray, "starts p"]
    rmse: float
    score: float


def fitted_in_step(
    data: ForceData,
    constraint: str,
    box: str,
    starts: int,
    seed: int,
    candidates: Sequence[Candidate],
) -> list[Fitted | str | None]:
    """The families of one kind fitted as well as a comparison needs, all of them in step.

    In words why the map cannot carry one; None where no start has a force everywhere.
    """
    posed: list[Posed | str] = []
    for candidate in candidates:
        try:
            posed.append(posed_of(data, candidate, constraint, box))
        except InputError as error:
            posed.append(str(error))
    ends = iter(_descended([one.problem for one in posed if isinstance(one, Posed)], starts, seed))
    return [
        one if isinstance(one, str) else _judged(candidate, one, next(ends), data.max_force)
        for candidate, one in zip(candidates, posed, strict=True)
    ]


def _judged(
    candidate: Candidate, posed: Posed, ends: Sequence[End], max_force: float
) -> Fitted | str | None:
    """The best end of a family's descents, see `fitted_in_step`."""
    problem = posed.problem
    try:
        end = best_of(ends)
    except InputError:
        return None
    if without_a_rig(problem, end):
        return "the rig of the best fit is rigid, or gives way as much as the bounds allow"
    error = force_error(problem, end)
    groups = {
        kind: one
        for kind, count in _kinds(problem)
        if (one := grouped(problem, kind, error, groups=count)) is not None
    }
    rmse = rmse_of(problem, end)
    order = np.argsort([one.cost for one in ends])
    points = np.stack([ends[k].u for k in order])
    return Fitted(candidate, posed, points, rmse, score(groups, rmse, max_force))


def _kinds(problem: Problem) -> list[tuple[str, int | None]]:
    """What is left out, and in how many groups: a length only if three others are left."""
    lengths = np.unique(problem.levels("length")).size
    kinds = ("pressure", "length") if lengths >= FEWEST_LENGTHS else ("pressure",)
    return [(kind, groups_of(problem, kind)) for kind in kinds]


def left_out_of(
    fitted: Sequence[Fitted],
    max_force: float,
    seed: int,
    executor: AnyExecutor,
    progress: Callable[[str, int, int], None] | None,
) -> tuple[list[tuple[Fitted, dict[str, LeftOut]]], list[Fitted]]:
    """The families with their errors on what was left out, and those for which it is no use.

    A family that errs more on what it has seen than another does on what it has not cannot be as good.
    """
    race = _Race(sorted(fitted, key=lambda one: one.score), max_force)

    def tell(done: int, total: int) -> None:
        if progress is not None and done < total:
            before = sum(len(places) for places in race.kinds[:done])
            first = race.order[race.kinds[done][0]].candidate
            progress(f"left out: {first.kind} families", before, len(fitted))

    run_fits(
        functools.partial(_left_out, seed), race, executor=executor, store=race.found, progress=tell
    )
    found, rest, best = [], [], np.inf
    for k, one in enumerate(race.order):
        if one.score > best + ALIKE:
            rest.append(one)
        elif (out := race.outcome(k)) is not None:
            found.append((one, out))
            best = min(best, race.score(k))
    return found, rest


class _Race(Sequence[dict[int, Fitted]]):
    """The families of each kind by their places, without those that can no longer be as good.

    A kind is judged after those with a better family on what it has seen. An earlier family that is no
    use makes the later ones no use, so what comes of those that were begun before this was known does
    not matter: the outcome is that of one after the other.

    Args:
        order: the families, the best on what they have seen first.
        max_force: largest force measured [N].
    """

    def __init__(self, order: Sequence[Fitted], max_force: float) -> None:
        self.order, self._max_force = order, max_force
        self.found = _Found()
        alike: dict[Any, list[int]] = {}
        for place, one in enumerate(order):
            alike.setdefault(one.candidate.kind, []).append(place)
        self.kinds = list(alike.values())

    def __len__(self) -> int:
        return len(self.kinds)

    def __getitem__(self, index: Any) -> Any:
        judged = [place for part in self.found.values() for place in part]
        best = min((self.score(place) for place in judged), default=np.inf)
        return {
            place: self.order[place]
            for place in self.kinds[index]
            if not self.order[place].score > best + ALIKE
        }

    def outcome(self, place: int) -> dict[str, LeftOut] | None:
        """The errors of a family on what was left out; None where there is no force at some of it."""
        return next((part[place] for part in self.found.values() if place in part), None)

    def score(self, place: int) -> float:
        """Of a family on what was left out; infinite where there is no force at some of it."""
        out = self.outcome(place)
        return np.inf if out is None else score(out, self.order[place].rmse, self._max_force)


class _Found(dict[int, dict[int, dict[str, LeftOut] | None]]):
    """Errors on what was left out of the families of each kind, see `run_tasks`."""

    def keep(self, index: int, part: dict[int, dict[str, LeftOut] | None]) -> None:
        """One more result."""
        self[index] = part


def _left_out(seed: int, fitted: Mapping[int, Fitted]) -> dict[int, dict[str, LeftOut] | None]:
    """Errors on what was left out of each family; None where there is no force at some of it."""
    if not fitted:
        return {}
    fits = [(one.posed.problem, one.ends[0]) for one in fitted.values()]
    # Without some pressures the optimum stays where it was; without a length it may not.
    kinds = {kind: (groups, 1 if kind == "pressure" else 2) for kind, groups in _kinds(fits[0][0])}
    found = leave_out_each(fits, kinds, seed=seed)
    return {
        place: out if all(np.isfinite(errors.error).all() for errors in out.values()) else None
        for place, out in zip(fitted, found, strict=True)
    }

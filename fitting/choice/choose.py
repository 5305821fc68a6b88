"""`choose`: the family that predicts best what it has not seen, and those that are as good."""

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor

from ..data.force_data import ForceData
from ..engine.descent import End, descend_many
from ..engine.problem import Problem
from ..evidence.left_out import LeftOut, grouped, groups_of, leave_out_each
from ..evidence.model_error import ModelError, model_error
from ..evidence.refit import force_error
from ..families.parameters import Parameter
from ..search.checks import check_starts
from ..search.identification import solve
from ..search.multi_start import best_of, latin_hypercube
from ..search.posing import Posed, pose_one
from ..search.result import Identification
from ..search.robust import check_objective
from ..trace import run_fits
from .ladder import FEWEST_LENGTHS, MODEL_ERROR, Candidate, ladder
from .ranking import ALIKE, Tried, hopeless, members, ranked, score

_STEPS, _TOLERANCE = 60, 1e-6
_COMPARED = 4  # starts of each family


@dataclasses.dataclass(frozen=True)
class Choice:
    """The model of a map, chosen by what each family predicts of readings left out.

    Attributes:
        data: the map.
        tried: all families, the best first, and behind them those that nothing was left out of.
        dropped: what the map cannot carry, in sentences.
        members: what predictions are the mean of, the chosen one first; its names in `names`.
        names: of the members.
        left_out: errors of the mean of the members, by "pressure" and by "length".
        error: of predictions, as the readings left out show it.
    """

    data: ForceData
    tried: tuple[Tried, ...]
    dropped: tuple[str, ...]
    members: tuple[Identification, ...]
    names: tuple[str, ...]
    left_out: Mapping[str, LeftOut]
    error: ModelError

    @property
    def chosen(self) -> Identification:
        """The first on the ladder of those that are as good as the best."""
        return self.members[0]

    @property
    def rmse(self) -> float:
        """Of the mean of the members over the loaded readings [N]."""
        mean = np.mean([one.residuals for one in self.members], axis=0)
        return float(np.sqrt(np.mean(mean**2)))

    @property
    def clear(self) -> str:
        """How clear the choice was, in a sentence."""
        name, others = self.names[0], [one for one in self.tried if one.as_good]
        if len(self.tried) == 1:
            return f"Only one family can be carried by this map: {name}."
        if len(others) == 1:
            second = self.tried[1]
            least = "" if second.left_out or not self.left_out else "at least "
            return (
                f"Clear: {name} predicts what it has not seen best; the next, "
                f"{second.candidate.name}, errs {least}{np.exp(second.behind[0]):.2g} times as much."
            )
        return (
            f"Not clear: {len(others)} families predict alike, within one standard error or a tenth; "
            f"{name} comes first on the ladder"
            + (f", and predictions are the mean of {len(self.members)}." if len(self.members) > 1
               else ".")
        )  # fmt: skip

    def predict(
        self, length: Float[np.ndarray, "..."], pressure: Float[np.ndarray, "..."]
    ) -> Float[np.ndarray, "..."]:
        """Mean force [N] of the members at lengths [m] and gauge pressures [Pa], broadcast."""
        return np.mean([one.predict(length, pressure) for one in self.members], axis=0)


def choose(
    data: ForceData,
    *,
    constraint: str = "drucker",
    box: str = "physical",
    bounds: Mapping[str, tuple[float, float]] | None = None,
    parameters: Mapping[str, Parameter] | None = None,
    noise: float | None = None,
    objective: str = "sum_of_squares",
    starts: int = 16,
    seed: int = 0,
    executor: AnyExecutor = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> Choice:
    """The model of a force map, from a ladder of families, by what each predicts of readings left out.

    Each family is fitted to all readings and again without each length and without groups of
    neighbouring pressures. Families within one standard error of the best, or a tenth, are as good as
    it: the first of them on the ladder is chosen, and predictions are the mean of the best few of its
    law. Nothing is left out of a family that errs more on what it has seen than another on what it
    has not.

    Args:
        data: the map.
        constraint: on the coefficients, as in `identify`; likewise of every family what follows.
        box: of the standard bounds.
        bounds: intervals by parameter name; the ladder varies none of these.
        parameters: bounds, held values and priors; the ladder varies none of these, either.
        noise: standard deviation of one reading [N]; that of the data unless given.
        objective: of the fits of the members.
        starts: of the fit of the chosen family; others are compared with a few.
        seed: of the starts.
        executor: what fits and judges the families, each a task: this process, processes or a cluster,
            see `famjax.boundary.tasks.AnyExecutor`; the choice is the same.
        progress: called with (what is done, families done, families).

    Returns:
        The choice.

    Raises:
        InputError: what `identify` refuses of the plainest family, or the executor is gone.
        RuntimeError: float64 is off.
    """
    check_starts(starts)
    check_objective(objective)
    candidates, dropped = ladder(data, parameters, bounds)
    weighed = weigh(data, noise)
    if not candidates:
        raise InputError(
            f"{int(data.loaded.sum())} loaded readings at "
            f"{np.unique(data.lengths.level[data.loaded]).size} lengths determine no family: "
            "measure the force at two lengths or more, of which one is shorter than the rest length"
        )
    _posed(weighed, candidates[0], constraint, box)  # what the plainest cannot be is no muscle

    def tell(done: int, total: int) -> None:
        if progress is not None and done < total:
            progress(candidates[done].name, done, total)

    fit = functools.partial(_fitted, weighed, constraint, box, min(starts, _COMPARED), seed)
    fitted: list[_Fitted] = []
    for candidate, one in zip(
        candidates, run_fits(fit, candidates, executor=executor, progress=tell), strict=True
    ):
        if isinstance(one, str):
            dropped = (*dropped, f"{candidate.name} was left out: {one}")
        elif one is not None:
            fitted.append(one)
    found, rest = _left_out_of(fitted, data.max_force, seed, executor, progress)
    if not found:
        solve(_posed(weighed, candidates[0], constraint, box), starts=starts, seed=seed)
        raise InputError("no family of the ladder has a force at every reading: narrow the bounds")
    tried, order = ranked([(one.candidate, one.rmse, out) for one, out in found], data.max_force)
    good = members(tried)
    fits, names, errors = [], [], []
    for one in good:
        chosen, left_out = found[order[one]]
        if progress is not None:
            progress(f"identifying: {chosen.candidate.name}", len(candidates), len(candidates))
        # The chosen family is certified by all starts; those averaged with it are near it.
        count = min(starts, _COMPARED) if fits else starts
        (result,) = solve(chosen.posed, objective=objective, starts=count, seed=seed)
        if fits and not result.converged:
            continue
        fits.append(dataclasses.replace(result, data=data))
        names.append(chosen.candidate.name)
        errors.append(left_out)
    mean = {
        kind: dataclasses.replace(one, error=np.mean([of[kind].error for of in errors], axis=0))
        for kind, one in errors[0].items()
    }
    residual = np.mean([one.residuals for one in fits], axis=0)
    unknowns = tried[good[0]].candidate.unknowns
    tried = (
        *tried,
        *(hopeless(one.candidate, one.rmse, one.score, tried[0].score) for one in rest),
    )
    return Choice(
        data=data, tried=tried, dropped=dropped, members=tuple(fits), names=tuple(names),
        left_out=mean, error=model_error(data, residual, mean, unknowns),
    )  # fmt: skip


def weigh(data: ForceData, noise: float | None = None) -> ForceData:
    """The map with the error of the laws in the standard deviations of its readings.

    Args:
        data: the map.
        noise: standard deviation of one reading [N]; that of the data unless given.
    """
    own = noise or (0.0 if data.force_std is None else data.force_std)
    std = np.hypot(own, MODEL_ERROR * data.max_force)
    return dataclasses.replace(data, force_std=np.broadcast_to(std, data.force.shape).copy())


def _posed(data: ForceData, candidate: Candidate, constraint: str, box: str) -> Posed:
    return pose_one(
        data, constraint=constraint, box=box, bounds=candidate.bounds,
        parameters=candidate.parameters, **candidate.options,
    )  # fmt: skip


def fit_candidate(
    data: ForceData,
    candidate: Candidate,
    constraint: str = "drucker",
    box: str = "physical",
    *,
    starts: int = 4,
    seed: int = 0,
) -> tuple[Problem, End]:
    """A family fitted to a map as well as a comparison needs.

    Raises:
        InputError: the map cannot carry it, or no start ends at a force for every reading.
    """
    problem = _posed(data, candidate, constraint, box).problem
    return problem, descended(problem, starts, seed)


def descended(problem: Problem, starts: int, seed: int) -> End:
    """The best end of a few descents, as near to an optimum as a comparison needs."""
    cube = latin_hypercube(len(problem.free), starts, seed)
    ends = descend_many([problem] * starts, list(cube), max_steps=_STEPS, tolerance=_TOLERANCE)
    return best_of(ends)


def without_a_rig(problem: Problem, end: End) -> bool:
    """Whether the rig that gives way by a power of the force is of the bounds and not of the readings."""
    at = {problem.names[place]: u for place, u in zip(problem.free, end.u, strict=True)}
    exponent, compliance = at.get("series_exponent", 1.0), at.get("series_compliance", 1.0)
    return "series_exponent" in at and (exponent == 0 or compliance in (0.0, 1.0))


def rmse_of(problem: Problem, end: End) -> float:
    """Root mean square error [N] of a fit over its readings."""
    return float(np.sqrt(np.mean(force_error(problem, end) ** 2)))


@dataclasses.dataclass(frozen=True)
class _Fitted:
    """A family fitted to all readings, at a point of its unit box, with its score on them."""

    candidate: Candidate
    posed: Posed
    u: Float[np.ndarray, " p"]
    rmse: float
    score: float


def _fitted(
    data: ForceData, constraint: str, box: str, starts: int, seed: int, candidate: Candidate
) -> _Fitted | str | None:
    """The family fitted as well as a comparison needs.

    In words why the map cannot carry it; None where no start has a force everywhere.
    """
    try:
        posed = _posed(data, candidate, constraint, box)
    except InputError as error:
        return str(error)
    problem = posed.problem
    try:
        end = descended(problem, starts, seed)
    except InputError:
        return None
    if without_a_rig(problem, end):
        return "the rig of its best fit is rigid, or gives way as much as the bounds allow"
    error = force_error(problem, end)
    groups = {
        kind: one
        for kind, count in _kinds(problem)
        if (one := grouped(problem, kind, error, groups=count)) is not None
    }
    rmse = rmse_of(problem, end)
    return _Fitted(candidate, posed, end.u, rmse, score(groups, rmse, data.max_force))


def _kinds(problem: Problem) -> list[tuple[str, int | None]]:
    """What is left out, and in how many groups: a length only if three others are left."""
    lengths = np.unique(problem.levels("length")).size
    kinds = ("pressure", "length") if lengths >= FEWEST_LENGTHS else ("pressure",)
    return [(kind, groups_of(problem, kind)) for kind in kinds]


def _left_out_of(
    fitted: Sequence[_Fitted],
    max_force: float,
    seed: int,
    executor: AnyExecutor,
    progress: Callable[[str, int, int], None] | None,
) -> tuple[list[tuple[_Fitted, dict[str, LeftOut]]], list[_Fitted]]:
    """The families with their errors on what was left out, and those for which it is no use.

    A family that errs more on what it has seen than another does on what it has not cannot be as good.
    """
    race = _Race(sorted(fitted, key=lambda one: one.score), max_force)

    def tell(done: int, total: int) -> None:
        if progress is not None and done < total:
            progress(f"left out: {race.order[done].candidate.name}", done, total)

    run_fits(
        functools.partial(_left_out, seed), race, executor=executor, store=race.found, progress=tell
    )
    found, rest, best = [], [], np.inf
    for k, one in enumerate(race.order):
        if one.score > best + ALIKE:
            rest.append(one)
        elif (out := race.found.parts[k]) is not None:
            found.append((one, out))
            best = min(best, race.score(k))
    return found, rest


class _Race(Sequence[_Fitted | None]):
    """Families by their scores on what they have seen, and None for one that can no longer be as good.

    An earlier one that is no use makes the later ones no use, so what comes of those that were begun
    before this was known does not matter: the outcome is that of one after the other.

    Args:
        order: the families, the best first.
        max_force: largest force measured [N].
    """

    def __init__(self, order: Sequence[_Fitted], max_force: float) -> None:
        self.order, self._max_force = order, max_force
        self.found = _Found()

    def __len__(self) -> int:
        return len(self.order)

    def __getitem__(self, index: Any) -> Any:
        one = self.order[index]
        best = min((self.score(k) for k in self.found.parts if k < index), default=np.inf)
        return None if one.score > best + ALIKE else one

    def score(self, index: int) -> float:
        """Of a family on what was left out; infinite where there is no force at some of it."""
        out = self.found.parts[index]
        return np.inf if out is None else score(out, self.order[index].rmse, self._max_force)


class _Found:
    """Errors on what was left out by the place of the family, see `run_tasks`."""

    def __init__(self) -> None:
        self.parts: dict[int, dict[str, LeftOut] | None] = {}

    def __contains__(self, index: int) -> bool:
        return index in self.parts

    def keep(self, index: int, part: dict[str, LeftOut] | None) -> None:
        """One more result."""
        self.parts[index] = part


def _left_out(seed: int, one: _Fitted | None) -> dict[str, LeftOut] | None:
    """Errors on what was left out; None where there is no force at some of it, or no use in it."""
    if one is None:
        return None
    problem = one.posed.problem
    # Without some pressures the optimum stays where it was; without a length it may not.
    kinds = {kind: (groups, 1 if kind == "pressure" else 2) for kind, groups in _kinds(problem)}
    found = leave_out_each(problem, one.u, kinds, seed=seed)
    return found if all(np.isfinite(errors.error).all() for errors in found.values()) else None

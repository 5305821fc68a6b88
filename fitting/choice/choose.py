"""`choose`: the family that predicts best what it has not seen, and those that are as good."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..data.force_data import ForceData
from ..engine.descent import End, descend_many
from ..engine.problem import Problem
from ..evidence.left_out import LeftOut, leave_out
from ..evidence.model_error import ModelError, model_error
from ..families.parameters import Parameter
from ..search.checks import check_starts
from ..search.identification import solve
from ..search.multi_start import best_of, latin_hypercube
from ..search.posing import Posed, pose_one
from ..search.result import Identification
from ..search.robust import check_objective
from .ladder import MODEL_ERROR, Candidate, ladder

_PRESSURE_GROUPS = 8  # neighbouring pressures say much the same of one another
_AVERAGED = 3  # families at most
_FEWEST_LENGTHS = 4  # without one of three, two are left, which no family is determined by
_PLAINLY = 2.0  # standard errors behind the best in pressures, or in lengths, alone
_NOISE = 1e-3  # of the largest force: smaller errors are not told apart
_STEPS, _TOLERANCE = 60, 1e-6
_COMPARED = 4  # starts of each family


@dataclasses.dataclass(frozen=True)
class Tried:
    """One family that was tried.

    Attributes:
        candidate: the family.
        rmse: in sample [N].
        left_out: errors by "pressure" and by "length", where there are three or more of these.
        score: mean logarithm of the errors of the groups left out, kinds of groups weighed alike;
            of the error in sample where nothing can be left out.
        behind: score less that of the best, with its standard error over the groups.
        as_good: within one standard error of the best in all, and within two of it in pressures and
            in lengths by themselves.
    """

    candidate: Candidate
    rmse: float
    left_out: Mapping[str, LeftOut]
    score: float
    behind: tuple[float, float]
    as_good: bool


@dataclasses.dataclass(frozen=True)
class Choice:
    """The model of a map, chosen by what each family predicts of readings left out.

    Attributes:
        data: the map.
        tried: all families, the best first.
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
        """The plainest of those that are as good as the best."""
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
            factor = np.exp(second.behind[0])
            return (
                f"Clear: {name} predicts what it has not seen best; the next, "
                f"{second.candidate.name}, errs {factor:.2g} times as much."
            )
        return (
            f"Not clear: {len(others)} families predict alike within one standard error; {name} is "
            "the plainest of them"
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
    progress: Callable[[str, int, int], None] | None = None,
) -> Choice:
    """The model of a force map, from a ladder of families, by what each predicts of readings left out.

    Each family is fitted to all readings and again without each length and without groups of
    neighbouring pressures. Families within one standard error of the best are as good as it: the
    plainest of them is chosen, and predictions are the mean of the best few.

    Args:
        data: the map.
        constraint: on the coefficients, as in `identify`; likewise of every family what follows.
        box: of the standard bounds.
        bounds: intervals by parameter name; the ladder varies none of these.
        parameters: bounds, held values and priors; the ladder varies none of these, either.
        noise: standard deviation of one reading [N]; that of the data unless given.
        objective: of the fits of the members.
        starts: of the fits of the members; families are compared with a few.
        seed: of the starts.
        progress: called with (what is done, families done, families).

    Returns:
        The choice.

    Raises:
        InputError: what `identify` refuses of the plainest family.
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
    found: list[tuple[Candidate, Posed, float, dict[str, LeftOut]]] = []
    for done, candidate in enumerate(candidates):
        if progress is not None:
            progress(candidate.name, done, len(candidates))
        try:
            posed = _posed(weighed, candidate, constraint, box)
        except InputError as error:
            if candidate is candidates[0]:
                raise  # what the plainest cannot be is no muscle
            dropped = (*dropped, f"{candidate.name} was left out: {error}")
            continue
        outcome = _tried(posed, min(starts, _COMPARED), seed)
        if outcome is not None:
            found.append((candidate, posed, *outcome))
    if not found:
        solve(_posed(weighed, candidates[0], constraint, box), starts=starts, seed=seed)
        raise InputError("no family of the ladder has a force at every reading: narrow the bounds")
    tried, order = _ranked(found, data.max_force)
    chosen = _members(tried)
    members, names, errors = [], [], []
    for one in chosen:
        candidate, posed, _, left_out = found[order[one]]
        if progress is not None:
            progress(f"identifying: {candidate.name}", len(candidates), len(candidates))
        (result,) = solve(posed, objective=objective, starts=starts, seed=seed)
        if members and not result.converged:
            continue
        members.append(dataclasses.replace(result, data=data))
        names.append(candidate.name)
        errors.append(left_out)
    mean = {
        kind: dataclasses.replace(one, error=np.mean([of[kind].error for of in errors], axis=0))
        for kind, one in errors[0].items()
    }
    residual = np.mean([one.residuals for one in members], axis=0)
    unknowns = found[order[chosen[0]]][0].unknowns
    return Choice(
        data=data, tried=tried, dropped=dropped, members=tuple(members), names=tuple(names),
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
    return problem, _descended(problem, starts, seed)


def fit_error(data: ForceData, candidate: Candidate) -> float:
    """RMSE [N] of a family fitted to a map.

    Raises:
        InputError: as `fit_candidate`.
    """
    return _rmse(*fit_candidate(data, candidate))


def _descended(problem: Problem, starts: int, seed: int) -> End:
    cube = latin_hypercube(len(problem.free), starts, seed)
    ends = descend_many([problem] * starts, list(cube), max_steps=_STEPS, tolerance=_TOLERANCE)
    return best_of(ends)


def _rmse(problem: Problem, end: End) -> float:
    residual = end.point.residual[: problem.force.size] / problem.weight
    return float(np.sqrt(np.mean(residual**2)))


def _tried(posed: Posed, starts: int, seed: int) -> tuple[float, dict[str, LeftOut]] | None:
    """Error in sample and on what was left out; None where no start has a force everywhere."""
    problem = posed.problem
    try:
        best = _descended(problem, starts, seed)
    except InputError:
        return None
    left_out = {}
    lengths = np.unique(problem.levels("length")).size
    for kind, groups in (("pressure", _PRESSURE_GROUPS), ("length", None)):
        if kind == "length" and lengths < _FEWEST_LENGTHS:
            continue
        one = leave_out(problem, best.u, kind, groups=groups, starts=2, seed=seed)
        if one is not None:
            if not np.isfinite(one.error).all():
                return None
            left_out[kind] = one
    return _rmse(problem, best), left_out


def _ranked(
    found: Sequence[tuple[Candidate, Posed, float, dict[str, LeftOut]]], max_force: float
) -> tuple[tuple[Tried, ...], list[int]]:
    """The families by their scores, the best first, and their places in `found`."""
    floor = _NOISE * max_force
    logs = [
        [np.log(np.hypot(one.group_rmse, floor)) for one in left_out.values()]
        or [np.array([np.log(np.hypot(rmse, floor))])]
        for _, _, rmse, left_out in found
    ]
    scores = [float(np.mean([one.mean() for one in of])) for of in logs]
    order = sorted(range(len(found)), key=lambda k: scores[k])
    tried = []
    for k in order:
        candidate, _, rmse, left_out = found[k]
        differences = [a - b for a, b in zip(logs[k], logs[order[0]], strict=True)]
        means = np.array([one.mean() for one in differences])
        errors = np.array(
            [np.sqrt(d.var(ddof=1) / d.size) if d.size > 1 else 0.0 for d in differences]
        )
        error = float(np.linalg.norm(errors) / errors.size)
        behind = scores[k] - scores[order[0]]
        as_good = behind <= error and bool((means <= _PLAINLY * errors).all())
        tried.append(Tried(candidate, rmse, left_out, scores[k], (behind, error), as_good))
    return tuple(tried), order


def _members(tried: Sequence[Tried]) -> list[int]:
    """Places of the families that predictions are the mean of, the first on the ladder first."""
    good = [k for k, one in enumerate(tried) if one.as_good]
    first = min(good, key=lambda k: tried[k].candidate.rank)
    law = tried[first].candidate.law
    alike = [k for k in good if tried[k].candidate.law == law and k != first]
    return [first, *alike[: _AVERAGED - 1]]

"""`choose`: the family that predicts best what it has not seen, and those that are as good."""

import dataclasses
import functools
import itertools
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.tasks import AnyExecutor

from ..data.force_data import ForceData
from ..evidence.left_out import LeftOut
from ..evidence.model_error import ModelError, model_error
from ..families.parameters import Parameter
from ..search.checks import check_starts
from ..search.identification import solve
from ..search.result import Identification
from ..search.robust import check_objective
from ..tasks import run_fits
from .ladder import MODEL_ERROR, Candidate, ladder
from .other_lengths import OtherLengths, accounts, other_lengths
from .race import Fitted, fitted_in_step, left_out_of, posed_of
from .ranking import Tried, first_settled, hopeless, members, ranked

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
        other_lengths: what predictions of muscles of other lengths are made of, None where the map or
            what a user says leaves but one account of it.
    """

    data: ForceData
    tried: tuple[Tried, ...]
    dropped: tuple[str, ...]
    members: tuple[Identification, ...]
    names: tuple[str, ...]
    left_out: Mapping[str, LeftOut]
    error: ModelError
    other_lengths: OtherLengths | None = None

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
    has not. A family whose optimum cannot be certified is passed over where another errs little more.

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
    posed_of(weighed, candidates[0], constraint, box)  # what the plainest cannot be is no muscle

    of_others = {one.name: one for one in accounts(data, parameters, bounds)}
    judged = {one.name: one for one in candidates}
    every = {**judged, **of_others}.values()
    kinds = [tuple(of) for _, of in itertools.groupby(every, lambda one: one.kind)]

    def tell(done: int, total: int) -> None:
        if progress is not None and done < total:
            before = sum(len(of) for of in kinds[:done])
            progress(f"{kinds[done][0].kind} families", before, len(every))

    fit = functools.partial(fitted_in_step, weighed, constraint, box, min(starts, _COMPARED), seed)
    ends = run_fits(fit, kinds, executor=executor, progress=tell)
    outcomes = [*zip(every, itertools.chain.from_iterable(ends), strict=True)]
    dropped = (*dropped, *sentences_on_no_use(outcomes, judged))
    fitted, elsewhere = (
        [one for candidate, one in outcomes if isinstance(one, Fitted) and candidate.name in of]
        for of in (judged, of_others)
    )

    def identified(one: Fitted, points: Float[np.ndarray, "k p"]) -> Identification | None:
        if progress is not None:
            progress(f"identifying: {one.candidate.name}", len(every), len(every))
        try:
            (result,) = solve(one.posed, points, objective=objective, seed=seed)
        except InputError:
            return None
        return dataclasses.replace(result, data=data)

    # The chosen family is certified by all starts; those averaged with it are near it.
    found, rest, first, unsettled = _settled(
        fitted,
        data.max_force,
        lambda left: left_out_of(left, data.max_force, seed, executor, progress),
        lambda one: identified(one, one.posed.starts(starts, seed)),
    )
    if first is None:
        plainest = posed_of(weighed, candidates[0], constraint, box)
        solve(plainest, plainest.starts(starts, seed), seed=seed)
        raise InputError("no family of the ladder has a force at every reading: narrow the bounds")
    dropped = (*dropped, *(f"{name} was left out: its fit did not converge." for name in unsettled))
    tried, order = ranked(_outcomes(found), data.max_force)
    good = members(tried)
    chosen, left_out = found[order[good[0]]]
    averaged = [(chosen, first, left_out)]
    for other, left_out in (found[order[one]] for one in good[1:]):
        result = identified(other, other.ends)
        if result is not None and result.converged:
            averaged.append((other, result, left_out))
    mean = {kind: LeftOut.of_mean([out[kind] for *_, out in averaged]) for kind in averaged[0][2]}
    residual = np.mean([one.residuals for _, one, _ in averaged], axis=0)
    unknowns, best = tried[good[0]].candidate.unknowns, tried[0].score
    return Choice(
        data=data,
        tried=(*tried, *(hopeless(one.candidate, one.rmse, one.score, best) for one in rest)),
        dropped=dropped,
        members=tuple(one for _, one, _ in averaged),
        names=tuple(one.candidate.name for one, *_ in averaged),
        left_out=mean,
        error=model_error(data, residual, mean, unknowns),
        other_lengths=other_lengths(elsewhere, data.max_force),
    )


_Judged = list[tuple[Fitted, dict[str, LeftOut]]]


def _outcomes(found: _Judged) -> list[tuple[Candidate, float, dict[str, LeftOut]]]:
    return [(one.candidate, one.rmse, out) for one, out in found]


def sentences_on_no_use(
    outcomes: Iterable[tuple[Candidate, Fitted | str | None]], judged: Collection[str]
) -> list[str]:
    """A sentence for each reason for which judged families were left out."""
    names: dict[str, list[str]] = {}
    for candidate, why in outcomes:
        if isinstance(why, str) and candidate.name in judged:
            names.setdefault(why, []).append(candidate.name)
    return [
        f"{'; '.join(those)} {'was' if len(those) == 1 else 'were'} left out: {why}"
        for why, those in names.items()
    ]


def _settled(
    fitted: Sequence[Fitted],
    max_force: float,
    race: Callable[[Sequence[Fitted]], tuple[_Judged, list[Fitted]]],
    certified: Callable[[Fitted], Identification | None],
) -> tuple[_Judged, list[Fitted], Identification | None, list[str]]:
    """The race of the families without those that are believed before the first that converges.

    Returns:
        (its outcome, as `left_out_of` has it; the fit of the first, None where nothing was found; the
        names of those without an optimum).
    """
    unsettled: list[str] = []
    while True:
        found, rest = race(fitted)
        if not found:
            return found, rest, None, unsettled
        first, lost = first_settled(
            _outcomes(found), max_force, lambda place, found=found: certified(found[place][0])
        )
        if not lost:
            return found, rest, first, unsettled
        names = [found[place][0].candidate.name for place in lost]
        unsettled += names
        fitted = [one for one in fitted if one.candidate.name not in names]


def weigh(data: ForceData, noise: float | None = None) -> ForceData:
    """The map with the error of the laws in the standard deviations of its readings.

    Args:
        data: the map.
        noise: standard deviation of one reading [N]; that of the data unless given.
    """
    own = noise or (0.0 if data.force_std is None else data.force_std)
    std = np.hypot(own, MODEL_ERROR * data.max_force)
    return dataclasses.replace(data, force_std=np.broadcast_to(std, data.force.shape).copy())

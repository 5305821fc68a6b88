"""Which families predict best what was left out, and of which the predictions are the mean."""

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np

from ..evidence.left_out import LeftOut
from .ladder import Candidate

_AVERAGED = 3  # families at most
_PLAINLY = 2.0  # standard errors behind the best in one kind of groups alone
ALIKE = 0.1
"""Errors that differ by less than a tenth are not told apart."""

_LITTLE_MORE = 0.4
"""Logarithm of the error: half as much again is little for a fit that is an optimum."""
_UNSETTLED = 6
"""Families in a row without an optimum: from there on it is the readings, and not the family."""
_NOISE = 1e-3  # of the largest force: smaller errors are not told apart


@dataclasses.dataclass(frozen=True)
class Tried:
    """One family that was tried.

    Attributes:
        candidate: the family.
        rmse: in sample [N].
        left_out: errors by kind of what was left out, "pressure", "length" or "specimen".
        score: mean logarithm of the errors of the groups left out, kinds of groups weighed alike; of
            the errors in sample, a lower bound, where nothing was left out of this family.
        behind: score less that of the best, with its standard error over the groups.
        as_good: within one standard error of the best, or a tenth, in all, and within two standard
            errors of it, or a tenth, in each kind by itself.
    """

    candidate: Candidate
    rmse: float
    left_out: Mapping[str, LeftOut]
    score: float
    behind: tuple[float, float]
    as_good: bool


def score(errors: Mapping[str, LeftOut], rmse: float, max_force: float) -> float:
    """Mean logarithm of the errors of groups, see `Tried`.

    Args:
        errors: by kind of groups.
        rmse: in sample [N], which counts where there are none.
        max_force: largest force measured [N].
    """
    return float(np.mean([one.mean() for one in _logs(errors, rmse, max_force)]))


def _logs(errors: Mapping[str, LeftOut], rmse: float, max_force: float) -> list[np.ndarray]:
    floor = _NOISE * max_force
    found = [np.log(np.hypot(one.group_rmse, floor)) for one in errors.values()]
    return found or [np.array([np.log(np.hypot(rmse, floor))])]


def hopeless(one: Candidate, rmse: float, at_least: float, best: float) -> Tried:
    """A family that nothing was left out of.

    By its score in sample it errs more on what it has seen than the best does on what it has not.
    """
    return Tried(one, rmse, {}, at_least, (at_least - best, 0.0), as_good=False)


def ranked(
    found: Sequence[tuple[Candidate, float, Mapping[str, LeftOut]]], max_force: float
) -> tuple[tuple[Tried, ...], list[int]]:
    """The families by their scores, the best first, and their places in `found`.

    Args:
        found: each family with its error in sample [N] and its errors on what was left out.
        max_force: largest force measured [N].
    """
    logs = [_logs(left_out, rmse, max_force) for _, rmse, left_out in found]
    scores = [float(np.mean([one.mean() for one in of])) for of in logs]
    order = sorted(range(len(found)), key=lambda k: scores[k])
    tried = []
    for k in order:
        candidate, rmse, left_out = found[k]
        differences = [a - b for a, b in zip(logs[k], logs[order[0]], strict=True)]
        means = np.array([one.mean() for one in differences])
        errors = np.array(
            [np.sqrt(d.var(ddof=1) / d.size) if d.size > 1 else 0.0 for d in differences]
        )
        error = float(np.linalg.norm(errors) / errors.size)
        behind = scores[k] - scores[order[0]]
        as_good = behind <= max(error, ALIKE) and bool(
            (means <= np.maximum(_PLAINLY * errors, ALIKE)).all()
        )
        tried.append(Tried(candidate, rmse, left_out, scores[k], (behind, error), as_good))
    return tuple(tried), order


def first_on_ladder(tried: Sequence[Tried]) -> int:
    """Place of the family that is believed first, of those that are as good as the best."""
    good = [k for k, one in enumerate(tried) if one.as_good]
    return min(good, key=lambda k: tried[k].candidate.rank)


@runtime_checkable
class Settles(Protocol):
    """What may be an optimum or not, such as an identification."""

    @property
    def converged(self) -> bool:
        """Whether it is one."""
        ...


Fit = TypeVar("Fit", bound=Settles)


def first_settled(
    found: Sequence[tuple[Candidate, float, Mapping[str, LeftOut]]],
    max_force: float,
    identified: Callable[[int], Fit | None],
) -> tuple[Fit | None, list[int]]:
    """The fit of the family that is believed first, of those whose optimum is certified.

    Args:
        found: each family, see `ranked`.
        max_force: largest force measured [N].
        identified: the fit of a family, called with its place in `found`; None where it has none.

    Returns:
        The fit, and the places of the families before it that have none to be certified. Where all that
        err little more have none, either, the fit of the first that has any.
    """
    left, lost = list(range(len(found))), []
    first: Fit | None = None
    before, best = 0, np.inf
    while left and len(lost) < _UNSETTLED:
        tried, order = ranked([found[place] for place in left], max_force)
        best = min(best, tried[0].score)
        if tried[0].score > best + _LITTLE_MORE:
            break
        place = left.pop(order[first_on_ladder(tried)])
        fit = identified(place)
        if fit is not None and fit.converged:
            return fit, lost
        if fit is not None and first is None:
            first, before = fit, len(lost)
        lost.append(place)
    return first, lost[:before]


def members(tried: Sequence[Tried]) -> list[int]:
    """Places of the families that predictions are the mean of, the first on the ladder first."""
    good = [k for k, one in enumerate(tried) if one.as_good]
    first = first_on_ladder(tried)
    law = tried[first].candidate.law
    alike = [k for k in good if tried[k].candidate.law == law and k != first]
    return [first, *alike[: _AVERAGED - 1]]

"""Cross-validation of force models: leave out a pressure, a length or a specimen, and predict it."""

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any, Literal, TypeAlias, cast

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError

from ..data import ForceData, Specimen

Groups = Literal["pressure", "length", "specimen"]
GROUPS: tuple[Groups, ...] = ("pressure", "length", "specimen")

Predictor: TypeAlias = Callable[[np.ndarray, np.ndarray], Any]
"""Force [N] of arrays of length [m] and pressure [Pa]."""

FitAndPredict: TypeAlias = Callable[[ForceData], Predictor]
"""Fits a force map and returns what predicts with that fit."""

PooledFitAndPredict: TypeAlias = Callable[[Sequence[ForceData], Specimen], Predictor]
"""Fits several force maps at once and returns what predicts with that fit for another specimen."""


@dataclasses.dataclass(frozen=True)
class GroupError:
    """How well one group of readings was predicted from the others.

    Attributes:
        group: pressure [Pa], length [m] or name of the specimen; the middle of neighbours that were
            left out together, as those of more than 40 are.
        n_readings: loaded readings in it.
        rmse, max_error: root mean square and largest error [N].
    """

    group: float | str
    n_readings: int
    rmse: float
    max_error: float


@dataclasses.dataclass(frozen=True)
class CrossValidation:
    """The errors of a model at readings that it had not seen.

    Attributes:
        groups: "pressure", "length" or "specimen".
        errors: of each group, in increasing order.
        rmse: root mean square error [N] over all held-out loaded readings.
        interior_rmse: over the groups between the first and the last, where a prediction is no
            extrapolation; nan where there is none, and for specimens.
        predicted: force [N] at every loaded reading, by the fit without its group.
        ambiguous: groups without which fits of equal cost predict different forces: what is left
            does not determine the model, and the error there is that of one fit among many.
    """

    groups: Groups
    errors: tuple[GroupError, ...]
    rmse: float
    interior_rmse: float
    predicted: Float[np.ndarray, " points"]
    ambiguous: tuple[float, ...] = ()


def cross_validate(
    fit_and_predict: FitAndPredict | PooledFitAndPredict,
    data: ForceData | Sequence[ForceData],
    groups: str = "pressure",
) -> CrossValidation:
    """The errors of a model at each pressure, length or specimen when fitted to the others.

    For each group in turn the model is fitted to the readings outside it, slack ones included, and
    the group's loaded readings are predicted.

    Args:
        fit_and_predict: takes a force map and returns a function of length [m] and pressure [Pa].
            For specimens it takes the sequence of maps to fit and the specimen to predict for.
        data: the force map; for specimens a sequence of them.
        groups: "pressure", "length" or "specimen".

    Returns:
        The errors.

    Raises:
        InputError: unknown groups, fewer than two of them, or a fit that refuses its readings.

    >>> from fitting import load_bundled
    >>> def mean(train):
    ...     force = train.force[train.loaded].mean()
    ...     return lambda length, pressure: force + 0 * length
    >>> print(f"{cross_validate(mean, load_bundled('DMSP-20-300'), 'length').rmse:.0f}")
    393
    """
    if groups not in GROUPS:
        raise InputError(f"groups must be one of {', '.join(GROUPS)}, got {groups!r}")
    if groups == "specimen":
        if isinstance(data, ForceData):
            raise InputError("to leave out specimens, give a sequence of force maps, one of each")
        return _without_specimens(cast(PooledFitAndPredict, fit_and_predict), data)
    if not isinstance(data, ForceData):
        raise InputError(f"to leave out a {groups}, give one force map, not a sequence")
    labels = data.left_out_as(groups)
    check_groups(data, groups)
    predicted = np.full(data.force.size, math.nan)
    for group in np.unique(labels[data.loaded]):
        held = (labels == group) & data.loaded
        predict = cast(FitAndPredict, fit_and_predict)(data.part(labels != group))
        predicted[held] = predict(data.length[held], data.pressure[held])
    return held_out_errors(data, cast(Groups, groups), predicted[data.loaded])


def check_groups(data: ForceData, groups: str) -> None:
    """There must be two pressures or lengths with loaded readings to leave one out.

    Raises:
        InputError: there is one.
    """
    if np.unique(data.levels(groups)[data.loaded]).size < 2:
        raise InputError(
            f"to leave out a {groups} there must be loaded readings at two of them or more; all "
            f"{int(data.loaded.sum())} share one"
        )


def held_out_errors(
    data: ForceData, groups: Groups, predicted: Float[np.ndarray, " points"]
) -> CrossValidation:
    """The summary of predictions [N] of the loaded readings, each without its own group."""
    loaded = data.loaded
    labels, force = data.left_out_as(groups)[loaded], data.force[loaded]
    levels = np.unique(labels)
    interior = (labels > levels[0]) & (labels < levels[-1])
    error = predicted - force
    errors = tuple(_group_error(float(level), error[labels == level]) for level in levels)
    return CrossValidation(groups, errors, _rms(error), _rms(error[interior]), predicted)


def _without_specimens(
    fit_and_predict: PooledFitAndPredict, maps: Sequence[ForceData]
) -> CrossValidation:
    if len(maps) < 2:
        raise InputError(f"to leave out specimens, give two force maps or more; got {len(maps)}")
    predictions, errors = [], []
    for place, held in enumerate(maps):
        others = tuple(data for k, data in enumerate(maps) if k != place)
        at, predict = held.loaded, fit_and_predict(others, held.specimen)
        predictions.append(np.asarray(predict(held.length[at], held.pressure[at]), float))
        errors.append(_group_error(held.specimen.name, predictions[-1] - held.force[at]))
    force = np.concatenate([held.force[held.loaded] for held in maps])
    predicted = np.concatenate(predictions)
    return CrossValidation("specimen", tuple(errors), _rms(predicted - force), math.nan, predicted)


def _group_error(group: float | str, error: Float[np.ndarray, " n"]) -> GroupError:
    return GroupError(group, error.size, _rms(error), float(np.abs(error).max()))


def _rms(error: Float[np.ndarray, " n"]) -> float:
    return float(np.sqrt(np.mean(error**2))) if error.size else math.nan

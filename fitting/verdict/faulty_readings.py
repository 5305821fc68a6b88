"""Faults of some readings only: a full load cell, outliers, and one length that is off."""

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.sentence import Quantity, Sentence

from ..data.force_data import ForceData
from ..search import NORMAL_MAD
from .trial import Trial, attempt, richest

Explanation = tuple[str, float]
"""What is wrong, and the misfit without it in parts of the largest force."""

_SHARED = 2e-3  # of the largest force: readings that stand at one limit, and its noise
_FEWEST_SHARED, _MOST_SHARED = 3, 0.5  # readings at a limit, and part of all
_LESS = 2.0  # times the misfit below the limit: a pull that contradicts a full load cell
_PULLED_LESS = 0.25  # of them at most do: the fit of the others reaches far beyond its readings
_OUTLYING = 5.0  # robust standard deviations
_MOST = 0.25  # of the readings may be outliers
_OF_A_LENGTH = 0.6  # of the readings of one length are no outliers
_ROUNDS = 6
_TRIED = 50  # offsets of a length
_OFFSET = 0.06  # of the rest length
ONE_MUSCLE = 3
"""Fewest lengths that show a muscle."""

_PER_LENGTH = 5  # readings


def kept_only(data: ForceData, kept: Bool[np.ndarray, " loaded"]) -> ForceData:
    """The map with some of its loaded readings only."""
    rows = np.ones(data.force.size, bool)
    rows[data.loaded] = kept
    return data.part(rows)


def errors_of(trial: Trial, data: ForceData) -> Float[np.ndarray, " loaded"]:
    """Of a fit to some readings, at all loaded ones [N]; infinite where it has no force."""
    loaded = data.loaded
    found = trial.predict(data.length[loaded], data.pressure[loaded]) - data.force[loaded]
    return np.where(np.isfinite(found), found, np.inf)


def at_a_limit(data: ForceData) -> Explanation | None:
    """Readings that share the largest force, where a fit of the others pulls harder: a full load cell."""
    force = data.force[data.loaded]
    limit = float(force.max())
    full = force >= (1 - _SHARED) * limit
    if not _FEWEST_SHARED <= full.sum() <= _MOST_SHARED * full.size:
        return None
    trial = attempt(kept_only(data, ~full), richest(data))
    if trial is None:
        return None
    errors = errors_of(trial, data)
    misfit = float(np.sqrt(np.mean(errors[~full] ** 2))) / limit
    less = errors[full] < -_LESS * max(misfit, _SHARED) * limit
    if less.mean() > _PULLED_LESS:
        return None
    return (
        Sentence(
            f"the load cell was full at {full.sum()} readings, which stand at ",
            Quantity(limit, "force"),
            f" (line # specimen: force_limit_N = {float(force[full].min()):.6g} says so)",
        ),
        misfit,
    )


def outliers(data: ForceData) -> Explanation | None:
    """A few readings far off, found by leaving the worst out and fitting again."""
    candidate, force = richest(data), data.force[data.loaded]
    kept, errors = force <= 20 * float(np.median(force)), np.zeros(force.size)
    if kept.sum() < 3:
        return None
    for _ in range(_ROUNDS):
        trial = attempt(kept_only(data, kept), candidate)
        if trial is None:
            return None
        errors = errors_of(trial, data)
        scale = max(NORMAL_MAD * float(np.median(np.abs(errors))), 2e-3 * float(force[kept].max()))
        found = np.abs(errors) <= _OUTLYING * scale
        if (found == kept).all():
            break
        if found.sum() < (1 - _MOST) * kept.size:
            return None
        kept = found
    count = int((~kept).sum())
    if not 0 < count <= _MOST * kept.size:
        return None
    _, place = levels_in(data)
    share = np.bincount(place, ~kept) / np.bincount(place)
    if (share[np.bincount(place, ~kept) > 2] > _OF_A_LENGTH).any():
        return None  # it is the length that is off
    rows = np.flatnonzero(data.loaded)[~kept] + 1
    shown = ", ".join(str(row) for row in rows[:6]) + (", ..." if count > 6 else "")
    misfit = float(np.sqrt(np.mean(errors[kept] ** 2))) / float(force[kept].max())
    are, them = ("reading is an outlier", "it") if count == 1 else ("readings are outliers", "them")
    return f"{count} {are} (number {shown}; --objective huber counts {them} little)", misfit


def levels_in(data: ForceData) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " loaded"]]:
    """The loaded lengths, and the number of each reading's."""
    return np.unique(data.lengths.level[data.loaded], return_inverse=True)


def one_length_off(data: ForceData) -> Explanation | None:
    """One length that is not what it says: without it the others fit, and moved it fits, too."""
    lengths, place = levels_in(data)
    if lengths.size < ONE_MUSCLE + 1:
        return None
    best: Explanation | None = None
    pressure, force = data.pressure[data.loaded], data.force[data.loaded]
    reach = _OFFSET * data.specimen.rest_length
    moved = np.linspace(-reach, reach, 2 * _TRIED + 1)
    for number, one in enumerate(lengths):
        mine = place == number
        trial = attempt(thinned(kept_only(data, ~mine)), starts=2)
        if trial is None:
            continue
        at = trial.predict(
            np.repeat(one + moved, mine.sum()), np.tile(pressure[mine], moved.size)
        ).reshape(moved.size, -1)  # fmt: skip
        errors = np.sqrt(np.mean((at - force[mine]) ** 2, axis=1))
        if not np.isfinite(errors).any():
            continue
        offset, least = moved[int(np.nanargmin(errors))], float(np.nanmin(errors))
        others = errors_of(trial, data)[~mine]
        total = np.sum(others**2) + mine.sum() * least**2
        misfit = float(np.sqrt(total / mine.size)) / data.max_force
        if abs(offset) < reach and (best is None or misfit < best[1]):
            best = (
                Sentence(
                    "the length ",
                    Quantity(one, "length"),
                    " is ",
                    Quantity(one + offset, "length"),
                    ", off by a constant",
                ),
                misfit,
            )
    return best


def thinned(data: ForceData) -> ForceData:
    """The map with a few readings of each loaded length, spread over the pressures."""
    kept = np.zeros(data.force.size, bool)
    for one in np.unique(data.lengths.level[data.loaded]):
        mine = np.flatnonzero(data.loaded & (data.lengths.level == one))
        mine = mine[np.argsort(data.pressure[mine])]
        kept[mine[np.unique(np.linspace(0, mine.size - 1, _PER_LENGTH).astype(int))]] = True
    return data.part(kept)

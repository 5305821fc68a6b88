"""Faults of some readings only: outliers, one length that is off, two muscles in one file."""

import itertools

import numpy as np
from jaxtyping import Bool, Float, Int

from ..choice.ladder import Candidate
from ..choice.nested import without
from ..data.force_data import ForceData
from .trial import Trial, attempt

Told = tuple[str, float]
"""What is wrong, and the misfit without it in parts of the largest force."""

_OUTLYING = 5.0  # robust standard deviations
_MOST = 0.25  # of the readings may be outliers
_ROUNDS = 6
_GAUSS = 1.4826  # from the median of absolute errors to a standard deviation
_TRIED = 50  # offsets of a length
_OFFSET = 0.06  # of the rest length
_TRIPLES = 24  # lengths that are tried as those of one muscle
_ONE_MUSCLE = 3  # lengths at least
_BOUNDARIES = 12  # places in the file at which a second muscle may begin


def _kept(data: ForceData, kept: Bool[np.ndarray, " loaded"]) -> ForceData:
    """The map with some of its loaded readings only."""
    out = np.zeros(data.force.size, bool)
    out[np.flatnonzero(data.loaded)[~kept]] = True
    return without(data, out)


def _errors(trial: Trial, data: ForceData) -> Float[np.ndarray, " loaded"]:
    """Of a fit to some readings, at all loaded ones [N]; infinite where it has no force."""
    loaded = data.loaded
    found = trial.predict(data.length[loaded], data.pressure[loaded]) - data.force[loaded]
    return np.where(np.isfinite(found), found, np.inf)


def outliers(data: ForceData, candidate: Candidate | None) -> Told | None:
    """A few readings far off, found by leaving the worst out and fitting again."""
    force = data.force[data.loaded]
    kept, errors = force <= 20 * float(np.median(force)), np.zeros(force.size)
    if kept.sum() < 3:
        return None
    for _ in range(_ROUNDS):
        trial = attempt(_kept(data, kept), candidate)
        if trial is None:
            return None
        errors = _errors(trial, data)
        scale = max(_GAUSS * float(np.median(np.abs(errors))), 2e-3 * float(force[kept].max()))
        found = np.abs(errors) <= _OUTLYING * scale
        if (found == kept).all():
            break
        if found.sum() < (1 - _MOST) * kept.size:
            return None
        kept = found
    count = int((~kept).sum())
    if not 0 < count <= _MOST * kept.size:
        return None
    rows = np.flatnonzero(data.loaded)[~kept] + 1
    shown = ", ".join(str(row) for row in rows[:6]) + (", ..." if count > 6 else "")
    misfit = float(np.sqrt(np.mean(errors[kept] ** 2))) / float(force[kept].max())
    are, them = ("reading is an outlier", "it") if count == 1 else ("readings are outliers", "them")
    return f"{count} {are} (number {shown}; --objective huber counts {them} little)", misfit


def _level(data: ForceData) -> tuple[Float[np.ndarray, " k"], Int[np.ndarray, " loaded"]]:
    """The loaded lengths, and the number of each reading's."""
    return np.unique(data.lengths.level[data.loaded], return_inverse=True)


def one_length_off(data: ForceData) -> Told | None:
    """One length that is not what it says: without it the others fit, and moved it fits, too."""
    lengths, place = _level(data)
    if lengths.size < _ONE_MUSCLE + 1:
        return None
    best: Told | None = None
    pressure, force = data.pressure[data.loaded], data.force[data.loaded]
    reach = _OFFSET * data.specimen.rest_length
    moved = np.linspace(-reach, reach, 2 * _TRIED + 1)
    for number, one in enumerate(lengths):
        mine = place == number
        trial = attempt(_kept(data, ~mine))
        if trial is None:
            continue
        at = trial.predict(
            np.repeat(one + moved, mine.sum()), np.tile(pressure[mine], moved.size)
        ).reshape(moved.size, -1)  # fmt: skip
        errors = np.sqrt(np.mean((at - force[mine]) ** 2, axis=1))
        if not np.isfinite(errors).any():
            continue
        offset, least = moved[int(np.nanargmin(errors))], float(np.nanmin(errors))
        others = _errors(trial, data)[~mine]
        total = np.sum(others**2) + mine.sum() * least**2
        misfit = float(np.sqrt(total / mine.size)) / data.max_force
        if abs(offset) < reach and (best is None or misfit < best[1]):
            best = (
                f"the length {one * 1e3:.4g} mm is {(one + offset) * 1e3:.4g} mm, off by a constant",
                misfit,
            )
    return best


def two_muscles(data: ForceData) -> Told | None:
    """Two muscles in one file, one after the other or each at lengths of its own."""
    splits = [found for found in (_in_file(data), _by_length(data)) if found is not None]
    if not splits:
        return None
    first, misfit = min(splits, key=lambda one: one[1])
    rows = np.flatnonzero(data.loaded)
    lengths, place = _level(data)
    if np.intersect1d(place[first], place[~first]).size:
        second = rows[~first]
        where = f"the second from reading {second.min() + 1} on"
    else:
        where = " and ".join(
            ", ".join(f"{one * 1e3:.4g}" for one in lengths[np.unique(place[of])]) + " mm"
            for of in (first, ~first)
        )
    return f"there are two muscles in the file, {where}", misfit


def _split(
    data: ForceData, first: Bool[np.ndarray, " loaded"]
) -> Float[np.ndarray, "2 loaded"] | None:
    """Errors at all loaded readings [N] of the fits to the two halves of a map."""
    halves = []
    for mine in (first, ~first):
        trial = attempt(_kept(data, mine)) if _carries(data, mine) else None
        if trial is None:
            return None
        halves.append(_errors(trial, data))
    return np.stack(halves)


def _carries(data: ForceData, mine: Bool[np.ndarray, " loaded"]) -> bool:
    """Whether some readings are enough for a muscle."""
    level = data.lengths.level[data.loaded][mine]
    return np.unique(level).size >= _ONE_MUSCLE and level.size >= 2 * _ONE_MUSCLE


def _in_file(data: ForceData) -> tuple[Bool[np.ndarray, " loaded"], float] | None:
    """The file of one muscle after that of the other."""
    count = int(data.loaded.sum())
    places = np.unique(np.linspace(0, count, _BOUNDARIES + 2).astype(int)[1:-1])
    best, halves = np.inf, None
    for _ in range(2):
        for place in places:
            errors = _split(data, np.arange(count) < place)
            if errors is None:
                continue
            # where the sum of squares is least, if both halves are as these fits have them
            sums = np.nan_to_num(np.cumsum(errors**2, axis=1), posinf=1e30, nan=1e30)
            total = np.concatenate([[0.0], sums[0]]) + sums[1, -1]
            total -= np.concatenate([[0.0], sums[1]])
            at = int(np.argmin(total))
            own = np.where(np.arange(count) < place, errors[0], errors[1])
            misfit = float(np.sqrt(np.mean(own**2))) / data.max_force
            if misfit < best:
                best, halves = misfit, (np.arange(count) < place, at)
        if halves is None:
            return None
        places = np.unique([halves[1], *range(max(1, halves[1] - 1), halves[1] + 2)])
    assert halves is not None
    return halves[0], best


def _by_length(data: ForceData) -> tuple[Bool[np.ndarray, " loaded"], float] | None:
    """Lengths of one muscle, and those that it does not explain."""
    lengths, place = _level(data)
    if lengths.size < 2 * _ONE_MUSCLE:
        return None
    triples = list(itertools.combinations(range(lengths.size), _ONE_MUSCLE))
    chosen = np.linspace(0, len(triples) - 1, min(_TRIPLES, len(triples))).astype(int)
    best: tuple[Bool[np.ndarray, " loaded"], float] | None = None
    for triple in (triples[k] for k in chosen):
        trial = attempt(_kept(data, np.isin(place, triple)))
        if trial is None:
            continue
        size = np.bincount(place, np.minimum(_errors(trial, data) ** 2, 1e30))
        size = np.sqrt(size / np.bincount(place)) / data.max_force
        order = np.argsort(size)
        gap = (
            _ONE_MUSCLE - 1 + int(np.argmax(np.diff(np.log(size[order] + 1e-3))[_ONE_MUSCLE - 1 :]))
        )
        first = np.isin(place, order[: gap + 1])
        errors = _split(data, first)
        if errors is None:
            continue
        misfit = float(np.sqrt(np.mean(np.where(first, *errors) ** 2))) / data.max_force
        if best is None or misfit < best[1]:
            best = first, misfit
    return best

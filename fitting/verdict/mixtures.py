"""Faults of some readings only: outliers, one length that is off, two muscles in one file."""

import numpy as np
from jaxtyping import Bool

from famjax.boundary.errors import InputError

from ..choice.choose import fit_candidate, weigh
from ..choice.ladder import Candidate
from ..choice.nested import without
from ..data.force_data import ForceData

Told = tuple[str, float]
"""What is wrong, and the misfit without it in parts of the largest force."""

_OUTLYING = 5.0  # robust standard deviations
_MOST = 0.3  # of the readings may be outliers
_ROUNDS = 4
_GAUSS = 1.4826  # from the median of absolute errors to a standard deviation
_TRIED = 40  # offsets of a length
_OFFSET = 0.04  # of the rest length


def _errors(
    data: ForceData, candidate: Candidate, kept: Bool[np.ndarray, " n"]
) -> np.ndarray | None:
    """Errors [N] at all loaded readings of the fit to some of them; None without a fit."""
    loaded = np.flatnonzero(data.loaded)
    out = np.zeros(data.force.size, bool)
    out[loaded[~kept]] = True
    try:
        problem, end = fit_candidate(weigh(without(data, out)), candidate)
    except InputError:
        return None
    part = problem.parts[0]
    predicted = part.predict(
        end.point.parameters[part.at], end.point.x, data.length[loaded], data.pressure[loaded]
    )
    return predicted - data.force[loaded]


def outliers(data: ForceData, candidate: Candidate) -> Told | None:
    """A few readings far off, found by leaving the worst out and fitting again."""
    kept, errors = np.ones(int(data.loaded.sum()), bool), None
    force = data.force[data.loaded]
    for _ in range(_ROUNDS):
        errors = _errors(data, candidate, kept)
        if errors is None or not np.isfinite(errors).all():
            return None
        scale = max(_GAUSS * float(np.median(np.abs(errors))), 1e-3 * float(np.median(force)))
        found = np.abs(errors) <= _OUTLYING * scale
        if (found == kept).all():
            break
        kept = found
    count = int((~kept).sum())
    if errors is None or not 0 < count <= _MOST * kept.size:
        return None
    rows = np.flatnonzero(data.loaded)[~kept] + 1
    named = ", ".join(str(row) for row in rows[:6]) + (", ..." if count > 6 else "")
    misfit = float(np.sqrt(np.mean(errors[kept] ** 2))) / float(force[kept].max())
    return (
        f"{count} of {kept.size} readings are outliers (readings {named}; --objective huber counts "
        "such readings little)",
        misfit,
    )


def one_length_off(data: ForceData, candidate: Candidate) -> Told | None:
    """One length that is not what it says: without it the others fit, and moved it fits, too."""
    level = data.lengths.level[data.loaded]
    lengths = np.unique(level)
    if lengths.size < 3:
        return None
    best: Told | None = None
    for one in lengths:
        mine = level == one
        out = np.zeros(data.force.size, bool)
        out[np.flatnonzero(data.loaded)[mine]] = True
        try:
            problem, end = fit_candidate(weigh(without(data, out)), candidate)
        except InputError:
            continue
        part, loaded = problem.parts[0], data.loaded
        reach = _OFFSET * data.specimen.rest_length
        moved = np.linspace(-reach, reach, 2 * _TRIED + 1)
        force, pressure = data.force[loaded][mine], data.pressure[loaded][mine]
        at = part.predict(
            end.point.parameters[part.at], end.point.x,
            (one + moved[:, None] + 0 * pressure).ravel(),
            np.broadcast_to(pressure, (moved.size, pressure.size)).ravel(),
        ).reshape(moved.size, -1)  # fmt: skip
        errors = np.sqrt(np.nanmean((at - force) ** 2, axis=1))
        offset = moved[int(np.nanargmin(errors))]
        others = end.point.residual[: problem.force.size] / problem.weight
        total = np.concatenate([others, np.full(force.size, np.nanmin(errors))])
        misfit = float(np.sqrt(np.mean(total**2))) / data.max_force
        if best is None or misfit < best[1]:
            best = (
                f"the length {one * 1e3:.4g} mm is {(one + offset) * 1e3:.4g} mm, off by a constant",
                misfit,
            )
    return best


def two_muscles(data: ForceData, candidate: Candidate) -> Told | None:
    """Two muscles in one file: each length belongs to the one of two fits that predicts it better."""
    level = data.lengths.level[data.loaded]
    lengths, place = np.unique(level, return_inverse=True)
    if lengths.size < 4:
        return None
    errors = _errors(data, candidate, np.ones(level.size, bool))
    if errors is None:
        return None
    mean = np.bincount(place, errors) / np.bincount(place)
    first = mean > np.median(mean)
    misfit = np.inf
    for _ in range(_ROUNDS):
        one = _errors(data, candidate, first[place])
        other = _errors(data, candidate, ~first[place])
        if one is None or other is None:
            return None
        kept = np.where(first[place], one, other)
        misfit = float(np.sqrt(np.mean(kept**2))) / data.max_force
        again = _sizes(place, one) < _sizes(place, other)
        if (again == first).all() or not again.any() or again.all():
            break
        first = again
    named = " and ".join(
        ", ".join(f"{one * 1e3:.4g}" for one in lengths[chosen]) for chosen in (first, ~first)
    )
    return f"there are two muscles in the file, at the lengths {named} mm", misfit


def _sizes(place: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """Sums of squares of the errors by length; no force is the largest."""
    return np.bincount(place, np.nan_to_num(errors, nan=1e9) ** 2)

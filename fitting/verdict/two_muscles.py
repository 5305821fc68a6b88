"""Two muscles in one file: one file after the other, or some lengths of each."""

import dataclasses
import itertools

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.sentence import Quantity, Sentence

from ..data.force_data import ForceData
from .faulty_readings import ONE_MUSCLE, Explanation, errors_of, kept_only, levels_in, thinned
from .trial import Trial, attempt

_TRIED = 4  # divisions
_SCALED = 2  # lengths of a second muscle that is taken as the first, scaled in bore
_COMBINATIONS = 400

Mask = Bool[np.ndarray, " loaded"]


def two_muscles(data: ForceData) -> Explanation | None:
    """The division of the readings between two muscles that leaves the least misfit.

    The specimen is one of them. Of the other neither bore nor rest length is known: it is taken as
    one of any bore whose rest length is the longest of its lengths, or as the first one scaled.
    """
    best: tuple[Mask, float] | None = None
    for first in [*_in_file(data), *_by_length(data)][: 2 * _TRIED]:
        misfit = _misfit(data, first)
        if misfit is not None and (best is None or misfit < best[1]):
            best = first, misfit
    if best is None:
        return None
    first, misfit = best
    lengths, place = levels_in(data)
    if np.intersect1d(place[first], place[~first]).size:
        number = int(np.flatnonzero(data.loaded)[~first].min()) + 1
        where = [f"the second of them at reading {number}"]
    else:
        where = [
            *("one at ", *_listed(lengths[np.unique(place[first])])),
            *(" and one at ", *_listed(lengths[np.unique(place[~first])])),
        ]
    return Sentence("there are two muscles in the file, ", *where), misfit


def _listed(lengths: Float[np.ndarray, " k"]) -> list[str | Quantity]:
    parts: list[str | Quantity] = []
    for one in lengths:
        parts += [", " if parts else "", Quantity(one, "length")]
    return parts


def _misfit(data: ForceData, first: Mask) -> float | None:
    """RMSE of both fits in parts of the largest force; None where one cannot be made."""
    force, found = data.force[data.loaded], []
    for own, other in ((first, ~first), (~first, first)):
        trial = _fitted(data, own, as_specimen=True)
        if trial is None:
            continue
        errors = errors_of(trial, data)
        predicted = (errors + force)[other]
        scaled = np.full(force.size, np.inf)
        if np.isfinite(predicted).all() and _lengths_of(data, other) >= _SCALED:
            scale = float(predicted @ force[other]) / float(predicted @ predicted)
            scaled[other] = scale * predicted - force[other]
        foreign = _fitted(data, other, as_specimen=False)
        seconds = [scaled] if foreign is None else [scaled, errors_of(foreign, data)]
        found += [float(np.mean(np.where(own, errors, one) ** 2)) for one in seconds]
    least = min(found, default=np.inf)
    return float(np.sqrt(least)) / data.max_force if np.isfinite(least) else None


def _lengths_of(data: ForceData, mine: Mask) -> int:
    return np.unique(levels_in(data)[1][mine]).size


def _fitted(data: ForceData, mine: Mask, *, as_specimen: bool) -> Trial | None:
    """The fit of some readings as those of the specimen, or of a muscle that is not described."""
    if _lengths_of(data, mine) < ONE_MUSCLE:
        return None
    part = thinned(kept_only(data, mine))
    if as_specimen:
        return attempt(part, starts=2)
    try:
        specimen = dataclasses.replace(
            part.specimen, nominal_diameter=None, bladder_diameter=None, embedded=True,
            rest_length=float(part.length.max()),
        )  # fmt: skip
        return attempt(dataclasses.replace(part, specimen=specimen), starts=2)
    except InputError:
        return None


def _in_file(data: ForceData) -> list[Mask]:
    """Divisions where the slower of pressure and length turns back, as where a file begins anew."""
    loaded = data.loaded
    columns = data.lengths.level[loaded], data.pressures.level[loaded]
    slow = min(columns, key=lambda one: int((np.diff(one) != 0).sum()))
    changes = np.flatnonzero(np.diff(slow) != 0) + 1
    steps = np.sign(slow[changes] - slow[changes - 1])
    turns = changes[1:][steps[1:] != steps[:-1]]
    number = np.arange(slow.size)
    return [number < turn for turn in turns[:_TRIED]]


def _by_length(data: ForceData) -> list[Mask]:
    """Divisions of the lengths between two muscles, the likeliest first.

    The slope of the force of an inextensible braid in pressure, (3 L^2 - B^2)/(4 pi N^2), is a
    straight line in L^2 for each muscle.
    """
    lengths, place = levels_in(data)
    pressure, force = data.pressure[data.loaded], data.force[data.loaded]
    slopes = np.array(
        [_slope(pressure[place == k], force[place == k]) for k in range(lengths.size)]
    )
    known = np.flatnonzero(np.isfinite(slopes))
    if known.size < ONE_MUSCLE + _SCALED:
        return []
    found: dict[tuple[int, ...], float] = {}
    squares = (lengths / lengths.max()) ** 2
    for count in range(_SCALED, known.size // 2 + 1):
        for second in itertools.islice(
            itertools.combinations(known.tolist(), count), _COMBINATIONS
        ):
            first = np.setdiff1d(known, second)
            off = _off_line(squares[first], slopes[first])
            if count == _SCALED:
                line = np.polyval(np.polyfit(squares[first], slopes[first], 1), squares[[*second]])
                own = slopes[[*second]]
                off += float(np.sum((line * (line @ own) / (line @ line) - own) ** 2))
            else:
                off += _off_line(squares[[*second]], slopes[[*second]])
            found[second] = off / (known.size - 4 + (count == _SCALED))
    likely = sorted(found, key=lambda one: found[one])[:_TRIED]
    return [~np.isin(place, one) for one in likely]


def _slope(pressure: Float[np.ndarray, " k"], force: Float[np.ndarray, " k"]) -> float:
    if np.unique(pressure).size < 2:
        return np.nan
    return float(np.polyfit(pressure, force, 1)[0])


def _off_line(x: Float[np.ndarray, " k"], y: Float[np.ndarray, " k"]) -> float:
    """Sum of squares about the straight line."""
    return float(np.sum((np.polyval(np.polyfit(x, y, 1), x) - y) ** 2))

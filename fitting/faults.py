"""What in a force map would explain a misfit: the same fit of data as they would be without a fault.

A fault is a mistake, and what the map would be without it: another unit, gauge pressures, another rest
length. Each is undone and fitted again, and a change that makes the misfit several times smaller is
named. Faults of some readings only, a full load cell and outliers, are found by fits of the others.
"""

import dataclasses
import itertools
import math
from collections.abc import Callable, Iterable, Iterator
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS, Quantity, Sentence

from .choice import weigh
from .data import ForceData
from .engine import predict
from .ladder import Candidate, as_cylinder, ladder
from .problem import Problem
from .race import descended, posed_of
from .result import Identification
from .search import NORMAL_MAD, End

ATMOSPHERE = 101.3e3
"""Pressure of the air [Pa]."""

THICK = 0.3
"""Part of the bore: a wall above it leaves no room for a bladder that strains."""

# Misfits, in parts of the largest force
GOOD = 0.02  # of a muscle by a good model
_DOUBTFUL = 0.01  # what a good fit of a good map is below
_MIXED = 0.013  # what is to be explained by faults of some readings
_UNEXPLAINED = 0.03  # the richest family misses no muscle's map by so much
_TOLERATED = 0.04  # of data that were far worse
_SCALED = 0.05  # likewise, where the misfit was five times as large
_PROMISING = 0.08  # of a few readings, from which all of them are fitted

_FAR_BETTER = 3.0  # factor by which a change of the data must lower the misfit to be named
_AS_LIKELY = 2.0  # times the least misfit: the first of these changes
_AT_BOUND = 1e-6  # of the width of the interval

_ABSOLUTE = 0.85  # of an atmosphere: no reading is below it where pressures are absolute
_AS_GOOD = 1.2  # a deadband takes up most of an atmosphere, a compliance the rest
_RICH_LAW = "cubic"  # takes up most of what a wrong pressure does
_RISE = 0.05  # of the force at a length, between pressures as far apart as this:
_APART = 1.3
# Loss of force per contraction, in parts of it: a muscle's is 3 to 10.
_STEEP, _DOUBTFULLY_STEEP = 40.0, 30.0
_PUSH = 0.03  # of the largest force: no slack muscle pushes so hard
_RESTS = {1.0: 0.0, 0.98: 0.3, 1.03: 0.3}  # of the longest loaded length, and how unlikely
_SAME_REST = 0.01

_SHARED = 2e-3  # of the largest force: readings that stand at one limit, and its noise
_FEWEST_SHARED, _MOST_SHARED = 3, 0.5  # readings at a limit, and part of all
_LESS = 2.0  # times the misfit below the limit: a pull that contradicts a full load cell
_PULLED_LESS = 0.25  # of them at most do: the fit of the others reaches far beyond its readings
_OUTLYING = 5.0  # robust standard deviations
_MOST_OUTLIERS = 0.25  # of the readings
_OF_A_LENGTH = 0.6  # of the readings of one length are no outliers
_ROUNDS = 6
_PER_LENGTH = 5  # readings that are spread over the pressures
_FEWEST_LENGTHS = 3  # that show a muscle
_DIVISIONS = 4  # between two muscles that are tried
_DIVIDED = 400  # groups of lengths of one size that are looked at

_USUAL = 5e5  # Pa, the highest pressure of most tests of pneumatic muscles
_ALIKE = 0.5  # decades of pressure or of misfit: taken as equal
_NOT_SAID = 0.35  # decades that a unit which the file does not name counts
_CORNERED = 0.3  # decades that a geometry at its bounds counts

_COMMON = {
    "force": (("kgf", "N"), ("lbf", "N"), ("kN", "N"), ("kgf", "lbf")),
    "pressure": (("MPa", "kPa"), ("kPa", "Pa"), ("psi", "kPa"), ("bar", "kPa"), ("bar", "psi"),
                 ("MPa", "bar"), ("MPa", "psi")),
}  # fmt: skip
"""Units that are taken for one another, either way round, before they are written into a file."""
_BORES = {
    2.0: "the nominal diameter is a radius, or that of a smaller muscle",
    0.5: "the nominal diameter is that of a larger muscle",
    10.0: "the nominal diameter is in cm, not mm",
    0.1: "the nominal diameter is ten times too large",
}
_SWAPS = ((1e-3, 1e3), (1 / 1550.0, 1550.0), (1e-5, 1e5), (1e-6, 1e6))
"""N in the place of kPa and the reverse, lbf and psi, N and bar, N and MPa."""


@dataclasses.dataclass(frozen=True)
class Suspicion:
    """A fault in the data that would explain the misfit.

    Attributes:
        cause: what it is, in a few words.
        sentence: for a reader, with the figures.
        misfit: with the fault undone, in parts of the largest force.
        grave: nothing is identified from such data; otherwise it is a doubt.
    """

    cause: str
    sentence: str
    misfit: float
    grave: bool = True


@dataclasses.dataclass(frozen=True)
class Trial:
    """A fit that was tried.

    Attributes:
        data: the map.
        problem, end: of the fit.
    """

    data: ForceData
    problem: Problem
    end: End

    def predict(
        self, length: Float[np.ndarray, " k"], pressure: Float[np.ndarray, " k"]
    ) -> Float[np.ndarray, " k"]:
        """Force [N] at lengths [m] and gauge pressures [Pa]; nan where there is none."""
        point = self.end.point
        return predict(self.problem, 0, point.parameters, point.x, length, pressure)

    def errors(self, data: ForceData) -> Float[np.ndarray, " loaded"]:
        """At the loaded readings of a map [N]; infinite where there is no force."""
        loaded = data.loaded
        found = self.predict(data.length[loaded], data.pressure[loaded]) - data.force[loaded]
        return np.where(np.isfinite(found), found, np.inf)

    @property
    def misfit(self) -> float:
        """RMSE over the loaded readings in parts of the largest force, with `_censored_misses`."""
        data = self.data
        missed = _censored_misses(data, self.predict(data.length, data.pressure))
        squares = np.sum(self.errors(data) ** 2) + np.nansum(missed**2)
        return float(np.sqrt(squares / data.loaded.sum())) / data.max_force

    def side(self, name: str) -> int:
        """-1 where a parameter is at its lower bound, 1 at its upper one, 0 between or without it."""
        if name not in self.problem.names:
            return 0
        place = self.problem.names.index(name)
        low, high = float(self.problem.low[place]), float(self.problem.high[place])
        at = (float(self.end.point.parameters[place]) - low) / (high - low) if high > low else 0.5
        return int(at > 1 - _AT_BOUND) - int(at < _AT_BOUND)

    @property
    def late(self) -> bool:
        """Whether the deadband is at its highest bound."""
        return self.side("deadband_pressure") > 0

    @property
    def corner(self) -> int:
        """Of braid diameter and angle: 1 where both are as large as may be, -1 as small, else 0."""
        sides = self.side("braid_diameter"), self.side("braid_angle")
        return sides[0] if sides[0] == sides[1] else 0


def attempt(
    data: ForceData, candidate: Candidate | None = None, *, starts: int = 4
) -> Trial | None:
    """The quick fit of a family to a map; of the richest one that it can carry, unless given.

    Returns:
        None where there is no fit.
    """
    try:
        chosen = candidate or richest(data)
        if chosen is None:
            return None
        posed = posed_of(weigh(data), chosen, "drucker")
        return Trial(data, posed.problem, descended(posed, starts, seed=0))
    except InputError:
        return None


def richest(data: ForceData, law: str | None = None) -> Candidate | None:
    """The family of a law, the ladder's first unless given, with a deadband; None without one."""
    candidates, _ = ladder(data)
    return next((one for one in candidates if not one.rig and law in (None, one.law)), None)


def plainest(data: ForceData) -> Candidate | None:
    """The first family of the ladder as a cylinder of stiff threads; None without one."""
    first = richest(data)
    return None if first is None else as_cylinder(first, data)


def _censored_misses(data: ForceData, force: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """How far [N] a model's force is from what a censored reading says of it, 0 at the others.

    A slack reading says that there is no pull, a saturated one that it is no less than the limit of the
    load cell. Where there is no force, nothing is contradicted.
    """
    pull, lack = np.fmax(force, 0.0), np.fmin(force - data.force, 0.0)
    return np.where(data.slack, pull, np.where(data.saturated, lack, 0.0))


def least_misfit(result: Identification) -> float:
    """RMSE in parts of the largest force, with what contradicts censored readings.

    Outliers of Huber's objective are not counted.
    """
    kept, missed = result.counted, _censored_misses(result.data, result.model_force())
    squares = np.sum(result.residuals[kept] ** 2) + np.sum(missed**2)
    return float(np.sqrt(squares / kept.sum())) / result.errors.max_force


def doubtful(result: Identification) -> bool:
    """Whether a fit is so poor, or so far at its bounds, that its data are to be questioned."""
    data, trial = result.data, Trial(result.data, result.problem, result.end)
    return (
        not result.converged
        or not least_misfit(result) <= _DOUBTFUL
        or trial.late
        or trial.corner != 0
        or bool(thick_wall(data))
        or float(data.force.min()) < -_DOUBTFUL * data.max_force
        or _steepness(data) > _DOUBTFULLY_STEEP
        or pulls_late(data)
    )


def suspect(
    result: Identification, progress: Callable[[int, int], None] | None = None
) -> tuple[Suspicion, ...]:
    """The faults of a force map that would explain its misfit, the likeliest first.

    Args:
        result: a fit of the map.
        progress: called with (changes tried, changes).

    Returns:
        At most three.
    """
    data, asked = _kept_only(result.data, result.counted), Trial(
        result.data, result.problem, result.end
    )  # fmt: skip
    no_rise = _no_rise(data)
    plain = [*no_rise, *thick_wall(data)]
    if no_rise:
        return tuple(plain)  # whatever else may be wrong does not show
    candidate = richest(data)
    here = attempt(data, candidate)
    least = min(least_misfit(result), np.inf if here is None else here.misfit)
    cornered = here is None or here.corner != 0 or (asked.corner != 0 and least > _DOUBTFUL)
    found = [] if plain else _explained(_signs(data, here), least, candidate)
    found += absolute(data, here, least, candidate, stopped=asked.late)
    found += _explained(_fractions(data), least)
    for asked_for, faults, family, most in (
        (least > _DOUBTFUL, _rest_lengths(data, grave=least > _UNEXPLAINED), None, 1),
        (least >= _TOLERATED, _swapped(data), candidate, 1),
        (least > GOOD or cornered, _scales(data, cornered=cornered), candidate, 3),
    ):
        if asked_for and not found:
            found = _explained(faults, least, family, most, progress)
    if not found and not plain and least > _MIXED:
        found = _of_some(data, least)
    if not found and not plain and least > _UNEXPLAINED:
        found.append(
            Suspicion(
                "no muscle explains the readings",
                f"No model of a muscle explains these readings: the richest misses them by "
                f"{least:.2%} of the largest force. Check units, signs and columns, the specimen's rest "
                "length, bore and wall, and that readings of a slack muscle are 0.",
                least,
            )
        )
    return tuple([*plain, *found][:3])


def suspect_refused(data: ForceData) -> tuple[Suspicion, ...]:
    """The likeliest mistake in a map to which no model can be fitted at all; none that explains it.

    Args:
        data: the map.
    """
    return tuple(_explained([*_lengths(data), *_swapped(data)], math.inf))


@dataclasses.dataclass(frozen=True)
class Fault:
    """A mistake that changed a whole column, or the specimen.

    Attributes:
        cause: what it is, a clause.
        undone: the map without it; raises InputError where there is none.
        explains: from the fit without it, and the misfit with it, whether it explains the misfit.
        unlikely: decades; only what is about as likely as the likeliest is named.
        grave: as of a `Suspicion`.
        thin: whether a few readings are fitted first, and all where these promise something.
    """

    cause: str
    undone: Callable[[], ForceData]
    explains: Callable[[Trial, float], bool] = lambda trial, _: trial.misfit < _TOLERATED
    unlikely: float = 0.0
    grave: bool = True
    thin: bool = False


def _explained(
    faults: Iterable[Fault],
    least: float,
    candidate: Candidate | None = None,
    most: int = 1,
    progress: Callable[[int, int], None] | None = None,
) -> list[Suspicion]:
    """The faults that explain a misfit, the likeliest first.

    Where the misfit does not separate them, how likely they are does.

    Args:
        faults: to be tried.
        least: the least misfit of the map as it is.
        candidate: the family; the richest that the map without the fault can carry unless given.
        most: named, of those that are about as likely as the first.
        progress: called with (changes tried, changes).
    """
    tried: list[tuple[float, float, Suspicion]] = []
    faults = [*faults]
    for done, fault in enumerate(faults):
        if progress is not None:
            progress(done, len(faults))
        then = _without(fault, candidate)
        if then is not None and fault.explains(then, least):
            # Misfits of a hundredth and less say no more.
            size = math.log10(max(then.misfit / _DOUBTFUL, 1.0))
            score = fault.unlikely + size + _CORNERED * abs(then.corner)
            named = _named(fault.cause, least, then.misfit, grave=fault.grave)
            tried.append((score, then.misfit, named))
    tried.sort(key=lambda one: one[:2])
    return [one for score, _, one in tried if score < tried[0][0] + _ALIKE][:most]


def _without(fault: Fault, candidate: Candidate | None) -> Trial | None:
    """The fit of the map without a fault."""
    try:
        data = fault.undone()
    except InputError:
        return None
    if fault.thin:
        few = attempt(thinned(data), candidate, starts=2)
        if few is None or few.misfit >= _PROMISING:
            return few
    return attempt(data, candidate)


def _named(
    cause: str, here: float, better: float, of: str = "", *, grave: bool = True
) -> Suspicion:
    """The suspicion of a cause, from the misfits with it and without it."""
    stands = f"it is {100 * here:.2g} %" if math.isfinite(here) else "no muscle has a force there"
    sentence = Sentence(
        *("The data look wrong. It seems that ", cause),
        f": read so, the misfit{of} is {100 * better:.2g} % of the largest force; as the file stands, "
        f"{stands}.",
    )
    return Suspicion(cause, sentence, better, grave)


def _changed(data: ForceData, **changes: Any) -> Callable[[], ForceData]:
    if "force" in changes:
        changes["slack_below"] = None
    return lambda: dataclasses.replace(data, **changes)


def _with_specimen(data: ForceData, **sizes: float) -> Callable[[], ForceData]:
    return lambda: dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, **sizes))


def _signs(data: ForceData, here: Trial | None) -> Iterator[Fault]:
    """Readings of pulls that are negative.

    A slack muscle that is held at both ends pushes against a load cell as its rubber does. Where the fit
    has no pull either, the other sign has to fit as well as what stands in the file.
    """
    negative = data.force < -_PUSH * data.max_force
    if not negative.any():
        return
    pull = np.inf if here is None else here.predict(data.length[negative], data.pressure[negative])
    pulls, n = not np.all(np.asarray(pull) <= 0), int(negative.sum())
    yield Fault(
        Sentence(
            f"forces have the wrong sign ({n} reading{' is' if n == 1 else 's are'} negative by up to ",
            *(Quantity(-float(data.force.min()), "force"), ", and a muscle does not push)"),
        ),
        _changed(data, force=np.where(negative, -data.force, data.force)),
        lambda then, least: (
            then.misfit < _TOLERATED
            and (then.misfit < 1.5 * least or (pulls and then.misfit < GOOD))
        ),
    )


def _fractions(data: ForceData) -> Iterator[Fault]:
    """Contractions that are a hundred times too small for what the force loses by them."""
    rest = data.specimen.rest_length
    if _steepness(data) >= _STEEP:
        length = rest * (1 - 100 * (1 - data.length / rest))
        changed = _changed(data, length=length, length_std=None)
        yield Fault("the contractions are fractions, not percent", changed)


def _rest_lengths(data: ForceData, *, grave: bool) -> Iterator[Fault]:
    """A rest length that is not the muscle's: it is beside the longest loaded length."""
    given, longest = data.specimen.rest_length, float(data.length[data.loaded].max())
    for part, unlikely in _RESTS.items():
        rest = part * longest
        if abs(rest / given - 1) >= _SAME_REST:
            ends = Quantity(rest, "length", 3), " or so, not ", Quantity(given, "length")
            yield Fault(
                Sentence("the rest length is ", *ends),
                _with_specimen(data, rest_length=rest),
                lambda then, least: then.misfit < min(GOOD, least / _FAR_BETTER),
                unlikely, grave,
            )  # fmt: skip


def _lengths(data: ForceData) -> Iterator[Fault]:
    """Lengths in another unit than the specimen's rest length."""
    said = data.units.get("length", "mm")
    for true in ("m", "cm", "mm", "in"):
        factor = UNITS["length"][true] / UNITS["length"][said]
        if true != said and data.length.max() * factor <= 1.05 * data.specimen.rest_length:
            yield Fault(
                f"the lengths were in {true.replace('in', 'inches')}, not {said}",
                _changed(data, length=data.length * factor, length_std=None),
                lambda then, _: then.misfit < GOOD,
            )


def _swapped(data: ForceData) -> Iterator[Fault]:
    """Force and pressure in each other's column."""
    for to_force, to_pressure in _SWAPS:
        yield Fault(
            "the columns of force and pressure are swapped",
            _changed(
                data, force=data.pressure * to_force,
                pressure=np.maximum(data.force, 0.0) * to_pressure, force_std=None,
                pressure_std=None, pressure_tolerance=None,
            ),
            lambda then, least: then.misfit < min(_TOLERATED, least / 5),
        )  # fmt: skip


def _scales(data: ForceData, *, cornered: bool) -> Iterator[Fault]:
    """Units of force and pressure, and the bore, all of which scale the force at a pressure.

    Where the misfit does not separate them, the pressure does, which is some bar in most tests.
    `cornered` says that a fit of the map as it is has both braid diameter and angle at bounds of more, or
    of less, force.
    """
    highest, most = float(data.pressure.max()), max(THICK, _wall_share(data))
    if not highest > 0:
        return

    def explains(then: Trial, least: float) -> bool:
        if _wall_share(then.data) > most:
            return False  # one fault is not explained by another
        far = then.misfit * _FAR_BETTER < least
        good = then.misfit < (_SCALED if least > 5 * then.misfit else GOOD)
        freed = cornered and then.corner == 0 and then.misfit < min(GOOD, 0.9 * least)
        return (far and good) or freed

    def unlikely(highest: float) -> float:
        return abs(math.log10(highest / _USUAL))

    for what in _COMMON:
        for factor, (words, known) in _units_meant(data, what).items():
            then = highest * (factor if what == "pressure" else 1.0)
            yield Fault(
                f"the {what}s are {' (or '.join(words)}{')' * (len(words) - 1)}",
                _changed(data, **{what: getattr(data, what) * factor}),
                explains, unlikely(then) + (0.0 if known else _NOT_SAID), thin=True,
            )  # fmt: skip
    bore = data.specimen.nominal_diameter or 0.0
    for factor, cause in _BORES.items() if bore else ():
        undone = _with_specimen(data, nominal_diameter=bore * factor)
        yield Fault(cause, undone, explains, unlikely(highest), thin=True)


def _units_meant(data: ForceData, what: str) -> dict[float, tuple[list[str], bool]]:
    """By factor: units that may be meant and are said, and whether the file says the latter.

    Units that a file does not name are taken for one another before they are written into it.
    """
    units, said = UNITS[what], data.units.get(what)
    named = [] if said is None else [(true, said) for true in units if true != said]
    common = [pair for one in _COMMON[what] for pair in (one, one[::-1])]
    found: dict[float, tuple[list[str], bool]] = {}
    for pairs, own in ((named, True), (common, said is None)):
        for true, unit in pairs:
            factor = float(f"{units[true] / units[unit]:.6g}")
            words, known = found.setdefault(factor, ([], own))
            if known == own and f"in {true}, not {unit}" not in words:
                words.append(f"in {true}, not {unit}")
    return found


def _wall_share(data: ForceData) -> float:
    """The wall in parts of the bore, or of the bladder's outer diameter where there is no bore."""
    bore = data.specimen.nominal_diameter or data.specimen.bladder_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def thick_wall(data: ForceData) -> list[Suspicion]:
    """A wall that is a third of the bore; the force hardly depends on it, so no misfit shows it."""
    share, specimen = _wall_share(data), data.specimen
    if share <= THICK:
        return []
    key = "nominal_diameter" if specimen.nominal_diameter else "bladder_diameter"
    sentence = Sentence(
        *(
            "The wall of ",
            Quantity(specimen.wall_thickness, "length"),
            f" is {share:.0%} of {key}, ",
        ),
        *(Quantity(getattr(specimen, key), "length"), ", and leaves no room for a bladder that "),
        f"strains: one of the two is wrong; check wall_thickness and {key}, and their units.",
    )
    return [Suspicion("the wall is too thick, or the diameter too small", sentence, 0.0)]


def _no_rise(data: ForceData) -> list[Suspicion]:
    """Forces that do not rise with the pressure at any length."""
    rises = []
    for one in np.unique(data.lengths.level[data.loaded]):
        mine = np.flatnonzero(data.loaded & (data.lengths.level == one))
        mine = mine[np.argsort(data.pressure[mine])]
        pressure, force = data.pressure[mine], data.force[mine]
        if pressure[-1] > _APART * pressure[0]:
            rises.append((force[-1] - force[0]) / force.max())
    if not rises or max(rises) >= _RISE:
        return []
    sentence = (
        "The force does not rise with the pressure at any length: check which column is which, "
        "and that the force was recorded."
    )
    return [Suspicion("the force does not rise with the pressure", sentence, 0.0)]


def _steepness(data: ForceData) -> float:
    """Loss of force per contraction at the highest pressure of two lengths, in parts of the force."""
    pressure, loaded = data.pressures.level, data.loaded
    for one in np.unique(pressure[loaded])[::-1]:
        mine = loaded & (pressure == one)
        length, force = data.length[mine], data.force[mine]
        if np.unique(data.lengths.level[mine]).size > 1:
            slope = np.polyfit(length / data.specimen.rest_length, force, 1)[0]
            return float(slope) / float(force.max())
    return 0.0


def _may_be_absolute(data: ForceData) -> bool:
    """Whether no pressure is below an atmosphere, and there are two: one alone tells no deadband."""
    several = np.unique(data.pressures.level[data.loaded]).size > 1
    return several and bool(data.pressure.min() >= _ABSOLUTE * ATMOSPHERE)


def pulls_late(data: ForceData) -> bool:
    """Whether the pressures may be absolute: none is below an atmosphere, and all lengths pull late.

    A braid or a rig that gives way takes the place of a deadband in part, so that a fit with one of
    them need not be at a bound. With neither, the deadband alone makes a muscle pull late.
    """
    if not _may_be_absolute(data):
        return False
    trial = attempt(data, plainest(data), starts=2)
    return trial is not None and trial.late


def absolute(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None, *, stopped: bool
) -> list[Suspicion]:
    """Absolute pressures: none is below an atmosphere, and the deadband takes up most of it.

    `stopped` says that the deadband of the fit in question is at its highest bound.
    """
    if not _may_be_absolute(data):
        return []
    undone = _changed(data, pressure=np.maximum(data.pressure - ATMOSPHERE, 0.0))

    def fault(most: float) -> Fault:
        return Fault(
            "the pressures are absolute, not gauge", undone,
            lambda then, _: then.misfit < min(_TOLERATED, most) and not then.late,
        )  # fmt: skip

    if stopped or here is None or here.late:
        for family in (candidate, richest(data, _RICH_LAW)):
            found = _explained([fault(max(_AS_GOOD * least, _DOUBTFUL))], least, family)
            if found:
                return found
    rigid = plainest(data)
    stands = attempt(data, rigid)
    if stands is None or not stands.late:
        return []
    found = _explained([fault(stands.misfit / _AS_GOOD)], stands.misfit, rigid)
    of = " of a muscle whose braid and rig do not give way"
    return [_named(one.cause, stands.misfit, one.misfit, of) for one in found]


def _of_some(data: ForceData, least: float) -> list[Suspicion]:
    """Faults of some readings: the first that makes the misfit about as good as the other does."""
    good = [
        one
        for one in (_at_a_limit(data), _outliers(data), _two_muscles(data))
        if one is not None and one[1] < GOOD and one[1] * _FAR_BETTER < least
    ]
    best = min((better for _, better in good), default=np.inf)
    likely = [one for one in good if one[1] <= _AS_LIKELY * max(best, 1e-3)]
    return [_named(cause, least, better) for cause, better in likely[:1]]


def _kept_only(data: ForceData, kept: Bool[np.ndarray, " loaded"]) -> ForceData:
    """The map with some of its loaded readings only."""
    rows = np.ones(data.force.size, bool)
    rows[data.loaded] = kept
    return data.part(rows)


def thinned(data: ForceData) -> ForceData:
    """The map with a few readings of each loaded length, spread over the pressures."""
    kept = np.zeros(data.force.size, bool)
    for one in np.unique(data.lengths.level[data.loaded]):
        mine = np.flatnonzero(data.loaded & (data.lengths.level == one))
        mine = mine[np.argsort(data.pressure[mine])]
        kept[mine[np.unique(np.linspace(0, mine.size - 1, _PER_LENGTH).astype(int))]] = True
    return data.part(kept)


def _at_a_limit(data: ForceData) -> tuple[str, float] | None:
    """Readings that share the largest force, where a fit of the others pulls harder: a full load cell."""
    force = data.force[data.loaded]
    limit = float(force.max())
    full = force >= (1 - _SHARED) * limit
    if not _FEWEST_SHARED <= full.sum() <= _MOST_SHARED * full.size:
        return None
    trial = attempt(_kept_only(data, ~full), richest(data))
    if trial is None:
        return None
    errors = trial.errors(data)
    misfit = float(np.sqrt(np.mean(errors[~full] ** 2))) / limit
    if np.mean(errors[full] < -_LESS * max(misfit, _SHARED) * limit) > _PULLED_LESS:
        return None
    cause = Sentence(
        f"the load cell was full at {full.sum()} readings, which stand at ",
        Quantity(limit, "force"),
        f" (line # specimen: force_limit_N = {float(force[full].min()):.6g} says so)",
    )
    return cause, misfit


def _outliers(data: ForceData) -> tuple[str, float] | None:
    """A few readings far off, found by leaving the worst out and fitting again."""
    candidate, force = richest(data), data.force[data.loaded]
    kept, errors = force <= 20 * float(np.median(force)), np.zeros(force.size)
    if kept.sum() < 3:
        return None
    for _ in range(_ROUNDS):
        trial = attempt(_kept_only(data, kept), candidate)
        if trial is None:
            return None
        errors = trial.errors(data)
        scale = max(NORMAL_MAD * float(np.median(np.abs(errors))), 2e-3 * float(force[kept].max()))
        found = np.abs(errors) <= _OUTLYING * scale
        if (found == kept).all():
            break
        if found.sum() < (1 - _MOST_OUTLIERS) * kept.size:
            return None
        kept = found
    count = int((~kept).sum())
    if not 0 < count <= _MOST_OUTLIERS * kept.size:
        return None
    place = np.unique(data.lengths.level[data.loaded], return_inverse=True)[1]
    off = np.bincount(place, ~kept)
    if ((off > 2) & (off > _OF_A_LENGTH * np.bincount(place))).any():
        return None  # it is the length that is off
    rows = np.flatnonzero(data.loaded)[~kept] + 1
    shown = ", ".join(str(row) for row in rows[:6]) + (", ..." if count > 6 else "")
    misfit = float(np.sqrt(np.mean(errors[kept] ** 2))) / float(force[kept].max())
    are, them = ("reading is an outlier", "it") if count == 1 else ("readings are outliers", "them")
    return f"{count} {are} (number {shown}; --objective huber counts {them} little)", misfit


def _two_muscles(data: ForceData) -> tuple[str, float] | None:
    """Readings of another muscle: from a place in the file on, or at some of the lengths.

    The specimen is one of the two. The other has any bore, and the longest of its lengths for its rest
    length; at some of the lengths it pulls in proportion to the specimen.
    """
    force, found = data.force[data.loaded], []
    for where, other, proportional in (*_in_file(data), *_by_length(data)):
        trial = attempt(thinned(_kept_only(data, ~other)), starts=2)
        if trial is None:
            continue
        errors = trial.errors(data)
        if proportional:
            pull = (errors + force)[other]
            errors[other] = pull * float(pull @ force[other]) / float(pull @ pull) - force[other]
        else:
            part = thinned(_kept_only(data, other))
            sizes = {"rest_length": float(part.length.max()), "nominal_diameter": None}
            sizes |= {"bladder_diameter": None, "embedded": True}
            specimen = dataclasses.replace(part.specimen, **sizes)
            second = attempt(dataclasses.replace(part, specimen=specimen), starts=2)
            if second is None:
                continue
            errors[other] = second.errors(data)[other]
        misfit = float(np.sqrt(np.mean(errors**2))) / data.max_force
        if np.isfinite(misfit):
            found.append(
                (misfit, Sentence("there are two muscles in the file, one of them ", *where))
            )
    return min(((cause, misfit) for misfit, cause in found), key=lambda one: one[1], default=None)


_Division = tuple[list[Any], Bool[np.ndarray, " loaded"], bool]
"""Where the other muscle is, in words; its readings; whether it pulls in proportion to the first."""


def _in_file(data: ForceData) -> Iterator[_Division]:
    """Divisions where the slower of pressure and length turns back, as where a file begins anew."""
    columns = data.lengths.level[data.loaded], data.pressures.level[data.loaded]
    slow = min(columns, key=lambda one: int((np.diff(one) != 0).sum()))
    changes = np.flatnonzero(np.diff(slow) != 0) + 1
    steps = np.sign(slow[changes] - slow[changes - 1])
    for turn in changes[1:][steps[1:] != steps[:-1]][:_DIVISIONS]:
        before = np.arange(slow.size) < turn
        row = int(np.flatnonzero(data.loaded)[turn]) + 1
        for words, other in (
            (f"up to reading {row - 1}", before),
            (f"from reading {row} on", ~before),
        ):
            if min(np.unique(columns[0][part]).size for part in (other, ~other)) >= _FEWEST_LENGTHS:
                yield [words], other, False


def _by_length(data: ForceData) -> Iterator[_Division]:
    """Divisions of the lengths, the likeliest first.

    The slope of a muscle's force in pressure, (3 L^2 - B^2)/(4 pi N^2), is a straight line in L^2.
    """
    lengths, place = np.unique(data.lengths.level[data.loaded], return_inverse=True)
    pressure, force = data.pressure[data.loaded], data.force[data.loaded]
    if min(np.unique(pressure[place == k]).size for k in range(lengths.size)) < 2:
        return
    slope = np.array(
        [np.polyfit(pressure[place == k], force[place == k], 1)[0] for k in range(lengths.size)]
    )
    tried = []
    for count in range(2, min(lengths.size // 2, lengths.size - _FEWEST_LENGTHS) + 1):
        for some in itertools.islice(itertools.combinations(range(lengths.size), count), _DIVIDED):
            rest = np.setdiff1d(np.arange(lengths.size), some)
            line = np.polyval(np.polyfit(lengths[rest] ** 2, slope[rest], 1), lengths**2)
            own = line[[*some]]
            line[[*some]] *= (own @ slope[[*some]]) / (own @ own)
            tried.append((float(np.sum((line - slope) ** 2)), some))
    for _, some in sorted(tried)[:_DIVISIONS]:
        words: list[Any] = ["at "]
        for one in some:
            words += [Quantity(float(lengths[one]), "length"), ", "]
        yield words[:-1], np.isin(place, some), True

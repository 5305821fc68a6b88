"""What in a force map would explain a misfit: the same fit of data as they would be without a fault.

A fault is a mistake, and what the map would be without it: another unit, gauge pressures, another rest
length. Each is undone and fitted again, and a change that makes the misfit several times smaller is
named. Faults of some readings only, a full load cell and outliers, are found by fits of the others.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS, Quantity, Sentence

from .choice import weigh
from .data import ForceData
from .descent import End
from .engine import predict
from .ladder import Candidate, as_cylinder, ladder
from .problem import Problem
from .race import descended, posed_of
from .result import Identification
from .search import NORMAL_MAD

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
_COUNTED = 0.25  # of its weight: a reading that counts less lies 5 standard deviations off
_AT_BOUND = 1e-6  # of the width of the interval

_ABSOLUTE = 0.85  # of an atmosphere: no reading is below it where pressures are absolute
_AS_GOOD = 1.2  # a deadband takes up most of an atmosphere, a compliance the rest
_RICH_LAW = "cubic"  # takes up most of what a wrong pressure does
_RISE = 0.05  # of the force at a length, between pressures as far apart as this:
_APART = 1.3
# Loss of force per contraction, in parts of it: a muscle's is 3 to 10.
_STEEP, _DOUBTFULLY_STEEP = 40.0, 30.0
_PUSH = 0.03  # of the largest force: no slack muscle pushes so hard
_RESTS = (1.0, 0.98, 1.03)  # of the longest loaded length, at which most tests begin
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
class Fault:
    """A mistake that changed a whole column, or the specimen.

    Attributes:
        cause: what it is, a clause.
        undone: the map without it; raises InputError where there is none.
        below: misfit that the map must then have.
        factor: by which its misfit must then fall.
        unlikely: decades; only what is about as likely as the likeliest is named.
    """

    cause: str
    undone: Callable[[], ForceData]
    below: float = _TOLERATED
    factor: float = 0.0
    unlikely: float = 0.0


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
        """-1 where a parameter is at its lower bound, 1 at its upper one, 0 between."""
        place = list(self.problem.names).index(name)
        low, high = float(self.problem.low[place]), float(self.problem.high[place])
        at = (float(self.end.point.parameters[place]) - low) / (high - low) if high > low else 0.5
        return int(at > 1 - _AT_BOUND) - int(at < _AT_BOUND)

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
        problem = posed_of(weigh(data), chosen, "drucker").problem
        return Trial(data, problem, descended(problem, starts, seed=0))
    except InputError:
        return None


def _misfit(data: ForceData, candidate: Candidate | None = None) -> float:
    found = attempt(data, candidate)
    return np.inf if found is None else found.misfit


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


def counted(result: Identification) -> Bool[np.ndarray, " readings"]:
    """The loaded readings that are no outliers of Huber's objective; all of them without it."""
    return result.weights >= _COUNTED


def least_misfit(result: Identification) -> float:
    """RMSE in parts of the largest force, with what contradicts censored readings.

    Outliers of Huber's objective are not counted.
    """
    data, kept = result.data, counted(result)
    missed = _censored_misses(data, result.model_force())
    squares = np.sum(result.residuals[kept] ** 2) + np.sum(missed**2)
    return float(np.sqrt(squares / kept.sum())) / result.errors.max_force


def _sides(result: Identification) -> dict[str, int]:
    """1 of a parameter at its upper bound, -1 at its lower one, 0 between."""
    return {
        e.name: 0 if not e.at_bound else 1 if e.max - e.value < e.value - e.min else -1
        for e in result.estimates
    }


def _stopped_above(result: Identification) -> bool:
    return _sides(result).get("deadband_pressure") == 1


def _in_corner(result: Identification) -> bool:
    """Whether braid diameter and angle are both at the bounds of more, or of less, force."""
    sides = _sides(result)
    return abs(sides.get("braid_diameter", 0) + sides.get("braid_angle", 0)) == 2


def doubtful(result: Identification) -> bool:
    """Whether a fit is so poor, or so far at its bounds, that its data are to be questioned."""
    data = result.data
    return (
        not result.converged
        or not least_misfit(result) <= _DOUBTFUL
        or _stopped_above(result)
        or _in_corner(result)
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
    data = _kept_only(result.data, counted(result))
    no_rise = _no_rise(data)
    plain = [*no_rise, *thick_wall(data)]
    if no_rise:
        return tuple(plain)  # whatever else may be wrong does not show
    candidate = richest(data)
    here = attempt(data, candidate)
    least = min(least_misfit(result), np.inf if here is None else here.misfit)
    found = [] if plain else _wrong_signs(data, here, least, candidate)
    found += absolute(data, here, least, candidate, stopped=_stopped_above(result))
    found += _first_named(_fractions(data), least)
    if not found and least > _DOUBTFUL:
        found += _first_named(_rest_lengths(data), least, grave=least > _UNEXPLAINED)
    if not found and least >= _TOLERATED:
        found += _first_named(_swapped(data), least, candidate)
    cornered = here is None or here.corner != 0 or (_in_corner(result) and least > _DOUBTFUL)
    if not found and (least > GOOD or cornered):
        found += _wrong_scales(data, least, candidate, progress, cornered=cornered)
    if not found and not plain and least > _MIXED:
        found += _of_some(data, least)
    if not found and not plain and least > _UNEXPLAINED:
        found.append(
            Suspicion(
                "no muscle explains the readings",
                f"No model of a muscle explains these readings: the richest misses them by "
                f"{least:.2%} of the largest force. Check units, signs and columns, and the "
                "specimen's rest length, bore and wall.",
                least,
            )
        )
    return tuple([*plain, *found][:3])


def _named(cause: str, here: float, better: float, *, grave: bool = True) -> Suspicion:
    """The suspicion of a cause, from the misfits with it and without it."""
    sentence = Sentence(
        "The data look wrong. It seems that ",
        cause,
        f": read so, the misfit is {100 * better:.2g} % of the largest force; as the file stands, it is "
        f"{100 * here:.2g} %.",
    )
    return Suspicion(cause, sentence, better, grave)


def _undone(
    fault: Fault, candidate: Candidate | None, few: Callable[[ForceData], ForceData] | None = None
) -> Trial | None:
    """The fit of the map without a fault; of a few of its readings by two starts."""
    try:
        data = fault.undone()
    except InputError:
        return None
    return attempt(data, candidate) if few is None else attempt(few(data), candidate, starts=2)


def _first_named(
    faults: Iterable[Fault], least: float, candidate: Candidate | None = None, *, grave: bool = True
) -> list[Suspicion]:
    """The first fault that explains about as much as the one that explains most, if it is enough."""
    tried = [(fault, _undone(fault, candidate)) for fault in faults]
    misfits = [(fault, trial.misfit) for fault, trial in tried if trial is not None]
    best = min((misfit for _, misfit in misfits), default=np.inf)
    for fault, misfit in misfits:
        if misfit <= _AS_LIKELY * best:
            enough = misfit < fault.below and misfit * fault.factor < least
            return [_named(fault.cause, least, misfit, grave=grave)] if enough else []
    return []


def _fractions(data: ForceData) -> Iterator[Fault]:
    """Contractions that are a hundred times too small for what the force loses by them."""
    rest = data.specimen.rest_length
    if _steepness(data) >= _STEEP:
        length = rest * (1 - 100 * (1 - data.length / rest))
        yield Fault(
            "the contractions are fractions, not percent",
            lambda: dataclasses.replace(data, length=length, length_std=None),
        )


def _rest_lengths(data: ForceData) -> Iterator[Fault]:
    """A rest length that is not the muscle's: it is beside the longest loaded length."""
    given = data.specimen.rest_length
    for rest in float(data.length[data.loaded].max()) * np.array(_RESTS):
        if abs(rest / given - 1) >= _SAME_REST:
            yield Fault(
                Sentence(
                    *("the rest length is ", Quantity(rest, "length", 3)),
                    *(" or so, not ", Quantity(given, "length")),
                ),
                lambda rest=float(rest): _with_specimen(data, rest_length=rest),
                below=GOOD,
                factor=_FAR_BETTER,
            )


def _swapped(data: ForceData) -> Iterator[Fault]:
    """Force and pressure in each other's column, N with kPa or lbf with psi."""
    for to_force, to_pressure in ((1e-3, 1e3), (1 / 1550.0, 1550.0), (1e-5, 1e5), (1e-6, 1e6)):
        yield Fault(
            "the columns of force and pressure are swapped",
            lambda to_force=to_force, to_pressure=to_pressure: dataclasses.replace(
                data, force=data.pressure * to_force,
                pressure=np.maximum(data.force, 0.0) * to_pressure, force_std=None,
                pressure_std=None, pressure_tolerance=None,
            ),
            factor=5.0,
        )  # fmt: skip


def _scales(data: ForceData) -> Iterator[Fault]:
    """Units of force and pressure, and the bore, all of which scale the force at a pressure."""
    highest = float(data.pressure.max())
    for what in _COMMON:
        for factor, (words, known) in _units_meant(data, what).items():
            then = highest * (factor if what == "pressure" else 1.0)
            yield Fault(
                f"the {what}s are {' (or '.join(words)}{')' * (len(words) - 1)}",
                lambda what=what, factor=factor: dataclasses.replace(
                    data, **{what: getattr(data, what) * factor}
                ),
                unlikely=abs(math.log10(then / _USUAL)) + (0.0 if known else _NOT_SAID),
            )
    bore = data.specimen.nominal_diameter or 0.0
    for factor, cause in _BORES.items() if bore else ():
        yield Fault(
            cause,
            lambda factor=factor: _with_specimen(data, nominal_diameter=bore * factor),
            unlikely=abs(math.log10(highest / _USUAL)),
        )


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


def _wrong_scales(
    data: ForceData,
    least: float,
    candidate: Candidate | None,
    progress: Callable[[int, int], None] | None,
    *,
    cornered: bool,
) -> list[Suspicion]:
    """Units and sizes of which another would explain the readings far better, the likeliest first.

    Where the misfit does not separate them, the pressure does, which is some bar in most tests.

    Args:
        data: the map.
        least: the least misfit of the map as it is.
        candidate: the family.
        progress: called with (changes tried, changes).
        cornered: a fit of the map as it is has both braid diameter and angle at bounds of more, or
            of less, force.
    """
    if not np.any(data.pressure > 0):
        return []
    tried: list[tuple[float, float, Suspicion]] = []
    faults, most = [*_scales(data)], max(THICK, _wall_share(data))
    for done, fault in enumerate(faults):
        if progress is not None:
            progress(done, len(faults))
        then = _undone(fault, candidate, thinned)
        if then is None or _wall_share(then.data) > most:
            continue  # one fault is not explained by another
        if then.misfit < _PROMISING:
            then = _undone(fault, candidate)
        if then is None:
            continue
        far = then.misfit * _FAR_BETTER < least
        good = then.misfit < (_SCALED if least > 5 * then.misfit else GOOD)
        freed = cornered and then.corner == 0 and then.misfit < min(GOOD, 0.9 * least)
        if (far and good) or freed:
            # Misfits of a hundredth and less say no more.
            size = math.log10(max(then.misfit / _DOUBTFUL, 1.0))
            score = fault.unlikely + size + _CORNERED * abs(then.corner)
            tried.append((score, then.misfit, _named(fault.cause, least, then.misfit)))
    tried.sort(key=lambda one: one[:2])
    return [one for score, _, one in tried if score < tried[0][0] + _ALIKE][:3]


def _with_specimen(data: ForceData, **sizes: float) -> ForceData:
    return dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, **sizes))


def _wall_share(data: ForceData) -> float:
    """The wall in parts of the bore, or of the bladder's outer diameter where there is no bore."""
    bore = data.specimen.nominal_diameter or data.specimen.bladder_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def thick_wall(data: ForceData) -> list[Suspicion]:
    """A wall that is a third of the bore; the force hardly depends on it, so no misfit shows it."""
    share, specimen = _wall_share(data), data.specimen
    if share <= THICK:
        return []
    what, key = "the bore", "nominal_diameter"
    if not specimen.nominal_diameter:
        what, key = "the bladder", "bladder_diameter"
    sentence = Sentence(
        *("The wall of ", Quantity(specimen.wall_thickness, "length")),
        *(f" is {share:.0%} of {what} of ", Quantity(getattr(specimen, key), "length")),
        ", and leaves no room for a bladder that strains: one of the two is wrong; check "
        f"wall_thickness and {key}, and their units.",
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


def _wrong_signs(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None
) -> list[Suspicion]:
    """Readings of pulls that are negative.

    A slack muscle that is held at both ends pushes against a load cell as its rubber does. Where the fit
    has no pull either, the other sign has to fit as well as what stands in the file.
    """
    negative = data.force < -_PUSH * data.max_force
    if not negative.any():
        return []
    n = int(negative.sum())
    pull = np.inf if here is None else here.predict(data.length[negative], data.pressure[negative])
    pulls = not np.all(np.asarray(pull) <= 0)
    force = np.where(negative, -data.force, data.force)
    better = _misfit(dataclasses.replace(data, force=force), candidate)
    if not (better < _TOLERATED and (better < 1.5 * least or (pulls and better < GOOD))):
        return []
    sentence = Sentence(
        f"{n} reading{' is' if n == 1 else 's are'} negative by up to ",
        Quantity(-float(data.force.min()), "force"),
        ", and a muscle does not push: with the sign of a pull they fit, with a misfit of "
        f"{better:.2%} of the largest force in all. Check the sign of the force.",
    )
    return [Suspicion("forces have the wrong sign", sentence, better)]


def _may_be_absolute(data: ForceData) -> bool:
    """Whether no pressure is below an atmosphere, and there are two: one alone tells no deadband."""
    several = np.unique(data.pressures.level[data.loaded]).size > 1
    return several and bool(data.pressure.min() >= _ABSOLUTE * ATMOSPHERE)


def pulls_late(data: ForceData) -> bool:
    """Whether the pressures may be absolute: none is below an atmosphere, and all lengths pull late.

    A braid or a rig that gives way takes the place of a deadband in part, so that a fit with one of
    them need not be at a bound. With neither, the deadband alone makes a muscle pull late.
    """
    return _may_be_absolute(data) and _late(attempt(data, plainest(data), starts=2))


def _late(trial: Trial | None) -> bool:
    return trial is not None and trial.side("deadband_pressure") > 0


def absolute(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None, *, stopped: bool
) -> list[Suspicion]:
    """Absolute pressures: none is below an atmosphere, and the deadband takes up most of it.

    `stopped` says that the deadband of the fit in question is at its highest bound.
    """
    if not _may_be_absolute(data):
        return []
    cause = "the pressures are absolute, not gauge"
    gauge = dataclasses.replace(data, pressure=np.maximum(data.pressure - ATMOSPHERE, 0.0))

    def as_gauge(family: Candidate | None) -> float:
        then = attempt(gauge, family)
        return np.inf if then is None or _late(then) else then.misfit

    if stopped or here is None or _late(here):
        for family in (candidate, richest(data, _RICH_LAW)):
            better = as_gauge(family)
            if better < _TOLERATED and better < max(_AS_GOOD * least, _DOUBTFUL):
                return [_named(cause, least, better)]
    rigid = plainest(data)
    as_it_stands = attempt(data, rigid)
    if rigid is None or as_it_stands is None or not _late(as_it_stands):
        return []
    better = as_gauge(rigid)
    if not (better < _TOLERATED and better * _AS_GOOD < as_it_stands.misfit):
        return []
    sentence = (
        f"The data look wrong. It seems that {cause}: none is below an atmosphere, and unless braid or "
        "rig give way the muscle pulls later than any deadband has it. With them rigid, the misfit is "
        f"{100 * better:.2g} % of the largest force if an atmosphere is taken off, and "
        f"{100 * as_it_stands.misfit:.2g} % as the file stands."
    )
    return [Suspicion(cause, sentence, better)]


def _of_some(data: ForceData, least: float) -> list[Suspicion]:
    """Faults of some readings: the first that makes the misfit about as good as the other does."""
    good = [
        one
        for one in (_at_a_limit(data), _outliers(data))
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

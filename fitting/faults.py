"""Find mistakes in a force map that would explain a poor fit.

Each candidate mistake (wrong unit, absolute pressures, wrong rest length) is undone and the map is fitted
again. A correction that makes the misfit several times smaller is reported. Faults that affect only some
readings, such as a saturated load cell or outliers, are found by fitting the other readings.
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

from .bands import Column
from .choice import weigh
from .data import ForceData
from .engine import predict
from .ladder import Candidate, as_cylinder, ladder
from .problem import Problem
from .race import descended, posed_of
from .result import Identification
from .search import NORMAL_MAD, End

ATMOSPHERE = 101.3e3
"""Atmospheric pressure [Pa]."""

THICK = 0.3
"""Ratio of wall to bore above which no space remains for a bladder that strains."""

# Misfits as fractions of the largest force
GOOD = 0.02  # highest misfit of a good model of a muscle
_DOUBTFUL = 0.01  # good fits of good maps stay below
_UNEXPLAINED = 0.03  # above what the most general family leaves on any muscle's map
_TOLERATED = 0.04  # accepted after a correction if the map was far worse before
_FAR_BETTER = 3.0  # factor by which a correction must reduce the misfit to be reported

_AS_GOOD = (
    1.2  # ratio of misfits; the deadband absorbs most of an atmosphere, a compliance the rest
)
_RESTS = {1.0: 0.0, 0.98: 0.3, 1.03: 0.3}
"""Candidate rest lengths, relative to the longest loaded length, and their penalty [decades]."""
_SHARED = 2e-3  # fraction of the largest force within which readings share one limit
_MOST_OUTLIERS = 0.25  # fraction of the readings
_FEWEST_LENGTHS = 3  # needed to characterise a muscle
_DIVISIONS = 4  # splits into two muscles that are tried

_COMMON = {
    "force": (("kgf", "N"), ("lbf", "N"), ("kN", "N"), ("kgf", "lbf")),
    "pressure": (("MPa", "kPa"), ("kPa", "Pa"), ("psi", "kPa"), ("bar", "kPa"), ("bar", "psi"),
                 ("MPa", "bar"), ("MPa", "psi")),
}  # fmt: skip
"""Units often confused with each other, in either direction, when no unit is written in the file."""
_BORES = {
    2.0: "the nominal diameter is a radius, or that of a smaller muscle",
    0.5: "the nominal diameter is that of a larger muscle",
    10.0: "the nominal diameter is in cm, not mm",
    0.1: "the nominal diameter is ten times too large",
}
_SWAPS = ((1e-3, 1e3), (1 / 1550.0, 1550.0), (1e-5, 1e5), (1e-6, 1e6))
"""Factors to force and pressure if the columns were N and kPa, lbf and psi, N and bar, or N and MPa."""


@dataclasses.dataclass(frozen=True)
class Suspicion:
    """A fault in the data that would explain the misfit.

    Attributes:
        cause: short description.
        sentence: message with the figures.
        misfit: misfit after the correction, as a fraction of the largest force.
        grave: if true, nothing can be identified from such data; otherwise the fit is doubtful.
    """

    cause: str
    sentence: str
    misfit: float
    grave: bool = True


@dataclasses.dataclass(frozen=True)
class Trial:
    """One trial fit of a map."""

    data: ForceData
    problem: Problem
    end: End

    def predict(self, length: Column, pressure: Column) -> Column:
        """Force [N] at lengths [m] and gauge pressures [Pa]; nan where there is none."""
        point = self.end.point
        return predict(self.problem, 0, point.parameters, point.x, length, pressure)

    def errors(self, data: ForceData) -> Float[np.ndarray, " loaded"]:
        """Residuals [N] at the loaded readings of a map; infinite where the model has no force."""
        loaded = data.loaded
        found = self.predict(data.length[loaded], data.pressure[loaded]) - data.force[loaded]
        return np.where(np.isfinite(found), found, np.inf)

    @property
    def misfit(self) -> float:
        """RMSE of loaded and contradicted censored readings, as a fraction of the largest force."""
        data = self.data
        missed = _censored_misses(data, self.predict(data.length, data.pressure))
        squares = np.sum(self.errors(data) ** 2) + np.nansum(missed**2)
        return float(np.sqrt(squares / data.loaded.sum())) / data.max_force

    def side(self, name: str) -> int:
        """Return -1 at the lower bound, 1 at the upper bound, and 0 between them or if not a parameter."""
        if name not in self.problem.names:
            return 0
        place = self.problem.names.index(name)
        low, high = self.problem.low[place], self.problem.high[place]
        at = (self.end.point.parameters[place] - low) / (high - low) if high > low else 0.5
        return int(at > 1 - 1e-6) - int(at < 1e-6)

    @property
    def late(self) -> bool:
        """True if the deadband is at its upper bound."""
        return self.side("deadband_pressure") > 0

    @property
    def corner(self) -> int:
        """Return 1 or -1 if braid diameter and angle are both at upper or both at lower bounds, else 0."""
        sides = self.side("braid_diameter"), self.side("braid_angle")
        return sides[0] if sides[0] == sides[1] else 0


def attempt(
    data: ForceData, candidate: Candidate | None = None, *, starts: int = 4
) -> Trial | None:
    """Fit a family quickly to a map, by default the most general one that the map supports.

    Returns:
        The trial, or None if no fit is possible.
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
    """First family of the ladder with a rigid rig (and this law, if given); None if there is none."""
    candidates, _ = ladder(data)
    return next((one for one in candidates if not one.rig and law in (None, one.law)), None)


def plainest(data: ForceData) -> Candidate | None:
    """First family of the ladder as a cylinder with stiff threads; None if there is none."""
    first = richest(data)
    return None if first is None else as_cylinder(first, data)


def _censored_misses(data: ForceData, force: Column) -> Column:
    """Force [N] by which a model contradicts censored readings; 0 at the other readings.

    A slack reading allows no pull; a saturated one allows no force below the limit of the load cell.
    States without a model force contradict nothing.
    """
    pull, lack = np.fmax(force, 0.0), np.fmin(force - data.force, 0.0)
    return np.where(data.slack, pull, np.where(data.saturated, lack, 0.0))


def least_misfit(result: Identification) -> float:
    """RMSE including contradicted censored readings, as a fraction of the largest force.

    Outliers of the Huber objective are excluded.
    """
    data, kept = result.data, result.counted
    missed = _censored_misses(data, result.predict(data.length, data.pressure))
    squares = np.sum(result.residuals[kept] ** 2) + np.sum(missed**2)
    return float(np.sqrt(squares / kept.sum())) / result.errors.max_force


def doubtful(result: Identification) -> bool:
    """True if the misfit is so large, or the fit so close to its bounds, that the data are suspect."""
    data, trial = result.data, Trial(result.data, result.problem, result.end)
    return (
        not result.converged
        or not least_misfit(result) <= _DOUBTFUL
        or trial.late
        or trial.corner != 0
        or bool(thick_wall(data))
        or float(data.force.min()) < -_DOUBTFUL * data.max_force
        or _steepness(data) > 30.0
        or pulls_late(data)
    )


def suspect(
    result: Identification, progress: Callable[[int, int], None] | None = None
) -> tuple[Suspicion, ...]:
    """Find faults in a force map that would explain its misfit, most likely first.

    Args:
        result: a fit of the map.
        progress: called with (corrections tried, total).

    Returns:
        At most three suspicions.
    """
    data = _kept_only(result.data, result.counted)
    asked = Trial(result.data, result.problem, result.end)
    no_rise = _no_rise(data)
    plain = [*no_rise, *thick_wall(data)]
    if no_rise:
        return tuple(plain)  # other faults cannot be detected
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
    if not found and not plain and least > 0.013:
        found = _of_some(data, least)
    if not found and not plain and least > _UNEXPLAINED:
        sentence = (
            f"No muscle model explains these readings: the most general one misses them by {least:.2%} of "
            "the largest force. Check units, signs and columns, the rest length, bore and wall of the "
            "specimen, and that readings of a slack muscle are 0."
        )
        found.append(Suspicion("no muscle explains the readings", sentence, least))
    return tuple([*plain, *found][:3])


def suspect_refused(data: ForceData) -> tuple[Suspicion, ...]:
    """Find the most likely mistake in a map to which no model can be fitted; empty if none is found."""
    return tuple(_explained([*_lengths(data), *_swapped(data)], math.inf))


@dataclasses.dataclass(frozen=True)
class Fault:
    """A mistake in a whole column or in the specimen.

    Attributes:
        cause: description as a clause.
        undone: returns the corrected map, or raises InputError.
        explains: decides from the corrected fit and the original misfit if the fault explains the latter.
        unlikely: penalty in decades; only faults about as likely as the best one are reported.
        grave: see `Suspicion`.
        thin: if true, try a few readings first and fit all only if these look promising.
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
    """Return the faults that explain a misfit, most likely first.

    Args:
        faults: candidates.
        least: smallest misfit of the map as given.
        candidate: family to fit; by default the most general one that each corrected map supports.
        most: maximum number to report, among those about as likely as the first.
        progress: called with (corrections tried, total).
    """
    tried: list[tuple[float, float, Suspicion]] = []
    faults = [*faults]
    for done, fault in enumerate(faults):
        if progress is not None:
            progress(done, len(faults))
        try:
            data = fault.undone()
        except InputError:
            continue
        if fault.thin:
            few = attempt(thinned(data), candidate, starts=2)
            if few is None or few.misfit >= 0.08:
                continue
        then = attempt(data, candidate)
        if then is not None and fault.explains(then, least):
            # Misfits below a hundredth are not compared.
            size = math.log10(max(then.misfit / _DOUBTFUL, 1.0))
            score = fault.unlikely + size + 0.3 * abs(then.corner)
            named = _named(fault.cause, least, then.misfit, grave=fault.grave)
            tried.append((score, then.misfit, named))
    tried.sort(key=lambda one: one[:2])
    return [one for score, _, one in tried if score < tried[0][0] + 0.5][:most]


def _named(
    cause: str, here: float, better: float, of: str = "", *, grave: bool = True
) -> Suspicion:
    before = f" instead of {100 * here:.2g} %"
    if not math.isfinite(here):
        before = "; as given, no muscle has a force there"
    sentence = Sentence(
        *("The data look wrong. It seems that ", cause),
        f". With this corrected, the misfit{of} is {100 * better:.2g} % of the largest force{before}.",
    )
    return Suspicion(cause, sentence, better, grave)


def _changed(data: ForceData, **changes: Any) -> Callable[[], ForceData]:
    if "force" in changes:
        changes["slack_below"] = None
    return lambda: dataclasses.replace(data, **changes)


def _with_specimen(data: ForceData, **sizes: float) -> Callable[[], ForceData]:
    return lambda: dataclasses.replace(data, specimen=dataclasses.replace(data.specimen, **sizes))


def _signs(data: ForceData, here: Trial | None) -> Iterator[Fault]:
    """Negative forces.

    A slack muscle held at both ends pushes lightly against a load cell. Where the model does not pull
    either, the reversed sign must fit about as well as the original.
    """
    negative = data.force < -0.03 * data.max_force  # no slack muscle pushes harder
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
    """Contractions given as fractions in place of percent, so that the force falls far too steeply."""
    rest = data.specimen.rest_length
    if _steepness(data) >= 40.0:
        length = rest * (1 - 100 * (1 - data.length / rest))
        changed = _changed(data, length=length, length_std=None)
        yield Fault("the contractions are fractions, not percent", changed)


def _rest_lengths(data: ForceData, *, grave: bool) -> Iterator[Fault]:
    """A wrong rest length; the right one is close to the longest loaded length."""
    given, longest = data.specimen.rest_length, float(data.length[data.loaded].max())
    for part, unlikely in _RESTS.items():
        rest = part * longest
        if abs(rest / given - 1) >= 0.01:
            ends = Quantity(rest, "length", 3), " approximately, not ", Quantity(given, "length")
            yield Fault(
                Sentence("the rest length is ", *ends),
                _with_specimen(data, rest_length=rest),
                lambda then, least: then.misfit < min(GOOD, least / _FAR_BETTER),
                unlikely, grave,
            )  # fmt: skip


def _lengths(data: ForceData) -> Iterator[Fault]:
    """Lengths in a unit different from that of the rest length."""
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
    """Swapped columns of force and pressure."""
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
    """Wrong units of force or pressure, or a wrong bore: each scales the force at a given pressure.

    If the misfit does not separate them, a typical test pressure of 5 bar does. `cornered` means that
    braid diameter and angle of the original fit are both at their upper or both at their lower bounds.
    """
    highest, most = float(data.pressure.max()), max(THICK, _wall_share(data))
    if not highest > 0:
        return

    def explains(then: Trial, least: float) -> bool:
        if _wall_share(then.data) > most:
            return False  # this would trade one fault for another
        far = then.misfit * _FAR_BETTER < least
        good = then.misfit < (0.05 if least > 5 * then.misfit else GOOD)
        freed = cornered and then.corner == 0 and then.misfit < min(GOOD, 0.9 * least)
        return (far and good) or freed

    def unlikely(highest: float) -> float:
        return abs(math.log10(highest / 5e5))

    for what in _COMMON:
        for factor, (words, known) in _units_meant(data, what).items():
            then = highest * (factor if what == "pressure" else 1.0)
            yield Fault(
                f"the {what}s are {' (or '.join(words)}{')' * (len(words) - 1)}",
                _changed(data, **{what: getattr(data, what) * factor}),
                explains, unlikely(then) + (0.0 if known else 0.35), thin=True,
            )  # fmt: skip
    bore = data.specimen.nominal_diameter or 0.0
    for factor, cause in _BORES.items() if bore else ():
        undone = _with_specimen(data, nominal_diameter=bore * factor)
        yield Fault(cause, undone, explains, unlikely(highest), thin=True)


def _units_meant(data: ForceData, what: str) -> dict[float, tuple[list[str], bool]]:
    """Map each conversion factor to its phrases, and to whether the file names the unit in use."""
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
    """Wall thickness over bore, or over the bladder's outer diameter if no bore is given."""
    bore = data.specimen.nominal_diameter or data.specimen.bladder_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def thick_wall(data: ForceData) -> list[Suspicion]:
    """A wall thicker than a third of the bore; the misfit hardly depends on it."""
    share, specimen = _wall_share(data), data.specimen
    if share <= THICK:
        return []
    key = "nominal_diameter" if specimen.nominal_diameter else "bladder_diameter"
    sentence = Sentence(
        *("The wall of ", Quantity(specimen.wall_thickness, "length")),
        *(f" is {share:.0%} of {key}, ", Quantity(getattr(specimen, key), "length")),
        f", and leaves no room for a bladder that strains: check wall_thickness, {key} and their units.",
    )
    return [Suspicion("the wall is too thick, or the diameter too small", sentence, 0.0)]


def _isometrics(data: ForceData) -> Iterator[np.ndarray]:
    """Loaded readings of each length, sorted by pressure."""
    for one in np.unique(data.lengths.level[data.loaded]):
        mine = np.flatnonzero(data.loaded & (data.lengths.level == one))
        yield mine[np.argsort(data.pressure[mine])]


def _no_rise(data: ForceData) -> list[Suspicion]:
    """Forces that do not rise with the pressure at any length."""
    rises = [
        (data.force[mine[-1]] - data.force[mine[0]]) / data.force[mine].max()
        for mine in _isometrics(data)
        if data.pressure[mine[-1]] > 1.3 * data.pressure[mine[0]]
    ]
    if not rises or max(rises) >= 0.05:
        return []
    cause = "the force does not rise with the pressure"
    sentence = f"{cause.capitalize()} at any length: check the columns, and that it was recorded."
    return [Suspicion(cause, sentence, 0.0)]


def _steepness(data: ForceData) -> float:
    """Relative loss of force per contraction at the highest pressure with two lengths; usually 3 to 10."""
    pressure, loaded = data.pressures.level, data.loaded
    for one in np.unique(pressure[loaded])[::-1]:
        mine = loaded & (pressure == one)
        length, force = data.length[mine], data.force[mine]
        if np.unique(data.lengths.level[mine]).size > 1:
            slope = np.polyfit(length / data.specimen.rest_length, force, 1)[0]
            return float(slope) / float(force.max())
    return 0.0


def _may_be_absolute(data: ForceData) -> bool:
    """True if all of at least two pressures exceed about one atmosphere; one cannot show a deadband."""
    several = np.unique(data.pressures.level[data.loaded]).size > 1
    return several and bool(data.pressure.min() >= 0.85 * ATMOSPHERE)


def pulls_late(data: ForceData) -> bool:
    """True if the pressures may be absolute and the deadband is as large as allowed at all lengths.

    A compliant braid or rig absorbs part of the deadband, so its fit need not reach the bound. The fit
    here has neither.
    """
    if not _may_be_absolute(data):
        return False
    trial = attempt(data, plainest(data), starts=2)
    return trial is not None and trial.late


def absolute(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None, *, stopped: bool
) -> list[Suspicion]:
    """Absolute pressures: all exceed an atmosphere, and the deadband absorbs most of it.

    `stopped` means that the deadband of the original fit is at its upper bound.
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
        # A cubic absorbs most of the effect of a wrong pressure.
        for family in (candidate, richest(data, "cubic")):
            found = _explained([fault(max(_AS_GOOD * least, _DOUBTFUL))], least, family)
            if found:
                return found
    rigid = plainest(data)
    stands = attempt(data, rigid)
    if stands is None or not stands.late:
        return []
    found = _explained([fault(stands.misfit / _AS_GOOD)], stands.misfit, rigid)
    of = " of a muscle with a stiff braid and rig"
    return [_named(one.cause, stands.misfit, one.misfit, of) for one in found]


def _of_some(data: ForceData, least: float) -> list[Suspicion]:
    """Faults that affect some readings: the first whose misfit is close to the smallest."""
    good = [
        one
        for one in (_at_a_limit(data), _outliers(data), _two_muscles(data))
        if one is not None and one[1] < GOOD and one[1] * _FAR_BETTER < least
    ]
    best = min((better for _, better in good), default=np.inf)
    likely = [one for one in good if one[1] <= 2.0 * max(best, 1e-3)]
    return [_named(cause, least, better) for cause, better in likely[:1]]


def _kept_only(data: ForceData, kept: Bool[np.ndarray, " loaded"]) -> ForceData:
    """Keep only some of the loaded readings."""
    rows = np.ones(data.force.size, bool)
    rows[data.loaded] = kept
    return data.part(rows)


def thinned(data: ForceData) -> ForceData:
    """Keep five readings at each loaded length, spread over the pressures."""
    kept = np.zeros(data.force.size, bool)
    for mine in _isometrics(data):
        kept[mine[np.unique(np.linspace(0, mine.size - 1, 5).astype(int))]] = True
    return data.part(kept)


def _at_a_limit(data: ForceData) -> tuple[str, float] | None:
    """Readings at the largest force that a fit of the others exceeds: a saturated load cell."""
    force = data.force[data.loaded]
    limit = float(force.max())
    full = force >= (1 - _SHARED) * limit
    if not 3 <= full.sum() <= 0.5 * full.size:
        return None
    trial = attempt(_kept_only(data, ~full), richest(data))
    if trial is None:
        return None
    errors = trial.errors(data)
    misfit = float(np.sqrt(np.mean(errors[~full] ** 2))) / limit
    if np.mean(errors[full] < -2.0 * max(misfit, _SHARED) * limit) > 0.25:
        return None
    cause = Sentence(
        f"the load cell was saturated at {full.sum()} readings of ",
        Quantity(limit, "force"),
        f" (mark them with the line # specimen: force_limit_N = {float(force[full].min()):.6g})",
    )
    return cause, misfit


def _outliers(data: ForceData) -> tuple[str, float] | None:
    """A few outliers, found by repeatedly excluding the worst readings and refitting."""
    candidate, force = richest(data), data.force[data.loaded]
    kept, errors = force <= 20 * float(np.median(force)), np.zeros(force.size)
    if kept.sum() < 3:
        return None
    for _ in range(6):
        trial = attempt(_kept_only(data, kept), candidate)
        if trial is None:
            return None
        errors = trial.errors(data)
        scale = max(NORMAL_MAD * float(np.median(np.abs(errors))), 2e-3 * float(force[kept].max()))
        found = np.abs(errors) <= 5.0 * scale
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
    if ((off > 2) & (off > 0.6 * np.bincount(place))).any():
        return None  # most readings of one length are off: the length itself is wrong
    rows = np.flatnonzero(data.loaded)[~kept] + 1
    shown = ", ".join(str(row) for row in rows[:6]) + (", ..." if count > 6 else "")
    misfit = float(np.sqrt(np.mean(errors[kept] ** 2))) / float(force[kept].max())
    are, them = ("reading is an outlier", "it") if count == 1 else ("readings are outliers", "them")
    return f"{count} {are} (number {shown}; --objective huber gives {them} little weight)", misfit


def _two_muscles(data: ForceData) -> tuple[str, float] | None:
    """Readings from a second muscle, either a contiguous part of the file or some of the lengths.

    One of the two is the specimen. The second may have any bore, and its longest length is its rest
    length; if it was measured at some of the lengths, its force is proportional to the specimen's.
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
            cause = Sentence("there are two muscles in the file, one of them ", *where)
            found.append((cause, misfit))
    return min(found, key=lambda one: one[1], default=None)


_Division = tuple[list[Any], Bool[np.ndarray, " loaded"], bool]
"""Location of the second muscle in words, its readings, and if its force is proportional to the first."""


def _in_file(data: ForceData) -> Iterator[_Division]:
    """Divide the file where the slower of pressure and length reverses, as if a new test began."""
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
    """Divide the lengths into two muscles, most likely first.

    For one muscle, dF/dP = (3 L^2 - B^2)/(4 pi N^2) is linear in L^2.
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
        for some in itertools.islice(itertools.combinations(range(lengths.size), count), 400):
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

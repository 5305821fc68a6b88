"""Find mistakes in a force map that would explain a poor fit.

Each candidate mistake (wrong unit, absolute pressures, wrong rest length) is corrected and the map is
fitted again. A correction that makes the misfit several times smaller is reported. Faults that affect only
some readings, such as a saturated load cell or outliers, are found by fitting the other readings.
"""

import dataclasses
import itertools
import math
from collections.abc import Iterable, Iterator, Mapping
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
"""Ratio of wall thickness to bore above which the bladder has no room to deform."""

# Misfits as fractions of the largest force
GOOD = 0.02  # highest misfit of a good model of a muscle
_DOUBTFUL = 0.01  # good fits of good maps stay below
_UNEXPLAINED = 0.03  # above what the most general family leaves on any muscle's map
_TOLERATED = 0.04  # accepted after a correction if the map was far worse before
_FAR_BETTER = 3.0  # factor by which a correction must reduce the misfit to be reported
# Ratio of misfits; the deadband absorbs most of an atmosphere, a compliance the rest.
_AS_GOOD = 1.2
_RESTS = {1.0: 0.0, 0.98: 0.3, 1.03: 0.3}
"""Candidate rest lengths, relative to the longest loaded length, and their penalty [decades]."""
_SHARED = 2e-3  # fraction of the largest force within which readings share one limit
_MOST_OUTLIERS = 0.25  # fraction of the readings
_DIVISIONS = 4  # divisions of the lengths between two muscles that are tried
_FEWEST_LENGTHS = 3  # needed to characterise a muscle
_BORES = {
    2.0: "the nominal diameter is a radius, or belongs to a smaller muscle",
    0.5: "the nominal diameter belongs to a larger muscle",
    10.0: "the nominal diameter is in cm, not mm",
    0.1: "the nominal diameter is ten times too large",
}


@dataclasses.dataclass(frozen=True)
class Suspicion:
    """A fault in the data that would explain the misfit.

    Attributes:
        cause: short description.
        sentence: message with the figures.
        misfit: misfit after the correction, as a fraction of the largest force.
        grave: if true, no muscle can be identified from the data; otherwise the fit is only doubtful.
    """

    cause: str
    sentence: str
    misfit: float
    grave: bool = True


@dataclasses.dataclass(frozen=True)
class Trial:
    """Trial fit of one family to a map."""

    data: ForceData
    problem: Problem
    end: End

    def predict(self, length: Column, pressure: Column) -> Column:
        """Predict the force [N] at lengths [m] and gauge pressures [Pa]; nan where undefined."""
        point = self.end.point
        return predict(self.problem, 0, point.parameters, point.x, length, pressure)

    def errors(self, data: ForceData) -> Float[np.ndarray, " loaded"]:
        """Return residuals [N] at a map's loaded readings; infinite where the model's force is nan."""
        loaded = data.loaded
        found = self.predict(data.length[loaded], data.pressure[loaded]) - data.force[loaded]
        return np.where(np.isfinite(found), found, np.inf)

    @property
    def misfit(self) -> float:
        """RMSE as a fraction of the largest force, including censored readings that the model contradicts.

        At a slack reading the model must not pull; at a saturated reading its force must not be below the
        limit of the load cell. Censored readings at which the model's force is nan are ignored.
        """
        data = self.data
        force = self.predict(data.length, data.pressure)
        pull, lack = np.fmax(force, 0.0), np.fmin(force - data.force, 0.0)
        missed = np.where(data.slack, pull, np.where(data.saturated, lack, 0.0))
        squares = np.sum(self.errors(data) ** 2) + np.nansum(missed**2)
        return float(np.sqrt(squares / data.loaded.sum())) / data.max_force

    def side(self, name: str) -> int:
        """Return -1 if the parameter is at its lower bound, 1 at its upper bound, and 0 otherwise."""
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
    def cornered(self) -> bool:
        """True if braid diameter and angle are both at their upper or both at their lower bounds."""
        sides = self.side("braid_diameter"), self.side("braid_angle")
        return sides[0] == sides[1] != 0


def attempt(data: ForceData, candidate: Candidate | None = None) -> Trial | None:
    """Fit a family quickly to a map; by default, the most general family that the map supports.

    Returns:
        The trial, or None if no fit is possible.
    """
    try:
        chosen = candidate or richest(data)
        if chosen is None:
            return None
        posed = posed_of(weigh(data), chosen, "drucker")
        return Trial(data, posed.problem, descended(posed, 4, seed=0))
    except InputError:
        return None


def richest(data: ForceData) -> Candidate | None:
    """Return the first family on the ladder with a rigid rig; None if there is none."""
    return next((one for one in ladder(data)[0] if not one.rig), None)


def _as_fitted(result: Identification) -> Trial:
    """Return a fit as a trial, without the readings that the Huber objective treats as outliers."""
    return Trial(_kept_only(result.data, result.counted), result.problem, result.end)


def doubtful(result: Identification) -> bool:
    """Return True if the data are suspect because of a large misfit or a fit close to its bounds."""
    data, trial = result.data, _as_fitted(result)
    return (
        not result.converged
        or not trial.misfit <= _DOUBTFUL
        or trial.late
        or trial.cornered
        or bool(thick_wall(data))
        or float(data.force.min()) < -_DOUBTFUL * data.max_force
        or _stiff_and_late(data) is not None
    )


def suspect(result: Identification) -> tuple[Suspicion, ...]:
    """Find faults in a force map that would explain its misfit, most likely first.

    Args:
        result: a fit of the map.

    Returns:
        At most three suspicions.
    """
    asked = _as_fitted(result)
    data = asked.data
    plain = [*_no_rise(data), *thick_wall(data)]
    here = attempt(data)
    least = min(asked.misfit, np.inf if here is None else here.misfit)
    cornered = here is None or here.cornered or (asked.cornered and least > _DOUBTFUL)
    found: list[Suspicion] = []
    kinds: tuple[tuple[int, Iterable[Fault]], ...] = (
        (int(not plain), _signs(data, here, least)),
        (1, _absolute(data, least, late=asked.late or here is None or here.late)),
        (int(least > _DOUBTFUL), _rest_lengths(data, least)),
        (int(least >= _TOLERATED), _swapped(data, least)),
        (3 * (least > GOOD or cornered), _scales(data, least, cornered=cornered)),
    )
    for most, faults in kinds:
        if most and not found:
            found = _explained(data, faults, least, most)
    if not found and not plain and least > 0.013:
        found = _of_some(data, least)
    if not found and not plain and least > _UNEXPLAINED:
        sentence = (
            f"No muscle model explains these readings: the best one has an RMSE of {least:.2%} of the "
            "largest force. Check the units, signs, columns and specimen, and that slack readings are 0."
        )
        found.append(Suspicion("no muscle explains the readings", sentence, least))
    return tuple([*plain, *found][:3])


@dataclasses.dataclass(frozen=True)
class Fault:
    """A mistake in a whole column or in the specimen.

    Attributes:
        cause: description as a clause.
        changes: corrected columns of the map, or corrected dimensions of the specimen.
        below: limit on the misfit after the correction, below which the fault explains the original misfit.
        freed: limit used instead of `below` if the correction moves the braid away from its bounds.
        early: if true, the deadband after the correction must be below its upper bound.
        stiff: original fit with a stiff braid and rig, if the misfits of that family are to be compared.
        unlikely: penalty in decades; only faults about as likely as the best one are reported.
        grave: see `Suspicion`.
    """

    cause: str
    changes: Mapping[str, Any]
    below: float
    freed: float = 0.0
    early: bool = False
    stiff: Trial | None = None
    unlikely: float = 0.0
    grave: bool = True


def _explained(
    data: ForceData, faults: Iterable[Fault], least: float, most: int
) -> list[Suspicion]:
    """Return the faults that explain a misfit, most likely first.

    Args:
        data: the map as given.
        faults: the candidate faults.
        least: smallest misfit for the map as given.
        most: maximum number to report, among those about as likely as the first.
    """
    tried: list[tuple[float, float, Suspicion]] = []
    for fault in faults:
        columns = dict(fault.changes) | ({"slack_below": None} if "force" in fault.changes else {})
        sizes = {name: columns.pop(name) for name in fault.changes if hasattr(data.specimen, name)}
        try:
            specimen = dataclasses.replace(data.specimen, **sizes)
            undone = dataclasses.replace(data, specimen=specimen, **columns)
        except InputError:
            continue
        then = attempt(undone, None if fault.stiff is None else _stiff(data))
        if then is None or (fault.early and then.late):
            continue
        misfit = then.misfit
        if misfit < fault.below or (misfit < fault.freed and not then.cornered):
            # Misfits below a hundredth are not compared.
            size = math.log10(max(misfit / _DOUBTFUL, 1.0))
            before, of = least, ""
            if fault.stiff is not None:
                before, of = fault.stiff.misfit, " of a model with a stiff braid and rig"
            named = _named(fault.cause, before, misfit, of, grave=fault.grave)
            tried.append((fault.unlikely + size + 0.3 * then.cornered, misfit, named))
    tried.sort(key=lambda one: one[:2])
    return [one for score, _, one in tried if score < tried[0][0] + 0.5][:most]


def suspect_refused(data: ForceData) -> tuple[Suspicion, ...]:
    """Find the mistake that explains why no model can be fitted; empty if none is found."""
    return tuple(_explained(data, _swapped(data, math.inf), math.inf, 1))


def _named(
    cause: str, before: float, after: float, of: str = "", *, grave: bool = True
) -> Suspicion:
    instead = f" instead of {100 * before:.2g} %" * math.isfinite(before)
    figures = f"{100 * after:.2g} % of the largest force{instead}."
    corrected = f". With this corrected, the misfit{of} is {figures}"
    sentence = Sentence("The data look wrong. It seems that ", cause, corrected)
    return Suspicion(cause, sentence, after, grave)


def _signs(data: ForceData, here: Trial | None, least: float) -> Iterator[Fault]:
    """Yield a fault in the sign of the force, if some forces are negative.

    A slack muscle held at both ends pushes lightly against a load cell. If the model does not pull at these
    readings, the map with reversed signs must fit about as well as the original.
    """
    negative = data.force < -0.03 * data.max_force  # no slack muscle pushes harder
    if not negative.any():
        return
    pull = np.inf if here is None else here.predict(data.length[negative], data.pressure[negative])
    pulls, n = not np.all(np.asarray(pull) <= 0), int(negative.sum())
    are = "reading is" if n == 1 else "readings are"
    said = f"some forces have the wrong sign ({n} {are} negative by up to "
    most = Quantity(-float(data.force.min()), "force")
    cause = Sentence(said, most, ", but a muscle cannot push)")
    undone = {"force": np.where(negative, -data.force, data.force)}
    yield Fault(cause, undone, min(_TOLERATED, max(1.5 * least, GOOD * pulls)))


_SWAPS = ((1e-3, 1e3), (1 / 1550.0, 1550.0), (1e-5, 1e5), (1e-6, 1e6))
"""Conversion factors if the swapped columns are in N and kPa, lbf and psi, N and bar, or N and MPa."""


def _swapped(data: ForceData, least: float) -> Iterator[Fault]:
    """Yield faults for swapped force and pressure columns, in all likely pairs of units."""
    none = dict.fromkeys(("force_std", "pressure_std", "pressure_tolerance"))
    for to_force, to_pressure in _SWAPS:
        pressure = np.maximum(data.force, 0.0) * to_pressure
        columns = {"force": data.pressure * to_force, "pressure": pressure, **none}
        cause = "the force and pressure columns are swapped"
        yield Fault(cause, columns, min(_TOLERATED, least / 5))


def _no_rise(data: ForceData) -> list[Suspicion]:
    """Report that the force does not rise with the pressure at any length."""
    pressure, length, force = data.pressure, data.lengths.level, data.force
    rises = []
    for level in np.unique(length[data.loaded]):
        mine = np.flatnonzero(data.loaded & (length == level))
        low, high = mine[np.argmin(pressure[mine])], mine[np.argmax(pressure[mine])]
        if pressure[high] > 1.3 * pressure[low]:
            rises.append((force[high] - force[low]) / force[mine].max())
    if not rises or max(rises) >= 0.05:
        return []
    cause = "the force does not rise with the pressure"
    sentence = (
        f"{cause.capitalize()} at any length: check the columns, and that the force was recorded."
    )
    return [Suspicion(cause, sentence, 0.0)]


def _stiff(data: ForceData) -> Candidate | None:
    """Return the first family on the ladder as a cylinder with stiff threads; None if there is none."""
    first = richest(data)
    return None if first is None else as_cylinder(first, data)


def _stiff_and_late(data: ForceData) -> Trial | None:
    """Return the fit of a stiff muscle if pressures may be absolute and the deadband is at its bound.

    A compliant braid or rig absorbs part of the deadband, so a fit that includes one need not reach
    the bound. A single pressure cannot reveal a deadband.
    """
    several = np.unique(data.pressures.level[data.loaded]).size > 1
    if not several or data.pressure.min() < 0.85 * ATMOSPHERE:
        return None
    trial = attempt(data, _stiff(data))
    return trial if trial is not None and trial.late else None


def _absolute(data: ForceData, least: float, *, late: bool) -> Iterator[Fault]:
    """Yield faults for absolute pressures: all exceed an atmosphere, and the deadband absorbs most of it.

    `late` means that the deadband of the most general fit is at its upper bound.
    """
    stiff = _stiff_and_late(data)
    if stiff is None:
        return
    undone = {"pressure": np.maximum(data.pressure - ATMOSPHERE, 0.0)}
    cause = "the pressures are absolute, not gauge"
    if late:
        yield Fault(cause, undone, min(_TOLERATED, max(_AS_GOOD * least, _DOUBTFUL)), early=True)
    below = min(_TOLERATED, stiff.misfit / _AS_GOOD)
    yield Fault(cause, undone, below, early=True, stiff=stiff)


def _rest_lengths(data: ForceData, least: float) -> Iterator[Fault]:
    """Yield faults for a wrong rest length; the true one is close to the longest loaded length."""
    given, longest = data.specimen.rest_length, float(data.length[data.loaded].max())
    for part, unlikely in _RESTS.items():
        rest = part * longest
        if abs(rest / given - 1) >= 0.01:
            ends = Quantity(rest, "length", 3), ", not ", Quantity(given, "length")
            cause = Sentence("the rest length is approximately ", *ends)
            yield Fault(
                cause, {"rest_length": rest}, min(GOOD, least / _FAR_BETTER), unlikely=unlikely,
                grave=least > _UNEXPLAINED,
            )  # fmt: skip


def _scales(data: ForceData, least: float, *, cornered: bool) -> Iterator[Fault]:
    """Yield faults that scale the force at a given pressure: wrong force or pressure units, wrong bores.

    If their misfits are similar, the fault that brings the highest pressure closest to a typical 5 bar is
    preferred. `cornered` means that the braid diameter and angle of the original fit are both at their
    upper or both at their lower bounds.
    """
    highest = float(data.pressure.max())
    if not highest > 0:
        return
    below = max(min(least / _FAR_BETTER, GOOD), min(least / 5, 0.05))
    freed = min(GOOD, 0.9 * least) if cornered else 0.0

    def fault(cause: str, highest: float, **changes: Any) -> Fault:
        unlikely = abs(math.log10(highest / 5e5))
        return Fault(cause, changes, below, freed=freed, unlikely=unlikely)

    for what in ("force", "pressure"):
        said, units = data.units.get(what), UNITS[what]
        for true in units:
            if said is None or true == said:
                continue
            factor = units[true] / units[said]
            then = highest * (factor if what == "pressure" else 1.0)
            changes = {what: getattr(data, what) * factor}
            yield fault(f"the {what}s are in {true}, not {said}", then, **changes)
    bore, share = data.specimen.nominal_diameter, _wall_share(data)
    for factor, cause in _BORES.items():
        if bore is not None and share / factor <= max(
            THICK, share
        ):  # else this would trade one fault for another
            yield fault(cause, highest, nominal_diameter=bore * factor)


def _wall_share(data: ForceData) -> float:
    """Return the ratio of wall thickness to bore, or to the bladder's outer diameter without a bore."""
    bore = data.specimen.nominal_diameter or data.specimen.bladder_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def thick_wall(data: ForceData) -> list[Suspicion]:
    """Report a wall thicker than a third of the bore; the misfit hardly depends on the wall thickness."""
    share, specimen = _wall_share(data), data.specimen
    if share <= THICK:
        return []
    key = "nominal_diameter" if specimen.nominal_diameter else "bladder_diameter"
    wall, bore = (Quantity(getattr(specimen, name), "length") for name in ("wall_thickness", key))
    remedy = f". This leaves no room for a bladder: check wall_thickness, {key} and their units."
    sentence = Sentence("The wall thickness, ", wall, f", is {share:.0%} of {key}, ", bore, remedy)
    return [Suspicion("the wall is too thick, or the diameter too small", sentence, 0.0)]


def _of_some(data: ForceData, least: float) -> list[Suspicion]:
    """Find a fault that affects only some readings: the first whose misfit is close to the smallest."""
    tries = (_at_a_limit, _outliers, _two_muscles, _two_by_length)
    good = [
        _named(cause, least, better)
        for cause, better in filter(None, (one(data) for one in tries))
        if better < GOOD and better * _FAR_BETTER < least
    ]
    best = min((one.misfit for one in good), default=np.inf)
    return [one for one in good if one.misfit <= 2.0 * max(best, 1e-3)][:1]


def _kept_only(data: ForceData, kept: Bool[np.ndarray, " loaded"]) -> ForceData:
    """Keep only some of the loaded readings."""
    rows = np.ones(data.force.size, bool)
    rows[data.loaded] = kept
    return data.part(rows)


def _at_a_limit(data: ForceData) -> tuple[str, float] | None:
    """Find a saturated load cell: readings at the largest force, which a fit to the rest exceeds."""
    force = data.force[data.loaded]
    limit = float(force.max())
    full = force >= (1 - _SHARED) * limit
    if not 3 <= full.sum() <= 0.5 * full.size:
        return None
    trial = attempt(_kept_only(data, ~full))
    if trial is None:
        return None
    errors = trial.errors(data)
    misfit = float(np.sqrt(np.mean(errors[~full] ** 2))) / limit
    if np.mean(errors[full] < -2.0 * max(misfit, _SHARED) * limit) > 0.25:
        return None
    said = f"the load cell was saturated at {full.sum()} readings of "
    mark = f" (add the line # specimen: force_limit_N = {float(force[full].min()):.6g} to the file)"
    return Sentence(said, Quantity(limit, "force"), mark), misfit


def _outliers(data: ForceData) -> tuple[str, float] | None:
    """Find a few outliers by repeatedly excluding the worst readings and refitting."""
    force = data.force[data.loaded]
    kept, errors = force <= 20 * float(np.median(force)), np.zeros(force.size)
    if kept.sum() < 3:
        return None
    for _ in range(6):
        trial = attempt(_kept_only(data, kept))
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
    return (
        f"{count} {are} (number {shown}; use --objective huber to give {them} little weight)",
        misfit,
    )


def _two_muscles(data: ForceData) -> tuple[str, float] | None:
    """Find readings from a second muscle before or after some row; the other readings fit well alone.

    The file is divided where the slower of pressure and length first reverses, as if a new test began.
    """
    lengths, pressures = data.lengths.level[data.loaded], data.pressures.level[data.loaded]
    slow = min((lengths, pressures), key=lambda one: int((np.diff(one) != 0).sum()))
    changes = np.flatnonzero(np.diff(slow) != 0) + 1
    steps = np.sign(slow[changes] - slow[changes - 1])
    turns, found = changes[1:][steps[1:] != steps[:-1]], []
    if not turns.size:
        return None
    before, row = np.arange(slow.size) < turns[0], int(np.flatnonzero(data.loaded)[turns[0]])
    for where, other in ((f"up to reading {row}", before), (f"from reading {row + 1} on", ~before)):
        trial = attempt(_kept_only(data, ~other))
        if trial is not None and np.unique(lengths[~other]).size >= _FEWEST_LENGTHS:
            cause = f"the file contains readings from two muscles, one of them {where}"
            found.append((cause, trial.misfit))
    return min(found, key=lambda one: one[1], default=None)


def _two_by_length(data: ForceData) -> tuple[str, float] | None:
    """Find readings from a second muscle at some lengths, with forces proportional to the first muscle's.

    For one muscle, dF/dP = (3 L^2 - B^2)/(4 pi N^2) is linear in L^2. The divisions of the lengths that
    satisfy this best are tried.
    """
    lengths, place = np.unique(data.lengths.level[data.loaded], return_inverse=True)
    pressure, force = data.pressure[data.loaded], data.force[data.loaded]
    rows, divisions, found = [place == k for k in range(lengths.size)], [], []
    if min(np.unique(pressure[mine]).size for mine in rows) < 2:
        return None
    slope = np.array([np.polyfit(pressure[mine], force[mine], 1)[0] for mine in rows])
    for count in range(2, min(lengths.size // 2, lengths.size - _FEWEST_LENGTHS) + 1):
        for some in itertools.islice(itertools.combinations(range(lengths.size), count), 400):
            rest = np.setdiff1d(np.arange(lengths.size), some)
            line = np.polyval(np.polyfit(lengths[rest] ** 2, slope[rest], 1), lengths**2)
            own, here = line[[*some]], slope[[*some]]
            line[[*some]] *= (own @ here) / (own @ own)
            divisions.append((float(np.sum((line - slope) ** 2)), some))
    for _, some in sorted(divisions)[:_DIVISIONS]:
        other = np.isin(place, some)
        trial = attempt(_kept_only(data, ~other))
        if trial is None:
            continue
        errors = trial.errors(data)
        pull, there = (errors + force)[other], force[other]
        errors[other] = pull * float(pull @ there) / float(pull @ pull) - there
        at = ", ".join(f"{one * 1e3:.5g}" for one in lengths[[*some]])
        cause = f"the file contains readings from two muscles, one of them at {at} mm"
        found.append((cause, float(np.sqrt(np.mean(errors**2))) / data.max_force))
    return min(found, key=lambda one: one[1], default=None)

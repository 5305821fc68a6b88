"""Faults of all readings that the figures themselves show, or that one change of them undoes."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.sentence import Quantity, Sentence

from ..data.force_data import ForceData
from ..ladder import Candidate
from .suspicion import FAR_BETTER, GOOD, Suspicion, named
from .trial import Trial, attempt, misfit, plainest, richest

ATMOSPHERE = 101.3e3
"""Pressure of the air [Pa]."""

THICK = 0.3
"""Part of the bore: a wall above it leaves no room for a bladder that strains."""

_ABSOLUTE = 0.85  # of an atmosphere: no reading is below it where pressures are absolute
_AS_GOOD, _FINE = 1.2, 0.01  # a deadband takes up most of an atmosphere, a compliance the rest
_RISE = 0.05  # of the force at a length, between pressures as far apart as this:
_APART = 1.3
_STEEP = 40.0  # loss of force per contraction, in parts of the force: 3 to 10 for a muscle
_PUSH = 0.03  # of the largest force: no slack muscle pushes so hard
_RICH_LAW = "cubic"  # takes up most of what a wrong pressure does
_RESTS = (1.0, 0.98, 1.03)  # of the longest loaded length, at which most tests begin
_AS_LIKELY = 2.0  # times the least misfit: the first of these
_SAME_REST = 0.01
_WRONG_REST = 0.03  # misfit from which nothing is identified
_TOLERATED = 0.04  # misfit of data that were far worse


def wall_share(data: ForceData) -> float:
    """The wall in parts of the bore, or of the bladder's outer diameter where there is no bore."""
    bore = data.specimen.nominal_diameter or data.specimen.bladder_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def thick_wall(data: ForceData) -> Iterator[Suspicion]:
    """A wall that is a third of the bore; the force hardly depends on it, so no misfit shows it."""
    if wall_share(data) > THICK:
        bore = data.specimen.nominal_diameter
        what, key = (
            ("the bore", "nominal_diameter") if bore else ("the bladder", "bladder_diameter")
        )
        across = bore or data.specimen.bladder_diameter or 0.0
        yield Suspicion(
            "the wall is too thick, or the diameter too small",
            Sentence(
                "The wall of ",
                Quantity(data.specimen.wall_thickness, "length"),
                f" is {wall_share(data):.0%} of {what} of ",
                Quantity(across, "length"),
                ", and leaves no room for a bladder that strains: one of the two is wrong; check "
                f"wall_thickness and {key}, and their units.",
            ),
            0.0,
        )


def no_rise(data: ForceData) -> Iterator[Suspicion]:
    """Forces that do not rise with the pressure at any length."""
    level, loaded = data.lengths.level, data.loaded
    rises = []
    for one in np.unique(level[loaded]):
        mine = loaded & (level == one)
        order = np.argsort(data.pressure[mine])
        pressure, force = data.pressure[mine][order], data.force[mine][order]
        if pressure[-1] > _APART * pressure[0]:
            rises.append((force[-1] - force[0]) / force.max())
    if rises and max(rises) < _RISE:
        yield Suspicion(
            "the force does not rise with the pressure",
            "The force does not rise with the pressure at any length: check which column is which, "
            "and that the force was recorded.",
            0.0,
        )


def steepness(data: ForceData) -> float:
    """Loss of force per contraction at the highest pressure of two lengths, in parts of the force."""
    pressure, loaded = data.pressures.level, data.loaded
    for one in np.unique(pressure[loaded])[::-1]:
        mine = loaded & (pressure == one)
        length, force = data.length[mine], data.force[mine]
        if np.unique(data.lengths.level[mine]).size > 1:
            slope = np.polyfit(length / data.specimen.rest_length, force, 1)[0]
            return float(slope) / float(force.max())
    return 0.0


def small_contraction(data: ForceData, least: float) -> Iterator[Suspicion]:
    """Contractions that are a hundred times too small for what the force loses by them."""
    rest = data.specimen.rest_length
    if steepness(data) < _STEEP:
        return
    length = rest * (1 - 100 * (1 - data.length / rest))
    if length.min() <= 0 or length.max() > 1.1 * rest:
        return
    better = misfit(dataclasses.replace(data, length=length, length_std=None))
    if better < _TOLERATED:
        yield Suspicion(
            "the contractions are fractions, not percent",
            f"The force falls by {steepness(data):.0f} % for a contraction of 1 %, ten times as fast "
            "as that of a muscle. It seems that the contractions are fractions, not percent: read so, "
            f"the misfit is {100 * better:.2g} % of the largest force; as the file stands, it is "
            f"{100 * least:.2g} %.",
            better,
        )


def swapped(data: ForceData, least: float, candidate: Candidate | None) -> Iterator[Suspicion]:
    """Force and pressure in each other's column, N with kPa or lbf with psi."""
    if least < _TOLERATED:
        return
    force, pressure = data.pressure, np.maximum(data.force, 0.0)
    for to_force, to_pressure in ((1e-3, 1e3), (1 / 1550.0, 1550.0), (1e-5, 1e5), (1e-6, 1e6)):
        try:
            other = dataclasses.replace(
                data, force=force * to_force, pressure=pressure * to_pressure, force_std=None,
                pressure_std=None, pressure_tolerance=None,
            )  # fmt: skip
        except InputError:
            continue
        better = misfit(other, candidate)
        if better < _TOLERATED and better * 5 < least:
            yield named("the columns of force and pressure are swapped", least, better)
            return


def signs(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None
) -> Iterator[Suspicion]:
    """Readings of pulls that are negative.

    A slack muscle that is held at both ends pushes against a load cell as its rubber does. Where the fit
    has no pull either, the other sign has to fit as well as what stands in the file.

    Args:
        data: the map.
        here: its fit, in which negative readings count by the pull that they are said not to be.
        least: its least misfit.
        candidate: the family.
    """
    negative = data.force < -_PUSH * data.max_force
    if not negative.any():
        return
    n = int(negative.sum())
    pull = np.inf if here is None else here.predict(data.length[negative], data.pressure[negative])
    pulls = not np.all(np.asarray(pull) <= 0)
    force = np.where(negative, -data.force, data.force)
    better = misfit(dataclasses.replace(data, force=force), candidate)
    if better < _TOLERATED and (better < 1.5 * least or (pulls and better < GOOD)):
        yield Suspicion(
            "forces have the wrong sign",
            Sentence(
                f"{n} reading{' is' if n == 1 else 's are'} negative by up to ",
                Quantity(-float(data.force.min()), "force"),
                ", and a muscle does not push: with the sign of a pull they fit, with a misfit of "
                f"{better:.2%} of the largest force in all. Check the sign of the force.",
            ),
            better,
        )


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
    here = attempt(data, plainest(data), starts=2)
    return here is not None and here.side("deadband_pressure") > 0


def absolute(
    data: ForceData, here: Trial | None, least: float, candidate: Candidate | None, *, stopped: bool
) -> Iterator[Suspicion]:
    """Absolute pressures: none is below an atmosphere, and the deadband takes up most of it.

    `stopped` says that the deadband of the fit in question is at its highest bound.
    """
    if not _may_be_absolute(data):
        return
    stopped = stopped or here is None or here.side("deadband_pressure") > 0
    gauge = dataclasses.replace(data, pressure=np.maximum(data.pressure - ATMOSPHERE, 0.0))
    for family in (candidate, richest(data, _RICH_LAW)) if stopped else ():
        then = attempt(gauge, family)
        if then is None or then.side("deadband_pressure") > 0:
            continue
        if then.misfit < _TOLERATED and then.misfit < max(_AS_GOOD * least, _FINE):
            yield named("the pressures are absolute, not gauge", least, then.misfit)
            return
    plain = plainest(data)
    as_it_stands, then = attempt(data, plain), attempt(gauge, plain)
    if as_it_stands is None or then is None or plain is None:
        return
    if as_it_stands.side("deadband_pressure") <= 0 or then.side("deadband_pressure") > 0:
        return
    if then.misfit < _TOLERATED and then.misfit * _AS_GOOD < as_it_stands.misfit:
        yield Suspicion(
            "the pressures are absolute, not gauge",
            "The data look wrong. It seems that the pressures are absolute, not gauge: none is below an "
            "atmosphere, and unless braid or rig give way the muscle pulls later than any deadband has "
            f"it. With them rigid, the misfit is {100 * then.misfit:.2g} % of the largest force if an "
            f"atmosphere is taken off, and {100 * as_it_stands.misfit:.2g} % as the file stands.",
            then.misfit,
        )


def wrong_rest_length(data: ForceData, least: float) -> Iterator[Suspicion]:
    """A rest length that is not the muscle's: one beside the longest loaded length fits far better."""
    given, longest = data.specimen.rest_length, float(data.length[data.loaded].max())
    found: list[tuple[float, float]] = []
    for rest in longest * np.array(_RESTS):
        if abs(rest / given - 1) < _SAME_REST:
            continue
        specimen = dataclasses.replace(data.specimen, rest_length=float(rest))
        found.append((misfit(dataclasses.replace(data, specimen=specimen)), float(rest)))
    least_of_all = min((one for one, _ in found), default=np.inf)
    alike = (one for one in found if one[0] <= _AS_LIKELY * least_of_all)
    better, rest = next(alike, (np.inf, 0.0))
    if better * FAR_BETTER < least and better < GOOD:
        cause = Sentence(
            "the rest length is ", Quantity(rest, "length", 3), " or so, not ", Quantity(given, "length")
        )  # fmt: skip
        yield named(cause, least, better, grave=least > _WRONG_REST)

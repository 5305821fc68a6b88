"""What in a force map would explain a misfit: the same fit of data as they would be without a fault.

Each suspicion is a change of the data that a mistake would need: a unit, absolute pressures, a
length that is off, two muscles in one file, outliers. A change that makes the misfit several times
smaller is named.
"""

import dataclasses
from collections.abc import Callable, Iterator

import numpy as np

from famjax.boundary.errors import InputError

from ..choice.choose import fit_error, weigh
from ..choice.ladder import Candidate, ladder
from ..data.force_data import ForceData
from ..search.result import Identification
from .mixtures import one_length_off, outliers, two_muscles

FAR_BETTER = 3.0
"""Factor by which a change of the data must lower the misfit to be named."""

_GOOD = 0.02  # of the largest force: a muscle's misfit
_DOUBTFUL = 1.5  # %
_ATMOSPHERE = 101.3e3  # Pa
_ABSOLUTE = 0.85  # of an atmosphere: no reading is below it where pressures are absolute
_UNITS = (
    ("force", 9.80665, "the forces are in kgf, not N"),
    ("force", 1 / 9.80665, "the forces are in N, not kgf"),
    ("force", 4.44822, "the forces are in lbf, not N"),
    ("force", 1 / 4.44822, "the forces are in N, not lbf"),
    ("force", 1e3, "the forces are in kN, not N"),
    ("force", 1e-3, "the forces are in N, not kN"),
    ("pressure", 1e3, "the pressures are in MPa, not kPa (or kPa, not Pa)"),
    ("pressure", 1e-3, "the pressures are in Pa, not kPa (or kPa, not MPa)"),
    ("pressure", 6.894757, "the pressures are in psi, not kPa"),
    ("pressure", 1 / 6.894757, "the pressures are in kPa, not psi"),
    ("pressure", 100.0, "the pressures are in bar, not kPa"),
    ("pressure", 0.01, "the pressures are in kPa, not bar"),
    ("pressure", 14.50377, "the pressures are in bar, not psi"),
    ("pressure", 1 / 14.50377, "the pressures are in psi, not bar"),
    ("pressure", 10.0, "the pressures are in MPa, not bar"),
    ("pressure", 0.1, "the pressures are in bar, not MPa"),
    ("rest_length", 10.0, "the rest length is in cm where mm is said, or a digit of it is missing"),
    ("rest_length", 0.1, "the rest length is in mm where cm is said, or has a digit too many"),
    ("rest_length", 25.4, "the rest length is in inches, not mm"),
    ("nominal_diameter", 10.0, "the nominal diameter is in cm where mm is said"),
    ("nominal_diameter", 0.1, "the nominal diameter is ten times too large"),
    ("nominal_diameter", 2.0, "the nominal diameter is a radius, or that of a smaller muscle"),
    ("nominal_diameter", 0.5, "the nominal diameter is that of a larger muscle"),
    ("wall_thickness", 0.1, "the wall is ten times too thick"),
    ("wall_thickness", 10.0, "the wall is ten times too thin"),
)
"""What is scaled, by what, and what that means."""


@dataclasses.dataclass(frozen=True)
class Suspicion:
    """A fault in the data that would explain the misfit.

    Attributes:
        cause: what it is, in a few words.
        sentence: for a reader, with the figures.
        misfit: RMSE with the fault undone, in parts of the largest force.
    """

    cause: str
    sentence: str
    misfit: float


def doubtful(result: Identification) -> bool:
    """Whether a fit is so poor, or so far at its bounds, that its data are to be questioned."""
    errors = result.errors
    bounds = {e.name for e in result.estimates if e.at_bound}
    return (
        not result.converged
        or not errors.rmse_percent <= _DOUBTFUL
        or "deadband_pressure" in bounds
        or errors.max_slack_force > max(2 * errors.rmse, 0.02 * errors.max_force)
        or _wall_share(result.data) > _THICK
    )


_THICK = 0.35  # of the bore: a wall that thick leaves no room to strain


def _wall_share(data: ForceData) -> float:
    bore = data.specimen.nominal_diameter
    return 0.0 if bore is None else data.specimen.wall_thickness / bore


def suspect(
    data: ForceData, misfit: float, progress: Callable[[int, int], None] | None = None
) -> tuple[Suspicion, ...]:
    """The faults of a force map that would explain its misfit, the likeliest first.

    Args:
        data: the map.
        misfit: RMSE of its fit in parts of the largest force.
        progress: called with (changes tried, changes).

    Returns:
        At most three; none where no change makes the misfit several times smaller.
    """
    candidate = _candidate(data)
    if candidate is None:
        return ()
    here = min(misfit, _error(data, candidate))
    found = list(_absolute(data, here, candidate))
    changes = list(_changed(data))
    for done, (cause, changed) in enumerate(changes):
        if progress is not None:
            progress(done, len(changes))
        better = _error(changed, candidate)
        if better * FAR_BETTER < here and better < _GOOD:
            found.append(_named(cause, here, better))
    if not found:
        for search in (outliers, one_length_off, two_muscles):
            told = search(data, candidate)
            if told is not None and told[1] * FAR_BETTER < here and told[1] < _GOOD:
                found.append(_named(told[0], here, told[1]))
    if _wall_share(data) > _THICK:
        found.append(
            Suspicion(
                "wall",
                f"The wall of {data.specimen.wall_thickness * 1e3:.4g} mm is {_wall_share(data):.0%} of "
                "the bore: it leaves no room for a bladder that strains. Check wall_thickness.",
                here,
            )
        )
    return tuple(sorted(found, key=lambda one: one.misfit)[:3])


def _named(cause: str, here: float, better: float) -> Suspicion:
    return Suspicion(
        cause,
        f"The data look wrong: were it that {cause}, the misfit would be {better:.2%} of the largest "
        f"force and not {here:.2%}.",
        better,
    )


def _candidate(data: ForceData) -> Candidate | None:
    """The richest family of the first law on the ladder: what a sound map of a muscle is fitted by."""
    candidates, _ = ladder(data)
    alike = [one for one in candidates if one.law == candidates[0].law] if candidates else []
    return max(alike, key=lambda one: one.unknowns, default=None)


def _error(data: ForceData, candidate: Candidate) -> float:
    """RMSE in parts of the largest force; infinite where there is no fit."""
    try:
        return fit_error(weigh(data), candidate) / data.max_force
    except InputError:
        return np.inf


def _changed(data: ForceData) -> Iterator[tuple[str, ForceData]]:
    """The map without each fault."""
    for what, factor, cause in _UNITS:
        try:
            if what in ("force", "pressure"):
                yield cause, dataclasses.replace(data, **{what: getattr(data, what) * factor})
            elif getattr(data.specimen, what) is not None:
                changed = {what: getattr(data.specimen, what) * factor}
                specimen = dataclasses.replace(data.specimen, **changed)
                yield cause, _refitted(data, specimen)
        except InputError:
            continue
    longest = float(data.length.max())
    if abs(longest / data.specimen.rest_length - 1) > 0.02:
        specimen = dataclasses.replace(data.specimen, rest_length=longest)
        yield (
            f"the rest length is {longest * 1e3:.4g} mm, the longest length measured",
            _refitted(data, specimen),
        )


def _refitted(data: ForceData, specimen: object) -> ForceData:
    return dataclasses.replace(data, specimen=specimen)


def _absolute(data: ForceData, here: float, candidate: Candidate) -> Iterator[Suspicion]:
    """Absolute pressures: none is below an atmosphere, and with gauge ones the fit is better."""
    if data.pressure.min() < _ABSOLUTE * _ATMOSPHERE:
        return
    gauge = np.maximum(data.pressure - _ATMOSPHERE, 0.0)
    try:
        better = _error(dataclasses.replace(data, pressure=gauge), candidate)
    except InputError:
        return
    if better < _GOOD and better * 1.2 < here:  # a deadband takes up most of an atmosphere
        yield _named("the pressures are absolute, not gauge", here, better)

"""Faults that scale a whole column or a size of the specimen: units, and sizes that are wrong."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from ..data.force_data import ForceData
from ..ladder import Candidate
from .faulty_readings import thinned
from .plain_faults import THICK, wall_share
from .suspicion import FAR_BETTER, GOOD, Suspicion, named
from .trial import attempt

_USUAL = 5e5  # Pa, the highest pressure of most tests of pneumatic muscles
_ALIKE = 0.5  # decades of pressure or of misfit: taken as equal
_NOT_SAID = 0.35  # decades that a unit which the file does not name counts
_GOOD_ENOUGH = 0.01  # smaller misfits say no more
_CORNERED = 0.3  # decades that a geometry at its bounds counts
_TOLERATED = 0.05  # of the largest force, where the misfit was many times as large
_PROMISING = 0.08  # misfit of a few readings from which all of them are fitted

_COMMON = {
    "force": (("kgf", "N"), ("lbf", "N"), ("kN", "N"), ("kgf", "lbf")),
    "pressure": (("MPa", "kPa"), ("kPa", "Pa"), ("psi", "kPa"), ("bar", "kPa"), ("bar", "psi"),
                 ("MPa", "bar"), ("MPa", "psi")),
}  # fmt: skip
"""Units that are taken for one another, either way round, before they are written into a file."""

_SIZES = (
    ("nominal_diameter", 2.0, "the nominal diameter is a radius, or that of a smaller muscle"),
    ("nominal_diameter", 0.5, "the nominal diameter is that of a larger muscle"),
    ("nominal_diameter", 10.0, "the nominal diameter is in cm, not mm"),
    ("nominal_diameter", 0.1, "the nominal diameter is ten times too large"),
)


@dataclasses.dataclass(frozen=True)
class _Scale:
    """A change of a column or a size.

    Attributes:
        what: column, or size of the specimen.
        factor: by which it is multiplied.
        cause: what that means.
        unlikely: decades by which the highest pressure is then away from the usual one, and more
            where the file names another unit.
    """

    what: str
    factor: float
    cause: str
    unlikely: float

    def applied(self, data: ForceData) -> ForceData:
        """The map without the fault."""
        if self.what in _COMMON:
            return dataclasses.replace(data, **{self.what: getattr(data, self.what) * self.factor})
        size = getattr(data.specimen, self.what) * self.factor
        return dataclasses.replace(
            data, specimen=dataclasses.replace(data.specimen, **{self.what: size})
        )


def _causes(data: ForceData, what: str) -> dict[float, tuple[list[str], bool]]:
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


def _scales(data: ForceData) -> list[_Scale]:
    highest, found = float(data.pressure.max()), []
    for what in _COMMON:
        for factor, (words, known) in _causes(data, what).items():
            then = highest * (factor if what == "pressure" else 1.0)
            cause = f"the {what}s are {' (or '.join(words)}{')' * (len(words) - 1)}"
            unlikely = abs(math.log10(then / _USUAL)) + (0.0 if known else _NOT_SAID)
            found.append(_Scale(what, factor, cause, unlikely))
    as_said = abs(math.log10(highest / _USUAL))
    known = [one for one in _SIZES if getattr(data.specimen, one[0]) is not None]
    return found + [_Scale(*one, as_said) for one in known]


def wrong_scales(
    data: ForceData,
    least: float,
    candidate: Candidate | None,
    progress: Callable[[int, int], None] | None = None,
    *,
    cornered: bool,
) -> list[Suspicion]:
    """Units and sizes of which another would explain the readings far better, the likeliest first.

    A unit of force, one of pressure and the bore all scale the force at a pressure: where the misfit
    does not separate them, the pressure does, which is some bar in most tests.

    Args:
        data: the map.
        least: the least misfit of the map as it is.
        candidate: the family.
        progress: called with (changes tried, changes).
        cornered: a fit of the map as it is has both braid diameter and angle at bounds of more, or
            of less, force.
    """
    if highest_is_zero(data):
        return []
    if least <= GOOD and not cornered:
        return []
    tried: list[tuple[float, float, Suspicion]] = []
    scales, few = _scales(data), thinned(data)
    for done, scale in enumerate(scales):
        if progress is not None:
            progress(done, len(scales))
        try:
            if wall_share(scale.applied(few)) > max(THICK, wall_share(data)):
                continue  # one fault is not explained by another
            then = attempt(scale.applied(few), candidate, starts=2)
            if then is not None and then.misfit < _PROMISING:
                then = attempt(scale.applied(data), candidate)
        except InputError:
            continue
        if then is None:
            continue
        far = then.misfit * FAR_BETTER < least
        good = then.misfit < (_TOLERATED if least > 5 * then.misfit else GOOD)
        freed = cornered and then.corner == 0 and then.misfit < min(GOOD, 0.9 * least)
        if (far and good) or freed:
            size = math.log10(max(then.misfit, _GOOD_ENOUGH) / _GOOD_ENOUGH)
            score = scale.unlikely + size + _CORNERED * abs(then.corner)
            tried.append((score, then.misfit, named(scale.cause, least, then.misfit)))
    tried.sort(key=lambda one: one[:2])
    return [one for score, _, one in tried if score < tried[0][0] + _ALIKE][:3]


def highest_is_zero(data: ForceData) -> bool:
    """Whether there is no pressure at all."""
    return not np.any(data.pressure > 0)

"""Faults that scale a whole column or a size of the specimen: units, and sizes that are wrong."""

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from ..choice.ladder import Candidate
from ..data.force_data import ForceData
from .suspicion import FAR_BETTER, GOOD, Suspicion, named
from .trial import Trial, attempt

_USUAL = 5e5  # Pa, the highest pressure of most tests of pneumatic muscles
_LIKELY = 0.75  # decades from it
_ALIKE = 1.6  # times the least misfit: not told apart
_TOLERATED = 0.05  # of the largest force, where the misfit was many times as large
_UNIT_PAIRS = {
    "force": (("kgf", "N"), ("lbf", "N"), ("kN", "N"), ("kgf", "lbf")),
    "pressure": (("MPa", "kPa"), ("kPa", "Pa"), ("psi", "kPa"), ("bar", "kPa"), ("bar", "psi"),
                 ("MPa", "bar"), ("MPa", "psi")),
}  # fmt: skip
"""Units that are taken for one another, either way round."""

_SIZES = (
    ("nominal_diameter", 2.0, "the nominal diameter is a radius, or that of a smaller muscle"),
    ("nominal_diameter", 0.5, "the nominal diameter is that of a larger muscle"),
    ("nominal_diameter", 10.0, "the nominal diameter is in cm, not mm"),
    ("nominal_diameter", 0.1, "the nominal diameter is ten times too large"),
    ("nominal_diameter", 1 / 25.4, "the nominal diameter is in mm, not inches"),
    ("nominal_diameter", 25.4, "the nominal diameter is in inches, not mm"),
)


@dataclasses.dataclass(frozen=True)
class _Scale:
    """A change of a column or a size.

    Attributes:
        what: column, or size of the specimen.
        factor: by which it is multiplied.
        cause: what that means.
        unlikely: decades by which the highest pressure is then away from the usual one.
    """

    what: str
    factor: float
    cause: str
    unlikely: float

    def applied(self, data: ForceData) -> ForceData:
        """The map without the fault."""
        if self.what in _UNIT_PAIRS:
            return dataclasses.replace(data, **{self.what: getattr(data, self.what) * self.factor})
        size = getattr(data.specimen, self.what) * self.factor
        return dataclasses.replace(
            data, specimen=dataclasses.replace(data.specimen, **{self.what: size})
        )


def _scales(data: ForceData) -> list[_Scale]:
    highest, found = float(data.pressure.max()), []
    for what, pairs in _UNIT_PAIRS.items():
        units = UNITS[what]
        by_factor: dict[float, list[str]] = {}
        for pair in pairs:
            for true, said in (pair, pair[::-1]):
                factor = float(f"{units[true] / units[said]:.6g}")
                by_factor.setdefault(factor, []).append(f"in {true}, not {said}")
        for factor, words in by_factor.items():
            then = highest * (factor if what == "pressure" else 1.0)
            cause = f"the {what}s are {' (or '.join(words)}{')' * (len(words) - 1)}"
            found.append(_Scale(what, factor, cause, abs(math.log10(then / _USUAL))))
    as_said = abs(math.log10(highest / _USUAL))
    known = [one for one in _SIZES if getattr(data.specimen, one[0]) is not None]
    return found + [_Scale(*one, as_said) for one in known]


def wrong_scales(
    data: ForceData,
    here: Trial | None,
    least: float,
    candidate: Candidate | None,
    progress: Callable[[int, int], None] | None = None,
) -> list[Suspicion]:
    """Units and sizes of which another would explain the readings far better, the likeliest first.

    A unit of force, one of pressure and the bore all scale the force at a pressure: what cannot be
    told apart by the misfit is told by the pressure, which is some bar in most tests.

    Args:
        data: the map.
        here: its fit.
        least: the least misfit of the map as it is.
        candidate: the family.
        progress: called with (changes tried, changes).
    """
    if highest_is_zero(data):
        return []
    cornered = here is None or here.corner != 0
    if least <= GOOD and not cornered:
        return []
    tried: list[tuple[_Scale, float]] = []
    scales = _scales(data)
    for done, scale in enumerate(scales):
        if progress is not None:
            progress(done, len(scales))
        try:
            changed = scale.applied(data)
        except InputError:
            continue
        then = attempt(changed, candidate)
        if then is None or then.corner != 0:
            continue
        far = then.misfit * FAR_BETTER < least
        good = then.misfit < (_TOLERATED if least > 5 * then.misfit else GOOD)
        freed = cornered and then.misfit < min(GOOD, 0.9 * least)
        if (far and good) or freed:
            tried.append((scale, then.misfit))
    if not tried:
        return []
    best = min(error for _, error in tried)
    alike = [(scale, error) for scale, error in tried if error <= _ALIKE * max(best, 0.2 * GOOD)]
    nearest = min(scale.unlikely for scale, _ in alike)
    kept = [(s, e) for s, e in alike if s.unlikely < max(_LIKELY, nearest + 1e-9)]
    kept.sort(key=lambda one: (round(one[0].unlikely, 3), one[1]))
    return [named(scale.cause, least, error) for scale, error in kept[:3]]


def highest_is_zero(data: ForceData) -> bool:
    """Whether there is no pressure at all."""
    return not np.any(data.pressure > 0)

"""Options of a design, `key_unit=value`, as numbers in SI."""

import math
from collections.abc import Iterable, Mapping

from ...boundary.units import UNITS
from ...design.catalogue import CatalogueError
from ...design.catalogue_search import Requirement
from ...design.space import SearchLimits, SearchRanges
from ...design.swage_tube import TubeOptions

_REQUIREMENT = {
    "pressure": "pressure",
    "force": "force",
    "contraction": "number",
    "largest_diameter": "length",
    "force_contraction": "number",
}
_LIMITS = {
    "stroke": "length",
    "force_stroke": "length",
    "longest_length": "length",
    "burst_factor": "number",
    "pull_factor": "number",
    "thread_factor": "number",
    "tube_factor": "number",
    "bore_stretch": "number",
}
_VARIED = {"rest_length": "length", "pressure": "pressure"}
_TUBE = {
    "modulus": "stress",
    "yield_stress": "stress",
    "free_length": "length",
    "supported_length": "length",
}


def parse_requirement(entries: Iterable[str]) -> Requirement:
    """The requirement that entries such as `force_lbf=900` and `contraction=0.3` make.

    Args:
        entries: `key_unit=value`; keys pressure, force, contraction, largest_diameter and
            force_contraction. Pressure is needed; without a force or contraction none is asked.

    Raises:
        CatalogueError: an entry that cannot be read, with what is known, or that only a search can
            keep to.

    >>> parse_requirement(["pressure_psi=100", "contraction=0.3"]).contraction
    0.3
    """
    given = _parse(entries, _REQUIREMENT | _LIMITS, "requirement")
    if of_a_search := [name for name in given if name in _LIMITS]:
        raise CatalogueError(
            f"the requirement {of_a_search[0]} needs a search over rest lengths and pressures: add "
            "--search 1e6"
        )
    return _requirement(given)


def parse_search_requirement(
    entries: Iterable[str], *, end_fittings: bool
) -> tuple[Requirement, SearchLimits]:
    """What a search keeps to: a requirement, and more such as `stroke_mm=50` and `burst_factor=2`.

    Args:
        entries: `key_unit=value`; the keys of `parse_requirement` and those of `SearchLimits`.
        end_fittings: whether a swage tube of the catalogue must fit.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that nothing can keep to.

    >>> parse_search_requirement(["pressure_bar=7", "stroke_mm=50"], end_fittings=True)[1].stroke
    0.05
    """
    given = _parse(entries, _REQUIREMENT | _LIMITS, "requirement")
    limits = {name: value for name, value in given.items() if name in _LIMITS}
    requirement = {name: value for name, value in given.items() if name in _REQUIREMENT}
    return _requirement(requirement), SearchLimits(**limits, end_fittings=end_fittings)


def _requirement(given: Mapping[str, float]) -> Requirement:
    if "pressure" not in given:
        raise CatalogueError("a requirement needs the pressure, as in --require pressure_psi=100")
    try:
        return Requirement(**{"force": 0.0, "contraction": 0.0, **given})
    except ValueError as error:
        raise CatalogueError(str(error)) from None


def number_of_candidates(about: float) -> int:
    """The number that an option such as 1e6 asks for.

    Raises:
        CatalogueError: it is not a number of candidates.

    >>> number_of_candidates(1e6)
    1000000
    """
    if not 1 <= about < math.inf:
        raise CatalogueError(f"--search must be >= 1 and finite, as in --search 1e6; got {about}")
    return int(about)


def parse_ranges(
    entries: Iterable[str], requirement: Requirement, limits: SearchLimits, rest_length: float
) -> SearchRanges:
    """What a search varies: entries such as `rest_length_mm=100:600` and `pressure_psi=20:100`.

    Args:
        entries: `key_unit=least:greatest`; one number keeps it fixed. What is not given goes from a
            quarter of the required pressure to all of it, and from a quarter of the longest length
            to all of it or, without such a limit, from half of a usual length to twice that.
        requirement: in SI.
        limits: in SI.
        rest_length: that usual length [m].

    Raises:
        InputError: an entry that cannot be read, with what is known.

    >>> asked, limits = parse_search_requirement(["pressure_kPa=700"], end_fittings=True)
    >>> parse_ranges(["rest_length_mm=100:600"], asked, limits, 0.25)
    SearchRanges(rest_length=(0.1, 0.6), pressure=(175000.0, 700000.0))
    """
    longest = limits.longest_length
    found = {
        "pressure": (requirement.pressure / 4, requirement.pressure),
        "rest_length": (
            (longest / 4, longest) if math.isfinite(longest) else (rest_length / 2, 2 * rest_length)
        ),
    }
    for entry in entries:
        key, _, text = entry.partition("=")
        ends = [_parse([f"{key}={end}"], _VARIED, "range") for end in text.split(":")]
        name = next(iter(ends[0]))
        if len(ends) > 2:
            raise CatalogueError(f"range {entry!r} must read key_unit=least:greatest")
        found[name] = ends[0][name], ends[-1][name]
    return SearchRanges(**found)


def parse_tube(entries: Iterable[str]) -> TubeOptions:
    """What entries such as `modulus_psi=28e6` and `free_length_in=3` say of the swage tubes.

    Args:
        entries: `key_unit=value`; keys modulus, yield_stress, free_length and supported_length.

    Raises:
        CatalogueError: an entry that cannot be read, with what is known, or that is not > 0.

    >>> parse_tube(["modulus_GPa=193", "yield_stress_MPa=215"]).yield_stress
    215000000.0
    """
    given = _parse(entries, _TUBE, "tube option")
    for name, value in given.items():
        if value <= 0:
            raise CatalogueError(f"the tube's {name} must be > 0, got {value:.6g} in SI")
    return TubeOptions(**given)


def _parse(entries: Iterable[str], kinds: Mapping[str, str], what: str) -> dict[str, float]:
    """Numbers in SI by name; `kinds` names what may be given and the kind of its unit."""
    keys = {
        f"{name}_{unit}" if unit else name: (name, factor)
        for name, kind in kinds.items()
        for unit, factor in UNITS.get(kind, {"": 1.0}).items()
    }
    given: dict[str, float] = {}
    for entry in entries:
        key, equals, text = (part.strip() for part in entry.partition("="))
        if key not in keys:
            raise CatalogueError(f"unknown {what} {entry!r}; known are {', '.join(keys)}")
        name, factor = keys[key]
        if name in given:
            raise CatalogueError(f"the {what} {name} is given twice")
        try:
            given[name] = float(text) * factor
        except ValueError:
            raise CatalogueError(f"{what} {entry!r}: {text!r} is not a number") from None
        if not equals or not math.isfinite(given[name]):
            raise CatalogueError(f"{what} {entry!r} must read key_unit=value, finite")
    return given

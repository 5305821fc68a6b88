"""Options of a design, `key_unit=value`, as numbers in SI."""

import math
from collections.abc import Iterable, Mapping

from ...boundary.units import UNITS
from ...design.catalogue import CatalogueError
from ...design.search import Range, Requirement

_REQUIREMENT = {
    "pressure": "pressure",
    "force": "force",
    "contraction": "number",
    "largest_diameter": "length",
    "force_contraction": "number",
    "stroke": "length",
    "longest_length": "length",
    "thread_factor": "number",
    "tube_factor": "number",
}
_VARIED = {"rest_length": "length", "pressure": "pressure"}
_USUAL = 0.5  # longest rest length [m] where none is asked for


def parse_requirement(entries: Iterable[str]) -> Requirement:
    """The requirement of entries such as `force_lbf=900`, `stroke_mm=50` and `contraction=0.3`.

    Args:
        entries: `key_unit=value`; the keys are the fields of `Requirement`, and pressure is needed.

    Raises:
        InputError: an entry that cannot be read, with what is known, or that no muscle can meet.

    >>> parse_requirement(["pressure_bar=7", "stroke_mm=50"]).stroke
    0.05
    """
    given = _parse(entries, _REQUIREMENT, "requirement")
    if "pressure" not in given:
        raise CatalogueError("a requirement needs the pressure, as in --require pressure_psi=100")
    return Requirement(**given)


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


def parse_ranges(entries: Iterable[str], requirement: Requirement) -> dict[str, Range]:
    """What a search varies: entries such as `rest_length_mm=100:600` and `pressure_psi=20:100`.

    Args:
        entries: `key_unit=least:greatest`; one number keeps it fixed. What is not given goes from a
            quarter of the required pressure, and of the longest length or 0.5 m, to all of it.
        requirement: in SI.

    Raises:
        CatalogueError: an entry that cannot be read, with what is known.

    >>> asked = parse_requirement(["pressure_kPa=700"])
    >>> parse_ranges(["rest_length_mm=100:600"], asked)
    {'pressure': (175000.0, 700000.0), 'rest_length': (0.1, 0.6)}
    """
    longest = requirement.longest_length if requirement.longest_length < math.inf else _USUAL
    found = {
        "pressure": (requirement.pressure / 4, requirement.pressure),
        "rest_length": (longest / 4, longest),
    }
    for entry in entries:
        key, _, text = entry.partition("=")
        ends = [_parse([f"{key}={end}"], _VARIED, "range") for end in text.split(":")]
        name = next(iter(ends[0]))
        if len(ends) > 2:
            raise CatalogueError(f"range {entry!r} must read key_unit=least:greatest")
        found[name] = ends[0][name], ends[-1][name]
    return found


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

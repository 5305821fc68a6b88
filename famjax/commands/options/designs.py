"""Options of a design, `key_unit=value`, as numbers in SI."""

import math
from collections.abc import Iterable, Mapping

from ...boundary.units import UNITS
from ...design.catalogue import CatalogueError
from ...design.catalogue_search import Requirement
from ...design.swage_tube import TubeOptions

_REQUIREMENT = {
    "pressure": "pressure",
    "force": "force",
    "contraction": "number",
    "largest_diameter": "length",
    "force_contraction": "number",
}
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
        CatalogueError: an entry that cannot be read, with what is known.

    >>> parse_requirement(["pressure_psi=100", "contraction=0.3"]).contraction
    0.3
    """
    given = _parse(entries, _REQUIREMENT, "requirement")
    if "pressure" not in given:
        raise CatalogueError("a requirement needs the pressure, as in --require pressure_psi=100")
    try:
        return Requirement(**{"force": 0.0, "contraction": 0.0, **given})
    except ValueError as error:
        raise CatalogueError(str(error)) from None


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

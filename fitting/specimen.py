"""Specimens: known properties of a muscle before the fit, and plausible ranges that reveal unit errors."""

import contextlib
import contextvars
import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from famjax.boundary.errors import InputError, meant
from famjax.boundary.units import UNITS, Quantity, si_unit, to_si

from .arguments import is_number, shown

DEFAULT_WALL_THICKNESS = 1.8e-3
"""Bladder wall thickness [m] of the Festo DMSP (Martens & Boblan 2017), assumed if none is given."""

_WALL_OF_BORE = 0.18  # largest ratio of wall to bore, from the DMSP-10, the smallest known DMSP


class Plausible(NamedTuple):
    """Plausible range of a muscle property.

    Attributes:
        kind: type of unit, a key of `UNITS`.
        low, high: generous limits [SI].
        usual: typical value [SI], used to guess the unit.
    """

    kind: str
    low: float
    high: float
    usual: float


PLAUSIBLE = {
    "length": Plausible("length", 5e-3, 5.0, 0.25),
    "diameter": Plausible("length", 0.5e-3, 0.3, 20e-3),
    "thickness": Plausible("length", 1e-6, 0.05, 1.5e-3),
    "dead length": Plausible("length", 1e-6, 2.0, 10e-3),
    "offset of a length": Plausible("length", 0.0, 0.05, 0.3e-3),
    "pressure": Plausible("pressure", 1e3, 3e7, 4e5),
    "deadband": Plausible("pressure", 50.0, 5e6, 3e4),
    "force": Plausible("force", 1e-3, 3e5, 1e3),
    "stress": Plausible("stress", 1e3, 1e12, 1e6),
    "braid angle": Plausible("angle", 0.1, math.pi / 2, 1.2),
    "compliance": Plausible("compliance", 0.0, 1e-2, 1e-5),
}
"""Generous ranges for muscles of 2 to 150 mm diameter and 10 mm to 3 m length, up to 10 MPa and 100 kN."""

QUANTITIES = {
    "rest_length": "length", "length": "length", "end_length": "dead length",
    "wall_thickness": "thickness", "braid_thickness": "thickness", "nominal_diameter": "diameter",
    "bladder_diameter": "diameter", "braid_diameter": "diameter", "braid_angle": "braid angle",
    "pressure": "pressure", "deadband_pressure": "deadband", "force": "force", "force_limit": "force",
    "series_compliance": "compliance",
}  # fmt: skip
"""Key of `PLAUSIBLE` for each column, specimen field or parameter."""

_MOST_IN = {"cm": 1.0}  # m: longer muscles are given in m, so 250 cm is probably 250 mm
_NARROWEST = 1e-6  # smallest relative standard deviation of a prior
_ALIKE = 0.5  # decades within which two guesses are equally good

_ANY_UNITS = contextvars.ContextVar("any consistent units", default=False)


@contextlib.contextmanager
def any_units() -> Iterator[None]:
    """Allow maps in any consistent set of units, such as inch, psi and lbf.

    Inside the context, plausibility is not checked. Also usable as a decorator, `@any_units()`.
    """
    token = _ANY_UNITS.set(True)
    try:
        yield
    finally:
        _ANY_UNITS.reset(token)


def check_plausible(what: str, value: float, quantity: str | None, unit: str = "") -> None:
    """Reject an implausible value and suggest its likely unit.

    Args:
        what: subject of the message, such as "the rest length".
        value: value in SI; zero and non-finite values are accepted.
        quantity: key of `PLAUSIBLE`; None if no range is known.
        unit: unit in which the value was given; default: SI.

    Raises:
        InputError: the value is outside the plausible range.

    >>> check_plausible("the rest length", 0.27, "length")
    >>> check_plausible("the rest length", 270.0, "length")
    Traceback (most recent call last):
    famjax.boundary.errors.InputError: the rest length is 270 m, but a muscle's length must be between \
0.005 and 5 m. The value looks like mm, not m
    """
    size = abs(value)
    if quantity is None or size == 0 or not math.isfinite(size) or _ANY_UNITS.get():
        return
    known = PLAUSIBLE[quantity]
    si = si_unit(known.kind)
    said = unit or si
    high = min(known.high, _MOST_IN.get(said, math.inf))
    if known.low <= size <= high:
        return
    scale = UNITS[known.kind][said]
    number, low, most = value / scale, known.low / scale, high / scale
    likely = " or ".join(_guesses(abs(number), known, said))
    guess = f"The value looks like {likely}, not {said}" if likely else "Check its unit"
    longer = ". If it is correct, specify it in m" if most < known.high / scale else ""
    raise InputError(
        f"{what} is {number:.6g} {said}, but a muscle's {quantity} must be between {low:.3g} and "
        f"{most:.3g} {said}. {guess}{longer}"
    )


def _guesses(number: float, known: Plausible, said: str) -> list[str]:
    """Return up to two units in which a number would be plausible, the most likely first."""
    away = {
        unit: abs(math.log10(number * size / known.usual))
        for unit, size in UNITS[known.kind].items()
        if unit != said and known.low <= number * size <= known.high
    }
    best = min(away.values(), default=0.0)
    return sorted((u for u in away if away[u] < best + _ALIKE), key=away.__getitem__)[:2]


def quantity_of(name: str, kind: str) -> str | None:
    """Return the key of `PLAUSIBLE` for a parameter, or None."""
    return QUANTITIES.get(name) or ("stress" if kind == "stress" else None)


def check_bounds(name: str, kind: str, ends: Iterable[float], unit: str = "") -> None:
    """Reject bounds (or a fixed value) of implausible magnitude.

    Args:
        name: name of the parameter.
        kind: type of its unit.
        ends: bounds, or the fixed value, in SI.
        unit: unit in which they were given.

    Raises:
        InputError: the larger bound is outside the plausible range.
    """
    most = max((abs(end) for end in ends if math.isfinite(end)), default=0.0)
    check_plausible(f"the bound on {name}", most, quantity_of(name, kind), unit)


def check_prior(name: str, kind: str, prior: tuple[float, float], unit: str = "") -> None:
    """Reject a prior in the wrong unit, or one so narrow that it fixes the parameter.

    Args:
        name: name of the parameter.
        kind: type of its unit.
        prior: mean and standard deviation in SI.
        unit: unit in which they were given.

    Raises:
        InputError: the prior is outside the plausible range, or too narrow.
    """
    mean, std = prior
    quantity = quantity_of(name, kind)
    check_plausible(f"the prior on {name}", max(abs(mean), std), quantity, unit)
    usual = PLAUSIBLE[quantity].usual if quantity else 0.0
    narrowest = _NARROWEST * max(abs(mean), usual)
    if std < narrowest:
        unit = unit or si_unit(kind)
        mean, std, narrowest = (one / UNITS[kind][unit] for one in (mean, std, narrowest))
        raise InputError(
            f"the prior on {name}, {mean:.6g} +- {std:.3g} {unit}, must have a standard deviation of "
            f"{narrowest:.3g} {unit} or more, because a narrower one fixes the value: use the standard "
            f"error of the measurement, or fix the value with Parameter({mean:.6g}, vary=False, ...)"
        )


@dataclasses.dataclass(frozen=True)
class Specimen:
    """Known properties of the muscle under test.

    Attributes:
        name: name for reports.
        rest_length: active length L0 [m] at zero contraction.
        wall_thickness: bladder wall t0 [m] at rest.
        nominal_diameter: catalogue bore [m], which bounds the braid diameter in a fit; None if unknown.
        bladder_diameter: outer diameter [m] of the bladder at rest; None if it fills the braid.
        braid_thickness: thickness [m] of the braid.
        embedded: True if the threads run inside the rubber (Festo DMSP).
    """

    name: str
    rest_length: float
    wall_thickness: float
    nominal_diameter: float | None = None
    bladder_diameter: float | None = None
    braid_thickness: float = 0.0
    embedded: bool = False

    def __post_init__(self) -> None:
        if not (isinstance(self.name, str) and isinstance(self.embedded, bool | np.bool_)):
            raise InputError(
                "the specimen's name must be a string, and embedded must be True or False; got "
                f"{shown(self.name)} and {shown(self.embedded)}"
            )
        for name in SPECIMEN_LENGTHS:
            size, zero = getattr(self, name), name == "braid_thickness"
            if size is None and name in {"nominal_diameter", "bladder_diameter"}:
                continue
            if size is None or not (is_number(size) and 0 <= size < math.inf and size + zero > 0):
                must = "a length >= 0" if zero else "a positive length"
                raise InputError(f"{name} must be {must} in m, got {size!r}")
            check_plausible(name, size, QUANTITIES[name])
        wall, bore = self.wall_thickness, self.nominal_diameter or math.inf
        widest = self.bladder_diameter or bore + 2 * wall
        if 2 * wall >= widest:
            raise InputError(
                f"the wall of {wall * 1e3:.4g} mm must be thinner than half the bladder diameter of "
                f"{widest * 1e3:.4g} mm: check wall_thickness, nominal_diameter and bladder_diameter, "
                "and their units"
            )
        if self.embedded and self.bladder_diameter is not None:
            raise InputError(
                "bladder_diameter does not apply to an embedded braid, which runs inside the wall: omit "
                "bladder_diameter, or set embedded = false"
            )


SPECIMEN_LENGTHS = (
    "rest_length", "wall_thickness", "nominal_diameter", "bladder_diameter", "braid_thickness",
)  # fmt: skip
"""Fields of `Specimen` that are lengths."""


def said_number(value: str, what: str) -> float:
    """Convert text from a specimen entry to a number."""
    try:
        return float(value)
    except ValueError:
        hint = " (use a decimal point)" if "," in value else ""
        raise InputError(f"{what} is {value!r}, not a number{hint}") from None


def parse_specimen(entries: Iterable[str]) -> dict[str, Any]:
    """Parse entries such as `rest_length_mm=296` into fields of `Specimen` in SI.

    Raises:
        InputError: an entry is malformed, or a field is given twice.

    >>> parse_specimen(["rest_length_in=10", "embedded=false"])
    {'rest_length': 0.254, 'embedded': False}
    """
    fields: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = (part.strip() for part in entry.partition("="))
        if not equals:
            raise InputError(
                f"specimen {entry!r} must have the form key=value, as in rest_length_mm=296"
            )
        name, field = _specimen_field(key, value)
        if name in fields:
            raise InputError(f"the specimen's {name} is given twice")
        fields[name] = field
    return fields


def _specimen_field(key: str, value: str) -> tuple[str, Any]:
    """Return the name and SI value of one field of `Specimen`."""
    if key == "name":
        return key, value
    if key == "embedded":
        if value not in {"true", "false"}:
            raise InputError(f"the specimen entry embedded must be true or false, got {value!r}")
        return key, value == "true"
    name, _, unit = key.rpartition("_")
    if name not in (*SPECIMEN_LENGTHS, "force_limit"):
        known = [*(f"{one}_mm" for one in SPECIMEN_LENGTHS), "force_limit_N", "name", "embedded"]
        near = [f"{one}_{unit}" for one in SPECIMEN_LENGTHS for unit in UNITS["length"]]
        raise InputError(
            f"unknown specimen entry {key!r}; choose from {', '.join(known)}{meant(key, [*near, *known])}. "
            f"If it is a parameter of the fit, use --prior {key}=MEAN+-STD, or fix it with --bounds "
            f"{key}={value}"
        )
    kind = "force" if name == "force_limit" else "length"
    in_si = to_si(said_number(value, f"the specimen's {key}"), unit, kind)
    # `Specimen` itself refuses values that are not positive.
    check_plausible(f"the specimen's {name}", max(in_si, 0.0), QUANTITIES[name], unit)
    return name, in_si


class Described(NamedTuple):
    """A specimen whose missing fields were assumed.

    Attributes:
        specimen: the completed specimen.
        notes: one sentence for each assumed field.
        assumed: names of the assumed fields, as in `ForceData`.
    """

    specimen: Specimen
    notes: tuple[str, ...]
    assumed: tuple[str, ...]


def describe(known: Mapping[str, Any], longest: float) -> Described:
    """Complete a specimen with defaults for missing fields.

    Args:
        known: fields of `Specimen` in SI, including the name.
        longest: longest measured length [m]; used as the rest length if none is given.
    """
    fields, notes = dict(known), {}

    def assume(name: str, text: str) -> None:
        notes[name] = f"The {text} (--specimen {name}_mm=...)."

    if "rest_length" not in fields:
        fields["rest_length"] = longest
        said = Quantity(longest, "length").in_units("metric")
        assume(
            "rest_length",
            f"rest length was not given: the longest length in the file, {said}, is used",
        )
    if "nominal_diameter" not in fields:
        searched = "the fit searches for the braid diameter between 3 mm and 80 mm"
        assume("nominal_diameter", f"nominal diameter was not given: {searched}")
    if "wall_thickness" not in fields:
        across = fields.get("nominal_diameter") or fields.get("bladder_diameter") or math.inf
        fields["wall_thickness"] = wall = min(DEFAULT_WALL_THICKNESS, _WALL_OF_BORE * across)
        said = Quantity(wall, "length").in_units("metric")
        scaled = "it changes E_n (inversely) and the fluid volume, but not the force"
        assume("wall_thickness", f"wall thickness was not given: {said} is assumed; {scaled}")
    if "embedded" not in fields and "bladder_diameter" not in fields:
        fields["embedded"] = True
        inside = "the braid is assumed to run inside the wall, as in a Festo DMSP"
        assume("bladder_diameter", f"bladder diameter was not given: {inside}")
    return Described(Specimen(**fields), tuple(notes.values()), tuple(notes))

"""Prior knowledge about a muscle, and the sizes that muscles have.

A number far from what is plausible has another unit than it says.
"""

import contextlib
import contextvars
import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from famjax.boundary.errors import InputError, meant
from famjax.boundary.units import UNITS, Quantity, Sentence, si_unit, to_si

from .arguments import is_number, shown

DEFAULT_WALL_THICKNESS = 1.8e-3
"""Bladder wall [m] assumed where none is given: that of the Festo DMSP (Martens & Boblan 2017)."""

_WALL_OF_BORE = 0.18  # at most: that of the DMSP-10, the smallest muscle that is known to have it
_OF_THE_FIT = ("braid_angle", "braid_diameter", "deadband_pressure")


class Plausible(NamedTuple):
    """A kind of quantity, and its plausible range for muscles.

    Attributes:
        kind: of unit, one of `UNITS`.
        low, high: between which it lies, generously [SI].
        usual: of a common muscle [SI], by which a unit is guessed.
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
"""Muscles of 2 to 150 mm and 10 mm to 3 m, to 10 MPa and 100 kN, lie well within."""

QUANTITIES = {
    "rest_length": "length",
    "wall_thickness": "thickness",
    "braid_thickness": "thickness",
    "nominal_diameter": "diameter",
    "bladder_diameter": "diameter",
    "braid_diameter": "diameter",
    "end_length": "dead length",
    "deadband_pressure": "deadband",
    "braid_angle": "braid angle",
    "series_compliance": "compliance",
    "length": "length",
    "pressure": "pressure",
    "force": "force",
    "force_limit": "force",
}
"""Entry of `PLAUSIBLE` by the name of a column, a size of a specimen or a parameter."""

_MOST_IN = {"cm": 1.0}  # m: who has more of it writes metres, so that 250 cm are 250 mm
_NARROWEST = 1e-6  # of a value: a prior that says more holds it
_ALIKE = 0.5  # decades between guesses that are equally good


_ANY_UNITS = contextvars.ContextVar("any consistent units", default=False)


@contextlib.contextmanager
def any_units() -> Iterator[None]:
    """Within it, maps may be in any consistent set of units, such as inch, psi and lbf.

    Nothing is taken for a slip then. It is a decorator, too: `@any_units()`.
    """
    token = _ANY_UNITS.set(True)
    try:
        yield
    finally:
        _ANY_UNITS.reset(token)


def check_plausible(what: str, value: float, quantity: str | None, unit: str = "") -> None:
    """Refuse an implausible number, and suggest the unit that it looks like.

    Args:
        what: it is, the subject of the sentence.
        value: in SI; of 0, or where it is not finite, nothing is said.
        quantity: entry of `PLAUSIBLE`; None for one of which nothing is known.
        unit: in which it was written; that of SI unless given.

    Raises:
        InputError: the number is outside the plausible range.

    >>> check_plausible("the rest length", 0.27, "length")
    >>> check_plausible("the rest length", 270.0, "length")
    Traceback (most recent call last):
    famjax.boundary.errors.InputError: the rest length is 270 m, but a length of a muscle lies between \
0.005 and 5 m. It looks like mm, not m
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
    guess = f"It looks like {likely}, not {said}" if likely else "Check its unit"
    longer = ". If it is that long, write it in m" if most < known.high / scale else ""
    raise InputError(
        f"{what} is {number:.6g} {said}, but a {quantity} of a muscle lies between {low:.3g} and "
        f"{most:.3g} {said}. {guess}{longer}"
    )


def _guesses(number: float, known: Plausible, said: str) -> list[str]:
    """Units in which a number would be plausible, the likeliest first, two at most."""
    away = {
        unit: abs(math.log10(number * size / known.usual))
        for unit, size in UNITS[known.kind].items()
        if unit != said and known.low <= number * size <= known.high
    }
    best = min(away.values(), default=0.0)
    return sorted((u for u in away if away[u] < best + _ALIKE), key=away.__getitem__)[:2]


def quantity_of(name: str, kind: str) -> str | None:
    """What a parameter is: by its name, or a stress by its kind; None where nothing is known of it."""
    return QUANTITIES.get(name) or ("stress" if kind == "stress" else None)


def check_bounds(name: str, kind: str, ends: Iterable[float], unit: str = "") -> None:
    """Refuse bounds, or a value at which a parameter is held, of which the larger is not plausible.

    Args:
        name: of the parameter.
        kind: of its unit.
        ends: that were given, in SI.
        unit: in which they were written.

    Raises:
        InputError: the bounds are outside what a muscle has.
    """
    most = max((abs(end) for end in ends if math.isfinite(end)), default=0.0)
    check_plausible(f"the bound of {name}", most, quantity_of(name, kind), unit)


def check_prior(name: str, kind: str, prior: tuple[float, float], unit: str = "") -> None:
    """Refuse a prior in another unit, and a prior so narrow that it fixes the parameter.

    Args:
        name: of the parameter.
        kind: of its unit.
        prior: mean and standard deviation in SI.
        unit: in which they were written.

    Raises:
        InputError: the prior is outside what a muscle has, or narrower than a fit can tell.
    """
    mean, std = prior
    quantity = quantity_of(name, kind)
    check_plausible(f"the prior of {name}", max(abs(mean), std), quantity, unit)
    usual = PLAUSIBLE[quantity].usual if quantity else 0.0
    narrowest = _NARROWEST * max(abs(mean), usual)
    if std < narrowest:
        scale = UNITS[kind][unit] if unit else 1.0
        said = unit or si_unit(kind)
        raise InputError(
            f"the prior of {name}, {mean / scale:.6g} +- {std / scale:.3g} {said}, must have a standard "
            f"deviation of {narrowest / scale:.3g} {said} or more: one that is narrower holds the value. "
            f"Hold it, by bounds of that value or Parameter({mean / scale:.6g}, vary=False, ...), or "
            "give the error with which it was measured"
        )


@dataclasses.dataclass(frozen=True)
class Specimen:
    """Prior knowledge about the muscle, beyond the force map.

    Attributes:
        name: for reports.
        rest_length: active length L0 [m] of zero contraction.
        wall_thickness: bladder wall t0 [m] at rest.
        nominal_diameter: bore [m] by which the muscle is sold, or None; it bounds the braid
            diameter of a fit.
        bladder_diameter: outer diameter [m] of the bladder at rest, or None where it fills the
            braid.
        braid_thickness: [m].
        embedded: True where the threads run inside the rubber (Festo DMSP).
    """

    name: str
    rest_length: float
    wall_thickness: float
    nominal_diameter: float | None = None
    bladder_diameter: float | None = None
    braid_thickness: float = 0.0
    embedded: bool = False

    def __post_init__(self) -> None:
        if not isinstance(self.name, str):
            raise InputError(f"the specimen's name must be a text, got {shown(self.name)}")
        if not isinstance(self.embedded, bool | np.bool_):
            raise InputError(
                f"the specimen's embedded must be True or False, got {shown(self.embedded)}"
            )
        for name in SPECIMEN_LENGTHS:
            size = getattr(self, name)
            if size is None and name in {"nominal_diameter", "bladder_diameter"}:
                continue
            positive = name != "braid_thickness"
            known = size is not None and is_number(size)
            if size is None or not (known and 0 <= size < math.inf and (size > 0 or not positive)):
                must = "a positive length" if positive else "a length >= 0"
                raise InputError(f"{name} must be {must} in m, got {size!r}")
            check_plausible(name, size, QUANTITIES[name])
        wall, bore = self.wall_thickness, self.nominal_diameter or math.inf
        widest = self.bladder_diameter or bore + 2 * wall
        if 2 * wall >= widest:
            raise InputError(
                f"a wall of {wall * 1e3:.4g} mm does not fit twice into a bladder of "
                f"{widest * 1e3:.4g} mm: one of the two is wrong; check wall_thickness and "
                "nominal_diameter or bladder_diameter, and their units"
            )
        if self.embedded and self.bladder_diameter is not None:
            raise InputError(
                "an embedded braid runs inside the wall, so the bladder has no diameter of its "
                "own: leave bladder_diameter out, or set embedded = false"
            )


SPECIMEN_LENGTHS = (
    "rest_length",
    "wall_thickness",
    "nominal_diameter",
    "bladder_diameter",
    "braid_thickness",
)
"""Fields of `Specimen` that are lengths."""


def said_number(value: str, what: str) -> float:
    """A number from a line that describes a muscle."""
    try:
        return float(value)
    except ValueError:
        hint = " (write a decimal point)" if "," in value else ""
        raise InputError(f"{what} is {value!r}, not a number{hint}") from None


def parse_specimen(entries: Iterable[str]) -> dict[str, Any]:
    """Fields of `Specimen` in SI, from entries such as `rest_length_mm=296`.

    Raises:
        InputError: an entry that is not of this form, or a field twice.

    >>> parse_specimen(["rest_length_in=10", "embedded=false"])
    {'rest_length': 0.254, 'embedded': False}
    """
    fields: dict[str, Any] = {}
    for entry in entries:
        key, equals, value = (part.strip() for part in entry.partition("="))
        if not equals:
            raise InputError(f"specimen {entry!r} must read key=value, as in rest_length_mm=296")
        name, field = _specimen_field(key, value)
        if name in fields:
            raise InputError(f"the specimen's {name} is given twice")
        fields[name] = field
    return fields


def _specimen_field(key: str, value: str) -> tuple[str, Any]:
    """Name and SI value of one field of `Specimen`, from a key with its unit and a text."""
    if key == "name":
        return key, value
    if key == "embedded":
        if value not in {"true", "false"}:
            raise InputError(f"the specimen's embedded must be true or false, got {value!r}")
        return key, value == "true"
    name, _, unit = key.rpartition("_")
    if name in _OF_THE_FIT:
        raise InputError(
            f"{name} is identified by the fit, and no entry of the specimen: what is known of it is "
            f"--prior {key}=MEAN+-STD, or held by --bounds {key}={value}"
        )
    if name not in (*SPECIMEN_LENGTHS, "force_limit"):
        others = ["force_limit_N", "name", "embedded"]
        known = [*(f"{length}_mm" for length in SPECIMEN_LENGTHS), *others]
        near = [f"{length}_{one}" for length in SPECIMEN_LENGTHS for one in UNITS["length"]]
        raise InputError(
            f"unknown entry of the specimen {key!r}; known are {', '.join(known)}"
            f"{meant(key, [*near, *others])}"
        )
    kind = "force" if name == "force_limit" else "length"
    in_si = to_si(said_number(value, f"the specimen's {key}"), unit, kind)
    # What is not positive the specimen itself refuses.
    check_plausible(f"the specimen's {name}", max(in_si, 0.0), QUANTITIES[name], unit)
    return name, in_si


class Described(NamedTuple):
    """A specimen that is not completely described.

    Attributes:
        specimen: with what had to be assumed.
        notes: a sentence for each value that was.
        assumed: their names, as in `ForceData`.
    """

    specimen: Specimen
    notes: tuple[str, ...]
    assumed: tuple[str, ...]


def describe(known: Mapping[str, Any], longest: float) -> Described:
    """Complete a specimen with defaults for missing fields.

    Args:
        known: fields of `Specimen` in SI; the name is needed.
        longest: longest measured length [m]; used as rest length if none is given.
    """
    fields, notes = dict(known), {}
    if "rest_length" not in fields:
        fields["rest_length"] = longest
        notes["rest_length"] = Sentence(
            "The rest length was not given: the longest length in the file, ",
            Quantity(longest, "length"),
            ", is taken (--specimen rest_length_mm=...).",
        )
    if "nominal_diameter" not in fields:
        notes["nominal_diameter"] = Sentence(
            "The nominal diameter was not given: the braid diameter is sought between ",
            Quantity(3e-3, "length", 3),
            " and ",
            Quantity(80e-3, "length", 3),
            " (--specimen nominal_diameter_mm=...), and may not be that of a muscle on sale.",
        )
    if "wall_thickness" not in fields:
        across = fields.get("nominal_diameter") or fields.get("bladder_diameter") or math.inf
        fields["wall_thickness"] = min(DEFAULT_WALL_THICKNESS, _WALL_OF_BORE * across)
        notes["wall_thickness"] = Sentence(
            "The bladder's wall was not given: ",
            Quantity(fields["wall_thickness"], "length"),
            " is assumed (--specimen wall_thickness_mm=...). E_n scales nearly inversely with it; "
            "the force does not change.",
        )
    if "embedded" not in fields and "bladder_diameter" not in fields:
        fields["embedded"] = True
        notes["bladder_diameter"] = (
            "The bladder's diameter was not given: the braid is taken to run inside the wall, as "
            "in a Festo DMSP (--specimen bladder_diameter_mm=..., or embedded=false)."
        )
    return Described(Specimen(**fields), tuple(notes.values()), tuple(notes))

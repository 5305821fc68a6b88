"""What an argument must be, refused in one sentence where it is something else.

And plausible sizes of a muscle's quantities: a number far from them has another unit than it says.
"""

import contextlib
import contextvars
import math
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS, si_unit

_SHOWN = 60
"""Characters of a value in a message."""


def is_number(value: object) -> bool:
    """Whether it is one real number: no text, no truth value, no array of several."""
    if isinstance(value, str | bytes | bool):
        return False
    try:
        array = np.asarray(value)
    except (TypeError, ValueError):
        return False
    return array.ndim == 0 and array.dtype.kind in "iuf"


def check_whole(name: str, value: Any, least: int = 0, most: int | None = None) -> int:
    """A whole number, as Python's.

    Args:
        name: of the argument.
        value: given.
        least: it may be.
        most: it may be.

    Raises:
        InputError: it is none, or out of range.

    >>> check_whole("starts", 16, 1)
    16
    """
    highest = math.inf if most is None else most
    if not (is_number(value) and math.isfinite(value) and least <= value <= highest) or value % 1:
        to = f">= {least}" if most is None else f"{least} to {most}"
        raise InputError(f"{name} must be a whole number {to}, got {shown(value)}")
    return int(value)


def check_numbers(name: str, values: Any) -> np.ndarray:
    """An array of floats.

    Raises:
        InputError: it holds something that is no number, or rows of different lengths.
    """
    try:
        return np.asarray(values, float)
    except (TypeError, ValueError):
        raise InputError(f"{name} must hold numbers, got {shown(values)}") from None


def check_pair(name: str, pair: Any, what: str) -> tuple[float, float]:
    """Two numbers, such as bounds.

    Raises:
        InputError: they are not two, or no numbers.
    """
    given = list(pair) if isinstance(pair, tuple | list | np.ndarray) else []
    if len(given) != 2 or not all(map(is_number, given)):
        raise InputError(f"{name} {what}, got {shown(pair)}")
    return float(given[0]), float(given[1])


def check_mapping(name: str, given: Any, holds: str) -> None:
    """Refuse what is no mapping by name.

    Raises:
        InputError: it is none.
    """
    if given is not None and not isinstance(given, Mapping):
        raise InputError(f"{name} must be a mapping {holds}, got {shown(given)}")


def check_names(name: str, given: Any) -> tuple[str, ...]:
    """Several names; one alone, as a text, is a likely slip.

    Raises:
        InputError: it is a text, or holds something else than texts.
    """
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise InputError(f"{name} must be names in a tuple or list, as ({shown(given)},)")
    names = tuple(given)
    if not all(isinstance(one, str) for one in names):
        raise InputError(f"{name} must be names in a tuple or list, got {shown(names)}")
    return names


def check_path(name: str, given: Any) -> Path:
    """A path.

    Raises:
        InputError: it is neither a text nor a path.
    """
    if not isinstance(given, str | Path):
        raise InputError(f"{name} must be a path, as a text or a pathlib.Path, got {shown(given)}")
    return Path(given)


def shown(value: object) -> str:
    """A value as a message shows it: what is long, or a table, by its type."""
    text = repr(value)
    plain = "\n" not in text and len(text) <= _SHOWN
    kind = type(value).__name__
    return text if plain else f"{'an' if kind[0] in 'aeiouAEIOU' else 'a'} {kind}"


class Plausible(NamedTuple):
    """A kind of quantity, and what muscles have of it.

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
    """Refuse a number that no muscle has, and say which unit it looks like.

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
    """Refuse a prior of another unit, and one that is so narrow that it holds the parameter.

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

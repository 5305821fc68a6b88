"""What is probably wrong with lengths that no muscle of the specimen's rest length can have."""

import itertools
import math
from collections.abc import Iterator

import numpy as np

from famjax.boundary.sentence import Quantity, Sentence
from famjax.boundary.units import UNITS

from .force_data import ForceData

_REACH = (0.55, 1.07)  # of the rest length: what muscles of rubber and threads come to
_LONGEST = 0.85  # of the rest length: the longest length of most tests is above it
_USUAL = 0.25  # m: rest length of a usual muscle
_ALIKE = 0.5  # decades: taken as equal


def likely_length_fault(data: ForceData) -> str:
    """The likeliest fault of a map whose lengths cannot be reached, a sentence, or "".

    >>> import dataclasses
    >>> from fitting import load_bundled
    >>> data = load_bundled("DMSP-20-300")
    >>> likely_length_fault(dataclasses.replace(data, length=data.length / 10, units={"length": "mm"}))
    'It looks as if the lengths were in cm, not mm.'
    """
    rest, length = data.specimen.rest_length, data.length[data.loaded]
    said = data.units.get("length", "mm")
    low, high = float(length.min()) / rest, float(length.max()) / rest
    of_lengths = {
        factor: f"the lengths were {_name(unit)}, not {_name(said)[3:]}"
        for unit, size in UNITS["length"].items()
        if unit != said and _near(low, high, factor := size / UNITS["length"][said])
    }
    of_rest = {
        factor: f"the rest length was {_name(true)}, not {_name(typed)[3:]}"
        for factor, typed, true in _mistaken_units()
        if _near(low, high, 1 / factor)
    }
    # Either change brings the two together; they differ in the muscle that is left.
    left = [(_unlikely(rest), sentence) for sentence in of_lengths.values()]
    left += [(_unlikely(rest * factor), sentence) for factor, sentence in of_rest.items()]
    if left:
        left.sort(key=lambda one: one[0])
        likely = [sentence for away, sentence in left if away < left[0][0] + _ALIKE][:2]
        return f"It looks as if {', or '.join(likely)}."
    if _falls_with_length(data):
        return (
            "It looks as if the lengths were contractions, as the force falls when they grow: these "
            "stand in a column contraction, as fractions, or contraction_%, in percent."
        )
    within = (length > _REACH[0] * rest) & (length < _REACH[1] * rest)
    if within.any():
        return Sentence(
            f"The other {int(within.sum())} of {length.size} loaded readings are within its reach: it "
            "looks as if the rest length were another (the longest loaded reading has ",
            Quantity(length.max(), "length"),
            "; the rest length is that of the muscle without pressure and load), or as if there were two "
            "muscles in the file.",
        )
    return ""


def _near(low: float, high: float, factor: float) -> bool:
    """Whether lengths, in parts of the rest length, are those of one muscle when scaled."""
    return _LONGEST <= high * factor <= _REACH[1] and low * factor >= _REACH[0]


def _unlikely(rest: float) -> float:
    """Decades between a rest length and a usual one."""
    return abs(math.log10(rest / _USUAL))


def _mistaken_units() -> Iterator[tuple[float, str, str]]:
    """Factors of a length with a wrong unit: by how much it is too short, what was typed, what is true."""
    for typed, true in itertools.permutations(("mm", "cm", "m", "in"), 2):
        yield UNITS["length"][true] / UNITS["length"][typed], typed, true


def _name(unit: str) -> str:
    return "in inches" if unit == "in" else f"in {unit}"


def _falls_with_length(data: ForceData) -> bool:
    """Whether the force falls as what is said to be the length grows, at most pressures."""
    slopes = []
    for one in np.unique(data.pressures.level[data.loaded]):
        mine = data.loaded & (data.pressures.level == one)
        if np.unique(data.length[mine]).size > 1:
            slopes.append(np.polyfit(data.length[mine], data.force[mine], 1)[0])
    return bool(slopes) and float(np.mean(np.array(slopes) < 0)) > 0.5

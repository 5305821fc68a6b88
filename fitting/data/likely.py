"""What is probably wrong with lengths that no muscle of the specimen's rest length can have."""

import numpy as np

from famjax.boundary.units import UNITS

from .force_data import ForceData

_REACH = (0.55, 1.07)  # of the rest length: what muscles of rubber and threads come to
_LONGEST = 0.85  # of the rest length: the longest length of most tests is above it


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
    low, high = length.min() / rest, length.max() / rest
    for unit, size in UNITS["length"].items():
        factor = size / UNITS["length"][said]
        for what, by in (("lengths were", factor), ("rest length was", 1 / factor)):
            near = _LONGEST <= high * by <= _REACH[1] and low * by >= _REACH[0]
            if near and unit != said:
                return f"It looks as if the {what} {_name(unit)}, not {_name(said)[3:]}."
    if _falls_with_length(data):
        return (
            "It looks as if the lengths were contractions, as the force falls when they grow: these "
            "stand in a column contraction, as fractions, or contraction_%, in percent."
        )
    within = (length > _REACH[0] * rest) & (length < _REACH[1] * rest)
    if within.any():
        return (
            f"The other {int(within.sum())} of {length.size} loaded readings are within its reach: it "
            "looks as if there were two muscles in the file."
        )
    return ""


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

"""Checks of data and options before an identification starts."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from .arguments import is_number
from .convex import Status
from .data import ForceData
from .engine import Batch, solve
from .families import AbstractGeometrySource, Law
from .parameters import KINDS, Entry, standard_table
from .problem import Problem
from .response import CONSTRAINTS

_REACH = (0.55, 1.07)  # range of lengths of rubber muscles, relative to the rest length
_LONGEST_AT_LEAST = 0.85  # longest length in most tests, relative to the rest length
_WORDS = {"in": "inches"}
_USUAL = 0.25  # m: usual rest length of a muscle
_ALIKE = 0.5  # decades within which two guesses are equally likely
_SAME_LENGTH = 1e-6  # relative tolerance for equal rest lengths


def check_law(law: Law, constraint: str) -> None:
    """Check that the options are valid and can be combined."""
    if constraint not in CONSTRAINTS:
        raise InputError(f"the constraint is one of {', '.join(CONSTRAINTS)}, got {constraint!r}")
    if constraint == "slope" and law.material.directions_interact:
        raise InputError(
            "the slope constraint is for laws whose two directions do not interact (polynomial, "
            "saturating, monotone, and those of a class with directions_interact = False), not for "
            f"{type(law.material).__name__}; the drucker constraint covers both directions together"
        )


def known_bounds(
    data: ForceData, geometry: famjax.geometries.AbstractGeometry, given: Mapping[str, object]
) -> dict[str, tuple[float, float]]:
    """Return diameter and angle of a known geometry at rest, without pressure, as fixed parameters.

    Raises:
        InputError: the rest length differs from the specimen's, or a known parameter has bounds.
    """
    rest = float(geometry.rest_length)
    if abs(rest / data.specimen.rest_length - 1) > _SAME_LENGTH:
        raise InputError(
            f"the rest lengths of geometry and specimen must be equal, got {rest * 1e3:.6g} mm and "
            f"{data.specimen.rest_length * 1e3:.6g} mm: set rest_length of the specimen"
        )
    at = geometry.dimensions(rest, 0.0)
    known = {"braid_diameter": 2 * float(at.radius), "braid_angle": float(at.braid_angle)}
    said = [name for name in known if name in given and name not in geometry.declared()]
    if said:
        raise InputError(
            f"{said[0]}: the known geometry already defines it ({known[said[0]]:.6g} in SI at rest); leave "
            "its bounds out, or leave geometry out to identify a cylinder"
        )
    return {name: (value, value) for name, value in known.items() if name not in given}


def check_specimen(
    data: ForceData,
    source: AbstractGeometrySource,
    table: Mapping[str, Entry],
    noise: float | None,
    *,
    censored: bool,
) -> None:
    """Check that parameters match the geometry and the measured lengths, and that priors have a weight."""
    cylinder = KINDS.keys() - standard_table(data.specimen).keys()
    named = sorted(cylinder & table.keys() - source.declared.keys())
    if named and getattr(source, "known", None) is not None:
        raise InputError(
            f"{', '.join(named)}: a known geometry has no such parameter; leave geometry out to "
            "identify a cylinder"
        )
    if censored and "series_compliance" in table:
        raise InputError(
            "censored readings cannot be combined with series_compliance, since the deflection of the rig "
            "is known only for measured forces. Omit one of them"
        )
    _check_lengths(data, table)
    priors = [name for name, entry in table.items() if entry.prior is not None]
    if noise is not None and not (is_number(noise) and 0 < noise < math.inf):
        raise InputError(f"the noise of a reading must be a force > 0 in N, got {noise!r}")
    if noise is not None and data.force_std is not None:
        raise InputError(
            "the readings have standard deviations of their own (force_std): leave noise out"
        )
    if priors and noise is None and data.force_std is None:
        raise InputError(
            f"the prior of {', '.join(priors)} is weighted against the force noise, which is "
            "unknown: give noise, the standard deviation of one reading in N (--error "
            "noise_N=1.5), or a "
            "column force_std in the data"
        )


def _check_lengths(data: ForceData, table: Mapping[str, Entry]) -> None:
    """Check that a braid within the bounds can reach every length."""
    rest, steepest = data.specimen.rest_length, table["braid_angle"].max
    rest = table["rest_length"].min if "rest_length" in table else rest
    longest = rest / math.sin(steepest)
    shortest = longest * math.sin(famjax.braids.NEUTRAL_ANGLE)
    long, short = np.argmax(data.length), np.argmin(np.where(data.loaded, data.length, np.inf))
    # The shortest length depends on compliances.
    gives = any(table[n].max > 0 for n in ("braid_compliance", "series_compliance") if n in table)
    if data.length[long] >= longest:
        reading = int(long)
        said = f"longer than its thread, {longest * 1e3:.5g} mm"
    elif not gives and data.length[short] <= shortest:
        reading = int(short)
        said = (
            f"a contraction of {1 - data.length[short] / rest:.3f}, but no braid of at most "
            f"{math.degrees(steepest):.4g} deg pulls when shorter than {shortest * 1e3:.5g} mm"
        )
    else:
        return
    likely = _likely_length_fault(data)
    raise InputError(
        f"reading {reading + 1} has the length {data.length[reading] * 1e3:.5g} mm, {said} (rest length "
        f"{rest * 1e3:.5g} mm, braid angle at most {math.degrees(steepest):.4g} deg). Check the unit of "
        "the length column and the rest length, and that all readings are of one muscle"
        f"{'. ' * bool(likely)}{likely}"
    )


def check_count(data: Sequence[ForceData], law: Law, table: Mapping[str, Entry]) -> None:
    """Check that there are enough readings for the parameters and enough lengths for the coefficients.

    Specimens identified together are pooled: a shared parameter counts once.
    """
    readings = sum(int(one.loaded.sum()) for one in data)
    free = {name for name, entry in table.items() if not entry.fixed}
    geometry, laws = len(free - law.coefficients.keys()), len(free & law.coefficients.keys())
    if geometry + laws == 0:
        raise InputError("every parameter is fixed by its bounds: there is nothing to identify")
    if readings < geometry + laws:
        raise InputError(
            f"{readings} loaded readings cannot determine {geometry + laws} parameters "
            f"({geometry} of the geometry, {laws} coefficients): give more readings, a lower order, or "
            "fix parameters by bounds"
        )
    strained = sum(np.unique(one.lengths.level[one.strained]).size for one in data)
    if laws and strained < law.order and not law.material.depends_on_pressure:
        rest = ", ".join(f"{one.specimen.rest_length * 1e3:.5g}" for one in data)
        raise InputError(
            f"a law of order {law.order} needs loaded readings at {law.order} or more lengths away from "
            f"the rest length, {rest} mm, where the bladder is not strained; there are {strained}. Use a "
            "lower order, or measure at more lengths"
        )


_ROUGH = 1e-3  # tolerance of the forces in a compliant rig, for a feasibility check
_AFFINE = 1e-7  # rounding of an affine force, relative to the largest column
_SEEN_TO_BE_AFFINE: set[tuple] = set()


def check_affine(problem: Problem) -> None:
    """Check that the force is affine in the coefficients that are declared linear.

    The derivatives at zero and at nonzero coefficients must agree. The result is cached, since it does not
    depend on the numbers.
    """
    batch = Batch([problem])
    if batch.layout.forms in _SEEN_TO_BE_AFFINE:
        return
    middle, n = problem.low + (problem.high - problem.low) / 2, len(problem.linear)
    for part in problem.parts:
        middle[list(part.rig)[:1]] = 0.0

    def columns(x: np.ndarray) -> np.ndarray:
        found, _ = batch.linear_at(middle, x, problem.force)
        return found.columns[batch.layout.readings, :n]

    none = columns(np.zeros(n))
    size = np.nanmax(np.abs(none), axis=0, initial=0.0)
    alone = np.abs(problem.force).max() / np.where(size > 0, size, np.inf)
    with_them = columns(np.where(size > 0, alone, 1.0) * (1 + np.arange(n)))
    change = np.nanmax(np.abs(with_them - none), axis=0, initial=0.0)
    bent = np.flatnonzero(change > _AFFINE * np.nanmax(np.abs([none, with_them]), initial=0.0))
    if bent.size:
        raise InputError(
            f"{', '.join(dict.fromkeys(problem.linear[k] for k in bent))}: declared linear, but the force "
            "is not affine in it. Declare it without linear=True and with a finite range (low and high)"
        )
    _SEEN_TO_BE_AFFINE.add(batch.layout.forms)


def check_solvable(problem: Problem) -> None:
    """Check that the convex fit has a solution in the middle of the bounds."""
    point = solve(problem, problem.low + (problem.high - problem.low) / 2, tolerance=_ROUGH)
    count = problem.force.size
    lost = np.flatnonzero(~np.isfinite(point.A[:count]).all(axis=1) | ~np.isfinite(point.b[:count]))
    if lost.size:
        lengths = np.concatenate([part.inputs.length for part in problem.parts])
        raise InputError(
            f"there is no force at the loaded reading {lost[0] + 1} (length {lengths[lost[0]] * 1e3:.5g} "
            "mm): the geometry has no dimensions there, as the bladder does not fit in the braid or the "
            "length is outside what was measured or can be reached, or a law or term is no number. Check "
            "wall_thickness, nominal_diameter and bladder_diameter of the specimen (diameters, not radii), "
            "its rest length, their units, and force(at, pressure) of terms of your own"
        )
    if not np.isfinite(point.G).all():
        raise InputError(
            "the constraint cannot be posed: the actuation path, which runs to the shortest length "
            "in the map, slack readings included, leaves the range in which the geometry is "
            "known. Leave out "
            "readings that are shorter than the last measured shape, or use --constraint none"
        )
    if point.status in {Status.RANK_DEFICIENT, Status.INFEASIBLE}:
        raise InputError(point.status.message)


def _likely_length_fault(data: ForceData) -> str:
    """Return a sentence on the likeliest fault of a map with unreachable lengths, or ""."""
    rest, length = data.specimen.rest_length, data.length[data.loaded]
    low, high = float(length.min()) / rest, float(length.max()) / rest
    # Both kinds of change reconcile the lengths; the more usual muscle is likelier.
    found = sorted(
        (
            abs(math.log10(then / _USUAL)),
            f"{what} in {_WORDS.get(true, true)}, not {_WORDS.get(said, said)}",
        )
        for scale, then, what, true, said in _unit_slips(data)
        if _LONGEST_AT_LEAST <= high * scale <= _REACH[1] and low * scale >= _REACH[0]
    )
    likely = [sentence for away, sentence in found if away < found[0][0] + _ALIKE][:2]
    return f"It looks as if {', or '.join(likely)}." if likely else ""


def _unit_slips(data: ForceData) -> Iterator[tuple[float, float, str, str, str]]:
    """Yield possible unit errors of the lengths or of the rest length.

    Yields:
        Factor on lengths relative to the rest length, corrected rest length, subject of the message, true
        unit and given unit.
    """
    rest, said = data.specimen.rest_length, data.units.get("length", "mm")
    known = UNITS["length"]
    for true in known:
        if true != said:
            yield known[true] / known[said], rest, "the lengths were", true, said
    for typed, true in itertools.permutations(("mm", "cm", "m", "in"), 2):
        scale = known[true] / known[typed]
        yield 1 / scale, rest * scale, "the rest length was", true, typed

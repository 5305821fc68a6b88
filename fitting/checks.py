"""Check data and options before an identification starts."""

import itertools
import math
from collections.abc import Mapping, Sequence

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
_USUAL = 0.25  # m: usual rest length of a muscle
_ALIKE = 0.5  # decades within which two guesses are equally likely


def check_law(law: Law, constraint: str) -> None:
    """Check that the law and the constraint are valid and can be combined."""
    if constraint not in CONSTRAINTS:
        raise InputError(
            f"the constraint must be one of {', '.join(CONSTRAINTS)}, got {constraint!r}"
        )
    of = type(law.material).__name__
    if constraint == "slope" and law.material.directions_interact:
        raise InputError(
            f"the constraint slope cannot be used with {of}, in which the axial and hoop directions "
            "interact: use drucker"
        )


def known_bounds(
    data: ForceData, geometry: famjax.geometries.AbstractGeometry, given: Mapping[str, object]
) -> dict[str, tuple[float, float]]:
    """Return the diameter and angle of a known geometry, at rest and unpressurised, as fixed parameters.

    Raises:
        InputError: the rest length differs from that of the specimen, or bounds were given for a parameter
            that the geometry defines.
    """
    rest = float(geometry.rest_length)
    if abs(rest / data.specimen.rest_length - 1) > 1e-6:
        both = f"{rest * 1e3:.6g} mm and {data.specimen.rest_length * 1e3:.6g} mm"
        raise InputError(
            f"the geometry and the specimen must have the same rest length, got {both}"
        )
    at = geometry.dimensions(rest, 0.0)
    known = {"braid_diameter": 2 * float(at.radius), "braid_angle": float(at.braid_angle)}
    said = [name for name in known if name in given and name not in geometry.declared()]
    if said:
        raise InputError(f"the known geometry defines {said[0]}: remove the bounds on {said[0]}")
    return {name: (value, value) for name, value in known.items() if name not in given}


def check_specimen(
    data: ForceData,
    source: AbstractGeometrySource,
    table: Mapping[str, Entry],
    noise: float | None,
    *,
    censored: bool,
) -> None:
    """Check that the parameters suit the geometry and the lengths, and that priors can be weighted."""
    cylinder = KINDS.keys() - standard_table(data.specimen).keys()
    named = sorted(cylinder & table.keys() - source.declared.keys())
    if named and getattr(source, "known", None) is not None:
        raise InputError(f"a known geometry has no parameter {' or '.join(named)}: remove it")
    if "braid_compliance" in named and getattr(source, "thread", None) is not None:
        raise InputError("this geometry already models thread stretch: remove braid_compliance")
    if censored and "series_compliance" in table:
        raise InputError("censored readings cannot be combined with series_compliance")
    _check_lengths(data, table)
    priors = [name for name, entry in table.items() if entry.prior is not None]
    if noise is not None and not (is_number(noise) and 0 < noise < math.inf):
        raise InputError(
            f"noise, the standard deviation of a reading in N, must be > 0, got {noise!r}"
        )
    if noise is not None and data.force_std is not None:
        raise InputError("the readings already have a force_std: omit noise")
    if priors and noise is None and data.force_std is None:
        raise InputError(
            f"the prior on {', '.join(priors)} is weighted against the force noise, which is unknown: set "
            "noise to the standard deviation of a reading in N (--error noise_N=1.5), or add a column "
            "force_std"
        )


def _check_lengths(data: ForceData, table: Mapping[str, Entry]) -> None:
    """Check that a braid within the bounds can reach every measured length."""
    rest, steepest = data.specimen.rest_length, table["braid_angle"].max
    rest = table["rest_length"].min if "rest_length" in table else rest
    longest = rest / math.sin(steepest)
    shortest = longest * math.sin(famjax.braids.NEUTRAL_ANGLE)
    long, short = np.argmax(data.length), np.argmin(np.where(data.loaded, data.length, np.inf))
    # The shortest length depends on compliances.
    gives = any(table[n].max > 0 for n in ("braid_compliance", "series_compliance") if n in table)
    if data.length[long] >= longest:
        reading = int(long)
        said = f"which exceeds the thread length, {longest * 1e3:.5g} mm"
    elif not gives and data.length[short] <= shortest:
        reading = int(short)
        said = (
            f"a contraction of {1 - data.length[short] / rest:.3f}, but a braid with an angle of at most "
            f"{math.degrees(steepest):.4g} deg does not pull at lengths below {shortest * 1e3:.5g} mm"
        )
    else:
        return
    raise InputError(
        f"reading {reading + 1} has a length of {data.length[reading] * 1e3:.5g} mm, {said} (rest length "
        f"{rest * 1e3:.5g} mm). Check both lengths and their units, and that all readings are from one "
        f"muscle{_likely_length_fault(data)}"
    )


def check_count(data: Sequence[ForceData], law: Law, table: Mapping[str, Entry]) -> None:
    """Check that there are enough readings for the parameters and enough lengths for the coefficients.

    For specimens identified together, readings are added up and a shared parameter is counted once.
    """
    readings = sum(int(one.loaded.sum()) for one in data)
    free = {name for name, entry in table.items() if not entry.fixed}
    geometry, laws = len(free - law.coefficients.keys()), len(free & law.coefficients.keys())
    if geometry + laws == 0:
        raise InputError("every parameter is fixed by its bounds: there is nothing to identify")
    if readings < geometry + laws:
        raise InputError(
            f"{readings} loaded readings cannot determine {geometry + laws} parameters "
            f"({geometry} geometry parameters, {laws} coefficients): take more readings, or fix some "
            "parameters"
        )
    strained = sum(np.unique(one.lengths.level[one.strained]).size for one in data)
    if laws and strained < law.order and not law.material.depends_on_pressure:
        raise InputError(
            f"a law of order {law.order} needs loaded readings at {law.order} or more lengths other than "
            f"the rest length, but there are {strained}: use a lower order, or measure at more lengths"
        )


_ROUGH = 1e-3  # tolerance of the forces in a compliant rig, for a feasibility check
_AFFINE = 1e-7  # rounding of an affine force, relative to the largest column


def check_affine(problem: Problem) -> None:
    """Check that the force is affine in the coefficients that a user's class declares as linear.

    The derivatives at zero and at nonzero coefficients must agree. famjax's own laws are not checked.
    """
    problem = problem.thinned()
    batch = Batch([problem])
    if all(form.own_code for form in batch.layout.forms):
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
        named = ", ".join(dict.fromkeys(problem.linear[k] for k in bent))
        raise InputError(f"the force is not affine in {named}: declare it without linear=True")


def check_solvable(problem: Problem, data: Sequence[ForceData]) -> None:
    """Check that the convex fit has a solution when all parameters are midway between their bounds."""
    point = solve(problem, problem.low + (problem.high - problem.low) / 2, tolerance=_ROUGH)
    count = problem.force.size
    lost = np.flatnonzero(~np.isfinite(point.A[:count]).all(axis=1) | ~np.isfinite(point.b[:count]))
    if lost.size:
        lengths = np.concatenate([part.inputs.length for part in problem.parts])
        raise InputError(
            f"the force is undefined (nan) at loaded reading {lost[0] + 1} (length "
            f"{lengths[lost[0]] * 1e3:.5g} mm): the bladder does not fit in the braid, the length cannot "
            "be reached or was not measured, or a law or term returns nan. Check the specimen's "
            "wall_thickness, nominal_diameter and bladder_diameter (diameters, not radii), its rest "
            "length, their units, and any laws and terms of your own"
            f"{_likely_length_fault(data[0])}"
        )
    if not np.isfinite(point.G).all():
        raise InputError(
            "the constraint cannot be evaluated: the actuation path, which includes slack readings, "
            "extends beyond the range of the geometry. Remove the readings at the shortest lengths, or "
            "use --constraint none"
        )
    if point.status in {Status.RANK_DEFICIENT, Status.INFEASIBLE}:
        raise InputError(point.status.message)


def _likely_length_fault(data: ForceData) -> str:
    """Return ". It looks as if" and the likely mistake in a unit of length; "" if none is likely."""
    rest, length = data.specimen.rest_length, data.length[data.loaded]
    known, said = UNITS["length"], data.units.get("length", "mm")
    words = {unit: unit for unit in known} | {"in": "inches"}
    # Factor on lengths relative to the rest length, corrected rest length, fault.
    slips = [
        (known[true] / known[said], rest, f"the lengths were in {words[true]}, not {words[said]}")
        for true in known.keys() - {said}
    ]
    for said, true in itertools.permutations(("mm", "cm", "m", "in"), 2):
        scale = known[true] / known[said]
        fault = f"the rest length was in {words[true]}, not {words[said]}"
        slips.append((1 / scale, rest * scale, fault))
    low, high = float(length.min()) / rest, float(length.max()) / rest
    # Both kinds of change reconcile the lengths; the more usual muscle is likelier.
    found = sorted(
        (abs(math.log10(then / _USUAL)), fault)
        for scale, then, fault in slips
        if _LONGEST_AT_LEAST <= high * scale <= _REACH[1] and low * scale >= _REACH[0]
    )
    likely = [fault for away, fault in found if away < found[0][0] + _ALIKE][:2]
    return f". It looks as if {', or '.join(likely)}" if likely else ""

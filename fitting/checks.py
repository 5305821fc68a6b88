"""What a force map must hold for an identification to make sense, asked before any work is done."""

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

import famjax
from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from .arguments import check_whole, is_number
from .convex import Status
from .data import ForceData
from .engine import Batch, solve
from .families import AbstractGeometrySource, Law
from .parameters import Entry
from .problem import Problem
from .response import CONSTRAINTS, DEPENDENCES, Constraint, PressureDependence

_COMPLIANCES = ("braid_compliance", "series_compliance")
_REACH = (0.55, 1.07)  # of the rest length: what muscles of rubber and threads come to
_LONGEST_AT_LEAST = 0.85  # of the rest length: the longest length of most tests is above it
_WORDS = {"in": "inches"}
_USUAL = 0.25  # m: rest length of a usual muscle
_ALIKE = 0.5  # decades: taken as equal
_SAME_LENGTH = 1e-6  # relative; rest lengths of geometry and specimen are the same number


def check_starts(starts: int) -> None:
    """There must be one start at least."""
    check_whole("starts", starts, 1)


def check_options(
    law: Law, constraint: str, dependence: str
) -> tuple[Constraint, PressureDependence]:
    """The named choices, if they are among those there are and go together."""
    if constraint not in CONSTRAINTS:
        raise InputError(f"the constraint is one of {', '.join(CONSTRAINTS)}, got {constraint!r}")
    if dependence not in DEPENDENCES:
        raise InputError(
            f"the pressure dependence is one of {', '.join(DEPENDENCES)}, got {dependence!r}"
        )
    if dependence != "fixed" and not isinstance(law.material, famjax.PolynomialMaterial):
        raise InputError(
            f"only the polynomial law may depend on pressure, got a law that is {dependence} in "
            f"pressure with {type(law.material).__name__}"
        )
    if constraint == "slope" and law.material.directions_interact:
        raise InputError(
            "the slope constraint is for laws whose two directions do not interact (polynomial, "
            "saturating, monotone, and those of a class with directions_interact = False), not for "
            f"{type(law.material).__name__}; use drucker, which is the same question asked of both "
            "together"
        )
    return constraint, dependence


def known_bounds(
    data: ForceData, geometry: famjax.geometries.AbstractGeometry, given: Mapping[str, object]
) -> dict[str, tuple[float, float]]:
    """Diameter and angle of a known geometry at rest and without pressure, as held parameters.

    Raises:
        InputError: another rest length than the specimen's, or bounds given of what is known.
    """
    rest = float(geometry.rest_length)
    if abs(rest / data.specimen.rest_length - 1) > _SAME_LENGTH:
        raise InputError(
            f"the geometry's rest length, {rest * 1e3:.6g} mm, must be the specimen's, "
            f"{data.specimen.rest_length * 1e3:.6g} mm: set rest_length of the specimen"
        )
    at = geometry.dimensions(rest, 0.0)
    diameter, angle = 2 * float(at.radius), float(at.braid_angle)
    asked = [name for name in ("braid_diameter", "braid_angle") if name in given]
    said = [name for name in asked if name not in geometry.declared()]
    if said:
        raise InputError(
            f"{said[0]}: the known geometry says it already (braid diameter {diameter * 1e3:.6g} "
            f"mm, braid angle {math.degrees(angle):.6g} deg at rest); leave its bounds out, or "
            "leave geometry out to identify a cylinder"
        )
    known = {"braid_diameter": (diameter, diameter), "braid_angle": (angle, angle)}
    return {name: ends for name, ends in known.items() if name not in asked}


def check_source(source: AbstractGeometrySource, table: Mapping[str, Entry]) -> None:
    """A parameter of the geometry must be one that the geometry has."""
    cylinder = {"rest_length", "end_factor", "end_length", "braid_compliance", "series_compliance",
                "series_exponent"}  # fmt: skip
    named = sorted(cylinder & set(table) - set(source.declared))
    if named and getattr(source, "known", None) is not None:
        raise InputError(
            f"{', '.join(named)}: a known geometry has no such parameter; leave geometry out to "
            "identify a cylinder"
        )
    if "braid_compliance" in named and getattr(source, "thread", None) is not None:
        raise InputError(
            "braid_compliance is for threads that are not known; this geometry has the law of its "
            "thread already"
        )


def check_lengths(data: ForceData, table: Mapping[str, Entry]) -> None:
    """Every length must be within what a braid in the box can reach."""
    rest, steepest = data.specimen.rest_length, table["braid_angle"].max
    if "rest_length" in table:
        rest = table["rest_length"].min
    longest = rest / math.sin(steepest)
    longest_reading = int(np.argmax(data.length))
    if data.length[longest_reading] >= longest:
        raise InputError(
            f"reading {longest_reading + 1} has the length {data.length[longest_reading] * 1e3:.5g} "
            f"mm, longer than its thread: with a rest length of {rest * 1e3:.5g} mm and a braid "
            f"angle of at most {math.degrees(steepest):.4g} deg one thread has {longest * 1e3:.5g} "
            f"mm. {_check(data)}"
        )
    if any(name in table and table[name].max > 0 for name in _COMPLIANCES):
        return  # how short it may become depends on what gives way
    shortest = longest * math.sin(famjax.braids.NEUTRAL_ANGLE)
    pulling = np.where(data.loaded, data.length, np.inf)
    reading = int(np.argmin(pulling))
    if pulling[reading] <= shortest:
        raise InputError(
            f"reading {reading + 1} pulls at the length {pulling[reading] * 1e3:.5g} mm, a "
            f"contraction of {1 - pulling[reading] / rest:.3f}, but no braid of at most "
            f"{math.degrees(steepest):.4g} deg pulls when shorter than {shortest * 1e3:.5g} mm "
            f"(rest length {rest * 1e3:.5g} mm). {_check(data)}"
        )


def _check(data: ForceData) -> str:
    """What to do about lengths out of reach."""
    likely = _likely_length_fault(data)
    return f"Check the unit of the length column and the rest length{'. ' * bool(likely)}{likely}"


def check_censored(table: Mapping[str, Entry]) -> None:
    """One-sided readings need lengths and forces that do not hang on what they read."""
    if "series_compliance" in table:
        raise InputError(
            "censored readings do not go together with series_compliance: how far a rig gives way is "
            "known only where a force was read. Leave one of them out"
        )


def check_priors(data: ForceData, table: Mapping[str, Entry], noise: float | None) -> None:
    """A prior is weighed against the noise of the force, which must be known then."""
    named = [name for name, entry in table.items() if entry.prior is not None]
    if noise is not None and not (is_number(noise) and 0 < noise < math.inf):
        raise InputError(f"the noise of a reading must be a force > 0 in N, got {noise!r}")
    if noise is not None and data.force_std is not None:
        raise InputError(
            "the readings have standard deviations of their own (force_std): leave noise out"
        )
    if named and noise is None and data.force_std is None:
        raise InputError(
            f"the prior of {', '.join(named)} is weighed against the noise of the force, which is "
            "not known: give noise, the standard deviation of one reading in N (--error noise_N=1.5), or a "
            "column force_std in the data"
        )


def check_count(
    data: Sequence[ForceData],
    law: Law,
    dependence: PressureDependence,
    table: Mapping[str, Entry],
    *,
    own_law: bool = False,
) -> None:
    """There must be as many readings as parameters, and pressures for a law that depends on them.

    Specimens identified together are counted together: a shared parameter is one parameter.
    """
    readings = sum(int(one.loaded.sum()) for one in data)
    levels = np.unique(data[0].pressures.level[data[0].loaded])
    if dependence != "fixed" and levels.size < 2:
        raise InputError(
            f"a law that is {dependence} in pressure needs readings at two pressures or more; all "
            f"{readings} loaded readings are at {levels[0] / 1e3:.5g} kPa. Use a law that "
            "does not depend on pressure: fixed, not linear or free"
        )
    linear = law.coefficients
    free = [n for n, entry in table.items() if not entry.fixed]
    free_geometry = sum(n not in linear for n in free)
    free_coefficients = sum(n in linear for n in free)
    nodes = len(data) if own_law else {"fixed": 1, "linear": 2, "free": levels.size}[dependence]
    unknowns = free_geometry + nodes * free_coefficients
    if readings < unknowns:
        raise InputError(
            f"{readings} loaded readings cannot determine {unknowns} parameters "
            f"({free_geometry} of the geometry, {nodes * free_coefficients} coefficients): give "
            "more readings, a lower order, or fix parameters by bounds"
        )
    if unknowns == 0:
        raise InputError("every parameter is fixed by its bounds: there is nothing to identify")
    if free_coefficients == 0:
        return
    _check_strained(data, law.order, own_law=own_law)
    if dependence == "free":
        _check_strained_everywhere(data[0], law.order, levels)


def _check_strained(data: Sequence[ForceData], order: int, *, own_law: bool) -> None:
    """As many strained lengths as the law has coefficients, over all specimens that share it."""
    each = [np.unique(one.lengths.level[one.strained]).size for one in data]
    strained = min(each) if own_law else sum(each)
    if strained >= order:
        return
    rest = ", ".join(f"{one.specimen.rest_length * 1e3:.5g}" for one in data)
    raise InputError(
        f"a law of order {order} needs loaded readings at {order} or more lengths away from the "
        f"rest length, {rest} mm, where the bladder is not strained; there are "
        f"{strained}. Use a lower order, or measure at more lengths"
    )


def _check_strained_everywhere(data: ForceData, order: int, levels: np.ndarray) -> None:
    """The same at every pressure."""
    pressure, length = data.pressures.level, data.lengths.level
    known = np.array([np.unique(length[data.strained & (pressure == P)]).size for P in levels])
    poor = levels[known < order] / 1e3
    if poor.size:
        raise InputError(
            f"free coefficients need loaded readings at {order} or more lengths away from the "
            f"rest length at every pressure; too few at {', '.join(f'{P:.4g}' for P in poor)} "
            "kPa. Let the law be linear in pressure, use a lower order, or leave those pressures out"
        )


_ROUGH = 1e-3  # of the forces in a compliant rig: whether there are any
_AFFINE = 1e-7  # of the largest column: rounding of a force that is affine
_SEEN_TO_BE_AFFINE: set[tuple] = set()


def check_affine(problem: Problem) -> None:
    """The force must be affine in the coefficients that are declared linear.

    It is evaluated: the derivatives at no coefficients and at others must be the same. What has been
    seen to be affine is so with other numbers.
    """
    batch = Batch([problem])
    if batch.layout.forms in _SEEN_TO_BE_AFFINE:
        return
    middle, n = problem.low + (problem.high - problem.low) / 2, len(problem.linear)
    for part in problem.parts:
        middle[list(part.rig)[:1]] = 0.0
    none = batch.columns(middle, np.zeros(n))
    size = np.nanmax(np.abs(none), axis=0, initial=0.0)
    force = np.abs(problem.force).max()
    other = np.where(size > 0, force / np.where(size > 0, size, 1.0), 1.0) * (1 + np.arange(n))
    with_them = batch.columns(middle, other)
    change = np.nanmax(np.abs(with_them - none), axis=0, initial=0.0)
    bent = np.flatnonzero(change > _AFFINE * np.nanmax(np.abs([none, with_them]), initial=0.0))
    if bent.size:
        names = [problem.linear[k].partition("@")[0] for k in bent]
        raise InputError(
            f"{', '.join(dict.fromkeys(names))}: declared linear, but the force is not affine "
            "in it. Declare it without linear=True and with a finite range, low and high, and "
            "it is searched"
        )
    _SEEN_TO_BE_AFFINE.add(batch.layout.forms)


def _check_dimensions_there(problem: Problem, reading: int) -> None:
    """Raise where the geometry has dimensions at a reading, and a law or term has no force there."""
    for part in problem.parts:
        if reading >= part.force.size:
            reading -= part.force.size
            continue
        middle = (problem.low + (problem.high - problem.low) / 2)[part.at]
        values = dict(zip(part.family.nonlinear, middle, strict=False))
        model = part.family.build(values | dict.fromkeys(part.family.linear, 0.0))
        length, pressure = part.inputs.length[reading], part.inputs.pressure[reading]
        at = model.geometry.dimensions(length, pressure)
        if bool(at.reached):
            lost = [
                type(term).__name__ for term in model.terms.terms
                if not np.isfinite(term.force(at, pressure))
            ]  # fmt: skip
            raise InputError(
                f"{', '.join(lost) or 'the force'} must be a number at every loaded reading, got nan or "
                f"inf at length {length * 1e3:.5g} mm and pressure {pressure / 1e3:.5g} kPa: mend its "
                "force(at, pressure), or its law, there"
            )
        return


def check_solvable(problem: Problem) -> None:
    """The convex fit must have a solution in the middle of the box."""
    point = solve(problem, problem.low + (problem.high - problem.low) / 2, tolerance=_ROUGH)
    columns, target, rows, _ = point.programme
    count = problem.force.size
    known = np.isfinite(columns[:count]).all(axis=1) & np.isfinite(target[:count])
    lost = np.flatnonzero(~known)
    if lost.size:
        lengths = np.concatenate([part.inputs.length for part in problem.parts])
        _check_dimensions_there(problem, int(lost[0]))
        raise InputError(
            f"the geometry has no dimensions at the loaded reading {lost[0] + 1} (length "
            f"{lengths[lost[0]] * 1e3:.5g} mm): the bladder does not fit in the braid there, or "
            "the length is outside what was measured or can be reached. Check wall_thickness, "
            "nominal_diameter and bladder_diameter of the specimen (diameters, not radii), its rest "
            "length, and their units"
        )
    if not np.isfinite(rows).all():
        raise InputError(
            "the constraint cannot be posed: the actuation path, which runs to the shortest length "
            "in the map, slack readings included, leaves what the geometry is known for. Leave out "
            "readings that are shorter than the last measured shape, or use --constraint none"
        )
    if point.status in {Status.RANK_DEFICIENT, Status.INFEASIBLE}:
        raise InputError(point.status.message)


def _likely_length_fault(data: ForceData) -> str:
    """The likeliest fault of a map whose lengths cannot be reached, a sentence, or ""."""
    rest, length = data.specimen.rest_length, data.length[data.loaded]
    low, high = float(length.min()) / rest, float(length.max()) / rest
    # Either change brings the two together; they differ in the muscle that is left.
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
    """Units of lengths or of the rest length that may be meant.

    Yields:
        By how much lengths grow against the rest length, the rest length then, what is wrong, and both
        units.
    """
    rest, said = data.specimen.rest_length, data.units.get("length", "mm")
    known = UNITS["length"]
    for true in known:
        if true != said:
            yield known[true] / known[said], rest, "the lengths were", true, said
    for typed, true in itertools.permutations(("mm", "cm", "m", "in"), 2):
        scale = known[true] / known[typed]
        yield 1 / scale, rest * scale, "the rest length was", true, typed

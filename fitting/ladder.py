"""Families of models to choose from, limited to those that a map can determine.

All families but one have the same unknown geometry: braid diameter and angle, deadband, rounded ends,
stretching threads, and the rest length to within its rounding. Priors that are the same for every muscle
constrain what the readings cannot determine. The Mooney-Rivlin law uses an equivalent cylinder instead. The
families differ in the bladder law, and in what delays the onset of force: a deadband or a compliant rig. A
map of one muscle cannot determine both.

Compiling takes longer than fitting, so all families share one compiled program: that of a muscle whose law
is the sum of their laws. A family identifies some parameters and fixes the others at neutral values: no end
effect, rigid threads, a rigid rig, and no stress from the other laws.
"""

import dataclasses
import functools
from collections.abc import Collection, Mapping
from typing import Any, ClassVar

import jax.numpy as jnp
import numpy as np

from famjax._arrays import Real, RealArray
from famjax.materials import AbstractMaterial

from .arguments import check_mapping
from .data import ForceData, check_maps
from .families import EstimatedSource, Law, LawGiven, law_named
from .parameters import Parameter
from .problem import Part, Problem, Within
from .response import MuscleFamily

EXPONENT_PRIOR = (-3.0, 5.0)
"""Prior on Ogden's exponent, the same for all muscles. The exponent is -2 to 5 for plain rubbers (Ogden
1972; 2 is neo-Hookean) and -7 to -4 for walls with embedded threads. With fewer than four lengths, its sign
is poorly determined."""

MODEL_ERROR = 0.005
"""Standard deviation of a law's error, relative to the largest force. It is combined with the standard
deviation of the readings. If the law is accurate only to within 3 N, a reading known to within 0.1 N then
counts about as much as one known to within 1 N."""

LAWS: dict[str, dict[str, Any]] = {
    "ogden": {"law": "ogden"},
    "mooney-rivlin": {"law": "mooney-rivlin"},
    "linear": {"law": "polynomial", "order": 1},
    "saturating": {"law": "saturating"},
    "cubic": {"law": "polynomial", "order": 3},
}
"""Laws in order of preference for a map that cannot distinguish them: rubber laws before empirical laws,
and fewer coefficients first."""

END_FACTOR_PRIOR = (1.0, 0.05)
"""Prior on the end factor: a muscle whose ends widen as it shortens is up to a tenth longer than its
cylinder."""
BRAID_COMPLIANCE_PRIOR = (0.0, 1e-5)
"""Prior on the braid compliance [1/N]: the threads of a muscle with a bore of 10 to 20 mm stretch by 1 %
at 1000 N."""

_WIDEST_SCALE = 0.1
_WIDEST_CYLINDER = 1.4  # relative to the nominal diameter
_GEOMETRY = 2  # braid diameter and angle; the other parameters have priors
FEWEST_LENGTHS = 4
"""Smallest number of lengths for cross-validation by length. With three, leaving one out would leave only
two lengths, which determine no family."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One family on the ladder.

    Attributes:
        name: name in plain words.
        law: name of the law.
        rig: true if a compliant rig replaces the deadband.
        options: law and order, as in `identify`.
        bounds: the user's bounds, as in `identify`.
        parameters: free parameters, held parameters and priors, as in `identify`.
        unknowns: number of parameters without a prior, which the readings must determine.
        rank: position on the ladder; of several families that predict equally well, the first is chosen.
    """

    name: str
    law: str
    rig: bool
    options: Mapping[str, Any]
    bounds: Mapping[str, tuple[float, float]]
    parameters: Mapping[str, Parameter]
    unknowns: int
    rank: tuple[int, int]


def ladder(
    data: ForceData,
    parameters: Mapping[str, Parameter] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """List the families that a force map can determine.

    Each length provides two numbers, the slope and the intercept of force against pressure. A family with
    as many unknowns as there are slopes and intercepts cannot be tested, so it is left out. A law with more
    coefficients than there are lengths at which the bladder is strained is left out as well.

    Args:
        data: the map.
        parameters: the user's parameters, the same for every family. Laws without one of these parameters
            are left out.
        bounds: the user's bounds, treated in the same way.

    Returns:
        The candidates in the order of the ladder, and a sentence about each kind of family left out.
    """
    check_maps(data)
    check_mapping("bounds", bounds, "from names to (low, high) in SI")
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    bounds, parameters = dict(bounds or {}), dict(parameters or {})
    said = {*bounds, *parameters}
    lengths = np.unique(data.lengths.level[data.loaded]).size
    strained = np.unique(data.lengths.level[data.strained]).size
    told = lengths * min(np.unique(data.pressures.level[data.loaded]).size, 2) - 1
    of_any_law = set().union(*map(_rows, LAWS))
    found, dropped, large = [], [], 0
    for rank, law in enumerate(LAWS):
        count, lacking = len(law_of(law).coefficients), (said & of_any_law) - _rows(law)
        if lacking or count > strained:
            dropped.append(
                f"The {law} law has no {', '.join(sorted(lacking))}, which you specified." if lacking else
                f"The {law} law needs {count} lengths at which the bladder is strained, but the map has "
                f"{strained}."
            )  # fmt: skip
            continue
        for rig in (False,) if said & _PULLS_LATE else (False, True):
            of_law = _equivalent_cylinder if law == "mooney-rivlin" else _geometry
            known = {**of_law(data), **believed(law, data), **(_RIG if rig else {})}
            if "end_length" in said:
                known.pop("end_factor", None)
            known = {name: one for name, one in known.items() if name not in bounds}
            unknowns = numbers_of(law) + rig * len(_RIG_UNKNOWNS)
            if unknowns > told:
                large += 1
                continue
            found.append(
                Candidate(
                    name=f"{law}, compliant rig" if rig else law, law=law, rig=rig,
                    options=LAWS[law], bounds=bounds, parameters={**known, **parameters},
                    unknowns=unknowns, rank=(rank, rig),
                )
            )  # fmt: skip
    if large:
        dropped.append(
            f"{large} {'family' if large == 1 else 'families'} with more than {told} unknowns could not be "
            f"tried: {lengths} lengths cannot determine that many."
        )
    return tuple(found), tuple(dropped)


def as_cylinder(one: Candidate, data: ForceData, said: Collection[str] = frozenset()) -> Candidate:
    """Return the family restricted to a cylinder with rigid threads, which can be cut to other lengths.

    Args:
        one: the family.
        data: the map.
        said: parameters set by the user, which are not changed.
    """
    held = {
        "end_factor": Parameter(value=1.0, vary=False),
        "braid_compliance": Parameter(value=0.0, vary=False, unit="1/N"),
        "rest_length": Parameter(value=data.specimen.rest_length, vary=False, unit="m"),
    }
    changed = {name: entry for name, entry in held.items() if name not in said}
    return dataclasses.replace(one, parameters={**one.parameters, **changed})


_RIG_UNKNOWNS = ("series_compliance", "series_exponent")
_RIG = {
    "deadband_pressure": Parameter(value=0.0, vary=False, unit="Pa"),
    "braid_compliance": Parameter(value=0.0, vary=False, unit="1/N"),
    **{name: Parameter() for name in _RIG_UNKNOWNS},
}
"""Parameters of a compliant rig. The threads are rigid, because compliant threads have almost the same
effect."""
_PULLS_LATE = {"deadband_pressure", *_RIG_UNKNOWNS}


def _geometry(data: ForceData) -> dict[str, Parameter]:
    """Return the priors on the geometry, for any muscle and law."""
    return {
        "end_factor": Parameter(prior=END_FACTOR_PRIOR),
        "braid_compliance": Parameter(prior=BRAID_COMPLIANCE_PRIOR, unit="1/N"),
        "rest_length": rest_length_prior(data),
    }


def rest_length_prior(data: ForceData) -> Parameter:
    """Return the prior on the rest length: the specimen's value, to within its rounding."""
    rest = data.specimen.rest_length
    rounding = rest_length_rounding(rest)
    return Parameter(min=rest - rounding, max=rest + rounding, prior=(rest, rounding / 2), unit="m")


def _equivalent_cylinder(data: ForceData) -> dict[str, Parameter]:
    """Return bounds for a cylinder whose diameter and angle absorb the effects of ends and wall.

    Its threads are rigid. Klute & Hannaford (2000) fit the Mooney-Rivlin law in this way. With the
    muscle's true dimensions, the error of that law is larger.
    """
    bore = data.specimen.nominal_diameter
    angle = {"braid_angle": Parameter(min=57.0, max=72.0, unit="deg")}
    if not bore:
        return angle
    return angle | {"braid_diameter": Parameter(min=bore, max=_WIDEST_CYLINDER * bore, unit="m")}


def options_of(law: LawGiven) -> dict[str, Any]:
    """Return the law and order as arguments of `identify`, for a law on the ladder or any other law."""
    return LAWS.get(law, {"law": law}) if isinstance(law, str) else {"law": law}


def law_of(law: LawGiven) -> Law:
    """Return the `Law` for a law on the ladder or any other law.

    Raises:
        InputError: there is no such law, or it cannot be identified.
    """
    options = options_of(law)
    return law_named(options["law"], options.get("order"))


def believed(law: LawGiven, data: ForceData | None = None) -> dict[str, Parameter]:
    """Return the priors and bounds on a law's parameters that are used for any muscle.

    Args:
        law: the law, as in `identify`.
        data: the map. If it is given, features of a law that are narrower than half the widest gap between
            lengths are excluded, since they cannot be identified.
    """
    known = {"ogden_exponent": Parameter(prior=EXPONENT_PRIOR)}
    if data is not None:
        lengths = np.unique(data.lengths.level[data.loaded])
        widest = float(np.diff(lengths, prepend=lengths[0]).max()) / data.specimen.rest_length
        least, most = law_of("saturating").shape["strain_scale"].min, _WIDEST_SCALE
        known["strain_scale"] = Parameter(min=float(np.clip(widest / 2, least, most)))
    return {name: one for name, one in known.items() if name in law_of(law).shape}


def numbers_of(law: LawGiven) -> int:
    """Return the number of parameters of law and geometry that the readings must determine.

    Shape parameters of the law are counted unless they have a prior, which is equivalent to a reading.
    """
    made = law_of(law)
    of_prior = {name for name, one in believed(law).items() if one.prior is not None}
    return _GEOMETRY + len(made.coefficients) + len(made.shape.keys() - of_prior)


def _rows(law: str) -> set[str]:
    """Return the names of the parameters of a law."""
    made = law_of(law)
    return {*made.shape, *made.coefficients}


def rest_length_rounding(rest_length: float) -> float:
    """Return half a unit of the last digit of a rest length [m], from 0.05 to 0.5 mm."""
    millimetres = rest_length * 1e3
    return 0.5e-3 if abs(millimetres - round(millimetres)) < 1e-6 else 0.05e-3


_NEUTRAL: Mapping[str, float] = {
    "deadband_pressure": 0.0, "end_factor": 1.0, "braid_compliance": 0.0,
    "series_compliance": 0.0, "series_exponent": 1.0, "ogden_exponent": 2.0, "strain_scale": 0.1,
}  # fmt: skip
"""Neutral values for the parameters that a family does not identify; the rest length is the specimen's."""
_NONLINEAR = ("braid_diameter", "braid_angle", "rest_length", *_NEUTRAL)


class LawSum(AbstractMaterial):
    """Sum of several laws that share no parameters."""

    laws: tuple[AbstractMaterial, ...]

    depends_on_pressure: ClassVar[bool] = False

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """Return the true stresses (sigma_z, sigma_c) [Pa], summed over the laws."""
        each = [law.stresses(axial_strain, hoop_strain, pressure) for law in self.laws]
        axial, hoop = zip(*each, strict=True)
        return sum(axial, jnp.zeros(())), sum(hoop, jnp.zeros(()))


@functools.cache
def _sum_of_laws() -> Law:
    """Return the sum of the ladder's laws."""
    laws = ("ogden", "mooney-rivlin", "saturating", "cubic")
    return Law(LawSum(tuple(law_of(law).material for law in laws)))


def sharing_one_program(problem: Problem) -> Problem:
    """Return the problem with every part computed by the shared program if it is a special case of it."""
    return dataclasses.replace(problem, parts=tuple(_within(part) for part in problem.parts))


def _within(part: Part) -> Part:
    family, law = part.family, _sum_of_laws()
    material: Any = law.material
    names = {*family.nonlinear, *family.law.shape, *family.law.coefficients}
    same = type(family.law.material) in map(type, material.laws)
    face = same and names <= {*_NONLINEAR, *law.shape, *law.coefficients}
    plain = type(family.source) is EstimatedSource and family.terms is None
    if not (face and plain) or len(part.inputs.path_end) > 2:
        return part
    neutral = {**_NEUTRAL, "rest_length": float(family.rest)}
    held = [0.0 if n in family.nonlinear else neutral[n] for n in _NONLINEAR]
    larger = MuscleFamily(_NONLINEAR, tuple(law.coefficients), family.source, law, family.rest)
    return dataclasses.replace(
        part,
        within=Within(
            larger,
            1.0 * (np.array(_NONLINEAR)[:, None] == np.array(family.nonlinear)),
            np.array(held),
            1.0 * (np.array(larger.linear)[:, None] == np.array(family.linear)),
        ),
    )

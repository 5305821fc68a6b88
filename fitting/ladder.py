"""The families that a fit chooses from, as far as a map can carry them.

All families but one have the same unknown geometry: braid diameter and angle, deadband, rounded ends,
stretching threads, and the rest length within the rounding to which it was given. Priors that are the same
for every muscle hold what the readings cannot determine. The Mooney-Rivlin law has an equivalent cylinder
instead. The families differ in the law of the bladder, and in why the muscle pulls late: because of its
deadband, or because the rig is compliant. A map of one muscle cannot determine both.

Tracing and compiling takes longer than fitting, so one compiled program serves all families: that of a
muscle whose law is the sum of their laws. A family searches some parameters and holds the others at values
without effect: no end effect, rigid threads, a rigid rig, no stress of the other laws.
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
"""Of Ogden's exponent, the same for every muscle: bare rubbers have -2 to 5 (Ogden 1972; 2 is
neo-Hookean), walls with threads in them -7 to -4. Fewer than four lengths hardly tell its sign."""

MODEL_ERROR = 0.005
"""Standard deviation, in parts of the largest force, by which a law misses readings of a muscle that
is made of rubber and threads. It is added to that of the readings: what is known to 0.1 N does not
count a hundred times more than what is known to 1 N where the law itself is good to 3 N."""

LAWS: dict[str, dict[str, Any]] = {
    "ogden": {"law": "ogden"},
    "mooney-rivlin": {"law": "mooney-rivlin"},
    "linear": {"law": "polynomial", "order": 1},
    "saturating": {"law": "saturating"},
    "cubic": {"law": "polynomial", "order": 3},
}
"""In the order in which they are believed of a map that cannot tell: the laws of rubber before those
that only describe, and of either the one of fewer coefficients first."""

END_FACTOR_PRIOR = (1.0, 0.05)
"""A muscle whose ends open as it shortens is up to a tenth longer than its cylinder."""
BRAID_COMPLIANCE_PRIOR = (0.0, 1e-5)
"""[1/N]; threads of a muscle of 10 to 20 mm that stretch by 1 % do so at 1000 N."""

_WIDEST_SCALE = 0.1
_WIDEST_CYLINDER = 1.4  # of the nominal diameter
_GEOMETRY = 2  # braid diameter and angle; the rest has priors
FEWEST_LENGTHS = 4
"""From which on lengths are left out: without one of three, two are left, which determine no family."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One family of the ladder.

    Attributes:
        name: in words.
        law: its name.
        rig: whether the rig is compliant, in place of a deadband.
        options: law and order, as `identify` takes them.
        bounds: the user's bounds, as `identify` takes them.
        parameters: free and held parameters and priors, as `identify` takes them.
        unknowns: numbers without a prior, which the readings have to determine.
        rank: place on the ladder: of families that predict alike, the first is taken.
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
    """The families that a force map can carry.

    Each length tells two numbers, the slope and the intercept of the force in pressure, so a family of as
    many unknowns has none left to be judged by: it is left out, and so is a law of more coefficients than
    there are lengths at which the bladder is strained.

    Args:
        data: the map.
        parameters: the user's parameters; the ladder does not vary them, and leaves out a law without
            one of them.
        bounds: the user's bounds; the same applies.

    Returns:
        (the candidates, in the order of the ladder; one sentence for each kind of family left out).
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
                f"The {law} law has no {', '.join(sorted(lacking))}, which was given." if lacking else
                f"The {law} law needs {count} lengths at which the bladder is strained; the map has "
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
            f"{large} families of more than {told} unknowns, which {lengths} lengths cannot "
            "determine, were left out."
        )
    return tuple(found), tuple(dropped)


def as_cylinder(one: Candidate, data: ForceData, said: Collection[str] = frozenset()) -> Candidate:
    """The family with the geometry of a cylinder of stiff threads, which transfers to other lengths.

    Args:
        one: the family.
        data: the map.
        said: parameters of which a user says something; they stay.
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
"""A compliant rig and compliant threads have almost the same effect."""
_PULLS_LATE = {"deadband_pressure", *_RIG_UNKNOWNS}


def _geometry(data: ForceData) -> dict[str, Parameter]:
    """What is believed of every muscle, whatever its law."""
    return {
        "end_factor": Parameter(prior=END_FACTOR_PRIOR),
        "braid_compliance": Parameter(prior=BRAID_COMPLIANCE_PRIOR, unit="1/N"),
        "rest_length": rest_length_prior(data),
    }


def rest_length_prior(data: ForceData) -> Parameter:
    """The rest length within the rounding to which it was given."""
    rest = data.specimen.rest_length
    rounding = rest_length_rounding(rest)
    return Parameter(min=rest - rounding, max=rest + rounding, prior=(rest, rounding / 2), unit="m")


def _equivalent_cylinder(data: ForceData) -> dict[str, Parameter]:
    """A cylinder of stiff threads, whose diameter and angle stand for ends and wall as well.

    The law of Mooney and Rivlin is fitted so, as by Klute & Hannaford (2000); with the muscle's own
    dimensions it misses more.
    """
    bore = data.specimen.nominal_diameter
    angle = {"braid_angle": Parameter(min=57.0, max=72.0, unit="deg")}
    if not bore:
        return angle
    return angle | {"braid_diameter": Parameter(min=bore, max=_WIDEST_CYLINDER * bore, unit="m")}


def options_of(law: LawGiven) -> dict[str, Any]:
    """Law and order, as `identify` takes them: a name of the ladder, or whatever a law may be given as."""
    return LAWS.get(law, {"law": law}) if isinstance(law, str) else {"law": law}


def law_of(law: LawGiven) -> Law:
    """The family of a law.

    Raises:
        InputError: no such law, or nothing that can be identified by what is given.
    """
    options = options_of(law)
    return law_named(options["law"], options.get("order"))


def believed(law: LawGiven, data: ForceData | None = None) -> dict[str, Parameter]:
    """Prior knowledge about the law's parameters, for any muscle.

    Args:
        law: as `identify` takes it.
        data: the map; features of a law narrower than half the widest gap between its lengths cannot be
            identified.
    """
    known = {"ogden_exponent": Parameter(prior=EXPONENT_PRIOR)}
    if data is not None:
        lengths = np.unique(data.lengths.level[data.loaded])
        widest = float(np.diff(lengths, prepend=lengths[0]).max()) / data.specimen.rest_length
        least, most = law_of("saturating").shape["strain_scale"].min, _WIDEST_SCALE
        known["strain_scale"] = Parameter(min=float(np.clip(widest / 2, least, most)))
    return {name: one for name, one in known.items() if name in law_of(law).shape}


def numbers_of(law: LawGiven) -> int:
    """How many numbers of law and geometry the readings have to determine.

    A shape parameter of the law is one, unless it has a prior, which is as good as a reading.
    """
    made = law_of(law)
    of_prior = {name for name, one in believed(law).items() if one.prior is not None}
    return _GEOMETRY + len(made.coefficients) + len(made.shape.keys() - of_prior)


def _rows(law: str) -> set[str]:
    """Names of the parameters of a law."""
    made = law_of(law)
    return {*made.shape, *made.coefficients}


def rest_length_rounding(rest_length: float) -> float:
    """Half a unit of the last digit to which a rest length [m] is given, from 0.05 to 0.5 mm."""
    millimetres = rest_length * 1e3
    return 0.5e-3 if abs(millimetres - round(millimetres)) < 1e-6 else 0.05e-3


_NEUTRAL: Mapping[str, float] = {
    "deadband_pressure": 0.0, "end_factor": 1.0, "braid_compliance": 0.0,
    "series_compliance": 0.0, "series_exponent": 1.0, "ogden_exponent": 2.0, "strain_scale": 0.1,
}  # fmt: skip
"""Of parameters that a family has not, values that change nothing; the rest length is the specimen's."""
_NONLINEAR = ("braid_diameter", "braid_angle", "rest_length", *_NEUTRAL)


class LawSum(AbstractMaterial):
    """The sum of the stresses of several laws, none with a parameter of another's."""

    laws: tuple[AbstractMaterial, ...]

    depends_on_pressure: ClassVar[bool] = False

    def stresses(
        self, axial_strain: Real, hoop_strain: Real, pressure: Real
    ) -> tuple[RealArray, RealArray]:
        """True stresses (sigma_z, sigma_c) [Pa], the sums of those of the laws."""
        each = [law.stresses(axial_strain, hoop_strain, pressure) for law in self.laws]
        axial, hoop = zip(*each, strict=True)
        return sum(axial, jnp.zeros(())), sum(hoop, jnp.zeros(()))


@functools.cache
def _sum_of_laws() -> Law:
    """The sum of the laws of the ladder."""
    laws = ("ogden", "mooney-rivlin", "saturating", "cubic")
    return Law(LawSum(tuple(law_of(law).material for law in laws)))


def sharing_one_program(problem: Problem) -> Problem:
    """The same problem, its parts computed by the shared program where they are faces of it."""
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

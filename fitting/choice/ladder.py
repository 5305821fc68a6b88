"""The families that a fit chooses from, as far as a map can carry them."""

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..arguments import check_mapping
from ..data.force_data import ForceData, check_maps
from ..families.laws import Law, LawGiven, law_named
from ..families.parameters import Parameter

EXPONENT_PRIOR = (0.0, 5.0)
"""Of Ogden's exponent, the same for every muscle: those of rubbers lie within 10 of zero on either
side (1.3, 5 and -2 of the vulcanised rubber of Ogden 1972; 2 is neo-Hookean)."""

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
_WORDS = {
    "end_factor": "rounded ends",
    "braid_compliance": "compliant braid",
    "rest_length": "free rest length",
    "series_compliance": "compliant rig",
    "series_exponent": "as a power of the force",
}
_FAMILIES: tuple[tuple[tuple[str, ...], bool], ...] = (
    ((), False),
    ((), True),
    (("end_factor",), True),
    (("braid_compliance",), True),
    (("end_factor", "braid_compliance"), True),
    (("end_factor", "rest_length"), True),
    (("series_compliance", "series_exponent"), False),
)
"""What takes part besides braid diameter and angle, and whether the deadband is identified. A rig that
gives way by a power of the force takes the place of the deadband: either makes the muscle pull late, and
with both a map of one muscle tells neither. A rig that gives way in proportion is hardly told from a
braid that does, and predicts lengths left out no better (`--free series_compliance`)."""
_GEOMETRY = 2  # braid diameter and angle
FEWEST_LENGTHS = 4
"""From which on lengths are left out: without one of three, two are left, which determine no family."""


@dataclasses.dataclass(frozen=True)
class Candidate:
    """One family of the ladder.

    Attributes:
        law: its name in the table of what was tried.
        free: parameters that take part besides those of every fit.
        deadband: whether the deadband pressure is identified; otherwise it is held at zero.
        options: law and order, as `identify` takes them.
        bounds: as a user gave them, likewise.
        parameters: what takes part, what is held, and priors, likewise.
        unknowns: numbers that the readings have to determine.
        rank: place on the ladder: of families that predict alike, the first is taken.
    """

    law: str
    free: tuple[str, ...]
    deadband: bool
    options: Mapping[str, Any]
    bounds: Mapping[str, tuple[float, float]]
    parameters: Mapping[str, Parameter]
    unknowns: int
    rank: tuple[int, int, int]

    @property
    def kind(self) -> str:
        """The law, and the rig if it gives way: families of one kind differ in what they hold."""
        return f"{self.law}, compliant rig" if "series_compliance" in self.free else self.law

    @property
    def name(self) -> str:
        """What it is, in words."""
        words = [self.law, *(_WORDS[name] for name in self.free)]
        return ", ".join(words if self.deadband else [*words, "no deadband"])


def ladder(
    data: ForceData,
    parameters: Mapping[str, Parameter] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
    *,
    rig_from: int = FEWEST_LENGTHS,
) -> tuple[tuple[Candidate, ...], tuple[str, ...]]:
    """The families that a force map can carry.

    With an inextensible braid each length tells two numbers, the slope and the intercept of the force
    in pressure. A family that takes them all has none left to be judged by, so it is left out, and so
    is a law of more coefficients than there are lengths at which the bladder is strained.

    Args:
        data: the map.
        parameters: what a user says; none of these is varied by the ladder, and a law that has not
            one of them is left out.
        bounds: likewise.
        rig_from: lengths from which on a rig that gives way by a power is told from a soft bladder.

    Returns:
        (the candidates, in the order of the ladder; one sentence for each kind of family left out).
    """
    check_maps(data)
    check_mapping("bounds", bounds, "from names to (low, high) in SI")
    check_mapping("parameters", parameters, "from names to fitting.Parameter")
    said = _Said(dict(bounds or {}), dict(parameters or {}))
    loaded = data.loaded
    lengths = np.unique(data.lengths.level[loaded]).size
    pressures = np.unique(data.pressures.level[loaded]).size
    strained = np.unique(data.lengths.level[data.strained]).size
    told = lengths * min(pressures, 2) - 1
    of_any_law = set().union(*map(_rows, LAWS))
    found, dropped, large = [], [], 0
    for law in LAWS:
        made = law_of(law)
        lacking = sorted((said.names & of_any_law) - _rows(law))
        if lacking:
            dropped.append(f"The {law} law has no {', '.join(lacking)}, which was given.")
            continue
        if len(made.coefficients) > strained:
            dropped.append(
                f"The {law} law needs {len(made.coefficients)} lengths at which the bladder is "
                f"strained; the map has {strained}."
            )
            continue
        for extras, deadband in _FAMILIES:
            if said.names & {*extras, *(() if deadband else ("deadband_pressure",))}:
                continue
            if "series_exponent" in extras and lengths < rig_from:
                continue
            one = _candidate(data, law, extras, said, deadband=deadband)
            if one.unknowns <= told:
                found.append(one)
            else:
                large += 1
    if large:
        dropped.append(
            f"{large} families of more than {told} unknowns, which {lengths} lengths cannot "
            "determine, were left out."
        )
    return tuple(sorted(found, key=lambda one: one.rank)), tuple(dropped)


def _candidate(
    data: ForceData,
    law: str,
    free: tuple[str, ...],
    said: "_Said",
    *,
    deadband: bool,
) -> Candidate:
    """One family. Whatever may be freed is in the table, held where it is not: one program serves all."""
    rest, rounding = data.specimen.rest_length, rest_length_rounding(data.specimen.rest_length)
    parameters = {}
    if "series_compliance" not in free:
        parameters = {
            "end_factor": _held(1.0),
            "braid_compliance": _held(0.0, "1/N"),
            "rest_length": _held(rest, "m"),
        }
    for name in free:
        parameters[name] = Parameter()
    if "rest_length" in free:
        parameters["rest_length"] = Parameter(min=rest - rounding, max=rest + rounding, unit="m")
    parameters |= believed(law)
    if not deadband:
        parameters["deadband_pressure"] = _held(0.0, "Pa")
    if "end_length" in said.names:
        parameters.pop("end_factor", None)
    given = {name: one for name, one in parameters.items() if name not in said.bounds}
    unknowns = numbers_of(law) + deadband + len(free)
    # Every muscle has a deadband: of families that predict alike, one without is believed last.
    rank = list(LAWS).index(law), 1 - deadband, unknowns
    return Candidate(
        law, free, deadband, LAWS[law], said.bounds, {**given, **said.parameters}, unknowns, rank
    )


@dataclasses.dataclass(frozen=True)
class _Said:
    """What a user says of parameters."""

    bounds: dict[str, tuple[float, float]]
    parameters: dict[str, Parameter]

    @property
    def names(self) -> set[str]:
        return {*self.bounds, *self.parameters}


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


def believed(law: LawGiven) -> dict[str, Parameter]:
    """What is known of the law's parameters, whatever the muscle."""
    known = {"ogden_exponent": Parameter(prior=EXPONENT_PRIOR)}
    return {name: one for name, one in known.items() if name in law_of(law).shape}


def numbers_of(law: LawGiven) -> int:
    """How many numbers of law and geometry the readings have to determine.

    A shape parameter of the law is one, unless it has a prior, which is as good as a reading.
    """
    made = law_of(law)
    return _GEOMETRY + len(made.coefficients) + len(made.shape.keys() - believed(law))


def _rows(law: str) -> set[str]:
    """Names of the parameters of a law."""
    made = law_of(law)
    return {*made.shape, *made.coefficients}


def _held(value: float, unit: str = "") -> Parameter:
    return Parameter(value=value, vary=False, unit=unit)


def rest_length_rounding(rest_length: float) -> float:
    """Half a unit of the last digit to which a rest length [m] is given, from 0.05 to 0.5 mm."""
    millimetres = rest_length * 1e3
    return 0.5e-3 if abs(millimetres - round(millimetres)) < 1e-6 else 0.05e-3

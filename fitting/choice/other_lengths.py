"""Muscles of other lengths from one specimen: by every account of it that its map cannot refute.

What makes a muscle pull late, a deadband of its bladder or a rig that gives way, one map hardly tells, and
which law its bladder follows it tells within its own strains. A muscle three times as long tells both. So
its force is the mean of what all of them say of it, and their disagreement is in its band.
"""

import dataclasses
from collections.abc import Mapping, Sequence

import famjax

from ..data.force_data import ForceData
from ..engine import solve
from ..families.parameters import Parameter
from ..search.summary import muscle_at
from .ladder import Candidate, ladder
from .race import Fitted
from .series import DEFAULT_LAWS

FROM_ONE = 0.06
"""Standard deviation, in parts of the largest force, of readings of a muscle about what one specimen of
another length says of it, the disagreement of the accounts apart. Set so that the bands of 18 pairs of five
muscles of 12 to 28 cm, each predicted from another, hold 95 % of the readings (96 %)."""


@dataclasses.dataclass(frozen=True)
class OtherLengths:
    """What is believed of muscles of the same make and another length.

    Attributes:
        names: of the families.
        members: the muscle as each has it, in its rig.
        between: standard deviation [N] of a specimen about their mean, their disagreement apart.
    """

    names: tuple[str, ...]
    members: tuple[famjax.MountedMuscle, ...]
    between: float


def accounts(
    data: ForceData,
    parameters: Mapping[str, Parameter] | None = None,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> tuple[Candidate, ...]:
    """The families that transfer and that a map can carry, those that it does not tell apart too.

    None where there is but one thing to make a muscle pull late, by what a user says (see `ladder`) or
    for lack of readings.
    """
    every, _ = ladder(data, parameters, bounds, rig_from=0)
    found = tuple(one for one in every if _pulls_late_by(one) is not None)
    return found if {_pulls_late_by(one) for one in found} == {"bladder", "rig"} else ()


def other_lengths(fitted: Sequence[Fitted], max_force: float) -> OtherLengths | None:
    """Muscles of other lengths by the accounts of a specimen; None where there is none."""
    if not fitted:
        return None
    return OtherLengths(
        names=tuple(one.candidate.name for one in fitted),
        members=tuple(_mounted(one) for one in fitted),
        between=FROM_ONE * max_force,
    )


def _pulls_late_by(candidate: Candidate) -> str | None:
    """What does not pull at once in a family that transfers; None of one that is not meant to."""
    if candidate.law not in DEFAULT_LAWS:
        return None
    if candidate.deadband:
        return None if candidate.free else "bladder"
    return "rig" if "series_exponent" in candidate.free else None


def _mounted(fitted: Fitted) -> famjax.MountedMuscle:
    problem = fitted.posed.problem
    point = solve(problem, problem.parameters(fitted.ends[0]))
    return problem.parts[0].mounted(muscle_at(problem, point, 0), point.parameters)

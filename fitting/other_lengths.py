"""Muscles of other lengths from one specimen: by every account of it that its map cannot refute.

What makes a muscle pull late, a deadband of its bladder or a rig that gives way, one map hardly tells, and
which law its bladder follows it tells within its own strains. A muscle three times as long tells both. So
its force is the mean of what all of them say of it, and their disagreement is in its band.
"""

import dataclasses
from collections.abc import Collection, Sequence

import famjax

from .data import ForceData
from .ladder import Candidate, as_cylinder
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
    candidates: Sequence[Candidate], data: ForceData, said: Collection[str]
) -> tuple[Candidate, ...]:
    """The families that transfer, with a deadband and with a rig that gives way.

    Args:
        candidates: of the ladder.
        data: the map.
        said: parameters of which a user says something.

    Returns:
        The families; none where there is but one thing to make a muscle pull late.
    """
    found = [as_cylinder(one, data, said) for one in candidates if one.law in DEFAULT_LAWS]
    return tuple(found) if {one.rig for one in found} == {False, True} else ()


def other_lengths(families: Sequence[Fitted], max_force: float) -> OtherLengths | None:
    """Muscles of other lengths by the families that transfer, as cylinders of stiff threads.

    Args:
        families: of `accounts`, fitted to all readings.
        max_force: largest force measured [N].

    Returns:
        None where there are none.
    """
    if not families:
        return None
    return OtherLengths(
        names=tuple(one.candidate.name for one in families),
        members=tuple(one.mounted for one in families),
        between=FROM_ONE * max_force,
    )

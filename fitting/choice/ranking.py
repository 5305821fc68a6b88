"""Families in the order of their held-out errors, which the table that is printed shows."""

import dataclasses
import math
from collections.abc import Mapping, Sequence

import numpy as np

from ..evidence.left_out import LeftOut, columns_of
from .ladder import Candidate

ALIKE = 1.5
"""Families fit alike whose RMSE in sample is within this factor of the smallest."""
NEAR = 1.1
"""Held-out errors within this factor are not told apart: the first on the ladder is taken."""
LITTLE_MORE = 2.0
"""Factor of the held-out error up to which a family with a certified optimum is taken instead."""
_NOISE = 1e-3  # of the largest force: smaller errors are not told apart


@dataclasses.dataclass(frozen=True)
class Tried:
    """One family that was tried.

    Attributes:
        candidate: the family.
        rmse: in sample [N].
        left_out: errors by kind of what was left out, "pressure", "length" or "specimen".
        held_out: the held-out error [N] by which families are ordered, see `held_out_error`.
        alike: whether its RMSE in sample is within `ALIKE` of the smallest of all.
    """

    candidate: Candidate
    rmse: float
    left_out: Mapping[str, LeftOut]
    held_out: float
    alike: bool

    @property
    def columns(self) -> dict[str, float]:
        """RMSE [N] on each kind of readings left out, see `columns_of`."""
        return columns_of(self.left_out)


def held_out_error(left_out: Mapping[str, LeftOut], rmse: float, max_force: float) -> float:
    """Geometric mean of the columns of `columns_of` [N], or the RMSE in sample where there are none.

    Args:
        left_out: errors by kind.
        rmse: in sample [N].
        max_force: largest force measured [N], of which errors below 0.1 % are not told apart.
    """
    errors = list(columns_of(left_out).values()) or [rmse]
    return float(np.exp(np.mean(np.log(np.hypot(errors, _NOISE * max_force)))))


def ranked(
    families: Sequence[tuple[Candidate, float, Mapping[str, LeftOut] | None]], max_force: float
) -> tuple[Tried, ...]:
    """The families with their held-out errors, in the order in which they are given.

    Args:
        families: each with its error in sample [N] and its errors on what was left out; None where
            nothing was left out of it.
        max_force: largest force measured [N].
    """
    least = max(min(rmse for _, rmse, _ in families), _NOISE * max_force)
    return tuple(
        Tried(
            candidate, rmse, left_out or {},
            math.inf if left_out is None else held_out_error(left_out, rmse, max_force),
            rmse <= ALIKE * least,
        )
        for candidate, rmse, left_out in families
    )  # fmt: skip


def preferred(tried: Sequence[Tried]) -> list[int]:
    """Places of the families, the one to believe first in front.

    Those whose held-out error is within `NEAR` of the smallest come in the order of the ladder, the
    others behind them by their errors. Without lengths left out little tells the laws apart, so it is
    within `ALIKE` then.
    """
    least = min(one.held_out for one in tried)
    factor = NEAR if any("length" in one.left_out for one in tried) else ALIKE

    def order(place: int) -> tuple[bool, float | tuple[int, ...]]:
        one = tried[place]
        near = one.held_out <= factor * least
        return (not near, one.candidate.rank if near else one.held_out)

    return sorted(range(len(tried)), key=order)

"""Strengths of Maxwell-slip elements from pairs of branches: a convex fit with its certificate."""

import dataclasses

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.compile_options import quick_jit
from famjax.slip import CentredSlip, MaxwellSlip, ReferenceCycle, SlipElements

from ..convex import Status, solve_qp
from .branch_pairs import BranchPairs
from .slip_columns import (
    MODULUS,
    Thresholds,
    half_difference_columns,
    threshold_grid,
)

SHRINKAGE = 1e-3
"""Weight of the sum of squared strengths, in parts of the largest column's square."""


@dataclasses.dataclass(frozen=True)
class HysteresisLeftOut:
    """Half-differences predicted for points whose group was left out of the fit.

    Attributes:
        groups: what was left out at a time: record, length or pressure.
        values: of the groups: number of the record, length [m] or pressure [Pa], shape (groups,).
        predicted: half-difference [N], shape (n,).
        measured: the same as measured, shape (n,).
        group_rms: root mean square error [N] of each group, shape (groups,).
    """

    groups: str
    values: Float[np.ndarray, " groups"]
    predicted: Float[np.ndarray, " n"]
    measured: Float[np.ndarray, " n"]
    group_rms: Float[np.ndarray, " groups"]

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the predictions."""
        return float(np.sqrt(np.mean((self.predicted - self.measured) ** 2)))

    @property
    def ratio(self) -> float:
        """That error in parts of the root mean square of what was measured."""
        return self.rms / float(np.sqrt(np.mean(self.measured**2)))


@dataclasses.dataclass(frozen=True)
class HysteresisFit:
    """Hysteresis identified from pairs of branches.

    Attributes:
        centred: the elements, about the middle of the records' cycles.
        pairs: what it was fitted to.
        predicted: half-difference [N] of the fit, shape (n,).
        kkt_residual: largest violation of the optimality conditions, relative to the data.
        duality_gap: relative to the objective.
        left_out: predictions of what was left out of the fit; none before
            `leave_out`.
    """

    centred: CentredSlip
    pairs: BranchPairs
    predicted: Float[np.ndarray, " n"]
    kkt_residual: float
    duality_gap: float
    left_out: tuple[HysteresisLeftOut, ...] = ()

    @property
    def slip(self) -> MaxwellSlip:
        """The elements alone."""
        return self.centred.slip

    @property
    def rms(self) -> float:
        """Root mean square error [N] of the half-difference."""
        return float(np.sqrt(np.mean((self.predicted - self.pairs.half_difference) ** 2)))

    def half_difference(self, pairs: BranchPairs) -> Float[np.ndarray, " n"]:
        """Half-difference [N] that the fit predicts for other points, shape (n,)."""
        sides = (self.slip.wall, self.slip.braid)
        wall, braid = (np.asarray(one.threshold, float) for one in sides)
        strength = np.concatenate([np.asarray(one.strength, float) for one in sides])
        return half_difference_columns(pairs, (wall, braid), float(self.slip.modulus)) @ strength

    def heat(self, record: int) -> float:
        """Energy [J] that a closed cycle of a record loses by the fit, from start to turn and back.

        It comes from the fluid in a ramp and from the machine in a stroke. Of a cycled record it is
        that of the cycle which repeats itself.
        """
        at = int(np.flatnonzero(self.pairs.record == record)[0])
        ends = [
            (float(getattr(self.pairs, f"{end}_length")[at]),
             float(getattr(self.pairs, f"{end}_pressure")[at]))
            for end in ("start", "turn", "start")
        ]  # fmt: skip
        once, twice = (
            float(self.slip.heat(*np.array(ends + ends[1:] * more).T)) for more in (0, 1)
        )
        return twice - once if self.pairs.cycled[at] else once


def fit_hysteresis(
    pairs: BranchPairs,
    *,
    thresholds: Thresholds | None = None,
    cycle: ReferenceCycle | None = None,
    modulus: float = MODULUS,
    shrinkage: float = SHRINKAGE,
) -> HysteresisFit:
    """The non-negative strengths whose half-differences are nearest to those measured.

        minimise 1/2 |A S - h|^2 + 1/2 r |a|^2 |S|^2   subject to   S >= 0

    At fixed thresholds the force is linear in the strengths S, so that the optimum is that of a
    convex programme and global. The second term, a the largest column of A, chooses among strengths
    that the records cannot tell apart, and leaves at zero those of elements that no record moves.

    Args:
        pairs: of ramps, strokes or both.
        thresholds: of the elements on wall and braid; None for `threshold_grid`.
        cycle: whose middle the static map is; None for that of the records, if they are of one kind.
        modulus: E [Pa] of the coordinates.
        shrinkage: r [-], > 0 unless the records tell all elements apart.

    Returns:
        The fit.

    Raises:
        InputError: thresholds or a modulus that are not positive, ramps and strokes without a
            `cycle`, or elements that the records cannot tell apart and no shrinkage.
    """
    if not (np.isfinite(modulus) and modulus > 0 and shrinkage >= 0):
        raise InputError(
            f"modulus must be > 0 and shrinkage >= 0, got {modulus} Pa and {shrinkage}"
        )
    wall, braid = threshold_grid(pairs, modulus) if thresholds is None else thresholds
    for values in (wall, braid):
        if not (np.isfinite(values).all() and (values > 0).all()):
            raise InputError(f"thresholds must be > 0 and finite, got {values}")
    columns = half_difference_columns(pairs, (wall, braid), modulus)
    n = columns.shape[1]
    size = np.sqrt(shrinkage) * float(np.linalg.norm(columns, axis=0).max(initial=0.0))
    A = np.concatenate([columns, size * np.eye(n)])
    b = np.concatenate([pairs.half_difference, np.zeros(n)])
    G, h = np.eye(n), np.zeros(n)
    optimum = quick_jit(solve_qp)(A, b, G, h)
    if int(optimum.status) != Status.OPTIMAL:
        raise InputError(
            f"the records do not tell {n} elements apart: give a shrinkage, or fewer thresholds "
            "than turning points reach"
        )
    strength = np.maximum(np.asarray(optimum.x), 0.0)
    strength[np.asarray(optimum.active)] = 0.0  # active: what is left is rounding
    model = MaxwellSlip(
        SlipElements(wall, strength[: wall.size]),
        SlipElements(braid, strength[wall.size :]),
        pairs.rest_length,
        modulus,
    )
    return HysteresisFit(
        centred=CentredSlip(model, _cycle_of(pairs) if cycle is None else cycle),
        pairs=pairs,
        predicted=columns @ strength,
        kkt_residual=float(optimum.kkt_residual),
        duality_gap=float(optimum.duality_gap),
    )


def _cycle_of(pairs: BranchPairs) -> ReferenceCycle:
    """The cycle of records of one kind, its ends the median of theirs."""
    kinds = np.unique(pairs.is_ramp)
    if kinds.size > 1:
        raise InputError(
            "of ramps and strokes together it is not known which the static map is the mean of: "
            "give the cycle"
        )
    quantity = "pressure" if kinds[0] else "length"
    start, turn = (
        float(np.median(getattr(pairs, f"{end}_{quantity}"))) for end in ("start", "turn")
    )
    return ReferenceCycle(
        "ramp" if kinds[0] else "stroke", start, turn, bool(np.mean(pairs.cycled) > 0.5)
    )

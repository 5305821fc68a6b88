"""Fill and vent force of raw records at common pressures, from their quasi-static points."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError

from ..monotone_cubic import end_slope, monotone_cubic
from .quasi_static_ramp import QuasiStatic

Branches = Literal["both", "fill", "vent"]
"""Whose force a map shows: the mean of both branches, or one of them."""

_MERGE = 0.01  # of the pressure range: points closer than this are one


@dataclasses.dataclass(frozen=True)
class BranchCurves:
    """Fill and vent force at the common pressures, one row per record; nan where not measured."""

    fill: Float[np.ndarray, "records levels"]
    vent: Float[np.ndarray, "records levels"]
    fill_pulls: Bool[np.ndarray, "records levels"]
    vent_pulls: Bool[np.ndarray, "records levels"]

    def shown(
        self, branches: Branches
    ) -> tuple[Float[np.ndarray, "records levels"], Bool[np.ndarray, "records levels"]]:
        """The force of each record, and where it pulls."""
        if branches == "both":
            return (self.fill + self.vent) / 2, self.fill_pulls & self.vent_pulls
        if branches == "fill":
            return self.fill, self.fill_pulls
        return self.vent, self.vent_pulls


def branch_curves(
    points: QuasiStatic, records: Sequence[int], pressures: Float[np.ndarray, " levels"]
) -> BranchCurves:
    """The branches of these records."""
    (fill, fill_pulls), (vent, vent_pulls) = (
        zip(*(_curve(points, i, pressures, filling=filling) for i in records), strict=True)
        for filling in (True, False)
    )
    return BranchCurves(*map(np.stack, (fill, vent, fill_pulls, vent_pulls)))


def common_pressures(points: QuasiStatic, step: float) -> Float[np.ndarray, " levels"]:
    """The multiples of a step [Pa] from zero to the highest pressure of the points."""
    if not step > 0:
        raise InputError(f"step must be > 0, got {step} Pa")
    return step * np.arange(int(points.pressure.max() / step) + 1)


def _curve(
    points: QuasiStatic, record: int, pressures: Float[np.ndarray, " levels"], *, filling: bool
) -> tuple[Float[np.ndarray, " levels"], Bool[np.ndarray, " levels"]]:
    """Force of one branch of one record at the pressures, and where it pulls."""
    mine = points.record == record
    on = points.filling[mine] == filling
    if points.kinds[record] == "staircase":
        on = on | np.append(on[1:] & ~on[:-1], False)  # the hold before a turn
    on &= points.settled[mine]
    if not on.any():
        return np.full(pressures.size, np.nan), np.zeros(pressures.size, bool)
    P, F, slack = (x[mine][on] for x in (points.pressure, points.force, points.slack))
    P, F, slack = _merged(P, F, slack, _MERGE * float(np.ptp(points.pressure[mine])))
    start = int(np.flatnonzero(slack)[-1]) + 1 if slack.any() else 0
    force = monotone_cubic(P, F, pressures)
    above = pressures > (P[start - 1] if start else -np.inf)
    pulling = force
    if P.size - start >= 2:
        line = F[start] + end_slope(P[start:], F[start:]) * (pressures - P[start])
        cubic = monotone_cubic(P[start:], F[start:], pressures)
        pulling = np.where((pressures < P[start]) & (start > 0), line, cubic)
    pulls = above & np.isfinite(pulling) & (pulling >= points.slack_below)
    return np.where(pulls, pulling, force), pulls


def _merged(
    P: Float[np.ndarray, " n"],
    F: Float[np.ndarray, " n"],
    slack: Bool[np.ndarray, " n"],
    width: float,
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, " m"], Bool[np.ndarray, " m"]]:
    """Points in the order of pressure, those within the width of a first one averaged with it."""
    order = np.argsort(P, kind="stable")
    groups: list[list[int]] = []
    for i in order.tolist():
        if groups and P[i] - P[groups[-1][0]] <= width:
            groups[-1].append(i)
        else:
            groups.append([i])
    return (
        np.array([P[group].mean() for group in groups]),
        np.array([F[group].mean() for group in groups]),
        np.array([slack[group].any() for group in groups]),
    )

"""What raw records at one length show: counts, noise, hysteresis and repeatability."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float

from .branch_curves import BranchCurves, Branches
from .quasi_static_ramp import QuasiStatic


@dataclasses.dataclass(frozen=True)
class LengthSummary:
    """What the records at one length show. Statistics are taken where the muscle pulls.

    Attributes:
        length: active length L [m].
        n_records, n_unused: number of records, and of those among them without the branches that
            the map shows at any of its pressures.
        n_fill, n_vent: points on either branch.
        n_clamped, n_slack, n_unsettled, n_mislabelled: points so marked.
        n_repeated_stamps, n_glitches: readings with the time stamp of the one before, and with a
            valve state that is none.
        noise: root mean square over the points of the standard deviation of the readings [N].
        stderr: that of the standard error of a point [N].
        half_width_mean, half_width_rms, half_width_max: of the hysteresis (vent - fill)/2 over
            records and pressures [N]; the last one the largest magnitude. nan without one.
        repeatability_fill, repeatability_vent, repeatability: standard deviation [N] between
            records at the same pressure, pooled over pressures; of the branches and of what the map
            shows. nan where no two records share a pressure.
    """

    length: float
    n_records: int
    n_unused: int
    n_fill: int
    n_vent: int
    n_clamped: int
    n_slack: int
    n_unsettled: int
    n_mislabelled: int
    n_repeated_stamps: int
    n_glitches: int
    noise: float
    stderr: float
    half_width_mean: float
    half_width_rms: float
    half_width_max: float
    repeatability_fill: float
    repeatability_vent: float
    repeatability: float


def length_summary(
    points: QuasiStatic, records: Sequence[int], curves: BranchCurves, branches: Branches
) -> LengthSummary:
    """What these records, all at one length, show."""
    mine = np.isin(points.record, records)
    pulling = mine & ~points.slack & points.settled
    half = ((curves.vent - curves.fill) / 2)[curves.fill_pulls & curves.vent_pulls]
    measured = [points.records[i] for i in records]
    noise, stderr = (
        float(np.sqrt(np.mean(x[pulling if pulling.any() else mine] ** 2)))
        for x in (points.noise, points.stderr)
    )
    return LengthSummary(
        length=float(measured[0].length),
        n_records=len(records),
        n_unused=int(np.sum(~np.isfinite(curves.shown(branches)[0]).any(axis=1))),
        n_fill=int(np.sum(mine & points.filling)),
        n_vent=int(np.sum(mine & ~points.filling)),
        n_clamped=int(np.sum(mine & points.clamped)),
        n_slack=int(np.sum(mine & points.slack)),
        n_unsettled=int(np.sum(mine & ~points.settled)),
        n_mislabelled=int(np.sum(mine & points.mislabelled)),
        n_repeated_stamps=sum(record.n_repeated_stamps for record in measured),
        n_glitches=sum(record.n_glitches for record in measured),
        noise=noise,
        stderr=stderr,
        half_width_mean=float(half.mean()) if half.size else np.nan,
        half_width_rms=float(np.sqrt(np.mean(half**2))) if half.size else np.nan,
        half_width_max=float(np.abs(half).max()) if half.size else np.nan,
        repeatability_fill=_repeatability(curves.fill, curves.fill_pulls),
        repeatability_vent=_repeatability(curves.vent, curves.vent_pulls),
        repeatability=_repeatability(*curves.shown(branches)),
    )


def _repeatability(
    force: Float[np.ndarray, "records levels"], pulls: Bool[np.ndarray, "records levels"]
) -> float:
    """Standard deviation between records, pooled over the pressures that two or more share."""
    count = pulls.sum(axis=0)
    mean = np.where(pulls, force, 0.0).sum(axis=0) / np.maximum(count, 1)
    square = np.where(pulls, (force - mean) ** 2, 0.0).sum()
    freedom = int(np.maximum(count - 1, 0).sum())
    return float(np.sqrt(square / freedom)) if freedom else np.nan

"""The static force map of repeated records: the mean of fill and vent branches, and hysteresis."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError

from ..data.force_data import ForceData, Specimen
from .branch_curves import Branches, branch_curves, common_pressures
from .length_summary import LengthSummary, length_summary
from .quasi_static_ramp import QuasiStatic

_LEAST_STD = 1e-9  # of the largest force: a standard deviation below is rounding


@dataclasses.dataclass(frozen=True)
class StaticMap:
    """Static force at common pressures of every length, one row per length and pressure.

    Attributes:
        length: L [m], shape (rows,).
        pressure: gauge pressure P [Pa], shape (rows,).
        force: F [N], shape (rows,): the mean over records.
        half_width: hysteresis (vent - fill)/2 [N], the mean over records, shape (rows,); nan where
            no record has both branches.
        n_records: records in the mean, shape (rows,).
        slack: no record pulls there, shape (rows,): the force is no static force of the muscle.
        force_std: standard error of the force [N], shape (rows,): that of the points, and the
            repeatability of the length (of all lengths where it has no repeats) over the root of
            the number of records.
        branches: whose force it is.
        lengths: what the records at each length show.
        points: what the map was made from.
    """

    length: Float[np.ndarray, " rows"]
    pressure: Float[np.ndarray, " rows"]
    force: Float[np.ndarray, " rows"]
    half_width: Float[np.ndarray, " rows"]
    n_records: Int[np.ndarray, " rows"]
    slack: Bool[np.ndarray, " rows"]
    force_std: Float[np.ndarray, " rows"]
    branches: Branches
    lengths: tuple[LengthSummary, ...]
    points: QuasiStatic

    def force_data(
        self, specimen: Specimen, *, length_std: float | None = None, keep_slack: bool = False
    ) -> ForceData:
        """The map as data of an identification, without its slack rows.

        Args:
            specimen: the muscle.
            length_std: standard deviation of the lengths [m], where it is known.
            keep_slack: keep slack rows whose force is <= 0, as censored readings.

        Raises:
            InputError: no row pulls, or what `ForceData` refuses.
        """
        kept = ~self.slack | (keep_slack & (self.force <= 0))
        if self.slack.all():
            raise InputError(
                f"all {self.slack.size} rows of the map are slack, under "
                f"{self.points.slack_below:.4g} N: check the force column, or lower slack_below"
            )
        std = self.force_std[kept]
        noisy = bool((std > _LEAST_STD * self.force.max()).all())
        return ForceData(
            force=self.force[kept],
            pressure=self.pressure[kept],
            length=self.length[kept],
            specimen=specimen,
            force_std=std if noisy else None,
            length_std=None if length_std is None else np.full(int(kept.sum()), length_std),
            source=", ".join(record.source for record in self.points.records),
            notes=self._notes(int((~kept).sum()), noisy=noisy),
        )

    def _notes(self, left_out: int, *, noisy: bool) -> tuple[str, ...]:
        shown = {
            "both": "the mean of fill and vent branches",
            "fill": "that of the fill branch",
            "vent": "that of the vent branch",
        }[self.branches]
        zeros = self.points.atmosphere
        notes = [
            f"Forces are quasi-static, {shown} of {len(self.points.records)} records; the pressure "
            f"sensor's reading at atmosphere, {min(zeros) / 1e3:.4g} to {max(zeros) / 1e3:.4g} "
            "kPa, is subtracted.",
            f"{left_out} of {self.slack.size} rows are slack (under {self.points.slack_below:.4g} "
            "N) and left out.",
        ]
        if unused := sum(one.n_unused for one in self.lengths):
            notes.append(f"{unused} records lack the branches shown, and are not used.")
        if not noisy:
            notes.append("The readings show no noise: forces have no standard deviation.")
        elif any(np.isnan(one.repeatability) for one in self.lengths):
            notes.append(
                "Not every length has records that repeat a pressure: there, the standard deviation "
                "of the force takes the repeatability of the other lengths, or is that of the noise "
                "alone where none has."
            )
        return tuple(notes)


def static_map(
    points: QuasiStatic,
    *,
    step: float = 25e3,
    pressures: Float[np.ndarray, " levels"] | None = None,
    branches: Branches = "both",
) -> StaticMap:
    """The mean curve of fill and vent branches at common pressures, with hysteresis and errors.

    Each branch of each record becomes a shape-preserving cubic through its settled points; those
    closer than 1 % of the pressure range are averaged, and the hold before a turn belongs to both
    branches. Where the muscle turns slack between two points the force has a kink: the curve of the
    pulling points above is drawn on straight to the slack point, as long as it pulls, and what is
    below is slack. (A single pulling point is joined to the slack one by the cubic.) Beyond the
    points nothing is extrapolated.
    The mean is taken first over the branches of a record, then over the records that pull at the
    pressure, so that differences between records do not enter the hysteresis.

    Args:
        points: of records at one length or several.
        step: of the common pressures [Pa], its multiples from zero up.
        pressures: the common gauge pressures [Pa] instead, increasing, >= 0.
        branches: "both", or "fill" or "vent" where the other branch was not recorded.

    Returns:
        The map.

    Raises:
        InputError: pressures that do not increase, or a length at which no record has the branches
            asked for at any of the pressures.
    """
    if branches not in {"both", "fill", "vent"}:
        raise InputError(f'branches must be "both", "fill" or "vent", got {branches!r}')
    if pressures is None:
        pressures = common_pressures(points, step)
    elif pressures.size == 0 or pressures[0] < 0 or (np.diff(pressures) <= 0).any():
        raise InputError(f"pressures must be >= 0 and increase, got {pressures} Pa")
    parts = [_at_length(points, L, pressures, branches) for L in np.unique(points.length)[::-1]]
    summaries = tuple(summary for _, summary in parts)
    length, pressure, force, half_width, count, slack = (
        np.concatenate(column) for column in zip(*(rows for rows, _ in parts), strict=True)
    )
    return StaticMap(
        length=length,
        pressure=pressure,
        force=force,
        half_width=half_width,
        n_records=count,
        slack=slack,
        force_std=_single_std(summaries, branches, length) / np.sqrt(count),
        branches=branches,
        lengths=summaries,
        points=points,
    )


def _single_std(
    summaries: Sequence[LengthSummary], branches: Branches, length: Float[np.ndarray, " rows"]
) -> Float[np.ndarray, " rows"]:
    """Standard deviation of a row that a single record gives: of its points, and between records.

    A length without repeats has the repeatability pooled over the others.
    """
    between = np.array([one.repeatability for one in summaries])
    known = between[np.isfinite(between)]
    pooled = float(np.sqrt(np.mean(known**2))) if known.size else 0.0
    within = np.array([one.stderr for one in summaries]) / np.sqrt(2 if branches == "both" else 1)
    std = np.hypot(within, np.where(np.isfinite(between), between, pooled))
    at = [one.length for one in summaries]
    return np.array([std[at.index(L)] for L in length])


def _at_length(
    points: QuasiStatic,
    length: float,
    pressures: Float[np.ndarray, " levels"],
    branches: Branches,
) -> tuple[tuple[np.ndarray, ...], LengthSummary]:
    records = [i for i, record in enumerate(points.records) if record.length == length]
    curves = branch_curves(points, records, pressures)
    force, pulls = curves.shown(branches)
    pulling = np.any(pulls, axis=0)
    known = np.any(np.isfinite(force), axis=0)
    if not known.any():
        raise InputError(
            f"no record at {length * 1e3:.6g} mm has "
            f"{'both branches' if branches == 'both' else f'a {branches} branch'} at a common "
            'pressure: vent the muscle too, show one branch (branches="fill"), or use smaller steps'
        )
    summary = length_summary(points, records, curves, branches)
    used = np.where(pulling, pulls, np.isfinite(force))[:, known]
    count = used.sum(axis=0)
    rows = (
        np.full(count.size, length),
        pressures[known],
        np.where(used, force[:, known], 0.0).sum(axis=0) / count,
        _masked_mean(((curves.vent - curves.fill) / 2)[:, known], used),
        count,
        ~pulling[known],
    )
    return rows, summary


def _masked_mean(
    values: Float[np.ndarray, "records levels"], used: Bool[np.ndarray, "records levels"]
) -> Float[np.ndarray, " levels"]:
    """Mean over the records used whose value is known; nan where there is none."""
    used = used & np.isfinite(values)
    total, count = np.where(used, values, 0.0).sum(axis=0), used.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)

"""Read raw isometric ramps and compute the static force at each pressure hold or bin."""

import dataclasses
import itertools
import statistics
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError
from famjax.tables import check_time, read_table

from .record import Column, check_positive, noise_of, set_columns, split_branches

LEAST_READINGS = 5
"""Smallest number of readings in the used part of a hold, and on either side of the centre of a bin."""

Mask = Bool[np.ndarray, " n"]
Rows = Int[np.ndarray, " _"]
Holds = Float[np.ndarray, " holds"]
Kind = Literal["staircase", "ramp"]
"""Valve pulses with holds between them, or a continuously changing pressure."""
Points = list[tuple[Rows, dict[str, Any]]]
"""Rows and `QuasiStatic` columns of each point."""

_PART = (0.56, 0.96)  # part of each hold that is used, as fractions
_BIN = 25e3  # width of the bins of a continuous ramp [Pa]
_MAX_DRIFT = 2e3  # largest pressure drift of a settled hold [Pa]
_JUMP = 0.01  # smallest jump over two readings, relative to the pressure range
_JUMP_NOISE = 8.0  # the same in standard deviations of the pressure noise
_CALM = 0.25  # periods without a jump before a pulse, longer than the air oscillates
_LEAST_PULSES = 4
_LEAST_CORRELATION = 0.3
_FULL = 0.95  # smallest length of the first and last hold, in periods
_TOLERANCE = 0.15  # largest deviation of a regular pulse, in periods
_MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median relative to a mean, normal noise
_CLAMP_READINGS = 20  # readings at the exact minimum that indicate a clamped sensor
_CLAMP_SPAN = 0.02  # smallest pressure range of clamped readings, relative
_CLAMPED = 0.1  # fraction of clamped readings from which a point is clamped
_SLACK_NOISE = 6.0  # force below which a point is slack, in standard deviations of the noise
_STANDS = 0.9  # largest fraction of repeated time stamps
_VACUUM = 0.05  # deepest reading below atmosphere, relative to the pressure range


@dataclasses.dataclass(frozen=True)
class RampRecord:
    """Record of a muscle filled and vented at constant length, in chronological order.

    Attributes:
        force: measured force F [N], shape (n,), positive when the muscle pulls.
        pressure: raw sensor reading [Pa], shape (n,), without zero correction.
        time: times [s], shape (n,); they may repeat but not decrease.
        length: constant active length L [m].
        source: origin of the data.
        taken: how the columns of the file were interpreted; commands print it.
    """

    force: Column
    pressure: Column
    time: Column
    length: float
    source: str = "arrays"
    taken: str = ""

    def __post_init__(self) -> None:
        set_columns(self, "force", "pressure", "time")
        check_positive(length=self.length)
        for name in ("time", "pressure"):
            if np.ptp(getattr(self, name)) == 0:
                raise InputError(
                    f"the {name} in a record must vary, but it is constant: check which column is used"
                )


def read_ramp(
    path: str | Path, *, length: float, columns: Mapping[str, str] | None = None
) -> RampRecord:
    """Read a record from a file without any correction or smoothing.

    Args:
        path: the file, see `famjax.tables.read_table`.
        length: active length L [m] at which the muscle was held.
        columns: column name of each quantity that cannot be recognised, `{"force": "Kraft [N]"}`, or its
            number, `{"force": "1 [N]"}`.

    Returns:
        The record in SI, with raw pressure readings.

    Raises:
        InputError: the file is invalid; the message states the row.
    """
    table = read_table(
        path, ("force", "pressure", "time"), columns=columns, strict=True, absolute=True
    )
    try:
        check_time(table, _STANDS)
        return RampRecord(**table.columns, length=length, source=table.source, taken=table.said())
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


@dataclasses.dataclass(frozen=True)
class Staircase:
    """Pressure holds of a record.

    Attributes:
        period: time between valve pulses [s].
        start, stop: start and end of each hold [s], shape (holds,), from one pulse to the next.
    """

    period: float
    start: Holds
    stop: Holds

    def rows(self, time: Column) -> list[Rows]:
        """Return the rows in the evaluated part of each hold."""
        width = self.stop - self.start
        low, high = (np.searchsorted(time, self.start + end * width) for end in _PART)
        return [np.arange(i, j) for i, j in zip(low, high, strict=True)]


def find_staircase(pressure: Column, time: Column) -> Staircase | None:
    """Find the holds of a record; None if the pressure does not change in regular pulses.

    A reading counts as moving if the pressure changes over two readings by more than 1 % of its range and
    by more than noise explains. The period is the lag of the highest peak in the autocorrelation of the
    moving readings. A pulse is the first moving reading after a quarter period without any. The time
    between two pulses is one hold, or several equal holds if a pulse had no effect.

    Args:
        pressure: pressures [Pa], shape (n,).
        time: times [s], shape (n,).

    Returns:
        The holds, or None if there are fewer than four pulses or no period.
    """
    t = time - time[0]
    jump = max(_JUMP * float(np.ptp(pressure)), _JUMP_NOISE * noise_of(pressure))
    moving = t[1:-1][np.abs(pressure[2:] - pressure[:-2]) > jump]
    lag = _period(moving, t)
    if lag is None:
        return None
    pulses = moving[np.diff(moving, prepend=-np.inf) > _CALM * lag]
    if pulses.size < _LEAST_PULSES:
        return None
    gaps = np.diff(pulses)
    regular = np.abs(gaps / lag - np.round(gaps / lag)) < _TOLERANCE
    if regular.sum() < gaps.size / 2:
        return None
    lag = float(np.median(gaps[regular] / np.round(gaps[regular] / lag)))
    before = pulses[0] - lag * np.arange(int((pulses[0] + (1 - _FULL) * lag) / lag), 0, -1)
    after = pulses[-1] + lag * np.arange(1, int((t[-1] - pulses[-1]) / lag + 1 - _FULL) + 1)
    inner = [
        np.linspace(a, b, max(1, round((b - a) / lag)), endpoint=False)
        for a, b in itertools.pairwise(pulses)
    ]
    edges = np.concatenate([before, *inner, pulses[-1:], after]) + time[0]
    return Staircase(period=lag, start=edges[:-1], stop=edges[1:])


def _period(moving: Float[np.ndarray, " m"], time: Column) -> float | None:
    """Return the lag [s] of the highest autocorrelation peak of moving readings; None if it is low."""
    from scipy.signal import correlate  # noqa: PLC0415 -- 0.2 s

    n = time.size
    step = time[-1] / (n - 1)
    signal = np.zeros(n)
    signal[np.round(moving / step).astype(int)] = 1.0
    signal -= signal.mean()
    correlation = correlate(signal, signal, method="fft")[n - 1 : n - 1 + n // 2]
    low = np.flatnonzero(correlation < 0.1 * correlation[0])
    if not low.size:
        return None
    lag = int(low[0] + np.argmax(correlation[low[0] :]))
    return lag * step if correlation[lag] >= _LEAST_CORRELATION * correlation[0] else None


@dataclasses.dataclass(frozen=True)
class QuasiStatic:
    """Quasi-static points of several records, ordered by record and time.

    Attributes:
        record: index of the record in `records`, shape (n,).
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        force: F [N], shape (n,).
        filling: True on the fill branch, False on the vent branch, shape (n,).
        noise: standard deviation of the force readings used [N], shape (n,).
        stderr: standard error of the force for independent readings [N], shape (n,).
        slack: True if more than a tenth of the readings are at the clamp, or if the force is below
            `slack_below`, shape (n,).
        settled: True if the pressure drift is within the limit, shape (n,).
        records: the records.
        atmosphere: reading at atmospheric pressure [Pa].
        kinds: "staircase" or "ramp" for each record.
        periods: time between valve pulses [s] of each record; nan for a ramp.
        n_short: number of holds with too few readings in each record.
        clamp: smallest force [N] that the sensor can indicate, or None if it is not clamped.
        slack_below: force [N] below which a point is slack.
    """

    record: Int[np.ndarray, " n"]
    length: Column
    pressure: Column
    force: Column
    filling: Mask
    noise: Column
    stderr: Column
    slack: Mask
    settled: Mask
    records: tuple[RampRecord, ...]
    atmosphere: float
    kinds: tuple[Kind, ...]
    periods: tuple[float, ...]
    n_short: tuple[int, ...]
    clamp: float | None
    slack_below: float


def quasi_static(
    records: Sequence[RampRecord], *, atmosphere: float, slack_below: float | None = None
) -> QuasiStatic:
    """Compute the static force at each hold or pressure bin, with its noise and branch.

    For a staircase, force and pressure are medians over the part of each hold from 0.56 to 0.96 of its
    duration, interpolated within the resolution of the sensor as for grouped data. A continuous ramp is
    divided into bins of 25 kPa on each branch. The force at the centre of a bin is read from a straight
    line through its readings; the curvature error F'' w^2 / 24 and the lag of sensors and rubber are
    neglected.

    Pressure is monotonic on a branch. The hold before a turning point, and any hold within 2 % of its
    pressure, belongs to the preceding branch.

    Points that are clamped, slack or unsettled are marked, not dropped. Holds with fewer than five readings
    in the used part produce no point, but are counted. The sensor counts as clamped if its smallest reading
    occurs at least 20 times over more than 2 % of the pressure range: unclamped noise rarely repeats its
    minimum, and a real force rises with pressure.

    Args:
        records: records from one sensor, each at constant length.
        atmosphere: reading at atmospheric pressure [Pa], which is subtracted.
        slack_below: force [N] below which the muscle counts as slack; None uses six standard deviations of
            the noise above zero or above the clamp, whichever is higher.

    Returns:
        The points of all records.

    Raises:
        InputError: there are no records or no points, holds have too few readings, or pressures are far
            below the reading at atmospheric pressure.
    """
    if not records:
        raise InputError("quasi_static needs at least one record, got none")
    clamp = _find_clamp(records)
    points, stairs, n_short = [], [], []
    for number, record in enumerate(records):
        _check_atmosphere(record, atmosphere)
        stair = find_staircase(record.pressure, record.time)
        found = _bins(record, atmosphere) if stair is None else _holds(record, atmosphere, stair)
        for rows, point in found:
            clamped = clamp is not None and np.mean(record.force[rows] <= clamp) > _CLAMPED
            points.append(
                {**point, "record": number, "length": record.length, "slack": bool(clamped)}
            )
        stairs.append(stair)
        n_short.append(0 if stair is None else stair.start.size - len(found))
    columns = {name: np.array([point[name] for point in points]) for name in points[0]}
    if slack_below is None:
        floor = max(0.0, clamp or 0.0)
        slack_below = floor + _SLACK_NOISE * float(np.median(columns["noise"]))
    columns["slack"] |= columns["force"] < slack_below
    return QuasiStatic(
        **columns,
        records=tuple(records),
        atmosphere=atmosphere,
        kinds=tuple("staircase" if stair else "ramp" for stair in stairs),
        periods=tuple(stair.period if stair else np.nan for stair in stairs),
        n_short=tuple(n_short),
        clamp=clamp,
        slack_below=slack_below,
    )


def _holds(record: RampRecord, zero: float, stair: Staircase) -> Points:
    """Return a point for every hold with enough readings."""
    holds = [rows for rows in stair.rows(record.time) if rows.size >= LEAST_READINGS]
    if not holds:
        raise InputError(
            f"{record.source} has fewer than {LEAST_READINGS} readings in the used part of each "
            f"{stair.period:.4g} s hold, {_PART[0]:.0%} to {_PART[1]:.0%} of it: sample faster"
        )
    pressures, forces = record.pressure, record.force
    step, fine = _resolution(forces), _resolution(pressures)
    pressure = np.array([_median(pressures[rows], fine) for rows in holds])
    points: Points = []
    for rows, P, filling in zip(holds, pressure, _directions(pressure), strict=True):
        F = forces[rows]
        noise = float(np.std(F, ddof=1))
        # Noise smaller than a step does not average out the rounding of readings.
        rounding = step / np.sqrt(12) if noise < step / 2 else 0.0
        points.append((rows, {
            "pressure": P - zero,
            "force": _median(F, step),
            "filling": filling,
            "noise": noise,
            "stderr": float(np.hypot(noise * _MEDIAN / np.sqrt(rows.size), rounding)),
            "settled": abs(_drift(record.time[rows], pressures[rows])) <= _MAX_DRIFT,
        }))  # fmt: skip
    return points


def _resolution(values: Column) -> float:
    """Return the resolution of the sensor: the smallest difference between two readings."""
    return float(np.diff(np.unique(values)).min(initial=np.inf)) if np.ptp(values) > 0 else 0.0


def _median(values: Column, step: float) -> float:
    """Return the median, interpolated within the resolution of the sensor."""
    return statistics.median_grouped(values.tolist(), step)


def _drift(t: Column, values: Column) -> float:
    """Return the linear change of the values over the time span."""
    late = t - t.mean()
    return float(late @ values / (late @ late) * np.ptp(t)) if np.ptp(t) > 0 else 0.0


def _directions(pressure: Column) -> list[bool]:
    """Return, for each held pressure, True if it was reached by filling."""
    branches = split_branches(pressure) if pressure.size >= 3 else ()
    if not branches:
        return [bool(pressure[-1] >= pressure[0])] * pressure.size
    filling = np.full(pressure.size, branches[0].rising)
    for branch in branches:
        filling[branch.start + 1 :] = branch.rising  # the first row belongs to the previous branch
    return filling.tolist()


def _bins(record: RampRecord, zero: float) -> Points:
    """Return a point for every pressure bin of every branch, in chronological order."""
    P = record.pressure - zero
    points: Points = []
    for branch in split_branches(P):
        rows = np.arange(branch.start, branch.stop)
        inside = P[rows]
        middles = _BIN * np.arange(np.ceil(inside.min() / _BIN), inside.max() / _BIN)
        for middle in middles if branch.rising else middles[::-1]:
            near = rows[np.abs(inside - middle) <= _BIN / 2]
            below = int(np.sum(P[near] < middle))
            if min(below, near.size - below) < LEAST_READINGS:
                continue
            F, x = record.force[near], P[near] - middle
            line, covariance = np.polyfit(x, F, 1, cov="unscaled")
            noise = float(np.sqrt(np.sum((F - np.polyval(line, x)) ** 2) / (x.size - 2)))
            points.append((near, {
                "pressure": float(middle),
                "force": float(line[1]),
                "filling": branch.rising,
                "noise": noise,
                "stderr": noise * float(np.sqrt(covariance[1, 1])),
                "settled": True,
            }))  # fmt: skip
    if not points:
        raise InputError(
            f"{record.source} has no complete pressure bin of {_BIN:.6g} Pa: the pressure must rise or "
            f"fall over several bins, with {2 * LEAST_READINGS} readings in each"
        )
    return points


def _check_atmosphere(record: RampRecord, atmosphere: float) -> None:
    """Reject a reading at atmospheric pressure that is not finite or far above the lowest pressures."""
    if not np.isfinite(atmosphere):
        raise InputError(f"the reading at atmospheric pressure must be finite, got {atmosphere} Pa")
    low = float(np.sort(record.pressure)[:LEAST_READINGS].max())  # ignore single glitches
    if low < atmosphere - _VACUUM * np.ptp(record.pressure):
        raise InputError(
            f"the lowest pressure in {record.source}, {low / 1e3:.4g} kPa, is far below the stated reading "
            f"at atmospheric pressure, {atmosphere / 1e3:.4g} kPa: specify the reading of the vented "
            "muscle (0kPa for a zeroed gauge)"
        )


def _find_clamp(records: Sequence[RampRecord]) -> float | None:
    """Return the smallest reading in all records if the sensor is clamped there, else None."""
    force = np.concatenate([record.force for record in records])
    pressure = np.concatenate([record.pressure for record in records])
    least = force == force.min()
    low, high = np.percentile(pressure[least], [5, 95])
    if least.sum() < _CLAMP_READINGS or high - low <= _CLAMP_SPAN * np.ptp(pressure):
        return None
    return float(force.min())

"""Raw isometric ramps: static force at each pressure hold or bin, at constant length."""

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError
from famjax.tables import check_time, read_table

from .record import Column, check_positive, noise_of, set_columns, split_branches

FILL, VENT = 1, 2
"""Values of the valve state; 0 is closed, any other value is a glitch."""
LEAST_READINGS = 5
"""Fewest readings in the used part of a hold, and on either side of the centre of a bin."""

Mask = Bool[np.ndarray, " n"]
Rows = Int[np.ndarray, " _"]
Holds = Float[np.ndarray, " holds"]
Kind = Literal["staircase", "ramp"]
"""Valve pulses with holds between them, or a continuously changing pressure."""
Points = list[tuple[Rows, dict[str, Any]]]
"""Rows and `QuasiStatic` columns of each point."""

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
_FLAT = 0.02  # largest spread of a vented interval, relative to the pressure range
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
        valve_state: valve state, shape (n,), or None: 0 closed, 1 fill, 2 vent. Other values are
            glitches, which are counted but not used.
        source: origin of the data.
        taken: how the columns of the file were interpreted, for the command that read it.
    """

    force: Column
    pressure: Column
    time: Column
    length: float
    valve_state: Column | None = None
    source: str = "arrays"
    taken: str = ""

    def __post_init__(self) -> None:
        set_columns(self, "force", "pressure", "time", "valve_state")
        check_positive(length=self.length)
        for name in ("time", "pressure"):
            if np.ptp(getattr(self, name)) == 0:
                raise InputError(
                    f"the {name} of a record must vary, got a constant column: check the column"
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
        InputError: the file is invalid; the message names the row.
    """
    table = read_table(
        path, ("force", "pressure", "time"), optional=("valve_state",), columns=columns, strict=True,
        absolute=True,
    )  # fmt: skip
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

    def rows(self, time: Column, part: tuple[float, float]) -> list[Rows]:
        """Return the rows of a part of each hold, given as fractions of the hold."""
        width = self.stop - self.start
        low, high = (np.searchsorted(time, self.start + end * width) for end in part)
        return [np.arange(i, j) for i, j in zip(low, high, strict=True)]


def find_staircase(
    pressure: Column, time: Column, *, period: float | None = None
) -> Staircase | None:
    """Find the holds of a record; None if the pressure does not change in regular pulses.

    The pressure moves at a reading if it changes over two readings by more than 1 % of its range and by
    more than noise explains. The period is the lag of the highest autocorrelation peak of moving
    readings. A pulse is the first moving reading after a quarter period without motion. The time
    between two pulses is one hold, or several equal ones if a pulse had no effect.

    Args:
        pressure: pressures [Pa], shape (n,).
        time: times [s], shape (n,).
        period: known period [s]; None to detect it.

    Returns:
        The holds, or None if there are fewer than four pulses or no period.

    Raises:
        InputError: the period is not between two readings and half the record.
    """
    t = time - time[0]
    if period is not None and not 2 * t[-1] / t.size < period < t[-1] / 2:
        raise InputError(
            f"the period must be longer than two readings and shorter than half the record, "
            f"{t[-1] / 2:.4g} s, got {period} s"
        )
    jump = max(_JUMP * float(np.ptp(pressure)), _JUMP_NOISE * noise_of(pressure))
    moving = t[1:-1][np.abs(pressure[2:] - pressure[:-2]) > jump]
    lag = _period(moving, t) if period is None else period
    if lag is None:
        return None
    pulses = moving[np.diff(moving, prepend=-np.inf) > _CALM * lag]
    if pulses.size < _LEAST_PULSES:
        return None
    gaps = np.diff(pulses)
    regular = np.abs(gaps / lag - np.round(gaps / lag)) < _TOLERANCE
    if regular.sum() < gaps.size / 2:
        return None
    if period is None:
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
    """Lag [s] of the highest autocorrelation peak of moving readings; None if it is low."""
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
        time: mean time of the readings used [s], shape (n,); nan for a continuous ramp.
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        force: F [N], shape (n,).
        filling: True on the fill branch, False on the vent branch, shape (n,).
        noise: standard deviation of the force readings used [N], shape (n,).
        stderr: standard error of the force for independent readings [N], shape (n,).
        pressure_noise: standard deviation of the pressure readings used [Pa], shape (n,).
        force_drift, pressure_drift: linear change over the readings used [N], [Pa], shape (n,); nan for
            a continuous ramp.
        clamped: True if more than a tenth of the readings are at the clamp, shape (n,).
        slack: True if clamped, or if the force is below `slack_below`, shape (n,).
        settled: True if the pressure drift is within the limit, shape (n,).
        mislabelled: True if most valve states contradict the branch, shape (n,).
        records: the records.
        atmosphere: pressure reading at atmosphere [Pa] of each record.
        kinds: "staircase" or "ramp" for each record.
        periods: time between valve pulses [s] of each record; nan for a ramp.
        n_short: number of holds with too few readings in each record.
        clamp: smallest force [N] that the sensor can show, or None if it is not clamped.
        slack_below: force [N] below which a point is slack.
    """

    record: Int[np.ndarray, " n"]
    time: Column
    length: Column
    pressure: Column
    force: Column
    filling: Mask
    noise: Column
    stderr: Column
    pressure_noise: Column
    force_drift: Column
    pressure_drift: Column
    clamped: Mask
    slack: Mask
    settled: Mask
    mislabelled: Mask
    records: tuple[RampRecord, ...]
    atmosphere: tuple[float, ...]
    kinds: tuple[Kind, ...]
    periods: tuple[float, ...]
    n_short: tuple[int, ...]
    clamp: float | None
    slack_below: float


def quasi_static(
    records: RampRecord | Sequence[RampRecord],
    *,
    atmosphere: float | tuple[float, float],
    kind: Kind | None = None,
    period: float | None = None,
    part: tuple[float, float] = (0.56, 0.96),
    bin_width: float = 25e3,
    clamp: float | None = None,
    slack_below: float | None = None,
    max_drift: float = 2e3,
) -> QuasiStatic:
    """Compute the static force at each hold or pressure bin, with its noise and branch.

    For a staircase, force and pressure are medians over a part of each hold, interpolated within the
    resolution of the sensor as for grouped data. A continuous ramp is divided into pressure bins on each
    branch. The force at the centre of a bin comes from a straight line through its readings; the
    curvature error F'' w^2 / 24 and the lag of sensors and rubber are neglected.

    Pressure is monotonic on a branch. The hold before a turning point, and any hold within 2 % of its
    pressure, belongs to the preceding branch. The valve state only serves as a check.

    Points that are clamped, slack or unsettled are marked, not dropped. Holds with fewer than five readings
    in the selected part give no point and are counted.

    Args:
        records: records from one sensor, each at constant length.
        atmosphere: pressure reading at atmosphere [Pa], which is subtracted; or the interval
            (start, stop) [s] of every record in which the muscle is vented.
        kind: kind of the records; None to detect it.
        period: time between valve pulses [s]; None to detect it.
        part: part of each hold to use, as fractions.
        bin_width: bin width w [Pa] of a ramp.
        clamp: smallest force [N] that the sensor can show. None uses the smallest reading if it
            occurs at least 20 times over more than 2 % of the pressure range: unclamped noise rarely
            repeats its minimum, and a force rises with pressure.
        slack_below: force [N] below which a muscle does not pull; None uses six standard deviations of
            the noise above zero or above the clamp, whichever is higher.
        max_drift: largest pressure drift [Pa] of a settled hold.

    Returns:
        The points of all records.

    Raises:
        InputError: there are no records or no points, the pressure changes in the vented interval, holds
            have too few readings, or an option is out of range.
    """
    records = (records,) if isinstance(records, RampRecord) else tuple(records)
    if not records:
        raise InputError("quasi_static needs at least one record, got none")
    if not 0 <= part[0] < part[1] <= 1:
        raise InputError(f"part must be (start, stop) with 0 <= start < stop <= 1, got {part}")
    if not bin_width > 0 or not max_drift > 0:
        raise InputError(
            f"bin_width and max_drift must be > 0, got {bin_width} Pa and {max_drift} Pa"
        )
    if clamp is None:
        clamp = _find_clamp(records)
    zeros, stairs, points = [], [], []
    for number, record in enumerate(records):
        zero, stair = _atmosphere(record, atmosphere), _staircase(record, kind, period)
        found = (
            _bins(record, zero, bin_width) if stair is None else _holds(record, zero, stair, part)
        )
        for rows, point in found:
            F = record.force[rows]
            points.append({
                **point,
                "record": number,
                "length": record.length,
                "clamped": clamp is not None and float(np.mean(clamp >= F)) > _CLAMPED,
                "mislabelled": _mislabelled(record, rows, filling=point["filling"]),
            })  # fmt: skip
        zeros.append(zero)
        stairs.append((stair, len(found)))
    columns = {name: np.array([point[name] for point in points]) for name in points[0]}
    if slack_below is None:
        floor = max(0.0, clamp or 0.0)
        slack_below = floor + _SLACK_NOISE * float(np.median(columns["noise"]))
    return QuasiStatic(
        **columns,
        slack=columns["clamped"] | (columns["force"] < slack_below),
        settled=~(np.abs(columns["pressure_drift"]) > max_drift),
        records=records,
        atmosphere=tuple(zeros),
        kinds=tuple("staircase" if stair else "ramp" for stair, _ in stairs),
        periods=tuple(stair.period if stair else np.nan for stair, _ in stairs),
        n_short=tuple(stair.start.size - made if stair else 0 for stair, made in stairs),
        clamp=clamp,
        slack_below=slack_below,
    )


def _holds(record: RampRecord, zero: float, stair: Staircase, part: tuple[float, float]) -> Points:
    """Return a point for every hold with enough readings."""
    holds = [rows for rows in stair.rows(record.time, part) if rows.size >= LEAST_READINGS]
    if not holds:
        raise InputError(
            f"{record.source} has fewer than {LEAST_READINGS} readings in the part {part} of its "
            f"{stair.period:.4g} s holds: use a larger part, or record faster"
        )
    step = _resolution(record.force)
    pressure, force = (_medians(values, holds) for values in (record.pressure, record.force))
    points: Points = []
    for rows, P, F, filling in zip(holds, pressure, force, _directions(pressure), strict=True):
        noise = float(np.std(record.force[rows], ddof=1))
        # Noise smaller than a step does not average out the rounding of readings.
        rounding = step / np.sqrt(12) if noise < step / 2 else 0.0
        time = record.time[rows]
        points.append((rows, {
            "time": float(np.mean(time)),
            "pressure": P - zero,
            "force": F,
            "filling": filling,
            "noise": noise,
            "stderr": float(np.hypot(noise * _MEDIAN / np.sqrt(rows.size), rounding)),
            "pressure_noise": float(np.std(record.pressure[rows], ddof=1)),
            "force_drift": _drift(time, record.force[rows]),
            "pressure_drift": _drift(time, record.pressure[rows]),
        }))  # fmt: skip
    return points


def _resolution(values: Column) -> float:
    """Resolution of the sensor: the smallest difference between two readings."""
    return float(np.diff(np.unique(values)).min(initial=np.inf)) if np.ptp(values) > 0 else 0.0


def _medians(values: Column, holds: Sequence[Rows]) -> Holds:
    """Median of each hold, interpolated within the resolution of the sensor."""
    step = _resolution(values)
    medians = []
    for rows in holds:
        held = np.sort(values[rows])
        middle = held[held.size // 2]
        below, above = np.searchsorted(held, middle), np.searchsorted(held, middle, "right")
        medians.append(middle + step * ((held.size / 2 - below) / (above - below) - 0.5))
    return np.array(medians)


def _drift(t: Column, values: Column) -> float:
    """Linear change of the values over the time span."""
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


def _bins(record: RampRecord, zero: float, width: float) -> Points:
    """Return a point for every pressure bin of every branch, in chronological order."""
    P = record.pressure - zero
    noise_of_pressure = noise_of(P)
    points: Points = []
    for branch in split_branches(P):
        rows = np.arange(branch.start, branch.stop)
        inside = P[rows]
        middles = width * np.arange(np.ceil(inside.min() / width), inside.max() / width)
        for middle in middles if branch.rising else middles[::-1]:
            near = rows[np.abs(inside - middle) <= width / 2]
            below = int(np.sum(P[near] < middle))
            if min(below, near.size - below) < LEAST_READINGS:
                continue
            F, x = record.force[near], P[near] - middle
            design = np.stack([np.ones_like(x), x / np.abs(x).max()], axis=1)
            inverse = np.linalg.pinv(design)
            value = inverse @ F
            residual = F - design @ value
            noise = float(np.sqrt(residual @ residual / (x.size - 2)))
            points.append((near, {
                "time": np.nan,
                "pressure": float(middle),
                "force": float(value[0]),
                "filling": branch.rising,
                "noise": noise,
                "stderr": noise * float(np.linalg.norm(inverse[0])),
                "pressure_noise": noise_of_pressure,
                "force_drift": np.nan,
                "pressure_drift": np.nan,
            }))  # fmt: skip
    if not points:
        raise InputError(
            f"{record.source} has no complete pressure bin of {width:.6g} Pa: the pressure must rise or "
            f"fall over several bins, with {2 * LEAST_READINGS} readings in each"
        )
    return points


def _mislabelled(record: RampRecord, rows: Rows, *, filling: bool) -> bool:
    if record.valve_state is None:
        return False
    return bool(np.mean(record.valve_state[rows] == (VENT if filling else FILL)) > 0.5)


def _atmosphere(record: RampRecord, given: float | tuple[float, float]) -> float:
    """Return the pressure reading of a record at atmosphere [Pa]."""
    if isinstance(given, tuple):
        start, stop = given
        vented = record.pressure[(record.time >= start) & (record.time <= stop)]
        if vented.size < LEAST_READINGS:
            raise InputError(
                f"the vented interval must have at least {LEAST_READINGS} readings; {record.source} has "
                f"{vented.size} from {start} to {stop} s: widen the interval, or give the reading in Pa"
            )
        if np.ptp(vented) > _FLAT * np.ptp(record.pressure):
            raise InputError(
                f"the pressure of {record.source} moves from {vented.min():.6g} to "
                f"{vented.max():.6g} Pa between {start} and {stop} s, so it is not vented there: "
                "choose another interval, or give the reading at atmosphere in Pa"
            )
        given = float(np.mean(vented))
    if not np.isfinite(given):
        raise InputError(f"the reading at atmosphere must be finite, got {given} Pa")
    low = float(np.sort(record.pressure)[:LEAST_READINGS].max())  # ignore single glitches
    if low < given - _VACUUM * np.ptp(record.pressure):
        raise InputError(
            f"{record.source} reads down to {low / 1e3:.4g} kPa, far below the stated reading at "
            f"atmosphere, {given / 1e3:.4g} kPa: give the reading of the vented muscle (0kPa for a zeroed "
            "gauge)"
        )
    return float(given)


def _find_clamp(records: Sequence[RampRecord]) -> float | None:
    """Return the smallest reading of all records if it is a clamp, else None."""
    force = np.concatenate([record.force for record in records])
    pressure = np.concatenate([record.pressure for record in records])
    least = force == force.min()
    low, high = np.percentile(pressure[least], [5, 95])
    if least.sum() < _CLAMP_READINGS or high - low <= _CLAMP_SPAN * np.ptp(pressure):
        return None
    return float(force.min())


def _staircase(record: RampRecord, kind: Kind | None, period: float | None) -> Staircase | None:
    if kind == "ramp":
        return None
    found = find_staircase(record.pressure, record.time, period=period)
    if found is None and (kind == "staircase" or period is not None):
        known = "" if period is None else f" of {period:.4g} s"
        raise InputError(
            f"{record.source} has no regular valve pulses{known}: give the period, or treat it as a "
            "continuous ramp"
        )
    return found

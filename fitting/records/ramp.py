"""Raw isometric records: pressure goes up and down at one length, and each hold gives a static force."""

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
"""Values of the valve state; 0 is closed, and any other value is a glitch."""
LEAST_READINGS = 5
"""Of a hold's part, and on either side of a bin's middle."""

Mask = Bool[np.ndarray, " n"]
Rows = Int[np.ndarray, " _"]
Holds = Float[np.ndarray, " holds"]
Kind = Literal["staircase", "ramp"]
"""Pulses of a valve with holds between them, or a pressure that moves all the time."""
Points = list[tuple[Rows, dict[str, Any]]]
"""Rows of the readings used, and columns of `QuasiStatic`, of each point."""

_JUMP = 0.01  # least jump over two readings, as a fraction of the record's pressure range
_JUMP_NOISE = 8.0  # and in standard deviations of the pressure noise
_CALM = 0.25  # of a period without a jump before a pulse: longer than the air rings
_LEAST_PULSES = 4
_LEAST_CORRELATION = 0.3
_FULL = 0.95  # least part of a period that the first or the last hold must have
_TOLERANCE = 0.15  # of a period by which a regular pulse may be early or late
_MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median over that of a mean, normal noise
_CLAMP_READINGS = 20  # at the exact minimum: noise without a clamp thins out long before it
_CLAMP_SPAN = 0.02  # of the pressure range: a muscle's force would rise over it
_CLAMPED = 0.1  # part of a point's readings at the clamp from which the point counts as clamped
_SLACK_NOISE = 6.0  # standard deviations of the noise above zero under which a point is slack
_FLAT = 0.02  # of the pressure range: the most by which a vented interval's readings may spread
_STANDS = 0.9  # of the readings: the most that may share the time stamp of the one before
_VACUUM = 0.05  # of the pressure range: the most by which a record may lie below atmosphere


@dataclasses.dataclass(frozen=True)
class RampRecord:
    """The record of a muscle held at one length while it is filled and vented, in order of time.

    Attributes:
        force: F [N], shape (n,), positive when the muscle pulls, as the sensor reads it.
        pressure: [Pa], shape (n,), as the sensor reads it: its zero is not yet subtracted.
        time: [s], shape (n,); stamps may repeat, but not run backwards.
        length: active length L [m], constant.
        valve_state: shape (n,), or None: 0 closed, 1 fill, 2 vent. Any other value is a glitch; it
            is counted and not used.
        source: where the numbers come from.
        taken: what the columns of a file were taken as, for the command that read it.
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
                    f"the {name} in a record must vary, but it is constant: check the column"
                )


def read_ramp(
    path: str | Path, *, length: float, columns: Mapping[str, str] | None = None
) -> RampRecord:
    """The record in a file; nothing is subtracted, left out or smoothed.

    Args:
        path: the file, see `famjax.tables.read_table`.
        length: active length L [m] at which the muscle was held.
        columns: which column is which quantity, `{"force": "Kraft [N]"}`, where the names do not say it or
            there are none, `{"force": "1 [N]"}`.

    Returns:
        The record in SI, pressure as the sensor reads it.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
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
    """When the pressure of a record is held.

    Attributes:
        period: between pulses of the valve [s].
        start, stop: of every hold [s], shape (holds,), from one pulse to the next.
    """

    period: float
    start: Holds
    stop: Holds

    def rows(self, time: Column, part: tuple[float, float]) -> list[Rows]:
        """Rows of each hold's part, given as fractions of the hold."""
        width = self.stop - self.start
        low, high = (np.searchsorted(time, self.start + end * width) for end in part)
        return [np.arange(i, j) for i, j in zip(low, high, strict=True)]


def find_staircase(
    pressure: Column, time: Column, *, period: float | None = None
) -> Staircase | None:
    """The holds of a record, or None where its pressure does not move in regular pulses.

    A reading moves where the pressure changes by more than 1 % of its range, and by more than the
    noise explains, over two readings. The period is the lag of the highest peak of the moving
    readings' autocorrelation. A pulse is the first moving reading after a calm quarter of it. The
    time between two pulses is one hold, or several equal ones where pulses moved nothing.

    Args:
        pressure: [Pa], shape (n,).
        time: [s], shape (n,).
        period: [s] where it is known; None finds it.

    Returns:
        The holds, or None: fewer than four pulses, or no period.

    Raises:
        InputError: a period that is not between two readings and half the record.
    """
    t = time - time[0]
    if period is not None and not 2 * t[-1] / t.size < period < t[-1] / 2:
        raise InputError(
            f"the period must lie between two readings and half the record, {t[-1] / 2:.4g} s, got "
            f"{period} s"
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
    """Lag [s] of the highest peak in the autocorrelation of the moving readings; None if low."""
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
    """The quasi-static points of a set of records, in the order of records and time.

    Attributes:
        record: number of the record in `records`, shape (n,).
        time: middle of the readings used [s], shape (n,); nan in a continuous ramp.
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        force: F [N], shape (n,).
        filling: True on the fill branch, False on the vent branch, shape (n,).
        noise: standard deviation of the force readings used [N], shape (n,).
        stderr: standard error of the force for independent readings [N], shape (n,).
        pressure_noise: standard deviation of the pressure readings used [Pa], shape (n,).
        force_drift, pressure_drift: change over the readings used [N], [Pa], by a straight line,
            shape (n,); nan in a continuous ramp.
        clamped: more than a tenth of the readings stand at the clamp, shape (n,).
        slack: clamped, or the force is under `slack_below`, shape (n,).
        settled: the pressure drifts by no more than was allowed, shape (n,).
        mislabelled: most valve states contradict the branch, shape (n,).
        records: the records.
        atmosphere: reading of the pressure sensor at atmosphere [Pa], one for each record.
        kinds: "staircase" or "ramp", one for each record.
        periods: between valve pulses [s], one for each record; nan for a ramp.
        n_short: holds with too few readings for a point, one for each record.
        clamp: least force [N] the sensor can show, or None where none shows.
        slack_below: force [N] under which a point is slack.
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
    """The static force at each hold or pressure bin, noise and branch with it.

    A hold of a staircase gives the medians of force and pressure over a part of it, resolved within
    the sensor's step as for grouped readings. A continuous ramp is cut into pressure bins on each
    branch; the force at a bin's middle is that of the straight line through its readings, which
    leaves out F'' w^2 / 24 for curvature; it is not corrected for the lag of sensors and rubber.
    A branch is where the pressure moves one way; the hold before a turn, and any within 2 % of the
    range of it, belongs to the branch before. The valve state is compared with it, not used.

    Points that are clamped, slack or unsettled are marked, not dropped; holds with fewer than five
    readings in the part give no point and are counted.

    Args:
        records: of one sensor, each at one length.
        atmosphere: what the pressure sensor reads at atmosphere [Pa], which is subtracted; or the
            interval (start, stop) [s] of every record in which the muscle is vented.
        kind: of the records; None finds out.
        period: between valve pulses [s]; None finds it from the pressure.
        part: of each hold that is used, as fractions of it.
        bin_width: w [Pa], of a ramp.
        clamp: least force [N] the sensor can show. None takes the least reading of all records, if
            it occurs 20 times or more and over more than 2 % of the pressure range: noise without a
            clamp thins out, and a force rises with the pressure.
        slack_below: force [N] under which a muscle does not pull; None takes six standard
            deviations of the noise above zero or above the clamp, whichever is higher.
        max_drift: pressure drift [Pa] up to which a hold is settled.

    Returns:
        The points of all records.

    Raises:
        InputError: no records, a vented interval in which the pressure moves, holds with too few
            readings, no points, or an option outside its range.
    """
    records = (records,) if isinstance(records, RampRecord) else tuple(records)
    if not records:
        raise InputError("quasi_static needs at least one record, got none")
    if not 0 <= part[0] < part[1] <= 1:
        raise InputError(f"part is (start, stop) with 0 <= start < stop <= 1, got {part}")
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
    """A point for every hold that has readings enough."""
    holds = [rows for rows in stair.rows(record.time, part) if rows.size >= LEAST_READINGS]
    if not holds:
        raise InputError(
            f"{record.source} has fewer than {LEAST_READINGS} readings in the part {part} of its "
            f"holds of {stair.period:.4g} s: widen the part, or record faster"
        )
    step = _resolution(record.force)
    pressure, force = (_medians(values, holds) for values in (record.pressure, record.force))
    points: Points = []
    for rows, P, F, filling in zip(holds, pressure, force, _directions(pressure), strict=True):
        noise = float(np.std(record.force[rows], ddof=1))
        # Noise that does not reach the next step leaves the rounding of a reading in the median.
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
    """The sensor's step: the least difference between two readings."""
    return float(np.diff(np.unique(values)).min(initial=np.inf)) if np.ptp(values) > 0 else 0.0


def _medians(values: Column, holds: Sequence[Rows]) -> Holds:
    """The median of each hold; readings at the middle are spread over the sensor's step."""
    step = _resolution(values)
    medians = []
    for rows in holds:
        held = np.sort(values[rows])
        middle = held[held.size // 2]
        below, above = np.searchsorted(held, middle), np.searchsorted(held, middle, "right")
        medians.append(middle + step * ((held.size / 2 - below) / (above - below) - 0.5))
    return np.array(medians)


def _drift(t: Column, values: Column) -> float:
    """Change of the values over the time, by a straight line."""
    late = t - t.mean()
    return float(late @ values / (late @ late) * np.ptp(t)) if np.ptp(t) > 0 else 0.0


def _directions(pressure: Column) -> list[bool]:
    """Whether each of the held pressures was reached by filling."""
    branches = split_branches(pressure) if pressure.size >= 3 else ()
    if not branches:
        return [bool(pressure[-1] >= pressure[0])] * pressure.size
    filling = np.full(pressure.size, branches[0].rising)
    for branch in branches:
        filling[branch.start + 1 :] = branch.rising  # its first row is the last of the hold before
    return filling.tolist()


def _bins(record: RampRecord, zero: float, width: float) -> Points:
    """A point for every pressure bin of every branch, in the order of time."""
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
            f"{record.source} gives no pressure bin of {width:.6g} Pa: its pressure must rise or "
            f"fall over several bins, with {2 * LEAST_READINGS} readings in each"
        )
    return points


def _mislabelled(record: RampRecord, rows: Rows, *, filling: bool) -> bool:
    if record.valve_state is None:
        return False
    return bool(np.mean(record.valve_state[rows] == (VENT if filling else FILL)) > 0.5)


def _atmosphere(record: RampRecord, given: float | tuple[float, float]) -> float:
    """What the sensor of a record reads at atmosphere [Pa]."""
    if isinstance(given, tuple):
        start, stop = given
        vented = record.pressure[(record.time >= start) & (record.time <= stop)]
        if vented.size < LEAST_READINGS:
            raise InputError(
                f"{record.source} has {vented.size} readings from {start} to {stop} s, and at least "
                f"{LEAST_READINGS} are needed for the reading at atmosphere: widen the interval, or "
                "give the reading in Pa"
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
    low = float(np.sort(record.pressure)[:LEAST_READINGS].max())  # one alone may be a glitch
    if low < given - _VACUUM * np.ptp(record.pressure):
        raise InputError(
            f"{record.source} reads down to {low / 1e3:.4g} kPa, far below the {given / 1e3:.4g} kPa "
            "that its sensor is said to read at atmosphere: give its reading with the muscle "
            "vented: 0kPa for a gauge that was zeroed"
        )
    return float(given)


def _find_clamp(records: Sequence[RampRecord]) -> float | None:
    """The least reading of all records where it must be a clamp, else None."""
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
            f"{record.source} shows no regular valve pulses{known}: give the period, or read it "
            "as a continuous ramp"
        )
    return found

"""Quasi-static points of raw isometric records: one for each hold, or for each pressure bin."""

import dataclasses
from collections.abc import Sequence
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError

from .holds import Staircase, find_staircase
from .points import LEAST_READINGS, RampPoint, bin_points, hold_points
from .record import RampRecord

Kind = Literal["staircase", "ramp"]
"""Pulses of a valve with holds between them, or a pressure that moves all the time."""

_CLAMP_READINGS = 20  # at the exact minimum: noise without a clamp thins out long before it
_CLAMP_SPAN = 0.02  # of the pressure range: a muscle's force would rise over it
_CLAMPED = 0.1  # part of a point's readings at the clamp from which the point counts as clamped
_SLACK_NOISE = 6.0  # standard deviations of the noise above zero under which a point is slack
_FLAT = 0.02  # of the pressure range: the most by which a vented interval's readings may spread
_VACUUM = 0.05  # of the pressure range: the most by which a record may lie below atmosphere


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
    time: Float[np.ndarray, " n"]
    length: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    force: Float[np.ndarray, " n"]
    filling: Bool[np.ndarray, " n"]
    noise: Float[np.ndarray, " n"]
    stderr: Float[np.ndarray, " n"]
    pressure_noise: Float[np.ndarray, " n"]
    force_drift: Float[np.ndarray, " n"]
    pressure_drift: Float[np.ndarray, " n"]
    clamped: Bool[np.ndarray, " n"]
    slack: Bool[np.ndarray, " n"]
    settled: Bool[np.ndarray, " n"]
    mislabelled: Bool[np.ndarray, " n"]
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
    zeros = tuple(_atmosphere(record, atmosphere) for record in records)
    for record, zero in zip(records, zeros, strict=True):
        _check_atmosphere(record, zero)
    found = _find_clamp(records) if clamp is None else clamp
    stairs = [_staircase(record, kind, period) for record in records]
    points = [
        bin_points(record, zero, bin_width, found)
        if stair is None
        else hold_points(record, zero, stair, part, found)
        for record, zero, stair in zip(records, zeros, stairs, strict=True)
    ]
    column = {
        field.name: np.array([getattr(point, field.name) for made in points for point in made])
        for field in dataclasses.fields(RampPoint)
    }
    number = np.repeat(np.arange(len(records)), [len(made) for made in points])
    if slack_below is None:
        floor = 0.0 if found is None else max(0.0, found)
        slack_below = floor + _SLACK_NOISE * float(np.median(column["noise"]))
    clamped = column.pop("at_clamp") > _CLAMPED
    return QuasiStatic(
        record=number,
        length=np.array([record.length for record in records])[number],
        clamped=clamped,
        slack=clamped | (column["force"] < slack_below),
        settled=~(np.abs(column["pressure_drift"]) > max_drift),
        records=records,
        atmosphere=zeros,
        kinds=tuple("ramp" if stair is None else "staircase" for stair in stairs),
        periods=tuple(np.nan if stair is None else stair.period for stair in stairs),
        n_short=tuple(
            0 if stair is None else stair.start.size - len(made)
            for stair, made in zip(stairs, points, strict=True)
        ),
        clamp=found,
        slack_below=slack_below,
        **column,
    )


def _atmosphere(record: RampRecord, given: float | tuple[float, float]) -> float:
    if not isinstance(given, tuple):
        if not np.isfinite(given):
            raise InputError(f"the reading at atmosphere must be finite, got {given} Pa")
        return float(given)
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
            f"the pressure of {record.source} moves from {vented.min():.6g} to {vented.max():.6g} "
            f"Pa between {start} and {stop} s, so it is not vented there: choose another interval, "
            "or give the reading at atmosphere in Pa"
        )
    return float(np.mean(vented))


def _check_atmosphere(record: RampRecord, zero: float) -> None:
    """Raise where a record has readings far below what its sensor reads at atmosphere."""
    low = float(np.sort(record.pressure)[:LEAST_READINGS].max())  # one alone may be a glitch
    if low < zero - _VACUUM * np.ptp(record.pressure):
        raise InputError(
            f"{record.source} reads down to {low / 1e3:.4g} kPa, far below the {zero / 1e3:.4g} kPa that "
            "its sensor is said to read at atmosphere: give what it reads where the muscle is vented, "
            "which is 0kPa of a gauge that was zeroed"
        )


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

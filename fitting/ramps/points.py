"""The force of a raw record at each of its holds, or in each pressure bin of its branches."""

import dataclasses
from collections.abc import Sequence

import numpy as np
from jaxtyping import Float, Int

from famjax.boundary.errors import InputError

from ..rubber.cycles import noise_of, split_branches
from .holds import Staircase
from .record import FILL, VENT, RampRecord

LEAST_READINGS = 5
"""Of a hold's part, and on either side of a bin's middle."""

_MEDIAN = np.sqrt(np.pi / 2)  # standard error of a median over that of a mean, normal noise


@dataclasses.dataclass(frozen=True)
class RampPoint:
    """One hold or pressure bin: the attributes of `QuasiStatic` before any judgement.

    Attributes:
        at_clamp: part of the readings that stand at the clamp.
    """

    time: float
    pressure: float
    force: float
    filling: bool
    noise: float
    stderr: float
    pressure_noise: float
    force_drift: float
    pressure_drift: float
    at_clamp: float
    mislabelled: bool


def hold_points(
    record: RampRecord,
    zero: float,
    stair: Staircase,
    part: tuple[float, float],
    clamp: float | None,
) -> list[RampPoint]:
    """A point for every hold that has readings enough.

    Raises:
        InputError: no hold has.
    """
    holds = [rows for rows in stair.rows(record.time, part) if rows.size >= LEAST_READINGS]
    if not holds:
        raise InputError(
            f"{record.source} has fewer than {LEAST_READINGS} readings in the part {part} of its "
            f"holds of {stair.period:.4g} s: widen the part, or record faster"
        )
    pressure = _medians(record.pressure, holds)
    middles = zip(holds, pressure - zero, _medians(record.force, holds), strict=True)
    step = _resolution(record.force)
    return [
        _hold_point(record, rows, P, F, step, filling, clamp)
        for (rows, P, F), filling in zip(middles, _directions(pressure), strict=True)
    ]


def _resolution(values: Float[np.ndarray, " n"]) -> float:
    """The sensor's step: the least difference between two readings."""
    steps = np.diff(np.unique(values))
    return float(steps.min()) if steps.size else 0.0


def _medians(
    values: Float[np.ndarray, " n"], holds: Sequence[Int[np.ndarray, " _"]]
) -> Float[np.ndarray, " holds"]:
    """The median of each hold; readings at the middle are spread over the sensor's step."""
    step = _resolution(values)
    medians = []
    for rows in holds:
        held = np.sort(values[rows])
        middle = held[held.size // 2]
        below, above = np.searchsorted(held, middle), np.searchsorted(held, middle, "right")
        medians.append(middle + step * ((held.size / 2 - below) / (above - below) - 0.5))
    return np.array(medians)


def _hold_point(
    record: RampRecord,
    rows: Int[np.ndarray, " rows"],
    pressure: float,
    force: float,
    step: float,
    filling: bool,
    clamp: float | None,
) -> RampPoint:
    F, P, t = (column[rows] for column in (record.force, record.pressure, record.time))
    noise = float(np.std(F, ddof=1))
    # Noise that does not reach the next step leaves the rounding of a reading in the median.
    rounding = step / np.sqrt(12) if noise < step / 2 else 0.0
    return RampPoint(
        time=float(np.mean(t)),
        pressure=pressure,
        force=force,
        filling=filling,
        noise=noise,
        stderr=float(np.hypot(noise * _MEDIAN / np.sqrt(rows.size), rounding)),
        pressure_noise=float(np.std(P, ddof=1)),
        force_drift=_drift(t, F),
        pressure_drift=_drift(t, P),
        at_clamp=0.0 if clamp is None else float(np.mean(clamp >= F)),
        mislabelled=_mislabelled(record, rows, filling=filling),
    )


def _drift(t: Float[np.ndarray, " n"], values: Float[np.ndarray, " n"]) -> float:
    """Change of the values over the time, by a straight line."""
    late = t - t.mean()
    return float(late @ values / (late @ late) * np.ptp(t)) if np.ptp(t) > 0 else 0.0


def _directions(pressure: Float[np.ndarray, " n"]) -> list[bool]:
    """Whether each of the held pressures was reached by filling."""
    branches = split_branches(pressure) if pressure.size >= 3 else ()
    if not branches:
        return [bool(pressure[-1] >= pressure[0])] * pressure.size
    filling = [branches[0].rising] * pressure.size
    for branch in branches:
        # Its first row is the last of the hold before.
        filling[branch.start + 1 :] = [branch.rising] * (pressure.size - branch.start - 1)
    return filling


def _mislabelled(record: RampRecord, rows: Int[np.ndarray, " rows"], *, filling: bool) -> bool:
    if record.valve_state is None:
        return False
    state = record.valve_state[rows]
    return bool(np.mean(state == (VENT if filling else FILL)) > 0.5)


def bin_points(
    record: RampRecord, zero: float, width: float, clamp: float | None
) -> list[RampPoint]:
    """A point for every pressure bin of every branch, in the order of time.

    Raises:
        InputError: no bin has readings enough.
    """
    P = record.pressure - zero
    points = []
    for branch in split_branches(P):
        rows = np.arange(branch.start, branch.stop)
        inside = P[rows]
        middles = width * np.arange(np.ceil(inside.min() / width), inside.max() / width)
        made = []
        for middle in middles:
            near = rows[np.abs(inside - middle) <= width / 2]
            below = int(np.sum(P[near] < middle))
            if min(below, near.size - below) >= LEAST_READINGS:
                made.append(_bin_point(record, P, near, float(middle), branch.rising, clamp))
        points += made if branch.rising else made[::-1]
    if not points:
        raise InputError(
            f"{record.source} gives no pressure bin of {width:.6g} Pa: its pressure must rise or "
            f"fall over several bins, with {2 * LEAST_READINGS} readings in each"
        )
    return points


def _bin_point(
    record: RampRecord,
    pressure: Float[np.ndarray, " n"],
    rows: Int[np.ndarray, " rows"],
    middle: float,
    filling: bool,
    clamp: float | None,
) -> RampPoint:
    F, x = record.force[rows], pressure[rows] - middle
    design = np.stack([np.ones_like(x), x / np.abs(x).max()], axis=1)
    inverse = np.linalg.pinv(design)
    value = inverse @ F
    residual = F - design @ value
    noise = float(np.sqrt(residual @ residual / (x.size - 2)))
    return RampPoint(
        time=np.nan,
        pressure=middle,
        force=float(value[0]),
        filling=filling,
        noise=noise,
        stderr=noise * float(np.linalg.norm(inverse[0])),
        pressure_noise=noise_of(pressure),
        force_drift=np.nan,
        pressure_drift=np.nan,
        at_clamp=0.0 if clamp is None else float(np.mean(clamp >= F)),
        mislabelled=_mislabelled(record, rows, filling=filling),
    )

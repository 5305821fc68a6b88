"""Evaluate tests at constant pressure: strokes, curves, key figures and a force map."""

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.polynomial import Polynomial

from famjax.boundary.errors import InputError

from .clock import Alignment
from .record import MachineLog, check_positive, set_columns, split_branches

GRID = 100
"""Number of lengths at which the branches are compared."""
TURN = 0.03
"""Fraction of a stroke next to each turn that is omitted from a force map. Friction reverses there, so the
mean of both branches differs from the static force."""

_BRIDGE = 5  # longest gap of the journal, in usual intervals, that is bridged
_MISSING = 5  # spacing of rows, in usual intervals, from which rows are missing
_STROKE = 0.3  # smallest stroke, relative to the range of lengths at a pressure
_END = 0.003  # width of the ends, relative to that range
_SHORT = 0.02  # how far a stroke may end before its starting point, relative to that range
_AT_REST = 1e-3  # tolerance of the rest length, relative
_STILL = 2e-5  # motion of a muscle at rest, relative to the rest length
_SHORTEST_HOLD = 0.5  # s
_LONGEST_HOLD = 2.0  # s, over which the force is averaged
_BEND = 5  # degree of the polynomial that is removed before local lines are fitted
_POINTS = 30  # number of lengths in a force map
_ALIKE = 1e-3  # smaller pressure differences between branches are noise, relative
_FIGURES = {
    "set_pressure": "Pa", "pressure": "Pa", "pressure_std": "Pa", "largest_pressure_error": "Pa",
    "cycles": "", "blocked_force": "N", "blocked_force_std": "N", "free_contraction": "",
    "free_contraction_std": "", "hysteresis": "J",
}  # fmt: skip


@dataclasses.dataclass(frozen=True)
class IsobaricRecord:
    """Record of a test in SI, with one row for each row of the machine log that has a pressure.

    Attributes:
        time: time on the journal's clock [s], increasing, shape (n,).
        length: active length L [m], shape (n,).
        force: F [N], positive when the muscle pulls, shape (n,).
        pressure: measured gauge pressure [Pa], shape (n,).
        set_pressure: set point at each time, gauge [Pa], shape (n,); nan if there is none.
        rest_length: rest length L0 [m].
        notes: remarks on omitted data.
    """

    time: np.ndarray
    length: np.ndarray
    force: np.ndarray
    pressure: np.ndarray
    set_pressure: np.ndarray
    rest_length: float
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        set_columns(self, "time", "length", "force", "pressure")
        check_positive(rest_length=self.rest_length)
        if np.any(self.length <= 0):
            raise InputError(
                f"active lengths must be positive, got {self.length.min():.5g} to "
                f"{self.length.max():.5g} m with a rest length of {self.rest_length:.5g} m: check "
                "the unit and sign of the displacement, and rest_length"
            )


def combine(
    log: MachineLog,
    alignment: Alignment,
    journal_time: np.ndarray,
    journal_pressure: np.ndarray,
    set_points: Sequence[tuple[float, float]],
    *,
    rest_length: float,
    shortening_positive: bool = False,
    zero_displacement: float = 0.0,
    pushing_positive: bool = False,
) -> IsobaricRecord:
    """Combine the machine log and the journal of a test into one record.

    L = L0 + (displacement - zero). Each row is assigned the nearest pressure reading in the journal rather
    than a mean, to preserve the measured scatter. Rows in gaps in the journal, or before the first set
    point, are left out.

    Args:
        log: log of the machine.
        alignment: alignment of the machine's clock with the journal's.
        journal_time: times [s], increasing, shape (n,).
        journal_pressure: gauge pressures [Pa], shape (n,).
        set_points: pairs of a journal time [s] and the set pressure [Pa] that applies from then on, in
            order; a set pressure of nan ends the previous one.
        rest_length: rest length L0 [m].
        shortening_positive: True if the machine's displacement grows as the muscle shortens.
        zero_displacement: displacement reading at L0 [m].
        pushing_positive: True if the machine's force is positive in compression.

    Returns:
        The record.

    Raises:
        InputError: journal and log do not overlap, or there is no set point.
    """
    if not set_points:
        raise InputError("the journal must have at least one set point, got none")
    time = alignment.journal_time(log.time)
    place = np.interp(time, journal_time, np.arange(len(journal_time)))
    nearest = np.floor(place + 0.5).astype(int)
    apart = np.abs(journal_time[nearest] - time)
    heard = apart <= _BRIDGE * float(np.median(np.diff(journal_time)))
    starts, pressures = np.array(set_points, float).T
    order = np.searchsorted(starts, time, side="right") - 1
    use = heard & (order >= 0)
    if use.sum() < 2:
        raise InputError(
            "no row of the machine log has a matching pressure in the journal: check that log and journal "
            "are from the same test"
        )
    notes = []
    if not heard.all():
        notes.append(
            f"{(~heard).sum()} rows of the machine log have no matching pressure in the journal and were "
            "left out."
        )
    if log.missing_rows:
        notes.append(f"{log.missing_rows} rows are missing from the machine log.")
    towards = -1.0 if shortening_positive else 1.0
    return IsobaricRecord(
        time=time[use],
        length=rest_length + towards * (log.displacement[use] - zero_displacement),
        force=(-1.0 if pushing_positive else 1.0) * log.channel("force")[use],
        pressure=journal_pressure[nearest[use]],
        set_pressure=pressures[order[use]],
        rest_length=rest_length,
        notes=tuple(notes),
    )


Stroke = tuple[slice, slice]
"""Rows of the concentric and the eccentric branch of one stroke."""


def strokes(record: IsobaricRecord) -> tuple[dict[float, list[Stroke]], list[str]]:
    """Return all complete strokes by set pressure [Pa], and a note on each incomplete motion.

    A stroke goes from the longest to the shortest length and back. It covers at least 30 % of the range
    of lengths at its set pressure.
    """
    found: dict[float, list[Stroke]] = {}
    notes: list[str] = []
    edges = np.flatnonzero(np.diff(record.set_pressure) != 0) + 1
    for low, high in itertools.pairwise([0, *edges.tolist(), record.time.size]):
        pressure = float(record.set_pressure[low])
        if high - low < 3 or not math.isfinite(pressure):
            continue
        length = record.length[low:high]
        span = float(np.ptp(length))
        branches = list(split_branches(length, min_travel=_STROKE, hold=_END * span))
        complete = []
        while branches:
            there = branches.pop(0)
            back = branches[0] if branches and not there.rising else None
            if back and length[back.stop - 1] > length[there.start] - _SHORT * span:
                pair = (there, branches.pop(0))
                complete.append(tuple(slice(low + b.start, low + b.stop) for b in pair))
            else:
                notes.append(
                    f"At {pressure:.6g} Pa, a motion from {length[there.start]:.5g} m to "
                    f"{length[there.stop - 1]:.5g} m is not a complete stroke and was left out."
                )
        found[pressure] = found.get(pressure, []) + complete
        if not complete and span > 0.01 * record.rest_length:
            notes.append(f"At {pressure:.6g} Pa there is no complete stroke.")
    return found, notes


@dataclasses.dataclass(frozen=True)
class Isobar:
    """Measurements at one set pressure in SI; nan for missing values.

    Attributes:
        set_pressure: set pressure, gauge [Pa].
        pressure: mean of the measured pressure during the strokes [Pa].
        pressure_std: standard deviation of the measured pressure [Pa] (Chambers 2021, tables 3.3 and 3.4).
        largest_pressure_error: largest deviation of the measured pressure from the set pressure [Pa].
        cycles: number of averaged strokes.
        length: active lengths [m], decreasing from near the longest, shape (n,).
        shortening: F [N] on the concentric branch, shape (n,).
        lengthening: F [N] on the eccentric branch, shape (n,).
        shortening_pressure, lengthening_pressure: measured pressures on the branches [Pa], shape (n,). They
            are not constant, since the pressure dips at one turn and rises at the other.
        bin_pressure_std: scatter of the pressure readings within a step of the grid [Pa], shape (n,).
        blocked_force: mean F [N] while the muscle was held at the rest length before its first stroke, for
            at least half a second. It includes friction from the preceding motion.
        blocked_force_std: scatter of F [N] during that hold.
        free_contraction: (L0 - L)/L0 at which the force of the shortening muscle vanishes, averaged over
            the strokes; nan if the machine reversed before that.
        free_contraction_std: scatter of the free contraction between strokes; nan for a single stroke.
        hysteresis: work lost in a stroke [J], the area between the branches.
    """

    set_pressure: float
    pressure: float
    pressure_std: float
    largest_pressure_error: float
    cycles: int
    length: np.ndarray
    shortening: np.ndarray
    lengthening: np.ndarray
    shortening_pressure: np.ndarray
    lengthening_pressure: np.ndarray
    bin_pressure_std: np.ndarray
    blocked_force: float
    blocked_force_std: float
    free_contraction: float
    free_contraction_std: float
    hysteresis: float

    @property
    def force(self) -> np.ndarray:
        """Mean of both branches, F [N], shape (n,)."""
        return (self.shortening + self.lengthening) / 2


@dataclasses.dataclass(frozen=True)
class Characterisation:
    """Characteristics of a muscle at several constant pressures.

    Attributes:
        isobars: isobars in order of set pressure.
        rest_length: rest length L0 [m].
        notes: remarks on omitted data.
    """

    isobars: tuple[Isobar, ...]
    rest_length: float
    notes: tuple[str, ...] = ()

    def rows(self) -> list[dict[str, float]]:
        """Return the key figures of every isobar, with the unit in each key."""
        return [
            {f"{name}_{unit}".rstrip("_"): getattr(bar, name) for name, unit in _FIGURES.items()}
            for bar in self.isobars
        ]


def characterise(record: IsobaricRecord, *, skip_cycles: int = 0) -> Characterisation:
    """Compute curves and key figures at every set pressure; rate effects are neglected.

    Branches are evaluated at 100 lengths that every stroke at that pressure covers, by fitting local
    straight lines over two grid steps. Strokes are then averaged.

    Args:
        record: record of the test.
        skip_cycles: number of strokes to leave out at the start of each pressure.

    Returns:
        The characterisation, in order of set pressure.

    Raises:
        InputError: there is no complete stroke.

    References:
        Chambers 2021, sections 3.3 and 4.3, tables 3.3 and 3.4.
    """
    if skip_cycles < 0:
        raise InputError(f"skip_cycles must be >= 0, got {skip_cycles}")
    found, notes = strokes(record)
    isobars = []
    for pressure in sorted(found):
        whole = []
        for number, stroke in list(enumerate(found[pressure], 1))[skip_cycles:]:
            lacks = max(_hole(record, rows) for rows in stroke)
            if lacks:
                notes.append(
                    f"At {pressure:.6g} Pa, stroke {number} was left out because {lacks:.3g} s of data are "
                    "missing from the journal or the log."
                )
            else:
                whole.append(stroke)
        try:
            isobars += [_isobar(record, pressure, whole)] if whole else []
        except InputError as error:
            # A muscle that becomes slack early has short strokes with few rows.
            notes.append(f"The strokes at {pressure:.6g} Pa were left out: {error}")
    if not isobars:
        raise InputError(
            f"there is no complete stroke in {record.time.size} rows over {np.ptp(record.time):.5g} s, at "
            f"lengths {record.length.min():.5g} to {record.length.max():.5g} m, after skipping "
            f"{skip_cycles} cycles: check that journal and log are complete and from the same test (famjax "
            "rig check). " + " ".join(notes)
        )
    return Characterisation(tuple(isobars), record.rest_length, (*record.notes, *notes))


def _hole(record: IsobaricRecord, rows: slice) -> float:
    """Return the longest gap [s] in which the length changes by more than a grid step, or 0."""
    apart, moved = np.diff(record.time[rows]), np.abs(np.diff(record.length[rows]))
    step = float(np.ptp(record.length[rows])) / (GRID - 1)
    missing = (apart > _MISSING * np.median(apart)) & (moved > step)
    return float(apart[missing].max(initial=0.0))


def _isobar(record: IsobaricRecord, set_pressure: float, found: list[Stroke]) -> Isobar:
    sides = list(zip(*found, strict=True))
    every = [record.length[rows] for side in sides for rows in side]
    shortest, longest = max(x.min() for x in every), min(x.max() for x in every)
    at = np.linspace(longest, shortest, GRID)
    force, pressure = (
        np.array([[_curve(record, of, rows, at) for rows in side] for side in sides])
        for of in ("force", "pressure")
    )
    variance = []
    for rows, curve in zip(sides[0] + sides[1], pressure.reshape(-1, GRID), strict=True):
        x, left = record.length[rows], record.pressure[rows]
        left = left - np.interp(x, at[::-1], curve[::-1])
        variance.append(_local_mean(x, left**2, at, float(at[0] - at[1])))
    held = _held_force(record, set_pressure, sides[0][0].start)
    inside = np.concatenate([record.pressure[a.start : b.stop] for a, b in found])
    free = np.array([_free_contraction(record, rows) for rows in sides[0]])
    down, up = force.mean(axis=1)
    return Isobar(
        set_pressure=set_pressure,
        pressure=float(inside.mean()),
        pressure_std=float(inside.std()),
        largest_pressure_error=float(np.abs(inside - set_pressure).max()),
        cycles=len(found),
        length=at,
        shortening=down,
        lengthening=up,
        shortening_pressure=pressure[0].mean(axis=0),
        lengthening_pressure=pressure[1].mean(axis=0),
        bin_pressure_std=np.sqrt(np.mean(variance, axis=0)),
        blocked_force=float(held.mean()) if held.size else math.nan,
        blocked_force_std=float(held.std()) if held.size else math.nan,
        free_contraction=float(free.mean()),
        free_contraction_std=float(free.std(ddof=1)) if free.size > 1 else math.nan,
        hysteresis=float(np.trapezoid(up - down, -at)),
    )


def _curve(record: IsobaricRecord, of: str, rows: slice, at: np.ndarray) -> np.ndarray:
    """Evaluate a column at evenly spaced lengths by fitting local straight lines over two steps."""
    width = float(at[0] - at[1])
    values, count = _local_lines(record.length[rows], getattr(record, of)[rows], at, width)
    thin = count < 3
    if thin.any():
        raise InputError(
            f"the machine log must have at least 3 rows within {1e3 * width:.3g} mm of the length "
            f"{1e3 * at[thin][0]:.5g} mm, got {int(count[thin][0])}. Either the muscle became slack soon "
            "after the start of the stroke, and a higher pressure helps; or the logging rate is too low"
        )
    return values


def _local_lines(
    x: np.ndarray, y: np.ndarray, at: np.ndarray, width: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return values from straight lines through the points within `width`, and the number of points.

    A global polynomial is subtracted first, since a line is biased where the curve bends and near the
    ends. If all points within `width` coincide, their mean is used.
    """
    order = np.argsort(x, kind="stable")
    x, y = x[order], y[order]
    bend = Polynomial.fit(x, y, min(_BEND, x.size // 3))
    y = y - bend(x)
    origin = x.mean()
    x, away = x - origin, at - origin
    n, sx, sxx, sy, sxy = _window_sums(
        np.stack([np.ones_like(x), x, x * x, y, x * y]), x, away, width
    )
    spread = n * sxx - sx * sx
    straight = (n > 1) & (spread > 0)
    slope = np.divide(n * sxy - sx * sy, spread, where=straight, out=np.zeros_like(at))
    n_safe = np.maximum(n, 1)
    return sy / n_safe + slope * (away - sx / n_safe) + bend(at), n


def _local_mean(x: np.ndarray, y: np.ndarray, at: np.ndarray, width: float) -> np.ndarray:
    """Return the mean of the values within `width` of each position."""
    order = np.argsort(x, kind="stable")
    total, n = _window_sums(np.stack([y[order], np.ones_like(x)]), x[order], at, width)
    return total / n


def _window_sums(columns: np.ndarray, x: np.ndarray, at: np.ndarray, width: float) -> np.ndarray:
    """Return sums of columns over the rows whose x (increasing) is within `width` of each position."""
    sums = np.concatenate([np.zeros((len(columns), 1)), np.cumsum(columns, axis=1)], axis=1)
    low, high = (np.searchsorted(x, at + side * 1.0001 * width) for side in (-1, 1))
    return sums[:, high] - sums[:, low]


def _free_contraction(record: IsobaricRecord, rows: slice) -> float:
    """Return the contraction at zero force on a shortening branch, or at most one step beyond its end."""
    at, step = np.linspace(record.length[rows].max(), record.length[rows].min(), GRID, retstep=True)
    curve = _curve(record, "force", rows, at)
    fallen = np.flatnonzero(curve <= 0)
    k = int(fallen[0]) if fallen.size else GRID - 1
    if k == 0:
        return math.nan
    length = at[k] - curve[k] * (at[k] - at[k - 1]) / (curve[k] - curve[k - 1])
    if length < at[-1] - abs(float(step)):
        return math.nan
    return float((record.rest_length - length) / record.rest_length)


def _held_force(record: IsobaricRecord, set_pressure: float, start: int) -> np.ndarray:
    """Return the forces in the second half of the hold before a stroke, but at most two seconds of it."""
    stop = start + 1
    length = record.length[:stop]
    near = np.abs(length - record.rest_length) <= _AT_REST * record.rest_length
    same = near & (record.set_pressure[:stop] == set_pressure)
    while stop > 0 and not same[stop - 1] and length[stop - 1] >= length[-1]:
        stop -= 1  # the stroke has already left the rest length
    others = np.flatnonzero(~same[:stop])
    start = int(others[-1]) + 1 if others.size else 0
    if stop - start < 3:
        return np.empty(0)
    away = np.abs(length[start:stop] - np.median(length[start:stop]))
    still = np.flatnonzero(away <= max(3 * float(np.median(away)), _STILL * record.rest_length))
    rows = slice(start, start + int(still[-1]) + 1)
    time = record.time[rows]
    if time[-1] - time[0] < _SHORTEST_HOLD:
        return np.empty(0)
    return record.force[rows][time >= max(time[-1] - _LONGEST_HOLD, (time[0] + time[-1]) / 2)]


def write_dataset(
    found: Characterisation, path: str | Path, *, specimen: Mapping[str, object] | None = None
) -> Path:
    """Write pressure, length and force in SI as a force map, with the specimen as comments.

    The map contains the mean force of both branches at 30 lengths common to all isobars, with the pressure
    measured there and its scatter. The fraction `TURN` at either end of the stroke is left out. Forces
    <= 0 are kept, since they show where the muscle is slack.

    Args:
        found: the characterisation.
        path: the file to write, which `fitting.read_csv` can read; an existing file is replaced.
        specimen: further specimen entries with units in the keys, such as {"wall_thickness_mm": 1.6}.

    Returns:
        The path.

    Raises:
        InputError: a specimen entry is invalid, or the file cannot be written.
    """
    turn = TURN * max(float(np.ptp(bar.length)) for bar in found.isobars)
    bars = [_between_turns(bar, turn) for bar in found.isobars]
    longest, shortest = max(bar.length[0] for bar in bars), min(bar.length[-1] for bar in bars)
    common = np.linspace(longest, shortest, _POINTS)
    friction = _friction(bars)
    readings = [_readings(bar, common, friction) for bar in bars]
    lines = [f"# note: {note}" for note in found.notes]
    lines.append(f"# specimen: rest_length_m = {found.rest_length!r}")
    for key, value in (specimen or {}).items():
        text = str(value).lower() if isinstance(value, bool) else str(value)
        if key.startswith("rest_length") or "\n" in f"{key}{text}":
            raise InputError(
                f"the specimen entry {key} = {text!r} must fit on one line and must not repeat the rest "
                "length, which is already known from the record"
            )
        lines.append(f"# specimen: {key} = {text}")
    tolerance = _tolerance([rows[:, 0] for rows in readings])
    if tolerance is not None:
        lines.append(f"# level: pressure_tolerance_Pa = {tolerance!r}")
    lines.append("pressure_Pa,length_m,force_N,pressure_std_Pa")
    lines += [",".join(map(repr, row)) for rows in readings for row in rows.tolist()]
    path = Path(path)
    try:
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from None
    return path


def _between_turns(bar: Isobar, turn: float) -> Isobar:
    """Remove the lengths within `turn` [m] of a turning point from an isobar."""
    margin = min(turn, float(np.ptp(bar.length)) / 4)
    use = (bar.length <= bar.length[0] - margin) & (bar.length >= bar.length[-1] + margin)
    curves: dict[str, Any] = {
        name: value[use] for name, value in vars(bar).items() if isinstance(value, np.ndarray)
    }
    return dataclasses.replace(bar, **curves)


def _readings(bar: Isobar, common: np.ndarray, friction: float) -> np.ndarray:
    """Return pressure, length, force and pressure scatter at the common lengths, shape (n, 4).

    Each value comes from a line through the isobar's points within half a step of the common length, so
    short strokes are as precise as long ones. With a friction share f of the force, F = D (P - P_d) gives
    ((1 - f) F(P_s) + (1 + f) F(P_l))/2 = F(((1 - f) P_s + (1 + f) P_l)/2),
    which defines the pressure that corresponds to the mean of both branches.
    """
    low, high = bar.shortening_pressure, bar.lengthening_pressure
    pressure = ((1 - friction) * low + (1 + friction) * high) / 2
    own = bar.length
    reach = max(float(common[0] - common[1]) / 2, 1.01 * float(own[0] - own[1]))
    at = common[(common <= own[0] + 1e-9) & (common >= own[-1] - 1e-9)]
    at = at if at.size > 1 else own[[0, -1]]
    columns = [_local_lines(own, curve, at, reach)[0] for curve in (pressure, bar.force)]
    scatter = np.sqrt(_local_mean(own, bar.bin_pressure_std**2, at, reach))
    return np.stack([columns[0], at, columns[1], scatter], axis=1)


def _friction(bars: Sequence[Isobar]) -> float:
    """Return the friction share f of the force, averaged over all isobars.

    The branches of an isobar differ by 2 f F and by the effect of their pressure difference. The smaller
    the relative pressure difference, the better an isobar determines f. Each isobar is therefore weighted
    by the inverse square of this difference.
    """
    shares, weights = [], []
    for bar in bars:
        apart = np.abs(bar.lengthening_pressure - bar.shortening_pressure)
        alike = (apart <= np.median(apart)) & (bar.shortening > 0) & (bar.lengthening > 0)
        if alike.any():
            share = (bar.lengthening - bar.shortening)[alike] / (2 * bar.force[alike])
            noise = max(float(np.median(apart[alike])), _ALIKE * bar.pressure)
            shares.append(float(np.median(share)))
            weights.append((bar.pressure / noise) ** 2)
    return float(np.average(shares, weights=weights)) if shares else 0.0


def _tolerance(pressures: list[np.ndarray]) -> float | None:
    """Return the tolerance [Pa] that separates the pressures of the isobars, or None."""
    inside = sorted((np.sort(values) for values in pressures), key=lambda values: values[0])
    within = max(float(np.diff(values).max()) for values in inside)
    wide = max(float(np.ptp(values)) for values in inside)
    between = min((float(b[0] - a[-1]) for a, b in itertools.pairwise(inside)), default=2 * wide)
    return math.sqrt(within * between) if 0 < within < between > wide else None

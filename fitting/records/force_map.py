"""Static force maps from raw ramps: mean of fill and vent branches, hysteresis, output files."""

import contextlib
import csv
import dataclasses
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int

from famjax.boundary.errors import InputError
from famjax.boundary.files import as_png
from famjax.boundary.units import (
    UNITS,
    factor,
    finite_or_none,
    from_si,
    parse_quantity,
    sentence_in_units,
    unit_system,
)
from famjax.tables import text_lines

from ..data import ForceData, csv_text
from ..specimen import Specimen, describe
from .hysteresis import BranchPairs
from .ramp import FILL, LEAST_READINGS, VENT, Mask, QuasiStatic, RampRecord, quasi_static, read_ramp
from .record import Column

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Branches = Literal["both", "fill", "vent"]
"""Branch of a force map, or the mean of both."""

_SHOWN = {"both": "mean of fill and vent branches", "fill": "fill branch", "vent": "vent branch"}
_MERGE = 0.01  # points closer than this fraction of the pressure range are averaged
_LEAST_RANGE = 0.2  # smallest pressure range of a ramp, relative to its highest pressure
_LEAST_STD = 1e-9  # a smaller standard deviation, relative to the largest force, is rounding
_PAIRS = ("record", "rest_length_m", "length_m", "pressure_Pa", "half_difference_N",
          "turn_pressure_Pa")  # fmt: skip

Levels = Float[np.ndarray, " levels"]
Pulls = Bool[np.ndarray, " levels"]
Grid = Float[np.ndarray, "records levels"]
GridMask = Bool[np.ndarray, "records levels"]
Curves = tuple[Float[np.ndarray, "2 records levels"], Bool[np.ndarray, "2 records levels"]]
"""Fill and vent forces at common pressures (nan if not measured), and a mask of pulling states."""


@dataclasses.dataclass(frozen=True)
class StaticMap:
    """Static force at common pressures for every length, one row per length and pressure.

    Attributes:
        length: L [m], shape (rows,).
        pressure: gauge pressure P [Pa], shape (rows,).
        force: mean force F [N] over records, shape (rows,).
        half_width: mean hysteresis (vent - fill)/2 [N] over records, shape (rows,); nan if no record
            has both branches.
        n_records: number of records in the mean, shape (rows,).
        slack: True if no record pulls, shape (rows,); the force is then not a static muscle force.
        force_std: standard error of the force [N], shape (rows,). It combines the error of the points with
            the repeatability at the length (pooled over lengths if there are no repeats), both divided
            by the square root of the number of records.
        branches: branch that the force belongs to.
        lengths: summary of each length in SI, longest first. `length`; the number of records
            (`n_records`), of records without the branches shown (`n_unused`), of points on each
            branch (`n_fill`, `n_vent`), of marked points (`n_clamped` etc.), of repeated time stamps and
            of valve glitches; RMS of the reading `noise` and of the points' `stderr`; mean, RMS and
            largest magnitude of the hysteresis (`half_width_mean` etc.); and the `repeatability`, the
            standard deviation between records pooled over pressures, for the map and for each branch.
            Forces refer to pulling states; nan if there are none.
        points: quasi-static points of the map.
    """

    length: Column
    pressure: Column
    force: Column
    half_width: Column
    n_records: Int[np.ndarray, " rows"]
    slack: Mask
    force_std: Column
    branches: Branches
    lengths: tuple[dict[str, Any], ...]
    points: QuasiStatic

    def force_data(self, specimen: Specimen, *, length_std: float | None = None) -> ForceData:
        """Return the map without its slack rows as data for an identification.

        Args:
            specimen: the muscle.
            length_std: standard deviation of the lengths [m], if known.

        Raises:
            InputError: no row pulls, or `ForceData` refuses the map.
        """
        kept = ~self.slack
        if not kept.any():
            raise InputError(
                f"all {self.slack.size} rows of the map are slack (below "
                f"{self.points.slack_below:.4g} N): check the force column, or lower slack_below"
            )
        std = self.force_std[kept]
        noisy = bool((std > _LEAST_STD * self.force.max()).all())
        zeros = self.points.atmosphere
        notes = [
            f"Forces are quasi-static ({_SHOWN[self.branches]} of {len(self.points.records)} records). "
            f"The pressure reading at atmosphere, {min(zeros) / 1e3:.4g} to "
            f"{max(zeros) / 1e3:.4g} kPa, is subtracted.",
            f"{int((~kept).sum())} of {self.slack.size} rows are slack (below "
            f"{self.points.slack_below:.4g} N) and left out.",
        ]
        if unused := sum(one["n_unused"] for one in self.lengths):
            notes.append(f"{unused} records lack the selected branches and are not used.")
        if not noisy:
            notes.append("The readings show no noise: forces have no standard deviation.")
        elif any(math.isnan(one["repeatability"]) for one in self.lengths):
            notes.append(
                "Some lengths have no repeated pressures. Their standard deviation of the force uses the "
                "repeatability of the other lengths, or the noise alone if there is none."
            )
        return ForceData(
            force=self.force[kept],
            pressure=self.pressure[kept],
            length=self.length[kept],
            specimen=specimen,
            force_std=std if noisy else None,
            length_std=None if length_std is None else np.full(int(kept.sum()), length_std),
            source=", ".join(record.source for record in self.points.records),
            notes=tuple(notes),
        )


def static_map(
    points: QuasiStatic, *, step: float = 25e3, branches: Branches = "both"
) -> StaticMap:
    """Average fill and vent branches at common pressures, with hysteresis and standard errors.

    Each branch of each record is interpolated by a shape-preserving cubic through its settled points.
    Points closer than 1 % of the pressure range are averaged first; the hold before a turn belongs to
    both branches. The force has a kink where the muscle becomes slack between two points: the curve
    of the pulling points is extended linearly towards the slack point while it pulls, and lower
    pressures are slack. (The cubic joins a single pulling point to the slack one.) Nothing is
    extrapolated beyond the points.

    The mean is computed first over the branches of a record, then over the records that pull, so
    differences between records do not affect the hysteresis.

    Args:
        points: points of records at one or more lengths.
        step: spacing of the common pressures [Pa], which start at zero.
        branches: "both", or "fill" or "vent" if the other branch was not recorded.

    Returns:
        The map.

    Raises:
        InputError: the step is not positive, or no record at some length has the requested branches.
    """
    if branches not in _SHOWN:
        raise InputError(f'branches must be "both", "fill" or "vent", got {branches!r}')
    pressures = _common_pressures(points, step)
    lengths = np.unique(points.length)[::-1].tolist()
    parts = [_at_length(points, length, pressures, branches) for length in lengths]
    summaries = tuple(summary for _, summary in parts)
    columns = (np.concatenate(column) for column in zip(*(rows for rows, _ in parts), strict=True))
    length, pressure, force, half_width, count, slack = columns
    between, within = (np.array([s[k] for s in summaries]) for k in ("repeatability", "stderr"))
    # Lengths without repeats use the repeatability pooled over the others.
    known = between[np.isfinite(between)]
    pooled = _rms(known) if known.size else 0.0
    within = within / np.sqrt(2 if branches == "both" else 1)
    single = np.hypot(within, np.where(np.isfinite(between), between, pooled))
    force_std = single[[lengths.index(one) for one in length.tolist()]] / np.sqrt(count)
    return StaticMap(
        length, pressure, force, half_width, count, slack, force_std, branches, summaries, points
    )


def _common_pressures(points: QuasiStatic, step: float) -> Levels:
    """Return the multiples of a step [Pa] from zero to the highest pressure of the points."""
    if not step > 0:
        raise InputError(f"step must be > 0, got {step} Pa")
    return step * np.arange(int(points.pressure.max() / step) + 1)


def _at_length(
    points: QuasiStatic, length: float, pressures: Levels, branches: Branches
) -> tuple[tuple[np.ndarray, ...], dict[str, Any]]:
    """Return the columns of the map at a length, and the summary of its records."""
    records = [i for i, record in enumerate(points.records) if record.length == length]
    forces, pulls = _curves(points, records, pressures)
    if branches == "both":
        force, pull = forces.mean(axis=0), np.asarray(pulls.all(axis=0))
    else:
        side = ("fill", "vent").index(branches)
        force, pull = forces[side], pulls[side]
    known = np.isfinite(force).any(axis=0)
    if not known.any():
        there = [side for k, side in enumerate(("fill", "vent")) if np.isfinite(forces[k]).any()]
        lacking = "both branches" if branches == "both" else f"a {branches} branch"
        other = f"use the {there[0]} branch (--branches {there[0]}), or " if there else ""
        raise InputError(
            f"no record at {length * 1e3:.6g} mm has {lacking} at a common pressure: record it, {other}use "
            "smaller steps (--step-kPa)"
        )
    pulling = np.asarray(pull.any(axis=0))
    used = np.where(pulling, pull, np.isfinite(force))[:, known]
    half = (forces[1] - forces[0]) / 2
    rows = (
        np.full(int(known.sum()), length),
        pressures[known],
        _mean(force[:, known], used),
        _mean(half[:, known], used & np.isfinite(half[:, known])),
        used.sum(axis=0),
        ~pulling[known],
    )
    return rows, _length_summary(points, records, (forces, pulls), (force, pull))


def _length_summary(
    points: QuasiStatic, records: list[int], curves: Curves, shown: tuple[Grid, GridMask]
) -> dict[str, Any]:
    """Summarise the records of a length; `StaticMap.lengths` explains the keys."""
    (fill, vent), (fills, vents) = curves
    mine = np.isin(points.record, records)
    pulling = mine & ~points.slack & points.settled
    least = pulling if pulling.any() else mine
    half = ((vent - fill) / 2)[fills & vents]
    ours = [points.records[i] for i in records]
    states = [record.valve_state for record in ours if record.valve_state is not None]

    def count(mark: np.ndarray) -> int:
        return int(np.sum(mine & mark))

    return {
        "length": float(ours[0].length),
        "n_records": len(records),
        "n_unused": int(np.sum(~np.isfinite(shown[0]).any(axis=1))),
        "n_fill": count(points.filling),
        "n_vent": count(~points.filling),
        "n_clamped": count(points.clamped),
        "n_slack": count(points.slack),
        "n_unsettled": count(~points.settled),
        "n_mislabelled": count(points.mislabelled),
        "n_repeated_stamps": sum(int(np.sum(np.diff(record.time) == 0)) for record in ours),
        "n_glitches": sum(int(np.sum(~np.isin(state, (0, FILL, VENT)))) for state in states),
        "noise": _rms(points.noise[least]),
        "stderr": _rms(points.stderr[least]),
        "half_width_mean": float(half.mean()) if half.size else math.nan,
        "half_width_rms": _rms(half),
        "half_width_max": float(np.abs(half).max()) if half.size else math.nan,
        "repeatability_fill": _repeatability(fill, fills),
        "repeatability_vent": _repeatability(vent, vents),
        "repeatability": _repeatability(*shown),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _mean(values: Grid, used: GridMask) -> Levels:
    """Mean over the used records; nan if there are none."""
    total, count = np.where(used, values, 0.0).sum(axis=0), used.sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


def _repeatability(force: Grid, pulls: GridMask) -> float:
    """Standard deviation between records, pooled over the pressures that several records share."""
    square = np.where(pulls, (force - _mean(force, pulls)) ** 2, 0.0).sum()
    freedom = int(np.maximum(pulls.sum(axis=0) - 1, 0).sum())
    return float(np.sqrt(square / freedom)) if freedom else math.nan


def _curves(points: QuasiStatic, records: Sequence[int], pressures: Levels) -> Curves:
    found = [[_curve(points, i, pressures, filling=f) for i in records] for f in (True, False)]
    force, pulls = (np.array([[one[k] for one in side] for side in found]) for k in (0, 1))
    return force, pulls


def _curve(
    points: QuasiStatic, record: int, pressures: Levels, *, filling: bool
) -> tuple[Levels, Pulls]:
    """Force of one branch of a record at the given pressures, and a mask of pulling states."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 -- 0.2 s

    mine = points.record == record
    on = points.filling[mine] == filling
    if points.kinds[record] == "staircase":
        on = on | np.append(on[1:] & ~on[:-1], False)  # the hold before a turn
    on &= points.settled[mine]
    if not on.any():
        return np.full(pressures.size, np.nan), np.zeros(pressures.size, bool)
    P, F, slack = (x[mine][on] for x in (points.pressure, points.force, points.slack))
    P, F, slack = _merged(P, F, slack, _MERGE * float(np.ptp(points.pressure[mine])))
    if P.size == 1:
        force = np.where(pressures == P[0], F[0], np.nan)
        return force, np.isfinite(force) & ~slack & (force >= points.slack_below)
    force = pulling = PchipInterpolator(P, F, extrapolate=False)(pressures)
    start = int(np.flatnonzero(slack)[-1]) + 1 if slack.any() else 0
    if P.size - start >= 2:
        cubic = PchipInterpolator(P[start:], F[start:], extrapolate=False)
        pulling = cubic(pressures)
        if start:
            line = F[start] + cubic(P[start], 1) * (pressures - P[start])
            pulling = np.where(pressures < P[start], line, pulling)
    above = pressures > (P[start - 1] if start else -np.inf)
    pulls = above & np.isfinite(pulling) & (pulling >= points.slack_below)
    return np.where(pulls, pulling, force), pulls


def _merged(P: Column, F: Column, slack: Mask, width: float) -> tuple[np.ndarray, ...]:
    """Sort points by pressure and average those within a width of the first of their group."""
    groups: list[list[int]] = []
    for i in np.argsort(P, kind="stable").tolist():
        if not groups or P[i] - P[groups[-1][0]] > width:
            groups.append([])
        groups[-1].append(i)
    pressure, force = (np.array([x[group].mean() for group in groups]) for x in (P, F))
    return pressure, force, np.array([slack[group].any() for group in groups])


def ramp_pairs(points: QuasiStatic, *, rest_length: float, step: float = 25e3) -> BranchPairs:
    """Return both branches of every record at the common pressures where both pull.

    Args:
        points: points of records at one or more lengths, interpolated as in `static_map`.
        rest_length: rest length L0 [m] of the muscle.
        step: spacing of the common pressures [Pa], which start at zero.

    Returns:
        The pairs of all records that have any.

    Raises:
        InputError: the step is not positive, or no record has both branches.
    """
    pressures = _common_pressures(points, step)
    (fill, vent), pulls = _curves(points, range(len(points.records)), pressures)
    parts = []
    for k, record in enumerate(points.records):
        turn = float(points.pressure[points.record == k].max())
        if points.kinds[k] == "ramp":  # skip the highest readings, which may be spikes
            highest = np.sort(record.pressure)[-LEAST_READINGS] - points.atmosphere[k]
            turn = max(turn, float(highest))
        both = pulls[:, k].all(axis=0) & (pressures <= turn)
        if both.any():
            parts.append(
                BranchPairs.ramp(
                    record.length, pressures[both], (vent[k] - fill[k])[both] / 2,
                    turn_pressure=turn, rest_length=rest_length, name=record.source,
                )
            )  # fmt: skip
    if not parts:
        raise InputError(
            "no record has both branches where the muscle pulls: hysteresis requires records of "
            "filling and venting"
        )
    return BranchPairs.joined(parts)


def branches_csv(pairs: BranchPairs) -> str:
    """Return the branches of ramps as CSV text in SI, one row per point, for `read_branches`."""
    columns = (pairs.length, pairs.pressure, pairs.half_difference, pairs.turn_pressure)
    lines = [",".join(_PAIRS)]
    for number, *values in zip(pairs.record, *columns, strict=True):
        name = pairs.names[number].replace(",", ";")
        numbers = (repr(float(one)) for one in (pairs.rest_length, *values))
        lines.append(",".join((name, *numbers)))
    return "\n".join(lines) + "\n"


def read_branches(path: Path) -> BranchPairs:
    """Read the branches of ramps from the `branches.csv` that `famjax ramps` writes.

    Raises:
        InputError: the file is missing or invalid.
    """
    header, *rows = text_lines(path) or [""]
    cells = [row.split(",") for row in rows]
    try:
        numbers = np.array([row[1:] for row in cells], float)
    except ValueError:
        numbers = np.empty(0)
    if header != ",".join(_PAIRS) or not numbers.size:
        raise InputError(f"{path} must be a branches.csv that famjax ramps has written")
    names = np.array([row[0] for row in cells])
    parts = []
    for name in dict.fromkeys(names.tolist()):
        rest, length, pressure, half, turn = numbers[names == name].T
        parts.append(
            BranchPairs.ramp(
                length[0], pressure, half, turn_pressure=turn[0], rest_length=rest[0], name=name
            )
        )
    return BranchPairs.joined(parts)


def read_ramps(
    entries: Iterable[str], *, columns: Mapping[str, str] | None = None
) -> list[RampRecord]:
    """Read the records named by entries such as `test8.csv=73.25mm`.

    Args:
        entries: `FILE=LENGTH` with the unit of the length; or a list, which is a CSV file with the columns
            `file` (relative to the list's folder) and `length_mm` (or another unit).
        columns: column name of each quantity in the records, see `read_ramp`.

    Raises:
        InputError: there is no entry, an entry cannot be read, or a file is named twice.
    """
    named: list[tuple[Path, float]] = []
    for entry in entries:
        name, equals, length = entry.rpartition("=")
        if equals:
            named.append((Path(name), parse_quantity(length, "length")))
        else:
            named += _listed(Path(entry))
    if not named:
        raise InputError(
            "no records: give each with its length, as in test8.csv=73.25mm, or give a list (a CSV file "
            "with the columns file and length_mm)"
        )
    paths = [path for path, _ in named]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice is not None:
        raise InputError(f"{twice} is named twice: give each record once")
    return [read_ramp(path, length=length, columns=columns) for path, length in named]


def _listed(path: Path) -> list[tuple[Path, float]]:
    """Return the files and lengths [m] in a list."""
    rows = list(csv.DictReader(text_lines(path)))
    units = [unit for unit in UNITS["length"] if rows and f"length_{unit}" in rows[0]]
    if not rows or "file" not in rows[0] or len(units) != 1:
        raise InputError(
            f"{path} is not a list of records with the columns file and length_mm (or another unit). "
            f"A single record needs its length: write {path}=73.25mm"
        )
    key, unit = f"length_{units[0]}", units[0]
    return [
        (path.parent / row["file"].strip(), parse_quantity(f"{row[key]}{unit}", "length"))
        for row in rows
    ]


def parse_atmosphere(text: str) -> float | tuple[float, float]:
    """Parse the reading at atmosphere [Pa], `8.94kPa`, or the vented interval [s], `0s:0.5s`.

    >>> parse_atmosphere("8.94kPa"), parse_atmosphere("0s:0.5s")
    (8940.0, (0.0, 0.5))
    """
    if ":" not in text:
        return parse_quantity(text, "pressure")
    try:
        start, stop = (float(end.strip().removesuffix("s")) for end in text.split(":"))
    except ValueError:
        raise InputError(
            f"atmosphere {text!r} must be a sensor reading with its unit, as in 8.94kPa, or the "
            "interval in which the muscle is vented, as in 0s:0.5s"
        ) from None
    return start, stop


def ramps_command(
    entries: Sequence[str],
    *,
    atmosphere: float | tuple[float, float],
    columns: Mapping[str, str] | None = None,
    specimen: Mapping[str, Any] | None = None,
    period: float | None = None,
    step: float = 25e3,
    slack_below: float | None = None,
    branches: Branches = "both",
    length_std: float | None = None,
    system: str = "metric",
    tell: Callable[[str], object] = str,
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Convert raw records to a static force map; return a summary and the files to write.

    Args:
        entries: see `read_ramps`.
        atmosphere: pressure reading at atmosphere [Pa], or the vented interval [s].
        columns: column name of each quantity in the records, see `read_ramp`.
        specimen: fields of `Specimen` in SI, including the rest length.
        period: time between valve pulses [s]; None to detect it.
        step: spacing of the pressures of the map [Pa].
        slack_below: force [N] below which a muscle does not pull; None to detect it.
        branches: "both", "fill" or "vent".
        length_std: standard deviation of the lengths [m], if known.
        system: units of summary, figure and map: "si", "metric" or "us".
        tell: function called with a description of the columns of the records.

    Returns:
        The JSON-ready summary, with units in the keys and null for missing values; and the contents of
        `map.csv`, `ramps.png`, `ramps.json` and, if records have both branches, `branches.csv`.

    Raises:
        InputError: an entry, record or option is invalid.
    """
    unit_system(system)
    if not specimen or "rest_length" not in specimen:
        raise InputError(
            "the rest length of the muscle must be given (--specimen rest_length_mm=...), since the "
            "longest record may differ from it"
        )
    muscle = describe({"name": "ramps", **specimen}, specimen["rest_length"])
    records = read_ramps(entries, columns=columns)
    _check_ranges(records)
    for taken in dict.fromkeys(record.taken for record in records):
        tell(taken)
    points = quasi_static(records, atmosphere=atmosphere, period=period, slack_below=slack_below)
    static = static_map(points, step=step, branches=branches)
    data = static.force_data(muscle.specimen, length_std=length_std)
    data = dataclasses.replace(data, notes=(*muscle.notes, *data.notes), assumed=muscle.assumed)
    summary = {
        **_summary(static, system),
        "notes": [sentence_in_units(one, system) for one in data.notes],
    }
    files = {
        "map.csv": csv_text(data, system).encode(),
        "ramps.png": as_png(plot_ramps(static, system)),
        "ramps.json": json.dumps(summary, indent=1, allow_nan=False).encode(),
    }
    with contextlib.suppress(InputError):  # no record has both branches
        pairs = ramp_pairs(points, rest_length=data.specimen.rest_length, step=step)
        files["branches.csv"] = branches_csv(pairs).encode()
    return summary, files


def _check_ranges(records: Iterable[RampRecord]) -> None:
    """Refuse records at constant pressure."""
    for record in records:
        low, high = np.quantile(record.pressure, [0.01, 0.99]).tolist()
        if high - low < _LEAST_RANGE * abs(high):
            raise InputError(
                f"{record.source}: the pressure must sweep a range at constant length, got only "
                f"{low / 1e3:.4g} to {high / 1e3:.4g} kPa: check the column (--column pressure=). For "
                "strokes at constant pressure, use famjax characterise"
            )


def _summary(static: StaticMap, system: str) -> dict[str, Any]:
    """Return the JSON-ready summary: totals, then one row per record and per length."""
    points, units = static.points, unit_system(system)

    def entry(name: str, number: float | None, kind: str) -> dict[str, float | None]:
        value = math.nan if number is None else number
        return {f"{name}_{units[kind]}": finite_or_none(from_si(value, units[kind], kind))}

    lengths = []
    for one in static.lengths:
        row: dict[str, Any] = {}
        for key, number in one.items():  # floats are lengths or forces, the rest are counts
            kind = "length" if key == "length" else "force"
            row |= entry(key, number, kind) if isinstance(number, float) else {key: number}
        lengths.append(row)
    each = (points.records, points.kinds, points.periods, points.atmosphere, points.n_short)
    return {
        "n_points": points.force.size,
        "n_rows": static.force.size,
        "n_pulling_rows": int((~static.slack).sum()),
        **entry("clamp", points.clamp, "force"),
        **entry("slack_below", points.slack_below, "force"),
        "branches": static.branches,
        "records": [
            {
                "source": record.source,
                **entry("length", record.length, "length"),
                "kind": kind,
                "period_s": period if math.isfinite(period) else None,
                **entry("atmosphere", zero, "pressure"),
                "n_readings": record.time.size,
                "n_short_holds": short,
            }
            for record, kind, period, zero, short in zip(*each, strict=True)
        ],
        "lengths": lengths,
    }


def plot_ramps(static: StaticMap, system: str = "metric") -> "Figure":
    """Plot points and map against pressure, and the hysteresis next to them, one colour per length.

    Args:
        static: result of `static_map`.
        system: "si", "metric" or "us".

    Returns:
        The figure, not shown; save it with `savefig`.
    """
    import matplotlib as mpl  # noqa: PLC0415 -- 0.3 s
    from matplotlib.figure import Figure  # noqa: PLC0415

    units, points = unit_system(system), static.points
    pressure, force, metre = (factor(units[kind], kind) for kind in ("pressure", "force", "length"))
    figure = Figure(figsize=(11, 4.5), layout="constrained")
    figure.suptitle(
        f"{len(points.records)} records, {points.force.size} quasi-static points, "
        f"{int(points.slack.sum())} slack",
        fontsize=11,
    )
    left, right = figure.subplots(1, 2)
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(static.lengths)))
    for one, colour in zip(static.lengths, shades, strict=True):
        for filling, marker in ((True, "^"), (False, "v")):
            mine = (points.length == one["length"]) & (points.filling == filling) & ~points.slack
            dots = points.pressure[mine] / pressure, points.force[mine] / force
            left.plot(*dots, marker, ms=3, mfc="none", color=colour)
        rows = (static.length == one["length"]) & ~static.slack
        P, F = static.pressure[rows] / pressure, static.force[rows] / force
        left.plot(P, F, color=colour, lw=1, label=f"{one['length'] / metre:.5g} {units['length']}")
        half, bars = static.half_width[rows] / force, static.force_std[rows] / force
        right.errorbar(P, half, yerr=bars, color=colour, marker=".", lw=1, elinewidth=0.6)
    slack = points.pressure[points.slack] / pressure, points.force[points.slack] / force
    left.plot(*slack, "x", color="0.7", ms=3)
    left.legend(frameon=False, fontsize=8)
    left.set_title("up: fill; down: vent; crosses: slack; line: map", fontsize=9)
    left.set_ylabel(f"force, {units['force']}")
    right.axhline(0, color="0.7", lw=0.8)
    right.set_title("hysteresis half-width; bars: standard error of the map", fontsize=9)
    right.set_ylabel(f"(vent - fill)/2, {units['force']}")
    for axes in (left, right):
        axes.set_xlabel(f"gauge pressure, {units['pressure']}")
    return figure

"""Compute static force maps from raw ramps: mean of fill and vent branches, hysteresis, output files."""

import csv
import dataclasses
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Bool, Float

from famjax.boundary.errors import InputError
from famjax.boundary.files import as_png
from famjax.boundary.units import (
    UNITS,
    factor,
    finite_or_none,
    parse_quantity,
    sentence_in_units,
    unit_system,
)
from famjax.tables import text_lines

from ..data import ForceData, csv_text
from ..specimen import Specimen, describe
from .hysteresis import BranchPairs
from .ramp import LEAST_READINGS, Mask, QuasiStatic, RampRecord, quasi_static, read_ramp
from .record import Column

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_MERGE = 0.01  # points closer than this fraction of the pressure range are averaged
_LEAST_RANGE = 0.2  # smallest pressure range of a ramp, relative to its highest pressure
_LEAST_STD = 1e-9  # a smaller standard deviation, relative to the largest force, is rounding
_PAIRS = ("record", "rest_length_m", "length_m", "pressure_Pa", "half_difference_N",
          "turn_pressure_Pa")  # fmt: skip

Curves = tuple[Float[np.ndarray, "2 records levels"], Bool[np.ndarray, "2 records levels"]]
"""Fill and vent forces at common pressures (nan if not measured), and a mask of pulling states."""


@dataclasses.dataclass(frozen=True)
class StaticMap:
    """Static force at common pressures for every length, one row per length and pressure.

    Attributes:
        length: L [m], shape (rows,).
        pressure: gauge pressure P [Pa], shape (rows,).
        force: mean force F [N] over records, shape (rows,).
        slack: True if the muscle pulls in no record, shape (rows,); the force is then not a static force.
        force_std: standard error of the force [N], shape (rows,). It combines the error of the points with
            the repeatability at the length (pooled over lengths if there are no repeats), both divided
            by the square root of the number of records.
        lengths: summary of each length in SI, longest first: `length_m`; the number of records
            (`n_records`), of records that lack a branch (`n_unused`), and of points (`n_fill`, `n_vent`,
            `n_slack`, `n_unsettled`); RMS of the reading noise (`noise_N`), of the points' `stderr_N` and
            of the hysteresis (`half_width_rms_N`); and `repeatability_N`, the standard deviation between
            records pooled over pressures. Forces refer to pulling states; nan if there are none.
        points: quasi-static points from which the map was computed.
    """

    length: Column
    pressure: Column
    force: Column
    slack: Mask
    force_std: Column
    lengths: tuple[dict[str, Any], ...]
    points: QuasiStatic

    def force_data(self, specimen: Specimen) -> ForceData:
        """Return the map without its slack rows as a `ForceData`, from which a muscle can be identified.

        Raises:
            InputError: all rows are slack, or `ForceData` rejects the map.
        """
        kept = ~self.slack
        if not kept.any():
            raise InputError(
                f"all {self.slack.size} rows of the map are slack (below "
                f"{self.points.slack_below:.4g} N): check that pulling forces are positive, or lower the "
                "limit with --slack-below-N (slack_below in Python)"
            )
        std = self.force_std[kept]
        noisy = bool((std > _LEAST_STD * self.force.max()).all())
        notes = [
            f"Forces are quasi-static (mean of fill and vent branches of {len(self.points.records)} "
            f"records). The reading at atmospheric pressure, {self.points.atmosphere / 1e3:.4g} kPa, was "
            "subtracted. Forces are used as recorded, so correct an offset of the load cell first.",
            f"{int((~kept).sum())} of {self.slack.size} rows are slack (below "
            f"{self.points.slack_below:.4g} N) and were left out.",
        ]
        if unused := sum(one["n_unused"] for one in self.lengths):
            notes.append(f"{unused} records lack one of the branches and were not used.")
        if not noisy:
            notes.append("The readings show no noise, so the forces have no standard deviation.")
        elif any(math.isnan(one["repeatability_N"]) for one in self.lengths):
            notes.append(
                "At some lengths, no pressure was repeated. The standard deviation of the forces there is "
                "based on the repeatability at other lengths or, if there is none, on the noise alone."
            )
        return ForceData(
            force=self.force[kept],
            pressure=self.pressure[kept],
            length=self.length[kept],
            specimen=specimen,
            force_std=std if noisy else None,
            source=", ".join(record.source for record in self.points.records),
            notes=tuple(notes),
        )


def static_map(points: QuasiStatic, *, step: float = 25e3) -> StaticMap:
    """Average fill and vent branches at common pressures, with hysteresis and standard errors.

    Each branch of each record is interpolated by a shape-preserving cubic through its settled points.
    Points closer than 1 % of the pressure range are averaged first; the hold before a turn belongs to
    both branches. The force has a kink where the muscle becomes slack between two points. There, the
    curve through the pulling points is extended linearly towards the slack point until the muscle is
    slack; it is slack at all lower pressures. (If only one point pulls, the cubic joins it to the
    slack point.) Nothing is extrapolated beyond the points.

    The mean is computed first over the branches of a record, then over the records that pull, so
    differences between records do not affect the hysteresis.

    Args:
        points: points of records at one or more lengths.
        step: spacing of the common pressures [Pa], which start at zero.

    Returns:
        The map.

    Raises:
        InputError: the step is not positive, or no record at some length has both branches.
    """
    pressures = _common_pressures(points, step)
    lengths = np.unique(points.length)[::-1].tolist()
    parts = [_at_length(points, length, pressures) for length in lengths]
    summaries = tuple(summary for _, summary in parts)
    columns = (np.concatenate(column) for column in zip(*(rows for rows, _ in parts), strict=True))
    length, pressure, force, count, slack = columns
    between, within = (np.array([s[k] for s in summaries]) for k in ("repeatability_N", "stderr_N"))
    # Lengths without repeats use the repeatability pooled over the others.
    known = between[np.isfinite(between)]
    pooled = _rms(known) if known.size else 0.0
    single = np.hypot(within / np.sqrt(2), np.where(np.isfinite(between), between, pooled))
    force_std = single[[lengths.index(one) for one in length.tolist()]] / np.sqrt(count)
    return StaticMap(length, pressure, force, slack, force_std, summaries, points)


def _common_pressures(points: QuasiStatic, step: float) -> Column:
    """Return the multiples of a step [Pa] from zero to the highest pressure of the points."""
    if not step > 0:
        raise InputError(f"step must be > 0, got {step} Pa")
    return step * np.arange(int(points.pressure.max() / step) + 1)


def _at_length(
    points: QuasiStatic, length: float, pressures: Column
) -> tuple[tuple[np.ndarray, ...], dict[str, Any]]:
    """Return the columns of the map at one length, including the number of records, and a summary."""
    records = [i for i, record in enumerate(points.records) if record.length == length]
    forces, pulls = _curves(points, records, pressures)
    force, pull = forces.mean(axis=0), np.asarray(pulls.all(axis=0))
    known = np.isfinite(force).any(axis=0)
    if not known.any():
        raise InputError(
            f"no record at {length * 1e3:.6g} mm has both branches at a common pressure: record both "
            "filling and venting, or use smaller steps (--step-kPa)"
        )
    pulling = np.asarray(pull.any(axis=0))
    used = np.where(pulling, pull, np.isfinite(force))[:, known]
    rows = (
        np.full(int(known.sum()), length),
        pressures[known],
        _mean(force[:, known], used),
        used.sum(axis=0),
        ~pulling[known],
    )
    mine = np.isin(points.record, records)
    sound = mine & ~points.slack & points.settled
    least = sound if sound.any() else mine
    summary = {
        "length_m": length,
        "n_records": len(records),
        "n_unused": int(np.sum(~np.isfinite(force).any(axis=1))),
        "n_fill": int(np.sum(mine & points.filling)),
        "n_vent": int(np.sum(mine & ~points.filling)),
        "n_slack": int(np.sum(mine & points.slack)),
        "n_unsettled": int(np.sum(mine & ~points.settled)),
        "noise_N": _rms(points.noise[least]),
        "stderr_N": _rms(points.stderr[least]),
        "half_width_rms_N": _rms((forces[1] - forces[0])[pull] / 2),
        "repeatability_N": _repeatability(force, pull),
    }
    return rows, summary


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def _mean(values: np.ndarray, used: np.ndarray) -> Column:
    """Return the mean over the used records; nan if there are none."""
    return np.ma.masked_array(values, ~used).mean(axis=0).filled(np.nan)


def _repeatability(force: np.ndarray, pulls: np.ndarray) -> float:
    """Return the standard deviation between records, pooled over pressures that several records share."""
    square = np.where(pulls, (force - _mean(force, pulls)) ** 2, 0.0).sum()
    freedom = int(np.maximum(pulls.sum(axis=0) - 1, 0).sum())
    return float(np.sqrt(square / freedom)) if freedom else math.nan


def _curves(points: QuasiStatic, records: Sequence[int], pressures: Column) -> Curves:
    found = [[_curve(points, i, pressures, filling=f) for i in records] for f in (True, False)]
    force, pulls = (np.array([[one[k] for one in side] for side in found]) for k in (0, 1))
    return force, pulls


def _curve(
    points: QuasiStatic, record: int, pressures: Column, *, filling: bool
) -> tuple[Column, Mask]:
    """Return the force on one branch of a record at given pressures, and a mask of pulling states."""
    from scipy.interpolate import PchipInterpolator  # noqa: PLC0415 -- 0.2 s

    mine = points.record == record
    on = points.filling[mine] == filling
    if points.kinds[record] == "staircase":
        on = on | np.append(on[1:] & ~on[:-1], False)  # the hold before a turn
    on &= points.settled[mine]
    P, F, slack = (x[mine][on] for x in (points.pressure, points.force, points.slack))
    P, F, slack = _merged(P, F, slack, _MERGE * float(np.ptp(points.pressure[mine])))
    if P.size < 2:
        return np.full(pressures.size, np.nan), np.zeros(pressures.size, bool)
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
    """Return both branches of every record at the shared pressures at which the muscle pulls.

    Args:
        points: points of records at one or more lengths, interpolated as in `static_map`.
        rest_length: rest length L0 [m] of the muscle.
        step: spacing of the common pressures [Pa], which start at zero.

    Returns:
        The branch pairs of all records that have any.

    Raises:
        InputError: the step is not positive, or no record has both branches.
    """
    pressures = _common_pressures(points, step)
    (fill, vent), pulls = _curves(points, range(len(points.records)), pressures)
    parts = []
    for k, record in enumerate(points.records):
        turn = float(points.pressure[points.record == k].max())
        if points.kinds[k] == "ramp":  # skip the highest readings, which may be spikes
            highest = np.sort(record.pressure)[-LEAST_READINGS] - points.atmosphere
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
            "no record has both branches in states where the muscle pulls: for hysteresis, record both "
            "filling and venting"
        )
    return BranchPairs.joined(parts)


def branches_csv(pairs: BranchPairs) -> str:
    """Return the branches of ramps as CSV text in SI, one row per point, for `read_branches`."""
    columns = (
        pairs.record,
        pairs.length,
        pairs.pressure,
        pairs.half_difference,
        pairs.turn_pressure,
    )
    file = io.StringIO()
    writer = csv.writer(file, lineterminator="\n")
    writer.writerow(_PAIRS)
    for name, *values in zip(*(one.tolist() for one in columns), strict=True):
        writer.writerow([name, pairs.rest_length, *values])
    return file.getvalue()


def read_branches(path: Path) -> BranchPairs:
    """Read the branches of ramps from the `branches.csv` that `famjax ramps` writes.

    Raises:
        InputError: the file is missing or invalid.
    """
    header, *rows = list(csv.reader(text_lines(path))) or [[]]
    try:
        numbers = np.array([row[1:] for row in rows], float)
    except ValueError:
        numbers = np.empty(0)
    if tuple(header) != _PAIRS or not numbers.size:
        raise InputError(f"{path} must be a branches.csv written by famjax ramps")
    rest, length, pressure, half, turn = (numbers[:, k] for k in range(5))
    names = np.array([row[0] for row in rows])
    return BranchPairs(length, pressure, half, turn, names, float(rest[0]))


def read_ramps(
    entries: Iterable[str], *, columns: Mapping[str, str] | None = None
) -> list[RampRecord]:
    """Read the records named by entries such as `test8.csv=73.25mm`.

    Args:
        entries: `FILE=LENGTH`, with the unit of the length; or the name of a list, which is a CSV file with
            the columns `file` (relative to the list's folder) and `length_mm` (or another unit).
        columns: column name of each quantity in the records, see `read_ramp`.

    Raises:
        InputError: there is no entry, an entry cannot be read, or a file is listed twice.
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
            "no records were given: list each record with its length, as in test8.csv=73.25mm, or give a "
            "list (a CSV file with the columns file and length_mm)"
        )
    paths = [path for path, _ in named]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice is not None:
        raise InputError(f"{twice} is listed twice: list each record only once")
    return [read_ramp(path, length=length, columns=columns) for path, length in named]


def _listed(path: Path) -> list[tuple[Path, float]]:
    """Return the files and lengths [m] named in a list."""
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


def ramps_command(
    entries: Sequence[str],
    *,
    atmosphere: float,
    columns: Mapping[str, str] | None = None,
    specimen: Mapping[str, Any] | None = None,
    step: float = 25e3,
    slack_below: float | None = None,
    system: str = "metric",
    tell: Callable[[str], object] = str,
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """Convert raw records to a static force map; return a summary and the files to write.

    Args:
        entries: see `read_ramps`.
        atmosphere: reading at atmospheric pressure [Pa].
        columns: column name of each quantity in the records, see `read_ramp`.
        specimen: fields of `Specimen` in SI, including the rest length.
        step: spacing of the pressures in the map [Pa].
        slack_below: force [N] below which the muscle counts as slack; None to detect it.
        system: units for notes, figure and map: "si", "metric" or "us".
        tell: function that is called with a description of how the columns were interpreted.

    Returns:
        The JSON-ready summary in SI, with units in the keys and null for missing values; and the contents
        of `map.csv`, `ramps.png` and `branches.csv`.

    Raises:
        InputError: an entry, record or option is invalid.
    """
    unit_system(system)
    if not specimen or "rest_length" not in specimen:
        raise InputError(
            "the rest length of the muscle must be given (--specimen rest_length_mm=...), because the "
            "longest recorded length may differ from it"
        )
    muscle = describe({"name": "ramps", **specimen}, specimen["rest_length"])
    records = read_ramps(entries, columns=columns)
    _check_ranges(records)
    for taken in dict.fromkeys(record.taken for record in records):
        tell(taken)
    points = quasi_static(records, atmosphere=atmosphere, slack_below=slack_below)
    static = static_map(points, step=step)
    data = static.force_data(muscle.specimen)
    data = dataclasses.replace(data, notes=(*muscle.notes, *data.notes), assumed=muscle.assumed)
    summary = _summary(static) | {"notes": [sentence_in_units(one, system) for one in data.notes]}
    pairs = ramp_pairs(points, rest_length=data.specimen.rest_length, step=step)
    return summary, {
        "map.csv": csv_text(data, system).encode(),
        "ramps.png": as_png(plot_ramps(static, system)),
        "branches.csv": branches_csv(pairs).encode(),
    }


def _check_ranges(records: Iterable[RampRecord]) -> None:
    """Reject records in which the pressure is nearly constant."""
    for record in records:
        low, high = np.quantile(record.pressure, [0.01, 0.99]).tolist()
        if high - low < _LEAST_RANGE * abs(high):
            raise InputError(
                f"{record.source}: the pressure must sweep a range at constant length, but it only ranges "
                f"from {low / 1e3:.4g} to {high / 1e3:.4g} kPa. Check the column (--column pressure=). For "
                "strokes at constant pressure, use famjax characterise"
            )


def _summary(static: StaticMap) -> dict[str, Any]:
    """Return the JSON-ready summary in SI: totals, then one row per record and per length."""
    points = static.points
    each = zip(points.records, points.kinds, points.periods, points.n_short, strict=True)
    return {
        "n_points": points.force.size,
        "n_rows": static.force.size,
        "n_pulling_rows": int((~static.slack).sum()),
        "clamp_N": points.clamp,
        "slack_below_N": points.slack_below,
        "atmosphere_Pa": points.atmosphere,
        "records": [
            {
                "source": record.source, "length_m": record.length, "kind": kind,
                "period_s": finite_or_none(period), "n_short_holds": short,
            }
            for record, kind, period, short in each
        ],
        "lengths": [{k: finite_or_none(v) for k, v in one.items()} for one in static.lengths],
    }  # fmt: skip


def plot_ramps(static: StaticMap, system: str = "metric") -> "Figure":
    """Plot the points and the map against pressure, in one colour for each length.

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
    figure = Figure(figsize=(6, 4.5), layout="constrained")
    axes = figure.subplots()
    shades = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(static.lengths)))
    for one, colour in zip(static.lengths, shades, strict=True):
        for filling, marker in ((True, "^"), (False, "v")):
            mine = (points.length == one["length_m"]) & (points.filling == filling) & ~points.slack
            dots = points.pressure[mine] / pressure, points.force[mine] / force
            axes.plot(*dots, marker, ms=3, mfc="none", color=colour)
        rows = (static.length == one["length_m"]) & ~static.slack
        P, F = static.pressure[rows] / pressure, static.force[rows] / force
        axes.plot(
            P, F, color=colour, lw=1, label=f"{one['length_m'] / metre:.5g} {units['length']}"
        )
    slack = points.pressure[points.slack] / pressure, points.force[points.slack] / force
    axes.plot(*slack, "x", color="0.7", ms=3)
    axes.legend(frameon=False, fontsize=8)
    axes.set_title("triangles: fill (up), vent (down); crosses: slack; lines: map", fontsize=9)
    axes.set_ylabel(f"force, {units['force']}")
    axes.set_xlabel(f"gauge pressure, {units['pressure']}")
    return figure

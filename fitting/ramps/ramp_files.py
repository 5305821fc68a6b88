"""What `famjax ramps` does: raw records with their lengths in, a static force map out."""

import contextlib
import csv
import dataclasses
import io
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from famjax.boundary.errors import InputError
from famjax.boundary.files import csv_lines
from famjax.boundary.sentence import in_units
from famjax.boundary.units import UNITS, from_si, parse_quantity, unit_system

from ..data.csv_writer import csv_text
from ..data.force_csv import Described, describe
from ..data.force_data import ForceData
from .branch_curves import Branches
from .force_map import StaticMap, static_map
from .length_summary import LengthSummary
from .quasi_static_ramp import quasi_static
from .ramp_pairs import branches_csv, ramp_pairs
from .record import RampRecord, read_ramp


def read_ramps(entries: Iterable[str], *, columns: str | None = None) -> list[RampRecord]:
    """The records that entries such as `test8.csv=73.25mm` name.

    Args:
        entries: `FILE=LENGTH` with the length's unit; or a list of files, a CSV file with the
            columns `file` and `length_mm` (or another unit), names relative to its folder.
        columns: names of the records' columns where their header has none, see `read_ramp`.

    Raises:
        InputError: no entry, one that cannot be read, or a file twice.
    """
    named: list[tuple[Path, float]] = []
    for entry in entries:
        name, equals, length = entry.rpartition("=")
        named += (
            [(Path(name), parse_quantity(length, "length"))] if equals else _listed(Path(entry))
        )
    if not named:
        raise InputError(
            "no records: name them with their lengths, as in test8.csv=73.25mm, or give a list, a "
            "CSV file with the columns file and length_mm"
        )
    paths = [path for path, _ in named]
    twice = next((path for path in paths if paths.count(path) > 1), None)
    if twice is not None:
        raise InputError(f"{twice} is named twice: each record counts once")
    return [read_ramp(path, length=length, columns=columns) for path, length in named]


def _listed(path: Path) -> list[tuple[Path, float]]:
    """Files and lengths [m] of a list."""
    rows = list(csv.DictReader(csv_lines(path)))
    units = [u for u in UNITS["length"] if rows and rows[0].get(f"length_{u}") is not None]
    if not rows or rows[0].get("file") is None or len(units) != 1:
        raise InputError(
            f"{path} is no list of records with the columns file and length_mm (or another unit). "
            "A single record needs its length: write "
            f"{path}=73.25mm"
        )
    named = []
    for number, row in enumerate(rows, 2):
        if None in row.values() or None in row:
            raise InputError(f"{path}: row {number} has not as many cells as the header")
        length = parse_quantity(f"{row[f'length_{units[0]}']}{units[0]}", "length")
        named.append((path.parent / row["file"].strip(), length))
    return named


def parse_atmosphere(text: str) -> float | tuple[float, float]:
    """The reading at atmosphere [Pa] from `8.94kPa`, or the vented interval [s] from `0s:0.5s`.

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
    columns: str | None = None,
    specimen: Mapping[str, Any] | None = None,
    period: float | None = None,
    step: float = 25e3,
    slack_below: float | None = None,
    branches: Branches = "both",
    length_std: float | None = None,
    system: str = "metric",
) -> tuple[dict[str, Any], dict[str, bytes]]:
    """The static force map of raw records: a summary, and the files to write.

    Args:
        entries: see `read_ramps`.
        atmosphere: what the pressure sensor reads at atmosphere [Pa], or the vented interval [s].
        columns: of the records, where their header has none.
        specimen: fields of `Specimen` in SI. The rest length must be among them.
        period: between valve pulses [s]; None finds it.
        step: of the map's pressures [Pa].
        slack_below: force [N] under which a muscle does not pull; None finds it.
        branches: "both", "fill" or "vent".
        length_std: standard deviation of the lengths [m], where it is known.
        system: units of summary, picture and map: "si", "metric" or "us".

    Returns:
        The summary, JSON-ready, with the unit in each key, null where there is no value; and the
        contents of `map.csv`, `ramps.png`, `ramps.json` and, where records have both branches,
        `branches.csv`.

    Raises:
        InputError: what is wrong with entries, records or options.
    """
    unit_system(system)
    muscle = ramp_specimen(specimen or {})
    points = quasi_static(
        read_ramps(entries, columns=columns),
        atmosphere=atmosphere,
        period=period,
        slack_below=slack_below,
    )
    static = static_map(points, step=step, branches=branches)
    data = ramp_data(static, muscle, length_std=length_std)
    summary = {
        **ramp_summary(static, system),
        "notes": [in_units(one, system) for one in data.notes],
    }
    files = {
        "map.csv": csv_text(data, system).encode(),
        "ramps.png": _picture(static, system),
        "ramps.json": json.dumps(summary, indent=1, allow_nan=False).encode(),
    }
    with contextlib.suppress(InputError):  # no record has both branches
        pairs = ramp_pairs(points, rest_length=data.specimen.rest_length, step=step)
        files["branches.csv"] = branches_csv(pairs).encode()
    return summary, files


def ramp_specimen(known: Mapping[str, Any]) -> Described:
    """The muscle of raw records, with what is assumed of it as of a force map's.

    Args:
        known: fields of `Specimen` in SI.

    Raises:
        InputError: the rest length is not among them.
    """
    if "rest_length" not in known:
        raise InputError(
            "the rest length of the muscle must be given (--specimen rest_length_mm=...): the "
            "longest record need not be at it"
        )
    return describe({"name": "ramps", **known}, known["rest_length"])


def ramp_data(
    static: StaticMap, muscle: Described, *, length_std: float | None = None
) -> ForceData:
    """A static map as data of an identification, with what was assumed of the muscle."""
    data = static.force_data(muscle.specimen, length_std=length_std)
    return dataclasses.replace(data, notes=(*muscle.notes, *data.notes), assumed=muscle.assumed)


def _picture(static: StaticMap, system: str) -> bytes:
    from .ramp_plot import plot_ramps  # noqa: PLC0415 -- loads matplotlib

    picture = io.BytesIO()
    plot_ramps(static, system).savefig(picture, format="png", dpi=130)
    return picture.getvalue()


def ramp_summary(static: StaticMap, system: str = "metric") -> dict[str, Any]:
    """What the records show, JSON-ready: totals, then a row for each record and each length."""
    points, units = static.points, unit_system(system)

    def value(number: float | None, kind: str) -> float | None:
        if number is None or not math.isfinite(number):
            return None
        return from_si(number, units[kind], kind)

    def of_length(one: LengthSummary) -> dict[str, Any]:
        row: dict[str, Any] = {}
        for key, number in dataclasses.asdict(one).items():
            if isinstance(number, float):  # a length or a force, and all others are counts
                kind = "length" if key == "length" else "force"
                row[f"{key}_{units[kind]}"] = value(number, kind)
            else:
                row[key] = number
        return row

    force, pressure, length = units["force"], units["pressure"], units["length"]
    return {
        "n_points": points.force.size,
        "n_rows": static.force.size,
        "n_pulling_rows": int((~static.slack).sum()),
        f"clamp_{force}": value(points.clamp, "force"),
        f"slack_below_{force}": value(points.slack_below, "force"),
        "branches": static.branches,
        "records": [
            {
                "source": record.source,
                f"length_{length}": value(record.length, "length"),
                "kind": kind,
                "period_s": period if math.isfinite(period) else None,
                f"atmosphere_{pressure}": value(zero, "pressure"),
                "n_readings": record.time.size,
                "n_short_holds": short,
            }
            for record, kind, period, zero, short in zip(
                points.records,
                points.kinds,
                points.periods,
                points.atmosphere,
                points.n_short,
                strict=True,
            )
        ],
        "lengths": [of_length(one) for one in static.lengths],
    }

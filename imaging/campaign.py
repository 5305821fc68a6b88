"""Measure many photographs into one table: workers, resuming, CSV and NetCDF."""

import dataclasses
import functools
import hashlib
import importlib.metadata
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import import_extra
from famjax.boundary.files import csv_text, some_of
from famjax.boundary.tasks import Store, run_tasks
from famjax.boundary.units import factor, finite_or_none, unit_system

from .camera import Array
from .errors import ImagingError, MixedSizes
from .measurement import Measurement
from .photograph import date_text, read_timestamp, sizes_of
from .recipe import Recipe, recipe_text

if TYPE_CHECKING:
    import xarray

PARTS = "parts"
"""Folder of the finished rows in that of a campaign."""
POSITION = np.linspace(0, 1, 201)
"""Where the profiles of all pictures are given: z/L, from the upper tape edge to the lower one."""
SCALE_STDERR = "scale_relative_stderr"
"""Entry of the provenance: relative standard error of px/m, common to all lengths and diameters."""

_FEW = 4  # pictures that are measured before a second process has started
_NONE = (math.nan,) * POSITION.size
_FIRST = (
    "time", "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "max_diameter",
    "volume", "volume_stderr", "contraction", "contraction_stderr", "px_per_m", "roll_deg",
)  # fmt: skip
_TEXTS = "path", "error", "sha256", "warnings"
_PROFILES = "diameter", "diameter_stderr", "braid_angle", "braid_angle_stderr"
_LENGTHS = "length", "mean_diameter", "max_diameter", "x0", "distance", "bow", "displacement"
_KINDS = dict.fromkeys(_LENGTHS, "length") | {"time": "time", "log_time": "time"}
_KINDS |= {kind: kind for kind in ("volume", "force", "pressure")}
"""Kind of unit of a column; the names of the others say theirs."""


def column_unit(name: str, system: str) -> tuple[str, str, float]:
    """The name of a column in a file, its unit, and SI per unit; a standard error has that of its quantity.

    >>> [column_unit(name, "metric")[0] for name in ("length", "px_per_m", "roll_deg")]
    ['length_mm', 'px_per_mm', 'roll_deg']
    """
    units = unit_system(system)
    if name == "px_per_m":
        return f"px_per_{units['length']}", "", factor(units["scale"], "scale")
    kind = _KINDS.get(name.removesuffix("_stderr"))
    if kind is None:
        return name, "", 1.0
    return f"{name}_{units[kind]}", units[kind], factor(units[kind], kind)


@dataclasses.dataclass(frozen=True)
class Row:
    """The result for one picture, as stored in JSON.

    Args:
        path: as it was given.
        error: "ClassName: message"; empty where the picture was measured.
        numbers: in SI, by column; none where the picture could not be measured.
        diameter: at `POSITION`, shape (201,) [m]; nan where the picture could not be measured.
        diameter_stderr: its standard error, shape (201,) [m].
        braid_angle: at `POSITION`, shape (201,) [deg]; nan where it is not resolved or not asked for.
        braid_angle_stderr: its standard error, shape (201,) [deg].
        braid_refusal: why the braid angle is resolved nowhere, empty where it is or was not asked for.
        seconds: when it was taken, by the camera's clock [s since 1970]; nan if it does not say.
        resolution: of the time stamp [s].
        sha256: of the file; empty where it could not be read.
        warnings: of the measurement, on one line; empty where there are none.
    """

    path: str
    error: str = ""
    numbers: dict[str, float] = dataclasses.field(default_factory=dict)
    diameter: ArrayLike = _NONE
    diameter_stderr: ArrayLike = _NONE
    braid_angle: ArrayLike = _NONE
    braid_angle_stderr: ArrayLike = _NONE
    braid_refusal: str = ""
    seconds: float = math.nan
    resolution: float = math.nan
    sha256: str = ""
    warnings: str = ""


def measured_row(path: str, recipe: Recipe) -> Row:
    """The row of a picture, also if it could not be measured.

    Args:
        path: of the picture.
        recipe: how to measure.
    """
    import cv2  # noqa: PLC0415 -- 0.1 s, and only workers need it

    from . import measurement  # noqa: PLC0415

    stamp, threads = read_timestamp(path), cv2.getNumThreads()
    facts: dict[str, Any] = {"sha256": _sha256(path), **({} if stamp is None else stamp._asdict())}
    cv2.setNumThreads(1)
    try:
        found = measurement.measure(path, recipe)
    except (ValueError, OSError, ArithmeticError, cv2.error) as error:
        return Row(path, error=_error_text(error), **facts)
    finally:
        cv2.setNumThreads(threads)
    z = found.z / found.length
    profiles: dict[str, Any] = {
        name: np.interp(POSITION, z, getattr(found, name)).tolist() for name in _PROFILES[:2]
    }
    if found.braid is not None:
        for name, values in zip(
            _PROFILES[2:], (found.braid.angle, found.braid.stderr), strict=True
        ):
            at = np.interp(POSITION * found.length, found.braid.z, values)
            profiles[name] = np.degrees(at).tolist()
        facts["braid_refusal"] = found.braid.refusal
    warnings = " | ".join(found.warnings)
    return Row(path, numbers=_numbers(found), warnings=warnings, **profiles, **facts)


def _part(path: str, recipe: Recipe) -> dict[str, Any]:
    return vars(measured_row(path, recipe))


def _numbers(found: Measurement) -> dict[str, float]:
    """The columns of a measurement in SI, its quality figures after them."""
    names = (
        "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "volume",
        "volume_stderr", "px_per_m", "x0", "distance", "distance_stderr", "bow",
    )  # fmt: skip
    numbers = {name: getattr(found, name) for name in names} | {
        "max_diameter": found.maximum_diameter,
        "roll_deg": math.degrees(found.roll),
        "tilt_deg": math.degrees(found.tilt),
        **dataclasses.asdict(found.quality),
    }
    if (braid := found.braid) is not None:
        numbers |= {
            "braid_angle_deg": math.degrees(braid.mean),
            "braid_angle_deg_stderr": math.degrees(braid.mean_stderr),
            "braid_angle_resolved": braid.part,
            "yarns": braid.yarns,
            "yarns_stderr": braid.yarns_stderr,
            "turns": braid.turns,
        }
    return {name: float(value) for name, value in numbers.items()}


def _error_text(error: BaseException) -> str:
    """`ClassName: message`, on one line, without the path, which has its own column."""
    message = str(error).removeprefix(f"{getattr(error, 'path', None)}: ")
    return f"{type(error).__name__}: {' '.join(message.split())}"


def _sha256(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


@dataclasses.dataclass(frozen=True)
class Table:
    """The measurements of a campaign, in SI.

    Args:
        path: of each picture, n of them.
        error: "ClassName: message", empty where the picture was measured.
        warnings: of each picture, empty where there are none.
        sha256: of each file.
        columns: numbers by name, each of shape (n,); nan where a picture has none. `time` counts from
            the first stamped picture, `contraction` is (rest length - length) / rest length, `x0` the
            distance of the axis from the optical axis, `tilt_deg` that of the axis in depth, `bow` the
            largest deviation of the mid-line from a straight one, `yarns` those around the
            circumference in each direction; figures of quality as in `Quality`.
        diameter: at z/L = `POSITION`, shape (n, 201) [m].
        diameter_stderr: its standard error, shape (n, 201) [m].
        braid_angle: at z/L = `POSITION`, shape (n, 201) [deg]; nan where it is not resolved, as it is
            next to the tapes, and where the recipe does not ask for it.
        braid_angle_stderr: its standard error, shape (n, 201) [deg].
        rest_length: against which contraction is counted [m]; nan if no picture was measured.
        time_origin: where `time` is zero, by the camera's clock [s since 1970]; nan if no picture
            has a time stamp.
        stamp_resolution: coarsest step of the time stamps [s]; nan if there are none.
        notes: what a reader must know, in sentences.
        provenance: version, recipe, sources and their hashes.
    """

    path: tuple[str, ...]
    error: tuple[str, ...]
    warnings: tuple[str, ...]
    sha256: tuple[str, ...]
    columns: Mapping[str, Array]
    diameter: Array
    diameter_stderr: Array
    braid_angle: Array
    braid_angle_stderr: Array
    rest_length: float
    time_origin: float
    stamp_resolution: float
    notes: tuple[str, ...]
    provenance: Mapping[str, str]

    @property
    def position(self) -> Array:
        """z/L of the profiles, shape (201,)."""
        return POSITION

    @property
    def ok(self) -> np.ndarray:
        """Which pictures were measured, shape (n,)."""
        return np.array([not error for error in self.error])

    def __len__(self) -> int:
        return len(self.path)

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    @classmethod
    def from_rows(
        cls, rows: Sequence[Row], *, scale_relative_stderr: float = 0.0,
        rest_length: float | None = None, provenance: Mapping[str, str] | None = None,
    ) -> "Table":  # fmt: skip
        """The table of some pictures, in order.

        Args:
            rows: of the pictures.
            scale_relative_stderr: of px/m; it is common to all lengths, so that it cancels in the
                contraction if the rest length is one of them.
            rest_length: L0 [m]; the longest measured picture if None.
            provenance: see `Table`.
        """
        names = dict.fromkeys((*_FIRST, *(name for row in rows for name in row.numbers)))
        columns = {n: np.array([row.numbers.get(n, math.nan) for row in rows]) for n in names}
        seconds = np.array([row.seconds for row in rows])
        origin = float(np.nanmin(seconds)) if np.isfinite(seconds).any() else math.nan
        columns["time"] = np.round(seconds - origin, 6)  # what float64 keeps of a date
        steps = (row.resolution for row in rows if not row.error and row.resolution > 0)
        resolution = max(steps, default=math.nan)
        rest, note = _contract(columns, scale_relative_stderr, rest_length, rows)
        texts = {name: tuple(getattr(row, name) for row in rows) for name in _TEXTS}
        profiles: dict[str, Any] = {
            name: np.array([getattr(row, name) for row in rows]) for name in _PROFILES
        }
        return cls(
            **texts, **profiles, columns=columns, rest_length=rest, time_origin=origin,
            stamp_resolution=resolution, notes=(note, *_notes(rows, resolution)),
            provenance={**(provenance or {}), SCALE_STDERR: f"{scale_relative_stderr:.6g}"},
        )  # fmt: skip

    def rows(self, system: str = "us") -> list[dict[str, Any]]:
        """One for each picture, the unit in the name of each number; None where there is no value.

        Args:
            system: "us", "metric" or "si".
        """
        units = {name: column_unit(name, system) for name in self.columns}
        figures = {units[n][0]: values / units[n][2] for n, values in self.columns.items()}
        dates = self.time_origin + self.columns["time"]
        return [
            {
                "path": path,
                "ok": not self.error[k],
                "error": self.error[k],
                "warnings": self.warnings[k],
                "taken": date_text(dates[k]),
                **{n: finite_or_none(float(f"{values[k]:.10g}")) for n, values in figures.items()},
                "sha256": self.sha256[k],
            }
            for k, path in enumerate(self.path)
        ]

    def csv_text(self, system: str = "us") -> str:
        """One line per picture, see `rows`; an empty cell has no value."""
        return csv_text([row | {"ok": str(row["ok"]).lower()} for row in self.rows(system)])

    def to_xarray(self) -> "xarray.Dataset":
        """The table with profiles, units and provenance, in SI; needs the extra `tables`.

        Dimensions are `picture` and `position` (z/L).

        Raises:
            ImagingError: xarray is not installed.
        """
        picture, grid = "picture", ("picture", "position")
        data: dict[str, Any] = {
            "ok": (picture, self.ok.astype(np.int8)),
            "error": (picture, np.array(self.error, "U")),
            "sha256": (picture, np.array(self.sha256, "U")),
            "diameter_m": (grid, self.diameter, {"units": "m"}),
            "diameter_stderr_m": (grid, self.diameter_stderr, {"units": "m"}),
        }
        if "braid_angle_deg" in self.columns:
            for name in ("braid_angle", "braid_angle_stderr"):
                column = name.replace("angle", "angle_profile_deg")
                data[column] = grid, getattr(self, name), {"units": "degree"}
        for name, values in self.columns.items():
            column, unit, _ = column_unit(name, "si")
            data[column] = picture, values, {"units": unit} if unit else {}
        coordinates = {
            "path": (picture, np.array(self.path, "U")), "position": ("position", POSITION),
        }  # fmt: skip
        attributes = {
            "rest_length_m": self.rest_length,
            "time_origin_s": self.time_origin,
            "notes": "\n".join(self.notes),
            **self.provenance,
        }
        xarray = import_extra("xarray", "tables", ImagingError)
        return xarray.Dataset(data, coordinates, attributes)

    def write_csv(self, path: str | Path, system: str = "us") -> Path:
        """Write the CSV file, replacing an existing one."""
        Path(path).write_bytes(self.csv_text(system).encode())
        return Path(path)

    def write_netcdf(self, path: str | Path) -> Path:
        """Write a NetCDF 3 file (64-bit offsets), which every NetCDF reader can open."""
        self.to_xarray().to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
        return Path(path)


def _contract(
    columns: dict[str, np.ndarray], scale_relative_stderr: float, rest_length: float | None, rows:
    Sequence[Row],
) -> tuple[float, str]:  # fmt: skip
    """Set contraction and its error; the rest length and where it is from."""
    length, stderr = columns["length"], columns["length_stderr"]
    rest, source, relative = rest_length or math.nan, "as given, taken as exact", stderr / length
    if rest_length is None and np.isnan(length).all():
        source = "as no picture was measured"
    elif rest_length is None:
        k = int(np.nanargmax(length))
        rest, source = float(length[k]), f"that of the longest measured picture, {rows[k].path}"
        noise = np.sqrt(np.maximum(relative**2 - scale_relative_stderr**2, 0))
        relative = np.hypot(noise, noise[k])
        relative[k] = 0.0
    columns["contraction"] = 1 - length / rest
    columns["contraction_stderr"] = length / rest * relative
    return rest, f"Contraction is against the rest length {rest * 1e3:.6g} mm, {source}."


def _notes(rows: Sequence[Row], resolution: float) -> Iterator[str]:
    """On time stamps, warnings (each once, with the number of pictures that have it) and braids."""
    good = [row for row in rows if not row.error]
    if silent := sum(math.isnan(row.seconds) for row in good):
        yield f"{silent} of {len(good)} pictures have no time stamp."
    if resolution >= 1:
        yield "The time stamps are truncated to whole seconds; each picture was taken up to 1 s later."
    if warned := [row for row in rows if row.warnings]:
        first = warned[0]
        yield f"Warning, {len(warned)} of {len(rows)} pictures, first {first.path}: {first.warnings}."
    if bare := [row for row in rows if row.braid_refusal]:
        yield (
            f"{len(bare)} of {len(rows)} pictures show no braid angle, first "
            f"{Path(bare[0].path).name}: {bare[0].braid_refusal}."
        )


def process(
    paths: Iterable[str | Path], recipe: Recipe, output: str | Path | None = None,
    executor: Any = "auto", progress: Callable[[int, int], None] | None = None, *,
    rest_length: float | None = None, provenance: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """Measure the shape in every picture separately; a failed picture gives a row with the reason.

    Rows are kept in `output/parts` as soon as they are done: a campaign that was stopped or killed goes
    on with the pictures that are not there yet, where pictures and recipe are the same.

    Args:
        paths: of the pictures, all of one size; one named twice is measured once.
        recipe: how to measure, the same for all.
        output: folder for the finished rows, created if missing; None keeps them in memory only.
        executor: a number of processes, None for this one, or an executor as of `run_tasks`, whose
            workers must see the files. "auto" takes a process for each core, and this one for few pictures.
        progress: called with (pictures done, pictures) whenever some are done.
        rest_length: L0 [m] of the contraction; the longest measured picture if None.
        provenance: further entries of the table's provenance.

    Returns:
        The table, its rows in the order of the paths.

    Raises:
        ImagingError: no paths, or a folder that cannot be used.
        MixedSizes: the pictures differ in size; nothing has been measured.
        InputError: the executor cannot be used, or a worker died; the finished rows are kept.
    """
    unique: dict[str, str] = {}
    for path in paths:
        unique.setdefault(os.path.abspath(path), str(path))
    names = list(unique.values())
    if not names:
        raise ImagingError("there are no pictures to measure: name at least one")
    if (size := common_size(names)) is not None:
        recipe.camera(*size)  # refuses a crop that does not lie in its frame
    version = importlib.metadata.version("famjax")
    told = {"famjax_version": version, "recipe": recipe_text(recipe)}
    digest = hashlib.sha256(json.dumps([told, *map(_sha256, names)]).encode()).hexdigest()
    file = None if output is None else Path(output) / PARTS / f"{digest[:16]}.jsonl"
    kept = Store(file, "campaign", {}, len(names))
    if executor == "auto":
        cores, left = os.cpu_count() or 1, len(names) - len(list(kept))
        executor = cores if cores > 1 and left > _FEW else None
    work = functools.partial(_part, recipe=recipe)
    run_tasks(work, names, executor=executor, store=kept, progress=progress, names=names)
    return Table.from_rows(
        [Row(**part | {"path": name}) for part, name in zip(kept, names, strict=True)],
        scale_relative_stderr=recipe.scale.relative_stderr,
        rest_length=rest_length, provenance={**told, **(provenance or {})},
    )  # fmt: skip


def common_size(paths: Sequence[str]) -> tuple[int, int] | None:
    """Width and height of the pictures from their file headers [px]; None if no header has them.

    A file whose header cannot be read is left to the measurement, which reports what is wrong with it.

    Raises:
        MixedSizes: names the pictures that differ from the most common size.
    """
    sizes = {path: found[0] for path in paths if (found := sizes_of(path))}
    if not sizes:
        return None
    usual, most = Counter(sizes.values()).most_common(1)[0]
    others = [f"{path} ({w} x {h})" for path, (w, h) in sizes.items() if (w, h) != usual]
    if others:
        raise MixedSizes(
            "the pictures of a campaign must have the same size, because they share one scale; "
            f"{most} have {usual[0]} x {usual[1]} px, but not {some_of(others)}. Measure those separately"
        )
    return usual

"""From many photographs to one table: workers, resuming, CSV and NetCDF."""

import contextlib
import csv
import dataclasses
import functools
import hashlib
import importlib.metadata
import io
import json
import math
import os
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from famjax.boundary.errors import import_extra
from famjax.boundary.files import some_of
from famjax.boundary.tasks import Store, run_tasks
from famjax.boundary.units import factor, unit_system

from .camera import Array
from .errors import ImagingError, MixedSizes
from .measurement import Measurement, of_placement
from .photograph import Timestamp, read_timestamp, sizes_of
from .recipe import Recipe, recipe_text

if TYPE_CHECKING:
    import xarray

PARTS = "parts"
"""Folder of the finished rows in that of a campaign."""
POSITION = np.linspace(0, 1, 201)
"""Where the profiles of all pictures are given: z/L, from the upper tape edge to the lower one."""
SCALE_STDERR = "scale_relative_stderr"
"""Entry of the provenance: relative standard error of px/m, common to all lengths and diameters."""

_START = 2.0  # s, in which a worker starts: what workers save must be more
_NONE = (math.nan,) * POSITION.size
_NUMBER = re.compile(r"[-+]*[\d.]+")
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


def column_unit(name: str, system: str) -> tuple[str, float]:
    """Unit of a column, and SI per unit; a standard error has the unit of its quantity."""
    if name == "px_per_m":
        return "", factor(unit_system(system)["scale"], "scale")
    kind = _KINDS.get(name.removesuffix("_stderr"))
    unit = "" if kind is None else unit_system(system)[kind]
    return unit, 1.0 if kind is None else factor(unit, kind)


def column_name(name: str, system: str) -> str:
    """The name of a column in a file, with its unit.

    >>> column_name("length", "us"), column_name("px_per_m", "metric"), column_name("roll_deg", "us")
    ('length_in', 'px_per_mm', 'roll_deg')
    """
    unit, _ = column_unit(name, system)
    if name == "px_per_m":
        return f"px_per_{unit_system(system)['length']}"
    return f"{name}_{unit}" if unit else name


def _cf_unit(name: str) -> dict[str, str]:
    """Unit of a column in the spelling of the CF conventions, as attributes of a variable."""
    bare = name.removesuffix("_stderr")
    spelt = {"_deg": "degree", "_px": "pixel", "px_per_m": "pixel m-1"}
    by_name = (unit for end, unit in spelt.items() if bare.endswith(end))
    return {"units": column_unit(name, "si")[0] or next(by_name, "1")}


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
        angles = np.degrees(found.braid.at(POSITION * found.length)).tolist()
        profiles |= dict(zip(_PROFILES[2:], angles, strict=True))
        facts["braid_refusal"] = found.braid.refusal
    warnings = " | ".join(found.warnings)
    return Row(path, numbers=_numbers(found), warnings=warnings, **profiles, **facts)


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
        diameter: at z/L = `position`, shape (n, 201) [m].
        diameter_stderr: its standard error, shape (n, 201) [m].
        braid_angle: at z/L = `position`, shape (n, 201) [deg]; nan where it is not resolved, as it is
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

    def in_units(self, name: str, system: str) -> Array:
        """A column in the units of a system, those of `column_name`."""
        return self.columns[name] / column_unit(name, system)[1]

    def csv_text(self, system: str = "us") -> str:
        """One line per picture, the unit in the name of each column; an empty cell has no value.

        Args:
            system: "us", "metric" or "si".
        """
        numbers = {column_name(name, system): self.in_units(name, system) for name in self.columns}
        dates = self.time_origin + self.columns["time"]
        columns = {
            "path": self.path,
            "ok": ["false" if error else "true" for error in self.error],
            "error": self.error,
            "warnings": self.warnings,
            "taken": ["" if math.isnan(at) else Timestamp(at, 1e-3).text for at in dates],
            **{
                name: ["" if math.isnan(value) else f"{value:.10g}" for value in values]
                for name, values in numbers.items()
            },
            "sha256": self.sha256,
        }
        lines = csv.writer(text := io.StringIO(), lineterminator="\n")
        lines.writerow(columns)
        lines.writerows(zip(*columns.values(), strict=True))
        return text.getvalue()

    def to_xarray(self) -> "xarray.Dataset":
        """The table with profiles, units and provenance, in SI; needs the extra `tables`.

        Dimensions are `picture` and `position` (z/L).

        Raises:
            ImagingError: xarray is not installed.
        """
        picture, grid = "picture", ("picture", "position")
        data: dict[str, Any] = {
            "ok": (picture, self.ok.astype(np.int8), {"long_name": "1 where measured"}),
            "error": (picture, np.array(self.error, "U")),
            "sha256": (picture, np.array(self.sha256, "U"), {"long_name": "of the file"}),
        }
        for name, values in self.columns.items():
            data[column_name(name, "si")] = picture, values, _cf_unit(name)
        data["diameter_m"] = grid, self.diameter, {"units": "m", "long_name": "D(z), outside"}
        data["diameter_stderr_m"] = grid, self.diameter_stderr, {"units": "m"}
        if "braid_angle_deg" in self.columns:
            about = {"units": "degree", "long_name": "theta(z), nan where it is not resolved"}
            data["braid_angle_profile_deg"] = grid, self.braid_angle, about
            data["braid_angle_profile_deg_stderr"] = grid, self.braid_angle_stderr, about
        about = {"units": "1", "long_name": "z/L, from the upper tape edge to the lower one"}
        coordinates = {
            "path": (picture, np.array(self.path, "U")), "position": ("position", POSITION, about),
        }  # fmt: skip
        attributes = {
            "title": "Shape of a fluidic artificial muscle from photographs",
            "rest_length_m": self.rest_length,
            "time_origin_s": self.time_origin,
            "notes": "\n".join(self.notes),
            **self.provenance,
        }
        xarray = import_extra("xarray", "tables", ImagingError)
        return xarray.Dataset(data, coordinates, attributes)

    def write_csv(self, path: str | Path, system: str = "us") -> Path:
        """Write the CSV file, replacing an existing one."""
        with _on_disk(path, "the table cannot be written"):
            Path(path).write_bytes(self.csv_text(system).encode())
        return Path(path)

    def write_netcdf(self, path: str | Path) -> Path:
        """Write a NetCDF 3 file (64-bit offsets), which every NetCDF reader can open."""
        with _on_disk(path, "the table cannot be written"):
            self.to_xarray().to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
        return Path(path)


@contextlib.contextmanager
def _on_disk(path: str | Path, what: str) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise ImagingError(f"{what}: {error}", path=path) from None


def _contract(
    columns: dict[str, np.ndarray], scale_relative_stderr: float, rest_length: float | None, rows:
    Sequence[Row],
) -> tuple[float, str]:  # fmt: skip
    """Set contraction and its error; the rest length and where it is from."""
    length, stderr = columns["length"], columns["length_stderr"]
    if rest_length is not None:
        rest, source = rest_length, "as given, taken as exact"
        relative = stderr / length
    elif np.all(np.isnan(length)):
        columns["contraction"] = columns["contraction_stderr"] = length
        return math.nan, "No picture was measured: there is no rest length and no contraction."
    else:
        k = int(np.nanargmax(length))
        rest, source = float(length[k]), f"that of the longest measured picture, {rows[k].path}"
        noise = np.sqrt(np.maximum((stderr / length) ** 2 - scale_relative_stderr**2, 0))
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
        yield "The time stamps are cut down to whole seconds: each picture was taken up to 1 s later."
    alike: dict[str, list[str]] = {}
    for warning in (one for row in rows if row.warnings for one in row.warnings.split(" | ")):
        alike.setdefault(_NUMBER.sub("", warning), []).append(warning)  # figures may differ
    for each in alike.values():
        yield f"Warning, {len(each)} of {len(rows)} pictures: {each[0]}."
    if bare := [row for row in rows if row.braid_refusal]:
        yield (
            f"{len(bare)} of {len(rows)} pictures show no braid angle, first "
            f"{Path(bare[0].path).name}: {bare[0].braid_refusal}."
        )


class _Kept(Store):
    """The rows of a campaign, in `rows.jsonl` as soon as each is measured; a store of `run_tasks`.

    A row is known by the content of its picture and by the settings, so that pictures may be added.

    Args:
        folder: created if missing; None keeps nothing.
        settings: what a row depends on besides its picture.
        paths: of the pictures.

    Raises:
        ImagingError: the folder cannot be read or written.
    """

    def __init__(self, folder: Path | None, settings: str, paths: Sequence[str]) -> None:
        super().__init__(None, "campaign", {}, len(paths))
        self.path = None if folder is None else folder / "rows.jsonl"
        self.settings = hashlib.sha256(settings.encode()).hexdigest()
        if folder is None or self.path is None:
            return
        with _on_disk(folder, "the finished part of the campaign cannot be used"):
            folder.mkdir(parents=True, exist_ok=True)
            lines = self.path.read_bytes().splitlines() if self.path.exists() else []
        known = {}
        for line in lines:
            with contextlib.suppress(ValueError):  # a line that a stop cut short
                entry = json.loads(line)
                if entry.pop("settings") == self.settings:
                    known[entry["sha256"]] = Row(**entry)
        for k, path in enumerate(paths if known else ()):
            if row := known.get(_sha256(path)):
                self._parts[k] = dataclasses.replace(row, path=path)

    def keep(self, index: int, part: Row) -> None:
        """Keep a finished row; it is on the disk when this returns."""
        self._parts[index] = part
        if self.path is None or not part.sha256:
            return
        line = json.dumps(vars(part) | {"settings": self.settings}).encode()
        what = "the finished part of the campaign cannot be written"
        with _on_disk(self.path.parent, what), self.path.open("ab") as file:
            file.write(b"\n" + line)  # ahead of it, so that it is apart from one cut short
            file.flush()
            os.fsync(file.fileno())


def process(
    paths: Iterable[str | Path], recipe: Recipe, output: str | Path | None = None,
    executor: Any = "auto", progress: Callable[[int, int], None] | None = None, *,
    rest_length: float | None = None, provenance: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """Measure the shape in every picture separately; a failed picture gives a row with the reason.

    Rows are kept in `output/parts` as soon as they are done. A campaign that was stopped, killed or
    extended goes on with the pictures that are not there yet, or were measured otherwise: a row is known
    by the content of its picture and the recipe.

    Args:
        paths: of the pictures, all of one size; one named twice is measured once.
        recipe: how to measure, the same for all.
        output: folder for the finished rows, created if missing; None keeps them in memory only.
        executor: a number of processes, None for this one, or an executor as of `run_tasks`, whose
            workers must see the files. "auto" measures the first picture here, and takes a process for
            each core where these then save more than their start.
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
        raise ImagingError("there are no pictures to measure")
    if (size := common_size(names)) is not None:
        try:
            recipe.camera(*size)
        except ValueError as error:
            raise ImagingError(f"the recipe does not fit the pictures: {error}") from None
    version = importlib.metadata.version("famjax")
    told = {"famjax_version": version, "recipe": recipe_text(recipe)}
    kept = _Kept(None if output is None else Path(output) / PARTS, json.dumps(told), names)
    work = functools.partial(measured_row, recipe=recipe)
    run_tasks(work, names, executor=_paying(executor, work, names, kept), store=kept,
              progress=progress, names=names)  # fmt: skip
    table = Table.from_rows(
        list(kept), scale_relative_stderr=recipe.scale.relative_stderr,
        rest_length=rest_length, provenance={**told, **(provenance or {})},
    )  # fmt: skip
    notes = (f"{note[0].upper()}{note[1:]}." for note in of_placement(recipe).get("notes", ()))
    return dataclasses.replace(table, notes=(*table.notes, *notes))


def _paying(executor: Any, work: Callable[[str], Row], names: Sequence[str], kept: _Kept) -> Any:
    """The executor; for "auto" a process for each core where these save more than their start."""
    if executor != "auto":
        return executor
    if not (left := [k for k in range(len(names)) if k not in kept]):
        return None
    began, cores = time.perf_counter(), os.cpu_count() or 1
    kept.keep(left[0], work(names[left[0]]))
    each = time.perf_counter() - began
    return cores if each * (len(left) - 1) * (1 - 1 / cores) > _START else None


def common_size(paths: Sequence[str]) -> tuple[int, int] | None:
    """Width and height of the pictures from their file headers [px]; None if no header has them.

    A file whose header cannot be read is left to the measurement, which reports what is wrong with it.

    Raises:
        MixedSizes: names the pictures that differ from the most common size.
    """
    by_size: dict[tuple[int, int], list[str]] = {}
    for path in paths:
        for size in sizes_of(path)[:1]:
            by_size.setdefault(size, []).append(path)
    if len(by_size) < 2:
        return next(iter(by_size), None)
    (usual, most), *others = sorted(by_size.items(), key=lambda item: -len(item[1]))
    differing = [f"{path} ({w} x {h})" for (w, h), some in others for path in some]
    (width, height), (first, *_) = others[0]
    raise MixedSizes(
        "the pictures of a campaign must have one size, because one crop offset and one scale hold "
        f"for all; {len(most)} have {usual[0]} x {usual[1]} px, but not {some_of(differing)}. "
        "Measure them in a campaign of their own",
        path=first, width=width, height=height,
    )  # fmt: skip

"""Measure many photographs in worker processes, and collect the results in a CSV or NetCDF table."""

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

from famjax.boundary.errors import import_extra
from famjax.boundary.files import csv_text, some_of
from famjax.boundary.tasks import Store, run_tasks
from famjax.boundary.units import factor, finite_or_none, unit_system

from .camera import Array
from .errors import ImagingError, MixedSizes
from .measurement import Measurement
from .photograph import read_timestamp, sizes_of
from .recipe import Recipe, recipe_text

if TYPE_CHECKING:
    import xarray

PARTS = "parts"
"""Subfolder for the finished rows."""
POSITION = np.linspace(0, 1, 201)
"""Positions z/L at which all profiles are sampled, from the upper tape edge to the lower one."""
SCALE_STDERR = "scale_relative_stderr"
"""Provenance entry: relative standard error of px/m, common to all lengths and diameters."""

_FEW = 4  # a second process does not save time for so few pictures
_FIRST = (
    "time", "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "max_diameter",
    "volume", "volume_stderr", "contraction", "contraction_stderr", "px_per_m", "roll_deg",
)  # fmt: skip
_TEXTS = "path", "error", "warnings"
_PROFILES = "diameter", "diameter_stderr", "braid_angle", "braid_angle_stderr"
_LENGTHS = "length", "mean_diameter", "max_diameter", "x0", "distance", "bow", "displacement"
_KINDS = dict.fromkeys(_LENGTHS, "length") | {"time": "time", "log_time": "time"}
_KINDS |= {kind: kind for kind in ("volume", "force", "pressure")}
"""Kind of unit for each column; the names of all other columns include their unit."""
_BLANK: dict[str, Any] = {
    "error": "", "warnings": "", "braid_refusal": "", "numbers": {}, "seconds": math.nan,
    "resolution": math.nan, **dict.fromkeys(_PROFILES, (math.nan,) * POSITION.size),
}  # fmt: skip
"""Default entries of a row, see `measured_row`."""


def column_unit(name: str, system: str) -> tuple[str, str, float]:
    """Return a column's name in a file, its unit, and its conversion factor to SI.

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


def measured_row(path: str, recipe: Recipe) -> dict[str, Any]:
    """Measure a picture and return its row, even if the measurement fails.

    Args:
        path: path of the picture.
        recipe: measurement settings.

    Returns:
        A row that can be stored as JSON; entries that do not apply are omitted. `error` is "ClassName:
        message", and `numbers` contains the columns in SI. `diameter`, `diameter_stderr` [m], `braid_angle`
        and `braid_angle_stderr` [deg] are profiles at `POSITION`. `seconds` [s since 1970] and `resolution`
        [s] come from the time stamp. `warnings` and `braid_refusal` are messages for the user.
    """
    import cv2  # noqa: PLC0415 -- 0.1 s, and only workers need it

    from . import measurement  # noqa: PLC0415

    stamp, threads = read_timestamp(path), cv2.getNumThreads()
    row: dict[str, Any] = {"path": path, **({} if stamp is None else stamp._asdict())}
    cv2.setNumThreads(1)
    try:
        found = measurement.measure(path, recipe)
    except (ValueError, OSError, ArithmeticError, cv2.error) as error:
        message = str(error).removeprefix(f"{getattr(error, 'path', None)}: ")
        return row | {"error": f"{type(error).__name__}: {' '.join(message.split())}"}
    finally:
        cv2.setNumThreads(threads)
    row |= {"numbers": _numbers(found), "warnings": " | ".join(found.warnings)}
    for name in _PROFILES[:2]:
        row[name] = np.interp(POSITION, found.z / found.length, getattr(found, name)).tolist()
    if (braid := found.braid) is not None:
        row["braid_refusal"] = braid.refusal
        for name, values in zip(_PROFILES[2:], (braid.angle, braid.stderr), strict=True):
            at = np.interp(POSITION * found.length, braid.z, values)
            row[name] = np.degrees(at).tolist()
    return row


def _numbers(found: Measurement) -> dict[str, float]:
    """Return the columns of a measurement in SI, followed by its quality figures."""
    names = (
        "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "volume",
        "volume_stderr", "px_per_m", "x0", "distance", "distance_stderr", "bow",
    )  # fmt: skip
    numbers = {name: getattr(found, name) for name in names} | {
        "max_diameter": found.diameter.max(),
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


def _sha256(path: str) -> str:
    try:
        return hashlib.sha256(Path(path).read_bytes()).hexdigest()
    except OSError:
        return ""


@dataclasses.dataclass(frozen=True)
class Table:
    """The measurements of a campaign, in SI units.

    Args:
        path: path of each of the n pictures.
        error: "ClassName: message" for each picture, empty if it was measured.
        warnings: warnings for each picture, empty if there are none.
        columns: numerical columns by name, shape (n,); nan if not available. `time` is counted from the
            first picture with a time stamp, `contraction` is (rest length - length) / rest length, `x0` is
            the distance of the muscle's axis from the optical axis, `tilt_deg` is the tilt of the axis in
            depth, `bow` is the largest deviation of the mid-line from a straight line, and `yarns` is the
            number of yarns around the circumference in each direction. `Quality` describes the quality
            figures.
        diameter: diameter at z/L = `POSITION`, shape (n, 201) [m].
        diameter_stderr: standard error of the diameter, shape (n, 201) [m].
        braid_angle: braid angle at z/L = `POSITION`, shape (n, 201) [deg]; nan where it is not resolved
            (for example, next to the tapes) or was not requested.
        braid_angle_stderr: standard error of the braid angle, shape (n, 201) [deg].
        rest_length: rest length used for the contraction [m]; nan if no picture was measured.
        time_origin: time on the camera's clock at which `time` is zero [s since 1970]; nan if there are no
            time stamps.
        stamp_resolution: coarsest resolution of the time stamps [s]; nan if there are no time stamps.
        notes: notes on the results, for the user.
        provenance: version, recipe, sources and their hashes.
    """

    path: tuple[str, ...]
    error: tuple[str, ...]
    warnings: tuple[str, ...]
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
    def ok(self) -> np.ndarray:
        """True for each picture that was measured, shape (n,)."""
        return np.array([not error for error in self.error])

    def __len__(self) -> int:
        return len(self.path)

    def __getitem__(self, name: str) -> Array:
        return self.columns[name]

    @classmethod
    def from_rows(
        cls, rows: Sequence[Mapping[str, Any]], *, scale_relative_stderr: float = 0.0,
        rest_length: float | None = None, provenance: Mapping[str, str] | None = None,
    ) -> "Table":  # fmt: skip
        """Build the table from the rows of the pictures, in order.

        Args:
            rows: rows of the pictures, see `measured_row`; only `path` is required.
            scale_relative_stderr: relative standard error of px/m. It is common to all lengths, and cancels
                in the contraction if the rest length is one of the measured lengths.
            rest_length: rest length L0 [m]; None uses the longest measured length.
            provenance: see `Table`.
        """
        rows = _of_one_camera([{**_BLANK, **row} for row in rows])
        names = dict.fromkeys((*_FIRST, *(name for row in rows for name in row["numbers"])))
        columns = {n: np.array([row["numbers"].get(n, math.nan) for row in rows]) for n in names}
        seconds = np.array([row["seconds"] for row in rows])
        origin = float(np.nanmin(seconds)) if np.isfinite(seconds).any() else math.nan
        columns["time"] = np.round(seconds - origin, 6)  # the accuracy of a date in float64
        steps = (row["resolution"] for row in rows if not row["error"] and row["resolution"] > 0)
        resolution = max(steps, default=math.nan)
        rest, note = _contract(columns, scale_relative_stderr, rest_length, rows)
        texts: dict[str, Any] = {name: tuple(row[name] for row in rows) for name in _TEXTS}
        profiles: dict[str, Any] = {n: np.array([row[n] for row in rows]) for n in _PROFILES}
        return cls(
            **texts, **profiles, columns=columns, rest_length=rest, time_origin=origin,
            stamp_resolution=resolution, notes=(note, *_notes(rows, resolution)),
            provenance={**(provenance or {}), SCALE_STDERR: f"{scale_relative_stderr:.6g}"},
        )  # fmt: skip

    def rows(self, system: str = "us") -> list[dict[str, Any]]:
        """Return one row per picture, with units in the column names; missing numbers are None.

        Args:
            system: "us", "metric" or "si".
        """
        units = {name: column_unit(name, system) for name in self.columns}
        figures = {units[n][0]: values / units[n][2] for n, values in self.columns.items()}
        return [
            {
                "path": path,
                "ok": not self.error[k],
                "error": self.error[k],
                "warnings": self.warnings[k],
                **{n: finite_or_none(float(f"{values[k]:.10g}")) for n, values in figures.items()},
            }
            for k, path in enumerate(self.path)
        ]

    def csv_text(self, system: str = "us") -> str:
        """Return `rows` as CSV text; missing values are left empty."""
        return csv_text([row | {"ok": str(row["ok"]).lower()} for row in self.rows(system)])

    def to_xarray(self) -> "xarray.Dataset":
        """Return an xarray dataset in SI, with profiles, units and provenance.

        The dimensions are `picture` and `position` (z/L). This method requires the `tables` extra.

        Raises:
            ImagingError: xarray is not installed.
        """
        picture, grid = "picture", ("picture", "position")
        data: dict[str, Any] = {
            "ok": (picture, self.ok.astype(np.int8)),
            "error": (picture, np.array(self.error, "U")),
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

    def write_netcdf(self, path: str | Path) -> Path:
        """Write a NetCDF 3 file (64-bit offsets), which every NetCDF reader can open."""
        self.to_xarray().to_netcdf(path, engine="scipy", format="NETCDF3_64BIT")
        return Path(path)


_OTHER_CAMERA = 4.0  # standard errors of the inverse distance


def _of_one_camera(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Reject pictures in which the tapes indicate another camera distance than in the other pictures."""
    good = [k for k, row in enumerate(rows) if row["numbers"].get("distance_stderr", 0) > 0]
    distance, stderr = (
        np.array([rows[k]["numbers"][name] for k in good])
        for name in ("distance", "distance_stderr")
    )
    near, weight, good = 1 / distance, (distance**2 / stderr) ** 2, np.array(good)
    while near.size > 2:
        others = (weight @ near - weight * near) / (weight.sum() - weight)
        off = np.abs(near - others) / np.sqrt(1 / weight + 1 / (weight.sum() - weight))
        k = int(off.argmax())
        if off[k] < _OTHER_CAMERA:
            break
        error = (
            f"DistanceContradiction: the tapes indicate a camera distance of {1e3 / near[k]:.0f} mm, but "
            f"those in the other pictures indicate {1e3 / others[k]:.0f} mm. The muscle is probably "
            "bowed, or leans towards the camera: hold it straight and upright, and retake the picture"
        )
        rows[good[k]] = {**_BLANK, "path": rows[good[k]]["path"], "error": error}
        near, weight, good = (np.delete(one, k) for one in (near, weight, good))
    return rows


def _contract(
    columns: dict[str, np.ndarray], scale_relative_stderr: float, rest_length: float | None, rows:
    Sequence[Mapping[str, Any]],
) -> tuple[float, str]:  # fmt: skip
    """Set the contraction and its error; return the rest length and a note on its source."""
    length, stderr = columns["length"], columns["length_stderr"]
    rest, source, relative = (
        rest_length or math.nan,
        "stated and assumed to be exact",
        stderr / length,
    )
    if rest_length is None and not np.isnan(length).all():
        k = int(np.nanargmax(length))
        rest, source = float(length[k]), f"the longest measured length, in {rows[k]['path']}"
        noise = np.sqrt(np.maximum(relative**2 - scale_relative_stderr**2, 0))
        relative = np.hypot(noise, noise[k])
        relative[k] = 0.0
    columns["contraction"] = 1 - length / rest
    columns["contraction_stderr"] = length / rest * relative
    if math.isnan(rest):
        return rest, "The contraction cannot be computed, because the rest length is unknown."
    return rest, f"Contraction is relative to the rest length {rest * 1e3:.6g} mm, {source}."


def _notes(rows: Sequence[Mapping[str, Any]], resolution: float) -> Iterator[str]:
    """Yield notes on time stamps, warnings and braid angles."""
    good = [row for row in rows if not row["error"]]
    if silent := sum(math.isnan(row["seconds"]) for row in good):
        yield f"{silent} of {len(good)} pictures have no time stamp."
    if resolution >= 1:
        yield "The time stamps are truncated to whole seconds: pictures were taken up to 1 s later."
    for key, text in (("warnings", "have warnings"), ("braid_refusal", "have no braid angle")):
        if told := [row for row in rows if row[key]]:
            first = told[0]
            yield f"{len(told)} of {len(rows)} pictures {text}; the first is {first['path']}: {first[key]}."


def process(
    paths: Iterable[str | Path], recipe: Recipe, output: str | Path | None = None,
    executor: Any = "auto", progress: Callable[[int, int], None] | None = None, *,
    rest_length: float | None = None, provenance: Mapping[str, str] | None = None,
) -> Table:  # fmt: skip
    """Measure the muscle in each picture; if a picture cannot be measured, its row states the reason.

    Each finished row is saved in `output/parts`. A campaign that was stopped or killed resumes with the
    remaining pictures, provided that the pictures and the recipe are unchanged.

    Args:
        paths: paths of the pictures, which must all be the same size; duplicates are measured once.
        recipe: measurement settings, the same for all pictures.
        output: folder for the finished rows, created if missing; None keeps them in memory.
        executor: number of processes, None to use only this process, or an executor (see `run_tasks`)
            whose workers can access the files. "auto" uses one process per core, or only this process if
            there are few pictures.
        progress: called with (pictures done, pictures).
        rest_length: rest length L0 [m] for the contraction; None uses the longest measured length.
        provenance: further entries for the table's provenance.

    Returns:
        The table, with rows in the order of the paths.

    Raises:
        ImagingError: there are no paths, or the output folder cannot be used.
        MixedSizes: the pictures differ in size; nothing was measured.
        InputError: the executor cannot be used, or a worker died; finished rows are kept.
    """
    unique: dict[str, str] = {}
    for path in paths:
        unique.setdefault(os.path.abspath(path), str(path))
    names = list(unique.values())
    if not names:
        raise ImagingError("there are no pictures to measure: specify at least one")
    if (size := common_size(names)) is not None:
        recipe.camera(*size)  # checks that the crop lies in the frame
    version = importlib.metadata.version("famjax")
    told = {"famjax_version": version, "recipe": recipe_text(recipe)}
    digest = hashlib.sha256(json.dumps([told, *map(_sha256, names)]).encode()).hexdigest()
    file = None if output is None else Path(output) / PARTS / f"{digest[:16]}.jsonl"
    kept = Store(file, "campaign", {}, len(names))
    if executor == "auto":
        cores, left = os.cpu_count() or 1, len(names) - len(list(kept))
        executor = cores if cores > 1 and left > _FEW else None
    work = functools.partial(measured_row, recipe=recipe)
    run_tasks(work, names, executor=executor, store=kept, progress=progress, names=names)
    return Table.from_rows(
        [row | {"path": name} for row, name in zip(kept, names, strict=True)],
        scale_relative_stderr=recipe.scale.relative_stderr,
        rest_length=rest_length, provenance={**told, **(provenance or {})},
    )  # fmt: skip


def common_size(paths: Sequence[str]) -> tuple[int, int] | None:
    """Return width and height of the pictures from their headers [px]; None if no header can be read.

    Files without a readable header are ignored here; the measurement reports the cause.

    Raises:
        MixedSizes: some pictures differ from the most common size.
    """
    sizes = {path: found[0] for path in paths if (found := sizes_of(path))}
    if not sizes:
        return None
    usual, most = Counter(sizes.values()).most_common(1)[0]
    others = [f"{path} ({w} x {h})" for path, (w, h) in sizes.items() if (w, h) != usual]
    if others:
        raise MixedSizes(
            "all pictures in a campaign must be the same size, because they share one scale; "
            f"{most} are {usual[0]} x {usual[1]} px, unlike {some_of(others)}. Measure those separately"
        )
    return usual

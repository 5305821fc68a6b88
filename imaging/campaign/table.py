"""The table of a campaign: one row per picture, the profiles of all on a common grid."""

import csv
import dataclasses
import io
import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from famjax.boundary.extras import import_extra
from famjax.boundary.netcdf import Variable, netcdf_content

from ..camera.timestamps import Timestamp
from ..errors import ImagingError
from .columns import cf_unit, column_name, column_unit, describe
from .row import POSITION, Row

if TYPE_CHECKING:
    import xarray

_ALWAYS = (
    "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "max_diameter", "volume",
    "volume_stderr", "px_per_m", "roll_deg",
)  # fmt: skip
_NUMBER = re.compile(r"[-+]*[\d.]+")
_FIRST = (
    "time", "length", "length_stderr", "mean_diameter", "mean_diameter_stderr", "max_diameter",
    "volume", "volume_stderr", "contraction", "contraction_stderr",
)  # fmt: skip

SCALE_STDERR = "scale_relative_stderr"
"""Entry of the provenance: relative standard error of px/m, common to all lengths and diameters."""


@dataclass(frozen=True)
class Table:
    """What a campaign has measured, in SI.

    Args:
        path: of each picture, n of them.
        error: "ClassName: message", empty where the picture was measured.
        columns: numbers by name, each of shape (n,); nan where a picture has none.
        diameter: at z/L = `position`, shape (n, 201) [m].
        diameter_stderr: its standard error, shape (n, 201) [m].
        braid_angle: at z/L = `position`, shape (n, 201) [deg]; nan where it is not resolved, as it is
            next to the tapes, and where the recipe does not ask for it.
        braid_angle_stderr: its standard error, shape (n, 201) [deg].
        sha256: of each file.
        rest_length: against which contraction is counted [m]; nan if no picture was measured.
        time_origin: where `time` is zero, by the camera's clock [s since 1970]; nan if no picture
            has a time stamp.
        stamp_resolution: coarsest step of the time stamps [s]; nan if there are none.
        warnings: of each picture, empty where there are none.
        notes: what a reader must know, in sentences.
        provenance: version, recipe, sources and their hashes.
    """

    path: tuple[str, ...]
    error: tuple[str, ...]
    columns: Mapping[str, np.ndarray]
    diameter: np.ndarray
    diameter_stderr: np.ndarray
    braid_angle: np.ndarray
    braid_angle_stderr: np.ndarray
    sha256: tuple[str, ...]
    rest_length: float
    time_origin: float
    stamp_resolution: float
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    provenance: Mapping[str, str] = dataclasses.field(default_factory=dict)

    @property
    def position(self) -> np.ndarray:
        """z/L of the profiles, shape (201,)."""
        return POSITION

    @property
    def ok(self) -> np.ndarray:
        """Which pictures were measured, shape (n,)."""
        return np.array([not error for error in self.error])

    def __len__(self) -> int:
        return len(self.path)

    def __getitem__(self, name: str) -> np.ndarray:
        return self.columns[name]

    @classmethod
    def from_rows(
        cls,
        rows: Sequence[Row],
        *,
        scale_relative_stderr: float = 0.0,
        rest_length: float | None = None,
        provenance: Mapping[str, str] | None = None,
    ) -> "Table":
        """The table of some pictures, in their order.

        Args:
            rows: of the pictures.
            scale_relative_stderr: of px/m; it is common to all lengths, so that it cancels in the
                contraction if the rest length is one of them.
            rest_length: L0 [m]; the longest measured picture if None.
            provenance: see `Table`.
        """
        names = dict.fromkeys((*_ALWAYS, *(name for row in rows for name in row.numbers)))
        columns = {
            name: np.array([row.numbers.get(name, math.nan) for row in rows]) for name in names
        }
        seconds = np.array([row.seconds for row in rows])
        stamped = np.isfinite(seconds)
        origin = float(seconds[stamped].min()) if stamped.any() else math.nan
        resolution = max((row.resolution for row in rows if row.ok and row.resolution > 0),
                         default=math.nan)  # fmt: skip
        columns["time"] = np.round(seconds - origin, 6)  # what float64 keeps of a date
        rest, note = _contract(columns, scale_relative_stderr, rest_length, rows)
        first = [name for name in _FIRST if name in columns]
        return cls(
            path=tuple(row.path for row in rows),
            error=tuple(row.error for row in rows),
            columns={name: columns[name] for name in dict.fromkeys([*first, *columns])},
            diameter=np.array([row.diameter for row in rows]),
            diameter_stderr=np.array([row.diameter_stderr for row in rows]),
            braid_angle=np.array([row.braid_angle for row in rows]),
            braid_angle_stderr=np.array([row.braid_angle_stderr for row in rows]),
            sha256=tuple(row.sha256 for row in rows),
            rest_length=rest,
            time_origin=origin,
            stamp_resolution=resolution,
            warnings=tuple(row.warnings for row in rows),
            notes=(note, *_stamp_notes(rows, resolution), *_warned(rows), *_braid_notes(rows)),
            provenance={**(provenance or {}), SCALE_STDERR: f"{scale_relative_stderr:.6g}"},
        )

    def in_units(self, name: str, system: str) -> np.ndarray:
        """A column in the units of a system, those of `column_name`."""
        return self.columns[name] / column_unit(name, system)[1]

    def csv_text(self, system: str = "us") -> str:
        """One line per picture, the unit in the name of each column; an empty cell has no value.

        Args:
            system: "us", "metric" or "si".
        """
        columns = {column_name(name, system): self.in_units(name, system) for name in self.columns}
        text = io.StringIO()
        lines = csv.writer(text, lineterminator="\n")
        lines.writerow(["path", "ok", "error", "warnings", "taken", *columns, "sha256"])
        for k, path in enumerate(self.path):
            lines.writerow(
                [path, "false" if self.error[k] else "true", self.error[k], self._warning(k)]
                + [self._taken(k)]
                + ["" if math.isnan(v[k]) else f"{v[k]:.10g}" for v in columns.values()]
                + [self.sha256[k]]
            )
        return text.getvalue()

    def _warning(self, k: int) -> str:
        return self.warnings[k] if self.warnings else ""

    def _taken(self, k: int) -> str:
        seconds = self.time_origin + self.columns["time"][k]
        return "" if math.isnan(seconds) else Timestamp(seconds, 1e-3).text

    def to_xarray(self) -> "xarray.Dataset":
        """The table with profiles, units and provenance, in SI; needs the extra `tables`.

        Dimensions are `picture` and `position` (z/L).

        Raises:
            ImagingError: xarray is not installed.
        """
        xarray = import_extra("xarray", "tables", ImagingError)
        return xarray.Dataset(*self._variables())

    def _variables(self) -> tuple[dict[str, Variable], dict[str, Variable], dict[str, Any]]:
        """Data, coordinates and attributes of the file, in SI."""
        picture, grid = ("picture",), ("picture", "position")
        data: dict[str, Variable] = {
            "ok": (picture, self.ok.astype(np.int8), {"long_name": "1 where measured"}),
            "error": (picture, np.array(self.error, "U"), {}),
            "sha256": (picture, np.array(self.sha256, "U"), {"long_name": "of the file"}),
        }
        for name, values in self.columns.items():
            about = {"units": cf_unit(name), "long_name": describe(name) or name.replace("_", " ")}
            data[column_name(name, "si")] = picture, values, about
        data["diameter_m"] = grid, self.diameter, {"units": "m", "long_name": "D(z), outside"}
        data["diameter_stderr_m"] = grid, self.diameter_stderr, {"units": "m"}
        if "braid_angle_deg" in self.columns:
            about = {
                "units": "degree",
                "long_name": "theta(z), between yarns and circumference; nan where it is not resolved, "
                "as it is next to the tapes",
            }
            data["braid_angle_profile_deg"] = grid, self.braid_angle, about
            data["braid_angle_profile_deg_stderr"] = (
                grid, self.braid_angle_stderr, {"units": "degree"},
            )  # fmt: skip
        about = {"units": "1", "long_name": "z/L, from the upper tape edge to the lower one"}
        coordinates: dict[str, Variable] = {
            "path": (picture, np.array(self.path, "U"), {}),
            "position": (("position",), self.position, about),
        }
        attributes = {
            "title": "Shape of a fluidic artificial muscle from photographs",
            "rest_length_m": self.rest_length,
            "time_origin_s": self.time_origin,
            "notes": "\n".join(self.notes),
            **self.provenance,
        }
        return data, coordinates, attributes

    def netcdf_bytes(self) -> bytes:
        """The table as a NetCDF 3 file (64-bit offsets), which any NetCDF reader opens."""
        return netcdf_content(*self._variables())

    def write_csv(self, path: str | Path, system: str = "us") -> Path:
        """Write the CSV file; one that is there is replaced."""
        return _written(Path(path), self.csv_text(system).encode())

    def write_netcdf(self, path: str | Path) -> Path:
        """Write the NetCDF file; one that is there is replaced."""
        return _written(Path(path), self.netcdf_bytes())


def _contract(
    columns: dict[str, np.ndarray],
    scale_relative_stderr: float,
    rest_length: float | None,
    rows: Sequence[Row],
) -> tuple[float, str]:
    """Add contraction and its error; the rest length and where it is from."""
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


def _stamp_notes(rows: Sequence[Row], resolution: float) -> list[str]:
    good = [row for row in rows if row.ok]
    silent = sum(math.isnan(row.seconds) for row in good)
    notes = [f"{silent} of {len(good)} pictures have no time stamp."] if silent else []
    if resolution >= 1:
        notes.append(
            "The time stamps are cut down to whole seconds: each picture was taken up to 1 s later."
        )
    return notes


def _braid_notes(rows: Sequence[Row]) -> list[str]:
    bare = [row for row in rows if row.braid_refusal]
    if not bare:
        return []
    return [
        f"{len(bare)} of {len(rows)} pictures show no braid angle, first {Path(bare[0].path).name}: "
        f"{bare[0].braid_refusal}."
    ]


def _warned(rows: Sequence[Row]) -> list[str]:
    """Each warning once, with the number of pictures that have it; figures may differ."""
    first: dict[str, list[str]] = {}
    for row in rows:
        for warning in row.warnings.split(" | ") if row.warnings else []:
            first.setdefault(_NUMBER.sub("", warning), []).append(warning)
    return [f"Warning, {len(each)} of {len(rows)} pictures: {each[0]}." for each in first.values()]


def _written(path: Path, content: bytes) -> Path:
    try:
        path.write_bytes(content)
    except OSError as error:
        raise ImagingError(f"the table cannot be written: {error}", path=str(path)) from None
    return path

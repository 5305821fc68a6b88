"""The log of a test machine: displacement, force and pressure over the machine's own time."""

import csv
import hashlib
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from famjax.boundary.units import UNITS, factor

from ..errors import ImagingError

_COLUMNS = {
    "time": "time", "displacement": "length", "force": "force", "pressure": "pressure"
}  # fmt: skip
"""Kind of each quantity that a log may hold."""


@dataclass(frozen=True)
class MachineLog:
    """What a test machine recorded, in SI.

    Args:
        time: by the machine's clock, rising, shape (n,) [s].
        displacement: of the crosshead, either sense, shape (n,) [m].
        force: shape (n,) [N], None where the log has no such column.
        pressure: gauge, shape (n,) [Pa], None where the log has no such column.
        source: where it came from, for messages and provenance.
        sha256: of the file.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray | None = None
    pressure: np.ndarray | None = None
    source: str = "arrays"
    sha256: str = ""

    def __post_init__(self) -> None:
        """Refuse arrays that do not belong together.

        Raises:
            ImagingError: lengths differ, fewer than two rows, not finite, or time does not rise.
        """
        for name in _COLUMNS:
            values = getattr(self, name)
            if values is None:
                continue
            values = np.asarray(values, float)
            object.__setattr__(self, name, values)
            if values.shape != (len(self.time),) or len(values) < 2:
                raise ImagingError(
                    f"{self.source}: a log has at least two rows, as many of {name} as of time; "
                    f"got the shape {values.shape} beside {len(self.time)} times"
                )
            if not np.all(np.isfinite(values)):
                raise ImagingError(
                    f"{self.source}: {name} must be finite, but row {_first_bad(values)} is not"
                )
        steps = np.diff(self.time)
        if not np.all(steps > 0):
            at = int(np.argmin(steps > 0))
            raise ImagingError(
                f"{self.source}: time must rise from row to row, but "
                f"{self.time[at + 1]:g} s follows {self.time[at]:g} s; sort the log, "
                "or remove what was recorded twice"
            )

    def at(
        self, name: str, time: np.ndarray, time_stderr: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """A channel at given times by straight lines between the rows, with what that may be off.

        stderr^2 = (F' time_stderr)^2 + (F'' (t - t_k)(t_{k+1} - t)/2)^2, both derivatives from
        divided differences of the rows about t. The sensor's own noise is not in it.

        Args:
            name: "displacement", "force" or "pressure".
            time: by the machine's clock, shape (m,) [s].
            time_stderr: standard error of `time` [s].

        Returns:
            Values and standard errors, shape (m,); nan outside the log.

        Raises:
            ImagingError: the log has no such channel.
        """
        values = getattr(self, name) if name in _COLUMNS else None
        if values is None:
            raise ImagingError(f"{self.source}: the log has no channel {name!r}")
        time, stderr = np.broadcast_arrays(np.asarray(time, float), time_stderr)
        found = np.interp(time, self.time, values, left=np.nan, right=np.nan)
        k = np.clip(np.searchsorted(self.time, time, side="right") - 1, 0, len(self.time) - 2)
        slope = np.diff(values) / np.diff(self.time)
        bend = np.zeros(len(slope))
        if len(slope) > 1:
            inner = np.abs(np.diff(slope)) / ((self.time[2:] - self.time[:-2]) / 2)
            bend = np.maximum(np.append(inner, inner[-1]), np.append(inner[0], inner))
        chord = bend[k] * (time - self.time[k]) * (self.time[k + 1] - time) / 2
        return found, np.where(np.isnan(found), np.nan, np.hypot(slope[k] * stderr, chord))


def read_machine_log(path: str | Path) -> MachineLog:
    """A machine log from a CSV file whose columns name their units.

    `time` and `displacement` are needed, `force` and `pressure` (gauge) are optional, each with its
    unit: `time_s,displacement_in,force_lbf,pressure_psi`. Other columns are left alone if their
    names are none of these. Lines that start with `#` are comments.

    Args:
        path: the file, UTF-8, separated by comma, semicolon or tab.

    Returns:
        The log in SI.

    Raises:
        ImagingError: no such file, a column missing, without unit or with an unknown one, a cell
            that is no number, or time that does not rise.
    """
    path = Path(path)
    try:
        content = path.read_bytes()
        lines = content.decode("utf-8-sig").splitlines()
    except OSError as error:
        raise ImagingError(f"the log cannot be read: {error.strerror}", path=str(path)) from None
    except UnicodeDecodeError:
        raise ImagingError(
            "the log is not a UTF-8 text file; save it as CSV, UTF-8", path=str(path)
        ) from None
    rows = [
        (k, line) for k, line in enumerate(lines, 1) if line.strip() and line.lstrip()[0] != "#"
    ]
    if len(rows) < 3:
        raise ImagingError(
            f"a log has a header such as time_s,displacement_in,force_lbf and at least two rows; "
            f"got {len(rows)} lines",
            path=str(path),
        )
    separator = max(",;\t", key=rows[0][1].count)
    header = [name.strip() for name in next(csv.reader([rows[0][1]], delimiter=separator))]
    units = _units_of(header, str(path))
    values: dict[str, list[float]] = {header[at]: [] for at in units}
    for number, line in rows[1:]:
        cells = next(csv.reader([line], delimiter=separator))
        if len(cells) != len(header):
            raise ImagingError(
                f"row {number} has {len(cells)} cells, the header has {len(header)}",
                path=str(path),
            )
        for at in units:
            values[header[at]].append(_number(cells[at], number, header[at], str(path)))
    columns = {
        quantity: np.array(values[header[at]]) * multiplier
        for at, (quantity, multiplier) in units.items()
    }
    return MachineLog(**columns, source=str(path), sha256=hashlib.sha256(content).hexdigest())


def _units_of(header: list[str], path: str) -> dict[int, tuple[str, float]]:
    """(quantity, multiplier to SI) of every column of a quantity that is known, by position."""
    found: dict[int, tuple[str, float]] = {}
    for at, name in enumerate(header):
        quantity, _, unit = name.partition("_")
        if quantity not in _COLUMNS:
            continue
        kind = _COLUMNS[quantity]
        if unit not in UNITS[kind]:
            what = f"the unknown unit {unit!r}" if unit else "no unit"
            raise ImagingError(
                f"the column {name!r} has {what}; name it for example "
                f"{quantity}_{next(reversed(UNITS[kind]))}; known units of {kind} are: "
                f"{', '.join(UNITS[kind])}",
                path=path,
            )
        if quantity in [known for known, _ in found.values()]:
            raise ImagingError(f"the quantity {quantity!r} has two columns; keep one", path=path)
        found[at] = quantity, factor(unit, kind)
    for needed in ("time", "displacement"):
        if needed not in [known for known, _ in found.values()]:
            raise ImagingError(
                f"a log needs a column for {needed} with its unit, for example "
                f"{needed}_{next(reversed(UNITS[_COLUMNS[needed]]))}; got {', '.join(header)}",
                path=path,
            )
    return found


def _number(cell: str, row: int, column: str, path: str) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise ImagingError(
            f"row {row} has {cell.strip()!r} for {column}, which is not a finite number", path=path
        )
    return value


def _first_bad(values: np.ndarray) -> int:
    return int(np.argmin(np.isfinite(values)))

"""The log of a test machine: displacement, force and pressure over the machine's own time."""

import dataclasses
import hashlib
import math
from collections.abc import Collection, Mapping
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError

from .log_header import KINDS, columns as find_columns
from .log_text import LogText, decoded, number, split

_LATE = 1.5  # of the usual interval: a longer one is a gap


@dataclasses.dataclass(frozen=True)
class Gap:
    """Rows that a log lacks.

    Attributes:
        after: time [s] of the last row before it.
        rows: how many are missing, by the usual interval.
    """

    after: float
    rows: int


@dataclasses.dataclass(frozen=True)
class MachineLog:
    """What a test machine recorded, in SI and on its own clock.

    Attributes:
        time: [s], rising, shape (n,).
        displacement: [m], with the machine's own sign and zero, shape (n,).
        force: [N], with the machine's own sign, shape (n,); None where the log has none.
        pressure: gauge [Pa], shape (n,); None where the log has none, or where it was not asked for.
        others: every other column of numbers, as printed, by its name.
        interval: the usual time between two rows [s].
        gaps: rows that are missing; nothing is filled in.
        unread: line numbers between the first and the last row whose cells are not numbers.
        repeated: line numbers whose time is that of the row before, which are left out.
        source: the file.
        sha256: of the file.
        form: encoding, delimiter and decimal sign, for the record.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray | None = None
    pressure: np.ndarray | None = None
    others: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    interval: float = math.nan
    gaps: tuple[Gap, ...] = ()
    unread: tuple[int, ...] = ()
    repeated: tuple[int, ...] = ()
    source: str = "arrays"
    sha256: str = ""
    form: str = ""

    def __post_init__(self) -> None:
        """Refuse arrays that do not belong together.

        Raises:
            InputError: lengths differ, fewer than two rows, not finite, or time does not rise.
        """
        for name in KINDS:
            values = getattr(self, name)
            if values is None:
                continue
            values = np.asarray(values, float)
            object.__setattr__(self, name, values)
            if values.shape != (len(self.time),) or len(values) < 2:
                raise InputError(
                    f"{self.source}: a log has at least two rows, as many of {name} as of time; "
                    f"got the shape {values.shape} beside {len(self.time)} times"
                )
            if not np.all(np.isfinite(values)):
                first = int(np.argmin(np.isfinite(values)))
                raise InputError(f"{self.source}: {name} must be finite, but row {first} is not")
        steps = np.diff(self.time)
        if not np.all(steps > 0):
            at = int(np.argmin(steps > 0))
            raise InputError(
                f"{self.source}: time must rise from row to row, but "
                f"{self.time[at + 1]:g} s follows {self.time[at]:g} s; sort the log, "
                "or remove what was recorded twice"
            )

    @property
    def missing_rows(self) -> int:
        """How many rows are missing in all gaps."""
        return sum(gap.rows for gap in self.gaps)

    def channel(self, name: str) -> np.ndarray:
        """A channel [SI] by its name.

        Raises:
            InputError: the log has no such channel.
        """
        values = getattr(self, name) if name in KINDS else None
        if values is None:
            raise InputError(f"{self.source}: the log has no channel {name!r}")
        return values

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
            InputError: the log has no such channel.
        """
        values = self.channel(name)
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


def read_machine_log(
    path: str | Path,
    *,
    columns: Mapping[str, str] | None = None,
    units: Mapping[str, str] | None = None,
    decimal: str | None = None,
    needed: Collection[str] = ("time", "displacement", "force"),
    welcome: Collection[str] = (),
) -> MachineLog:
    """The log of a test machine, from a delimited text in any usual encoding.

    The block of numbers, the names above it and the units, in the names or in a row of their own,
    are found; a time may be a number or hh:mm:ss. Nothing is interpolated and no unit is guessed.

    Args:
        path: the file: UTF-8, UTF-16 or cp1252; tab, semicolon, comma, bar or blanks.
        columns: name, or number from 1, of the column of "time", "displacement" or "force", where
            the log's own names do not tell.
        units: unit of "time", "displacement" or "force", in place of the log's.
        decimal: "." or ",", where the numbers do not tell.
        needed: quantities that the log must hold.
        welcome: those that it may hold, "pressure" (gauge) among them.

    Returns:
        The log in SI, with the rows that it lacks.

    Raises:
        InputError: what is wrong with the file, with the number of the line.
    """
    path = Path(path)
    for option in (columns, units):
        unknown = set(option or ()) - set(KINDS)
        if unknown:
            raise InputError(f"{', '.join(sorted(unknown))} is none of {', '.join(KINDS)}")
    text, encoding = decoded(path)
    try:
        cells = split(text, decimal)
        found, names = find_columns(cells, columns or {}, units or {}, needed, welcome)
        lines, table, unread = _numbers(cells, [index for index, _ in found.values()])
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    used = {index for index, _ in found.values()}
    values = {quantity: table[:, index] * factor for quantity, (index, factor) in found.items()}
    step = np.diff(values["time"])
    back = np.flatnonzero(step < 0)
    if back.size:
        raise InputError(
            f"{path}: time goes back from {values['time'][back[0]]:.6g} s to "
            f"{values['time'][back[0] + 1]:.6g} s at line {lines[back[0] + 1]}: a file must hold one "
            "test; split it there"
        )
    keep = np.concatenate([[True], step > 0])
    repeated = tuple(np.asarray(lines)[~keep].tolist())
    values = {name: value[keep] for name, value in values.items()}
    if values["time"].size < 2:
        raise InputError(f"{path}: one row of numbers makes no log")
    interval, gaps = _gaps(values["time"])
    others = {
        name if names.count(name) == 1 else f"{name} [{k + 1}]": table[keep, k]
        for k, name in enumerate(names)
        if k not in used and not np.isnan(table[keep, k]).all()
    }
    form = f"{encoding}, delimiter {cells.delimiter!r}, decimal {cells.decimal!r}"
    return MachineLog(**values, others=others, interval=interval, gaps=gaps, unread=unread,
                      repeated=repeated, source=str(path),
                      sha256=hashlib.sha256(path.read_bytes()).hexdigest(), form=form)  # fmt: skip


def _numbers(cells: LogText, needed: list[int]) -> tuple[list[int], np.ndarray, tuple[int, ...]]:
    """Line numbers and values of the rows of numbers, and the lines among them that are none.

    A cell that is no number is nan in a column that is not needed.
    """
    lines, rows, others = [], [], []
    for line, row in cells.rows[cells.first :]:
        values = [number(cell, cells.decimal) for cell in row]
        if len(values) == cells.n_columns and all(values[k] is not None for k in needed):
            lines.append(line)
            rows.append([np.nan if value is None else value for value in values])
        else:
            others.append(line)
    if not rows:
        raise InputError("no row has numbers in all the columns that are needed")
    return lines, np.array(rows, float), tuple(line for line in others if line < lines[-1])


def _gaps(time: np.ndarray) -> tuple[float, tuple[Gap, ...]]:
    step = np.diff(time)
    interval = float(np.median(step))
    late = np.flatnonzero(step > _LATE * interval)
    return interval, tuple(
        Gap(float(time[k]), max(1, round(float(step[k]) / interval) - 1)) for k in late
    )

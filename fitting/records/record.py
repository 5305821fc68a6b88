"""What records share: checked columns, a test machine's log, the branches between turning points."""

import dataclasses
import itertools
import math
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError
from famjax.tables import check_time, read_table

Column = Float[np.ndarray, " n"]

_CHANNELS = ("time", "displacement", "force", "pressure")

_HOLD_WIDTH = 6.0  # standard deviations of the noise within which a hold lies
_LATE = 1.5  # of the usual interval: a longer one is a gap


def checked_columns(
    columns: Mapping[str, ArrayLike | None], *, least: int = 3
) -> dict[str, Column | None]:
    """The columns of a record as float arrays of one length, those that are None left so.

    Args:
        columns: by name; `time` must not run backwards.
        least: number of readings.

    Raises:
        InputError: another shape, too few readings, a value that is not finite, or a time that runs
            backwards.
    """
    arrays = {
        name: None if values is None else np.asarray(values, float)
        for name, values in columns.items()
    }
    known = {name: values for name, values in arrays.items() if values is not None}
    if (
        len({values.shape for values in known.values()}) != 1
        or next(iter(known.values())).ndim != 1
    ):
        shapes = ", ".join(f"{name} of shape {values.shape}" for name, values in known.items())
        raise InputError(
            f"all columns of a record must be one-dimensional and equally long; got {shapes}"
        )
    for name, values in known.items():
        if values.size < least:
            raise InputError(f"a record needs at least {least} readings, got {values.size}")
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name} of reading {bad[0] + 1} is {values[bad[0]]}; every value must be finite: "
                "remove the reading"
            )
    back = np.flatnonzero(np.diff(known.get("time", np.empty(0))) < 0)
    if back.size:
        raise InputError(
            f"time must not run backwards, and does at reading {back[0] + 2}: sort the record, or "
            "split it there"
        )
    return arrays


def set_columns(record: Any, *names: str, least: int = 3) -> None:
    """Check these columns of a frozen record, and keep them as float arrays."""
    columns = {name: getattr(record, name) for name in names}
    for name, values in checked_columns(columns, least=least).items():
        object.__setattr__(record, name, values)


def check_positive(**values: float | int) -> None:
    """Refuse sizes that are not > 0 and finite.

    Raises:
        InputError: the first that is not, by its name.
    """
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} must be > 0 and finite, got {value} in SI units")


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
        gaps: rows that are missing, as time [s] of the last row before and number of rows by the usual
            interval; nothing is filled in.
        unread: line numbers between the first and the last row whose cells are not numbers.
        repeated: line numbers whose time is that of the row before, which are left out.
        source: the file.
        sha256: of the file.
        taken: what its columns were taken as, for the command that read it.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray | None = None
    pressure: np.ndarray | None = None
    others: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    interval: float = math.nan
    gaps: tuple[tuple[float, int], ...] = ()
    unread: tuple[int, ...] = ()
    repeated: tuple[int, ...] = ()
    source: str = "arrays"
    sha256: str = ""
    taken: str = ""

    def __post_init__(self) -> None:
        set_columns(self, *_CHANNELS, least=2)
        if np.any(np.diff(self.time) <= 0):
            raise InputError(
                f"{self.source}: time must rise from row to row: sort the log, or remove what was "
                "recorded twice"
            )

    @property
    def missing_rows(self) -> int:
        """How many rows are missing in all gaps."""
        return sum(rows for _, rows in self.gaps)

    def channel(self, name: str) -> np.ndarray:
        """A channel [SI] by its name.

        Raises:
            InputError: the log has no such channel.
        """
        values = getattr(self, name) if name in _CHANNELS else None
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
    needed: Collection[str] = ("time", "displacement", "force"),
    welcome: Collection[str] = (),
) -> MachineLog:
    """The log of a test machine, from a text or workbook of any maker and country.

    Args:
        path: the file, see `famjax.tables.read_table`.
        columns: which column is which of "time", "displacement", "force" and "pressure", where the log's
            own names do not tell, `{"force": "Load 2 [N]"}`; also `decimal` and `atmosphere`.
        needed: quantities that the log must hold.
        welcome: those that it may hold, "pressure" (gauge) among them.

    Returns:
        The log in SI, with the rows that it lacks.

    Raises:
        InputError: what is wrong with the file, with the number of the line.
    """
    table = read_table(path, tuple(needed), optional=welcome, columns=columns, fewest=3)
    try:
        keep = check_time(table)
        if keep.sum() < 2:
            raise InputError("a log needs at least two rows")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    time = table.columns["time"][keep]
    step = np.diff(time)
    interval = float(np.median(step))
    late = np.flatnonzero(step > _LATE * interval)
    return MachineLog(
        **{quantity: values[keep] for quantity, values in table.columns.items()},
        others={name: values[keep] for name, values in table.others.items() if np.isfinite(values).any()},
        interval=interval,
        gaps=tuple((float(time[k]), max(1, round(float(step[k]) / interval) - 1)) for k in late.tolist()),
        unread=table.unread,
        repeated=tuple(table.lines[~keep].tolist()),
        source=str(path),
        sha256=table.sha256,
        taken=table.said(),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Branch:
    """A stretch of a record in which the position moves one way.

    Attributes:
        start, stop: first row, and the row after the last.
        rising: the position grows.
    """

    start: int
    stop: int
    rising: bool

    @property
    def rows(self) -> slice:
        """The branch's rows of any column."""
        return slice(self.start, self.stop)


def split_branches(
    position: ArrayLike, *, min_travel: float = 0.5, hold: float | None = None
) -> tuple[Branch, ...]:
    """The branches of a record, found by its turning points; noise and holds do not count as such.

    A turning point is an extreme from which the position comes back by at least `min_travel`.
    Readings at either end of a branch that are within a hold of the extreme are left out.

    Args:
        position: displacement, length or pressure in the order of time, shape (n,).
        min_travel: least travel of a branch, as a fraction of the record's range, in (0, 1).
        hold: how far the position may move in a hold; None for six standard deviations of its noise
            (from second differences), but no more than 2 % of the range.

    Returns:
        The branches in order, rising and falling in turn; none where nothing moves.

    Raises:
        InputError: `min_travel` outside (0, 1), or a bad column.

    >>> [(b.start, b.stop, b.rising) for b in split_branches([0, 0, 1, 2, 3, 3, 3, 2, 1, 0])]
    [(1, 5, True), (6, 10, False)]
    """
    if not 0 < min_travel < 1:
        raise InputError(f"min_travel is a fraction of the range in (0, 1), got {min_travel}")
    x = checked_columns({"position": position})["position"]
    assert x is not None
    travel = float(np.ptp(x))
    width = min(_HOLD_WIDTH * noise_of(x), 0.02 * travel) if hold is None else hold
    branches = []
    for start, stop in itertools.pairwise(_turning_points(x, min_travel * travel)):
        rising = bool(x[stop] > x[start])
        way = (x[start : stop + 1] - x[start]) * (1 if rising else -1)
        arrival = int(np.flatnonzero(way >= way[-1] - width)[0])
        departure = int(np.flatnonzero(way[:arrival] <= width)[-1])
        branches.append(Branch(start + departure, start + arrival + 1, rising))
    return tuple(branches)


def noise_of(values: Column) -> float:
    """Standard deviation of white noise on a smooth signal, by the median second difference."""
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6.0)))


def _turning_points(x: Column, travel: float) -> list[int]:
    """Rows of alternating extremes between which x changes by `travel` or more, the outermost included."""
    turns: list[int] = []
    low = high = best = direction = 0
    for i, value in enumerate(x.tolist() if travel > 0 else ()):
        if direction == 0:
            low, high = (i if value < x[low] else low), (i if value > x[high] else high)
            if x[high] - x[low] >= travel:
                direction = 1 if high > low else -1
                turns, best = [min(low, high)], max(low, high)
        elif direction * (value - x[best]) > 0:
            best = i
        elif direction * (x[best] - value) >= travel:
            turns.append(best)
            best, direction = i, -direction
    return [*turns, best] if direction else []

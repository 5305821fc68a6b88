"""Code shared by all records: column checks, machine logs, and branches between turning points."""

import dataclasses
import itertools
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

_HOLD_WIDTH = 6.0  # width of a hold, in standard deviations of the noise
_LATE = 1.5  # shortest gap, in usual intervals


def checked_columns(
    columns: Mapping[str, ArrayLike | None], *, least: int = 3
) -> dict[str, Column | None]:
    """Return the columns of a record as float arrays of equal length; None is left unchanged.

    Args:
        columns: columns by name; `time` must not decrease.
        least: smallest number of readings.

    Raises:
        InputError: shapes differ, there are too few readings, a value is not finite, or time decreases.
    """
    arrays = {
        name: None if values is None else np.asarray(values, float)
        for name, values in columns.items()
    }
    known = {name: values for name, values in arrays.items() if values is not None}
    sizes = {values.shape for values in known.values()}
    if len(sizes) != 1 or len(next(iter(sizes))) != 1:
        shapes = ", ".join(f"{name} of shape {values.shape}" for name, values in known.items())
        raise InputError(
            f"all columns of a record must be one-dimensional and have the same length; got {shapes}"
        )
    if (count := next(iter(sizes))[0]) < least:
        raise InputError(f"a record needs at least {least} readings, got {count}")
    for name, values in known.items():
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            raise InputError(
                f"{name} of reading {bad[0] + 1} is {values[bad[0]]}; every value must be finite: "
                "remove the reading"
            )
    back = np.flatnonzero(np.diff(known.get("time", np.empty(0))) < 0)
    if back.size:
        raise InputError(
            f"time must not run backwards, but it does at reading {back[0] + 2}: sort the record, or "
            "split it there"
        )
    return arrays


def set_columns(record: Any, *names: str, least: int = 3) -> None:
    """Check columns of a frozen record and convert them to float arrays."""
    columns = {name: getattr(record, name) for name in names}
    for name, values in checked_columns(columns, least=least).items():
        object.__setattr__(record, name, values)


def check_positive(**values: float | int) -> None:
    """Reject values that are not positive and finite.

    Raises:
        InputError: a value is invalid; the message states which.
    """
    for name, value in values.items():
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{name} must be > 0 and finite, got {value} in SI units")


@dataclasses.dataclass(frozen=True)
class MachineLog:
    """Log of a test machine in SI, on the machine's clock.

    Attributes:
        time: times [s], increasing, shape (n,).
        displacement: displacements [m] with the machine's sign and zero, shape (n,).
        force: forces [N] with the machine's sign, shape (n,), or None.
        pressure: gauge pressures [Pa], shape (n,), or None.
        others: other numeric columns by name, unconverted.
        missing_rows: number of rows missing between other rows; they are not filled in.
        unread: line numbers of rows that contain cells that are not numbers.
        source: name of the file.
        sha256: hash of the file.
        taken: how the columns of the file were interpreted; commands print it.
    """

    time: np.ndarray
    displacement: np.ndarray
    force: np.ndarray | None = None
    pressure: np.ndarray | None = None
    others: Mapping[str, np.ndarray] = dataclasses.field(default_factory=dict)
    missing_rows: int = 0
    unread: tuple[int, ...] = ()
    source: str = "arrays"
    sha256: str = ""
    taken: str = ""

    def __post_init__(self) -> None:
        set_columns(self, *_CHANNELS, least=2)
        if np.any(np.diff(self.time) <= 0):
            raise InputError(
                f"{self.source}: time must increase from row to row: sort the log, or remove rows that "
                "were recorded twice"
            )

    def channel(self, name: str) -> np.ndarray:
        """Return a channel in SI.

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
        """Interpolate a channel linearly at given times, and return the standard errors as well.

        stderr^2 = (F' time_stderr)^2 + (F'' (t - t_k)(t_{k+1} - t)/2)^2, where both derivatives are
        divided differences of the rows around t. Sensor noise is not included.

        Args:
            name: "displacement", "force" or "pressure".
            time: times on the machine's clock [s], shape (m,).
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
    """Read the log of a test machine from a text file or workbook in any common format.

    Args:
        path: the file, see `famjax.tables.read_table`.
        columns: column name of each quantity ("time", "displacement", "force", "pressure") that cannot be
            recognised, `{"force": "Load 2 [N]"}`; also `decimal` and `atmosphere`.
        needed: quantities that the file must contain.
        welcome: quantities that it may contain, such as "pressure" (gauge).

    Returns:
        The log in SI.

    Raises:
        InputError: the file is invalid; the message states the line.
    """
    table = read_table(path, tuple(needed), optional=welcome, columns=columns, fewest=3)
    try:
        keep = check_time(table)
        if keep.sum() < 2:
            raise InputError("a log needs at least two rows")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    time = table.columns["time"][keep]
    step = np.diff(time) / np.median(np.diff(time))
    late = step[step > _LATE]
    return MachineLog(
        **{quantity: values[keep] for quantity, values in table.columns.items()},
        others={name: values[keep] for name, values in table.others.items() if np.isfinite(values).any()},
        missing_rows=int(np.maximum(1, np.round(late) - 1).sum()),
        unread=table.unread,
        source=str(path),
        sha256=table.sha256,
        taken=table.said(),
    )  # fmt: skip


@dataclasses.dataclass(frozen=True)
class Branch:
    """Part of a record in which the position changes monotonically.

    Attributes:
        start, stop: first row, and the row after the last.
        rising: True if the position increases.
    """

    start: int
    stop: int
    rising: bool


def split_branches(
    position: ArrayLike, *, min_travel: float = 0.5, hold: float | None = None
) -> tuple[Branch, ...]:
    """Split a record into branches at its turning points; noise and holds are ignored.

    A turning point is an extreme from which the position returns by at least `min_travel`. Readings
    within a hold of the extremes are left out at both ends of a branch.

    Args:
        position: displacement, length or pressure in chronological order, shape (n,).
        min_travel: smallest travel of a branch, as a fraction of the range, in (0, 1).
        hold: largest change of position in a hold. None uses six standard deviations of the noise (from
            second differences), but at most 2 % of the range.

    Returns:
        The branches in order, alternately rising and falling; empty if the position does not change.

    Raises:
        InputError: `min_travel` is outside (0, 1), or the column is invalid.

    >>> [(b.start, b.stop, b.rising) for b in split_branches([0, 0, 1, 2, 3, 3, 3, 2, 1, 0])]
    [(1, 5, True), (6, 10, False)]
    """
    if not 0 < min_travel < 1:
        raise InputError(
            f"min_travel, a fraction of the range, must be in (0, 1), got {min_travel}"
        )
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
    """Estimate the standard deviation of white noise on a smooth signal from second differences."""
    return float(np.median(np.abs(np.diff(values, 2))) / (0.6745 * np.sqrt(6.0)))


def _turning_points(x: Column, travel: float) -> list[int]:
    """Return the rows of alternating extremes that differ by at least `travel`."""
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

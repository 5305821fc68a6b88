"""What all records share: columns that are read and checked, and the branches between turning points."""

import dataclasses
import itertools
import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from numpy.typing import ArrayLike

from famjax.boundary.errors import InputError
from famjax.boundary.files import csv_lines
from famjax.boundary.units import UNITS

Column = Float[np.ndarray, " n"]

_HOLD_WIDTH = 6.0  # standard deviations of the noise within which a hold lies
_MICROSECOND = {"us": 1e-6}  # microcontrollers count them


def read_columns(
    path: str | Path,
    quantities: Collection[str],
    *,
    optional: Collection[str] = (),
    names: str | Sequence[str] | None = None,
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    """The columns of a CSV file whose names have their units, as in `time_s,length_mm`.

    Args:
        path: UTF-8, separated by comma, semicolon or tab; lines that start with `#` are comments.
        quantities: that the file must hold, each also its kind of unit.
        optional: those that it may hold; one that is no kind of unit has no unit.
        names: of the columns, where the header has none or there is no header; `-` leaves a column
            out.

    Returns:
        SI values and unit of each quantity.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    lines = csv_lines(path)
    try:
        return _columns(lines, quantities, optional, names)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _columns(
    lines: Sequence[str],
    quantities: Collection[str],
    optional: Collection[str],
    names: str | Sequence[str] | None,
) -> tuple[dict[str, np.ndarray], dict[str, str]]:
    units = {name: UNITS.get(name, {}) for name in (*quantities, *optional)}
    units["time"] = UNITS["time"] | _MICROSECOND
    example = ",".join(f"{name}_{next(iter(units[name]))}" for name in quantities)
    rows = [
        (number, line)
        for number, line in enumerate(lines, 1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    if not rows:
        raise InputError(f"the file is empty; it needs a header such as {example} and readings")
    separator = max(",;\t", key=rows[0][1].count)
    first = [cell.strip(' "') for cell in rows[0][1].split(separator)]
    headed = not any(_is_number(cell) for cell in first)
    if names is None and not headed:
        raise InputError(f"no header names the columns: give them, as in columns={example!r}")
    given = names.split(",") if isinstance(names, str) else names
    header = first if given is None else [name.strip() for name in given]
    columns = [(k, name, *_quantity(name, units)) for k, name in enumerate(header) if name != "-"]
    found = [quantity for _, _, quantity, _ in columns]
    twice = next((quantity for quantity in found if found.count(quantity) > 1), None)
    if twice is not None:
        raise InputError(f"the quantity {twice!r} has two columns; keep one")
    missing = [quantity for quantity in quantities if quantity not in found]
    if missing:
        raise InputError(
            f"no column for {' and '.join(missing)} among {', '.join(header)}; the file needs "
            f"columns with their units, as in {example}"
        )
    values = np.zeros((len(rows) - headed, len(columns)))
    for row, (number, line) in enumerate(rows[headed:]):
        cells = line.split(separator)
        if len(cells) != len(header):
            raise InputError(f"row {number} has {len(cells)} cells for {len(header)} columns")
        for column, (k, name, _, _) in enumerate(columns):
            if not _is_number(cells[k]):
                hint = " (write a decimal point)" if "," in cells[k] else ""
                raise InputError(
                    f"row {number}: {name} is {cells[k].strip()!r}, not a number{hint}"
                )
            values[row, column] = float(cells[k])
    return (
        {
            quantity: units[quantity].get(unit, 1.0) * values[:, column]
            for column, (_, _, quantity, unit) in enumerate(columns)
        },
        {quantity: unit for _, _, quantity, unit in columns},
    )


def _quantity(name: str, units: Mapping[str, Mapping[str, float]]) -> tuple[str, str]:
    """Quantity and unit of a column's name."""
    if name in units and not units[name]:
        return name, ""
    quantity, _, unit = name.rpartition("_")
    if unit not in units.get(quantity, {}):
        known = "; ".join(
            f"{one}_ with {', '.join(of)}" if of else one for one, of in units.items()
        )
        raise InputError(f"unknown column {name!r}; known are {known}; and - for none of them")
    return quantity, unit


def _is_number(cell: str) -> bool:
    try:
        return math.isfinite(float(cell))
    except ValueError:
        return False


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

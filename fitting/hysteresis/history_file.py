"""A history of lengths and pressures from a CSV file whose columns name their units."""

import csv
import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.files import csv_lines
from famjax.boundary.units import UNITS, to_si

_KINDS = ("length", "pressure", "time")
_SI = {"length": "m", "pressure": "Pa", "time": "s"}
_EXAMPLE = "time_s,length_mm,pressure_kPa"


@dataclasses.dataclass(frozen=True)
class History:
    """Lengths and pressures in the order in which they came.

    Attributes:
        length: active length L [m], shape (n,).
        pressure: gauge pressure P [Pa], shape (n,).
        time: [s], shape (n,), or None.
        units: those of the columns, by quantity, in which answers are given; not of the values here.
    """

    length: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    time: Float[np.ndarray, " n"] | None = None
    units: Mapping[str, str] = dataclasses.field(default_factory=lambda: dict(_SI))

    def __post_init__(self) -> None:
        columns = {"length": self.length, "pressure": self.pressure, "time": self.time}
        for name, values in columns.items():
            if values is None:
                continue
            if values.size != self.length.size or not values.size:
                raise InputError(
                    f"a history needs as many values of {name} as of length and one at least, got "
                    f"{values.size} and {self.length.size}"
                )
            bad = np.flatnonzero(~np.isfinite(values))
            if bad.size:
                raise InputError(f"{name} of reading {bad[0] + 1} is {values[bad[0]]}")
        if (self.length <= 0).any() or (self.pressure < 0).any():
            raise InputError(
                f"lengths must be > 0 and gauge pressures >= 0, got {self.length.min():.6g} m and "
                f"{self.pressure.min():.6g} Pa at the least"
            )
        if self.time is not None and (np.diff(self.time) < 0).any():
            row = int(np.flatnonzero(np.diff(self.time) < 0)[0]) + 2
            raise InputError(f"time runs backwards at reading {row}: sort the readings by time")


def read_history(path: str | Path) -> History:
    """The history in a CSV file.

    Args:
        path: UTF-8, separated by comma, semicolon or tab, with the columns length and pressure and,
            where they are known, times; each with its unit, as in `time_s,length_mm,pressure_kPa`.
            Without times the rows are in order. Lines that start with `#` are comments.

    Returns:
        The history in SI.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    path = Path(path)
    lines = csv_lines(path)
    try:
        return _parse(lines)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parse(lines: list[str]) -> History:
    rows = [
        (number, line)
        for number, line in enumerate(lines, 1)
        if line.strip() and line.lstrip()[0] != "#"
    ]
    if len(rows) < 2:
        raise InputError(f"the file needs a header such as {_EXAMPLE} and readings below it")
    separator = max(",;\t", key=rows[0][1].count)
    header = [name.strip() for name in next(csv.reader([rows[0][1]], delimiter=separator))]
    columns = [_column(name) for name in header]
    kinds = [kind for kind, _ in columns]
    twice = next((kind for kind in kinds if kinds.count(kind) > 1), None)
    if twice is not None:
        raise InputError(f"the quantity {twice!r} has two columns; keep one")
    missing = [kind for kind in ("length", "pressure") if kind not in kinds]
    if missing:
        raise InputError(
            f"no column for {' and '.join(missing)} among {', '.join(header)}; a history needs "
            f"length and pressure with their units, as in {_EXAMPLE}"
        )
    table = np.array(
        [_numbers(number, line, separator, columns) for number, line in rows[1:]], float
    )
    return History(**dict(zip(kinds, table.T, strict=True)), units=dict(columns))


def _column(name: str) -> tuple[str, str]:
    """Quantity and unit of a column."""
    kind, _, unit = name.rpartition("_")
    if kind not in _KINDS or unit not in UNITS[kind]:
        known = "; ".join(f"{kind}_ with {', '.join(UNITS[kind])}" for kind in _KINDS)
        raise InputError(f"unknown column {name!r}; known are {known}")
    return kind, unit


def _numbers(number: int, line: str, separator: str, columns: list[tuple[str, str]]) -> list[float]:
    """The cells of a row in SI."""
    cells = next(csv.reader([line], delimiter=separator))
    if len(cells) != len(columns):
        raise InputError(f"row {number} has {len(cells)} cells, the header has {len(columns)}")
    values = []
    for (kind, unit), cell in zip(columns, cells, strict=True):
        try:
            value = float(cell)
        except ValueError:
            value = math.nan
        if not math.isfinite(value):
            hint = " (write a decimal point)" if "," in cell else ""
            raise InputError(f"row {number}: {kind} is {cell.strip()!r}, not a number{hint}")
        values.append(to_si(value, unit, kind))
    return values

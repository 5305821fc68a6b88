"""Raw isometric records: pressure goes up and down at one length while the force is logged."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float

from famjax.boundary.errors import InputError
from famjax.boundary.files import csv_lines
from famjax.boundary.units import factor

from ..rubber.cycles import checked_columns

FILL, VENT = 1, 2
"""Values of the valve state; 0 is closed, and any other value is a glitch."""

_TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0}
_REQUIRED = ("force", "pressure", "time")
_EXAMPLE = "force_N,pressure_kPa,time_s,valve_state"


@dataclasses.dataclass(frozen=True)
class RampRecord:
    """The record of a muscle held at one length while it is filled and vented, in order of time.

    Attributes:
        force: F [N], shape (n,), positive when the muscle pulls, as the sensor reads it.
        pressure: [Pa], shape (n,), as the sensor reads it: its zero is not yet subtracted.
        time: [s], shape (n,); stamps may repeat, but not run backwards.
        length: active length L [m], constant.
        valve_state: shape (n,), or None: 0 closed, 1 fill, 2 vent. Any other value is a glitch; it
            is counted and not used.
        source: where the numbers come from.
    """

    force: Float[np.ndarray, " n"]
    pressure: Float[np.ndarray, " n"]
    time: Float[np.ndarray, " n"]
    length: float
    valve_state: Float[np.ndarray, " n"] | None = None
    source: str = "arrays"

    def __post_init__(self) -> None:
        columns = {
            "force": self.force,
            "pressure": self.pressure,
            "time": self.time,
            "valve_state": self.valve_state,
        }
        for name, values in checked_columns(columns).items():
            object.__setattr__(self, name, values)
        if not (np.isfinite(self.length) and self.length > 0):
            raise InputError(f"length must be > 0 and finite, got {self.length} m")
        if np.ptp(self.time) == 0 or np.ptp(self.pressure) == 0:
            still = "time" if np.ptp(self.time) == 0 else "pressure"
            raise InputError(f"the {still} of a record must change, and does not: check the column")

    @property
    def n_repeated_stamps(self) -> int:
        """Readings whose time stamp is that of the reading before."""
        return int(np.sum(np.diff(self.time) == 0))

    @property
    def n_glitches(self) -> int:
        """Readings whose valve state is none of 0, 1 and 2."""
        state = self.valve_state
        return 0 if state is None else int(np.sum(~np.isin(state, (0, FILL, VENT))))


def read_ramp(
    path: str | Path, *, length: float, columns: str | Sequence[str] | None = None
) -> RampRecord:
    """The record in a CSV file; nothing is subtracted, left out or smoothed.

    Args:
        path: the file, UTF-8, separated by comma, semicolon or tab; lines that start with `#` are
            comments.
        length: active length L [m] at which the muscle was held.
        columns: names with units, `"force_N,pressure_kPa,time_s,valve_state"`, where the header
            has none or there is no header; `-` leaves a column out. None takes the header.

    Returns:
        The record in SI, pressure as the sensor reads it.

    Raises:
        InputError: what is wrong with the file, with the number of the row.
    """
    path = Path(path)
    lines = csv_lines(path)
    try:
        return _parse(lines, length, columns, path.name)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def _parse(
    lines: Sequence[str], length: float, columns: str | Sequence[str] | None, source: str
) -> RampRecord:
    rows = [
        (i, text) for i, text in enumerate(lines, 1) if text.strip() and text.lstrip()[0] != "#"
    ]
    if not rows:
        raise InputError(f"the file is empty; it needs columns such as {_EXAMPLE}")
    separator = max(",;\t", key=rows[0][1].count)
    first = [cell.strip() for cell in rows[0][1].split(separator)]
    headed = not any(map(_is_number, first))
    if columns is None and not headed:
        raise InputError(f"no header names the columns: give them, as in columns={_EXAMPLE!r}")
    if isinstance(columns, str):
        columns = columns.split(",")
    header = first if columns is None else [name.strip() for name in columns]
    known = [_column(name) for name in header]
    numbers = _numbers(rows[headed:], separator, header)
    given: dict[str, Float[np.ndarray, " n"]] = {}
    for (quantity, scale), values in zip(known, numbers.T, strict=True):
        if quantity in given:
            raise InputError(f"the quantity {quantity!r} has two columns; keep one")
        if quantity:
            given[quantity] = values * scale
    missing = [name for name in _REQUIRED if name not in given]
    if missing:
        raise InputError(
            f"no column for {' and '.join(missing)} among {', '.join(header)}; a record needs "
            f"force, pressure and time, each with its unit, as in {_EXAMPLE}"
        )
    return RampRecord(**given, length=length, source=source)


def _column(name: str) -> tuple[str, float]:
    """Quantity and SI units per unit of a column's name; no quantity where it is left out."""
    if name in {"-", "valve_state"}:
        return name.strip("-"), 1.0
    quantity, _, unit = name.rpartition("_")
    if quantity not in _REQUIRED:
        raise InputError(
            f"column {name!r} is not force, pressure or time with a unit, valve_state, or - (left "
            f"out); name the columns, as in columns={_EXAMPLE!r}"
        )
    if quantity != "time":
        return quantity, factor(unit, quantity)
    if unit not in _TIME_UNITS:
        raise InputError(f"column {name!r}: known units of time are {', '.join(_TIME_UNITS)}")
    return quantity, _TIME_UNITS[unit]


def _numbers(
    rows: Sequence[tuple[int, str]], separator: str, header: Sequence[str]
) -> Float[np.ndarray, "n columns"]:
    """The readings; the columns left out are zero."""
    kept = [i for i, name in enumerate(header) if name != "-"]
    numbers = np.zeros((len(rows), len(header)))
    for row, (number, text) in enumerate(rows):
        cells = text.split(separator)
        if len(cells) != len(header):
            raise InputError(f"row {number} has {len(cells)} cells for {len(header)} columns")
        try:
            numbers[row, kept] = [float(cells[i]) for i in kept]
        except ValueError:
            bad = next(i for i in kept if not _is_number(cells[i]))
            hint = " (write a decimal point)" if "," in cells[bad] else ""
            raise InputError(
                f"row {number}: {header[bad]} is {cells[bad].strip()!r}, not a number{hint}"
            ) from None
    return numbers


def _is_number(cell: str) -> bool:
    try:
        float(cell)
    except ValueError:
        return False
    return True

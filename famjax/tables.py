"""Read tables, such as force maps, ramps and machine logs, and identify their columns by name.

Set points, limits, peaks, atmospheric pressures and counters are not treated as measurements of the
muscle unless the user assigns them. If a column is ambiguous, the error message states which option
to use.
"""

import dataclasses
import hashlib
import io
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import _cells, _headers
from ._cells import Asked, Sheet, looks_number
from ._headers import Column, kind_of, remedy_for, shortened, unit_size
from ._stamps import REPEATED, STAMP, clock_seconds
from .boundary.errors import InputError, import_extra, meant
from .boundary.units import UNITS, parse_quantity, si_unit

_BAROMETER = (96e3, 102.8e3)  # Pa: range of atmospheric pressure where people live
_ATMOSPHERE = (100.6e3, 102.0e3)  # Pa: range of the first reading of an absolute sensor


@dataclasses.dataclass(frozen=True)
class Table:
    """A table in SI units.

    Attributes:
        columns: values by quantity, shape (n,). Pressures are gauge pressures, unless the caller
            requested absolute pressures.
        taken: source column of each quantity.
        others: all other numeric columns by name, not converted to SI.
        lines: line number of each row, counted from 1.
        unread: line numbers of the lines between the first and last row that are not readings.
        comments: lines that begin with #.
        source: name of the file.
        sha256: SHA-256 digest of the file.
    """

    columns: dict[str, np.ndarray]
    taken: dict[str, Column]
    others: dict[str, np.ndarray]
    lines: np.ndarray
    unread: tuple[int, ...] = ()
    comments: tuple[str, ...] = ()
    source: str = ""
    sha256: str = ""

    @property
    def units(self) -> dict[str, str]:
        """Unit of each quantity in the file; the SI unit if famjax has no name for the unit."""
        found = {}
        for quantity, one in self.taken.items():
            kind = kind_of(quantity)
            same = (name for name, size in UNITS[kind].items() if size == one.size)
            found[quantity] = next(same, si_unit(kind))
        return found

    def said(self) -> str:
        """Describe the source of each quantity in one line of text.

        If columns are assigned or ignored, the description is a table.
        """
        if not self.others and not any(one.named for one in self.taken.values()):
            each = self.taken.items()
            told = [f"{q} from {one.name!r}, first {one.first:.6g} {one.unit}" for q, one in each]
            return f"columns: {'; '.join(told)}"
        rows = [
            f"{quantity:<12} {one.name!r:<28} first {one.first:.6g} {one.unit}{', as assigned' * one.named}"
            for quantity, one in self.taken.items()
        ]
        left = [f"ignored      {', '.join(map(repr, self.others))}"] if self.others else []
        return "\n".join(["columns:", *rows, *left])


def read_table(
    source: Any, needed: Sequence[str], *, optional: Iterable[str] = (),
    columns: Mapping[str, str] | None = None, strict: bool = False, absolute: bool = False, fewest: int = 1,
) -> Table:  # fmt: skip
    """Read a table in any common format; nothing is interpolated and no unit is guessed.

    Text files may be encoded in UTF-8, UTF-16 or cp1252. Cells may be separated by tabs, semicolons,
    commas, vertical bars or spaces, and numbers may have decimal points or commas. Other lines may precede
    the header, and units may be in the column names or in a separate row. Workbooks in the format .xlsx
    are read with pandas.

    Args:
        source: a path or an open file, such as standard input.
        needed: required quantities from `KINDS`; a `contraction` may replace a `length`.
        optional: optional quantities.
        columns: columns assigned by the user: for each quantity, the name of a column, or its number,
            counted from 1. If the table lacks the unit, add it in brackets, as in
            `{"force": "Kraft [N]"}`. `-` ignores a quantity. `{"decimal": ","}` sets the decimal sign, and
            `{"atmosphere": "101.3kPa"}` sets the reference for absolute pressures.
        strict: True to require that every row is a reading; otherwise, other rows are skipped and reported.
        absolute: True to keep absolute pressures, for a caller that subtracts the zero reading later.
        fewest: minimum number of numeric rows.

    Returns:
        The table.

    Raises:
        InputError: the table cannot be read; the message states the fault, its line and the remedy.
    """
    asked = Asked(tuple(needed), tuple(optional), columns or {}, strict, absolute, fewest)
    known = [*asked.needed, *asked.optional, "decimal", "atmosphere"]
    for unknown in sorted(asked.columns.keys() - {*known, "contraction"}):
        raise InputError(f"--column {unknown}=...: {unknown} must be one of {', '.join(known)}")
    where, name = str(getattr(source, "name", "a stream")).strip("<>"), ""
    if not hasattr(source, "read"):
        check_size(source)
        where, name = str(source), Path(source).name
    try:
        data = _cells.read_bytes(source)
        if data.startswith(b"PK\x03\x04"):
            table = _of_workbook(data, asked)
        else:
            table = _of_sheet(_cells.split_text(_cells.decoded_text(data), asked), asked)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return dataclasses.replace(table, source=name or where, sha256=hashlib.sha256(data).hexdigest())


def text_lines(path: str | Path) -> list[str]:
    """Read the lines of a text file in any common encoding.

    Raises:
        InputError: the file is missing, or is not a text file.
    """
    check_size(path)
    try:
        return _cells.decoded_text(_cells.read_bytes(path)).splitlines()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check_size(path: str | Path, most: float = _cells.MOST_BYTES) -> None:
    """Reject a file that is too large, before reading it.

    Raises:
        InputError: the file is missing or too large.
    """
    try:
        size = Path(path).stat().st_size
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    if size > most:
        raise InputError(
            f"{path} is {size / 1e6:.0f} MB, above the limit of {most / 1e6:.0f} MB: export less data"
        )


def _of_workbook(data: bytes, asked: Asked) -> Table:
    """Read the table from the only sheet in a workbook that contains a suitable one."""
    try:
        _cells.check_workbook(data)
        pandas = import_extra("pandas", "tables")
        import_extra("openpyxl", "tables")
        how = {"header": None, "dtype": object, "engine": "openpyxl", "keep_default_na": False}
        sheets = pandas.read_excel(io.BytesIO(data), sheet_name=None, **how)
    except InputError:
        raise
    except _cells.DAMAGED as error:
        raise InputError(f"this is not a readable workbook ({error}): save it as CSV") from None
    found, refused = {}, []
    for name, frame in sheets.items():
        rows = [
            _cells.trimmed_cells(tuple(map(_cells.cell_text, row)))
            for row in frame.itertuples(index=False)
        ]
        numbered = [(k, row) for k, row in enumerate(rows, 1) if row]
        comments = [" ".join(filter(None, row)) for _, row in numbered if row[0].startswith("#")]
        body = [(k, row) for k, row in numbered if not row[0].startswith("#")]
        try:
            found[str(name)] = _of_sheet(_cells.sheet_of(body, tuple(comments), asked), asked)
        except InputError as error:
            refused.append(f"sheet {str(name)!r}: {error}")
    if len(found) > 1:
        several = ", ".join(map(repr, found))
        raise InputError(
            f"the sheets {several} all contain a suitable table: keep one, or save one as CSV"
        )
    if not found:
        raise InputError("; ".join(refused))
    return next(iter(found.values()))


def _find(
    quantity: str, held: Sequence[Column], wanted: str | None, clock: Callable
) -> Column | None:
    """Find the column for a quantity; return None if there is none."""
    kind = kind_of(quantity)
    if wanted == "-":
        return None
    if wanted is not None:
        one = _wanted(quantity, held, wanted)
    else:
        mine = [one for one in held if one.quantity == quantity and one.plain and not one.reason]
        # For load and load rate, the unit decides.
        fitting = [one for one in mine if unit_size(one.unit, kind) is not None]
        mine = fitting or [one for one in mine if not _headers.any_unit(one.unit)] or mine
        if quantity == "time" and len(mine) > 1:
            mine = [one for one in mine if len(_headers.tokens_of(one.title)) == 1] or mine
        if not mine:
            return None
        one = mine[0]
        if len(mine) > 1:
            alone = sum(other.name == one.name for other in held) == 1
            raise InputError(
                f"{len(mine)} columns match {quantity} ({', '.join(one.name for one in mine)}): choose one "
                f"with {remedy_for(quantity, one.name if alone else str(one.place + 1))}"
            )
    if quantity == "time" and clock(one.place):
        return one
    size = unit_size(one.unit, kind)
    if size is not None:
        return one._replace(size=size[0], absolute=one.absolute if size[1] is None else size[1])
    every = [unit for unit in _headers.SIZES[kind] if unit]
    lacks = (
        f"the unknown unit {shortened(one.unit)}" if one.unit else "no unit in or below its name"
    )
    hint = ": a contraction is (L0 - L)/L0, as a fraction or in %" if kind == "contraction" else ""
    if hint and unit_size(one.unit, "length") is not None:
        raise InputError(f"{one} has the unit of a length{hint}: write the length L instead")
    if any(map(str.isdigit, one.unit)):
        hint = ": convert a multiple to a plain unit, or remove the range from the column name"
    raise InputError(
        f"{one} has {lacks}{hint}; known units of {kind} are {', '.join(every)}{meant(one.unit, every)}: "
        f"specify the unit with {remedy_for(quantity, f'{one.title} [{every[0]}]')}"
    )


def _wanted(quantity: str, held: Sequence[Column], wanted: str) -> Column:
    """Find the column that the user assigned by name or number, and apply the unit that the user stated."""
    wanted = wanted.strip()
    title, unit = _headers.split_unit(_headers.joined_mode(wanted))
    said = [bool(match[1]) for match in _headers.MODE.finditer(unit)]
    unit = _headers.MODE.sub("", unit).strip(" ,()")
    for found in (
        [one for one in held if one.name == wanted],
        [one for one in held if title in (one.name, one.title)],
        [one for one in held if title.casefold() in (one.name.casefold(), one.title.casefold())],
        [one for one in held if title == str(one.place + 1)],
    ):
        if len(found) == 1:
            one = found[0]
            absolute = said[0] if said else None if unit and unit != one.unit else one.absolute
            return one._replace(unit=unit or one.unit, absolute=absolute, named=True)
    raise InputError(
        f"--column {quantity}={wanted}: this must match one column, but the table has "
        f"{', '.join(one.name for one in held)}: use one of these names, or a column number from 1"
    )


def _missing(quantity: str, held: Sequence[Column]) -> InputError:
    """Return the error for a missing quantity; it names possible columns and the option to assign one."""
    kind = kind_of(quantity)
    near = [
        f"{shortened(one.name)} {f'is {one.reason}' if one.reason else 'may be a different quantity'}"
        for one in held
        if one.quantity == quantity or (one.reason and unit_size(one.unit, kind) is not None)
    ]
    known = [f"{quantity}_{unit}" for unit in UNITS.get(kind, {})]
    example = "1 [N]" if held[0].name == "column 1" else "NAME [unit]"
    if quantity == "length" and any(one.quantity == "displacement" for one in held):
        near.append(
            "a displacement is not a length: add a column with the rest length minus the shortening"
        )
    return InputError(
        f"no column for {quantity}{': ' * bool(near)}{'; '.join(near)}; the table has "
        f"{', '.join(shortened(one.name)[1:-1] for one in held)}: name the column with its unit, such as "
        f"{known[-1]}, or assign a column with {remedy_for(quantity, example)}"
    )


def _find_all(sheet: Sheet, asked: Asked, clock: Callable[[int], bool]) -> dict[str, Column]:
    """Find the columns for all quantities by name."""
    held = []
    named = zip(sheet.names, sheet.below, sheet.beside, strict=True)
    for k, (name, below, beside) in enumerate(named):
        one = _headers.judge(name, below)
        held.append(one._replace(place=k, reason=one.reason or _headers.judge(beside).reason))
    found: dict[str, Column] = {}
    for quantity in (*asked.needed, *asked.optional):
        both = {}
        for name in dict.fromkeys((quantity, quantity.replace("length", "contraction"))):
            if (one := _find(name, held, asked.columns.get(name), clock)) is not None:
                both[name] = one
        if len(both) > 1:
            raise InputError(f"{' and '.join(map(repr, both))} are redundant: keep only one column")
        if not both and quantity in asked.needed:
            raise _missing(quantity, held)
        found |= both
    return found


def _of_sheet(sheet: Sheet, asked: Asked) -> Table:
    """Extract the columns from a sheet, in SI units."""
    names, body, width = sheet.names, sheet.rows, len(sheet.names)
    if asked.strict:  # up to the last row with a number, to exclude a footer
        last = max(k for k, (_, row) in enumerate(body) if any(map(looks_number, row)))
        body = body[: last + 1]
        for line in (line for line, row in body if len(row) > width):
            raise InputError(
                f"row {line} has more cells than the header: use decimal points, or name every column"
            )
    lines = np.array([line for line, _ in body])
    blank = ("",) * width
    padded = [(*row, *blank[len(row) :]) if len(row) <= width else blank for _, row in body]
    cells = list(zip(*padded, strict=True))

    def clock(place: int) -> bool:
        return any(":" in cell for cell in cells[place][: _cells.NEAREST])

    found = _find_all(sheet, asked, clock)
    _check_summaries(cells, lines)
    values = {
        quantity: clock_seconds(_dated(one.place, names, cells), one)
        if quantity == "time" and clock(one.place)
        else _cells.numbers_of(cells[one.place], sheet)
        for quantity, one in found.items()
    }
    bad = np.any([np.isnan(column) for column in values.values()], axis=0)
    if asked.strict and bad.any():
        k = int(np.argmax(bad))
        quantity = next(quantity for quantity, column in values.items() if np.isnan(column[k]))
        cell = cells[found[quantity].place][k]
        fault = f"{shortened(cell)}, not a number" if cell else "missing"
        how = "fill in the cell"
        if cell:
            how = (
                "write the reading with a decimal point, and without thousands separators or a unit"
            )
        raise InputError(f"row {lines[k]}: {quantity} is {fault}; remove the row, or {how}")
    if bad.all():
        raise InputError("no row has numbers in all required columns")
    others = {}
    for k in sorted(set(range(width)) - {one.place for one in found.values()}):
        if any(map(looks_number, cells[k][: _cells.NEAREST])):
            label = f"{names[k]} ({sheet.below[k]})" if sheet.below[k] else names[k]
            label = label if names.count(names[k]) == 1 else f"{label} [{k + 1}]"
            others[label] = _cells.numbers_of(cells[k], sheet)[~bad]
    unread = tuple(line for line in lines[bad].tolist() if line < lines[~bad][-1])
    kept = {quantity: column[~bad] for quantity, column in values.items()}
    taken = {name: one._replace(first=float(kept[name][0])) for name, one in found.items()}
    return Table(
        _in_si(kept, found, asked), taken, others, lines[~bad], unread, comments=sheet.comments
    )


def _check_summaries(cells: Sequence[Sequence[str]], lines: np.ndarray) -> None:
    """Reject rows that a label such as Mean marks as summaries of the readings."""
    for column in cells:
        labels = {
            cell
            for cell in {one for one in column if one[:1].isalpha()}
            if cell.casefold().strip(" .:()") in _headers.SUMMARIES
        }
        rows = (
            [line for line, cell in zip(lines, column, strict=True) if cell in labels]
            if labels
            else []
        )
        if 0 < 2 * len(rows) < len(column):
            label = next(cell for cell in column if cell in labels)
            raise InputError(
                f"row {rows[0]} is labelled {label!r}, so it is not a reading: remove such rows"
            )


def _dated(place: int, names: Sequence[str], cells: Sequence[Sequence[str]]) -> Sequence[str]:
    """Prepend the dates in a separate column to times of day."""
    for k, name in enumerate(names):
        if k != place and {"date", "datum"} & set(_headers.tokens_of(name)):
            both = [" ".join(one) for one in zip(cells[k], cells[place], strict=True)]
            if STAMP.fullmatch(both[0]):
                return both
    return cells[place]


def _in_si(
    values: dict[str, np.ndarray], found: dict[str, Column], asked: Asked
) -> dict[str, np.ndarray]:
    """Convert columns to SI units, and absolute pressures to gauge."""
    columns = {quantity: one.size * values[quantity] for quantity, one in found.items()}
    for quantity, one in found.items():
        if not one.named and columns[quantity].size > 2:
            _check_values(quantity, columns[quantity], one, asked)
    one = found.get("pressure")
    if one is not None and one.absolute and not asked.absolute:
        if "atmosphere" not in asked.columns:
            raise InputError(
                f"{one} is an absolute pressure, but gauge pressure is required: set the atmospheric "
                "pressure with --column atmosphere=101.3kPa, or assign a column of gauge pressures"
            )
        columns["pressure"] -= parse_quantity(asked.columns["atmosphere"], "pressure")
    return columns


def _check_values(quantity: str, values: np.ndarray, one: Column, asked: Asked) -> None:
    """Reject a column whose values contradict its name."""
    raw = values / one.size
    if quantity == "force" and len(raw) >= 10 and np.all(np.diff(raw) == 1) and raw[0] % 1 == 0:
        remedy = remedy_for("force", "NAME [unit]")
        raise InputError(f"{one} only counts the rows: assign the force column with {remedy}")
    if quantity != "pressure" or asked.absolute or one.absolute is not None:
        return
    low, high = float(values.min()), float(values.max())
    at_one = _ATMOSPHERE[0] < low < _ATMOSPHERE[1]
    stands = low == high and at_one
    stands |= _BAROMETER[0] < low < high < _BAROMETER[1] and high - low < 0.01 * high
    plain = math.isclose(float(f"{raw.min():.2g}"), raw.min())  # 30 inHg is a setting
    if stands or (at_one and high > 1.3 * low and not plain):
        remedy = f'--column pressure="{one.title} [{one.unit}'
        raise InputError(
            f"{one} {'stays' if stands else 'begins'} at atmospheric pressure, {raw.min():.6g} "
            f'{one.unit}, as absolute readings do: specify which it is with {remedy} gauge]" '
            f'or {remedy} abs]" and --column atmosphere=101.3kPa; or ignore it with --column pressure=-'
        )


def check_time(table: Table, most: float = REPEATED) -> np.ndarray:
    """Return a mask that is True for each row that is later than the one before.

    Args:
        table: table with a time column.
        most: fraction of rows that may repeat the time of the previous row.

    Raises:
        InputError: the time goes back, or does not advance.
    """
    time, step = table.columns["time"], np.diff(table.columns["time"])
    for k in np.flatnonzero(step < 0):
        raise InputError(
            f"the time goes back from {time[k]:.6g} s to {time[k + 1]:.6g} s at line {table.lines[k + 1]}: "
            "a file must contain a single test; split the file there"
        )
    if step.size and np.mean(step == 0) > most:
        raise InputError(
            f"the time does not advance in {np.sum(step == 0)} rows: export it with fractions of a second"
        )
    return np.concatenate([[True], step > 0])

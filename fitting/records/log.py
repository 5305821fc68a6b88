"""Logs of test machines: a delimited text of any maker and country to displacement and force in SI."""

import codecs
import csv
import dataclasses
import hashlib
import math
import re
from collections import Counter
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

import numpy as np

from famjax.boundary.errors import InputError
from famjax.boundary.units import UNITS

from .record import set_columns

KINDS = {"time": "time", "displacement": "length", "force": "force", "pressure": "pressure"}
"""The columns of a machine log and the kind of unit of each."""

_WORDS = {
    "time": "time zeit prüfzeit pruefzeit testzeit laufzeit temps elapsed",
    "displacement": "displacement disp crosshead extension position stroke travel weg traversenweg "
    "standardweg maschinenweg kolbenweg prüfweg traverse déplacement",
    "force": "force load kraft standardkraft prüfkraft pruefkraft last kraftsensor charge",
    "pressure": "pressure druck pression",
}
_NAMES = {quantity: frozenset(words.split()) for quantity, words in _WORDS.items()}
_ALIASES = {
    "time": {"sec": "s", "secs": "s", "second": "s", "seconds": "s", "sek": "s", "sekunden": "s",
             "msec": "ms", "minute": "min", "minutes": "min", "minuten": "min"},
    "length": {"inch": "in", "inches": "in", '"': "in", "millimeter": "mm", "meter": "m"},
    "force": {"newton": "N", "newtons": "N", "lb": "lbf", "lbs": "lbf", "pound": "lbf",
              "pounds": "lbf", "kilonewton": "kN", "kp": "kgf"},
    "pressure": {"pascal": "Pa"},
}  # fmt: skip
_MORE = {
    "time": {"h": 3600.0, "us": 1e-6, "\u00b5s": 1e-6, "\u03bcs": 1e-6},
    "length": {"um": 1e-6, "\u00b5m": 1e-6, "\u03bcm": 1e-6},
    "force": {"mN": 1e-3, "MN": 1e6, "daN": 10.0, "kip": 4448.2216152605, "gf": 9.80665e-3},
    "pressure": {"mbar": 100.0},
}  # fmt: skip
_DELIMITERS = ("\t", ";", ",", "|", " ")  # in this order; the blank stands for any run of blanks
_NUMBER = {
    ".": re.compile(r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"),
    ",": re.compile(r"[+-]?(?:\d+(?:,\d*)?|,\d+)(?:[eE][+-]?\d+)?"),
}
_GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?"),
}
_CLOCK = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)")
_BRACKETS = re.compile(r"^(.*?)[\s_,]*[(\[{<]\s*([^()\[\]{}<>]*)\s*[)\]}>]$")
_BESIDE = re.compile(r"^(.*\S)(?:\s*/\s*|\s+in\s+|\s*,\s*|_|\s+)(\S+)$")
_FEWEST_COLUMNS, _FEWEST_ROWS = 2, 3
_SAMPLE = 2000  # lines that tell delimiter and decimal sign, where they hold a block of numbers
_LOOK = 200  # rows in which a decimal point is sought
_LATE = 1.5  # of the usual interval: a longer one is a gap


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

    def __post_init__(self) -> None:
        set_columns(self, *KINDS, least=2)
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
    chosen, units = columns or {}, units or {}
    unknown = sorted({*chosen, *units} - set(KINDS))
    if unknown:
        raise InputError(f"{', '.join(unknown)} is none of {', '.join(KINDS)}")
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    try:
        cells = _split(_decoded(data), decimal)
        found, names = _find_columns(cells, chosen, units, needed, welcome)
        lines, table, unread = _numbers(cells, [index for index, _ in found.values()])
        time = table[:, found["time"][0]] * found["time"][1]
        step = np.diff(time)
        back = np.flatnonzero(step < 0)
        if back.size:
            raise InputError(
                f"time goes back from {time[back[0]]:.6g} s to {time[back[0] + 1]:.6g} s at line "
                f"{lines[back[0] + 1]}: a file must hold one test; split it there"
            )
        keep = np.concatenate([[True], step > 0])
        if keep.sum() < 2:
            raise InputError("one row of numbers makes no log")
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    table, time, step = table[keep], time[keep], step[step > 0]
    interval = float(np.median(step))
    late = np.flatnonzero(step > _LATE * interval)
    used = {index for index, _ in found.values()}
    return MachineLog(
        **{quantity: table[:, index] * factor for quantity, (index, factor) in found.items()},
        others={
            name if names.count(name) == 1 else f"{name} [{k + 1}]": table[:, k]
            for k, name in enumerate(names)
            if k not in used and not np.isnan(table[:, k]).all()
        },
        interval=interval,
        gaps=tuple(
            (float(time[k]), max(1, round(float(step[k]) / interval) - 1)) for k in late.tolist()
        ),
        unread=unread,
        repeated=tuple(lines[~keep].tolist()),
        source=str(path),
        sha256=hashlib.sha256(data).hexdigest(),
    )


@dataclasses.dataclass(frozen=True)
class _Cells:
    """A delimited text in cells.

    Attributes:
        delimiter: between cells; a blank stands for any run of blanks.
        decimal: "." or ",".
        rows: line number (from 1) and cells of every line that is not empty.
        first: index into `rows` of the first row of numbers.
        width: columns of the block of numbers.
    """

    delimiter: str
    decimal: str
    rows: list[tuple[int, tuple[str, ...]]]
    first: int
    width: int


def _decoded(data: bytes) -> str:
    """The text of a file: by its mark, else UTF-16, UTF-8 or cp1252 by its bytes."""
    encodings = ["utf-8-sig", "cp1252"]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in data:
        # Latin text in UTF-16 has a zero in every second byte: which one tells the order.
        little = data[1:2000:2].count(0) > data[0:2000:2].count(0)
        encodings = ["utf-16-le" if little else "utf-16-be"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text
    raise InputError("it is not a text file in UTF-8, UTF-16 or cp1252: export it as text")


def _split(text: str, decimal: str | None) -> _Cells:
    """The cells of a log, by the delimiter and decimal sign that make most of it numbers."""
    if decimal not in {None, ".", ","}:
        raise InputError(f"decimal must be '.' or ',', got {decimal!r}")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip(" \t;,|")]
    found = _best(lines[:_SAMPLE], decimal) or _best(lines, decimal)
    if found is None:
        raise InputError(
            f"no block of numbers: at least {_FEWEST_ROWS} lines of {_FEWEST_COLUMNS} numbers, "
            "separated by tab, semicolon, comma, bar or blanks, are needed"
        )
    return dataclasses.replace(
        found, rows=[(n, _cells(line, found.delimiter)) for n, line in lines]
    )


def _best(lines: list[tuple[int, str]], decimal: str | None) -> _Cells | None:
    """The delimiter and decimal sign that make most cells of these lines numbers, if any do."""
    found: list[tuple[int, _Cells]] = []
    for delimiter in _DELIMITERS:
        if delimiter == " " and found:
            break
        rows = [(n, _cells(line, delimiter)) for n, line in lines]
        scored = []
        for sign in (decimal,) if decimal else (".", ","):
            score, first, width = _block([cells for _, cells in rows], sign)
            if score:
                scored.append((score, _Cells(delimiter, sign, rows, first, width)))
        if len(scored) == 2 and scored[0][0] == scored[1][0]:
            _check_decimal(scored[0][1])
        found += scored
    # The first of several with one score: a decimal point before a comma.
    return max(found, key=lambda one: one[0])[1] if found else None


def _block(rows: list[tuple[str, ...]], decimal: str) -> tuple[int, int, int]:
    """Cells of numbers in the block, index of its first row, and its width; zeros for no block."""
    counts = [sum(_number(cell, decimal) is not None for cell in cells) for cells in rows]
    widths = [
        len(cells) if n >= _FEWEST_COLUMNS and 2 * n >= sum(map(bool, cells)) else 0
        for n, cells in zip(counts, rows, strict=True)
    ]
    common = Counter(width for width in widths if width).most_common(1)
    for width, _ in common:
        for k in range(len(rows) - _FEWEST_ROWS + 1):
            if widths[k : k + _FEWEST_ROWS] == [width] * _FEWEST_ROWS:
                inside = zip(counts[k:], widths[k:], strict=True)
                return sum(n for n, one in inside if one == width), k, width
    return 0, 0, 0


def _number(cell: str, decimal: str) -> float | None:
    """The value of a cell, a clock time in seconds, or None where it is neither."""
    cell = cell.strip()
    if not cell.isascii():
        cell = cell.replace("\u2212", "-").replace("\u00a0", "")
    if _NUMBER[decimal].fullmatch(cell):
        return float(cell.replace(",", "."))
    if _GROUPED[decimal].fullmatch(cell):
        group = "," if decimal == "." else "."
        return float(cell.replace(group, "").replace(",", "."))
    clock = _CLOCK.fullmatch(cell)
    if clock:
        hours, minutes, seconds = clock.groups()
        return int(hours or 0) * 3600 + int(minutes) * 60 + float(seconds.replace(",", "."))
    return None


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    if delimiter != " ":
        cells = (
            next(csv.reader([line], delimiter=delimiter)) if '"' in line else line.split(delimiter)
        )
        return tuple(map(str.strip, cells))
    if any(character.isalpha() for character in line):
        names = re.split(r"\s{2,}", line.strip())  # a name may hold a blank
        if len(names) > 1:
            return tuple(names)
    return tuple(line.split())


def _check_decimal(found: _Cells) -> None:
    """Refuse numbers such as 1,234 where nothing tells one and a bit from more than a thousand."""
    for _, cells in found.rows[found.first :]:
        for cell in cells:
            if "," in cell and _GROUPED["."].fullmatch(cell):
                raise InputError(
                    f"{cell!r} may be {cell.replace(',', '.')} or {cell.replace(',', '')}: give the "
                    "decimal sign, decimal=',' or decimal='.' (--log-decimal)"
                )


def _numbers(
    cells: _Cells, needed: Sequence[int]
) -> tuple[np.ndarray, np.ndarray, tuple[int, ...]]:
    """Line numbers and values of the rows of numbers, and the lines among them that are none.

    A cell that is no number is nan in a column that is not needed.
    """
    lines, rows, others = [], [], []
    for line, row in cells.rows[cells.first :]:
        values = [_number(cell, cells.decimal) for cell in row]
        if len(values) == cells.width and all(values[k] is not None for k in needed):
            lines.append(line)
            rows.append(values)
        else:
            others.append(line)
    if not rows:
        raise InputError("no row has numbers in all the columns that are needed")
    unread = tuple(line for line in others if line < lines[-1])
    return np.array(lines), np.array(rows, float), unread


def _unit_factor(unit: str, kind: str) -> float | None:
    """The multiplier that takes a unit, in any maker's spelling, to SI; None where it is not known."""
    unit = unit.strip().strip(".")
    known = UNITS[kind] | _MORE[kind]
    lower = unit.casefold()
    if unit in known:
        return known[unit]
    if lower in _ALIASES[kind]:
        return known[_ALIASES[kind][lower]]
    # mN and MN differ in case alone; any other unit may be written in either.
    same = [value for name, value in known.items() if name.casefold() == lower]
    return same[0] if len(same) == 1 else None


def _is_unit(text: str) -> bool:
    return any(_unit_factor(text, kind) is not None for kind in KINDS.values())


def _find_columns(
    cells: _Cells,
    chosen: Mapping[str, str],
    units: Mapping[str, str],
    needed: Collection[str],
    welcome: Collection[str],
) -> tuple[dict[str, tuple[int, float]], list[str]]:
    """Index and multiplier to SI of each quantity, and every column's full name."""
    names, below = _header(cells)
    parsed = [_name_and_unit(name) for name in names]
    quantities = {_quantity(name) for name, _ in parsed}
    found = {}
    for quantity in (*needed, *welcome):
        if quantity not in needed and quantity not in chosen and quantity not in quantities:
            continue
        kind = KINDS[quantity]
        own = [unit or lower for (_, unit), lower in zip(parsed, below, strict=True)]
        known = [_unit_factor(unit, kind) is not None for unit in own]
        k = _column(quantity, parsed, names, chosen.get(quantity), known)
        unit = units.get(quantity) or own[k]
        first = next(iter(UNITS[kind]))
        if not unit:
            raise InputError(
                f"column {names[k]!r} has no unit, in its name or in a row below: give it, "
                f'units={{"{quantity}": "{first}"}} or --log-units {quantity}={first}'
            )
        factor = _unit_factor(unit, kind)
        if factor is None:
            known_units = ", ".join(UNITS[kind] | _MORE[kind])
            raise InputError(
                f"column {names[k]!r} has the unknown unit {unit!r}; known units of {kind} are "
                f"{known_units}"
            )
        found[quantity] = (k, factor)
    pairs = zip(names, below, strict=True)
    return found, [f"{name} ({unit})" if unit else name for name, unit in pairs]


def _header(cells: _Cells) -> tuple[list[str], list[str]]:
    """Names of the columns, and the units in a row of their own below ("" where there is none)."""
    n = cells.width
    nearest = cells.rows[: cells.first][:-5:-1]
    above = [[*row, *[""] * n][:n] for _, row in nearest]
    scores = [sum(_quantity(_name_and_unit(c)[0]) is not None for c in row) for row in above]
    if not any(scores):
        return [f"column {k + 1}" for k in range(n)], [""] * n
    at = scores.index(max(scores))  # the nearest to the numbers
    _check_commas(cells, above[at])
    for row in above[:at]:
        matches = [_BRACKETS.match(cell.strip()) for cell in row]
        bracketed = [bool(match and not match.group(1)) for match in matches]
        bare = [
            match.group(2).strip() if match and alone else cell.strip()
            for cell, match, alone in zip(row, matches, bracketed, strict=True)
        ]
        if any(bracketed) or any(map(_is_unit, bare)):
            return above[at], bare
    return above[at], [""] * n


def _check_commas(cells: _Cells, header: list[str]) -> None:
    """Refuse numbers with decimal commas between commas: more cells than names, and no point in any."""
    line, first = cells.rows[cells.first]
    values, names = (len([cell for cell in row if cell]) for row in (first, header))
    block = cells.rows[cells.first : cells.first + _LOOK]
    if (
        cells.delimiter == ","
        and values > names
        and not any("." in c for _, row in block for c in row)
    ):
        raise InputError(
            f"line {line} has {values} numbers under {names} names ({', '.join(filter(None, header))}): "
            "are they decimal commas? Export the log with semicolons or tabs between the columns, or with "
            "decimal points, or name every column"
        )


def _name_and_unit(name: str) -> tuple[str, str]:
    """`Load (N)`, `Kraft [N]`, `Weg / mm`, `time_s`: the name and the unit, or "" for none."""
    name = name.strip()
    match = _BRACKETS.match(name)
    if match and match.group(1):
        return match.group(1).strip(), match.group(2).strip()
    match = _BESIDE.match(name)
    if match and (_is_unit(match.group(2)) or "/" in name or "_" in name):
        return match.group(1).strip(), match.group(2)
    return name, ""


def _quantity(name: str) -> str | None:
    words = set(re.findall(r"[^\W\d_]+", name.casefold()))
    return next((quantity for quantity, known in _NAMES.items() if words & known), None)


def _column(
    quantity: str,
    parsed: list[tuple[str, str]],
    names: list[str],
    wanted: str | None,
    fitting_unit: list[bool],
) -> int:
    if wanted is not None:
        matches = [k for k, name in enumerate(names) if wanted in (name, parsed[k][0])]
        if not matches and wanted.isdecimal() and 1 <= int(wanted) <= len(names):
            matches = [int(wanted) - 1]
    else:
        matches = [k for k, (name, _) in enumerate(parsed) if _quantity(name) == quantity]
        # Load and load rate: the unit tells. Time and cycle time: the plainer name does, but a second
        # load is of the same kind, whatever it is called.
        fitting = [k for k in matches if fitting_unit[k]]
        plain = [k for k in fitting or matches if parsed[k][0].casefold() in _NAMES[quantity]]
        matches = fitting or matches
        if len(plain) == 1 and (quantity == "time" or not fitting):
            matches = plain
    if len(matches) != 1:
        what = "no column" if not matches else f"{len(matches)} columns"
        which = f" ({', '.join(names[k] for k in matches)})" if matches else ""
        raise InputError(
            f"{what} for {quantity}{which}; the log has {', '.join(names)}: choose one by its name, "
            f'columns={{"{quantity}": "..."}} or --log-columns {quantity}=..., or by its number from 1'
        )
    return matches[0]

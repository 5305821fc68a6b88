"""The one reader of tables: force maps, ramps, logs of any maker, each column judged by its whole name.

A set point, a limit, a peak, an atmosphere or a counter is no measurement of the muscle unless the user
says so. What cannot be told is refused with the option that tells it. The words: data/tables.toml.
"""

import codecs
import csv
import dataclasses
import datetime
import functools
import hashlib
import importlib.resources
import io
import math
import re
import tomllib
import unicodedata
import zipfile
import zlib
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from .boundary.errors import InputError, import_extra, meant
from .boundary.units import UNITS, parse_quantity, si_unit

KINDS = {
    "time": "time", "displacement": "length", "force": "force", "pressure": "pressure",
    "length": "length", "contraction": "contraction", "valve_state": "state",
}  # fmt: skip
"""Kind of unit of every quantity of a table; `force_std` is of the kind of `force`."""

_MOST_BYTES = 500e6  # of a file, and of what a workbook unpacks to
_MOST_CELLS = 20e6  # of a sheet
_SAMPLE = 2000  # lines that tell delimiter and decimal sign
_LONGEST = 40  # characters of a cell in a message
_NEAREST = (
    6  # rows above the numbers among which the names are, and below that show what a column holds
)
_REPEATED = (
    0.1  # of all rows: more that share the time of the row before, and the stamps are too coarse
)
_DAY = 86400.0
_DAMAGED = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, OSError, EOFError, SyntaxError,
    RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""What readers of workbooks make of a damaged one."""
_BAROMETER = (96e3, 102.8e3)  # Pa: where people live
_ATMOSPHERE = (100.6e3, 102.0e3)  # Pa: where absolute readings begin

_WORDS = tomllib.loads(
    (importlib.resources.files("famjax") / "data" / "tables.toml").read_text(encoding="utf-8")
)
_SIZES = {kind: {**UNITS.get(kind, {}), **more} for kind, more in _WORDS["units"].items()}
for _sizes in _SIZES.values():
    for _unit, _same in _WORDS["same"].items():
        if _unit in _sizes:
            _sizes.update(dict.fromkeys(_same.split(), _sizes[_unit]))
_HEADS = {word: name for name, words in _WORDS["quantities"].items() for word in words.split()}
_REASONS = {word: why for why, words in _WORDS["no measurement"].items() for word in words.split()}
_PLAIN = frozenset(_WORDS["plain"]["words"].split())
_JOINED = _WORDS["plain"]["joined"].split()
_OTHER_UNITS = frozenset(_WORDS["others"]["units"].split())
_KNOWN = _PLAIN | _REASONS.keys()
_STD = {"std", "sd", "stdev"}

_CLOCK_UNIT = re.compile(r"(h+|m+):(m+|s+)(:s+)?(?:[.,:]\w+)?", re.IGNORECASE)
_MODE = re.compile(r"(?i)(?<![^\W_])(?:(abs|absolute?)|gauge|gage|rel|relative?)(?![^\W_])\.?")
_MODE_BESIDE = re.compile(
    r"(?i)(?<![^\W_])([kmh]?pa|m?bar|psi|at|cm2|hg)(?:\s*\(([agü])\)|\s+([agü]))(?![^\W_])"
)
_BRACKETS = [
    re.compile(form)
    for form in (r"\[([^\[\]]*)\]", r"\(((?:[^()]|\([^()]*\))*)\)", r"\{([^{}]*)\}", r"<([^<>]*)>")
]
_BESIDE = re.compile(r"\s*/\s*|\s+in\s+|\s*[,;:.]\s*|_|\s+")
_FORMULA = re.compile(r"[*^|=+\u00d7\u221a]|/\s*\d|^\s*[-\d]")
_GROUPS = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:[, ']\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:[. ']\d{3})+(?:,\d*)?"),
}
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")
_STAMP = re.compile(
    r"(?:(?P<date>\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{2,4}"
    r"|\d{1,2}[- ][A-Za-z]{3}[- ]\d{2,4})[T ,]+)?(?P<a>\d{1,4}):(?P<b>\d{2})(?::(?P<c>\d{1,2}))?"
    r"(?:(?:[.,]|:(?=\d{3}\b))(?P<f>\d+))?"
    r"\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?"
)
_DATES = ("%Y-%m-%d", "%d-%m-%Y", "%m-%d-%Y", "%d-%b-%Y", "%d-%m-%y", "%m-%d-%y", "%d-%b-%y")


class Column(NamedTuple):
    """What a column of a table is, by its name and its unit.

    Attributes:
        name: as the table has it.
        title: without the unit.
        unit: as written, "" for none.
        quantity: that it measures, one of `KINDS`, or `force_std` and its kind; None for none.
        reason: what it is instead of a measurement of the muscle, "" where that is not said.
        plain: every word is known, and it is no formula: what is not may be anything.
        absolute: a pressure from vacuum (True), gauge (False), or not said (None).
        place: from 0.
        size: multiplier to SI.
        named: the user says that it is.
        first: value of the first reading, in the unit as written.
    """

    name: str
    title: str
    unit: str
    quantity: str | None
    reason: str
    plain: bool
    absolute: bool | None
    place: int = 0
    size: float = 1.0
    named: bool = False
    first: float = math.nan

    def __str__(self) -> str:
        return f"column {shortened(self.name)}"


@dataclasses.dataclass(frozen=True)
class Table:
    """A table in SI.

    Attributes:
        columns: by quantity, shape (n,); pressures are gauge unless absolute ones were asked for.
        taken: what each was taken from.
        others: every other column of numbers, as printed, by its name.
        lines: number of the line of each row, from 1.
        unread: lines between the first and the last row that are no readings.
        comments: lines that begin with #.
        source: the file's name.
        sha256: of the file.
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
        """Units of the columns by the names of this program; those of SI where it has none."""
        found = {}
        for quantity, one in self.taken.items():
            kind = kind_of(quantity)
            same = [name for name, size in UNITS[kind].items() if size == one.size]
            found[quantity] = next(iter(same), si_unit(kind))
        return found

    def said(self) -> str:
        """What was taken as what: one line, or a table with what was said or left aside."""
        if not self.others and not any(one.named for one in self.taken.values()):
            each = (
                f"{q} from {one.name!r}, first {one.first:.6g} {one.unit}"
                for q, one in self.taken.items()
            )
            return f"columns: {'; '.join(each)}"
        rows = [
            f"{quantity:<12} {one.name!r:<28} first {one.first:.6g} {one.unit}{', as was said' * one.named}"
            for quantity, one in self.taken.items()
        ]
        left = [f"left aside   {', '.join(map(repr, self.others))}"] if self.others else []
        return "\n".join(["columns:", *rows, *left])


@dataclasses.dataclass(frozen=True)
class _Asked:
    """What is asked of a table; see `read_table`."""

    needed: tuple[str, ...]
    optional: tuple[str, ...]
    columns: Mapping[str, str]
    strict: bool = False
    absolute: bool = False
    fewest: int = 1


def shortened(text: str) -> str:
    """A text as a message shows it, in quotes: what is long is cut."""
    return repr(text if len(text) <= _LONGEST else text[:_LONGEST] + "...")


def kind_of(quantity: str) -> str:
    """Kind of unit of a quantity."""
    return KINDS[quantity.removesuffix("_std")]


# --- files


def read_table(
    source: Any,
    needed: Sequence[str],
    *,
    optional: Iterable[str] = (),
    columns: Mapping[str, str] | None = None,
    strict: bool = False,
    absolute: bool = False,
    fewest: int = 1,
) -> Table:
    """The table in a file of any maker and country; nothing is interpolated, and no unit is guessed.

    Text in UTF-8, UTF-16 or cp1252, separated by tab, semicolon, comma, bar or blanks, with decimal points
    or commas, what stands above the names, and units in the names or in a row of their own; or a workbook,
    .xlsx, by pandas.

    Args:
        source: a path; or an open file, such as standard input.
        needed: quantities of `KINDS` that the table must hold; a `contraction` stands for a `length`.
        optional: those that it may hold.
        columns: what the user says of them: name, or number from 1, by quantity, with the unit in brackets
            where the table does not say it, `{"force": "Kraft [N]"}`, or `-` for none; `{"decimal": ","}`
            is the decimal sign, and `{"atmosphere": "101.3kPa"}` what absolute pressures are counted from.
        strict: every row must be a reading; otherwise those that are none are reported.
        absolute: pressures stay as they are, for those whose zero is subtracted later.
        fewest: rows of numbers.

    Returns:
        The table.

    Raises:
        InputError: what is wrong with the file, with the number of the line and what to do.
    """
    asked = _Asked(tuple(needed), tuple(optional), columns or {}, strict, absolute, fewest)
    known = [*asked.needed, *asked.optional, "decimal", "atmosphere"]
    for unknown in sorted(asked.columns.keys() - {*known, "contraction"}):
        raise InputError(f"--column {unknown}=...: {unknown} is none of {', '.join(known)}")
    where, name = str(getattr(source, "name", "a stream")).strip("<>"), ""
    if not hasattr(source, "read"):
        check_size(source)
        where, name = str(source), Path(source).name
    try:
        data = _bytes(source)
        if data.startswith(b"PK\x03\x04"):
            table = _of_workbook(data, asked)
        else:
            table = _of_sheet(_split(_decoded(data), asked), asked)
    except InputError as error:
        raise InputError(f"{where}: {error}") from None
    return dataclasses.replace(table, source=name or where, sha256=hashlib.sha256(data).hexdigest())


def text_lines(path: str | Path) -> list[str]:
    """The lines of a text file in any usual encoding.

    Raises:
        InputError: there is no such file, or it is no text.
    """
    check_size(path)
    try:
        return _decoded(_bytes(path)).splitlines()
    except InputError as error:
        raise InputError(f"{path}: {error}") from None


def check_size(path: str | Path, most: float = _MOST_BYTES) -> None:
    """Refuse a file that is larger than such files are, before it is read.

    Raises:
        InputError: it is not there, or too large.
    """
    try:
        size = Path(path).stat().st_size
    except FileNotFoundError:
        raise InputError(f"no such file: {path}") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    if size > most:
        raise InputError(
            f"{path} has {size / 1e6:.0f} MB, {most / 1e6:.0f} at most are read: export less"
        )


def _bytes(source: Any) -> bytes:
    try:
        file = getattr(
            source, "buffer", source
        )  # of an open text, whatever its encoding is said to be
        held = file.read() if hasattr(file, "read") else Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"cannot read it: {error.strerror}") from None
    return held.encode() if isinstance(held, str) else bytes(held)


def _decoded(data: bytes) -> str:
    """The text of a file: by its mark, else UTF-16, UTF-8 or cp1252 by its bytes."""
    head = data[:200].lstrip(b"\xef\xbb\xbf \r\n\t").lower()
    if head.startswith((b"\xd0\xcf\x11\xe0", b"<?xml", b"<!doctype", b"<html", b"<table")):
        raise InputError("it is an old workbook, XML or HTML, not a text: save it as .xlsx or CSV")
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
            return text.removeprefix("\ufeff")
    raise InputError("it is not a text file in UTF-8, UTF-16 or cp1252: export it as text")


def _of_workbook(data: bytes, asked: _Asked) -> Table:
    """The one sheet of a workbook that holds the table."""
    try:
        _check_workbook(data)
        pandas = import_extra("pandas", "tables")
        import_extra("openpyxl", "tables")
        how = {"header": None, "dtype": object, "engine": "openpyxl", "keep_default_na": False}
        sheets = pandas.read_excel(io.BytesIO(data), sheet_name=None, **how)
    except InputError:
        raise
    except _DAMAGED as error:
        raise InputError(f"it is no workbook that can be read ({error}): save it as CSV") from None
    found, refused = {}, []
    for name, frame in sheets.items():
        rows = [_trimmed(tuple(map(_cell_text, row))) for row in frame.itertuples(index=False)]
        numbered = [(k, row) for k, row in enumerate(rows, 1) if row]
        comments = [" ".join(filter(None, row)) for _, row in numbered if row[0].startswith("#")]
        body = [(k, row) for k, row in numbered if not row[0].startswith("#")]
        try:
            found[str(name)] = _of_sheet(_sheet(body, tuple(comments), asked), asked)
        except InputError as error:
            refused.append(f"sheet {str(name)!r}: {error}")
    if len(found) > 1:
        several = ", ".join(map(repr, found))
        raise InputError(f"the sheets {several} hold such a table: keep one, or save it as CSV")
    if not found:
        raise InputError("; ".join(refused))
    return next(iter(found.values()))


def _check_workbook(data: bytes) -> None:
    """Refuse a workbook that would unpack to more than is read, and one that names entities.

    Python reads no more of a part than the archive states, and a part of a workbook has no document type.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if (size := sum(part.file_size for part in archive.infolist())) > _MOST_BYTES:
            raise InputError(
                f"the workbook unpacks to {size / 1e6:.0f} MB, {_MOST_BYTES / 1e6:.0f} at most are read: "
                "save its table as CSV"
            )
        for part in archive.infolist():
            content = archive.read(part).replace(b"\0", b"")
            if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
                raise InputError(
                    "the workbook defines entities, no spreadsheet does: save it as CSV"
                )
            places = re.findall(rb'<(?:\w+:)?c\s[^>]*?r="([A-Z]+)(\d+)"', content)
            width, rows = (max(map(f, places), default=0) for f in (_width, lambda at: int(at[1])))
            if width * rows > _MOST_CELLS:
                raise InputError("a sheet of the workbook reaches too far: save the table as CSV")


def _width(place: tuple[bytes, bytes]) -> int:
    return functools.reduce(lambda n, letter: 26 * n + letter - 64, place[0], 0)


def _cell_text(cell: Any) -> str:
    if isinstance(cell, datetime.timedelta):
        cell = datetime.datetime.min + cell
        return f"{(cell.day - 1) * 24 + cell.hour}:{cell:%M:%S.%f}"
    if cell is None or cell != cell:  # noqa: PLR0124 -- nan of any kind
        return ""
    return " ".join(str(cell).split())


# --- cells


@dataclasses.dataclass(frozen=True)
class _Sheet:
    """A table in cells.

    Attributes:
        rows: line number (from 1) and cells of every row from the first reading on.
        names, below, beside: of the columns, the units in a row of their own and other words that stand
            above or below a name, "" where there are none.
        decimal: "." or ",".
        grouped: thousands may be grouped: somewhere that is plain.
        comments: lines that begin with #.
    """

    rows: list[tuple[int, tuple[str, ...]]]
    names: list[str]
    below: list[str]
    beside: list[str]
    decimal: str
    grouped: bool
    comments: tuple[str, ...]


def _split(text: str, asked: _Asked) -> _Sheet:
    """The cells of a text, by the delimiter that makes most of it names and numbers."""
    lines = text.splitlines()
    stated = re.fullmatch(r'(?i)"?sep=(.)"?\s*', lines[0]) if lines else None
    held = [(n, one) for n, one in enumerate(lines, 1) if one.strip(" \t;,|")][bool(stated) :]
    comments = tuple(one.strip(" \t,;") for _, one in held if one.lstrip(' "').startswith("#"))
    body = [(n, one) for n, one in held if not one.lstrip(' "').startswith("#")]
    if not body:
        raise InputError("the file is empty; it needs names such as pressure_kPa,length_mm,force_N")
    found: list[tuple[tuple[float, ...], str]] = []
    for rank, delimiter in enumerate([stated[1]] if stated else "\t;,| "):
        rows = [(n, _cells(line, delimiter)) for n, line in body[:_SAMPLE]]
        first, width = _block([cells for _, cells in rows], asked.fewest)
        if width:
            names, *_ = _header(rows, first, width, comments)
            inside = [cell for _, row in rows[first:] for cell in row if cell]
            share = round(sum(map(_looks_number, inside)) / len(inside), 1)
            known = sum(judge(name).quantity is not None for name in names)
            found.append(((known, share, width, -rank), delimiter))
    if not found:
        raise InputError(
            "a header but no readings, or no block of numbers: rows of two numbers and more are needed, "
            f"{asked.fewest} at least, separated by tab, semicolon, comma, bar or blanks"
        )
    delimiter = max(found)[1]
    plain = '"' not in text if delimiter == "," else "," not in text
    rows = [(n, _cells(line, delimiter)) for n, line in body]
    return _sheet(rows, comments, asked, delimiter, plain=plain)


def _sheet(
    rows: list[tuple[int, tuple[str, ...]]],
    comments: tuple[str, ...],
    asked: _Asked,
    delimiter: str = "",
    *,
    plain: bool = False,
) -> _Sheet:
    """Where the numbers of these rows are, what is above them, and their decimal sign."""
    first, width = _block([row for _, row in rows[:_SAMPLE]], asked.fewest)
    if not width:
        raise InputError("no block of numbers")
    names, below, beside, first = _header(rows, first, width, comments)
    body = rows[first:]
    named = sum(not re.fullmatch(r"column \d+", name) for name in names)
    inside = [row for _, row in (body[:_SAMPLE] if plain else body)]
    for line, row in body if delimiter == "," and named else ():
        if len(row) > named and all(map(_looks_number, row)):
            raise InputError(
                f"line {line} has {len(row)} numbers under {named} names: are they decimal commas, or "
                "between thousands? Export with semicolons between the columns, or name every column"
            )
    sign, grouped = _decimal(inside, asked.columns.get("decimal"), delimiter)
    return _Sheet(body, names, below, beside, sign, grouped, comments)


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    if delimiter == " ":
        names = re.split(r"\s{2,}", line.strip())  # a name may hold a blank
        return tuple(names if len(names) > 1 and re.search("[^\\W\\d]", line) else line.split())
    cells = next(csv.reader([line], delimiter=delimiter)) if '"' in line else line.split(delimiter)
    return _trimmed(tuple(map(str.strip, cells)))


def _trimmed(cells: tuple[str, ...]) -> tuple[str, ...]:
    """Without the empty cells that a spreadsheet has put behind the last column."""
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _ascii(cell: str) -> str:
    """A number with ASCII signs: no Unicode minus, no narrow blank between thousands."""
    if cell.isascii():
        return cell
    return re.sub("[\u00a0\u2009\u202f]", " ", cell).replace("\u2212", "-").replace("\u2019", "'")


def _looks_number(cell: str) -> bool:
    cell = _ascii(cell)
    return any("0" <= one <= "9" for one in cell) and any(
        form.fullmatch(cell) for form in (_NUMBER, *_GROUPS.values(), _STAMP)
    )


def _block(rows: Sequence[tuple[str, ...]], fewest: int) -> tuple[int, int]:
    """Index of the first row of the block of numbers, and its width; zeros for no block."""
    looks = [sum(map(_looks_number, row)) for row in rows]
    widths = [
        len(row) if n >= 2 and 2 * n >= sum(map(bool, row)) else 0
        for n, row in zip(looks, rows, strict=True)
    ]
    count = Counter(filter(None, widths))
    for width in sorted(count, key=lambda one: (-count[one] * one, -one)):
        for k, one in enumerate(widths):
            run = sum(other in (width, width - 1) for other in widths[k : k + 3])
            if (
                one == width
                and run >= min(3, count[width], len(rows) - k)
                and count[width] >= fewest
            ):
                return k, width
    return 0, 0


def _header(
    rows: list[tuple[int, tuple[str, ...]]], first: int, width: int, comments: tuple[str, ...]
) -> tuple[list[str], list[str], list[str], int]:
    """Names, units in a row of their own ("" for none), other words beside, and where the numbers begin.

    They begin behind the names, whatever the first rows lack.
    """
    looks = [sum(map(_looks_number, row)) for _, row in rows[:first]]
    above = [list(row) for _, row in rows[:first]][: -_NEAREST - 1 : -1]
    if not first and comments:  # as NumPy writes it
        line = comments[-1].lstrip("# ")
        split = [line.split(), *(list(_cells(line, d)) for d in "\t;,|")]
        above = [next((cells for cells in split if len(cells) == width), split[0])]
    scores = [
        sum(bool(judge(cell).quantity or judge(cell).reason) for cell in row) for row in above
    ]
    texts = [
        k
        for k, row in enumerate(above)
        if 2 * len(row) > width and not any(map(_looks_number, row))
    ]
    if not any(scores) and not texts:
        while first and looks[first - 1] > 1:
            first -= 1
        return [f"column {k + 1}" for k in range(width)], [""] * width, [""] * width, first
    # The nearest to the numbers, or the first of the same.
    at = scores.index(max(scores)) if any(scores) else texts[0]
    at = max(k for k, row in enumerate(above) if row == above[at])
    n = max(width, len(above[at]))
    names, below, beside = [*above[at], *[""] * n][:n], [""] * n, [""] * n
    others = [*above[:at][::-1], *above[at + 1 : at + 2]]
    for row in others:
        bare = [re.sub(r"^[(\[{<]\s*(.*?)\s*[)\]}>]$", r"\1", cell) for cell in row]
        units = [cell for cell in bare if cell]
        known = [cell for cell in units if _any_unit(cell)]
        alike = sum(cell in known or cell.casefold() in _OTHER_UNITS for cell in units)
        if known and 2 * alike >= len(units):
            below = [*bare, *[""] * n][:n]
            others.remove(row)
            break
    for row in others:  # groups of columns, and words below the names
        if sum(map(bool, row)) > 1 and not any(map(_looks_number, row)):
            group = ""
            for k, cell in enumerate([*row, *[""] * n][:n]):
                group = cell or (group if row in above[at:] else "")  # merged cells
                beside[k] += f" {group}"
    if rows[0][1][0].casefold() == "labview measurement":
        labels = [row for _, row in rows[:first] if row[0].casefold() == "y_unit_label"]
        below = [*labels[-1], *[""] * n][:n] if labels else below
        for k, name in enumerate(names):
            if name.casefold() == "x_value":
                names[k], below[k] = "Time", "s"
    names = [name or f"column {k + 1}" for k, name in enumerate(names)]
    start = next(k for k in range(max(first - at, 0), first + 1) if k == first or looks[k])
    return names, below, beside, start


def _decimal(
    rows: Sequence[tuple[str, ...]], given: str | None, delimiter: str
) -> tuple[str, bool]:
    """The decimal sign of the numbers, and whether thousands are grouped; refuses what nothing tells."""
    if given is not None:
        if given not in {".", ","}:
            raise InputError(f"--column decimal={given}: the decimal sign is . or ,")
        return given, True
    certain: dict[str, str] = {}  # sign, and an example of it
    doubtful: dict[str, str] = {}  # it may stand between thousands
    grouped = False
    for cell in (cell for row in rows for cell in row if "." in cell or "," in cell):
        if ":" in cell or not _looks_number(cell):
            continue
        plain = _ascii(cell)
        sign = max(",.", key=plain.rfind)
        other = "," if sign == "." else "."
        if other in plain or plain.count(sign) > 1:
            certain.setdefault(sign if other in plain else other, plain)
            grouped = True
        elif _GROUPS[other].fullmatch(plain) and " " not in plain and "'" not in plain:
            doubtful.setdefault(sign, plain)
        else:
            certain.setdefault(sign, plain)
    remedy = "say which sign is the decimal one, --column decimal=, or --column decimal=."
    if len(certain) == 2 or ("," in certain and "." in doubtful and not grouped):
        one, two = certain.get(".") or doubtful["."], certain[","]
        raise InputError(
            f"{one!r} has a point and {two!r} a comma: write all with one sign, or {remedy}"
        )
    if not certain and ("," in doubtful or (doubtful and delimiter == ";")):
        cell = doubtful.get(",") or doubtful["."]
        raise InputError(
            f"{cell!r} may be {cell.replace(',', '.')} or {re.sub('[.,]', '', cell)}: {remedy}"
        )
    return ("," if "," in certain else "."), grouped or "," in doubtful


def _numbers(cells: Sequence[str], sheet: _Sheet) -> np.ndarray:
    """Values of a column, nan where there is none."""
    sign, other = sheet.decimal, "," if sheet.decimal == "." else "."
    joined = sign == "," and not any("." in cell for cell in cells)
    if joined or sign == ".":
        try:
            values = np.array([c.replace(",", ".") for c in cells] if joined else cells, float)
        except ValueError:
            pass
        else:
            return np.where(np.isfinite(values), values, np.nan)

    def number(cell: str) -> float:
        cell = _ascii(cell)
        if not (_NUMBER.fullmatch(cell) and other not in cell):
            grouped = sheet.grouped or " " in cell or "'" in cell
            if not (grouped and _GROUPS[sign].fullmatch(cell)):
                return math.nan
            cell = re.sub(f"[ '{other}]", "", cell)
        return float(cell.replace(",", "."))

    return np.array(list(map(number, cells)))


# --- names


def unit_size(unit: str, kind: str) -> tuple[float, bool | None] | None:
    """The multiplier that takes a unit, in any maker's spelling, to SI; None where it is not known.

    Returns:
        The multiplier, and of a pressure whether it is absolute, gauge, or not said (None).

    >>> unit_size("mbar", "pressure"), unit_size("kgf/cm^2", "pressure"), unit_size("psia", "pressure")[1]
    ((100.0, None), (98066.5, None), True)
    """
    text = re.sub(r"[\s^*\u00b7()]", "", unicodedata.normalize("NFKC", unit)).rstrip(".")
    known, lower = _SIZES[kind], text.casefold()
    same = [name for name in known if name.casefold() == lower]
    if lower in {"mn", "mpa"}:  # milli or mega: the case tells
        same = [name for name in same if name == "MPa" and text[0] == "M"]
    elif text[:1] == "M" and not text.isupper():
        same = [name for name in same if name[0] == "M"]
    if text in known:
        return known[text], None
    if len({known[name] for name in same}) == 1:
        return known[same[0]], None
    if kind == "pressure" and len(text) > 2 and lower[-1] in "agü":
        found = unit_size(text[:-1], kind)
        return found and (found[0], lower[-1] == "a")
    return None


def _any_unit(text: str) -> bool:
    """Whether a text is a unit of any kind."""
    return bool(text.strip("- ")) and (
        bool(_CLOCK_UNIT.fullmatch(text))
        or any(unit_size(_MODE.sub("", text), kind) is not None for kind in _SIZES)
    )


def _tokens(text: str) -> list[str]:
    """The words of a name, composed ones in their parts."""
    apart = re.sub("(?<=[a-zäöüß])(?=[A-ZÄÖÜ])", " ", text)
    words = re.findall(r"[^\W\d_]+", apart.casefold())
    return [part for word in words for part in _parts(word)]


@functools.lru_cache(4096)
def _parts(word: str) -> tuple[str, ...]:
    if word in _HEADS or word in _KNOWN:
        return (word,)
    for head in sorted(_HEADS, key=len, reverse=True):
        for rest in {word.removeprefix(head), word.removesuffix(head)} - {word, ""}:
            rest = rest if rest in _KNOWN or len(head) == 1 else rest.removesuffix("s")  # noqa: PLW2901
            if rest in _KNOWN or (head in _JOINED and len(rest) > 1):
                return head, rest
    return (word,)


def _strange(text: str) -> bool:
    """Whether no word of a text is known: it may be a unit that is not."""
    return not any(word in _KNOWN or word in _HEADS for word in _tokens(text))


def _split_unit(text: str) -> tuple[str, str]:
    """`Load (N)`, `Kraft [N]`, `Weg / mm`, `time_s`, `Force, N`: the name and the unit, or "" for none."""
    unknown: list[tuple[str, str]] = []
    for pattern in _BRACKETS:
        for match in reversed(list(pattern.finditer(text))):
            inner, rest = match[1].strip(), f"{text[: match.start()]} {text[match.end() :]}".strip()
            if inner and (_any_unit(inner) or inner.casefold() in _OTHER_UNITS):
                return rest, inner
            if inner and rest and _strange(inner):
                unknown.append((rest, inner))
    for match in _BESIDE.finditer(text):
        stem, tail = text[: match.start()], text[match.end() :]
        words = _tokens(stem)
        heads = {_HEADS[word] for word in words if word in _HEADS}
        if any(unit_size(tail, KINDS[head]) for head in heads):
            return stem, tail
        alone = heads and all(word in _HEADS or word in _STD for word in words) and match[0].strip()
        if alone and not tail.isdecimal() and _strange(tail):
            unknown.append((stem, tail))
    return unknown[0] if unknown else (text, "")


def _joined_mode(text: str) -> str:
    """A text whose units have their `(a)` or `g` beside them."""
    return _MODE_BESIDE.sub(lambda m: f"{m[1]}{m[2] or m[3]}", unicodedata.normalize("NFKC", text))


@functools.lru_cache(4096)
def judge(name: str, below: str = "") -> Column:
    """What the name of a column says.

    Args:
        name: as the table has it.
        below: unit in a row of its own.

    >>> judge("Pressure setpoint (psi)").reason, judge("Kraft [kN]").unit, judge("p abs. / mbar").absolute
    ('a set point or command', 'kN', True)
    """
    text, below = _joined_mode(name).strip(" '\"#"), _joined_mode(below)
    said = [bool(match[1]) for match in _MODE.finditer(f"{text} {below}")]
    text = (
        re.sub(r"[(\[{]\s*[)\]}]", "", _MODE.sub(" ", text))
        .replace("__", "_")
        .strip(" _,")
        .rstrip("-")
    )
    title, unit = _split_unit(text)
    below = _MODE.sub("", below).strip(" ,()[]")
    words = _tokens(title)
    heads = {_HEADS[word] for word in words if word in _HEADS}
    quantity = heads.pop() if len(heads) == 1 else None
    reasons = [_REASONS[word] for word in words if word in _REASONS]
    if (quantity == "length" and said) or re.search(r"(?<![^\W_])[A-Za-z]_?0(?![^\W_])", title):
        reasons.append("an offset or setting")
    if quantity == "valve_state" and set(words) <= {"valve", "ventil", "state", "status"}:
        reasons = []
    absolute = True if {"abs", "absolut", "absolute"} & set(words) else said[0] if said else None
    return Column(
        name, title, below if below and not _any_unit(unit) else unit,
        f"{quantity}_std" if quantity and _STD & set(words) else quantity,
        reasons[0] if reasons else "",
        _KNOWN | _HEADS.keys() >= set(words) and not _FORMULA.search(title),
        absolute,
    )  # fmt: skip


def _remedy(quantity: str, name: str) -> str:
    return f"--column {quantity}=\"{name}\" (columns={{'{quantity}': '{name}'}} in Python)"


def _find(
    quantity: str, held: Sequence[Column], wanted: str | None, clock: Callable
) -> Column | None:
    """The column of a quantity; None where there is none."""
    kind = kind_of(quantity)
    if wanted == "-":
        return None
    if wanted is not None:
        one = _wanted(quantity, held, wanted)
    else:
        mine = [one for one in held if one.quantity == quantity and one.plain and not one.reason]
        # Load and load rate: the unit tells.
        fitting = [one for one in mine if unit_size(one.unit, kind) is not None]
        mine = fitting or [one for one in mine if not _any_unit(one.unit)] or mine
        if quantity == "time" and len(mine) > 1:
            mine = [one for one in mine if len(_tokens(one.title)) == 1] or mine
        if not mine:
            return None
        one = mine[0]
        if len(mine) > 1:
            alone = sum(other.name == one.name for other in held) == 1
            raise InputError(
                f"{len(mine)} columns for {quantity} ({', '.join(one.name for one in mine)}): say which, "
                f"{_remedy(quantity, one.name if alone else str(one.place + 1))}"
            )
    if quantity == "time" and clock(one.place):
        return one
    size = unit_size(one.unit, kind)
    if size is not None:
        return one._replace(size=size[0], absolute=one.absolute if size[1] is None else size[1])
    every = [unit for unit in _SIZES[kind] if unit]
    lacks = (
        f"the unknown unit {shortened(one.unit)}" if one.unit else "no unit, in its name or below"
    )
    hint = ": a contraction is (L0 - L)/L0, a fraction or in %" if kind == "contraction" else ""
    raise InputError(
        f"{one} has {lacks}{hint}; known units of {kind} are: {', '.join(every)}"
        f"{meant(one.unit, every)}: say it, {_remedy(quantity, f'{one.title} [{every[0]}]')}"
    )


def _wanted(quantity: str, held: Sequence[Column], wanted: str) -> Column:
    """The column that the user names, with or without its unit or by number, with the unit that is said."""
    wanted = wanted.strip()
    title, unit = _split_unit(_joined_mode(wanted))
    said = [bool(match[1]) for match in _MODE.finditer(unit)]
    unit = _MODE.sub("", unit).strip(" ,()")
    for match in (
        lambda one: one.name == wanted,
        lambda one: title in (one.name, one.title),
        lambda one: title.casefold() in (one.name.casefold(), one.title.casefold()),
        lambda one: title == str(one.place + 1),
    ):
        found = [one for one in held if match(one)]
        if len(found) == 1:
            one = found[0]
            absolute = said[0] if said else None if unit and unit != one.unit else one.absolute
            return one._replace(unit=unit or one.unit, absolute=absolute, named=True)
    raise InputError(
        f"--column {quantity}={wanted}: no column, or more than one, has that name; the table has "
        f"{', '.join(one.name for one in held)}, by name or by number from 1"
    )


def _missing(quantity: str, held: Sequence[Column]) -> InputError:
    """What is there in the place of a quantity, and how to say which it is."""
    kind = kind_of(quantity)
    near = [
        f"{shortened(one.name)} {f'is {one.reason}' if one.reason else 'may be it, or not'}"
        for one in held
        if one.quantity == quantity or (one.reason and unit_size(one.unit, kind) is not None)
    ]
    known = [f"{quantity}_{unit}" for unit in UNITS.get(kind, {})]
    spelt = ("_".join(re.findall(r"[^\W_]+", one.name)) for one in held)
    hint = next(filter(None, (meant(name, known) for name in spelt)), "")
    example = "1 [N]" if held[0].name == "column 1" else "NAME [unit]"
    return InputError(
        f"no column for {quantity}{': ' * bool(near)}{'; '.join(near)}; the table has "
        f"{', '.join(shortened(one.name)[1:-1] for one in held)}{hint}: name it with its unit, as in "
        f"{known[-1]}, or say which it is, {_remedy(quantity, example)}"
    )


def _find_all(sheet: _Sheet, asked: _Asked, clock: Callable[[int], bool]) -> dict[str, Column]:
    """The columns of quantities by their names."""
    held = []
    for k, (name, below, beside) in enumerate(
        zip(sheet.names, sheet.below, sheet.beside, strict=True)
    ):
        one = judge(name, below)
        held.append(one._replace(place=k, reason=one.reason or judge(beside).reason))
    found: dict[str, Column] = {}
    for quantity in (*asked.needed, *asked.optional):
        both = {}
        for name in dict.fromkeys((quantity, quantity.replace("length", "contraction"))):
            if (one := _find(name, held, asked.columns.get(name), clock)) is not None:
                both[name] = one
        if len(both) > 1:
            raise InputError(
                f"{' and '.join(map(repr, both))} say the same of a reading; keep one column"
            )
        if not both and quantity in asked.needed:
            raise _missing(quantity, held)
        found |= both
    return found


# --- columns


def _of_sheet(sheet: _Sheet, asked: _Asked) -> Table:
    """The columns of a sheet in SI."""
    names, body, width = sheet.names, sheet.rows, len(sheet.names)
    if asked.strict:  # up to the last row that holds a number: a footer is none
        last = max(k for k, (_, row) in enumerate(body) if any(map(_looks_number, row)))
        body = body[: last + 1]
        for line, row in body:
            if len(row) > width:
                raise InputError(
                    f"row {line} has {len(row)} cells, the header has {width}: write decimal points, or "
                    "name every column"
                )
    lines = np.array([line for line, _ in body])
    blank = ("",) * width
    padded = [(*row, *blank[len(row) :]) if len(row) <= width else blank for _, row in body]
    cells = list(zip(*padded, strict=True))

    def clock(place: int) -> bool:
        return any(":" in cell for cell in cells[place][:_NEAREST])

    found = _find_all(sheet, asked, clock)
    values = {
        quantity: _clock(_dated(one.place, names, cells), one)
        if quantity == "time" and clock(one.place)
        else _numbers(cells[one.place], sheet)
        for quantity, one in found.items()
    }
    bad = np.any([np.isnan(column) for column in values.values()], axis=0)
    if asked.strict and bad.any():
        k = int(np.argmax(bad))
        quantity = next(quantity for quantity, column in values.items() if np.isnan(column[k]))
        _refuse_cell(quantity, cells[found[quantity].place][k], int(lines[k]))
    if bad.all():
        raise InputError("no row has numbers in all the columns that are needed")
    others = {}
    for k in sorted(set(range(width)) - {one.place for one in found.values()}):
        if any(map(_looks_number, cells[k][:_NEAREST])):
            label = f"{names[k]} ({sheet.below[k]})" if sheet.below[k] else names[k]
            label = label if names.count(names[k]) == 1 else f"{label} [{k + 1}]"
            others[label] = _numbers(cells[k], sheet)[~bad]
    unread = tuple(line for line in lines[bad].tolist() if line < lines[~bad][-1])
    kept = {quantity: column[~bad] for quantity, column in values.items()}
    return _in_si(kept, found, others, lines[~bad], asked, unread=unread, comments=sheet.comments)


def _dated(place: int, names: Sequence[str], cells: Sequence[Sequence[str]]) -> Sequence[str]:
    """Times of the day with the date that stands in a column of its own."""
    for k, name in enumerate(names):
        if k != place and {"date", "datum"} & set(_tokens(name)):
            both = [" ".join(one) for one in zip(cells[k], cells[place], strict=True)]
            if _STAMP.fullmatch(both[0]):
                return both
    return cells[place]


def _refuse_cell(quantity: str, cell: str, line: int) -> None:
    hint = " (write a decimal point, and nothing between thousands)" if "," in cell else ""
    fault = f"is {shortened(cell)}, not a number{hint}"
    if cell.lstrip("+-").casefold() in {"nan", "inf", "infinity"}:
        fault = f"is {cell}; every value must be finite"
    fault = fault if cell else "is missing; take the row out, or write what was read"
    raise InputError(f"row {line}: {quantity} {fault}")


def _in_si(
    values: Mapping[str, np.ndarray],
    found: Mapping[str, Column],
    others: dict[str, np.ndarray],
    lines: np.ndarray,
    asked: _Asked,
    **rest: Any,
) -> Table:
    """The numbers of columns in SI, pressures from the atmosphere."""
    columns = {quantity: one.size * values[quantity] for quantity, one in found.items()}
    for quantity, one in found.items():
        if not one.named and len(lines) > 2:
            _check_values(quantity, columns[quantity], one, asked)
    one = found.get("pressure")
    if one is not None and one.absolute and not asked.absolute:
        if "atmosphere" not in asked.columns:
            raise InputError(
                f"{one} is an absolute pressure, and a muscle's is counted from the atmosphere: say what "
                "that was, --column atmosphere=101.3kPa, or give a column of gauge pressure"
            )
        columns["pressure"] -= parse_quantity(asked.columns["atmosphere"], "pressure")
    taken = {key: one._replace(first=float(values[key][0])) for key, one in found.items()}
    return Table(columns, taken, others, lines, **rest)


def _check_values(quantity: str, values: np.ndarray, one: Column, asked: _Asked) -> None:
    """Refuse a column whose values are those of something else."""
    raw = values / one.size
    if quantity == "force" and len(raw) >= 10 and np.all(np.diff(raw) == 1) and raw[0] % 1 == 0:
        remedy = _remedy("force", "NAME [unit]")
        raise InputError(f"{one} counts the rows: say which is the force, {remedy}")
    if quantity != "pressure" or asked.absolute or one.absolute is not None:
        return
    low, high = float(values.min()), float(values.max())
    at_one = _ATMOSPHERE[0] < low < _ATMOSPHERE[1]
    stands = low == high and at_one
    stands |= _BAROMETER[0] < low < high < _BAROMETER[1] and high - low < 0.01 * high
    plain = math.isclose(float(f"{raw.min():.2g}"), raw.min())  # 30 inHg is set, not read
    if stands or (at_one and high > 1.3 * low and not plain):
        remedy = f'--column pressure="{one.title} [{one.unit}'
        raise InputError(
            f"{one} {'stands' if stands else 'begins'} at the atmosphere, "
            f'{raw.min():.6g} {one.unit}, as absolute readings do: say what it is, {remedy} gauge]" or '
            f'{remedy} abs]" with --column atmosphere=101.3kPa; or leave it aside, --column pressure=-'
        )


# --- times


def _clock(cells: Sequence[str], one: Column) -> np.ndarray:
    """Seconds of time stamps, across midnight and over days; nan where a cell is none."""
    stamps = [_STAMP.fullmatch(cell) for cell in cells]
    good = [stamp for stamp in stamps if stamp is not None]
    if not good:
        return np.full(len(cells), np.nan)
    minutes, days = _minutes_first(good, one), _days([stamp["date"] or "" for stamp in good], one)
    seconds = []
    for stamp in good:
        a, b, c = (int(stamp[part] or 0) for part in "abc")
        if minutes and stamp["c"] is None:
            a, b, c = a // 60, a % 60, b
        if stamp["half"]:
            a = a % 12 + 12 * (stamp["half"][0] in "pP")
        zone = re.sub("Z|UTC|:", "", stamp["zone"] or "") or "+0000"
        shift = 3600 * int(zone[:3]) + 60 * int(zone[0] + zone[3:])
        whole = 3600 * a + 60 * b + c + float(f"0.{stamp['f'] or 0}") - shift
        seconds.append(whole if b < 60 and c < 60 else math.nan)
    known = np.array(seconds) + days * _DAY
    if not days.any():
        wrap = 3600.0 if minutes else _DAY
        with np.errstate(invalid="ignore"):
            back = np.diff(known) < -wrap / 2
        known[1:] += wrap * np.cumsum(back)
    found = np.full(len(cells), np.nan)
    found[[stamp is not None for stamp in stamps]] = known
    return found


def _minutes_first(stamps: Sequence[re.Match[str]], one: Column) -> bool:
    """Whether stamps of two parts are minutes and seconds; what nothing tells is refused.

    They are where there are fractions, more than 23 of the first, or a wrap at the hour; they are hours and
    minutes where they wrap at midnight. The unit may say it.
    """
    said = _CLOCK_UNIT.fullmatch(one.unit.strip())
    if said:
        if said[1][0] in "mM" and (said[3] or said[2][0] not in "sS"):
            raise InputError(
                f"the time's form {one.unit!r} is not known: hh:mm:ss, hh:mm and mm:ss are"
            )
        return said[1][0] in "mM"
    if any(stamp["c"] or stamp["half"] or stamp["date"] for stamp in stamps):
        return False
    first = np.array([int(stamp["a"]) for stamp in stamps])
    whole = first * 60 + np.array([int(stamp["b"]) for stamp in stamps])
    if any(stamp["f"] for stamp in stamps):
        return True
    if np.mean(np.diff(whole) == 0) > _REPEATED:
        raise InputError(
            f"the time in {one} does not advance, {whole.size} rows have {np.unique(whole).size} stamps, "
            "hours and minutes it seems: export the time with seconds"
        )
    back = np.flatnonzero(np.diff(whole) < 0)
    if first.max() > 23 or (back.size and first[back].min() >= 59):
        return True
    if back.size and np.all(first[back] == 23) and np.all(first[back + 1] == 0):
        return False
    raise InputError(
        f"the time in {one}, {stamps[0][0]!r}, may be minutes and seconds or hours and minutes: say which, "
        f"{_remedy('time', f'{one.title} [mm:ss]')} or [hh:mm]"
    )


def _days(dates: Sequence[str], one: Column) -> np.ndarray:
    """Days since the first of these dates, which must rise in one order of day and month alone."""
    distinct = list(dict.fromkeys(dates))
    if len(distinct) == 1:
        return np.zeros(len(dates))
    readings = set()
    for form in _DATES:
        try:
            plain = [re.sub("[./ ]", "-", date) for date in distinct]
            days = [datetime.datetime.strptime(date, form).toordinal() for date in plain]
        except ValueError:
            continue
        if all(np.diff(days) > 0):
            readings.add(tuple(day - days[0] for day in days))
    best = sorted(readings, key=lambda days: days[-1])
    if not best or (len(best) > 1 and best[0][-1] > 2 * len(distinct)):
        raise InputError(
            f"the dates in {one}, {distinct[0]!r} and {distinct[1]!r}, do not rise or can be read in "
            "more than one way: write them as 2021-03-04"
        )
    number = dict(zip(distinct, best[0], strict=True))
    return np.array([number[date] for date in dates], float)


def check_time(table: Table, most: float = _REPEATED) -> np.ndarray:
    """Rows of a table whose time is later than that of the row before.

    Args:
        table: with a time.
        most: part of the rows that may share the time of the row before.

    Raises:
        InputError: time goes back, or does not advance.
    """
    time, step = table.columns["time"], np.diff(table.columns["time"])
    for k in np.flatnonzero(step < 0):
        raise InputError(
            f"time goes back from {time[k]:.6g} s to {time[k + 1]:.6g} s at line {table.lines[k + 1]}: a "
            "file must hold one test; split it there"
        )
    if step.size and np.mean(step == 0) > most:
        raise InputError(
            f"the time does not advance in {np.sum(step == 0)} of {time.size} rows: export it with "
            "fractions of a second"
        )
    return np.concatenate([[True], step > 0])

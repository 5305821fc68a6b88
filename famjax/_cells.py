"""Split a text file or workbook into cells; find its delimiter, decimal sign and column names."""

import codecs
import csv
import dataclasses
import datetime
import functools
import io
import itertools
import math
import re
import zipfile
import zlib
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ._headers import OTHER_UNITS, any_unit, judge
from ._stamps import STAMP
from .boundary.errors import InputError

MOST_BYTES = 500e6  # limit of a file, and of an unpacked workbook
_MOST_CELLS = 5e6  # limit of a sheet
_SAMPLE = 2000  # number of lines from which delimiter and decimal sign are determined
NEAREST = 6
"""Number of rows above the numbers that are searched for names, and of readings checked per column."""
DAMAGED = (
    ValueError, TypeError, LookupError, AttributeError, ArithmeticError, OSError, EOFError, SyntaxError,
    RuntimeError, MemoryError, zipfile.BadZipFile, zlib.error,
)  # fmt: skip
"""Exceptions that may be raised while a damaged workbook is read."""
_GROUPS = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:[, ']\d{3})+(?:\.\d*)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:[. ']\d{3})+(?:,\d*)?"),
}
_COMMENT = re.compile(r'[\s"]*(?:#|(?:%+|//+|!+)[ \t]*(?=[^\W\d]|["\[(]))')
_NUMBER = re.compile(r"[+-]?(?:\d+[.,]?\d*|[.,]\d+)(?:[eE][+-]?\d+)?")


@dataclasses.dataclass(frozen=True)
class Asked:
    """Requested columns and options; see `famjax.tables.read_table`."""

    needed: tuple[str, ...]
    optional: tuple[str, ...]
    columns: Mapping[str, str]
    strict: bool = False
    absolute: bool = False
    fewest: int = 1


def read_bytes(source: Any) -> bytes:
    try:
        file = getattr(
            source, "buffer", source
        )  # of an open text, whatever its encoding is said to be
        held = file.read() if hasattr(file, "read") else Path(file).read_bytes()
    except OSError as error:
        raise InputError(f"cannot read the file: {error.strerror}") from None
    return held.encode() if isinstance(held, str) else bytes(held)


def decoded_text(data: bytes) -> str:
    """Decode a file in UTF-8, in cp1252, or in UTF-16 with or without a byte order mark."""
    head = data[:200].lstrip(b"\xef\xbb\xbf \r\n\t").lower()
    if head.startswith((b"\xd0\xcf\x11\xe0", b"<?xml", b"<!doctype", b"<html", b"<table")):
        raise InputError(
            "this is an .xls workbook, XML or HTML, not a text file: save it as .xlsx or CSV"
        )
    encodings = ["utf-8-sig", "cp1252"]
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        encodings = ["utf-16"]
    elif b"\0" in data:
        # Latin text in UTF-16 has a zero in every second byte, which tells the byte order.
        little = data[1:2000:2].count(0) > data[0:2000:2].count(0)
        encodings = ["utf-16-le" if little else "utf-16-be"]
    for encoding in encodings:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text.removeprefix("\ufeff")
    raise InputError("this is not a text file in UTF-8, UTF-16 or cp1252: export the table as text")


def check_workbook(data: bytes) -> None:
    """Reject a workbook that is too large when unpacked, has too large a sheet, or defines XML entities.

    The sizes stated in the archive can be trusted, because Python never unpacks more than the stated size.
    A genuine workbook never contains a document type declaration.
    """
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if (size := sum(part.file_size for part in archive.infolist())) > MOST_BYTES:
            raise InputError(
                f"the workbook unpacks to {size / 1e6:.0f} MB, above the limit of "
                f"{MOST_BYTES / 1e6:.0f} MB: save its table as CSV"
            )
        for part in archive.infolist():
            content = archive.read(part).replace(b"\0", b"")
            if b"<!DOCTYPE" in content or b"<!ENTITY" in content:
                raise InputError(
                    "the workbook defines XML entities, which no spreadsheet program does: save it as CSV"
                )
            places = re.findall(rb'<(?:\w+:)?c\s[^>]*?r="([A-Z]+)(\d+)"', content)
            width, rows = (max(map(f, places), default=1) for f in (_width, lambda at: int(at[1])))
            rows = max(
                map(int, re.findall(rb'<(?:\w+:)?row\s[^>]*?r="(\d+)"', content)), default=rows
            )
            cells = max(width * rows, len(re.findall(rb"<(?:\w+:)?c[\s>/]", content)))
            if cells > _MOST_CELLS:
                raise InputError("a sheet in the workbook is too large: save the table as CSV")


def _width(place: tuple[bytes, bytes]) -> int:
    return functools.reduce(lambda n, letter: 26 * n + letter - 64, place[0], 0)


def cell_text(cell: Any) -> str:
    if isinstance(cell, datetime.timedelta):
        cell = datetime.datetime.min + cell
        return f"{(cell.day - 1) * 24 + cell.hour}:{cell:%M:%S.%f}"
    if cell is None or cell != cell:  # noqa: PLR0124 -- nan of any kind
        return ""
    return " ".join(str(cell).split())


@dataclasses.dataclass(frozen=True)
class Sheet:
    """A table split into cells.

    Attributes:
        rows: line number (counted from 1) and cells of every row, starting with the first reading.
        names, below, beside: for each column, its name, its unit from a separate row of units, and other
            words above or below the name; "" if missing.
        decimal: decimal sign, "." or ",".
        grouped: True if some numbers contain thousands separators, so any of them may.
        comments: lines that begin with #.
    """

    rows: list[tuple[int, tuple[str, ...]]]
    names: list[str]
    below: list[str]
    beside: list[str]
    decimal: str
    grouped: bool
    comments: tuple[str, ...]


def split_text(text: str, asked: Asked) -> Sheet:
    """Split text into cells at the delimiter that yields the most names and numbers."""
    lines = text.splitlines()
    stated = re.fullmatch(r'(?i)"?sep=(.)"?\s*', lines[0]) if lines else None
    held = [(n, one) for n, one in enumerate(lines, 1) if one.strip(" \t;,|")][bool(stated) :]
    apart = {n for n, one in held if _is_comment(one)}
    comments = tuple(one.strip(" \t,;") for n, one in held if n in apart)
    body = [(n, one) for n, one in held if n not in apart]
    if not body:
        raise InputError(
            "the file is empty: it needs column names, such as pressure_kPa,length_mm,force_N"
        )
    if re.match(r"\d\d:\d\d:\d\d\.\d+ -> ", body[-1][1]):
        raise InputError(
            "the lines begin with time stamps from a serial monitor: switch these off, and send "
            "the time as a column"
        )
    found: list[tuple[tuple[float, ...], str]] = []
    for rank, delimiter in enumerate([stated[1]] if stated else "\t;,| "):
        rows = [(n, _cells(line, delimiter)) for n, line in body[:_SAMPLE]]
        first, width = _block([cells for _, cells in rows], asked.fewest)
        if width:
            names, *_ = _header(rows, first, width, comments)
            inside = [cell for _, row in rows[first:] for cell in row if cell]
            share = round(sum(map(looks_number, inside)) / len(inside), 1)
            known = sum(judge(name).quantity is not None for name in names)
            found.append(((known, share, width, -rank), delimiter))
    if not found:
        raise InputError(
            "the file contains no readings or no block of numbers: it needs at least "
            f"{asked.fewest} row(s) of two or more numbers, separated by tabs, semicolons, commas, "
            "vertical bars or spaces"
        )
    delimiter = max(found)[1]
    plain = '"' not in text if delimiter == "," else "," not in text
    rows = [(n, _cells(line, delimiter)) for n, line in body]
    return sheet_of(rows, comments, asked, delimiter, plain=plain)


def sheet_of(
    rows: list[tuple[int, tuple[str, ...]]],
    comments: tuple[str, ...],
    asked: Asked,
    delimiter: str = "",
    *,
    plain: bool = False,
) -> Sheet:
    """Find the block of numbers in these rows, the column names above it and the decimal sign."""
    first, width = _block([row for _, row in rows[:_SAMPLE]], asked.fewest)
    if not width:
        raise InputError("there is no block of numbers")
    names, below, beside, first = _header(rows, first, width, comments)
    body = rows[first:]
    named = max((k for k, name in enumerate(names, 1) if not _UNNAMED.fullmatch(name)), default=0)
    if 0 < named == width - 1 and _row_names([r[0] for _, r in body[:_SAMPLE] if len(r) == width]):
        names = ["row", *names[:-1]]
        below, beside = (["", *one[:-1]] for one in (below, beside))
        named = width
    inside = [row for _, row in (body[:_SAMPLE] if plain else body)]
    for line, row in body if named else ():
        if len(row) > named and all(map(looks_number, row)):
            raise InputError(
                f"line {line} has {len(row)} numbers, but the header has {named} names: name every column. "
                "If commas are decimal or thousands separators, export the table with semicolons"
            )
    sign, grouped = _decimal(inside, asked.columns.get("decimal"), delimiter)
    return Sheet(body, names, below, beside, sign, grouped, comments)


_UNNAMED = re.compile(r"column \d+")


def _row_names(cells: Sequence[str]) -> bool:
    """Return True if these first cells of the rows are labels or numbers that count the rows."""
    if not any(map(looks_number, cells)):
        return True
    whole = all(re.fullmatch(r"\d+", cell) for cell in cells)
    return whole and all(int(b) == int(a) + 1 for a, b in itertools.pairwise(cells))


def _is_comment(line: str) -> bool:
    """Return True for a line that begins with #, %, // or !, but not for a row of units: `% kPa N`."""
    mark = _COMMENT.match(line)
    words = re.split(r"[\s,;|]+", line[mark.end() :].strip()) if mark else []
    return mark is not None and (mark[0].endswith("#") or not all(map(any_unit, words)))


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    if delimiter == " ":
        names = re.split(r"\s{2,}", line.strip())  # a name may contain a blank
        return tuple(names if len(names) > 1 and re.search("[^\\W\\d]", line) else line.split())
    cells = next(csv.reader([line], delimiter=delimiter)) if '"' in line else line.split(delimiter)
    return trimmed_cells(tuple(map(str.strip, cells)))


def trimmed_cells(cells: tuple[str, ...]) -> tuple[str, ...]:
    """Remove empty cells at the end of a row."""
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _ascii(cell: str) -> str:
    """Replace the Unicode minus, apostrophe and narrow spaces in a number with ASCII characters."""
    if cell.isascii():
        return cell
    return re.sub("[\u00a0\u2009\u202f]", " ", cell).replace("\u2212", "-").replace("\u2019", "'")


def looks_number(cell: str) -> bool:
    cell = _ascii(cell)
    return any("0" <= one <= "9" for one in cell) and any(
        form.fullmatch(cell) for form in (_NUMBER, *_GROUPS.values(), STAMP)
    )


def _block(rows: Sequence[tuple[str, ...]], fewest: int) -> tuple[int, int]:
    """Return the first row and the width of the block of numbers; zeros if there is none."""
    looks = [sum(map(looks_number, row)) for row in rows]
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
    """Return column names, units from a separate row, other words, and the first row of numbers.

    The numbers begin directly below the names, even if their first rows are incomplete.
    """
    looks = [sum(map(looks_number, row)) for _, row in rows[:first]]
    above = [list(row) for _, row in rows[:first]][: -NEAREST - 1 : -1]
    if not first and comments:  # as NumPy writes it
        line = comments[-1].lstrip("#%/! ")
        split = [line.split(), *(list(_cells(line, d)) for d in " \t;,|")]
        above = [next((cells for cells in split if len(cells) == width), split[0])]
    scores = [
        sum(bool(judge(cell).quantity or judge(cell).reason) for cell in row) for row in above
    ]
    texts = [
        k for k, row in enumerate(above) if 2 * len(row) > width and not any(map(looks_number, row))
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
        known = [cell for cell in units if any_unit(cell)]
        alike = sum(cell in known or cell.casefold() in OTHER_UNITS for cell in units)
        if known and 2 * alike >= len(units):
            below = [*bare, *[""] * n][:n]
            others.remove(row)
            break
    for row in others:  # groups of columns, and words below names
        if sum(map(bool, row)) > 1 and not any(map(looks_number, row)):
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
    """Return the decimal sign, and True if thousands are grouped; reject an ambiguous sign."""
    if given is not None:
        if given not in {".", ","}:
            raise InputError(f"--column decimal={given}: the decimal sign must be . or ,")
        return given, True
    certain: dict[str, str] = {}  # sign, and an example of it
    doubtful: dict[str, str] = {}  # may separate thousands
    grouped = False
    for cell in (cell for row in rows for cell in row if "." in cell or "," in cell):
        if ":" in cell or not looks_number(cell):
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
    remedy = "specify the decimal sign with --column decimal=, or --column decimal=."
    if len(certain) == 2 or ("," in certain and "." in doubtful and not grouped):
        one, two = certain.get(".") or doubtful["."], certain[","]
        how = remedy if delimiter else "store all readings as numbers, not as text"
        raise InputError(
            f"{one!r} has a point and {two!r} has a comma: use one decimal sign throughout, or {how}"
        )
    if not certain and ("," in doubtful or (doubtful and (delimiter == ";" or _mixed(rows)))):
        cell = doubtful.get(",") or doubtful["."]
        raise InputError(
            f"{cell!r} may mean {cell.replace(',', '.')} or {re.sub('[.,]', '', cell)}: {remedy}"
        )
    return ("," if "," in certain else "."), grouped or "," in doubtful


def _mixed(rows: Sequence[tuple[str, ...]]) -> bool:
    """Return True if whole numbers and numbers such as 1.100 stand in one column."""
    columns = itertools.zip_longest(*rows, fillvalue="")
    return any(
        any(_GROUPS[","].fullmatch(cell) for cell in column)
        and any(re.fullmatch(r"[1-9]\d*", cell) for cell in column)
        for column in columns
    )


def numbers_of(cells: Sequence[str], sheet: Sheet) -> np.ndarray:
    """Return a column as numbers, with nan for cells that are not numbers."""
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

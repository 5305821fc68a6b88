"""The text of a delimited log: its encoding, its delimiter, its decimal sign, its block of numbers."""

import codecs
import csv
import dataclasses
import re
from collections import Counter
from pathlib import Path

from famjax.boundary.errors import InputError

DELIMITERS = ("\t", ";", ",", "|", " ")
"""Tried in this order; the blank stands for any run of blanks."""

_NUMBER = r"[+-]?(?:\d+(?:{p}\d*)?|{p}\d+)(?:[eE][+-]?\d+)?"
_PATTERN = {
    ".": re.compile(_NUMBER.format(p=r"\.")),
    ",": re.compile(_NUMBER.format(p=",")),
}
_GROUPED = {
    ".": re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d+)?"),
    ",": re.compile(r"[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d+)?"),
}
_CLOCK = re.compile(r"(?:(\d+):)?(\d{1,2}):(\d{1,2}(?:[.,]\d+)?)")
_FEWEST_COLUMNS, _FEWEST_ROWS = 2, 3
_SAMPLE = 2000  # lines that tell delimiter and decimal sign, where they hold a block of numbers


@dataclasses.dataclass(frozen=True)
class LogText:
    """A delimited text in cells.

    Attributes:
        delimiter: between cells; a blank stands for any run of blanks.
        decimal: "." or ",".
        rows: line number (from 1) and cells of every line that is not empty.
        first: index into `rows` of the first row of numbers.
        n_columns: of the block of numbers.
    """

    delimiter: str
    decimal: str
    rows: tuple[tuple[int, tuple[str, ...]], ...]
    first: int
    n_columns: int


def decoded(path: Path) -> tuple[str, str]:
    """Text and encoding of a file: by its mark, else UTF-16, UTF-8 or cp1252 by its bytes.

    Raises:
        InputError: there is no such file, or it is not text.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from None
    marks = {
        codecs.BOM_UTF8: "utf-8-sig",
        codecs.BOM_UTF16_LE: "utf-16",
        codecs.BOM_UTF16_BE: "utf-16",
    }
    candidates = [name for mark, name in marks.items() if data.startswith(mark)]
    if not candidates and b"\0" in data:
        # Latin text in UTF-16 has a zero in every second byte: which one tells the order.
        candidates = [
            "utf-16-le" if data[1:2000:2].count(0) > data[0:2000:2].count(0) else "utf-16-be"
        ]
    for encoding in candidates or ["utf-8", "cp1252"]:
        try:
            text = data.decode(encoding)
        except UnicodeDecodeError:
            continue
        if "\0" not in text:
            return text, encoding
    raise InputError(f"{path} is not a text file in UTF-8, UTF-16 or cp1252: export it as text")


def split(text: str, decimal: str | None = None) -> LogText:
    """The cells of a log, by the delimiter and decimal sign that make most of it numbers.

    Args:
        text: of the file.
        decimal: "." or ",", where it is known.

    Raises:
        InputError: there is no block of numbers, or the decimal sign is ambiguous.
    """
    if decimal not in {None, ".", ","}:
        raise InputError(f"decimal must be '.' or ',', got {decimal!r}")
    lines = [(n, line) for n, line in enumerate(text.splitlines(), 1) if line.strip(" \t;,|")]
    found = _best(lines[:_SAMPLE], decimal) or _best(lines, decimal)
    if found is None:
        raise InputError(
            f"no block of numbers: at least {_FEWEST_ROWS} lines of {_FEWEST_COLUMNS} numbers, "
            "separated by tab, semicolon, comma, bar or blanks, are needed"
        )
    rows = tuple((n, _cells(line, found.delimiter)) for n, line in lines)
    return dataclasses.replace(found, rows=rows)


def _best(lines: list[tuple[int, str]], decimal: str | None) -> LogText | None:
    """The delimiter and decimal sign that make most cells of these lines numbers, if any do."""
    best: tuple[int, LogText] | None = None
    for delimiter in DELIMITERS:
        if delimiter == " " and best:
            break
        rows = tuple((n, _cells(line, delimiter)) for n, line in lines)
        scored = [
            (score, LogText(delimiter, sign, rows, first, width))
            for sign in ((decimal,) if decimal else (".", ","))
            for score, first, width in [_block([cells for _, cells in rows], sign)]
            if score
        ]
        if len(scored) == 2 and scored[0][0] == scored[1][0]:
            _check_decimal(scored[0][1])
        for found in scored:  # the first to reach a score wins: a decimal point before a comma
            if best is None or found[0] > best[0]:
                best = found
    return best[1] if best else None


def _block(rows: list[tuple[str, ...]], decimal: str) -> tuple[int, int, int]:
    """Cells of numbers in the block, index of its first row, and its width; zeros for no block."""
    counts = [sum(number(cell, decimal) is not None for cell in cells) for cells in rows]
    numeric = [
        n >= _FEWEST_COLUMNS and 2 * n >= sum(1 for cell in cells if cell)
        for n, cells in zip(counts, rows, strict=True)
    ]
    widths = Counter(len(cells) for cells, yes in zip(rows, numeric, strict=True) if yes)
    if not widths:
        return 0, 0, 0
    width = widths.most_common(1)[0][0]
    member = [yes and len(cells) == width for yes, cells in zip(numeric, rows, strict=True)]
    for k in range(len(rows) - _FEWEST_ROWS + 1):
        if all(member[k : k + _FEWEST_ROWS]):
            return sum(n for n, yes in zip(counts[k:], member[k:], strict=True) if yes), k, width
    return 0, 0, 0


def number(cell: str, decimal: str) -> float | None:
    """The value of a cell, a clock time in seconds, or None where it is neither.

    >>> number("1.234,5", ","), number("00:01:02.5", "."), number("---", ".")
    (1234.5, 62.5, None)
    """
    cell = cell.strip()
    if not cell.isascii():
        cell = cell.replace("\u2212", "-").replace("\u00a0", "")
    if _PATTERN[decimal].fullmatch(cell):
        return float(cell if decimal == "." else cell.replace(",", "."))
    if _GROUPED[decimal].fullmatch(cell):
        group = "," if decimal == "." else "."
        return float(cell.replace(group, "").replace(",", "."))
    clock = _CLOCK.fullmatch(cell)
    if clock:
        hours, minutes, seconds = clock.groups()
        return int(hours or 0) * 3600 + int(minutes) * 60 + float(seconds.replace(",", "."))
    return None


def _cells(line: str, delimiter: str) -> tuple[str, ...]:
    if delimiter != " " and '"' not in line:
        return tuple(map(str.strip, line.split(delimiter)))
    if delimiter != " ":
        return tuple(cell.strip() for cell in next(csv.reader([line], delimiter=delimiter)))
    if any(character.isalpha() for character in line):
        names = re.split(r"\s{2,}", line.strip())  # a name may hold a blank
        if len(names) > 1:
            return tuple(names)
    return tuple(line.split())


def _check_decimal(found: LogText) -> None:
    """Refuse numbers such as 1,234 where nothing tells one and a bit from more than a thousand."""
    for _, cells in found.rows[found.first :]:
        for cell in cells:
            if "," in cell and _GROUPED["."].fullmatch(cell):
                raise InputError(
                    f"{cell!r} may be {cell.replace(',', '.')} or {cell.replace(',', '')}: give the "
                    "decimal sign, decimal=',' or decimal='.' (--log-decimal)"
                )

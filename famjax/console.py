"""Code shared by all commands: options, progress, files, tables and units."""

import contextlib
import json
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, Token, validators
from rich.cells import cell_len
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress
from rich.table import Table
from rich.text import Text

from famjax.boundary.errors import InputError
from famjax.boundary.files import check_output, write_all
from famjax.boundary.units import from_si

# --- options

Units = Literal["si", "metric", "us"]
"""Unit system of what a command prints and draws."""


def whole(type_: Any, tokens: Sequence[Token]) -> Any:
    """The whole number of a token, or a tuple of several; never rounded.

    Raises:
        ValueError: one is no whole number.
    """
    found = [_whole(token) for token in tokens]
    return tuple(found) if getattr(type_, "__origin__", None) is tuple else found[0]


def _whole(token: Token) -> int:
    try:
        return int(token.value)
    except ValueError:
        name = token.keyword or "the value"
        raise ValueError(f"{name} must be a whole number, got {token.value!r}") from None


def whole_number(least: int, most: int | None = None) -> Parameter:
    """An option that is a whole number in a range, checked before anything is read or computed."""
    return Parameter(converter=whole, validator=validators.Number(gte=least, lte=most))


Seed = Annotated[int, whole_number(0)]
"""Of random numbers."""

Jobs = Annotated[int | None, whole_number(1)]
"""Number of processes."""


def parse_entries(given: Iterable[str], option: str, example: str) -> dict[str, str]:
    """Parse repeated entries such as `operator=NAME` into names and values.

    Args:
        given: the entries.
        option: its name, for messages.
        example: of an entry, for messages.

    Raises:
        InputError: an entry that is not of this form, or a name twice.

    >>> parse_entries(["force=Load 2"], "log-columns", "force=3")
    {'force': 'Load 2'}
    """
    found: dict[str, str] = {}
    for entry in given:
        name, equals, value = (part.strip() for part in entry.partition("="))
        if not (name and equals and value) or name in found:
            raise InputError(
                f"{option} {entry!r} must read name=value, once for each name, as in {example}"
            )
        found[name] = value
    return found


Signed = Parameter(allow_leading_hyphen=True)
"""An option whose value may begin with a minus sign."""

Columns = Annotated[tuple[str, ...], Parameter(name="--column")]
"""Which column of a table is which quantity."""


def parse_columns(given: Iterable[str]) -> dict[str, str]:
    """Columns by quantity, of entries such as `force="Kraft [N]"`.

    Raises:
        InputError: an entry that is not of this form, or a quantity twice.
    """
    return parse_entries(given, "--column", 'force="Kraft [N]"')


def tell_columns(taken: str) -> None:
    """Say on standard error what the columns of a file were taken as."""
    if taken:
        print(taken, file=sys.stderr)


def add_cwd_to_path() -> None:
    """Find classes in modules of the current folder."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


# --- progress

_PATIENCE = 2.0  # s; what is done before it needs no bar

Show = Callable[..., None]
"""Called with what is done, of what and, where that changes, what is under way."""


@contextlib.contextmanager
def progress(what: str) -> Iterator[Show]:
    """Show a bar with the time left on the terminal of standard error, from the third second to the end.

    Args:
        what: is under way.
    """
    console = Console(stderr=True)
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task, begin = bar.add_task(what, total=None), threading.Timer(_PATIENCE, bar.start)
    begin.daemon = True
    begin.start()

    def show(done: int | float, total: int | float, now: str = what) -> None:
        if now != bar.tasks[0].description:  # the time left is that of this part
            bar.reset(task, description=now)
        bar.update(task, completed=done, total=total)

    try:
        yield show
    finally:
        begin.cancel()
        begin.join()
        bar.stop()


# --- files and tables


class Output:
    """The folder of a command's files, checked before the work.

    Attributes:
        folder: where they go.

    Raises:
        InputError: the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        check_output(folder)
        self.folder = folder
        self._there = set(folder.iterdir()) if folder.is_dir() else set()

    def write(self, files: Mapping[str, Any]) -> list[Path]:
        """Write files by name, all or none: bytes unchanged, everything else as JSON.

        Raises:
            InputError: the folder cannot be written.
        """
        return write_all(
            self.folder,
            {
                name: one
                if isinstance(one, bytes)
                else json.dumps(one, indent=1, allow_nan=False).encode()
                for name, one in files.items()
            },
        )

    def tell(self, paths: Iterable[Path]) -> None:
        """Print what was written, and which earlier files it replaced."""
        written = list(paths)
        print("written:", ", ".join(map(str, written)))
        if replaced := [path.name for path in written if path in self._there]:
            print(
                f"note: replaced earlier files: {', '.join(replaced)}; --output names another folder"
            )


def print_json(document: object) -> None:
    """Print one JSON value; a value that is not finite is an error of the program."""
    print(json.dumps(document, allow_nan=False))


_LOG = 100  # characters of a line of a log


def print_lines(rows: Iterable[tuple[str, str]]) -> None:
    """Print labelled sentences, wrapped to the width of the terminal beside their labels."""
    table = Table.grid(padding=(0, 2, 0, 0))
    for label, text in rows:
        table.add_row(Text(label, style="bold"), Text(text))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, _LOG)
    console.print(table)


_WIDEST = 250  # characters of a table


def print_rows(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows with the same keys as a table; lists are only in the JSON file."""
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    header = [key.replace("_", " ") for key in keys]
    print_table(title, header, [[_cell(row[key]) for key in keys] for row in rows], numbers="left")


def print_table(
    title: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    numbers: Literal["left", "right"] = "right",
) -> None:
    """Print a text table; all columns but the first are right-aligned."""
    columns = [[name, *(row[k] for row in rows)] for k, name in enumerate(header)]
    widths = [
        max(cell_len(line) for one in column for line in one.split("\n")) for column in columns
    ]
    total = sum(widths) + 2 * (len(widths) - 1)
    table = Table(box=None, pad_edge=False)
    for k, (name, width) in enumerate(zip(header, widths, strict=True)):
        # Widths that are given are not measured, twice, cell by cell.
        known = width if total <= _WIDEST else None
        table.add_column(name, justify=numbers if k else "left", overflow="fold", width=known)
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False)
    # Folded cells are harder to read than long lines.
    console.width = max(console.width, min(total, _WIDEST))
    console.print(f"\n{title}" if rows else f"\n{title}: none", markup=False)
    if rows:
        console.print(table)


def _cell(value: object) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


_KINDS = {"m": "length", "Pa": "pressure", "N": "force"}
"""Kind of a quantity, by the SI unit that its key ends in."""


def in_units(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Rows in SI converted to other units, with the unit in each key.

    Args:
        rows: with keys such as `length_m`, `force_N`; what has no unit stays, or one such as `N_per_m`.
        units: of each kind of quantity.

    >>> in_units([{"length_m": 0.27, "slack": False}], {"length": "mm"})
    [{'length_mm': 270.0, 'slack': False}]
    >>> in_units([{"margin_N_per_m": 2.0}], {"length": "mm"})
    [{'margin_N_per_m': 2.0}]
    """
    return [dict(_entry(key, value, units) for key, value in row.items()) for row in rows]


def _entry(key: str, value: Any, units: Mapping[str, str]) -> tuple[str, Any]:
    name, _, end = key.rpartition("_")
    if end not in _KINDS or name.endswith("_per"):
        return key, value
    unit = units[_KINDS[end]]
    return f"{name}_{unit}", None if value is None else from_si(value, unit, _KINDS[end])

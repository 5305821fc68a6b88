"""Code shared by all commands: options, progress, files, tables and units."""

import contextlib
import json
import sys
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

from cyclopts import Parameter, Token, validators
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress
from rich.table import Table
from rich.text import Text

from famjax.boundary.errors import InputError
from famjax.boundary.files import check_output, write_all
from famjax.boundary.units import from_si

# --- options

Units = Literal["si", "metric", "us"]
"""Unit system for printed tables and plots."""


def whole(type_: Any, tokens: Sequence[Token]) -> Any:
    """Convert a command-line token to a whole number, or several tokens to a tuple, without rounding.

    Raises:
        ValueError: a token is not a whole number.
    """
    found = []
    for token in tokens:
        try:
            found.append(int(token.value))
        except ValueError:
            name = token.keyword or "the value"
            raise ValueError(f"{name} must be a whole number, got {token.value!r}") from None
    return tuple(found) if getattr(type_, "__origin__", None) is tuple else found[0]


def whole_number(least: int, most: int | None = None) -> Parameter:
    """Define an option that takes a whole number in a range, checked before any work starts."""
    return Parameter(converter=whole, validator=validators.Number(gte=least, lte=most))


Seed = Annotated[int, whole_number(0)]
"""Seed for random numbers."""

Jobs = Annotated[int | None, whole_number(1)]
"""Number of processes."""


def parse_entries(given: Iterable[str], option: str, example: str) -> dict[str, str]:
    """Parse repeated entries such as `operator=NAME` into a dictionary.

    Args:
        given: entries to parse.
        option: name of the option, for error messages.
        example: example of an entry, for error messages.

    Raises:
        InputError: an entry does not have this form, or a name occurs twice.

    >>> parse_entries(["force=Load 2"], "log-columns", "force=3")
    {'force': 'Load 2'}
    """
    found: dict[str, str] = {}
    for entry in given:
        name, equals, value = (part.strip() for part in entry.partition("="))
        if not (name and equals and value) or name in found:
            raise InputError(
                f"{option} {entry!r} must have the form name=value, such as {example}; use each name once"
            )
        found[name] = value
    return found


Signed = Parameter(allow_leading_hyphen=True)
"""Option whose value may begin with a minus sign."""

Columns = Annotated[tuple[str, ...], Parameter(name="--column")]
"""Assignment of table columns to quantities."""


def parse_columns(given: Iterable[str]) -> dict[str, str]:
    """Parse entries such as `force="Kraft [N]"` into a dictionary of columns by quantity.

    Raises:
        InputError: an entry does not have this form, or a quantity occurs twice.
    """
    return parse_entries(given, "--column", 'force="Kraft [N]"')


def tell_columns(taken: str) -> None:
    """Print on standard error how the columns of a file were interpreted."""
    if taken:
        print(taken, file=sys.stderr)


def add_cwd_to_path() -> None:
    """Allow modules in the current folder to be imported."""
    here = str(Path.cwd())
    if here not in sys.path:
        sys.path.insert(0, here)


# --- progress

_PATIENCE = 2.0  # s; shorter work needs no bar

Show = Callable[..., None]
"""Function called with the amount done, the total and, if the task has changed, the current task."""


@contextlib.contextmanager
def progress(what: str) -> Iterator[Show]:
    """Show a progress bar and the time left on standard error if the work takes longer than 2 s.

    Nothing is shown if standard error is not a terminal.

    Args:
        what: name of the current task.
    """
    console = Console(stderr=True)
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    bar = Progress(*columns, console=console, transient=True, disable=not console.is_terminal)
    task, begin = bar.add_task(what, total=None), threading.Timer(_PATIENCE, bar.start)
    begin.daemon = True
    begin.start()

    def show(done: int | float, total: int | float, now: str = what) -> None:
        if now != bar.tasks[0].description:  # estimate the time left for each task alone
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
    """Output folder of a command; write access is checked before the work starts.

    Attributes:
        folder: folder to which files are written.

    Raises:
        InputError: the folder cannot be written.
    """

    def __init__(self, folder: Path) -> None:
        check_output(folder)
        self.folder = folder

    def write(self, files: Mapping[str, Any]) -> list[Path]:
        """Write all files or none; bytes are written unchanged, everything else as JSON.

        Raises:
            InputError: the folder cannot be written.
        """
        contents = {
            name: one if isinstance(one, bytes)
            else json.dumps(one, indent=1, allow_nan=False).encode()
            for name, one in files.items()
        }  # fmt: skip
        return write_all(self.folder, contents)

    def tell(self, paths: Iterable[Path]) -> None:
        """Print the names of the written files."""
        print("written:", ", ".join(map(str, paths)))


def print_json(document: object) -> None:
    """Print one JSON value; raise an error for nan and infinity, because they indicate a bug."""
    print(json.dumps(document, allow_nan=False))


_LOG = 100  # characters per line if the output is not a terminal


def print_lines(rows: Iterable[tuple[str, str]]) -> None:
    """Print labelled sentences with a hanging indent, wrapped to the terminal width."""
    table = Table.grid(padding=(0, 2, 0, 0))
    for label, text in rows:
        table.add_row(Text(label, style="bold"), Text(text))
    console = Console(highlight=False)
    if not console.is_terminal:
        console.width = max(console.width, _LOG)
    console.print(table)


_WIDEST = 250  # characters per table row


def print_rows(title: str, rows: Sequence[Mapping[str, Any]]) -> None:
    """Print rows with the same keys as a table; values that are lists are omitted."""
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    header = [key.replace("_", " ") for key in keys]
    print_table(title, header, [[_cell(row[key]) for key in keys] for row in rows], numbers="left")


def print_table(
    title: str, header: Sequence[str], rows: Sequence[Sequence[str]], *, numbers: Any = "right"
) -> None:
    """Print a text table; by default, all columns except the first are right-aligned."""
    table = Table(box=None, pad_edge=False)
    for k, name in enumerate(header):
        table.add_column(name, justify=numbers if k else "left", overflow="fold")
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False)
    # Folded cells are harder to read than long lines.
    wide = console.options.update(max_width=_WIDEST)
    console.width = max(console.width, console.measure(table, options=wide).maximum)
    console.print(f"\n{title}" if rows else f"\n{title}: none", markup=False)
    if rows:
        console.print(table)


def _cell(value: object) -> str:
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)


_KINDS = {"m": "length", "Pa": "pressure", "N": "force"}
"""Kind of quantity for each SI unit that a key may end with."""


def in_units(rows: Sequence[Mapping[str, Any]], units: Mapping[str, str]) -> list[dict[str, Any]]:
    """Convert rows from SI to other units and rename their keys.

    Args:
        rows: rows with keys such as `length_m` and `force_N`. Keys without a unit, or with a compound
            unit such as `N_per_m`, are unchanged.
        units: unit for each kind of quantity.

    >>> in_units([{"length_m": 0.27, "slack": False}], {"length": "mm"})
    [{'length_mm': 270.0, 'slack': False}]
    >>> in_units([{"margin_N_per_m": 2.0}], {"length": "mm"})
    [{'margin_N_per_m': 2.0}]
    """

    def converted(key: str, value: Any) -> tuple[str, Any]:
        name, _, end = key.rpartition("_")
        if end not in _KINDS or name.endswith("_per"):
            return key, value
        unit = units[_KINDS[end]]
        return f"{name}_{unit}", None if value is None else from_si(value, unit, _KINDS[end])

    return [dict(converted(key, value) for key, value in row.items()) for row in rows]

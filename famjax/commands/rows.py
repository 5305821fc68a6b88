"""Rows as a table on the terminal."""

from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

_WIDEST = 250  # characters of a table


def print_rows(title: str, rows: list[dict]) -> None:
    """A table of rows that share their keys; lists are left to the JSON file."""
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    for key in keys:
        table.add_column(key.replace("_", " "), overflow="fold")
    for row in rows:
        table.add_row(*(cell(row[key]) for key in keys))
    console = Console(highlight=False)
    # Folded cells are harder to read than long lines.
    wide = console.options.update(max_width=_WIDEST)
    console.width = max(console.width, Measurement.get(console, wide, table).maximum)
    console.print()
    console.print(table if rows else f"{title}: none", markup=False)


def cell(value: object) -> str:
    """A value as a table shows it."""
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)

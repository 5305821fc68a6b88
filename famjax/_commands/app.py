"""The command line itself, and what its commands share: the library loaded, rows printed."""

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING

from cyclopts import App
from rich.console import Console
from rich.measure import Measurement
from rich.table import Table

from .. import __version__

if TYPE_CHECKING:
    from fitting import ForceData

_WIDEST = 250  # characters of a table

app = App(
    name="famjax",
    version=f"famjax {__version__}",
    help="Fluidic artificial muscles: from measured force maps to identified, stable models.",
    help_format="markdown",
)


def load_fitting():
    """The fitting package, with JAX in float64."""
    from .. import require  # noqa: PLC0415

    fitting = require("fitting")
    import jax  # noqa: PLC0415

    jax.config.update("jax_enable_x64", True)
    return fitting


def load_map(
    data: str, specimen: dict, *, pressure: str | None = None, length: str | None = None
) -> "ForceData":
    """A force map: a bundled one by its name, or a CSV file; tolerances with their unit."""
    from fitting import bundled_names, load_bundled, read_csv  # noqa: PLC0415
    from fitting._data.quantities import parse_quantity  # noqa: PLC0415

    bundled = data.upper() in bundled_names() and not Path(data).exists()
    found = load_bundled(data.upper(), specimen) if bundled else read_csv(data, specimen)
    given = {
        f"{kind}_tolerance": parse_quantity(text, kind)
        for kind, text in (("pressure", pressure), ("length", length))
        if text is not None
    }
    return dataclasses.replace(found, **given)


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

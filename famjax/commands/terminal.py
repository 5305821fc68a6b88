"""What the commands show on a terminal: tables, and how far a long command is."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from time import monotonic
from typing import Any, Literal

from rich.cells import cell_len
from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, ProgressColumn, Task, TaskID
from rich.table import Table
from rich.text import Text

from famjax.boundary.files import check_output, write_all

_EVERY = 15.0  # seconds between lines


def progress_bar(every: float = _EVERY) -> Progress:
    """A bar on standard error, gone at the end; no terminal there gets lines in its place.

    Both say what is done, how much in a second, and the time that is left.

    Args:
        every: least time between two lines [s]; 0 for a line at every step.
    """
    console = Console(stderr=True)
    if console.is_terminal:
        columns = (*Progress.get_default_columns(), MofNCompleteColumn(), _Rate())
        return Progress(*columns, console=console, transient=True)
    return _Lines(every, console)


Show = Callable[..., None]
"""Called with what is done, of what and, where that changes, what is under way."""


@contextlib.contextmanager
def progress(what: str, every: float = _EVERY) -> Iterator[Show]:
    """A `progress_bar` of one work, while it lasts."""
    with progress_bar(every) as bar:
        task = bar.add_task(what, total=None)
        yield lambda done, total, what=None: bar.update(
            task, completed=done, total=total, description=what
        )


class _Rate(ProgressColumn):
    """What is done in a second."""

    def render(self, task: Task) -> Text:
        return Text(
            "" if task.speed is None else f"{task.speed:.3g}/s", style="progress.data.speed"
        )


class _Lines(Progress):
    """A line on standard error for what was done, after so many seconds at the least."""

    def __init__(self, every: float, console: Console) -> None:
        super().__init__(console=console, disable=True)
        self._every = every
        self._next = monotonic() + every

    def update(self, task_id: TaskID, **changes: Any) -> None:
        super().update(task_id, **changes)
        if monotonic() < self._next:
            return
        self._next = monotonic() + self._every
        task = self.tasks[task_id]
        count = "" if task.total is None else f", {task.completed:.0f} of {task.total:.0f} done"
        speed, left = task.speed, task.time_remaining
        rate = "" if speed is None or left is None else f", {speed:.3g}/s, {left:.0f} s left"
        print(f"{task.description}{count}{rate}", file=sys.stderr, flush=True)


class Output:
    """The folder of a command's files: checked before the work, its files listed at the end.

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
        """Write files by their names, whole or none: bytes as they are, all else as JSON.

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
        """Print what was written, and which files of an earlier time it took the place of."""
        written = list(paths)
        print("written:", ", ".join(map(str, written)))
        if replaced := [path.name for path in written if path in self._there]:
            print(
                f"note: {', '.join(replaced)} took the place of earlier files; --output gives another "
                "folder"
            )


_WIDEST = 250  # characters of a table


def print_rows(title: str, rows: list[dict]) -> None:
    """A table of rows that share their keys; lists are left to the JSON file."""
    keys = [key for key, value in rows[0].items() if not isinstance(value, list)] if rows else []
    header = [key.replace("_", " ") for key in keys]
    print_table(title, header, [[cell(row[key]) for key in keys] for row in rows], numbers="left")


def print_table(
    title: str,
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    numbers: Literal["left", "right"] = "right",
) -> None:
    """A table of text; all columns but the first are aligned as numbers are."""
    columns = [[name, *(row[k] for row in rows)] for k, name in enumerate(header)]
    widths = [
        max(cell_len(line) for one in column for line in one.split("\n")) for column in columns
    ]
    total = sum(widths) + 2 * (len(widths) - 1)
    table = Table(title=title, title_justify="left", box=None, pad_edge=False)
    for k, (name, width) in enumerate(zip(header, widths, strict=True)):
        # Widths that are given are not measured, twice, cell by cell.
        known = width if total <= _WIDEST else None
        table.add_column(name, justify=numbers if k else "left", overflow="fold", width=known)
    for row in rows:
        table.add_row(*row)
    console = Console(highlight=False)
    # Folded cells are harder to read than long lines.
    console.width = max(console.width, min(total, _WIDEST))
    console.print()
    console.print(table if rows else f"{title}: none", markup=False)


def cell(value: object) -> str:
    """A value as a table shows it."""
    if value is None:
        return "none"
    return f"{value:.4g}" if isinstance(value, float) else str(value)

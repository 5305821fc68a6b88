"""How far a long command is: a bar on a terminal, and in a log a line now and then."""

import sys
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import Progress, TaskID

_EVERY = 15.0  # seconds between lines


def progress_bar() -> Progress:
    """A bar on standard error, gone at the end; no terminal there gets lines in its place."""
    console = Console(stderr=True)
    if console.is_terminal:
        return Progress(console=console, transient=True)
    return _Lines(console=console, disable=True)


class _Lines(Progress):
    """A line on standard error for every quarter of a minute in which something was done."""

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self._next = monotonic() + _EVERY

    def update(self, task_id: TaskID, **changes: Any) -> None:
        super().update(task_id, **changes)
        if monotonic() < self._next:
            return
        self._next = monotonic() + _EVERY
        task = self.tasks[task_id]
        count = "" if task.total is None else f", {task.completed:.0f} of {task.total:.0f} done"
        print(f"{task.description}{count}", file=sys.stderr, flush=True)

"""How far a long command is: a bar on a terminal, and in a log a line now and then."""

import sys
from time import monotonic
from typing import Any

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, TaskID

_EVERY = 15.0  # seconds between lines


def progress_bar(every: float = _EVERY) -> Progress:
    """A bar on standard error, gone at the end; no terminal there gets lines in its place.

    Args:
        every: least time between two lines [s]; 0 for a line at every step.
    """
    console = Console(stderr=True)
    if console.is_terminal:
        columns = (*Progress.get_default_columns(), MofNCompleteColumn())
        return Progress(*columns, console=console, transient=True)
    return _Lines(every, console)


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
        print(f"{task.description}{count}", file=sys.stderr, flush=True)

"""Fits in other processes: what can be sent there."""

import pickle
import sys
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from typing import Any

from famjax.boundary.tasks import AnyExecutor, can_travel, run_tasks


def run_fits(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    *,
    executor: AnyExecutor,
    store: Any = None,
    progress: Callable[[int, int], None] | None = None,
    names: Sequence[str] | None = None,
) -> Any:
    """`famjax.boundary.tasks.run_tasks` for a function that fits.

    What holds something that another process cannot import, such as a function within a function,
    is done in this one, with a warning.

    Args:
        function: of one item, of a module's own level, or a `functools.partial` of one.
        items: one for each task.
        executor: as `run_tasks` takes it.
        store: likewise.
        progress: likewise.
        names: likewise.

    Returns:
        The store; `list(...)` of one in memory has the results in the order of the items.
    """
    if executor is not None and not _can_be_sent((function, items), executor):
        warnings.warn(
            "this work holds something of your own that another process cannot import, a function "
            "within a function or a class typed at a prompt, so it is done in this process: put "
            "that in a module and import it",
            UserWarning,
            stacklevel=3,
        )
        executor = None
    return run_tasks(
        function, items, executor=executor, store=store, progress=progress, names=names
    )  # fmt: skip


def _can_be_sent(work: Any, executor: AnyExecutor) -> bool:
    """Whether the workers of an executor can make of a message what was sent."""
    if not can_travel(work):
        return False
    # Spawned processes import the script by its file; other engines send its classes themselves.
    spawned = isinstance(executor, int | ProcessPoolExecutor)
    prompt = not hasattr(sys.modules["__main__"], "__file__")
    return not (spawned and prompt and b"__main__" in pickle.dumps(work))

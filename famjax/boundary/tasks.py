"""Long computations: apply a function to many items on an executor, storing each result when ready.

Any `concurrent.futures` executor works, as does any other with the same interface: loky, mpi4py, or
dask's `Client.get_executor()`. This module contains no JAX and no physics.
"""

import contextlib
import functools
import json
import multiprocessing
import os
import pickle
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import BrokenExecutor, CancelledError, ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .errors import InputError
from .files import differing, some_of, write_all

AnyExecutor: TypeAlias = Any
"""Where tasks run: None for this process, a number of spawned processes, or an executor."""

_FORMAT = "famjax parts 2"
_TAKEN_OVER = (
    "jax_enable_x64", "jax_compilation_cache_dir", "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)  # fmt: skip
"""JAX settings that a worker process copies from its parent process."""
_one_at_a_time = threading.RLock()


class Store:
    """Results by index, 0 to `count` - 1, in memory and, if a path is given, also in a JSONL file.

    The first line of the file contains the settings. Each other line contains one part, which is on disk
    when `keep` returns. Damaged lines, such as a last line that a crash cut off, cause a warning, and
    their parts are computed again.

    Args:
        path: path of the file, which is created if missing. If None, parts are kept only in memory and
            may have any type.
        kind: type of computation, such as "sweep".
        settings: JSON values on which every part depends. A file with different settings is rejected.
        count: number of parts.

    Raises:
        InputError: the file belongs to a different computation, or cannot be read or written.
    """

    def __init__(self, path: Any, kind: str, settings: dict[str, Any], count: int) -> None:
        self.path = None if path is None else Path(path)
        self._parts: dict[int, Any] = {}
        if self.path is None:
            return
        head = json.dumps({"format": _FORMAT, "kind": kind, "parts": count, "settings": settings})
        try:
            if not self.path.exists():
                write_all(self.path.parent, {self.path.name: head.encode()})
            self._read(self.path, json.loads(head))
        except OSError as error:
            raise InputError(f"the {kind} file {self.path} cannot be used: {error}") from None

    def __contains__(self, index: int) -> bool:
        return index in self._parts

    def __iter__(self) -> Iterator[Any]:
        """Iterate over the finished parts in the order of their indices."""
        return (self._parts[index] for index in sorted(self._parts))

    def keep(self, index: int, part: Any) -> None:
        """Store one finished part, a mapping of names to arrays and plain values; nan stays nan.

        Raises:
            InputError: the part contains a value of any other type.
            OSError: the file cannot be written.
        """
        if self.path is not None:
            line = json.dumps({"index": index, "part": part}, default=_encoded)
            with self.path.open("a", encoding="utf-8") as file:
                # The break comes first: a line that was cut off stays alone.
                file.write(f"\n{line}")
                file.flush()
                os.fsync(file.fileno())
            part = json.loads(line, object_hook=_decoded)["part"]
        self._parts[index] = part

    def _read(self, path: Path, head: dict[str, Any]) -> None:
        first, *lines = path.read_bytes().split(b"\n")
        try:
            there = json.loads(first)
        except ValueError as error:
            raise InputError(
                f"{path} is damaged ({error}): remove it, or choose another file"
            ) from None
        if there != head:
            raise InputError(
                f"{path} contains a {head['kind']} with different data or settings: "
                f"{some_of(differing(there, head), '; ')}. Choose another file, or remove this one"
            )
        for number, line in enumerate(lines, 2):
            try:
                row = json.loads(line.decode(), object_hook=_decoded)
                self._parts[row["index"]] = row["part"]
            except (ValueError, KeyError, TypeError):
                text = f"line {number} in {path} is damaged; the part in it will be computed again"
                warnings.warn(text, UserWarning, stacklevel=4)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"dtype": value.dtype.str, "values": value.tolist(), "shape": value.shape}
    if isinstance(value, np.generic):
        return value.item()
    raise InputError(
        f"a part must contain only arrays and plain values, got a {type(value).__name__}"
    )


def _decoded(entries: dict[str, Any]) -> Any:
    if entries.keys() == {"dtype", "values", "shape"}:
        return np.array(entries["values"], entries["dtype"]).reshape(entries["shape"])
    return entries


def run_tasks(
    function: Callable[[Any], Any], items: Sequence[Any], *, executor: AnyExecutor = None,
    store: Store | None = None, progress: Callable | None = None, names: Sequence[str] | None = None,
) -> Store:  # fmt: skip
    """Apply a function to every unfinished item; each result is stored as soon as it is ready.

    Stored results survive an interrupt or an error in the function. The name of the item is added to
    the error as a note. Tasks in threads of the same process run one at a time, because JAX may hang if
    two of them factorise matrices simultaneously.

    Args:
        function: function of one item, called in the workers. It must be a module-level function, or a
            `functools.partial` of such a function with arrays and names.
        items: one item per task; results are stored by index.
        executor: None for this process, a number of processes, a `concurrent.futures.Executor`, or any
            object with the same `submit`. A dask client is replaced by its `get_executor()`.
        store: store with finished results, to which new results are added; None creates one in memory.
        progress: called with (finished tasks, all tasks), first with the tasks already in the store.
        names: names of the items in messages; "item 12" by default.

    Returns:
        The store; `list(store)` returns the results in the order of the items.

    Raises:
        InputError: the executor cannot be used or failed, for example because a worker died; or the work
            contains an object that another process cannot import.
    """
    if isinstance(executor, int | ProcessPoolExecutor):
        _check_travels((function, items))
    kept = Store(None, "tasks", {}, len(items)) if store is None else store
    waiting = [index for index in range(len(items)) if index not in kept]
    done, tell = len(items) - len(waiting), progress or (lambda _done, _total: None)
    tell(done, len(items))
    jobs: dict[Any, int] = {}
    with _pool(executor, len(waiting)) as pool:
        try:
            if pool is None:
                results = ((index, functools.partial(function, items[index])) for index in waiting)
            else:
                call = functools.partial(_called, _settings(), function)
                results = _as_done(pool, call, items, waiting, jobs)
            for index, result in results:
                try:
                    part = result()
                except Exception as error:
                    error.add_note(f"in {f'item {index}' if names is None else names[index]}")
                    raise
                kept.keep(index, part)
                done += 1
                tell(done, len(items))
        except (BrokenExecutor, CancelledError) as error:
            where = "pass resume= to keep the finished parts" if kept.path is None else (
                f"the finished parts are in {kept.path}: repeat the same call to resume"
            )  # fmt: skip
            raise InputError(
                f"the executor failed after {done} of {len(items)} tasks "
                f"({type(error).__name__}: {error}); {where}. Workers usually die because memory runs out. "
                "A script that starts processes "
                'must make its calls under `if __name__ == "__main__":`'
            ) from error
        finally:
            for job in jobs:
                job.cancel()
    return kept


def _check_travels(work: Any) -> None:
    try:
        pickle.dumps(work)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InputError(
            f"this work cannot be sent to another process ({error}): define your functions and classes in "
            "a module, or omit the executor"
        ) from None


def _as_done(
    pool: Any,
    call: Callable[[Any], Any],
    items: Sequence[Any],
    waiting: Sequence[int],
    jobs: dict[Any, int],
) -> Iterator[tuple[int, Callable[[], Any]]]:
    """Submit all items; yield the index and result of each finished item, even during submission."""
    for index in waiting:
        job = pool.submit(call, items[index])
        if job.done():
            yield index, job.result
        else:
            jobs[job] = index
    for job in as_completed(jobs):
        yield jobs[job], job.result


def _pool(executor: AnyExecutor, count: int) -> contextlib.AbstractContextManager[Any]:
    if not isinstance(executor, int):
        ours = executor.get_executor() if hasattr(executor, "get_executor") else executor
        return contextlib.nullcontext(ours)
    if executor < 1:
        raise InputError(f"the number of workers must be at least 1, got {executor}")
    spawn, workers = multiprocessing.get_context("spawn"), max(1, min(executor, count))
    return ProcessPoolExecutor(workers, spawn, initializer=_begin, initargs=(_settings(),))


def _settings() -> dict[str, Any]:
    jax = sys.modules.get("jax")
    values = {} if jax is None else jax.config.values
    return {name: values[name] for name in _TAKEN_OVER if values.get(name) is not None}


def _called(settings: dict[str, Any], function: Callable[[Any], Any], item: Any) -> Any:
    """Call the function in a worker, with the JAX precision of the parent process."""
    with _one_at_a_time:
        if settings and (jax := sys.modules.get("jax")) is not None:
            jax.config.update("jax_enable_x64", settings["jax_enable_x64"])
        return function(item)


def _begin(settings: dict[str, Any]) -> None:
    """Initialise a worker: single-threaded linear algebra, and the JAX settings of the parent process."""
    os.environ |= dict.fromkeys(
        ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "PJRT_NPROC"), "1"
    )
    for name, value in settings.items():
        os.environ[name.upper()] = str(int(value) if isinstance(value, bool) else value)
    if (jax := sys.modules.get("jax")) is not None:
        for name, value in settings.items():
            jax.config.update(name, value)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Exit when the parent process is killed; otherwise a worker would wait forever."""
    if (parent := multiprocessing.parent_process()) is not None:
        parent.join()
        os._exit(1)

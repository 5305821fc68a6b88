"""Long work: a function of many items on an executor; each result is stored as soon as it is ready.

An executor is one of `concurrent.futures`, or has its interface, as those of loky, mpi4py and dask's
`Client.get_executor()` have. No JAX and no physics.
"""

import contextlib
import functools
import json
import os
import pickle
import signal
import sys
import threading
import warnings
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, CancelledError, Future, wait
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from .errors import InputError
from .files import write_whole
from .settings import differing, some_of

AnyExecutor: TypeAlias = Any
"""Where long work is done: None in this process, a number of spawned processes, or an executor."""

_FORMAT = "famjax parts 2"
_AHEAD = 2  # tasks submitted for each worker, so that none is idle
_WAKE = 1.0  # seconds after which a wait is taken up again, so that an interrupt is seen anywhere
_ONE_THREAD = ("OMP", "OPENBLAS", "MKL")
_SHARED = (
    "jax_compilation_cache_dir",
    "jax_persistent_cache_min_compile_time_secs",
    "jax_persistent_cache_min_entry_size_bytes",
)
_one_at_a_time = threading.RLock()


class Store:
    """Results by index, 0 to `count` - 1, in memory and, with a path, in one JSONL file.

    The first line of the file has the settings, each other one a part. It is on the disk when `keep`
    returns. A line that is damaged, as the last one is after a crash, is reported by a warning and
    its part counts as not done.

    Args:
        path: of the file, created if missing; None keeps the parts in memory alone, whatever they are.
        kind: of the work, such as "sweep".
        settings: what every part depends on, values of JSON. A file with others is refused.
        count: number of parts.

    Raises:
        InputError: the file is that of another work, or cannot be read or written.
    """

    def __init__(
        self, path: Path | str | None, kind: str, settings: dict[str, Any], count: int
    ) -> None:
        self.path = None if path is None else Path(path)
        self.kind, self._count = kind, count
        self._parts: dict[int, Any] = {}
        if self.path is None:
            return
        head = {"format": _FORMAT, "kind": kind, "parts": count, "settings": settings}
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not self.path.exists():
                write_whole(self.path, json.dumps(head).encode() + b"\n")
            self._read(self.path, json.loads(json.dumps(head)))
        except OSError as error:
            raise InputError(f"the {kind} file {self.path} cannot be used: {error}") from None

    def __contains__(self, index: int) -> bool:
        return index in self._parts

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, index: int) -> Any:
        if index not in self._parts:
            raise IndexError(f"part {index} of the {self.kind} is not done")
        return self._parts[index]

    def __iter__(self) -> Iterator[Any]:
        """The parts that are done, by index."""
        return (self._parts[index] for index in sorted(self._parts))

    def keep(self, index: int, part: Any) -> None:
        """Store one finished part: arrays and plain values by name; nan stays nan.

        Raises:
            InputError: it cannot be written.
        """
        if self.path is not None:
            line = json.dumps({"index": index, "part": part}, default=_encoded) + "\n"
            try:
                with self.path.open("a", encoding="utf-8") as file:
                    file.write(line)
                    file.flush()
                    os.fsync(file.fileno())
            except OSError as error:
                raise InputError(f"{self.path} cannot be written: {error}") from None
            part = json.loads(line, object_hook=_decoded)["part"]
        self._parts[index] = part

    def _read(self, path: Path, head: dict[str, Any]) -> None:
        first, *lines = path.read_bytes().split(b"\n")
        try:
            there = json.loads(first)
        except ValueError as error:
            raise InputError(f"{path} is damaged ({error}): give another, or remove it") from None
        if there != head:
            raise InputError(
                f"{path} holds a {self.kind} of other data or with other settings: "
                f"{some_of(differing(there, head), '; ')}. Give another file, or remove it"
            )
        good = [first]
        for line in filter(None, lines):
            try:
                row = json.loads(line, object_hook=_decoded)
                self._parts[row["index"]] = row["part"]
            except (ValueError, KeyError, TypeError):
                text = f"line {len(good) + 1} of {path} is damaged; its part is done again"
                warnings.warn(text, UserWarning, stacklevel=4)
            else:
                good.append(line)
        if lines and (lines[-1] or len(good) <= len([*filter(None, lines)])):
            write_whole(path, b"\n".join([*good, b""]))


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return {"dtype": value.dtype.str, "values": value.tolist(), "shape": value.shape}
    if isinstance(value, np.generic):
        return value.item()
    raise InputError(f"a part holds arrays and plain values, got a {type(value).__name__}")


def _decoded(entries: dict[str, Any]) -> Any:
    if entries.keys() == {"dtype", "values", "shape"}:
        return np.array(entries["values"], entries["dtype"]).reshape(entries["shape"])
    return entries


def run_tasks(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    *,
    executor: AnyExecutor = None,
    store: Store | None = None,
    progress: Callable[[int, int], None] | None = None,
    names: Sequence[str] | None = None,
) -> Store:
    """Apply a function to every item that is not done yet; each result is stored as soon as it is ready.

    No more than a few tasks for each worker are under way. An interrupt keeps what is done, and what
    is under way and cannot be cancelled. An error that the function raises ends the work in the same
    way, with the name of the item as a note. Tasks in threads of one process take turns, as JAX may
    hang where two of them factorise matrices at once.

    Args:
        function: of one item, called in the workers: one of a module's own level, or a
            `functools.partial` of one, of arrays and names.
        items: one for each task; the results go by their index.
        executor: None for this process, a number of processes, a `concurrent.futures.Executor`, or what
            has its `submit`; a dask client stands for its `get_executor()`.
        store: what is done already, and what takes the results; None: one in memory.
        progress: called with (tasks done, tasks), at first with those that the store has.
        names: of the items in messages; "item 12" without.

    Returns:
        The store; `list(...)` of it has the results in the order of the items.

    Raises:
        InputError: the executor cannot be used, or it broke, as when a worker dies.
    """
    kept = Store(None, "tasks", {}, len(items)) if store is None else store
    waiting = deque(index for index in range(len(items)) if index not in kept)
    done = len(items) - len(waiting)

    def tell() -> None:
        if progress is not None:
            progress(done, len(items))

    def keep(index: int, job: Future[Any]) -> None:
        nonlocal done
        try:
            result = job.result()
        except Exception as error:
            error.add_note(f"in {f'item {index}' if names is None else names[index]}")
            raise
        kept.keep(index, result)
        done += 1
        tell()

    tell()
    if not waiting:
        return kept
    running: dict[Future[Any], int] = {}
    with _pool(executor, len(waiting)) as pool:
        call = function if pool is None else functools.partial(_called, _settings(), function)
        most = (
            1
            if pool is None
            else _AHEAD * (getattr(pool, "_max_workers", 0) or os.cpu_count() or 1)
        )
        try:
            while waiting or running:
                while waiting and len(running) < most and not any(job.done() for job in running):
                    item = items[waiting[0]]
                    job = _here(call, item) if pool is None else pool.submit(call, item)
                    running[job] = waiting.popleft()
                wait(running, timeout=_WAKE, return_when=FIRST_COMPLETED)
                for job in [job for job in running if job.done()]:
                    keep(running.pop(job), job)
        except (BrokenExecutor, CancelledError) as error:
            where = "give resume= to keep what is finished" if kept.path is None else (
                f"what is finished is in {kept.path}, and the same call goes on from there"
            )  # fmt: skip
            raise InputError(
                f"the executor broke after {done} of {len(items)} ({type(error).__name__}: {error}); "
                f"{where}. A worker that dies lacks memory as a rule; a script with processes needs "
                'its calls under `if __name__ == "__main__":`'
            ) from error
        finally:
            for job, index in running.items():
                if not job.cancel() and not job.cancelled() and job.exception() is None:
                    keep(index, job)
    return kept


def _here(function: Callable[[Any], Any], item: Any) -> Future[Any]:
    job: Future[Any] = Future()
    try:
        job.set_result(function(item))
    except Exception as error:
        job.set_exception(error)
    return job


@contextlib.contextmanager
def _pool(executor: AnyExecutor, count: int) -> Iterator[Any]:
    """What takes tasks; None for this process."""
    if not isinstance(executor, int):
        pool: Any = executor
        if hasattr(pool, "get_executor"):
            pool = pool.get_executor()
        if pool is not None and not hasattr(pool, "submit"):
            raise InputError(
                "executor must be None, a number of processes, or have `submit` as the executors of "
                f"concurrent.futures have; got {type(executor).__name__}"
            )
        context = getattr(pool, "_mp_context", None)
        if context is not None and getattr(context, "get_start_method", str)() == "fork":
            raise InputError(
                "processes must be spawned: a fork of a process that has used JAX or OpenCV can hang. "
                'Give ProcessPoolExecutor(n, mp_context=multiprocessing.get_context("spawn")), or the '
                "number n alone"
            )
        yield pool
        return
    if executor < 1:
        raise InputError(f"at least one worker is needed, got {executor}")
    import multiprocessing  # noqa: PLC0415 -- only who has processes waits for it
    from concurrent.futures import ProcessPoolExecutor  # noqa: PLC0415

    spawn = multiprocessing.get_context("spawn")
    workers = min(executor, count)
    with ProcessPoolExecutor(
        workers, spawn, initializer=_begin, initargs=(_settings(True),)
    ) as pool:
        yield pool


def _settings(child: bool = False) -> dict[str, Any]:
    """Settings of JAX that a worker takes over, by name; a child process also its compiled programs."""
    jax = sys.modules.get("jax")
    values = {} if jax is None else jax.config.values
    names = ("jax_enable_x64", *(_SHARED if child else ()))
    return {name: values[name] for name in names if values.get(name) is not None}


def _called(settings: dict[str, Any], function: Callable[[Any], Any], item: Any) -> Any:
    """The function in a worker, in the precision of the process that asks."""
    with _one_at_a_time:
        if settings and (jax := sys.modules.get("jax")) is not None:
            for name, value in settings.items():
                jax.config.update(name, value)
        return function(item)


def _begin(settings: dict[str, Any]) -> None:
    """Make this process a worker: one thread for linear algebra, JAX set as in its parent."""
    os.environ.update({f"{name}_NUM_THREADS": "1" for name in _ONE_THREAD}, PJRT_NPROC="1")
    for name, value in settings.items():
        os.environ[name.upper()] = str(int(value) if isinstance(value, bool) else value)
    if (jax := sys.modules.get("jax")) is not None:
        for name, value in settings.items():
            jax.config.update(name, value)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Exit when the parent is killed; a worker would wait for it indefinitely."""
    import multiprocessing  # noqa: PLC0415 -- loaded in every child, and not elsewhere

    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


def can_travel(thing: Any) -> bool:
    """Whether something can be sent to another process, as a function at module level can."""
    try:
        pickle.dumps(thing)
    except (pickle.PicklingError, AttributeError, TypeError):
        return False
    return True

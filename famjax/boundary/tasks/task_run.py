"""A function of many items on any engine: what is done is kept, a worker that dies costs little."""

from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import BrokenExecutor, CancelledError
from contextlib import closing
from types import TracebackType
from typing import Any, Protocol, TypeVar, runtime_checkable

from ..errors import InputError
from .executors import AnyExecutor, Engine, engine_of
from .store import Store
from .worker import Call, Host

_SHOWN = 5  # names in a message
_Kept = TypeVar("_Kept", bound="Keeps")


@runtime_checkable
class Keeps(Protocol):
    """What takes results by the index of their item, and knows which are there already."""

    def __contains__(self, index: int, /) -> bool: ...

    def keep(self, index: int, part: Any, /) -> None:
        """One more result; it is safe when this returns."""


class TaskRefused(InputError):  # noqa: N818 -- the name says what it is
    """Some items are done by no worker: each one that takes them dies."""


class EngineLost(InputError):  # noqa: N818
    """The executor broke, or its scheduler is gone; what was finished is kept."""


def run_tasks(
    function: Callable[[Any], Any],
    items: Sequence[Any],
    *,
    executor: AnyExecutor = None,
    store: _Kept | None = None,
    progress: Callable[[int, int], None] | None = None,
    names: Sequence[str] | None = None,
    refuse: Callable[[int, str], None] | None = None,
    threads: bool = False,
) -> _Kept | Store:
    """The function of every item that is not done yet, each result kept as soon as it is there.

    No more than a few tasks for each worker are under way, and their results are all that is in
    memory besides the store. When a worker dies, what was under way with it is tried again at the
    end, alone, twice at most; the rest goes on. An interrupt keeps what is done, and what is under
    way and cannot be cancelled. An error that the function raises ends the work in the same way,
    with the name of the item as a note.

    Args:
        function: of one item, called in the workers: one of a module's own level, or a
            `functools.partial` of one, of arrays and names.
        items: one for each task; the results go by their index.
        executor: see `AnyExecutor`.
        store: a `Store`, or what has its `__contains__` and `keep`; None: in memory.
        progress: called with (tasks done, tasks), at first with those that the store has.
        names: of the items in messages; "item 12" without.
        refuse: called with the index and the reason where the workers of an item die each time;
            None raises `TaskRefused` at the end.
        threads: whether the function may run in several threads of a process at once. JAX may not:
            two batches of LAPACK at once can hang on few cores.

    Returns:
        The store; `list(...)` of it has the results in the order of the items.

    Raises:
        TaskRefused: see `refuse`; all other items are done.
        EngineLost: a pool that was given broke, or the scheduler of a cluster is gone.
        InputError: the executor cannot be used, or the function cannot be sent to a worker.
        RuntimeError: processes cannot start.
    """
    kept = Store(None, "tasks", {}, len(items)) if store is None else store
    waiting = deque(index for index in range(len(items)) if index not in kept)
    run = _Run(items, kept, progress, names, len(items) - len(waiting))
    run.tell()
    if waiting:
        with closing(engine_of(executor, len(waiting))) as engine:
            call = Call(function, Host.here(child=engine.child), threads=threads)
            run.all_of(waiting, engine, call)
    for index, why in run.refused.items():
        if refuse is not None:
            refuse(index, why)
    if run.refused and refuse is None:
        some = [f"{run.name(index)}: {why}" for index, why in list(run.refused.items())[:_SHOWN]]
        more = f"; and {len(run.refused) - _SHOWN} more" if len(run.refused) > _SHOWN else ""
        raise TaskRefused(
            f"{len(run.refused)} of {len(items)} could not be done, all others are: "
            f"{'; '.join(some)}{more}. Leave them out, or see whether memory is short"
        )
    return kept


class _Run:
    """The state of one run."""

    def __init__(
        self,
        items: Sequence[Any],
        store: Keeps,
        progress: Callable[[int, int], None] | None,
        names: Sequence[str] | None,
        done: int,
    ) -> None:
        self._items, self._store, self._progress = items, store, progress
        self._names, self._done = names, done
        self._running: dict[Any, int] = {}
        self.refused: dict[int, str] = {}

    def name(self, index: int) -> str:
        return f"item {index}" if self._names is None else self._names[index]

    def tell(self) -> None:
        if self._progress is not None:
            self._progress(self._done, len(self._items))

    def all_of(self, waiting: deque[int], engine: Engine, call: Call) -> None:
        """All tasks; those with which a worker died come last, one at a time."""
        suspects: deque[int] = deque()
        tried: Counter[int] = Counter()
        broken = False
        try:
            while waiting or suspects or self._running:
                if broken and not self._running:
                    engine.remake()
                    broken = False
                alone = not waiting and not self._running
                if not broken:
                    queue, most = (suspects, 1) if alone else (waiting, engine.ahead)
                    broken = not self._filled(queue, most, engine, call)
                for job in engine.finished(self._running):
                    index = self._running.pop(job)
                    if self._took(job, index, engine):
                        continue
                    broken = engine.remakes
                    tried[index] += alone
                    if tried[index] < engine.tries:
                        suspects.append(index)
                    else:
                        self.refused[index] = (
                            f"the process that worked on it ended abnormally, {1 + tried[index]} times"
                        )
        finally:
            self._keep_what_ends(engine)

    def _filled(self, queue: deque[int], most: int, engine: Engine, call: Call) -> bool:
        """Submit tasks until so many are under way; False where the workers are to be replaced."""
        while queue and len(self._running) < most:
            try:
                with _Named(self.name(queue[0])):
                    job = engine.submit(call, self._items[queue[0]])
            except (BrokenExecutor, CancelledError, *engine.losses) as error:
                if engine.remakes:
                    return False
                raise self._lost(error) from error
            self._running[job] = queue.popleft()
            if job.done():  # an executor that works in this thread is given one task at a time
                break
        return True

    def _took(self, job: Any, index: int, engine: Engine) -> bool:
        """Whether the job has a result, which is then kept; not where its worker died."""
        try:
            with _Named(self.name(index)):
                result = job.result()
        except engine.deaths:
            return False
        except CancelledError as error:
            raise self._lost(error) from error
        self._keep(index, result)
        return True

    def _keep(self, index: int, result: Any) -> None:
        self._store.keep(index, result)
        self._done += 1
        self.tell()

    def _keep_what_ends(self, engine: Engine) -> None:
        """After an interrupt or an error: cancel what can be, keep the rest when it is done."""
        jobs = list(self._running.items())
        for job, index in [(job, index) for job, index in jobs if not engine.cancelled(job)]:
            if job.exception() is None:
                self._keep(index, job.result())

    def _lost(self, error: BaseException) -> EngineLost:
        folder = getattr(self._store, "folder", None)
        kept = "give a folder to keep what is finished"
        if folder is not None:
            kept = f"the finished parts are kept in {folder}, and the same call goes on from there"
        return EngineLost(
            f"the executor is gone after {self._done} of {len(self._items)} "
            f"({type(error).__name__}: {error}); {kept}. Give a new executor, or a number of "
            "processes, which are replaced when they die"
        )


class _Named:
    """Errors that leave this block have the name of the item as a note."""

    def __init__(self, name: str) -> None:
        self._name = name

    def __enter__(self) -> None:
        return

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if error is not None:
            error.add_note(f"in {self._name}")

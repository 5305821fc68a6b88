"""What a caller gives as `executor=`, made into one thing that takes tasks and hands back results."""

import contextlib
import importlib
import os
import sys
import time
from collections.abc import Callable, Collection
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    CancelledError,
    Executor,
    Future,
    wait,
)
from typing import Any, Protocol, TypeAlias, runtime_checkable

from ..errors import InputError
from .worker import Call, Host, prepare

_AHEAD = 2  # tasks submitted for each worker, so that none is idle
_FEWEST = 8  # workers that a cluster is assumed to have: it may grow with what waits for it
_LOOK = (
    0.01,
    1.0,
)  # seconds between two looks at jobs that cannot be waited for, at first and at last
_WAKE = 1.0  # seconds after which a wait is taken up again, so that an interrupt is seen anywhere


@runtime_checkable
class Submits(Protocol):
    """What takes a function and its arguments, and returns a job with `done()` and `result()`.

    So do the executors of `concurrent.futures`, loky and mpi4py, a dask client, and submitit.
    """

    def submit(self, function: Callable[..., Any], /, *args: Any) -> Any:
        """The job of calling that function."""


AnyExecutor: TypeAlias = Submits | int | None
"""Where long work is done: None in this process, a number of processes of our own, or what `Submits`
says, which is taken as it is."""


class Engine:
    """An executor in use.

    Attributes:
        ahead: most tasks that are under way.
        deaths: errors that say that the worker of a task died.
        losses: errors that say that the whole executor is gone.
        tries: how often a task is tried alone after a worker died with it.
        remakes: whether new workers take the place of those that died.
        child: whether the workers are children of this process by `multiprocessing`.
    """

    deaths: tuple[type[BaseException], ...] = (BrokenExecutor,)
    losses: tuple[type[BaseException], ...] = ()
    tries = 2
    remakes = False
    child = False

    def __init__(self, executor: Any, workers: int) -> None:
        self._executor = executor
        self.ahead = _AHEAD * workers

    def submit(self, call: Call, item: Any) -> Any:
        """The job of one task."""
        return self._executor.submit(call, item)

    def finished(self, jobs: Collection[Any]) -> list[Any]:
        """Those of some jobs that are done, once one of them is."""
        if jobs and all(isinstance(job, Future) for job in jobs):
            while not (done := wait(jobs, timeout=_WAKE, return_when=FIRST_COMPLETED).done):
                pass
            return [job for job in jobs if job in done]
        pause, most = _LOOK
        while not (found := [job for job in jobs if job.done()]) and jobs:
            time.sleep(pause)
            pause = min(2 * pause, most)
        return found

    def cancelled(self, job: Any) -> bool:
        """Give up a job if it can be; it is not where its result is still to be had."""
        return not (isinstance(job, Future) and not job.cancel())

    def remake(self) -> None:
        """New workers for those that died."""

    def close(self) -> None:
        """End what was begun here; an executor that was given stays as it is."""


class _Here:
    """Takes one task at a time, in this process."""

    def submit(self, function: Callable[..., Any], /, *args: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args))
        return future


class _OwnProcesses(Engine):
    """Spawned processes: a fork after JAX or OpenCV has run can hang."""

    remakes = True
    child = True

    def __init__(self, workers: int) -> None:
        self._workers = workers
        super().__init__(None, workers)
        self.remake()

    def remake(self) -> None:
        """New processes.

        Raises:
            RuntimeError: the first of them cannot even start.
        """
        import multiprocessing  # noqa: PLC0415 -- only who has processes waits for it
        from concurrent.futures import ProcessPoolExecutor  # noqa: PLC0415

        self.close()
        context = multiprocessing.get_context("spawn")
        self._executor = ProcessPoolExecutor(
            self._workers, context, initializer=prepare, initargs=(Host.here(child=True),)
        )
        try:
            self._executor.submit(os.getpid).result()
        except BrokenExecutor:
            raise RuntimeError(
                "worker processes cannot start. A script that works with processes needs its calls "
                'under `if __name__ == "__main__":`, because each worker imports it; else give '
                "executor=concurrent.futures.ThreadPoolExecutor()"
            ) from None

    def close(self) -> None:
        if self._executor is not None:
            self._executor.shutdown(cancel_futures=True)


class _Dask(Engine):
    """A client of dask or its executor, taken as it is: who connected it knows the cluster."""

    tries = 1  # the scheduler has tried it several times

    def __init__(self, given: Any) -> None:
        client = given if hasattr(given, "get_executor") else given._client
        if client.asynchronous:
            raise InputError(
                "a dask client must not be asynchronous here: make it with asynchronous=False"
            )
        if client.status != "running":
            raise InputError(
                f"the dask client is {client.status}, without a scheduler: connect a new one"
            )
        super().__init__(client, max(_FEWEST, sum(client.ncores().values())))
        # What an executor of the client adds; and two items that are equal are two tasks.
        self._options = {**getattr(given, "_kwargs", {}), "pure": False}
        # There, since its client is.
        self._dask = importlib.import_module("distributed")
        closed = getattr(self._dask.client, "ClosedClientError", RuntimeError)
        self.deaths = (self._dask.KilledWorker,)
        self.losses = (self._dask.comm.CommClosedError, closed, OSError, RuntimeError)

    def submit(self, call: Call, item: Any) -> Any:
        return self._executor.submit(call, item, **self._options)

    def finished(self, jobs: Collection[Any]) -> list[Any]:
        while not (found := [job for job in jobs if job.done()]) and jobs:
            with contextlib.suppress(TimeoutError, CancelledError), self._executor.as_current():
                self._dask.wait(list(jobs), timeout=_WAKE, return_when="FIRST_COMPLETED")
        return found

    def cancelled(self, job: Any) -> bool:
        if self._executor.status == "running":
            job.cancel()
        return True


def engine_of(executor: Any, count: int) -> Engine:
    """An executor of any kind, in use; to be closed.

    Args:
        executor: see `AnyExecutor`.
        count: of the tasks; there are no more processes than that.

    Raises:
        InputError: what is given takes no tasks, or would fork.
        RuntimeError: processes cannot start.
    """
    if executor is None:
        return Engine(_Here(), 1)
    if isinstance(executor, int):
        if executor < 1:
            raise InputError(f"at least one worker is needed, got {executor}")
        return _OwnProcesses(max(1, min(executor, count)))
    if type(executor).__module__.partition(".")[0] == "distributed":
        return _Dask(executor)
    if not isinstance(executor, Submits):
        raise InputError(
            "executor must be None, a number of processes, a dask client or have `submit` as the "
            f"executors of concurrent.futures have; got {type(executor).__name__}"
        )
    pool = _pool(executor)
    if pool is not None and pool._mp_context.get_start_method() == "fork":
        raise InputError(
            "processes must be spawned: a fork of a process that has used JAX or OpenCV can hang. "
            'Give ProcessPoolExecutor(n, mp_context=multiprocessing.get_context("spawn")), or the '
            "number n alone"
        )
    workers = getattr(executor, "_max_workers", None) or os.cpu_count() or 1
    engine = Engine(executor, workers)
    engine.child = pool is not None
    if isinstance(executor, Executor):
        engine.losses = (RuntimeError,)  # of `submit` alone: it was shut down
    if "submitit" in sys.modules:
        engine.deaths += (sys.modules["submitit"].core.utils.UncompletedJobError,)
    return engine


def _pool(executor: Any) -> Any:
    """A process pool of `concurrent.futures`, whose module is loaded if it is one; else None."""
    process: Any = sys.modules.get("concurrent.futures.process")
    is_pool = process is not None and isinstance(executor, process.ProcessPoolExecutor)
    return executor if is_pool else None

"""Chunks of pictures through an executor: a worker that dies costs one picture, a stop costs none."""

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
    wait,
)
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from ..errors import ImagingError
from .row import Row, error_text, file_facts, measured_row

_AHEAD = 2  # chunks handed over for each process, so that none waits for the next
_stop: Any = None  # of this process, if it is a worker: an event that ends its chunk early


class WorkerDied(ImagingError):  # noqa: N818 - as all names in `_errors`
    """The process that measured a picture ended without a word, for lack of memory for example."""


@dataclass(frozen=True)
class Job:
    """Measure a chunk of pictures; travels to the workers.

    Args:
        recipe: a `Recipe`.
        reader: see `measure`; None for the usual one.
    """

    recipe: Any
    reader: Callable[..., Any] | None = None

    def __call__(self, paths: Sequence[str]) -> list[Row]:
        """The rows of these pictures, or of the first of them when told to stop."""
        rows = []
        for path in paths:
            if _stop is not None and _stop.is_set():
                break
            rows.append(measured_row(path, self.recipe, self.reader))
        return rows


def in_this_process(
    paths: Sequence[str],
    job: Callable[[Sequence[str]], list[Row]],
    begun: Callable[[str], AbstractContextManager[None]],
) -> Iterator[tuple[list[Row], bool]]:
    """(rows, whether they are final) of every picture, measured here by one thread.

    Args:
        paths: of the pictures.
        job: see `Job`.
        begun: entered while a picture is measured, for the case that this process dies of it.
    """
    import cv2  # noqa: PLC0415

    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        for path in paths:
            with begun(path):
                rows = job([path])
            yield rows, True
    finally:
        cv2.setNumThreads(threads)


def in_executor(
    executor: Executor, chunks: Sequence[Sequence[str]], job: Callable[[Sequence[str]], list[Row]]
) -> Iterator[tuple[list[Row], bool]]:
    """(rows, whether they are final) of every chunk, in the order in which they are done.

    Where the executor breaks, the rows say so and are not final: another run may measure them.
    """
    running: dict[Future[list[Row]], Sequence[str]] = {}
    lost: list[Sequence[str]] = []

    def result(future: Future[list[Row]], chunk: Sequence[str]) -> list[Row]:
        try:
            return future.result()
        except BrokenExecutor:
            lost.append(chunk)
            return []

    try:
        for chunk in chunks:
            try:
                future = executor.submit(job, chunk)
            except BrokenExecutor:
                lost.append(chunk)
                continue
            if future.done():  # at once, where the executor works in this thread
                yield result(future, chunk), True
            else:
                running[future] = chunk
        for future in as_completed(list(running)):
            yield result(future, running.pop(future)), True
    finally:
        for future in running:
            future.cancel()
    for chunk in lost:
        yield [_dead(path, "its executor broke; run again to measure it") for path in chunk], False


def in_processes(
    workers: int, chunks: Sequence[Sequence[str]], job: Callable[[Sequence[str]], list[Row]]
) -> Iterator[tuple[list[Row], bool]]:
    """The same in spawned processes of our own.

    When a worker dies, its neighbours' chunks are lost with it; their pictures are then measured one
    by one, so that the picture at fault is known, and the rest goes on in new workers. When the
    caller is interrupted, what the workers have done so far still comes back.
    """
    waiting = deque(chunks)
    while waiting:
        suspects: list[Sequence[str]] = []
        yield from _until_death(workers, waiting, suspects, job)
        if suspects:
            yield from _one_by_one([path for chunk in suspects for path in chunk], job)


def _until_death(
    workers: int,
    waiting: deque[Sequence[str]],
    suspects: list[Sequence[str]],
    job: Callable[[Sequence[str]], list[Row]],
) -> Iterator[tuple[list[Row], bool]]:
    """Work off the chunks that wait; if a worker dies, those it may have died of become suspects."""
    running: dict[Future[list[Row]], Sequence[str]] = {}
    pool, stop = _pool(workers)
    try:
        while (waiting and not suspects) or running:
            while waiting and not suspects and len(running) < _AHEAD * workers:
                chunk = waiting.popleft()
                try:
                    running[pool.submit(job, chunk)] = chunk
                except BrokenExecutor:
                    suspects.append(chunk)
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                chunk = running.pop(future)
                try:
                    rows = future.result()
                except BrokenExecutor:
                    suspects.append(chunk)
                else:
                    yield rows, True
    except KeyboardInterrupt:
        stop.set()
        pool.shutdown(cancel_futures=True)
        for future in running:
            if not future.cancelled() and future.exception() is None:
                yield future.result(), True
        raise
    finally:
        stop.set()
        pool.shutdown(cancel_futures=True)


def _one_by_one(
    paths: Sequence[str], job: Callable[[Sequence[str]], list[Row]]
) -> Iterator[tuple[list[Row], bool]]:
    waiting = deque(paths)
    while waiting:
        pool, _ = _pool(1)
        try:
            while waiting:
                path = waiting.popleft()
                try:
                    yield pool.submit(job, [path]).result(), True
                except BrokenExecutor:
                    why = "the process that measured it ended without a word, twice"
                    yield [_dead(path, why)], True
                    break
        finally:
            pool.shutdown(cancel_futures=True)


def _dead(path: str, why: str) -> Row:
    return Row(path, error=error_text(WorkerDied(why, path=path)), **file_facts(path))


def _pool(workers: int) -> tuple[ProcessPoolExecutor, Any]:
    """Spawned processes (a fork after OpenCV has run can hang), and the event that stops them.

    Raises:
        RuntimeError: the first of them cannot even start.
    """
    context = multiprocessing.get_context("spawn")
    stop = context.Event()
    pool = ProcessPoolExecutor(workers, context, initializer=_prepare, initargs=(stop,))
    try:
        pool.submit(os.getpid).result()
    except BrokenExecutor:
        pool.shutdown()
        raise RuntimeError(
            "worker processes cannot start. A script that measures with processes needs its calls "
            'under `if __name__ == "__main__":`, because each worker imports it; else give '
            "executor=concurrent.futures.ThreadPoolExecutor()"
        ) from None
    return pool, stop


def _prepare(stop: Any) -> None:
    """Make this process a worker: one thread, deaf to Ctrl-C, gone when its parent is."""
    import cv2  # noqa: PLC0415

    global _stop  # noqa: PLW0603 -- an event can reach a worker only when it starts
    _stop = stop
    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent says when to stop
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    """End with a parent that was killed; a worker would wait for it for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

"""Pictures through an executor: a worker that dies costs one picture, a stop costs none."""

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    wait,
)

from ..errors import ImagingError
from .row import Row, error_text, file_facts

_AHEAD = 2  # pictures submitted for each process, so that none is idle

Work = Callable[[Sequence[str]], list[Row]]
"""From the paths of some pictures to their rows; picklable."""

Rows = Generator[list[Row], None, None]
"""Rows of some pictures at a time."""


class WorkerDied(ImagingError):  # noqa: N818 - as all names in `imaging.errors`
    """The process that measured a picture ended abnormally, for lack of memory for example."""


def in_executor(
    executor: Executor,
    chunks: Iterable[Sequence[str]],
    work: Work,
    ahead: int,
    lost: list[str],
) -> Rows:
    """The rows of every chunk, in the order in which they are done.

    When the caller is interrupted, or throws `KeyboardInterrupt` in here, the chunks under way still
    come back.

    Args:
        executor: where the chunks are measured.
        chunks: of paths, asked for when they are needed.
        work: from paths to rows.
        ahead: most chunks that are submitted at a time.
        lost: takes the paths of the chunks with which the executor broke.
    """
    running: dict[Future[list[Row]], Sequence[str]] = {}
    remaining = iter(chunks)

    def result(future: Future[list[Row]]) -> list[Row]:
        chunk = running.pop(future)
        try:
            return future.result()
        except BrokenExecutor:
            lost.extend(chunk)
            return []

    try:
        while True:
            # An executor that works in this thread is given one chunk at a time.
            while len(running) < ahead and not any(future.done() for future in running):
                chunk = next(remaining, None)
                if chunk is None:
                    break
                try:
                    running[executor.submit(work, chunk)] = chunk
                except BrokenExecutor:
                    lost.extend(chunk)
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield result(future)
    except KeyboardInterrupt:
        for future in [future for future in running if not future.cancel()]:
            yield result(future)
        raise
    finally:
        for future in running:
            future.cancel()


def in_processes(workers: int, paths: Sequence[str], work: Work, *, ahead: int = _AHEAD) -> Rows:
    """The rows of every picture from spawned processes of our own, as they are done.

    When a worker dies, the pictures under way in its neighbours are lost with it; all of these are
    then measured one by one, so that the picture at fault is known, and the rest goes on in new
    workers. An interrupt does as in `in_executor`.

    Args:
        workers: number of processes.
        paths: of the pictures.
        work: measures them.
        ahead: pictures submitted at a time for each process.
    """
    waiting = deque(paths)
    while waiting:
        suspects: list[str] = []
        with _pool(workers) as pool:
            chunks = _next(waiting, suspects)
            yield from in_executor(pool, chunks, work, ahead * workers, suspects)
        if ahead * workers > 1:
            yield from in_processes(1, suspects, work, ahead=1)
        else:
            why = "the process that measured it ended abnormally, twice"
            yield [dead_row(path, why) for path in suspects]


def _next(waiting: deque[str], suspects: Sequence[str]) -> Iterator[list[str]]:
    """The pictures that wait, one at a time, until there are suspects."""
    while waiting and not suspects:
        yield [waiting.popleft()]


def dead_row(path: str, why: str) -> Row:
    """The row of a picture whose worker died."""
    return Row(path, error=error_text(WorkerDied(why, path=path)), **file_facts(path))


@contextlib.contextmanager
def _pool(workers: int) -> Iterator[Executor]:
    """Spawned processes: a fork after OpenCV has run can hang.

    Raises:
        RuntimeError: the first of them cannot even start.
    """
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(workers, context, initializer=_prepare)
    try:
        pool.submit(os.getpid).result()
        yield pool
    except BrokenExecutor:
        raise RuntimeError(
            "worker processes cannot start. A script that measures with processes needs its calls "
            'under `if __name__ == "__main__":`, because each worker imports it; else give '
            "executor=concurrent.futures.ThreadPoolExecutor()"
        ) from None
    finally:
        pool.shutdown(cancel_futures=True)


def _prepare() -> None:
    """Make this process a worker: it has one thread, ignores SIGINT and exits with its parent."""
    import cv2  # noqa: PLC0415

    cv2.setNumThreads(1)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent stops its workers
    threading.Thread(target=_exit_with_parent, daemon=True).start()


def _exit_with_parent() -> None:
    """Exit when the parent is killed; a worker would wait for it indefinitely."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)

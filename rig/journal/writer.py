"""Append-only text: the device's own lines verbatim, and notes as JSON lines with the same CRC.

{"note":"set","n":12,"at":3.20112,"pressure_Pa":275790.3}*5A1C
T,...*09F2

What was queued is in the kernel within milliseconds, so killing this process loses no more than
that; it is on the disk within about a second. Neither blocks the caller.
"""

import datetime
import json
import os
import queue
import shutil
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from ..errors import RigError
from ..fault import RigFault
from ..protocol.lines import frame

FORMAT = "famjax journal 1"
RESERVE_BYTES = 50_000_000
"""Free space on the disk at which a recording stops."""
BYTES_PER_SECOND = 6000
"""What 100 records a second, statuses and notes need."""
BACKLOG_LIMIT = 1 << 22
"""Bytes queued for the disk at which it counts as hung: more than ten minutes of records."""

_sync_data: Callable[[int], None] = getattr(os, "fdatasync", os.fsync)


class Journal:
    """A journal that is being written.

    Lines and notes may be queued from any thread and keep their order. One thread writes them to
    the kernel at once; a second one syncs the file to the disk every `sync_period`.

    Args:
        path: the file; created, or with `append` continued after its last complete line.
        now: the clock of the notes [s].
        append: continue an existing journal.
        plan_seconds: expected duration [s]; the disk must have room for three times its records.
        reserve_bytes: free space at which `check` raises.
        began: date of the recording, of a simulated one; now if None.
        sync_period: seconds between two syncs.
        sync: brings a file descriptor's data to the disk.

    Raises:
        RigError: the file exists (or does not, with `append`), its folder cannot be written, or the
            disk has too little room for the plan.
    """

    def __init__(
        self,
        path: str | Path,
        now: Callable[[], float],
        *,
        append: bool = False,
        plan_seconds: float = 0.0,
        reserve_bytes: int = RESERVE_BYTES,
        began: datetime.datetime | None = None,
        sync_period: float = 1.0,
        sync: Callable[[int], None] = _sync_data,
    ) -> None:
        self.path = Path(path)
        self._now = now
        self._reserve = reserve_bytes
        _check_room(self.path.absolute().parent, 3 * plan_seconds * BYTES_PER_SECOND, reserve_bytes)
        self._file = _open(self.path, append)
        self._lock = threading.Lock()  # orders the notes' numbers with the queue
        self._queue: queue.SimpleQueue[bytes | None] = queue.SimpleQueue()
        self._notes = 0
        self._queued = self._written = 0
        self._failure: str | None = None
        self._sync = sync
        self._sync_period = sync_period
        self._closing = threading.Event()
        self._writer = threading.Thread(target=self._write, name="journal writer", daemon=True)
        self._syncer = threading.Thread(target=self._keep_synced, name="journal sync", daemon=True)
        self._writer.start()
        self._syncer.start()
        began = began or datetime.datetime.now(datetime.UTC)
        self.note("journal", format=FORMAT, wall=began.isoformat(timespec="milliseconds"))

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def lines(self, data: bytes) -> None:
        """Queue verified lines of the device, each with its end."""
        if data:
            with self._lock:
                self._put(data)

    def note(self, kind: str, /, **fields: Any) -> None:
        """Queue a note; every field must be JSON, numbers finite, units in the names."""
        with self._lock:
            content = {"note": kind, "n": self._notes, "at": round(self._now(), 6), **fields}
            text = json.dumps(content, allow_nan=False, separators=(",", ":"))
            self._put(frame(text.replace("*", r"\u002a")))  # the asterisk begins the CRC
            self._notes += 1

    @property
    def waiting(self) -> int:
        """Bytes that are queued and not yet in the kernel."""
        return self._queued - self._written

    def check(self) -> None:
        """Nothing unless the recording has failed.

        Raises:
            RigFault: it has; all that was written before stays.
        """
        if self._failure is not None:
            raise RigFault(self._failure)
        if self.waiting > BACKLOG_LIMIT:
            raise RigFault(
                f"{self.waiting / 1e6:.1f} MB wait for the disk of {self.path}, which hangs; "
                "record to a local disk"
            )

    def close(self) -> None:
        """Write and sync all that is queued; closing twice does nothing.

        Raises:
            RigFault: not all of it could be written.
        """
        if self._closing.is_set():
            return
        with self._lock:
            self._closing.set()
            self._queue.put(None)
        self._writer.join()
        self._syncer.join()
        try:
            self._sync(self._file)
        except OSError as error:
            self._fail(error)
        os.close(self._file)
        self.check()

    def _put(self, data: bytes) -> None:
        if self._failure is None and not self._closing.is_set():
            self._queued += len(data)
            self._queue.put(data)

    def _write(self) -> None:
        """Write all that is queued in one call: in virtual time one call per line is too slow."""
        waiting: list[bytes | None] = []
        while not waiting or waiting[-1] is not None:  # nothing comes after None
            waiting = [self._queue.get()]
            while not self._queue.empty():
                waiting.append(self._queue.get())
            data = b"".join(filter(None, waiting))
            try:
                view = memoryview(data)
                while view:
                    view = view[os.write(self._file, view) :]
            except OSError as error:
                self._fail(error)
                return
            self._written += len(data)

    def _keep_synced(self) -> None:
        synced = 0
        while not self._closing.wait(self._sync_period):
            try:
                if self._written > synced:
                    synced = self._written
                    self._sync(self._file)
                if shutil.disk_usage(self.path.absolute().parent).free < self._reserve:
                    self._failure = (
                        f"less than {self._reserve / 1e6:.0f} MB are free beside {self.path}; "
                        "the recording stops while all of it can still be written"
                    )
                    return
            except OSError as error:
                self._fail(error)
                return

    def _fail(self, error: OSError) -> None:
        self._failure = self._failure or f"cannot write {self.path}: {error.strerror}"


def _open(path: Path, append: bool) -> int:
    flags = os.O_RDWR | os.O_APPEND if append else os.O_WRONLY | os.O_CREAT | os.O_EXCL
    try:
        file = os.open(path, flags | getattr(os, "O_BINARY", 0), 0o644)
    except FileExistsError:
        raise RigError(f"{path} exists; give another name, or resume it") from None
    except OSError as error:
        raise RigError(f"cannot write {path}: {error.strerror}") from None
    if append and (size := os.fstat(file).st_size):
        os.lseek(file, size - 1, os.SEEK_SET)
        if os.read(file, 1) != b"\n":  # ends a line that was cut short
            os.write(file, b"\n")
    return file


def _check_room(folder: Path, needed: float, reserve: int) -> None:
    try:
        free = shutil.disk_usage(folder).free
    except OSError as error:
        raise RigError(f"cannot write to {folder}: {error.strerror}") from None
    if free < needed + reserve:
        raise RigError(
            f"{folder} has {free / 1e6:.0f} MB free, the plan needs {(needed + reserve) / 1e6:.0f} MB "
            "(three times its records and a reserve); make room or record elsewhere"
        )

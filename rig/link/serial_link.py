"""A link over a serial port, which one thread owns."""

import os
import threading
import time
from collections.abc import Callable
from typing import Any, Protocol

from ..errors import RigError
from .abstract_link import AbstractLink

READ_TIMEOUT = 0.004
"""Longest wait for a byte [s], and with it the resolution of heartbeats and requests."""
REOPEN = 0.02
"""Time [s] between attempts to reopen a port."""


_READ_LIMIT = 4096


class Port(Protocol):
    """The interface of a port, which `serial.Serial` has."""

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        ...

    def read(self, size: int = 1, /) -> bytes:
        """Up to `size` bytes, after `READ_TIMEOUT` those that have arrived."""
        ...

    def write(self, data: bytes, /) -> Any:
        """Send bytes."""
        ...

    def close(self) -> None:
        """Close the port."""
        ...


def serial_opener(path: str, baud: int = 115200) -> Callable[[], Port]:
    """A function that opens a serial port for this program alone.

    Opening the port of most Arduino boards resets them: the link sees a reset, not a reconnection.

    Args:
        path: a device such as /dev/serial/by-id/..., COM3, or a URL such as socket://host:port.
        baud: bits a second, as the firmware was built for.
    """

    def open_port() -> Port:
        import serial  # noqa: PLC0415 -- importing rig loads no serial library

        options: dict[str, Any] = {"timeout": READ_TIMEOUT, "write_timeout": 0.5}
        if "://" not in path:
            options["exclusive"] = True
        return serial.serial_for_url(path, baud, **options)

    return open_port


class Link(AbstractLink):
    """A link over a real port, in real time.

    A port that disappears is opened again. Until then records and heartbeats are missing, so that a
    running device vents within its limit of silence.

    Args:
        opener: opens the port, as `serial_opener` does.

    Raises:
        RigError: the port cannot be opened: it is not there, or another program has it.
    """

    def __init__(self, opener: Callable[[], Port]) -> None:
        super().__init__(first_id=(time.time_ns() // 1_000_000) ^ os.getpid())
        self._opener = opener
        try:
            self._port: Port | None = opener()
        except OSError as error:  # what pyserial raises is one
            raise RigError(
                f"cannot open the port: {error}; is it plugged in, and has no other program it open?"
            ) from None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="rig link", daemon=True)
        self._thread.start()

    @property
    def now(self) -> float:
        """Monotonic time of this machine [s]."""
        return time.monotonic()

    @property
    def running(self) -> bool:
        """Whether the thread has neither been closed nor ended with an error."""
        return self._thread.is_alive()

    @property
    def connected(self) -> bool:
        """Whether the port is open."""
        return self._port is not None

    def sleep(self, seconds: float) -> None:
        """Wait while the thread runs."""
        time.sleep(max(seconds, 0.0))

    def close(self) -> None:
        """End the thread and close the port."""
        self._closing.set()
        self._thread.join()
        self._drop()

    def _run(self) -> None:
        while not self._closing.is_set():
            data = self._read()
            out = self._pump(data)
            if out:
                self._write(out)

    def _read(self) -> bytes:
        if self._port is None:
            self._closing.wait(REOPEN)
            try:
                self._port = self._opener()
            except OSError:
                return b""  # not back yet; the session reports the silence
        try:
            data = self._port.read(self._port.in_waiting or 1)
            while (waiting := self._port.in_waiting) and len(data) < _READ_LIMIT:
                data += self._port.read(waiting)  # a socket reports one byte at most
            return data
        except OSError:
            self._drop()
            return b""

    def _write(self, data: bytes) -> None:
        try:
            if self._port is not None:
                self._port.write(data)
        except OSError:
            self._drop()

    def _drop(self) -> None:
        port, self._port = self._port, None
        if port is None:
            return
        try:
            port.close()
        except OSError:
            return  # closed already

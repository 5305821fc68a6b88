"""The connection to a device: bytes over a serial port or from a simulated rig, recorded.

`Link` is a real port in real time, `VirtualLink` a simulated rig in virtual time; both carry one
`Session`, whose commands and records they hand on.
"""

import abc
import contextlib
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from pathlib import Path
from typing import Any, Self

from .calibration import READINGS
from .errors import RigError, RigFault
from .journal import Journal
from .protocol import Ack, Sample
from .session import NOTES, Event, Lost, Reset, Session, Silent

READ_TIMEOUT = 0.004  # s to wait for a byte at most, and the resolution of heartbeats and requests
SLICE = 0.004  # s of virtual time between two exchanges of bytes
_POLL = 0.004  # s between two looks for an answer


class AbstractLink(abc.ABC):
    """A session with its recording; a subclass adds transport and clock.

    Every wait goes through `sleep`, so that one plan runs in real and in virtual time. All methods
    but `close` may be called from any thread.

    Args:
        first_id: number of the first command, see `Session`.

    Attributes:
        session: the conversation.
        alarms: losses, resets and silences that were not handled yet.
        watch: called with every record, or None.
    """

    def __init__(self, first_id: int) -> None:
        self.session = Session(first_id=first_id)
        self.alarms: deque[Lost | Reset | Silent] = deque(maxlen=10_000)
        self.watch: Callable[[Sample], None] | None = None
        self._journal: Journal | None = None
        self._lock = threading.Lock()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    @abc.abstractmethod
    def now(self) -> float:
        """The link's time [s]."""

    @property
    @abc.abstractmethod
    def running(self) -> bool:
        """Whether bytes are exchanged."""

    @abc.abstractmethod
    def sleep(self, seconds: float) -> None:
        """Wait for a time [s] while bytes are exchanged."""

    @abc.abstractmethod
    def close(self) -> None:
        """Close the connection; the heartbeats stop."""

    @property
    def newest(self) -> Sample | None:
        """The last record in order, or None."""
        return self.session.newest

    def attach(self, journal: Journal | None) -> None:
        """Record into a journal from now on; None detaches, which must come before closing it."""
        with self._lock:
            self._journal = journal

    def check(self) -> None:
        """Nothing unless the link or the recording has failed.

        Raises:
            RigFault: the link has ended, or as `Journal.check`.
        """
        if not self.running:
            raise RigFault("the link has ended: no byte is exchanged; the device vents by itself")
        if self._journal is not None:
            self._journal.check()

    def keep_alive(self) -> None:
        """Extend the heartbeats by five seconds; only the code that supervises the test does so."""
        with self._lock:
            self.session.keep_alive(self.now)

    def rest(self) -> None:
        """Stop the heartbeats at once."""
        with self._lock:
            self.session.rest()

    def command(self, verb: str, *values: float | str) -> Ack:
        """Send a command and wait for the device's answer.

        Raises:
            RigError: the device refuses the command, or a number is not finite.
            RigFault: no answer came, or the device was reset meanwhile.
        """
        with self._lock:
            command = self.session.command(verb, *values)
        while not command.done:
            if not self.running:
                raise RigFault(f"{verb!r} was not sent: the link has ended")
            self.sleep(_POLL)
        said = " ".join([verb, *map(str, values)])
        if command.answer is None:
            raise RigFault(f"{said!r} failed: {command.failure}; check cable and supply")
        if command.answer.seq is None:
            raise RigError(f"the device refuses {said!r}: {command.answer.reason}")
        return command.answer

    def settle(self, seconds: float) -> None:
        """Wait up to a time [s] for missing records; those that have not come by then are lost."""
        until = self.now + seconds
        while self.running and self.session.gaps and self.now < until:
            self.sleep(_POLL)
        with self._lock:
            self.session.give_up()
            self._take(self.session.feed(b"", self.now))

    def _pump(self, data: bytes) -> bytes:
        """Process received bytes; returns the bytes to send."""
        with self._lock:
            now = self.now
            events = self.session.feed(data, now)
            lines = self.session.take_lines()
            if self._journal is not None:
                self._journal.lines(lines)
            self._take(events)
            return self.session.poll(now)

    def _take(self, events: list[Event]) -> None:
        for event in events:
            if type(event) is Sample:
                if self.watch is not None:
                    self.watch(event)
                continue
            if isinstance(event, Lost | Reset | Silent):
                self.alarms.append(event)
            kind = NOTES.get(type(event))
            if kind is not None and self._journal is not None:
                self._journal.note(kind, **event._asdict())


def ports() -> dict[str, str]:
    """The serial ports of this computer: path to open, and description.

    A path under /dev/serial/by-id stays the same when a board is replugged.
    """
    from serial.tools import list_ports  # noqa: PLC0415 -- importing rig loads no serial library

    stable = {str(path.resolve()): str(path) for path in Path("/dev/serial/by-id").glob("*")}
    found = sorted(list_ports.comports())
    return {stable.get(port.device, port.device): port.description for port in found}


def serial_opener(path: str, baud: int = 115200) -> Callable[[], Any]:
    """A function that opens a serial port for this program alone.

    Opening the port of most Arduino boards resets them: the link sees a reset, not a reconnection.

    Args:
        path: a device such as /dev/serial/by-id/..., COM3, or a URL such as socket://host:port.
        baud: bits a second, as the firmware was built for.
    """

    def open_port() -> Any:
        import serial  # noqa: PLC0415 -- importing rig loads no serial library

        options: dict[str, Any] = {"timeout": READ_TIMEOUT, "write_timeout": 0.5}
        if "://" not in path:
            options["exclusive"] = True
        return serial.serial_for_url(path, baud, **options)

    return open_port


class Link(AbstractLink):
    """A link over a real port, in real time; one thread owns the port.

    A port that disappears is opened again. Until then records and heartbeats are missing, so that a
    running device vents within its limit of silence.

    Args:
        opener: opens the port, as `serial_opener` does; the port has `in_waiting`, `read`, `write` and
            `close` as pyserial's do, and its errors are `OSError`s.

    Attributes:
        port: what it has opened, None while it is away.

    Raises:
        RigError: the port cannot be opened: it is not there, or another program has it.
    """

    def __init__(self, opener: Callable[[], Any]) -> None:
        super().__init__(first_id=(time.time_ns() // 1_000_000) ^ os.getpid())
        self._opener = opener
        try:
            self.port: Any = opener()
        except OSError as error:
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
            try:
                data = self._read()
            except OSError:  # the session reports the silence
                self._drop()
                data = b""
            out = self._pump(data)
            try:
                if out and self.port is not None:
                    self.port.write(out)
            except OSError:
                self._drop()

    def _read(self) -> bytes:
        if self.port is None:
            self._closing.wait(0.02)
            self.port = self._opener()
        data = self.port.read(self.port.in_waiting or 1)
        while (waiting := self.port.in_waiting) and len(data) < 4096:
            data += self.port.read(waiting)  # a socket reports one byte at most
        return data

    def _drop(self) -> None:
        port, self.port = self.port, None
        with contextlib.suppress(OSError):  # closed already
            if port is not None:
                port.close()


class VirtualLink(AbstractLink):
    """A link to a simulated rig: no thread, and time passes only in `sleep`.

    Args:
        rig: the device's side of the cable: `now` [s], `write(bytes)`, `read()` and
            `advance(seconds)`, as `SimulatedRig` has them.
        first_id: number of the first command.
    """

    def __init__(self, rig: Any, first_id: int = 0) -> None:
        super().__init__(first_id)
        self.rig = rig
        self._part = b""  # of an incomplete line

    @property
    def now(self) -> float:
        """Virtual time [s]."""
        return self.rig.now

    @property
    def running(self) -> bool:
        """Always: `sleep` moves the bytes."""
        return True

    def sleep(self, seconds: float) -> None:
        """Advance the rig in slices of `SLICE`, exchanging bytes where there is a line or need."""
        rig, idle = self.rig, self.session.idle
        end = rig.now + seconds
        while (left := end - rig.now) > 1e-9:
            rig.advance(SLICE if left > SLICE else left)
            data = self._part + rig.read()
            if b"\n" not in data and idle(rig.now):
                self._part = data
                continue
            self._part = b""
            out = self._pump(data)
            if out:
                rig.write(out)

    def close(self) -> None:
        """Nothing to close."""


def mean_counts(
    link: AbstractLink, seconds: float, wait: Callable[[float], None] | None = None
) -> tuple[float, float]:
    """Mean sums of five readings of pressure and force [counts] over a time [s].

    Args:
        link: to the device, in any state; nothing is sent.
        seconds: of the mean.
        wait: waits for a time [s] and supervises a run meanwhile; none runs unless given.

    Raises:
        RigFault: no record came.
    """
    found: list[Sample] = []
    until = link.now + 4.0  # a board that was reset by opening its port takes two seconds at most
    if wait is None:
        link.sleep(0.1)  # a record that was begun before has come
    while wait is None and link.session.settings is None and link.now < until:
        link.sleep(0.05)
    link.watch = found.append
    try:
        (wait or link.sleep)(seconds)
    finally:
        link.watch = None
    if not found or link.session.settings is None:
        raise RigFault(f"no record came in {seconds:g} s; check the cable")
    scale = READINGS / link.session.settings.ticks_per_record / len(found)
    pressure, force = sum(s.pressure_sum for s in found), sum(s.force_sum for s in found)
    return scale * pressure, scale * force

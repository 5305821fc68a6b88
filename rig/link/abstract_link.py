"""The interface of a link to a device, whatever its transport and clock."""

import abc
import threading
from collections import deque
from collections.abc import Callable
from typing import Self

from ..errors import RigError
from ..fault import RigFault
from ..journal.writer import Journal
from ..protocol.messages import Ack, Sample
from .events import NOTES, Event, Lost, Reset, Silent
from .session import Session

_POLL = 0.004


class AbstractLink(abc.ABC):
    """A session with its recording; a subclass adds transport and clock.

    Every wait goes through `sleep`, so that one plan runs in real and in virtual time. All methods
    but `close` may be called from any thread.

    Args:
        first_id: number of the first command, see `CommandQueue`.

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
        return self.session.order.newest

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

    def kick(self) -> None:
        """Extend the heartbeats by five seconds; only the code that supervises the test does so."""
        with self._lock:
            self.session.kick(self.now)

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
        while self.running and self.session.order.gaps and self.now < until:
            self.sleep(_POLL)
        with self._lock:
            self.session.order.give_up()
            for event in self.session.feed(b"", self.now):
                self._take(event)

    def _pump(self, data: bytes) -> bytes:
        """Process received bytes; returns the bytes to send."""
        with self._lock:
            now = self.now
            events = self.session.feed(data, now)
            lines = self.session.take_lines()
            if self._journal is not None:
                self._journal.lines(lines)
            for event in events:
                if type(event) is Sample:
                    if self.watch is not None:
                        self.watch(event)
                else:
                    self._take(event)
            return self.session.poll(now)

    def _take(self, event: Event) -> None:
        if isinstance(event, Lost | Reset | Silent):
            self.alarms.append(event)
        kind = NOTES.get(type(event))
        if kind is not None and self._journal is not None:
            self._journal.note(kind, **event._asdict())

"""What a link to a device offers, whatever carries its bytes and whatever its time is."""

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
    """A session with its recording; a subclass brings bytes and time.

    Every wait goes through `sleep`, so that one plan runs in real and in virtual time. All methods
    but `close` may be called from any thread.

    Args:
        first_id: number of the first command, see `CommandQueue`.

    Attributes:
        session: the conversation.
        alarms: losses, resets and silences that nobody has looked at yet.
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
        """Whether anybody moves the bytes."""

    @abc.abstractmethod
    def sleep(self, seconds: float) -> None:
        """Let time pass [s] while bytes go on flowing."""

    @abc.abstractmethod
    def close(self) -> None:
        """Let the device go; heartbeats end with it."""

    @property
    def newest(self) -> Sample | None:
        """The last record in order, or None."""
        return self.session.order.newest

    def attach(self, journal: Journal | None) -> None:
        """Record into a journal from now on; None detaches, which must come before closing it."""
        with self._lock:
            self._journal = journal

    def check(self) -> None:
        """Nothing while bytes flow and the recording goes well.

        Raises:
            RigFault: nobody moves the bytes any more, or as `Journal.check`.
        """
        if not self.running:
            raise RigFault(
                "the link has ended and nobody moves the bytes; the device vents by itself"
            )
        if self._journal is not None:
            self._journal.check()

    def kick(self) -> None:
        """Let heartbeats go on for five seconds more; only who looks after the test may do so."""
        with self._lock:
            self.session.kick(self.now)

    def rest(self) -> None:
        """Stop the heartbeats at once."""
        with self._lock:
            self.session.rest()

    def command(self, verb: str, *values: float | str) -> Ack:
        """The device's answer to a command, waited for.

        Raises:
            RigError: the device refuses the command, or a number is not finite.
            RigFault: no answer came, or the device was reset meanwhile.
        """
        with self._lock:
            command = self.session.command(verb, *values)
        while not command.done:
            if not self.running:
                raise RigFault(f"nobody sends {verb!r}: the link has ended")
            self.sleep(_POLL)
        said = " ".join([verb, *map(str, values)])
        if command.answer is None:
            raise RigFault(f"{said!r} came to nothing: {command.failure}; look at cable and supply")
        if command.answer.seq is None:
            raise RigError(f"the device refuses {said!r}: {command.answer.reason}")
        return command.answer

    def settle(self, seconds: float) -> None:
        """Wait a while [s] for records that are still missing; what has not come then is lost."""
        until = self.now + seconds
        while self.running and self.session.order.gaps and self.now < until:
            self.sleep(_POLL)
        with self._lock:
            self.session.order.give_up()
            for event in self.session.feed(b"", self.now):
                self._take(event)

    def _pump(self, data: bytes) -> bytes:
        """Hand in what was received; what is to be sent."""
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

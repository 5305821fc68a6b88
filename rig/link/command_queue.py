"""Commands one after the other: each is sent again until it is answered or has failed."""

import dataclasses
import math
from collections import deque

from ..errors import RigError
from ..protocol.lines import command_body, frame
from ..protocol.messages import Ack

RETRY = 0.06
"""Time [s] after which a command that was not answered is sent again."""
GIVE_UP = 2.0
"""Time [s] after which it has failed."""
_LAST_ID = 30_000


@dataclasses.dataclass(eq=False)
class Command:
    """A command under way.

    Attributes:
        id: its number; the device answers a repeated number without executing it twice.
        verb: what to do.
        line: as it is sent.
        answer: of the device, None until it has come.
        failure: why none will come, None while one may.
        sent_at: when it was sent first [s].
    """

    id: int
    verb: str
    line: bytes
    answer: Ack | None = None
    failure: str | None = None
    sent_at: float | None = None

    @property
    def done(self) -> bool:
        """Whether it was answered or has failed."""
        return self.answer is not None or self.failure is not None


class CommandQueue:
    """Commands in a queue; one is under way at a time.

    Args:
        first_id: number of the first command. The device remembers the last one it executed, also from
            a program that ran before: begin with another number than that one did.
    """

    def __init__(self, first_id: int) -> None:
        self._id = first_id % _LAST_ID
        self._queue: deque[Command] = deque()
        self._retry_at = -math.inf

    def __len__(self) -> int:
        return len(self._queue)

    def put(self, verb: str, values: tuple[float | str, ...]) -> Command:
        """Queue a command.

        Raises:
            RigError: a number that is not finite.
        """
        for value in values:
            if not isinstance(value, str) and not math.isfinite(value):
                raise RigError(f"{verb} needs finite numbers, got {values}")
        self._id = self._id % _LAST_ID + 1  # 0 is for lines that need no answer
        line = frame(command_body(self._id, verb, *values))
        command = Command(self._id, verb, line)
        self._queue.append(command)
        return command

    def send(self, now: float) -> bytes:
        """The line to be sent at host time `now` [s], or nothing."""
        while self._queue:
            command = self._queue[0]
            if command.sent_at is None:
                command.sent_at = now
            elif now - command.sent_at >= GIVE_UP:
                command.failure = f"the device did not answer for {GIVE_UP:g} s"
                self._queue.popleft()
                continue
            elif now < self._retry_at:
                return b""
            self._retry_at = now + RETRY
            return command.line
        return b""

    def answered(self, answer: Ack) -> Command | None:
        """The command that an answer belongs to, now done, or None where it is an old one."""
        if not self._queue:
            return None
        command = self._queue[0]
        if command.id != answer.id or command.sent_at is None:
            return None
        self._queue.popleft()
        command.answer = answer
        return command

    def withdraw(self, command: Command | None) -> None:
        """Drop a query, so that it does not delay other commands."""
        if command in self._queue:
            self._queue.remove(command)

    def fail(self, why: str) -> None:
        """Fail all queued commands: what a device had not executed before a reset must not follow it."""
        for command in self._queue:
            command.failure = why
        self._queue.clear()

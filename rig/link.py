"""Connection to a device: the host's side of the protocol, and recording.

`Session` has no clock and no thread: it accepts bytes and times, and returns bytes and events. Every record
is returned exactly once. Missing records are requested again, and doubtful records must be confirmed. A
command is repeated until the device answers it. Heartbeats continue only while a test is supervised. `Link`
runs a session over a real port in real time; `VirtualLink` runs one over a simulated rig in virtual time.
"""

import abc
import contextlib
import dataclasses
import math
import os
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Any, NamedTuple

from .calibration import READINGS
from .errors import RigError, RigFault
from .journal import Journal
from .protocol import (
    DRIVEN,
    TICK_HZ,
    TICKS,
    Ack,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Message,
    Sample,
    Splitter,
    command_body,
    frame,
    parse,
)

HEARTBEAT = 0.2  # s between heartbeats
ALIVE = 5.0  # s for which heartbeats continue after `keep_alive`, even if the plan hangs
SILENCE = 1.0  # s without a verified line
SUSPICION = 10.0  # s after a damaged line during which unusual records must be confirmed
RETRY = 0.06  # s after which an unanswered command is sent again
GIVE_UP = 2.0  # s after which an unanswered command has failed
SPACING = 0.012  # smallest time between two requests for records [s]
MASK_BITS = 64  # records in a request
_SLACK = 0.004  # s
_LAST_ID = 30_000
# Unusual changes between two records: sum and count (2.5 psi of 200), force, output, integral.
_JUMP = (64, 13, 64, 32, 2 << 15)
_MOST_TICKS = 50  # in a record
_NEAR = 16  # largest distance of two records that confirm each other
_CHANGES_SETTINGS = {"set", "gain", "ilim", "cal", "tele", "trip", "jump", "stall", "hbms",
                     "floor", "ceiling", "still", "frozen"}  # fmt: skip
SLICE = 0.004  # s between two exchanges of bytes, the resolution of heartbeats and requests


class Lost(NamedTuple):
    """Lost records of one boot: first <= seq < first + records."""

    boot: int
    first: int
    records: int


class Reset(NamedTuple):
    """A restart of the device: boot counters modulo 16, and `cause` as in `Hello`, None if unknown."""

    old: int
    new: int
    cause: int | None


class Silent(NamedTuple):
    """Seconds without a verified line, reported once for each silence."""

    seconds: float


class Timing(NamedTuple):
    """Tick and arrival time [s] of the record with the shortest latency in a quarter of a second."""

    boot: int
    tick: int
    arrival_s: float


# Kinds of notes in the journal; their fields are those of the event.
NOTES = {Lost: "lost", Reset: "reset", Silent: "silent", Timing: "clock"}
Event = Message | Lost | Reset | Silent | Timing


@dataclasses.dataclass(eq=False)
class Command:
    """A command in progress.

    Attributes:
        id: number of the command; the device answers a repeated number without executing it again.
        verb: verb of the command.
        line: line sent to the device.
        answer: the device's answer, None until it arrives.
        failure: reason why no answer is expected; None if one may arrive.
        sent_at: time of the first transmission [s].
    """

    id: int
    verb: str
    line: bytes
    answer: Ack | None = None
    failure: str | None = None
    sent_at: float | None = None

    @property
    def done(self) -> bool:
        """True if the command was answered or has failed."""
        return self.answer is not None or self.failure is not None


class Session:
    r"""One session with a device.

    A record is doubtful if its tick does not follow from the newest record, or, after a damaged line, if a
    value jumps. It is accepted only if the next record follows from it, or if the same line arrives twice.
    A 16-bit CRC alone accepts one in 65 536 damaged lines.

    Args:
        first_id: number of the first command. The device remembers the last command it executed, even from
            an earlier program, so use a number different from that program's.

    Attributes:
        newest: last record in order, or None.
        gaps: missing records, and the expected times of their repetition [s].
        ring: number of records that the device can repeat.
        recovered: number of records received on request.
        settings: settings that govern the records; None until the device has reported them.
        hello: last hello message, or None.
        status: last status message, or None.
        bad_lines: number of lines refused.

    >>> session = Session()
    >>> _ = session.feed(b"T,3,17,90,1025,205,512,131,-42,1*0000\n", now=0.0)
    >>> session.bad_lines
    1
    """

    def __init__(self, first_id: int = 0) -> None:
        self.settings: DeviceSettings | None = None
        self.hello: Hello | None = None
        self.status: DeviceStatus | None = None
        self.newest: Sample | None = None
        self.gaps: dict[int, float] = {}
        self.ring, self._pace, self._round_trip = 64, 0.0085, SPACING  # until the hello
        self._last_request = -math.inf
        self.bad_lines = self.recovered = 0
        self._splitter = Splitter()
        self._lines: list[bytes] = []  # verified lines, verbatim, each record once
        self._events: list[Event] = []
        self._line_bytes = 50  # of the last record, including the line feed
        self._begun, self._next, self._ticks = False, 0, 5
        self._doubtful: dict[int, set[bytes]] = {}
        self._candidate: tuple[Sample, bytes] | None = None
        self._suspicious_until = self._beat_at = self._status_at = self._alive_until = -math.inf
        self._heard_at: float | None = None
        self._silence_reported = False
        self._settings_due: int | None = None
        self._command: Command | None = None  # in progress
        self._id, self._retry_at = first_id % _LAST_ID, -math.inf
        self._quarter = (-1, -1)
        self._earliest = (math.inf, 0, 0.0)

    def feed(self, data: bytes, now: float) -> list[Event]:
        """Return the events in `data`, received by host time `now` [s]; call this even without data."""
        for line in self._splitter.feed(data) if data else ():
            message = parse(line)
            if message is None:
                self.bad_lines += 1
                self._suspicious_until = now + SUSPICION
                continue
            self._heard_at = now
            if type(message) is Sample:
                self._take(message, line, now)
                if self.newest is message:
                    self._time(message, now)
            else:
                self._lines += (line, b"\n")
                self._events.append(message)
                self._on_message(message)
        oldest = self._next - self.ring
        if self.newest is not None and self.gaps and next(iter(self.gaps)) < oldest:
            turns = self.gaps.items()
            gone = [seq for seq, turn in turns if seq < oldest and now >= self._overdue(turn)]
            self._lose(self.newest.boot, gone)
        self._heard_at = now if self._heard_at is None else self._heard_at
        silence = now - self._heard_at
        if silence >= SILENCE and not self._silence_reported:
            self._events.append(Silent(round(silence, 3)))
        self._silence_reported = silence >= SILENCE
        events, self._events = self._events, []
        return events

    def take_lines(self) -> bytes:
        """Return the lines verified since the last call, verbatim, each once, for the journal."""
        data = b"".join(self._lines)
        self._lines.clear()
        return data

    def give_up(self) -> None:
        """Report all missing records as lost in the next `feed`."""
        if self.newest is not None:
            self._lose(self.newest.boot, sorted(self.gaps))

    @property
    def settings_known(self) -> bool:
        """True if the device has reported its settings since the last command that changed them."""
        return self.settings is not None and self._settings_due is None

    def idle(self, now: float) -> bool:
        """Return True if `feed` and `poll` have nothing to do at time `now` [s] until a line arrives."""
        quiet = self._heard_at is not None and now - self._heard_at < SILENCE
        waits = self._settings_due is not None or self._command or self.gaps
        return quiet and not waits and now < self._beat_at + HEARTBEAT

    def command(self, verb: str, *values: float | str) -> Command:
        """Begin a command, which `poll` sends; a command in progress is abandoned.

        Raises:
            RigError: a number is not finite.
        """
        if not all(isinstance(value, str) or math.isfinite(value) for value in values):
            raise RigError(f"{verb} requires finite numbers, got {values}")
        self._abandon("another command was sent before this one was answered")
        self._id = self._id % _LAST_ID + 1  # 0 is for lines without an answer
        line = frame(command_body(self._id, verb, *values))
        self._command, self._retry_at = Command(self._id, verb, line), -math.inf
        return self._command

    def keep_alive(self, now: float) -> None:
        """Extend the heartbeat deadline to `ALIVE` seconds from now."""
        self._alive_until = now + ALIVE

    def rest(self) -> None:
        """Stop the heartbeats, so that the device vents within its silence limit."""
        self._alive_until = -math.inf

    def poll(self, now: float) -> bytes:
        """Return the bytes to send at host time `now` [s]: heartbeat, command, request for records.

        The device treats any line as a sign of life. While the device drives its output, the session
        therefore sends nothing of its own accord after the last heartbeat.
        """
        out = b""
        if self._beat_at + HEARTBEAT <= now < self._alive_until:
            self._beat_at = now
            out = frame("0 hb")
        newest = self.newest
        may_ask = now < self._alive_until or newest is None or newest.state not in DRIVEN
        due = self._settings_due is not None and now >= self._status_at + RETRY
        if due and may_ask and self._command is None:
            self._status_at = now
            self.command("status")
        out += self._send(now)
        if self.gaps and may_ask:
            out += self._request(now)
        return out

    def _request(self, now: float) -> bytes:
        """Return the line that requests up to 64 missing records, or nothing.

        A request is a bit mask that replaces the previous request. The device repeats the records in
        ascending order at its own pace. Each request therefore omits records that should already be on
        their way. Records that will soon be overwritten are always requested, because a request can also be
        damaged. If 1 % of the bytes are damaged, no simpler scheme is sufficient.
        """
        if now - self._last_request < SPACING - 1e-9:
            return b""
        oldest = self._next - self.ring
        urgent = oldest + 2 * self.ring // 3
        wanted = sorted(
            seq
            for seq, turn in self.gaps.items()
            if seq >= oldest and (seq < urgent or now < turn or now >= self._overdue(turn))
        )
        if not wanted:
            return b""
        base, mask, turn = wanted[0], 0, now
        for seq in wanted:
            if seq - base >= MASK_BITS:
                break
            mask |= 1 << (seq - base)
            self.gaps[seq] = turn
            turn += self._pace
        self._last_request = now
        return frame(command_body(0, "rp", base, f"{mask:x}"))

    def _overdue(self, turn: float) -> float:
        """Return the time after which a repetition expected at `turn` counts as damaged."""
        return turn + 1.25 * self._round_trip + _SLACK

    def _send(self, now: float) -> bytes:
        command = self._command
        if command is None or now < self._retry_at:
            return b""
        if command.sent_at is None:
            command.sent_at = now
        if now - command.sent_at >= GIVE_UP:
            self._abandon(f"the device did not answer for {GIVE_UP:g} s")
            return b""
        self._retry_at = now + RETRY
        return command.line

    def _abandon(self, why: str) -> None:
        if self._command is not None:
            self._command.failure, self._command = why, None

    def _on_message(self, message: Message) -> None:
        if isinstance(message, Ack):
            self._on_answer(message)
        elif isinstance(message, DeviceStatus):
            self.status = message
        elif isinstance(message, DeviceSettings):
            self.settings = message
            self._set_pace(message.ticks_per_record)
            if self._settings_due is not None and message.since >= self._settings_due:
                self._settings_due = None
        elif isinstance(message, Hello):
            self.hello, self.ring = message, message.ring
            self._set_pace(message.ticks_per_record)

    def _on_answer(self, answer: Ack) -> None:
        command = self._command
        if command is None or command.id != answer.id or command.sent_at is None:
            return  # the answer to an earlier command
        command.answer, self._command = answer, None
        if answer.seq is not None and command.verb in _CHANGES_SETTINGS:
            self._settings_due = answer.seq

    def _set_pace(self, ticks_per_record: int) -> None:
        """Compute how fast the device repeats records in the line capacity that new records leave free."""
        if self.hello is not None:
            left = max(self.hello.bytes_per_tick - self._line_bytes / ticks_per_record, 1.0)
            self._pace = max(1.0, self._line_bytes / left) / self.hello.tick_hz

    def _restart(self, new_boot: int) -> None:
        """Handle a restart of the device: missing records and commands of the old boot are lost."""
        if self.newest is None:
            return
        old, self.newest, hello = self.newest.boot, None, self.hello
        self._lose(old, sorted(self.gaps))
        self._doubtful.clear()
        self._next = 0
        cause = hello.cause if hello is not None and hello.boot & 15 == new_boot else None
        self._events.append(Reset(old, new_boot, cause))
        self.settings = self._settings_due = None
        self._abandon("the device was reset")

    def _time(self, sample: Sample, now: float) -> None:
        """Report the earliest arrival in each quarter second, relative to the device's clock.

        The arrival time is that of the first byte, because the length of a line matters on a slow port.
        """
        quarter = (sample.boot, sample.tick // (TICK_HZ // 4))
        if self.hello is not None:
            now -= self._line_bytes / (self.hello.bytes_per_tick * self.hello.tick_hz)
        arrival = (now - sample.tick / TICK_HZ, sample.tick, now)
        if quarter == self._quarter:
            self._earliest = min(self._earliest, arrival)
            return
        if self._quarter[0] >= 0:
            _, tick, at = self._earliest
            self._events.append(Timing(self._quarter[0], tick, round(at, 6)))
        self._quarter, self._earliest = quarter, arrival

    def _take(self, sample: Sample, line: bytes, now: float) -> None:
        """Process a record with a correct CRC, received at host time `now` [s]."""
        newest = self.newest
        if newest is None or sample.boot != newest.boot:
            self._take_stray(sample, line, now)
            return
        late = sample.seq < self._next
        if late and sample.seq not in self.gaps:
            return  # received before
        ahead = sample.seq - newest.seq
        on_grid = (sample.tick - newest.tick - self._ticks * ahead) % TICKS == 0
        odd = not on_grid or (now < self._suspicious_until and _has_jumped(sample, newest))
        near = on_grid or ahead <= self.ring
        if not odd or self._is_confirmed(sample, line, now, late=late, near=near):
            self._accept(sample, line, now)

    def _is_confirmed(
        self, sample: Sample, line: bytes, now: float, *, late: bool, near: bool
    ) -> bool:
        """Return True if a doubtful record is confirmed; otherwise request it again."""
        copies = self._doubtful.setdefault(sample.seq, set())
        if line in copies:
            return True
        if not late:
            before, self._candidate = self._candidate, (sample, line)
            if before is not None and _follows(sample, before[0]):
                other = before[0].seq
                if other >= self._next or other in self.gaps:
                    self._candidate = None
                    self._accept(*before, now)
                    return True
        copies.add(line)
        if near and not late:  # otherwise the number of the record is doubtful
            self._open_gap(sample, sample.seq + 1)
        return False

    def _take_stray(self, sample: Sample, line: bytes, now: float) -> None:
        """Process a record from an unknown boot; a new boot is accepted after two consistent records."""
        before, self._candidate = self._candidate, (sample, line)
        if before is None or not _follows(sample, before[0]):
            return
        first, first_line = before
        self._candidate = None
        anew, self._begun = self._begun, True
        self._restart(sample.boot)
        self._next = 0 if anew else first.seq
        self._ticks = (sample.tick - first.tick) % TICKS // (sample.seq - first.seq)
        self._accept(first, first_line, now)
        self.newest = first
        self._accept(sample, line, now)

    def _accept(self, sample: Sample, line: bytes, now: float) -> None:
        seq, newest = sample.seq, self.newest
        if newest is not None and seq > newest.seq:
            if seq == newest.seq + 1:
                self._ticks = (sample.tick - newest.tick) % TICKS
            self.newest, self._line_bytes = sample, len(line) + 1
        if seq in self.gaps:
            self.recovered += 1
            taken = now - self.gaps.pop(seq)  # time of the repetition relative to its turn
            if 0 <= taken < 0.25:
                self._round_trip += (taken - self._round_trip) / 16
        else:
            if seq > self._next:
                self._open_gap(sample, seq)
            self._next = seq + 1
        if self._doubtful:
            self._doubtful.pop(seq, None)
        self._lines += (line, b"\n")
        self._events.append(sample)

    def _open_gap(self, sample: Sample, end: int) -> None:
        """Request the records next <= seq < end; those already overwritten at `sample` are lost."""
        first = max(self._next, sample.seq + 1 - self.ring)
        if first > self._next:
            self._events.append(Lost(sample.boot, self._next, first - self._next))
        for seq in range(first, end):
            self.gaps.setdefault(seq, -math.inf)
        self._next = end

    def _lose(self, boot: int, seqs: list[int]) -> None:
        """Report lost records, one event for each run of consecutive records."""
        start = 0
        for i, seq in enumerate(seqs):
            del self.gaps[seq]
            self._doubtful.pop(seq, None)
            if i + 1 == len(seqs) or seqs[i + 1] != seq + 1:
                self._events.append(Lost(boot, seqs[start], i + 1 - start))
                start = i + 1


def _has_jumped(sample: Sample, other: Sample) -> bool:
    """Return True if the state differs, or a value differs too much for the distance between records."""
    times = 1 + abs(sample.seq - other.seq) // 4
    pairs = zip(sample[3:8], other[3:8], _JUMP, strict=True)
    return sample.flags != other.flags or any(abs(a - b) > times * most for a, b, most in pairs)


def _follows(sample: Sample, before: Sample) -> bool:
    """Return True if a record can follow shortly after another, at any record rate."""
    records, ticks = sample.seq - before.seq, (sample.tick - before.tick) % TICKS
    return (
        sample.boot == before.boot
        and 0 < records <= _NEAR
        and ticks % records == 0
        and 0 < ticks // records <= _MOST_TICKS
        and not _has_jumped(sample, before)
    )


class AbstractLink(contextlib.AbstractContextManager):
    """A session and its recording; subclasses add the transport and the clock.

    All waiting is done by `sleep`, so that a plan can run in real or virtual time. All methods except
    `close` may be called from any thread.

    Args:
        first_id: number of the first command, see `Session`.

    Attributes:
        session: session with the device.
        alarms: losses, resets and silences that have not been handled.
        watch: function called with every record, or None.
    """

    def __init__(self, first_id: int) -> None:
        self.session = Session(first_id=first_id)
        self.alarms: deque[Lost | Reset | Silent] = deque(maxlen=10_000)
        self.watch: Callable[[Sample], None] | None = None
        self._journal: Journal | None = None
        self._lock = threading.Lock()

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    @abc.abstractmethod
    def now(self) -> float:
        """The link's time [s]."""

    @property
    def running(self) -> bool:
        """True while bytes are exchanged."""
        return True

    @abc.abstractmethod
    def sleep(self, seconds: float) -> None:
        """Wait for the given time [s] while exchanging bytes."""

    def close(self) -> None:
        """Close the connection; the heartbeats stop."""
        self.rest()

    @property
    def newest(self) -> Sample | None:
        """Last record in order, or None."""
        return self.session.newest

    def attach(self, journal: Journal | None) -> None:
        """Record to a journal from now on; use None to detach the journal before closing it."""
        with self._lock:
            self._journal = journal

    def check(self) -> None:
        """Raise if the link or the recording has failed.

        Raises:
            RigFault: the link has closed, or the recording has failed, see `Journal.check`.
        """
        if not self.running:
            raise RigFault("the link has closed; the device vents by itself")
        if self._journal is not None:
            self._journal.check()

    def keep_alive(self) -> None:
        """Extend the heartbeat deadline to 5 s from now; only code that supervises a test may call this."""
        with self._lock:
            self.session.keep_alive(self.now)

    def rest(self) -> None:
        """Stop the heartbeats."""
        with self._lock:
            self.session.rest()

    def command(self, verb: str, *values: float | str) -> Ack:
        """Send a command and wait for the device's answer.

        Raises:
            RigError: the device refuses the command, or a number is not finite.
            RigFault: there was no answer, or the device was reset in the meantime.
        """
        with self._lock:
            command = self.session.command(verb, *values)
        while not command.done:
            if not self.running:
                raise RigFault(f"{verb!r} was not sent: the link has closed")
            self.sleep(SLICE)
        said = " ".join([verb, *map(str, values)])
        if command.answer is None:
            raise RigFault(
                f"{said!r} failed: {command.failure}; check the cable and the power supply"
            )
        if command.answer.seq is None:
            raise RigError(f"the device refused {said!r}: {command.answer.reason}")
        return command.answer

    def settle(self, seconds: float) -> None:
        """Wait up to this time [s] for missing records, then report those still missing as lost."""
        until = self.now + seconds
        while self.running and self.session.gaps and self.now < until:
            self.sleep(SLICE)
        with self._lock:
            self.session.give_up()
            self._take(self.session.feed(b"", self.now))

    def _pump(self, data: bytes) -> bytes:
        """Process received bytes, and return the bytes to send."""
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


def serial_opener(path: str, baud: int = 115200) -> Callable[[], Any]:
    """Return a function that opens a serial port for exclusive use.

    Opening the port resets most Arduino boards, so the link sees a reset, not a reconnection.

    Args:
        path: device such as /dev/serial/by-id/..., COM3, or a URL such as socket://host:port.
        baud: bits per second for which the firmware was built.
    """

    def open_port() -> Any:
        import serial  # noqa: PLC0415 -- importing rig loads no serial library

        options: dict[str, Any] = {"timeout": SLICE, "write_timeout": 0.5}
        if "://" not in path:
            options["exclusive"] = True
        return serial.serial_for_url(path, baud, **options)

    return open_port


class Link(AbstractLink):
    """A link over a real port, in real time; one thread owns the port.

    If the port disappears, it is reopened as soon as it is available again. Until then, records and
    heartbeats are missing, and a running device vents within its silence limit.

    Args:
        opener: function that opens the port, such as the one returned by `serial_opener`. The port must
            have `in_waiting`, `read`, `write` and `close` as in pyserial, and raise `OSError`.

    Attributes:
        port: open port, or None.

    Raises:
        RigError: the port cannot be opened.
    """

    def __init__(self, opener: Callable[[], Any]) -> None:
        super().__init__(first_id=(time.time_ns() // 1_000_000) ^ os.getpid())
        self._opener = opener
        try:
            self.port: Any = opener()
        except OSError as error:
            raise RigError(
                f"cannot open the port: {error}; check that the board is plugged in and that no other "
                "program is using the port"
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
        """True while the thread is running."""
        return self._thread.is_alive()

    def sleep(self, seconds: float) -> None:
        """Wait for a time [s] while the thread runs."""
        time.sleep(max(seconds, 0.0))

    def close(self) -> None:
        """Stop the thread and close the port."""
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
            data += self.port.read(waiting)  # a socket reports at most one waiting byte
        return data

    def _drop(self) -> None:
        port, self.port = self.port, None
        with contextlib.suppress(OSError):  # closed already
            if port is not None:
                port.close()


class VirtualLink(AbstractLink):
    """A link to a simulated rig without a thread; time passes only in `sleep`.

    Args:
        rig: device's side of the cable, with `now` [s], `write(bytes)`, `read()` and `advance(seconds)` as
            in `SimulatedRig`.
        first_id: number of the first command.
    """

    def __init__(self, rig: Any, first_id: int = 0) -> None:
        super().__init__(first_id)
        self.rig = rig
        self._part = b""  # incomplete line

    @property
    def now(self) -> float:
        """Virtual time [s]."""
        return self.rig.now

    def sleep(self, seconds: float) -> None:
        """Advance the rig in slices of `SLICE`, exchanging bytes if needed."""
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


def mean_counts(
    link: AbstractLink, seconds: float, wait: Callable[[float], None] | None = None
) -> tuple[float, float]:
    """Return the pressure and force counts (sums of five readings), averaged over a time [s].

    Args:
        link: link to the device, after its hello; the device may be in any state, and nothing is sent.
        seconds: averaging time.
        wait: function that waits for a time [s] and supervises the run; omit it if no run is active.

    Raises:
        RigFault: no record arrived.
    """
    found: list[Sample] = []
    wait = wait or link.sleep
    wait(0.1)  # for a record that has already begun
    link.watch = found.append
    try:
        wait(seconds)
    finally:
        link.watch = None
    if not found or link.session.settings is None:
        raise RigFault(f"no record arrived within {seconds:g} s: check the cable")
    scale = READINGS / link.session.settings.ticks_per_record / len(found)
    pressure, force = sum(s.pressure_sum for s in found), sum(s.force_sum for s in found)
    return scale * pressure, scale * force

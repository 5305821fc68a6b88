"""The host's side of the protocol: bytes and times in, bytes and events out; no clock, no thread."""

import math

from ..protocol.control_law import TICK_HZ
from ..protocol.lines import Splitter, frame, parse
from ..protocol.messages import (
    DRIVEN,
    Ack,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Message,
    Sample,
)
from .command_queue import RETRY, Command, CommandQueue
from .events import Event, Reset, Silent, Timing
from .record_order import RecordOrder

HEARTBEAT = 0.2
"""Time [s] between heartbeats."""
ALIVE = 5.0
"""Time [s] for which heartbeats continue after a kick: if a plan hangs for longer, the rig vents."""
SILENCE = 1.0
"""Time [s] without a verified line that counts as silence."""
SUSPICION = 10.0
"""Time [s] after a damaged line during which odd records must come twice."""
_QUARTER = TICK_HZ // 4
_CHANGES_SETTINGS = frozenset(
    {
        "set", "gain", "ilim", "cal", "tele", "trip", "jump", "stall", "hbms", "floor", "ceiling",
        "still", "frozen",
    }
)  # fmt: skip


class Session:
    r"""One session with a device.

    Args:
        ring: records that the device can repeat, until its hello reports the number.
        first_id: number of the first command, see `CommandQueue`.

    Attributes:
        order: the records; `order.newest` is the last one.
        settings: what governs them, None until the device has reported it.
        hello: the last hello, None before the first.
        status: the last status, None before the first.
        bad_lines: lines refused so far.

    >>> session = Session()
    >>> _ = session.feed(b"T,3,17,90,1025,205,512,131,-42,1*0000\n", now=0.0)
    >>> session.bad_lines
    1
    """

    def __init__(self, ring: int = 64, first_id: int = 0) -> None:
        self.settings: DeviceSettings | None = None
        self.hello: Hello | None = None
        self.status: DeviceStatus | None = None
        self.bad_lines = 0
        self.order = RecordOrder(ring, self._on_restart)
        self.commands = CommandQueue(first_id)
        self._splitter = Splitter()
        self._boot: int | None = None
        self._doubted_boot: int | None = None
        self._suspicious_until = self._beat_at = self._status_at = self._alive_until = -math.inf
        self._heard_at: float | None = None
        self._silence_reported = False
        self._settings_due: int | None = None
        self._inquiry: Command | None = None
        self._quarter = (-1, -1)
        self._earliest = (math.inf, 0, 0.0)

    def feed(self, data: bytes, now: float) -> list[Event]:
        """The events in `data`, received by host time `now` [s]; to be called without data, too."""
        order = self.order
        for line in self._splitter.feed(data) if data else ():
            message = parse(line)
            if message is None:
                self.bad_lines += 1
                self._suspicious_until = now + SUSPICION
                continue
            self._heard_at = now
            if type(message) is Sample:
                order.take(message, line, now, suspicious=now < self._suspicious_until)
                if order.newest is message:
                    self._time(message, now)
            else:
                order.lines += (line, b"\n")
                order.events.append(message)
                self._on_message(message)
        if order.gaps:
            order.expire(now)
        self._watch_silence(now)
        events, order.events = order.events, []
        return events

    def take_lines(self) -> bytes:
        """The verified lines since the last call, verbatim, each once, for the journal."""
        data = b"".join(self.order.lines)
        self.order.lines.clear()
        return data

    @property
    def settings_known(self) -> bool:
        """Whether the device has reported its settings since the last command that changed them."""
        return self.settings is not None and self._settings_due is None

    def idle(self, now: float) -> bool:
        """Whether `feed` and `poll` have nothing to do at host time `now` [s] until a line comes."""
        return not (
            self._beat_at + HEARTBEAT <= now
            or self._heard_at is None
            or now - self._heard_at >= SILENCE
            or self._settings_due is not None
            or self.commands
            or self.order.gaps
        )

    def command(self, verb: str, *values: float | str) -> Command:
        """Queue a command, which `poll` sends."""
        self.commands.withdraw(self._inquiry)
        return self.commands.put(verb, values)

    def kick(self, now: float) -> None:
        """Extend the heartbeats by `ALIVE` seconds."""
        self._alive_until = now + ALIVE

    def rest(self) -> None:
        """Stop the heartbeats at once: the device vents within its limit of silence."""
        self._alive_until = -math.inf

    def poll(self, now: float) -> bytes:
        """The bytes to send at host time `now` [s]: heartbeat, command, request for records.

        Every line keeps the device alive. So what the session sends by itself to a device that
        drives its output ends with the heartbeats.
        """
        out = b""
        if self._beat_at + HEARTBEAT <= now < self._alive_until:
            self._beat_at = now
            out = frame("0 hb")
        newest = self.order.newest
        may_ask = now < self._alive_until or newest is None or newest.state not in DRIVEN
        due = self._settings_due is not None and now >= self._status_at + RETRY
        if due and may_ask and not self.commands:
            self._status_at = now
            self._inquiry = self.commands.put("status", ())
        if self.commands:
            out += self.commands.send(now)
        if self.order.gaps and may_ask:
            out += self.order.gaps.request(now)
        return out

    def _on_message(self, message: Message) -> None:
        match message:
            case Ack():
                command = self.commands.answered(message)
                if command and message.seq is not None and command.verb in _CHANGES_SETTINGS:
                    self._settings_due = message.seq
            case DeviceSettings():
                self.settings = message
                self._set_pace(message.ticks_per_record)
                if self._settings_due is not None and message.since >= self._settings_due:
                    self._settings_due = None
            case DeviceStatus():
                self.status = message
                self._on_boot(message.boot)
            case Hello():
                self.hello = message
                self.order.gaps.ring = message.ring
                self._set_pace(message.ticks_per_record)
                self._on_boot(message.boot)

    def _set_pace(self, ticks_per_record: int) -> None:
        if self.hello is not None:
            tick = 1 / self.hello.tick_hz
            length = self.order.line_bytes
            self.order.gaps.set_pace(length, self.hello.bytes_per_tick, ticks_per_record, tick)

    def _on_boot(self, boot: int) -> None:
        """Sixteen resets during one silence look like none in the records, but not here."""
        newest = self.order.newest
        if newest is None or boot & 15 != newest.boot:
            return
        if self._boot is not None and boot != self._boot and boot == self._doubted_boot:
            self.order.restart(newest.boot)
        if self._boot is None:
            self._boot = boot
        self._doubted_boot = boot

    def _on_restart(self) -> None:
        reset, hello = self.order.events[-1], self.hello
        fresh = hello is not None and hello.boot != self._boot  # not that of sixteen boots ago
        if isinstance(reset, Reset) and hello and fresh and hello.boot & 15 == reset.new:
            self.order.events[-1] = reset._replace(cause=hello.cause)
        self._boot = self._doubted_boot = self.settings = self._settings_due = None
        self.commands.fail("the device was reset")

    def _time(self, sample: Sample, now: float) -> None:
        """Of each quarter second, report the arrival that is earliest against the device's clock.

        The arrival is that of the line's first byte: lines grow, and on a slow port by milliseconds.
        """
        quarter = (sample.boot, sample.tick // _QUARTER)
        if self.hello is not None:
            now -= self.order.line_bytes / (self.hello.bytes_per_tick * self.hello.tick_hz)
        late = now - sample.tick / TICK_HZ
        if quarter == self._quarter:
            if late < self._earliest[0]:
                self._earliest = (late, sample.tick, now)
            return
        if self._quarter[0] >= 0:
            _, tick, arrival = self._earliest
            self.order.events.append(Timing(self._quarter[0], tick, round(arrival, 6)))
        self._quarter, self._earliest = quarter, (late, sample.tick, now)

    def _watch_silence(self, now: float) -> None:
        if self._heard_at is None:
            self._heard_at = now
        if now - self._heard_at < SILENCE:
            self._silence_reported = False
        elif not self._silence_reported:
            self._silence_reported = True
            self.order.events.append(Silent(round(now - self._heard_at, 3)))

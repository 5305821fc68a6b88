"""Python port of the firmware: a device without hardware that sends the same bytes as the C core."""

import re
import struct
from collections import deque
from importlib import resources
from pathlib import Path

from .controller import COUNTER, NUMBER, OK, REASONS, VERB, WATCHDOG, DeviceControl, Latch
from .protocol import DRIVEN, PROTOCOL, TICK_HZ, Sample, crc16, frame

FIRMWARE = 3  # version of the ported firmware

# Causes of a reset, as in the ATmega328P's MCUSR.
POWER_ON, RESET_PIN, BROWN_OUT, WATCHDOG_RESET = 1, 2, 4, 8

# Bytes sent in a tick and records in the ring for each baud rate, as in the firmware's Makefile.
BAUD_RATES = {115200: (21, 64), 500000: (91, 32)}

# Highest pressure limit [counts] that the firmware accepts by default: 4.4 V.
TRIP_CEILING = 900

RECEIVE_LIMIT = 127  # capacity for received bytes that have not been read

_LIMIT = 200  # capacity for bytes to send
_SAMPLE = 68  # bytes reserved for a record; other lines must leave this much free
_ANSWER, _REPEAT, _REPORT, _SETTINGS = _SAMPLE + 50, 2 * _SAMPLE, _SAMPLE + 100, _SAMPLE + 120
_FUTURE = 1 << 31  # an apparent age from here on belongs to a future record
_MEMORY = struct.Struct("<HBBHH")

LINE_LIMIT = 63  # bytes of the longest line accepted, without its end

_PRINTABLE = bytes(range(ord(" "), ord("~") + 1))
_HEX = b"0123456789ABCDEF"
_NUMBER = re.compile(rb"(-?)(\d{1,6})(?:\.(\d{0,4}))?").fullmatch
_REQUEST = re.compile(rb"(\d{1,10}) ([\dA-Fa-f]{1,16})").fullmatch

# For each verb, the numbers required and how each is stored: value * unit, rounded, within [low, high].
ARGUMENTS: dict[bytes, tuple[int, tuple[tuple[int, int, int], ...]]] = {
    **dict.fromkeys((b"hello", b"status", b"hb", b"rp", b"run", b"stop", b"clear"), (0, ())),
    b"strict": (1, ((1, 0, 1),)),
    b"board": (1, ((1, 1, 65534),)),
    b"set": (1, ((128, 0, 131071), (256, 0, 65280))),
    b"gain": (2, ((256, 0, 32767), (256, 0, 32767))),
    b"ilim": (2, ((1, -255, 0), (1, 0, 255))),
    b"cal": (2, ((16, 0, 16383), (64, 1, 65535))),
    b"man": (1, ((1, 0, 255),)),
    b"sync": (1, ((1, 1, 1000),)),
    b"tele": (1, ((1, 1, 50),)),
    b"trip": (1, ((1, 1, 1023),)),
    b"jump": (1, ((1, 1, 1023),)),
    b"stall": (1, ((1, 500, 30000),)),
    b"hbms": (1, ((1, 100, 10000),)),
    b"floor": (1, ((1, 0, 1022),)),
    b"ceiling": (1, ((1, 1, 1023),)),
    b"still": (1, ((1, 500, 60000),)),
    b"frozen": (2, ((1, 1, 255), (1, 100, 2000))),
}


def firmware_folder() -> Path:
    """Return the folder that contains the firmware sources and the prebuilt `famrig.hex`."""
    return Path(str(resources.files("rig"))) / "firmware"


class Device:
    r"""The device as seen by the host: it accepts bytes and counts, and returns bytes and an output.

    It has no clock and no thread: `tick` is one 2 ms tick of the controller. As on the hardware, each tick
    reads at most one line, answers it, and sends up to `bytes_per_tick` bytes.

    Args:
        eeprom: eight bytes that outlast this object: boot counter, latched trip (fault, output, counts)
            and board number. A shorter array stores only the first bytes. None for a blank memory.
        ring: number of records that can be repeated, 1 to 1024.
        bytes_per_tick: bytes sent in 2 ms: 21 at 115200 baud, 91 at 500000.
        trip_ceiling: highest pressure limit that the command `trip` accepts [counts], 1 to 1020.

    Attributes:
        output: PWM counts, 0 to 255; 0 is the safe output.
        boot: boot counter.

    >>> device = Device()
    >>> device.feed(b"trip 600\n")
    >>> for _ in range(3):
    ...     device.tick(102, 0)
    >>> b"A,0,OK,1" in device.take()
    True
    """

    def __init__(
        self,
        eeprom: bytearray | None = None,
        *,
        ring: int = 64,
        bytes_per_tick: int = 21,
        trip_ceiling: int = TRIP_CEILING,
    ) -> None:
        self._memory, self._out = Memory(eeprom), bytearray()
        self._size, self._budget, self._trip_ceiling = ring, bytes_per_tick, trip_ceiling
        self.reset(POWER_ON)

    def reset(self, cause: int) -> None:
        """Restart: output off, dump valve open, boot counter advanced; unsent bytes are lost."""
        self.boot = (self._memory.boot + 1) & 0xFFFF
        self._cause = cause
        fault = WATCHDOG if cause & WATCHDOG_RESET else 0
        least_div = -(-_SAMPLE // self._budget)
        latch, ceiling = self._memory.latch, self._trip_ceiling
        self._control = DeviceControl(self.boot, fault, least_div, ceiling, latch)
        self._latched = self._control.latch
        self._memory.store(self.boot, self._latched)
        self._ring: deque[Sample] = deque(maxlen=self._size)
        self._received, self._line = bytearray(), bytearray()
        self._sending = bytearray(b"\n")  # ends the line that the reset interrupted
        self._strict = False
        self._last = (0, 0, OK, 0)  # id, CRC, reason and record of the last command
        self._base = self._mask = 0
        self._range_sent = False
        self._bad = self._good = self._overrun = self._dropped = 0
        self._hello = True
        self._control.report_state = self._control.report_settings = True

    @property
    def output(self) -> int:
        """Output [PWM counts], 0 to 255."""
        return self._control.output

    @property
    def dump_open(self) -> bool:
        """True if the normally open dump valve is open: in every state except RUN and MAN."""
        return self._control.state not in DRIVEN

    @property
    def sync(self) -> bool:
        """True if the sync pin is high."""
        return self._control.sync

    @property
    def state(self) -> int:
        """`SAFE`, `RUN`, `MANUAL` or `TRIP`."""
        return self._control.state

    @property
    def board(self) -> int:
        """Board number, 0 if there is none."""
        return self._control.latch.board

    def feed(self, data: bytes) -> None:
        """Receive bytes; any beyond `RECEIVE_LIMIT` unread bytes are lost and counted."""
        room = RECEIVE_LIMIT - len(self._received)
        self._received += data[:room]
        self._overrun = (self._overrun + max(len(data) - room, 0)) & 0xFFFF

    def take(self) -> bytes:
        """Return the bytes sent since the last call."""
        sent, self._out = bytes(self._out), bytearray()
        return sent

    def tick(self, pressure_counts: int, force_counts: int) -> None:
        """Run one 2 ms tick with the converter's readings, 0 to 1023 each."""
        control, sending = self._control, self._sending
        record = control.step(pressure_counts, force_counts)
        if record is not None:
            self._ring.append(record)
            self._send_record(record)
        if control.latch is not self._latched:
            self._latched = control.latch
            self._memory.store(self.boot, control.latch)
        if control.tick % TICK_HZ == 0:
            control.report_state = control.report_settings = True
        answered = self._received and self._room() >= _ANSWER and self._read()
        if not answered:
            if self._hello or control.report_state or control.report_settings:
                self._report()
            elif self._mask and self._room() >= _REPEAT:
                self._repeat()
        if sending:
            self._out += sending[: self._budget]
            del sending[: self._budget]

    def _room(self) -> int:
        return _LIMIT - len(self._sending)

    def _send(self, kind: str, *fields: int | str) -> None:
        self._sending += frame(",".join([kind, *map(str, fields)]))

    def _send_record(self, record: Sample) -> None:
        if self._room() < _SAMPLE:
            self._dropped = (self._dropped + 1) & 0xFFFF
            return
        body = b"T,%d,%d,%d,%d,%d,%d,%d,%d,%d" % record
        self._sending += b"%b*%04X\n" % (body, crc16(body))

    def _report(self) -> None:
        """Send one of the lines that are due, if there is room."""
        c = self._control
        settings = not (self._hello or c.report_state)
        if self._room() < (_SETTINGS if settings else _REPORT):
            return
        if self._hello:
            self._hello = False
            built = self._size, self._budget, self._trip_ceiling, c.latch.board
            self._send(
                "H,famrig", PROTOCOL, FIRMWARE, self.boot, self._cause, TICK_HZ, c.div, *built
            )
        elif c.report_state:
            c.report_state = False
            now = self.boot, c.seq, c.tick, c.state, c.fault, c.count
            counters = self._bad, self._good, self._overrun, self._dropped, 0
            trip = c.tripped_at, c.latch.reading, c.latch.output
            self._send("S", *now, *counters, *trip, c.plausibility.alive)
        else:
            c.report_settings = False
            boot, since, law, *limits = c.settings
            self._send("P", boot, since, *law, *limits)

    def _repeat(self) -> None:
        """Send the next requested record; report once per request if some are no longer stored."""
        seq, kept = self._control.seq, len(self._ring)
        while self._mask:
            wanted, age = self._mask & 1, (seq - self._base) & COUNTER
            self._mask >>= 1
            self._base = (self._base + 1) & COUNTER
            if wanted and 1 <= age <= kept:
                self._send_record(self._ring[-age])
                return
            if wanted and kept < age < _FUTURE and not self._range_sent:
                self._range_sent = True
                self._send("L", (seq - kept) & COUNTER, seq)
                return

    def _read(self) -> bool:
        """Read up to the end of one line; return True if it was answered."""
        while self._received:
            ends = [at for at in map(self._received.find, (b"\r", b"\n")) if at >= 0]
            end = min(ends, default=len(self._received))
            self._line += self._received[:end][: LINE_LIMIT + 1 - len(self._line)]
            del self._received[: end + 1]
            if ends and self._line:
                line, self._line = bytes(self._line), bytearray()
                return self._handle(line)
        return False

    def _handle(self, line: bytes) -> bool:
        body = body_of(line, strict=self._strict)
        if body is None:
            self._bad = (self._bad + 1) & 0xFFFF
            return False
        id_, verb, words = split_command(body)
        if verb not in ARGUMENTS and body is line:  # noise without a CRC is ignored
            self._bad = (self._bad + 1) & 0xFFFF
        else:
            self._good = (self._good + 1) & 0xFFFF
            self._control.silence = 0
        if verb in (b"hb", b"rp"):
            if verb == b"rp" and (request := read_request(words)) is not None:
                self._base, self._mask = request
                self._range_sent = False
            return False
        check = crc16(body)
        if id_ == 0 or self._last[:2] != (id_, check) or verb == b"hello":
            reason = self._execute(verb, words)
            self._last = (id_, check, reason, self._control.in_force())
        _, _, reason, seq = self._last
        self._send("A", id_, *(("OK", seq) if reason == OK else ("ERR", REASONS[reason])))
        return True

    def _execute(self, verb: bytes, words: list[bytes]) -> int:
        if verb not in ARGUMENTS:
            return VERB
        values = read_numbers(verb, words)
        if values is None:
            return NUMBER
        match verb:
            case b"strict":
                self._strict = bool(values[0])
            case b"board":
                self._hello = True
                self._control.latch = self._control.latch._replace(board=values[0])
            case b"hello" | b"status":
                self._hello = self._hello or verb == b"hello"
                self._control.report_state = self._control.report_settings = True
            case _:
                return self._control.execute(verb, values)
        return OK


class Memory:
    """Memory that survives a reset: boot counter and latch."""

    def __init__(self, eeprom: bytearray | None) -> None:
        self._eeprom = bytearray() if eeprom is None else eeprom
        blank = b"\xff" * (_MEMORY.size - len(self._eeprom))
        self.boot, *latch = _MEMORY.unpack((self._eeprom + blank)[: _MEMORY.size])
        self.latch = Latch(*latch)

    def store(self, boot: int, latch: Latch) -> None:
        """Store the boot counter and the latch."""
        self.boot, self.latch = boot, latch
        self._eeprom[:] = _MEMORY.pack(boot, *latch)[: len(self._eeprom)]


def body_of(line: bytes, *, strict: bool) -> bytes | None:
    """Return the line without its CRC, or None if it must be refused."""
    if len(line) > LINE_LIMIT or line.translate(None, _PRINTABLE):
        return None
    if len(line) > 4 and line[-5:-4] == b"*":
        digits = line[-4:]
        if all(d in _HEX for d in digits) and int(digits, 16) == crc16(line[:-5]):
            return line[:-5]
        return None
    return None if strict or b"*" in line else line


def split_command(body: bytes) -> tuple[int, bytes, list[bytes]]:
    """Return id (0 if there is none), verb and words of a command."""
    words = [word for word in body.split(b" ") if word]
    first = words[0] if words else b""
    numbered = 1 <= len(first) <= 5 and first.isdigit() and int(first) <= 0xFFFF
    id_ = int(words.pop(0)) if numbered else 0
    return id_, words[0] if words else b"", words[1:]


def read_number(word: bytes, unit: int, low: int, high: int) -> int | None:
    """Return a number of at most six digits and four decimals as the device stores it; None if invalid."""
    match = _NUMBER(word)
    if match is None or (unit == 1 and b"." in word):
        return None
    sign, whole, fraction = match.groups(b"")
    tens = 10 ** len(fraction)
    part = (2 * int(fraction or b"0") * unit + tens) // (2 * tens)
    value = int(whole) * unit + part
    value = -value if sign else value
    return value if low <= value <= high else None


def read_numbers(verb: bytes, words: list[bytes]) -> list[int] | None:
    """Return the numbers in a command, or None if one is missing, superfluous or out of range."""
    least, numbers = ARGUMENTS[verb]
    if not least <= len(words) <= len(numbers):
        return None
    values = [read_number(word, *number) for word, number in zip(words, numbers, strict=False)]
    return None if None in values else values  # pyright: ignore[reportReturnType]


def read_request(words: list[bytes]) -> tuple[int, int] | None:
    """Return first record and mask of a repeat request, `rp base hexmask`; None if it is invalid."""
    match = _REQUEST(b" ".join(words))
    if match is None or int(match[1]) > 0xFFFFFFFF:
        return None
    return int(match[1]), int(match[2], 16)

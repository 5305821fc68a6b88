"""Serial protocol of the device: lines with a CRC, messages, and the control law in integers.

Each line from the device, and each line from the host after `strict 1`, ends with `*HHHH`, the CRC-16
of the text before the asterisk. `firmware/README.md` lists the lines and their fields.

The controller is PI with feed-forward: u = v + Kp e + I, dI/dt = Ki e, e = set point - measured
pressure. The C core, its Python port and the audit of a journal compute the same integers, so the output of
each record can be recomputed.
"""

import binascii
import re
from typing import Any, NamedTuple

PROTOCOL = 3  # version of the protocol, field `proto` of the hello line
TICK_HZ = 500  # ticks of the controller per second
TICKS = 1 << 32  # ticks are counted modulo this number, which is reached after 99 days

PRESSURE_UNIT = 128  # set point and error are in 1/128 psi
GAIN_UNIT = 256  # gains and feed-forward: 1/256 of PWM counts (per psi, per psi and second)
INTEGRAL_UNIT = PRESSURE_UNIT * GAIN_UNIT  # the integral is in 1/32768 PWM count, the unit of Kp e
ZERO_UNIT = 16  # the zero of the transducer is in 1/16 count of the converter
SPAN_UNIT = 64  # the span of the transducer, psi per 1024 counts, is in 1/64 psi
MAX_ERROR = 32767  # largest error in the proportional term [1/128 psi], 256 psi
_SPAN_SHIFT = 13  # 2^4 per count of zero and 2^16 of span, to 2^7 per psi

SAFE, RUN, MANUAL, TRIP = range(4)  # states of the device
STATES = ("SAFE", "RUN", "MAN", "TRIP")
DRIVEN = (RUN, MANUAL)  # states in which the output may be on and the dump valve is closed
# Reasons why the device left RUN or MAN by itself, or started with the output off.
FAULTS = ("none", "silence", "over-pressure", "jump", "stall", "watchdog", "range", "frozen",
          "no response")  # fmt: skip


class ControlLaw(NamedTuple):
    """Parameters of the controller, exactly as the device stores them.

    Attributes:
        set_point: 1/128 psi, 0 to 131071.
        feed_forward: v [1/256 PWM count], 0 to 65280.
        proportional: Kp [1/256 PWM count / psi], 0 to 32767.
        integral: Ki [1/256 PWM count / (psi s)], 0 to 32767.
        low: smallest value of the integral term [PWM counts], -255 to 0.
        high: largest value of the integral term [PWM counts], 0 to 255. The defaults are symmetric about
            the feed-forward and cover the whole range of the output at v = 128.
        zero: converter counts at 0 psi [1/16 count].
        span: psi per 1024 counts [1/64 psi]; the default is a 200 psi transducer of 0 to 5 V.

    >>> ControlLaw(set_point=40 * PRESSURE_UNIT).set_point_psi
    40.0
    """

    set_point: int = 0
    feed_forward: int = 0
    proportional: int = 0
    integral: int = 0
    low: int = -128
    high: int = 128
    zero: int = 0
    span: int = 200 * SPAN_UNIT

    @property
    def set_point_psi(self) -> float:
        """Set point [psi]."""
        return self.set_point / PRESSURE_UNIT


def pressure_error(law: ControlLaw, counts: int, ticks: int = 1) -> int:
    """Return set point minus measured pressure, summed over `ticks` ticks [1/128 psi], rounded once.

    E = n set - span (16 counts - n zero) / 2^13, where counts is the sum of n conversions.

    >>> law = ControlLaw(set_point=40 * PRESSURE_UNIT)
    >>> pressure_error(law, 200) / PRESSURE_UNIT  # 200 counts of 200 psi / 1024 are 39.06 psi
    0.9375
    """
    measured = law.span * (ZERO_UNIT * counts - ticks * law.zero)
    return ticks * law.set_point - ((measured + (1 << (_SPAN_SHIFT - 1))) >> _SPAN_SHIFT)


def next_integral(law: ControlLaw, integral: int, error: int) -> int:
    """Return the integral term after one record [1/32768 PWM count], limited to [low, high].

    The unlimited value is I + round(Ki E / 500), with halves rounded away from zero.

    Args:
        law: control law.
        integral: I before the record.
        error: E, the `pressure_error` of the sum over the ticks of the record.

    >>> law = ControlLaw(integral=2 * GAIN_UNIT)
    >>> next_integral(law, 0, 500 * PRESSURE_UNIT) / INTEGRAL_UNIT  # 1 psi for 1 s, Ki = 2
    2.0
    """
    size = (law.integral * abs(error) + TICK_HZ // 2) // TICK_HZ
    value = integral + (size if error >= 0 else -size)
    return min(max(value, law.low * INTEGRAL_UNIT), law.high * INTEGRAL_UNIT)


def drive(law: ControlLaw, integral: int, error: int) -> int:
    """Return the output u = v + Kp e + I [PWM counts], rounded and limited to 0..255.

    Args:
        law: control law.
        integral: I [1/32768 PWM count].
        error: e [1/128 psi] of one tick, limited to `MAX_ERROR`.

    >>> drive(ControlLaw(feed_forward=128 * GAIN_UNIT, proportional=4 * GAIN_UNIT), 0, 256)
    136
    """
    if not -MAX_ERROR <= error <= MAX_ERROR:
        error = MAX_ERROR if error > 0 else -MAX_ERROR
    sum_ = law.proportional * error + integral + law.feed_forward * PRESSURE_UNIT
    output = (sum_ + INTEGRAL_UNIT // 2) >> 15
    return 0 if output < 0 else output if output < 255 else 255


class Sample(NamedTuple):
    """One record: `T,boot,seq,tick,p,q,f,u,i,st`.

    Attributes:
        boot: boot counter modulo 16.
        seq: number of the record since boot.
        tick: last 2 ms tick of the record, counted since boot.
        pressure_sum: sum of the pressure counts over the ticks of the record.
        pressure_count: pressure count of the last tick.
        force_sum: sum of the force counts over the ticks of the record.
        output: u [PWM counts], computed from `pressure_count` and `integral`.
        integral: I [1/32768 PWM count].
        flags: state + 4 * sync + 16 * fault.
    """

    boot: int
    seq: int
    tick: int
    pressure_sum: int
    pressure_count: int
    force_sum: int
    output: int
    integral: int
    flags: int

    @property
    def state(self) -> int:
        """`SAFE`, `RUN`, `MANUAL` or `TRIP` at the last tick."""
        return self.flags & 3

    @property
    def sync(self) -> bool:
        """True if the sync pin is high."""
        return bool(self.flags & 4)

    @property
    def fault(self) -> int:
        """Index into `FAULTS`."""
        return self.flags >> 4


class DeviceStatus(NamedTuple):
    """Status line, `S,boot,seq,tick,state,fault,p,bad,good,overrun,dropped,late,at,counts,u,alive`.

    Counters wrap at 65536.

    Attributes:
        boot: boot counter.
        seq: number of the next record.
        tick: tick of this line.
        state: as in `Sample`.
        fault: as in `Sample`.
        pressure_count: last pressure count.
        bad: lines from the host that were refused: wrong CRC or length, or no CRC after `strict 1`.
        good: lines from the host that were accepted.
        overrun: bytes from the host that were lost for lack of space.
        dropped: lines from the device that were lost for lack of space.
        late: ticks that started late.
        tripped_at: tick of the last trip since boot, 0 if there was none.
        tripped_count: pressure count that caused the trip.
        tripped_output: output [PWM counts] before the trip.
        alive: whether the reading varied at rest: 0 not yet known, 1 quiet, 2 alive.
    """

    boot: int
    seq: int
    tick: int
    state: int
    fault: int
    pressure_count: int
    bad: int
    good: int
    overrun: int
    dropped: int
    late: int
    tripped_at: int
    tripped_count: int
    tripped_output: int
    alive: int


class DeviceSettings(NamedTuple):
    """Settings that govern the records from number `since` onwards.

    `P,boot,since,<law>,div,trip,jump,stall,silence,floor,ceiling,still,frozen,frozen_ticks`.

    Attributes:
        boot: boot counter.
        since: first record governed by these settings.
        law: control law.
        ticks_per_record: ticks per record, as set by `tele`.
        trip: over-pressure limit [counts]; 0 if it has not been set.
        jump: largest change allowed over 5 ticks [counts].
        stall: ticks without a pressure rise, at the upper limit of output or integral, after which the
            device trips.
        silence: ticks without an accepted line after which the device vents.
        floor: smallest plausible reading [counts].
        ceiling: largest plausible reading [counts].
        still: ticks after which the device trips if a reading that varied at rest stays within two counts.
        frozen: PWM counts by which the output may exceed the holding output.
        frozen_ticks: ticks after which the device trips if the output is at twice that excess and the
            reading does not change.
    """

    boot: int
    since: int
    law: ControlLaw
    ticks_per_record: int
    trip: int
    jump: int
    stall: int
    silence: int
    floor: int
    ceiling: int
    still: int
    frozen: int
    frozen_ticks: int


class Hello(NamedTuple):
    """Hello line, `H,famrig,proto,fw,boot,cause,tick_hz,div,ring,budget,limit,board`.

    Attributes:
        protocol: `PROTOCOL`.
        firmware: version of the firmware.
        boot: boot counter.
        cause: cause of the reset: 1 power, 2 reset pin, 4 brown-out, 8 watchdog, 0 unknown.
        tick_hz: ticks per second.
        ticks_per_record: ticks per record, as set by `tele`.
        ring: number of records that the device can repeat.
        bytes_per_tick: bytes that the device can send per tick.
        trip_ceiling: highest pressure limit accepted [counts].
        board: board number, stored on the board and in the calibration; 0 if there is none.
    """

    protocol: int
    firmware: int
    boot: int
    cause: int
    tick_hz: int
    ticks_per_record: int
    ring: int
    bytes_per_tick: int
    trip_ceiling: int
    board: int


class Ack(NamedTuple):
    """Reply to a command: `A,id,OK,seq` or `A,id,ERR,why`.

    Attributes:
        id: number of the command.
        seq: first record fully governed by the command; None if it was refused.
        reason: reason for the refusal; empty if the command was accepted.
    """

    id: int
    seq: int | None
    reason: str


class StoredRange(NamedTuple):
    """Range of the records that can be repeated, `L,oldest,next`: oldest <= seq < next."""

    oldest: int
    next: int


Message = Sample | DeviceStatus | DeviceSettings | Hello | Ack | StoredRange


def crc16(data: bytes) -> int:
    """Return the CRC-16 of `data`: polynomial 0x1021, initial value 0xFFFF, not reflected.

    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    return binascii.crc_hqx(data, 0xFFFF)


def frame(body: str) -> bytes:
    r"""Return a line made of `body` (ASCII without asterisks or line endings) and its CRC.

    >>> frame("0 hb")
    b'0 hb*E088\n'
    """
    data = body.encode()
    return b"%b*%04X\n" % (data, crc16(data))


def command_body(id_: int, verb: str, *values: float | str) -> str:
    """Return the body of a command; numbers have at most four decimals and no trailing zeros.

    The device reads no more than four decimals. It stores and reports gains in steps of 1/256.

    >>> command_body(7, "set", 40.0, 127.53125)
    '7 set 40 127.5312'
    """
    words = [
        value if isinstance(value, str) else f"{round(value, 4) + 0.0:.4f}".rstrip("0").rstrip(".")
        for value in values
    ]
    return " ".join([str(id_), verb, *words])


_SAMPLE = re.compile(
    rb"T,(\d{1,2}),(\d{1,10}),(\d{1,10}),(\d{1,5}),(\d{1,4}),(\d{1,5}),(\d{1,3}),(-?\d{1,8}),(\d{1,3})"
).fullmatch
_INTEGER = re.compile(rb"-?\d{1,10}").fullmatch
_LAW = len(ControlLaw._fields)


def parse(line: bytes) -> Message | None:
    """Return the message in a line from the device, or None if its CRC or form is wrong.

    Args:
        line: line without the line feed.

    >>> parse(frame("T,3,17,90,1025,205,512,131,-42,1")[:-1]).pressure_sum
    1025
    >>> parse(b"T,3,17,90,1025,205,512,131,-42,1*0000") is None
    True
    """
    body = line[:-5]
    if b"*%04X" % binascii.crc_hqx(body, 0xFFFF) != line[-5:]:
        return None
    if body[:2] == b"T,":
        match = _SAMPLE(body)
        return Sample._make(map(int, match.groups())) if match else None
    kind, *fields = body.split(b",")
    return _of_integers(kind, fields)


def _of_integers(kind: bytes, fields: list[bytes]) -> Message | None:
    """Parse a message of any kind other than a record."""
    made: Any = {b"S": DeviceStatus, b"P": DeviceSettings, b"H": Hello, b"L": StoredRange}.get(kind)
    if kind == b"A" and len(fields) == 3 and _INTEGER(fields[0]):
        id_, said, rest = fields
        if said == b"OK" and _INTEGER(rest):
            return Ack(int(id_), int(rest), "")
        return Ack(int(id_), None, rest.decode("latin-1")) if said == b"ERR" else None
    if made is None or (made is Hello and fields[:1] != [b"famrig"]):
        return None
    numbers = fields[1:] if made is Hello else fields
    needed = len(made._fields) + (_LAW - 1 if made is DeviceSettings else 0)
    if len(numbers) != needed or not all(map(_INTEGER, numbers)):
        return None
    values: list[Any] = [int(number) for number in numbers]
    if made is DeviceSettings:
        values[2 : 2 + _LAW] = [ControlLaw(*values[2 : 2 + _LAW])]
    return made(*values)


class Splitter:
    r"""Split a stream of bytes into lines; only the last `limit` bytes of an unfinished line are kept.

    >>> Splitter(limit=200).feed(b"one\ntwo\n\nthr")
    [b'one', b'two']
    """

    def __init__(self, limit: int = 200) -> None:
        self._limit = limit
        self._rest = b""

    def feed(self, data: bytes) -> list[bytes]:
        """Return the lines completed by `data`, without line endings and without empty lines."""
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[-self._limit :]
        return [line for line in lines if line]

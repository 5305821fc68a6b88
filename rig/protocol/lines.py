"""The lines that host and device exchange: text, a CRC, a line feed; no waiting and no clock.

Every line of the device, and every line of a host under `strict 1`, ends in `*HHHH`, the CRC-16 of
the text before the asterisk. `firmware/README.md` lists the lines and their fields.
"""

import binascii
import re
from collections.abc import Callable

from .control_law import ControlLaw
from .messages import (
    Ack,
    Comment,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Message,
    Sample,
    StoredRange,
)


def crc16(data: bytes) -> int:
    """CRC-16 of `data`: polynomial 0x1021, start 0xFFFF, not reflected.

    >>> hex(crc16(b"123456789"))
    '0x29b1'
    """
    return binascii.crc_hqx(data, 0xFFFF)


def frame(body: str) -> bytes:
    r"""The line that carries `body`, with its CRC.

    Raises:
        ValueError: `body` holds an asterisk, a line end or a character that is not ASCII.

    >>> frame("0 hb")
    b'0 hb*E088\n'
    """
    if not body.isascii() or any(c in body for c in "*\r\n"):
        raise ValueError(f"a line is ASCII without '*' and line ends, got {body!r}")
    data = body.encode()
    return b"%b*%04X\n" % (data, crc16(data))


def command_body(id_: int, verb: str, *values: float | str) -> str:
    """The body of a command, numbers with at most four decimals and no trailing zeros.

    The device reads no more decimals than that; it stores gains in 1/256 steps and reports them.

    >>> command_body(7, "set", 40.0, 127.53125)
    '7 set 40 127.5312'
    """
    words = [v if isinstance(v, str) else _number(v) for v in values]
    return " ".join([str(id_), verb, *words])


def _number(value: float) -> str:
    text = f"{value:.4f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


def parse(line: bytes) -> Message | None:
    """The message in a line of the device, or None where its CRC or its form is wrong.

    Args:
        line: without the line feed.

    >>> parse(frame("T,3,17,90,1025,205,512,131,-42,1")[:-1]).pressure_sum
    1025
    >>> parse(b"T,3,17,90,1025,205,512,131,-42,1*0000") is None
    True
    """
    body = _verified(line)
    if body is None:
        return None
    if body[:2] == b"T,":
        match = _SAMPLE(body)
        return Sample._make(map(int, match.groups())) if match else None
    reader = _READERS.get(body[:2])
    return reader(body[2:]) if reader else None


def record_fields(line: bytes) -> tuple[bytes, ...] | None:
    """The fields of a record's line as digits, or None where it is another line or damaged.

    >>> record_fields(frame("T,3,17,90,1025,205,512,131,-42,1")[:-1])[3]
    b'1025'
    """
    body = _verified(line)
    match = _SAMPLE(body) if body is not None else None
    return match.groups() if match else None


def _verified(line: bytes) -> bytes | None:
    """The text before the asterisk, where the CRC is right."""
    body = line[:-5]
    return body if b"*%04X" % binascii.crc_hqx(body, 0xFFFF) == line[-5:] else None


_SAMPLE = re.compile(
    rb"T,(\d{1,2}),(\d{1,10}),(\d{1,10}),(\d{1,5}),(\d{1,4}),(\d{1,5}),(\d{1,3}),(-?\d{1,8}),(\d{1,3})"
).fullmatch
_INTEGER = re.compile(rb"-?\d{1,10}").fullmatch


def _integers(fields: bytes, numbers: tuple[int, ...]) -> list[int] | None:
    """The integers of a line that has one of these numbers of fields."""
    parts = fields.split(b",")
    if len(parts) not in numbers or not all(map(_INTEGER, parts)):
        return None
    return [int(part) for part in parts]


def _lengths(kind: type[tuple], more: int = 0) -> tuple[int, ...]:
    """Fields of a line of this protocol and of protocol 1, which has none of those with a default."""
    names, added = kind._fields, kind._field_defaults  # pyright: ignore[reportAttributeAccessIssue]
    return len(names) + more, len(names) - len(added) + more


def _integers_of(kind: type[DeviceStatus | StoredRange]) -> Callable[[bytes], Message | None]:
    """What reads a line whose fields are those of the tuple."""
    lengths = _lengths(kind)

    def read(fields: bytes) -> Message | None:
        values = _integers(fields, lengths)
        return kind(*values) if values else None

    return read


_LAW = len(ControlLaw._fields)
_SETTINGS_LENGTHS, _HELLO_LENGTHS = _lengths(DeviceSettings, _LAW - 1), _lengths(Hello)


def _settings(fields: bytes) -> DeviceSettings | None:
    values = _integers(fields, _SETTINGS_LENGTHS)
    if values is None:
        return None
    boot, since, *rest = values
    return DeviceSettings(boot, since, ControlLaw(*rest[:_LAW]), *rest[_LAW:])


def _hello(fields: bytes) -> Hello | None:
    name, _, rest = fields.partition(b",")
    values = _integers(rest, _HELLO_LENGTHS)
    return Hello(*values) if name == b"famrig" and values else None


def _ack(fields: bytes) -> Ack | None:
    parts = fields.split(b",")
    if len(parts) != 3 or not _INTEGER(parts[0]):
        return None
    if parts[1] == b"OK" and _INTEGER(parts[2]):
        return Ack(int(parts[0]), int(parts[2]), "")
    return Ack(int(parts[0]), None, parts[2].decode("latin-1")) if parts[1] == b"ERR" else None


_READERS: dict[bytes, Callable[[bytes], Message | None]] = {
    b"S,": _integers_of(DeviceStatus),
    b"P,": _settings,
    b"H,": _hello,
    b"A,": _ack,
    b"L,": _integers_of(StoredRange),
    b"# ": lambda fields: Comment(fields.decode("latin-1")),
}


class Splitter:
    r"""Cuts a stream of bytes into lines; longer ones than `limit` bytes are discarded and counted.

    Attributes:
        discarded: bytes discarded so far.

    >>> Splitter(limit=200).feed(b"one\ntwo\r\nthr")
    [b'one', b'two']
    """

    def __init__(self, limit: int = 200) -> None:
        self.discarded = 0
        self._limit = limit
        self._rest = b""
        self._skipping = False

    def feed(self, data: bytes) -> list[bytes]:
        """The lines that `data` completes, without their ends and without empty ones."""
        *lines, rest = (self._rest + data).split(b"\n")
        if self._skipping and lines:
            self.discarded += len(lines.pop(0))
            self._skipping = False
        if len(rest) > self._limit or self._skipping:
            self.discarded += len(rest)
            self._skipping = True
            rest = b""
        self._rest = rest
        kept = []
        for line in lines:
            line = line.removesuffix(b"\r")  # noqa: PLW2901 -- the line without its end
            if len(line) > self._limit:
                self.discarded += len(line)
            elif line:
                kept.append(line)
        return kept

"""How the device reads a line of the host: check, words, numbers, all in integers."""

import re
from typing import NamedTuple

from ..protocol.lines import crc16

LINE_LIMIT = 63
"""Bytes of the longest line the device takes, its end aside."""

_DIGITS = b"0123456789"
_PRINTABLE = bytes(range(ord(" "), ord("~") + 1))
_HEX = b"0123456789ABCDEF"
_NUMBER = re.compile(rb"(-?)(\d{1,6})(?:\.(\d{0,4}))?").fullmatch
_REQUEST = re.compile(rb"(\d{1,10}) ([\dA-Fa-f]{1,16})").fullmatch


class Number(NamedTuple):
    """How an argument is stored: value * unit, rounded, within [low, high]."""

    unit: int
    low: int
    high: int


_GAIN = Number(256, 0, 32767)
_SWITCH = Number(1, 0, 1)

ARGUMENTS: dict[bytes, tuple[int, tuple[Number, ...]]] = {
    b"hello": (0, ()),
    b"status": (0, ()),
    b"hb": (0, ()),
    b"rp": (0, ()),
    b"strict": (1, (_SWITCH,)),
    b"human": (1, (_SWITCH,)),
    b"set": (1, (Number(128, 0, 131071), Number(256, 0, 65280))),
    b"gain": (2, (_GAIN, _GAIN)),
    b"ilim": (2, (Number(1, -255, 0), Number(1, 0, 255))),
    b"cal": (2, (Number(16, 0, 16383), Number(64, 1, 65535))),
    b"run": (0, ()),
    b"man": (1, (Number(1, 0, 255),)),
    b"stop": (0, ()),
    b"clear": (0, ()),
    b"sync": (1, (Number(1, 1, 1000),)),
    b"tele": (1, (Number(1, 1, 50),)),
    b"trip": (1, (Number(1, 1, 1023),)),
    b"jump": (1, (Number(1, 1, 1023),)),
    b"stall": (1, (Number(1, 500, 30000),)),
    b"hbms": (1, (Number(1, 100, 10000),)),
    b"floor": (1, (Number(1, 0, 1022),)),
    b"ceiling": (1, (Number(1, 1, 1023),)),
    b"still": (1, (Number(1, 500, 60000),)),
    b"frozen": (2, (Number(1, 1, 255), Number(1, 100, 2000))),
}
"""Verb: how many numbers it needs, and the numbers that it takes."""


def body_of(line: bytes, *, strict: bool) -> bytes | None:
    """The line without its CRC, or None where it must be refused."""
    if len(line) > LINE_LIMIT or line.translate(None, _PRINTABLE):
        return None
    if len(line) > 4 and line[-5:-4] == b"*":
        digits = line[-4:]
        if all(d in _HEX for d in digits) and int(digits, 16) == crc16(line[:-5]):
            return line[:-5]
        return None
    return None if strict or b"*" in line else line


def split_command(body: bytes) -> tuple[int, bytes, list[bytes]]:
    """Id (0 where there is none), verb and words of a command."""
    words = [word for word in body.split(b" ") if word]
    first = words[0] if words else b""
    numbered = 1 <= len(first) <= 5 and all(d in _DIGITS for d in first) and int(first) <= 0xFFFF
    id_ = int(words.pop(0)) if numbered else 0
    return id_, words[0] if words else b"", words[1:]


def read_number(word: bytes, number: Number) -> int | None:
    """A decimal number of at most six digits and four decimals, as the device stores it."""
    match = _NUMBER(word)
    if match is None or (number.unit == 1 and b"." in word):
        return None
    sign, whole, fraction = match.groups(b"")
    tens = 10 ** len(fraction)
    part = (2 * int(fraction or b"0") * number.unit + tens) // (2 * tens)
    value = int(whole) * number.unit + part
    value = -value if sign else value
    return value if number.low <= value <= number.high else None


def read_numbers(verb: bytes, words: list[bytes]) -> list[int] | None:
    """The numbers of a command, or None where one is missing, too many or out of range."""
    least, numbers = ARGUMENTS[verb]
    if not least <= len(words) <= len(numbers):
        return None
    values = [read_number(word, number) for word, number in zip(words, numbers, strict=False)]
    read = [value for value in values if value is not None]
    return read if len(read) == len(values) else None


def read_request(words: list[bytes]) -> tuple[int, int] | None:
    """First record and mask of a re-request, `rp base hexmask`."""
    match = _REQUEST(b" ".join(words))
    if match is None or int(match[1]) > 0xFFFFFFFF:
        return None
    return int(match[1]), int(match[2], 16)

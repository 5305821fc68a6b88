"""Lines: the CRC against its published check value and a bit-wise oracle; damage; broken streams."""

import random
import re

import pytest

from rig.device import ARGUMENTS, firmware_folder
from rig.protocol import (
    Ack,
    ControlLaw,
    DeviceSettings,
    DeviceStatus,
    Hello,
    Message,
    Sample,
    Splitter,
    StoredRange,
    command_body,
    crc16,
    frame,
    parse,
)

LINES: list[tuple[str, Message]] = [
    (
        "T,15,4294967295,500,1025,205,512,131,-42,97",
        Sample(15, 4294967295, 500, 1025, 205, 512, 131, -42, 97),
    ),
    (
        "S,65535,3,17,3,2,900,1,2,3,4,5,16,901,131,2",
        DeviceStatus(65535, 3, 17, 3, 2, 900, 1, 2, 3, 4, 5, 16, 901, 131, 2),
    ),
    (
        "P,7,20,5120,32768,1024,512,-128,128,1632,12800,5,700,77,1500,500,51,963,350,4,375",
        DeviceSettings(
            7,
            20,
            ControlLaw(5120, 32768, 1024, 512, -128, 128, 1632, 12800),
            5,
            700,
            77,
            1500,
            500,
            51,
            963,
            350,
            4,
            375,
        ),
    ),
    ("H,famrig,3,3,7,8,500,5,64,21,900,9", Hello(3, 3, 7, 8, 500, 5, 64, 21, 900, 9)),
    ("A,12,OK,345", Ack(12, 345, "")),
    ("A,12,ERR,no trip limit", Ack(12, None, "no trip limit")),
    ("L,10,74", StoredRange(10, 74)),
]


def _bitwise_crc(data: bytes) -> int:
    """The division, bit by bit, as the standard writes it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1
    return crc & 0xFFFF


def test_crc_is_the_published_one() -> None:
    assert crc16(b"123456789") == 0x29B1  # check value of CRC-16/CCITT-FALSE
    data = random.Random(1).randbytes(300)
    assert crc16(data) == _bitwise_crc(data)


@pytest.mark.parametrize(("body", "message"), LINES)
def test_lines_say_what_they_say(body: str, message: Message) -> None:
    line = frame(body)
    assert line.endswith(b"\n")
    assert parse(line[:-1]) == message
    assert type(parse(line[:-1])) is type(message)


@pytest.mark.parametrize(("body", "message"), LINES)
def test_every_damage_of_one_or_two_bytes_is_seen(body: str, message: Message) -> None:
    """A CRC-16 finds every burst of up to 16 bits: no damaged line is taken, none differently."""
    line = frame(body)[:-1]
    r = random.Random(2)
    for at in range(len(line)):
        for byte in range(256):
            damaged = bytearray(line)
            damaged[at] = byte
            assert parse(bytes(damaged)) == (message if damaged == line else None)
        damaged = bytearray(line)
        damaged[at : at + 2] = r.randbytes(2)
        assert damaged == line or parse(bytes(damaged)) is None


@pytest.mark.parametrize(
    "body",
    [
        "T,0,1,2,3,4,5,6,7",
        "T,0,1,2,3,4,5,6,7,8,9",
        "T,0,1,2,3,4,5,6,,8",
        "T,0,1,2,3,4,5,6, 7,8",
        "T,0,1,2,3,4,5,6,+7,8",
        "T,0,1_0,2,3,4,5,6,7,8",
        "S,1,2",
        "S,65535,3,17,3,2,900,1,2,3,4,5",
        "H,famrig,1,1,7,8,500,5,64,21",
        "H,other,2,1,7,8,500,5,64,21,900",
        "A,1,MAYBE,2",
        "A,x,OK,2",
        "A,1,OK,",
        "P,1,2,3",
        "L,10",
        "Q,1",
        "",
    ],
)
def test_other_forms_are_refused_whatever_their_crc(body: str) -> None:
    assert parse(frame(body)[:-1]) is None


def test_noise_is_refused() -> None:
    r = random.Random(3)
    assert all(parse(r.randbytes(r.randint(0, 80))) is None for _ in range(2000))
    assert parse(b"T,0,1,2,3,4,5,6,7,8") is None
    body, check = frame("L,10,74")[:-1].split(b"*")
    assert check != check.lower()
    assert parse(body + b"*" + check.lower()) is None


@pytest.mark.parametrize("body", ["a*b", "a\nb", "a\rb", "Kp\N{MULTIPLICATION SIGN}2"])
def test_what_would_break_a_line_is_not_framed(body: str) -> None:
    with pytest.raises(ValueError, match="ASCII without"):
        frame(body)


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ((40.0, 128), "40 128"),
        ((0.00004,), "0"),
        ((-0.00004,), "0"),
        ((1.99998,), "2"),
        ((20.1250,), "20.125"),
        (("ff",), "ff"),
        ((1e5,), "100000"),
    ],
)
def test_numbers_have_at_most_four_decimals(values: tuple[float | str, ...], text: str) -> None:
    assert command_body(3, "set", *values) == f"3 set {text}"


def test_splitter_does_not_care_how_the_stream_is_cut() -> None:
    r = random.Random(4)
    lines = [bytes(r.choices(b"abc,*\r", k=r.randint(0, 60))) for _ in range(300)]
    stream = b"\n".join(lines) + b"\n"
    whole = Splitter(limit=50)
    expected = whole.feed(stream)
    pieces = Splitter(limit=50)
    found = []
    at = 0
    while at < len(stream):
        step = r.randint(1, 90)
        found += pieces.feed(stream[at : at + step])
        at += step
    assert found == expected
    assert pieces.discarded == whole.discarded > 0
    assert max(map(len, expected)) <= 50


def test_every_command_is_in_the_firmwares_readme() -> None:
    text = (firmware_folder() / "README.md").read_text()
    for verb in ARGUMENTS:
        assert re.search(rf"`(0 )?{verb.decode()}[ `]", text), verb
    for letter in "TSPHAL":
        assert f"| `{letter}," in text

"""Lines: CRC against its check value and a bit-wise oracle, damage, streams; the law in fractions."""

import random
import re
from fractions import Fraction

import pytest

from rig import protocol
from rig.device import ARGUMENTS, firmware_folder
from rig.protocol import ControlLaw, Splitter, crc16, frame, next_integral, parse

LAW = ControlLaw(5120, 32768, 1024, 512, -128, 128, 1632, 12800)
SETTINGS = "7,20,5120,32768,1024,512,-128,128,1632,12800,5,700,77,1500,500,51,963,350,4,375"
STATUS = (65535, 3, 17, 3, 2, 900, 1, 2, 3, 4, 5, 16, 901, 131, 2)
HELLO = (3, 3, 7, 8, 500, 5, 64, 21, 900, 9)
SAMPLE = (15, 4294967295, 500, 1025, 205, 512, 131, -42, 97)
LINES = [
    ("T," + ",".join(map(str, SAMPLE)), protocol.Sample(*SAMPLE)),
    ("S," + ",".join(map(str, STATUS)), protocol.DeviceStatus(*STATUS)),
    (f"P,{SETTINGS}",
     protocol.DeviceSettings(7, 20, LAW, 5, 700, 77, 1500, 500, 51, 963, 350, 4, 375)),
    ("H,famrig," + ",".join(map(str, HELLO)), protocol.Hello(*HELLO)),
    ("A,12,OK,345", protocol.Ack(12, 345, "")),
    ("A,12,ERR,no trip limit", protocol.Ack(12, None, "no trip limit")),
    ("L,10,74", protocol.StoredRange(10, 74)),
]  # fmt: skip


def test_crc_is_the_published_one():
    """The division, bit by bit, as the standard writes it."""
    assert crc16(b"123456789") == 0x29B1  # check value of CRC-16/CCITT-FALSE
    data, crc = random.Random(1).randbytes(300), 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = ((crc << 1) ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    assert crc16(data) == crc


@pytest.mark.parametrize(("body", "message"), LINES)
def test_lines_say_what_they_say_and_damage_of_one_or_two_bytes_is_seen(body, message):
    """A CRC-16 finds every burst of up to 16 bits: no damaged line is taken, none differently."""
    line = frame(body).removesuffix(b"\n")
    assert (parse(line), type(parse(line))) == (message, type(message))
    r = random.Random(2)
    for at in range(len(line)):
        for damage in (*r.sample(range(256), 32), r.randbytes(2)):
            new = damage if isinstance(damage, bytes) else bytes((damage,)) + line[at + 1 : at + 2]
            damaged = line[:at] + new + line[at + 2 :]
            assert parse(damaged) == (message if damaged == line else None)


def test_splitter_does_not_care_how_the_stream_is_cut_and_keeps_little_noise():
    r = random.Random(4)
    lines = [bytes(r.choices(b"abc,*\r", k=r.randint(0, 50))) for _ in range(300)]
    stream, pieces, found = b"\n".join(lines) + b"\n", Splitter(limit=50), []
    while stream:
        step = r.randint(1, 90)
        found += pieces.feed(stream[:step])
        stream = stream[step:]
    assert found == [line for line in lines if line]
    assert pieces.feed(b"x" * 1000) == []
    assert pieces.feed(b"\n") == [b"x" * 50]


def test_every_command_is_in_the_firmwares_readme():
    text = (firmware_folder() / "README.md").read_text()
    for verb in ARGUMENTS:
        assert re.search(rf"`(0 )?{verb.decode()}[ `]", text), verb
    for letter in "TSPHAL":
        assert f"| `{letter}," in text


def test_the_law_rounds_each_figure_once_and_keeps_within_its_limits():
    r, inside = random.Random(1), 0
    for _ in range(400):
        law = ControlLaw(
            r.randint(0, 120 * 128), r.randint(0, 65280), r.randint(0, 2560), r.randint(0, 2560),
            r.randint(-255, 0), r.randint(0, 255), r.randint(0, 3200), r.randint(3200, 32000),
        )  # fmt: skip
        ticks = r.randint(1, 50)
        counts = r.randint(0, 1023 * ticks)
        slope = Fraction(law.span, 64) / 1024  # psi per count
        measured = slope * (counts - ticks * Fraction(law.zero, 16))
        exact = ticks * Fraction(law.set_point, 128) - measured
        assert abs(protocol.pressure_error(law, counts, ticks) - 128 * exact) <= Fraction(1, 2)

        error, integral = r.randint(-6400, 6400), r.randint(-128 * 32768, 128 * 32768)
        u = Fraction(law.proportional, 256) * Fraction(error, 128)
        u += Fraction(law.feed_forward, 256) + Fraction(integral, 32768)
        expected = min(max(u, Fraction(0)), Fraction(255))
        assert abs(protocol.drive(law, integral, error) - expected) <= Fraction(1, 2)
        inside += expected == u

        odd, error = law._replace(low=-100, high=100), r.randint(-(10**6), 10**6)
        assert next_integral(odd, 0, error) == -next_integral(odd, 0, -error)
        exact = Fraction(law.integral * error, 500)
        limited = min(max(exact, Fraction(-100 * 32768)), Fraction(100 * 32768))
        assert abs(next_integral(odd, 0, error) - limited) <= Fraction(1, 2)
        wide = next_integral(law._replace(low=-7, high=3), r.randint(-(2**23), 2**23), error)
        assert -7 * 32768 <= wide <= 3 * 32768
    assert inside > 100  # the limits are not all that was tried

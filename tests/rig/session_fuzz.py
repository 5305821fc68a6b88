"""A host that misbehaves and a pressure that wanders, the same for every execution of the firmware."""

import random
from typing import NamedTuple

from rig.protocol import Sample, Splitter, command_body, frame, parse


class Tick(NamedTuple):
    """What happens in one tick."""

    bytes_in: bytes
    pressure: int
    force: int
    reset: int  # cause, or 0


BYTES_PER_TICK = 19  # what simavr's receiver takes in 2 ms at 115200 baud, at 11 bits a byte


class Fuzz:
    """Commands, right, wrong and damaged; pressure that rests, wanders, steps and fails.

    It hears what the device sends, so that it asks for records that there are.
    """

    def __init__(self, seed, *, resets=True, rate=BYTES_PER_TICK):
        self._random, self._resets, self._rate = random.Random(seed), resets, rate
        self._queue, self._splitter, self._last_line = bytearray(), Splitter(), b""
        self._pressure, self._force, self._drift = 100.0, 300.0, 0.0
        self._id = self._next_seq = self._quiet = 0
        self._starting = False  # a start is on its way: what if a guard acts at that moment?

    def ticks(self, number):
        for _ in range(number):
            yield self._tick()

    def hear(self, data):
        for line in self._splitter.feed(data):
            message = parse(line)
            if isinstance(message, Sample):
                self._next_seq = message.seq + 1

    def _tick(self):
        r = self._random
        if self._quiet > 0:
            self._quiet -= 1
        elif len(self._queue) < 40 and r.random() < 0.06:
            self._queue += self._damaged(self._line())
        elif r.random() < 5e-5:
            self._quiet = 600
        self._move()
        sent = bytes(self._queue[: self._rate])
        del self._queue[: self._rate]
        reset = r.choice((1, 2, 4, 8)) if self._resets and r.random() < 2e-5 else 0
        return Tick(sent, int(self._pressure), int(self._force), reset)

    def _move(self):
        r = self._random
        if r.random() < 0.002:
            self._drift = r.choice((0.0, 0.0, r.uniform(-3, 3)))
        if r.random() < (0.02 if self._starting else 5e-4):
            self._pressure = r.choice((0, 1023, r.uniform(0, 1023)))
            self._starting = False
        noise = r.choice((0, 0, r.gauss(0, 1)))
        self._pressure = min(max(self._pressure + self._drift + noise, 0.0), 1023.0)
        self._force = min(max(self._force + r.gauss(0, 2), 0.0), 1023.0)

    def _damaged(self, line):
        r = self._random
        if r.random() < 0.85:
            return line
        damaged = bytearray(line)
        for _ in range(r.randint(1, 3)):
            damaged[r.randrange(len(damaged))] = r.randrange(256)
        return bytes(damaged) if r.random() < 0.7 else bytes(r.randbytes(r.randint(1, 90)))

    def _line(self):
        r = self._random
        kind = r.random()
        if kind < 0.25:
            return frame("0 hb")
        if kind < 0.45:
            base = max(self._next_seq - r.choice((3, 20, 60, 64, 65, 90, 5000)), 0)
            mask = r.getrandbits(64) & r.getrandbits(64)
            return frame(f"0 rp {base} {mask:x}")
        if kind < 0.5 and self._last_line:
            return self._last_line  # a retry
        self._id = r.choice((self._id + 1, self._id + 1, r.randint(0, 70000)))
        verb, values = self._command()
        self._starting = verb in ("run", "man")
        body = command_body(self._id, verb, *values)
        if r.random() < 0.05:
            body = "0" * r.randint(1, 5) + body
        if r.random() < 0.1:
            body = body.split(" ", 1)[1]  # as a person types
        self._last_line = frame(body) if r.random() < 0.9 else body.encode() + b"\r\n"
        return self._last_line

    def _command(self):
        r = self._random
        verb, *values = r.choice((
            ("hello",), ("status",), ("strict", r.randint(0, 1)),
            ("board", r.choice((0, 7, 65534, 65535))),
            ("set", round(r.uniform(0, 120), r.randint(0, 4)), round(r.uniform(0, 255), 3)),
            ("set", r.choice((20, 40, 60, 1023.99, 1024, -1))),
            ("gain", round(r.uniform(0, 10), 4), round(r.uniform(0, 10), 4)),
            ("gain", r.choice((0, 4, 127.99, 128)), r.choice((0, 5, 127.99))),
            ("ilim", r.randint(-260, 5), r.randint(-5, 260)),
            ("cal", round(r.uniform(0, 200), 2), round(r.uniform(0, 1030), 3)),
            ("cal", 0, r.choice((200, 1023.98))),
            ("run",), ("run",), ("run",), ("man", r.randint(-1, 256)),
            ("stop",), ("clear",), ("clear",),
            ("sync", r.choice((1, 3, 50, 0))),
            ("tele", r.choice((3, 4, 5, 5, 5, 10, 50, 51, 2))),
            ("trip", r.choice((900, 900, 901, 600, 500, 300, 0, 1024))),
            ("jump", r.choice((1023, 1023, 77, 20, 3))),
            ("stall", r.choice((500, 3000, 30001))),
            ("hbms", r.choice((100, 1000, 1000, 10000, 99))),
            ("floor", r.choice((0, 0, 0, 51, 90, 1022, 1023))),
            ("ceiling", r.choice((1023, 1023, 963, 0))),
            ("still", r.choice((500, 2000, 2000, 60000, 499))),
            ("frozen", r.choice((4, 4, 1, 255, 0)), r.choice((750, 750, 100, 2000, 2001))),
            ("clear",), ("nonsense",), ("set", "1e3"), ("set", r.choice(("40.1234", "40.12345"))),
            ("set", r.choice((400, 900.5))), ("set", "40.", "128"), ("man", "12.5"),
            ("set", "1", "2", "3"),
        ))  # fmt: skip
        return verb, values

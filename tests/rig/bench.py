"""A device on the bench: commands in, ticks at a pressure, the messages that came out."""

from typing import TypeVar

from rig.device import Device
from rig.protocol import Ack, Message, Sample, Splitter, command_body, frame, parse

AnyMessage = TypeVar("AnyMessage", bound=Message)


REST = (("floor", 0), ("still", 60000), ("frozen", 255, 2000), ("stall", 30000))
"""A constant reading may stay so while the output is high: there is no plant on the bench."""


class Bench:
    """Drives a device and keeps what it said, in order; only a reset tears a line."""

    def __init__(self, device: Device) -> None:
        self.device = device
        self.said: list[Message] = []
        self.torn: list[bytes] = []
        self.pressure, self.force = 100, 300
        self._lines = Splitter()
        self._id = 0

    def ticks(self, number: int = 1, pressure: int | None = None) -> None:
        for _ in range(number):
            at = self.pressure if pressure is None else pressure
            self.device.tick(at, self.force)
            for line in self._lines.feed(self.device.take()):
                message = parse(line)
                if message is None:
                    self.torn.append(line)
                else:
                    self.said.append(message)

    def send(self, line: bytes) -> None:
        """Let the line arrive as fast as the wire brings it."""
        for at in range(0, len(line), 21):
            self.device.feed(line[at : at + 21])
            self.ticks()

    def command(self, verb: str, *values: float | str) -> Ack:
        self._id += 1
        self.send(frame(command_body(self._id, verb, *values)))
        self.ticks(12)
        answers = [a for a in self.of(Ack) if a.id == self._id]
        assert len(answers) == 1, answers
        return answers[0]

    def start(self, *, gains: tuple[float, float] = (4, 2), set_psi: float = 40.0) -> None:
        """Running at a set point, feed-forward 128, trip at 600 counts; a reading may jump and rest."""
        for verb, *values in (
            ("trip", 600),
            ("jump", 1023),
            *REST,
            ("gain", *gains),
            ("set", set_psi, 128),
            ("run",),
        ):
            assert not self.command(verb, *values).reason

    def beat(self, ticks: int, pressure: int | None = None) -> None:
        """Ticks with a heartbeat every 0.2 s."""
        for at in range(0, ticks, 100):
            self.device.feed(frame("0 hb"))
            self.ticks(min(100, ticks - at), pressure)

    def of(self, kind: type[AnyMessage]) -> list[AnyMessage]:
        return [message for message in self.said if isinstance(message, kind)]

    @property
    def samples(self) -> list[Sample]:
        return self.of(Sample)

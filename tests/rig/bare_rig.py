"""A device on a table: no plant, counts from a seed, a line with faults, and what was truly sent."""

import numpy as np
from faulty_channel import FaultyChannel

from rig.device import Device
from rig.errors import RigError
from rig.link import VirtualLink

TICK = 0.002


class BareRig:
    """What a virtual link drives; `truth` holds every record line that left the device."""

    def __init__(self, seed: int = 0, *, ring: int = 64, **chances: float) -> None:
        self.device = Device(ring=ring)
        self.to_device = FaultyChannel(baud=115200, seed=seed, **chances)
        self.to_host = FaultyChannel(seed=seed + 1, **chances)
        self.now = 0.0
        self.ticks = 0
        self.truth: set[bytes] = set()
        rng = np.random.default_rng(seed)
        n = 1 << 14
        slow = 60 * np.sin(np.arange(n) * 2 * np.pi / n * 4)
        self._pressure = (300 + slow + rng.normal(0, 1.5, n)).astype(int).tolist()
        self._force = (500 + slow + rng.normal(0, 1.5, n)).astype(int).tolist()
        self._rest = b""

    def write(self, data: bytes) -> None:
        self.to_device.send(data, self.now)

    def read(self) -> bytes:
        return self.to_host.receive(self.now)

    def advance(self, seconds: float) -> None:
        end = self.now + seconds
        while (self.ticks + 1) * TICK <= end + 1e-9:
            self.ticks += 1
            at = self.ticks * TICK
            self.device.feed(self.to_device.receive(at))
            i = self.ticks % len(self._pressure)
            self.device.tick(self._pressure[i], self._force[i])
            self._send(self.device.take(), at)
        self.now = end

    def _send(self, data: bytes, at: float) -> None:
        if not data:
            return
        self.to_host.send(data, at)
        *lines, self._rest = (self._rest + data).split(b"\n")
        self.truth.update(line for line in lines if line.startswith(b"T"))

    def reset(self, cause: int = 2) -> None:
        self._rest = b""
        self.device.reset(cause)


class Recorder:
    """A link over a bare rig that keeps every line the session lets through."""

    def __init__(self, rig: BareRig, first_id: int = 0) -> None:
        self.rig = rig
        self.link = VirtualLink(rig, first_id)
        self.samples = []
        self.link.watch = self.samples.append
        self.link.command("hello")
        self._become_strict()

    def _become_strict(self) -> None:
        """Until then a damaged command without its CRC may be taken for another, and refused."""
        while True:
            try:
                self.link.command("strict", 1)
                return
            except RigError:
                continue

    def run(self, seconds: float) -> None:
        end = self.link.now + seconds
        while self.link.now < end - 1e-9:
            self.link.keep_alive()
            self.link.sleep(min(0.5, end - self.link.now))

    def wrong(self) -> int:
        """Records that the device never sent, recognised by all of their fields."""
        sent = {tuple(map(int, line[2:-5].split(b","))) for line in self.rig.truth}
        return sum(tuple(sample) not in sent for sample in self.samples)

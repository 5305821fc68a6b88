"""Rigs in virtual time, devices on the bench, and commands of `famjax rig` as a person types them."""

import contextlib
import time

from faulty_channel import FaultyChannel

from rig.calibration import write_calibration
from rig.channels import greet
from rig.control import Control, Rig
from rig.device import Device
from rig.journal import Journal
from rig.link import VirtualLink
from rig.protocol import SAFE, Ack, DeviceStatus, Sample, Splitter, command_body, frame, parse
from rig.simulation import SimulatedRig

PSI = 6894.757293168361
LIMIT = 110 * PSI


class Wired(Device):
    """A board whose wires carry something else to its channels."""

    def __init__(self, wires):
        self.wires = wires
        super().__init__()

    def tick(self, pressure_counts, force_counts):
        super().tick(*self.wires(pressure_counts, force_counts))


class Watched(SimulatedRig):
    """Knows its highest true pressure [psi]."""

    peak = 0.0

    def advance(self, seconds):
        super().advance(seconds)
        self.peak = max(self.peak, self.pressure / PSI)


def opened(sim, journal=None, **changes):
    """A rig under 110 psi, still to be entered."""
    calibration = changes.pop("calibration", None) or sim.calibration()
    gains = Control.per_psi(4, 2)
    settings = {"pressure_limit": LIMIT, "control": gains, "journal": journal, **changes}
    return Rig(VirtualLink(sim), calibration, **settings)


def journal_of(path, sim, **options):
    return Journal(path, lambda: sim.now, **options)


@contextlib.contextmanager
def recorded(path, sim=None, **changes):
    """A rig that is entered and recorded; it must be vented in the end."""
    sim = sim or SimulatedRig()
    try:
        with journal_of(path, sim) as journal, opened(sim, journal, **changes) as rig:
            yield rig
    finally:
        assert sim.device.output == 0


def vented(sim):
    return sim.device.state == SAFE and sim.device.output == 0 and sim.device.dump_open


def cable(sim, *, out):
    """The device runs on its own supply."""
    sim.to_host.cut = sim.to_device.cut = out


class Recorder:
    """A link over a line with faults that keeps what the session lets through, and what was sent."""

    def __init__(self, seed=0, **chances):
        to_device = FaultyChannel(baud=115200, limit=4096, seed=seed, **chances)
        to_host = FaultyChannel(seed=seed + 1, **chances)
        self.sim = SimulatedRig(to_device=to_device, to_host=to_host)
        self.sent, take = bytearray(), self.sim.device.take

        def taken():
            data = take()
            self.sent += data
            return data

        self.sim.device.take = taken
        self.link = VirtualLink(self.sim)
        self.samples: list[Sample] = []
        self.link.watch = self.samples.append
        self.link.command("hello")
        greet(self.link)

    def run(self, seconds):
        end = self.link.now + seconds
        while self.link.now < end - 1e-9:
            self.link.keep_alive()
            self.link.sleep(min(0.5, end - self.link.now))

    def wrong(self):
        """Records that the device never sent, recognised by all of their fields."""
        lines = (line for line in self.sent.split(b"\n") if line.startswith(b"T"))
        sent = {tuple(map(int, line[2:-5].split(b","))) for line in lines}
        return sum(tuple(sample) not in sent for sample in self.samples)


class Port:
    """A port whose rig runs as the clock does: reading advances it, by 0.25 s at most."""

    cable_out, closed, in_waiting = False, 0, 0

    def __init__(self):
        self.sim, self.begin = SimulatedRig(), time.monotonic()

    def open(self):
        if self.cable_out:
            raise OSError("the cable is out")
        return self

    def read(self, _size=1):
        self.open()
        time.sleep(0.002)
        behind = time.monotonic() - self.begin - self.sim.now
        self.begin += max(behind - 0.25, 0.0)
        self.sim.advance(min(max(behind, 0.0), 0.25))
        return self.sim.read()

    def write(self, data):
        self.open().sim.write(data)

    def close(self):
        self.closed += 1


def until(holds, seconds=10):
    """Wait for another thread."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


def record_line(seq, tick=None, **fields):
    tick = 5 * seq + 5 if tick is None else tick
    sample = Sample(0, seq, tick, 1000 + seq % 7, 200, 2500, 0, 0, 0)._replace(**fields)
    return frame("T," + ",".join(map(str, sample)))


def records(*numbers, **fields):
    return b"".join(record_line(number, **fields) for number in numbers)


class Bench:
    """Commands in, ticks at a pressure, the messages that came out; only a reset tears a line."""

    def __init__(self, device):
        self.device = device
        self.said = []
        self.lines = []
        self.torn = []
        self.pressure, self.force = 100, 300
        self._splitter, self._id = Splitter(), 0

    def ticks(self, number=1, pressure=None):
        for _ in range(number):
            self.device.tick(self.pressure if pressure is None else pressure, self.force)
            for line in self._splitter.feed(self.device.take()):
                self.lines.append(line)
                message = parse(line)
                if message is None:
                    self.torn.append(line)
                else:
                    self.said.append(message)

    def send(self, line):
        """Let the line arrive as fast as the wire brings it."""
        for at in range(0, len(line), 21):
            self.device.feed(line[at : at + 21])
            self.ticks()

    def command(self, verb, *values):
        self._id += 1
        self.send(frame(command_body(self._id, verb, *values)))
        self.ticks(12)
        (answer,) = (a for a in self.of(Ack) if a.id == self._id)
        return answer

    def start(self, *, gains=(4, 2), set_psi=40.0):
        """Running at a set point, feed-forward 128, trip at 600 counts; a reading may jump and rest."""
        rest = ("floor", 0), ("still", 60000), ("frozen", 255, 2000), ("stall", 30000)  # no plant
        begin = ("trip", 600), ("jump", 1023), *rest, ("gain", *gains), ("set", set_psi, 128)
        for verb, *values in (*begin, ("run",)):
            assert not self.command(verb, *values).reason

    def beat(self, ticks, pressure=None):
        """Ticks with a heartbeat every 0.2 s."""
        for at in range(0, ticks, 100):
            self.device.feed(frame("0 hb"))
            self.ticks(min(100, ticks - at), pressure)

    def of(self, kind):
        return [message for message in self.said if isinstance(message, kind)]

    @property
    def status(self):
        """The last one, some ticks later."""
        self.ticks(30)
        return self.of(DeviceStatus)[-1]

    @property
    def samples(self):
        return self.of(Sample)


PLAN = """
[plan]
pressures_psi = [{pressures}]
cycles = 1
stroke_in = {stroke}
rate_in_per_s = {rate}
settle_s = {settle}

[rig]
circuit = "{circuit}"
{limit}
proportional_counts_per_psi = 4
integral_counts_per_psi_s = 2
calibration = "calibration.toml"
"""


def write_plan(folder, **changes):
    fields = {"pressures": "40, 80", "circuit": "air", "limit": "pressure_limit_psi = 110",
              "settle": "3", "stroke": "3.2", "rate": "0.4"}  # fmt: skip
    path = folder / "plan.toml"
    path.write_text(PLAN.format(**(fields | changes)))
    return path


def calibrated(folder, **changes):
    write_calibration(folder / "calibration.toml", SimulatedRig().calibration())
    return write_plan(folder, **changes)

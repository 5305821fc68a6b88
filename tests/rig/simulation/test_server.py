"""The real-time server through pyserial. No timing is asserted: real time on a busy machine is not."""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import serial

from rig import RigError
from rig.protocol import Ack, Sample, Splitter, parse
from rig.simulation import RigServer, SimulatedRig

PATIENCE = 10.0  # s, for what takes milliseconds on an idle machine
needs_pty = pytest.mark.skipif(sys.platform == "win32", reason="there are no pseudo-terminals here")


class Host:
    """The other end: a pyserial port and the messages that it has brought."""

    def __init__(self, address: str) -> None:
        self.port = serial.serial_for_url(address, 115200, timeout=0.02)
        self.splitter, self.heard = Splitter(), []

    def listen(self, until: Callable[[], bool], patience: float = PATIENCE) -> bool:
        end = time.monotonic() + patience
        while time.monotonic() < end:
            data = self.port.read(4096)
            self.heard += [m for m in map(parse, self.splitter.feed(data)) if m is not None]
            if until():
                return True
        return False

    def answered(self, id_: int) -> bool:
        return any(isinstance(m, Ack) and m.id == id_ for m in self.heard)

    def ask(self, id_: int, verb: str) -> bool:
        for _ in range(5):  # a line may be lost where the port has only just been opened
            self.port.write(f"{id_} {verb}\n".encode())
            if self.listen(lambda: self.answered(id_), PATIENCE / 5):
                return True
        return False


@pytest.mark.parametrize("transport", [pytest.param("pty", marks=needs_pty), "tcp"])
def test_a_host_finds_the_device(transport: str) -> None:
    with RigServer(SimulatedRig(), transport) as server:  # pyright: ignore[reportArgumentType]
        host = Host(server.address)
        assert host.ask(1, "hello")
        assert host.listen(lambda: sum(isinstance(m, Sample) for m in host.heard) > 20)
        host.port.close()
    numbers = [m.seq for m in host.heard if isinstance(m, Sample)]
    assert numbers == sorted(numbers)


@needs_pty
def test_a_pulled_cable_comes_back_behind_the_same_name(tmp_path: Path) -> None:
    link = tmp_path / "rig"
    with RigServer(SimulatedRig(), "pty", link=link) as server:
        assert server.address == str(link)
        host = Host(server.address)
        assert host.ask(1, "hello")
        server.unplug()
        assert not link.exists()
        with pytest.raises(OSError):  # noqa: PT011 -- pyserial's words differ by system
            host.listen(lambda: False)
        host.port.close()
        server.plug()
        again = Host(server.address)
        assert again.ask(2, "hello")
        again.port.close()
    assert not link.is_symlink()


def test_a_tcp_host_that_hangs_up_may_call_again() -> None:
    with RigServer(SimulatedRig(), "tcp") as server:
        for id_ in (1, 2):
            host = Host(server.address)
            assert host.ask(id_, "hello")
            host.port.close()
        server.unplug()
        server.plug()
        host = Host(server.address)
        assert host.ask(3, "hello")
        host.port.close()


@pytest.mark.slow
def test_a_frozen_bridge_is_silent_and_thaws() -> None:
    with RigServer(SimulatedRig(), "tcp") as server:
        host = Host(server.address)
        assert host.ask(1, "hello")
        server.freeze()
        host.listen(lambda: False, 0.2)  # what was on its way
        count = len(host.heard)
        host.port.write(b"2 hello\n")
        host.listen(lambda: False, 0.3)
        assert len(host.heard) == count
        server.freeze(frozen=False)
        assert host.ask(3, "hello")
        host.port.close()


def test_the_reset_button_starts_a_new_boot() -> None:
    rig = SimulatedRig()
    with RigServer(rig, "tcp") as server:
        boot = rig.device.boot
        server.reset_device()
        host = Host(server.address)
        assert host.listen(lambda: any(isinstance(m, Sample) for m in host.heard))
        host.port.close()
    assert rig.device.boot == boot + 1
    assert {m.boot for m in host.heard if isinstance(m, Sample)} == {(boot + 1) & 15}


def test_what_fails_in_the_rig_is_told_at_the_end() -> None:
    rig = SimulatedRig()

    def fail(seconds: float) -> None:
        raise RigError("the muscle left its table")

    rig.advance = fail  # pyright: ignore[reportAttributeAccessIssue]
    server = RigServer(rig, "tcp")
    with (
        pytest.raises(RigError, match="the simulated rig stopped: the muscle left its table"),
        server,
    ):
        time.sleep(0.1)


def test_ports_and_names_that_are_taken_are_refused(tmp_path: Path) -> None:
    taken = RigServer(SimulatedRig(), "tcp")
    number = int(taken.address.rpartition(":")[2])
    with pytest.raises(RigError, match=f"cannot serve on port {number}"):
        RigServer(SimulatedRig(), "tcp", port=number)
    taken.close()
    with pytest.raises(RigError, match="transport must be pty or tcp"):
        RigServer(SimulatedRig(), "usb")  # pyright: ignore[reportArgumentType]
    if sys.platform != "win32":
        name = tmp_path / "there"
        name.write_text("")
        with pytest.raises(RigError, match="exists: give the link another name"):
            RigServer(SimulatedRig(), "pty", link=name)

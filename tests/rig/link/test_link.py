"""The thread that owns a port: over a scripted port, and in real time over a pty."""

# ruff: noqa: PT012 -- what is told comes at some time, not at the first call

import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rig.device import Device
from rig.errors import RigError, RigFault
from rig.journal import Journal, read_journal
from rig.link import Link, Silent, serial_opener

posix = pytest.mark.skipif(sys.platform == "win32", reason="a pty is needed")


def until(holds: Callable[[], bool], seconds: float = 10) -> None:
    """Wait for another thread."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.002)


class InProcessPort:
    """A device that ticks whenever its port is read: as fast as the link goes."""

    def __init__(self, device: Device | None = None) -> None:
        self.device = device or Device()
        self.broken = False
        self.closed = 0
        self._out = bytearray()

    def open(self) -> "InProcessPort":
        if self.broken:
            raise OSError("no such device")
        return self

    @property
    def in_waiting(self) -> int:
        return len(self._out)

    def read(self, size: int = 1) -> bytes:
        if self.broken:
            raise OSError("the cable is out")
        time.sleep(0.0002)
        self.device.tick(200, 500)
        self._out += self.device.take()
        data = bytes(self._out)
        self._out.clear()
        return data

    def write(self, data: bytes) -> None:
        if self.broken:
            raise OSError("the cable is out")
        self.device.feed(data)

    def close(self) -> None:
        self.closed += 1


@pytest.fixture
def port() -> InProcessPort:
    return InProcessPort()


def test_a_conversation_over_a_port(port: InProcessPort, tmp_path: Path) -> None:
    with (
        Link(port.open) as link,
        Journal(tmp_path / "a.fam", lambda: link.now, reserve_bytes=0) as journal,
    ):
        link.attach(journal)
        link.command("hello")
        assert link.command("trip", 600).seq is not None
        with pytest.raises(RigError, match=r"refuses 'man 300': number"):
            link.command("man", 300)
        until(lambda: link.newest is not None and link.newest.seq > 100)
        link.attach(None)
    assert port.closed == 1
    found = read_journal(tmp_path / "a.fam")
    assert found.missing == ()
    assert len(found.rows) > 50


def test_a_port_that_goes_away_is_opened_again(port: InProcessPort) -> None:
    with Link(port.open) as link:
        link.command("hello")
        until(lambda: link.newest is not None)
        port.broken = True
        until(lambda: link.port is None)
        port.broken = False
        until(lambda: link.port is not None)
        assert link.command("status").seq is not None
    assert port.closed == 2


@pytest.mark.slow
def test_a_port_that_stays_away_is_told_as_silence(port: InProcessPort) -> None:
    with Link(port.open) as link:
        link.command("hello")
        port.broken = True
        until(lambda: any(isinstance(alarm, Silent) for alarm in link.alarms))
        with pytest.raises(RigFault, match=r"failed: "):
            link.command("status")


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_thread_that_ends_is_told_to_who_waits(port: InProcessPort) -> None:
    with Link(port.open) as link:
        link.command("hello")
        link.watch = lambda _: 1 / 0
        with pytest.raises(RigFault, match=r"the link has ended"):
            while True:
                link.command("status")
        with pytest.raises(RigFault, match=r"the link has ended"):
            link.check()


def test_a_port_that_is_not_there_is_said() -> None:
    pytest.importorskip("serial")
    with pytest.raises(RigError, match=r"cannot open the port.*no other program"):
        Link(serial_opener("/dev/no-such-port"))


def test_a_serial_port_is_opened_for_this_program_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    serial = pytest.importorskip("serial")
    opened: list[tuple[str, int, bool | None]] = []
    monkeypatch.setattr(
        serial, "serial_for_url",
        lambda path, baud, **options: opened.append((path, baud, options.get("exclusive"))),
    )  # fmt: skip
    for path in ("/dev/ttyACM0", "socket://127.0.0.1:1"):  # which pyserial cannot lock
        serial_opener(path, 500_000)()
    assert opened == [("/dev/ttyACM0", 500_000, True), ("socket://127.0.0.1:1", 500_000, None)]

"""The thread that owns a port: over a scripted port, and in real time over a pty."""

# ruff: noqa: PT012 -- what is told comes at some time, not at the first call

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rig.device import Device
from rig.errors import RigError
from rig.fault import RigFault
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


def test_commands_of_many_threads_are_all_answered(port: InProcessPort) -> None:
    answers: list[int | None] = []
    with Link(port.open) as link:
        link.command("hello")

        def ask(counts: int) -> None:
            answers.append(link.command("trip", counts).seq)

        threads = [threading.Thread(target=ask, args=(500 + k,)) for k in range(8)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert len(answers) == 8
    assert None not in answers


def test_a_port_that_goes_away_is_opened_again(port: InProcessPort) -> None:
    with Link(port.open) as link:
        link.command("hello")
        until(lambda: link.newest is not None)
        port.broken = True
        until(lambda: not link.connected)
        port.broken = False
        until(lambda: link.connected)
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


class Pty:
    """A device behind a pty in real time, reached by a name that outlives the pty."""

    def __init__(self, name: Path) -> None:
        self.name, self.device = name, Device()
        self._closing = threading.Event()
        self._master = -1
        self.plug()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def plug(self) -> None:
        import tty

        master, slave = os.openpty()
        tty.setraw(slave)
        os.set_blocking(master, False)
        self.name.unlink(missing_ok=True)
        self.name.symlink_to(os.ttyname(slave))
        os.close(slave)
        self._master = master

    def unplug(self) -> None:
        master, self._master = self._master, -1
        os.close(master)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        if self._master >= 0:
            self.unplug()

    def _run(self) -> None:
        start, ticks = time.monotonic(), 0
        while not self._closing.wait(0.001):
            while ticks * 0.002 < time.monotonic() - start:
                ticks += 1
                self._exchange()

    def _exchange(self) -> None:
        master = self._master
        received = b""
        try:
            received = os.read(master, 4096) if master >= 0 else b""
        except OSError:  # nothing came, or nobody has the other end open
            received = b""
        self.device.feed(received)
        self.device.tick(200, 500)
        sent = self.device.take()
        try:
            if master >= 0 and sent:
                os.write(master, sent)
        except OSError:
            return


@pytest.fixture
def pty(tmp_path: Path) -> Iterator[Pty]:
    pytest.importorskip("serial")
    device = Pty(tmp_path / "ttyRIG")
    yield device
    device.close()


@posix
def test_a_serial_port_is_this_programs_alone(pty: Pty) -> None:
    with Link(serial_opener(str(pty.name))) as link:
        link.command("hello")
        assert link.command("trip", 600).seq is not None
        with pytest.raises(RigError, match=r"exclusively lock port"):
            Link(serial_opener(str(pty.name)))
        assert link.command("status").seq is not None


@posix
def test_a_cable_that_comes_back_under_its_name_goes_on(pty: Pty) -> None:
    with Link(serial_opener(str(pty.name))) as link:
        link.command("hello")
        until(lambda: link.newest is not None)
        before = link.newest.seq
        pty.unplug()
        until(lambda: not link.connected)
        pty.plug()
        until(lambda: link.connected and link.newest.seq > before + 20)
        assert not link.session.order.gaps or link.session.order.recovered > 0
        assert link.command("status").seq is not None

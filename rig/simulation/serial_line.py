"""The far end of a serial line in real time: a pseudo-terminal or a TCP port."""

import contextlib
import errno
import io
import os
import socket
from pathlib import Path

from ..errors import RigError

_CHUNK = 4096


class _Line:
    """One end of a line; reading and writing never wait."""

    address: str
    _open: io.RawIOBase | None = None  # what is connected

    def read(self) -> bytes:
        """Bytes that have come, none if nothing is connected."""
        data = None
        if self._open is None:
            self._accept()
            return b""
        with self._lost():
            data = self._open.read(_CHUNK)
            if data == b"":
                self._drop()
        return data or b""

    def write(self, data: bytes) -> None:
        """Send bytes; without a peer they are lost."""
        if self._open is not None and data:
            with self._lost():
                self._open.write(data)

    def _accept(self) -> None:
        """Connect whoever calls."""

    def _drop(self) -> None:
        if self._open is not None:
            self._open.close()
            self._open = None

    @contextlib.contextmanager
    def _lost(self):
        try:
            yield
        except ConnectionError:
            self._drop()
        except OSError as error:
            if error.errno != errno.EIO:  # nobody has the pseudo-terminal open
                raise


class PtyLine(_Line):
    """A pseudo-terminal."""

    def __init__(self, link: str | Path | None) -> None:
        try:
            import pty  # noqa: F401, PLC0415 -- tells whether there are any
        except ImportError:
            raise RigError("there are no pseudo-terminals on this system: take tcp") from None
        self._link = Path(link) if link is not None else None
        if self._link is not None and (self._link.exists() or self._link.is_symlink()):
            raise RigError(f"{self._link} exists: give the link another name")
        self.restore()

    def restore(self) -> None:
        """Connect again."""
        import tty  # noqa: PLC0415 -- not on Windows

        if self._open is not None:
            return
        master, slave = os.openpty()
        tty.setraw(slave)  # before the first write, or the terminal echoes
        os.set_blocking(master, False)
        # The slave stays open here: reading the master is an error while no process has it open.
        self._open, self._slave = io.FileIO(master, "r+"), slave
        self.address = os.ttyname(slave)
        if self._link is not None:
            self._link.unlink(missing_ok=True)
            self._link.symlink_to(self.address)
            self.address = str(self._link)

    def hang_up(self) -> None:
        """Break the connection, as a pulled cable does."""
        if self._open is not None:
            os.close(self._slave)
            self._drop()
            if self._link is not None:
                self._link.unlink()

    def close(self) -> None:
        """End for good."""
        self.hang_up()


class TcpLine(_Line):
    """A TCP port of this computer."""

    def __init__(self, port: int) -> None:
        self._server = socket.socket()
        self._server.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._server.bind(("127.0.0.1", port))
        except OSError as error:
            self._server.close()
            raise RigError(f"cannot serve on port {port}: {error.strerror}") from None
        self._server.listen(1)
        self._server.setblocking(False)
        self._out = False
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def restore(self) -> None:
        """Connect again."""
        self._out = False

    def hang_up(self) -> None:
        """Break the connection, as a pulled cable does."""
        self._out = True
        self._drop()

    def close(self) -> None:
        """End for good."""
        self._drop()
        self._server.close()

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError):
            peer, _ = self._server.accept()
            with peer:  # its file keeps it open
                if not self._out:
                    peer.setblocking(False)
                    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    self._open = peer.makefile("rwb", buffering=0)

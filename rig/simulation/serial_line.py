"""The far end of a serial line in real time: a pseudo-terminal or a TCP port."""

import contextlib
import errno
import os
import socket
from pathlib import Path

from ..errors import RigError

_CHUNK = 4096


class PtyLine:
    """A pseudo-terminal; reading and writing never wait."""

    def __init__(self, link: str | Path | None) -> None:
        try:
            import pty  # noqa: F401, PLC0415 -- tells whether there are any
            import tty  # noqa: F401, PLC0415
        except ImportError:
            raise RigError("there are no pseudo-terminals on this system: take tcp") from None
        self._link = Path(link) if link is not None else None
        if self._link is not None and (self._link.exists() or self._link.is_symlink()):
            raise RigError(f"{self._link} exists: give the link another name")
        self._open()

    def _open(self) -> None:
        import tty  # noqa: PLC0415

        self._master, slave = os.openpty()
        tty.setraw(slave)  # before the first write, or the terminal echoes
        os.set_blocking(self._master, False)
        name = os.ttyname(slave)
        # The slave stays open here: reading the master is an error while no process has it open.
        self._slave = slave
        if self._link is None:
            self.address = name
            return
        with contextlib.suppress(FileNotFoundError):
            self._link.unlink()
        self._link.symlink_to(name)
        self.address = str(self._link)

    def read(self) -> bytes:
        """Bytes that have come, none if nothing is connected."""
        if self._master < 0:
            return b""
        try:
            return os.read(self._master, _CHUNK)
        except OSError as error:
            if error.errno in {errno.EAGAIN, errno.EIO}:
                return b""
            raise

    def write(self, data: bytes) -> None:
        """Send bytes; without a peer they are lost."""
        if self._master < 0 or not data:
            return
        try:
            os.write(self._master, data)
        except OSError as error:
            if error.errno not in {errno.EAGAIN, errno.EIO}:
                raise

    def hang_up(self) -> None:
        """Break the connection, as a pulled cable does."""
        if self._master >= 0:
            os.close(self._slave)
            os.close(self._master)
            self._master = self._slave = -1
            if self._link is not None:
                self._link.unlink()

    def restore(self) -> None:
        """Connect again."""
        if self._master < 0:
            self._open()

    def close(self) -> None:
        """End for good."""
        self.hang_up()


class TcpLine:
    """A TCP port of this computer; reading and writing never wait."""

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
        self._peer: socket.socket | None = None
        self._out = False
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"

    def read(self) -> bytes:
        """Bytes that have come, none if nothing is connected."""
        if self._peer is None:
            self._accept()
            return b""
        try:
            data = self._peer.recv(_CHUNK)
        except BlockingIOError:
            return b""
        except ConnectionError:
            data = b""
        if not data:
            self._drop()
        return data

    def write(self, data: bytes) -> None:
        """Send bytes; without a peer they are lost."""
        if self._peer is None or not data:
            return
        try:
            self._peer.send(data)
        except BlockingIOError:
            return
        except ConnectionError:
            self._drop()

    def hang_up(self) -> None:
        """Break the connection, as a pulled cable does."""
        self._out = True
        self._drop()

    def restore(self) -> None:
        """Connect again."""
        self._out = False

    def close(self) -> None:
        """End for good."""
        self._drop()
        self._server.close()

    def _accept(self) -> None:
        try:
            peer, _ = self._server.accept()
        except BlockingIOError:
            return
        if self._out:
            peer.close()
            return
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._peer = peer

    def _drop(self) -> None:
        if self._peer is not None:
            self._peer.close()
            self._peer = None

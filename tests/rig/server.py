"""A simulated rig in real time on a TCP port, whose cable can be pulled. Base no test on its times."""

import contextlib
import io
import socket
import threading
import time

from rig.simulation import SimulatedRig

SLICE = 0.004  # s between two exchanges of bytes
CATCH_UP = 0.25  # s that the rig may lag; on a busy machine the rest is left out


class RigServer:
    """Runs a rig in a thread and offers its serial line; bytes that are not read are lost."""

    def __init__(self, rig: SimulatedRig) -> None:
        self.rig = rig
        self._server = socket.create_server(("127.0.0.1", 0))
        self._server.setblocking(False)
        self.address = f"socket://127.0.0.1:{self._server.getsockname()[1]}"
        self._host: io.RawIOBase | None = None
        self._lock, self._stop = threading.Lock(), threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated rig", daemon=True)

    def __enter__(self) -> "RigServer":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        self._thread.join()
        self._drop()
        self._server.close()

    def unplug(self) -> None:
        """Pull the cable: bytes under way are lost, and the host's port disappears."""
        with self._lock:
            self.rig.to_device.cut = self.rig.to_host.cut = True
            self._drop()

    def _run(self) -> None:
        start, begin = time.monotonic(), self.rig.now
        while not self._stop.wait(SLICE):
            with self._lock:
                behind = begin + time.monotonic() - start - self.rig.now
                if behind > CATCH_UP:
                    begin -= behind - SLICE
                    behind = SLICE
                try:
                    self.rig.write(self._read())
                    self.rig.advance(max(behind, 0.0))
                    if self._host is not None:
                        self._host.write(self.rig.read())
                except ConnectionError:
                    self._drop()

    def _read(self) -> bytes:
        if self._host is None:
            with contextlib.suppress(BlockingIOError):
                peer, _ = self._server.accept()
                with peer:  # its file keeps it open
                    peer.setblocking(False)
                    peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    if not self.rig.to_device.cut:
                        self._host = peer.makefile("rwb", buffering=0)
            return b""
        data = self._host.read(4096)
        if data == b"":
            self._drop()
        return data or b""

    def _drop(self) -> None:
        if self._host is not None:
            self._host.close()
            self._host = None

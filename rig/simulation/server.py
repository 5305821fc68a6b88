"""A simulated rig in real time on a pseudo-terminal or a TCP port, with faults on demand."""

import threading
import time
from pathlib import Path

from ..errors import RigError
from .serial_line import PtyLine, TcpLine
from .simulated_rig import SimulatedRig

_SLICE = 0.004  # s between two exchanges of bytes
_CATCH_UP = 0.25  # s that the rig may lag; on a busy machine the rest is left out, and counted


class RigServer:
    """Runs a simulated rig in real time in a thread and offers its serial line.

    A virtual cable can be pulled, a bridge frozen and the device reset while it runs. Bytes
    that are not read are lost, as on a serial line. Real time on a busy machine is an
    approximation: `skipped` says how much of it was left out; base no test on it.

    Args:
        rig: to be run; nothing else may advance it.
        transport: "pty" (not on Windows) or "tcp".
        link: path of a symbolic link that always leads to the present pseudo-terminal.
        port: TCP port, 0 for a free one.
        speed: seconds of the rig per second.

    Attributes:
        rig: which is run.
        skipped: seconds that were left out.

    Raises:
        RigError: there are no pseudo-terminals here, or the port or the link is taken.
    """

    def __init__(
        self,
        rig: SimulatedRig,
        transport: str = "pty",
        *,
        link: str | Path | None = None,
        port: int = 0,
        speed: float = 1.0,
    ) -> None:
        if transport not in {"pty", "tcp"} or not speed > 0:
            raise RigError(
                f"transport must be pty or tcp and speed positive, got {transport!r}, {speed}"
            )
        self.rig, self.skipped = rig, 0.0
        self._speed = speed
        self._line: PtyLine | TcpLine = PtyLine(link) if transport == "pty" else TcpLine(port)
        self._lock = threading.Lock()
        self._frozen = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name="simulated rig", daemon=True)
        self._failure: Exception | None = None

    @property
    def address(self) -> str:
        """What to open with pyserial: the path of a terminal, or socket://127.0.0.1:port."""
        return self._line.address

    def __enter__(self) -> "RigServer":
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Stop the rig and free the port.

        Raises:
            RigError: the rig itself had failed while it ran.
        """
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._line.close()
        if self._failure is not None:
            raise RigError(f"the simulated rig stopped: {self._failure}") from self._failure

    def unplug(self) -> None:
        """Pull the cable: bytes under way are lost, and the host's port disappears."""
        with self._lock:
            self.rig.to_device.cut = self.rig.to_host.cut = True
            self._line.hang_up()

    def plug(self) -> None:
        """Put the cable back in; a pseudo-terminal gets a new name behind the same link."""
        with self._lock:
            self.rig.to_device.cut = self.rig.to_host.cut = False
            self._line.restore()

    def freeze(self, *, frozen: bool = True) -> None:
        """Let the bridge hang: the port stays open, no byte passes either way."""
        with self._lock:
            self._frozen = frozen
            self.rig.to_device.cut = self.rig.to_host.cut = frozen

    def reset_device(self, cause: int = 2) -> None:
        """Press the device's reset button."""
        with self._lock:
            self.rig.device.reset(cause)

    def _run(self) -> None:
        start, begin = time.monotonic(), self.rig.now
        try:
            while not self._stop.wait(_SLICE):
                with self._lock:
                    behind = begin + (time.monotonic() - start) * self._speed - self.rig.now
                    if behind > _CATCH_UP * self._speed:
                        self.skipped += behind - _SLICE
                        begin -= behind - _SLICE
                        behind = _SLICE
                    data = self._line.read()
                    if not self._frozen:
                        self.rig.write(data)
                    if behind > 0:
                        self.rig.advance(behind)
                    self._line.write(self.rig.read())
        except (RigError, OSError) as error:
            self._failure = error

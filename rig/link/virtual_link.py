"""A link to a simulated rig: no thread, and time passes only in `sleep`."""

from typing import Protocol

from .abstract_link import AbstractLink

SLICE = 0.004
"""Virtual time [s] between two exchanges of bytes."""


class Simulated(Protocol):
    """The device's side of the cable."""

    @property
    def now(self) -> float:
        """Virtual time [s]."""
        ...

    def write(self, data: bytes) -> None:
        """Bytes to the device."""
        ...

    def read(self) -> bytes:
        """Bytes that have come from it."""
        ...

    def advance(self, seconds: float) -> None:
        """Let virtual time pass."""
        ...


class VirtualLink(AbstractLink):
    """A link whose `sleep` advances a simulated rig.

    Args:
        rig: the simulated rig.
        first_id: number of the first command.
    """

    def __init__(self, rig: Simulated, first_id: int = 0) -> None:
        super().__init__(first_id)
        self.rig = rig
        self._part = b""  # of an incomplete line

    @property
    def now(self) -> float:
        """Virtual time [s]."""
        return self.rig.now

    @property
    def running(self) -> bool:
        """Always: `sleep` moves the bytes."""
        return True

    def sleep(self, seconds: float) -> None:
        """Advance the rig in slices of `SLICE`, exchanging bytes where there is a line or need."""
        rig, idle = self.rig, self.session.idle
        end = rig.now + seconds
        while (left := end - rig.now) > 1e-9:
            rig.advance(SLICE if left > SLICE else left)
            data = self._part + rig.read()
            if b"\n" not in data and idle(rig.now):
                self._part = data
                continue
            self._part = b""
            out = self._pump(data)
            if out:
                rig.write(out)

    def close(self) -> None:
        """Nothing to close."""

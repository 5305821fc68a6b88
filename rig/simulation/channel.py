"""One direction of a serial line: delay, and bytes damaged, dropped and doubled."""

import math
from collections import deque

import numpy as np

from ..errors import RigError

BITS_PER_BYTE = 10  # start, eight, stop


class ByteChannel:
    """A queue of bytes with a baud rate and faults, all decided by a seed.

    Args:
        baud: bits a second; None delivers at once.
        damage: probability that a byte has one or more bits flipped.
        drop: probability that a byte is lost.
        duplicate: probability that a byte arrives twice.
        seed: of the faults.
        limit: bytes that may wait; what comes on top is lost, as in a UART. None for no limit.

    Attributes:
        sent: bytes put in.
        faulty: bytes damaged, dropped or doubled.
        waiting: bytes that have not been received.
    """

    def __init__(
        self,
        *,
        baud: float | None = None,
        damage: float = 0.0,
        drop: float = 0.0,
        duplicate: float = 0.0,
        seed: int = 0,
        limit: int | None = None,
    ) -> None:
        for name, chance in (("damage", damage), ("drop", drop), ("duplicate", duplicate)):
            if not 0 <= chance < 1:
                raise RigError(f"{name} is a probability per byte in [0, 1), got {chance}")
        if damage + drop + duplicate >= 1:
            raise RigError("damage, drop and duplicate together must stay below 1")
        if baud is not None and not baud > 0:
            raise RigError(f"baud must be positive, or None for no delay, got {baud}")
        self._per_byte = BITS_PER_BYTE / baud if baud else 0.0
        self._chances = (damage, drop, duplicate)
        self._fault = damage + drop + duplicate
        self._rng = np.random.default_rng(seed)
        self._until_fault = self._gap()
        self._queue: deque[tuple[float, bytes]] = deque()
        self._free_at = -math.inf
        self.waiting = 0
        self._limit = limit
        self.sent = 0
        self.faulty = 0
        self._cut = False

    @property
    def cut(self) -> bool:
        """Whether the cable is out: nothing enters, and bytes under way are lost."""
        return self._cut

    @cut.setter
    def cut(self, out: bool) -> None:
        self._cut = out
        if out:
            self._queue.clear()
            self.waiting = 0
            self._free_at = -math.inf

    def send(self, data: bytes, now: float) -> None:
        """Put bytes in at a time [s], which must not go back."""
        self.sent += len(data)
        if self._cut or not data:
            return
        if self._limit is not None:
            data = data[: max(0, self._limit - self.waiting)]
        if self._fault:
            data = self._with_faults(data)
        start = now if now > self._free_at else self._free_at
        self._free_at = start + len(data) * self._per_byte
        self._queue.append((start, data))
        self.waiting += len(data)

    def receive(self, now: float) -> bytes:
        """The bytes that have arrived by a time [s]."""
        queue = self._queue
        if not queue:
            return b""
        arrived = []
        while queue:
            start, data = queue[0]
            if start + len(data) * self._per_byte <= now + 1e-12:
                arrived.append(data)
                queue.popleft()
                continue
            n = int((now - start) / self._per_byte + 1e-9) if now > start else 0
            if n > 0:
                arrived.append(data[:n])
                queue[0] = (start + n * self._per_byte, data[n:])
            break
        out = b"".join(arrived)
        self.waiting -= len(out)
        return out

    def _gap(self) -> int:
        """Bytes that pass before the next faulty one."""
        return int(self._rng.geometric(self._fault)) - 1 if self._fault else 0

    def _with_faults(self, data: bytes) -> bytes:
        if self._until_fault >= len(data):
            self._until_fault -= len(data)
            return data
        out = bytearray()
        position = 0
        while self._until_fault < len(data) - position:
            at = position + self._until_fault
            out += data[position:at]
            out += self._faulty(data[at])
            self.faulty += 1
            position = at + 1
            self._until_fault = self._gap()
        self._until_fault -= len(data) - position
        return bytes(out + data[position:])

    def _faulty(self, byte: int) -> bytes:
        damage, drop, _ = self._chances
        kind = self._rng.random() * self._fault
        if kind < damage:
            return bytes((byte ^ int(self._rng.integers(1, 256)),))
        return b"" if kind < damage + drop else bytes((byte, byte))

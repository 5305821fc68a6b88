"""A serial line that damages, drops and doubles bytes, all decided by a seed."""

import numpy as np

from rig.simulation import ByteChannel


class FaultyChannel(ByteChannel):
    """A `ByteChannel` with faults: probabilities that a byte is damaged, lost, or arrives twice."""

    def __init__(self, *, damage: float = 0.0, drop: float = 0.0, duplicate: float = 0.0,
                 seed: int = 0, **line: float | None) -> None:  # fmt: skip
        super().__init__(**line)  # pyright: ignore[reportArgumentType]
        self._chances, self._fault = (damage, drop), damage + drop + duplicate
        self._rng = np.random.default_rng(seed)
        self._until_fault = self._gap()

    def send(self, data: bytes, now: float) -> None:
        """Put bytes in at a time [s], some of them faulty."""
        if self._limit is not None:
            data = data[: max(0, self._limit - self.waiting)]
        super().send(self._with_faults(data) if self._fault and not self.cut else data, now)

    def _gap(self) -> int:
        """Bytes that pass before the next faulty one."""
        return int(self._rng.geometric(self._fault)) - 1 if self._fault else 0

    def _with_faults(self, data: bytes) -> bytes:
        out, position = bytearray(), 0
        while self._until_fault < len(data) - position:
            at = position + self._until_fault
            out += data[position:at] + self._faulty(data[at])
            position = at + 1
            self._until_fault = self._gap()
        self._until_fault -= len(data) - position
        return bytes(out + data[position:])

    def _faulty(self, byte: int) -> bytes:
        damage, drop = self._chances
        kind = self._rng.random() * self._fault
        if kind < damage:
            return bytes((byte ^ int(self._rng.integers(1, 256)),))
        return b"" if kind < damage + drop else bytes((byte, byte))
